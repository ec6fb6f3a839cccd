//! Time first: the measurements of each station are smoothed, then the instants are located.

use super::result::{Trajectory, without_correlations};
use crate::base::angle::{median, nearest};
use crate::base::small::{Factor, Vector, add_multiple, add_outer, dot, norm};
use crate::sensors::{KINDS, Kind, Measurement};
use crate::trajectory::images::Choice;
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::measured::{Measured, Place, Record, in_domain, seen};
use crate::trajectory::path::failure::Failure;
use crate::trajectory::path::series::{Noisy, Polynomials, Series};
use std::f64::consts::TAU;

/// Step of numerical derivatives relative to the median interval between instants.
const STEP: f64 = 0.1;
/// Window and degree of the polynomials that determine the motion of a station.
const STATION: Polynomials = Polynomials { window: 5, degree: Some(2) };

/// Smooths the measurements of each station, then locates every instant. N is 3 D.
///
/// Along x(t), a measurement h(x − p) of a station at p(t) has the rate J (x' − p') and the second
/// derivative J (x'' − p'') + u'H u, with u = x' − p' and H the second derivatives of h.
///
/// # Errors
/// No instant can be located, or the polynomials do not exist.
pub fn temporal_first<const D: usize, const N: usize>(
    record: &Record<'_>,
    polynomials: Option<Polynomials>,
) -> Result<Trajectory, Failure> {
    let smoothed = Smoothed::new(record, polynomials)?;
    let smooth = Record { own_sigmas: Some(&smoothed.sigma[0]), ..*record };
    let fixes = Fixes::of::<D>(&smooth, &smoothed.value[0]);
    let choice = Choice::<D>::new(record, &fixes);
    let fixes = fixes.beside(&smooth, &smoothed.value[0], choice.mirror.as_ref()).located()?;
    let motion = Motion::<D>::new(record)?;
    let unit = vec![1.0; record.width()];
    let measured = Measured::<D>::new(
        &Record { sigmas: &unit, own_sigmas: None, ..*record },
        smoothed.value[0].clone(),
    );
    let (mut mean, mut variance) =
        (vec![f64::NAN; record.len() * N], vec![f64::INFINITY; record.len() * N]);
    for t in 0..record.len() {
        let position = &fixes.position[t * D..][..D];
        mean[t * N..][..D].copy_from_slice(position);
        let Some(solution) = Solution::new(&measured, t, &fixes, &smoothed.sigma[0]) else {
            continue;
        };
        let p = measured.relative(t, position);
        let moved = |derivative: usize, m: usize| {
            let rate = smoothed.value[derivative][t * record.width() + measured.column[m]];
            rate + motion.share(t, derivative, measured.one(m), &p)
        };
        let velocity = solution.sum(|m| moved(1, m));
        let bend = |m: usize| motion.bend(t, measured.one(m), &p, &velocity);
        let acceleration = solution.sum(|m| moved(2, m) - bend(m));
        for (derivative, found) in [(1, velocity), (2, acceleration)] {
            mean[t * N + derivative * D..][..D].copy_from_slice(&found);
            let sigma = &smoothed.sigma[derivative][t * record.width()..];
            let own = solution.variance(|m| sigma[measured.column[m]]);
            variance[t * N + derivative * D..][..D].copy_from_slice(&own);
        }
    }
    let mut covariance = without_correlations(&variance, N);
    for t in 0..record.len() {
        let own = &fixes.covariance[t * D * D..][..D * D];
        if own.iter().all(|v| v.is_finite()) {
            for (i, row) in own.chunks_exact(D).enumerate() {
                covariance[(t * N + i) * N..][..D].copy_from_slice(row);
            }
        }
    }
    let image = choice.image(&mean, N)?;
    Ok(Trajectory { image, ..Trajectory::of_fixes::<D, N>(record, fixes, mean, covariance) })
}

/// Smoothed measurements (N, 5, K) with two derivatives and their standard errors: nan and 1 where unknown.
struct Smoothed {
    value: [Vec<f64>; 3],
    sigma: [Vec<f64>; 3],
}

impl Smoothed {
    /// Smooths every series from its first measurement to its last.
    fn new(record: &Record<'_>, polynomials: Option<Polynomials>) -> Result<Self, Failure> {
        let (n, width) = (record.len(), record.width());
        let columns = seen(record, &[0, 1, 2, 3]);
        let rows: Vec<Noisy> = columns.iter().map(|&column| series(record, column)).collect();
        let all = Series::smoothed(record, &rows, polynomials)?;
        let mut value = [(); 3].map(|()| vec![f64::NAN; n * width]);
        let mut sigma = [(); 3].map(|()| vec![1.0; n * width]);
        for ((&column, (y, _)), series) in columns.iter().zip(&rows).zip(&all) {
            let first = y.iter().position(|v| !v.is_nan()).unwrap_or(n);
            let end = y.iter().rposition(|v| !v.is_nan()).map_or(0, |last| last + 1);
            for t in (first..end).filter(|&t| series.sigma[0][t].is_finite()) {
                for derivative in 0..3 {
                    value[derivative][t * width + column] = series.value[derivative][t];
                    sigma[derivative][t * width + column] = series.sigma[derivative][t];
                }
                let smooth = &mut value[0][t * width + column];
                *smooth = in_domain(column, width, *smooth);
            }
        }
        Ok(Self { value, sigma })
    }
}

/// Returns one column of the measurements with its variances; azimuths are unwrapped.
fn series(record: &Record<'_>, column: usize) -> Noisy {
    let turns = Kind::ALL[column * KINDS / record.width()] == Kind::Azimuth;
    let mut y: Vec<f64> =
        record.values.iter().skip(column).step_by(record.width()).copied().collect();
    let mut last = f64::NAN;
    for value in y.iter_mut().filter(|v| turns && !v.is_nan()) {
        if !last.is_nan() {
            *value = nearest(*value, last, TAU);
        }
        last = *value;
    }
    let variance = |t: usize| record.sigmas_at(t)[column].powi(2);
    let variances =
        y.iter().enumerate().map(|(t, v)| if v.is_nan() { 1.0 } else { variance(t) }).collect();
    (y, variances)
}

/// `(J' W J)^-1 J' W` of an instant, with a column for each measurement that is used.
struct Solution<const D: usize>(Vec<(usize, Vector<D>)>);

impl<const D: usize> Solution<D> {
    fn new(measured: &Measured<D>, t: usize, fixes: &Fixes, sigma: &[f64]) -> Option<Self> {
        let width = sigma.len() / fixes.fixes.len();
        let (mut normal, mut columns) = ([[0.0; D]; D], Vec::new());
        for (m, row) in measured.rows(t, Place::at(&fixes.position[t * D..])) {
            let at = t * width + measured.column[m];
            if fixes.outlier[at] {
                continue;
            }
            let weight = sigma[at].powi(-2);
            add_outer(&mut normal, weight, &row.gradient);
            columns.push((m, row.gradient.map(|v| weight * v)));
        }
        let factor = Factor::try_new(&normal, 0.0)?;
        columns.iter_mut().for_each(|(_, column)| *column = factor.solve(column));
        Some(Self(columns))
    }

    fn sum(&self, of: impl Fn(usize) -> f64) -> Vector<D> {
        let mut sum = [0.0; D];
        for (m, column) in &self.0 {
            add_multiple(&mut sum, of(*m), column);
        }
        sum
    }

    fn variance(&self, sigma: impl Fn(usize) -> f64) -> Vector<D> {
        let mut sum = [0.0; D];
        for (m, column) in &self.0 {
            let sigma = sigma(*m);
            for i in 0..D {
                sum[i] += (column[i] * sigma).powi(2);
            }
        }
        sum.map(|v| if v.is_nan() { f64::INFINITY } else { v })
    }
}

/// Velocities and accelerations of the stations.
struct Motion<const D: usize> {
    /// First and second derivatives of the positions, K D numbers for each instant; none if the stations
    /// stand still.
    derivatives: Option<[Vec<f64>; 2]>,
    size: usize,
    step: f64,
}

impl<const D: usize> Motion<D> {
    fn new(record: &Record<'_>) -> Result<Self, Failure> {
        let size = record.width() / KINDS * D;
        let mut steps: Vec<f64> =
            record.time.windows(2).map(|t| t[1] - t[0]).filter(|step| *step > 0.0).collect();
        let interval = if steps.is_empty() { 1.0 } else { median(&mut steps) };
        let mut motion = Self { derivatives: None, size, step: STEP * interval };
        if record.stations.len() > size {
            let mut found = [(); 2].map(|()| vec![0.0; record.stations.len()]);
            for at in 0..size {
                let y: Vec<f64> = record.stations.iter().skip(at).step_by(size).copied().collect();
                let path = Series::of_polynomials(record.time, &y, None, STATION)
                    .map_err(Failure::Error)?;
                for (own, values) in found.iter_mut().zip(&path.value[1..]) {
                    own.iter_mut().skip(at).step_by(size).zip(values).for_each(|(a, b)| *a = *b);
                }
            }
            motion.derivatives = Some(found);
        }
        Ok(motion)
    }

    /// Returns the first or second derivative of a station's position.
    fn of(&self, t: usize, derivative: usize, index: usize) -> Vector<D> {
        let Some(derivatives) = &self.derivatives else { return [0.0; D] };
        let own = &derivatives[derivative - 1][t * self.size + index * D..];
        std::array::from_fn(|i| own[i])
    }

    /// Returns the part that the motion of a station subtracts from a derivative of its measurement.
    fn share(&self, t: usize, derivative: usize, one: &Measurement<D>, p: &Vector<D>) -> f64 {
        let moved = self.of(t, derivative, one.index);
        let own = dot(&one.row(p).gradient, &moved);
        if one.kind != Kind::RangeDifference {
            return own;
        }
        let first = self.of(t, derivative, 0);
        own + dot(p, &std::array::from_fn(|i| moved[i] - first[i])) / norm(p)
    }

    /// Returns the second derivative of a measurement along a straight path, by differences.
    fn bend(&self, t: usize, one: &Measurement<D>, p: &Vector<D>, velocity: &Vector<D>) -> f64 {
        let (own, first) = (self.of(t, 1, one.index), self.of(t, 1, 0));
        let residual = |time: f64| {
            let mut shifted = one.clone();
            for i in 0..D {
                shifted.station[i] += time * (own[i] - first[i]);
            }
            let ahead = std::array::from_fn(|i| p[i] + time * (velocity[i] - first[i]));
            shifted.row(&ahead).residual
        };
        let (behind, here, ahead) = (residual(-self.step), residual(0.0), residual(self.step));
        let near = |difference| {
            if one.kind.is_angle() { nearest(difference, 0.0, TAU) } else { difference }
        };
        (near(here - ahead) - near(behind - here)) / self.step.powi(2)
    }
}

//! What the covariances that a sensor states tell about the gain of its filter.
//!
//! A Kalman filter that states its own covariances P⁺ has the gain `P⁺ H' R⁻¹`, where R is the noise that it assumes,
//! in the units of these covariances. Then a plot moves the velocity by `P_vp P_pp⁻¹` times what it moves the position.
//! The covariance before the plot is `M = P⁺ + P⁺ H' N H P⁺` with `N = (R − P_pp)⁻¹`. In a filter of nearly constant
//! velocity, the process noise `Q = M − F P F'`, where P is the covariance of the row before, has `Q_pv = T/2 Q_vv`,
//! whether its acceleration is white or constant during the time T between the rows. These equations are linear in N,
//! and determine R, whatever noise the filter assumes.

use super::row::Row;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use nalgebra::{Matrix2, SMatrix, Vector2};
use serde::{Deserialize, Serialize};

/// Largest asymmetry of N, relative to its trace, and limits of `Q_pp / (T² Q_vv)`: 1/4 if the acceleration is constant
/// between rows, 1/3 if it is white.
const SYMMETRIC: f64 = 0.02;
const SHARES: [f64; 2] = [0.23, 0.35];
/// Logarithm of the ratios of two rows up to which they agree, and number and share of such rows from which on the
/// covariances are those of the filter.
const ALIKE: f64 = 0.02;
const FEWEST: f64 = 20.0;
const MOST: f64 = 0.5;
/// Relative and absolute difference of velocities, m/s, up to which they move as the covariances state.
const RELATIVE: f64 = 0.05;
const ABSOLUTE: f64 = 0.05;

/// Numbers of rows of a sensor, and of those that agree with the rows before about the noise of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Agreement {
    rows: f64,
    agreed: f64,
}

impl Agreement {
    /// Adds the noise of a row, relative to that of the sensor, and that of the row before.
    fn see(&mut self, last: Option<f64>, ratio: Option<f64>) {
        self.rows += 1.0;
        let (Some(last), Some(ratio)) = (last, ratio) else { return };
        self.agreed += f64::from(u8::from((ratio / last).ln().abs() < ALIKE));
    }

    /// Adds other rows.
    pub fn add(&mut self, other: &Self) {
        self.rows += other.rows;
        self.agreed += other.agreed;
    }

    /// Whether the sensor states the covariances of its filter.
    pub fn is_sure(&self) -> bool {
        self.agreed >= FEWEST && self.agreed >= MOST * self.rows
    }
}

/// Compares the covariances of successive rows of a track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Covariances {
    last: Row,
    /// Noise of the filter relative to that of the sensor, from the last two rows.
    ratio: Option<f64>,
    /// What was found since it was last taken.
    pub found: Agreement,
}

impl Covariances {
    /// Starts with a row.
    pub fn new(row: &Row) -> Self {
        Self { last: *row, ratio: None, found: Agreement::default() }
    }

    /// Returns the innovation behind a row with this correction of position and velocity, if the covariance of the
    /// row and that of the row before say what noise the filter assumes.
    pub fn innovation(
        &mut self,
        row: &Row,
        correction: [f64; 4],
        radar: &Radar,
    ) -> Option<[f64; 2]> {
        let after = row.estimate(radar).covariance;
        let noise = is_moved_as_stated(correction, &after)
            .then(|| {
                let before = self.last.estimate(radar).covariance;
                assumed(&before, &after, row.time - self.last.time)
            })
            .flatten();
        let ratio = noise.and_then(|noise| {
            let own = radar.noise_at([row.state[0], row.state[1]], row.above(radar));
            Some((matrix(own).try_inverse()? * noise).trace())
        });
        self.found.see(self.ratio, ratio);
        (self.ratio, self.last) = (ratio, *row);
        let [x, y, ..] = correction;
        Some((noise? * block(&after, 0, 0).try_inverse()? * Vector2::new(x, y)).into())
    }
}

/// Whether the correction of a state, position and velocity, is one that its covariance allows by a single plot.
pub(super) fn is_moved_as_stated(correction: [f64; 4], covariance: &SMatrix<f64, 4, 4>) -> bool {
    let [x, y, vx, vy] = correction;
    let Some(inverse) = block(covariance, 0, 0).try_inverse() else { return false };
    let by = block(covariance, 2, 0) * inverse * Vector2::new(x, y);
    (by[0] - vx).hypot(by[1] - vy) <= RELATIVE * vx.hypot(vy) + ABSOLUTE
}

/// Returns the noise that a filter assumes, from the covariances of two successive rows with the time t between them;
/// `None` if they are not those of a filter of nearly constant velocity.
fn assumed(
    before: &SMatrix<f64, 4, 4>,
    after: &SMatrix<f64, 4, 4>,
    t: f64,
) -> Option<Matrix2<f64>> {
    let [pp, pv, vv] = [(0, 0), (0, 2), (2, 2)].map(|(i, j)| block(after, i, j));
    let [last_pp, last_pv, last_vv] = [(0, 0), (0, 2), (2, 2)].map(|(i, j)| block(before, i, j));
    let known = pv - last_pv - last_vv * t - (vv - last_vv) * (0.5 * t);
    let factor = (pp - pv.transpose() * (0.5 * t)).try_inverse()?;
    let n = -factor * known * pv.try_inverse()?;
    let is_symmetric = (n[(0, 1)] - n[(1, 0)]).abs() <= SYMMETRIC * n.trace();
    let n = (n + n.transpose()) * 0.5;
    let speed = (vv + pv.transpose() * n * pv - last_vv).trace();
    let place = pp + pp * n * pp - last_pp - last_vv * (t * t);
    let share = (place.trace() - 2.0 * t * last_pv.trace()) / (t * t * speed);
    let is_usual = SHARES[0] < share && share < SHARES[1];
    let is_definite = n.trace() > 0.0 && n.determinant() > 0.0;
    if is_symmetric && is_usual && is_definite { Some(n.try_inverse()? + pp) } else { None }
}

fn matrix(Plane { xx, xy, yy }: Plane) -> Matrix2<f64> {
    Matrix2::new(xx, xy, xy, yy)
}

fn block(matrix: &SMatrix<f64, 4, 4>, i: usize, j: usize) -> Matrix2<f64> {
    matrix.fixed_view::<2, 2>(i, j).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Matrix2<f64> = Matrix2::new(900.0, 200.0, 200.0, 2500.0);

    /// Noise that is found from the covariances of a filter, times `scale`, whose gaps differ.
    fn found(density: f64, is_white: bool, scale: f64) -> Vec<Matrix2<f64>> {
        let mut p = SMatrix::<f64, 4, 4>::identity() * 1e4;
        let mut found = Vec::new();
        for t in [4.0_f64, 4.1, 8.0, 4.0, 3.9, 4.0] {
            let (mut f, mut q) = (SMatrix::<f64, 4, 4>::identity(), SMatrix::<f64, 4, 4>::zeros());
            for k in 0..2 {
                f[(k, k + 2)] = t;
                let (a, b, c) = if is_white {
                    (t * t * t / 3.0, t * t / 2.0, t)
                } else {
                    (t.powi(4) / 4.0, t.powi(3) / 2.0, t * t)
                };
                q[(k, k)] = density * a;
                q[(k, k + 2)] = density * b;
                q[(k + 2, k)] = density * b;
                q[(k + 2, k + 2)] = density * c;
            }
            let last = p;
            let m = f * p * f.transpose() + q;
            let gain =
                m.fixed_view::<4, 2>(0, 0) * (block(&m, 0, 0) + NOISE).try_inverse().unwrap();
            p = m - gain * m.fixed_view::<2, 4>(0, 0);
            found.push(assumed(&(last * scale), &(p * scale), t).unwrap());
        }
        found
    }

    #[test]
    fn the_noise_that_covariances_imply() {
        for (density, is_white, scale) in [(1.0, true, 1.0), (0.05, true, 0.5), (4.0, false, 2.0)] {
            let found = found(density, is_white, scale);
            assert!(found.iter().all(|r| (r / scale - NOISE).amax() < 1e-4), "{found:?}");
        }
        let other = SMatrix::from_diagonal(&nalgebra::Vector4::new(900.0, 900.0, 9.0, 9.0));
        assert_eq!(assumed(&other, &other, 4.0), None);
    }

    #[test]
    fn covariances_are_those_of_the_filter_if_rows_agree() {
        let (mut same, mut other) = (Agreement::default(), Agreement::default());
        for k in 0..30 {
            same.see(Some(2.0), Some(2.0 + 0.001 * f64::from(k % 2)));
            other.see(Some(2.0), Some(if k % 2 == 0 { 1.0 } else { 3.0 }));
        }
        assert!(same.is_sure() && !other.is_sure() && !Agreement::default().is_sure());
    }

    #[test]
    fn velocities_move_as_positions_do() {
        let mut covariance = SMatrix::<f64, 4, 4>::identity() * 100.0;
        for k in 0..2 {
            covariance[(k, k + 2)] = 10.0;
            covariance[(k + 2, k)] = 10.0;
        }
        assert!(is_moved_as_stated([50.0, -20.0, 5.0, -2.0], &covariance));
        assert!(!is_moved_as_stated([50.0, -20.0, 5.0, -3.0], &covariance));
        assert!(!is_moved_as_stated([50.0, -20.0, 5.0, -2.0], &SMatrix::repeat(f64::NAN)));
    }
}

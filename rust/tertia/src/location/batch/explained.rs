//! What explains that the measurements of many instants contradict each other: one number that all of them have
//! in common.
//!
//! Ranges to a target above the stations are too long by `q / 2 r` in the plane, with the squared height q; a
//! compass or a delay that all stations share is an offset of a kind; a clock that is fast by τ changes
//! measurements by minus τ times their rates. Each of these is compared with lasting errors of the single
//! stations by their evidence. It explains the contradictions if it is far likelier, leaves nothing that looks
//! like a lasting error, and if eight parts of the record agree on it.

use super::lasting::Sums;
use crate::base::small::{Factor, Vector, add_multiple, add_outer, dot};
use crate::location::search::fix::Instant;
use crate::location::solver::Locator;
use crate::location::solver::record::Record;
use crate::sensors::{KINDS, Kind, Measurement, Row};

/// Least and largest number of instants, evenly spread.
const LEAST: usize = 20;
const SAMPLE: usize = 256;
/// Largest number of series of measurements, because the cost grows with the cube.
const MOST: usize = 40;
/// Parts of a record that have to agree.
const PARTS: usize = 8;
/// Standard deviation of the effect on the measurements before, in their standard deviations.
const WIDE: f64 = 10.0;
/// Least logarithm of the odds, number of standard deviations from 0, and effect in standard deviations of the
/// measurements.
const ODDS: f64 = 7.0;
const SURELY: f64 = 10.0;
const MATERIAL: f64 = 1.0;
/// Largest offset of elevations, rad: where they seem to have a larger one, they are measured in another way.
const TILT: f64 = 0.2;
/// Number of times that a height is improved, and of steps of each position to it.
const ROUNDS: usize = 6;
const STEPS: usize = 3;
/// Least range in the plane, relative to a range in space.
const SHORTEST: f64 = 0.01;

/// One number that explains contradictions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// Ranges in space are taken for ranges in the plane; the squared height of the target.
    Slant,
    /// Measurements of this kind are all too large.
    Offset(usize),
    /// The clock of this station is fast.
    Clock(usize),
}

/// What explains the contradictions: how large it is, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explanation {
    /// What it is.
    pub cause: Cause,
    /// Its value, in metres, square metres, radians or seconds.
    pub value: f64,
    /// Standard deviation of the value.
    pub sigma: f64,
}

/// Causes, and the series of measurements with lasting errors: the columns of the unknowns.
struct Columns {
    causes: Vec<Cause>,
    places: Vec<usize>,
    stations: usize,
}

/// Sums of each part of a record, and the squares and the number of the effects of each cause.
struct Parts {
    sums: Vec<Sums>,
    squares: Vec<f64>,
    counts: Vec<f64>,
}

impl Locator {
    /// Returns what explains the contradictions of instants without outliers, at these positions (N D). Clocks
    /// are only considered if the velocities (N D) are given. None if nothing has to be explained, or if there
    /// are times of arrival or range differences. O(N (M + K)² + K⁴) for M series and K stations.
    pub fn explanation<const D: usize>(
        &self,
        instants: &[Instant<'_>],
        positions: &[f64],
        velocities: Option<&[f64]>,
    ) -> Option<Explanation> {
        let columns = Columns::of::<D>(instants, velocities.is_some())?;
        let none = vec![0.0; columns.causes.len()];
        let mut at = none.clone();
        let mut best = None;
        for _ in 0..ROUNDS {
            let slant = columns.causes.iter().position(|cause| *cause == Cause::Slant);
            let squared = slant.map_or(0.0, |slant| at[slant]);
            let parts = columns.sums::<D>(self, instants, (positions, velocities), squared);
            let (cause, sigma, told) = parts.likeliest(&at)?;
            let change = told - at[cause];
            best = Some((cause, told, sigma));
            if Some(cause) != slant || change.abs() < 0.1 * sigma {
                break;
            }
            at.clone_from(&none);
            at[cause] = told.max(0.0);
        }
        let (cause, value, sigma) = best?;
        let parts = {
            let squared = if columns.causes[cause] == Cause::Slant { at[cause] } else { 0.0 };
            columns.sums::<D>(self, instants, (positions, velocities), squared)
        };
        let is_right = match columns.causes[cause] {
            Cause::Slant => value > 0.0,
            Cause::Offset(kind) if kind == Kind::Elevation as usize => value.abs() < TILT,
            _ => true,
        };
        let sigma = sigma.max(parts.explains(cause, &at, value)?);
        (is_right && value.abs() > SURELY * sigma).then_some(Explanation {
            cause: columns.causes[cause],
            value,
            sigma,
        })
    }
}

impl Columns {
    fn of<const D: usize>(instants: &[Instant<'_>], has_velocities: bool) -> Option<Self> {
        let width = instants.first().filter(|_| instants.len() >= LEAST)?.values.len();
        let stations = width / KINDS;
        let is_measured = |place: usize| instants.iter().any(|one| !one.values[place].is_nan());
        let places: Vec<usize> = (0..width).filter(|place| is_measured(*place)).collect();
        let is_timed =
            places.iter().any(|place| *place >= Kind::RangeDifference as usize * stations);
        if is_timed || places.len() > MOST {
            return None;
        }
        let has = |kind: usize| places.iter().any(|place| place / stations == kind);
        let kinds = (0..KINDS).filter(|kind| has(*kind));
        let mut causes: Vec<Cause> = kinds.map(Cause::Offset).collect();
        if D == 2 && has(Kind::Range as usize) {
            causes.push(Cause::Slant);
        }
        if has_velocities {
            let own = |station: usize| places.iter().any(|place| place % stations == station);
            causes.extend((0..stations).filter(|station| own(*station)).map(Cause::Clock));
        }
        Some(Self { causes, places, stations })
    }

    /// Returns the sums of each part if this is the squared height of the target.
    fn sums<const D: usize>(
        &self,
        locator: &Locator,
        instants: &[Instant<'_>],
        (positions, velocities): (&[f64], Option<&[f64]>),
        squared: f64,
    ) -> Parts {
        let count = self.causes.len();
        let mut parts = Parts {
            sums: (0..PARTS).map(|_| Sums::new(count, self.places.len())).collect(),
            squares: vec![0.0; count],
            counts: vec![0.0; count],
        };
        let (size, mut record) = (instants.len().min(SAMPLE), Record::<D, D>::default());
        for i in 0..size {
            let t = i * instants.len() / size;
            let instant = &instants[t];
            let of = |all: &[f64]| -> Vector<D> { std::array::from_fn(|a| all[t * D + a]) };
            let velocity = velocities.map_or([0.0; D], of);
            let mut p = of(positions);
            (0..D).for_each(|a| p[a] -= instant.stations[a]);
            if p.iter().chain(&velocity).any(|v| !v.is_finite()) {
                continue;
            }
            let mut values = instant.values.to_vec();
            if squared > 0.0 {
                let ranges = &mut values[..self.stations];
                ranges.iter_mut().for_each(|z| *z = in_the_plane(*z, squared));
            }
            record.read(&Instant { values: &values, ..*instant }, locator.correlation);
            if record.is_blurred(instant) {
                record.blur(instant, &p);
            }
            if squared > 0.0 {
                p = stepped(&record, p);
            }
            record.rows.clear();
            record.rows.extend(record.measurements.iter().map(|m| m.row_at(&p)));
            self.add(&record, (&p, &velocity), i * PARTS / size, &mut parts);
        }
        parts
    }

    /// Adds the measurements of an instant to a part.
    fn add<const D: usize>(
        &self,
        record: &Record<D, D>,
        (p, velocity): (&Vector<D>, &Vector<D>),
        part: usize,
        parts: &mut Parts,
    ) {
        let effects = |m: &Measurement<D>, row: &Row<D>, own: &mut Vec<(usize, f64)>| {
            let place = m.kind as usize * self.stations + m.index;
            let Ok(series) = self.places.binary_search(&place) else { return };
            for (at, cause) in self.causes.iter().enumerate() {
                let effect = match *cause {
                    Cause::Slant if m.kind == Kind::Range => {
                        0.5 * m.precision / m.path(p).max(m.value.abs())
                    }
                    Cause::Offset(kind) if kind == m.kind as usize => m.precision,
                    Cause::Clock(station) if station == m.index => -dot(&row.gradient, velocity),
                    _ => continue,
                };
                own.push((at, effect));
            }
            own.push((self.causes.len() + series, 1.0));
        };
        let mut own = Vec::new();
        for (m, row) in record.measurements.iter().zip(&record.rows) {
            own.clear();
            effects(m, row, &mut own);
            for &(at, effect) in own.iter().filter(|(at, _)| *at < self.causes.len()) {
                parts.squares[at] += effect * effect;
                parts.counts[at] += 1.0;
            }
        }
        parts.sums[part].add(record, &[], effects);
    }
}

impl Parts {
    /// Returns the prior standard deviations if only this cause may be present.
    fn prior(&self, cause: Option<usize>) -> Vec<f64> {
        let of = |at: usize| match Some(at) == cause && self.squares[at] > 0.0 {
            true => WIDE * (self.counts[at] / self.squares[at]).sqrt(),
            false => 0.0,
        };
        (0..self.squares.len()).map(of).collect()
    }

    fn whole(&self) -> Sums {
        let mut whole = self.sums[0].clone();
        self.sums[1..].iter().for_each(|part| whole.join(part));
        whole
    }

    /// Returns the factor of the variance of the noise.
    fn noise(&self, whole: &Sums, at: &[f64]) -> Option<f64> {
        let all = (0..self.squares.len()).map(Some).chain([None]);
        let each = all.filter_map(|cause| whole.noise(&self.prior(cause), at));
        each.min_by(f64::total_cmp)
    }

    /// Returns the cause with the largest evidence, its standard deviation and its mean; none if nothing has to
    /// be explained, or if it is not likelier than lasting errors.
    fn likeliest(&self, at: &[f64]) -> Option<(usize, f64, f64)> {
        let mut whole = self.whole();
        let is_first = at.iter().all(|v| *v == 0.0);
        if is_first && whole.mixed(&self.prior(None), at)?.nothing > 0.5 {
            return None;
        }
        let noise = self.noise(&whole, at)?;
        whole.reduce(noise);
        let null = whole.mixed(&self.prior(None), at)?;
        let of = |cause: usize| Some((cause, whole.mixed(&self.prior(Some(cause)), at)?));
        let all = (0..at.len()).filter_map(of);
        let (cause, told) = all.max_by(|(_, a), (_, b)| a.evidence.total_cmp(&b.evidence))?;
        let is_likelier = told.evidence - null.evidence > ODDS;
        is_likelier.then(|| (cause, told.sigma(cause), at[cause] + told.mean[cause]))
    }

    /// Returns the standard deviation of a cause as the parts of the record have it; none if it leaves lasting
    /// errors, or if its effect is small.
    fn explains(mut self, cause: usize, at: &[f64], value: f64) -> Option<f64> {
        let mut whole = self.whole();
        let (noise, prior) = (self.noise(&whole, at)?, self.prior(Some(cause)));
        whole.reduce(noise);
        self.sums.iter_mut().for_each(|part| part.reduce(noise));
        let told = whole.mixed(&prior, at)?;
        let is_material = value.abs() * WIDE > MATERIAL * prior[cause];
        (is_material && told.nothing > 0.5).then(|| whole.spread(&self.sums, &prior, at, cause))?
    }
}

/// Returns the range in the plane of a target with this squared height.
fn in_the_plane(range: f64, squared: f64) -> f64 {
    (range * range - squared).max((SHORTEST * range).powi(2)).sqrt()
}

/// Returns the position of the least squares near a position relative to the first station.
fn stepped<const D: usize>(record: &Record<D, D>, mut p: Vector<D>) -> Vector<D> {
    for _ in 0..STEPS {
        let (mut normal, mut right) = ([[0.0; D]; D], [0.0; D]);
        for row in record.measurements.iter().map(|m| m.row(&p)) {
            add_multiple(&mut right, row.residual, &row.gradient);
            add_outer(&mut normal, 1.0, &row.gradient);
        }
        let Some(factor) = Factor::try_new(&normal, 0.0) else { break };
        let step = factor.solve(&right);
        (0..D).for_each(|a| p[a] += step[a]);
    }
    p
}

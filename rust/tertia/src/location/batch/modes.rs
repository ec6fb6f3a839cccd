//! Positions of an instant for each set of measurements that may be wrong, if there are too few redundant
//! measurements for the weights of a robust fit to show which are wrong.

use crate::base::small::{Vector, quadratic};
use crate::location::descent::minimum::{SAME_MINIMUM as SAME, SLOPE};
use crate::location::descent::starts;
use crate::location::descent::{End, Loss, Problem};
use crate::location::search::fix::Instant;
use crate::location::search::least;
use crate::location::solver::record::NOWHERE;
use crate::location::solver::{Locator, Workspace};
use crate::sensors::{KINDS, Kind, Measurement, Row};

/// Largest number of redundant measurements: with more, the weights of a robust fit show which are wrong.
const MOST: usize = 2;
/// Standard deviation of wrong measurements in the search for positions, in stated sigmas.
const WRONG: f64 = 20.0;
/// Largest number of descents for each set of wrong measurements.
const TRIES: usize = 3;
/// Largest number of steps of a descent.
const STEPS: usize = 8;
/// Length of a step, in standard deviations, below which a descent ends. This is enough, because one more
/// step is taken when the likelihood is computed.
const NEAR: f64 = 0.1;
/// Difference in log likelihood from the best position of a set beyond which its other position is left out.
const UNLIKELY: f64 = 10.0;

/// A position that explains the measurements if a certain set of them is wrong.
pub(in crate::location) struct Mode<const D: usize> {
    /// Set of the wrong measurements: bit i is measurement i.
    pub wrong: u32,
    /// Position relative to the first station.
    pub position: Vector<D>,
    /// Residuals of all measurements and their derivatives, in units of the stated sigmas.
    pub rows: Vec<Row<D>>,
}

/// The positions of an instant for all sets of wrong measurements.
pub(in crate::location) struct Modes<const D: usize> {
    pub modes: Vec<Mode<D>>,
    /// Kind of each measurement and its index in the instant; `None` for a height.
    pub places: Vec<Option<(usize, usize)>>,
    /// Whether each measurement, and its sigma, may be wrong.
    pub free: Vec<bool>,
}

impl Locator {
    /// Whether an instant has redundant measurements, but too few for a robust fit, and no angles: large
    /// errors of angles, such as those of the alignment of a station, last and do not vary from instant to
    /// instant.
    pub(in crate::location) fn has_few(&self, instant: &Instant<'_>, dimension: usize) -> bool {
        let height = usize::from(instant.height.is_some());
        let count = instant.values.iter().filter(|v| !v.is_nan()).count() + height;
        let redundant = count.saturating_sub(dimension);
        let stations = instant.values.len() / KINDS;
        let angles = Kind::Azimuth as usize * stations..(Kind::Elevation as usize + 1) * stations;
        (1..=MOST).contains(&redundant)
            && instant.values[angles].iter().all(|v| v.is_nan())
            && self.is_robust()
            && !self.has_arrivals(instant)
            && self.loss(redundant, false) == Loss::SQUARE
    }

    /// Returns the positions of an instant with few redundant measurements: at most two for each set with
    /// no more wrong measurements than there are redundant ones, and one for each set with one more.
    /// O(2^M M).
    pub(in crate::location) fn modes<const D: usize>(
        &self,
        instant: &Instant<'_>,
        free: &[bool],
        workspace: &mut Workspace<D>,
    ) -> Modes<D> {
        let record = &mut workspace.own.records[0];
        record.read(instant, self.correlation);
        let stations = free.len() / KINDS;
        let is_known = |place: usize| place != NOWHERE;
        let places = record.places.iter().map(|&p| is_known(p).then_some((p / stations, p)));
        let places: Vec<_> = places.collect();
        let free: Vec<bool> = places.iter().map(|own| own.is_some_and(|(_, p)| free[p])).collect();
        let mut found = Modes { modes: Vec::new(), places, free };
        if record.unknown {
            return found;
        }
        let (measurements, extent) = (&record.measurements, record.extent);
        let candidates = &mut workspace.own.buffers.candidates;
        candidates.find(measurements, extent);
        let (points, mut costs) = (&candidates.points, Vec::new());
        let redundant = measurements.len() - D;
        let may_be =
            |wrong: u32| (0..measurements.len()).all(|i| found.free[i] || !is_in(wrong, i));
        let sets = |count: usize| {
            let all = 0..1_u32 << measurements.len();
            all.filter(move |wrong| wrong.count_ones() as usize == count)
        };
        let stretched = |wrong: u32| -> Vec<Measurement<D>> {
            let mut own = measurements.clone();
            let all = own.iter_mut().enumerate();
            all.filter(|(i, _)| is_in(wrong, *i)).for_each(|(_, own)| own.precision /= WRONG);
            own
        };
        let mut modes = Vec::new();
        let mut add = |wrong: u32, position: Vector<D>| {
            let rows = measurements.iter().map(|m| m.row_at(&position)).collect();
            modes.push(Mode { wrong, position, rows });
        };
        let mut ends = Vec::new();
        for wrong in (0..=redundant).flat_map(sets).filter(|wrong| may_be(*wrong)) {
            let own = stretched(wrong);
            let problem = Problem { measurements: &own, extent };
            starts::costs(&own, points, Loss::SQUARE, &mut costs);
            for (position, _) in minima(&problem, points, &mut costs) {
                ends.push(position);
                add(wrong, position);
            }
        }
        // the other measurements determine no position: take the best one of those found above
        for wrong in sets(redundant + 1).filter(|wrong| may_be(*wrong)) {
            starts::costs(&stretched(wrong), &ends, Loss::SQUARE, &mut costs);
            if let Some(at) = least(&costs) {
                add(wrong, ends[at]);
            }
        }
        found.modes = modes;
        found
    }
}

/// Whether a set contains measurement i.
pub(in crate::location) fn is_in(set: u32, i: usize) -> bool {
    set >> i & 1 == 1
}

/// Returns the lowest minimum that descents from the points lead to and, unless it is far less likely, the
/// next one, with their costs.
fn minima<const D: usize>(
    problem: &Problem<'_, D, D>,
    points: &[Vector<D>],
    costs: &mut [f64],
) -> Vec<(Vector<D>, f64)> {
    let mut found: Vec<(Vector<D>, f64)> = Vec::new();
    for _ in 0..TRIES {
        let Some(at) = least(costs) else { break };
        let mut state = points[at];
        let (end, normal) = problem.descend(&mut state, Loss::SQUARE, 1.0, STEPS, NEAR);
        costs[at] = f64::INFINITY;
        let distance = |point: &Vector<D>| {
            quadratic(&normal.matrix, &std::array::from_fn(|i| point[i] - state[i]))
        };
        for (point, cost) in points.iter().zip(costs.iter_mut()) {
            if distance(point) <= SAME.max((*cost - normal.cost) / SLOPE) {
                *cost = f64::INFINITY;
            }
        }
        let ended = matches!(end, End::Converged | End::Moving);
        if ended && found.iter().all(|(own, _)| distance(own) > SAME) {
            found.push((state, normal.cost));
        }
    }
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found.truncate(2);
    found.dedup_by(|b, a| b.1 > a.1 + UNLIKELY);
    found
}

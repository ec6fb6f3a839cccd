//! Both filters over the measurements of one target, without outliers.

use super::mixture::{Fix, Mixture, State};
use super::two_filter::{Instant, Models, Place, TwoFilter};
use crate::base::small::{Factor, Matrix, Vector};
use std::ops::Range;

/// A state with the probabilities of the models and the means of their own states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Solution<const N: usize, const M: usize> {
    pub state: State<N>,
    pub probability: [f64; M],
    pub own: [f64; M],
}

/// A measurement less the state given by all others, with its covariance and its squared normalised
/// distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Innovation<const D: usize> {
    pub value: Vector<D>,
    pub covariance: Matrix<D>,
    pub distance: f64,
    /// Squared normalised distance of the rate from what all other measurements and this value
    /// give; 0 if there is no rate.
    pub distance_of_rate: f64,
}

/// Measurements of one target, in the order of time, and whether each of them is used.
#[derive(Clone)]
pub(super) struct Record<const D: usize> {
    pub time: Vec<f64>,
    pub fixes: Vec<Fix<D>>,
    pub used: Vec<bool>,
}

/// States at the wanted times, with none before the first or after the last measurement that is
/// used, and the innovation of each measurement.
pub(super) struct Passes<const N: usize, const M: usize, const D: usize> {
    pub solutions: Vec<Option<Solution<N, M>>>,
    pub innovations: Vec<Option<Innovation<D>>>,
}

impl<const D: usize> Record<D> {
    /// Smooths the measurements. Rates farther than `guard` from what the measurements give are
    /// removed, then measurements farther than `guard` from what all others give, and the filters
    /// run once more. Of neighbours that are all too far, only the farthest is removed: an outlier
    /// draws the estimates beside it away, and a manoeuvre that no model describes is no reason to
    /// leave out all its plots.
    pub fn smooth<L: Models<N, M>, const N: usize, const M: usize>(
        &mut self,
        models: &L,
        wanted: &[f64],
        guard: f64,
    ) -> Passes<N, M, D> {
        let has_rates = self.fixes.iter().any(|fix| fix.rate.is_some());
        let mut passes = self.pass(models, wanted, false);
        let kept: Vec<usize> = (0..self.time.len()).filter(|&i| self.used[i]).collect();
        let far = |passes: &Passes<N, M, D>, distance: fn(&Innovation<D>) -> f64, wrong: f64| {
            let of = |i: &usize| passes.innovations[*i].as_ref().map_or(0.0, distance);
            farthest(&kept.iter().map(of).collect::<Vec<f64>>(), guard, wrong)
        };
        if has_rates {
            // a wrong rate would draw many states away
            let rates = far(&passes, |one| one.distance_of_rate, WRONG * guard);
            rates.iter().for_each(|&k| self.fixes[kept[k]].rate = None);
            passes = self.pass(models, wanted, true);
        }
        let places = far(&passes, |one| one.distance, f64::INFINITY);
        places.iter().for_each(|&k| self.used[kept[k]] = false);
        if places.is_empty() { passes } else { self.pass(models, wanted, true) }
    }

    /// Runs one pass forwards and one backwards, with or without rates. `wanted` includes the times
    /// of all measurements.
    fn pass<L: Models<N, M>, const N: usize, const M: usize>(
        &self,
        models: &L,
        wanted: &[f64],
        with_rates: bool,
    ) -> Passes<N, M, D> {
        let mut passes = Passes {
            solutions: vec![None; wanted.len()],
            innovations: vec![None; self.time.len()],
        };
        let mut plan = Plan::new(self, wanted);
        if !with_rates {
            plan.fixes.iter_mut().for_each(|fix| fix.rate = None);
        }
        let Some(near) = plan.beginning::<N>() else {
            return passes;
        };
        let filter = TwoFilter { models, instants: &plan.instants, fixes: &plan.fixes };
        let start = models.begin(&near, models.stationary());
        filter.run(start, &plan.between, |place, without, with| {
            let row = match place {
                Place::At(k) => plan.row_of_instant[k],
                Place::Between(k) => plan.row_of_between[k],
            };
            let solution =
                Solution { state: with.moments(), probability: with.probability, own: with.own() };
            passes.solutions[row] = Some(solution);
            for i in plan.of_row[row].clone() {
                passes.innovations[i] = self.innovation(i, &plan.of_row[row], without, with);
            }
        });
        passes
    }

    /// Innovation of the measurement `i` from the state without it; `others` are the measurements
    /// of the same instant.
    fn innovation<const N: usize, const M: usize>(
        &self,
        i: usize,
        others: &Range<usize>,
        without: &Mixture<N, M>,
        with: &Mixture<N, M>,
    ) -> Option<Innovation<D>> {
        let mut state = if self.used[i] { *without } else { *with };
        if self.used[i] {
            let rest = others.clone().filter(|&j| j != i && self.used[j]);
            rest.for_each(|j| state.correct(&self.fixes[j]));
        }
        let fix = &self.fixes[i];
        let distance_of_rate = fix.rate.and_then(|_| {
            let mut placed = state;
            placed.correct(&Fix::new(fix.value, fix.covariance));
            placed.moments().distance_of_rate(fix)
        });
        let state = state.moments();
        Some(Innovation {
            value: std::array::from_fn(|d| fix.value[d] - state.mean[d]),
            covariance: state.spread(fix),
            distance: state.distance(fix)?,
            distance_of_rate: distance_of_rate.unwrap_or(0.0),
        })
    }
}

impl<const N: usize, const M: usize, const D: usize> Passes<N, M, D> {
    /// Logarithm of the density of the measurements, each given all others, less a constant. A
    /// measurement farther than `guard` counts as one at that distance.
    pub fn log_density(&self, guard: f64) -> f64 {
        let one = |own: &Innovation<D>| {
            let factor = Factor::try_new(&own.covariance, 0.0);
            -0.5 * (own.distance.min(guard) + factor.map_or(0.0, |own| own.ln_determinant()))
        };
        self.innovations.iter().flatten().map(one).sum()
    }
}

impl<const N: usize, const M: usize> Passes<N, M, 2> {
    /// Mean of the squared normalised distances, relative to its expected value, and the number of them.
    pub fn scatter(&self, guard: f64) -> (f64, f64) {
        let known = self.innovations.iter().flatten().map(|own| 0.5 * own.distance.min(guard));
        let (sum, count) = known.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
        (sum / count, count)
    }
}

/// Squared distance from which a rate is wrong in any case, relative to that of the guard gate.
const WRONG: f64 = 30.0;

/// Indices of distances beyond `guard` that are larger than those beside them, or beyond `wrong`.
fn farthest(distances: &[f64], guard: f64, wrong: f64) -> Vec<usize> {
    let beside = |k: Option<usize>| k.and_then(|k| distances.get(k)).copied().unwrap_or(0.0);
    let neighbours = |k: usize| beside(k.checked_sub(1)).max(beside(Some(k + 1)));
    let is_most = |k: usize| distances[k] > neighbours(k) || distances[k] > wrong;
    let far = |&k: &usize| distances[k] > guard && is_most(k);
    (0..distances.len()).filter(far).collect()
}

/// Instants of the measurements that are used, and the rows to which results belong.
struct Plan<const D: usize> {
    instants: Vec<Instant>,
    fixes: Vec<Fix<D>>,
    row_of_instant: Vec<usize>,
    between: Vec<f64>,
    row_of_between: Vec<usize>,
    /// Measurements at each wanted time.
    of_row: Vec<Range<usize>>,
}

impl<const D: usize> Plan<D> {
    fn new(record: &Record<D>, wanted: &[f64]) -> Self {
        let mut plan = Self {
            instants: Vec::new(),
            fixes: Vec::new(),
            row_of_instant: Vec::new(),
            between: Vec::new(),
            row_of_between: Vec::new(),
            of_row: Vec::with_capacity(wanted.len()),
        };
        let last = (0..record.time.len()).rfind(|&i| record.used[i]);
        let end = last.map_or(f64::NEG_INFINITY, |i| record.time[i]);
        let mut next = 0;
        for (row, &time) in wanted.iter().enumerate() {
            let begin = next;
            while next < record.time.len() && record.time[next] <= time {
                next += 1;
            }
            let first = plan.fixes.len();
            let used = (begin..next).filter(|&i| record.used[i]);
            plan.fixes.extend(used.map(|i| record.fixes[i]));
            if plan.fixes.len() > first {
                plan.instants.push(Instant { time, first, end: plan.fixes.len() });
                plan.row_of_instant.push(row);
            } else if !plan.instants.is_empty() && time < end {
                plan.between.push(time);
                plan.row_of_between.push(row);
            }
            plan.of_row.push(begin..next);
        }
        plan
    }

    /// The first measurement, with rates by least squares from those that follow, and their variances.
    fn beginning<const N: usize>(&self) -> Option<State<N>> {
        let first = self.instants.first()?;
        let origin = &self.fixes[first.first];
        let (mut products, mut sum, mut square) = ([0.0; D], 0.0, 0.0);
        for (k, instant) in self.instants.iter().enumerate().skip(1) {
            let t = instant.time - first.time;
            if k > 1 && t > BEGINNING {
                break;
            }
            let value = self.fixes[instant.first].value;
            (0..D).for_each(|d| products[d] += t * (value[d] - origin.value[d]));
            (sum, square) = (sum + t, square + t * t);
        }
        let mut near = State::new([0.0; N], [0.0; N]);
        near.mean[..D].copy_from_slice(&origin.value);
        if square > 0.0 {
            let variance = 1.0 / square + (sum / square).powi(2);
            for (d, product) in products.iter().enumerate() {
                near.mean[D + d] = product / square;
                near.covariance[D + d][D + d] = variance * origin.covariance[d][d];
            }
        }
        Some(near)
    }
}

/// Time after the first measurement within which measurements determine the first rates, s.
const BEGINNING: f64 = 30.0;

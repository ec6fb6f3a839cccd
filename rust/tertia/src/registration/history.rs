//! Errors of radars over the periods of a recording: they drift, and may change suddenly.
//!
//! Whether and how fast they drift is unknown. Several rates of drift, including zero, are compared by their
//! likelihoods, and the results are averaged. A sudden change is accepted if it is much likelier than no
//! change.

use super::change::{ODDS, Surprise};
use super::gaussian::Gaussian;
use crate::base::interrupt::poll;
use nalgebra::{DMatrix, DVector};

/// Rates of drift relative to the assumed one; the first is as probable as all others together.
const RATES: [f64; 5] = [0.0, 0.25, 1.0, 4.0, 16.0];
/// Size of a sudden change in standard deviations of the prior.
const CHANGE: f64 = 3.0;
/// Smaller changes, in standard deviations of the prior, are drift or errors of blocks.
const LEAST: f64 = 0.1;
/// Largest number of changes.
const MOST: usize = 64;

/// Information and score of the blocks of a period, about errors of zero, in units of the prior.
#[derive(Clone, Debug)]
pub(super) struct Said {
    pub information: DMatrix<f64>,
    pub score: DVector<f64>,
}

impl Said {
    /// Divides the information and the score.
    pub fn divided(self, by: f64) -> Self {
        Self { information: self.information / by, score: self.score / by }
    }
}

/// Estimated errors of all periods.
pub(super) struct History {
    /// Mean and covariance in each period.
    pub known: Vec<(DVector<f64>, DMatrix<f64>)>,
    /// The first period after each change, and the radar that changed.
    pub changes: Vec<(usize, usize)>,
}

/// Times of the periods, rates at which the errors drift, and the columns of the errors of each radar.
pub(super) struct Course<'a> {
    pub middles: &'a [f64],
    pub rates: &'a [f64],
    pub own: &'a [Vec<usize>],
    /// Changes that are known: the first period after each, and the radar.
    pub changes: &'a [(usize, usize)],
}

/// Estimates of the errors in each period, for one rate of drift.
struct Passes {
    /// From the periods before.
    before: Vec<Gaussian>,
    /// From the period itself and those after it.
    after: Vec<Said>,
    /// ln of the likelihood, up to a constant.
    likelihood: f64,
}

impl History {
    /// Estimates the errors from the information of each period. Cost O(T q³) for T periods and q errors, and
    /// again for each change.
    pub fn new(said: &[Said], course: &Course<'_>) -> Self {
        let mut changes = course.changes.to_vec();
        loop {
            let tried = course.tried(said, &changes);
            let likeliest = tried.iter().max_by(|a, b| a.0.total_cmp(&b.0));
            let found = likeliest.and_then(|(_, passes)| passes.change(course, &changes));
            match found {
                Some(change) if changes.len() < MOST => changes.push(change),
                _ => return Self { known: averaged(&tried), changes },
            }
        }
    }
}

impl Course<'_> {
    /// Returns the estimates for each rate of drift, with ln of its weight.
    fn tried(&self, said: &[Said], changes: &[(usize, usize)]) -> Vec<(f64, Passes)> {
        let is_constant = self.rates.iter().all(|rate| *rate == 0.0);
        let count = if is_constant { 1 } else { RATES.len() };
        let each = RATES[..count].iter().map(|share| {
            let rates = self.rates.iter().map(|rate| share * rate).collect();
            let passes = Passes::new(said, self, rates, changes);
            let others = if *share > 0.0 { (count as f64 - 1.0).ln() } else { 0.0 };
            (passes.likelihood - others, passes)
        });
        each.collect()
    }

    /// Calls `add` for each error that changes suddenly before a period.
    fn changed(&self, changes: &[(usize, usize)], period: usize, mut add: impl FnMut(usize)) {
        for (_, radar) in changes.iter().filter(|(first, _)| *first == period) {
            self.own[*radar].iter().for_each(|column| add(*column));
        }
    }
}

impl Passes {
    fn new(
        said: &[Said],
        course: &Course<'_>,
        rates: Vec<f64>,
        changes: &[(usize, usize)],
    ) -> Self {
        let (mut before, mut likelihood) = (Vec::with_capacity(said.len()), 0.0);
        let mut known = Gaussian::new(rates.clone());
        for (t, own) in said.iter().enumerate() {
            poll();
            if t > 0 {
                known.drift(course.middles[t] - course.middles[t - 1]);
            }
            course.changed(changes, t, |i| known.covariance[(i, i)] += CHANGE * CHANGE);
            before.push(known.clone());
            known.update(&own.information, &own.score);
            likelihood += likelihood_of(own, &before[t], &known);
        }
        let order = rates.len();
        let mut after = said.to_vec();
        for t in (1..said.len()).rev() {
            let gap = course.middles[t] - course.middles[t - 1];
            let rest: Vec<f64> = rates.iter().map(|rate| (-rate * gap).exp()).collect();
            let mut added: Vec<f64> = rest.iter().map(|a| 1.0 - a * a).collect();
            course.changed(changes, t, |i| added[i] += CHANGE * CHANGE);
            let added = DMatrix::from_diagonal(&DVector::from_vec(added));
            let sum = DMatrix::identity(order, order) + &after[t].information * added;
            let Some(inverse) = sum.try_inverse() else { continue };
            let rest = DMatrix::from_diagonal(&DVector::from_vec(rest));
            let information = &rest * &inverse * &after[t].information * &rest;
            let score = &rest * &inverse * &after[t].score;
            after[t - 1].information += 0.5 * (&information + information.transpose());
            after[t - 1].score += score;
        }
        Self { before, after, likelihood }
    }

    /// Returns the likeliest change that is not among the known ones, if it is likely enough.
    fn change(&self, course: &Course<'_>, changes: &[(usize, usize)]) -> Option<(usize, usize)> {
        let mut best: Option<(f64, (usize, usize))> = None;
        for (t, (before, after)) in self.before.iter().zip(&self.after).enumerate().skip(1) {
            let known = (&before.mean, &before.covariance);
            let Some(surprise) = Surprise::new(known, (&after.information, &after.score)) else {
                continue;
            };
            for (k, columns) in course.own.iter().enumerate() {
                let Some((odds, size)) = surprise.odds(columns, CHANGE) else { continue };
                let is_new = !changes.contains(&(t, k)) && size > LEAST;
                if odds > ODDS.ln() && is_new && best.is_none_or(|(most, _)| odds > most) {
                    best = Some((odds, (t, k)));
                }
            }
        }
        best.map(|(_, change)| change)
    }
}

/// ln of the likelihood of a period, from the errors as known before and after it.
fn likelihood_of(said: &Said, before: &Gaussian, after: &Gaussian) -> f64 {
    let Said { information, score } = said;
    let (order, mean) = (score.len(), &before.mean);
    let off = score - information * mean;
    let sum = DMatrix::identity(order, order) + &before.covariance * information;
    let explained = 0.5 * off.dot(&(&after.covariance * &off));
    mean.dot(score) - 0.5 * mean.dot(&(information * mean)) + explained
        - 0.5 * sum.determinant().ln()
}

/// Mean and covariance in each period, averaged over all rates.
fn averaged(tried: &[(f64, Passes)]) -> Vec<(DVector<f64>, DMatrix<f64>)> {
    let most = tried.iter().map(|(weight, _)| *weight).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = tried.iter().map(|(weight, _)| (weight - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    let periods = tried.first().map_or(0, |(_, passes)| passes.before.len());
    let known = |passes: &Passes, t: usize| {
        let mut known = passes.before[t].clone();
        known.update(&passes.after[t].information, &passes.after[t].score);
        known
    };
    let period = |t: usize| {
        let each: Vec<Gaussian> = tried.iter().map(|(_, passes)| known(passes, t)).collect();
        let pairs = || weights.iter().map(|weight| weight / total).zip(&each);
        let order = each[0].mean.len();
        let mean = pairs().fold(DVector::zeros(order), |sum, (w, own)| sum + w * &own.mean);
        let covariance = pairs().fold(DMatrix::zeros(order, order), |sum, (w, own)| {
            let off = &own.mean - &mean;
            sum + w * (&own.covariance + &off * off.transpose())
        });
        (mean, covariance)
    };
    (0..periods).map(period).collect()
}

#[cfg(test)]
mod tests;

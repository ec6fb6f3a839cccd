//! The grid of scales, shares and correlation times of lasting errors.

use super::contradictions::{Blocks, Kernel, Point};
use super::measured::Record;
use super::prior::Prior;
use crate::sensors::KINDS;

/// Standard deviations of lasting errors, in those of the measurements.
const SCALES: [f64; 7] = [0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Shares of the variance that drift. None is no error that is exactly the same everywhere: such a
/// one would be told from another by differences that no station has.
const SHARES: [f64; 4] = [0.12, 0.35, 0.7, 1.0];
/// Correlation times, in those of the record.
const TIMES: [f64; 4] = [0.5, 0.15, 0.05, 0.015];
/// Correlation times are longer than so many blocks.
const RESOLVED: f64 = 1.5;
/// Odds of no lasting errors over any.
const NOTHING: f64 = 2.0;
/// Scales of one kind or all with which nothing must be gained where nothing lasts.
const PROBES: [f64; 2] = [0.25, 1.0];
/// Scales where there are several kinds.
const LEVELS: [f64; 4] = [0.15, 0.5, 1.5, 5.0];
/// Stations of which one alone may be wrong: with fewer, others would be as likely.
const SEVERAL: usize = 4;
/// Those that are tried.
const SUSPECTS: usize = 4;
/// Odds that one alone is wrong over any errors that last, scales of its error and of those of the others.
const ALONE: f64 = 0.2;
const ALONE_SCALES: [f64; 3] = [4.0, 16.0, 64.0];
const OTHER_SCALES: [f64; 2] = [0.0, 0.5];
/// Standard deviation of the logarithms of scales of different kinds.
const ALIKE: f64 = 1.2;
/// Probability of no lasting errors from which none are removed.
pub(super) const CERTAIN: f64 = 0.5;
/// Probability below which a point of the grid does not count, over that of the best: many together
/// may.
const UNLIKELY: f64 = 3e-4;
/// Probability of the largest errors that do not count where none are removed: a region of 95 % need not
/// hold what is as unlikely, and it would be most of the variance.
const LARGEST: f64 = 0.05;
/// ln of the likelihood ratio below which a point does not count.
const FALL: f64 = 6.0;

/// How large a part of lasting errors changes, and how.
#[derive(Clone, Copy, Debug)]
struct Drift {
    share: f64,
    time: f64,
    kernel: Kernel,
}

/// Points at which the likelihood is asked for.
pub(super) struct Grid<'a> {
    blocks: &'a Blocks,
    /// Standard deviation of each column, and its number among the kinds that are found; none where
    /// the standard deviation is that of the lasting error.
    sigma: Vec<f64>,
    kind: Vec<Option<usize>>,
    kinds: usize,
    /// Share and time of each column; none where they are found.
    own: Vec<(Option<f64>, Option<f64>)>,
    shares: Vec<f64>,
    times: Vec<f64>,
}

impl<'a> Grid<'a> {
    pub fn new(record: &Record<'_>, blocks: &'a Blocks, prior: &Prior, columns: &[usize]) -> Self {
        let k = record.width() / KINDS;
        let mut found: Vec<usize> =
            columns.iter().filter(|c| prior.sigma[**c].is_nan()).map(|c| c / k).collect();
        found.dedup();
        let kind = |c: &usize| {
            prior.sigma[*c].is_nan().then(|| found.iter().position(|own| *own == c / k)).flatten()
        };
        let sigma = |c: &usize| {
            let given = prior.sigma[*c];
            if given.is_nan() { record.own_sigma(*c) } else { given }
        };
        let span = record.time[record.len() - 1] - record.time[0];
        let step = span / blocks.time.len() as f64;
        let mut times: Vec<f64> =
            TIMES.iter().map(|part| part * span).filter(|t| *t > RESOLVED * step).collect();
        if times.is_empty() {
            times.push(span.max(f64::MIN_POSITIVE));
        }
        // what is given without a share is constant
        let own: Vec<(Option<f64>, Option<f64>)> = columns
            .iter()
            .map(|c| {
                let known = |v: f64| (!v.is_nan()).then_some(v);
                let share = if prior.sigma[*c].is_nan() { None } else { Some(0.0) };
                (known(prior.share[*c]).or(share), known(prior.time[*c]))
            })
            .collect();
        let any_share = own.iter().any(|own| own.0.is_none());
        let any_time = own.iter().any(|own| own.1.is_none() && own.0 != Some(0.0));
        let shares = if any_share { SHARES.to_vec() } else { vec![0.0] };
        let times = if any_time { times } else { vec![span] };
        let (sigma, kind) =
            (columns.iter().map(sigma).collect(), columns.iter().map(kind).collect());
        Self { blocks, sigma, kind, kinds: found.len(), own, shares, times }
    }

    fn point(&self, scales: &[f64], Drift { share, time, kernel }: Drift) -> Point {
        let (constant, drift, times) = (Vec::new(), Vec::new(), Vec::new());
        let mut point = Point { constant, drift, time: times, kernel, alone: None };
        for ((sigma, kind), own) in self.sigma.iter().zip(&self.kind).zip(&self.own) {
            let variance = (kind.map_or(1.0, |kind| scales[kind]) * sigma).powi(2);
            let time = own.1.unwrap_or(time);
            // what drifts for ever does not
            let share = if time.is_finite() { own.0.unwrap_or(share) } else { 0.0 };
            point.constant.push((1.0 - share) * variance);
            point.drift.push(share * variance);
            point.time.push(time);
        }
        point
    }

    /// Points that count, with their probabilities and the growth of the noise.
    pub fn weighed(&self) -> Vec<(Point, f64, f64)> {
        let mut points = self.searched();
        let top = points.iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
        points.iter_mut().for_each(|one| one.1 = (one.1 - top).exp());
        points.retain(|one| one.1 > UNLIKELY);
        let total: f64 = points.iter().map(|one| one.1).sum();
        points.iter_mut().for_each(|one| one.1 /= total);
        let nothing: f64 = points.iter().filter(|one| one.0.is_nothing()).map(|one| one.1).sum();
        if nothing < CERTAIN {
            return points;
        }
        let size = |point: &Point| -> f64 {
            let each = point.constant.iter().zip(&point.drift).zip(&self.sigma);
            each.map(|((constant, drift), sigma)| (constant + drift) / (sigma * sigma)).sum()
        };
        points.sort_by(|a, b| size(&a.0).total_cmp(&size(&b.0)));
        let mut left = 0.0;
        while let Some((_, share, _)) = points.last().filter(|one| left + one.1 <= LARGEST) {
            left += share;
            points.pop();
        }
        points.iter_mut().for_each(|one| one.1 /= 1.0 - left);
        points
    }

    /// Points that may count, with ln of their probabilities and the growth of the noise.
    fn searched(&self) -> Vec<(Point, f64, f64)> {
        let mut own = Vec::new();
        for kernel in [Kernel::Markov, Kernel::Smooth] {
            for &share in &self.shares {
                own.extend(self.times.iter().map(|&time| Drift { share, time, kernel }));
            }
        }
        let each = (own.len() as f64).ln();
        let total: f64 = SCALES.iter().map(|scale| cauchy(*scale)).sum();
        match self.kinds {
            0 => own.iter().map(|own| self.judged(&[], *own, 0.0)).collect(),
            1 => {
                let none = self.judged(&[0.0], own[0], NOTHING.ln());
                if self.blocks.count == 0 {
                    // nothing can tell
                    return vec![none];
                }
                let some = SCALES.iter().flat_map(|scale| own.iter().map(move |own| (scale, own)));
                let prior = |scale: f64| (cauchy(scale) / total).ln() - each;
                let some = some.map(|(scale, own)| self.judged(&[*scale], *own, prior(*scale)));
                std::iter::once(none).chain(some).chain(self.alone()).collect()
            }
            _ => self.several(&own).into_iter().chain(self.alone()).collect(),
        }
    }

    /// Points with one number of an instant that is far more wrong than the others.
    fn alone(&self) -> Vec<(Point, f64, f64)> {
        let (first, last) = (self.shares[0], self.shares[self.shares.len() - 1]);
        let (slow, fast) = (self.times[0], self.times[self.times.len() / 2]);
        let drifts = [(first, slow), (last, slow), (last, fast)];
        let suspects = self.suspects(Drift { share: first, time: slow, kernel: Kernel::Markov });
        let each = self.kind.len() * ALONE_SCALES.len() * OTHER_SCALES.len() * drifts.len();
        let prior = (ALONE / each as f64).ln();
        let mut points = Vec::new();
        for (share, time) in drifts {
            let drift = Drift { share, time, kernel: Kernel::Markov };
            let of = |scale: f64| self.point(&vec![scale; self.kinds], drift);
            for (other, scale) in OTHER_SCALES.iter().flat_map(|o| ALONE_SCALES.map(|s| (*o, s))) {
                for &at in &suspects {
                    let (mut point, own) = (of(other), of(scale));
                    (point.constant[at], point.drift[at]) = (own.constant[at], own.drift[at]);
                    point.alone = Some(at);
                    let (value, growth) = self.blocks.likelihood(&self.blocks.filter(&point));
                    points.push((point, value + prior, growth));
                }
            }
        }
        points
    }

    /// Numbers of an instant with the largest errors, if there are enough others of their kind.
    fn suspects(&self, drift: Drift) -> Vec<usize> {
        let point = self.point(&vec![ALONE_SCALES[0]; self.kinds], drift);
        let mean = self.blocks.filter(&point).mean;
        let alike = |kind: Option<usize>| self.kind.iter().filter(|own| **own == kind).count();
        let may = |at: &usize| self.kind[*at].is_some() && alike(self.kind[*at]) >= SEVERAL;
        let mut own: Vec<usize> = (0..mean.len()).filter(may).collect();
        let size = |at: usize| (mean[at] / self.sigma[at]).abs();
        own.sort_by(|a, b| size(*b).total_cmp(&size(*a)));
        own.truncate(SUSPECTS);
        own
    }

    fn judged(&self, scales: &[f64], drift: Drift, prior: f64) -> (Point, f64, f64) {
        let point = self.point(scales, drift);
        let (value, growth) = self.blocks.likelihood(&self.blocks.filter(&point));
        (point, value + prior, growth)
    }

    /// Of several kinds: the scales with a likely share and time, and shares and times with the
    /// likeliest scales, as if these were independent. Scales of kinds are alike, or one kind would
    /// explain what others do as well.
    fn several(&self, own: &[Drift]) -> Vec<(Point, f64, f64)> {
        let middle = own[own.len() / 6];
        let value = |scales: &[f64], prior: f64| {
            let (_, value, growth) = self.judged(scales, middle, prior);
            (value, growth)
        };
        let none = vec![0.0; self.kinds];
        let least = value(&none, 0.0);
        let probes = PROBES.iter().flat_map(|&scale| {
            let one = move |kind| (0..self.kinds).map(|k| f64::from(k == kind) * scale).collect();
            (0..self.kinds).map(one).chain(std::iter::once(vec![scale; self.kinds]))
        });
        if !probes.map(|scales: Vec<f64>| value(&scales, 0.0).0).any(|value| value > least.0) {
            return vec![(self.point(&none, middle), least.0, least.1)];
        }
        let count = LEVELS.len().pow(self.kinds as u32);
        let scales = |number: usize| -> Vec<f64> {
            let place = |kind| number / LEVELS.len().pow(kind) % LEVELS.len();
            (0..self.kinds as u32).map(|kind| LEVELS[place(kind)]).collect()
        };
        let total: f64 = (0..count).map(|number| unlike(&scales(number)).exp()).sum();
        let each = -total.ln();
        let mut found = vec![(none.clone(), least.0 + NOTHING.ln(), least.1)];
        for scales in (0..count).map(scales) {
            let (value, growth) = value(&scales, unlike(&scales) + each);
            found.push((scales, value, growth));
        }
        let top = found.iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
        let likely = found[1..].iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|one| one.0.clone());
        let likely = likely.unwrap_or(none);
        let values: Vec<f64> = own.iter().map(|own| self.judged(&likely, *own, 0.0).1).collect();
        let best = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let total = values.iter().map(|value| (value - best).exp()).sum::<f64>().ln() + best;
        let mut points = Vec::new();
        for (scales, value, growth) in found.into_iter().filter(|one| one.1 > top - FALL) {
            if scales.iter().all(|scale| *scale == 0.0) {
                points.push((self.point(&scales, middle), value, growth));
                continue;
            }
            for (drift, part) in own.iter().zip(&values) {
                let value = value + part - total;
                if value > top - FALL {
                    points.push((self.point(&scales, *drift), value, growth));
                }
            }
        }
        points
    }
}

/// A half-Cauchy density of a scale about 1, per logarithm.
fn cauchy(scale: f64) -> f64 {
    scale / (1.0 + scale * scale)
}

/// ln of how likely scales are, and that they differ as much.
fn unlike(scales: &[f64]) -> f64 {
    let mean = scales.iter().map(|scale| scale.ln()).sum::<f64>() / scales.len() as f64;
    let differences = scales.iter().map(|scale| -0.5 * ((scale.ln() - mean) / ALIKE).powi(2));
    cauchy(mean.exp()).ln() + differences.sum::<f64>()
}

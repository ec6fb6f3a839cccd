//! Plots that do not belong to a track, and jumps of its position.
//!
//! A position or a velocity is recognised as an outlier by its difference from the estimate that all other
//! measurements give, and a jump by how much of the differences it would explain (de Jong, Penzer 1998). The
//! largest faults are removed, and the rest is examined again.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::fit::Family;
use super::lasting::Found;
use super::model::{Faults, LastingNoise, Levels, Model};
use super::search::{Near, Scale, Search};
use super::seen::Quantity;
use super::track::Track;
use crate::base::angle::median;
use crate::base::distribution::chi_square_upper_quantile;

/// Probability that a good plot of a track is left out.
const SIGNIFICANCE: f64 = 0.02;
/// Factor of the limit for jumps: a motion that deviates from the model may look like a small jump.
const JUMP_LIMIT: f64 = 2.0;
/// Factor by which a jump must explain more than an outlier; otherwise it is an outlier.
const OVER_OUTLIER: f64 = 1.2;
/// Smallest misfit of a position that is newly left out in a round, relative to the largest.
const SHARE: f64 = 0.2;
const ROUNDS: usize = 20;
/// Number of successive outliers from which on they may be a turn instead.
const LONG: usize = 4;
/// Least number of plots before and after a jump; fewer are outliers.
const FEW: usize = 3;
/// Largest number of plots that are too few between jumps.
const APART: usize = 4;
/// Two jumps with at most this share of the plots between them may be the ends of a run of outliers.
const RUN: f64 = 0.2;

/// Parts of the measurements of each instant: positions, and velocities if these are measured.
struct Parts<'a> {
    track: &'a Track<'a>,
    /// Number of measured components of each part.
    counts: Vec<usize>,
    /// Limit of a squared difference for each number of components; below, its median.
    limits: Vec<f64>,
    medians: Vec<f64>,
}

impl<'a> Parts<'a> {
    fn of(track: &'a Track<'a>) -> Self {
        let d = track.dimension;
        let count = |part: &[f64]| part.iter().filter(|y| !y.is_nan()).count();
        let counts: Vec<usize> = track.y.chunks_exact(d).map(count).collect();
        let known = counts.iter().filter(|&&count| count > 0).count();
        let quantiles = |chance: f64| -> Vec<f64> {
            (0..=d).map(|count| chi_square_upper_quantile(chance, count.max(1))).collect()
        };
        let limits = quantiles(SIGNIFICANCE / known as f64);
        Self { track, counts, limits, medians: quantiles(0.5) }
    }

    /// Number of parts of an instant.
    fn each(&self) -> usize {
        self.track.numbers / self.track.dimension
    }

    fn known(&self) -> usize {
        self.counts.iter().filter(|&&count| count > 0).count()
    }

    /// Returns the median of the squared differences of positions, or of velocities, relative to the median
    /// expected without faults; at least 1.
    fn unit(&self, misfit: &[f64], quantity: Quantity) -> f64 {
        let first = usize::from(quantity == Quantity::Velocity);
        let own = misfit.iter().zip(&self.counts).skip(first).step_by(self.each());
        let relative = own.filter(|(misfit, _)| !misfit.is_nan());
        let mut relative: Vec<f64> = relative.map(|(x, &count)| x / self.medians[count]).collect();
        if relative.is_empty() { 1.0 } else { median(&mut relative).max(1.0) }
    }

    /// Least statistic of a jump.
    fn jump_limit(&self, misfit: &[f64]) -> f64 {
        let unit = self.unit(misfit, Quantity::Position);
        JUMP_LIMIT * self.limits[self.track.dimension] * unit
    }
}

/// Result for a track: its faults, a start for the search for its motion without them, and the squared
/// differences of all parts from their estimates by the others.
struct Settled {
    faults: Faults,
    near: Near,
    misfit: Vec<f64>,
}

/// Returns the outliers and jumps of a track, and a start for the search for its motion without them; `None`
/// if there are so many outliers that good plots cannot be recognised.
///
/// Positions are compared with each other first, because velocities may be wrong for long; then the
/// velocities that contradict the positions are found.
pub(super) fn find_faults<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    levels: Levels,
) -> Option<(Faults, Near)> {
    let track = search.track;
    let parts = Parts::of(track);
    let (count, each) = (parts.counts.len(), parts.each());
    let mut faults = Faults { levels, ..Faults::none(track) };
    (0..count).for_each(|part| faults.gross[part] = part % each > 0);
    // start from a stiff path: a flexible one would follow the faults
    let near = Near::intensity(search.low);
    let jerk = (Family::Jerk, Scale::Free);
    let mut found = settle::<M, S, N>(search, &parts, faults, near, jerk)?;
    // a long run that a stiff path leaves out may be a turn
    let turning = without_runs(&parts, &found.faults);
    let near = search.likeliest(&turning);
    let stated = (Family::Jerk, Scale::Stated);
    if let Some(other) = settle::<M, S, N>(search, &parts, turning, near, stated)
        && other.faults != found.faults
        && score(search, &parts, &other.faults) > score(search, &parts, &found.faults)
    {
        found = other;
    }
    let Settled { mut faults, near, misfit } = found;
    let limit = parts.unit(&misfit, Quantity::Velocity);
    for part in (0..count).filter(|part| part % each > 0) {
        faults.gross[part] = misfit[part] > limit * parts.limits[parts.counts[part]];
    }
    let gross = faults.gross.iter().filter(|gross| **gross).count();
    (2 * gross < parts.known()).then_some((faults, near))
}

/// Searches for faults again and again until they no longer change.
fn settle<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    parts: &Parts<'_>,
    mut faults: Faults,
    mut near: Near,
    (family, scale): (Family, Scale),
) -> Option<Settled> {
    let mut found = Found::default();
    let mut misfit = vec![0.0; parts.counts.len()];
    let mut judged = faults.jumps.clone();
    for _ in 0..ROUNDS {
        let best = search.best(family, LastingNoise::NONE, scale, &faults, near);
        near.intensity = family.log(best.model.motion).max(f64::MIN_POSITIVE.ln());
        // the vague first state must not depend on a jerk that outliers have raised
        search.restart::<S>(best.model.motion.times(best.factor.powi(2)));
        search.engine.smooth(parts.track, &best.model, &faults, &mut found)?;
        for (part, misfit) in misfit.iter_mut().enumerate() {
            *misfit = of_part::<S>(parts, part, &found, &faults);
        }
        let limit = parts.jump_limit(&misfit);
        let is_new = judged != faults.jumps;
        judged.clone_from(&faults.jumps);
        let next = match is_new.then(|| without_returns(search, parts, &best.model, &faults, limit))
        {
            Some(closed) if closed != faults => closed,
            _ => changed(parts, &faults, &misfit, &found.jump),
        };
        if next == faults {
            break;
        }
        faults = next;
    }
    Some(Settled { faults, near, misfit })
}

/// Returns the outliers and jumps of a track whose position is a random walk with the noise as stated, if
/// such a motion is at least `odds` times as likely as one with white jerk; otherwise `None`. Both are fitted
/// without the given faults, and the search starts at `near`. In a fit with white jerk, the steps of a random
/// walk look like outliers and jumps.
pub(super) fn find_rough_faults<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    (faults, near): (&Faults, Near),
    odds: f64,
) -> Option<Faults> {
    let none = LastingNoise::NONE;
    let jerk = search.best(Family::Jerk, none, Scale::Prior, faults, near);
    let near = Near::intensity(Family::Velocity.like(jerk.model.motion, search.track));
    let rough = search.best(Family::Velocity, none, Scale::Stated, faults, near);
    if rough.value < jerk.value + odds.ln() {
        return None;
    }
    let (parts, first) = (Parts::of(search.track), Faults::none(search.track));
    let stated = (Family::Velocity, Scale::Stated);
    Some(settle::<M, S, N>(search, &parts, first, near, stated)?.faults)
}

/// Returns the log-likelihood of the positions with the noise as stated. Each position that is left out
/// counts as much as an average one of the others, less half the limit of an outlier.
fn score<const M: usize, const N: usize>(
    search: &Search<'_, M, N>,
    parts: &Parts<'_>,
    faults: &Faults,
) -> f64 {
    let near = search.likeliest(faults);
    let best = search.best(Family::Jerk, LastingNoise::NONE, Scale::Stated, faults, near);
    let positions = (0..parts.counts.len()).step_by(parts.each());
    let all = positions.clone().filter(|&part| parts.counts[part] > 0).count() as f64;
    let gross = positions.filter(|&part| faults.gross[part]).count() as f64;
    let limit = parts.limits[parts.track.dimension];
    best.value * all / (all - gross) - 0.5 * limit * gross
}

/// Returns the faults without long runs of positions that are left out.
fn without_runs(parts: &Parts<'_>, faults: &Faults) -> Faults {
    let mut fewer = faults.clone();
    let known: Vec<usize> = (0..parts.counts.len())
        .step_by(parts.each())
        .filter(|&part| parts.counts[part] > 0)
        .collect();
    for run in known.chunk_by(|&a, &b| faults.gross[a] == faults.gross[b]) {
        if run.len() >= LONG {
            run.iter().for_each(|&part| fewer.gross[part] = false);
        }
    }
    fewer
}

/// Returns the faults for the next round: with a further jump if that explains most, otherwise with the
/// positions that fit worst as outliers.
fn changed(parts: &Parts<'_>, faults: &Faults, misfit: &[f64], jump: &[f64]) -> Faults {
    let (n, each) = (parts.track.len(), parts.each());
    let unit = parts.unit(misfit, Quantity::Position);
    let mut next = faults.clone();
    let at = |part: usize| {
        if misfit[part].is_nan() || faults.gross[part] { 0.0 } else { misfit[part] }
    };
    let is_free =
        |k: usize| !(k.saturating_sub(APART)..(k + APART + 1).min(n)).any(|j| faults.jumps[j]);
    let strongest = (FEW..n.saturating_sub(FEW))
        .filter(|&k| is_free(k))
        .max_by(|&a, &b| jump[a].total_cmp(&jump[b]));
    let largest = (0..misfit.len()).map(at).fold(0.0, f64::max);
    let least = parts.jump_limit(misfit).max(OVER_OUTLIER * largest);
    if let Some(k) = strongest.filter(|&k| jump[k] > least) {
        next.jumps[k] = true;
        return next;
    }
    let limit = |part: usize| parts.limits[parts.counts[part]] * unit;
    let worst = (0..misfit.len()).map(|part| at(part) / limit(part)).fold(0.0, f64::max);
    for part in (0..misfit.len()).step_by(each) {
        let least = if faults.gross[part] { 1.0 } else { f64::max(1.0, SHARE * worst) };
        next.gross[part] = misfit[part] > least * limit(part);
    }
    next
}

/// Returns the faults with outliers in place of two jumps near each other, if the path after both agrees with
/// the path before: if no jump remains when all positions between them are left out. Otherwise the target has
/// moved on from there, and the jumps stay.
fn without_returns<const M: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    parts: &Parts<'_>,
    model: &Model,
    faults: &Faults,
    limit: f64,
) -> Faults {
    let (n, mut found, mut closed) = (parts.track.len(), Found::default(), faults.clone());
    let jumps: Vec<usize> = (0..n).filter(|&k| faults.jumps[k]).collect();
    for pair in jumps.windows(2) {
        let (first, last) = (pair[0], pair[1]);
        if !closed.jumps[first] || (last - first) as f64 > RUN * n as f64 {
            continue;
        }
        let mut other = closed.clone();
        (first..last).for_each(|k| other.gross[k * parts.each()] = true);
        (other.jumps[first], other.jumps[last]) = (false, false);
        let smoothed = search.engine.smooth(parts.track, model, &other, &mut found);
        if smoothed.is_some() && found.jump[last] <= limit {
            closed = other;
        }
    }
    closed
}

/// Returns the squared difference of a part from the estimate that all other measurements give, divided by
/// its variance; nan if nothing is measured.
fn of_part<const S: usize>(parts: &Parts<'_>, part: usize, found: &Found, faults: &Faults) -> f64 {
    let Parts { track, counts, .. } = parts;
    if counts[part] == 0 {
        return f64::NAN;
    }
    let (d, m) = (track.dimension, track.numbers);
    let (k, first) = (part / parts.each(), part % parts.each() * d);
    let (plot, whitener) = (&track.plot(k)[first..][..d], track.whitener(k));
    let w = |i: usize, j: usize| whitener[(first + i) * m + first + j];
    let mut trend = [0.0; S];
    track.add_trend(k, &mut trend);
    let away = |i: usize| plot[i] - (found.mean[k * S + first + i] - trend[first + i]);
    let p = |i: usize, j: usize| found.covariance[(k * S + first + i) * S + first + j];
    let own = if faults.gross[part] { 1.0 } else { -1.0 };
    let variance = if first == 0 { faults.levels.noise(k) } else { 1.0 };
    let there = || (0..d).filter(|&i| !plot[i].is_nan());
    let (mut factor, mut white, mut sum) = ([[0.0; S]; S], [0.0; S], 0.0);
    for i in there() {
        let residual: f64 = there().take_while(|&j| j <= i).map(|j| w(i, j) * away(j)).sum();
        for j in there().take_while(|&j| j <= i) {
            let mut value = if i == j { variance } else { 0.0 };
            for a in 0..=i {
                for b in 0..=j {
                    value += own * w(i, a) * p(a, b) * w(j, b);
                }
            }
            value -= (0..j).map(|l| factor[i][l] * factor[j][l]).sum::<f64>();
            if i != j {
                factor[i][j] = value / factor[j][j];
            } else if value > 1e-9 {
                factor[i][i] = value.sqrt();
            } else {
                // the other measurements do not determine this component
                return 0.0;
            }
        }
        let inner: f64 = (0..i).map(|l| factor[i][l] * white[l]).sum();
        white[i] = (residual - inner) / factor[i][i];
        sum += white[i] * white[i];
    }
    sum
}

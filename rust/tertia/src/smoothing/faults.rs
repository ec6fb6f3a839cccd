//! Plots that do not belong to a track, and jumps of its position.
//!
//! A plot is an outlier by its difference from what all others say of it; a jump, by how much it would
//! explain (de Jong, Penzer 1998). The largest are taken out, and the rest is looked at again.

// indices are those of the formulas
#![allow(clippy::needless_range_loop)]

use super::fit::Family;
use super::lasting::{Faults, Found};
use super::search::{Scale, Search};
use super::track::Track;
use crate::base::angle::median;
use crate::base::distribution::chi_square_upper_quantile;

/// Chance that one good plot of a track is taken out.
const SIGNIFICANCE: f64 = 0.02;
/// A motion that is not as the model has it may look like a small jump.
const JUMP_LIMIT: f64 = 2.0;
/// A jump that explains less than this over what an outlier does is one.
const OVER_OUTLIER: f64 = 1.2;
/// In a round nothing is taken out that explains less than this share of the largest.
const SHARE: f64 = 0.2;
const ROUNDS: usize = 20;
/// Jumps are at least so many plots apart.
const APART: usize = 5;
/// Two jumps with at most this share of the plots between them are the ends of a run of outliers.
const RUN: f64 = 0.2;
/// Medians of the chi-square distributions of 1, 2 and 3 degrees of freedom.
const MEDIANS: [f64; 3] =
    [0.454_936_423_119_572_9, 1.386_294_361_119_890_6, 2.365_973_884_375_337_7];

/// The outliers and jumps of a track, and the logarithm of its jerk without them; none where they
/// are too many to tell which plots are good.
pub(super) fn find_faults<const D: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, D, N>,
) -> Option<(Faults, f64)> {
    let track = search.track;
    let n = track.len();
    let plots = (0..n).filter(|&k| track.plot(k).iter().any(|y| !y.is_nan())).count();
    let limit = chi_square_upper_quantile(SIGNIFICANCE / plots as f64, D);
    let mut faults = Faults { gross: vec![false; n], jumps: vec![false; n] };
    // from a stiff path: a restless one would follow the faults
    let mut near = search.low;
    let (mut found, mut misfit) = (Found::default(), vec![0.0; n]);
    for _ in 0..ROUNDS {
        let best = search.best(Family::Jerk, (0.0, 0.0), Scale::Free, &faults, near);
        near = best.model.motion.jerk.max(f64::MIN_POSITIVE).ln();
        // what outliers did to the jerk must not be in the vagueness of the first state
        search.restart::<S>(best.model.motion.times(best.factor.powi(2)));
        search.engine.smooth(track, &best.model, &faults, &mut found)?;
        for k in 0..n {
            misfit[k] = of_plot::<D, S>(track, k, &found, faults.gross[k]);
        }
        let mut known: Vec<f64> = misfit.iter().copied().filter(|x| !x.is_nan()).collect();
        let unit = (median(&mut known) / MEDIANS[D - 1]).max(1.0);
        let next = changed(track, &faults, &misfit, &found.jump, limit * unit);
        if next == faults {
            break;
        }
        faults = next;
    }
    let gross = faults.gross.iter().filter(|gross| **gross).count();
    (2 * gross < plots).then_some((faults, near))
}

/// The next guess: with a jump, if that explains most, or else without the worst plots.
fn changed(track: &Track<'_>, faults: &Faults, misfit: &[f64], jump: &[f64], limit: f64) -> Faults {
    let n = misfit.len();
    let mut next = faults.clone();
    let at = |k: usize| if misfit[k].is_nan() || faults.gross[k] { 0.0 } else { misfit[k] };
    let is_free =
        |k: usize| !(k.saturating_sub(APART)..(k + APART + 1).min(n)).any(|j| faults.jumps[j]);
    let strongest = (1..n).filter(|&k| is_free(k)).max_by(|&a, &b| jump[a].total_cmp(&jump[b]));
    let largest = (0..n).map(at).fold(0.0, f64::max);
    let least = (JUMP_LIMIT * limit).max(OVER_OUTLIER * largest);
    if let Some(k) = strongest.filter(|&k| jump[k] > least) {
        next.jumps[k] = true;
        close_runs(track, &mut next);
        return next;
    }
    for k in 0..n {
        next.gross[k] =
            if faults.gross[k] { misfit[k] > limit } else { at(k) > limit.max(SHARE * largest) };
    }
    next
}

/// Replaces two jumps near each other by a run of outliers.
fn close_runs(track: &Track<'_>, faults: &mut Faults) {
    let n = track.len();
    let jumps: Vec<usize> = (0..n).filter(|&k| faults.jumps[k]).collect();
    for pair in jumps.windows(2) {
        let (first, last) = (pair[0], pair[1]);
        if faults.jumps[first] && (last - first) as f64 <= RUN * n as f64 {
            faults.gross[first..last].fill(true);
            faults.jumps[first] = false;
            faults.jumps[last] = false;
        }
    }
}

/// The squared difference of a plot from what the others say of it, over its variance; nan where
/// there is no plot.
fn of_plot<const D: usize, const S: usize>(
    track: &Track<'_>,
    k: usize,
    found: &Found,
    is_gross: bool,
) -> f64 {
    let (plot, whitener) = (track.plot(k), track.whitener(k));
    let mut trend = [0.0; S];
    track.add_trend(k, &mut trend);
    let mean = &found.mean[k * S..][..S];
    let p = |i: usize, j: usize| found.covariance[(k * S + i) * S + j];
    let own = if is_gross { 1.0 } else { -1.0 };
    let there: Vec<usize> = (0..D).filter(|&i| !plot[i].is_nan()).collect();
    if there.is_empty() {
        return f64::NAN;
    }
    let (mut factor, mut white, mut sum) = ([[0.0; D]; D], [0.0; D], 0.0);
    for &i in &there {
        let residual: f64 = (0..=i)
            .filter(|j| !plot[*j].is_nan())
            .map(|j| whitener[i * D + j] * (plot[j] - (mean[j] - trend[j])))
            .sum();
        for &j in there.iter().filter(|&&j| j <= i) {
            let mut value = if i == j { 1.0 } else { 0.0 };
            for a in 0..=i {
                for b in 0..=j {
                    value += own * whitener[i * D + a] * p(a, b) * whitener[j * D + b];
                }
            }
            value -= (0..j).map(|l| factor[i][l] * factor[j][l]).sum::<f64>();
            if i != j {
                factor[i][j] = value / factor[j][j];
            } else if value > 1e-9 {
                factor[i][i] = value.sqrt();
            } else {
                // the others say nothing of it
                return 0.0;
            }
        }
        let inner: f64 = (0..i).map(|l| factor[i][l] * white[l]).sum();
        white[i] = (residual - inner) / factor[i][i];
        sum += white[i] * white[i];
    }
    sum
}

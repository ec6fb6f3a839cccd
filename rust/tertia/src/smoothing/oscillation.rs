//! Positions that oscillate about a path, as those of a buoy in waves.
//!
//! With a few plots in each period, such a motion looks like noise that is larger than stated. Unlike noise, its
//! deviations from the path change their sign after half a period. A damped oscillator that white noise drives is
//! then added to the path, if this is clearly more likely than noise.

use super::fit::{Family, ProcessNoiseFit, median_step};
use super::model::{Faults, LastingNoise, Model};
use super::results::Smoothed;
use super::search::{Candidate, Scale, Search, climb};
use super::track::Track;
use std::f64::consts::TAU;

/// Least number of periods in a track, and largest number of plots in one.
const PERIODS: usize = 8;
const LONGEST: usize = 256;
/// Correlation of deviations from the path after half a period, below which a model of an oscillation is tried.
const OPPOSITE: f64 = -0.12;
/// Part of the lowest correlation that the first minimum has at least.
const NEARLY: f64 = 0.6;
/// Least correlation of successive deviations; below, it is that of two sensors in turn.
const SUCCESSIVE: f64 = -0.2;
/// Number of frequencies in each multiple of the lowest one, and largest number of plots, in a search for the
/// highest power.
const RESOLUTION: f64 = 3.0;
const SPECTRUM: usize = 2000;
/// Damping times that are tried, in periods.
const DAMPINGS: [f64; 4] = [1.0, 3.0, 10.0, 30.0];
/// Unit of the search for the logarithm of the period.
const UNIT: f64 = 0.05;
/// Smallest part of the largest amplitude that an axis has.
const LEAST_SHARE: f64 = 0.05;

/// Returns a search with models that oscillate, and the likeliest of them for each damping, if the deviations from
/// the results `out` of the best other model seem to oscillate. N = 5 D.
pub(super) fn find_oscillation<'a, const M: usize, const S: usize, const N: usize>(
    track: &'a Track<'a>,
    (fit, jerk): (&ProcessNoiseFit, Option<f64>),
    (best, faults): (&Candidate, &Faults),
    out: &Smoothed<'_>,
) -> Option<(Search<'a, M, N>, Vec<Candidate>)> {
    let (period, wandering) = suspected(track, faults, out)?;
    let search = Search::<M, N>::new::<S>(track, fit, jerk, out)?;
    let motion = Family::Jerk.of(track);
    let intensity = best.model.motion.times(best.factor.powi(2)).jerk.ln().max(search.low);
    let of = |[more, larger, longer]: [f64; 3], damping: f64| {
        let period = period * (UNIT * longer).exp();
        let model = Model {
            motion: jerk.map_or_else(|| motion(intensity + more), |_| best.model.motion),
            lasting: LastingNoise { time: damping * period, ..LastingNoise::NONE },
            wandering: wandering.map(|size| size * larger.exp()),
            frequency: TAU / period,
            ..best.model
        };
        let scale = if jerk.is_some() { Scale::Stated } else { Scale::Prior };
        search.candidate(model, scale, faults)
    };
    let mut at = [0.0; 3];
    let found: Vec<Candidate> = DAMPINGS
        .iter()
        .map(|&damping| {
            let near = |offset: [f64; 3]| of(std::array::from_fn(|i| at[i] + offset[i]), damping);
            let lowest = search.low - intensity - at[0];
            let (offset, one) = climb([jerk.is_none(), true, true], lowest, near);
            at = std::array::from_fn(|i| at[i] + offset[i]);
            one
        })
        .collect();
    Some((search, found))
}

/// Returns the period with which the deviations from the path seem to oscillate, and the standard deviation of
/// the oscillation of each axis.
fn suspected(track: &Track<'_>, faults: &Faults, out: &Smoothed<'_>) -> Option<(f64, [f64; 3])> {
    let axes = 0..track.dimension;
    let deviations: Vec<Vec<f64>> = axes.map(|axis| deviations(track, axis, faults, out)).collect();
    let halves = deviations.iter().filter_map(|own| half_period(own));
    let (_, half) = halves.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let variance =
        |own: &Vec<f64>| (0.5 * (covariance(own, 2 * half) - covariance(own, half))).max(0.0);
    let sizes: Vec<f64> = deviations.iter().map(|own| variance(own).sqrt()).collect();
    let least = LEAST_SHARE * sizes.iter().copied().fold(0.0, f64::max);
    let sizes = std::array::from_fn(|axis| sizes.get(axis).map_or(0.0, |size| size.max(least)));
    Some((period(track, &deviations, half), sizes))
}

/// Returns the number of plots after which deviations have the opposite sign, with the correlation there.
fn half_period(own: &[f64]) -> Option<(f64, usize)> {
    let most = (own.len() / (2 * PERIODS)).min(LONGEST / 2);
    let variance = covariance(own, 0);
    let at = |lag: usize| covariance(own, lag) / variance;
    let correlation: Vec<f64> = (0..=most).map(at).collect();
    let lowest = correlation.get(2..=most)?.iter().copied().fold(0.0, f64::min);
    // the first minimum that is nearly as low as the lowest one: others are multiples of it
    let limit = OPPOSITE.min(NEARLY * lowest);
    let first = (2..=most).find(|&lag| correlation[lag] < limit)?;
    let below = (first..=most).take_while(|&lag| correlation[lag] < limit);
    let half = below.min_by(|&a, &b| correlation[a].total_cmp(&correlation[b]))?;
    (at(2 * half) > 0.0 && at(1) > SUCCESSIVE).then_some((correlation[half], half))
}

/// Returns the period at which the deviations have the highest power, of those near two times `half` plots.
fn period(track: &Track<'_>, deviations: &[Vec<f64>], half: usize) -> f64 {
    let n = track.len().min(SPECTRUM);
    let times = &track.times[..n];
    let span = times[n - 1] - times[0];
    let at = |half: f64| TAU / (2.0 * half * median_step(track));
    let (low, high) = (at(half as f64 + 1.0), at(half as f64 - 1.0));
    let step = TAU / (RESOLUTION * span);
    // more would only be found if some steps are much longer than the median
    let most = (RESOLUTION * n as f64) as usize;
    let frequencies =
        (0..=(((high - low) / step) as usize).min(most)).map(|i| low + i as f64 * step);
    let power = |frequency: f64| -> f64 {
        let waves: Vec<_> = times.iter().map(|t| (frequency * (t - times[0])).sin_cos()).collect();
        let of = |own: &Vec<f64>| {
            let products = own.iter().zip(&waves).map(|(own, (sin, cos))| (own * sin, own * cos));
            let (sin, cos) = products.fold((0.0, 0.0), |sum, own| (sum.0 + own.0, sum.1 + own.1));
            sin * sin + cos * cos
        };
        deviations.iter().map(of).sum()
    };
    let powers = frequencies.map(|frequency| (frequency, power(frequency)));
    let highest = powers.max_by(|a, b| a.1.total_cmp(&b.1));
    TAU / highest.map_or(at(half as f64), |(frequency, _)| frequency)
}

/// Differences of the plots of an axis from the path, less their mean; 0 where there is no plot.
fn deviations(track: &Track<'_>, axis: usize, faults: &Faults, out: &Smoothed<'_>) -> Vec<f64> {
    let (d, m, states) = (track.dimension, track.numbers, 3 * track.dimension);
    let (mut own, mut trend) = (Vec::with_capacity(track.len()), vec![0.0; states]);
    for k in 0..track.len() {
        trend.fill(0.0);
        track.add_trend(k, &mut trend);
        let is_gross = faults.gross[k * m / d];
        let away = track.plot(k)[axis] + trend[axis] - out.mean[k * states + axis];
        own.push(if is_gross { f64::NAN } else { away });
    }
    let known = own.iter().filter(|away| !away.is_nan());
    let mean = known.clone().sum::<f64>() / known.count().max(1) as f64;
    own.iter().map(|away| if away.is_nan() { 0.0 } else { away - mean }).collect()
}

/// Sum of the products of values `lag` apart, over the number of values.
fn covariance(values: &[f64], lag: usize) -> f64 {
    let pairs = values.iter().zip(&values[lag.min(values.len())..]);
    pairs.map(|(a, b)| a * b).sum::<f64>() / values.len() as f64
}

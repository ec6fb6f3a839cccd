//! Noise of a track that differs from the stated noise: larger or correlated noise, outliers and jumps.
//!
//! If innovations are as expected, nothing is changed. Otherwise models of the noise are compared by their
//! likelihoods, each with its own motion, and their estimates are averaged. One of the models has white noise
//! and a velocity that is a random walk, another one a position that is a random walk: motion without white
//! jerk need not be noise.

use super::expected::Expected;
use super::faults::{find_faults, find_rough_faults};
use super::fit::{
    Family, Likely, ProcessNoiseFit, fit_both_families, likeliest_other, median_step,
};
use super::interleaved::Interleaved;
use super::lasting::Found;
use super::levels::find_levels;
use super::model::{Faults, LastingNoise, Levels, Model};
use super::motion::ProcessNoise;
use super::oscillation::find_oscillation;
use super::results::{Smoothed, Summary};
use super::search::{Candidate, Near, Scale, Search};
use super::seen::Quantity;
use super::smoother::{Workspace, likelihood, smooth};
use super::stays::add_stays;
use super::track::Track;
use super::unresolved::add_unresolved;
use super::wandering::add_wandering;

/// Correlations of successive plots that are tried, and shares of the noise that are correlated.
const CORRELATIONS: [f64; 7] = [0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98];
const SHARES: [f64; 2] = [0.95, 0.6];
/// Prior probability that the noise is white; below, that the velocity is a random walk if noise is white.
const WHITE: f64 = 0.5;
const WANDERING: f64 = 0.5;
/// Prior probability that the position is a random walk, relative to that of all other models together: so
/// small that this model hardly counts unless the plots require it.
const ROUGH: f64 = 0.02;
/// Prior probability that the position oscillates about the path, relative to that of all other models together.
const OSCILLATING: f64 = 1e-3;
/// Least gain of the log-likelihood by levels of the noise or the motion.
const LEVEL_GAIN: f64 = 6.0;
/// Squared difference of an outlier from the path, for the comparison of tracks with different outliers.
const OUTLIER_LIMIT: f64 = 18.0;
/// Smallest weight of a model that is not left out.
const LEAST_WEIGHT: f64 = 0.02;

/// Models with the logarithms of their probabilities.
type Models = (Vec<Candidate>, Vec<f64>);

/// Assumptions about the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Intensity of the jerk; `None` if it is to be estimated.
    pub jerk: Option<f64>,
    /// Time over which the noise is correlated, 0 for white noise; `None` if it is to be estimated.
    pub correlation_time: Option<f64>,
    /// Whether noise may be larger than stated, plots may be outliers, and the position may jump.
    pub robust: bool,
}

impl Options {
    /// Returns the expected properties of innovations if the noise is as stated.
    fn expected(&self) -> Expected {
        Expected { white: self.correlation_time.is_none(), normal: self.robust }
    }
}

/// Estimated noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseFit {
    /// Motion of the likeliest model, with its uncertainty for noise as stated.
    pub motion: ProcessNoiseFit,
    /// Correlation time of the likeliest model; 0 for white noise.
    pub correlation_time: f64,
    /// Factor of the stated standard deviations of positions, at least 1.
    pub noise_factor: f64,
    /// Factor of the stated standard deviations of velocities.
    pub velocity_noise_factor: f64,
    /// Time by which velocities lag behind positions.
    pub velocity_time_offset: f64,
    /// Angular frequency of an oscillation about the path; 0 if there is none.
    pub frequency: f64,
}

impl NoiseFit {
    /// Noise as stated, with this motion.
    pub fn as_stated(motion: ProcessNoiseFit) -> Self {
        let (noise_factor, velocity_noise_factor) = (1.0, 1.0);
        let (correlation_time, velocity_time_offset, frequency) = (0.0, 0.0, 0.0);
        Self {
            motion,
            correlation_time,
            noise_factor,
            velocity_noise_factor,
            velocity_time_offset,
            frequency,
        }
    }
}

/// Smooths a track; `outlier` (N, 1 or 2) marks the positions, and velocities, that are left out. If the
/// noise is as stated, the result is that of [`smooth`]. Cost O(N D³): about 15 filters, or hundreds if the
/// innovations are suspicious. The summary is that for the noise as stated.
pub fn smooth_with_noise(
    track: &Track<'_>,
    options: &Options,
    workspace: &mut Workspace,
    out: &mut Smoothed<'_>,
    outlier: &mut [bool],
) -> (Summary, NoiseFit) {
    outlier.fill(false);
    let (fit, other) = match options.jerk {
        Some(jerk) => {
            let motion = ProcessNoise::with_jerk(jerk);
            (ProcessNoiseFit { motion, relative_error: 0.0 }, None)
        }
        None => fit_both_families(track, workspace),
    };
    let summary = smooth(track, fit.motion, workspace, out);
    let improved = if options.correlation_time.is_some_and(|time| time > 0.0)
        || options.expected().are_suspicious(out.innovation, track.numbers)
    {
        match (track.dimension, track.numbers) {
            (1, 1) => improve::<1, 3, 4, 5>(track, &fit, options, out, outlier),
            (2, 2) => improve::<2, 6, 8, 10>(track, &fit, options, out, outlier),
            (3, 3) => improve::<3, 9, 12, 15>(track, &fit, options, out, outlier),
            (1, 2) => improve::<2, 3, 4, 5>(track, &fit, options, out, outlier),
            (2, 4) => improve::<4, 6, 8, 10>(track, &fit, options, out, outlier),
            (3, 6) => improve::<6, 9, 12, 15>(track, &fit, options, out, outlier),
            _ => None,
        }
    } else {
        None
    };
    let noise = improved.unwrap_or_else(|| {
        if options.jerk.is_none() {
            add_other_family(track, (&fit, other), summary.log_likelihood, workspace, out);
        }
        NoiseFit::as_stated(fit)
    });
    (summary, noise)
}

/// Includes the motion of the other family in the covariance, if this motion is likely: the covariance
/// becomes the second moment of the mixture of both about the mean, which does not change. `other` is this
/// motion if it is known from the fit.
fn add_other_family(
    track: &Track<'_>,
    (fit, other): (&ProcessNoiseFit, Option<Likely>),
    top: f64,
    workspace: &mut Workspace,
    out: &mut Smoothed<'_>,
) {
    let mut value = |motion| likelihood(track, motion, workspace).log_likelihood;
    let least = top + LEAST_WEIGHT.ln();
    let other = other.or_else(|| likeliest_other(track, fit.motion, least, &mut value));
    let Some((other, value)) = other else {
        return;
    };
    let weight = 1.0 / (1.0 + (top - value).exp());
    let (mut mean, mut covariance) = (out.mean.to_vec(), out.covariance.to_vec());
    let mut found = Smoothed { mean: &mut mean, covariance: &mut covariance, innovation: &mut [] };
    smooth(track, other.motion, workspace, &mut found);
    let n = 3 * track.dimension;
    for (at, own) in out.covariance.iter_mut().enumerate() {
        let (row, column) = (at / n, at / (n * n) * n + at % n);
        let away = |i: usize| mean[i] - out.mean[i];
        let second_moment = covariance[at] + away(row) * away(column);
        if own.is_finite() && second_moment.is_finite() {
            *own += weight * (second_moment - *own);
        }
    }
}

/// Replaces the results by those of the models that the plots support.
fn improve<const M: usize, const S: usize, const N: usize, const O: usize>(
    track: &Track<'_>,
    fit: &ProcessNoiseFit,
    options: &Options,
    out: &mut Smoothed<'_>,
    outlier: &mut [bool],
) -> Option<NoiseFit> {
    let mut search = Search::<M, N>::new::<S>(track, fit, options.jerk, out)?;
    let jerk = fit.motion.jerk;
    let intensity = if jerk > 0.0 { jerk.ln() } else { search.low };
    let mut near = Near::intensity(intensity);
    let mut faults = Faults::none(track);
    let expected = options.expected();
    if let Some(found) =
        options.robust.then(|| find_faults::<M, S, N>(&mut search, Levels::default())).flatten()
    {
        (faults, near) = found;
    }
    let mut is_rough = faults == Faults::none(track);
    if !is_rough && options.jerk.is_none() && track.numbers == track.dimension {
        let own = find_rough_faults::<M, S, N>(&mut search, (&faults, near), 1.0 / ROUGH);
        is_rough = own.is_some();
        faults = own.unwrap_or(faults);
    }
    // outliers and jumps may be the only deviations
    let is_healthy = options.correlation_time.is_none_or(|time| time == 0.0)
        && faults != Faults::none(track)
        && search.is_healthy(&faults, near, expected);
    let interleaved = Interleaved::find(track).filter(|_| options.correlation_time.is_none());
    let found = (&faults, is_rough);
    let may_last = interleaved.is_none();
    let (mut candidates, mut logs) =
        candidates(&search, options, found, near, (is_healthy, may_last));
    let mut weights = weights_of(&logs);
    let mut most = likeliest(&weights)?;
    average::<M, S, N>(&mut search, &candidates, &weights, most, &faults, out)?;
    // without larger noise, an oscillation would be a motion that the path follows badly, such as a turn
    if candidates[most].factor > 1.0
        && interleaved.is_none()
        && let Some((mut search, oscillating)) = find_oscillation::<M, S, O>(
            track,
            (fit, options.jerk),
            (&candidates[most], &faults),
            out,
        )
    {
        let before = candidates.len();
        let prior = (OSCILLATING / oscillating.len() as f64).ln();
        logs.extend(oscillating.iter().map(|one| one.value + prior));
        candidates.extend(oscillating);
        weights = weights_of(&logs);
        if weights[before..].iter().any(|weight| *weight > 0.0) {
            most = likeliest(&weights)?;
            average::<M, S, O>(&mut search, &candidates, &weights, most, &faults, out)?;
        }
    }
    let is_white = options.correlation_time.is_none_or(|time| time == 0.0);
    if options.robust && may_last && is_white && candidates[most].model.frequency == 0.0 {
        let plain = (faults.clone(), (candidates, logs));
        let (own, models) = with_levels::<M, S, N>(&mut search, options, near, plain)?;
        candidates = models.0;
        if own != faults {
            faults = own;
            weights = weights_of(&models.1);
            most = likeliest(&weights)?;
            average::<M, S, N>(&mut search, &candidates, &weights, most, &faults, out)?;
        }
    }
    let best = &candidates[most];
    if let Some(sensors) = interleaved {
        sensors.add_lasting_errors(track, &faults, out);
    }
    add_stays(track, &faults, out);
    outlier.copy_from_slice(&faults.gross);
    let motion = match options.jerk {
        Some(jerk) => ProcessNoise::with_jerk(jerk),
        None => best.model.whole_motion().times(best.factor.powi(2)),
    };
    Some(NoiseFit {
        motion: ProcessNoiseFit { motion, ..*fit },
        correlation_time: match best.model.lasting {
            LastingNoise { of: Quantity::Position, share, time } if share > 0.0 => time,
            _ => 0.0,
        },
        noise_factor: best.factor.max(1.0),
        velocity_noise_factor: best.factor.max(1.0) * best.model.velocity_factor,
        velocity_time_offset: best.model.velocity_time_offset,
        frequency: best.model.frequency,
    })
}

/// Returns the faults with levels of the noise or the motion, if these make the plots likelier, and models with them.
fn with_levels<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    options: &Options,
    near: Near,
    (mut faults, mut models): (Faults, Models),
) -> Option<(Faults, Models)> {
    let jumps = vec![false; search.track.len()];
    // those of white noise
    let white = models.0.iter().take(2).max_by(|a, b| a.value.total_cmp(&b.value)).copied()?;
    for levels in find_levels::<M, S, N>(search, &white, &faults) {
        let own = Faults { levels: levels.clone(), jumps: jumps.clone(), ..faults.clone() };
        let (own, near) = find_faults::<M, S, N>(search, levels).unwrap_or((own, near));
        let is_healthy = search.is_healthy(&own, near, options.expected());
        let other = candidates(search, options, (&own, false), near, (is_healthy, true));
        let least = total(search, &models, &faults)? + LEVEL_GAIN;
        if total(search, &other, &own)? > least {
            (faults, models) = (own, other);
        }
    }
    Some((faults, models))
}

/// Returns the logarithm of the likelihood of the best model, from the same vague first state for all faults. Each
/// position that is left out counts as much as an average one of the others, less half the limit of an outlier.
fn total<const M: usize, const N: usize>(
    search: &Search<'_, M, N>,
    (candidates, logs): &Models,
    faults: &Faults,
) -> Option<f64> {
    let best = &candidates[likeliest(&weights_of(logs))?];
    let value = search.candidate(best.model, Scale::Larger, faults).value;
    let (all, each) = (search.track.len() as f64, search.track.numbers / search.track.dimension);
    let gross = faults.gross.iter().step_by(each).filter(|gross| **gross).count() as f64;
    Some(value * all / (all - gross) - 0.5 * OUTLIER_LIMIT * gross)
}

/// Returns models with the logarithms of their probabilities.
fn candidates<const M: usize, const N: usize>(
    search: &Search<'_, M, N>,
    options: &Options,
    (faults, may_be_rough): (&Faults, bool),
    near: Near,
    (is_healthy, may_last): (bool, bool),
) -> Models {
    let of = |scale| if options.robust && !is_healthy { scale } else { Scale::Stated };
    let larger = of(Scale::Larger);
    // levels may not be those of noise that is smaller than stated
    let prior = if faults.levels == Levels::default() { of(Scale::Prior) } else { larger };
    let best = |family, lasting, scale, near| search.best(family, lasting, scale, faults, near);
    if let Some(time) = options.correlation_time.filter(|time| *time > 0.0) {
        let lasting = LastingNoise { of: Quantity::Position, share: SHARES[0], time };
        return (vec![best(Family::Jerk, lasting, larger, near)], vec![0.0]);
    }
    let white = best(Family::Jerk, LastingNoise::NONE, prior, near);
    let Model { velocity_factor, velocity_time_offset, .. } = white.model;
    let near = Near { velocity_factor: velocity_factor.ln(), velocity_time_offset, ..near };
    let mut found = vec![white];
    let mut log_prior = vec![WHITE.ln()];
    if options.jerk.is_none() {
        let intensity = Family::Acceleration.like(white.model.motion, search.track);
        let near = Near { intensity, ..near };
        found.push(best(Family::Acceleration, LastingNoise::NONE, prior, near));
        log_prior = vec![(WHITE * (1.0 - WANDERING)).ln(), (WHITE * WANDERING).ln()];
    }
    let has_velocities = search.track.numbers > search.track.dimension;
    // the steps of a random walk look like larger, lasting noise, so this model has the noise as stated;
    // outliers look like such steps although the motion has none, so it is tried only if `may_be_rough`
    if options.jerk.is_none() && !has_velocities && may_be_rough {
        let near = Near::intensity(Family::Velocity.like(white.model.motion, search.track));
        found.push(best(Family::Velocity, LastingNoise::NONE, Scale::Stated, near));
        log_prior.push(ROUGH.ln());
    }
    let mut lasting = Vec::new();
    if !is_healthy {
        let is_unknown = options.correlation_time.is_none();
        lasting.extend((is_unknown && may_last).then_some(Quantity::Position));
        lasting.extend((has_velocities && options.robust).then_some(Quantity::Velocity));
    }
    let step = median_step(search.track);
    let count = CORRELATIONS.len() * SHARES.len() * lasting.len();
    for of in lasting {
        for share in SHARES {
            let mut near = near;
            near.intensity = white.model.motion.jerk.max(f64::MIN_POSITIVE).ln();
            for correlation in CORRELATIONS {
                let lasting = LastingNoise { of, share, time: -step / f64::ln(correlation) };
                let one = best(Family::Jerk, lasting, larger, near);
                near.intensity = one.model.motion.jerk.max(f64::MIN_POSITIVE).ln();
                found.push(one);
                log_prior.push(((1.0 - WHITE) / count as f64).ln());
            }
        }
    }
    let mut logs = found.iter().zip(&log_prior).map(|(one, prior)| one.value + prior).collect();
    if options.jerk.is_none() && !has_velocities {
        add_wandering(search, faults, &mut found, &mut logs);
    }
    (found, logs)
}

/// Turns logarithms of probabilities into weights that add up to 1. The weights of small probabilities are 0,
/// and those of nan, which is the likelihood of a model that was lost to rounding.
fn weights_of(logs: &[f64]) -> Vec<f64> {
    // nan is not larger
    let highest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weight = |log: &f64| if log.is_nan() { 0.0 } else { (log - highest).exp() };
    let mut weights: Vec<f64> = logs.iter().map(weight).collect();
    for _ in 0..2 {
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w = if *w < LEAST_WEIGHT * sum { 0.0 } else { *w / sum });
    }
    weights
}

/// Returns the index of the largest weight.
fn likeliest(weights: &[f64]) -> Option<usize> {
    let known = (0..weights.len()).filter(|&i| weights[i] > 0.0);
    known.max_by(|&a, &b| weights[a].total_cmp(&weights[b]))
}

/// Averages the results over the models; the covariance includes the spread between them. Returns
/// `None`, and writes nothing, if too many digits are lost.
fn average<const M: usize, const S: usize, const N: usize>(
    search: &mut Search<'_, M, N>,
    candidates: &[Candidate],
    weights: &[f64],
    most: usize,
    faults: &Faults,
    out: &mut Smoothed<'_>,
) -> Option<()> {
    let track = search.track;
    let best = &candidates[most];
    let mut first = Found::default();
    search.engine.smooth(track, &best.model, faults, &mut first)?;
    add_unresolved(track, best.model.whole_motion(), S, &mut first.covariance);
    let variance = best.factor.max(1.0).powi(2);
    first.covariance.iter_mut().for_each(|c| *c *= weights[most] * variance);
    let (mut found, mut shift) = (Found::default(), vec![0.0; first.mean.len()]);
    for (i, one) in candidates.iter().enumerate() {
        let weight = weights[i];
        if weight == 0.0 || i == most {
            continue;
        }
        search.engine.smooth(track, &one.model, faults, &mut found)?;
        add_unresolved(track, one.model.whole_motion(), S, &mut found.covariance);
        let variance = one.factor.max(1.0).powi(2);
        for k in 0..track.len() {
            let away: [f64; S] =
                std::array::from_fn(|i| found.mean[k * S + i] - first.mean[k * S + i]);
            for i in 0..S {
                shift[k * S + i] += weight * away[i];
                for j in 0..S {
                    let at = (k * S + i) * S + j;
                    let own = variance * found.covariance[at] + away[i] * away[j];
                    first.covariance[at] += weight * own;
                }
            }
        }
    }
    for (k, shift) in shift.chunks_exact(S).enumerate() {
        for i in 0..S {
            for j in 0..S {
                let at = (k * S + i) * S + j;
                out.covariance[at] = first.covariance[at] - shift[i] * shift[j];
            }
            out.mean[k * S + i] = first.mean[k * S + i] + shift[i];
        }
    }
    for (to, from) in out.innovation.iter_mut().zip(&first.innovation) {
        *to = from / best.factor;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_without_likelihood_does_not_spoil_the_others() {
        let weights = weights_of(&[-5.0, f64::NAN, -5.0, -50.0]);
        assert_eq!(weights, [0.5, 0.0, 0.5, 0.0]);
        assert!(weights_of(&[f64::NAN; 2]).iter().all(|weight| weight.is_nan()));
    }
}

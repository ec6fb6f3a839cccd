//! Positions that wander about a path, as those of an animal in its home range.
//!
//! The plots of such a target are those of one on the path whose noise is larger than stated and lasts: an
//! Ornstein–Uhlenbeck process is added to the path in both cases. Only the stated noise can tell them apart. If it
//! is right, the white part of the noise is as large as stated, and the rest is movement.

use super::fit::median_step;
use super::model::Faults;
use super::search::{Candidate, Search};

/// Difference of the logarithms of the likelihoods of both that says nothing: so much is chance.
const EQUAL: f64 = 2.0;
/// Least correlation of successive plots: with less, outliers that are not found, or larger white noise, would
/// be taken for movement.
const LEAST_CORRELATION: f64 = 0.4;
/// Difference of the logarithm of the likelihood of a model of noise from that of the best one, up to which the
/// process of this model is also tried as a movement.
const LIKELY: f64 = 4.0;
/// As [`LIKELY`], but from the best of all models, up to which movements are tried at all.
const FAR: f64 = 30.0;

/// Adds models of such movements to models of the noise, of which the logarithms of the probabilities are given.
pub(super) fn add_wandering<const M: usize, const N: usize>(
    search: &Search<'_, M, N>,
    faults: &Faults,
    found: &mut Vec<Candidate>,
    logs: &mut Vec<f64>,
) {
    let likely = likely_noise(found, median_step(search.track));
    let highest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let Some(&best) = likely.first().filter(|&&i| logs[i] > highest - FAR) else {
        return;
    };
    let moving = likely.iter().map(|&i| search.wandering(&found[i], faults));
    let moving: Vec<Candidate> = moving.filter(|one| !one.value.is_nan()).collect();
    let top = moving.iter().map(|one| one.value).fold(f64::NEG_INFINITY, f64::max);
    let gain = top - found[best].value;
    // a movement with the noise as stated is as likely beforehand as noise that is larger and lasts
    let odds = gain - gain.clamp(-EQUAL, EQUAL);
    for one in moving {
        logs.push(logs[best] + odds + one.value - top);
        found.push(one);
    }
}

/// Returns the likely models of noise that lasts and is larger than stated, the likeliest first, one for each
/// correlation time.
fn likely_noise(found: &[Candidate], step: f64) -> Vec<usize> {
    let lasts = |one: &Candidate| {
        one.model.lasting.share > 0.0 && one.model.lasting.correlation(step) > LEAST_CORRELATION
    };
    let is_larger = |one: &Candidate| one.factor > 1.0 && !one.value.is_nan();
    let mut likely: Vec<usize> =
        (0..found.len()).filter(|&i| lasts(&found[i]) && is_larger(&found[i])).collect();
    likely.sort_by(|&a, &b| found[b].value.total_cmp(&found[a].value));
    let mut times = Vec::new();
    likely.retain(|&i| {
        let time = found[i].model.lasting.time;
        let is_new = !times.contains(&time);
        times.push(time);
        is_new
    });
    let least = likely.first().map_or(0.0, |&i| found[i].value - LIKELY);
    likely.retain(|&i| found[i].value >= least);
    likely
}

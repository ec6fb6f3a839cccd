//! Runs of outliers that agree with each other, which may be a stay at another place.
//!
//! Outliers that are independent of each other hardly ever agree. A target that stays at another place for a
//! few plots and returns gives the same plots as a sensor with a short systematic error, so neither is certain.

use super::model::Faults;
use super::results::Smoothed;
use super::track::Track;
use crate::base::distribution::chi_square_upper_quantile;

/// Probability that a run of outliers that agree is a stay of the target.
const REAL: f64 = 1.0 / 3.0;
/// Probability that the plots of a stay do not agree.
const DISAGREE: f64 = 0.01;
/// Least number of plots of a stay.
const FEW: usize = 2;

/// Includes stays in the covariances of the positions: these become the second moments, about the estimates,
/// of the two possibilities.
pub(super) fn add_stays(track: &Track<'_>, faults: &Faults, out: &mut Smoothed<'_>) {
    let (d, m) = (track.dimension, track.numbers);
    let states = 3 * d;
    let limit = chi_square_upper_quantile(DISAGREE, d);
    let known: Vec<usize> =
        (0..track.len()).filter(|&k| track.plot(k)[..d].iter().all(|y| !y.is_nan())).collect();
    let away = |k: usize| -> Vec<f64> {
        let mut trend = vec![0.0; states];
        track.add_trend(k, &mut trend);
        (0..d).map(|i| track.plot(k)[i] + trend[i] - out.mean[k * states + i]).collect()
    };
    // squared length of a whitened vector
    let square = |k: usize, vector: &[f64]| -> f64 {
        let whitener = track.whitener(k);
        let row = |i: usize| (0..=i).map(|j| whitener[i * m + j] * vector[j]).sum::<f64>();
        (0..d).map(|i| row(i).powi(2)).sum()
    };
    let is_gross = |k: usize| faults.gross[k * m / d];
    // with the sum of the covariances, as if they had the same shape
    let agree = |a: usize, b: usize| {
        let difference: Vec<f64> = away(a).iter().zip(away(b)).map(|(a, b)| a - b).collect();
        (square(a, &difference).recip() + square(b, &difference).recip()).recip() < limit
    };
    let do_agree = |&a: &usize, &b: &usize| is_gross(a) && is_gross(b) && agree(a, b);
    let runs: Vec<_> = known.chunk_by(do_agree).filter(|run| run.len() >= FEW).collect();
    let stays: Vec<Vec<Vec<f64>>> =
        runs.iter().map(|run| run.iter().map(|&k| away(k)).collect()).collect();
    for (run, stay) in runs.iter().zip(&stays) {
        // few plots show too little of their own noise
        let weight = REAL / (run.len() - 1) as f64;
        for (i, j) in (0..d).flat_map(|i| (0..d).map(move |j| (i, j))) {
            let moment: f64 = stay.iter().map(|away| weight * away[i] * away[j]).sum();
            for &k in *run {
                out.covariance[(k * states + i) * states + j] += moment;
            }
        }
    }
}

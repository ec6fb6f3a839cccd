//! Innovations from rows of information.

use super::information::Information;
use super::rows::{invert, solve};
use super::track::Track;
use crate::base::scratch::refill;

/// Buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Whitening {
    triangle: Vec<f64>,
    state: Vec<f64>,
    root: Vec<f64>,
}

impl Whitening {
    /// Computes the innovations of the D numbers of instant `k` from number `first` on, which are its
    /// positions or its velocities, multiplied by the inverse of the Cholesky factor of their covariance; nan
    /// where there is no prediction.
    #[inline(always)]
    pub fn innovation(
        &mut self,
        n: usize,
        track: &Track<'_>,
        k: usize,
        first: usize,
        information: &mut Information,
        out: &mut [f64],
    ) {
        let Self { triangle, state, root } = self;
        let (d, width) = (n / 3, n + 1);
        out.fill(f64::NAN);
        let plot = &track.plot(k)[first..][..d];
        let derivative = usize::from(first > 0);
        let seen = &information.seen;
        let predicted =
            |axis: usize| !plot[axis].is_nan() && seen[axis].determines(track.times[k])[derivative];
        let predicted: Vec<bool> = (0..d).map(predicted).collect();
        if !predicted.contains(&true) {
            return;
        }
        information.complete(n, track, triangle);
        for values in [&mut *root, &mut *state] {
            refill(values, n * n, 0.0);
        }
        invert(triangle, width, n, root);
        solve(triangle, width, n, state);
        // S = H P H^T + covariance; the innovation is eliminated together with the rows of its factor
        let mut factor = vec![0.0; d * d];
        let noise = noise_of(track, k, first);
        for i in 0..d {
            if !predicted[i] {
                continue;
            }
            let near = if first == 0 { track.reference(k)[i] } else { 0.0 };
            let mut value = plot[i] - near - state[first + i];
            for j in 0..=i {
                if out[j].is_nan() && j < i {
                    continue;
                }
                let product = |a: usize, b: usize| -> f64 {
                    (0..n).map(|c| root[a * n + c] * root[b * n + c]).sum()
                };
                let mut sum = product(first + i, first + j) + noise[i * d + j];
                for l in 0..j {
                    sum -= factor[i * d + l] * factor[j * d + l];
                }
                factor[i * d + j] = if i == j { sum.sqrt() } else { sum / factor[j * d + j] };
                if j < i {
                    value -= factor[i * d + j] * out[j];
                }
            }
            out[i] = value / factor[i * d + i];
        }
    }
}

/// Covariance of D numbers of a plot, from the inverse of its factor.
fn noise_of(track: &Track<'_>, k: usize, first: usize) -> Vec<f64> {
    // L row by row from N = L^-1; missing axes have zero rows
    let (d, m) = (track.dimension, track.numbers);
    let whitener = |i: usize, j: usize| track.whitener(k)[(first + i) * m + first + j];
    let mut l = vec![0.0; d * d];
    for i in 0..d {
        let pivot = whitener(i, i);
        if pivot == 0.0 {
            continue;
        }
        l[i * d + i] = 1.0 / pivot;
        for j in 0..i {
            let sum: f64 = (j..i).map(|k| whitener(i, k) * l[k * d + j]).sum();
            l[i * d + j] = -sum / pivot;
        }
    }
    let mut noise = vec![0.0; d * d];
    for i in 0..d {
        for j in 0..d {
            noise[i * d + j] = (0..d).map(|k| l[i * d + k] * l[j * d + k]).sum();
        }
    }
    noise
}

//! Innovations by rows of information.

use super::information::Information;
use super::rows::{invert, solve};
use super::track::{Seen, Track};

/// Buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Whitening {
    triangle: Vec<f64>,
    state: Vec<f64>,
    root: Vec<f64>,
}

impl Whitening {
    /// The innovation of the plot of instant `k`, with the inverse of the Cholesky factor of its
    /// covariance, as far as the plot is predicted.
    #[inline(always)]
    pub fn innovation(
        &mut self,
        n: usize,
        track: &Track<'_>,
        k: usize,
        information: &mut Information,
        out: &mut [f64],
    ) {
        let Self { triangle, state, root } = self;
        let (d, width) = (n / 3, n + 1);
        out.fill(f64::NAN);
        let plot = track.plot(k);
        let predicted =
            |axis: usize, seen: &Seen| !plot[axis].is_nan() && seen.determines(track.times[k])[0];
        if !information.seen.iter().enumerate().any(|(axis, seen)| predicted(axis, seen)) {
            return;
        }
        information.complete(n, track, triangle);
        for values in [&mut *root, &mut *state] {
            values.clear();
            values.resize(n * n, 0.0);
        }
        invert(triangle, width, n, root);
        solve(triangle, width, n, state);
        // S = H P H^T + covariance; the innovation goes along as another row of its factor
        let whitener = track.whitener(k);
        let mut factor = vec![0.0; d * d];
        let noise = noise_of(whitener, d);
        for i in 0..d {
            if !predicted(i, &information.seen[i]) {
                continue;
            }
            let mut value = plot[i] - track.reference(k)[i] - state[i];
            for j in 0..=i {
                if out[j].is_nan() && j < i {
                    continue;
                }
                let product = |a: usize, b: usize| -> f64 {
                    (0..n).map(|c| root[a * n + c] * root[b * n + c]).sum()
                };
                let mut sum = product(i, j) + noise[i * d + j];
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

/// The covariance whose factor's inverse is given.
fn noise_of(whitener: &[f64], d: usize) -> Vec<f64> {
    // L row by row from N = L^-1; axes that are not there have zero rows
    let mut l = vec![0.0; d * d];
    for i in 0..d {
        let pivot = whitener[i * d + i];
        if pivot == 0.0 {
            continue;
        }
        l[i * d + i] = 1.0 / pivot;
        for j in 0..i {
            let sum: f64 = (j..i).map(|k| whitener[i * d + k] * l[k * d + j]).sum();
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

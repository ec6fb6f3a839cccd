//! Modes that persist: bursts of bad measurements as a hidden Markov chain.
//!
//! The chain has one parameter more than the mixture: `P(j | i) = κ δ_ij + (1 − κ) π_j` with the
//! shares π, which are its stationary distribution whatever κ. Forward and backward pass (Baum and
//! others 1970) cost O(N) for each mode.

use super::modes::{MOST_BAD, Modes, Sums, excess};
use crate::base::exponential::exp;
use pulp::{Simd, WithSimd};

/// Modes with the good one.
const MOST: usize = MOST_BAD + 1;

/// Ratios below this were not cut.
const LARGE: f64 = 1e290;

/// Buffers of the two passes.
#[derive(Clone, Debug, Default)]
pub(super) struct Passes {
    /// Densities of each bad mode over that of the good one.
    ratio: [Vec<f64>; MOST_BAD],
    /// Probabilities of the modes given the measurements so far.
    forward: Vec<[f64; MOST]>,
    /// One over the predicted density of each measurement over that of the good mode.
    scale: Vec<f64>,
}

struct Ratios<'a, const KINDS: usize> {
    modes: &'a Modes,
    y: &'a [f64],
    ratio: [&'a mut [f64]; KINDS],
}

impl<const KINDS: usize> WithSimd for Ratios<'_, KINDS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let c: [[f64; 3]; KINDS] = std::array::from_fn(|j| self.modes.log_ratio(j));
        let n = self.y.len();
        let ratio = self.ratio.map(|r| &mut r[..n]);
        for i in 0..n {
            let z = self.y[i] - self.modes.centre;
            let log: [f64; KINDS] = std::array::from_fn(|j| c[j][0] + z * (c[j][1] + z * c[j][2]));
            let shift = excess(&log);
            for j in 0..KINDS {
                ratio[j][i] = exp(log[j] - shift);
            }
        }
    }
}

/// One E step. Unless `bad` is empty, it gets the probabilities of the bad modes, as many for each
/// measurement as there are, and the log-likelihood is returned, without its part `−½ N ln 2π`.
pub(super) fn expect(
    modes: &Modes,
    y: &[f64],
    passes: &mut Passes,
    bad: &mut [f64],
) -> (Sums, f64) {
    for ratio in &mut passes.ratio {
        ratio.resize(y.len(), 0.0);
    }
    passes.forward.resize(y.len(), [0.0; MOST]);
    passes.scale.resize(y.len(), 0.0);
    let (arch, [first, second]) = (pulp::Arch::new(), &mut passes.ratio);
    let sums = if modes.kinds() == 1 {
        arch.dispatch(Ratios { modes, y, ratio: [first] });
        passes.both::<2>(modes, y, bad)
    } else {
        arch.dispatch(Ratios { modes, y, ratio: [first, second] });
        passes.both::<MOST>(modes, y, bad)
    };
    let likelihood = if bad.is_empty() { 0.0 } else { passes.log_likelihood(modes, y) };
    (sums, likelihood)
}

impl Passes {
    /// Forward and backward pass over so many modes, the good one first.
    fn both<const MODES: usize>(&mut self, modes: &Modes, y: &[f64], bad: &mut [f64]) -> Sums {
        let n = y.len();
        let ratio = self.ratio.each_ref().map(|r| &r[..n]);
        let (forward, scale) = (&mut self.forward[..n], &mut self.scale[..n]);
        // the good mode is what ratios refer to
        let density = |t: usize, j: usize| if j == 0 { 1.0 } else { ratio[j - 1][t] };
        let persistence = modes.persistence;
        let share: [f64; MODES] = std::array::from_fn(|j| match j {
            0 => modes.good_share(),
            _ => modes.bad[j - 1].share,
        });
        let renewed = share.map(|s| (1.0 - persistence) * s);
        let mut predicted = share;
        for t in 0..n {
            let joint: [f64; MODES] = std::array::from_fn(|j| predicted[j] * density(t, j));
            scale[t] = 1.0 / joint.iter().sum::<f64>();
            for j in 0..MODES {
                forward[t][j] = joint[j] * scale[t];
                predicted[j] = persistence * forward[t][j] + renewed[j];
            }
        }
        let mut sums = Sums::default();
        let mut drawn = [0.0; MODES];
        let mut backward = [1.0; MODES];
        for t in (0..n).rev() {
            for j in 0..MODES - 1 {
                let g = forward[t][j + 1] * backward[j + 1];
                sums.count[j] += g;
                sums.first[j] += g * y[t];
                sums.second[j] += g * y[t] * y[t];
                if !bad.is_empty() {
                    bad[t * (MODES - 1) + j] = g;
                }
            }
            if t == 0 {
                for j in 0..MODES {
                    drawn[j] += forward[0][j] * backward[j];
                }
                break;
            }
            // P(j at t | rest) over the probability of coming to j at t
            let ahead: [f64; MODES] =
                std::array::from_fn(|j| density(t, j) * backward[j] * scale[t]);
            let mut renewal = 0.0;
            for j in 0..MODES {
                sums.persisted += persistence * forward[t - 1][j] * ahead[j];
                drawn[j] += renewed[j] * ahead[j];
                renewal += renewed[j] * ahead[j];
            }
            backward = ahead.map(|a| persistence * a + renewal);
        }
        sums.drawn_good = drawn[0];
        sums.drawn[..MODES - 1].copy_from_slice(&drawn[1..]);
        sums
    }

    /// The log-likelihood after both passes, without its part `−½ N ln 2π`.
    fn log_likelihood(&self, modes: &Modes, y: &[f64]) -> f64 {
        let ratio = &self.ratio[..modes.kinds()];
        let of = |t: usize| {
            let cut = ratio.iter().any(|r| r[t] > LARGE);
            let excess = if cut { modes.excess(y[t]) } else { 0.0 };
            excess - self.scale[t].ln() - 0.5 * ((y[t] - modes.centre) / modes.width).powi(2)
        };
        (0..y.len()).map(of).sum::<f64>() - y.len() as f64 * modes.width.ln()
    }
}

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
    /// Densities over that of the good mode.
    ratio: Vec<[f64; MOST]>,
    /// Probabilities of the modes given the measurements so far.
    forward: Vec<[f64; MOST]>,
    /// One over the predicted density of each measurement over that of the good mode.
    scale: Vec<f64>,
}

struct Ratios<'a> {
    modes: &'a Modes,
    y: &'a [f64],
    ratio: &'a mut Vec<[f64; MOST]>,
}

impl WithSimd for Ratios<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let kinds = self.modes.kinds();
        let mut c = [[0.0; 3]; MOST_BAD];
        for (j, c) in c.iter_mut().enumerate().take(kinds) {
            *c = self.modes.log_ratio(j);
        }
        self.ratio.clear();
        self.ratio.resize(self.y.len(), [1.0, 0.0, 0.0]);
        for (&y, ratio) in self.y.iter().zip(&mut *self.ratio) {
            let z = y - self.modes.centre;
            let mut log = [f64::NEG_INFINITY; MOST_BAD];
            for j in 0..kinds {
                log[j] = c[j][0] + z * (c[j][1] + z * c[j][2]);
            }
            let shift = excess(&log);
            for j in 0..kinds {
                ratio[j + 1] = exp(log[j] - shift);
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
    pulp::Arch::new().dispatch(Ratios { modes, y, ratio: &mut passes.ratio });
    let (kinds, persistence) = (modes.kinds(), modes.persistence);
    let mut share = [modes.good_share(), modes.bad[0].share, 0.0];
    if kinds == 2 {
        share[2] = modes.bad[1].share;
    }
    let renewed = share.map(|s| (1.0 - persistence) * s);
    passes.forward.clear();
    passes.scale.clear();
    let mut predicted = share;
    for r in &passes.ratio {
        let joint: [f64; MOST] = std::array::from_fn(|j| predicted[j] * r[j]);
        let scale = 1.0 / (joint[0] + joint[1] + joint[2]);
        let forward = joint.map(|v| v * scale);
        predicted = std::array::from_fn(|j| persistence * forward[j] + renewed[j]);
        passes.forward.push(forward);
        passes.scale.push(scale);
    }
    let mut sums = Sums::default();
    let mut drawn = [0.0; MOST];
    let mut backward = [1.0; MOST];
    for t in (0..y.len()).rev() {
        let Passes { ratio, forward, scale } = &*passes;
        for j in 0..kinds {
            let g = forward[t][j + 1] * backward[j + 1];
            sums.count[j] += g;
            sums.first[j] += g * y[t];
            sums.second[j] += g * y[t] * y[t];
            if !bad.is_empty() {
                bad[t * kinds + j] = g;
            }
        }
        if t == 0 {
            for j in 0..MOST {
                drawn[j] += forward[0][j] * backward[j];
            }
            break;
        }
        // P(j at t | rest) over the probability of coming to j at t
        let ahead: [f64; MOST] = std::array::from_fn(|j| ratio[t][j] * backward[j] * scale[t]);
        let mut renewal = 0.0;
        for j in 0..MOST {
            sums.persisted += persistence * forward[t - 1][j] * ahead[j];
            drawn[j] += renewed[j] * ahead[j];
            renewal += renewed[j] * ahead[j];
        }
        backward = ahead.map(|a| persistence * a + renewal);
    }
    sums.drawn_good = drawn[0];
    sums.drawn.copy_from_slice(&drawn[1..]);
    if bad.is_empty() {
        return (sums, 0.0);
    }
    let of = |t: usize| {
        let cut = passes.ratio[t].iter().any(|&r| r > LARGE);
        let excess = if cut { modes.excess(y[t]) } else { 0.0 };
        excess - passes.scale[t].ln() - 0.5 * ((y[t] - modes.centre) / modes.width).powi(2)
    };
    let log_likelihood = (0..y.len()).map(of).sum::<f64>();
    (sums, log_likelihood - y.len() as f64 * modes.width.ln())
}

//! Modes that persist: bursts of bad measurements as a hidden Markov chain.
//!
//! The chain has one parameter more than the mixture: `P(j | i) = κ δ_ij + (1 − κ) π_j` with the shares
//! π, which are its stationary distribution for any κ. The forward and backward passes (Baum and others
//! 1970) cost O(N) for each mode.

use super::independent::{LANES, LARGE};
use super::modes::{MOST_BAD, Modes, Sums, excess};
use crate::base::exponential::exp;
use pulp::{Simd, WithSimd};

/// Largest number of modes, including the good one.
const MOST: usize = MOST_BAD + 1;

/// Sums outside this range are scaled to 1; sums within it remain finite when multiplied by a ratio.
const USUAL: std::ops::Range<f64> = 1e-100..1e3;

/// Buffers of the two passes, with a column for each mode.
#[derive(Clone, Debug, Default)]
pub(super) struct Passes {
    /// Density of each bad mode relative to the good mode.
    ratio: [Vec<f64>; MOST_BAD],
    /// Proportional to the joint density of the measurements so far and the mode of the last one.
    forward: [Vec<f64>; MOST],
    /// Proportional to the density of the later measurements, given the mode.
    backward: [Vec<f64>; MOST],
    /// Proportional to the density of the next and all later measurements, given the mode of the next
    /// one; 0 after the last.
    ahead: [Vec<f64>; MOST],
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

/// Runs one E step. Unless `bad` is empty, the probabilities of the bad modes are written to it, as
/// many for each measurement as there are bad modes, and the log likelihood is returned without its
/// term `−½ N ln 2π`.
pub(super) fn expect(
    modes: &Modes,
    y: &[f64],
    passes: &mut Passes,
    bad: &mut [f64],
) -> (Sums, f64) {
    passes.make_room(y.len());
    let (arch, [first, second]) = (pulp::Arch::new(), &mut passes.ratio);
    let sticky = Sticky::of(modes);
    let likelihood = !bad.is_empty();
    let (sums, log_ratio) = if modes.kinds() == 1 {
        arch.dispatch(Ratios { modes, y, ratio: [first] });
        let log_ratio = passes.both::<2>(&sticky, y.len());
        (arch.dispatch(Collect::<2> { sticky: &sticky, y, passes, bad }), log_ratio)
    } else {
        arch.dispatch(Ratios { modes, y, ratio: [first, second] });
        let log_ratio = passes.both::<MOST>(&sticky, y.len());
        (arch.dispatch(Collect::<MOST> { sticky: &sticky, y, passes, bad }), log_ratio)
    };
    let likelihood = if likelihood { log_ratio + passes.log_likelihood(modes, y) } else { 0.0 };
    (sums, likelihood)
}

/// The chain: persistence κ, shares π of the modes with the good one first, and `(1 − κ) π`.
struct Sticky {
    persistence: f64,
    share: [f64; MOST],
    renewed: [f64; MOST],
}

impl Sticky {
    fn of(modes: &Modes) -> Self {
        let [first, second] = modes.bad.map(|mode| mode.share);
        let share = [modes.good_share(), first, second];
        let persistence = modes.persistence;
        Self { persistence, share, renewed: share.map(|s| (1.0 - persistence) * s) }
    }
}

impl Passes {
    /// Resizes the columns for n measurements. They are padded to whole lanes with good measurements
    /// after which nothing follows.
    fn make_room(&mut self, n: usize) {
        let whole = n.next_multiple_of(LANES);
        for ratio in &mut self.ratio {
            ratio.resize(n, 0.0);
        }
        for j in 0..MOST {
            let good = f64::from(u8::from(j == 0));
            for (column, value) in [
                (&mut self.forward[j], good),
                (&mut self.backward[j], 1.0),
                (&mut self.ahead[j], 0.0),
            ] {
                column.resize(whole, value);
                column[n.saturating_sub(1)..].fill(value);
            }
        }
    }

    /// Runs forward and backward pass over `MODES` modes side by side, because each step depends on the
    /// one before. Returns the log of the density of all measurements relative to good modes only.
    fn both<const MODES: usize>(&mut self, chain: &Sticky, n: usize) -> f64 {
        let Self { ratio, forward, backward, ahead } = self;
        let ratio = ratio.each_ref().map(|r| &r[..n]);
        let [forward, backward, ahead] =
            [forward, backward, ahead].map(|columns| columns.each_mut().map(|c| &mut c[..n]));
        // ratios are relative to the good mode
        let density = |t: usize, j: usize| if j == 0 { 1.0 } else { ratio[j - 1][t] };
        let Sticky { persistence, share, renewed } = *chain;
        let (mut log, mut last) = (0.0, 1.0);
        let mut predicted: [f64; MODES] = std::array::from_fn(|j| share[j]);
        let mut b = [1.0; MODES];
        for t in 0..n {
            let mut a: [f64; MODES] = std::array::from_fn(|j| predicted[j] * density(t, j));
            last = a.iter().sum::<f64>();
            if !USUAL.contains(&last) {
                log += last.ln();
                a = a.map(|a| a / last);
                last = 1.0;
            }
            for j in 0..MODES {
                forward[j][t] = a[j];
                predicted[j] = persistence * a[j] + renewed[j] * last;
            }
            let u = n - 1 - t;
            for j in 0..MODES {
                backward[j][u] = b[j];
            }
            if u == 0 {
                break;
            }
            let mut next: [f64; MODES] = std::array::from_fn(|j| density(u, j) * b[j]);
            let renewal: f64 = (0..MODES).map(|j| renewed[j] * next[j]).sum();
            b = next.map(|next| persistence * next + renewal);
            let sum = b.iter().sum::<f64>();
            if !USUAL.contains(&sum) {
                b = b.map(|b| b / sum);
                next = next.map(|next| next / sum);
            }
            for j in 0..MODES {
                ahead[j][u - 1] = next[j];
            }
        }
        log + last.ln()
    }

    /// Returns the log likelihood with good modes only, plus what was subtracted from log ratios,
    /// without its term `−½ N ln 2π`.
    fn log_likelihood(&self, modes: &Modes, y: &[f64]) -> f64 {
        let ratio = &self.ratio[..modes.kinds()];
        let of = |t: usize| {
            let cut = ratio.iter().any(|r| r[t] > LARGE);
            let excess = if cut { modes.excess(y[t]) } else { 0.0 };
            excess - 0.5 * ((y[t] - modes.centre) / modes.width).powi(2)
        };
        (0..y.len()).map(of).sum::<f64>() - y.len() as f64 * modes.width.ln()
    }
}

/// Computes the expected sums after both passes.
struct Collect<'a, const MODES: usize> {
    sticky: &'a Sticky,
    y: &'a [f64],
    passes: &'a Passes,
    /// As in [`expect`].
    bad: &'a mut [f64],
}

impl<const MODES: usize> WithSimd for Collect<'_, MODES> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Sums {
        let Self { sticky: Sticky { persistence, renewed, .. }, y, passes, bad } = self;
        let chunks = |columns: &'_ [Vec<f64>; MOST], j: usize, k: usize| -> [f64; LANES] {
            columns[j].as_chunks().0[k]
        };
        let zero = [0.0; LANES];
        let (mut count, mut first, mut second) = ([zero; MODES], [zero; MODES], [zero; MODES]);
        let (mut drawn, mut persisted) = ([zero; MODES], zero);
        for k in 0..y.len().div_ceil(LANES) {
            let at = k * LANES;
            let mut values = zero;
            let there = LANES.min(y.len() - at);
            values[..there].copy_from_slice(&y[at..at + there]);
            let (mut a, mut g, mut ahead) = ([zero; MODES], [zero; MODES], [zero; MODES]);
            let (mut all, mut sum, mut stays) = (zero, zero, zero);
            for j in 0..MODES {
                a[j] = chunks(&passes.forward, j, k);
                ahead[j] = chunks(&passes.ahead, j, k);
                let b = chunks(&passes.backward, j, k);
                for i in 0..LANES {
                    g[j][i] = a[j][i] * b[i];
                    all[i] += g[j][i];
                    sum[i] += a[j][i];
                    stays[i] += a[j][i] * ahead[j][i];
                }
            }
            for i in 0..LANES {
                all[i] = 1.0 / all[i];
                persisted[i] += stays[i] * all[i];
                sum[i] *= all[i];
            }
            for j in 0..MODES {
                for i in 0..LANES {
                    g[j][i] *= all[i];
                    count[j][i] += g[j][i];
                    first[j][i] += g[j][i] * values[i];
                    second[j][i] += g[j][i] * values[i] * values[i];
                    drawn[j][i] += ahead[j][i] * sum[i];
                }
            }
            if !bad.is_empty() {
                for i in 0..there {
                    for j in 1..MODES {
                        bad[(at + i) * (MODES - 1) + j - 1] = g[j][i];
                    }
                }
            }
        }
        let mut sums = Sums::default();
        let total = |lanes: &[f64; LANES]| lanes.iter().sum::<f64>();
        // the mode of the first measurement was drawn
        let first_drawn = passes.first::<MODES>();
        let drawn: [f64; MODES] =
            std::array::from_fn(|j| renewed[j] * total(&drawn[j]) + first_drawn[j]);
        sums.drawn_good = drawn[0];
        for j in 1..MODES {
            (sums.count[j - 1], sums.drawn[j - 1]) = (total(&count[j]), drawn[j]);
            (sums.first[j - 1], sums.second[j - 1]) = (total(&first[j]), total(&second[j]));
        }
        sums.persisted = persistence * total(&persisted);
        sums
    }
}

impl Passes {
    /// Returns the probabilities of the modes of the first measurement.
    fn first<const MODES: usize>(&self) -> [f64; MODES] {
        let joint: [f64; MODES] = std::array::from_fn(|j| self.forward[j][0] * self.backward[j][0]);
        let all: f64 = joint.iter().sum();
        joint.map(|g| g / all)
    }
}

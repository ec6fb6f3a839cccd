//! Modes that do not persist: the mode of each measurement is independent of the others.

use super::modes::{Modes, Sums, excess};
use crate::base::exponential::{LARGEST_EXPONENT, exp, sum_of_logarithms};
use pulp::{Simd, WithSimd};

pub(super) const LANES: usize = 8;
/// Ratios up to this have not been limited.
pub(super) const LARGE: f64 = 1e290;

/// Computes the expected sums of the bad modes. O(N), without storage.
struct Expect<'a, const KINDS: usize> {
    modes: &'a Modes,
    y: &'a [f64],
}

/// Returns the coefficients of the log density ratios of the bad modes to the good one, and the ratios
/// of the shares.
fn coefficients<const KINDS: usize>(modes: &Modes) -> [([f64; 3], f64); KINDS] {
    let good = modes.good_share();
    std::array::from_fn(|j| (modes.log_ratio(j), modes.bad[j].share / good))
}

impl<const KINDS: usize> WithSimd for Expect<'_, KINDS> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Sums {
        let (modes, c) = (self.modes, coefficients::<KINDS>(self.modes));
        let mut lanes = [[[0.0; LANES]; 3]; KINDS];
        let (chunks, rest) = self.y.as_chunks::<LANES>();
        let mut padded = [modes.centre; LANES];
        padded[..rest.len()].copy_from_slice(rest);
        // lanes beyond the end do not count
        let ones = [1.0; LANES];
        let last: [f64; LANES] = std::array::from_fn(|i| f64::from(u8::from(i < rest.len())));
        for k in 0..=chunks.len() {
            let (chunk, present) =
                if k < chunks.len() { (&chunks[k], &ones) } else { (&padded, &last) };
            // lane by lane within each mode: in the other order the loops for two modes are not
            // vectorised
            let (mut r, mut excess) = ([[0.0; LANES]; KINDS], [LARGEST_EXPONENT; LANES]);
            for j in 0..KINDS {
                for i in 0..LANES {
                    let z = chunk[i] - modes.centre;
                    let log = c[j].0[0] + z * (c[j].0[1] + z * c[j].0[2]);
                    r[j][i] = log;
                    excess[i] = if log > excess[i] { log } else { excess[i] };
                }
            }
            let mut all = ones;
            for j in 0..KINDS {
                for i in 0..LANES {
                    r[j][i] = c[j].1 * exp(r[j][i] - (excess[i] - LARGEST_EXPONENT));
                    all[i] += r[j][i];
                }
            }
            for i in 0..LANES {
                all[i] = present[i] / all[i];
            }
            for j in 0..KINDS {
                for i in 0..LANES {
                    let g = r[j][i] * all[i];
                    lanes[j][0][i] += g;
                    lanes[j][1][i] += g * chunk[i];
                    lanes[j][2][i] += g * chunk[i] * chunk[i];
                }
            }
        }
        let mut sums = Sums::default();
        for j in 0..KINDS {
            let [count, first, second] = lanes[j].map(|l| l.iter().sum());
            (sums.count[j], sums.first[j], sums.second[j]) = (count, first, second);
            sums.drawn[j] = count;
        }
        sums.drawn_good = self.y.len() as f64 - sums.count.iter().sum::<f64>();
        sums
    }
}

/// Runs one E step.
pub(super) fn expect(modes: &Modes, y: &[f64]) -> Sums {
    let arch = pulp::Arch::new();
    match modes.kinds() {
        1 => arch.dispatch(Expect::<1> { modes, y }),
        _ => arch.dispatch(Expect::<2> { modes, y }),
    }
}

/// Computes the probabilities of the bad modes, `KINDS` for each measurement, and the evidence of each
/// measurement relative to the good mode.
struct Posterior<'a, const KINDS: usize> {
    modes: &'a Modes,
    y: &'a [f64],
    bad: &'a mut [f64],
    evidence: &'a mut [f64],
}

impl<const KINDS: usize> WithSimd for Posterior<'_, KINDS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (modes, c) = (self.modes, coefficients::<KINDS>(self.modes));
        let (bad, _) = self.bad.as_chunks_mut::<KINDS>();
        for ((&y, g), e) in self.y.iter().zip(bad).zip(self.evidence) {
            let z = y - modes.centre;
            *e = 1.0;
            for j in 0..KINDS {
                g[j] = c[j].0[0] + z * (c[j].0[1] + z * c[j].0[2]);
            }
            let shift = excess(g);
            for j in 0..KINDS {
                g[j] = c[j].1 * exp(g[j] - shift);
                *e += g[j];
            }
            for j in 0..KINDS {
                g[j] /= *e;
            }
        }
    }
}

/// Writes the probabilities of the bad modes, as many for each measurement as there are; returns the
/// log likelihood without its term `−½ N ln 2π`.
pub(super) fn posterior(modes: &Modes, y: &[f64], bad: &mut [f64], evidence: &mut [f64]) -> f64 {
    let arch = pulp::Arch::new();
    match modes.kinds() {
        1 => arch.dispatch(Posterior::<1> { modes, y, bad, evidence }),
        _ => arch.dispatch(Posterior::<2> { modes, y, bad, evidence }),
    }
    let good = y.len() as f64 * (modes.good_share() / modes.width).ln();
    let inverse = 1.0 / modes.width;
    let square = |y: &f64| ((y - modes.centre) * inverse).powi(2);
    let excess = |y: &f64, e: f64| if e > LARGE { modes.excess(*y) } else { 0.0 };
    let of = |(y, e): (&f64, &f64)| excess(y, *e) - 0.5 * square(y);
    good + sum_of_logarithms(evidence) + y.iter().zip(&*evidence).map(of).sum::<f64>()
}

//! The mean of values with slow noise in addition to white noise.
//!
//! 1/f noise is represented as a sum of AR(1) processes of equal variance. Their time constants are a
//! geometric series from one step to several lengths of the record (van der Ziel 1950), so a Kalman
//! filter yields the likelihood. A Gauss-Markov process is one such AR(1) process, of unknown time constant.

use crate::base::exponential::ln;
use crate::base::interrupt::poll;
use pulp::{Arch, Simd, WithSimd};

/// Prior probabilities of 1/f noise and of a Gauss-Markov process beside white noise.
const FLICKER: f64 = 0.1;
const GAUSS_MARKOV: f64 = 0.2;
/// Assumed shares of the 1/f noise, and of a Gauss-Markov process, in the variance.
const FLICKER_SHARES: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
const MARKOV_SHARES: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
/// Ratio of successive time constants of 1/f noise, and of the longest one to the length of the record.
const RATIO: f64 = 4.0;
const LONGEST: f64 = 4.0;
/// Largest number of processes, with time constants of up to 4^15 steps.
const MOST: usize = 16;
/// Shortest time constant of a Gauss-Markov process, ratio of successive ones, and ratio of the longest one to
/// the length of the record: with a shorter one, a finder that drifts would not be recognised.
const SHORTEST: f64 = 2.0;
const MARKOV_RATIO: f64 = 2.0;
const MARKOV_LONGEST: f64 = 4.0;
/// Number of variances, none below .05, of which one logarithm is taken.
const AT_ONCE: usize = 16;

/// Effect of slow noise on the mean of a record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlowNoise {
    /// Logarithm of the evidence relative to that of white noise.
    pub gain: f64,
    /// Ratio of the variance of the mean to its variance for white noise.
    pub inflation: f64,
    /// Correlation of successive values.
    pub correlation: f64,
}

/// Sums of a filter for `L` shares: Σ ln S, and the squares and products of the innovations of ones and of
/// values, divided by S.
#[derive(Clone, Copy)]
struct Sums<const L: usize> {
    log: [f64; L],
    ones: [f64; L],
    cross: [f64; L],
    squares: [f64; L],
}

/// Values with their indices in the record, and their likelihood if the noise is white.
struct Values<'a> {
    values: &'a [(usize, f64)],
    origin: f64,
    white: f64,
    variance: f64,
}

impl<'a> Values<'a> {
    /// Returns `None` for fewer than three values, and if all are equal. O(N).
    fn new(values: &'a [(usize, f64)]) -> Option<Self> {
        let n = values.len() as f64;
        let origin = values.first()?.1;
        let mean = values.iter().map(|v| v.1 - origin).sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v.1 - origin - mean).powi(2)).sum();
        let white = evidence(n, 0.0, n, squares);
        (n >= 3.0 && squares > 0.0).then_some(Self { values, origin, white, variance: squares / n })
    }

    /// Number of steps from the first to the last value, both included.
    fn length(&self) -> f64 {
        (self.values[self.values.len() - 1].0 - self.values[0].0 + 1) as f64
    }

    /// Returns the effects of each of these kinds of noise, for each of their shares in the variance. `P` filters
    /// run side by side, because each waits for the division of the step before.
    fn effects<const K: usize, const L: usize, const P: usize>(
        &self,
        noises: &[Noise<L>],
    ) -> Vec<SlowNoise> {
        let mut found = Vec::with_capacity(noises.len() * L);
        for some in noises.chunks(P) {
            poll();
            let filter = |p: usize| Filter::<K, L>::new(some.get(p).unwrap_or(&some[0]));
            let filters: [Filter<K, L>; P] = std::array::from_fn(filter);
            let sums = Arch::new().dispatch(Run::<K, L, P> { values: self, filters });
            found.extend(some.iter().zip(&sums).flat_map(|(noise, sums)| self.read(noise, sums)));
        }
        found
    }

    fn read<const L: usize>(&self, noise: &Noise<L>, sums: &Sums<L>) -> [SlowNoise; L] {
        let correlation = noise.decay.iter().sum::<f64>() / noise.decay.len() as f64;
        let Sums { log, ones, cross, squares } = sums;
        std::array::from_fn(|l| {
            let rss = (squares[l] - cross[l] * cross[l] / ones[l]).max(f64::MIN_POSITIVE);
            SlowNoise {
                gain: evidence(self.values.len() as f64, log[l], ones[l], rss) - self.white,
                inflation: rss / ones[l] / self.variance,
                correlation: noise.shares[l] * correlation,
            }
        })
    }
}

/// Processes of equal variances, given by their correlations per step, and shares in the variance.
struct Noise<'a, const L: usize> {
    decay: &'a [f64],
    shares: [f64; L],
}

/// Logarithm of the evidence, with flat priors of the mean and of the logarithm of the scale.
fn evidence(n: f64, log: f64, ones: f64, rss: f64) -> f64 {
    -0.5 * (log + ones.ln() + (n - 1.0) * rss.ln())
}

impl SlowNoise {
    /// Returns the kinds of slow noise, with their prior probabilities.
    pub fn possible(values: &[(usize, f64)]) -> Vec<(f64, Self)> {
        let flicker = Self::flicker(values).map(|found| (FLICKER, found));
        let gauss_markov = Self::gauss_markov(values).map(|found| (GAUSS_MARKOV, found));
        flicker.into_iter().chain(gauss_markov).collect()
    }

    /// Computes the posterior over the shares of 1/f noise, whose priors are equal. `values` are given with
    /// their indices in the record. Returns `None` for fewer than three values, and if all are equal.
    /// O(N log² N).
    fn flicker(values: &[(usize, f64)]) -> Option<Self> {
        let values = Values::new(values)?;
        let decay = processes(values.length());
        let noises = FLICKER_SHARES.map(|share| Noise { decay: &decay, shares: [share] });
        Some(Self::mean(&match decay.len() {
            ..=4 => values.effects::<4, 1, 3>(&noises),
            5..=6 => values.effects::<6, 1, 3>(&noises),
            7..=8 => values.effects::<8, 1, 3>(&noises),
            _ => values.effects::<MOST, 1, 3>(&noises),
        }))
    }

    /// Computes the same for a Gauss-Markov process, over its shares and time constants. O(N log N).
    fn gauss_markov(values: &[(usize, f64)]) -> Option<Self> {
        let values = Values::new(values)?;
        let times = std::iter::successors(Some(SHORTEST), |time| Some(time * MARKOV_RATIO));
        let times = times.take_while(|time| *time <= MARKOV_LONGEST * values.length());
        let decay: Vec<f64> = times.map(|time| (-1.0 / time).exp()).collect();
        let noise = |decay| Noise { decay: std::slice::from_ref(decay), shares: MARKOV_SHARES };
        let noises: Vec<_> = decay.iter().map(noise).collect();
        Some(Self::mean(&values.effects::<1, 4, 4>(&noises)))
    }

    /// Returns the mean over several possibilities of equal priors.
    fn mean(found: &[Self]) -> Self {
        let highest = found.iter().fold(f64::NEG_INFINITY, |h: f64, f| h.max(f.gain));
        let weight = |f: &Self| (f.gain - highest).exp();
        let total: f64 = found.iter().map(weight).sum();
        let over = |value: fn(&Self) -> f64| {
            found.iter().map(|f| weight(f) * value(f)).sum::<f64>() / total
        };
        Self {
            gain: highest + (total / found.len() as f64).ln(),
            inflation: over(|f| f.inflation),
            correlation: over(|f| f.correlation),
        }
    }
}

/// Correlation per step of each process of 1/f noise.
fn processes(length: f64) -> Vec<f64> {
    let times = std::iter::successors(Some(1.0), |time| Some(time * RATIO));
    let times = times.take(MOST).take_while(|time| *time <= LONGEST * length);
    times.map(|time| (-1.0 / time).exp()).collect()
}

/// A filter of ones and values with `K` processes, whose variances are given for each of `L` shares.
#[derive(Clone, Copy)]
struct Filter<const K: usize, const L: usize> {
    decay: [f64; K],
    variance: [[f64; L]; K],
    white: [f64; L],
    /// Covariance and values of the prediction.
    covariance: [[[f64; L]; K]; K],
    one: [[f64; L]; K],
    value: [[f64; L]; K],
    sums: Sums<L>,
    /// Product of the variances of which no logarithm has been taken.
    product: [f64; L],
}

#[inline(always)]
fn sum<const K: usize, const L: usize>(of: &[[f64; L]; K]) -> [f64; L] {
    let mut sums = [0.0; L];
    for lanes in of {
        for l in 0..L {
            sums[l] += lanes[l];
        }
    }
    sums
}

impl<const K: usize, const L: usize> Filter<K, L> {
    /// Missing processes have no variance.
    fn new(noise: &Noise<L>) -> Self {
        let decay: [f64; K] = std::array::from_fn(|k| noise.decay.get(k).copied().unwrap_or(0.0));
        let of_each = |share: f64| share / noise.decay.len() as f64;
        let variance = decay.map(|d| noise.shares.map(|s| if d > 0.0 { of_each(s) } else { 0.0 }));
        let mut covariance = [[[0.0; L]; K]; K];
        (0..K).for_each(|i| covariance[i][i] = variance[i]);
        let (zero, none) = ([0.0; L], [[0.0; L]; K]);
        Self {
            decay,
            variance,
            white: sum(&variance).map(|v| 1.0 - v),
            covariance,
            one: none,
            value: none,
            sums: Sums { log: zero, ones: zero, cross: zero, squares: zero },
            product: [1.0; L],
        }
    }

    /// Takes a value in, and predicts for the next one, `gap` steps later.
    #[inline(always)]
    fn step(&mut self, y: f64, gap: usize) {
        let mut f = self.decay;
        if gap != 1 {
            f = f.map(|d| d.powi(i32::try_from(gap).unwrap_or(i32::MAX)));
        }
        // sums over columns, which are in successive lanes
        let mut row = [[0.0; L]; K];
        for of in &self.covariance {
            for j in 0..K {
                for l in 0..L {
                    row[j][l] += of[j][l];
                }
            }
        }
        let (mut s, ones, values) = (sum(&row), sum(&self.one), sum(&self.value));
        let (mut inverse, mut e_one, mut e_value) = ([0.0; L], [0.0; L], [0.0; L]);
        for l in 0..L {
            s[l] += self.white[l];
            inverse[l] = 1.0 / s[l];
            e_one[l] = 1.0 - ones[l];
            e_value[l] = y - values[l];
            self.product[l] *= s[l];
            self.sums.ones[l] += e_one[l] * e_one[l] * inverse[l];
            self.sums.cross[l] += e_one[l] * e_value[l] * inverse[l];
            self.sums.squares[l] += e_value[l] * e_value[l] * inverse[l];
        }
        for i in 0..K {
            let mut g = [0.0; L];
            for l in 0..L {
                g[l] = row[i][l] * inverse[l];
                self.one[i][l] = f[i] * (self.one[i][l] + g[l] * e_one[l]);
                self.value[i][l] = f[i] * (self.value[i][l] + g[l] * e_value[l]);
            }
            for j in 0..K {
                for l in 0..L {
                    let before = self.covariance[i][j][l];
                    self.covariance[i][j][l] = f[i] * f[j] * (before - g[l] * row[j][l]);
                }
            }
            for l in 0..L {
                self.covariance[i][i][l] += self.variance[i][l] * (1.0 - f[i] * f[i]);
            }
        }
    }

    #[inline(always)]
    fn take_logarithms(&mut self) {
        for l in 0..L {
            self.sums.log[l] += ln(self.product[l]);
        }
        self.product = [1.0; L];
    }
}

/// Filters values with several filters.
struct Run<'a, const K: usize, const L: usize, const P: usize> {
    values: &'a Values<'a>,
    filters: [Filter<K, L>; P],
}

impl<const K: usize, const L: usize, const P: usize> WithSimd for Run<'_, K, L, P> {
    type Output = [Sums<L>; P];

    /// Vectorised by the compiler, with the registers of this processor.
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> [Sums<L>; P] {
        let Values { values, origin, .. } = self.values;
        for (t, &(place, y)) in values.iter().enumerate() {
            let gap = values.get(t + 1).map_or(1, |next| next.0 - place);
            for filter in &mut self.filters {
                filter.step(y - origin, gap);
                if (t + 1) % AT_ONCE == 0 {
                    filter.take_logarithms();
                }
            }
        }
        for filter in &mut self.filters {
            filter.take_logarithms();
        }
        self.filters.map(|filter| filter.sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;

    /// Expected values from an independent computation with NumPy and complete covariance matrices.
    #[test]
    fn gaps_and_shares_are_those_of_whole_matrices() {
        let y = [1.2, 0.9, 1.1, 0.4, 0.3, 0.6, 0.2, -0.1, 0.3, 0.5];
        let place = [0, 1, 2, 4, 5, 6, 9, 10, 11, 12];
        let found = SlowNoise::flicker(&place.into_iter().zip(y).collect::<Vec<_>>()).unwrap();
        assert_within(1e-9, found.gain, 2.281_116_506_361_179);
        assert_within(1e-9, found.inflation, 4.162_451_700_422_766);
        assert_within(1e-9, found.correlation, 0.587_116_162_207_727);
    }

    #[test]
    fn times_and_shares_are_those_of_whole_matrices() {
        let y = [1.2, 0.9, 1.1, 0.4, 0.3, 0.6, 0.2, -0.1, 0.3, 0.5];
        let place = [0, 1, 2, 4, 5, 6, 9, 10, 11, 12];
        let values = place.into_iter().zip(y).collect::<Vec<_>>();
        let found = SlowNoise::gauss_markov(&values).unwrap();
        assert_within(1e-9, found.gain, 1.955_236_028_763_822);
        assert_within(1e-9, found.inflation, 5.113_394_630_517_646);
        assert_within(1e-9, found.correlation, 0.536_627_874_557_930);
    }

    #[test]
    fn equal_values_tell_nothing() {
        assert!(SlowNoise::possible(&[(0, 1.0), (1, 1.0), (2, 1.0)]).is_empty());
        assert!(SlowNoise::possible(&[(0, 1.0), (1, 2.0)]).is_empty());
    }
}

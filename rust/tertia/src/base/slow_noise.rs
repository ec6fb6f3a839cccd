//! The mean of values with slow noise in addition to white noise.
//!
//! 1/f noise is represented as a sum of AR(1) processes of equal variance. Their time constants are a
//! geometric series from one step to several lengths of the record (van der Ziel 1950), so a Kalman
//! filter yields the likelihood. A Gauss-Markov process is one such AR(1) process, of unknown time constant.

use crate::base::interrupt::poll;

/// Prior probabilities of 1/f noise and of a Gauss-Markov process beside white noise.
const FLICKER: f64 = 0.1;
const GAUSS_MARKOV: f64 = 0.2;
/// Assumed shares of the 1/f noise, and of a Gauss-Markov process, in the variance.
const FLICKER_SHARES: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
const MARKOV_SHARES: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
/// Ratio of successive time constants of 1/f noise, and of the longest one to the length of the record.
const RATIO: f64 = 4.0;
const LONGEST: f64 = 4.0;
/// Largest number of processes, with time constants of up to 4^15 steps; and a number that suffices for
/// short records.
const MOST: usize = 16;
const FEW: usize = 8;
/// Shortest time constant of a Gauss-Markov process, ratio of successive ones, and ratio of the longest one to
/// the length of the record: with a shorter one, a finder that drifts would not be recognised.
const SHORTEST: f64 = 2.0;
const MARKOV_RATIO: f64 = 2.0;
const MARKOV_LONGEST: f64 = 4.0;

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

/// Sums of a filter: Σ ln S, and the squares and products of the innovations of ones and of values,
/// divided by S.
#[derive(Clone, Copy, Default)]
struct Sums {
    log: f64,
    ones: f64,
    cross: f64,
    squares: f64,
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

    /// Returns the effect of `K` processes of these correlations per step and equal variances, whose share
    /// in the variance is given; those of correlation zero do not count.
    fn effect<const K: usize>(&self, decay: [f64; K], share: f64) -> SlowNoise {
        poll();
        let count = decay.iter().filter(|d| **d > 0.0).count() as f64;
        let variance = decay.map(|d| if d > 0.0 { share / count } else { 0.0 });
        let Sums { log, ones, cross, squares } =
            filter(self.values, self.origin, &decay, &variance);
        let rss = (squares - cross * cross / ones).max(f64::MIN_POSITIVE);
        SlowNoise {
            gain: evidence(self.values.len() as f64, log, ones, rss) - self.white,
            inflation: rss / ones / self.variance,
            correlation: share * decay.iter().sum::<f64>() / count,
        }
    }
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
        let (decay, count) = processes(values.length());
        let found = FLICKER_SHARES.map(|share| match count <= FEW {
            true => values.effect::<FEW>(std::array::from_fn(|k| decay[k]), share),
            false => values.effect::<MOST>(decay, share),
        });
        Some(Self::mean(&found))
    }

    /// Computes the same for a Gauss-Markov process, over its shares and time constants. O(N log N).
    fn gauss_markov(values: &[(usize, f64)]) -> Option<Self> {
        let values = Values::new(values)?;
        let (longest, mut time, mut found) =
            (MARKOV_LONGEST * values.length(), SHORTEST, Vec::new());
        while time <= longest {
            let decay = [(-1.0 / time).exp()];
            found.extend(MARKOV_SHARES.map(|share| values.effect(decay, share)));
            time *= MARKOV_RATIO;
        }
        Some(Self::mean(&found))
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

/// Correlation per step of each process of 1/f noise, and their number.
fn processes(length: f64) -> ([f64; MOST], usize) {
    let (mut decay, mut count, mut time) = ([0.0; MOST], 0, 1.0);
    while count < MOST && time <= LONGEST * length {
        decay[count] = (-1.0 / time).exp();
        (count, time) = (count + 1, time * RATIO);
    }
    (decay, count)
}

/// Filters ones and values at once, with room for `K` processes.
fn filter<const K: usize>(
    values: &[(usize, f64)],
    origin: f64,
    decay: &[f64; K],
    variance: &[f64; K],
) -> Sums {
    let noise = 1.0 - variance.iter().sum::<f64>();
    // covariance of the prediction, and its row sums
    let mut covariance: [[f64; K]; K] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { variance[i] } else { 0.0 }));
    let (mut one, mut value) = ([0.0; K], [0.0; K]);
    let mut sums = Sums::default();
    for (t, &(place, y)) in values.iter().enumerate() {
        let gap = values.get(t + 1).map_or(1, |next| next.0 - place);
        let f = if gap == 1 {
            *decay
        } else {
            decay.map(|d| d.powi(i32::try_from(gap).unwrap_or(i32::MAX)))
        };
        let row: [f64; K] = std::array::from_fn(|j| (0..K).map(|i| covariance[i][j]).sum());
        let s = noise + row.iter().sum::<f64>();
        let (e_one, e_value) =
            (1.0 - one.iter().sum::<f64>(), y - origin - value.iter().sum::<f64>());
        sums.log += s.ln();
        sums.ones += e_one * e_one / s;
        sums.cross += e_one * e_value / s;
        sums.squares += e_value * e_value / s;
        for i in 0..K {
            let g = row[i] / s;
            one[i] = f[i] * (one[i] + g * e_one);
            value[i] = f[i] * (value[i] + g * e_value);
            for j in 0..K {
                covariance[i][j] = f[i] * f[j] * (covariance[i][j] - g * row[j]);
            }
            covariance[i][i] += variance[i] * (1.0 - f[i] * f[i]);
        }
    }
    sums
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

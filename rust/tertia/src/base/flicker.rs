//! The mean of values with 1/f noise in addition to white noise.
//!
//! 1/f noise is represented as a sum of AR(1) processes of equal variance. Their time constants are a
//! geometric series from one step to several lengths of the record (van der Ziel 1950), so a Kalman
//! filter yields the likelihood.

use crate::base::interrupt::poll;

/// Assumed shares of the 1/f noise in the variance.
const SHARES: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
/// Ratio of successive time constants, and ratio of the longest one to the length of the record.
const RATIO: f64 = 4.0;
const LONGEST: f64 = 4.0;
/// Largest number of processes, with time constants of up to 4^15 steps; and a number that suffices for
/// short records.
const MOST: usize = 16;
const FEW: usize = 8;

/// Effect of 1/f noise on the mean of a record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flicker {
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

impl Flicker {
    /// Computes the posterior over the shares, whose priors are equal. `values` are given with their
    /// indices in the record. Returns `None` for fewer than three values, and if all are equal. O(N log²
    /// N).
    pub fn of(values: &[(usize, f64)]) -> Option<Self> {
        let n = values.len() as f64;
        let origin = values.first()?.1;
        let mean = values.iter().map(|v| v.1 - origin).sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v.1 - origin - mean).powi(2)).sum();
        if n < 3.0 || squares <= 0.0 {
            return None;
        }
        let evidence = |log: f64, a: f64, rss: f64| -0.5 * (log + a.ln() + (n - 1.0) * rss.ln());
        let white = (evidence(0.0, n, squares), squares / n);
        let found = SHARES.map(|share| {
            poll();
            let Sums { log, ones, cross, squares } = if processes(values).1 <= FEW {
                filter::<FEW>(values, origin, share)
            } else {
                filter::<MOST>(values, origin, share)
            };
            let rss = (squares - cross * cross / ones).max(f64::MIN_POSITIVE);
            (evidence(log, ones, rss) - white.0, rss / ones / white.1)
        });
        let highest = found.iter().fold(f64::NEG_INFINITY, |h: f64, f| h.max(f.0));
        let weight = found.map(|f| (f.0 - highest).exp());
        let total: f64 = weight.iter().sum();
        let over = |f: &dyn Fn(usize) -> f64| {
            (0..SHARES.len()).map(|i| weight[i] * f(i)).sum::<f64>() / total
        };
        let (decay, count) = processes(values);
        let successive = decay[..count].iter().sum::<f64>() / count as f64;
        Some(Self {
            gain: highest + (total / SHARES.len() as f64).ln(),
            inflation: over(&|i| found[i].1),
            correlation: over(&|i| SHARES[i]) * successive,
        })
    }
}

/// Correlation per step of each process.
fn processes(values: &[(usize, f64)]) -> ([f64; MOST], usize) {
    let length = LONGEST * (values[values.len() - 1].0 - values[0].0 + 1) as f64;
    let (mut decay, mut count, mut time) = ([0.0; MOST], 0, 1.0);
    while count < MOST && time <= length {
        decay[count] = (-1.0 / time).exp();
        (count, time) = (count + 1, time * RATIO);
    }
    (decay, count)
}

/// Filters ones and values at once, with room for `K` processes.
fn filter<const K: usize>(values: &[(usize, f64)], origin: f64, share: f64) -> Sums {
    let (decay, count) = processes(values);
    let decay: [f64; K] = std::array::from_fn(|k| if k < count { decay[k] } else { 0.0 });
    let variance: [f64; K] =
        std::array::from_fn(|k| if k < count { share / count as f64 } else { 0.0 });
    // covariance of the prediction, and its row sums
    let mut covariance: [[f64; K]; K] =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { variance[i] } else { 0.0 }));
    let (mut one, mut value) = ([0.0; K], [0.0; K]);
    let mut sums = Sums::default();
    for (t, &(place, y)) in values.iter().enumerate() {
        let gap = values.get(t + 1).map_or(1, |next| next.0 - place);
        let f = if gap == 1 {
            decay
        } else {
            decay.map(|d| d.powi(i32::try_from(gap).unwrap_or(i32::MAX)))
        };
        let row: [f64; K] = std::array::from_fn(|j| (0..K).map(|i| covariance[i][j]).sum());
        let s = 1.0 - share + row.iter().sum::<f64>();
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
        let found = Flicker::of(&place.into_iter().zip(y).collect::<Vec<_>>()).unwrap();
        assert_within(1e-9, found.gain, 2.281_116_506_361_179);
        assert_within(1e-9, found.inflation, 4.162_451_700_422_766);
        assert_within(1e-9, found.correlation, 0.587_116_162_207_727);
    }

    #[test]
    fn equal_values_tell_nothing() {
        assert!(Flicker::of(&[(0, 1.0), (1, 1.0), (2, 1.0)]).is_none());
        assert!(Flicker::of(&[(0, 1.0), (1, 2.0)]).is_none());
    }
}

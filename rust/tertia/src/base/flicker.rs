//! The mean of values whose noise is 1/f noise beside white noise.
//!
//! 1/f noise is the sum of AR(1) processes of equal variance, whose times are a geometric series from one
//! step to several records (van der Ziel 1950), so that a Kalman filter has its likelihood.

/// Share of the 1/f noise in the variance.
const SHARES: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
/// Ratio of successive times, and the longest over the length of the record.
const RATIO: f64 = 4.0;
const LONGEST: f64 = 4.0;
/// Most processes: times up to 4^15 steps.
const MOST: usize = 16;
const FEW: usize = 8;

/// What is found of the mean of a record with 1/f noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flicker {
    /// Logarithm of the evidence over that of white noise.
    pub gain: f64,
    /// Variance of the mean over what it would be with white noise.
    pub inflation: f64,
    /// Correlation of successive values.
    pub correlation: f64,
}

/// Sums of a filter: Σ ln S, and of squares and products of the innovations of ones and values over S.
#[derive(Clone, Copy, Default)]
struct Sums {
    log: f64,
    ones: f64,
    cross: f64,
    squares: f64,
}

impl Flicker {
    /// Finds the posterior over the shares, equally probable before. `values` have their places in the
    /// record. None for fewer than three values, and for equal ones. O(N log² N).
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

/// Filter of zeros, ones and values at once, with room for `MOST` processes.
fn filter<const K: usize>(values: &[(usize, f64)], origin: f64, share: f64) -> Sums {
    let (decay, count) = processes(values);
    let decay: [f64; K] = std::array::from_fn(|k| if k < count { decay[k] } else { 0.0 });
    let variance: [f64; K] =
        std::array::from_fn(|k| if k < count { share / count as f64 } else { 0.0 });
    // covariance of the prediction, and its sums over rows
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

    /// An independent computation with NumPy, with whole covariance matrices.
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

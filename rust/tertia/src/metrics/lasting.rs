//! Estimation of how long errors last.

use crate::base::error::{Result, require};
use crate::base::exponential::exponentials;

/// Assumed shares of the variance that are correlated; the rest is new in each row.
const SHARES: [f64; 8] = [0.05, 0.12, 0.22, 0.35, 0.5, 0.7, 0.9, 1.0];
/// Shortest correlation length, in steps, and the ratio of successive lengths.
const SHORTEST: f64 = 0.3;
const RATIO: f64 = 1.4;
/// Smooth errors are thinned until their correlation falls below this value. From row to row they hardly
/// change, which a Gauss–Markov process would explain by a long correlation.
const CORRELATED: f64 = 0.6;
/// Smallest number of rows of a series after thinning.
const LEAST: usize = 10;
/// Products are converted to logarithms when they fall below this.
const SMALL: f64 = 1e-200;
/// Prior probability that all errors are independent.
const INDEPENDENT: f64 = 0.5;

/// Powers of the correlation whose sums are returned.
pub const POWERS: [i32; 8] = [1, 2, 3, 4, 6, 8, 12, 16];

/// Models of the duration of errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Lasting {
    /// Posterior probability of each model.
    pub probability: Vec<f64>,
    /// `1 + 2/N Σ_{i<j} ρ_ij^k` for the powers k of [`POWERS`]: the number of rows that are worth one
    /// independent value of a function whose correlation is `ρ^k`.
    pub rows_per_value: Vec<[f64; POWERS.len()]>,
}

/// Computes the posterior of models in which a share s of the variance is a Gauss–Markov process of
/// correlation length l and the rest is white: `ρ_j = s exp(−j/l)`, j > 0.
///
/// `errors` has `axes` numbers per row, with mean 0 and any scale; the axes are independent and follow
/// the same model. `gaps` contains the steps since the previous row, which are not positive where a
/// series begins. The scale of each axis is integrated out (prior 1/σ). Half of the prior is on
/// independence; the rest is flat in exp(−1/l) and s.
///
/// The rows are thinned to every k-th until their correlation is moderate, so that smooth errors, which
/// are not a Gauss–Markov process, are assessed over steps in which they change. The likelihood is then the
/// geometric mean over the k phases; the prior is flat in exp(−k/l), with no share on independence.
///
/// Cost O(N axes) per model, 0.3 s in total for 10^5 rows of two axes; there are 8 models for each of the
/// lengths from 0.3 to 2 N by factors of 1.4.
///
/// # Errors
/// Numbers of rows that do not match, or no rows.
pub fn lasting(errors: &[f64], axes: usize, gaps: &[f64]) -> Result<Lasting> {
    let n = gaps.len();
    let fits = axes > 0 && n > 0 && errors.len() == n * axes;
    require("gaps", n as f64, fits, "as many as rows of errors, and at least one")?;
    let (step, order) = thinned(errors, axes, gaps);
    let thin: Vec<f64> =
        order.iter().flat_map(|row| &errors[row * axes..][..axes]).copied().collect();
    let thin_gaps = gaps_between(gaps, &order, step);
    // there are as many records as phases, but together they contain hardly more information than one
    let copies = step as f64;
    // errors that must be thinned are not independent
    let independent = if step > 1 { 0.0 } else { INDEPENDENT };
    let white = independent.ln() + marginal(&squares(errors, axes), n, 0.0);
    let (mut ln_weights, mut rows_per_value) = (vec![white], vec![[1.0; POWERS.len()]]);
    let mut run = Run { factor: vec![0.0; n], state: vec![NONE; axes], rss: vec![NONE; axes] };
    let mut length = SHORTEST * copies;
    let longest = 2.0 * n as f64;
    while length < longest {
        // prior mass between the midpoints to the neighbouring lengths
        let mass =
            (-copies / (length * RATIO.sqrt())).exp() - (-copies * RATIO.sqrt() / length).exp();
        run.decay(gaps, length);
        let pairs = pairs(&run.factor);
        run.decay(&thin_gaps, length);
        let marginals = run.marginals(&thin);
        for (k, share) in SHARES.into_iter().enumerate() {
            let below = if k == 0 { 0.0 } else { 0.5 * (SHARES[k - 1] + share) };
            let above = SHARES.get(k + 1).map_or(1.0, |next| 0.5 * (share + next));
            let prior = (1.0 - independent) * mass * (above - below);
            ln_weights.push(prior.ln() + marginals[k] / copies);
            let of = |k: usize| 1.0 + 2.0 * share.powi(POWERS[k]) * pairs[k] / n as f64;
            rows_per_value.push(std::array::from_fn(of));
        }
        length *= RATIO;
    }
    let total = exponentials(&mut ln_weights, |weight| weight);
    let probability = ln_weights.iter().map(|weight| weight / total).collect();
    Ok(Lasting { probability, rows_per_value })
}

/// Whether a series begins after this gap.
fn begins(gap: f64) -> bool {
    gap.is_nan() || gap <= 0.0
}

/// Returns the step to every how many rows the errors are thinned, so that their correlation is below
/// [`CORRELATED`], and the order of rows: for each series those of the first phase, then those of the
/// second, ...
fn thinned(errors: &[f64], axes: usize, gaps: &[f64]) -> (usize, Vec<usize>) {
    let mut starts: Vec<usize> = (0..gaps.len()).filter(|row| begins(gaps[*row])).collect();
    if starts.first() != Some(&0) {
        starts.insert(0, 0);
    }
    let ends = starts[1..].iter().copied().chain([gaps.len()]);
    let series: Vec<_> = starts.iter().zip(ends).map(|(start, end)| *start..end).collect();
    let longest = series.iter().map(|rows| rows.len()).max().unwrap_or(0);
    let mut step = 1;
    while step < longest / LEAST {
        let (mut product, mut square) = (0.0, 0.0);
        for rows in &series {
            let own = &errors[rows.start * axes..rows.end * axes];
            for (one, other) in own.iter().zip(own.iter().skip(step * axes)) {
                product += one * other;
                square += 0.5 * (one * one + other * other);
            }
        }
        if product < CORRELATED * square {
            break;
        }
        step += 1 + step / 4;
    }
    let order = series.into_iter().flat_map(|rows| {
        (0..step).flat_map(move |phase| (rows.start + phase..rows.end).step_by(step))
    });
    (step, order.collect())
}

/// Steps from each row to the row `step` before it in the series; 0 if there is none. O(N) for any `step`.
fn gaps_between(gaps: &[f64], order: &[usize], step: usize) -> Vec<f64> {
    // steps since the beginning of the series
    let (mut begin, mut total, mut totals) = (0, 0.0, Vec::with_capacity(gaps.len()));
    let mut sums = Vec::with_capacity(gaps.len());
    for (row, gap) in gaps.iter().enumerate() {
        if begins(*gap) {
            (begin, total) = (row, 0.0);
        } else {
            total += gap;
        }
        totals.push(total);
        sums.push(if row < begin + step { 0.0 } else { total - totals[row - step] });
    }
    order.iter().map(|row| sums[*row]).collect()
}

/// Sum of squares of each axis.
fn squares(errors: &[f64], axes: usize) -> Vec<f64> {
    let mut sums = vec![0.0; axes];
    for row in errors.chunks_exact(axes) {
        for (sum, error) in sums.iter_mut().zip(row) {
            *sum += error * error;
        }
    }
    sums
}

/// Log likelihood with the scales integrated out: `−m/2 Σ ln S − N/2 Σ ln rss` for m axes.
fn marginal(rss: &[f64], n: usize, ln_variances: f64) -> f64 {
    let of = |rss: &f64| ln_variances + n as f64 * rss.max(f64::MIN_POSITIVE).ln();
    -0.5 * rss.iter().map(of).sum::<f64>()
}

/// `Σ_{i<j} exp(−k (t_j − t_i)/l)` within series for all powers k, by `a_j = f_j^k (1 + a_{j−1})`.
fn pairs(factor: &[f64]) -> [f64; POWERS.len()] {
    let (mut last, mut sums) = ([0.0; POWERS.len()], [0.0; POWERS.len()]);
    for f in factor {
        let (square, cube) = (f * f, f * f * f);
        let (fourth, sixth) = (square * square, cube * cube);
        let eighth = fourth * fourth;
        let powers = [*f, square, cube, fourth, sixth, eighth, sixth * sixth, eighth * eighth];
        for k in 0..POWERS.len() {
            last[k] = powers[k] * (1.0 + last[k]);
            sums[k] += last[k];
        }
    }
    sums
}

/// One number for each of the [`SHARES`], which are processed in parallel.
type Lanes = [f64; SHARES.len()];

const NONE: Lanes = [0.0; SHARES.len()];

struct Run {
    factor: Vec<f64>,
    state: Vec<Lanes>,
    rss: Vec<Lanes>,
}

impl Run {
    /// Computes the factors `exp(−gap/l)`; 0 where a series begins.
    fn decay(&mut self, gaps: &[f64], length: f64) {
        for (factor, gap) in self.factor.iter_mut().zip(gaps) {
            *factor = if begins(*gap) { 0.0 } else { (-gap / length).exp() };
        }
    }

    /// Kalman filter of the process in white noise, in units of the total variance.
    fn marginals(&mut self, errors: &[f64]) -> Lanes {
        let Self { factor, state, rss } = self;
        rss.fill(NONE);
        state.fill(NONE);
        let (mut variance, mut product, mut ln_variances) = (SHARES, [1.0; SHARES.len()], NONE);
        let (mut weight, mut gain) = (NONE, NONE);
        for (row, f) in errors.chunks_exact(state.len()).zip(&*factor) {
            for k in 0..SHARES.len() {
                variance[k] = SHARES[k] + f * f * (variance[k] - SHARES[k]);
                let total = variance[k] + 1.0 - SHARES[k];
                weight[k] = 1.0 / total;
                gain[k] = variance[k] * weight[k];
                variance[k] *= 1.0 - gain[k];
                // the logarithm of a product is cheaper than the sum of logarithms
                product[k] *= total;
            }
            for ((error, state), rss) in row.iter().zip(&mut *state).zip(&mut *rss) {
                for k in 0..SHARES.len() {
                    let predicted = f * state[k];
                    let innovation = error - predicted;
                    rss[k] += innovation * innovation * weight[k];
                    state[k] = predicted + gain[k] * innovation;
                }
            }
            if product.iter().any(|product| *product < SMALL) {
                for (ln_variance, product) in ln_variances.iter_mut().zip(&mut product) {
                    *ln_variance += product.ln();
                    *product = 1.0;
                }
            }
        }
        std::array::from_fn(|k| {
            let own: Vec<f64> = rss.iter().map(|lanes| lanes[k]).collect();
            marginal(&own, factor.len(), ln_variances[k] + product[k].ln())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An alternating series counts as independent, because only positive correlations are modelled.
    #[test]
    fn a_series_that_alternates_is_not_taken_to_last() {
        let errors: Vec<f64> = (0..60).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let found = lasting(&errors, 1, &[1.0; 60]).unwrap();
        assert!(found.probability[0] > 0.9);
    }

    #[test]
    fn a_constant_is_worth_one_value() {
        let found = lasting(&[2.0; 80], 2, &[1.0; 40]).unwrap();
        let models = found.probability.iter().zip(&found.rows_per_value);
        let rows: f64 = models.map(|(p, rows)| p * rows[0]).sum();
        assert!(rows > 20.0, "{rows}");
    }

    #[test]
    fn probabilities_sum_to_one_and_do_not_depend_on_the_unit() {
        let errors: Vec<f64> = (0..50).map(|k| f64::from(k * k % 17) - 8.0).collect();
        let small: Vec<f64> = errors.iter().map(|error| error * 1e-6).collect();
        let [one, other] = [&errors, &small].map(|x| lasting(x, 1, &[1.0; 50]).unwrap());
        assert!((one.probability.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for (p, q) in one.probability.iter().zip(&other.probability) {
            assert!((p - q).abs() < 1e-9);
        }
    }

    /// A sum over all rows between for each row would take minutes.
    #[test]
    fn gaps_over_many_rows() {
        let n = 1_000_000;
        let mut gaps = vec![2.0; n];
        (gaps[0], gaps[n / 2]) = (0.0, f64::NAN);
        let step = n / 10;
        let found = gaps_between(&gaps, &(0..n).collect::<Vec<_>>(), step);
        let is_early = |row: usize| row % (n / 2) < step;
        let expected = |row: usize| if is_early(row) { 0.0 } else { 2.0 * step as f64 };
        assert!((0..n).all(|row| found[row] == expected(row)));
    }

    #[test]
    fn numbers_that_do_not_fit_are_refused() {
        assert!(lasting(&[1.0; 3], 2, &[1.0; 2]).is_err());
        assert!(lasting(&[], 1, &[]).is_err());
    }
}

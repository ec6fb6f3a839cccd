//! Blocks of consecutive measurements.

use crate::base::distribution::student_two_sided_quantile;
use crate::base::error::Result;
use crate::base::moments::Moments;
use crate::screening::extreme_variance_pvalue;
use std::ops::Range;

/// Output columns for the blocks of a sample, of the length that [`super::Estimator::blocks`] returns.
#[derive(Debug)]
pub struct BlockOutput<'a> {
    /// Mean of each block as used; nan if the block is empty.
    pub mean: &'a mut [f64],
    /// Variance of each block as used; nan if the block has fewer than two measurements.
    pub variance: &'a mut [f64],
    /// Weight of each block; the weights sum to one.
    pub weight: &'a mut [f64],
}

/// Mean, variance, size and weight of each block.
#[derive(Clone, Debug, Default)]
pub(super) struct BlockTable {
    pub mean: Vec<f64>,
    /// nan for blocks with fewer than two measurements.
    pub variance: Vec<f64>,
    /// Number of measurements that are not excluded.
    pub count: Vec<f64>,
    pub weight: Vec<f64>,
}

impl BlockTable {
    /// Fills the table with blocks of `block_size`; the last one includes the remainder. nan values are
    /// left out.
    pub fn fill(
        &mut self,
        cleaned: &[f64],
        block_size: usize,
        scratch: &mut Vec<f64>,
    ) -> Result<()> {
        for members in self.begin(cleaned.len(), block_size) {
            scratch.clear();
            scratch.extend(cleaned[members].iter().filter(|v| !v.is_nan()));
            let moments = Moments::of("theta", scratch)?;
            let count = moments.count();
            self.mean.push(if count > 0.0 { moments.mean() } else { f64::NAN });
            self.variance.push(if count > 1.0 { moments.variance() } else { f64::NAN });
            self.count.push(count);
        }
        self.weight.resize(self.len(), 0.0);
        Ok(())
    }

    /// Empties the table, and returns the ranges of the blocks of `n` measurements.
    pub fn begin(
        &mut self,
        n: usize,
        block_size: usize,
    ) -> impl Iterator<Item = Range<usize>> + use<> {
        for column in [&mut self.mean, &mut self.variance, &mut self.count, &mut self.weight] {
            column.clear();
        }
        let blocks = (n / block_size).max(1);
        (0..blocks).map(move |j| block_range(j, blocks, block_size, n))
    }

    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// Returns the degrees of freedom of the variance of a block.
    pub fn degrees(&self, j: usize) -> f64 {
        (self.count[j] - 1.0).max(0.0)
    }

    /// Returns `Σ ν_j d_j / Σ ν_j` over the blocks for which `used` is true.
    pub fn pooled_variance(&self, used: impl Fn(usize) -> bool) -> f64 {
        let (mut squares, mut degrees) = (0.0, 0.0);
        for j in (0..self.len()).filter(|&j| used(j) && self.degrees(j) > 0.0) {
            squares += self.degrees(j) * self.variance[j];
            degrees += self.degrees(j);
        }
        squares / degrees
    }

    /// Returns which of the `used` blocks have too large a variance compared with the others of them, by
    /// the exact F test with Bonferroni's correction (for equal sizes: Cochran's test). O(blocks).
    pub fn extreme_variances(&self, used: &[bool], significance: f64) -> Vec<bool> {
        let count = used.iter().filter(|used| **used).count() as f64;
        let plus = |[degrees, squares]: [f64; 2], j: usize| match self.degrees(j) {
            nu if used[j] && nu > 0.0 => [degrees + nu, squares + nu * self.variance[j]],
            _ => [degrees, squares],
        };
        // sums over the blocks before and after each one: differences from the sum of all would cancel
        let mut after = vec![[0.0; 2]; self.len() + 1];
        for j in (0..self.len()).rev() {
            after[j] = plus(after[j + 1], j);
        }
        let mut before = [0.0; 2];
        let is_extreme = |j: usize| {
            let [degrees, squares] = [0, 1].map(|i| before[i] + after[j + 1][i]);
            before = plus(before, j);
            let nu = self.degrees(j);
            let pvalue =
                || extreme_variance_pvalue(self.variance[j], nu, squares / nu, degrees, count);
            used[j] && nu > 0.0 && degrees > 0.0 && pvalue() < significance
        };
        (0..self.len()).map(is_extreme).collect()
    }

    /// Sets weights proportional to `information` that sum to one; if there are infinite ones, these
    /// share the weight equally.
    pub fn set_weights(&mut self, information: impl Fn(usize) -> f64) {
        let raw: Vec<f64> = (0..self.len()).map(information).collect();
        let largest = raw.iter().copied().fold(0.0, f64::max);
        let scaled = |v: f64| match (largest.is_infinite(), v.is_infinite()) {
            (true, infinite) => f64::from(u8::from(infinite)),
            (false, _) => v / largest,
        };
        let total: f64 = raw.iter().map(|&v| scaled(v)).sum();
        for (weight, &v) in self.weight.iter_mut().zip(&raw) {
            *weight = scaled(v) / total;
        }
    }

    /// Returns `Σ p_j m_j`, computed relative to the mean with the largest weight, so that neither a
    /// common offset nor a distant mean of small weight costs digits.
    pub fn weighted_mean(&self) -> f64 {
        let pairs = || self.weight.iter().zip(&self.mean).filter(|(w, _)| **w > 0.0);
        let heaviest = pairs().max_by(|a, b| a.0.total_cmp(b.0));
        let origin = heaviest.map_or(0.0, |(_, m)| *m);
        origin + pairs().map(|(w, m)| w * (m - origin)).sum::<f64>()
    }

    pub fn write(&self, output: &mut BlockOutput<'_>) {
        for (column, out, missing) in [
            (&self.mean, &mut *output.mean, f64::NAN),
            (&self.variance, &mut *output.variance, f64::NAN),
            (&self.weight, &mut *output.weight, 0.0),
        ] {
            out.fill(missing);
            out[..column.len()].copy_from_slice(column);
        }
    }
}

/// Returns the members of block j of `blocks`; the last block includes the remainder.
pub(super) fn block_range(j: usize, blocks: usize, size: usize, n: usize) -> Range<usize> {
    let end = if j + 1 == blocks { n } else { (j + 1) * size };
    j * size..end
}

/// Returns the k2 that the paper takes 'from Student's distribution'.
pub(super) fn student_factor(significance: f64, block_size: usize) -> f64 {
    student_two_sided_quantile(significance, block_size as f64 - 1.0)
}

//! Symmetric positive definite matrices in which each row begins at its own first column.
//!
//! Jennings, Computer Journal 9 (1966); elements of the inverse by Takahashi, Fagan and Chen, PICA
//! (1973). The factor and the required part of the inverse have the same envelope as the matrix. The cost
//! is the sum of the squares of the column heights.

use super::scratch::refill;
use pulp::{Arch, Simd, WithSimd};

/// The lower triangle, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Skyline {
    /// First column of each row.
    first: Vec<usize>,
    /// Start of each row in `values`.
    start: Vec<usize>,
    values: Vec<f64>,
}

// structs instead of closures, because closures would be compiled as functions of their own without the
// vectors of `simd`

/// Runs [`Skyline::factorise`] with the widest vectors of the processor.
struct Factorise<'a>(&'a mut Skyline);

impl WithSimd for Factorise<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        self.0.factorise_here()
    }
}

/// Runs [`Skyline::inverse`] with the widest vectors of the processor.
struct Inverse<'a>(&'a Skyline);

impl WithSimd for Inverse<'_> {
    type Output = Skyline;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Skyline {
        self.0.inverse_here()
    }
}

impl Skyline {
    /// Creates a matrix of zeros; `first[i]` is at most i.
    pub fn zeros(first: Vec<usize>) -> Self {
        let mut start = Vec::with_capacity(first.len() + 1);
        let mut end = 0;
        start.push(0);
        for (row, first) in first.iter().enumerate() {
            end += row + 1 - first;
            start.push(end);
        }
        Self { first, start, values: vec![0.0; end] }
    }

    /// Sets all elements to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Number of rows.
    pub fn order(&self) -> usize {
        self.first.len()
    }

    /// The stored part of a row, which ends with the diagonal.
    fn row(&self, i: usize) -> &[f64] {
        &self.values[self.start[i]..self.start[i + 1]]
    }

    /// Index in `values` of an element of the lower triangle, j <= i, inside the envelope.
    fn at(&self, i: usize, j: usize) -> usize {
        self.start[i] + j - self.first[i]
    }

    /// Element of the symmetric matrix; 0 outside the envelope.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let (i, j) = if i < j { (j, i) } else { (i, j) };
        if j < self.first[i] { 0.0 } else { self.values[self.at(i, j)] }
    }

    /// Adds a value to element (i, j) and its mirror image.
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        let (i, j) = if i < j { (j, i) } else { (i, j) };
        let at = self.at(i, j);
        self.values[at] += value;
    }

    /// `x' A x` for a sparse vector x of indices and values.
    pub fn quadratic(&self, x: &[(usize, f64)]) -> f64 {
        let row = |i: usize, v: f64| v * x.iter().map(|&(j, w)| w * self.get(i, j)).sum::<f64>();
        x.iter().map(|&(i, v)| row(i, v)).sum()
    }

    /// Replaces A by the factor L of A = L L'. The error is the row at which A is not positive definite.
    pub fn factorise(&mut self) -> Result<(), usize> {
        Arch::new().dispatch(Factorise(self))
    }

    #[inline(always)]
    fn factorise_here(&mut self) -> Result<(), usize> {
        for i in 0..self.order() {
            let (before, rest) = self.values.split_at_mut(self.start[i]);
            let row = &mut rest[..i + 1 - self.first[i]];
            let diagonal = row[i - self.first[i]];
            for j in self.first[i]..i {
                let from = self.first[i].max(self.first[j]);
                let other = &before[self.start[j]..self.start[j + 1]];
                let (mine, theirs) =
                    (&row[from - self.first[i]..j - self.first[i]], &other[from - self.first[j]..]);
                let (theirs, pivot) = theirs.split_at(mine.len());
                row[j - self.first[i]] = (row[j - self.first[i]] - dot(mine, theirs)) / pivot[0];
            }
            let (left, last) = row.split_at_mut(i - self.first[i]);
            let pivot = last[0] - dot(left, left);
            if pivot.is_nan() || pivot <= diagonal * f64::EPSILON {
                return Err(i);
            }
            last[0] = pivot.sqrt();
        }
        Ok(())
    }

    /// Solves L L' x = b in place; this matrix is the factor L.
    pub fn solve(&self, b: &mut [f64]) {
        for i in 0..self.order() {
            let (left, pivot) = self.row(i).split_at(i - self.first[i]);
            b[i] = (b[i] - dot(left, &b[self.first[i]..i])) / pivot[0];
        }
        for i in (0..self.order()).rev() {
            let (left, pivot) = self.row(i).split_at(i - self.first[i]);
            b[i] /= pivot[0];
            let value = b[i];
            for (b, l) in b[self.first[i]..i].iter_mut().zip(left) {
                *b -= l * value;
            }
        }
    }

    /// Returns the elements of (L L')^-1 inside the envelope; this matrix is the factor L.
    pub fn inverse(&self) -> Self {
        Arch::new().dispatch(Inverse(self))
    }

    #[inline(always)]
    fn inverse_here(&self) -> Self {
        let n = self.order();
        let mut inverse = Self {
            first: self.first.clone(),
            start: self.start.clone(),
            values: vec![0.0; self.values.len()],
        };
        // rows below j that reach column j, as runs (first row, index in `column`), and the elements l_ij
        let mut runs: Vec<(usize, usize)> = Vec::new();
        let mut column: Vec<f64> = Vec::new();
        let mut sum = Vec::new();
        // these rows, the last one first
        let mut below: Vec<usize> = Vec::new();
        for j in (0..n).rev() {
            runs.clear();
            column.clear();
            below.retain(|&i| self.first[i] <= j);
            for &i in below.iter().rev() {
                if runs.last().is_none_or(|(start, at)| start + column.len() - at != i) {
                    runs.push((i, column.len()));
                }
                column.push(self.values[self.at(i, j)]);
            }
            refill(&mut sum, column.len(), 0.0);
            // indices in `column` of a run, and its first row minus its first index
            let rows = |run: usize| {
                let end = runs.get(run + 1).map_or(column.len(), |next| next.1);
                (runs[run].1..end, runs[run].0 - runs[run].1)
            };
            // z_ij = -sum_k l_kj z_ik / l_jj
            for run in 0..runs.len() {
                let (places, offset) = rows(run);
                for a in places {
                    let i = a + offset;
                    let (row, l) = (inverse.row(i), column[a]);
                    let mut own = row[i - inverse.first[i]] * l;
                    for (other, &(start, at)) in runs[..=run].iter().enumerate() {
                        let end = if other == run { a } else { runs[other + 1].1 };
                        let z = &row[start - inverse.first[i]..][..end - at];
                        own += dot(&column[at..end], z);
                        for (sum, z) in sum[at..end].iter_mut().zip(z) {
                            *sum += l * z;
                        }
                    }
                    sum[a] += own;
                }
            }
            let pivot = self.values[self.at(j, j)];
            let mut diagonal = 1.0 / pivot;
            for run in 0..runs.len() {
                let (places, offset) = rows(run);
                for a in places {
                    let z = -sum[a] / pivot;
                    let at = inverse.at(a + offset, j);
                    inverse.values[at] = z;
                    diagonal -= column[a] * z;
                }
            }
            let at = inverse.at(j, j);
            inverse.values[at] = diagonal / pivot;
            below.push(j);
        }
        inverse
    }
}

/// Sum of products in eight parts, which the processor adds in parallel.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a8.iter().zip(b8) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use nalgebra::DMatrix;

    #[test]
    fn factor_solution_and_inverse_are_those_of_the_dense_matrix() {
        let first = vec![0, 0, 2, 1, 3, 4, 0];
        let n = first.len();
        let (mut a, mut dense) = (Skyline::zeros(first.clone()), DMatrix::zeros(n, n));
        for i in 0..n {
            for j in first[i]..=i {
                let value = if i == j { 9.0 } else { ((3 * i + 5 * j) % 7) as f64 - 3.0 };
                a.add(j, i, value);
                (dense[(i, j)], dense[(j, i)]) = (value, value);
            }
        }
        let b: Vec<f64> = (0..n).map(|i| i as f64 - 2.5).collect();
        let inverse = dense.clone().try_inverse().expect("regular");
        let expected = &inverse * nalgebra::DVector::from_vec(b.clone());
        let sum = a.quadratic(&[(1, 1.0), (3, -2.0)]);
        assert_within(1e-12, sum, dense[(1, 1)] + 4.0 * dense[(3, 3)] - 4.0 * dense[(1, 3)]);
        a.factorise().expect("definite");
        let mut x = b;
        a.solve(&mut x);
        let z = a.inverse();
        for i in 0..n {
            assert_within(1e-12, x[i], expected[i]);
            for j in first[i]..=i {
                assert_within(1e-12, z.get(j, i), inverse[(i, j)]);
            }
        }
    }

    /// A row that begins at the first column must not make each column look at all rows.
    #[test]
    fn many_low_rows_and_a_full_one() {
        let n = 400_000;
        let first = (0..n).map(|i: usize| if i == n - 1 { 0 } else { i.saturating_sub(1) });
        let mut a = Skyline::zeros(first.collect());
        for i in 0..n {
            a.add(i, i, 4.0);
        }
        a.add(n - 1, 0, 2.0);
        a.factorise().expect("definite");
        let z = a.inverse();
        assert_within(1e-12, z.get(0, 0), 1.0 / 3.0);
        assert_within(1e-12, z.get(n - 1, 0), -1.0 / 6.0);
        assert_within(1e-12, z.get(n / 2, n / 2), 0.25);
    }

    #[test]
    fn a_matrix_that_is_not_definite_names_the_row() {
        let mut a = Skyline::zeros(vec![0, 0, 1]);
        for i in 0..3 {
            a.add(i, i, 1.0);
        }
        a.add(2, 1, 1.0);
        assert_eq!(a.factorise(), Err(2));
    }
}

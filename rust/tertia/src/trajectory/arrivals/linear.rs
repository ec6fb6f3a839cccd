//! Sparse rows of a linear problem: measurements and priors.

use crate::base::skyline::Skyline;

/// Largest number of columns of a row: two positions, a clock at two nodes, the speed, a path.
const WIDEST: usize = 10;

/// `residual = measured - expected`, and the derivatives of `expected`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    columns: [(usize, f64); WIDEST],
    length: usize,
    pub residual: f64,
}

/// Group of a prior, whose variance scales the row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Group {
    /// Variance 1.
    Unit,
    Path,
    Drift,
    /// Motion of an identity: the weight of its white acceleration beside its white jerk.
    Motion(usize, f64),
}

impl Row {
    pub fn new(residual: f64) -> Self {
        Self { columns: [(0, 0.0); WIDEST], length: 0, residual }
    }

    /// Adds to the derivative with respect to an unknown; a known value has no column.
    pub fn push(&mut self, column: Option<usize>, value: f64) {
        if let Some(column) = column {
            self.columns[self.length] = (column, value);
            self.length += 1;
        }
    }

    pub fn columns(&self) -> &[(usize, f64)] {
        &self.columns[..self.length]
    }

    /// Adds `weight x x'` to the matrix.
    pub fn add_to(&self, matrix: &mut Skyline, weight: f64) {
        let columns = self.columns();
        for (a, &(i, v)) in columns.iter().enumerate() {
            matrix.add(i, i, weight * v * v);
            for &(j, w) in &columns[..a] {
                // a column may occur twice: then both symmetric terms fall on the diagonal
                matrix.add(i, j, if i == j { 2.0 } else { 1.0 } * weight * v * w);
            }
        }
    }

    /// Adds `weight x residual` to the right-hand side.
    pub fn add_pull(&self, pull: &mut [f64], weight: f64) {
        for &(column, value) in self.columns() {
            pull[column] += weight * value * self.residual;
        }
    }
}

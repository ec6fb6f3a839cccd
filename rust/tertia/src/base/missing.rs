//! Samples with missing (nan) measurements, which are removed before a kernel and restored after it.

use crate::base::error::Error;

/// The measurements that are not missing, and their indices.
#[derive(Clone, Debug, Default)]
pub struct Present {
    values: Vec<f64>,
    index: Vec<usize>,
}

impl Present {
    /// Collects the values that are not nan. O(N).
    pub fn collect(&mut self, y: &[f64]) {
        self.values.clear();
        self.index.clear();
        for (i, &v) in y.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            self.values.push(v);
            self.index.push(i);
        }
    }

    /// Returns the measurements that are not missing.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Writes one result for each present measurement to its index, and `missing` to the others.
    pub fn scatter<T: Copy>(&self, results: &[T], missing: T, out: &mut [T]) {
        out.fill(missing);
        for (&i, &result) in self.index.iter().zip(results) {
            out[i] = result;
        }
    }

    /// Converts the index in an error to that in the whole sample.
    pub fn locate(&self, error: Error) -> Error {
        match error {
            Error::InvalidMeasurement { argument, index, value, requirement } => {
                let index = self.index[index];
                Error::InvalidMeasurement { argument, index, value, requirement }
            }
            other => other,
        }
    }
}

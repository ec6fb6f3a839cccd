//! Plots with the inverses of the Cholesky factors of their covariances.

use crate::base::error::{Error, Result, require_elements};

/// Range of variances in which products of two standard deviations and of their reciprocals stay finite.
const VARIANCES: std::ops::RangeInclusive<f64> = 1e-140..=1e140;
/// Largest difference of two elements that should be equal, in standard deviations.
const ASYMMETRY: f64 = 1e-10;
/// Least share of a variance that the other components leave unexplained in a regular matrix.
const REGULAR: f64 = 1e-13;
/// Largest number; squares of larger ones overflow.
pub(super) const LARGEST: f64 = 1e140;

/// Covariances of the plots, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Noise<'a> {
    /// One matrix (D, D) for all instants.
    Same(&'a [f64]),
    /// A matrix for each instant, (N, D, D).
    Each(&'a [f64]),
}

/// Measurements at N instants, with the matrices that make their errors independent and of unit variance.
pub(super) struct Whitened {
    /// Values; nan where missing.
    pub y: Vec<f64>,
    /// For each instant, the inverse of the lower Cholesky factor of the covariance of the measured
    /// components.
    pub whitener: Vec<f64>,
    /// Sum of the logarithms of the determinants of the covariances.
    pub log_determinant: f64,
    /// Number of measured components.
    pub measured: usize,
}

impl Whitened {
    /// Whitens values (N, D) with these covariances; errors state the names of both. Another length panics.
    pub fn try_new(
        [name, covariance]: [&'static str; 2],
        d: usize,
        y: &[f64],
        noise: Noise<'_>,
        n: usize,
    ) -> Result<Self> {
        assert_eq!(y.len(), n * d);
        let requirement = "a plot must be a finite number, or nan for none";
        require_elements(name, y, d, |y| y.is_nan() || y.abs() <= LARGEST, requirement)?;
        let (mut whitener, mut log_determinant) = (vec![0.0; n * d * d], 0.0);
        let mut measured = 0;
        let mut last: Option<(Vec<bool>, f64)> = None;
        for k in 0..n {
            let there: Vec<bool> = y[k * d..][..d].iter().map(|y| !y.is_nan()).collect();
            measured += there.iter().filter(|&&there| there).count();
            let (before, rest) = whitener.split_at_mut(k * d * d);
            let own = &mut rest[..d * d];
            let log = match (noise, &last) {
                (Noise::Same(_), Some((same, log))) if *same == there => {
                    own.copy_from_slice(&before[(k - 1) * d * d..]);
                    *log
                }
                (Noise::Same(matrix), _) => whiten_as(covariance, &[], matrix, &there, own)?,
                (Noise::Each(matrices), _) => {
                    whiten_as(covariance, &[k], &matrices[k * d * d..][..d * d], &there, own)?
                }
            };
            log_determinant += log;
            last = Some((there, log));
        }
        Ok(Self { y: y.to_vec(), whitener, log_determinant, measured })
    }

    /// Joins parts (N, D) with independent errors side by side.
    pub fn together(mut parts: Vec<Self>, d: usize, n: usize) -> Self {
        if parts.len() == 1 {
            return parts.remove(0);
        }
        let m = parts.len() * d;
        let (mut y, mut whitener) = (Vec::with_capacity(n * m), vec![0.0; n * m * m]);
        for k in 0..n {
            for (at, part) in parts.iter().enumerate() {
                y.extend_from_slice(&part.y[k * d..][..d]);
                for (i, row) in part.whitener[k * d * d..][..d * d].chunks_exact(d).enumerate() {
                    let start = (k * m + at * d + i) * m + at * d;
                    whitener[start..][..d].copy_from_slice(row);
                }
            }
        }
        let log_determinant = parts.iter().map(|part| part.log_determinant).sum();
        let measured = parts.iter().map(|part| part.measured).sum();
        Self { y, whitener, log_determinant, measured }
    }
}

/// Computes the inverse of the Cholesky factor of the covariance of the measured components, and returns ln
/// of the determinant. `argument` is the name of the covariance, `place` the index of its matrix in it.
pub(super) fn whiten_as(
    argument: &'static str,
    place: &[usize],
    matrix: &[f64],
    there: &[bool],
    out: &mut [f64],
) -> Result<f64> {
    let m = there.len();
    let present: Vec<usize> = (0..m).filter(|&i| there[i]).collect();
    require_numbers(argument, place, matrix, m, &present)?;
    let mut factor = vec![0.0; m * m];
    let mut log_determinant = 0.0;
    out.fill(0.0);
    for &i in &present {
        for &j in present.iter().take_while(|&&j| j <= i) {
            let (lower, upper) = (matrix[i * m + j], matrix[j * m + i]);
            let scale = (matrix[i * m + i] * matrix[j * m + j]).sqrt();
            if (upper - lower).abs() > ASYMMETRY * scale {
                let index = [place, &[j, i]].concat();
                return Err(Error::NotSymmetric { argument, index, upper, lower });
            }
            let mut sum = upper + 0.5 * (lower - upper);
            for &k in present.iter().take_while(|&&k| k < j) {
                sum -= factor[i * m + k] * factor[j * m + k];
            }
            if i != j {
                factor[i * m + j] = sum / factor[j * m + j];
                continue;
            }
            let share = sum / matrix[i * m + i];
            let index = place.to_vec();
            if share <= -REGULAR {
                return Err(Error::Indefinite { argument, index });
            }
            if share <= REGULAR {
                return Err(Error::Singular { argument, index });
            }
            factor[i * m + i] = sum.sqrt();
            log_determinant += sum.ln();
        }
    }
    // N = L^-1, row by row
    for &i in &present {
        let reciprocal = 1.0 / factor[i * m + i];
        for &j in present.iter().take_while(|&&j| j < i) {
            let between = present.iter().filter(|&&k| j <= k && k < i);
            let sum: f64 = between.map(|&k| factor[i * m + k] * out[k * m + j]).sum();
            out[i * m + j] = -sum * reciprocal;
        }
        out[i * m + i] = reciprocal;
    }
    Ok(log_determinant)
}

/// Fails unless the elements for the measured components are finite, and their variances are in range.
fn require_numbers(
    argument: &'static str,
    place: &[usize],
    matrix: &[f64],
    m: usize,
    present: &[usize],
) -> Result<()> {
    let wrong = |i: usize, j: usize, requirement| {
        let (index, value) = ([place, &[i, j]].concat(), matrix[i * m + j]);
        Err(Error::InvalidElement { argument, index, value, requirement })
    };
    for &i in present {
        if let Some(&j) = present.iter().find(|&&j| !matrix[i * m + j].is_finite()) {
            return wrong(i, j, "every element must be a finite number where there is a plot");
        }
        if !VARIANCES.contains(&matrix[i * m + i]) {
            return wrong(i, i, "variances must be positive, between 1e-140 and 1e140");
        }
    }
    Ok(())
}

//! Space first: every instant is located, then each coordinate is smoothed by local polynomials.

use super::result::{Trajectory, without_correlations};
use crate::trajectory::images::Choice;
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::measured::Record;
use crate::trajectory::path::failure::Failure;
use crate::trajectory::path::series::{Noisy, Polynomials, Series};

/// Locates every instant, then smooths each coordinate by polynomials. N is 3 D.
///
/// # Errors
/// No instant can be located, or the polynomials do not exist.
pub fn by_polynomials<const D: usize, const N: usize>(
    record: &Record<'_>,
    polynomials: Polynomials,
) -> Result<Trajectory, Failure> {
    let fixes = Fixes::of::<D>(record, record.values);
    let choice = Choice::<D>::new(record, &fixes);
    let fixes = fixes.beside(record, record.values, choice.mirror.as_ref()).located()?;
    let coordinate = |axis: usize| -> Noisy {
        let of = |t: usize| {
            let variance = fixes.covariance[(t * D + axis) * D + axis];
            let known = variance.is_finite();
            if known { (fixes.position[t * D + axis], variance) } else { (f64::NAN, 1.0) }
        };
        (0..record.len()).map(of).unzip()
    };
    let rows: Vec<Noisy> = (0..D).map(coordinate).collect();
    let series = Series::smoothed(record, &rows, Some(polynomials))?;
    let (mut mean, mut variance) = (vec![0.0; record.len() * N], vec![0.0; record.len() * N]);
    for t in 0..record.len() {
        for derivative in 0..3 {
            for (axis, series) in series.iter().enumerate() {
                let at = t * N + derivative * D + axis;
                mean[at] = series.value[derivative][t];
                variance[at] = series.sigma[derivative][t].powi(2);
            }
        }
    }
    let covariance = without_correlations(&variance, N);
    let image = choice.image(&mean, N)?;
    Ok(Trajectory { image, ..Trajectory::of_fixes::<D, N>(record, fixes, mean, covariance) })
}

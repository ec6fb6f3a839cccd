//! Correction of tracks for the errors and the noise that were found.

use super::sighting::{Errors, azimuth_of};
use super::states::States;
use nalgebra::{Matrix2, Matrix4, Vector2};

/// Removes the `errors` (M, K) of the radars at these positions from the states. Scales the covariances along
/// the range and across it by `factors`, (M, K) pairs of ratios of the standard deviations found to those
/// with which the tracks were made.
///
/// # Panics
/// If the lengths do not match.
pub fn correct(
    states: &mut States,
    positions: &[[f64; 2]],
    errors: &[Errors],
    factors: &[[f64; 2]],
) {
    let count = positions.len();
    assert!(errors.len() == states.state.len() && factors.len() == errors.len());
    let states =
        states.state.iter_mut().zip(&mut states.covariance).zip(errors.iter().zip(factors));
    for (at, ((state, covariance), (errors, factor))) in states.enumerate() {
        let k = at % count;
        let offset = Vector2::new(state[0] - positions[k][0], state[1] - positions[k][1]);
        let distance = offset.norm().max(1.0);
        let along = offset / distance;
        let across = Vector2::new(along[1], -along[0]);
        let [offset, gain, _, clock, ..] = *errors;
        let azimuth = azimuth_of(errors, along.into());
        let shift = (offset + gain * distance) * along + azimuth * distance * across;
        state[0] += clock * state[2] - shift[0];
        state[1] += clock * state[3] - shift[1];
        let scale: Matrix2<f64> =
            factor[0] * along * along.transpose() + factor[1] * across * across.transpose();
        let mut s = Matrix4::zeros();
        s.fixed_view_mut::<2, 2>(0, 0).copy_from(&scale);
        s.fixed_view_mut::<2, 2>(2, 2).copy_from(&scale);
        let scaled = s * Matrix4::from_row_slice(covariance) * s;
        covariance.copy_from_slice((0.5 * (scaled + scaled.transpose())).as_slice());
    }
}

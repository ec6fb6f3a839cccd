//! Radars that see a target from the same side.
//!
//! An error of the range that is common to such radars moves all plots of the target alike. It also bends a
//! straight path, but targets turn as well, often in the same way in many blocks. Therefore this error is an
//! additional unknown of each block, without a prior. Cost O(n + q²) for n plots and q errors.

use super::block::Unknowns;
use super::sighting::Sighting;
use nalgebra::{DMatrix, DVector, Vector2};

/// Sine of the angle between the directions to radars below which these directions are taken as equal.
const SAME: f64 = 0.05;

/// Returns a unit of the common range error of radars without parallax, in each of the columns of a block;
/// none if the error is observable by parallax, or if the range error of one of the radars is known.
pub(super) fn common_range(
    sightings: &[Sighting],
    columns: &[usize],
    unknowns: &Unknowns,
) -> Option<DVector<f64>> {
    let centre = sightings.iter().map(|one| one.position).sum::<Vector2<f64>>();
    let centre = centre / sightings.len() as f64;
    let (mut common, mut first) = (DVector::zeros(columns.len()), None);
    for one in sightings {
        let (column, prior) = unknowns[one.radar][0]?;
        let own = centre - one.origin()?;
        let other = *first.get_or_insert(own);
        let sides = own.norm() * other.norm();
        if own.dot(&other) <= 0.0 || own.perp(&other).abs() > SAME * sides {
            return None;
        }
        let place = columns.partition_point(|&other| other < column);
        common[place] = 1.0 / prior;
    }
    Some(common)
}

/// Removes the information about errors in these proportions from normal equations.
pub(super) fn hide(
    information: &mut DMatrix<f64>,
    score: &mut DVector<f64>,
    errors: &DVector<f64>,
) {
    let by_errors = &*information * errors;
    let square = errors.dot(&by_errors);
    if square > 0.0 {
        let share = errors.dot(score) / square;
        score.axpy(-share, &by_errors, 1.0);
        information.ger(-1.0 / square, &by_errors, &by_errors, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::sighting::tests::radar;
    use super::super::sighting::{ERRORS, Report};
    use super::*;

    /// Two plots by radars this far apart, 50 km from a target, with these priors of the range errors.
    fn common(apart: f64, priors: [Option<f64>; 2]) -> Option<DVector<f64>> {
        let radars = [radar([0.0; 3], 50.0, 0.08), radar([apart, 0.0, 0.0], 50.0, 0.08)];
        let seen = |k: usize| {
            let azimuth = if k == 0 { 0.0 } else { -(apart / 5e4).atan() };
            let range = f64::hypot(5e4, if k == 0 { 0.0 } else { apart });
            let (time, height, place) = (k as f64, f64::NAN, None);
            let plot = Report { radar: k, time, range, azimuth, height, place };
            Sighting::new(&plot, f64::NAN, &radars[k], [1.0; 2]).unwrap()
        };
        let mut unknowns: Unknowns = vec![[None; ERRORS]; 2];
        let mut columns = Vec::new();
        for (k, prior) in priors.into_iter().enumerate() {
            unknowns[k][2] = Some((2 * k + 1, 1e-3));
            unknowns[k][0] = prior.map(|prior| (2 * k, prior));
            columns.extend(unknowns[k].iter().flatten().map(|one| one.0));
        }
        common_range(&[seen(0), seen(1)], &columns, &unknowns)
    }

    #[test]
    fn a_range_error_in_common_is_told_by_parallax_or_by_a_radar_without_errors() {
        let expected = DVector::from_row_slice(&[0.01, 0.0, 0.02, 0.0]);
        assert_eq!(common(500.0, [Some(100.0), Some(50.0)]), Some(expected));
        assert_eq!(common(5000.0, [Some(100.0), Some(50.0)]), None);
        assert_eq!(common(500.0, [None, Some(50.0)]), None);
    }

    #[test]
    fn what_is_hidden_is_a_free_unknown() {
        // the Schur complement: common errors [1 1] are free, only the difference remains
        let mut information = DMatrix::from_row_slice(2, 2, &[3.0, -1.0, -1.0, 2.0]);
        let mut score = DVector::from_row_slice(&[5.0, 1.0]);
        hide(&mut information, &mut score, &DVector::from_row_slice(&[1.0, 1.0]));
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} {b}");
        // Y = [3 -1; -1 2], c = [1 1]: Y c = [2 1], c Y c = 3
        for (found, expected) in information.iter().zip([5.0, -5.0, -5.0, 5.0]) {
            close(*found, expected / 3.0);
        }
        for (found, expected) in score.iter().zip([1.0, -1.0]) {
            close(*found, expected);
        }
    }
}

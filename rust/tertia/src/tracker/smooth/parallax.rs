//! The height of a target that reports none: several radars see it in the same place only at its own height.

use super::flight::TrackPlot;
use nalgebra::{SMatrix, SVector};

/// Number of plots during which a target moves with a constant acceleration.
const BLOCK: usize = 12;
/// Unknowns of this motion.
const MOTION: usize = 6;

/// Returns by how much the target is lower than the height at which its plots were placed, m, and the variance
/// of this; infinite if the plots do not tell. `by_height` has the derivatives of their positions with respect
/// to the height.
///
/// Cost O(plots).
pub fn height_offset(plots: &[TrackPlot], by_height: &[[f64; 2]]) -> [f64; 2] {
    let blocks = plots.chunks(BLOCK).zip(by_height.chunks(BLOCK));
    let (score, information) = blocks
        .filter_map(|(plots, lifts)| block(plots, lifts))
        .fold((0.0, 0.0), |(score, information), own| (score + own[0], information + own[1]));
    let known = information > 0.0;
    if known { [score / information, 1.0 / information] } else { [0.0, f64::INFINITY] }
}

/// Score and information of a block; none if it has too few plots.
fn block(plots: &[TrackPlot], lifts: &[[f64; 2]]) -> Option<[f64; 2]> {
    let (first, last) = (plots.first()?, plots.last()?);
    let (middle, half) = (0.5 * (first.time + last.time), 0.5 * (last.time - first.time));
    let mut normal = SMatrix::<f64, MOTION, MOTION>::zeros();
    // for the positions and for the lifts
    let mut right = SMatrix::<f64, MOTION, 2>::zeros();
    let mut squares = SMatrix::<f64, 2, 2>::zeros();
    for (plot, lift) in plots.iter().zip(lifts) {
        let t = (plot.time - middle) / half;
        let powers = [1.0, t, t * t];
        let inverse = plot.covariance.inverse();
        let weight = SMatrix::<f64, 2, 2>::new(inverse.xx, inverse.xy, inverse.xy, inverse.yy);
        let design =
            SMatrix::<f64, 2, MOTION>::from_fn(
                |axis, k| {
                    if k % 2 == axis { powers[k / 2] } else { 0.0 }
                },
            );
        let off = [0, 1].map(|axis| plot.position[axis] - first.position[axis]);
        let values = SMatrix::<f64, 2, 2>::from_columns(&[SVector::from(off), (*lift).into()]);
        let weighted = weight * values;
        normal += design.transpose() * weight * design;
        right += design.transpose() * weighted;
        squares += values.transpose() * weighted;
    }
    let solved = normal.cholesky()?.solve(&right);
    let left = squares - right.transpose() * solved;
    let (score, information) = (left[(0, 1)], left[(1, 1)]);
    let freedom = (2 * plots.len()).checked_sub(MOTION + 1).filter(|free| *free > 0)?;
    if information.is_nan() || information <= 0.0 {
        return None;
    }
    let factor = ((left[(0, 0)] - score * score / information) / freedom as f64).max(1.0);
    Some([score / factor, information / factor])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::base::plane::Plane;

    /// Plots, by radars at these places, of a target at the height `high`, which are placed at `assumed`.
    fn seen(radars: &[[f64; 2]], high: f64, assumed: f64) -> (Vec<TrackPlot>, Vec<[f64; 2]>) {
        let of = |k: usize| {
            let time = 2.0 * k as f64;
            let radar = radars[k % radars.len()];
            let east = 5e3 + 200.0 * time - radar[0];
            let north = 30e3 + 50.0 * time + 0.5 * time * time - radar[1];
            let range = (east * east + north * north + high * high).sqrt();
            let ground = (range * range - assumed * assumed).sqrt();
            let direction = [east, north].map(|x| x / east.hypot(north));
            let plot = TrackPlot {
                sensor: 0,
                time,
                position: [0, 1].map(|i| radar[i] + ground * direction[i]),
                covariance: Plane { xx: 400.0, xy: 0.0, yy: 900.0 },
                velocity: [f64::NAN; 2],
                velocity_covariance: Plane { xx: f64::NAN, xy: f64::NAN, yy: f64::NAN },
                height: f64::NAN,
                used: true,
            };
            (plot, direction.map(|x| -x * assumed / ground))
        };
        (0..36).map(of).unzip()
    }

    #[test]
    fn several_radars_tell_the_height() {
        let radars = [[0.0, 0.0], [40e3, 0.0], [10e3, 60e3]];
        let (mut high, mut variance) = (6000.0, 0.0);
        for _ in 0..5 {
            let (plots, by_height) = seen(&radars, 9000.0, high);
            let [lower, found] = height_offset(&plots, &by_height);
            (high, variance) = (high - lower, found);
        }
        assert_within(0.01, high, 9000.0);
        assert!((10.0..100.0).contains(&variance.sqrt()), "{}", variance.sqrt());
    }

    #[test]
    fn one_radar_tells_nothing_and_few_plots_are_not_used() {
        let (plots, by_height) = seen(&[[0.0, 0.0]], 9000.0, 6000.0);
        assert!(height_offset(&plots, &by_height)[1].sqrt() > 500.0);
        assert_eq!(height_offset(&plots[..3], &by_height[..3]), [0.0, f64::INFINITY]);
        assert_eq!(height_offset(&[], &[]), [0.0, f64::INFINITY]);
    }
}

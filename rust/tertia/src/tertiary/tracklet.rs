//! The plot behind a row of a track, reconstructed from the track (a tracklet).

use super::row::Row;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use nalgebra::{Cholesky, Matrix2, SymmetricEigen, Vector2};

/// Least gain by which a row tells anything of its plot.
const LEAST_GAIN: f64 = 0.15;
/// Scans after which what was predicted is not known.
const LONGEST_GAP: f64 = 2.0;

/// The plot that moved a prediction to `corrected`, where plots have the covariance R:
/// `z = x⁻ + K⁻¹ (x⁺ − x⁻)` with `K = P⁺ R⁻¹`, which holds for the positions of a Kalman filter whatever
/// its prediction was. Eigenvalues of the gain above 1 count as 1. None where the plot has moved the
/// track too little.
pub fn reconstructed(
    predicted: [f64; 2],
    corrected: [f64; 2],
    covariance: Plane,
    noise: Plane,
) -> Option<[f64; 2]> {
    let (p, r) = (matrix(covariance), matrix(noise));
    let lower = Cholesky::new(r)?.l();
    let inverse = lower.try_inverse()?;
    // K = L M L⁻¹ with M = L⁻¹ P L'⁻¹, symmetric
    let gain = SymmetricEigen::new(inverse * p * inverse.transpose());
    if !gain.eigenvalues.iter().all(|&value| value >= LEAST_GAIN) {
        return None;
    }
    let mut scaled = gain.eigenvectors;
    for (mut column, value) in scaled.column_iter_mut().zip(gain.eigenvalues.iter()) {
        column /= value.min(1.0);
    }
    let [x, y] = predicted;
    let moved = Vector2::new(corrected[0] - x, corrected[1] - y);
    let plot = lower * scaled * gain.eigenvectors.transpose() * inverse * moved;
    Some([x + plot[0], y + plot[1]])
}

/// What a row says of a position.
pub(super) enum Behind {
    /// The plot, with the noise of the sensor.
    Plot([f64; 2]),
    /// The state as it is, with its own covariance: after a gap, or at the beginning, no prediction is
    /// known, and little that was used before is in it.
    State([f64; 2], Plane),
    /// Nothing.
    Nothing,
}

/// What is behind the last row of a track, by the rows before it, the last one first, where the plot is
/// not known by the filter that made the row. So high above its sensor that a small error of the range
/// is a large one on the ground, it says nothing.
pub(super) fn behind(
    plot: Option<[f64; 2]>,
    row: &Row,
    before: &[Option<Row>; 2],
    radar: &Radar,
) -> Behind {
    let [x, y, ..] = row.state;
    if (x - radar.position[0]).hypot(y - radar.position[1]) < row.above(radar).abs() {
        return Behind::Nothing;
    }
    if let Some(plot) = plot {
        return Behind::Plot(plot);
    }
    let Estimate { covariance: p, .. } = row.estimate(radar);
    let covariance = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] };
    let Some(last) = before[0] else { return Behind::State([x, y], covariance) };
    let t = row.time - last.time;
    if t > LONGEST_GAP * radar.scan_period {
        return Behind::State([x, y], covariance);
    }
    let rate = before[1].map_or(0.0, |first| last.turning() * turn_rate(&first, &last));
    let predicted = carried(&last, t, rate);
    let noise = radar.noise_at([x, y], row.above(radar));
    reconstructed(predicted, [x, y], covariance, noise).map_or(Behind::Nothing, Behind::Plot)
}

/// Change of course between two rows over time, rad/s, anticlockwise.
fn turn_rate(first: &Row, last: &Row) -> f64 {
    let ([_, _, a, b], [_, _, c, d]) = (first.state, last.state);
    let rate = (a * d - b * c).atan2(a * c + b * d) / (last.time - first.time);
    if rate.is_finite() { rate } else { 0.0 }
}

/// Position after t seconds of a turn at this rate.
pub(super) fn carried(row: &Row, t: f64, rate: f64) -> [f64; 2] {
    let [x, y, vx, vy] = row.state;
    let half = 0.5 * rate * t;
    let chord = if half.abs() < 1e-6 { t } else { t * half.sin() / half };
    let (sine, cosine) = half.sin_cos();
    [x + chord * (cosine * vx - sine * vy), y + chord * (sine * vx + cosine * vy)]
}

fn matrix(plane: Plane) -> Matrix2<f64> {
    Matrix2::new(plane.xx, plane.xy, plane.xy, plane.yy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::Identities;

    #[test]
    fn a_plot_from_its_correction() {
        let r = Plane { xx: 9000.0, xy: 2500.0, yy: 6000.0 };
        let (p, z, x) =
            (Plane { xx: 9000.0, xy: 500.0, yy: 7000.0 }, [50110.0, 59920.0], [5e4, 6e4]);
        let (before, noise) = (matrix(p), matrix(r));
        let gain = before * (before + noise).try_inverse().unwrap();
        let moved = Vector2::from(x) + gain * (Vector2::from(z) - Vector2::from(x));
        let position = [moved[0], moved[1]];
        assert_within(1e-12, position[0], 50_062.866_666_666_67);
        assert_within(1e-12, position[1], 59_948.644_444_444_44);
        let c = before - gain * before;
        let after = Plane { xx: c[(0, 0)], xy: c[(0, 1)], yy: c[(1, 1)] };
        let found = reconstructed(x, position, after, r).unwrap();
        assert_within(1e-12, found[0], z[0]);
        assert_within(1e-12, found[1], z[1]);
        let tiny = Plane { xx: 900.0, xy: 0.0, yy: 600.0 };
        assert_eq!(reconstructed(x, position, tiny, r), None);
    }

    #[test]
    fn a_turn_goes_on() {
        let row = |time, course: f64| Row {
            sensor: 0,
            track: 1,
            time,
            state: [0.0, 0.0, 200.0 * course.cos(), 200.0 * course.sin()],
            covariance: [f64::NAN; 16],
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: 1.0,
        };
        let (first, last) = (row(0.0, 0.1), row(4.0, 0.3));
        assert_within(1e-12, turn_rate(&first, &last), 0.05);
        let radius = 200.0 / 0.05;
        let found = carried(&last, 4.0, 0.05);
        assert_within(1e-12, found[0], radius * (0.5_f64.sin() - 0.3_f64.sin()));
        assert_within(1e-12, found[1], radius * (0.3_f64.cos() - 0.5_f64.cos()));
        assert_eq!(carried(&last, 4.0, 0.0), [4.0 * last.state[2], 4.0 * last.state[3]]);
    }
}

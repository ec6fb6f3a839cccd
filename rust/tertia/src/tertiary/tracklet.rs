//! The plot behind a row of a track, reconstructed from the track (a tracklet).

use super::row::Row;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use nalgebra::{Cholesky, Matrix2, SymmetricEigen, Vector2};
use serde::{Deserialize, Serialize};

/// Least gain by which a row tells anything of its plot.
const LEAST_GAIN: f64 = 0.15;
/// Scans after which what was predicted is not known.
const LONGEST_GAP: f64 = 2.0;
/// Variance of a row along some direction, in that of a plot, from which on it is of two possibilities: a
/// filter that has taken a plot knows more than the plot, and several models that disagree seldom reach 3.
const DOUBT: f64 = 5.0;

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

/// What is remembered of an earlier row of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Past {
    time: f64,
    state: [f64; 4],
    turning: f64,
    is_doubtful: bool,
}

impl Past {
    pub fn new(row: &Row, is_doubtful: bool) -> Self {
        let &Row { time, state, .. } = row;
        Self { time, state, turning: row.turning(), is_doubtful }
    }

    /// By which a later row moved the state that went straight on from this one.
    pub fn correction(&self, row: &Row) -> [f64; 4] {
        let [x, y] = self.carried(row.time - self.time, 0.0);
        let [.., vx, vy] = self.state;
        [row.state[0] - x, row.state[1] - y, row.state[2] - vx, row.state[3] - vy]
    }

    /// Change of course since a row before it over time, rad/s, anticlockwise.
    fn turn_rate(&self, first: &Self) -> f64 {
        let ([_, _, a, b], [_, _, c, d]) = (first.state, self.state);
        let rate = (a * d - b * c).atan2(a * c + b * d) / (self.time - first.time);
        if rate.is_finite() { rate } else { 0.0 }
    }

    /// Position after t seconds of a turn at this rate.
    fn carried(&self, t: f64, rate: f64) -> [f64; 2] {
        let [x, y, vx, vy] = self.state;
        let half = 0.5 * rate * t;
        let chord = if half.abs() < 1e-6 { t } else { t * half.sin() / half };
        let (sine, cosine) = half.sin_cos();
        [x + chord * (cosine * vx - sine * vy), y + chord * (sine * vx + cosine * vy)]
    }
}

/// Whether the sensor does not know which of two plots, or none, was of the target: the next ones show it,
/// and one of two states that lie far apart is given up.
pub(super) fn is_doubtful(row: &Row, radar: &Radar) -> bool {
    let [x, y, ..] = row.state;
    let r = radar.noise_at([x, y], row.above(radar));
    let [xx, xy, _, _, _, yy, ..] = row.covariance;
    let left = Plane { xx: DOUBT * r.xx - xx, xy: DOUBT * r.xy - xy, yy: DOUBT * r.yy - yy };
    left.xx < 0.0 || left.determinant() < 0.0
}

/// What a row says of a position.
pub(super) enum Behind {
    /// The plot, with the noise of the sensor.
    Plot([f64; 2]),
    /// The state as it is, with its own covariance: after a gap, in doubt and after it, or at the beginning,
    /// no prediction is known, and little that was used before is in it.
    State([f64; 2], Plane),
    /// Nothing.
    Nothing,
}

/// What is behind the last row of a track, by the rows before it, the last one first, where the plot is
/// not known by the filter that made the row. So high above its sensor that a small error of the range
/// is a large one on the ground, it says nothing.
pub(super) fn behind(
    plot: Option<[f64; 2]>,
    (row, is_doubtful): (&Row, bool),
    before: &[Option<Past>; 2],
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
    let known = before[0].filter(|last| {
        let is_sure = !is_doubtful && !last.is_doubtful;
        is_sure && row.time - last.time <= LONGEST_GAP * radar.scan_period
    });
    let Some(last) = known else { return Behind::State([x, y], covariance) };
    let rate = before[1].map_or(0.0, |first| last.turning * last.turn_rate(&first));
    let predicted = last.carried(row.time - last.time, rate);
    let noise = radar.noise_at([x, y], row.above(radar));
    reconstructed(predicted, [x, y], covariance, noise).map_or(Behind::Nothing, Behind::Plot)
}

fn matrix(plane: Plane) -> Matrix2<f64> {
    Matrix2::new(plane.xx, plane.xy, plane.xy, plane.yy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::{Identities, radar_of};

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
        let past = |time, course: f64| Past {
            time,
            state: [0.0, 0.0, 200.0 * course.cos(), 200.0 * course.sin()],
            turning: 1.0,
            is_doubtful: false,
        };
        let (first, last) = (past(0.0, 0.1), past(4.0, 0.3));
        assert_within(1e-12, last.turn_rate(&first), 0.05);
        let radius = 200.0 / 0.05;
        let found = last.carried(4.0, 0.05);
        assert_within(1e-12, found[0], radius * (0.5_f64.sin() - 0.3_f64.sin()));
        assert_within(1e-12, found[1], radius * (0.3_f64.cos() - 0.5_f64.cos()));
        assert_eq!(last.carried(4.0, 0.0), [4.0 * last.state[2], 4.0 * last.state[3]]);
    }

    /// A row between two states is a position of its own covariance, and so is the row after it where the
    /// filter is not known.
    #[test]
    fn a_row_in_doubt_is_of_no_plot() {
        let radar = radar_of([50.0, 1e-3]);
        let row = |time, variance: f64| Row {
            sensor: 0,
            track: 1,
            time,
            state: [40e3 + 200.0 * time, 30e3, 200.0, 0.0],
            covariance: std::array::from_fn(|i| if i % 5 == 0 { variance } else { 0.0 }),
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: 0.0,
        };
        let (sure, doubtful) = (row(0.0, 1e3), row(4.0, 4e4));
        assert!(!is_doubtful(&sure, &radar) && is_doubtful(&doubtful, &radar));
        let none = Row { covariance: [f64::NAN; 16], ..doubtful };
        assert!(!is_doubtful(&none, &radar));
        let past = |row| Some(Past::new(row, is_doubtful(row, &radar)));
        let behind = |row: &Row, before: [Option<Past>; 2]| {
            behind(None, (row, is_doubtful(row, &radar)), &before, &radar)
        };
        let found = behind(&doubtful, [past(&sure), None]);
        assert!(matches!(found, Behind::State(_, own) if own.xx == 4e4));
        let found = behind(&row(8.0, 1e3), [past(&doubtful), past(&sure)]);
        assert!(matches!(found, Behind::State(_, own) if own.xx == 1e3));
        let found = behind(&row(4.0, 1e3), [past(&sure), None]);
        assert!(matches!(found, Behind::Plot(_)));
    }
}

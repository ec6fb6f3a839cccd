//! Reconstruction of the plot behind a row of a track from the track itself (a tracklet).

use super::family::{DAMPING, Evidence, Families};
use super::gain::{Gain, Step};
use super::row::Row;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use crate::tracker::Estimate;
use serde::{Deserialize, Serialize};

/// Longest time since the last plot, in scans, after which a correction is still used to estimate the gain:
/// after a longer gap, the gain is not the usual one.
const LONGEST_GAP: f64 = 2.0;
/// If the variance of a row in some direction exceeds this many variances of a plot, the row mixes two
/// alternatives: a filter with a plot is more accurate than the plot, and several models that disagree
/// seldom reach 3.
const DOUBT: f64 = 5.0;
/// A row that moves a track by less than this, in standard deviations of a plot, has no plot.
const STILL: f64 = 0.02;

/// Largest error of a plot, in standard deviations, and longest lag of a filter, in scans over its gain, with
/// which a plot is reconstructed.
const FARTHEST: f64 = 5.0;
const LONGEST_LAG: f64 = 1.5;
/// Most steps to the place of a plot whose noise differs from that at its row, the ratio of a step to the one before
/// from which on they lead nowhere, and the step that is small enough, in standard deviations of the plot.
const STEPS: usize = 8;
const SLOWEST: f64 = 0.5;
const SMALL: f64 = 0.1;
/// Relative standard deviation of an innovation that follows from the stated covariances.
const STATED: f64 = 0.01;

/// An earlier row of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Past {
    time: f64,
    state: [f64; 4],
    turning: f64,
    is_doubtful: bool,
    /// Time of the last plot.
    plotted: f64,
}

impl Past {
    pub fn new(row: &Row, is_doubtful: bool, plotted: f64) -> Self {
        let &Row { time, state, turn_probability, .. } = row;
        // a sensor that does not report turns does not predict that they continue
        let turning = if turn_probability.is_finite() { row.turning() } else { 0.0 };
        Self { time, state, turning, is_doubtful, plotted }
    }

    /// Correction by a later row, relative to a straight extrapolation of this one.
    pub fn correction(&self, row: &Row) -> [f64; 4] {
        let [x, y] = self.carried(row.time - self.time, 0.0);
        let [.., vx, vy] = self.state;
        [row.state[0] - x, row.state[1] - y, row.state[2] - vx, row.state[3] - vy]
    }

    /// Rate of turn since an earlier row, rad/s, anticlockwise.
    fn turn_rate(&self, first: &Self) -> f64 {
        let ([_, _, a, b], [_, _, c, d]) = (first.state, self.state);
        let rate = (a * d - b * c).atan2(a * c + b * d) / (self.time - first.time);
        if rate.is_finite() { rate } else { 0.0 }
    }

    /// Position after t seconds of a turn with this rate.
    fn carried(&self, t: f64, rate: f64) -> [f64; 2] {
        let [x, y, vx, vy] = self.state;
        let half = 0.5 * rate * t;
        let chord = if half.abs() < 1e-6 { t } else { t * half.sin() / half };
        let (sine, cosine) = half.sin_cos();
        [x + chord * (cosine * vx - sine * vy), y + chord * (sine * vx + cosine * vy)]
    }
}

/// The correction of a track by a later row.
struct Moved {
    step: Step,
    /// Axes along and across the line of sight, with the length of the standard deviations of a plot.
    axes: [[f64; 2]; 2],
    /// Predicted position of the track.
    predicted: [f64; 2],
}

impl Moved {
    /// Returns the correction by a row, relative to a prediction from the last row with this rate of turn, in
    /// standard deviations of a plot at `place`.
    fn new(row: &Row, last: &Past, rate: f64, radar: &Radar, place: [f64; 2]) -> Self {
        let [x, y, vx, vy] = row.state;
        let t = row.time - last.time;
        let predicted = last.carried(t, rate);
        let (sine, cosine) = (rate * t).sin_cos();
        let [.., px, py] = last.state;
        let by = [vx - cosine * px + sine * py, vy - sine * px - cosine * py];
        let (dx, dy) = (place[0] - radar.position[0], place[1] - radar.position[1]);
        let ground = dx.hypot(dy);
        // exactly above the radar, the direction is arbitrary
        let [e, n] = if ground > 0.0 { [dx / ground, dy / ground] } else { [0.0, 1.0] };
        let noise = radar.noise_at(place, row.above(radar));
        let axes = [[e, n], [n, -e]].map(|[east, north]| {
            let sigma = noise.form([east, north]).sqrt();
            [east * sigma, north * sigma]
        });
        let in_sigmas =
            |[east, north]: [f64; 2]| axes.map(|[a, b]| (a * east + b * north) / (a * a + b * b));
        let period = radar.scan_period;
        let scans = ((row.time - last.plotted) / period).round().max(1.0);
        let Estimate { covariance: p, .. } = row.estimate(radar);
        let covariance = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] };
        let [along, across] = axes.map(|[a, b]| [a, b].map(|one| one / (a * a + b * b)));
        let [east, north] = covariance.times(across);
        let stated = Plane {
            xx: covariance.form(along),
            xy: along[0] * east + along[1] * north,
            yy: covariance.form(across),
        };
        let step = Step {
            position: in_sigmas([x - predicted[0], y - predicted[1]]),
            velocity: in_sigmas(by.map(|by| scans * period * by)),
            stated,
        };
        Self { step, axes, predicted }
    }

    /// Converts components along and across the line of sight to the plane.
    fn in_plane(&self, [along, across]: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| along * self.axes[0][k] + across * self.axes[1][k])
    }

    /// Largest distance of a plot from its row, m: by noise, and because a filter with this gain lags.
    fn largest_lag(row: &Row, gain: Plane, radar: &Radar) -> f64 {
        let [x, y, vx, vy] = row.state;
        let Plane { xx, yy, .. } = radar.noise_at([x, y], row.above(radar));
        let lag = LONGEST_LAG * radar.scan_period / gain.determinant().sqrt();
        FARTHEST * (xx + yy).sqrt() + lag * vx.hypot(vy)
    }

    /// Distance that is small compared with the noise of a plot.
    fn small(&self) -> f64 {
        SMALL * self.axes.iter().fold(f64::INFINITY, |least, [a, b]| least.min(a.hypot(*b)))
    }

    /// Returns the plot that caused the correction with these gains.
    fn plot(&self, gain: Plane) -> [f64; 2] {
        let by = self.in_plane(gain.inverse().times(self.step.position));
        [self.predicted[0] + by[0], self.predicted[1] + by[1]]
    }
}

/// Whether a row only extrapolates the track straight ahead: practically no plot moves a track so little.
pub(super) fn coasts(row: &Row, last: &Past, radar: &Radar) -> bool {
    let [x, y, ..] = row.state;
    let step = Moved::new(row, last, 0.0, radar, [x, y]).step;
    step.position.iter().chain(&step.velocity).all(|by| by.abs() < STILL)
}

/// Whether the sensor is in doubt which of two plots belonged to the target, or whether any did. The next
/// plots decide, and one of two distant states is then dropped.
pub(super) fn is_doubtful(row: &Row, radar: &Radar) -> bool {
    let [x, y, ..] = row.state;
    let r = radar.noise_at([x, y], row.above(radar));
    let [xx, xy, _, _, _, yy, ..] = row.covariance;
    let left = Plane { xx: DOUBT * r.xx - xx, xy: DOUBT * r.xy - xy, yy: DOUBT * r.yy - yy };
    left.xx < 0.0 || left.determinant() < 0.0
}

/// Information on a position behind a row.
pub(super) enum Behind {
    /// The plot with the noise of the sensor, and the covariance that its reconstruction adds.
    Plot([f64; 2], Plane),
    /// The state with its own covariance. This is used after a gap, during and after doubt, and at the
    /// beginning: there is no known prediction, and the state contains little that was used before.
    State([f64; 2], Plane),
    /// No information.
    Nothing,
}

/// Returns the information behind the last row of a track. If the plot is not known because another filter
/// made the row, it follows from the `innovation` if the covariances tell it; else it is estimated from the rows before
/// (the latest first) and the gain of that filter. If the
/// target is so high above the sensor that a small error of the range is large on the ground, there is none.
pub(super) fn behind(
    plot: Option<[f64; 2]>,
    innovation: Option<[f64; 2]>,
    (row, is_doubtful): (&Row, bool),
    before: &[Option<Past>; 2],
    (gain, evidence, is_periodic): (&mut Gain, &Evidence, bool),
    families: Option<&mut Families>,
    (radar, noisy): (&Radar, &Radar),
) -> Behind {
    let [x, y, ..] = row.state;
    if (x - radar.position[0]).hypot(y - radar.position[1]) < row.above(radar).abs() {
        return Behind::Nothing;
    }
    if let Some(plot) = plot {
        return Behind::Plot(plot, Plane::default());
    }
    let Estimate { covariance: p, .. } = row.estimate(radar);
    let covariance = Plane { xx: p[(0, 0)], xy: p[(0, 1)], yy: p[(1, 1)] };
    let state = Behind::State([x, y], covariance);
    let Some(last) = before[0].filter(|last| !is_doubtful && !last.is_doubtful) else {
        return state;
    };
    let rate = before[1].map_or(0.0, |first| last.turning * last.turn_rate(&first));
    let moved = Moved::new(row, &last, rate, radar, [x, y]);
    if row.time - last.plotted <= LONGEST_GAP * radar.scan_period {
        gain.see(&moved.step);
    }
    if let Some([east, north]) = innovation {
        let plot = [moved.predicted[0] + east, moved.predicted[1] + north];
        return Behind::Plot(plot, outer([STATED * east, STATED * north]));
    }
    let along = |stated, damping| gain.along(stated, damping, is_periodic);
    // if velocities are not derived from positions, the positions are those of the plots
    let Some(own) = along(moved.step.stated, evidence.damping()) else {
        return Behind::Plot([x, y], Plane::default());
    };
    if let Some(families) = families {
        let plots = DAMPING.map(|damping| {
            let gain = along(moved.step.stated, damping).unwrap_or(own);
            (moved.plot(gain), gain)
        });
        families.follow(row, &plots, own, noisy);
    }
    let plot = moved.plot(own);
    let [east, north] = [plot[0] - x, plot[1] - y];
    if east.hypot(north) <= Moved::largest_lag(row, own, noisy) {
        let there = |place| {
            let moved = Moved::new(row, &last, rate, radar, place);
            moved.plot(along(moved.step.stated, evidence.damping()).unwrap_or(own))
        };
        let (plot, step) = settled([x, y], plot, moved.small(), there);
        let unsure = evidence.unsure();
        let by = [0, 1].map(|k| unsure * (plot[k] - moved.predicted[k]));
        let turned = Plane { xx: step * step, xy: 0.0, yy: step * step };
        return Behind::Plot(plot, outer(by).plus(turned));
    }
    // the gain is not what it seems to be: the state, which may be as wrong as the plot is far away
    Behind::State([x, y], covariance.plus(outer([east, north])))
}

/// Follows a plot behind a row from place to place, because near a sensor, the noise at the plot is another one than
/// that at the row. Returns the last place, and the length of the step to the next one.
fn settled(
    row: [f64; 2],
    mut plot: [f64; 2],
    small: f64,
    there: impl Fn([f64; 2]) -> [f64; 2],
) -> ([f64; 2], f64) {
    let mut last = (plot[0] - row[0]).hypot(plot[1] - row[1]);
    for _ in 0..STEPS {
        let next = there(plot);
        let step = (next[0] - plot[0]).hypot(next[1] - plot[1]);
        if step <= small || step >= SLOWEST * last {
            return (plot, step);
        }
        (plot, last) = (next, step);
    }
    (plot, last)
}

/// Covariance of a position that may be wrong by this in one direction.
fn outer([x, y]: [f64; 2]) -> Plane {
    Plane { xx: x * x, xy: x * y, yy: y * y }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::{Identities, radar_of};

    #[test]
    fn a_turn_goes_on() {
        let past = |time, course: f64| Past {
            time,
            state: [0.0, 0.0, 200.0 * course.cos(), 200.0 * course.sin()],
            turning: 1.0,
            is_doubtful: false,
            plotted: time,
        };
        let (first, last) = (past(0.0, 0.1), past(4.0, 0.3));
        assert_within(1e-12, last.turn_rate(&first), 0.05);
        let radius = 200.0 / 0.05;
        let found = last.carried(4.0, 0.05);
        assert_within(1e-12, found[0], radius * (0.5_f64.sin() - 0.3_f64.sin()));
        assert_within(1e-12, found[1], radius * (0.3_f64.cos() - 0.5_f64.cos()));
        assert_eq!(last.carried(4.0, 0.0), [4.0 * last.state[2], 4.0 * last.state[3]]);
    }

    /// The information behind a row between two states is a position with its own covariance, and so is that
    /// behind the next row if the filter is not known.
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
        let past = |row| Some(Past::new(row, is_doubtful(row, &radar), row.time));
        let behind = |row: &Row, before: [Option<Past>; 2]| {
            let mut gain = Gain::default();
            behind(
                None,
                None,
                (row, is_doubtful(row, &radar)),
                &before,
                (&mut gain, &Evidence::default(), false),
                None,
                (&radar, &radar),
            )
        };
        let found = behind(&doubtful, [past(&sure), None]);
        assert!(matches!(found, Behind::State(_, own) if own.xx == 4e4));
        let found = behind(&row(8.0, 1e3), [past(&doubtful), past(&sure)]);
        assert!(matches!(found, Behind::State(_, own) if own.xx == 1e3));
        let found = behind(&row(4.0, 1e3), [past(&sure), None]);
        assert!(matches!(found, Behind::Plot(..)));
    }

    /// A correction that would lead to a plot many scans away.
    #[test]
    fn a_plot_far_away_is_none() {
        let radar = radar_of([50.0, 1e-3]);
        let row = |time, north: f64| Row {
            sensor: 0,
            track: 1,
            time,
            state: [40e3 + 200.0 * time, 30e3 + north, 200.0, 0.0],
            covariance: std::array::from_fn(|i| if i % 5 == 0 { 1e3 } else { 0.0 }),
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: 0.0,
        };
        let last = Past::new(&row(0.0, 0.0), false, 0.0);
        let behind = |north| {
            let mut gain = Gain::default();
            behind(
                None,
                None,
                (&row(4.0, north), false),
                &[Some(last), None],
                (&mut gain, &Evidence::default(), false),
                None,
                (&radar, &radar),
            )
        };
        assert!(matches!(behind(100.0), Behind::Plot(..)));
        let far = 4.0 * LONGEST_LAG * radar.scan_period * 200.0;
        assert!(
            matches!(behind(far), Behind::State([_, y], own) if y == 30e3 + far && own.yy > far * far)
        );
    }

    #[test]
    fn a_row_at_the_radar_has_a_plot() {
        let radar = radar_of([50.0, 1e-3]);
        let row = |time, east: f64| Row {
            sensor: 0,
            track: 1,
            time,
            state: [east, 0.0, 200.0, 0.0],
            covariance: [f64::NAN; 16],
            height: f64::NAN,
            identities: Identities::NONE,
            turn_probability: f64::NAN,
        };
        let (last, own) = (Past::new(&row(0.0, -780.0), false, 0.0), row(4.0, 0.0));
        let mut gain = Gain::default();
        let found = behind(
            None,
            None,
            (&own, false),
            &[Some(last), None],
            (&mut gain, &Evidence::default(), false),
            None,
            (&radar, &radar),
        );
        assert!(matches!(found, Behind::Plot(plot, _) if plot.iter().all(|x| x.is_finite())));
    }
}

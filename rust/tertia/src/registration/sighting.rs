//! A plot of a radar in the plane, and its displacement by the systematic errors of the radar.

use crate::sensors::{HEIGHT_SIGMA, Radar, SPREAD};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// Number of systematic errors of a radar that are the same in all directions: offset of the range, gain of the
/// range, azimuth, clock.
pub const KINDS: usize = 4;
/// Number of all errors: also the coefficients of the deviation of the azimuth.
pub const ERRORS: usize = 8;
/// Indices of the errors of azimuth and clock.
pub(super) const AZIMUTH: usize = 2;
pub(super) const CLOCK: usize = 3;

/// Least variance of a position along an axis, relative to the mean of both axes.
const THIN: f64 = 1e-9;
/// Ground range over slant range below which the target is overhead.
const OVERHEAD: f64 = 1e-3;
/// Largest height of targets of unknown height, m, and largest sine of their elevation.
const HIGHEST: f64 = 12_000.0;
const STEEP: f64 = 0.7;

/// Offset of the range (m), gain of the range (1), azimuth (rad), clock (s): the measurements are
/// `ρ_m = (1 + γ) ρ + δ`, `θ_m = θ + α`, at `t_m = t + τ`. The azimuth error deviates from `α` by the sum of
/// `sin θ, cos θ, sin 2θ, cos 2θ` times the other coefficients (rad). A sensor that reports positions has errors
/// of east (m) and north (m) in place of offset and azimuth, and neither gain nor deviation.
pub type Errors = [f64; ERRORS];

/// A position that a sensor reports, and its covariance: variance east, covariance, variance north.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// East and north, metres.
    pub position: [f64; 2],
    /// Square metres; nan if that of the sensor is valid.
    pub covariance: [f64; 3],
}

/// A plot or a position as the sensor reports it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Number of the radar or other sensor.
    pub radar: usize,
    /// Seconds.
    pub time: f64,
    /// Slant range, metres.
    pub range: f64,
    /// Radians, clockwise from north.
    pub azimuth: f64,
    /// Height above the plane in metres; nan where it is not known.
    pub height: f64,
    /// Position, from a sensor that reports positions instead of range and azimuth.
    pub place: Option<Place>,
}

/// Sine and cosine of an azimuth, and of twice the azimuth.
#[inline(always)]
pub(super) fn harmonics([sine, cosine]: [f64; 2]) -> [f64; ERRORS - KINDS] {
    [sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine]
}

/// Azimuth error in the direction with these sine and cosine, rad.
#[inline(always)]
pub(super) fn azimuth_of(errors: &Errors, direction: [f64; 2]) -> f64 {
    let own = harmonics(direction).into_iter().zip(&errors[KINDS..]);
    errors[AZIMUTH] + own.map(|(harmonic, coefficient)| harmonic * coefficient).sum::<f64>()
}

/// Standard deviation of the azimuth error in any direction, from those of all errors, rad.
pub(super) fn azimuth_sigma(sigmas: &Errors) -> f64 {
    let deviation: f64 = sigmas[KINDS..].iter().map(|sigma| sigma * sigma).sum();
    (sigmas[AZIMUTH] * sigmas[AZIMUTH] + 0.5 * deviation).sqrt()
}

/// Azimuth error in a direction, rad; sine and cosine are not needed if it is the same in all directions.
fn azimuth_towards(errors: &Errors, azimuth: f64) -> f64 {
    if errors[KINDS..] == [0.0; ERRORS - KINDS] {
        return errors[AZIMUTH];
    }
    azimuth_of(errors, azimuth.sin_cos().into())
}

impl Report {
    /// Whether something was measured.
    pub fn is_seen(&self) -> bool {
        self.range.is_finite() || self.place.is_some()
    }

    /// Largest squared height of a target that radars usually see at this range.
    pub(super) fn highest(&self) -> f64 {
        (STEEP * self.range).min(HIGHEST).powi(2)
    }

    /// Returns the plot corrected for these errors.
    pub fn corrected(&self, errors: &Errors) -> Self {
        let [offset, gain, azimuth, clock, ..] = *errors;
        let moved = |place: Place| Place {
            position: [place.position[0] - offset, place.position[1] - azimuth],
            ..place
        };
        Self {
            time: self.time - clock,
            place: self.place.map(moved),
            range: (self.range - offset) / (1.0 + gain),
            azimuth: self.azimuth - azimuth_towards(errors, self.azimuth),
            ..*self
        }
    }
}

/// A plot in the plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// Whether its sensor reports positions; their noise does not follow from noise of range and azimuth.
    pub is_placed: bool,
    pub radar: usize,
    pub time: f64,
    pub position: Vector2<f64>,
    /// Unit vectors away from the radar and across (clockwise).
    pub axes: [Vector2<f64>; 2],
    /// Standard deviations along these axes, metres.
    pub sigma: [f64; 2],
    /// Slant range and ground range, metres.
    range: f64,
    ground: f64,
    /// Standard deviation of the ground range due to the error of the height, metres.
    tilt: f64,
    /// Variance along each axis of a plot about the centre of a target that is larger than the resolution, m².
    spread: f64,
    /// Largest squared height, if the range is slant and the height is unknown.
    pub highest: Option<f64>,
    /// Whether the plot is late by a delay of its target.
    pub is_late: bool,
}

impl Sighting {
    /// From a corrected plot, at its own height or another one; none if nothing was measured or the target is
    /// overhead. `factor` multiplies the standard deviations that the radar states.
    pub fn new(plot: &Report, height: f64, radar: &Radar, factor: [f64; 2]) -> Option<Self> {
        if let Some(place) = &plot.place {
            return Some(Self::placed(plot, place, radar));
        }
        let up = if height.is_finite() { height - radar.position[2] } else { 0.0 };
        let squared = plot.range * plot.range - up * up;
        if plot.range.is_nan() || plot.range <= 0.0 || squared <= (OVERHEAD * plot.range).powi(2) {
            return None;
        }
        let ground = squared.sqrt();
        let (sine, cosine) = plot.azimuth.sin_cos();
        let mut seen = Self {
            is_placed: false,
            radar: plot.radar,
            time: plot.time,
            position: Vector2::new(
                radar.position[0] + ground * sine,
                radar.position[1] + ground * cosine,
            ),
            axes: [Vector2::new(sine, cosine), Vector2::new(cosine, -sine)],
            sigma: [0.0; 2],
            range: plot.range,
            ground,
            tilt: HEIGHT_SIGMA * up / ground,
            spread: SPREAD * radar.extent * radar.extent,
            highest: None,
            is_late: false,
        };
        seen.sigma = seen.noise([radar.range_sigma * factor[0], radar.azimuth_sigma * factor[1]]);
        Some(seen)
    }

    /// From a reported position. The axes are those of its covariance, or any if the sensor states the same
    /// standard deviation for each coordinate.
    fn placed(plot: &Report, place: &Place, sensor: &Radar) -> Self {
        let (sigma, more) = (sensor.range_sigma, SPREAD * sensor.extent * sensor.extent);
        let known = !place.covariance[0].is_nan();
        let [east, both, north] =
            if known { place.covariance } else { [sigma * sigma, 0.0, sigma * sigma] };
        let (middle, half) = (0.5 * (east + north), 0.5 * (east - north));
        let spread = half.hypot(both);
        let (sine, cosine) = (0.5 * both.atan2(half)).sin_cos();
        Self {
            is_placed: true,
            radar: plot.radar,
            time: plot.time,
            position: place.position.into(),
            axes: [Vector2::new(cosine, sine), Vector2::new(sine, -cosine)],
            sigma: [middle + spread, (middle - spread).max(THIN * middle)]
                .map(|variance| (variance + more).sqrt()),
            range: 0.0,
            ground: 1.0,
            tilt: 0.0,
            spread: more,
            highest: None,
            is_late: false,
        }
    }

    /// Position of the radar; none for a sensor that reports positions.
    pub fn origin(&self) -> Option<Vector2<f64>> {
        (!self.is_placed).then(|| self.position - self.axes[0] * self.ground)
    }

    /// Standard deviations along and across for these standard deviations of range (m) and azimuth (rad).
    pub fn noise(&self, [range, azimuth]: [f64; 2]) -> [f64; 2] {
        if self.is_placed {
            return self.sigma;
        }
        let along = range * self.range / self.ground;
        let across = azimuth * self.ground;
        [along * along + self.tilt * self.tilt, across * across].map(|v| (v + self.spread).sqrt())
    }

    /// Distance by which the plot lies too far out because this squared height was not subtracted from the
    /// squared range.
    pub fn lift(&self, square: f64) -> f64 {
        0.5 * square / self.ground
    }

    /// Returns the plot with the axes of a target at this position. With those of the measured azimuths, a positive
    /// error of the range would seem to explain their noise: closer to the radar, it is smaller.
    pub fn seen_at(&self, position: Vector2<f64>) -> Self {
        let away = self.origin().and_then(|origin| (position - origin).try_normalize(0.0));
        let axes = away.map_or(self.axes, |away| [away, Vector2::new(away.y, -away.x)]);
        Self { axes, ..*self }
    }

    /// Displacements of the plot along both axes by a unit of each error, for a target with this velocity.
    pub fn design(&self, velocity: Vector2<f64>) -> [Errors; 2] {
        let mut design = [[0.0; ERRORS]; 2];
        for (own, constant) in design.iter_mut().zip(self.constant(velocity)) {
            own[..KINDS].copy_from_slice(&constant);
        }
        if !self.is_placed {
            let harmonics = harmonics(self.axes[0].into());
            for (own, harmonic) in design[1][KINDS..].iter_mut().zip(harmonics) {
                *own = self.ground * harmonic;
            }
        }
        design
    }

    /// The same for the errors that are the same in all directions.
    #[inline(always)]
    pub fn constant(&self, velocity: Vector2<f64>) -> [[f64; KINDS]; 2] {
        let [a, b] = self.axes;
        let slope = self.range / self.ground;
        let [along, across] = [-a.dot(&velocity), -b.dot(&velocity)];
        if self.is_placed {
            return [[a.x, 0.0, a.y, along], [b.x, 0.0, b.y, across]];
        }
        [[slope, slope * self.range, 0.0, along], [0.0, 0.0, self.ground, across]]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sensors::radar_of;

    pub fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-11 * b.abs().max(1e-3), "{a} {b}");
    }

    pub fn radar(position: [f64; 3], range_sigma: f64, azimuth_sigma_deg: f64) -> Radar {
        Radar { position, ..radar_of([range_sigma, azimuth_sigma_deg.to_radians()]) }
    }

    pub const PRIOR: Errors =
        [100.0, 1.0 / 1852.0, 1.745_329_251_994_329_5e-3, 0.1, 0.0, 0.0, 0.0, 0.0];

    #[test]
    fn errors_are_removed() {
        let (radar, time, range, azimuth, height) = (0, 100.0, 80150.0, 1.2, f64::NAN);
        let found = Report { radar, time, range, azimuth, height, place: None }
            .corrected(&[150.0, 5e-4, 0.002, 0.1, 1e-3, 2e-3, 3e-3, 4e-3]);
        close(found.time, 99.9);
        close(found.range, 79960.01999001);
        let deviation = 1e-3 * 1.2_f64.sin() + 2e-3 * 1.2_f64.cos();
        close(found.azimuth, 1.198 - deviation - 3e-3 * 2.4_f64.sin() - 4e-3 * 2.4_f64.cos());
    }

    #[test]
    fn a_plot_and_what_errors_do_to_it() {
        let radar = radar([6e4, 0.0, 100.0], 70.0, 0.12);
        let plot =
            Report { radar: 1, time: 0.0, range: 5e4, azimuth: 5.5, height: 8e3, place: None };
        let seen = Sighting::new(&plot, plot.height, &radar, [1.0; 2]).unwrap();
        close(seen.position[0], 25166.09437027);
        close(seen.position[1], 34988.41263303);
        close(seen.sigma[0], 70.93106640067);
        close(seen.sigma[1], 103.4043820091);
        let design = seen.design(Vector2::new(150.0, -120.0));
        let expected = [
            [101.2720670875, 27.34127081195, 0.0, 19.08714217505],
            [0.0, 0.0, 86.17031834094, -2.163562707524],
        ];
        for (row, expected) in design.iter().zip(expected) {
            for ((metres, prior), expected) in row.iter().zip(PRIOR).zip(expected) {
                close(metres * prior, expected);
            }
        }
        let harmonics = [5.5_f64.sin(), 5.5_f64.cos(), 11_f64.sin(), 11_f64.cos()];
        for (j, harmonic) in harmonics.into_iter().enumerate() {
            assert_eq!(design[0][KINDS + j], 0.0);
            close(design[1][KINDS + j], harmonic * design[1][AZIMUTH]);
        }
        assert!(Sighting::new(&plot, 51e3, &radar, [1.0; 2]).is_none());
    }

    #[test]
    fn a_reported_position() {
        let radar = radar([0.0; 3], 30.0, 0.1);
        let position = [4e3, -2e3];
        let report = |covariance| Report {
            radar: 0,
            time: 0.0,
            range: f64::NAN,
            azimuth: f64::NAN,
            height: f64::NAN,
            place: Some(Place { position, covariance }),
        };
        let seen =
            Sighting::new(&report([500.0, 200.0, 300.0]), f64::NAN, &radar, [7.0; 2]).unwrap();
        assert_eq!(seen.position, Vector2::from(position));
        assert_eq!(seen.noise([1.0, 1.0]), seen.sigma);
        let [u, v] = seen.axes;
        let [a, b] = seen.sigma.map(|sigma| sigma * sigma);
        close(a * u[0] * u[0] + b * v[0] * v[0], 500.0);
        close(a * u[0] * u[1] + b * v[0] * v[1], 200.0);
        close(a * u[1] * u[1] + b * v[1] * v[1], 300.0);
        let stated = Sighting::new(&report([f64::NAN; 3]), f64::NAN, &radar, [1.0; 2]).unwrap();
        close(stated.sigma[0], 30.0);
        close(stated.sigma[1], 30.0);
        // its errors are those of east, north and clock
        let errors = [120.0, 0.0, -50.0, 0.3, 0.0, 0.0, 0.0, 0.0];
        let moved = report([500.0, 200.0, 300.0]).corrected(&errors);
        assert_eq!(moved.place.map(|place| place.position), Some([3880.0, -1950.0]));
        close(moved.time, -0.3);
        let velocity = Vector2::new(200.0, -10.0);
        let by = seen.design(velocity).map(|row| row.iter().zip(errors).map(|(d, e)| d * e).sum());
        let [along, across]: [f64; 2] = by;
        close(along * u[0] + across * v[0], 120.0 - 60.0);
        close(along * u[1] + across * v[1], -50.0 + 3.0);
    }
}

//! Converts plots of a sensor to positions in the plane, with and without heights.

use crate::base::plane::Plane;
use crate::geo::View;
use crate::sensors::{HEIGHT_SIGMA, LEAST_ACROSS, Radar};
use serde::{Deserialize, Serialize};

/// Largest sine of the elevation at which a plot without a height is placed: a target that would be seen at a
/// steeper elevation is lower than assumed.
const STEEPEST: f64 = 0.95;
/// A target whose height exceeds its range is straight above the radar if the excess is less than this number
/// of sigmas of the range.
const OVERHEAD_SIGMAS: f64 = 3.0;

/// How positions follow from the measurements of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // one per sensor
pub enum Geometry {
    /// A plane. Ranges without heights are horizontal until the height of any target is known.
    #[default]
    Flat,
    /// A plane with heights: all ranges are slant ranges.
    Space,
    /// The earth as seen from the sensor, and the largest slant range, m.
    Earth(View, f64),
    /// Positions and velocities. The numbers are the standard deviations of positions (m) and of velocities
    /// (m/s) that come without a covariance; nan if there is none.
    Position([f64; 2]),
    /// Azimuths alone, with this standard deviation (rad), from the position that comes with each azimuth.
    Azimuth(f64),
}

/// Range and azimuth of a plot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Polar {
    pub range: f64,
    azimuth: f64,
    /// Sine and cosine of the azimuth: a plot is placed once for each track near it.
    direction: [f64; 2],
}

impl Polar {
    pub fn new(range: f64, azimuth: f64) -> Self {
        Self { range, azimuth, direction: azimuth.sin_cos().into() }
    }
}

/// A plot in the plane.
#[derive(Clone, Copy, Debug)]
pub(in crate::tracker) struct Sighted {
    pub position: [f64; 2],
    /// Covariance of the position at this height.
    pub noise: Plane,
    /// Derivative of the position with respect to the height.
    pub by_height: [f64; 2],
}

impl Geometry {
    /// Whether ranges without heights are slant ranges; `known` says whether heights of other plots are
    /// known.
    pub(in crate::tracker) fn is_slant(&self, known: bool) -> bool {
        known || !matches!(self, Self::Flat)
    }

    /// Whether the sensor reports positions, which may come at any time.
    #[inline]
    pub(in crate::tracker) fn is_position(&self) -> bool {
        matches!(self, Self::Position(_))
    }

    /// Whether the sensor measures azimuths alone.
    pub(in crate::tracker) fn is_azimuth(&self) -> bool {
        matches!(self, Self::Azimuth(_))
    }

    /// Standard deviation of the azimuths of a sensor that measures azimuths alone, rad.
    pub(in crate::tracker) fn azimuth_sigma(&self) -> Option<f64> {
        if let Self::Azimuth(sigma) = self { Some(*sigma) } else { None }
    }

    /// Height of the sensor, m.
    pub(in crate::tracker) fn site(&self, radar: &Radar) -> f64 {
        match self {
            Self::Earth(view, _) => view.site().height,
            _ => radar.position[2],
        }
    }

    /// Largest range of its plots, m.
    pub(in crate::tracker) fn max_range(&self, radar: &Radar) -> f64 {
        match self {
            Self::Earth(_, limit) => *limit,
            _ => radar.max_range,
        }
    }

    /// Whether the target is straight above the sensor.
    pub(in crate::tracker) fn is_above(&self, radar: &Radar, range: f64, height: f64) -> bool {
        match self {
            Self::Earth(..) => {
                let excess = (height - self.site(radar)).abs() - range;
                excess >= 0.0 && excess < OVERHEAD_SIGMAS * radar.range_sigma
            }
            _ => radar.ground_squared(range, height).is_none(),
        }
    }

    /// Places a plot whose height is known; the covariance includes the error of the height. None if no
    /// elevation leads to this height.
    pub(in crate::tracker) fn see(
        &self,
        radar: &Radar,
        polar: &Polar,
        height: f64,
    ) -> Option<Sighted> {
        let mut sighted = self.seen(radar, polar, height)?;
        let [u, v] = sighted.by_height.map(|slope| slope * HEIGHT_SIGMA);
        sighted.noise = sighted.noise.plus(Plane { xx: u * u, xy: u * v, yy: v * v });
        Some(sighted)
    }

    /// Places a plot as if its target were at this height, or as near to it as the range allows.
    pub(in crate::tracker) fn placed(&self, radar: &Radar, polar: &Polar, height: f64) -> Sighted {
        let site = self.site(radar);
        let most = STEEPEST * polar.range;
        let height = site + (height - site).clamp(-most, most);
        self.seen(radar, polar, height).unwrap_or_else(|| flat(radar, polar, height))
    }

    fn seen(&self, radar: &Radar, polar: &Polar, height: f64) -> Option<Sighted> {
        let Self::Earth(view, _) = self else { return Some(flat(radar, polar, height)) };
        let seen = view.see(polar.range, polar.azimuth, height)?;
        // sine and cosine of a noisy azimuth are smaller by exp(-σ²/2) on average
        let (stretch, origin) = (radar.stretch(), view.origin());
        let position =
            std::array::from_fn(|i| origin[i] + stretch * (seen.position[i] - origin[i]));
        let noise = seen.covariance([radar.range_sigma, radar.azimuth_sigma, 0.0]);
        Some(Sighted { position, noise, by_height: seen.by[2] })
    }
}

/// Places a plot in a plane, with a height that is less than its range.
fn flat(radar: &Radar, polar: &Polar, height: f64) -> Sighted {
    let &Polar { range, direction: [sine, cosine], .. } = polar;
    let up = height - radar.position[2];
    let squared = (range * range - up * up).max(f64::MIN_POSITIVE);
    let ground = squared.sqrt();
    let along = (radar.range_sigma * range / ground).powi(2);
    let across = (radar.azimuth_sigma * ground).powi(2).max(LEAST_ACROSS * along);
    let far = ground * radar.stretch();
    Sighted {
        position: [radar.position[0] + far * sine, radar.position[1] + far * cosine],
        noise: Plane {
            xx: along * sine * sine + across * cosine * cosine,
            xy: (along - across) * sine * cosine,
            yy: along * cosine * cosine + across * sine * sine,
        },
        by_height: [-up / ground * sine, -up / ground * cosine],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_within;
    use crate::sensors::radar_of;

    #[test]
    fn noise_of_a_plot_at_the_radar_is_regular() {
        let noise = flat(&radar_of([600.0, 3e-5]), &Polar::new(1.0, 2.5), 0.95).noise;
        assert_within(1e-4, noise.determinant() / (noise.xx + noise.yy).powi(2), LEAST_ACROSS);
    }
}

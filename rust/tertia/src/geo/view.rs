//! Plots of a radar on the earth in the system plane: the interface to a tracker.
//!
//! ```
//! use tertia::geo::{Geodetic, LocalFrame, SystemPlane, View};
//! let at = |latitude: f64, longitude: f64, height| Geodetic {
//!     latitude: latitude.to_radians(),
//!     longitude: longitude.to_radians(),
//!     height,
//! };
//! let view = View::new(LocalFrame::new(at(50.1, 14.26, 380.0)), SystemPlane::new(at(50.0, 14.0, 0.0)));
//! // a plot with a height: its position, and the covariance of 75 m, 1.5 mrad and 15 m
//! let seen = view.see(100e3, 1.05, 10_500.0).unwrap();
//! let r = seen.covariance([75.0, 1.5e-3, 15.0]);
//! assert!((r.xx + r.yy).sqrt() < 175.0);
//! // a plot without a height gets one that is known only to 3 km: 280 m more along the range
//! let r = seen.covariance([75.0, 1.5e-3, 3e3]);
//! assert!((r.xx + r.yy).sqrt() > 250.0);
//! ```

use super::ellipsoid::Geodetic;
use super::local::LocalFrame;
use super::plane::SystemPlane;
use crate::base::plane::Plane;
use serde::{Deserialize, Serialize};

/// The site of a radar, and the plane to which its plots are converted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    site: LocalFrame,
    plane: SystemPlane,
    /// Position of the site in the plane.
    origin: [f64; 2],
}

/// A plot in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// u and v, m.
    pub position: [f64; 2],
    /// Derivatives of u and v by range, azimuth (per radian) and height. The last one is the displacement of
    /// the plot per metre of a height that becomes known later: about −tan e along the range.
    pub by: [[f64; 2]; 3],
    /// Sine and cosine of the elevation, relative to the horizon of the site.
    pub elevation: [f64; 2],
}

impl View {
    /// Creates the view of a site.
    pub fn new(site: LocalFrame, plane: SystemPlane) -> Self {
        let [u, v, _] = plane.from_ecef(&site.origin);
        Self { site, plane, origin: [u, v] }
    }

    /// Returns the place of the site.
    pub fn site(&self) -> Geodetic {
        self.site.place()
    }

    /// Returns the position of the site in the plane, u and v.
    pub fn origin(&self) -> [f64; 2] {
        self.origin
    }

    /// Converts a plot of slant range, azimuth and height above the ellipsoid to the plane. Returns `None`,
    /// instead of a clamped position, if there is no elevation for this height or directly above the radar.
    /// O(1).
    #[inline]
    pub fn see(&self, range: f64, azimuth: f64, height: f64) -> Option<Seen> {
        let sight = self.site.sight(range, azimuth, height)?;
        let derivatives = sight.derivatives(range, &self.site)?;
        let projected = self.plane.projected(&sight.position);
        Some(Seen {
            position: projected.position,
            by: derivatives.map(|v| projected.along(&self.plane, &v)),
            elevation: sight.elevation,
        })
    }

    /// Converts a plot to the range and azimuth that a radar in a flat plane, at the u, v and height of
    /// the site, would measure at the same position. With a height, the range is the slant range,
    /// relative to the height of the site; without a height (nan), it is the range in the plane, and the
    /// target is assumed at the height `level`. `None` as for [`View::see`].
    #[inline]
    pub fn flattened(&self, plot: [f64; 3], level: f64) -> Option<[f64; 2]> {
        let [range, azimuth, height] = plot;
        let known = height.is_finite();
        let sight = self.site.sight(range, azimuth, if known { height } else { level })?;
        let [u, v] = self.plane.projected(&sight.position).position;
        let [x, y] = [u - self.origin[0], v - self.origin[1]];
        let up = if known { height - self.site.place.height } else { 0.0 };
        Some([(x * x + y * y + up * up).sqrt(), x.atan2(y)])
    }
}

impl Seen {
    /// Covariance of the position, `J diag(σ²) J'`, for these standard deviations of range, azimuth and
    /// height.
    #[inline]
    pub fn covariance(&self, sigmas: [f64; 3]) -> Plane {
        let mut r = Plane { xx: 0.0, xy: 0.0, yy: 0.0 };
        for (by, sigma) in self.by.iter().zip(sigmas) {
            let [u, v] = by.map(|slope| slope * sigma);
            r = r.plus(Plane { xx: u * u, xy: u * v, yy: v * v });
        }
        r
    }
}

#[cfg(test)]
mod tests {
    use super::super::ellipsoid;
    use super::*;

    fn degrees(latitude: f64, longitude: f64, height: f64) -> Geodetic {
        Geodetic { latitude: latitude.to_radians(), longitude: longitude.to_radians(), height }
    }

    #[test]
    fn three_radars_see_one_aircraft_at_one_place() {
        let plane = SystemPlane::new(degrees(50.0, 14.0, 0.0));
        let views = [(50.0, 14.0, 300.0), (51.2, 15.0, 600.0), (48.0, 12.5, 450.0)]
            .map(|(a, b, c)| View::new(LocalFrame::new(degrees(a, b, c)), plane));
        for (latitude, longitude) in [(50.5, 15.0), (52.0, 12.0), (48.5, 16.0)] {
            let place = degrees(latitude, longitude, 10e3);
            let [u, v, _] = plane.from_ecef(&ellipsoid::to_ecef(&place));
            for view in views {
                let [range, azimuth, _] = view.site.geodetic_to_polar(&place);
                let seen = view.see(range, azimuth, 10e3).unwrap();
                let off = (seen.position[0] - u).hypot(seen.position[1] - v);
                assert!(off < 1e-6, "{off:e}");
                let [flat, turned] = view.flattened([range, azimuth, 10e3], f64::NAN).unwrap();
                let ground = (flat * flat - (10e3 - view.site.place.height).powi(2)).sqrt();
                let back = [ground * turned.sin(), ground * turned.cos()];
                let again = (0..2).map(|i| back[i] + view.origin[i] - seen.position[i]);
                assert!(again.map(f64::abs).sum::<f64>() < 1e-6);
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let plane = SystemPlane::new(degrees(50.0, 14.0, 0.0));
        let view = View::new(LocalFrame::new(degrees(50.1, 14.26, 380.0)), plane);
        for range in [1.5e4, 6e4, 4e5] {
            let at = [range, 1.0, 10_500.0];
            let seen = view.see(at[0], at[1], at[2]).unwrap();
            for (k, step) in [1.0, 1e-5, 1.0].into_iter().enumerate() {
                let moved = |sign: f64| {
                    let mut plot = at;
                    plot[k] += sign * step;
                    view.see(plot[0], plot[1], plot[2]).unwrap().position
                };
                let (high, low) = (moved(1.0), moved(-1.0));
                for i in 0..2 {
                    let slope = (high[i] - low[i]) / (2.0 * step);
                    let size = seen.by[k][0].hypot(seen.by[k][1]).max(1.0);
                    assert!((slope - seen.by[k][i]).abs() < 1e-6 * size, "{range} {k} {i}");
                }
            }
        }
    }
}

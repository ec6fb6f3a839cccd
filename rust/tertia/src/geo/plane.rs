//! The system plane: the oblique stereographic projection that is common in air traffic control
//! (TransLib, ARTAS) and is used by system tracks of category 62, item 100.
//!
//! It is not EPSG 9809 (`sterea`), from which it differs by 0.4 to 0.9 m at 180 to 450 km, nor Snyder's
//! ellipsoidal form (`stere`), from which it differs by 9 to 51 m.

use super::ellipsoid::{self, Geodetic, radii, vertical};
use super::local::LocalFrame;
use crate::base::small::{Matrix, Vector, dot, rotated, rotated_back};
use serde::{Deserialize, Serialize};

/// Number of iterations from a height above the ellipsoid to the one above the sphere, for 1e-9 m.
const ROUNDS: usize = 3;

/// A plane with a sphere of the meridional radius R that touches the ellipsoid at the centre of the plane.
/// With x, y, z in the tangent frame of the centre, whose height is `h_c`:
///
/// `H = √(x² + y² + (z + h_c + R)²) − R`, `k = 2R / (2R + h_c + z + H)`, `u = k x`, `v = k y`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SystemPlane {
    pub(super) centre: LocalFrame,
    radius: f64,
}

/// Projection of a point, and its derivatives by x, y, z of the tangent frame.
#[derive(Clone, Copy)]
pub(super) struct Projected {
    pub position: [f64; 2],
    pub slope: [Vector<3>; 2],
}

impl SystemPlane {
    /// Creates the plane with its centre at a place.
    pub fn new(centre: Geodetic) -> Self {
        let [radius, _] = radii(centre.latitude);
        Self { centre: LocalFrame::new(centre), radius }
    }

    /// Returns the centre.
    pub fn centre(&self) -> Geodetic {
        self.centre.place
    }

    /// Converts a geocentric position to u, v and the height above the sphere, which differs from that above
    /// the ellipsoid.
    pub fn from_ecef(&self, p: &[f64; 3]) -> [f64; 3] {
        let local = self.centre.from_ecef(p);
        let (scale, height) = self.scale(&local);
        [scale * local[0], scale * local[1], height]
    }

    /// Converts u, v and a height above the sphere to a geocentric position.
    pub fn to_ecef(&self, [u, v, height]: [f64; 3]) -> [f64; 3] {
        let (r, own) = (self.radius, self.centre.place.height);
        let d = u * u + v * v;
        // z = (H + R)(4R² − d) / (4R² + d) − (R + h_c), without the cancellation of R
        let z = height - own - (height + r) * 2.0 * d / (4.0 * r * r + d);
        let k = 2.0 * r / (2.0 * r + own + z + height);
        self.centre.to_ecef(&[u / k, v / k, z])
    }

    /// Converts u, v and a height above the ellipsoid to a geocentric position.
    pub fn lifted(&self, u: f64, v: f64, height: f64) -> [f64; 3] {
        let mut above = height;
        for _ in 0..ROUNDS {
            above += height - vertical(&self.to_ecef([u, v, above])).0;
        }
        self.to_ecef([u, v, above])
    }

    /// Scale of lengths on the ground, and azimuth of true north in the plane, which must be
    /// subtracted from courses in the plane.
    pub fn scale_and_convergence(&self, u: f64, v: f64, height: f64) -> [f64; 2] {
        let p = self.lifted(u, v, height);
        let place = ellipsoid::from_ecef(&p);
        let [east, north, _] = ellipsoid::axes(place.latitude, place.longitude);
        let slope = self.projected(&p).slope.map(|row| rotated_back(&self.centre.axes, &row));
        let [ue, un] = [dot(&slope[0], &east), dot(&slope[0], &north)];
        let [ve, vn] = [dot(&slope[1], &east), dot(&slope[1], &north)];
        [(ue * vn - un * ve).abs().sqrt(), un.atan2(vn)]
    }

    #[inline]
    fn scale(&self, local: &Vector<3>) -> (f64, f64) {
        let (r, own) = (self.radius, self.centre.place.height);
        let [x, y, z] = *local;
        let height = (x * x + y * y + (z + own + r) * (z + own + r)).sqrt() - r;
        (2.0 * r / (2.0 * r + own + z + height), height)
    }

    /// The projection with its derivatives, in the tangent frame:
    /// `du = k dx + x dk`, `dk = −k²/2R (dz + dH)`, `dH = (x dx + y dy + (z + h_c + R) dz)/(H + R)`.
    #[inline]
    pub(super) fn projected(&self, p: &Vector<3>) -> Projected {
        let local = self.centre.from_ecef(p);
        let (k, height) = self.scale(&local);
        let r = self.radius;
        let share = 1.0 / (height + r);
        let up = [
            local[0] * share,
            local[1] * share,
            (local[2] + self.centre.place.height + r) * share + 1.0,
        ];
        let fall = -k * k / (2.0 * r);
        let row = |i: usize| {
            let mut row = up.map(|slope| local[i] * fall * slope);
            row[i] += k;
            row
        };
        Projected { position: [k * local[0], k * local[1]], slope: [row(0), row(1)] }
    }

    /// Derivatives of u, v and the height above the ellipsoid by the geocentric position, as rows.
    pub(super) fn jacobian(&self, p: &Vector<3>) -> Matrix<3> {
        let [u, v] = self.projected(p).slope.map(|row| rotated_back(&self.centre.axes, &row));
        [u, v, vertical(p).1]
    }
}

impl Projected {
    /// Derivative of u and v along a geocentric vector.
    #[inline]
    pub fn along(&self, plane: &SystemPlane, v: &Vector<3>) -> [f64; 2] {
        let local = rotated(&plane.centre.axes, v);
        [dot(&self.slope[0], &local), dot(&self.slope[1], &local)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(latitude: f64, longitude: f64, height: f64) -> Geodetic {
        Geodetic { latitude: latitude.to_radians(), longitude: longitude.to_radians(), height }
    }

    /// Values of the prototype.
    #[test]
    fn places_in_the_plane() {
        let plane = SystemPlane::new(degrees(50.0, 14.0, 0.0));
        for (place, expected) in [
            (
                degrees(51.0, 16.0, 10e3),
                [140_394.213_510_926, 113_132.460_435_449, 10_004.441_431_968],
            ),
            (
                degrees(53.0, 18.0, 11e3),
                [268_640.156_403_309, 341_193.341_194_583, 11_018.278_479_594],
            ),
            (
                degrees(47.0, 10.0, 0.0),
                [-304_347.913_665_790, -325_713.026_755_534, 17.481_261_087],
            ),
        ] {
            let p = ellipsoid::to_ecef(&place);
            let found = plane.from_ecef(&p);
            for i in 0..3 {
                assert!((found[i] - expected[i]).abs() < 2e-9, "{found:?} {expected:?}");
            }
            let (back, lifted) =
                (plane.to_ecef(found), plane.lifted(found[0], found[1], place.height));
            for i in 0..3 {
                assert!((back[i] - p[i]).abs() < 5e-9 && (lifted[i] - p[i]).abs() < 5e-9);
            }
        }
    }

    #[test]
    fn scale_and_north_are_those_of_differences() {
        let plane = SystemPlane::new(degrees(50.0, 14.0, 300.0));
        for (latitude, longitude, height) in [(50.0, 14.0, 300.0), (51.5, 18.0, 10e3)] {
            let place = degrees(latitude, longitude, height);
            let at = |place: &Geodetic| plane.from_ecef(&ellipsoid::to_ecef(place));
            let [u, v, _] = at(&place);
            let step = 1e-6;
            let north = Geodetic { latitude: place.latitude + step, ..place };
            let [un, vn, _] = at(&north);
            let [scale, convergence] = plane.scale_and_convergence(u, v, height);
            let length = step * (radii(place.latitude)[0] + height);
            assert!(((un - u).hypot(vn - v) / length - scale).abs() < 2e-6);
            assert!(((un - u).atan2(vn - v) - convergence).abs() < 1e-6);
        }
    }
}

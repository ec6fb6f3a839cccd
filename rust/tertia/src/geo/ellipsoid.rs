//! The ellipsoid of WGS 84: geodetic and geocentric coordinates.

use crate::base::small::{Matrix, Vector};
use serde::{Deserialize, Serialize};

/// Equatorial radius, m, and flattening.
pub const RADIUS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Squares of the first and the second eccentricity, and the polar radius, m.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);
const E2_SECOND: f64 = E2 / (1.0 - E2);
const POLAR: f64 = RADIUS * (1.0 - FLATTENING);
/// Numbers of iterations. Five give the latitude to 1e-15 from any point; near the earth, one has an error of
/// 1e-11, which changes the height by a share of 1e-15.
const ROUNDS: usize = 5;
const ROUNDS_TO_HEIGHT: usize = 1;

/// A place on or above the earth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Latitude, rad.
    pub latitude: f64,
    /// Longitude, rad.
    pub longitude: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
}

/// Direction of the normal to the ellipsoid through a point: sine and cosine of the latitude.
#[derive(Clone, Copy)]
struct Foot {
    sine: f64,
    cosine: f64,
    /// Distance of the point from the axis of the earth.
    level: f64,
}

/// Radii of curvature, m, in the meridian and across it.
pub fn radii(latitude: f64) -> [f64; 2] {
    let squeezed = 1.0 - E2 * latitude.sin().powi(2);
    let across = RADIUS / squeezed.sqrt();
    [across * (1.0 - E2) / squeezed, across]
}

/// East, north and up at a place, as rows, in geocentric coordinates.
pub(crate) fn axes(latitude: f64, longitude: f64) -> Matrix<3> {
    let (sp, cp) = latitude.sin_cos();
    let (sl, cl) = longitude.sin_cos();
    [[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]]
}

/// Converts a place to geocentric x, y, z.
pub fn to_ecef(place: &Geodetic) -> [f64; 3] {
    let (sp, cp) = place.latitude.sin_cos();
    let (sl, cl) = place.longitude.sin_cos();
    // N = a / √(1 − e² sin² φ)
    let across = RADIUS / (1.0 - E2 * sp * sp).sqrt();
    let level = (across + place.height) * cp;
    [level * cl, level * sl, (across * (1.0 - E2) + place.height) * sp]
}

/// Converts geocentric x, y, z to a place, to 4e-9 m; the centre of the earth is below the equator. By
/// Bowring's initial value and iterations with the reduced latitude (Bowring 1976).
pub fn from_ecef(p: &[f64; 3]) -> Geodetic {
    let foot = foot(p, ROUNDS);
    Geodetic {
        latitude: foot.sine.atan2(foot.cosine),
        longitude: p[1].atan2(p[0]),
        height: foot.height(p[2]),
    }
}

/// Height above the ellipsoid and vertical direction of a point near the earth.
#[inline]
pub(crate) fn vertical(p: &Vector<3>) -> (f64, Vector<3>) {
    let foot = foot(p, ROUNDS_TO_HEIGHT);
    let share = if foot.level > 0.0 { foot.cosine / foot.level } else { 0.0 };
    (foot.height(p[2]), [share * p[0], share * p[1], foot.sine])
}

#[inline]
fn foot(p: &Vector<3>, rounds: usize) -> Foot {
    let level = (p[0] * p[0] + p[1] * p[1]).sqrt();
    let distance = (level * level + p[2] * p[2]).sqrt();
    if distance == 0.0 {
        return Foot { sine: 0.0, cosine: 1.0, level };
    }
    // tan β = (b z / a r) (1 + e'² b / |p|); sine and cosine of β apart from a common factor
    let mut up = POLAR * p[2] * (1.0 + E2_SECOND * POLAR / distance);
    let mut out = RADIUS * level;
    let (mut sine, mut cosine) = (0.0, 1.0);
    for _ in 0..rounds {
        let scale = 1.0 / (up * up + out * out).sqrt();
        let (s, c) = (up * scale, out * scale);
        // tan φ = (z + e'² b sin³ β) / (r − e² a cos³ β)
        sine = p[2] + E2_SECOND * POLAR * s * s * s;
        cosine = level - E2 * RADIUS * c * c * c;
        (up, out) = ((1.0 - FLATTENING) * sine, cosine);
    }
    let scale = 1.0 / (sine * sine + cosine * cosine).sqrt();
    Foot { sine: sine * scale, cosine: cosine * scale, level }
}

impl Foot {
    /// Height `h = r cos φ + z sin φ − a² / N`; its error is of second order in the error of φ.
    #[inline]
    fn height(&self, z: f64) -> f64 {
        let squeezed = (1.0 - E2 * self.sine * self.sine).sqrt();
        self.level * self.cosine + z * self.sine - RADIUS * squeezed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_from_anywhere() {
        for latitude in [-90.0_f64, -89.999, -45.0, -1e-9, 0.0, 30.0, 78.2, 90.0] {
            for height in [-1e4, 0.0, 1.1e4, 1e6, 3.6e7] {
                let place = Geodetic { latitude: latitude.to_radians(), longitude: 2.5, height };
                let p = to_ecef(&place);
                let found = from_ecef(&p);
                let again = to_ecef(&found);
                let off = (0..3).map(|i| (p[i] - again[i]).powi(2)).sum::<f64>().sqrt();
                assert!(off < 1e-8 * (1.0 + height.abs() / 1e7), "{latitude} {height}: {off:e}");
                assert!((found.height - height).abs() < 4e-9 * (1.0 + height.abs() / 1e6));
                let (near, up) = vertical(&p);
                assert!((near - height).abs() < 4e-9 * (1.0 + height.abs() / 1e6) || height > 1e5);
                let [.., third] = axes(found.latitude, found.longitude);
                assert!((0..3).all(|i| (third[i] - up[i]).abs() < 1e-9));
            }
        }
        assert!(from_ecef(&[0.0; 3]).height.is_finite());
    }

    #[test]
    fn radii_at_the_equator_and_the_pole() {
        let [meridian, across] = radii(0.0);
        assert!((meridian - POLAR * POLAR / RADIUS).abs() < 1e-6 && (across - RADIUS).abs() < 1e-6);
        let [meridian, across] = radii(std::f64::consts::FRAC_PI_2);
        assert!((meridian - across).abs() < 1e-6);
    }
}

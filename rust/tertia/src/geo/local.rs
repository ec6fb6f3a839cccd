//! Local frames of east, north and up, and the measurements of a radar in them.

use super::ellipsoid::{self, Geodetic, radii, vertical};
use crate::base::angle::principal;
use crate::base::small::{Matrix, Vector, dot, norm, rotated, rotated_back};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Number of Newton steps for the elevation; the errors after 0, 1 and 2 steps are 0.22 m, 5e-8 m and 3e-9 m.
const STEPS: usize = 2;
/// Smallest change of the height with the elevation, as a share of the range; directly above the site
/// there is none.
const LEAST_SLOPE: f64 = 1e-4;

/// A frame of east, north and up, tangent to the ellipsoid, at the site of a radar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalFrame {
    pub(super) place: Geodetic,
    /// Geocentric position of the origin, m.
    pub(super) origin: Vector<3>,
    /// East, north and up as rows.
    pub(super) axes: Matrix<3>,
    /// Curvature in the meridian and across it, 1/m.
    curvature: [f64; 2],
}

/// Position of a plot, with the direction from the site.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    /// Geocentric position, m.
    pub position: Vector<3>,
    /// Unit vector from the site to the target, in the axes of the site; below, its derivatives by the
    /// elevation and the azimuth.
    pub along: Vector<3>,
    pub rise: Vector<3>,
    pub turn: Vector<3>,
    /// Vertical direction at the target, geocentric.
    pub up: Vector<3>,
    /// Sine and cosine of the elevation.
    pub elevation: [f64; 2],
}

impl LocalFrame {
    /// Creates the frame at a place.
    pub fn new(place: Geodetic) -> Self {
        let [meridian, across] = radii(place.latitude);
        Self {
            place,
            origin: ellipsoid::to_ecef(&place),
            axes: ellipsoid::axes(place.latitude, place.longitude),
            curvature: [1.0 / meridian, 1.0 / across],
        }
    }

    /// Returns the place of the origin.
    pub fn place(&self) -> Geodetic {
        self.place
    }

    /// Converts a geocentric position to east, north and up.
    #[inline]
    pub fn from_ecef(&self, p: &[f64; 3]) -> [f64; 3] {
        rotated(&self.axes, &std::array::from_fn(|i| p[i] - self.origin[i]))
    }

    /// Converts east, north and up to a geocentric position.
    #[inline]
    pub fn to_ecef(&self, local: &[f64; 3]) -> [f64; 3] {
        let turned = rotated_back(&self.axes, local);
        std::array::from_fn(|i| self.origin[i] + turned[i])
    }

    /// Place of a plot with slant range, azimuth and the height of the target. `None` if there is no
    /// elevation for this height: the range is smaller than the difference of the heights, or
    /// extends beyond the earth.
    pub fn polar_to_geodetic(&self, range: f64, azimuth: f64, height: f64) -> Option<Geodetic> {
        Some(ellipsoid::from_ecef(&self.sight(range, azimuth, height)?.position))
    }

    /// Returns slant range, azimuth in [0, 2π), and elevation of a place.
    pub fn geodetic_to_polar(&self, place: &Geodetic) -> [f64; 3] {
        let local = self.from_ecef(&ellipsoid::to_ecef(place));
        let ground = (local[0] * local[0] + local[1] * local[1]).sqrt();
        [norm(&local), principal(local[0].atan2(local[1]), TAU), local[2].atan2(ground)]
    }

    /// Solves `h(p(e)) = H` for the elevation e, `p(e) = o + ρ (cos e g + sin e U)`,
    /// `g = sin α E + cos α N`.
    #[inline]
    pub(super) fn sight(&self, range: f64, azimuth: f64, height: f64) -> Option<Sight> {
        let (sa, ca) = azimuth.sin_cos();
        let [meridian, across] = self.curvature;
        // Euler's radius 1/R = cos² α / M + sin² α / N
        let radius = 1.0 / (ca * ca * meridian + sa * sa * across);
        let own = self.place.height;
        // sin e = ((R + H)² − (R + h0)² − ρ²) / 2ρ (R + h0)
        let rise = (height - own) * (2.0 * radius + height + own) - range * range;
        let mut sine = rise / (2.0 * range * (radius + own));
        // nan is excluded, too
        if sine.abs() > 1.0 || sine.is_nan() {
            return None;
        }
        let mut cosine = (1.0 - sine * sine).sqrt();
        let mut up = [0.0; 3];
        for _ in 0..STEPS {
            let h;
            (h, up) = vertical(&self.seen(range, [sa, ca], [sine, cosine]));
            // dh/de = ρ u · (cos e U − sin e g)
            let change = rotated(&self.axes, &up);
            let slope = range * (cosine * change[2] - sine * (sa * change[0] + ca * change[1]));
            if slope.abs() <= LEAST_SLOPE * range {
                break;
            }
            let step = (height - h) / slope;
            // rotated by atan(step)
            let (s, c) = (sine + step * cosine, cosine - step * sine);
            let scale = 1.0 / (s * s + c * c).sqrt();
            (sine, cosine) = (s * scale, c * scale);
        }
        Some(Sight {
            position: self.seen(range, [sa, ca], [sine, cosine]),
            along: [cosine * sa, cosine * ca, sine],
            rise: [-sine * sa, -sine * ca, cosine],
            turn: [cosine * ca, -cosine * sa, 0.0],
            // from the last step but one, 5e-8 m away
            up,
            elevation: [sine, cosine],
        })
    }

    #[inline]
    fn seen(&self, range: f64, [sa, ca]: [f64; 2], [sine, cosine]: [f64; 2]) -> Vector<3> {
        self.to_ecef(&[range * cosine * sa, range * cosine * ca, range * sine])
    }
}

impl Sight {
    /// Derivatives of the geocentric position by range, azimuth and height, from
    /// `dp = along dρ + ρ rise de + ρ turn dα` and `up · dp = dH`. `None` directly above the site,
    /// where the height does not change with the elevation.
    #[inline]
    pub fn derivatives(&self, range: f64, site: &LocalFrame) -> Option<[Vector<3>; 3]> {
        let up = rotated(&site.axes, &self.up);
        let slope = dot(&up, &self.rise);
        if slope.abs() <= LEAST_SLOPE {
            return None;
        }
        let held = |v: &Vector<3>| {
            let share = dot(&up, v) / slope;
            std::array::from_fn(|i| v[i] - share * self.rise[i])
        };
        let turned = held(&self.turn).map(|x| range * x);
        let lifted = self.rise.map(|x| x / slope);
        Some([held(&self.along), turned, lifted].map(|v| rotated_back(&site.axes, &v)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn site(latitude: f64, longitude: f64, height: f64) -> LocalFrame {
        LocalFrame::new(Geodetic {
            latitude: latitude.to_radians(),
            longitude: longitude.to_radians(),
            height,
        })
    }

    #[test]
    fn an_overhead_plot_and_one_that_cannot_be() {
        let radar = site(50.1, 14.26, 380.0);
        assert!(radar.polar_to_geodetic(9000.0, 1.0, 10_500.0).is_none());
        assert!(radar.polar_to_geodetic(2e7, 1.0, 10_500.0).is_none());
        assert!(radar.polar_to_geodetic(0.0, 1.0, 10_500.0).is_none());
        assert!(radar.polar_to_geodetic(f64::NAN, 1.0, 0.0).is_none());
        let above = radar.polar_to_geodetic(10_120.0, 1.0, 10_500.0).unwrap();
        assert!((above.height - 10_500.0).abs() < 1e-6);
        let sight = radar.sight(10_120.0, 1.0, 10_500.0).unwrap();
        assert!(sight.derivatives(10_120.0, &radar).is_none());
    }

    #[test]
    fn round_trips_from_15_to_450_km() {
        for (latitude, height) in [(0.0, 0.0), (-33.9, 60.0), (50.1, 380.0), (78.2, 450.0)] {
            let radar = site(latitude, 14.0, height);
            for range in [1.5e4, 6e4, 2e5, 4.5e5] {
                for azimuth in [0.0, 1.0, 2.5, 4.0, 6.0] {
                    let place = radar.polar_to_geodetic(range, azimuth, 1.05e4).unwrap();
                    let [r, a, _] = radar.geodetic_to_polar(&place);
                    assert!((r - range).abs() < 1e-6, "{range} {azimuth}: {r}");
                    let turned = (a - azimuth + PI).rem_euclid(TAU) - PI;
                    assert!(turned.abs() < 1e-12, "{range} {azimuth}: {turned:e}");
                    assert!((place.height - 1.05e4).abs() < 1e-7, "{range} {azimuth}");
                }
            }
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let radar = site(50.1, 14.26, 380.0);
        for range in [1.2e4, 6e4, 4e5] {
            let at = [range, 1.0, 10_500.0];
            let exact = radar.sight(at[0], at[1], at[2]).unwrap();
            let exact = exact.derivatives(range, &radar).unwrap();
            for (k, step) in [1.0, 1e-5, 1.0].into_iter().enumerate() {
                let moved = |sign: f64| {
                    let mut plot = at;
                    plot[k] += sign * step;
                    radar.sight(plot[0], plot[1], plot[2]).unwrap().position
                };
                let (high, low) = (moved(1.0), moved(-1.0));
                for i in 0..3 {
                    let slope = (high[i] - low[i]) / (2.0 * step);
                    let off = (slope - exact[k][i]).abs();
                    assert!(off < 1e-6 * norm(&exact[k]).max(1.0), "{range} {k} {i}: {off:e}");
                }
            }
        }
    }
}

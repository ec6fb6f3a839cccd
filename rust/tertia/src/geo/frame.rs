//! Conversion of positions and states from one frame to another.

use super::ellipsoid::Geodetic;
use super::local::LocalFrame;
use super::plane::SystemPlane;
use crate::base::small::{Matrix, Vector, dot, rotated};

/// Time step for the change of a projection along a path, s: 250 m of flight, small against the earth's
/// radius.
const MOMENT: f64 = 1.0;
/// Number of components of position, of velocity and of acceleration.
const AXES: usize = 3;

/// A frame with three coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Frame {
    /// East, north and up.
    Local(LocalFrame),
    /// u, v and height above the ellipsoid.
    Plane(SystemPlane),
}

impl Frame {
    /// Returns the origin of the frame.
    pub fn origin(&self) -> Geodetic {
        match self {
            Self::Local(frame) => frame.place(),
            Self::Plane(plane) => plane.centre(),
        }
    }

    /// Converts a geocentric position to coordinates.
    pub fn from_ecef(&self, p: &[f64; 3]) -> [f64; 3] {
        match self {
            Self::Local(frame) => frame.from_ecef(p),
            Self::Plane(plane) => {
                let [u, v, _] = plane.from_ecef(p);
                [u, v, super::ellipsoid::from_ecef(p).height]
            }
        }
    }

    /// Converts coordinates to a geocentric position.
    pub fn to_ecef(&self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Local(frame) => frame.to_ecef(&[a, b, c]),
            Self::Plane(plane) => plane.lifted(a, b, c),
        }
    }

    /// Derivatives of the coordinates by the geocentric position, as rows.
    fn jacobian(&self, p: &Vector<3>) -> Matrix<3> {
        match self {
            Self::Local(frame) => frame.axes,
            Self::Plane(plane) => plane.jacobian(p),
        }
    }

    /// `(dJ/dt) v` along a path with this geocentric velocity: the apparent acceleration of a straight path.
    fn bend(&self, p: &Vector<3>, v: &Vector<3>) -> Vector<3> {
        if matches!(self, Self::Local(_)) {
            return [0.0; 3];
        }
        let after = |seconds: f64| {
            rotated(&self.jacobian(&std::array::from_fn(|i| p[i] + seconds * v[i])), v)
        };
        let (later, sooner) = (after(MOMENT), after(-MOMENT));
        std::array::from_fn(|i| (later[i] - sooner[i]) / (2.0 * MOMENT))
    }

    /// Converts a state to another frame: position, optionally velocity and acceleration, with three
    /// components each. Both frames are fixed to the earth, so there is no Coriolis term. Returns
    /// the matrix that transforms each of the three, `J_t J_s^-1`. O(1).
    ///
    /// # Panics
    /// If the number of components is not 3, 6 or 9.
    pub fn transform(&self, target: &Self, state: &mut [f64]) -> Matrix<3> {
        let part = |state: &[f64], k: usize| std::array::from_fn(|i| state[AXES * k + i]);
        let p = self.to_ecef(part(state, 0));
        let back = inverse(&self.jacobian(&p));
        let there = target.jacobian(&p);
        state[..AXES].copy_from_slice(&target.from_ecef(&p));
        if state.len() > AXES {
            let v = rotated(&back, &part(state, 1));
            state[AXES..2 * AXES].copy_from_slice(&rotated(&there, &v));
            if state.len() > 2 * AXES {
                // x'' = J a + (dJ/dt) v
                let (second, bend) = (part(state, 2), self.bend(&p, &v));
                let a = rotated(&back, &std::array::from_fn(|i| second[i] - bend[i]));
                let (a, bend) = (rotated(&there, &a), target.bend(&p, &v));
                for i in 0..AXES {
                    state[2 * AXES + i] = a[i] + bend[i];
                }
            }
        }
        std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..AXES).map(|k| there[i][k] * back[k][j]).sum())
        })
    }

    /// Converts the covariance of such a state with the matrix of [`Frame::transform`]: each block of three
    /// by three is transformed separately. The change of the scale of a plane within the position error is
    /// neglected (1e-8 per second).
    pub fn transform_covariance(turn: &Matrix<3>, covariance: &mut [f64]) {
        let n = covariance.len().isqrt();
        for (first, second) in (0..n * n).step_by(AXES).map(|k| (k / n, k % n)) {
            if first % AXES != 0 {
                continue;
            }
            let block: Matrix<3> = std::array::from_fn(|i| {
                std::array::from_fn(|j| covariance[(first + i) * n + second + j])
            });
            let half = block.map(|row| turn.map(|t| dot(&row, &t)));
            for i in 0..AXES {
                for j in 0..AXES {
                    covariance[(first + i) * n + second + j] =
                        (0..AXES).map(|k| turn[i][k] * half[k][j]).sum();
                }
            }
        }
    }
}

/// Inverts a regular matrix by cross products of its rows.
fn inverse(m: &Matrix<3>) -> Matrix<3> {
    let cross = |a: &Vector<3>, b: &Vector<3>| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let columns = [cross(&m[1], &m[2]), cross(&m[2], &m[0]), cross(&m[0], &m[1])];
    let determinant = dot(&m[0], &columns[0]);
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(latitude: f64, longitude: f64, height: f64) -> Geodetic {
        Geodetic { latitude: latitude.to_radians(), longitude: longitude.to_radians(), height }
    }

    /// Values of the prototype: a state 9 km above the first plane that climbs with 5 m/s.
    #[test]
    fn between_tangent_planes() {
        let source = Frame::Local(LocalFrame::new(degrees(50.1, 14.26, 380.0)));
        let target = Frame::Local(LocalFrame::new(degrees(50.45, 15.3, 250.0)));
        let given = [30e3, 40e3, 9000.0, 120.0, -180.0, 5.0, -1.5, 2.0, 0.0];
        let expected = [
            -43_961.895_993_64,
            1_107.879_350_477,
            9_174.572_409_433,
            117.415_631_581_3,
            -181.688_665_390_7,
            5.272_412_059_725,
            -1.471_904_150_197,
            2.020_760_647_112,
            -0.004_957_793_401_428,
        ];
        let mut state = given;
        source.transform(&target, &mut state);
        assert_near(1e-8, &state, &expected);
        target.transform(&source, &mut state);
        assert_near(1e-8, &state, &given);
    }

    fn assert_near(tolerance: f64, found: &[f64; 9], expected: &[f64; 9]) {
        for i in 0..9 {
            assert!((found[i] - expected[i]).abs() < tolerance, "{i}: {}", found[i]);
        }
    }

    #[test]
    fn into_the_system_plane_as_the_path_goes() {
        let source = Frame::Local(LocalFrame::new(degrees(50.1, 14.26, 380.0)));
        let target = Frame::Plane(SystemPlane::new(degrees(50.0, 14.0, 0.0)));
        let given = [230e3, 140e3, 9000.0, 220.0, -80.0, 5.0, -1.5, 2.0, 0.1];
        let mut state = given;
        let turn = source.transform(&target, &mut state);
        let after = |t: f64| -> [f64; 3] {
            let path =
                std::array::from_fn(|i| given[i] + t * given[3 + i] + 0.5 * t * t * given[6 + i]);
            target.from_ecef(&source.to_ecef(path))
        };
        let (later, now, sooner) = (after(1.0), after(0.0), after(-1.0));
        let (soon, just) = (after(0.05), after(-0.05));
        for i in 0..3 {
            assert!((state[i] - now[i]).abs() < 1e-9);
            assert!((state[3 + i] - (soon[i] - just[i]) / 0.1).abs() < 1e-6);
            assert!((state[6 + i] - (later[i] - 2.0 * now[i] + sooner[i])).abs() < 2e-6);
            let own: Vector<3> = [given[3], given[4], given[5]];
            assert!((dot(&turn[i], &own) - state[3 + i]).abs() < 1e-9);
        }
        let mut again = state;
        target.transform(&source, &mut again);
        assert_near(1e-7, &again, &given);
        let covariance: [f64; 81] = std::array::from_fn(|k| if k % 10 == 0 { 4.0 } else { 0.0 });
        let mut moved = covariance;
        Frame::transform_covariance(&turn, &mut moved);
        let scale = moved[0] / 4.0;
        assert!((scale - 1.0).abs() < 5e-3 && (moved[10] / 4.0 - scale).abs() < 1e-4);
        assert_eq!(moved[3], 0.0);
    }
}

//! What the covariances that a sensor states tell about the gain of its filter.
//!
//! A Kalman filter that states its own covariances P⁺ has the gain `P⁺ H' R⁻¹`, where R is the noise that it assumes,
//! in the units of these covariances. Then a plot moves the velocity by `P_vp P_pp⁻¹` times what it moves the position.
//! If R is c times the noise of the sensor, the covariance before the plot is `M = (P⁺⁻¹ − H' R⁻¹ H)⁻¹`. In a filter
//! of nearly constant velocity, the process noise `Q = M − F P F'`, where P is the covariance of the row before, has
//! `Q_pv = T/2 Q_vv`, whether its acceleration is white or constant during the time T between the rows. This
//! equation determines c.

use super::row::Row;
use crate::base::plane::Plane;
use crate::sensors::Radar;
use nalgebra::{Matrix2, SMatrix};
use serde::{Deserialize, Serialize};

/// Largest ratio that is looked for, and number of halvings.
const LARGEST: f64 = 1e3;
const HALVINGS: usize = 40;
/// Logarithm of the ratios of two rows up to which they agree, and number and share of such rows from which on the
/// ratio is known.
const ALIKE: f64 = 0.02;
const FEWEST: f64 = 20.0;
const MOST: f64 = 0.5;
/// Relative and absolute difference of velocities, m/s, up to which they move as the covariances state.
const RELATIVE: f64 = 0.05;
const ABSOLUTE: f64 = 0.05;

/// Ratios of the noise that a sensor's filter assumes to that of the sensor, over the rows of its tracks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Ratios {
    rows: f64,
    agreed: f64,
    /// Sum of the logarithms of the ratios that agree with those of the rows before.
    sum: f64,
}

impl Ratios {
    /// Adds the ratio of a row and that of the row before.
    fn see(&mut self, last: Option<f64>, ratio: Option<f64>) {
        self.rows += 1.0;
        let (Some(last), Some(ratio)) = (last, ratio) else { return };
        if (ratio / last).ln().abs() < ALIKE {
            self.agreed += 1.0;
            self.sum += ratio.ln();
        }
    }

    /// Adds those of other rows.
    pub fn add(&mut self, other: &Self) {
        self.rows += other.rows;
        self.agreed += other.agreed;
        self.sum += other.sum;
    }

    /// Returns the ratio if the rows agree about it.
    pub fn ratio(&self) -> Option<f64> {
        let is_known = self.agreed >= FEWEST && self.agreed >= MOST * self.rows;
        is_known.then(|| (self.sum / self.agreed).exp())
    }
}

/// Compares the covariances of successive rows of a track.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Covariances {
    last: Row,
    /// Ratio that follows from the last two rows.
    ratio: Option<f64>,
    /// What was found since it was last taken.
    pub found: Ratios,
}

impl Covariances {
    /// Starts with a row.
    pub fn new(row: &Row) -> Self {
        Self { last: *row, ratio: None, found: Ratios::default() }
    }

    /// Compares the covariance of a row with that of the row before, and with its correction.
    pub fn follow(&mut self, row: &Row, correction: [f64; 4], radar: &Radar) {
        let after = row.estimate(radar).covariance;
        let found = if is_moved_as_stated(correction, &after) {
            let before = self.last.estimate(radar).covariance;
            let noise = radar.noise_at([row.state[0], row.state[1]], row.above(radar));
            ratio(&before, &after, row.time - self.last.time, noise)
        } else {
            None
        };
        self.found.see(self.ratio, found);
        (self.ratio, self.last) = (found, *row);
    }
}

/// Whether the correction of a state, position and velocity, is one that its covariance allows by a single plot.
pub(super) fn is_moved_as_stated(correction: [f64; 4], covariance: &SMatrix<f64, 4, 4>) -> bool {
    let [x, y, vx, vy] = correction;
    let Some(inverse) = block(covariance, 0, 0).try_inverse() else { return false };
    let by = block(covariance, 2, 0) * inverse * nalgebra::Vector2::new(x, y);
    (by[0] - vx).hypot(by[1] - vy) <= RELATIVE * vx.hypot(vy) + ABSOLUTE
}

/// Returns the ratio c of the noise that a filter assumes to `noise`, from the covariances of two successive rows
/// with the time t between them; `None` if no ratio satisfies the equation.
fn ratio(
    before: &SMatrix<f64, 4, 4>,
    after: &SMatrix<f64, 4, 4>,
    t: f64,
    noise: Plane,
) -> Option<f64> {
    let noise = Matrix2::new(noise.xx, noise.xy, noise.xy, noise.yy);
    let weight = noise.try_inverse()?;
    let [pp, pv, vv] = [(0, 0), (0, 2), (2, 2)].map(|(i, j)| block(after, i, j));
    let (last_pv, last_vv) = (block(before, 0, 2), block(before, 2, 2));
    let known = pv - last_pv - last_vv * t - (vv - last_vv) * (0.5 * t);
    // decreases with c
    let excess = |c: f64| {
        let gain = (noise * c - pp).try_inverse().map(|inverse| inverse * pv);
        gain.map(|gain| (weight * (known + (pp - pv.transpose() * (0.5 * t)) * gain)).trace())
    };
    // the gain is smaller than one
    let relative = weight * pp;
    let half = 0.5 * relative.trace();
    let mut low = (half + (half * half - relative.determinant()).max(0.0).sqrt()).ln();
    let mut high = LARGEST.ln();
    if !(low < high && excess(high.exp())? < 0.0) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if excess(middle.exp())? > 0.0 { low = middle } else { high = middle }
    }
    Some((0.5 * (low + high)).exp())
}

fn block(matrix: &SMatrix<f64, 4, 4>, i: usize, j: usize) -> Matrix2<f64> {
    matrix.fixed_view::<2, 2>(i, j).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ratio that is found from the covariances of a filter, times `scale`, whose gaps differ.
    fn found(density: f64, is_white: bool, scale: f64) -> Vec<f64> {
        let noise = Plane { xx: 900.0, xy: 200.0, yy: 2500.0 };
        let r = Matrix2::new(noise.xx, noise.xy, noise.xy, noise.yy);
        let mut p = SMatrix::<f64, 4, 4>::identity() * 1e4;
        let mut found = Vec::new();
        for t in [4.0_f64, 4.1, 8.0, 4.0, 3.9, 4.0] {
            let (mut f, mut q) = (SMatrix::<f64, 4, 4>::identity(), SMatrix::<f64, 4, 4>::zeros());
            for k in 0..2 {
                f[(k, k + 2)] = t;
                let (a, b, c) = if is_white {
                    (t * t * t / 3.0, t * t / 2.0, t)
                } else {
                    (t.powi(4) / 4.0, t.powi(3) / 2.0, t * t)
                };
                q[(k, k)] = density * a;
                q[(k, k + 2)] = density * b;
                q[(k + 2, k)] = density * b;
                q[(k + 2, k + 2)] = density * c;
            }
            let last = p;
            let m = f * p * f.transpose() + q;
            let gain = m.fixed_view::<4, 2>(0, 0) * (block(&m, 0, 0) + r).try_inverse().unwrap();
            p = m - gain * m.fixed_view::<2, 4>(0, 0);
            found.push(ratio(&(last * scale), &(p * scale), t, noise).unwrap());
        }
        found
    }

    #[test]
    fn the_ratio_that_covariances_imply() {
        for (density, is_white, scale) in [(1.0, true, 1.0), (0.05, true, 0.5), (4.0, false, 2.0)] {
            let found = found(density, is_white, scale);
            assert!(found.iter().all(|c| (c / scale - 1.0).abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn a_ratio_is_known_if_rows_agree() {
        let (mut same, mut other) = (Ratios::default(), Ratios::default());
        let mut last = None;
        for k in 0..30 {
            let ratio = Some(2.0 + 0.001 * f64::from(k % 2));
            same.see(last, ratio);
            other.see(ratio, Some(if k % 2 == 0 { 1.0 } else { 3.0 }));
            last = ratio;
        }
        assert!((same.ratio().unwrap() - 2.0005).abs() < 1e-3);
        assert_eq!((other.ratio(), Ratios::default().ratio()), (None, None));
    }

    #[test]
    fn velocities_move_as_positions_do() {
        let mut covariance = SMatrix::<f64, 4, 4>::identity() * 100.0;
        for k in 0..2 {
            covariance[(k, k + 2)] = 10.0;
            covariance[(k + 2, k)] = 10.0;
        }
        assert!(is_moved_as_stated([50.0, -20.0, 5.0, -2.0], &covariance));
        assert!(!is_moved_as_stated([50.0, -20.0, 5.0, -3.0], &covariance));
        assert!(!is_moved_as_stated([50.0, -20.0, 5.0, -2.0], &SMatrix::repeat(f64::NAN)));
    }
}

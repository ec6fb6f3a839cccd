//! What later plots say about the state at a step (Bryson, Frazier 1963), computed backwards along a
//! series.

use super::model::Transition;
use super::state::{Innovation, State};

/// If later plots reduce a variance by more than this factor, the difference has lost digits.
const LOSS: f64 = 100.0;

/// The adjoint vector λ and matrix Λ: the state at a step from all plots is `x − P λ` with covariance
/// `P − P Λ P`, where x and P are those of the filter.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Adjoint {
    vector: [f64; 3],
    matrix: [f64; 6],
}

impl Adjoint {
    /// Returns the state from all plots; `None` if too many digits would be lost.
    #[inline(always)]
    pub fn smoothed(&self, filtered: &State) -> Option<State> {
        let [l0, l1, l2] = self.vector;
        let [a00, a01, a02, a11, a12, a22] = self.matrix;
        let [p00, p01, p02, p11, p12, p22] = filtered.covariance;
        // P Λ, row by row
        let row = |x: f64, y: f64, z: f64| {
            [x * a00 + y * a01 + z * a02, x * a01 + y * a11 + z * a12, x * a02 + y * a12 + z * a22]
        };
        let (m0, m1, m2) = (row(p00, p01, p02), row(p01, p11, p12), row(p02, p12, p22));
        let [x0, x1, x2] = filtered.mean;
        let covariance = [
            p00 - (m0[0] * p00 + m0[1] * p01 + m0[2] * p02),
            p01 - (m0[0] * p01 + m0[1] * p11 + m0[2] * p12),
            p02 - (m0[0] * p02 + m0[1] * p12 + m0[2] * p22),
            p11 - (m1[0] * p01 + m1[1] * p11 + m1[2] * p12),
            p12 - (m1[0] * p02 + m1[1] * p12 + m1[2] * p22),
            p22 - (m2[0] * p02 + m2[1] * p12 + m2[2] * p22),
        ];
        let mean = [
            x0 - (p00 * l0 + p01 * l1 + p02 * l2),
            x1 - (p01 * l0 + p11 * l1 + p12 * l2),
            x2 - (p02 * l0 + p12 * l1 + p22 * l2),
        ];
        let kept = |p: f64, smoothed: f64| p <= LOSS * smoothed;
        let all = kept(p00, covariance[0]) && kept(p11, covariance[3]) && kept(p22, covariance[5]);
        all.then_some(State { mean, covariance })
    }

    /// Returns the adjoint of the step before: back from after to before the plot of variance r, if
    /// there was one, and back over the transition. `None` if the plot was needed to start the filter.
    #[inline(always)]
    pub fn before(
        mut self,
        filtered: &State,
        plot: Option<(f64, Innovation)>,
        transition: &Transition,
    ) -> Option<Self> {
        if let Some((r, innovation)) = plot {
            if innovation.variance.is_nan() {
                return None;
            }
            self.before_plot(filtered, innovation, r);
        }
        self.before_step(transition);
        Some(self)
    }

    /// Goes back from after a plot to before it. The gain is the first row of the filtered covariance
    /// over r.
    #[inline(always)]
    fn before_plot(&mut self, filtered: &State, innovation: Innovation, r: f64) {
        let (k1, k2) = (filtered.covariance[1] / r, filtered.covariance[2] / r);
        let s = 1.0 / innovation.variance;
        // (I − K h^T) is the identity except for its first column
        let kept = r * s;
        let [l0, l1, l2] = self.vector;
        self.vector[0] = kept * l0 - k1 * l1 - k2 * l2 - s * innovation.value;
        let [a00, a01, a02, a11, a12, a22] = self.matrix;
        let column = [
            a00 * kept - a01 * k1 - a02 * k2,
            a01 * kept - a11 * k1 - a12 * k2,
            a02 * kept - a12 * k1 - a22 * k2,
        ];
        self.matrix[0] = kept * column[0] - k1 * column[1] - k2 * column[2] + s;
        self.matrix[1] = column[1];
        self.matrix[2] = column[2];
    }

    #[inline(always)]
    fn before_step(&mut self, transition: &Transition) {
        let [f01, f02, f12, f22] = transition.f;
        let [l0, l1, l2] = self.vector;
        self.vector = [l0, f01 * l0 + l1, f02 * l0 + f12 * l1 + f22 * l2];
        let [a00, a01, a02, a11, a12, a22] = self.matrix;
        // Λ F
        let (b01, b11) = (f01 * a00 + a01, f01 * a01 + a11);
        let b02 = f02 * a00 + f12 * a01 + f22 * a02;
        let b12 = f02 * a01 + f12 * a11 + f22 * a12;
        let b22 = f02 * a02 + f12 * a12 + f22 * a22;
        self.matrix =
            [a00, b01, b02, f01 * b01 + b11, f01 * b02 + b12, f02 * b02 + f12 * b12 + f22 * b22];
    }
}

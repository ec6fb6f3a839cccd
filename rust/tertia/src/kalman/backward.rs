//! The state at every step from all plots (Rauch, Tung, Striebel), computed backwards from the filtered
//! states.

use super::factored::Factored;
use super::model::Transition;

type Vector = [f64; 3];
type Matrix = [[f64; 3]; 3];

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    let mut product = [[0.0; 3]; 3];
    for (row, a) in product.iter_mut().zip(a) {
        for (j, value) in row.iter_mut().enumerate() {
            *value = a[0] * b[0][j] + a[1] * b[1][j] + a[2] * b[2][j];
        }
    }
    product
}

fn apply(a: &Matrix, x: &Vector) -> Vector {
    a.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn transposed(a: &Matrix) -> Matrix {
    [0, 1, 2].map(|j| [a[0][j], a[1][j], a[2][j]])
}

/// The filtered state at a step, and the direction in which nothing is known, if there is one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filtered {
    pub factored: Factored,
    pub unknown: Option<Vector>,
}

impl Filtered {
    /// Returns the smoothed state, given the smoothed state of the next step.
    ///
    /// With the gain `C = P F^T (P⁻)^-1`, the state is `x + C (x_next − F x)` and its covariance is
    /// `(I − C F) P (I − C F)^T + C (Q + P_next) C^T`. With `P = U D U^T`, `P⁻ = V E V^T` and
    /// `Z = V^-1 F U`, the gain is `C = U G V^-1` with `G = D Z^T E^-1`, and
    /// `(I − C F) U = U (I − G Z)`, so neither a wide nor a narrow prior costs digits. The sum is
    /// formed from factors, including those of the next step, so that small variances that C transforms
    /// are not lost beside large ones. If a direction e is unknown, C is the limit for `P + κ e e^T`, κ
    /// → ∞, in which `(I − C F) e = 0`.
    pub fn smoothed(&self, transition: &Transition, next: &Factored) -> Factored {
        let [f01, f02, f12, f22] = transition.f;
        let f = [[1.0, f01, f02], [0.0, 1.0, f12], [0.0, 0.0, f22]];
        let factored = self.with_unknown(f01);
        let mut predicted = factored;
        predicted.predict(transition);
        let (u, d) = factored.factors();
        let (v, e) = predicted.factors();
        let columns = transposed(&multiply(&f, &u)).map(|column| solve_upper(&v, column));
        let z = transposed(&columns);
        let mut g = columns;
        for (row, d) in g.iter_mut().zip(d) {
            for (value, e) in row.iter_mut().zip(e) {
                *value *= if e > 0.0 { d / e } else { 0.0 };
            }
        }
        let unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let inverse = transposed(&unit.map(|column| solve_upper(&v, column)));
        let mut c = multiply(&multiply(&u, &g), &inverse);
        let mut kept = multiply(&u, &complement(&multiply(&g, &z)));
        if let Some(direction) = self.unknown {
            let image = apply(&f, &direction);
            let y = predicted.solved(&image);
            let scale = 1.0 / (image[0] * y[0] + image[1] * y[1] + image[2] * y[2]);
            for (row, e) in c.iter_mut().zip(direction) {
                let along = row[0] * image[0] + row[1] * image[1] + row[2] * image[2];
                for (value, y) in row.iter_mut().zip(y) {
                    *value += (e - along) * scale * y;
                }
            }
            kept = multiply(&complement(&multiply(&c, &f)), &u);
        }
        let (x, ahead, later) = (factored.mean(), predicted.mean(), next.mean());
        let step = apply(&c, &[0, 1, 2].map(|i| later[i] - ahead[i]));
        let mean = [0, 1, 2].map(|i| x[i] + step[i]);
        let (noise, later) = (Factored::of_noise(transition).factors(), next.factors());
        let (from_noise, from_later) = (multiply(&c, &noise.0), multiply(&c, &later.0));
        let rows = [0, 1, 2].map(|i| joined(&kept[i], &from_noise[i], &from_later[i]));
        Factored::orthogonalised(mean, rows, &joined(&d, &noise.1, &later.1))
    }

    /// Returns the factors with a finite variance in the unknown direction. Its size is arbitrary,
    /// because the result is replaced by the limit for ∞. `next` is the time to the next step.
    fn with_unknown(&self, next: f64) -> Factored {
        let Some(direction) = self.unknown else { return self.factored };
        let mut state = self.factored.state();
        let t = direction[0] + next;
        let variance = state.covariance[0] / if t > 0.0 { t * t } else { 1.0 };
        state.covariance[0] += variance * direction[0] * direction[0];
        state.covariance[1] += variance * direction[0];
        state.covariance[3] += variance;
        Factored::new(&state)
    }
}

fn joined(a: &Vector, b: &Vector, c: &Vector) -> [f64; 9] {
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
}

/// Returns `I − A`.
fn complement(a: &Matrix) -> Matrix {
    let mut complement = a.map(|row| row.map(|value| -value));
    for (i, row) in complement.iter_mut().enumerate() {
        row[i] += 1.0;
    }
    complement
}

/// Returns the x with `V x = b`, where V is unit upper triangular.
fn solve_upper(v: &Matrix, b: Vector) -> Vector {
    let x1 = b[1] - v[1][2] * b[2];
    [b[0] - v[0][1] * x1 - v[0][2] * b[2], x1, b[2]]
}

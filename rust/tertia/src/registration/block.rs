//! What the plots of one target by several radars in a short time say of the errors of the radars.
//!
//! The target moves with constant acceleration, of which nothing is known but its size. Position,
//! velocity and acceleration are projected out, so that no state of a target is needed. Errors are in
//! units of their prior standard deviations. Cost O(n (6 + q)²) for n plots and q errors.

use super::sighting::{ERRORS, Sighting};
use nalgebra::{DMatrix, DVector, SMatrix, Vector2};

/// Position, velocity and acceleration in two axes.
const MOTION: usize = 6;
/// Plots of which a block is.
const FEWEST: usize = 3;

/// Normal equations of the errors of the radars of one block, about the errors removed before.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Columns of its unknowns among those of all radars.
    pub columns: Vec<usize>,
    /// `Gᵀ M G` and `Gᵀ M y`.
    pub information: DMatrix<f64>,
    pub score: DVector<f64>,
    /// `yᵀ M y`.
    pub square: f64,
    /// Measurements less unknowns of the motion.
    pub free: usize,
    /// `M y` and `M G`, two rows a plot.
    residual: DVector<f64>,
    sensitivity: DMatrix<f64>,
    /// The diagonal of `M`, two numbers a plot.
    pub redundancy: Vec<f64>,
}

/// The columns of the errors that a radar may have, among those of all radars, and their priors.
pub(super) type Unknowns = Vec<[Option<(usize, f64)>; ERRORS]>;

impl Block {
    /// Of sightings in order of time of a target with accelerations of about `acceleration`, m/s².
    /// None where there are too few.
    pub fn new(sightings: &[Sighting], unknowns: &Unknowns, acceleration: f64) -> Option<Self> {
        if sightings.len() < FEWEST {
            return None;
        }
        Self::at_velocity(sightings, unknowns, acceleration, velocity(sightings)?)
    }

    /// As `new`, with the velocity by which an error of a clock counts.
    fn at_velocity(
        sightings: &[Sighting],
        unknowns: &Unknowns,
        acceleration: f64,
        velocity: Vector2<f64>,
    ) -> Option<Self> {
        let n = sightings.len();
        let (first, last) = (sightings[0].time, sightings[n - 1].time);
        let middle = f64::midpoint(first, last);
        let columns = columns_of(sightings, unknowns);
        let q = columns.len();
        let centre = sightings.iter().map(|one| one.position).sum::<Vector2<f64>>() / n as f64;
        // the two last rows are of the acceleration
        let (rows, half) = (2 * n + 2, (0.5 * (last - first)).max(1e-3));
        let mut motion = DMatrix::<f64>::zeros(rows, MOTION);
        let mut right = DMatrix::<f64>::zeros(rows, 1 + q);
        for (i, one) in sightings.iter().enumerate() {
            let t = (one.time - middle) / half;
            for (axis, metres) in one.design(velocity).into_iter().enumerate() {
                let (row, sigma) = (2 * i + axis, one.sigma[axis]);
                for (k, power) in [1.0, t, t * t].into_iter().enumerate() {
                    for side in 0..2 {
                        motion[(row, 3 * side + k)] = one.axes[axis][side] * power / sigma;
                    }
                }
                right[(row, 0)] = one.axes[axis].dot(&(one.position - centre)) / sigma;
                for (unknown, metres) in unknowns[one.radar].iter().zip(metres) {
                    if let Some((column, prior)) = unknown {
                        let own = columns.binary_search(column).ok()?;
                        right[(row, 1 + own)] = metres * prior / sigma;
                    }
                }
            }
        }
        for side in 0..2 {
            // the unknown is half the acceleration, in units of the half time squared
            motion[(2 * n + side, 3 * side + 2)] = 2.0 / (half * half * acceleration);
        }
        let q_of_motion = motion.qr().q();
        right -= &q_of_motion * q_of_motion.tr_mul(&right);
        let redundancy = (0..2 * n).map(|row| 1.0 - q_of_motion.row(row).norm_squared()).collect();
        let (residual, sensitivity) = (right.column(0), right.columns(1, q));
        Some(Self {
            columns,
            information: sensitivity.tr_mul(&sensitivity),
            score: sensitivity.tr_mul(&residual),
            square: residual.norm_squared(),
            free: 2 * n + 2 - MOTION,
            residual: residual.rows(0, 2 * n).into_owned(),
            sensitivity: sensitivity.rows(0, 2 * n).into_owned(),
            redundancy,
        })
    }

    /// The errors that fit best where their covariance is `prior`, and the misfit that they leave.
    pub fn fit(&self, prior: &DMatrix<f64>) -> Option<(DVector<f64>, f64)> {
        let own = prior.select_rows(&self.columns).select_columns(&self.columns);
        // (P⁻¹ + Y)⁻¹ η = P (I + Y P)⁻¹ η, without an inverse of P
        let size = self.columns.len();
        if size == 0 {
            // sensors that are trusted
            return Some((DVector::zeros(0), self.square));
        }
        let sum = DMatrix::identity(size, size) + &self.information * &own;
        let step = &own * sum.lu().solve(&self.score)?;
        let misfit = self.square - self.score.dot(&step);
        Some((step, misfit))
    }

    /// Residuals after a step of the errors, two for each plot, in standard deviations.
    pub fn residuals(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.residual - &self.sensitivity * step
    }
}

/// The columns of the radars of these sightings, in order.
fn columns_of(sightings: &[Sighting], unknowns: &Unknowns) -> Vec<usize> {
    let mut columns: Vec<usize> = sightings
        .iter()
        .flat_map(|one| unknowns[one.radar].iter().flatten().map(|(column, _)| *column))
        .collect();
    columns.sort_unstable();
    columns.dedup();
    columns
}

/// Velocity of a weighted straight line.
fn velocity(sightings: &[Sighting]) -> Option<Vector2<f64>> {
    let mut normal = SMatrix::<f64, 4, 4>::zeros();
    let mut score = SMatrix::<f64, 4, 1>::zeros();
    let centre = sightings[0].position;
    for one in sightings {
        let t = one.time - sightings[0].time;
        for (axis, sigma) in one.axes.iter().zip(one.sigma) {
            let row = SMatrix::<f64, 4, 1>::new(axis[0], axis[1], axis[0] * t, axis[1] * t) / sigma;
            normal += row * row.transpose();
            score += row * (axis.dot(&(one.position - centre)) / sigma);
        }
    }
    let line = normal.cholesky()?.solve(&score);
    Some(Vector2::new(line[2], line[3]))
}

#[cfg(test)]
mod tests {
    use super::super::sighting::tests::{PRIOR, close, radar};
    use super::super::sighting::{Errors, Report};
    use super::*;

    /// Seven plots of two radars.
    fn block() -> Block {
        let radars = [radar([0.0; 3], 50.0, 0.08), radar([6e4, 0.0, 100.0], 70.0, 0.12)];
        let times = [0.0, 1.0, 4.0, 6.0, 8.0, 11.0, 12.0];
        let ranges = [44751.4, 56355.2, 45327.9, 56138.4, 46039.5, 55728.0, 46665.8];
        let azimuths = [0.46465, 5.50317, 0.47379, 5.52167, 0.48464, 5.53636, 0.4955];
        let sightings: Vec<Sighting> = (0..7)
            .map(|i| {
                let (time, range, azimuth) = (times[i], ranges[i], azimuths[i]);
                let plot = Report { radar: i % 2, time, range, azimuth, height: f64::NAN };
                Sighting::new(&plot, f64::NAN, &radars[i % 2], [1.0; 2]).unwrap()
            })
            .collect();
        let unknown = |k: usize| -> [Option<(usize, f64)>; ERRORS] {
            std::array::from_fn(|j| Some((ERRORS * k + j, PRIOR[j])))
        };
        let velocity = Vector2::new(180.0, 90.0);
        Block::at_velocity(&sightings, &vec![unknown(0), unknown(1)], 0.3, velocity).unwrap()
    }

    #[test]
    fn the_normal_equations() {
        let block = block();
        assert_eq!(block.free, 10);
        close(block.square, 11.59048620395);
        let score = [
            -0.6100307274143,
            -0.1480870254507,
            -3.822389829409,
            0.6642946142543,
            -4.335479277698,
            -1.311376141151,
            2.078598216941,
            -0.6642946142543,
        ];
        let first = [
            2.15623874783,
            0.5320854647842,
            -0.5256510146754,
            -0.2733836733516,
            -1.319354207771,
            -0.3994623665031,
            -1.789411431349,
            0.2733836733516,
        ];
        for i in 0..8 {
            close(block.score[i], score[i]);
            close(block.information[(0, i)], first[i]);
            close(block.information[(i, 0)], first[i]);
        }
        close(block.information[(4, 4)], 3.834917047892);
        close(block.redundancy[0], 0.3829102429999);
        close(block.redundancy[13], 0.5457523835922);
    }

    #[test]
    fn the_errors_that_follow() {
        let block = block();
        let (step, misfit) = block.fit(&DMatrix::identity(8, 8)).unwrap();
        let expected: Errors =
            [-25.95962987554, -3.324860671941e-5, -9.948045549001e-4, 0.01252980932538];
        for j in 0..ERRORS {
            close(step[j] * PRIOR[j], expected[j]);
        }
        // what one clock is fast the other is slow
        close(step[3], -step[7]);
        close(block.square - misfit, 6.263994148859);
    }
}

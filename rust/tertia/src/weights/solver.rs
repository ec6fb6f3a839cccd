//! A solver for all quantities that are computed from covariances, with its buffers.

use super::group::Problem;
use super::loss::Loss;
use super::propagation::{Propagation, write_covariance_of_covariance};
use crate::base::error::Result;
use crate::base::matrix::{Square, into_cholesky, read_covariance, with_order, write};
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim};

/// Quantities computed from the covariances of K sensors in m dimensions; `sensor` counts from 0, and the
/// covariance of Ŝ_j is `c_j (S_j ⊗ S_j)(I + K)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity<'a> {
    /// `W_k` of every sensor (K, m, m). Cost O(K m³).
    Weights,
    /// `S_p` (m, m); an error if it is lost to rounding. Cost O(K m³).
    FusedCovariance,
    /// `∂vec W_k / ∂vec S_j` for every j (K, m², m²), (7)–(14); for two sensors and k = 1, these are P1 and
    /// P2. Cost O(K m⁴), which is that of writing the result.
    Jacobian {
        /// k.
        sensor: usize,
    },
    /// The factors B_j, followed by A_j (2, K, m, m), of `dW_k = Σ_j B_j dS_j A_j`. Cost O(K m³).
    JacobianFactors {
        /// k.
        sensor: usize,
    },
    /// Covariance (m², m²) of vec Ŵ_k to first order (10). Cost O(K m⁴).
    WeightCovariance {
        /// k.
        sensor: usize,
        /// c of each sensor.
        c: &'a [f64],
    },
    /// `E Ŵ_k − W_k` (m, m) to second order, if the mean of Ŝ_j is `mean_j S_j`. Cost O(K m³).
    WeightBias {
        /// k.
        sensor: usize,
        /// c of each sensor, relative to the mean.
        c: &'a [f64],
        /// Mean of each sensor.
        mean: &'a [f64],
    },
    /// `S_p`, followed by the excess of the mean squared error over it to first order (2, m, m).
    /// Cost O(K m³).
    Excess {
        /// c of each sensor, relative to the mean.
        c: &'a [f64],
    },
    /// [`Quantity::Excess`] from draws of Wishart matrices with mean I, followed by the loss (the trace
    /// of the excess divided by that of `S_p`) and its standard error (2 m² + 2). Cost O(T K m³).
    SimulatedExcess {
        /// Draws (T, K, m, m).
        draws: &'a [f64],
    },
    /// Covariance (m², m²) of vec Ŝ of a sample covariance (4), for the S (m, m) of one sensor.
    /// Cost O(m⁴).
    CovarianceOfCovariance {
        /// c.
        c: f64,
    },
}

impl Quantity<'_> {
    /// Returns the shape of the result for this number of sensors and dimensions.
    pub fn shape(&self, sensors: usize, m: usize) -> Vec<usize> {
        match self {
            Self::Weights => vec![sensors, m, m],
            Self::FusedCovariance | Self::WeightBias { .. } => vec![m, m],
            Self::Jacobian { .. } => vec![sensors, m * m, m * m],
            Self::JacobianFactors { .. } => vec![2, sensors, m, m],
            Self::WeightCovariance { .. } | Self::CovarianceOfCovariance { .. } => {
                vec![m * m, m * m]
            }
            Self::Excess { .. } => vec![2, m, m],
            Self::SimulatedExcess { .. } => vec![2 * m * m + 2],
        }
    }
}

/// A computation with buffers that are reused from call to call.
pub trait Weighing: Send {
    /// Computes a quantity from covariances (K, m, m). Panics if a slice has a wrong length.
    ///
    /// # Errors
    /// An invalid covariance, or sensors that are singular in the same direction.
    fn compute(
        &mut self,
        quantity: &Quantity<'_>,
        covariances: &[f64],
        out: &mut [f64],
    ) -> Result<()>;
}

/// Returns the computation for this number of sensors and dimensions.
///
/// ```
/// use tertia::weights::{Quantity, weighing};
// two scalar estimates with the variances 1 and 3: the first gets a weight of three quarters
/// let mut weights = [0.0; 2];
/// weighing(2, 1).compute(&Quantity::Weights, &[1.0, 3.0], &mut weights)?;
/// assert_eq!(weights, [0.75, 0.25]);
/// # Ok::<(), tertia::Error>(())
/// ```
///
/// # Panics
/// If there is no sensor or no dimension.
pub fn weighing(sensors: usize, dimension: usize) -> Box<dyn Weighing> {
    assert!(sensors >= 1 && dimension >= 1, "{sensors} sensors, {dimension} dimensions");
    with_order!(dimension, |order| Box::new(Solver::new(sensors, order)))
}

struct Solver<D: Dim>
where
    DefaultAllocator: Allocator<D, D>,
{
    order: D,
    problem: Problem<D>,
    // created at the first use
    propagation: Option<Propagation<D>>,
    loss: Option<Loss<D>>,
}

impl<D: Dim> Weighing for Solver<D>
where
    DefaultAllocator: Allocator<D, D>,
    Square<D>: Send,
{
    fn compute(
        &mut self,
        quantity: &Quantity<'_>,
        covariances: &[f64],
        out: &mut [f64],
    ) -> Result<()> {
        match *quantity {
            Quantity::Weights => {
                self.problem.weigh(covariances)?;
                write_all(&self.problem.group.weight, out);
            }
            Quantity::FusedCovariance => {
                self.problem.fuse(covariances)?;
                write(&self.problem.group.fused, out);
            }
            Quantity::Jacobian { sensor } => {
                self.propagate(covariances, sensor)?.0.write_jacobian(out);
            }
            Quantity::JacobianFactors { sensor } => {
                let (propagation, _) = self.propagate(covariances, sensor)?;
                let (left, right) = out.split_at_mut(covariances.len());
                write_all(&propagation.left, left);
                write_all(&propagation.right, right);
            }
            Quantity::WeightCovariance { sensor, c } => {
                let (propagation, problem) = self.propagate(covariances, sensor)?;
                propagation.write_covariance(&problem.covariances, c, out);
            }
            Quantity::WeightBias { sensor, c, mean } => {
                self.problem.weigh(covariances)?;
                let (loss, problem) = self.loss();
                write(loss.bias(&problem.group, c, mean, sensor), out);
            }
            Quantity::Excess { c } => {
                self.problem.fuse(covariances)?;
                let (loss, problem) = self.loss();
                let (fused, excess) = out.split_at_mut(out.len() / 2);
                write(&problem.group.fused, fused);
                write(loss.first_order(&problem.group, c), excess);
            }
            Quantity::SimulatedExcess { draws } => {
                self.problem.fuse(covariances)?;
                self.problem.factors.iter_mut().for_each(into_cholesky);
                let (loss, problem) = self.loss();
                let (matrices, numbers) = out.split_at_mut(out.len() - 2);
                let (fused, excess) = matrices.split_at_mut(matrices.len() / 2);
                write(&problem.group.fused, fused);
                let draws = draws.chunks_exact(covariances.len());
                let (found, simulated) = loss.simulated(problem, draws)?;
                write(found, excess);
                numbers.copy_from_slice(&[simulated.loss, simulated.loss_sigma]);
            }
            Quantity::CovarianceOfCovariance { c } => {
                let Problem { covariances: read, factors, .. } = &mut self.problem;
                read_covariance("covariance", &[], covariances, &mut read[0], &mut factors[0])?;
                write_covariance_of_covariance(&read[0], c, out);
            }
        }
        Ok(())
    }
}

impl<D: Dim> Solver<D>
where
    DefaultAllocator: Allocator<D, D>,
{
    fn new(sensors: usize, order: D) -> Self {
        Self { order, problem: Problem::new(sensors, order), propagation: None, loss: None }
    }

    fn propagate(
        &mut self,
        covariances: &[f64],
        k: usize,
    ) -> Result<(&mut Propagation<D>, &Problem<D>)> {
        self.problem.read(covariances)?;
        let new = || Propagation::new(self.problem.covariances.len(), self.order);
        let propagation = self.propagation.get_or_insert_with(new);
        propagation.factors(&mut self.problem, k)?;
        Ok((propagation, &self.problem))
    }

    fn loss(&mut self) -> (&mut Loss<D>, &Problem<D>) {
        let new = || Loss::new(self.problem.covariances.len(), self.order);
        (self.loss.get_or_insert_with(new), &self.problem)
    }
}

fn write_all<D: Dim>(list: &[Square<D>], out: &mut [f64])
where
    DefaultAllocator: Allocator<D, D>,
{
    let size = list[0].len();
    for (matrix, out) in list.iter().zip(out.chunks_exact_mut(size)) {
        write(matrix, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_all_close;

    const TWO: [f64; 8] = [4.0, 1.0, 1.0, 2.0, 1.0, -0.5, -0.5, 3.0];
    /// P2 of TWO, from exact fractions.
    const P2: [[f64; 4]; 4] = [
        [-0.159167431894705, -0.0244872972145699, 0.0159167431894705, 0.00244872972145699],
        [-0.0326497296194266, -0.0775431078461381, 0.00326497296194266, 0.00775431078461382],
        [0.0159167431894705, 0.00244872972145699, -0.159167431894705, -0.0244872972145699],
        [0.00326497296194266, 0.00775431078461382, -0.0326497296194266, -0.0775431078461381],
    ];

    #[test]
    fn two_sensors_in_two_dimensions() {
        let mut solver = weighing(2, 2);
        let mut weights = [0.0; 8];
        solver.compute(&Quantity::Weights, &TWO, &mut weights).unwrap();
        assert_all_close(&weights[4..], &[78.0, 12.0, 16.0, 38.0].map(|w| w / 99.0));
        let mut fused = [0.0; 4];
        solver.compute(&Quantity::FusedCovariance, &TWO, &mut fused).unwrap();
        assert_all_close(&fused, &[72.0, -3.0, -3.0, 106.0].map(|s| s / 99.0));
        let mut jacobian = [0.0; 32];
        solver.compute(&Quantity::Jacobian { sensor: 1 }, &TWO, &mut jacobian).unwrap();
        assert_all_close(&jacobian[16..], P2.as_flattened());
        let mut excess = [0.0; 8];
        solver.compute(&Quantity::Excess { c: &[1.0 / 9.0; 2] }, &TWO, &mut excess).unwrap();
        let loss = (excess[4] + excess[7]) / (excess[0] + excess[3]);
        assert_all_close(&[loss], &[0.151638326798165]);
    }

    /// The same results whether the order is known at compile time or not: block diagonal matrices.
    #[test]
    fn any_order_and_any_number() {
        let (sensors, m) = (4, 12);
        let block = |k: usize, i: usize, j: usize| {
            let corner = TWO[4 * (k % 2) + 2 * (i % 2) + j % 2];
            if i / 2 == j / 2 { corner } else { 0.0 }
        };
        let covariances: Vec<f64> =
            (0..sensors * m * m).map(|at| block(at / (m * m), at / m % m, at % m)).collect();
        let mut weights = vec![0.0; sensors * m * m];
        weighing(sensors, m).compute(&Quantity::Weights, &covariances, &mut weights).unwrap();
        // each member of two equal pairs has half the weight of its pair
        for (at, &w) in weights.iter().enumerate().filter(|(at, _)| at / (m * m) == 3) {
            let (i, j) = (at / m % m, at % m);
            let pair = [78.0, 12.0, 16.0, 38.0][2 * (i % 2) + j % 2] / 99.0;
            let expected = if i / 2 == j / 2 { pair / 2.0 } else { 0.0 };
            assert!((w - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn matrices_that_are_no_covariances() {
        let mut solver = weighing(2, 2);
        let mut out = [0.0; 8];
        let mut fails = |covariances: [f64; 8]| {
            solver.compute(&Quantity::Weights, &covariances, &mut out).unwrap_err()
        };
        let text = fails([4.0, 1.0, 1.0, 2.0, 1.0, 3.0, 3.0, 3.0]).to_string();
        assert!(text.starts_with("covariances[1] is indefinite"), "{text}");
        let text = fails([4.0, 1.0, 0.9, 2.0, 1.0, 0.0, 0.0, 3.0]).to_string();
        assert!(text.starts_with("covariances[0, 0, 1] is 1 and its mirror image is 0.9"));
        let text = fails([4.0, 1.0, 1.0, 2.0, 1.0, 0.0, f64::NAN, 3.0]).to_string();
        assert!(text.starts_with("covariances[1, 1, 0] is nan"));
        let text = fails([1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]).to_string();
        assert!(text.starts_with("covariances[1] and the covariances fused"), "{text}");
        // singular in different directions: there are weights, but no fused covariance
        let crossed = [1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0];
        assert!(solver.compute(&Quantity::Weights, &crossed, &mut out).is_ok());
        let fused = solver.compute(&Quantity::FusedCovariance, &crossed, &mut out[..4]);
        assert!(fused.is_err());
    }
}

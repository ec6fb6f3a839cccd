//! The matrices that weigh several estimates of the same vector, and what not knowing them costs.
//!
//! Source: Kulyavets et al. 2005, equations (1) to (14), for K ≥ 2 sensors. `S_k` is the covariance
//! of sensor k's estimate, `C_k = S_k^-1`, `S_p = (Σ C_k)^-1` the fused covariance and
//! `W_k = S_p C_k`; vec stacks columns. Matrices are passed row by row, those of several sensors
//! one after the other.

mod convention;
mod group;
mod loss;
mod propagation;

use crate::base::error::Result;
use crate::base::matrix::{Square, into_cholesky, read_covariance, write};
use group::Problem;
use loss::Loss;
use nalgebra::allocator::Allocator;
use nalgebra::{Const, DefaultAllocator, Dim, Dyn, OVector};
use propagation::{Propagation, write_covariance_of_covariance};

pub use convention::{Convention, least_count, require_degrees_of_freedom};
pub(crate) use group::{Group, Sum};
pub use loss::Simulated;

pub(crate) const COVARIANCES: &str = "covariances";

/// What can be computed of the covariances of K sensors in m dimensions, with buffers that are
/// reused from call to call. Slices of other lengths than said panic.
pub trait Weighing: Send {
    /// `W_k` of every sensor (K, m, m). Cost O(K m³).
    ///
    /// # Errors
    /// Here and below: a covariance (K, m, m) that is none, or sensors that are singular in the
    /// same direction.
    fn weights(&mut self, covariances: &[f64], out: &mut [f64]) -> Result<()>;

    /// `S_p` (m, m). Cost O(K m³).
    ///
    /// # Errors
    /// Also where it is lost to rounding.
    fn fused_covariance(&mut self, covariances: &[f64], out: &mut [f64]) -> Result<()>;

    /// `∂vec W_k / ∂vec S_j` for every j (K, m², m²), (7)–(14): for two sensors and k = 1, P1 and
    /// P2. Cost O(K m⁴), that of writing it.
    ///
    /// # Errors
    /// See above.
    fn jacobian(&mut self, covariances: &[f64], k: usize, out: &mut [f64]) -> Result<()>;

    /// The factors B_j and A_j (K, m, m) of `dW_k = Σ_j B_j dS_j A_j`. Cost O(K m³).
    ///
    /// # Errors
    /// See above.
    fn jacobian_factors(
        &mut self,
        covariances: &[f64],
        k: usize,
        left: &mut [f64],
        right: &mut [f64],
    ) -> Result<()>;

    /// The covariance (m², m²) of vec Ŵ_k to first order (10), where that of vec Ŝ_j is
    /// `c_j (S_j ⊗ S_j)(I + K)`. Cost O(K m⁴).
    ///
    /// # Errors
    /// See above.
    fn weight_covariance(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        k: usize,
        out: &mut [f64],
    ) -> Result<()>;

    /// `E Ŵ_k − W_k` (m, m) to second order, where the mean of Ŝ_j is `mean_j S_j`. Cost O(K m³).
    ///
    /// # Errors
    /// See above.
    fn weight_bias(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        mean: &[f64],
        k: usize,
        out: &mut [f64],
    ) -> Result<()>;

    /// The excess (m, m) of the mean squared error over the fused covariance (m, m), to first
    /// order. Cost O(K m³).
    ///
    /// # Errors
    /// See above.
    fn excess(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        fused: &mut [f64],
        out: &mut [f64],
    ) -> Result<()>;

    /// The same from draws (T, K, m, m) of Wishart matrices with mean I. Cost O(T K m³).
    ///
    /// # Errors
    /// See above.
    fn simulated_excess(
        &mut self,
        covariances: &[f64],
        draws: &[f64],
        fused: &mut [f64],
        out: &mut [f64],
    ) -> Result<Simulated>;

    /// The covariance (m², m²) of the vec of a sample covariance, `c (S ⊗ S)(I + K)`, for the
    /// covariance S (m, m) of one sensor (4). Cost O(m⁴).
    ///
    /// # Errors
    /// A covariance that is none.
    fn covariance_of_covariance(
        &mut self,
        covariance: &[f64],
        c: f64,
        out: &mut [f64],
    ) -> Result<()>;
}

/// The computation for so many sensors and dimensions.
///
/// ```
/// // two scalar estimates with the variances 1 and 3: three quarters for the first
/// let mut weights = [0.0; 2];
/// tertia::weights::weighing(2, 1).weights(&[1.0, 3.0], &mut weights)?;
/// assert_eq!(weights, [0.75, 0.25]);
/// # Ok::<(), tertia::Error>(())
/// ```
///
/// # Panics
/// Fewer than two sensors, or no dimension.
pub fn weighing(sensors: usize, dimension: usize) -> Box<dyn Weighing> {
    assert!(sensors >= 2 && dimension >= 1, "{sensors} sensors, {dimension} dimensions");
    match dimension {
        1 => Solver::boxed(sensors, Const::<1>),
        2 => Solver::boxed(sensors, Const::<2>),
        3 => Solver::boxed(sensors, Const::<3>),
        4 => Solver::boxed(sensors, Const::<4>),
        5 => Solver::boxed(sensors, Const::<5>),
        6 => Solver::boxed(sensors, Const::<6>),
        7 => Solver::boxed(sensors, Const::<7>),
        8 => Solver::boxed(sensors, Const::<8>),
        9 => Solver::boxed(sensors, Const::<9>),
        m => Solver::boxed(sensors, Dyn(m)),
    }
}

struct Solver<D: Dim>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    order: D,
    problem: Problem<D>,
    // made when they are needed
    propagation: Option<Propagation<D>>,
    loss: Option<Loss<D>>,
}

impl<D: Dim> Solver<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
    Self: Weighing + 'static,
{
    fn boxed(sensors: usize, order: D) -> Box<dyn Weighing> {
        let problem = Problem::new(sensors, order);
        Box::new(Self { order, problem, propagation: None, loss: None })
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

impl<D: Dim> Solver<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    fn read_one(&mut self, covariance: &[f64]) -> Result<&Square<D>> {
        let Problem { covariances, factors, .. } = &mut self.problem;
        read_covariance("covariance", &[], covariance, &mut covariances[0], &mut factors[0])?;
        Ok(&covariances[0])
    }

    fn propagate(&mut self, covariances: &[f64], k: usize) -> Result<&mut Propagation<D>> {
        self.problem.read(covariances)?;
        let new = || Propagation::new(self.problem.covariances.len(), self.order);
        let propagation = self.propagation.get_or_insert_with(new);
        propagation.factors(&mut self.problem, k)?;
        Ok(propagation)
    }

    fn loss(&mut self) -> (&mut Loss<D>, &Problem<D>) {
        let new = || Loss::new(self.problem.covariances.len(), self.order);
        (self.loss.get_or_insert_with(new), &self.problem)
    }
}

impl<D: Dim> Weighing for Solver<D>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
    Square<D>: Send,
    OVector<f64, D>: Send,
{
    fn weights(&mut self, covariances: &[f64], out: &mut [f64]) -> Result<()> {
        self.problem.weigh(covariances)?;
        write_all(&self.problem.group.weight, out);
        Ok(())
    }

    fn fused_covariance(&mut self, covariances: &[f64], out: &mut [f64]) -> Result<()> {
        self.problem.fuse(covariances)?;
        write(&self.problem.group.fused, out);
        Ok(())
    }

    fn jacobian(&mut self, covariances: &[f64], k: usize, out: &mut [f64]) -> Result<()> {
        self.propagate(covariances, k)?.write_jacobian(out);
        Ok(())
    }

    fn jacobian_factors(
        &mut self,
        covariances: &[f64],
        k: usize,
        left: &mut [f64],
        right: &mut [f64],
    ) -> Result<()> {
        let propagation = self.propagate(covariances, k)?;
        write_all(&propagation.left, left);
        write_all(&propagation.right, right);
        Ok(())
    }

    fn weight_covariance(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        k: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.propagate(covariances, k)?;
        if let Some(propagation) = &mut self.propagation {
            propagation.write_covariance(&self.problem.covariances, c, out);
        }
        Ok(())
    }

    fn weight_bias(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        mean: &[f64],
        k: usize,
        out: &mut [f64],
    ) -> Result<()> {
        self.problem.weigh(covariances)?;
        let (loss, problem) = self.loss();
        write(loss.bias(&problem.group, c, mean, k), out);
        Ok(())
    }

    fn excess(
        &mut self,
        covariances: &[f64],
        c: &[f64],
        fused: &mut [f64],
        out: &mut [f64],
    ) -> Result<()> {
        self.problem.fuse(covariances)?;
        let (loss, problem) = self.loss();
        write(&problem.group.fused, fused);
        write(loss.first_order(&problem.group, c), out);
        Ok(())
    }

    fn simulated_excess(
        &mut self,
        covariances: &[f64],
        draws: &[f64],
        fused: &mut [f64],
        out: &mut [f64],
    ) -> Result<Simulated> {
        self.problem.fuse(covariances)?;
        self.problem.factors.iter_mut().for_each(into_cholesky);
        let (loss, problem) = self.loss();
        write(&problem.group.fused, fused);
        let draws = draws.chunks_exact(covariances.len());
        let (excess, simulated) = loss.simulated(problem, draws)?;
        write(excess, out);
        Ok(simulated)
    }

    fn covariance_of_covariance(
        &mut self,
        covariance: &[f64],
        c: f64,
        out: &mut [f64],
    ) -> Result<()> {
        write_covariance_of_covariance(self.read_one(covariance)?, c, out);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::checks::assert_all_close;

    const TWO: [f64; 8] = [4.0, 1.0, 1.0, 2.0, 1.0, -0.5, -0.5, 3.0];
    /// P2 of TWO, by exact fractions.
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
        solver.weights(&TWO, &mut weights).unwrap();
        assert_all_close(&weights[4..], &[78.0, 12.0, 16.0, 38.0].map(|w| w / 99.0));
        let mut fused = [0.0; 4];
        solver.fused_covariance(&TWO, &mut fused).unwrap();
        assert_all_close(&fused, &[72.0, -3.0, -3.0, 106.0].map(|s| s / 99.0));
        let mut jacobian = [0.0; 32];
        solver.jacobian(&TWO, 1, &mut jacobian).unwrap();
        assert_all_close(&jacobian[16..], P2.as_flattened());
        let mut excess = [0.0; 4];
        solver.excess(&TWO, &[1.0 / 9.0; 2], &mut fused, &mut excess).unwrap();
        let loss = (excess[0] + excess[3]) / (fused[0] + fused[3]);
        assert_all_close(&[loss], &[0.151638326798165]);
    }

    /// The same numbers whether the order is known when compiling or not: block diagonal matrices.
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
        weighing(sensors, m).weights(&covariances, &mut weights).unwrap();
        // of two equal pairs, each member has half the weight of its pair
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
        let mut fails = |covariances: [f64; 8]| solver.weights(&covariances, &mut out).unwrap_err();
        let text = fails([4.0, 1.0, 1.0, 2.0, 1.0, 3.0, 3.0, 3.0]).to_string();
        assert!(text.starts_with("covariances[1] is indefinite"), "{text}");
        let text = fails([4.0, 1.0, 0.9, 2.0, 1.0, 0.0, 0.0, 3.0]).to_string();
        assert!(text.starts_with("covariances[0, 0, 1] is 1 and its mirror image is 0.9"));
        let text = fails([4.0, 1.0, 1.0, 2.0, 1.0, 0.0, f64::NAN, 3.0]).to_string();
        assert!(text.starts_with("covariances[1, 1, 0] is nan"));
        let text = fails([1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]).to_string();
        assert!(text.starts_with("covariances[1] and those"), "{text}");
        // singular in different directions: weights, but no fused covariance
        let crossed = [1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0];
        assert!(solver.weights(&crossed, &mut out).is_ok());
        assert!(solver.fused_covariance(&crossed, &mut out[..4]).is_err());
    }
}

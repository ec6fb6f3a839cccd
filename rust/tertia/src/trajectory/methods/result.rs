//! Result of a reconstruction.

use crate::base::angle::median;
use crate::smoothing::{ProcessNoiseFit, Summary};
use crate::trajectory::instants::fixes::Fixes;
use crate::trajectory::measured::{Measured, Place, Record};
use crate::trajectory::systematic::lasting::LastingErrors;

/// Median size of the residuals of the measurements in use, in sigmas, from which a path has diverged, and up
/// to which it agrees with them: .67 is that of normal errors.
const DIVERGED: f64 = 1e4;
const AGREES: f64 = 1.0;
/// Largest share of outliers, as a divisor, with which a path agrees with the measurements.
const MOST_OUTLIERS: usize = 10;

/// Reconstructed trajectory.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Positions, velocities and accelerations (N, 3D); nan where unknown.
    pub mean: Vec<f64>,
    /// Covariances of the states (N, 3D, 3D), ∞ where unknown, with the uncertainty of motion and biases.
    pub covariance: Vec<f64>,
    /// Results of the smoother of positions; none with polynomials, or if the measurements were smoothed
    /// first.
    pub smoothed: Option<Smoothed>,
    /// Positions of the single instants.
    pub fixes: Fixes,
    /// Measurements that were left out (N, 5, K).
    pub outlier: Vec<bool>,
    /// Whitened residuals about the trajectory (N, 5, K), without biases.
    pub residual: Vec<f64>,
    /// Lasting errors; none if they were not to be estimated.
    pub bias: Option<LastingErrors>,
    /// Positions (N, D) of the mirror image of the path, if it explains the measurements as well.
    pub image: Option<Vec<f64>>,
    /// Whether the path is below the stations because no path above them fits.
    pub is_behind: bool,
    /// Whether a path that crosses the plane of the stations would be much likelier than one that turns back
    /// at it.
    pub may_cross: bool,
    /// Whether it is doubtful where, or if at all, the path crosses the plane of the stations.
    pub is_doubtful: bool,
    /// Standard deviation of large ranges relative to the range, if errors were found to grow with the range.
    pub relative_range_sigma: Option<f64>,
}

/// Results of the smoother.
#[derive(Clone, Debug)]
pub struct Smoothed {
    /// Covariances of the states (N, 3D, 3D) without the uncertainty of motion and biases.
    pub covariance: Vec<f64>,
    /// Innovations (N, D).
    pub innovation: Vec<f64>,
    /// Likelihood and number of positions.
    pub summary: Summary,
    /// Sum of ln of the sizes of the ellipsoids of the positions; the likelihood of the measurements is larger
    /// by this than that of the positions.
    pub ln_spread: f64,
    /// The given or estimated motion.
    pub fit: ProcessNoiseFit,
}

impl Trajectory {
    /// Whether the path is so far from the measurements that it says nothing, or left out most of them so that
    /// most of it is unknown.
    pub(in crate::trajectory) fn has_diverged(&self) -> bool {
        let unknown = self.mean.iter().filter(|value| value.is_nan()).count();
        let used = self.used().count();
        let left_out = self.outlier.iter().filter(|is_outlier| **is_outlier).count();
        self.misfit() > DIVERGED || (2 * unknown > self.mean.len() && left_out > used)
    }

    /// Whether the path agrees with nearly all measurements.
    pub(in crate::trajectory) fn explains(&self) -> bool {
        let known = self.residual.iter().filter(|residual| !residual.is_nan()).count();
        let outliers = self.outlier.iter().filter(|is_outlier| **is_outlier).count();
        self.misfit() <= AGREES && MOST_OUTLIERS * outliers <= known
    }

    /// States that the measurements hardly determine the motion.
    pub(in crate::trajectory) fn with_doubtful_motion(mut self) -> Self {
        if let Some(smoothed) = &mut self.smoothed {
            smoothed.fit.relative_error = f64::INFINITY;
        }
        self
    }

    /// Median size of the residuals of the measurements in use.
    fn misfit(&self) -> f64 {
        let mut sizes: Vec<f64> = self.used().map(f64::abs).collect();
        if sizes.is_empty() { 0.0 } else { median(&mut sizes) }
    }

    /// Residuals of the measurements in use.
    fn used(&self) -> impl Iterator<Item = f64> {
        let used = self.residual.iter().zip(&self.outlier);
        used.filter(|(residual, is_outlier)| !residual.is_nan() && !**is_outlier).map(|one| *one.0)
    }

    /// Returns states that follow from positions of the instants, without biases.
    pub(in crate::trajectory) fn of_fixes<const D: usize, const N: usize>(
        record: &Record<'_>,
        fixes: Fixes,
        mean: Vec<f64>,
        covariance: Vec<f64>,
    ) -> Self {
        let outlier = fixes.outlier.clone();
        let residual = residuals::<D, N>(record, record.values.to_vec(), &mean, &outlier);
        Self {
            mean,
            covariance,
            smoothed: None,
            fixes,
            outlier,
            residual,
            bias: None,
            image: None,
            is_behind: false,
            may_cross: false,
            is_doubtful: false,
            relative_range_sigma: None,
        }
    }
}

/// Returns diagonal matrices (N, S, S) of variances (N, S).
pub(in crate::trajectory) fn without_correlations(variance: &[f64], size: usize) -> Vec<f64> {
    let mut matrices = vec![0.0; variance.len() * size];
    for (at, variance) in variance.iter().enumerate() {
        matrices[at * size + at % size] = *variance;
    }
    matrices
}

/// Returns the whitened residuals of measurements (N, 5, K) about states. Arrivals are compared with the
/// emission that follows from the arrivals that are not outliers.
pub(in crate::trajectory) fn residuals<const D: usize, const N: usize>(
    record: &Record<'_>,
    values: Vec<f64>,
    mean: &[f64],
    outlier: &[bool],
) -> Vec<f64> {
    let width = record.width();
    let measured = Measured::<D>::new(record, values);
    let mut residual = vec![f64::NAN; record.values.len()];
    for (t, state) in mean.chunks_exact(N).enumerate() {
        let trust = |m: usize| if outlier[t * width + measured.column[m]] { 0.0 } else { 1.0 };
        let place = Place::at(&state[..D]);
        let emission = measured.emission_for_all(t, place, trust);
        for (m, row) in measured.rows(t, place) {
            let row = emission.removed_from(measured.one(m), row);
            residual[t * width + measured.column[m]] = row.map_or(f64::NAN, |row| row.residual);
        }
    }
    residual
}

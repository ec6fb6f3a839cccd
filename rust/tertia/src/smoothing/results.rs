//! Results of a smoother.

/// Results for each instant.
#[derive(Debug)]
pub struct Smoothed<'a> {
    /// States (N, 3D): positions, velocities, accelerations; nan where unknown.
    pub mean: &'a mut [f64],
    /// Covariances of the states (N, 3D, 3D); a variance is ∞ where unknown.
    pub covariance: &'a mut [f64],
    /// Innovations (N, M), uncorrelated and of unit variance: the difference of each component of a plot from
    /// its prediction by the plots before and by the components before it; nan if there is no prediction.
    pub innovation: &'a mut [f64],
}

/// Results for a whole track.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    /// Logarithm of the likelihood of the plots, up to a constant that depends on units and times.
    pub log_likelihood: f64,
    /// Number of measured components beyond those needed to determine the state.
    pub count: usize,
}

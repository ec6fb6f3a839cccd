//! What a smoother yields.

/// Where the results go.
#[derive(Debug)]
pub struct Smoothed<'a> {
    /// States (N, 3D): positions, velocities, accelerations; nan where unknown.
    pub mean: &'a mut [f64],
    /// Their covariances (N, 3D, 3D); a variance is ∞ where unknown.
    pub covariance: &'a mut [f64],
    /// Innovations (N, M), uncorrelated and of unit variance: the difference of each number of a plot from
    /// what plots before it and its numbers before this one predict; nan where nothing does.
    pub innovation: &'a mut [f64],
}

/// What comes of a whole track.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    /// Logarithm of the likelihood of the plots, but for a constant that depends on units and times.
    pub log_likelihood: f64,
    /// Measured numbers beyond those needed to determine the state.
    pub count: usize,
}

//! What is asked of an instant, and what comes out.

/// How a position is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Tukey's biweight from so many degrees of freedom on, least squares below.
    Robust(usize),
    /// Least squares.
    LeastSquares,
    /// Lenth's maximum likelihood.
    LenthMle,
    /// Lenth's form of Huber's estimator.
    LenthHuber,
    /// Lenth's form of Andrews' estimator.
    LenthAndrews,
}

/// Why an instant has no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It has one.
    None = 0,
    /// Fewer measurements than coordinates.
    TooFew = 1,
    /// Bearings that are parallel, diverge, or meet behind a station; ranges that do not meet.
    NoIntersection = 2,
    /// Measurements that leave some direction undetermined.
    Singular = 3,
    /// Two positions that explain the measurements (almost) equally well.
    Ambiguous = 4,
    /// A position at a station, or straight above one that measures angles.
    AtStation = 5,
    /// No minimum was reached.
    NotConverged = 6,
    /// A position that the measurements do not bound on one side.
    IllConditioned = 7,
}

/// What was measured at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant<'a> {
    /// Positions of K stations, K D numbers.
    pub stations: &'a [f64],
    /// East, north and up of each station, K D² numbers, to which its angles refer; those of the
    /// frame if there are none.
    pub axes: Option<&'a [f64]>,
    /// Ranges, azimuths, elevations, range differences and times of arrival (in metres, from any
    /// origin), 5 K finite numbers, nan where there is none.
    pub values: &'a [f64],
    /// Their standard deviations; nan if they are unknown and equal.
    pub sigmas: &'a [f64],
    /// Standard deviations of the coordinates of each station, as surveyed, K numbers; 0 if there
    /// are none.
    pub position_sigmas: Option<&'a [f64]>,
    /// The height of the target and its standard deviation, in space.
    pub height: Option<(f64, f64)>,
    /// A position near the one looked for.
    pub initial: Option<&'a [f64]>,
}

/// Where the results go.
#[derive(Debug)]
pub struct Output<'a> {
    /// D numbers.
    pub position: &'a mut [f64],
    /// D² numbers.
    pub covariance: &'a mut [f64],
    /// 5 K whitened residuals, measured less predicted; nan where nothing was measured.
    pub residual: &'a mut [f64],
    /// 5 K marks of measurements without weight.
    pub outlier: &'a mut [bool],
}

/// What besides the position came out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Why there is no position.
    pub status: Status,
    /// Measurements less unknowns, negative where there are too few.
    pub degrees_of_freedom: i64,
    /// Sum of all squared residuals.
    pub statistic: f64,
    /// Probability of a larger one; nan where σ is estimated.
    pub pvalue: f64,
    /// Root of the trace of the covariance for σ = 1; nan where units are mixed.
    pub dop: f64,
    /// The standard deviation of a measurement where it is estimated, nan otherwise.
    pub sigma: f64,
    /// Emission of arrivals, in metres from their origin; nan if there are none.
    pub emission: f64,
    /// Its standard deviation.
    pub emission_sigma: f64,
}

impl Fix {
    /// That of an instant that has not been located.
    pub const UNKNOWN: Self = Self {
        status: Status::TooFew,
        degrees_of_freedom: 0,
        statistic: f64::NAN,
        pvalue: f64::NAN,
        dop: f64::NAN,
        sigma: f64::NAN,
        emission: f64::NAN,
        emission_sigma: f64::NAN,
    };
}

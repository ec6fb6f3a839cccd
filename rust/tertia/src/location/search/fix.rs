//! Arguments and results of the location of one instant.

use crate::base::small::{Matrix, Vector};

/// How a position is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Tukey's biweight from this number of degrees of freedom on, least squares below.
    Robust(usize),
    /// Least squares.
    LeastSquares,
    /// Lenth's maximum-likelihood estimator.
    LenthMle,
    /// Lenth's form of Huber's estimator.
    LenthHuber,
    /// Lenth's form of Andrews' estimator.
    LenthAndrews,
}

/// Why an instant has no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// There is a position.
    None = 0,
    /// There are fewer measurements than unknowns.
    TooFew = 1,
    /// Bearings are parallel, diverge, or meet behind a station; or ranges do not meet.
    NoIntersection = 2,
    /// The measurements leave some direction undetermined.
    Singular = 3,
    /// Two positions explain the measurements (almost) equally well.
    Ambiguous = 4,
    /// The position is at a station, or straight above one that measures angles.
    AtStation = 5,
    /// No minimum was reached.
    NotConverged = 6,
    /// The measurements do not bound the position on one side.
    IllConditioned = 7,
}

/// Measurements and stations of one instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant<'a> {
    /// Positions of K stations: K D numbers.
    pub stations: &'a [f64],
    /// East, north and up axes of each station, to which its angles refer: K D² numbers; `None` for the
    /// axes of the frame.
    pub axes: Option<&'a [f64]>,
    /// 5 K values: ranges, azimuths, elevations, range differences and times of arrival (in metres,
    /// from any origin); nan if there is no measurement, otherwise finite.
    pub values: &'a [f64],
    /// Standard deviations of the values; nan if they are unknown and equal.
    pub sigmas: &'a [f64],
    /// Standard deviations of the surveyed coordinates of each station: K numbers; `None` if there are
    /// no such errors.
    pub position_sigmas: Option<&'a [f64]>,
    /// In space: the height of the target and its standard deviation.
    pub height: Option<(f64, f64)>,
    /// A position near the target, from which the search starts.
    pub initial: Option<&'a [f64]>,
}

/// Buffers for the results.
#[derive(Debug)]
pub struct Output<'a> {
    /// Position, D numbers.
    pub position: &'a mut [f64],
    /// Covariance of the position, D² numbers.
    pub covariance: &'a mut [f64],
    /// 5 K whitened residuals, measured minus predicted; nan where nothing was measured.
    pub residual: &'a mut [f64],
    /// 5 K marks of measurements that are outliers.
    pub outlier: &'a mut [bool],
}

impl<'a> Output<'a> {
    /// Returns the buffers of each instant, whose rows these arrays contain. `width` is the number of values
    /// of an instant.
    ///
    /// # Panics
    /// If the dimension or the width is 0.
    pub fn rows(
        (position, covariance): (&'a mut [f64], &'a mut [f64]),
        (residual, outlier): (&'a mut [f64], &'a mut [bool]),
        (dimension, width): (usize, usize),
    ) -> Vec<Self> {
        position
            .chunks_mut(dimension)
            .zip(covariance.chunks_mut(dimension * dimension))
            .zip(residual.chunks_mut(width))
            .zip(outlier.chunks_mut(width))
            .map(|(((position, covariance), residual), outlier)| Output {
                position,
                covariance,
                residual,
                outlier,
            })
            .collect()
    }
}

/// Results of one instant in memory of their own.
#[derive(Clone, Debug)]
pub(in crate::location) struct Solution<const D: usize> {
    pub position: Vector<D>,
    pub covariance: Matrix<D>,
    pub residual: Vec<f64>,
    pub outlier: Vec<bool>,
}

impl<const D: usize> Solution<D> {
    /// Returns memory for the results of an instant, which will be written to [`Solution::output`].
    pub fn of(instant: &Instant<'_>) -> Self {
        let count = instant.values.len();
        let (residual, outlier) = (vec![f64::NAN; count], vec![false; count]);
        Self { position: [f64::NAN; D], covariance: [[f64::NAN; D]; D], residual, outlier }
    }

    /// Returns the buffers of this memory.
    pub fn output(&mut self) -> Output<'_> {
        Output {
            position: &mut self.position,
            covariance: self.covariance.as_flattened_mut(),
            residual: &mut self.residual,
            outlier: &mut self.outlier,
        }
    }
}

/// Results of one instant besides the position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Whether there is a position, and why not.
    pub status: Status,
    /// Number of measurements minus number of unknowns; negative if there are too few measurements.
    pub degrees_of_freedom: i64,
    /// Sum of all squared whitened residuals.
    pub statistic: f64,
    /// Probability of a larger statistic if the sigmas are right; nan if σ is estimated.
    pub pvalue: f64,
    /// Square root of the trace of the covariance for σ = 1; nan if units are mixed.
    pub dop: f64,
    /// Standard deviation of a measurement if it is estimated, otherwise nan.
    pub sigma: f64,
    /// Emission of the arrivals, in metres from their origin; nan if there are no arrivals.
    pub emission: f64,
    /// Standard deviation of the emission.
    pub emission_sigma: f64,
}

impl Fix {
    /// Result of an instant that has not been located.
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

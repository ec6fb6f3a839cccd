//! Errors about rejected inputs, with the offending values.

use thiserror::Error;

/// A rejected input. The message names the argument, the offending element and the requirement.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Error {
    /// An unusable measurement.
    #[error("{argument}[{index}] is {}; {requirement}", text(*.value))]
    InvalidMeasurement {
        /// Name of the argument.
        argument: &'static str,
        /// Position along the sample axis.
        index: usize,
        /// The offending value.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
    /// An unusable element of one of several vectors or matrices.
    #[error("{} is {}; {requirement}", element(argument, .index), text(*.value))]
    InvalidElement {
        /// Name of the argument.
        argument: &'static str,
        /// Index of the vector or matrix, followed by the index of the element in it.
        index: Vec<usize>,
        /// The offending value.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
    /// A matrix whose halves differ by more than rounding.
    #[error(
        "{} is {} and its mirror image is {}; a covariance matrix must be symmetric",
        element(argument, .index), text(*.upper), text(*.lower)
    )]
    NotSymmetric {
        /// Name of the argument.
        argument: &'static str,
        /// Indices of the matrix, row and column.
        index: Vec<usize>,
        /// The element at this index.
        upper: f64,
        /// The element mirrored at the diagonal.
        lower: f64,
    },
    /// A matrix that is not a covariance.
    #[error(
        "{} is indefinite: some combination of its components would have a negative variance",
        element(argument, .index)
    )]
    Indefinite {
        /// Name of the argument.
        argument: &'static str,
        /// Which matrix.
        index: Vec<usize>,
    },
    /// A covariance that is (nearly) zero in some direction.
    #[error(
        "{} is singular to working precision: some combination of its components has (almost) no \
         variance",
        element(argument, .index)
    )]
    Singular {
        /// Name of the argument.
        argument: &'static str,
        /// Which matrix.
        index: Vec<usize>,
    },
    /// Sensors that all have (nearly) no error in the same direction.
    #[error(
        "{} and the covariances fused with it are singular to working precision: some combination \
         of components has (almost) no variance in any of them",
        element(argument, .index)
    )]
    SingularSum {
        /// Name of the argument.
        argument: &'static str,
        /// Which matrix.
        index: Vec<usize>,
    },
    /// Sensors that have (nearly) no error, each in a different direction.
    #[error(
        "the fused covariance of {argument} is lost to rounding: each is (almost) singular, in \
         different directions"
    )]
    LostToRounding {
        /// Name of the argument.
        argument: &'static str,
    },
    /// Estimates whose errors cannot have these correlations.
    #[error(
        "covariances and cross_covariances make a joint covariance that is indefinite: some \
         combination of the estimates would have a negative variance"
    )]
    IndefiniteJoint,
    /// Estimates with a combination that has (nearly) no error.
    #[error(
        "covariances and cross_covariances make a joint covariance that is singular to working \
         precision: some combination of the estimates has (almost) no error"
    )]
    SingularJoint,
    /// The sample is shorter than the method needs.
    #[error(
        "{argument} has {count} measurement{}; at least {minimum} are needed",
        if *count == 1 { "" } else { "s" }
    )]
    TooFew {
        /// Name of the argument.
        argument: &'static str,
        /// Measurements present.
        count: usize,
        /// Measurements needed.
        minimum: usize,
    },
    /// The rule left fewer measurements than a variance requires.
    #[error("only {kept} of {count} measurements pass; choose a larger threshold")]
    TooFewLeft {
        /// Measurements that passed.
        kept: usize,
        /// Measurements given.
        count: usize,
    },
    /// No block with two or more measurements passed the tests of the blocks.
    #[error(
        "none of {blocks} blocks is left: each has fewer than two good measurements or fails a test; \
         choose a larger block_size, k or variance_test"
    )]
    NoBlockLeft {
        /// Blocks given.
        blocks: usize,
    },
    /// Squares of the deviations would overflow or underflow.
    #[error(
        "the deviations of {argument} from their mean are too large or too small to be squared \
         in double precision (allowed: about 1e-140 to 1e150); change the unit"
    )]
    OutOfRange {
        /// Name of the argument.
        argument: &'static str,
    },
    /// The measurements do not determine the quantity to be estimated.
    #[error("{argument} {reason}")]
    Undetermined {
        /// Name of the argument.
        argument: &'static str,
        /// What is missing, as the rest of a sentence.
        reason: &'static str,
    },
    /// More sets of measurements that may be faulty together than can be left out in turn.
    #[error(
        "faults is {faults}; of {measurements} measurements, it must be at most {most}: every set of \
         faulty measurements is left out in turn"
    )]
    TooManySets {
        /// Number of simultaneous faults.
        faults: usize,
        /// Number of measurements.
        measurements: usize,
        /// Largest number of simultaneous faults that is allowed.
        most: usize,
    },
    /// A parameter is outside its domain.
    #[error("{argument} is {}; it must be {requirement}", text(*.value))]
    InvalidParameter {
        /// Name of the argument.
        argument: &'static str,
        /// The offending value.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
}

impl Error {
    /// Returns the same error with the index of one of several rows, vectors or matrices added.
    pub fn within(self, row: usize) -> Self {
        let of_row = |index: Vec<usize>| [&[row], index.as_slice()].concat();
        match self {
            Self::InvalidMeasurement { argument, index, value, requirement } => {
                Self::InvalidElement { argument, index: vec![row, index], value, requirement }
            }
            Self::InvalidElement { argument, index, value, requirement } => {
                Self::InvalidElement { argument, index: of_row(index), value, requirement }
            }
            Self::NotSymmetric { argument, index, upper, lower } => {
                Self::NotSymmetric { argument, index: of_row(index), upper, lower }
            }
            Self::Indefinite { argument, index } => {
                Self::Indefinite { argument, index: of_row(index) }
            }
            Self::Singular { argument, index } => Self::Singular { argument, index: of_row(index) },
            other => other,
        }
    }

    /// Whether the error is about a singular or indefinite matrix.
    pub fn is_about_definiteness(&self) -> bool {
        matches!(
            self,
            Self::Indefinite { .. }
                | Self::Singular { .. }
                | Self::SingularSum { .. }
                | Self::LostToRounding { .. }
                | Self::IndefiniteJoint
                | Self::SingularJoint
        )
    }

    /// Returns the same error with the original indices of the selected sensors.
    pub(crate) fn renumbered(self, sensors: &[usize]) -> Self {
        match self {
            Self::SingularSum { argument, index } => {
                let index = index.iter().map(|&k| sensors[k]).collect();
                Self::SingularSum { argument, index }
            }
            other => other,
        }
    }

    /// Returns the same error with the argument name `theta`, for bearings that were screened.
    pub(crate) fn about_theta(self) -> Self {
        match self {
            Self::InvalidMeasurement { index, value, requirement, .. } => {
                Self::InvalidMeasurement { argument: "theta", index, value, requirement }
            }
            Self::TooFew { count, minimum, .. } => {
                Self::TooFew { argument: "theta", count, minimum }
            }
            Self::OutOfRange { .. } => Self::OutOfRange { argument: "theta" },
            other => other,
        }
    }
}

/// An element of an argument in Python notation.
fn element(argument: &str, index: &[usize]) -> String {
    if index.is_empty() {
        return argument.to_owned();
    }
    let index: Vec<_> = index.iter().map(usize::to_string).collect();
    format!("{argument}[{}]", index.join(", "))
}

/// Returns the number in Python notation.
fn text(value: f64) -> String {
    let text = format!("{value:?}").to_lowercase();
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// Result of a kernel.
pub type Result<T> = std::result::Result<T, Error>;

/// Returns an error that names the parameter unless `holds`.
pub(crate) fn require(
    argument: &'static str,
    value: f64,
    holds: bool,
    requirement: &'static str,
) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::InvalidParameter { argument, value, requirement }) }
}

/// Returns an error unless `value` is positive and finite.
pub(crate) fn require_positive(argument: &'static str, value: f64) -> Result<()> {
    require(argument, value, value > 0.0 && value.is_finite(), "a positive number")
}

/// Returns an error unless the correlation of successive measurements is inside (−1, 1).
pub(crate) fn require_correlation(correlation: f64) -> Result<()> {
    require("correlation", correlation, correlation.abs() < 1.0, "between -1 and 1 (exclusive)")
}

/// Returns an error unless `significance` is inside (0, 1) and large enough to be divided by the sample size.
pub(crate) fn require_significance(significance: f64) -> Result<()> {
    let holds = (1e-290..1.0).contains(&significance);
    require("significance", significance, holds, "between 0 and 1 (exclusive, not below 1e-290)")
}

/// Returns an error for the first value of `y` that is not finite.
///
/// # Errors
/// The value and its index.
pub fn require_finite(argument: &'static str, y: &[f64]) -> Result<()> {
    require_each(argument, y, f64::is_finite, "every measurement must be a finite number")
}

/// Returns an error for the first value of `y` for which `holds` is false.
pub(crate) fn require_each(
    argument: &'static str,
    y: &[f64],
    holds: impl Fn(f64) -> bool,
    requirement: &'static str,
) -> Result<()> {
    match y.iter().position(|&value| !holds(value)) {
        None => Ok(()),
        Some(index) => {
            Err(Error::InvalidMeasurement { argument, index, value: y[index], requirement })
        }
    }
}

/// Returns an error for the first element for which `holds` is false, in rows of this width.
pub(crate) fn require_elements(
    argument: &'static str,
    rows: &[f64],
    width: usize,
    holds: impl Fn(f64) -> bool,
    requirement: &'static str,
) -> Result<()> {
    let Some(at) = rows.iter().position(|&value| !holds(value)) else { return Ok(()) };
    let index = vec![at / width, at % width];
    Err(Error::InvalidElement { argument, index, value: rows[at], requirement })
}

/// Returns an error for the first time whose size exceeds `largest`, that is nan, or that precedes the
/// last one.
pub(crate) fn require_times(times: &[f64], largest: f64) -> Result<()> {
    let requirement = "every time must be a finite number";
    require_each("time", times, |t| t.abs() <= largest, requirement)?;
    let Some(before) = times.windows(2).position(|pair| pair[1] < pair[0]) else { return Ok(()) };
    let (argument, requirement) = ("time", "time must not decrease");
    let (index, value) = (before + 1, times[before + 1]);
    Err(Error::InvalidMeasurement { argument, index, value, requirement })
}

/// Returns an error for the first value of a sample that is not finite, or if it has too few values.
pub(crate) fn require_sample(argument: &'static str, y: &[f64], minimum: usize) -> Result<()> {
    if y.len() < minimum {
        require_finite(argument, y)?;
    }
    require_count(argument, y.len(), minimum)
}

/// Returns an error if there are fewer than `minimum` measurements.
pub(crate) fn require_count(argument: &'static str, count: usize, minimum: usize) -> Result<()> {
    if count >= minimum { Ok(()) } else { Err(Error::TooFew { argument, count, minimum }) }
}

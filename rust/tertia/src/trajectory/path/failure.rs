//! Why a path cannot be reconstructed.

use crate::base::error::Error;

/// Why there is no trajectory.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// No instant could be located; the reasons, as numbers of `location::Status`.
    NotLocated(Vec<u8>),
    /// No usable measurement determines the biases of these columns of a record.
    Unusable(Vec<usize>),
    /// Biases of these columns move the positions together and change no residual.
    Unobservable(Vec<usize>),
    /// There are two paths that are mirror images, and neither of them is above the other.
    Mirrored,
    /// A covariance of the positions is singular, or too large or small.
    Unbounded,
    /// The path that was found contradicts the measurements.
    Diverged,
    /// An argument is wrong.
    Error(Error),
}

//! Why a path cannot be reconstructed.

use crate::base::error::Error;

/// Why there is no trajectory.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// No instant has a position: for these reasons, as numbers of a location's status.
    NotLocated(Vec<u8>),
    /// No usable measurement determines the biases of these numbers of an instant.
    Unusable(Vec<usize>),
    /// Biases of these numbers move positions together and change no residual.
    Unobservable(Vec<usize>),
    /// Two paths that are mirror images, neither of which is above the other.
    Mirrored,
    /// An argument is wrong.
    Error(Error),
}

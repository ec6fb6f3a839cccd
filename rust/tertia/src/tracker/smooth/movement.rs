//! How a target moves, in the categories of ASTERIX (I062/200).

/// Probability from which a model is taken to be right.
const LIKELY: f64 = 0.7;

/// Whether a quantity stays, grows or falls; numbers are those of ASTERIX.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manoeuvre {
    /// Constant course, constant speed, level.
    None = 0,
    /// To the right, faster, up.
    Positive = 1,
    /// To the left, slower, down.
    Negative = 2,
    /// Not known.
    Undetermined = 3,
}

/// The manoeuvre for a model of this probability and a quantity of this sign.
pub(super) fn likely(probability: f64, value: f64) -> Manoeuvre {
    match () {
        () if probability < 1.0 - LIKELY => Manoeuvre::None,
        () if probability > LIKELY && value > 0.0 => Manoeuvre::Positive,
        () if probability > LIKELY && value < 0.0 => Manoeuvre::Negative,
        () => Manoeuvre::Undetermined,
    }
}

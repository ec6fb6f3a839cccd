//! The states that a track may have, depending on which plots were its own.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A plot that a track took while its plots were not certain, or a missed detection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Choice {
    pub time: f64,
    /// Index of the plot among all plots; none for a missed detection.
    pub plot: Option<usize>,
}

/// The identifier of a state within its track, and the choices that led to this state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Branch {
    pub id: u32,
    pub choices: VecDeque<Choice>,
}

/// A state that is not shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Leaf<T> {
    pub branch: Branch,
    pub track: T,
    pub probability: f64,
}

/// All states of a track; the shown state is the track that owns the tree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Tree<T> {
    pub own: Branch,
    pub others: Vec<Leaf<T>>,
    /// Probability of the state that is shown.
    pub probability: f64,
}

//! The states that a track may have, by what its plots were.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// What a track was given when its plots were not certain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Choice {
    pub time: f64,
    /// Index of the plot among all; none where it was missed.
    pub plot: Option<usize>,
}

/// A state by its name among those of its track, and the choices that led to it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Branch {
    pub id: u32,
    pub choices: VecDeque<Choice>,
}

/// A state that is not shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Leaf<T> {
    pub branch: Branch,
    pub track: T,
    pub probability: f64,
}

/// All states of a track: the one that is shown is the track that has the tree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Tree<T> {
    pub own: Branch,
    pub others: Vec<Leaf<T>>,
    /// Probability of the state that is shown.
    pub probability: f64,
}

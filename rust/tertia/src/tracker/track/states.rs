//! The states that a track may have if its plots are not certain.

use super::Track;
use crate::tracker::settings::Settings;
use crate::tracker::track::tree::{Branch, Leaf, Tree};

impl Track {
    /// The branches of all states, the shown one first; empty if there is only one state.
    pub fn branches(&self) -> impl Iterator<Item = &Branch> {
        let others = |tree: &Tree<Self>| tree.others.len();
        let count = self.tree.as_deref().map_or(0, |tree| 1 + others(tree));
        (0..count).filter_map(|i| {
            let tree = self.tree.as_deref()?;
            Some(if i == 0 { &tree.own } else { &tree.others[i - 1].branch })
        })
    }

    /// The branch of the state with this `id`.
    pub fn branch(&self, id: u32) -> Option<&Branch> {
        self.branches().find(|branch| branch.id == id)
    }

    /// The states that are not shown.
    #[inline]
    pub fn alternatives(&self) -> &[Leaf<Self>] {
        self.tree.as_deref().map_or(&[], |tree| &tree.others)
    }

    #[inline]
    pub fn alternatives_mut(&mut self) -> &mut [Leaf<Self>] {
        self.tree.as_deref_mut().map_or(&mut [], |tree| &mut tree.others)
    }

    /// Changes all states.
    pub fn each_state(&mut self, mut change: impl FnMut(&mut Self)) {
        change(self);
        self.alternatives_mut().iter_mut().for_each(|leaf| change(&mut leaf.track));
    }

    /// The state with this `id`; the shown one if no other has it.
    pub fn state(&self, id: u32) -> &Self {
        let leaf = self.alternatives().iter().find(|leaf| leaf.branch.id == id);
        leaf.map_or(self, |leaf| &leaf.track)
    }

    /// Shows the state with this `id`.
    pub fn show(&mut self, id: u32) {
        let Some(mut tree) = self.tree.take() else { return };
        if let Some(leaf) = tree.others.iter_mut().find(|leaf| leaf.branch.id == id) {
            std::mem::swap(self, &mut leaf.track);
            std::mem::swap(&mut tree.own, &mut leaf.branch);
        }
        self.tree = Some(tree);
    }

    /// Forgets the first choice of all states.
    pub fn forget_first(&mut self) {
        let Some(tree) = &mut self.tree else { return };
        tree.own.choices.pop_front();
        for leaf in &mut tree.others {
            leaf.branch.choices.pop_front();
        }
    }

    /// Probability of the state that is shown.
    pub fn association_probability(&self) -> f64 {
        self.tree.as_deref().map_or(1.0, |tree| tree.probability)
    }

    /// Counts missed detections of the states that are not shown.
    #[inline]
    pub fn miss_alternatives(&mut self, end: f64, settings: &Settings) {
        for leaf in self.alternatives_mut() {
            leaf.track.miss(end, settings, |_, _| {});
        }
    }
}

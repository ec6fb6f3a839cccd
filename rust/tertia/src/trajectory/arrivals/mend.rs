//! Correction of emissions with few arrivals that were located at a wrong position where they fit as well.
//!
//! Such a position tears the motion apart, and the large jerk that is then estimated lets it stay there.
//! These emissions are moved to where the emissions before and after them suggest; if the first position was
//! right, the arrivals move the emission back.

use super::linear::{Group, Row};
use super::problem::{Model, Problem, State};
use super::start::median;

/// A motion is torn where its squared change is this many times the median.
const TORN: f64 = 30.0;
/// Steps beside a torn one are suspect from this many times the median on.
const SUSPECT: f64 = 10.0;
/// Largest share of the emissions of a motion that may be moved.
const MOST: f64 = 0.3;

impl<const D: usize> Problem<'_, D> {
    /// Moves emissions that tear their motions apart, and lowers the intensities of these motions. Returns
    /// whether there are any. O(N).
    pub fn mend(&self, state: &mut State<D>, model: &mut Model, priors: &[(Row, Group)]) -> bool {
        if self.scene.jerk.is_some() {
            return false;
        }
        let steps = self.steps(model, priors);
        let mut is_torn = false;
        for identity in 0..self.unit.len() {
            let own: Vec<usize> = (0..self.identity.len())
                .filter(|&e| self.identity[e] == identity && self.layout.motion[e].is_some())
                .collect();
            let mut sizes: Vec<f64> = own.iter().filter_map(|&e| steps[e]).collect();
            let usual = median(&mut sizes);
            let most = sizes.last().copied().unwrap_or(0.0);
            if most <= TORN * usual {
                continue;
            }
            // at an end of the motion, the missing step counts as suspect
            let is_suspect =
                |at: usize| own.get(at).and_then(|&e| steps[e]).is_none_or(|s| s > SUSPECT * usual);
            let wrong: Vec<bool> =
                (0..own.len()).map(|at| is_suspect(at) && is_suspect(at + 1)).collect();
            let count = wrong.iter().filter(|&&one| one).count();
            if count == 0 || count as f64 > MOST * own.len() as f64 {
                continue;
            }
            for at in (0..own.len()).filter(|&at| wrong[at]) {
                let right = |other: &usize| !wrong[*other];
                let before = (0..at).rev().find(right).map(|other| own[other]);
                let after = (at..own.len()).find(right).map(|other| own[other]);
                self.bridge(state, own[at], before, after);
            }
            let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
            let less = (usual / mean).powi(2).min(1.0);
            model.jerk[identity] *= less;
            model.acceleration[identity] *= less;
            is_torn = true;
        }
        is_torn
    }

    /// Returns, for each emission, the squared change of the motion since the emission before, in standard
    /// deviations.
    fn steps(&self, model: &Model, priors: &[(Row, Group)]) -> Vec<Option<f64>> {
        let mut rows = priors.iter().filter(|row| matches!(row.1, Group::Motion(..)));
        let mut step = |e: usize| {
            self.layout.motion[e].and(self.previous[e])?;
            let square =
                |(row, group): &(Row, Group)| row.residual.powi(2) / model.variance(*group);
            Some(rows.by_ref().take(3 * D).map(square).sum())
        };
        (0..self.identity.len()).map(&mut step).collect()
    }

    /// Moves an emission to the straight line between two others, or to the extrapolation of the only other
    /// one.
    fn bridge(
        &self,
        state: &mut State<D>,
        emission: usize,
        before: Option<usize>,
        after: Option<usize>,
    ) {
        let unit = self.unit[self.identity[emission]] * self.scene.speed;
        let time = |e: usize| state.emission[e] / unit;
        let place = |e: usize| state.motion[e][0];
        let (from, velocity) = match (before, after) {
            (Some(a), Some(b)) => {
                let dt = time(b) - time(a);
                (a, std::array::from_fn(|i| (place(b)[i] - place(a)[i]) / dt))
            }
            (Some(one), None) | (None, Some(one)) => (one, state.motion[one][1]),
            (None, None) => return,
        };
        let dt = time(emission) - time(from);
        let position = std::array::from_fn(|i| place(from)[i] + velocity[i] * dt);
        state.motion[emission] = [position, velocity, [0.0; D]];
        self.emit(state, |e| e == emission);
    }
}

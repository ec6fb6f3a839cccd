//! The state at every step from all plots (Rauch, Tung, Striebel): the filter forwards, then back.

use super::backward::Filtered;
use super::factored::Factored;
use super::filter::Filter;
use super::series::Series;
use super::state::State;

/// Buffers of the smoother.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    filtered: Vec<(State, Option<Filtered>)>,
}

/// The state at every step from all plots; those before the first plot are unknown, as in the
/// filter. Cost O(steps).
pub fn smooth(
    series: &Series<'_>,
    filter: Filter,
    workspace: &mut Workspace,
    mut sink: impl FnMut(usize, &State),
) {
    let mut filter = filter.factored();
    let filtered = &mut workspace.filtered;
    filtered.clear();
    for (step, &z) in series.z.iter().enumerate() {
        if step > 0 {
            filter.predict(&series.transition.at(step - 1));
        }
        if !z.is_nan() {
            filter.update(z, series.variance.at(step));
        }
        filtered.push((filter.state(), filter.filtered()));
    }
    let mut later: Option<Factored> = None;
    for (step, (shown, filtered)) in filtered.iter().enumerate().rev() {
        later = match (filtered, later) {
            (Some(filtered), Some(next)) => {
                Some(filtered.smoothed(&series.transition.at(step), &next))
            }
            (Some(filtered), None) if filtered.unknown.is_none() => Some(filtered.factored),
            _ => None,
        };
        sink(step, &later.map_or(*shown, |later| later.state()));
    }
}

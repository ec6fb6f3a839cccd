//! The state at every step from all plots: the filter runs forwards, then the smoother backwards.
//!
//! The smoother uses adjoints (Bryson, Frazier 1963). It uses factors (Rauch, Tung, Striebel) where a
//! difference of covariances would lose digits: with a very wide prior, and before angle and rate are
//! known.

use super::adjoint::Adjoint;
use super::backward::Filtered;
use super::factored::Factored;
use super::filter::Filter;
use super::model::Transition;
use super::series::Series;
use super::state::{Innovation, State};

/// Buffers of the smoother.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    steps: Vec<Step>,
}

/// Results of the filter at a step.
#[derive(Clone, Copy, Debug)]
struct Step {
    state: State,
    innovation: Innovation,
    /// The state as factors, if it is not kept as a covariance.
    factors: Option<Filtered>,
}

impl Step {
    fn new(filter: &Filter, innovation: Option<Innovation>) -> Self {
        let factors = if filter.plain().is_some() { None } else { filter.filtered() };
        let innovation = innovation.unwrap_or(Innovation::NONE);
        Self { state: filter.state(), innovation, factors }
    }

    /// Returns the state as factors; `None` before the first plot.
    fn filtered(&self) -> Option<Filtered> {
        let known = self.state.covariance[0].is_finite() && !self.state.mean[0].is_nan();
        self.factors.or_else(|| {
            known.then(|| Filtered { factored: Factored::new(&self.state), unknown: None })
        })
    }

    /// Returns the state if no later plot determines more. At the instant of the plots it is that of the
    /// last step there, which is visited first and kept in `at_once`.
    fn alone(&self, at_once: &mut Option<State>) -> State {
        if self.state.covariance[0].is_finite() {
            *at_once.get_or_insert(self.state)
        } else {
            self.state
        }
    }
}

/// The state at a step from all plots, in the form in which it was computed.
#[derive(Clone, Copy)]
enum Smoothed {
    Unknown,
    Plain(State),
    Factored(Factored),
}

impl Smoothed {
    fn state(&self) -> Option<State> {
        match self {
            Self::Unknown => None,
            Self::Plain(state) => Some(*state),
            Self::Factored(factored) => Some(factored.state()),
        }
    }

    /// Returns the state at the step before, by factors.
    fn before(&self, filtered: Option<Filtered>, transition: &Transition) -> Self {
        let next = match (filtered, self) {
            (None, _) => return Self::Unknown,
            (Some(filtered), Self::Unknown) if filtered.unknown.is_none() => {
                return Self::Factored(filtered.factored);
            }
            (_, Self::Unknown) => return Self::Unknown,
            (_, Self::Plain(state)) => Factored::new(state),
            (_, Self::Factored(factored)) => *factored,
        };
        filtered
            .map_or(Self::Unknown, |filtered| Self::Factored(filtered.smoothed(transition, &next)))
    }
}

/// Computes the state at every step from all plots and passes it to `sink`. The states before the first
/// plot are unknown, as in the filter. O(steps).
pub fn smooth(
    series: &Series<'_>,
    mut filter: Filter,
    workspace: &mut Workspace,
    mut sink: impl FnMut(usize, &State),
) {
    let steps = &mut workspace.steps;
    steps.clear();
    for (step, &z) in series.z.iter().enumerate() {
        if step > 0 {
            filter.predict(&series.transition.at(step - 1));
        }
        let taken = if z.is_nan() { None } else { filter.update(z, series.variance.at(step)) };
        steps.push(Step::new(&filter, taken));
    }
    let (mut adjoint, mut later) = (Some(Adjoint::default()), Smoothed::Unknown);
    // what all plots say of their instant, if they all belong to one: the rate is then never known
    let mut at_once = None;
    for (step, known) in steps.iter().enumerate().rev() {
        later = match adjoint.and_then(|adjoint| adjoint.smoothed(&known.state)) {
            Some(state) => Smoothed::Plain(state),
            None if step + 1 == series.z.len() => later.before(known.filtered(), &Transition::NONE),
            None => later.before(known.filtered(), series.transition.get(step)),
        };
        sink(step, &later.state().unwrap_or_else(|| known.alone(&mut at_once)));
        if step > 0 {
            let seen = !series.z[step].is_nan();
            let plot = seen.then(|| (series.variance.at(step), known.innovation));
            let transition = series.transition.get(step - 1);
            adjoint = adjoint.and_then(|adjoint| adjoint.before(&known.state, plot, transition));
        }
    }
}

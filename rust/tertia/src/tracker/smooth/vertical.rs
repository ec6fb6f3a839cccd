//! How heights change: level flight, or a climb whose rate fades.

use super::mixture::State;
use super::two_filter::{Models, exponential};
use crate::base::exponential::exp;
use crate::base::small::{Matrix, Vector};

/// Number of models.
pub(super) const MODELS: usize = 2;
/// Level flight.
pub(super) const LEVEL: usize = 0;
/// Climb or descent.
pub(super) const CLIMB: usize = 1;

/// Random walk of the height in level flight, m per root of a second.
const LEVEL_WALK: f64 = 0.3;
/// Random walk of the vertical rate, m/s per root of a second, and its standard deviation, m/s.
const CLIMB_WALK: f64 = 0.5;
const CLIMB_SIGMA: f64 = 8.0;
/// Mean duration of level flight and of climbs and descents, s.
const DURATION: [f64; MODELS] = [300.0, 150.0];
/// Standard deviation of an unknown height, m.
const UNKNOWN: f64 = 10e3;

/// Level flight and climbs; states are height and vertical rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertical;

fn rates() -> Matrix<MODELS> {
    let [begins, ends] = DURATION.map(f64::recip);
    [[-begins, begins], [ends, -ends]]
}

impl Models<2, MODELS> for Vertical {
    const SIGNS: Vector<2> = [1.0, -1.0];

    fn backwards(&self) -> Self {
        *self
    }

    fn predict(&self, model: usize, state: &mut State<2>, t: f64) {
        if model == LEVEL {
            state.redraw(CLIMB_SIGMA.powi(2));
            state.covariance[0][0] += LEVEL_WALK.powi(2) * t;
            return;
        }
        let left = exp(-0.5 * t * (CLIMB_WALK / CLIMB_SIGMA).powi(2));
        let [height, climb] = state.mean;
        state.mean = [height + t * climb, left * climb];
        state.transform(&[[1.0, t], [0.0, left]]);
        // the walk moves the height as well
        let q = CLIMB_WALK.powi(2);
        state.covariance[0][0] += q * t * t * t / 3.0;
        state.covariance[0][1] += q * t * t / 2.0;
        state.covariance[1][0] += q * t * t / 2.0;
        state.covariance[1][1] += q * t;
    }

    fn changes(&self, t: f64) -> Matrix<MODELS> {
        exponential(&rates(), t)
    }

    fn variances(&self) -> [f64; MODELS] {
        [CLIMB_SIGMA.powi(2); MODELS]
    }

    fn stationary(&self) -> [f64; MODELS] {
        let [level, climb] = DURATION;
        [level / (level + climb), climb / (level + climb)]
    }

    fn unknown(&self, near: &State<2>) -> State<2> {
        State::new([near.mean[0], 0.0], [UNKNOWN.powi(2), CLIMB_SIGMA.powi(2)])
    }
}

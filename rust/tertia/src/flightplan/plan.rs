//! A flight plan as filed: the route, and the identities of the aircraft that flies it.

use super::route::Route;
use crate::sensors::Identities;
use serde::{Deserialize, Serialize};

/// A route, the parameters of its turns, and the identities of the aircraft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Legs, turns and times.
    pub route: Route,
    /// Bank of the turns, rad.
    pub bank: f64,
    /// Largest rate of turn, rad/s.
    pub turn_rate: f64,
    /// Identities in the replies of the transponder, as far as they are filed.
    pub identities: Identities,
}

impl Plan {
    /// Whether another plan has the same path, perhaps at other times.
    pub fn has_path_of(&self, other: &Self) -> bool {
        let turns = |plan: &Self| (plan.bank, plan.turn_rate);
        turns(self) == turns(other) && self.route.is_along(&other.route)
    }
}

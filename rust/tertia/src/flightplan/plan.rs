//! A flight plan as it is filed: the route and who flies it.

use super::route::Route;
use crate::sensors::Identities;
use serde::{Deserialize, Serialize};

/// A route, the turns it was planned with, and the identities of the aircraft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Its legs, turns and times.
    pub route: Route,
    /// Bank of its turns, rad.
    pub bank: f64,
    /// Largest rate of its turns, rad/s.
    pub turn_rate: f64,
    /// Replies of its transponder, as far as they are filed.
    pub identities: Identities,
}

impl Plan {
    /// Whether another plan has the same path, perhaps at other times.
    pub fn has_path_of(&self, other: &Self) -> bool {
        let turns = |plan: &Self| (plan.bank, plan.turn_rate);
        turns(self) == turns(other) && self.route.is_along(&other.route)
    }
}

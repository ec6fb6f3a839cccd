//! The identities of a target by its replies, single ones of which may be wrong.

use crate::sensors::{Identities, IdentityKind, both};
use crate::tracker::settings::Settings;
use serde::{Deserialize, Serialize};

/// Number of equal replies in a row after which the identity of a track changes.
const CHANGED_AFTER: u8 = 3;
/// Likelihood ratio of an identity: its own target against any other.
pub(in crate::tracker) const IDENTITIES: f64 = 4096.0;
/// Probabilities that a reply contains a wrong address, which is protected by parity; a wrong callsign, which
/// is protected by parity but set by the crew; and a wrong code, which may be garbled and is changed by air
/// traffic control.
pub(in crate::tracker) const ADDRESS_ERROR: f64 = 1e-9;
pub(in crate::tracker) const CALLSIGN_ERROR: f64 = 1e-6;
pub(in crate::tracker) const CODE_ERROR: f64 = 1e-3;

/// Likelihood ratios, one target against two, of equal replies: of addresses and callsigns, which two targets
/// share only by mistake, and of codes that are given to many targets.
const UNSHARED: f64 = 1e6;
const SHARED_BY_MANY: f64 = 5.0;

/// Mode 3/A codes that are given to many targets, such as flights under visual rules.
pub const CODES_OF_MANY: [i16; 5] = [0o0000, 0o1000, 0o1200, 0o2000, 0o7000];

/// Likelihood ratio, one target against two, of two equal replies of this kind.
pub(in crate::tracker) fn rarity(
    kind: IdentityKind,
    reply: &Identities,
    settings: &Settings,
) -> f64 {
    match () {
        () if !settings.is_shared(kind) => UNSHARED,
        () if kind == IdentityKind::Code && CODES_OF_MANY.contains(&reply.mode_3a) => {
            SHARED_BY_MANY
        }
        () => IDENTITIES,
    }
}

/// The replies of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Replies<T> {
    /// The identity by the replies; negative if there was none.
    code: T,
    /// A different reply, and (`times`) how often in a row it was received.
    other: T,
    times: u8,
    /// Whether the code is reliable, which it is not right after a change.
    is_sure: bool,
}

impl<T: Copy + PartialOrd + From<i8>> Replies<T> {
    fn new(code: T) -> Self {
        Self { code, other: code, times: 0, is_sure: false }
    }

    /// Processes one more reply; the code changes only after several equal replies.
    fn answer(&mut self, code: T) {
        let none = T::from(0);
        if code < none {
            return;
        }
        if self.code < none {
            self.code = code;
        }
        if code == self.code {
            (self.is_sure, self.times) = (true, 0);
        } else {
            self.times = if code == self.other { self.times + 1 } else { 1 };
            self.other = code;
            if self.times >= CHANGED_AFTER {
                *self = Self::new(code);
            }
        }
    }

    /// Returns the earlier replies, unless an identity of this kind is known now.
    fn or(self, past: Self) -> Self {
        if self.code < T::from(0) { past } else { self }
    }
}

/// The identities of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::tracker) struct Known {
    icao_address: Replies<i32>,
    mode_3a: Replies<i16>,
    identity: Replies<i64>,
    callsign: Replies<i64>,
}

impl Known {
    pub fn new() -> Self {
        Self {
            icao_address: Replies::new(-1),
            mode_3a: Replies::new(-1),
            identity: Replies::new(-1),
            callsign: Replies::new(-1),
        }
    }

    pub fn identities(&self) -> Identities {
        Identities {
            identity: self.identity.code,
            callsign: self.callsign.code,
            icao_address: self.icao_address.code,
            mode_3a: self.mode_3a.code,
        }
    }

    /// Processes the replies in one more plot.
    pub fn answer(&mut self, reply: &Identities) {
        self.icao_address.answer(reply.icao_address);
        self.mode_3a.answer(reply.mode_3a);
        self.identity.answer(reply.identity);
        self.callsign.answer(reply.callsign);
    }

    /// Adds the identities of the earlier track of the same target, of those kinds that are not known now.
    pub fn or(&self, past: &Self) -> Self {
        Self {
            icao_address: self.icao_address.or(past.icao_address),
            mode_3a: self.mode_3a.or(past.mode_3a),
            identity: self.identity.or(past.identity),
            callsign: self.callsign.or(past.callsign),
        }
    }

    /// Likelihood ratio of the replies in a plot: this target against any other. If both have an address, it
    /// alone decides. Otherwise each kind that differs is wrong with its own probability, and the agreement
    /// of several kinds counts once, because false plots of a target have all its identities.
    #[inline]
    pub fn ratio(&self, reply: &Identities, settings: &Settings) -> f64 {
        if let Some(is_same) = both(self.icao_address.code, reply.icao_address) {
            return if is_same { (1.0 - ADDRESS_ERROR) * IDENTITIES } else { ADDRESS_ERROR };
        }
        let (mut ratio, mut agrees) = (1.0, false);
        let mut compare = |is_same: Option<bool>, error: f64| {
            if let Some(is_same) = is_same {
                ratio *= if is_same { 1.0 - error } else { error };
                agrees |= is_same;
            }
        };
        let number_error = settings.identity_error_probability;
        compare(both(self.identity.code, reply.identity), number_error);
        compare(both(self.callsign.code, reply.callsign), CALLSIGN_ERROR);
        compare(both(self.mode_3a.code, reply.mode_3a), CODE_ERROR);
        if agrees { ratio * IDENTITIES } else { ratio }
    }

    /// Whether it may refuse plots: those of another address.
    #[inline]
    pub fn may_refuse(&self, settings: &Settings) -> bool {
        self.icao_address.code >= 0 || settings.has_addresses() && self.identity.is_sure
    }

    /// Whether the plot has another address than the target, whose own has not changed just before.
    #[inline]
    pub fn refuses(&self, reply: &Identities, settings: &Settings) -> bool {
        if let Some(is_same) = both(self.icao_address.code, reply.icao_address) {
            return !is_same && self.icao_address.is_sure;
        }
        settings.has_addresses()
            && self.identity.is_sure
            && both(self.identity.code, reply.identity) == Some(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracker::motion::Motion;

    fn settings() -> Settings {
        Settings::new(Vec::new(), Motion::Cv(1.0))
    }

    fn known(reply: Identities) -> Known {
        let mut known = Known::new();
        known.answer(&reply);
        known
    }

    const ALL: Identities = Identities { identity: -1, callsign: 5, icao_address: 7, mode_3a: 9 };

    #[test]
    fn an_address_alone_decides() {
        let (own, settings) = (known(ALL), settings());
        let other = Identities { callsign: 6, mode_3a: 8, ..ALL };
        assert_eq!(own.ratio(&other, &settings), own.ratio(&ALL, &settings));
        let stranger = Identities { icao_address: 1, ..ALL };
        assert_eq!(own.ratio(&stranger, &settings), ADDRESS_ERROR);
        assert!(own.refuses(&stranger, &settings) && !own.refuses(&other, &settings));
        // a plot without an address is not refused
        assert!(!own.refuses(&Identities { icao_address: -1, ..other }, &settings));
    }

    #[test]
    fn agreement_counts_once_and_each_contradiction() {
        let (own, settings) = (known(ALL), settings());
        let of = |callsign, mode_3a| {
            let reply = Identities { callsign, mode_3a, ..Identities::NONE };
            own.ratio(&reply, &settings)
        };
        let right = [CALLSIGN_ERROR, CODE_ERROR].map(|error| 1.0 - error);
        assert_eq!(of(5, 9), right[0] * right[1] * IDENTITIES);
        assert_eq!(of(5, 1), right[0] * CODE_ERROR * IDENTITIES);
        assert_eq!(of(6, 9), CALLSIGN_ERROR * right[1] * IDENTITIES);
        assert_eq!(of(6, 1), CALLSIGN_ERROR * CODE_ERROR);
        assert_eq!(of(-1, -1), 1.0);
        let number = known(Identities::of(3));
        let p = settings.identity_error_probability;
        assert_eq!(number.ratio(&Identities::of(3), &settings), (1.0 - p) * IDENTITIES);
        assert_eq!(number.ratio(&Identities::of(4), &settings), p);
    }

    #[test]
    fn each_kind_changes_by_itself_after_three_equal_replies() {
        let mut own = known(ALL);
        let new = Identities { mode_3a: 1, ..ALL };
        own.answer(&new);
        own.answer(&ALL);
        own.answer(&new);
        own.answer(&new);
        assert_eq!(own.identities(), ALL);
        own.answer(&new);
        assert_eq!(own.identities(), new);
        own.answer(&Identities::of(2));
        assert_eq!(own.identities(), Identities { identity: 2, ..new });
        assert_eq!(
            known(Identities::of(2)).or(&known(ALL)).identities(),
            Identities { identity: 2, ..ALL }
        );
    }
}

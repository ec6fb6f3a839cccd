//! Identities: the information of a transponder on the identity of its target.

use serde::{Deserialize, Serialize};

/// Number of characters of an aircraft identification, and number of bits of each.
const LETTERS: usize = 8;
const BITS: usize = 6;
/// Code of a space, and ASCII code of the character whose code is 0.
const SPACE: i64 = 32;
const LETTER: u32 = 0x40;

/// Identities of a target by kind; negative if unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Identities {
    /// Any other number that stays with the target.
    pub identity: i64,
    /// Aircraft identification: eight characters, the first in the highest bits, each as the six lowest
    /// bits of its ASCII code (ICAO Annex 10, volume IV, 3.1.2.9), including characters that are not
    /// allowed there.
    pub callsign: i64,
    /// 24-bit address.
    pub icao_address: i32,
    /// 12-bit mode 3/A code.
    pub mode_3a: i16,
}

/// A kind of identity, in the order of how rarely it is shared by several targets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdentityKind {
    /// 24-bit address.
    Address,
    /// Any other number.
    Number,
    /// Aircraft identification.
    Callsign,
    /// Mode 3/A code.
    Code,
}

impl Default for Identities {
    fn default() -> Self {
        Self::NONE
    }
}

impl Identities {
    /// No identity of any kind.
    pub const NONE: Self = Self { identity: -1, callsign: -1, icao_address: -1, mode_3a: -1 };

    /// Returns an identity that is only a number.
    pub fn of(identity: i64) -> Self {
        Self { identity, ..Self::NONE }
    }

    /// Whether an identity of any kind is known.
    #[inline]
    pub fn is_some(&self) -> bool {
        // the result is negative only if all are negative
        self.identity & self.callsign & i64::from(self.icao_address) & i64::from(self.mode_3a) >= 0
    }

    /// Returns these identities, with unknown kinds replaced by those of another target report.
    pub fn or(&self, other: &Self) -> Self {
        let [identity, callsign] =
            [(self.identity, other.identity), (self.callsign, other.callsign)]
                .map(|(own, other)| if own < 0 { other } else { own });
        let icao_address =
            if self.icao_address < 0 { other.icao_address } else { self.icao_address };
        let mode_3a = if self.mode_3a < 0 { other.mode_3a } else { self.mode_3a };
        Self { identity, callsign, icao_address, mode_3a }
    }

    /// Whether any kind that both have differs.
    pub(crate) fn contradicts(&self, other: &Self) -> bool {
        let numbers = [both(self.identity, other.identity), both(self.callsign, other.callsign)];
        let codes =
            [both(self.icao_address, other.icao_address), both(self.mode_3a, other.mode_3a)];
        numbers.into_iter().chain(codes).any(|is_same| is_same == Some(false))
    }

    /// Compares the kind that is shared most rarely among those that both have. Returns it and whether it is
    /// equal; `None` if they have no kind in common.
    pub fn compare(&self, other: &Self) -> Option<(IdentityKind, bool)> {
        let of = |kind: IdentityKind| move |is_same: bool| (kind, is_same);
        both(self.icao_address, other.icao_address)
            .map(of(IdentityKind::Address))
            .or_else(|| both(self.identity, other.identity).map(of(IdentityKind::Number)))
            .or_else(|| both(self.callsign, other.callsign).map(of(IdentityKind::Callsign)))
            .or_else(|| both(self.mode_3a, other.mode_3a).map(of(IdentityKind::Code)))
    }

    /// Whether both belong to the same target, according to [`Self::compare`].
    pub fn same(&self, other: &Self) -> Option<bool> {
        self.compare(other).map(|(_, is_same)| is_same)
    }
}

/// Whether two identities of a kind are equal; `None` if one is unknown.
#[inline]
pub(crate) fn both<T: Copy + PartialOrd + From<i8>>(a: T, b: T) -> Option<bool> {
    let none = T::from(0);
    (a >= none && b >= none).then_some(a == b)
}

/// Converts a callsign to its number. Characters are from 0x20 to 0x5F of ASCII, with zeros at the end; an
/// empty callsign gives −1.
pub fn callsign_number(text: [u32; LETTERS]) -> i64 {
    let code = |letter: u32| if letter == 0 { SPACE } else { i64::from(letter & 63) };
    let blank = text.iter().all(|&letter| code(letter) == SPACE);
    if blank { -1 } else { text.iter().fold(0, |sum, &letter| sum << BITS | code(letter)) }
}

/// Converts a number to the characters of a callsign, with zeros in place of trailing spaces.
pub fn callsign_text(number: i64) -> [u32; LETTERS] {
    let mut text = [0; LETTERS];
    if number < 0 {
        return text;
    }
    let mut is_end = true;
    for (at, letter) in text.iter_mut().enumerate().rev() {
        let code = (number >> (BITS * (LETTERS - 1 - at)) & 63) as u32;
        is_end &= i64::from(code) == SPACE;
        if !is_end {
            *letter = if i64::from(code) < SPACE { code + LETTER } else { code };
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn letters(text: &str) -> [u32; LETTERS] {
        let mut letters = [0; LETTERS];
        letters.iter_mut().zip(text.chars()).for_each(|(letter, c)| *letter = c.into());
        letters
    }

    #[test]
    fn callsigns_are_coded_as_by_transponders() {
        // the message 8D4840D6202CC371C32CE0576098 (Sun, The 1090 Megahertz Riddle, 2021)
        assert_eq!(callsign_number(letters("KLM1023 ")), 0x2CC3_71C3_2CE0);
        for text in ["A", "CSA123", "N-123_AB", "@", " X", "00000000", "\\^]["] {
            let number = callsign_number(letters(text));
            assert_eq!(callsign_text(number), letters(text), "{text}");
            assert_eq!(callsign_number(letters(&format!("{text}  "))), number);
        }
        assert_eq!(callsign_number(letters("")), -1);
        assert_eq!(callsign_number(letters("   ")), -1);
        assert_eq!(callsign_text(-1), [0; LETTERS]);
    }

    #[test]
    fn the_kind_that_is_shared_least_decides() {
        let one = Identities { icao_address: 1, callsign: 5, mode_3a: 7, identity: -1 };
        assert_eq!(one.same(&Identities { mode_3a: 8, callsign: 6, ..one }), Some(true));
        assert_eq!(one.same(&Identities { icao_address: 2, ..one }), Some(false));
        let silent = Identities { icao_address: -1, ..one };
        assert_eq!(one.same(&Identities { mode_3a: 8, ..silent }), Some(true));
        assert_eq!(one.same(&Identities { callsign: 6, ..silent }), Some(false));
        assert_eq!(one.same(&Identities { mode_3a: 7, ..Identities::NONE }), Some(true));
        assert_eq!(one.same(&Identities::of(3)), None);
        assert!(one.is_some() && !Identities::default().is_some());
    }
}

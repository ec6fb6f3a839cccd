use super::blocks::{Blocks, HEADER, header};
use super::decode::whole_records;
use super::definition::definitions;

/// Number of successive blocks, with all but one of known categories, that cannot be a coincidence.
const CHAIN: usize = 6;

/// Largest number of bytes that are decoded to find blocks, per byte of the recording: data that were
/// made to look like blocks everywhere must not take longer. Noise requires about five.
const EFFORT: usize = 64;

/// A place at which data blocks are not consecutive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Index of the first byte at which no data block begins, or of the first byte of a block with a
    /// wrong length.
    pub at: usize,
    /// Number of bytes that belong to no data block; 0 for a block with a wrong length.
    pub lost: usize,
}

/// Finds the data blocks of a recording, also after a damaged length or foreign bytes. O(bytes).
///
/// `known` contains the plausible categories. The next block begins at the end of a block if a chain of
/// blocks begins there, or a block that can be decoded. Otherwise the next block is the first one of a
/// known category that can be decoded and is followed by the header of a known category. The previous
/// block then ends there at the latest, and the bytes between form a block if they can be decoded as
/// one. Data that look like blocks everywhere, but are none, end the search.
pub fn recover(bytes: &[u8], known: &[u8]) -> (Blocks, Vec<Gap>) {
    let mut categories = [false; 256];
    for &category in known {
        categories[usize::from(category)] = true;
    }
    Search { bytes, known: categories, left: EFFORT * bytes.len() }.blocks()
}

struct Search<'a> {
    bytes: &'a [u8],
    known: [bool; 256],
    /// Number of bytes that the search may still decode.
    left: usize,
}

impl Search<'_> {
    fn blocks(mut self) -> (Blocks, Vec<Gap>) {
        let (mut found, mut gaps) = (Blocks::default(), Vec::new());
        while found.stop < self.bytes.len() {
            let at = found.stop;
            let block = self.header(at).filter(|_| self.is_begun(at, found.category.is_empty()));
            if let Some((category, end)) = block {
                push(&mut found, category, at, end);
                continue;
            }
            // the previous block may be shorter than its stated length
            let before = found.begin.last().copied().unwrap_or(0);
            let next = self.next(before).unwrap_or(self.bytes.len());
            let mut lost = next.saturating_sub(at);
            if next < at {
                found.end.pop();
                found.end.push(next);
            } else if self.is_known(at) && self.is_whole(self.bytes[at], at + HEADER, next) {
                push(&mut found, self.bytes[at], at, next);
                lost = 0;
            }
            gaps.push(Gap { at: if next < at { before - HEADER } else { at }, lost });
            found.stop = next;
        }
        (found, gaps)
    }

    /// Whether a data block begins here; the first block must be of a known category.
    fn is_begun(&mut self, at: usize, is_first: bool) -> bool {
        (!is_first || self.is_known(at)) && self.is_followed(at) || self.is_sound(at)
    }

    /// Returns category and end of a data block.
    fn header(&self, at: usize) -> Option<(u8, usize)> {
        header(self.bytes, at)
    }

    fn is_known(&self, at: usize) -> bool {
        self.bytes.get(at).is_some_and(|&category| self.known[usize::from(category)])
    }

    /// Whether a chain of blocks begins here, which may be shorter at the end of the recording.
    fn is_followed(&self, mut at: usize) -> bool {
        let (mut strange, mut before) = (0, None);
        for _ in 0..CHAIN {
            if at == self.bytes.len() {
                return true;
            }
            let Some((category, end)) = self.header(at) else {
                return false;
            };
            // an unknown category counts once, even if it is repeated
            strange += usize::from(!self.is_known(at) && before != Some(category));
            (at, before) = (end, Some(category));
        }
        strange <= 1
    }

    /// Whether a block can be decoded completely.
    fn is_sound(&mut self, at: usize) -> bool {
        self.header(at).is_some_and(|(category, end)| self.is_whole(category, at + HEADER, end))
    }

    fn is_whole(&mut self, category: u8, begin: usize, end: usize) -> bool {
        let records = self.bytes.get(begin..end).unwrap_or_default();
        !records.is_empty()
            && definitions().iter().filter(|one| one.category == category).any(|one| {
                let decoded = whole_records(one, records);
                self.left = self.left.saturating_sub(decoded);
                decoded == records.len()
            })
    }

    fn next(&mut self, from: usize) -> Option<usize> {
        let found = (from..self.bytes.len()).find(|&at| {
            let ends = |(_, end)| end == self.bytes.len() || self.is_known(end);
            let is_there = self.is_known(at) && self.header(at).is_some_and(ends);
            is_there && self.is_sound(at) || self.left == 0
        });
        found.filter(|_| self.left > 0)
    }
}

fn push(found: &mut Blocks, category: u8, at: usize, end: usize) {
    found.category.push(category);
    found.begin.push(at + HEADER);
    found.end.push(end);
    found.stop = end;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asterix::blocks;

    const KNOWN: [u8; 3] = [34, 48, 65];

    /// Twelve blocks of one plot each, with some service messages.
    fn recording() -> Vec<u8> {
        let plot = [48, 0, 16, 0xF8, 23, 2, 0x42, 0x51, 0xE6, 0xA0, 0x40, 1, 0x20, 2, 0x04, 0xD2];
        let mut bytes = Vec::new();
        for k in 0..12 {
            bytes.extend(plot);
            if k % 4 == 0 {
                bytes.extend([34, 0, 7, 0xC0, 23, 2, 1]);
            }
        }
        bytes
    }

    fn whole(bytes: &[u8]) -> usize {
        recover(bytes, &KNOWN).0.category.len()
    }

    #[test]
    fn without_damage_blocks_are_the_same() {
        let bytes = recording();
        assert_eq!(recover(&bytes, &KNOWN), (blocks(&bytes), Vec::new()));
    }

    #[test]
    fn a_length_too_small_or_too_large_is_found() {
        let bytes = recording();
        let all = blocks(&bytes);
        for block in 0..all.category.len() {
            let at = all.begin[block] - HEADER;
            for length in [0, 4, 5, 9, 20, 60, 100, 9_999_u16] {
                let mut damaged = bytes.clone();
                damaged[at + 1..at + 3].copy_from_slice(&length.to_be_bytes());
                let (found, gaps) = recover(&damaged, &KNOWN);
                assert_eq!(found, all, "{block} {length}");
                assert_eq!(gaps, [Gap { at, lost: 0 }]);
            }
        }
    }

    #[test]
    fn other_bytes_are_passed_over() {
        let bytes = recording();
        for noise in [&b"\0\0\0\0"[..], b"48,12.5,seconds\r\n", &[0xFF; 40], &[48, 0, 5, 1]] {
            for at in [0, 16, 39] {
                let mut damaged = bytes.clone();
                damaged.splice(at..at, noise.iter().copied());
                let (found, gaps) = recover(&damaged, &KNOWN);
                assert_eq!(found.category.len(), whole(&bytes));
                assert_eq!(gaps, [Gap { at, lost: noise.len() }]);
            }
        }
    }

    #[test]
    fn text_has_no_blocks() {
        let text: Vec<u8> =
            (0..2000).flat_map(|k| format!("{k},48 0,A,{}\n", k * k).into_bytes()).collect();
        let (found, gaps) = recover(&text, &KNOWN);
        assert!(found.category.is_empty());
        assert_eq!(gaps, [Gap { at: 0, lost: text.len() }]);
    }

    /// Blocks and gaps adjoin each other for any bytes.
    #[test]
    fn all_bytes_are_accounted_for() {
        for octet in 0..=255 {
            let mut bytes = recording();
            bytes.extend([octet; 300]);
            bytes.extend(recording());
            let (found, gaps) = recover(&bytes, &KNOWN);
            let held: usize =
                found.begin.iter().zip(&found.end).map(|(at, end)| end - at + 3).sum();
            assert_eq!(held + gaps.iter().map(|gap| gap.lost).sum::<usize>(), bytes.len());
            assert!(found.category.len() >= 2 * whole(&recording()) - 1, "{octet}");
        }
    }

    /// A block of 12 kilobytes, whose first records can be decoded, follows each byte.
    #[test]
    fn what_looks_like_blocks_everywhere_ends_the_search() {
        let mut bytes = vec![48; 60_000];
        bytes[9..].iter_mut().step_by(6_000).for_each(|octet| *octet = 0);
        let mut search = Search { bytes: &bytes, known: [true; 256], left: 1_000_000 };
        assert_eq!(search.next(0), None);
        assert_eq!(search.left, 0);
    }
}

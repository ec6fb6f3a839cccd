//! The tracks that a registrar follows, by their numbers.

use super::followed::Followed;
use crate::base::mixed::IntegerMap;
use serde::{Deserialize, Serialize};

/// Tracks in contiguous memory. Rows find them by an index that exists only while rows are followed, so
/// dropping tracks costs nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Roster {
    /// Tracks in order of their numbers, except new ones.
    tracks: Vec<(i64, Followed)>,
    #[serde(skip)]
    places: IntegerMap<usize>,
}

impl Roster {
    /// Starts following rows. Cost O(tracks).
    pub fn open(&mut self) {
        let numbers = self.tracks.iter().map(|(number, _)| *number);
        self.places.extend(numbers.zip(0..));
    }

    /// Returns the place of a track, which is valid until `close`, and whether the track is new. `new`
    /// creates the track if there is none of this number.
    #[inline]
    pub fn place(&mut self, number: i64, new: impl FnOnce() -> Followed) -> (usize, bool) {
        let end = self.tracks.len();
        let place = *self.places.entry(number).or_insert(end);
        if place == end {
            self.tracks.push((number, new()));
        }
        (place, place == end)
    }

    /// Returns the track at a place.
    #[inline]
    pub fn at(&mut self, place: usize) -> &mut Followed {
        &mut self.tracks[place].1
    }

    /// Stops following rows.
    pub fn close(&mut self) {
        self.places.clear();
        if !self.tracks.is_sorted_by_key(|(number, _)| *number) {
            self.tracks.sort_unstable_by_key(|(number, _)| *number);
        }
    }

    /// Returns the track of this number.
    #[cfg(test)]
    pub fn get(&self, number: i64) -> Option<&Followed> {
        let at = self.tracks.binary_search_by_key(&number, |(number, _)| *number).ok()?;
        Some(&self.tracks[at].1)
    }

    /// Returns all tracks, in order of their numbers.
    pub fn all(&self) -> impl Iterator<Item = &Followed> {
        self.tracks.iter().map(|(_, track)| track)
    }

    /// Returns all tracks with their numbers, for changes.
    pub fn all_mut(&mut self) -> impl ExactSizeIterator<Item = (i64, &mut Followed)> {
        self.tracks.iter_mut().map(|(number, track)| (*number, track))
    }

    /// Drops the tracks for which `keep` is false.
    pub fn retain(&mut self, mut keep: impl FnMut(i64, &Followed) -> bool) {
        self.tracks.retain(|(number, track)| keep(*number, track));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_are_found_by_their_numbers_whatever_the_order_in_which_they_came() {
        let mut roster = Roster::default();
        let numbers = [7, 3, 1 << 40, 4, 3, 7];
        roster.open();
        let places = numbers.map(|number| roster.place(number, || Followed::new(number as f64)));
        assert_eq!(places.map(|(_, is_new)| is_new), [true, true, true, true, false, false]);
        assert_eq!([places[4].0, places[5].0], [places[1].0, places[0].0]);
        assert_eq!(roster.at(places[3].0).row_time, 4.0);
        roster.close();
        let times: Vec<f64> = roster.all().map(|track| track.row_time).collect();
        assert_eq!(times, [3.0, 4.0, 7.0, (1_u64 << 40) as f64]);
        roster.retain(|number, _| number != 4);
        roster.open();
        assert!(!roster.place(7, || Followed::new(0.0)).1);
        roster.close();
        assert_eq!(roster.get(7).map(|track| track.row_time), Some(7.0));
        assert_eq!(roster.get(4), None);
        assert_eq!(roster.all_mut().len(), 3);
    }
}

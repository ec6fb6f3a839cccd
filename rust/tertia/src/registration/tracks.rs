//! The tracks that a registrar follows, by their numbers.

use super::followed::Followed;
use crate::base::mixed::IntegerMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::hash_map::Entry;

/// Tracks by their numbers. New tracks take the places of dropped ones, and their memory: most tracks are those
/// of false plots, which end soon.
#[derive(Clone, Debug, Default)]
pub(super) struct Roster {
    followed: Vec<Followed>,
    /// Numbers and places of the tracks, in order of their numbers, except those that came since `close`.
    order: Vec<(i64, usize)>,
    places: IntegerMap<usize>,
    free: Vec<usize>,
}

impl Roster {
    /// Returns the place of a track, which is valid until the track is dropped, and whether the track is new: it
    /// then starts at this time.
    #[inline]
    pub fn place(&mut self, number: i64, time: impl FnOnce() -> f64) -> (usize, bool) {
        let entry = match self.places.entry(number) {
            Entry::Occupied(known) => return (*known.get(), false),
            Entry::Vacant(entry) => entry,
        };
        let place = self.free.pop().unwrap_or(self.followed.len());
        match self.followed.get_mut(place) {
            Some(dropped) => dropped.restart(time()),
            None => self.followed.push(Followed::new(time())),
        }
        self.order.push((number, *entry.insert(place)));
        (place, true)
    }

    /// Returns the track at a place.
    #[inline]
    pub fn at(&mut self, place: usize) -> &mut Followed {
        &mut self.followed[place]
    }

    /// Puts new tracks into the order of numbers.
    pub fn close(&mut self) {
        self.order.sort_by_key(|(number, _)| *number);
    }

    /// Returns all tracks, in order of their numbers.
    pub fn all(&self) -> impl Iterator<Item = &Followed> {
        self.numbered().map(|(_, track)| track)
    }

    /// Returns all tracks with their numbers.
    fn numbered(&self) -> impl ExactSizeIterator<Item = (i64, &Followed)> {
        self.order.iter().map(|&(number, place)| (number, &self.followed[place]))
    }

    /// Changes all tracks, in order of their numbers; returns the results.
    pub fn change<T>(&mut self, mut change: impl FnMut(i64, &mut Followed) -> T) -> Vec<T> {
        let change = |&(number, place): &(i64, usize)| change(number, &mut self.followed[place]);
        self.order.iter().map(change).collect()
    }

    /// Returns what is at each place, dropped tracks too.
    pub fn places_mut(&mut self) -> impl Iterator<Item = &mut Followed> {
        self.followed.iter_mut()
    }

    /// Drops the tracks for which `keep` is false.
    pub fn retain(&mut self, mut keep: impl FnMut(i64, &Followed) -> bool) {
        self.order.retain(|&(number, place)| {
            let is_kept = keep(number, &self.followed[place]);
            if !is_kept {
                self.places.remove(&number);
                self.free.push(place);
            }
            is_kept
        });
    }
}

/// The same tracks, whatever their places.
impl PartialEq for Roster {
    fn eq(&self, other: &Self) -> bool {
        self.numbered().eq(other.numbered())
    }
}

/// The tracks with their numbers.
impl Serialize for Roster {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.numbered())
    }
}

impl<'de> Deserialize<'de> for Roster {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let tracks = Vec::<(i64, Followed)>::deserialize(deserializer)?;
        let order: Vec<_> = tracks.iter().map(|(number, _)| *number).zip(0..).collect();
        let places = order.iter().copied().collect();
        let followed = tracks.into_iter().map(|(_, track)| track).collect();
        Ok(Self { followed, order, places, free: Vec::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::state::{restored, saved};

    #[test]
    fn tracks_are_found_by_their_numbers_whatever_the_order_in_which_they_came() {
        let mut roster = Roster::default();
        let numbers = [7, 3, 1 << 40, 4, 3, 7];
        let places = numbers.map(|number| roster.place(number, || number as f64));
        assert_eq!(places.map(|(_, is_new)| is_new), [true, true, true, true, false, false]);
        assert_eq!([places[4].0, places[5].0], [places[1].0, places[0].0]);
        assert_eq!(roster.at(places[3].0).row_time, 4.0);
        roster.close();
        let times =
            |roster: &Roster| -> Vec<f64> { roster.all().map(|track| track.row_time).collect() };
        assert_eq!(times(&roster), [3.0, 4.0, 7.0, (1_u64 << 40) as f64]);
        roster.at(places[3].0).see(4.0, 1, [1.0; 2], [2.0; 2]);
        roster.retain(|number, _| number != 4);
        assert_eq!(roster.place(7, || 0.0), (places[0].0, false));
        // a new track has nothing of the dropped one at its place
        assert_eq!(roster.place(5, || 5.0), (places[3].0, true));
        assert_eq!(*roster.at(places[3].0), Followed::new(5.0));
        roster.close();
        assert_eq!(times(&roster), [3.0, 5.0, 7.0, (1_u64 << 40) as f64]);
        let mut again: Roster = restored(&saved(&roster)).unwrap();
        assert_eq!(again, roster);
        assert!(!again.place(5, || 0.0).1);
        assert!(again.place(4, || 4.0).1);
        assert_ne!(again, roster);
    }
}

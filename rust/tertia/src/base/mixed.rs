//! Maps with integer keys from trusted sources, without the cost of a hash function that resists attacks.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// A map with 64-bit integers as keys.
pub(crate) type IntegerMap<V> = HashMap<i64, V, BuildHasherDefault<Mixed>>;

/// The key of a pair of integers, such as a cell in the plane.
pub(crate) fn key((i, j): (i32, i32)) -> i64 {
    (i64::from(i) << 32) | i64::from(j as u32)
}

/// The pair of integers of a key.
pub(crate) fn pair(key: i64) -> (i32, i32) {
    ((key >> 32) as i32, key as i32)
}

/// The entries, in the order of their keys.
pub(crate) fn sorted<V: Copy>(map: &IntegerMap<V>) -> Vec<(i64, V)> {
    let mut list: Vec<(i64, V)> = map.iter().map(|(key, value)| (*key, *value)).collect();
    list.sort_unstable_by_key(|(key, _)| *key);
    list
}

/// Saves a map in the order of its keys, so that equal maps are saved alike.
pub(crate) fn in_order<V: Copy + Serialize, S: Serializer>(
    map: &IntegerMap<V>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    sorted(map).serialize(serializer)
}

/// Restores a map that [`in_order`] has saved.
pub(crate) fn from_list<'de, V: Deserialize<'de>, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<IntegerMap<V>, D::Error> {
    Ok(Vec::deserialize(deserializer)?.into_iter().collect())
}

/// Hash function of an integer.
#[derive(Clone, Default)]
pub(crate) struct Mixed(u64);

impl Hasher for Mixed {
    fn write(&mut self, _: &[u8]) {
        unreachable!("the keys are integers of 64 bits")
    }

    fn write_i64(&mut self, number: i64) {
        let product = (number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 = product ^ (product >> 32);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

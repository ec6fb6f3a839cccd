//! Maps with integer keys from trusted sources, without the cost of a hash function that resists attacks.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// A map with 64-bit integers as keys.
pub(crate) type IntegerMap<V> = HashMap<i64, V, BuildHasherDefault<Mixed>>;

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

//! States of objects as bytes, with a checksum against damage.

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Version of the format of saved states; it changes with the fields of a tracker.
const FORMAT: u64 = 28;
/// Initial value and factor of the hash function FNV-1a.
const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_FACTOR: u64 = 0x0000_0100_0000_01b3;

/// Returns the complete state of an object, exact to the last bit.
///
/// # Panics
/// Never: every state can be serialised.
pub(crate) fn saved(object: &impl Serialize) -> Vec<u8> {
    let mut bytes = postcard::to_stdvec(object).expect("vectors grow");
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// Restores a saved object; `None` if the bytes are invalid or damaged.
pub(crate) fn restored<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    let (state, sum) = bytes.split_last_chunk()?;
    let is_whole = checksum(state) == u64::from_le_bytes(*sum);
    is_whole.then(|| postcard::from_bytes(state).ok())?
}

/// FNV-1a of a saved state. If a single bit of the state has changed, none of its values can be trusted.
fn checksum(state: &[u8]) -> u64 {
    let step = |sum: u64, &byte: &u8| (sum ^ u64::from(byte)).wrapping_mul(FNV_FACTOR);
    state.iter().fold(FNV_START ^ FORMAT, step)
}

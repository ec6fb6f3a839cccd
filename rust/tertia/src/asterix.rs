//! Records of ASTERIX as columns of whole numbers.
//!
//! | module | what |
//! |---|---|
//! | `blocks` | where the data blocks of a recording are |
//! | `resync` | the same in a damaged recording |
//! | `definition` | the published structures of records, and which fields become columns |
//! | `decode` | records to columns |
//! | `clock` | truncated times of day, completed by full ones |
//!
//! Bytes come from the caller; nothing here opens a file.

mod blocks;
mod clock;
mod decode;
mod definition;
#[cfg(test)]
mod fuzz;
mod resync;

pub use blocks::{Blocks, blocks};
pub use clock::complete_times;
pub use decode::{Damage, Records, decode};
pub use definition::{Definition, Field, definitions};
pub use resync::{Gap, recover};

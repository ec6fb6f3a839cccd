//! Decoding of ASTERIX records into columns of whole numbers.
//!
//! | module | contents |
//! |---|---|
//! | `blocks` | positions of the data blocks in a recording |
//! | `resync` | positions of the data blocks in a damaged recording |
//! | `definition` | the published structures of records, and the fields that become columns |
//! | `decode` | conversion of records to columns |
//! | `clock` | completion of truncated times of day from full ones |
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

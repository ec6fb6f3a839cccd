//! Records of ASTERIX as columns of whole numbers.
//!
//! | module | what |
//! |---|---|
//! | `blocks` | where the data blocks of a recording are |
//! | `definition` | the published structures of records, and which fields become columns |
//! | `decode` | records to columns |
//!
//! Bytes come from the caller; nothing here opens a file.

mod blocks;
mod decode;
mod definition;

pub use blocks::{Blocks, blocks};
pub use decode::{Damage, Records, decode};
pub use definition::{Definition, Field, definitions};

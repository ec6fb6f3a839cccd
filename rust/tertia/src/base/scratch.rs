//! Buffers whose memory is reused from one call to the next.

use std::fmt;

/// Resizes a buffer and fills it with a value.
#[inline(always)]
pub(crate) fn refill<T: Clone>(buffer: &mut Vec<T>, length: usize, value: T) {
    buffer.clear();
    buffer.resize(length, value);
}

/// Buffers that do not count as part of the state that contains them: a copy of the state begins with empty
/// buffers, and two states are equal whatever their buffers contain.
#[derive(Default)]
pub(crate) struct Scratch<T>(pub T);

impl<T: Default> Clone for Scratch<T> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl<T> PartialEq for Scratch<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl<T> fmt::Debug for Scratch<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Scratch")
    }
}

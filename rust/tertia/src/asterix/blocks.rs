/// Size of the header of a data block: category and length.
pub(super) const HEADER: usize = 3;

/// Data blocks of a recording: their categories, and the first and last bytes of their records.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Blocks {
    /// Category of each data block.
    pub category: Vec<u8>,
    /// Index of the first byte of each block after the header.
    pub begin: Vec<usize>,
    /// Index after the last byte of each block.
    pub end: Vec<usize>,
    /// Index at which the last block ends: the end of the recording, unless other bytes follow.
    pub stop: usize,
}

/// Finds consecutive data blocks, until there is none or one is truncated. O(blocks).
pub fn blocks(bytes: &[u8]) -> Blocks {
    let mut found = Blocks::default();
    while let Some((category, end)) = header(bytes, found.stop) {
        found.category.push(category);
        found.begin.push(found.stop + HEADER);
        found.stop = end;
        found.end.push(end);
    }
    found
}

/// Category and end of the data block that begins at this index, if there can be one.
pub(super) fn header(bytes: &[u8], at: usize) -> Option<(u8, usize)> {
    let &[category, high, low] = bytes.get(at..at + HEADER)? else {
        return None;
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    (length > HEADER && at + length <= bytes.len()).then_some((category, at + length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_end_where_the_next_begins() {
        let found = blocks(&[48, 0, 4, 7, 34, 0, 5, 1, 2, 48, 0, 9, 1]);
        assert_eq!(found.category, [48, 34]);
        assert_eq!((found.begin, found.end), (vec![3, 7], vec![4, 9]));
        assert_eq!(found.stop, 9);
    }

    #[test]
    fn a_block_of_no_length_is_none() {
        for bytes in [&[48, 0, 3][..], &[48, 0, 0, 1], &[48, 0], &[]] {
            assert_eq!(blocks(bytes), Blocks::default());
        }
    }
}

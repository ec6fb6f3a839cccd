use super::definition::{Definition, Items, Octets, Structure};

/// Value of a field that the record does not contain.
const MISSING: i64 = i64::MIN;
const CUT_OFF: &str = "it is cut off";
const TOO_LONG: &str = "its FSPEC is too long";

/// Decoded records, as columns.
#[derive(Debug, Default)]
pub struct Records {
    /// Data block of each record, as numbered by the caller.
    pub block: Vec<usize>,
    /// One column for each field of the definition; `i64::MIN` if the record does not contain the field.
    pub columns: Vec<Vec<i64>>,
    /// Places where data blocks are damaged.
    pub damage: Vec<Damage>,
}

/// A record that cannot be decoded; the rest of its data block is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Index of the data block.
    pub block: usize,
    /// Index of the first byte of the record in the recording.
    pub at: usize,
    /// What is wrong with the record.
    pub reason: &'static str,
}

/// Decodes data blocks, whose records are `bytes[begin..end]`.
///
/// The rest of a block after a record that does not conform to the definition is left out. O(bytes); a range
/// beyond the bytes counts as an empty block.
pub fn decode(
    definition: &Definition,
    bytes: &[u8],
    blocks: impl Iterator<Item = (usize, usize)>,
) -> Records {
    let mut found = Records::default();
    found.columns.resize_with(definition.fields.len(), Vec::new);
    let mut row = vec![MISSING; definition.fields.len()];
    for (block, (begin, end)) in blocks.enumerate() {
        let mut rest = bytes.get(begin..end).unwrap_or_default();
        while !rest.is_empty() {
            row.fill(MISSING);
            let at = end - rest.len();
            if let Err(reason) = read_items(&definition.record, &mut rest, &mut row) {
                found.damage.push(Damage { block, at, reason });
                break;
            }
            found.block.push(block);
            for (column, &value) in found.columns.iter_mut().zip(&row) {
                column.push(value);
            }
        }
    }
    found
}

/// Number of bytes taken by records before the first one that cannot be decoded.
pub(super) fn whole_records(definition: &Definition, bytes: &[u8]) -> usize {
    let mut row = vec![MISSING; definition.fields.len()];
    let mut rest = bytes;
    while !rest.is_empty() {
        row.fill(MISSING);
        let at = bytes.len() - rest.len();
        if read_items(&definition.record, &mut rest, &mut row).is_err() {
            return at;
        }
    }
    bytes.len()
}

type Outcome = Result<(), &'static str>;

fn take<'a>(rest: &mut &'a [u8], count: usize) -> Result<&'a [u8], &'static str> {
    let (taken, after) = rest.split_at_checked(count).ok_or(CUT_OFF)?;
    *rest = after;
    Ok(taken)
}

fn extends(octets: &[u8]) -> bool {
    octets.last().is_some_and(|last| last & 1 == 1)
}

fn read_items(mut items: &Items, rest: &mut &[u8], row: &mut [i64]) -> Outcome {
    let longest =
        items.other.as_ref().map_or(items.fspec, |(_, other)| items.fspec.max(other.fspec));
    let octets = &rest[..rest.len().min(longest + 1)];
    let last = octets.iter().position(|octet| octet & 1 == 0);
    let last = last.ok_or(if octets.len() > longest { TOO_LONG } else { CUT_OFF })?;
    for (octet, &flags) in take(rest, last + 1)?.iter().enumerate() {
        for bit in 0..7 {
            if flags & (0x80 >> bit) != 0 {
                match item(items, 7 * octet + bit)? {
                    Structure::Sequence => read_sequence(items, rest, row)?,
                    one => read(one, rest, row)?,
                }
                items = list(items, row);
            }
        }
    }
    if last < items.fspec { Ok(()) } else { Err(TOO_LONG) }
}

fn item(items: &Items, number: usize) -> Result<&Structure, &'static str> {
    let item = items.items.get(number).and_then(Option::as_ref);
    item.ok_or("its FSPEC names an item that is not defined")
}

/// Returns the list of items that applies to the record, from the columns read so far.
fn list<'a>(items: &'a Items, row: &[i64]) -> &'a Items {
    match &items.other {
        Some((column, other)) if row[*column] > 0 => other,
        _ => items,
    }
}

fn read_sequence(items: &Items, rest: &mut &[u8], row: &mut [i64]) -> Outcome {
    for _ in 0..take(rest, 1)?[0] {
        let number = usize::from(take(rest, 1)?[0]);
        let one = number.checked_sub(1).ok_or("a sequence has an item 0")?;
        read(item(items, one)?, rest, row)?;
    }
    Ok(())
}

fn read(structure: &Structure, rest: &mut &[u8], row: &mut [i64]) -> Outcome {
    match structure {
        Structure::Fixed(octets) => read_octets(octets, rest, row).map(|_| ()),
        Structure::Extended(parts, open) => {
            for part in parts {
                if !extends(read_octets(part, rest, row)?) {
                    return Ok(());
                }
            }
            if *open { Err("an item goes on beyond its last part") } else { Ok(()) }
        }
        Structure::Counted(octets, size) => {
            let digits = take(rest, *octets)?;
            let count = digits.iter().fold(0, |count, &digit| count << 8 | usize::from(digit));
            take(rest, count * size).map(|_| ())
        }
        Structure::Repeated(size) => {
            while extends(take(rest, *size)?) {}
            Ok(())
        }
        Structure::Explicit => {
            let length = rest.first().copied().ok_or(CUT_OFF)?;
            if length == 0 {
                return Err("an item of its own length has none");
            }
            take(rest, length.into()).map(|_| ())
        }
        Structure::Compound(items) => read_items(items, rest, row),
        Structure::Sequence => Err("a sequence has a sequence in it"),
    }
}

fn read_octets<'a>(
    octets: &Octets,
    rest: &mut &'a [u8],
    row: &mut [i64],
) -> Result<&'a [u8], &'static str> {
    let taken = take(rest, octets.count)?;
    for field in &octets.bits {
        let (first, end) = (field.first / 8, field.first + field.count);
        let word = taken[first..end.div_ceil(8)]
            .iter()
            .fold(0, |word: u64, &octet| word << 8 | u64::from(octet));
        // a shift to the right end, then one to the left and back, which extends the sign
        let right = word >> (end.div_ceil(8) * 8 - end);
        let left = 64 - field.count;
        let value = (right << left).cast_signed();
        row[field.column] = if field.signed {
            value >> left
        } else {
            (value.cast_unsigned() >> left).cast_signed()
        };
    }
    Ok(taken)
}

#[cfg(test)]
mod tests {
    use super::super::definitions;
    use super::*;

    fn plots() -> &'static Definition {
        definitions().iter().find(|one| one.category == 48).unwrap()
    }

    fn column(records: &Records, name: &str) -> Vec<i64> {
        let at = plots().fields.iter().position(|field| field.name == name).unwrap();
        records.columns[at].clone()
    }

    /// Two plots, one without a flight level.
    const PLOTS: [u8; 28] = [
        0xF4, 23, 2, 0x42, 0x51, 0xE5, 0xA0, 0x40, 0, 0x20, 0, 0x3F, 0xF6, // below zero
        0xF8, 23, 2, 0x42, 0x51, 0xE6, 0xA0, 0x40, 1, 0x20, 2, 0x04, 0xD2, 0, 0,
    ];

    #[test]
    fn fields_are_those_of_the_document() {
        let found = decode(plots(), &PLOTS, [(0, 26)].into_iter());
        assert_eq!(found.damage, []);
        assert_eq!(found.block, [0, 0]);
        assert_eq!(column(&found, "010/SAC"), [23, 23]);
        assert_eq!(column(&found, "140"), [0x4251E5, 0x4251E6]);
        assert_eq!(column(&found, "020/TYP"), [5, 5]);
        assert_eq!(column(&found, "020/TST"), [MISSING, MISSING]);
        assert_eq!(column(&found, "040/RHO"), [0x4000, 0x4001]);
        assert_eq!(column(&found, "090/FL"), [-10, MISSING]);
        assert_eq!(column(&found, "070/MODE3A"), [MISSING, 0o2322]);
    }

    #[test]
    fn a_damaged_record_ends_its_block_alone() {
        let found = decode(plots(), &PLOTS, [(0, 25), (13, 26), (26, 28), (30, 99)].into_iter());
        assert_eq!(found.block, [0, 1, 2, 2]);
        let reason = CUT_OFF;
        assert_eq!(found.damage, [Damage { block: 0, at: 13, reason }]);
    }

    /// Octets that cannot be a record.
    #[test]
    fn what_is_not_defined_is_damage() {
        for (bytes, what) in [
            (&[0x01, 0x01, 0x01, 0x01, 0x00][..], "too long"),
            (&[0xFF][..], "cut off"),
            (&[0x01, 0x01, 0x01, 0x04, 0][..], "has none"),
            (&[0x20, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF][..], "beyond its last part"),
            (&[0x01, 0x20, 9][..], "cut off"),
        ] {
            let found = decode(plots(), bytes, [(0, bytes.len())].into_iter());
            assert!(found.damage[0].reason.contains(what), "{:?}", found.damage);
        }
    }
}

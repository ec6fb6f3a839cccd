//! Mutated records and recordings: decoding ends for any bytes, and all bytes are accounted for.
//!
//! `MUTATED=100000000 cargo test --release -p tertia --lib asterix::fuzz -- --nocapture` decodes
//! more of them than the normal tests.

use super::decode::whole_records;
use super::{Definition, decode, definitions, recover};

/// Categories in a mutated recording.
const KNOWN: [u8; 9] = [1, 2, 10, 19, 20, 21, 34, 48, 62];
/// Number of blocks of a recording, and number of records of each block.
const BLOCKS: usize = 20;
const RECORDS: usize = 5;

/// A generator of random numbers (xorshift).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// Returns a record that can be decoded: random bytes after an FSPEC with few bits, cut at the end of the
/// record.
fn record(definition: &Definition, random: &mut Random) -> Vec<u8> {
    loop {
        let mut bytes: Vec<u8> = (0..200).map(|_| (random.next() & random.next()) as u8).collect();
        let octets = random.below(definition.record.fspec);
        bytes[..octets].iter_mut().for_each(|octet| *octet |= 1);
        bytes[octets] &= 0xFE;
        let found = decode(definition, &bytes, [(0, bytes.len())].into_iter());
        let end = match found.damage.first() {
            Some(_) => {
                (1..bytes.len()).find(|&end| whole_records(definition, &bytes[..end]) == end)
            }
            None => Some(bytes.len()),
        };
        if let Some(end) = end {
            bytes.truncate(end);
            return bytes;
        }
    }
}

/// Changes, removes or inserts some bytes.
fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..random.below(4) {
        let at = random.below(bytes.len());
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => bytes.insert(at, random.next() as u8),
            2 if at < bytes.len() => drop(bytes.remove(at)),
            3 if at < bytes.len() => bytes[at] = random.next() as u8,
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
    }
}

/// Checks that decoding ends where the damage begins, and that decoding from there finds the damage again.
fn check(definition: &Definition, bytes: &[u8]) -> usize {
    let found = decode(definition, bytes, [(0, bytes.len())].into_iter());
    let end = found.damage.first().map_or(bytes.len(), |damage| damage.at);
    assert!(found.damage.len() <= 1 && end <= bytes.len());
    assert_eq!(whole_records(definition, bytes), end);
    assert!(found.block.len() <= end && (end == 0) == found.block.is_empty());
    assert!(found.columns.iter().all(|one| one.len() == found.block.len()));
    found.block.len() + found.damage.len()
}

/// Checks that blocks and gaps of a mutated recording adjoin each other.
fn check_recording(bytes: &[u8]) -> usize {
    let (found, gaps) = recover(bytes, &KNOWN);
    let ranges = found.begin.iter().zip(&found.end);
    let held: usize = ranges.clone().map(|(begin, end)| end - begin + 3).sum();
    assert_eq!(held + gaps.iter().map(|gap| gap.lost).sum::<usize>(), bytes.len());
    assert!(
        ranges.clone().zip(found.begin.iter().skip(1)).all(|((_, end), next)| end + 3 <= *next)
    );
    let decoded = found.category.iter().zip(ranges).map(|(&category, (&begin, &end))| {
        let own = definitions().iter().find(|one| one.category == category);
        own.map_or(0, |one| decode(one, bytes, [(begin, end)].into_iter()).block.len())
    });
    decoded.sum()
}

#[test]
fn mutated_records_end() {
    let total = std::env::var("MUTATED").map_or(20_000, |text| text.parse().unwrap());
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let (mut count, mut whole) = (0, 0);
    let records: Vec<Vec<Vec<u8>>> = definitions()
        .iter()
        .map(|one| (0..50).map(|_| record(one, &mut random)).collect())
        .collect();
    while count < total {
        let mut recording = Vec::new();
        for _ in 0..BLOCKS {
            let which = random.below(definitions().len());
            let definition = &definitions()[which];
            let mut block = Vec::new();
            for _ in 0..RECORDS {
                let mut one = records[which][random.below(50)].clone();
                mutate(&mut one, &mut random);
                count += 1;
                whole += usize::from(whole_records(definition, &one) == one.len());
                block.extend(one);
            }
            check(definition, &block);
            let length = (block.len() + 3) as u16;
            recording.push(definition.category);
            recording.extend(length.to_be_bytes());
            recording.extend(block);
        }
        mutate(&mut recording, &mut random);
        check_recording(&recording);
    }
    println!("{count} mutated records, of which {whole} could be decoded");
    // mutation leaves some records whole, but not all
    assert!(whole > total / 10 && whole < total);
}

//! Bindings of `tertia::asterix`.

use crate::arrays::{Array, Integers, release, vector};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use tertia::asterix::{self, Damage, Gap};

/// Cost of an octet, for the decision whether to release the interpreter's lock.
const OCTET_NS: f64 = 5.0;

/// A definition: category, editions, and the name, scale and unit of each column.
type Definition = (u8, Vec<&'static str>, Vec<(&'static str, f64, &'static str)>);
type Blocks<'py> = (Integers<'py>, Integers<'py>, Integers<'py>, usize);
type Recording<'py> = (Integers<'py>, Integers<'py>, Integers<'py>, Vec<(usize, usize)>);
type Records<'py> = (Integers<'py>, Vec<Integers<'py>>, Vec<(usize, usize, &'static str)>);

/// All definitions; those of a category are sorted from the newest.
#[pyfunction]
pub fn asterix_definitions() -> Vec<Definition> {
    asterix::definitions()
        .iter()
        .map(|one| {
            let fields = one.fields.iter();
            let fields = fields.map(|field| (&*field.name, field.scale, &*field.unit)).collect();
            (one.category, one.editions.iter().map(|name| &**name).collect(), fields)
        })
        .collect()
}

/// Category, begin and end of consecutive data blocks, and the end of the last one.
#[pyfunction]
pub fn asterix_blocks<'py>(py: Python<'py>, contents: &[u8]) -> PyResult<Blocks<'py>> {
    let found = release(py, contents.len() as f64, || asterix::blocks(contents))?;
    let category = vector(py, found.category.into_iter().map(i64::from))?;
    Ok((category, places(py, found.begin)?, places(py, found.end)?, found.stop))
}

/// Category, begin and end of the data blocks of a recording that may be damaged, and its gaps: their
/// positions, and how many octets belong to no block.
#[pyfunction]
pub fn asterix_recording<'py>(
    py: Python<'py>,
    contents: &[u8],
    known: Vec<u8>,
) -> PyResult<Recording<'py>> {
    let cost = OCTET_NS * contents.len() as f64;
    let (found, gaps) = release(py, cost, || asterix::recover(contents, &known))?;
    let category = vector(py, found.category.into_iter().map(i64::from))?;
    let gaps = gaps.into_iter().map(|Gap { at, lost }| (at, lost)).collect();
    Ok((category, places(py, found.begin)?, places(py, found.end)?, gaps))
}

/// Block of each record, its columns, and the damaged records: block, first octet, reason.
#[pyfunction]
pub fn asterix_records<'py>(
    py: Python<'py>,
    definition: usize,
    contents: &[u8],
    begin: PyReadonlyArray1<'py, i64>,
    end: PyReadonlyArray1<'py, i64>,
) -> PyResult<Records<'py>> {
    let (begin, end) = (begin.as_slice()?, end.as_slice()?);
    let ranges = begin.iter().zip(end).map(|(&begin, &end)| (begin as usize, end as usize));
    let definition = &asterix::definitions()[definition];
    let cost = OCTET_NS * contents.len() as f64;
    let found = release(py, cost, || asterix::decode(definition, contents, ranges))?;
    let columns = found.columns.into_iter().map(|one| vector(py, one));
    let columns = columns.collect::<PyResult<_>>()?;
    let damage = found.damage.iter().map(|&Damage { block, at, reason }| (block, at, reason));
    Ok((places(py, found.block)?, columns, damage.collect()))
}

/// Times of day, with truncated times completed from full times of the same source.
#[pyfunction]
pub fn asterix_times<'py>(
    py: Python<'py>,
    full: PyReadonlyArray1<'py, f64>,
    truncated: PyReadonlyArray1<'py, f64>,
    source: PyReadonlyArray1<'py, i64>,
) -> PyResult<Array<'py>> {
    let (full, truncated, source) = (full.as_slice()?, truncated.as_slice()?, source.as_slice()?);
    let times = asterix::complete_times(full, truncated, source);
    vector(py, times)
}

fn places(py: Python<'_>, places: Vec<usize>) -> PyResult<Integers<'_>> {
    vector(py, places.into_iter().map(|place| place as i64))
}

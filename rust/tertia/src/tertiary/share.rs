//! Work on many targets, divided among threads.

use crate::base::batch::for_each_row;
use crate::base::error::Result;
use std::num::NonZero;

/// Largest cost that is stated for a batch, so that it is never interrupted: stopped halfway, it would leave
/// the picture partly updated.
const STOPPABLE_NS: f64 = 1e8;

/// Replaces the contents of `found` by the results of `work` on all items, in the order of the items for any
/// number of threads. The memory of `found` is reused, so that large results are neither moved nor first
/// created empty.
pub(super) fn fill<I: Send, T: Default + Send>(
    found: &mut Vec<T>,
    items: impl ExactSizeIterator<Item = I> + Send,
    nanoseconds: f64,
    n_threads: Option<NonZero<usize>>,
    work: impl Fn(I) -> T + Sync,
) {
    let cost = (nanoseconds * items.len() as f64).min(STOPPABLE_NS);
    found.resize_with(items.len(), T::default);
    let rows = items.zip(found.iter_mut());
    let work = |(): &mut (), (item, out): (I, &mut T)| {
        *out = work(item);
        Ok(())
    };
    for_each_row(rows, cost, n_threads, || (), work).expect("nothing fails");
}

/// Returns the results of `work` on all items, in the order of the items for any number of threads;
/// `nanoseconds` is the time for one item.
///
/// # Errors
/// The error of the first item that failed.
pub(super) fn mapped<I: Send, T: Send>(
    items: impl ExactSizeIterator<Item = I> + Send,
    nanoseconds: f64,
    n_threads: Option<NonZero<usize>>,
    work: impl Fn(I) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    if n_threads == NonZero::new(1) {
        // a fallible `collect` cannot reserve the length
        let mut found = Vec::with_capacity(items.len());
        for item in items {
            found.push(work(item)?);
        }
        return Ok(found);
    }
    let cost = (nanoseconds * items.len() as f64).min(STOPPABLE_NS);
    let mut found: Vec<Option<T>> = Vec::new();
    found.resize_with(items.len(), || None);
    let rows = items.zip(&mut found);
    let work = |(): &mut (), (item, out): (I, &mut Option<T>)| {
        *out = Some(work(item)?);
        Ok(())
    };
    for_each_row(rows, cost, n_threads, || (), work).map_err(|failed| failed.error)?;
    // unlike `flatten`, this reuses the memory
    Ok(found.into_iter().map(|one| one.expect("all items are done")).collect())
}

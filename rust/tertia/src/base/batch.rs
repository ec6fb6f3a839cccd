//! Rows of a batch on several threads.
//!
//! Threads exist only during one call, because the threads of a pool would be missing in a forked process.
//! Starting them (about 50 µs each) is worthwhile if the work takes a millisecond or more.

use crate::base::error::{Error, Result};
use crate::base::interrupt::{Flag, flag, poll};
use std::num::NonZero;
use std::sync::Mutex;

/// Less work than this is done by the calling thread alone.
const MIN_NANOSECONDS_TO_SHARE: f64 = 1e6;
/// More work than this can be interrupted; less work ends soon anyway.
const MIN_NANOSECONDS_TO_STOP: f64 = 1e8;
/// Largest number of threads: more than the cores of any machine today.
const MAX_THREADS: usize = 256;
/// Number of shares of the work per thread, so that a thread on a busy core does not delay the others.
pub(crate) const SHARES_PER_THREAD: usize = 8;

/// The first row that failed, with its error.
#[derive(Clone, Debug, PartialEq)]
pub struct RowError {
    /// Index of the row in the batch.
    pub row: usize,
    /// The error of this row.
    pub error: Error,
}

/// Number of threads: the requested number; by default one for little work, otherwise one per core.
fn threads(n_threads: Option<NonZero<usize>>, rows: usize, nanoseconds: f64) -> usize {
    let available = || std::thread::available_parallelism().map_or(1, NonZero::get);
    match n_threads {
        Some(n) => n.get().min(MAX_THREADS).min(rows.max(1)),
        None if nanoseconds < MIN_NANOSECONDS_TO_SHARE => 1,
        None => available().min(rows.max(1)),
    }
}

/// Calls `work` on every row, with one `state` per thread; returns the error of the lowest row
/// that failed. `nanoseconds` is an estimate of the total work on one thread. If this is large, the call can
/// be interrupted.
///
/// # Errors
/// The error of the first row that failed, which is the same for any number of threads.
pub fn for_each_row<R: Send, S>(
    rows: impl ExactSizeIterator<Item = R> + Send,
    nanoseconds: f64,
    n_threads: Option<NonZero<usize>>,
    state: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, R) -> Result<()> + Sync,
) -> std::result::Result<(), RowError> {
    let n_threads = threads(n_threads, rows.len(), nanoseconds);
    let flag = flag().filter(|_| nanoseconds > MIN_NANOSECONDS_TO_STOP);
    let stops = || flag.as_ref().is_some_and(Flag::is_set);
    if n_threads == 1 {
        let mut state = state();
        for (row, item) in rows.enumerate() {
            if stops() {
                break;
            }
            work(&mut state, item).map_err(|error| RowError { row, error })?;
        }
        if stops() {
            poll();
        }
        return Ok(());
    }
    let share = rows.len().div_ceil(n_threads * SHARES_PER_THREAD);
    let queue = Mutex::new(rows.enumerate());
    let failure: Mutex<Option<RowError>> = Mutex::new(None);
    let run = || {
        let mut state = state();
        loop {
            let items: Vec<_> = lock(&queue).by_ref().take(share).collect();
            if items.is_empty() {
                return;
            }
            for (row, item) in items {
                if stops() {
                    return;
                }
                if let Err(error) = work(&mut state, item) {
                    let mut failure = lock(&failure);
                    if failure.as_ref().is_none_or(|first| row < first.row) {
                        *failure = Some(RowError { row, error });
                    }
                    break;
                }
            }
            if lock(&failure).is_some() {
                return;
            }
        }
    };
    on_threads(n_threads, &run);
    if stops() {
        poll();
    }
    match failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        None => Ok(()),
        Some(first) => Err(first),
    }
}

/// Calls `run` on this number of threads, including the calling one. It is not generic, so it is compiled once.
fn on_threads(n_threads: usize, run: &(dyn Fn() + Sync)) {
    std::thread::scope(|scope| {
        for _ in 1..n_threads {
            // if the system refuses a thread, the other threads do its rows
            let _ = std::thread::Builder::new().spawn_scoped(scope, run);
        }
        run();
    });
}

/// Calls `work` on every part, on this number of threads.
pub(crate) fn for_each_part<P: Send>(threads: usize, parts: Vec<P>, work: impl Fn(P) + Sync) {
    let work = |(): &mut (), part: P| {
        work(part);
        Ok(())
    };
    for_each_row(parts.into_iter(), 0.0, NonZero::new(threads), || (), work)
        .expect("nothing fails");
}

/// Locks even if another thread has panicked: no data behind these locks can be left half-changed.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_once_and_the_first_error() {
        let rows = 1000;
        for n in [1, 2, 7] {
            let mut done = vec![0_u32; rows];
            let result = for_each_row(
                done.iter_mut().enumerate(),
                0.0,
                NonZero::new(n),
                || (),
                |(), (_, count)| {
                    *count += 1;
                    Ok(())
                },
            );
            assert!(result.is_ok() && done.iter().all(|&count| count == 1));
            let result = for_each_row(
                0..rows,
                0.0,
                NonZero::new(n),
                || (),
                |(), row| crate::base::error::require("x", row as f64, row < 700, "below 700"),
            );
            assert_eq!(result.unwrap_err().row, 700);
        }
    }
}

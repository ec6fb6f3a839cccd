//! Interruption of long calls.
//!
//! The caller may set a flag. The core checks it from time to time, between parts of its work, and ends the
//! call by unwinding. At these points no state that outlives the call is partly changed.

use std::cell::RefCell;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Payload of the unwinding of an interrupted call.
#[derive(Clone, Copy, Debug)]
pub struct Interrupted;

/// Flag that interrupts a call.
#[derive(Clone, Debug, Default)]
pub struct Flag(Arc<AtomicBool>);

thread_local! {
    static FLAG: RefCell<Option<Flag>> = const { RefCell::new(None) };
}

impl Flag {
    /// Requests the interruption.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the interruption was requested.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Does work on this thread; the work is interrupted if the flag is set.
    pub fn watch<T>(&self, work: impl FnOnce() -> T) -> T {
        /// Restores the previous flag, however the work ends.
        struct Restored(Option<Flag>);
        impl Drop for Restored {
            fn drop(&mut self) {
                FLAG.set(self.0.take());
            }
        }
        let _restored = Restored(FLAG.replace(Some(self.clone())));
        work()
    }
}

/// Returns the flag of this thread.
pub(crate) fn flag() -> Option<Flag> {
    FLAG.with_borrow(Clone::clone)
}

/// Unwinds with [`Interrupted`] if the interruption of the call was requested.
pub fn poll() {
    if FLAG.with_borrow(|flag| flag.as_ref().is_some_and(Flag::is_set)) {
        resume_unwind(Box::new(Interrupted));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn work_stops_where_it_looks() {
        let flag = Flag::default();
        let mut done = 0;
        let caught = catch_unwind(AssertUnwindSafe(|| {
            flag.watch(|| {
                for _ in 0..10 {
                    poll();
                    done += 1;
                    if done == 3 {
                        flag.set();
                    }
                }
            });
        }));
        assert!(caught.expect_err("it was told to stop").is::<Interrupted>());
        assert_eq!(done, 3);
        // without a flag, work continues
        poll();
    }
}

//! Long calls that are told to stop.
//!
//! Whoever calls may set a flag; the core looks at it now and then, between parts of its work, and leaves by
//! unwinding. No state that outlives the call is changed where it looks.

use std::cell::RefCell;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What unwinds where a call was told to stop.
#[derive(Clone, Copy, Debug)]
pub struct Interrupted;

/// Tells a call to stop.
#[derive(Clone, Debug, Default)]
pub struct Flag(Arc<AtomicBool>);

thread_local! {
    static FLAG: RefCell<Option<Flag>> = const { RefCell::new(None) };
}

impl Flag {
    /// Tells it.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was told.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Does work on this thread that stops where the flag is set.
    pub fn watch<T>(&self, work: impl FnOnce() -> T) -> T {
        /// Puts back what was there, however the work ends.
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

/// The flag of this thread.
pub(crate) fn flag() -> Option<Flag> {
    FLAG.with_borrow(Clone::clone)
}

/// Unwinds with [`Interrupted`] where the call was told to stop.
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
        // work that nobody watches goes on
        poll();
    }
}

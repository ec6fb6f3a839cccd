//! Work without the interpreter's lock.

use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;
use tertia::interrupt::Flag;

/// Cost from which the interpreter's lock is released; releasing and acquiring it takes a tenth of this.
const WORTH_RELEASING_NS: f64 = 2000.0;

/// Cost from which signals, such as Ctrl-C, are checked during the work; the work is then done by another
/// thread.
const WORTH_STOPPING_NS: f64 = 1e8;
const LOOKS: Duration = Duration::from_millis(50);
/// Size of the stack of the other thread, which is that of most main threads.
const STACK: usize = 8 << 20;

/// Does work of about this cost; the interpreter's lock is released if that is worthwhile.
///
/// # Errors
/// The exception raised by a signal handler, which interrupted the work.
pub fn release<T: Send>(
    py: Python<'_>,
    nanoseconds: f64,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    match nanoseconds {
        ..WORTH_RELEASING_NS => Ok(work()),
        ..WORTH_STOPPING_NS => Ok(py.detach(work)),
        _ => py.detach(|| stoppable(work)),
    }
}

/// Does work on another thread, and checks for signals meanwhile.
fn stoppable<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let (mut work, mut done) = (Some(work), None);
    watched(&mut || done = work.take().map(|work| work()))?;
    Ok(done.expect("it is done once"))
}

/// Does the work of `stoppable`. It is not generic, so it is compiled once.
fn watched(work: &mut (dyn FnMut() + Send)) -> PyResult<()> {
    let (flag, work, caller) = (Flag::default(), Mutex::new(work), thread::current());
    // a thread that has just woken the caller is not finished yet
    let is_done = AtomicBool::new(false);
    let run = || {
        let mut work = work.lock().expect("nobody else does it");
        flag.watch(&mut **work);
        is_done.store(true, Ordering::Release);
        caller.unpark();
    };
    thread::scope(|scope| {
        let builder = thread::Builder::new().stack_size(STACK);
        // if the system refuses a thread, this thread does the work
        let Ok(worker) = builder.spawn_scoped(scope, run) else {
            run();
            return Ok(());
        };
        let mut signal = None;
        while !is_done.load(Ordering::Acquire) && !worker.is_finished() {
            thread::park_timeout(LOOKS);
            if let (None, Err(raised)) = (&signal, Python::attach(|py| py.check_signals())) {
                signal = Some(raised);
                flag.set();
            }
        }
        match (worker.join(), signal) {
            (_, Some(raised)) => Err(raised),
            (Ok(()), None) => Ok(()),
            (Err(panic), None) => resume_unwind(panic),
        }
    })
}

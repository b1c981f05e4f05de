//! Work without the interpreter's lock, that Ctrl-C ends.
//!
//! The work has a thread of its own, while the caller's waits without the lock and looks for signals. It runs in a pool of this
//! process: a process that was forked has none of its parent's threads, and would wait for the global pool for ever.

use crate::errors::Raised;
use era_model::stop::StopRequest;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Between two looks for a signal.
const LOOK: Duration = Duration::from_millis(50);
/// How long the end of work that is not wanted any more is waited for.
const LAST: Duration = Duration::from_secs(1);

/// The pool, and the process that it is of.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Where work is done, until nobody waits for it.
pub struct WorkPool {
    threads: Arc<ThreadPool>,
    stop: StopRequest,
}

impl WorkPool {
    /// What tells that nobody waits any more.
    pub fn clone_stop_request_handle(&self) -> StopRequest {
        self.stop.clone()
    }

    /// Does it.
    pub fn run_in_pool_with_stop_request<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.threads.install(|| self.stop.run_with_self_as_current_stop_request_of_thread(work))
    }
}

/// The end of work that was stopped; whoever stopped it does not wait for it.
pub fn error_of_stopped_computation() -> Raised {
    Raised::unavailable_resource("the computation was stopped")
}

/// Runs `work`. What a signal's handler raises, `KeyboardInterrupt` as a rule, ends the work where it next looks at its [`StopRequest`], and is
/// raised when the work has ended, but a second later at the latest. What the work finds is dropped.
pub fn run_in_pool_interruptibly<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Raised> + Send + 'static,
) -> PyResult<T> {
    run_in_own_thread_interruptibly(py, move |pool| pool.run_in_pool_with_stop_request(work))
}

/// The same for work that begins in its own thread and goes to the pool by itself. Whatever is locked while the pool works has to be
/// locked outside: a thread of the pool that waits takes up other work, which may want the same lock.
pub fn run_in_own_thread_interruptibly<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&WorkPool) -> Result<T, Raised> + Send + 'static,
) -> PyResult<T> {
    run_in_own_thread_interruptibly_with_progress(py, |_| Ok(()), work)
}

/// The same with `report_progress`, which is called in the caller's thread between two looks for a signal, and once more when the work is done. What
/// it raises ends the work, as a signal does.
pub fn run_in_own_thread_interruptibly_with_progress<T: Send + 'static>(
    py: Python<'_>,
    mut report_progress: impl FnMut(Python<'_>) -> PyResult<()>,
    work: impl FnOnce(&WorkPool) -> Result<T, Raised> + Send + 'static,
) -> PyResult<T> {
    let failed = |error: &dyn std::fmt::Display| {
        PyRuntimeError::new_err(format!("the thread for the computation failed: {error}"))
    };
    let pool = thread_pool_of_process().map_err(|error| failed(&error))?;
    let stop = StopRequest::default();
    let (done, mut waiting) = sync_channel(1);
    let pool = WorkPool { threads: pool, stop: stop.clone() };
    let working = move || {
        let found = catch_unwind(AssertUnwindSafe(|| work(&pool)));
        // Nobody waits after a signal.
        let _ = done.send(found);
    };
    std::thread::Builder::new().name("era".into()).spawn(working).map_err(|error| failed(&error))?;
    loop {
        let found;
        (waiting, found) = py.detach(move || {
            let found = waiting.recv_timeout(LOOK);
            (waiting, found)
        });
        match found {
            Ok(Ok(found)) => {
                let found = found?;
                report_progress(py)?;
                return Ok(found);
            }
            // A mistake of the program, which Python shows as `PanicException`.
            Ok(Err(panic)) => resume_unwind(panic),
            Err(RecvTimeoutError::Disconnected) => return Err(failed(&"the thread ended without a result")),
            Err(RecvTimeoutError::Timeout) => {
                if let Err(raised) = py.check_signals().and_then(|()| report_progress(py)) {
                    stop.request_stop();
                    // The caller may go on with the same folder: nothing else should write there any more.
                    let _ = py.detach(move || waiting.recv_timeout(LAST));
                    return Err(raised);
                }
            }
        }
    }
}

/// This process's pool, with as many threads as there are processors, or as `RAYON_NUM_THREADS` says.
fn thread_pool_of_process() -> Result<Arc<ThreadPool>, rayon::ThreadPoolBuildError> {
    let mut kept = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((of, pool)) = kept.as_ref()
        && *of == process
    {
        return Ok(pool.clone());
    }
    let pool = Arc::new(ThreadPoolBuilder::new().thread_name(|i| format!("era-{i}")).build()?);
    // The parent's, whose threads are not here: to drop it would be to wait for them.
    std::mem::forget(kept.replace((process, pool.clone())));
    Ok(pool)
}

//! Calls of the system that may not return: a driver that hangs, another program that closes the port and waits for what it wrote to be sent.

use super::error::PortError;
use super::users::PortUsers;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Between two looks whether calls on this port that other threads have begun have returned.
const LOOK: Duration = Duration::from_millis(1);

/// The call that a thread is in, as its name in the manual.
#[derive(Debug)]
pub struct CurrentCall(Mutex<&'static str>);

impl CurrentCall {
    /// Names the call that comes next, and makes it.
    pub fn name_and_run_call<T>(&self, name: &'static str, call: impl FnOnce() -> T) -> T {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = name;
        call()
    }

    fn name(&self) -> &'static str {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A thread that is in calls on a port.
struct CallUnderWay {
    id: u64,
    path: String,
    step: Arc<CurrentCall>,
    since: Instant,
}

static UNDER_WAY: Mutex<Vec<CallUnderWay>> = Mutex::new(Vec::new());
static NEXT_ID: AtomicU64 = AtomicU64::new(0);

fn lock_calls_under_way() -> MutexGuard<'static, Vec<CallUnderWay>> {
    UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until no thread is in a call on the port at `path`, and no longer than `limit`: so a port that hangs costs one thread however often it
/// is tried, and one that is being closed is not opened before it is free.
///
/// # Errors
/// [`PortError::Late`] with the call that has not returned.
pub fn await_end_of_calls_on_port(path: &str, limit: Duration) -> Result<(), PortError> {
    let begun = Instant::now();
    loop {
        let waits_for = lock_calls_under_way()
            .iter()
            .find(|other| other.path == path)
            .map(|other| (other.step.name(), other.since.elapsed()));
        match waits_for {
            None => return Ok(()),
            Some((call, waited)) if begun.elapsed() >= limit => {
                return Err(make_late_error_looking_up_port_users(path, call, waited));
            }
            Some(_) => std::thread::sleep(LOOK),
        }
    }
}

/// Makes `calls` on the port at `path` in a thread of their own, and waits for them no longer than `limit`. Where they take longer they are left
/// behind, and what they give is dropped when they return.
///
/// # Errors
/// [`PortError::Late`] with the call that has not returned; [`PortError::Failed`] if the system gives no thread.
pub fn run_port_calls_in_thread_abandoned_after_limit<T: Send + 'static>(
    path: &str,
    limit: Duration,
    calls: impl FnOnce(&CurrentCall) -> T + Send + 'static,
) -> Result<T, PortError> {
    let (step, since) = (Arc::new(CurrentCall(Mutex::new("open"))), Instant::now());
    let id = NEXT_ID.fetch_add(1, Ordering::Relaxed);
    lock_calls_under_way().push(CallUnderWay { id, path: path.to_owned(), step: Arc::clone(&step), since });
    // Dropped however the thread ends, or if there is none: the port may be tried again.
    let returned = CallRegistration(id);
    let (result, results) = sync_channel(1);
    let own = Arc::clone(&step);
    let failed = |source| PortError::Failed { path: path.to_owned(), call: step.name(), source };
    let thread = std::thread::Builder::new().name("port".into()).spawn(move || {
        let given = calls(&own);
        // Nobody waits for it any more where the limit is over: a port that was opened too late is closed by this, before it may be tried again.
        let _ = result.send(given);
        drop(returned);
    });
    thread.map_err(failed)?;
    results.recv_timeout(limit).map_err(|error| match error {
        RecvTimeoutError::Timeout => make_late_error_looking_up_port_users(path, step.name(), since.elapsed()),
        RecvTimeoutError::Disconnected => {
            failed(std::io::Error::other("an internal error of this program; please report the error"))
        }
    })
}

struct CallRegistration(u64);

impl Drop for CallRegistration {
    fn drop(&mut self) {
        lock_calls_under_way().retain(|thread| thread.id != self.0);
    }
}

fn make_late_error_looking_up_port_users(path: &str, call: &'static str, waited: Duration) -> PortError {
    PortError::Late { path: path.to_owned(), call, waited, users: PortUsers::find_for_port(path) }
}

//! Work that takes longer than a stop may wait for: on threads of its own, which the system prefers all others to, with half of the processors,
//! and with an end. No thread that serves requests does any of it, and the daemon's end does not wait for it.

use crate::daemon::access::sender::RequestSender;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::device::priority;
use era_model::stop::StopRequest;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// Until when a piece of work may go on. Work looks at it wherever it can end.
#[derive(Clone, Debug)]
pub struct Deadline {
    until: Instant,
    longest: Duration,
    /// Models and plans look at it by themselves.
    stop: StopRequest,
}

impl Deadline {
    /// So long from now.
    #[must_use]
    pub fn from_now(time_limit: Duration) -> Self {
        let until = Instant::now() + time_limit;
        Self { until, longest: time_limit, stop: StopRequest::with_deadline(until) }
    }

    /// Nobody wants it any more.
    pub fn request_work_to_end_at_once(&self) {
        self.stop.request_stop();
    }

    /// Whether nobody wants it any more.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.stop.is_stop_requested_by_somebody()
    }

    /// Whether the work has to end.
    #[must_use]
    pub fn is_cancelled_or_expired(&self) -> bool {
        self.is_cancelled() || self.is_time_over()
    }

    /// Whether that is because of the time.
    #[must_use]
    pub fn is_time_over(&self) -> bool {
        Instant::now() >= self.until
    }

    /// Does work whose models and plans end when nobody wants it any more, or when the time is over.
    pub fn run_stoppable_by_cancel_or_time_limit<T>(&self, work: impl FnOnce() -> T) -> T {
        self.stop.clone().run_with_self_as_current_stop_request_of_thread(work)
    }

    /// # Errors
    /// [`Problem`] if the work has to end.
    pub fn check_not_cancelled_or_expired(&self) -> Result<(), Problem> {
        if self.is_cancelled() {
            return Err(Problem::new(ProblemKind::PreviewFailed, "the client no longer waits for the answer"));
        }
        if self.is_time_over() { Err(self.deadline_exceeded_problem()) } else { Ok(()) }
    }

    fn deadline_exceeded_problem(&self) -> Problem {
        let longest = self.longest;
        let detail = format!("the computation takes longer than {longest:?}, which is the maximum for one request");
        Problem::new(ProblemKind::TooLarge, detail)
    }
}

/// Cancels the work when whoever waits for it goes.
struct CancelOnDrop(Deadline);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.request_work_to_end_at_once();
    }
}

/// Begins work on a thread of this name; what comes of it is received, or that it has ended by a mistake of this program.
///
/// # Errors
/// [`Problem`] if there is no thread for it.
pub fn spawn_low_priority_thread<T: Send + 'static>(
    name: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<oneshot::Receiver<T>, Problem> {
    let (result, receiver) = oneshot::channel();
    let whole = move || {
        // A mistake is told where it happens, and whoever waits hears that nothing comes.
        if let Ok(found) = catch_unwind(AssertUnwindSafe(|| run_at_low_priority_on_half_the_processors(work))) {
            let _ = result.send(found);
        }
    };
    let started = std::thread::Builder::new().name(name.into()).spawn(whole);
    started.map_err(|error| {
        Problem::new(ProblemKind::PreviewFailed, format!("cannot start a thread for the {name} computation: {error}"))
    })?;
    Ok(receiver)
}

/// Does work for a request: no longer than `time_limit`, and no longer than its sender waits for the answer.
///
/// # Errors
/// [`Problem`]: that of the work, that it took too long, or that its sender is gone.
pub async fn run_low_priority_until_deadline<T: Send + 'static>(
    name: &'static str,
    time_limit: Duration,
    sender: &RequestSender,
    work: impl FnOnce(&Deadline) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let deadline = Deadline::from_now(time_limit);
    let _cancels = CancelOnDrop(deadline.clone());
    let own = deadline.clone();
    let result = spawn_low_priority_thread(name, move || own.run_stoppable_by_cancel_or_time_limit(|| work(&own)))?;
    let work = async {
        tokio::select! {
            result = result => match result {
                // What was ended on its way says only that.
                Ok(Err(_)) if deadline.is_time_over() => Err(deadline.deadline_exceeded_problem()),
                Ok(result) => result,
                Err(_) => {
                    let detail = format!(
                        "the {name} computation ended early because of an internal error: please report the error, with the request"
                    );
                    Err(Problem::new(ProblemKind::PreviewFailed, detail))
                }
            },
            () = tokio::time::sleep(time_limit) => Err(deadline.deadline_exceeded_problem()),
        }
    };
    sender.run_until_connection_closed(work).await
}

/// Does work on threads of its own, half as many as there are processors, which are to be late rather than others.
fn run_at_low_priority_on_half_the_processors<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    priority::lower_thread_priority_below_normal();
    let threads = std::thread::available_parallelism().map_or(1, usize::from).div_ceil(2);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(|_| priority::lower_thread_priority_below_normal())
        .build();
    match pool {
        Ok(pool) => pool.install(work),
        // Threads that cannot be had are done without.
        Err(error) => {
            tracing::warn!(
                %error,
                "cannot start threads for a long computation; the computation uses the existing threads"
            );
            work()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    /// How long the tests wait for what is at once.
    const PATIENCE: Duration = Duration::from_secs(20);

    #[tokio::test]
    async fn work_ends_with_its_time_and_reports_this() {
        let (seen, ended) = channel();
        let work = move |deadline: &Deadline| {
            while !deadline.is_cancelled_or_expired() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let _ = seen.send(deadline.is_time_over());
            deadline.check_not_cancelled_or_expired()
        };
        let problem =
            run_low_priority_until_deadline("test", Duration::from_millis(50), &RequestSender::default(), work)
                .await
                .unwrap_err();
        assert!(problem.is_kind("too-large") && problem.detail().contains("50ms"), "{}", problem.detail());
        assert!(ended.recv_timeout(PATIENCE).unwrap());
    }

    #[tokio::test]
    async fn work_ends_with_whoever_waits_for_it() {
        let ((seen, ended), (began, has_begun)) = (channel(), channel());
        let work = move |deadline: &Deadline| {
            let _ = began.send(());
            while !deadline.is_cancelled_or_expired() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let _ = seen.send(deadline.is_time_over());
            Ok(())
        };
        let waiting = tokio::spawn(async move {
            run_low_priority_until_deadline("test", PATIENCE * 10, &RequestSender::default(), work).await
        });
        tokio::task::spawn_blocking(move || has_begun.recv_timeout(PATIENCE)).await.unwrap().unwrap();
        waiting.abort();
        assert!(waiting.await.unwrap_err().is_cancelled());
        assert!(!ended.recv_timeout(PATIENCE).unwrap(), "not by its time");
    }

    #[tokio::test]
    async fn a_mistake_in_the_work_is_reported() {
        let failed = |_: &Deadline| -> Result<(), Problem> { panic!("a mistake, on purpose") };
        let problem =
            run_low_priority_until_deadline("test", PATIENCE, &RequestSender::default(), failed).await.unwrap_err();
        assert!(problem.is_kind("internal") && problem.detail().contains("ended early"), "{}", problem.detail());
    }

    /// As the system tells it: fields 19 of proc_thread_self's stat (proc_pid_stat(5)).
    #[cfg(target_os = "linux")]
    #[tokio::test]
    async fn others_are_preferred_to_it() {
        let nice = |_: &Deadline| {
            let of_this_thread = || -> i32 {
                let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
                stat.rsplit_once(')').unwrap().1.split_whitespace().nth(16).unwrap().parse().unwrap()
            };
            Ok(of_this_thread())
        };
        let nice = run_low_priority_until_deadline("test", PATIENCE, &RequestSender::default(), nice).await.unwrap();
        assert!(nice >= 10, "{nice}");
    }
}

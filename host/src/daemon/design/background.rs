//! Work of some seconds that no request waits for: one piece at a time, whatever it is, aside of what serves requests, so that touches and stops are
//! not held up, and for [`LONGEST`] at most. Requests for it are checked in slots, of which each client has one, and the place for the work is taken
//! only when a check has passed: a client that sends wrong requests keeps nobody else from the place.

use super::low_priority::{Deadline, run_low_priority_until_deadline, spawn_low_priority_thread};
use super::slots::Slots;
use crate::daemon::access::client::Client;
use crate::daemon::access::sender::RequestSender;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::device::SessionError;
use crate::study::run::StudyObserver;
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use utoipa::ToSchema;

/// Longest time for a piece of work: ten times what the largest study of the example plate takes on one processor.
const LONGEST: Duration = Duration::from_secs(300);
/// Longest time for the check whether a piece of work can be begun.
const LONGEST_CHECK: Duration = Duration::from_secs(10);
/// Requests that are checked at once, each of another client.
const CHECKS_AT_ONCE: usize = 2;
/// Clients that may wait for a check.
const MOST_WAITING: usize = 16;

/// Progress of a study or a tolerance study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// None has been asked for yet.
    None,
    /// Designs, or panels, are looked at.
    Running,
    /// The best designs of a study are computed anew.
    Finishing,
    /// What was asked for is there.
    Done,
    /// It was stopped.
    Stopped,
    /// It could not go on: `problem` says why.
    Failed,
}

/// What may be under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BackgroundWork {
    /// A design study.
    Study,
    /// What tolerances do to a plan.
    Tolerances,
}

impl BackgroundWork {
    /// Name of its thread.
    const fn thread_name(self) -> &'static str {
        match self {
            Self::Study => "study",
            Self::Tolerances => "tolerances",
        }
    }

    /// That it is under way, and what else was asked for has to wait.
    fn already_under_way_problem(self) -> Problem {
        match self {
            Self::Study => {
                Problem::new(ProblemKind::StudyRuns, "a study is already running: POST /v1/study/stop ends it")
            }
            Self::Tolerances => {
                let detail = "a tolerance study is already running: POST /v1/tolerances/stop ends it";
                Problem::new(ProblemKind::TolerancesRun, detail)
            }
        }
    }
}

/// The daemon's one place for such work, and the slots in which requests for it are checked.
#[derive(Clone, Debug)]
pub struct BackgroundPlace {
    taken_for: Arc<Mutex<Option<BackgroundWork>>>,
    closed: Arc<AtomicBool>,
    checks: Arc<Slots>,
}

impl Default for BackgroundPlace {
    fn default() -> Self {
        Self { taken_for: Arc::default(), closed: Arc::default(), checks: Slots::new(CHECKS_AT_ONCE, MOST_WAITING) }
    }
}

impl BackgroundPlace {
    /// Checks a request of a client for a piece of work when it is the client's turn, and begins the work. `check_and_begin` takes the place with
    /// [`Self::occupy_for`] once it has found no mistake. While other work is under way, nothing is checked.
    ///
    /// # Errors
    /// [`Problem`]: what is under way there, that a newer request of this client came while this one waited, that the check takes too long, or
    /// what the check has found.
    pub async fn check_in_turn_and_begin<T: Send + 'static>(
        &self,
        work: BackgroundWork,
        client: Client,
        sender: &RequestSender,
        check_and_begin: impl FnOnce(&Deadline) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        self.check_not_occupied()?;
        let slot = sender
            .run_until_connection_closed(self.checks.wait_for_slot_replacing_waiting_request_of_same_client(client))
            .await?;
        self.check_not_occupied()?;
        let whole = move |deadline: &Deadline| {
            // Until the check is done, also if nobody waits for it any more.
            let _slot = slot;
            check_and_begin(deadline)
        };
        run_low_priority_until_deadline(work.thread_name(), LONGEST_CHECK, sender, whole).await
    }

    fn check_not_occupied(&self) -> Result<(), Problem> {
        let taken_for = *self.lock_work();
        taken_for.map_or(Ok(()), |other| Err(other.already_under_way_problem()))
    }

    /// No work begins any more: the daemon ends.
    pub fn close(&self) {
        let _taken_for = self.lock_work();
        self.closed.store(true, Ordering::Relaxed);
    }

    /// Takes it.
    ///
    /// # Errors
    /// [`Problem`]: what is under way there, or that the daemon ends.
    pub fn occupy_for(&self, work: BackgroundWork) -> Result<BackgroundPlaceGuard, Problem> {
        let mut taken_for = self.lock_work();
        match *taken_for {
            _ if self.closed.load(Ordering::Relaxed) => Err(SessionError::Closed.into()),
            Some(other) => Err(other.already_under_way_problem()),
            None => {
                *taken_for = Some(work);
                Ok(BackgroundPlaceGuard { place: self.clone(), work })
            }
        }
    }

    fn lock_work(&self) -> MutexGuard<'_, Option<BackgroundWork>> {
        self.taken_for.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The place is taken until this is dropped.
#[derive(Debug)]
pub struct BackgroundPlaceGuard {
    place: BackgroundPlace,
    work: BackgroundWork,
}

impl Drop for BackgroundPlaceGuard {
    fn drop(&mut self) {
        *self.place.lock_work() = None;
    }
}

/// What is known of a piece of work that finds an `F`.
#[derive(Clone, Debug)]
pub struct JobReport<F> {
    /// How far it is.
    pub stage: Stage,
    /// Parts of it that are done.
    pub there: usize,
    /// Of so many.
    pub all: usize,
    /// What it has found.
    pub found: F,
    /// Why it could not go on.
    pub problem: Option<String>,
}

/// A piece of work.
#[derive(Debug)]
pub struct BackgroundJob<F> {
    there: AtomicUsize,
    all: usize,
    deadline: Deadline,
    known: Mutex<JobState<F>>,
}

#[derive(Debug)]
struct JobState<F> {
    stage: Stage,
    found: F,
    problem: Option<String>,
}

impl<F: Clone> BackgroundJob<F> {
    fn new(all: usize, stage: Stage, found: F) -> Self {
        let known = Mutex::new(JobState { stage, found, problem: None });
        Self { there: AtomicUsize::new(0), all, deadline: Deadline::from_now(LONGEST), known }
    }

    fn lock_state(&self) -> MutexGuard<'_, JobState<F>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does a part of it, whose models and plans end when nobody wants it any more: on whichever thread that is.
    pub fn run_stoppable_by_cancel_or_time_limit<T>(&self, part: impl FnOnce() -> T) -> T {
        self.deadline.run_stoppable_by_cancel_or_time_limit(part)
    }

    /// Tells that only the end of it is left.
    pub fn set_stage_to_finishing(&self) {
        self.lock_state().stage = Stage::Finishing;
    }

    fn report_progress(&self) -> JobReport<F> {
        let known = self.lock_state();
        JobReport {
            stage: known.stage,
            there: self.there.load(Ordering::Relaxed),
            all: self.all,
            found: known.found.clone(),
            problem: known.problem.clone(),
        }
    }
}

impl<F: Send> StudyObserver for BackgroundJob<F> {
    fn is_stop_wanted(&self) -> bool {
        self.deadline.is_cancelled_or_expired()
    }

    fn report_newly_computed_designs(&self, parts: usize) {
        self.there.fetch_add(parts, Ordering::Relaxed);
    }
}

/// The newest piece of work of one kind; what it has found is kept until the next one begins.
#[derive(Debug)]
pub struct NewestJob<F>(Mutex<Arc<BackgroundJob<F>>>);

impl<F: Clone + Send + 'static> NewestJob<F> {
    /// None yet.
    #[must_use]
    pub fn without_job(empty_findings: F) -> Self {
        Self(Mutex::new(Arc::new(BackgroundJob::new(0, Stage::None, empty_findings))))
    }

    fn current_job(&self) -> Arc<BackgroundJob<F>> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How far it is.
    #[must_use]
    pub fn report_progress(&self) -> JobReport<F> {
        self.current_job().report_progress()
    }

    /// No other part of it begins.
    pub fn cancel_current_job(&self) {
        self.current_job().deadline.request_work_to_end_at_once();
    }

    /// Begins one of `part_count` parts. `findings_so_far` is what there is of it now; `work` gives what there is in the end, `None` where it was
    /// stopped, or why it could not go on.
    ///
    /// # Errors
    /// [`Problem`] if there is no thread for it.
    pub fn start_job(
        &self,
        taken: BackgroundPlaceGuard,
        part_count: usize,
        findings_so_far: F,
        work: impl FnOnce(&BackgroundJob<F>) -> Result<Option<F>, String> + Send + 'static,
    ) -> Result<JobReport<F>, Problem> {
        let name = taken.work.thread_name();
        let job = Arc::new(BackgroundJob::new(part_count, Stage::Running, findings_so_far));
        let own = Arc::clone(&job);
        let whole = move || {
            let ended =
                catch_unwind(AssertUnwindSafe(|| own.deadline.run_stoppable_by_cancel_or_time_limit(|| work(&own))));
            let ended = ended.unwrap_or_else(|_| {
                Err("the computation ended early because of an internal error: please report the error, with the request".into())
            });
            let mut known = own.lock_state();
            // Whoever sees that it has ended may begin another one.
            drop(taken);
            match ended {
                Ok(Some(findings_so_far)) => (known.found, known.stage) = (findings_so_far, Stage::Done),
                // A model that was ended on its way is no mistake.
                Ok(None) | Err(_) if own.deadline.is_cancelled() => known.stage = Stage::Stopped,
                Ok(None) | Err(_) if own.deadline.is_time_over() => {
                    let problem = format!(
                        "the computation took longer than {LONGEST:?}, which is the maximum: simplify the scene or \
                         the study"
                    );
                    (known.problem, known.stage) = (Some(problem), Stage::Failed);
                }
                Ok(None) => known.stage = Stage::Stopped,
                Err(problem) => (known.problem, known.stage) = (Some(problem), Stage::Failed),
            }
        };
        let mut current = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Who wants to know how it ended asks for it.
        let _ended = spawn_low_priority_thread(name, whole)?;
        *current = Arc::clone(&job);
        Ok(job.report_progress())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::time::{Duration, Instant};

    fn await_end_of_job<F: Clone + Send + 'static>(newest: &NewestJob<F>) -> JobReport<F> {
        let deadline = Instant::now() + Duration::from_secs(10);
        while newest.report_progress().stage == Stage::Running {
            assert!(Instant::now() < deadline, "it goes on");
            std::thread::sleep(Duration::from_millis(1));
        }
        newest.report_progress()
    }

    /// One at a time, of whatever kind; whoever sees that one has ended may begin the next.
    #[test]
    fn the_place_is_for_one_and_free_when_that_has_ended() {
        let place = BackgroundPlace::default();
        let newest = NewestJob::without_job(0);
        assert_eq!(newest.report_progress().stage, Stage::None);
        let (go, wait) = channel::<()>();
        let taken = place.occupy_for(BackgroundWork::Study).unwrap();
        let work = move |job: &BackgroundJob<i32>| {
            job.report_newly_computed_designs(2);
            wait.recv().map_err(|error| error.to_string())?;
            Ok(Some(7))
        };
        assert_eq!(newest.start_job(taken, 3, 1, work).unwrap().found, 1);
        assert!(place.occupy_for(BackgroundWork::Study).unwrap_err().is_kind("study-runs"));
        assert!(place.occupy_for(BackgroundWork::Tolerances).unwrap_err().is_kind("study-runs"));
        go.send(()).unwrap();
        let told = await_end_of_job(&newest);
        assert_eq!((told.stage, told.found, told.there, told.all), (Stage::Done, 7, 2, 3));
        let taken = place.occupy_for(BackgroundWork::Tolerances).unwrap();
        assert!(place.occupy_for(BackgroundWork::Study).unwrap_err().is_kind("tolerances-run"));
        // One that is never begun leaves it free.
        drop(taken);
        place.occupy_for(BackgroundWork::Study).unwrap();
    }

    #[test]
    fn what_stops_fails_or_panics_is_reported_and_leaves_the_place_free() {
        let place = BackgroundPlace::default();
        let newest = NewestJob::without_job(0);
        let (began, has_begun) = channel();
        let until_stopped = move |job: &BackgroundJob<i32>| {
            began.send(()).map_err(|error| error.to_string())?;
            while !job.is_stop_wanted() {
                std::thread::sleep(Duration::from_millis(1));
            }
            Ok(None)
        };
        newest.start_job(place.occupy_for(BackgroundWork::Tolerances).unwrap(), 1, 5, until_stopped).unwrap();
        has_begun.recv().unwrap();
        newest.cancel_current_job();
        let told = await_end_of_job(&newest);
        assert_eq!((told.stage, told.found, told.problem), (Stage::Stopped, 5, None));
        // A model that was ended on its way says so, which is no mistake.
        let (began, has_begun) = channel();
        let ended_on_its_way = move |job: &BackgroundJob<i32>| {
            began.send(()).map_err(|error| error.to_string())?;
            while !job.is_stop_wanted() {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err("nobody waits for it".into())
        };
        newest.start_job(place.occupy_for(BackgroundWork::Study).unwrap(), 1, 6, ended_on_its_way).unwrap();
        has_begun.recv().unwrap();
        newest.cancel_current_job();
        let told = await_end_of_job(&newest);
        assert_eq!((told.stage, told.found, told.problem), (Stage::Stopped, 6, None));
        newest.start_job(place.occupy_for(BackgroundWork::Study).unwrap(), 1, 0, |_| Err("no room".into())).unwrap();
        let told = await_end_of_job(&newest);
        assert_eq!((told.stage, told.problem.as_deref()), (Stage::Failed, Some("no room")));
        newest
            .start_job(place.occupy_for(BackgroundWork::Study).unwrap(), 1, 0, |_| panic!("a mistake, on purpose"))
            .unwrap();
        let told = await_end_of_job(&newest);
        assert!(told.stage == Stage::Failed && told.problem.unwrap().contains("ended early"));
        place.occupy_for(BackgroundWork::Study).unwrap();
    }
}

//! Work of some seconds that no request waits for: one piece at a time, whatever it is, aside of what serves requests, so that touches and stops are
//! not held up, and for [`LONGEST`] at most.

use super::low_priority::{Deadline, begin_aside};
use crate::daemon::api::problem::{Kind, Problem};
use crate::design::run::StudyObserver;
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use utoipa::ToSchema;

/// Longest time for a piece of work: ten times what the largest study of the example plate takes on one processor.
const LONGEST: Duration = Duration::from_secs(300);

/// How far a piece of work is.
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
pub enum Work {
    /// A design study.
    Study,
    /// What tolerances do to a plan.
    Tolerances,
}

impl Work {
    /// Name of its thread.
    const fn name(self) -> &'static str {
        match self {
            Self::Study => "study",
            Self::Tolerances => "tolerances",
        }
    }

    /// That it is under way, and what else was asked for has to wait.
    fn runs(self) -> Problem {
        match self {
            Self::Study => Problem::new(Kind::StudyRuns, "a study is under way: POST /v1/study/stop ends it"),
            Self::Tolerances => {
                let detail = "panels that are off are looked at: POST /v1/tolerances/stop ends it";
                Problem::new(Kind::TolerancesRun, detail)
            }
        }
    }
}

/// The daemon's one place for such work.
#[derive(Clone, Debug, Default)]
pub struct Place(Arc<Mutex<Option<Work>>>);

impl Place {
    /// Takes it.
    ///
    /// # Errors
    /// [`Problem`]: what is under way there.
    pub fn take(&self, work: Work) -> Result<Taken, Problem> {
        let mut place = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match *place {
            Some(other) => Err(other.runs()),
            None => {
                *place = Some(work);
                Ok(Taken { place: self.clone(), work })
            }
        }
    }
}

/// The place is taken until this is dropped.
#[derive(Debug)]
pub struct Taken {
    place: Place,
    work: Work,
}

impl Drop for Taken {
    fn drop(&mut self) {
        *self.place.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// What is known of a piece of work that finds an `F`.
#[derive(Clone, Debug)]
pub struct Told<F> {
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
pub struct Job<F> {
    there: AtomicUsize,
    all: usize,
    deadline: Deadline,
    known: Mutex<Known<F>>,
}

#[derive(Debug)]
struct Known<F> {
    stage: Stage,
    found: F,
    problem: Option<String>,
}

impl<F: Clone> Job<F> {
    fn new(all: usize, stage: Stage, found: F) -> Self {
        let known = Mutex::new(Known { stage, found, problem: None });
        Self { there: AtomicUsize::new(0), all, deadline: Deadline::after(LONGEST), known }
    }

    fn known(&self) -> MutexGuard<'_, Known<F>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does a part of it, whose models and plans end when nobody wants it any more: on whichever thread that is.
    pub fn during<T>(&self, part: impl FnOnce() -> T) -> T {
        self.deadline.during(part)
    }

    /// Tells that only the end of it is left.
    pub fn finishes(&self) {
        self.known().stage = Stage::Finishing;
    }

    fn told(&self) -> Told<F> {
        let known = self.known();
        Told {
            stage: known.stage,
            there: self.there.load(Ordering::Relaxed),
            all: self.all,
            found: known.found.clone(),
            problem: known.problem.clone(),
        }
    }
}

impl<F: Send> StudyObserver for Job<F> {
    fn is_stop_wanted(&self) -> bool {
        self.deadline.is_over()
    }

    fn report_computed_designs(&self, parts: usize) {
        self.there.fetch_add(parts, Ordering::Relaxed);
    }
}

/// The newest piece of work of one kind; what it has found is kept until the next one begins.
#[derive(Debug)]
pub struct Newest<F>(Mutex<Arc<Job<F>>>);

impl<F: Clone + Send + 'static> Newest<F> {
    /// None yet.
    #[must_use]
    pub fn none(found: F) -> Self {
        Self(Mutex::new(Arc::new(Job::new(0, Stage::None, found))))
    }

    fn current(&self) -> Arc<Job<F>> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How far it is.
    #[must_use]
    pub fn told(&self) -> Told<F> {
        self.current().told()
    }

    /// No other part of it begins.
    pub fn stop(&self) {
        self.current().deadline.cancel();
    }

    /// Begins one of `all` parts. `found` is what there is of it now; `work` gives what there is in the end, `None` where it was
    /// stopped, or why it could not go on.
    ///
    /// # Errors
    /// [`Problem`] if there is no thread for it.
    pub fn begin(
        &self,
        taken: Taken,
        all: usize,
        found: F,
        work: impl FnOnce(&Job<F>) -> Result<Option<F>, String> + Send + 'static,
    ) -> Result<Told<F>, Problem> {
        let name = taken.work.name();
        let job = Arc::new(Job::new(all, Stage::Running, found));
        let own = Arc::clone(&job);
        let whole = move || {
            let ended = catch_unwind(AssertUnwindSafe(|| own.deadline.during(|| work(&own))));
            let ended =
                ended.unwrap_or_else(|_| Err("it ended early; please report it with what was asked for".into()));
            let mut known = own.known();
            // Whoever sees that it has ended may begin another one.
            drop(taken);
            match ended {
                Ok(Some(found)) => (known.found, known.stage) = (found, Stage::Done),
                // A model that was ended on its way is no mistake.
                Ok(None) | Err(_) if own.deadline.is_cancelled() => known.stage = Stage::Stopped,
                Ok(None) | Err(_) if own.deadline.has_run_out() => {
                    let problem =
                        format!("it took longer than {LONGEST:?}, which is the longest here: make it smaller");
                    (known.problem, known.stage) = (Some(problem), Stage::Failed);
                }
                Ok(None) => known.stage = Stage::Stopped,
                Err(problem) => (known.problem, known.stage) = (Some(problem), Stage::Failed),
            }
        };
        let mut current = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Who wants to know how it ended asks for it.
        let _ended = begin_aside(name, whole)?;
        *current = Arc::clone(&job);
        Ok(job.told())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::time::{Duration, Instant};

    fn ended<F: Clone + Send + 'static>(newest: &Newest<F>) -> Told<F> {
        let deadline = Instant::now() + Duration::from_secs(10);
        while newest.told().stage == Stage::Running {
            assert!(Instant::now() < deadline, "it goes on");
            std::thread::sleep(Duration::from_millis(1));
        }
        newest.told()
    }

    /// One at a time, of whatever kind; whoever sees that one has ended may begin the next.
    #[test]
    fn the_place_is_for_one_and_free_when_that_has_ended() {
        let place = Place::default();
        let newest = Newest::none(0);
        assert_eq!(newest.told().stage, Stage::None);
        let (go, wait) = channel::<()>();
        let taken = place.take(Work::Study).unwrap();
        let work = move |job: &Job<i32>| {
            job.report_computed_designs(2);
            wait.recv().map_err(|error| error.to_string())?;
            Ok(Some(7))
        };
        assert_eq!(newest.begin(taken, 3, 1, work).unwrap().found, 1);
        assert!(place.take(Work::Study).unwrap_err().is("study-runs"));
        assert!(place.take(Work::Tolerances).unwrap_err().is("study-runs"));
        go.send(()).unwrap();
        let told = ended(&newest);
        assert_eq!((told.stage, told.found, told.there, told.all), (Stage::Done, 7, 2, 3));
        let taken = place.take(Work::Tolerances).unwrap();
        assert!(place.take(Work::Study).unwrap_err().is("tolerances-run"));
        // One that is never begun leaves it free.
        drop(taken);
        place.take(Work::Study).unwrap();
    }

    #[test]
    fn what_stops_fails_or_panics_is_told_and_leaves_the_place_free() {
        let place = Place::default();
        let newest = Newest::none(0);
        let (began, has_begun) = channel();
        let until_stopped = move |job: &Job<i32>| {
            began.send(()).map_err(|error| error.to_string())?;
            while !job.is_stop_wanted() {
                std::thread::sleep(Duration::from_millis(1));
            }
            Ok(None)
        };
        newest.begin(place.take(Work::Tolerances).unwrap(), 1, 5, until_stopped).unwrap();
        has_begun.recv().unwrap();
        newest.stop();
        let told = ended(&newest);
        assert_eq!((told.stage, told.found, told.problem), (Stage::Stopped, 5, None));
        // A model that was ended on its way says so, which is no mistake.
        let (began, has_begun) = channel();
        let ended_on_its_way = move |job: &Job<i32>| {
            began.send(()).map_err(|error| error.to_string())?;
            while !job.is_stop_wanted() {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err("nobody waits for it".into())
        };
        newest.begin(place.take(Work::Study).unwrap(), 1, 6, ended_on_its_way).unwrap();
        has_begun.recv().unwrap();
        newest.stop();
        let told = ended(&newest);
        assert_eq!((told.stage, told.found, told.problem), (Stage::Stopped, 6, None));
        newest.begin(place.take(Work::Study).unwrap(), 1, 0, |_| Err("no room".into())).unwrap();
        let told = ended(&newest);
        assert_eq!((told.stage, told.problem.as_deref()), (Stage::Failed, Some("no room")));
        newest.begin(place.take(Work::Study).unwrap(), 1, 0, |_| panic!("a mistake, on purpose")).unwrap();
        let told = ended(&newest);
        assert!(told.stage == Stage::Failed && told.problem.unwrap().contains("ended early"));
        place.take(Work::Study).unwrap();
    }
}

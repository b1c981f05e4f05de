//! Requests that people make: to arm, and to clear a fault. They wait in a queue of their own, which has an end.

use crate::line::{Line, plate};
use crate::support::served::Served;
use crate::support::{Daemon, described};
use era::daemon::App;
use era::device::timing::REAL_TIME;
use era_shared::safety::SafetyState;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A daemon whose session can be made to wait for the board, as by a computer that has no time for it.
struct Waiting {
    // First, so that it lets go before the daemon has to end.
    line: Line,
    app: Arc<App>,
    url: String,
    _served: Served,
}

impl Waiting {
    fn start() -> Self {
        let (app, line) = plate(REAL_TIME);
        let app = Arc::new(app);
        let (served, url) = Served::at_a_port(&app, None);
        let waiting = Self { line, app, url, _served: served };
        waiting.until("the board is safe", || {
            waiting.app.driver.subscribe_device_snapshots().borrow().state() == Some(SafetyState::Safe)
        });
        waiting
    }

    /// The session waits for the answer to a sign of life, so that nothing is armed that would miss its host.
    fn hold(&self) {
        self.line.set(|ear| ear.is_held = true);
        drop(self.line.wait_for(|ear| ear.waiting > 0));
    }

    fn let_go(&self) {
        self.line.set(|ear| ear.is_held = false);
    }

    fn until(&self, what: &str, is_so: impl Fn() -> bool) {
        let deadline = Instant::now() + Duration::from_secs(30);
        while !is_so() {
            if Instant::now() >= deadline {
                // Whoever waits may end, so that this is told.
                self.let_go();
                panic!("not so: {what}");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until so many were refused.
    fn until_refused(&self, wanted: u64) {
        self.until(&format!("{wanted} were refused"), || {
            self.app.driver.admission.count_requests_refused_by_full_queue() >= wanted
        });
    }

    /// What `client` is answered: status, what the header `Retry-After` says, and the body.
    fn post(&self, path: &str, client: &str) -> (u16, Option<String>, Value) {
        let request = Daemon::agent().post(format!("{}{path}", self.url)).header("User-Agent", client);
        let mut answer = request.send("").unwrap();
        let header = |name: &str| answer.headers().get(name).map(|value| value.to_str().unwrap().to_owned());
        let (kind, retry) = (header("content-type").unwrap(), header("retry-after"));
        let (status, told) = (answer.status().as_u16(), answer.body_mut().read_json().unwrap());
        described::described().check("post", path, status, &kind, &told);
        (status, retry, told)
    }
}

#[test]
fn more_requests_of_people_than_can_be_done_soon_are_sent_away() {
    const MANY: u64 = 20;
    let waiting = &Waiting::start();
    waiting.hold();
    std::thread::scope(|scope| {
        let ask = |path: &'static str, client: &'static str| scope.spawn(move || waiting.post(path, client));
        let paths = ["/v1/arm", "/v1/faults/clear"].into_iter().cycle();
        let many: Vec<_> = paths.take(MANY as usize).map(|path| ask(path, "many")).collect();
        // One is being done and eight wait.
        waiting.until_refused(MANY - 9);
        // Another client gets a place: that of the newest of those who have the most.
        let other = ask("/v1/arm", "other");
        waiting.until_refused(MANY - 8);
        waiting.let_go();
        let (status, retry, told) = other.join().unwrap();
        assert_eq!((status, retry), (200, None), "{told}");
        let answers: Vec<_> = many.into_iter().map(|asked| asked.join().unwrap()).collect();
        let sent_away: Vec<_> = answers.iter().filter(|(status, ..)| *status == 429).collect();
        assert_eq!(sent_away.len() as u64, MANY - 8);
        for (_, retry, problem) in sent_away {
            assert_eq!((retry.as_deref(), &problem["depth"]), (Some("1"), &8.into()), "{problem}");
            assert!(problem["retry_after_ms"].as_u64() > Some(0), "{problem}");
            assert!(problem["type"].as_str().unwrap().ends_with(":busy"), "{problem}");
        }
        assert!(answers.iter().any(|(status, ..)| *status == 200), "{answers:?}");
    });
    // And all is as before.
    assert_eq!(waiting.post("/v1/arm", "many").0, 200);
}

/// A stop counts for those who wait, too.
#[test]
fn what_waited_when_everything_was_stopped_does_not_arm() {
    let waiting = &Waiting::start();
    waiting.hold();
    std::thread::scope(|scope| {
        let arms: Vec<_> = (0..12).map(|_| scope.spawn(|| waiting.post("/v1/arm", "one"))).collect();
        // As many wait as may.
        waiting.until_refused(3);
        let stop = scope.spawn(|| waiting.post("/v1/stop", "one"));
        waiting.until("the stop has come", || waiting.app.driver.stop_count() == 1);
        waiting.let_go();
        assert_eq!(stop.join().unwrap().0, 200);
        let mut answers: Vec<_> = arms
            .into_iter()
            .map(|arm| arm.join().unwrap())
            .map(|(status, _, told)| (status, told["type"].clone()))
            .collect();
        answers.sort_by_key(|(status, _)| *status);
        for (status, kind) in &answers[..9] {
            assert_eq!((*status, kind), (409, &json!("urn:era:problem:stopped")), "{answers:?}");
        }
        assert!(answers[9..].iter().all(|(status, _)| *status == 429), "{answers:?}");
    });
    assert!(!waiting.app.driver.subscribe_device_snapshots().borrow().state().unwrap().is_live());
}

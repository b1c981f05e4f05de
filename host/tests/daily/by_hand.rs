//! Requests that people make: to arm, and to clear a fault. They wait in a queue of their own, which has an end.

use crate::support::{Daemon, described, panel_of, table};
use era::daemon::{Access, App, Listener};
use era::device::OpenDevice;
use era::device::client::Transport;
use era::device::port::Port;
use era::device::session::policy::Policy;
use era::device::sim::SimDevice;
use era::device::timing::REAL_TIME;
use era::scene::EXAMPLE_PLATE;
use era_shared::safety::State;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A line on which whoever reads can be kept waiting, as by a computer that has no time for it.
struct Held {
    port: Port,
    hold: Arc<Hold>,
}

#[derive(Default)]
struct Hold {
    is_wanted: AtomicBool,
    /// Somebody is kept waiting.
    is_kept: AtomicBool,
}

impl Read for Held {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.hold.is_wanted.load(Ordering::SeqCst) {
            self.hold.is_kept.store(true, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(1));
        }
        self.port.read(buffer)
    }
}

impl Write for Held {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.port.write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A daemon whose session can be made to wait for the board.
struct Waiting {
    app: Arc<App>,
    url: String,
    hold: Arc<Hold>,
    _board: SimDevice,
    _runtime: tokio::runtime::Runtime,
}

impl Waiting {
    fn start() -> Self {
        let table = table(EXAMPLE_PLATE);
        let (panel, volts) = panel_of(&table);
        let board = SimDevice::start(panel, volts).unwrap();
        let (path, hold) = (board.path().to_owned(), Arc::new(Hold::default()));
        let held = Arc::clone(&hold);
        let open = move || -> Result<Box<dyn Transport>, serialport::Error> {
            Ok(Box::new(Held { port: Port::open(&path)?, hold: Arc::clone(&held) }))
        };
        let device = OpenDevice::over("a line", REAL_TIME, Box::new(open));
        let app = App::with(table, device, EXAMPLE_PLATE.into(), Policy::default(), Access::default()).unwrap();
        let (app, runtime) = (Arc::new(app), tokio::runtime::Runtime::new().unwrap());
        let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        runtime.spawn(era::daemon::serve(
            Arc::clone(&app),
            vec![Listener::Tcp(listener)],
            std::future::pending::<()>(),
        ));
        let waiting = Self { app, url, hold, _board: board, _runtime: runtime };
        waiting.until("the board is safe", || waiting.app.device().borrow().state() == Some(State::Safe));
        waiting
    }

    /// The session waits for the answer to a sign of life, so that nothing is armed that would miss its host.
    fn hold(&self) {
        self.hold.is_wanted.store(true, Ordering::SeqCst);
        self.until("the session waits", || self.hold.is_kept.load(Ordering::SeqCst));
    }

    fn let_go(&self) {
        self.hold.is_wanted.store(false, Ordering::SeqCst);
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
        self.until(&format!("{wanted} were refused"), || self.app.admission.refused() >= wanted);
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

impl Drop for Waiting {
    fn drop(&mut self) {
        // The daemon may end.
        self.let_go();
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
        waiting.until("the stop has come", || waiting.app.stops() == 1);
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
    assert!(!waiting.app.device().borrow().state().unwrap().is_live());
}

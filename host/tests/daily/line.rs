//! A line to a simulated board that listens along, and that can be made to fail. What happens to it is told by what was sent over it, so that a
//! test need not wait for time to pass.

use crate::support::{Daemon, panel_of, table};
use era::daemon::{Access, App, BackgroundDaemon};
use era::device::OpenDevice;
use era::device::client::Transport;
use era::device::port::{PortError, SerialPort};
use era::device::session::policy::SessionPolicy;
use era::device::sim::{SimControl, SimDevice};
use era::device::timing::{LinkTiming, REAL_TIME, RetryPolicy};
use era::scene::STARTING_PLATE;
use era_shared::link::{Decoder, FrameKind};
use era_shared::protocol::Request;
use std::io::{ErrorKind, Read, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Of one that is never late: for what is not about lateness, on a machine that may be busy.
pub const CALM: LinkTiming = LinkTiming {
    retry_policy: RetryPolicy::with_three_tries_of_constant_timeout(Duration::from_secs(10)),
    ..REAL_TIME
};
/// How long is waited for what comes at once.
const WAIT: Duration = Duration::from_secs(30);

/// A simulated board at the end of a line.
pub struct Line {
    board: SimDevice,
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    ear: Mutex<Ear>,
    changed: Condvar,
}

/// What the line does, and what it has heard.
#[derive(Default)]
pub struct Ear {
    /// How often it was opened.
    pub opened: u32,
    /// Whole requests that it has taken, in their order.
    pub asked: Vec<Request>,
    /// When it had taken each of them.
    pub at: Vec<Instant>,
    /// Whoever reads is kept waiting, as a thread that does not run.
    pub is_held: bool,
    /// Whoever opens it is.
    pub opening_is_held: bool,
    /// So many are kept waiting now.
    pub waiting: u32,
    /// Reading is held from the first request like this on.
    pub holds_at: Option<Request>,
    /// What the board answers is lost.
    pub is_deaf: bool,
    /// Bytes that it takes of the next frame, and then none until another one begins.
    pub takes: Option<usize>,
    /// Whoever reads panics.
    pub breaks: bool,
}

impl Line {
    pub fn to(board: SimDevice) -> Self {
        Self { board, shared: Arc::default() }
    }

    pub fn sim(&self) -> SimControl {
        self.board.control()
    }

    /// What it does and has heard.
    pub fn ear(&self) -> MutexGuard<'_, Ear> {
        self.shared.ear()
    }

    /// Changes what it does.
    pub fn set(&self, change: impl FnOnce(&mut Ear)) {
        change(&mut self.ear());
        self.shared.changed.notify_all();
    }

    /// How many requests it has taken; changed at the same time, so that what follows is heard with the change.
    pub fn mark(&self, change: impl FnOnce(&mut Ear)) -> usize {
        let mut marked = 0;
        self.set(|ear| {
            change(ear);
            marked = ear.asked.len();
        });
        marked
    }

    /// Waits until it is as wanted. That it never is ends with a limit; what must not come before is for the caller to look at.
    #[track_caller]
    pub fn wait_for(&self, wanted: impl Fn(&Ear) -> bool) -> MutexGuard<'_, Ear> {
        let wait = self.shared.changed.wait_timeout_while(self.ear(), WAIT, |ear| !wanted(ear));
        let (ear, waited) = wait.unwrap_or_else(PoisonError::into_inner);
        assert!(!waited.timed_out(), "still not as wanted: {:?}", ear.asked.iter().rev().take(20).collect::<Vec<_>>());
        ear
    }

    /// Waits until the board is stopped, in place of one of `most` questions that may go unanswered before. It fails with the first question
    /// over that.
    #[track_caller]
    pub fn is_stopped_within(&self, since: usize, most: usize) {
        let stop_in = |ear: &Ear| ear.asked[since..].iter().position(|request| *request == Request::Stop);
        let ear = self.wait_for(|ear| stop_in(ear).is_some() || ear.asked.len() > since + most);
        assert!(stop_in(&ear).is_some_and(|at| at <= most), "asked on: {:?}", &ear.asked[since..]);
    }

    pub fn device(&self, timing: LinkTiming) -> OpenDevice {
        let (path, shared) = (self.board.port_path().to_owned(), Arc::clone(&self.shared));
        let open = move || -> Result<Box<dyn Transport>, PortError> {
            shared.ear().opened += 1;
            shared.wait_while(|ear| ear.opening_is_held);
            let end = End {
                port: SerialPort::open(&path)?,
                decoder: Decoder::new(),
                left: None,
                shared: Arc::clone(&shared),
            };
            Ok(Box::new(end))
        };
        OpenDevice::with_opener("a line", timing, Box::new(open))
    }

    /// Waits until the board is off.
    #[track_caller]
    pub fn goes_off(&self) {
        let deadline = Instant::now() + WAIT;
        while self.sim().observations_since_start().energised {
            assert!(Instant::now() < deadline, "the board is still live");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// What a daemon serves at the end of a line to the board of the example plate. The line comes last, as in all that makes one, so that it is dropped
/// first: whoever it kept waiting then ends.
pub fn plate(timing: LinkTiming) -> (App, Line) {
    plate_with(timing, SessionPolicy::default())
}

fn plate_with(timing: LinkTiming, policy: SessionPolicy) -> (App, Line) {
    let table = table(STARTING_PLATE);
    let (panel, volts) = panel_of(&table);
    let line = Line::to(SimDevice::start(panel, volts).unwrap());
    let device = line.device(timing);
    let app =
        App::start_session_with_policy_and_access(table, device, STARTING_PLATE.to_owned(), policy, Access::default())
            .unwrap();
    (app, line)
}

/// The same with a daemon that serves it, once the board answers.
pub fn daemon(timing: LinkTiming) -> (Daemon, Line) {
    daemon_with(timing, SessionPolicy::default())
}

/// The same with what it does without being asked.
pub fn daemon_with(timing: LinkTiming, policy: SessionPolicy) -> (Daemon, Line) {
    let (app, line) = plate_with(timing, policy);
    let background = BackgroundDaemon::start(app).unwrap();
    let daemon =
        Daemon { url: format!("http://{}", background.address()), sim: line.sim(), background: Some(background) };
    daemon.wait_for(|state| state["device"]["connected"] == true);
    (daemon, line)
}

impl Drop for Line {
    fn drop(&mut self) {
        // Whoever is kept waiting may end.
        self.set(|ear| (ear.is_held, ear.opening_is_held, ear.holds_at) = (false, false, None));
    }
}

impl Shared {
    fn ear(&self) -> MutexGuard<'_, Ear> {
        self.ear.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait_while(&self, held: impl Fn(&Ear) -> bool) {
        let mut ear = self.ear();
        ear.waiting += 1;
        self.changed.notify_all();
        let mut ear = self.changed.wait_while(ear, |ear| held(ear)).unwrap_or_else(PoisonError::into_inner);
        ear.waiting -= 1;
    }
}

/// The host's end.
struct End {
    port: SerialPort,
    decoder: Decoder,
    /// Bytes that are still taken of this frame.
    left: Option<usize>,
    shared: Arc<Shared>,
}

impl Read for End {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let breaks = self.shared.ear().breaks;
        assert!(!breaks, "a mistake that was planted");
        if self.shared.ear().is_held {
            self.shared.wait_while(|ear| ear.is_held);
        }
        let length = self.port.read(buffer)?;
        if self.shared.ear().is_deaf { Err(ErrorKind::TimedOut.into()) } else { Ok(length) }
    }
}

impl Write for End {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        // No frame has a zero in it: one at the beginning is another frame's.
        if bytes.first() == Some(&0) && bytes.len() > 1 {
            self.left = None;
        }
        self.left = self.left.or_else(|| self.shared.ear().takes.take());
        let most = self.left.map_or(bytes.len(), |left| left.min(bytes.len()));
        if most == 0 {
            std::thread::sleep(Duration::from_millis(2));
            return Err(ErrorKind::TimedOut.into());
        }
        // Before the board has it, so that nobody sees what came of it before it is heard here.
        let mut ear = self.shared.ear();
        let length = self.port.write(&bytes[..most])?;
        self.left = self.left.map(|left| left - length);
        let Ear { asked, at, .. } = &mut *ear;
        self.decoder.feed_bytes(&bytes[..length], |frame| {
            let request = frame.ok().filter(|frame| frame.kind == FrameKind::Request as u8);
            asked.extend(request.and_then(|frame| postcard::from_bytes::<Request>(frame.body).ok()));
            at.resize(asked.len(), Instant::now());
        });
        if ear.holds_at.is_some() && ear.asked.last() == ear.holds_at.as_ref() {
            (ear.is_held, ear.holds_at) = (true, None);
        }
        drop(ear);
        self.shared.changed.notify_all();
        Ok(length)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

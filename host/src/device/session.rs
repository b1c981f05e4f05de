//! A session with a device: one thread that owns the link, keeps it alive while armed, ends drives in time, notices
//! restarts and lost cables, and publishes what it sees.
//!
//! The device's own dead-man timer is what makes this safe: whatever happens to this thread or its process, the board
//! switches off by itself.

use super::client::{Client, LinkError, LinkStatistics};
use super::target::OpenDevice;
use era_shared::protocol::{
    AchievedDrive, CURRENT_VERSION, ChannelDrive, HelloReply, MIN_VERSION, Reply, Request, StatusReply, TelemetryReply,
};
use era_shared::safety::State;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};

/// Between two tries to open a lost port.
const REOPEN: Duration = Duration::from_millis(500);
/// Idle time after which the session disarms: high voltage is not kept ready for a touch that may never come.
const DISARM_AFTER: Duration = Duration::from_secs(5);

/// Why a command was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The link failed, or the device refused.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The device is in a fault that must be cleared first.
    #[error("the device is in fault {number} ({name}): {advice}")]
    Fault {
        /// Its number.
        number: u8,
        /// Its name.
        name: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// There is no device at the moment.
    #[error("the device at {path} is not connected: {reason}")]
    Disconnected {
        /// The port.
        path: String,
        /// Since what.
        reason: String,
    },
    /// Everything was stopped after this drive had been asked for.
    #[error("everything was stopped while this was being planned")]
    Stopped,
    /// The session has ended.
    #[error("the daemon is shutting down")]
    Closed,
}

/// What a drive command did.
#[derive(Clone, Debug)]
pub struct Driven {
    /// What the device achieves.
    pub achieved: Vec<AchievedDrive>,
    /// When the last byte of the drive's frame was handed to the port.
    pub frame_written: Option<Instant>,
}

/// What is known of the device.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// `sim`, `emulated` or `serial`.
    pub kind: &'static str,
    /// The serial port.
    pub path: String,
    /// Whether it answers.
    pub connected: bool,
    /// Why it does not.
    pub problem: Option<String>,
    /// Who it is.
    pub hello: Option<HelloReply>,
    /// Its state as last seen.
    pub status: Option<StatusReply>,
    /// Its measurements as last seen.
    pub telemetry: Option<TelemetryReply>,
    /// Median round trip.
    pub round_trip: Option<Duration>,
    /// Frames and errors.
    pub link: LinkStatistics,
    /// Restarts noticed since the session began.
    pub restarts: u32,
}

impl Snapshot {
    /// The safety state as last seen.
    #[must_use]
    pub fn state(&self) -> Option<State> {
        self.status.as_ref().map(|status| status.state)
    }
}

/// What to drive, and until when.
#[derive(Clone, Debug)]
pub struct DriveOrder {
    /// Names the drive for [`Session::end_at`].
    pub id: u64,
    /// [`Session::stops`] as it was when the drive was asked for: a stop since then refuses it.
    pub stops: u64,
    /// What every channel does.
    pub drives: Vec<ChannelDrive>,
    /// How long.
    pub hold: Duration,
}

enum Command {
    Drive { order: DriveOrder, answer: oneshot::Sender<Result<Driven, SessionError>> },
    Stop { answer: oneshot::Sender<Result<(), SessionError>> },
    EndAt { id: u64, when: Instant },
    Clear { answer: oneshot::Sender<Result<(), SessionError>> },
    Close,
}

/// A session; it stops and disarms the device when it is dropped.
#[derive(Debug)]
pub struct Session {
    commands: Sender<Command>,
    snapshot: watch::Receiver<Snapshot>,
    stops: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Session {
    /// Starts the session's thread.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(device: OpenDevice) -> std::io::Result<Self> {
        let (commands, inbox) = channel();
        let first = Snapshot { kind: device.kind(), path: device.path().to_owned(), ..Snapshot::default() };
        let (publish, snapshot) = watch::channel(first);
        let stops = Arc::new(AtomicU64::new(0));
        let worker = Worker::new(device, publish, Arc::clone(&stops));
        let thread = std::thread::Builder::new().name("device-session".into()).spawn(move || worker.run(&inbox))?;
        Ok(Self { commands, snapshot, stops, thread: Some(thread) })
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn snapshots(&self) -> watch::Receiver<Snapshot> {
        self.snapshot.clone()
    }

    /// How often everything was stopped so far.
    #[must_use]
    pub fn stops(&self) -> u64 {
        self.stops.load(Ordering::SeqCst)
    }

    /// Arms if need be, sets the drives and ends them after a while.
    ///
    /// # Errors
    /// [`SessionError`], [`SessionError::Stopped`] if everything was stopped since the order's count was read; nothing is
    /// driven then.
    pub async fn drive(&self, order: DriveOrder) -> Result<Driven, SessionError> {
        let (answer, reply) = oneshot::channel();
        self.send(Command::Drive { order, answer })?;
        reply.await.map_err(|_| SessionError::Closed)?
    }

    /// Everything off, session disarmed.
    ///
    /// # Errors
    /// [`SessionError`]; the device's dead-man timer then does it within 250 ms.
    pub async fn stop(&self) -> Result<(), SessionError> {
        // Before anything else: what is planned meanwhile must not be driven. A drive that the worker has already begun is
        // ended by the command behind it.
        self.stops.fetch_add(1, Ordering::SeqCst);
        let (answer, reply) = oneshot::channel();
        self.send(Command::Stop { answer })?;
        reply.await.map_err(|_| SessionError::Closed)?
    }

    /// Ends the drive named `id` at `when`, if it does not end before; another one goes on.
    pub fn end_at(&self, id: u64, when: Instant) {
        // A session that has ended has ended its drives.
        let _ = self.send(Command::EndAt { id, when });
    }

    /// Clears the latched fault.
    ///
    /// # Errors
    /// [`SessionError`].
    pub async fn clear_faults(&self) -> Result<(), SessionError> {
        let (answer, reply) = oneshot::channel();
        self.send(Command::Clear { answer })?;
        reply.await.map_err(|_| SessionError::Closed)?
    }

    fn send(&self, command: Command) -> Result<(), SessionError> {
        self.commands.send(command).map_err(|_| SessionError::Closed)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.commands.send(Command::Close);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Worker {
    device: OpenDevice,
    client: Option<Client>,
    publish: watch::Sender<Snapshot>,
    stops: Arc<AtomicU64>,
    /// The drive that was set last.
    drive_id: u64,
    boot_id: Option<u32>,
    armed: bool,
    drive_until: Option<Instant>,
    idle_since: Instant,
    last_heard: Instant,
    next_status: Instant,
    next_open: Instant,
}

impl Worker {
    fn new(device: OpenDevice, publish: watch::Sender<Snapshot>, stops: Arc<AtomicU64>) -> Self {
        let now = Instant::now();
        Self {
            device,
            client: None,
            publish,
            stops,
            drive_id: 0,
            boot_id: None,
            armed: false,
            drive_until: None,
            idle_since: now,
            last_heard: now,
            next_status: now,
            next_open: now,
        }
    }

    fn run(mut self, inbox: &Receiver<Command>) {
        loop {
            self.attend();
            match inbox.recv_timeout(self.until_next_duty()) {
                Ok(Command::Drive { order, answer }) => {
                    let _ = answer.send(self.drive(order));
                }
                Ok(Command::Stop { answer }) => {
                    let _ = answer.send(self.stop());
                }
                Ok(Command::EndAt { id, when }) => {
                    if id == self.drive_id {
                        self.drive_until = self.drive_until.map(|until| until.min(when));
                    }
                }
                Ok(Command::Clear { answer }) => {
                    let _ = answer.send(self.clear());
                }
                Ok(Command::Close) | Err(RecvTimeoutError::Disconnected) => {
                    if self.client.is_some()
                        && let Err(error) = self.stop()
                    {
                        tracing::warn!(%error, "could not stop the device on leaving; its dead-man timer does it");
                    }
                    return;
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn until_next_duty(&self) -> Duration {
        let mut next = if self.client.is_some() { self.next_status } else { self.next_open };
        if self.armed {
            next = next.min(self.last_heard + self.device.timing().keep_alive);
        }
        if let Some(until) = self.drive_until {
            next = next.min(until);
        }
        next.saturating_duration_since(Instant::now())
    }

    /// What has to be done by now: open, keep alive, end a drive, look at the state.
    fn attend(&mut self) {
        let now = Instant::now();
        if self.client.is_none() {
            if now >= self.next_open {
                self.open();
                self.next_open = Instant::now() + REOPEN;
            }
            return;
        }
        let result = if self.drive_until.is_some_and(|until| now >= until) {
            self.rest()
        } else if self.armed && self.drive_until.is_none() && now >= self.idle_since + DISARM_AFTER {
            self.ask(&Request::Disarm).map(|_| self.armed = false)
        } else if self.armed && now >= self.last_heard + self.device.timing().keep_alive {
            self.keep_alive()
        } else if now >= self.next_status {
            self.look()
        } else {
            Ok(())
        };
        if let Err(error) = result {
            self.note_trouble(&error);
        }
    }

    fn open(&mut self) {
        let opened = self.device.client().map_err(|error| LinkError::Io(error.into())).and_then(|client| {
            self.client = Some(client);
            self.greet()
        });
        match opened {
            Ok(()) => tracing::info!(path = self.device.path(), kind = self.device.kind(), "device connected"),
            Err(error) => self.note_trouble(&error),
        }
    }

    fn greet(&mut self) -> Result<(), LinkError> {
        let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let Reply::Hello(hello) = self.ask(&hello)? else { return Err(unexpected("hello")) };
        self.boot_id = Some(hello.boot_id);
        self.armed = false;
        self.drive_until = None;
        self.publish.send_modify(|snapshot| snapshot.hello = Some(hello));
        self.look()
    }

    fn keep_alive(&mut self) -> Result<(), LinkError> {
        let Reply::Alive { state } = self.ask(&Request::KeepAlive)? else { return Err(unexpected("keep-alive")) };
        if !state.is_live() {
            self.armed = false;
            self.drive_until = None;
            return self.look();
        }
        Ok(())
    }

    fn look(&mut self) -> Result<(), LinkError> {
        self.next_status = Instant::now() + self.device.timing().status;
        let Reply::Status(status) = self.ask(&Request::Status)? else { return Err(unexpected("status")) };
        let Reply::Telemetry(telemetry) = self.ask(&Request::Telemetry)? else { return Err(unexpected("telemetry")) };
        let restarted = self.boot_id.is_some_and(|known| known != status.boot_id);
        if !status.state.is_live() {
            self.armed = false;
            self.drive_until = None;
        }
        let (round_trip, link) = self
            .client
            .as_ref()
            .map_or((None, LinkStatistics::default()), |client| (client.round_trip_median(), client.statistics()));
        self.publish.send_modify(|snapshot| {
            snapshot.connected = true;
            snapshot.problem = None;
            snapshot.status = Some(status);
            snapshot.telemetry = Some(telemetry);
            snapshot.round_trip = round_trip;
            snapshot.link = link;
            snapshot.restarts += u32::from(restarted);
        });
        if restarted {
            tracing::warn!("the device has restarted");
            return self.greet();
        }
        Ok(())
    }

    fn drive(&mut self, order: DriveOrder) -> Result<Driven, SessionError> {
        let result = self.try_drive(order);
        if let Err(SessionError::Link(error)) = &result {
            self.note_trouble(error);
        }
        result
    }

    fn try_drive(&mut self, order: DriveOrder) -> Result<Driven, SessionError> {
        let DriveOrder { id, stops, drives, hold } = order;
        if stops != self.stops.load(Ordering::SeqCst) {
            return Err(SessionError::Stopped);
        }
        self.connected()?;
        if !self.armed {
            let status = self.publish.borrow().status.clone();
            if let Some(fault) = status.and_then(|status| status.fault) {
                return Err(SessionError::Fault {
                    number: fault.code.number(),
                    name: fault.code.name(),
                    advice: fault.code.advice(),
                });
            }
            self.ask(&Request::Arm { deadman_ms: None })?;
            self.armed = true;
        }
        let drives: heapless::Vec<_, _> = drives.into_iter().take(era_shared::MAX_CHANNELS).collect();
        let state = if drives.is_empty() { State::Armed } else { State::Running };
        let Reply::DrivesSet { achieved } = self.ask(&Request::SetDrives { drives })? else {
            return Err(unexpected("set-drives").into());
        };
        let frame_written = self.client.as_ref().and_then(Client::last_frame_written);
        let now = Instant::now();
        self.drive_id = id;
        self.drive_until = Some(now + hold);
        self.idle_since = now + hold;
        // The acknowledgement tells the state; who asks right after its answer must not read an older one. The rest of the
        // status follows at once.
        self.publish.send_modify(|snapshot| {
            if let Some(status) = &mut snapshot.status {
                status.state = state;
            }
        });
        self.next_status = now;
        Ok(Driven { achieved: achieved.to_vec(), frame_written })
    }

    fn rest(&mut self) -> Result<(), LinkError> {
        self.drive_until = None;
        self.idle_since = Instant::now();
        self.ask(&Request::SetDrives { drives: heapless::Vec::new() })?;
        self.look()
    }

    fn stop(&mut self) -> Result<(), SessionError> {
        self.connected()?;
        self.armed = false;
        self.drive_until = None;
        let result = self.ask(&Request::Stop).and_then(|_| self.look());
        if let Err(error) = &result {
            self.note_trouble(error);
        }
        Ok(result?)
    }

    fn clear(&mut self) -> Result<(), SessionError> {
        self.connected()?;
        self.ask(&Request::ClearFaults)?;
        Ok(self.look()?)
    }

    fn connected(&self) -> Result<(), SessionError> {
        if self.client.is_some() {
            return Ok(());
        }
        let reason = self.publish.borrow().problem.clone().unwrap_or_else(|| "it has not answered yet".into());
        Err(SessionError::Disconnected { path: self.device.path().to_owned(), reason })
    }

    fn ask(&mut self, request: &Request) -> Result<Reply, LinkError> {
        let client = self.client.as_mut().ok_or_else(|| std::io::Error::from(std::io::ErrorKind::NotConnected))?;
        let reply = client.request(request)?;
        self.last_heard = Instant::now();
        Ok(reply)
    }

    /// A refusal leaves the link as it is, after a look at the device's state; anything else closes it, to be opened anew.
    fn note_trouble(&mut self, error: &LinkError) {
        if matches!(error, LinkError::Refused(_)) {
            self.next_status = Instant::now();
            tracing::warn!(%error, "refused");
            return;
        }
        let text = error.to_string();
        if self.publish.borrow().problem.as_deref() != Some(&text) {
            tracing::error!(path = self.device.path(), %error, "device lost");
        }
        self.client = None;
        self.armed = false;
        self.drive_until = None;
        self.next_open = Instant::now() + REOPEN;
        self.publish.send_modify(|snapshot| {
            snapshot.connected = false;
            snapshot.problem = Some(text);
        });
    }
}

fn unexpected(request: &'static str) -> LinkError {
    LinkError::Unexpected { request, reply: "another kind of answer".into() }
}

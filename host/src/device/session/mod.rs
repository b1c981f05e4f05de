//! A session with a device: one thread that owns the link, keeps it alive while armed, ends drives in time, notices
//! restarts and lost cables, and publishes what it sees.
//!
//! The device's own dead-man timer is what makes this safe: whatever happens to this thread or its process, the board
//! switches off by itself.

mod guard;
mod play;
pub mod policy;
mod refresh;
mod snapshot_part;
mod worker;

use super::client::{LinkError, LinkStatistics};
use super::clock::ClockQuality;
use super::identity::DeviceIdentity;
use super::priority;
use super::round_trips::RoundTripSummary;
use super::target::OpenDevice;
use era_shared::protocol::{
    AchievedDrive, ChannelDrive, CreditReply, DetailsReply, StatusReply, TelemetryReply, WindowSequence,
};
use era_shared::safety::SafetyState;
use era_shared::waveform::Effect;
use policy::{SceneNeeds, SessionPolicy};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};
use worker::SessionWorker;

/// Why a command was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The link failed, or the device refused.
    #[error(transparent)]
    Link(LinkError),
    /// The device is in a fault that must be cleared first.
    #[error("the device has latched fault {number} ({name}): {advice}")]
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
    /// The device does not answer just now.
    #[error("the device at {path} has not answered in time: {reason}")]
    Late {
        /// The port.
        path: String,
        /// For how long.
        reason: String,
    },
    /// The device has neither got through its self-test nor told a fault.
    #[error("the device did not become ready within {waited:?}; its state is {state}")]
    NotArmed {
        /// How long was waited.
        waited: Duration,
        /// Its state's name.
        state: &'static str,
    },
    /// The device was away, and is not armed again by itself.
    #[error("the device had an outage ({reason}) and waits until a person arms it")]
    Away {
        /// What had happened.
        reason: String,
        /// Whether it has latched a fault besides, which arming does not clear.
        is_faulty: bool,
    },
    /// The device is not made for this scene.
    #[error("the device does not match the scene: {reason}")]
    Unfit {
        /// What is missing.
        reason: String,
    },
    /// Everything was stopped after this drive had been asked for.
    #[error("a stop command ended this request before its completion")]
    Stopped,
    /// The device went off, faulted or was away after this drive had been asked for.
    #[error(
        "this request was not completed, because the device switched its high voltage off, reported a fault or had an \
        outage after the request arrived"
    )]
    Broken,
    /// The session has ended.
    #[error("the daemon is shutting down")]
    Closed,
    /// Its thread has ended without being told to: by a mistake in this program.
    #[error("{ENDED}. The board has switched its high voltage off. Restart the daemon to drive the actuators again")]
    Ended,
    /// Its thread hangs, by a mistake in this program or of the system's driver.
    #[error("{HANGS}. The board has switched its high voltage off. Restart the daemon to drive the actuators again")]
    Hangs,
}

impl From<LinkError> for SessionError {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::Halted { by_order: true, .. } => Self::Stopped,
            error => Self::Link(error),
        }
    }
}

/// What is said of a device whose session is no more.
const ENDED: &str = "the session with the device has ended";

/// What is said of one whose thread does nothing any more.
const HANGS: &str = "the session with the device hangs";
/// Time for its thread to end beside what a request to the device may take.
const LEAVE: Duration = Duration::from_millis(300);

/// What an order to drive did.
#[derive(Clone, Debug)]
pub struct DriveResult {
    /// The drives as the device achieves them; none of single windows.
    pub achieved: Vec<AchievedDrive>,
    /// Of an effect, when it is played.
    pub effect: Option<EffectTimes>,
}

/// When the board plays an effect.
#[derive(Clone, Copy, Debug)]
pub struct EffectTimes {
    /// When it begins, in us of the board's time.
    pub start_us: u64,
    /// The same in the host's time.
    pub start: Instant,
    /// How long it lasts on the channel on which it lasts longest.
    pub length: Duration,
}

/// What is known of the device.
#[derive(Clone, Debug, Default)]
pub struct DeviceSnapshot {
    /// `sim`, `emulated` or `serial`.
    pub kind: &'static str,
    /// The serial port.
    pub path: String,
    /// Whether it answers.
    pub connected: bool,
    /// Whether it does not just now, and may be only late: it is asked on.
    pub in_doubt: bool,
    /// Why it does not.
    pub problem: Option<String>,
    /// Who it is.
    pub identity: Option<DeviceIdentity>,
    /// Protocol version spoken with it.
    pub protocol: Option<u8>,
    /// Its state as last seen.
    pub status: Option<StatusReply>,
    /// Its measurements as last seen.
    pub telemetry: Option<TelemetryReply>,
    /// Supply, loops and budgets as last seen; a device of version 1 does not tell.
    pub details: Option<DetailsReply>,
    /// What the channels' drives cost; a device of version 1 or 2 does not tell, and charges by time.
    pub credit: Option<CreditReply>,
    /// How well its clock is known.
    pub clock: Option<ClockQuality>,
    /// The last round trips.
    pub round_trips: RoundTripSummary,
    /// Frames and errors since the session began.
    pub link: LinkStatistics,
    /// What was known of the link when the latched fault was seen.
    pub link_at_fault: Option<LinkAtFault>,
    /// Restarts noticed since the session began.
    pub restarts: u32,
    /// How often the link was lost since then.
    pub outages: u32,
    /// How often it was in doubt; those that were losses count among the outages, too.
    pub doubts: u32,
    /// Faults latched since then.
    pub faults: u32,
    /// Latched silences of the host that were cleared by policy.
    pub cleared: u32,
    /// How often it went off unasked, faulted, was cleared, or was away: what was asked for before that is not begun after it.
    pub interruptions: u64,
    /// Longest time between two signs of life while armed.
    pub longest_gap: Duration,
    /// What of the board does not go with the scene.
    pub mismatch: Option<String>,
    /// Whether a person has to arm it.
    pub waits_to_be_armed: bool,
}

/// What is known of the link when a fault is seen.
#[derive(Clone, Copy, Debug)]
pub struct LinkAtFault {
    /// Longest time without an answer since the board was last seen without this fault.
    pub silence: Duration,
    /// The last round trips.
    pub round_trips: RoundTripSummary,
    /// Frames and errors.
    pub link: LinkStatistics,
    /// [`DeviceSnapshot::longest_gap`].
    pub longest_gap: Duration,
    /// [`DeviceSnapshot::outages`].
    pub outages: u32,
}

impl DeviceSnapshot {
    /// The safety state as last seen.
    #[must_use]
    pub fn state(&self) -> Option<SafetyState> {
        self.status.as_ref().map(|status| status.state)
    }
}

/// When something was asked for: it is not begun if any of this has happened since.
#[derive(Clone, Copy, Debug)]
pub struct AskedAt {
    /// [`Session::stop_count`] then.
    pub stops: u64,
    /// [`DeviceSnapshot::interruptions`] then, for what begins later than it was asked for, or is driven again.
    pub interruptions: Option<u64>,
}

/// What to drive.
#[derive(Clone, Debug)]
pub struct DriveOrder {
    /// Names the drive for [`Session::end_drive_no_later_than`].
    pub id: u64,
    /// When it was asked for.
    pub asked_at: AskedAt,
    /// When an effect is to begin; `None` is as soon as it can. It begins later if that is sooner than link and rails allow.
    pub start: Option<Instant>,
    /// What it is.
    pub content: DriveContent,
}

/// What is driven.
#[derive(Clone, Debug)]
pub enum DriveContent {
    /// Drives that do not change.
    Steady {
        /// What every channel does.
        drives: Vec<ChannelDrive>,
        /// How long.
        hold: Duration,
        /// Whether the rails are brought down first, so that they rise with the drives.
        from_zero: bool,
    },
    /// Envelopes over drives, which begin together.
    Envelopes {
        /// What every channel does at full level.
        drives: Vec<ChannelDrive>,
        /// What is played on each of them, in their order, from the same moment on.
        effects: Vec<Effect>,
    },
    /// Single windows. Its number and its start are the session's.
    Windows(Box<WindowSequence>),
}

enum Command {
    Drive { order: DriveOrder, asked: Instant, answer: oneshot::Sender<Result<DriveResult, SessionError>> },
    Stop { number: u64, answer: oneshot::Sender<Result<(), SessionError>> },
    EndAt { id: u64, when: Instant },
    MoveEndTo { id: u64, until: Instant },
    Clear { answer: oneshot::Sender<Result<(), SessionError>> },
    Arm { stops: u64, asked: Instant, answer: oneshot::Sender<Result<(), SessionError>> },
    Close,
}

/// A session; it stops and disarms the device when it is dropped.
#[derive(Debug)]
pub struct Session {
    commands: Sender<Command>,
    snapshot: watch::Receiver<DeviceSnapshot>,
    stops: Arc<AtomicU64>,
    beat: Arc<ActivityClock>,
    heard: Arc<ActivityClock>,
    /// Longest time without a sign of life of the thread.
    longest: Duration,
    /// The same for its end.
    leaves: Duration,
    thread: Option<JoinHandle<()>>,
}

/// When the session's thread was last seen at work, or the device was last heard.
#[derive(Debug)]
struct ActivityClock {
    origin: Instant,
    last_ms: AtomicU64,
}

impl ActivityClock {
    fn new() -> Self {
        Self { origin: Instant::now(), last_ms: AtomicU64::new(0) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "the age of a process in ms")]
    fn ms_since_clock_creation(&self) -> u64 {
        self.origin.elapsed().as_millis() as u64
    }

    fn note_activity(&self) {
        self.last_ms.store(self.ms_since_clock_creation(), Ordering::Relaxed);
    }

    fn time_since_activity(&self) -> Duration {
        Duration::from_millis(self.ms_since_clock_creation().saturating_sub(self.last_ms.load(Ordering::Relaxed)))
    }
}

impl Session {
    /// Starts the session's thread, for a scene that `needs` that much of a board.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(device: OpenDevice, needs: SceneNeeds, policy: SessionPolicy) -> std::io::Result<Self> {
        let (commands, inbox) = channel();
        let first =
            DeviceSnapshot { kind: device.kind(), path: device.port_path().to_owned(), ..DeviceSnapshot::default() };
        let (publish, snapshot) = watch::channel(first);
        let stops = Arc::new(AtomicU64::new(0));
        let beat = Arc::new(ActivityClock::new());
        let longest = Duration::from_secs(5) + device.timing().retry_policy.longest_total_wait() * 2;
        let leaves = device.timing().retry_policy.longest_total_wait().saturating_add(LEAVE);
        let heard = Arc::new(ActivityClock::new());
        let clocks = [Arc::clone(&beat), Arc::clone(&heard)];
        let worker = SessionWorker::new(device, needs, policy, publish, Arc::clone(&stops), clocks);
        let thread = std::thread::Builder::new().name("device-session".into()).spawn(move || {
            priority::raise_thread_priority();
            worker.run_until_closed(&inbox);
        })?;
        Ok(Self { commands, snapshot, stops, beat, heard, longest, leaves, thread: Some(thread) })
    }

    /// What is known of the device, kept up to date.
    #[must_use]
    pub fn subscribe_snapshots(&self) -> watch::Receiver<DeviceSnapshot> {
        self.snapshot.clone()
    }

    /// Whether the session's thread does its work: it shows life before every request to the device, and
    /// no request takes as long as this: all its tries, twice where another version is spoken, and 5 s for the port and the computer.
    #[must_use]
    pub fn is_thread_running_and_recently_active(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
            && self.beat.time_since_activity() < self.longest
    }

    /// Whether the session's thread does nothing any more though it has not ended.
    #[must_use]
    pub fn is_thread_alive_without_heartbeat(&self) -> bool {
        !self.is_thread_running_and_recently_active()
            && self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// The latest snapshot. Where the session's thread hangs the device is shown as not connected.
    #[must_use]
    pub fn current_snapshot_marked_disconnected_if_thread_hung(&self) -> DeviceSnapshot {
        let hangs = self.is_thread_alive_without_heartbeat();
        let mut snapshot = self.snapshot.borrow().clone();
        if hangs {
            (snapshot.connected, snapshot.in_doubt) = (false, false);
            snapshot.problem = Some(HANGS.into());
        }
        snapshot
    }

    /// Time since the device last answered anything, or since the session began if it never did.
    #[must_use]
    pub fn time_since_last_answer(&self) -> Duration {
        self.heard.time_since_activity()
    }

    /// How often everything was stopped so far.
    #[must_use]
    pub fn stop_count(&self) -> u64 {
        self.stops.load(Ordering::SeqCst)
    }

    /// Arms if need be, and has the board drive. Steady drives end after their time; where they are to begin with the rails down, whatever is
    /// driven ends first, and the device is armed anew: its self-test waits for the rails. Effects wait until the rails are up, and the board plays
    /// them by its own clock, so that how late this process or the link are does not show.
    ///
    /// # Errors
    /// [`SessionError`]; [`SessionError::Stopped`] and [`SessionError::Broken`] if something came between ([`AskedAt`]), and nothing is driven
    /// then; [`LinkError::TooOld`] with a device that cannot play effects.
    pub async fn begin_drive_arming_if_needed(&self, order: DriveOrder) -> Result<DriveResult, SessionError> {
        self.refuse_while_answer_is_late_or_thread_hung()?;
        let (answer, reply) = oneshot::channel();
        self.send_command(Command::Drive { order, asked: Instant::now(), answer })?;
        reply.await.map_err(|_| SessionError::Ended)?
    }

    /// Everything off, session disarmed. It goes before whatever else waits, also while an answer is waited for.
    ///
    /// # Errors
    /// [`SessionError`]; a stop was sent all the same where there was a port, and the device's dead-man timer switches it off 250 ms after the
    /// last frame that it heard.
    pub async fn stop_and_disarm_board(&self) -> Result<(), SessionError> {
        // Before anything else: what is planned meanwhile must not be driven, and the worker looks at the count between any two
        // requests and while it waits for an answer. The command only wakes it and brings the answer.
        let number = self.stops.fetch_add(1, Ordering::SeqCst) + 1;
        let (answer, reply) = oneshot::channel();
        self.send_command(Command::Stop { number, answer })?;
        reply.await.map_err(|_| SessionError::Ended)?
    }

    /// Ends the drive named `drive_id` at `when`, if it does not end before; another drive is not changed.
    pub fn end_drive_no_later_than(&self, drive_id: u64, when: Instant) {
        // A session that has ended has ended its drives.
        let _ = self.send_command(Command::EndAt { id: drive_id, when });
    }

    /// Moves the end of the drive named `drive_id` to `until`; another drive, or one that has ended, is not changed.
    pub fn move_drive_end_to(&self, drive_id: u64, until: Instant) {
        let _ = self.send_command(Command::MoveEndTo { id: drive_id, until });
    }

    /// Arms, unless that has been done, and waits for the self-test to end. It was asked for at `asked_at`, when [`Session::stop_count`] said
    /// `stop_count`.
    ///
    /// # Errors
    /// [`SessionError`], [`SessionError::Stopped`] if everything was stopped since then; nothing is armed then.
    pub async fn arm_on_person_request_unless_stopped_since(
        &self,
        stop_count: u64,
        asked_at: Instant,
    ) -> Result<(), SessionError> {
        self.refuse_while_answer_is_late_or_thread_hung()?;
        let (answer, reply) = oneshot::channel();
        self.send_command(Command::Arm { stops: stop_count, asked: asked_at, answer })?;
        reply.await.map_err(|_| SessionError::Ended)?
    }

    /// Clears the latched fault.
    ///
    /// # Errors
    /// [`SessionError`].
    pub async fn clear_faults(&self) -> Result<(), SessionError> {
        let (answer, reply) = oneshot::channel();
        self.send_command(Command::Clear { answer })?;
        reply.await.map_err(|_| SessionError::Ended)?
    }

    /// Refuses an order at once while the device may be gone: it might otherwise be driven when nobody expects it any more. Stops are not refused.
    fn refuse_while_answer_is_late_or_thread_hung(&self) -> Result<(), SessionError> {
        if self.is_thread_alive_without_heartbeat() {
            return Err(SessionError::Hangs);
        }
        let snapshot = self.snapshot.borrow();
        if snapshot.in_doubt {
            let reason = snapshot.problem.clone().unwrap_or_default();
            return Err(SessionError::Late { path: snapshot.path.clone(), reason });
        }
        Ok(())
    }

    fn send_command(&self, command: Command) -> Result<(), SessionError> {
        self.commands.send(command).map_err(|_| SessionError::Ended)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.commands.send(Command::Close);
        let Some(thread) = self.thread.take() else { return };
        // One that hangs is left behind: with the process it ends anyway, and the board goes off by its dead-man timer.
        while !thread.is_finished() && self.beat.time_since_activity() < self.leaves {
            std::thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() {
            let _ = thread.join();
        } else {
            tracing::error!("{HANGS}; the daemon exits without waiting for the session");
        }
    }
}

//! The session's thread.

use super::policy::{Fit, Needs, Policy};
use super::{Beat, Command, DriveOrder, Driven, SessionError, Snapshot};
use crate::device::client::{Client, LinkError};
use crate::device::clock::ClockSync;
use crate::device::identity::Identity;
use crate::device::target::OpenDevice;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::{CURRENT_VERSION, CreditReply, Details, Fault, MIN_VERSION, Reply, Request};
use era_shared::safety::State;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Between two tries to open a lost port: a replugged board is there after some 300 ms, ...
const REOPEN: Duration = Duration::from_millis(100);
/// ... and one that stays away is looked for less and less often, down to this.
const REOPEN_MOST: Duration = Duration::from_secs(2);
/// Between two looks at a device that arms or discharges: both take some 20 ms.
const TRANSITION: Duration = Duration::from_millis(20);
/// Between two questions whether the self-test has ended.
const ARMING_POLL: Duration = Duration::from_millis(2);
/// Longest burst that is asked for in ms: the longest touch that the daemon takes.
const BURST_MS: u16 = BURST_MAX_MS;
/// Between two samples of the board's clock, as Klipper has it: a second, ...
const CLOCK: Duration = Duration::from_secs(1);
/// ... and 50 ms for the first few.
const QUICK_CLOCK: Duration = Duration::from_millis(50);
/// How many come so quickly.
const QUICK_SAMPLES: u32 = 8;

pub(super) struct Worker {
    pub(super) device: OpenDevice,
    pub(super) client: Option<Client>,
    pub(super) publish: watch::Sender<Snapshot>,
    pub(super) needs: Needs,
    pub(super) policy: Policy,
    beat: Arc<Beat>,
    reopen: Duration,
    /// The board that the session began with.
    pub(super) board_id: Option<[u8; 12]>,
    /// Why a person has to arm it.
    pub(super) away: Option<String>,
    /// Why it cannot drive the scene.
    pub(super) unfit: Option<String>,
    pub(super) stops: Arc<AtomicU64>,
    /// The drive that was set last.
    pub(super) drive_id: u64,
    pub(super) boot_id: Option<u32>,
    pub(super) armed: bool,
    pub(super) drive_until: Option<Instant>,
    pub(super) idle_since: Instant,
    pub(super) last_heard: Instant,
    pub(super) clock: ClockSync,
    next_clock: Instant,
    /// Samples of the clock that still come quickly.
    quick_samples: u32,
    next_status: Instant,
    next_open: Instant,
}

impl Worker {
    pub(super) fn new(
        device: OpenDevice,
        needs: Needs,
        policy: Policy,
        publish: watch::Sender<Snapshot>,
        stops: Arc<AtomicU64>,
        beat: Arc<Beat>,
    ) -> Self {
        let now = Instant::now();
        Self {
            device,
            client: None,
            publish,
            needs,
            policy,
            beat,
            reopen: REOPEN,
            board_id: None,
            away: None,
            unfit: None,
            stops,
            drive_id: 0,
            boot_id: None,
            armed: false,
            drive_until: None,
            idle_since: now,
            last_heard: now,
            clock: ClockSync::new(now),
            next_clock: now,
            quick_samples: QUICK_SAMPLES,
            next_status: now,
            next_open: now,
        }
    }

    pub(super) fn run(mut self, inbox: &Receiver<Command>) {
        loop {
            self.beat.beat();
            self.attend();
            match inbox.recv_timeout(self.until_next_duty()) {
                Ok(Command::Drive { order, answer }) => {
                    let _ = answer.send(self.drive(order));
                }
                Ok(Command::Play { order, answer }) => {
                    let _ = answer.send(self.play(order));
                }
                Ok(Command::Stop { answer }) => {
                    let _ = answer.send(self.stop());
                }
                Ok(Command::EndAt { id, when }) => {
                    if id == self.drive_id {
                        self.drive_until = self.drive_until.map(|until| until.min(when));
                    }
                }
                Ok(Command::HoldUntil { id, until }) => {
                    if id == self.drive_id && self.drive_until.is_some() {
                        (self.drive_until, self.idle_since) = (Some(until), until);
                    }
                }
                Ok(Command::Clear { answer }) => {
                    let _ = answer.send(self.clear());
                }
                Ok(Command::Arm { stops, answer }) => {
                    let _ = answer.send(self.arm_by_hand(stops));
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
        let mut next = self.next_open;
        if self.client.is_some() {
            next = self.next_status.min(self.next_clock).min(self.last_heard + self.device.timing().keep_alive);
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
                self.next_open = Instant::now() + self.reopen;
            }
            return;
        }
        let result = if self.drive_until.is_some_and(|until| now >= until) {
            self.rest()
        } else if self.armed && self.drive_until.is_none() && now >= self.idle_since + self.policy.idle {
            self.ask(&Request::Disarm).map(|_| self.armed = false)
        } else if now >= self.last_heard + self.device.timing().keep_alive {
            // Armed or not: so a board that is gone is seen to be.
            self.keep_alive()
        } else if now >= self.next_status {
            self.look()
        } else if now >= self.next_clock {
            self.sample_clock()
        } else {
            Ok(())
        };
        if let Err(error) = result {
            self.note_trouble(&error);
        }
    }

    fn open(&mut self) {
        let opened = self
            .device
            .revive()
            .map_err(|error| LinkError::Emulator(error.to_string()))
            .and_then(|()| self.device.locate().map_err(|error| LinkError::Io(error.into())))
            .and_then(|()| self.device.client().map_err(|error| LinkError::Io(error.into())))
            .and_then(|client| {
                self.client = Some(client);
                self.greet()
            });
        match opened {
            Ok(()) => {
                tracing::info!(path = self.device.path(), kind = self.device.kind(), "device connected");
                self.reopen = REOPEN;
            }
            Err(error) => {
                self.note_trouble(&error);
                self.reopen = (self.reopen * 2).min(REOPEN_MOST);
            }
        }
    }

    fn greet(&mut self) -> Result<(), LinkError> {
        let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let identity = Identity::from_reply(self.ask(&hello)?).ok_or_else(|| unexpected("hello"))?;
        if self.boot_id != Some(identity.boot_id) {
            self.clock.reset();
        }
        let board = self.board_id.unwrap_or(identity.board_id);
        if board != identity.board_id {
            let [wanted, found] = [board, identity.board_id].map(Identity::hex);
            return Err(LinkError::OtherBoard { wanted, found });
        }
        self.board_id = Some(board);
        self.device.remember();
        let fit = self.needs.fit(&identity);
        let mismatch = match &fit {
            Fit::Good => None,
            Fit::Weaker(text) | Fit::Unfit(text) => Some(text.clone()),
        };
        if let Some(text) = &mismatch
            && self.publish.borrow().mismatch.as_ref() != Some(text)
        {
            tracing::warn!("{text}");
        }
        self.unfit = mismatch.clone().filter(|_| matches!(fit, Fit::Unfit(_)));
        self.boot_id = Some(identity.boot_id);
        self.armed = false;
        self.drive_until = None;
        (self.next_clock, self.quick_samples) = (Instant::now(), QUICK_SAMPLES);
        let protocol = self.client.as_ref().map(Client::version);
        let path = self.device.path().to_owned();
        self.publish.send_modify(|snapshot| {
            (snapshot.identity, snapshot.protocol) = (Some(identity), protocol);
            (snapshot.mismatch, snapshot.path) = (mismatch, path);
            (snapshot.details, snapshot.credit, snapshot.clock) = (None, None, None);
        });
        self.look()
    }

    fn keep_alive(&mut self) -> Result<(), LinkError> {
        let Reply::Alive { state } = self.ask(&Request::KeepAlive)? else { return Err(unexpected("keep-alive")) };
        if self.armed && !state.is_live() {
            self.armed = false;
            self.drive_until = None;
            return self.look();
        }
        Ok(())
    }

    /// Whether the device speaks version 2 or later.
    pub(super) fn is_modern(&self) -> bool {
        self.speaks(2)
    }

    fn speaks(&self, version: u8) -> bool {
        self.client.as_ref().is_some_and(|client| client.version() >= version)
    }

    /// Asks for the board's time, quickly at first and then now and then.
    pub(super) fn sample_clock(&mut self) -> Result<(), LinkError> {
        self.quick_samples = self.quick_samples.saturating_sub(1);
        self.next_clock = Instant::now() + if self.quick_samples > 0 { QUICK_CLOCK } else { CLOCK };
        if !self.is_modern() {
            return Ok(());
        }
        let Reply::Clock { now_us } = self.ask(&Request::Clock)? else { return Err(unexpected("clock")) };
        let times = self.client.as_ref().and_then(|client| client.last_frame_written().zip(client.last_reply_read()));
        if let Some((sent, received)) = times {
            self.clock.sample(sent, received, now_us);
        }
        let quality = self.clock.quality();
        self.publish.send_modify(|snapshot| snapshot.clock = quality);
        Ok(())
    }

    pub(super) fn details(&mut self) -> Result<Details, LinkError> {
        let Reply::Details(details) = self.ask(&Request::Details)? else { return Err(unexpected("details")) };
        Ok(details)
    }

    fn credit(&mut self) -> Result<CreditReply, LinkError> {
        let Reply::Credit(credit) = self.ask(&Request::Credit)? else { return Err(unexpected("credit")) };
        Ok(credit)
    }

    pub(super) fn look(&mut self) -> Result<(), LinkError> {
        self.next_status = Instant::now() + self.device.timing().status;
        let Reply::Status(status) = self.ask(&Request::Status)? else { return Err(unexpected("status")) };
        let Reply::Telemetry(telemetry) = self.ask(&Request::Telemetry)? else { return Err(unexpected("telemetry")) };
        let details = if self.is_modern() { Some(self.details()?) } else { None };
        if matches!(status.state, State::Arming | State::Discharging) {
            // It is about to change.
            self.next_status = Instant::now() + self.device.timing().status.min(TRANSITION);
        }
        let credit = if self.speaks(Request::Credit.since()) { Some(self.credit()?) } else { None };
        let restarted = self.boot_id.is_some_and(|known| known != status.boot_id);
        let known = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        let is_new = |fault: &Fault| known.is_none_or(|k| (k.code, k.count) != (fault.code, fault.count));
        let faulted = status.fault.filter(is_new);
        if let Some(fault) = faulted {
            self.report(&fault);
        }
        if !status.state.is_live() {
            self.armed = false;
            self.drive_until = None;
        }
        let of_link = |client: &Client| (client.round_trip_median(), client.round_trip_worst(), client.statistics());
        let (round_trip, worst, link) = self.client.as_ref().map(of_link).unwrap_or_default();
        self.publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (true, false);
            snapshot.problem = None;
            snapshot.status = Some(status);
            snapshot.telemetry = Some(telemetry);
            snapshot.details = details;
            snapshot.credit = credit;
            (snapshot.round_trip, snapshot.round_trip_worst) = (round_trip, worst);
            snapshot.link = link;
            snapshot.restarts += u32::from(restarted);
            snapshot.faults += u32::from(faulted.is_some());
        });
        if restarted {
            tracing::warn!("the device has restarted");
            self.was_away("it had restarted");
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
        let DriveOrder { id, stops, drives, hold, from_zero } = order;
        if stops != self.stops.load(Ordering::SeqCst) {
            return Err(SessionError::Stopped);
        }
        self.connected()?;
        if from_zero && self.armed {
            self.ask(&Request::Disarm)?;
            self.armed = false;
            self.drive_until = None;
        }
        self.check_fit()?;
        let fresh = self.arm()?;
        let drives: heapless::Vec<_, _> = drives.into_iter().take(era_shared::MAX_CHANNELS).collect();
        let state = if drives.is_empty() { State::Armed } else { State::Running };
        let Reply::DrivesSet { achieved } = self.ask(&Request::SetDrives { drives })? else {
            return Err(unexpected("set-drives").into());
        };
        let frame_written = self.client.as_ref().and_then(Client::last_frame_written);
        if fresh {
            // The device holds the drives until its self-test has passed; what is acknowledged is driven, and what is refused
            // is not, later than that either.
            if let Err(error) = self.await_armed(stops) {
                self.take_back();
                return Err(error);
            }
        }
        let now = Instant::now();
        self.drive_id = id;
        self.drive_until = Some(now + hold);
        self.idle_since = now + hold;
        self.show(state);
        Ok(Driven { achieved: achieved.to_vec(), frame_written })
    }

    /// The acknowledgement tells the state; who asks right after its answer must not read an older one. The rest of the
    /// status follows at once.
    pub(super) fn show(&mut self, state: State) {
        self.publish.send_modify(|snapshot| {
            if let Some(status) = &mut snapshot.status {
                status.state = state;
            }
        });
        self.next_status = Instant::now();
    }

    /// Arms, unless that has been done; says whether it has only begun to.
    pub(super) fn arm(&mut self) -> Result<bool, SessionError> {
        if self.armed {
            return Ok(false);
        }
        self.clear_silence()?;
        self.check_fault()?;
        let arm = match self.is_modern() {
            // A touch may be held for longer than the board's default burst.
            true => Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MS) },
            false => Request::Arm { deadman_ms: None },
        };
        self.ask(&arm)?;
        self.armed = true;
        Ok(true)
    }

    /// Waits until the self-test has ended.
    pub(super) fn await_armed(&mut self, stops: u64) -> Result<(), SessionError> {
        let begun = Instant::now();
        loop {
            if stops != self.stops.load(Ordering::SeqCst) {
                return Err(SessionError::Stopped);
            }
            let Reply::Alive { state } = self.ask(&Request::KeepAlive)? else {
                return Err(unexpected("keep-alive").into());
            };
            if matches!(state, State::Armed | State::Running) {
                return Ok(());
            }
            if state != State::Arming || begun.elapsed() > self.device.timing().arming {
                self.look()?;
                self.check_fault()?;
                return Err(SessionError::NotArmed { waited: begun.elapsed(), state: state.name() });
            }
            std::thread::sleep(ARMING_POLL);
        }
    }

    pub(super) fn rest(&mut self) -> Result<(), LinkError> {
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

    pub(super) fn connected(&self) -> Result<(), SessionError> {
        if self.client.is_some() {
            return Ok(());
        }
        let reason = self.publish.borrow().problem.clone().unwrap_or_else(|| "it has not answered yet".into());
        Err(SessionError::Disconnected { path: self.device.path().to_owned(), reason })
    }

    /// Asks the device. While its answer is late that is told; the answer is waited for, so that a computer that is busy for a
    /// moment does not lose its board for it.
    pub(super) fn ask(&mut self, request: &Request) -> Result<Reply, LinkError> {
        let client = self.client.as_mut().ok_or_else(|| std::io::Error::from(std::io::ErrorKind::NotConnected))?;
        let publish = &self.publish;
        let reply = client.request_told(request, &mut |request, waited| Self::doubt(publish, request, waited))?;
        let now = Instant::now();
        let gap = now - self.last_heard;
        self.last_heard = now;
        if self.publish.borrow().in_doubt {
            tracing::warn!(silent_ms = gap.as_secs_f64() * 1e3, "the device answers again");
            self.publish.send_modify(|snapshot| {
                (snapshot.connected, snapshot.in_doubt) = (true, false);
                snapshot.problem = None;
            });
        }
        if self.armed && gap > self.publish.borrow().longest_gap {
            self.publish.send_modify(|snapshot| snapshot.longest_gap = gap);
        }
        Ok(reply)
    }

    /// A refusal leaves the link as it is, after a look at the device's state; anything else closes it, to be opened anew.
    pub(super) fn note_trouble(&mut self, error: &LinkError) {
        if matches!(error, LinkError::Refused(_) | LinkError::TooOld { .. }) {
            self.next_status = Instant::now();
            tracing::warn!(%error, "refused");
            return;
        }
        let text = self.device.trouble(error);
        if self.publish.borrow().problem.as_deref() != Some(&text) {
            tracing::error!(path = self.device.path(), error = text, "device lost");
        }
        self.client = None;
        self.armed = false;
        self.drive_until = None;
        self.next_open = Instant::now() + REOPEN;
        self.was_away(&text);
        self.publish.send_modify(|snapshot| {
            snapshot.outages += u32::from(snapshot.connected || snapshot.in_doubt);
            (snapshot.connected, snapshot.in_doubt) = (false, false);
            snapshot.problem = Some(text);
        });
    }
}

impl Drop for Worker {
    /// However the thread ends, nobody takes its device for connected.
    fn drop(&mut self) {
        self.publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (false, false);
            snapshot.problem = Some(super::ENDED.into());
        });
    }
}

pub(super) fn unexpected(request: &'static str) -> LinkError {
    LinkError::Unexpected { request, reply: "another kind of answer".into() }
}

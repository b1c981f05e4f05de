//! The session's thread.

use super::policy::{SceneNeeds, SessionPolicy};
use super::snapshot_part::SnapshotPart;
use super::{ActivityClock, Command, DeviceSnapshot, DriveContent, DriveOrder, DriveResult, SessionError};
use crate::device::client::{Client, LinkError, LinkStatistics, WaitHooks, request_name};
use crate::device::clock::ClockSync;
use crate::device::pause_detector::PauseDetector;
use crate::device::port::PortError;
use crate::device::target::OpenDevice;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::{ChannelDrive, Reply, Request, WindowSequence};
use era_shared::safety::SafetyState;
use std::cell::Cell;
use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Samples of the board's clock that come quickly after it has been connected.
pub(super) const QUICK_SAMPLES: u32 = 8;
/// Between two tries to open a lost port: a replugged board is there after some 300 ms, ...
const REOPEN: Duration = Duration::from_millis(100);
/// ... and one that stays away is looked for less and less often, down to this.
const REOPEN_MOST: Duration = Duration::from_secs(2);
/// Between two questions whether the self-test has ended.
const ARMING_POLL: Duration = Duration::from_millis(2);
/// From a look at the state until another one because of a drive. A look is four requests: after each of a thousand drives a second they
/// would take four fifths of the link.
const LOOK_FOR_DRIVE: Duration = Duration::from_millis(20);
/// Beside what a request may take, longest time that the thread does nothing while its process runs.
const AWAKE: Duration = Duration::from_secs(1);
/// Longest burst that is asked for in ms: the longest touch that the daemon takes.
const BURST_MS: u16 = BURST_MAX_MS;
pub(super) struct SessionWorker {
    pub(super) device: OpenDevice,
    pub(super) client: Option<Client>,
    pub(super) publish: watch::Sender<DeviceSnapshot>,
    pub(super) needs: SceneNeeds,
    pub(super) policy: SessionPolicy,
    beat: Arc<ActivityClock>,
    heard: Arc<ActivityClock>,
    /// Longest time without an answer since the device was last looked at.
    pub(super) silence: Duration,
    /// Of links that were given up.
    past: LinkStatistics,
    reopen: Duration,
    /// The board that the session began with.
    pub(super) board_id: Option<[u8; 12]>,
    /// Why a person has to arm it.
    pub(super) away: Option<String>,
    /// Why it cannot drive the scene.
    pub(super) unfit: Option<String>,
    pub(super) stops: Arc<AtomicU64>,
    /// Those of them that the device has obeyed.
    pub(super) obeyed: u64,
    /// Since when it answers again after it was in doubt or away: what was asked for before that comes too late.
    pub(super) again_since: Option<Instant>,
    /// The drive that was set last.
    pub(super) drive_id: u64,
    /// Number of the effect that was played last.
    pub(super) play_number: u32,
    pub(super) boot_id: Option<u32>,
    pub(super) armed: bool,
    pub(super) drive_until: Option<Instant>,
    pub(super) idle_since: Instant,
    pub(super) last_heard: Instant,
    pub(super) clock: ClockSync,
    pub(super) next_clock: Instant,
    /// Samples of the clock that still come quickly.
    pub(super) quick_samples: u32,
    pub(super) next_status: Instant,
    /// When the state was last looked at.
    pub(super) last_look: Instant,
    /// What is asked for next in a look that is under way.
    pub(super) look_next: Option<SnapshotPart>,
    /// Whether the state has been looked at since the last stop.
    pub(super) stop_is_seen: bool,
    next_open: Instant,
    pub(super) awake: PauseDetector,
}

impl SessionWorker {
    pub(super) fn new(
        device: OpenDevice,
        needs: SceneNeeds,
        policy: SessionPolicy,
        publish: watch::Sender<DeviceSnapshot>,
        stops: Arc<AtomicU64>,
        [beat, heard]: [Arc<ActivityClock>; 2],
    ) -> Self {
        let now = Instant::now();
        // It asks before and after every request.
        let longest = device.timing().retry_policy.longest_total_wait().saturating_mul(2).saturating_add(AWAKE);
        Self {
            device,
            client: None,
            publish,
            needs,
            policy,
            beat,
            heard,
            silence: Duration::ZERO,
            past: LinkStatistics::default(),
            reopen: REOPEN,
            board_id: None,
            away: None,
            unfit: None,
            stops,
            obeyed: 0,
            again_since: None,
            drive_id: 0,
            // Not that of a daemon before this one, whose numbers a board may still remember.
            play_number: u32::try_from(RandomState::new().hash_one(()) >> 32).unwrap_or_default(),
            boot_id: None,
            armed: false,
            drive_until: None,
            idle_since: now,
            last_heard: now,
            clock: ClockSync::new(now),
            next_clock: now,
            quick_samples: QUICK_SAMPLES,
            next_status: now,
            last_look: now,
            look_next: None,
            stop_is_seen: true,
            next_open: now,
            awake: PauseDetector::new(longest),
        }
    }

    pub(super) fn run_until_closed(mut self, inbox: &Receiver<Command>) {
        loop {
            self.beat.note_activity();
            self.stop_board_once_and_await_reply_if_any_stop_requested();
            self.carry_out_one_due_task();
            let command = inbox.recv_timeout(self.time_until_next_due_task());
            // A stop goes before whatever came before it, and so does what has happened meanwhile.
            self.stop_board_once_and_await_reply_if_any_stop_requested();
            self.stop_board_and_refuse_earlier_orders_if_slept_or_suspended();
            match command {
                Ok(Command::Drive { order, asked, answer }) => {
                    let result = self
                        .refuse_order_too_old_or_from_before_device_was_back(asked)
                        .and_then(|()| self.begin_drive_handling_link_errors(order));
                    let _ =
                        answer.send(result.map_err(|error| self.convert_error_of_halted_device_to_late_answer(error)));
                }
                Ok(Command::Stop { number, answer }) => {
                    let _ = answer.send(self.stop_unless_obeyed_and_refresh_state(number));
                }
                Ok(Command::EndAt { id, when }) => {
                    if id == self.drive_id {
                        self.drive_until = self.drive_until.map(|until| until.min(when));
                    }
                }
                Ok(Command::MoveEndTo { id, until }) => {
                    if id == self.drive_id && self.drive_until.is_some() {
                        (self.drive_until, self.idle_since) = (Some(until), until);
                    }
                }
                Ok(Command::Clear { answer }) => {
                    let _ = answer.send(self.clear_latched_fault_and_invalidate_earlier_orders());
                }
                Ok(Command::Arm { stops, asked, answer }) => {
                    let result = self
                        .refuse_order_too_old_or_from_before_device_was_back(asked)
                        .and_then(|()| self.arm_and_precharge_on_person_request_even_after_outage(stops));
                    let _ =
                        answer.send(result.map_err(|error| self.convert_error_of_halted_device_to_late_answer(error)));
                }
                Ok(Command::Close) | Err(RecvTimeoutError::Disconnected) => {
                    if self.client.is_some()
                        && let Err(error) = self.stop_unless_obeyed_and_refresh_state(u64::MAX)
                    {
                        tracing::warn!(
                            %error,
                            "could not stop the device at the end of the session; the device's dead-man timer switches its \
                             high voltage off"
                        );
                    }
                    return;
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn time_until_next_due_task(&self) -> Duration {
        if self.look_next.is_some() {
            return Duration::ZERO;
        }
        let mut next = self.next_open;
        if self.client.is_some() {
            next = self.next_status.min(self.next_clock).min(self.last_heard + self.device.timing().keep_alive);
        }
        if let Some(until) = self.drive_until {
            next = next.min(until);
        }
        next.saturating_duration_since(Instant::now())
    }

    /// Does one of the things that are due by now: open the port, send a sign of life, end a drive, refresh the state.
    fn carry_out_one_due_task(&mut self) {
        let now = Instant::now();
        if self.client.is_none() {
            if now >= self.next_open {
                self.try_to_connect_device();
                self.next_open = Instant::now() + self.reopen;
            }
            return;
        }
        let result = if self.drive_until.is_some_and(|until| now >= until) {
            self.end_drives()
        } else if self.armed && self.drive_until.is_none() && now >= self.idle_since + self.policy.idle {
            self.request_from_device_or_stop_it_instead(&Request::Disarm).map(|_| self.armed = false)
        } else if now >= self.last_heard + self.device.timing().keep_alive {
            // Armed or not: so a board that is gone is seen to be.
            self.send_keep_alive_and_stop_or_refresh_if_state_contradicts_armed()
        } else if self.look_next.is_some() || now >= self.next_status {
            self.refresh_next_snapshot_part_and_notify_after_last()
        } else if now >= self.next_clock {
            self.request_clock_sample_and_publish_quality_if_supported()
        } else {
            Ok(())
        };
        if let Err(error) = result {
            self.handle_link_error_closing_link_unless_refused_or_halted(&error);
        }
    }

    fn try_to_connect_device(&mut self) {
        // On coming in, whatever is live is stopped anyway.
        self.obeyed = self.stops.load(Ordering::SeqCst);
        let opened = self
            .device
            .restart_emulator_if_ended()
            .map_err(|error| LinkError::Emulator(error.to_string()))
            .and_then(|()| Ok(self.device.update_port_path_from_usb()?))
            .and_then(|()| Ok(self.device.open_client()?))
            .and_then(|client| {
                self.client = Some(client);
                self.exchange_hello_check_same_board_and_refresh_snapshot()
            });
        match opened {
            Ok(()) => {
                tracing::info!(path = self.device.port_path(), kind = self.device.kind(), "device connected");
                self.reopen = REOPEN;
            }
            Err(error) => {
                self.handle_link_error_closing_link_unless_refused_or_halted(&error);
                // A hello that a stop came between is begun anew.
                self.take_client_adding_its_statistics();
                self.reopen = (self.reopen * 2).min(REOPEN_MOST);
            }
        }
    }

    fn begin_drive_handling_link_errors(&mut self, order: DriveOrder) -> Result<DriveResult, SessionError> {
        let DriveOrder { id, asked_at, start, content } = order;
        let stops = asked_at.stops;
        let result = match content {
            DriveContent::Steady { drives, hold, from_zero } => self
                .check_connected_and_not_stopped_or_interrupted_since(asked_at)
                .and_then(|()| self.arm_if_needed_and_set_drives(id, stops, drives, (hold, from_zero))),
            DriveContent::Envelopes { drives, effects } => {
                self.schedule_effect_retrying_if_start_passed(id, asked_at, start, |worker, start| {
                    worker.arm_if_needed_await_rails_and_schedule_envelopes(
                        id,
                        stops,
                        (drives.clone(), effects.clone()),
                        start,
                    )
                })
            }
            DriveContent::Windows(sequence) => {
                self.schedule_effect_retrying_if_start_passed(id, asked_at, start, |worker, start| {
                    worker.arm_if_needed_and_play_windows(id, stops, WindowSequence::clone(&sequence), start)
                })
            }
        };
        if let Err(SessionError::Link(error)) = &result {
            self.handle_link_error_closing_link_unless_refused_or_halted(error);
        }
        result
    }

    fn arm_if_needed_and_set_drives(
        &mut self,
        id: u64,
        stop_count: u64,
        drives: Vec<ChannelDrive>,
        (hold, disarm_first): (Duration, bool),
    ) -> Result<DriveResult, SessionError> {
        if disarm_first && self.armed {
            self.request_from_device_or_stop_it_instead(&Request::Disarm)?;
            self.armed = false;
            self.drive_until = None;
        }
        self.check_board_fits_and_needs_no_manual_arming()?;
        let fresh = self.begin_arming_if_needed_and_is_self_test_pending()?;
        let drives: heapless::Vec<_, _> = drives.into_iter().take(era_shared::MAX_CHANNELS).collect();
        let state = if drives.is_empty() { SafetyState::Armed } else { SafetyState::Running };
        let Reply::DrivesSet { achieved } =
            self.request_from_device_or_stop_it_instead(&Request::SetDrives { drives })?
        else {
            return Err(unexpected_reply_error("set-drives").into());
        };
        if fresh {
            // The device holds the drives until its self-test has passed; what is acknowledged is driven, and what is refused
            // is not, later than that either.
            self.await_armed_or_stop_board(stop_count)?;
        }
        let now = Instant::now();
        self.drive_id = id;
        // Nothing is driven without drives: the rails go down when the board has been idle for long enough.
        (self.drive_until, self.idle_since) =
            if state == SafetyState::Armed { (None, now) } else { (Some(now + hold), now + hold) };
        self.publish_acknowledged_state(state);
        Ok(DriveResult { achieved: achieved.to_vec(), effect: None })
    }

    /// Publishes the state that an acknowledgement implies, so that whoever asks right after it does not read an older one. The rest of the
    /// status follows soon.
    pub(super) fn publish_acknowledged_state(&mut self, state: SafetyState) {
        self.publish.send_modify(|snapshot| {
            if let Some(status) = &mut snapshot.status {
                status.state = state;
            }
        });
        self.next_status = self.next_status.min(self.last_look + LOOK_FOR_DRIVE);
    }

    /// Begins to arm, unless the device is armed; returns whether the self-test has still to end.
    pub(super) fn begin_arming_if_needed_and_is_self_test_pending(&mut self) -> Result<bool, SessionError> {
        if self.armed {
            return Ok(false);
        }
        self.clear_host_silence_fault_if_policy_allows()?;
        self.check_no_fault_latched_in_snapshot()?;
        let arm = match self.speaks_version_2_or_later() {
            // A touch may be held for longer than the board's default burst.
            true => Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MS) },
            false => Request::Arm { deadman_ms: None },
        };
        self.request_from_device_or_stop_it_instead(&arm)?;
        self.armed = true;
        self.publish_acknowledged_state(SafetyState::Arming);
        Ok(true)
    }

    /// Waits until the self-test has ended. A device whose self-test does not end in time is not left to get through it later.
    pub(super) fn await_armed_or_stop_board(&mut self, stop_count: u64) -> Result<(), SessionError> {
        let ended = self.poll_until_armed(stop_count);
        // Else it has been stopped, or is off.
        if ended.is_err() && self.armed {
            self.stop_board_and_refresh_snapshot();
        }
        ended
    }

    fn poll_until_armed(&mut self, stop_count: u64) -> Result<(), SessionError> {
        let begun = Instant::now();
        loop {
            if stop_count != self.stops.load(Ordering::SeqCst) {
                return Err(SessionError::Stopped);
            }
            let Reply::Alive { state } = self.request_from_device_or_stop_it_instead(&Request::KeepAlive)? else {
                return Err(unexpected_reply_error("keep-alive").into());
            };
            if matches!(state, SafetyState::Armed | SafetyState::Running) {
                self.publish_acknowledged_state(state);
                return Ok(());
            }
            if state != SafetyState::Arming || begun.elapsed() > self.device.timing().arming {
                self.refresh_all_parts_of_snapshot()?;
                self.check_no_fault_latched_in_snapshot()?;
                return Err(SessionError::NotArmed { waited: begun.elapsed(), state: state.name() });
            }
            std::thread::sleep(ARMING_POLL);
        }
    }

    pub(super) fn end_drives(&mut self) -> Result<(), LinkError> {
        self.drive_until = None;
        self.idle_since = Instant::now();
        self.request_from_device_or_stop_it_instead(&Request::SetDrives { drives: heapless::Vec::new() })?;
        // Soon, as the state has changed; a drive that comes now goes first.
        self.look_next = Some(SnapshotPart::Status);
        Ok(())
    }

    fn clear_latched_fault_and_invalidate_earlier_orders(&mut self) -> Result<(), SessionError> {
        self.check_connected()?;
        self.clear_latched_fault_or_refuse_other_code(None)?;
        // Before a fault that came and went unseen.
        self.invalidate_earlier_orders();
        Ok(self.refresh_all_parts_of_snapshot()?)
    }

    pub(super) fn check_connected(&self) -> Result<(), SessionError> {
        if self.client.is_some() {
            return Ok(());
        }
        let reason = self.publish.borrow().problem.clone().unwrap_or_else(|| "the device has not answered yet".into());
        Err(SessionError::Disconnected { path: self.device.port_path().to_owned(), reason })
    }

    /// Sends a request to the device and returns its reply. A late answer is published as a doubt and still waited for, so that a computer
    /// that is busy for a moment does not lose its board.
    pub(super) fn request_from_device_or_stop_it_instead(&mut self, request: &Request) -> Result<Reply, LinkError> {
        self.beat.note_activity();
        if !matches!(request, Request::Stop)
            && let Some(waited) = self.stop_refuse_earlier_orders_and_get_pause_if_slept_or_suspended()
        {
            return Err(LinkError::Halted { request: request_name(request), waited, by_order: false });
        }
        if !matches!(request, Request::Stop) && self.stops.load(Ordering::SeqCst) != self.obeyed {
            // Between any two requests a stop goes first.
            let begun = Instant::now();
            self.stop_board_and_await_reply()?;
            return Err(LinkError::Halted { request: request_name(request), waited: begun.elapsed(), by_order: true });
        }
        let client = self.client.as_mut().ok_or_else(|| std::io::Error::from(std::io::ErrorKind::NotConnected))?;
        let (publish, stops, obeyed, was_armed) = (&self.publish, &self.stops, self.obeyed, self.armed);
        let seen = Cell::new(stops.load(Ordering::SeqCst));
        let is_stopped = || {
            seen.set(stops.load(Ordering::SeqCst));
            seen.get() != obeyed
        };
        let mut in_doubt =
            |request, waited| Self::publish_that_device_may_be_gone_if_connected(publish, request, waited);
        let reply = client.request_sending_stop_when_ordered_or_late(
            request,
            WaitHooks { in_doubt: &mut in_doubt, is_stopped: &is_stopped },
        );
        if let Err(LinkError::Halted { by_order, .. }) = &reply {
            self.obeyed = if *by_order { seen.get() } else { self.obeyed };
            self.mark_disarmed_and_schedule_status_request_after_stop();
            self.invalidate_earlier_orders();
        } else if let Err(error) = reply {
            return Err(error);
        }
        let now = Instant::now();
        let gap = now - self.last_heard;
        self.last_heard = now;
        self.heard.note_activity();
        self.silence = self.silence.max(gap);
        let (in_doubt, is_back) = {
            let snapshot = self.publish.borrow();
            (snapshot.in_doubt, !snapshot.connected && (snapshot.in_doubt || snapshot.outages > 0))
        };
        if is_back {
            // Before that is told: what is asked for by whoever has seen it is in time.
            self.again_since = self.again_since.max(Some(now));
        }
        if in_doubt {
            tracing::warn!(silent_ms = gap.as_secs_f64() * 1e3, "the device answers again");
            self.publish.send_modify(|snapshot| {
                (snapshot.connected, snapshot.in_doubt) = (true, false);
                snapshot.problem = None;
            });
        }
        if was_armed && gap > self.publish.borrow().longest_gap {
            self.publish.send_modify(|snapshot| snapshot.longest_gap = gap);
        }
        reply
    }

    /// Acts on an error of the link. After a refusal the link stays open and the state is refreshed soon; any other error closes the link, which is
    /// opened again later.
    pub(super) fn handle_link_error_closing_link_unless_refused_or_halted(&mut self, error: &LinkError) {
        if matches!(error, LinkError::Refused(_) | LinkError::TooOld { .. }) {
            self.next_status = Instant::now();
            tracing::warn!(%error, "the device refused a request");
            return;
        }
        match error {
            // As somebody wanted.
            LinkError::Halted { by_order: true, .. } => {
                tracing::info!(%error, "a request ended early, because a stop was ordered");
                return;
            }
            LinkError::Halted { .. } => {
                tracing::warn!(%error, "a request ended because the daemon stopped the device");
                return;
            }
            _ => {}
        }
        // Before anything that takes time, as a look at all programs does: the board may be live.
        if let Some(mut client) = self.take_client_adding_its_statistics() {
            client.send_stop_without_reply();
        }
        let mut text = self.device.describe_link_error_for_emulator_or_name_programs_on_port(error);
        if matches!(error, LinkError::Port(PortError::Busy { .. })) {
            text += ". The daemon tries again until the port is free";
        }
        if self.publish.borrow().problem.as_deref() != Some(&text) {
            tracing::error!(path = self.device.port_path(), error = text, "the connection to the device is lost");
        }
        let link = self.total_link_statistics();
        self.armed = false;
        self.drive_until = None;
        self.next_open = Instant::now() + REOPEN;
        self.require_manual_arming_if_policy(&text);
        self.invalidate_earlier_orders();
        self.publish.send_modify(|snapshot| {
            snapshot.outages += u32::from(snapshot.connected || snapshot.in_doubt);
            (snapshot.connected, snapshot.in_doubt) = (false, false);
            snapshot.problem = Some(text);
            snapshot.link = link;
        });
    }

    /// Closes the link, and adds its statistics to those of earlier links.
    fn take_client_adding_its_statistics(&mut self) -> Option<Client> {
        let client = self.client.take();
        self.look_next = None;
        self.past += client.as_ref().map(Client::link_statistics).unwrap_or_default();
        client
    }

    /// Statistics of all links of this session, the present one included.
    pub(super) fn total_link_statistics(&self) -> LinkStatistics {
        let mut all = self.past;
        all += self.client.as_ref().map(Client::link_statistics).unwrap_or_default();
        all
    }
}

impl Drop for SessionWorker {
    /// However the thread ends, nobody takes its device for connected.
    fn drop(&mut self) {
        self.publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (false, false);
            snapshot.problem = Some(super::ENDED.into());
        });
    }
}

pub(super) fn unexpected_reply_error(request: &'static str) -> LinkError {
    LinkError::Unexpected { request, reply: "a reply of another type".into() }
}

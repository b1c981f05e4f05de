//! Who the device is and how it is: its hello, its state, its clock, its signs of life.

use super::Snapshot;
use super::part::Part;
use super::policy::Fit;
use super::worker::{QUICK_SAMPLES, Worker, unexpected};
use crate::device::client::{Client, LinkError};
use crate::device::identity::Identity;
use crate::device::round_trips::RoundTrips;
use era_shared::protocol::{CURRENT_VERSION, CreditReply, Details, Fault, MIN_VERSION, Reply, Request, TelemetryReply};
use era_shared::safety::State;
use std::time::{Duration, Instant};

/// Between two looks at a device that arms or discharges: both take some 20 ms.
const TRANSITION: Duration = Duration::from_millis(20);
/// Between two samples of the board's clock, as Klipper has it: a second, ...
const CLOCK: Duration = Duration::from_secs(1);
/// ... and 50 ms for the first few ([`QUICK_SAMPLES`]).
const QUICK_CLOCK: Duration = Duration::from_millis(50);

impl Worker {
    pub(super) fn greet(&mut self) -> Result<(), LinkError> {
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

    pub(super) fn keep_alive(&mut self) -> Result<(), LinkError> {
        let Reply::Alive { state } = self.ask(&Request::KeepAlive)? else { return Err(unexpected("keep-alive")) };
        if self.armed && !state.is_live() {
            return self.look();
        }
        if self.is_live_unasked(state) {
            self.halt()?;
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

    fn telemetry(&mut self) -> Result<TelemetryReply, LinkError> {
        let Reply::Telemetry(telemetry) = self.ask(&Request::Telemetry)? else { return Err(unexpected("telemetry")) };
        Ok(telemetry)
    }

    fn details_if_told(&mut self) -> Result<Option<Details>, LinkError> {
        if self.is_modern() { self.details().map(Some) } else { Ok(None) }
    }

    pub(super) fn details(&mut self) -> Result<Details, LinkError> {
        let Reply::Details(details) = self.ask(&Request::Details)? else { return Err(unexpected("details")) };
        Ok(details)
    }

    fn credit(&mut self) -> Result<CreditReply, LinkError> {
        let Reply::Credit(credit) = self.ask(&Request::Credit)? else { return Err(unexpected("credit")) };
        Ok(credit)
    }

    /// All parts of a look, at once. One that is under way is begun anew: what it has seen may have changed.
    pub(super) fn look(&mut self) -> Result<(), LinkError> {
        self.look_next = Some(Part::Status);
        while self.look_next.is_some() {
            self.look_on()?;
        }
        Ok(())
    }

    /// The next part of a look, one request, so that a drive that comes meanwhile waits for one answer and not for four. What is seen is
    /// published part by part: a drive in between is never hidden by a state of before.
    pub(super) fn look_on(&mut self) -> Result<(), LinkError> {
        self.look_next = match self.look_next.take().unwrap_or(Part::Status) {
            Part::Status => {
                let seen = self.look_at_status()?;
                if seen.restarted {
                    return self.greet();
                }
                // What has been measured with it is not asked for again.
                if seen.measured { self.after_details() } else { Some(Part::Telemetry) }
            }
            Part::Telemetry => {
                let seen = self.telemetry()?;
                self.keep(|snapshot| snapshot.telemetry = Some(seen));
                self.is_modern().then_some(Part::Details)
            }
            Part::Details => {
                let seen = self.details()?;
                self.keep(|snapshot| snapshot.details = Some(seen));
                self.after_details()
            }
            Part::Credit => {
                let seen = self.credit()?;
                self.keep(|snapshot| snapshot.credit = Some(seen));
                None
            }
        };
        if self.look_next.is_none() {
            let (round_trips, link) = (self.round_trips(), self.link());
            self.publish.send_modify(|snapshot| {
                (snapshot.connected, snapshot.in_doubt) = (true, false);
                snapshot.problem = None;
                (snapshot.round_trips, snapshot.link) = (round_trips, link);
            });
        }
        Ok(())
    }

    fn after_details(&self) -> Option<Part> {
        self.speaks(Request::Credit.since()).then_some(Part::Credit)
    }

    /// What is told at the look's end.
    fn keep(&self, change: impl FnOnce(&mut Snapshot)) {
        self.publish.send_if_modified(|snapshot| {
            change(snapshot);
            false
        });
    }

    fn round_trips(&self) -> RoundTrips {
        self.client.as_ref().map(Client::round_trips).unwrap_or_default()
    }

    /// Its state, and what follows from it. Told at once if it is another one, or at the look's end.
    fn look_at_status(&mut self) -> Result<Seen, LinkError> {
        self.last_look = Instant::now();
        self.next_status = self.last_look + self.device.timing().status;
        let Reply::Status(status) = self.ask(&Request::Status)? else { return Err(unexpected("status")) };
        self.stop_is_seen = true;
        if self.is_live_unasked(status.state) {
            // Before anything else is asked; what it comes to is looked at soon.
            self.halt()?;
            self.next_status = Instant::now();
        } else if matches!(status.state, State::Arming | State::Discharging) {
            // It is about to change.
            self.next_status = Instant::now() + self.device.timing().status.min(TRANSITION);
        }
        // That it is safe says that its rails have been measured down: told with what was measured, and not beside what was before.
        let is_down = status.state == State::Safe && self.publish.borrow().state() != Some(State::Safe);
        let measured = if is_down { Some((self.telemetry()?, self.details_if_told()?)) } else { None };
        let restarted = self.boot_id.is_some_and(|known| known != status.boot_id);
        let known = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        let is_new = |fault: &Fault| known.is_none_or(|k| (k.code, k.count) != (fault.code, fault.count));
        let faulted = status.fault.filter(is_new);
        let at_fault = faulted.map(|fault| self.report(&fault, self.round_trips(), self.link()));
        self.silence = Duration::ZERO;
        let has_fault = status.fault.is_some();
        let has_broken = faulted.is_some() || restarted || (self.armed && !status.state.is_live());
        if !status.state.is_live() {
            self.armed = false;
            self.drive_until = None;
        }
        self.publish.send_if_modified(|snapshot| {
            let is_other = snapshot.state() != Some(status.state) || known != status.fault || has_broken;
            snapshot.status = Some(status);
            if let Some((telemetry, details)) = measured {
                (snapshot.telemetry, snapshot.details) = (Some(telemetry), details);
            }
            snapshot.link_at_fault = at_fault.or(snapshot.link_at_fault).filter(|_| has_fault);
            snapshot.restarts += u32::from(restarted);
            snapshot.faults += u32::from(faulted.is_some());
            snapshot.breaks += u64::from(has_broken);
            is_other
        });
        if restarted {
            tracing::warn!("the device has restarted");
            self.was_away("it had restarted");
        }
        Ok(Seen { restarted, measured: is_down })
    }
}

/// What comes of a look at the state.
struct Seen {
    /// Whether the device has restarted.
    restarted: bool,
    /// Whether its measurements have been asked for with it.
    measured: bool,
}

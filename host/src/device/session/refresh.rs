//! Who the device is and how it is: its hello, its state, its clock, its signs of life.

use super::DeviceSnapshot;
use super::policy::BoardFit;
use super::snapshot_part::SnapshotPart;
use super::worker::{QUICK_SAMPLES, SessionWorker, unexpected_reply_error};
use crate::device::client::{Client, LinkError};
use crate::device::identity::DeviceIdentity;
use crate::device::round_trips::RoundTripSummary;
use era_shared::protocol::{
    CURRENT_VERSION, CreditReply, DetailsReply, Fault, MIN_VERSION, Reply, Request, TelemetryReply,
};
use era_shared::safety::SafetyState;
use std::time::{Duration, Instant};

/// Between two looks at a device that arms or discharges: both take some 20 ms.
const TRANSITION: Duration = Duration::from_millis(20);
/// Between two samples of the board's clock, as Klipper has it: a second, ...
const CLOCK: Duration = Duration::from_secs(1);
/// ... and 50 ms for the first few ([`QUICK_SAMPLES`]).
const QUICK_CLOCK: Duration = Duration::from_millis(50);

impl SessionWorker {
    pub(super) fn exchange_hello_check_same_board_and_refresh_snapshot(&mut self) -> Result<(), LinkError> {
        let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
        let identity = DeviceIdentity::from_reply_if_hello(self.request_from_device_or_stop_it_instead(&hello)?)
            .ok_or_else(|| unexpected_reply_error("hello"))?;
        if self.boot_id != Some(identity.boot_id) {
            self.clock.forget_samples();
        }
        let board = self.board_id.unwrap_or(identity.board_id);
        if board != identity.board_id {
            let [wanted, found] = [board, identity.board_id].map(DeviceIdentity::board_id_hex);
            return Err(LinkError::OtherBoard { wanted, found });
        }
        self.board_id = Some(board);
        self.device.bind_to_usb_identity();
        let fit = self.needs.judge_board_channels_and_voltages(&identity);
        let mismatch = match &fit {
            BoardFit::Good => None,
            BoardFit::Weaker(text) | BoardFit::Unfit(text) => Some(text.clone()),
        };
        if let Some(text) = &mismatch
            && self.publish.borrow().mismatch.as_ref() != Some(text)
        {
            tracing::warn!("{text}");
        }
        self.unfit = mismatch.clone().filter(|_| matches!(fit, BoardFit::Unfit(_)));
        self.boot_id = Some(identity.boot_id);
        self.armed = false;
        self.drive_until = None;
        (self.next_clock, self.quick_samples) = (Instant::now(), QUICK_SAMPLES);
        let protocol = self.client.as_ref().map(Client::protocol_version);
        let path = self.device.port_path().to_owned();
        self.publish.send_modify(|snapshot| {
            (snapshot.identity, snapshot.protocol) = (Some(identity), protocol);
            (snapshot.mismatch, snapshot.path) = (mismatch, path);
            (snapshot.details, snapshot.credit, snapshot.clock) = (None, None, None);
        });
        self.refresh_all_parts_of_snapshot()
    }

    pub(super) fn send_keep_alive_and_stop_or_refresh_if_state_contradicts_armed(&mut self) -> Result<(), LinkError> {
        let Reply::Alive { state } = self.request_from_device_or_stop_it_instead(&Request::KeepAlive)? else {
            return Err(unexpected_reply_error("keep-alive"));
        };
        if self.armed && !state.is_live() {
            return self.refresh_all_parts_of_snapshot();
        }
        if self.is_live_though_not_armed_by_session(state) {
            self.stop_board_and_await_reply()?;
            return self.refresh_all_parts_of_snapshot();
        }
        Ok(())
    }

    /// Whether the device speaks version 2 or later.
    pub(super) fn speaks_version_2_or_later(&self) -> bool {
        self.speaks_version_or_later(2)
    }

    pub(super) fn speaks_version_or_later(&self, version: u8) -> bool {
        self.client.as_ref().is_some_and(|client| client.protocol_version() >= version)
    }

    /// Asks for the board's time, quickly at first and then now and then.
    pub(super) fn request_clock_sample_and_publish_quality_if_supported(&mut self) -> Result<(), LinkError> {
        self.quick_samples = self.quick_samples.saturating_sub(1);
        self.next_clock = Instant::now() + if self.quick_samples > 0 { QUICK_CLOCK } else { CLOCK };
        if !self.speaks_version_2_or_later() {
            return Ok(());
        }
        let Reply::Clock { now_us } = self.request_from_device_or_stop_it_instead(&Request::Clock)? else {
            return Err(unexpected_reply_error("clock"));
        };
        let times = self
            .client
            .as_ref()
            .and_then(|client| client.last_answered_frame_written_at().zip(client.last_reply_read_at()));
        if let Some((sent, received)) = times {
            self.clock.add_sample_forgetting_earlier_if_board_clock_went_back(sent, received, now_us);
        }
        let quality = self.clock.quality_if_two_samples();
        self.publish.send_modify(|snapshot| snapshot.clock = quality);
        Ok(())
    }

    fn request_telemetry(&mut self) -> Result<TelemetryReply, LinkError> {
        let Reply::Telemetry(telemetry) = self.request_from_device_or_stop_it_instead(&Request::Telemetry)? else {
            return Err(unexpected_reply_error("telemetry"));
        };
        Ok(telemetry)
    }

    fn request_details_if_supported(&mut self) -> Result<Option<DetailsReply>, LinkError> {
        if self.speaks_version_2_or_later() { self.request_details().map(Some) } else { Ok(None) }
    }

    pub(super) fn request_details(&mut self) -> Result<DetailsReply, LinkError> {
        let Reply::Details(details) = self.request_from_device_or_stop_it_instead(&Request::Details)? else {
            return Err(unexpected_reply_error("details"));
        };
        Ok(details)
    }

    fn request_credit(&mut self) -> Result<CreditReply, LinkError> {
        let Reply::Credit(credit) = self.request_from_device_or_stop_it_instead(&Request::Credit)? else {
            return Err(unexpected_reply_error("credit"));
        };
        Ok(credit)
    }

    /// Asks for all parts of the device's state now. A refresh that is under way begins again: what it has seen may have changed.
    pub(super) fn refresh_all_parts_of_snapshot(&mut self) -> Result<(), LinkError> {
        self.look_next = Some(SnapshotPart::Status);
        while self.look_next.is_some() {
            self.refresh_next_snapshot_part_and_notify_after_last()?;
        }
        Ok(())
    }

    /// The next part of a look, one request, so that a drive that comes meanwhile waits for one answer and not for four. What is seen is
    /// published part by part: a drive in between is never hidden by a state of before.
    pub(super) fn refresh_next_snapshot_part_and_notify_after_last(&mut self) -> Result<(), LinkError> {
        self.look_next = match self.look_next.take().unwrap_or(SnapshotPart::Status) {
            SnapshotPart::Status => {
                let seen = self.request_status_and_act_on_it()?;
                if seen.restarted {
                    return self.exchange_hello_check_same_board_and_refresh_snapshot();
                }
                // What has been measured with it is not asked for again.
                if seen.measured {
                    self.credit_as_next_snapshot_part_if_supported()
                } else {
                    Some(SnapshotPart::Telemetry)
                }
            }
            SnapshotPart::Telemetry => {
                let seen = self.request_telemetry()?;
                self.update_snapshot_silently(|snapshot| snapshot.telemetry = Some(seen));
                self.speaks_version_2_or_later().then_some(SnapshotPart::Details)
            }
            SnapshotPart::Details => {
                let seen = self.request_details()?;
                self.update_snapshot_silently(|snapshot| snapshot.details = Some(seen));
                self.credit_as_next_snapshot_part_if_supported()
            }
            SnapshotPart::Credit => {
                let seen = self.request_credit()?;
                self.update_snapshot_silently(|snapshot| snapshot.credit = Some(seen));
                None
            }
        };
        if self.look_next.is_none() {
            let (round_trips, link) = (self.summarise_round_trips(), self.total_link_statistics());
            self.publish.send_modify(|snapshot| {
                (snapshot.connected, snapshot.in_doubt) = (true, false);
                snapshot.problem = None;
                (snapshot.round_trips, snapshot.link) = (round_trips, link);
            });
        }
        Ok(())
    }

    fn credit_as_next_snapshot_part_if_supported(&self) -> Option<SnapshotPart> {
        self.speaks_version_or_later(Request::Credit.introduced_in_version()).then_some(SnapshotPart::Credit)
    }

    /// Changes the snapshot without notifying its receivers, which are notified at the end of the refresh.
    fn update_snapshot_silently(&self, change: impl FnOnce(&mut DeviceSnapshot)) {
        self.publish.send_if_modified(|snapshot| {
            change(snapshot);
            false
        });
    }

    fn summarise_round_trips(&self) -> RoundTripSummary {
        self.client.as_ref().map(Client::summarise_round_trips).unwrap_or_default()
    }

    /// Asks for the device's state, and acts on it. Receivers of the snapshot are notified at once if the state has changed, or else at the end of the
    /// refresh.
    fn request_status_and_act_on_it(&mut self) -> Result<StatusFindings, LinkError> {
        self.last_look = Instant::now();
        self.next_status = self.last_look + self.device.timing().status;
        let Reply::Status(status) = self.request_from_device_or_stop_it_instead(&Request::Status)? else {
            return Err(unexpected_reply_error("status"));
        };
        self.stop_is_seen = true;
        if self.is_live_though_not_armed_by_session(status.state) {
            // Before anything else is asked; what it comes to is looked at soon.
            self.stop_board_and_await_reply()?;
            self.next_status = Instant::now();
        } else if matches!(status.state, SafetyState::Arming | SafetyState::Discharging) {
            // It is about to change.
            self.next_status = Instant::now() + self.device.timing().status.min(TRANSITION);
        }
        // That it is safe says that its rails have been measured down: told with what was measured, and not beside what was before.
        let is_down = status.state == SafetyState::Safe && self.publish.borrow().state() != Some(SafetyState::Safe);
        let measured =
            if is_down { Some((self.request_telemetry()?, self.request_details_if_supported()?)) } else { None };
        let restarted = self.boot_id.is_some_and(|known| known != status.boot_id);
        let known = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        let is_new = |fault: &Fault| known.is_none_or(|k| (k.code, k.count) != (fault.code, fault.count));
        let faulted = status.fault.filter(is_new);
        let at_fault = faulted
            .map(|fault| self.log_fault_with_link(&fault, self.summarise_round_trips(), self.total_link_statistics()));
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
            snapshot.interruptions += u64::from(has_broken);
            is_other
        });
        if restarted {
            tracing::warn!("the device has restarted");
            self.require_manual_arming_if_policy("the device restarted");
        }
        Ok(StatusFindings { restarted, measured: is_down })
    }
}

/// What comes of a look at the state.
struct StatusFindings {
    /// Whether the device has restarted.
    restarted: bool,
    /// Whether its measurements have been asked for with it.
    measured: bool,
}

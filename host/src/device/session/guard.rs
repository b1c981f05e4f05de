//! What stands between an order and a drive: faults, outages, a board that does not fit, and drives that are taken back.

use super::worker::{SessionWorker, unexpected_reply_error};
use super::{AskedAt, DeviceSnapshot, LinkAtFault, SessionError};
use crate::device::client::{LinkError, LinkStatistics};
use crate::device::round_trips::RoundTripSummary;
use era_shared::protocol::{Fault, FaultCode, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Beside the time for arming, longest time that an order may wait for its turn.
const ORDER: Duration = Duration::from_secs(1);
/// After this program did not run for a while, what the system has kept for it meanwhile comes within this time.
const SETTLE: Duration = Duration::from_millis(500);

impl SessionWorker {
    /// Arms because a person asks for it: also a device that was away. Then charges the rails for the first touch.
    pub(super) fn arm_and_precharge_on_person_request_even_after_outage(
        &mut self,
        stop_count: u64,
    ) -> Result<(), SessionError> {
        self.check_connected_and_not_stopped_or_interrupted_since(AskedAt { stops: stop_count, interruptions: None })?;
        let begun = Instant::now();
        let was_away = self.away.take();
        self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = false);
        let armed = self
            .check_board_fits_and_needs_no_manual_arming()
            .and_then(|()| self.begin_arming_if_needed_and_is_self_test_pending())
            .and_then(|fresh| match fresh {
                true => self.await_armed_or_stop_board(stop_count),
                false => Ok(()),
            });
        let armed = armed.and_then(|()| self.precharge_rails_unless_driven());
        self.idle_since = Instant::now();
        if let Err(error) = &armed {
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = was_away.is_some());
            self.away = was_away;
            if let SessionError::Link(error) = error {
                self.handle_link_error_closing_link_unless_refused_or_halted(error);
            }
        }
        armed?;
        if let Err(error) = self.refresh_all_parts_of_snapshot() {
            self.handle_link_error_closing_link_unless_refused_or_halted(&error);
            return Err(error.into());
        }
        if self.armed {
            return Ok(());
        }
        // It has restarted, or gone off by itself, meanwhile.
        self.check_board_fits_and_needs_no_manual_arming()?;
        self.check_no_fault_latched_in_snapshot()?;
        let state = self.publish.borrow().state().map_or("unknown", SafetyState::name);
        Err(SessionError::NotArmed { waited: begun.elapsed(), state })
    }

    /// Refuses what was asked for before a stop, before the device went off, faulted or was away, or while it is away.
    pub(super) fn check_connected_and_not_stopped_or_interrupted_since(
        &self,
        asked_at: AskedAt,
    ) -> Result<(), SessionError> {
        self.check_not_stopped_since(asked_at.stops)?;
        self.check_connected()?;
        let now = self.publish.borrow().interruptions;
        if asked_at.interruptions.is_some_and(|then| then != now) { Err(SessionError::Broken) } else { Ok(()) }
    }

    pub(super) fn check_not_stopped_since(&self, stop_count: u64) -> Result<(), SessionError> {
        if stop_count == self.stops.load(Ordering::SeqCst) { Ok(()) } else { Err(SessionError::Stopped) }
    }

    /// Turns the error of a request that was ended because its answer was late into one that says so: it can be asked for again.
    pub(super) fn convert_error_of_halted_device_to_late_answer(&self, error: SessionError) -> SessionError {
        match error {
            SessionError::Link(error @ LinkError::Halted { .. }) => {
                SessionError::Late { path: self.device.port_path().to_owned(), reason: error.to_string() }
            }
            error => error,
        }
    }

    /// Refuses an order that was given before the device was in doubt or away, or before this program did not run for a while.
    pub(super) fn refuse_order_too_old_or_from_before_device_was_back(
        &self,
        asked_at: Instant,
    ) -> Result<(), SessionError> {
        let (now, oldest) = (Instant::now(), self.device.timing().arming.saturating_add(ORDER));
        let reason = match self.again_since.filter(|since| asked_at < *since) {
            Some(since) if now < since => format!(
                "the computer slept or the daemon was suspended, so the daemon refuses all requests for the next \
                 {:.0?}. Send the request again after this time",
                since - now
            ),
            Some(_) => "the request was sent while the device did not answer, or while the daemon did not run, so the \
                        daemon does not carry out the request. Send the request again"
                .to_owned(),
            None if asked_at.elapsed() > oldest => format!(
                "the request has waited for {:.0?}, but may wait for at most {oldest:.0?}. Send the request again",
                asked_at.elapsed()
            ),
            None => return Ok(()),
        };
        Err(SessionError::Late { path: self.device.port_path().to_owned(), reason })
    }

    /// Notices that this program did not run for a while, and ends what was driven or asked for before.
    pub(super) fn stop_board_and_refuse_earlier_orders_if_slept_or_suspended(&mut self) {
        let _ = self.stop_refuse_earlier_orders_and_get_pause_if_slept_or_suspended();
    }

    /// If this program did not run for a while, stops the board and refuses earlier orders; returns how long it did not run. What waited in the
    /// system's buffers meanwhile comes within moments, and is not driven either. A board that was on has gone off by its dead-man timer, and waits
    /// for a person as after any outage: whoever was there may have left.
    pub(super) fn stop_refuse_earlier_orders_and_get_pause_if_slept_or_suspended(&mut self) -> Option<Duration> {
        let paused = self.awake.take_time_since_last_call_if_host_slept_or_process_suspended()?;
        self.client.as_ref()?;
        tracing::warn!(
            paused_s = paused.as_secs_f64(),
            "the daemon did not run (the computer slept, or the process was suspended): the daemon stops the board and \
             refuses earlier requests"
        );
        self.again_since = Some(Instant::now() + SETTLE);
        self.require_manual_arming_if_policy(&format!(
            "this computer slept, or the daemon was suspended, for {:.0} s",
            paused.as_secs_f64()
        ));
        self.invalidate_earlier_orders();
        if let Err(error) = self.stop_board_and_await_reply() {
            self.handle_link_error_closing_link_unless_refused_or_halted(&error);
        }
        Some(paused)
    }

    /// Refuses to drive a scene that the board is not made for, and a board that a person has to arm.
    pub(super) fn check_board_fits_and_needs_no_manual_arming(&self) -> Result<(), SessionError> {
        if let Some(reason) = self.unfit.clone() {
            return Err(SessionError::Unfit { reason });
        }
        match self.away.clone() {
            Some(reason) => Err(SessionError::Away { reason, is_faulty: self.has_fault_that_arming_keeps() }),
            None => Ok(()),
        }
    }

    /// Whether a fault is latched that arming does not clear.
    fn has_fault_that_arming_keeps(&self) -> bool {
        let fault = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        fault.is_some_and(|fault| !(self.policy.clears_silence && fault.code == FaultCode::HostSilent))
    }

    /// From here on a person has to arm the board, if that is the policy.
    pub(super) fn require_manual_arming_if_policy(&mut self, reason: &str) {
        if !self.policy.arms_after_outage && self.board_id.is_some() && self.away.is_none() {
            self.away = Some(reason.to_owned());
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = true);
        }
    }

    /// Orders that were given before this call are refused from now on.
    pub(super) fn invalidate_earlier_orders(&self) {
        self.publish.send_modify(|snapshot| snapshot.interruptions += 1);
    }

    /// Whether the device is live though this session has not armed it: since before this program began, or by a mistake.
    pub(super) fn is_live_though_not_armed_by_session(&self, state: SafetyState) -> bool {
        !self.armed && state.is_live()
    }

    /// Notes that the device is told to stop: nothing that was seen of it before counts as its state after the stop.
    pub(super) fn mark_disarmed_and_schedule_status_request_after_stop(&mut self) {
        (self.armed, self.drive_until) = (false, None);
        (self.look_next, self.next_status, self.stop_is_seen) = (None, Instant::now(), false);
    }

    /// Has the device switch everything off.
    pub(super) fn stop_board_and_await_reply(&mut self) -> Result<(), LinkError> {
        self.mark_disarmed_and_schedule_status_request_after_stop();
        // Those that are counted while it is asked may have come too late for it.
        let stops = self.stops.load(Ordering::SeqCst);
        self.request_from_device_or_stop_it_instead(&Request::Stop)?;
        self.obeyed = stops;
        Ok(())
    }

    /// Carries out the stops that have been asked for since the last one, all by one request, whatever else waits.
    pub(super) fn stop_board_once_and_await_reply_if_any_stop_requested(&mut self) {
        if self.client.is_some()
            && self.obeyed != self.stops.load(Ordering::SeqCst)
            && let Err(error) = self.stop_board_and_await_reply()
        {
            self.handle_link_error_closing_link_unless_refused_or_halted(&error);
        }
    }

    /// Answers a stop: mostly it has been obeyed by now.
    pub(super) fn stop_unless_obeyed_and_refresh_state(&mut self, stop_number: u64) -> Result<(), SessionError> {
        self.check_connected()?;
        let is_shown = self.publish.borrow().state().is_some_and(|state| !state.is_live());
        if self.obeyed >= stop_number && self.stop_is_seen && is_shown {
            return Ok(());
        }
        let result = if self.obeyed >= stop_number { Ok(()) } else { self.stop_board_and_await_reply() }
            .and_then(|()| self.refresh_all_parts_of_snapshot());
        match result {
            // Another one came between this stop and the look at what it did: both have been obeyed, and the look is the other's.
            Err(LinkError::Halted { by_order: true, .. }) if self.obeyed >= stop_number => Ok(()),
            Err(error) => {
                self.handle_link_error_closing_link_unless_refused_or_halted(&error);
                Err(error.into())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Stops drives that were set and whose order was then answered with an error: they must not run.
    pub(super) fn stop_board_and_refresh_snapshot(&mut self) {
        if let Err(error) = self.stop_board_and_await_reply().and_then(|()| self.refresh_all_parts_of_snapshot()) {
            self.handle_link_error_closing_link_unless_refused_or_halted(&error);
        }
    }

    /// Clears a latched silence of this host, if that is the policy.
    pub(super) fn clear_host_silence_fault_if_policy_allows(&mut self) -> Result<(), SessionError> {
        let fault = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        if !self.policy.clears_silence || fault.is_none_or(|fault| fault.code != FaultCode::HostSilent) {
            return Ok(());
        }
        tracing::warn!(
            "the device latched a fault, because this host sent nothing for longer than the dead-man time; the daemon \
            clears this fault (--clear-silence)"
        );
        self.clear_latched_fault_or_refuse_other_code(Some(FaultCode::HostSilent))?;
        self.publish.send_modify(|snapshot| snapshot.cleared += 1);
        Ok(self.refresh_all_parts_of_snapshot()?)
    }

    /// Clears the latched fault, if it has `wanted_code_or_any`; with any code if that is `None`. A board that numbers its faults is told which one,
    /// so that a fault that is latched meanwhile stays.
    pub(super) fn clear_latched_fault_or_refuse_other_code(
        &mut self,
        wanted_code_or_any: Option<FaultCode>,
    ) -> Result<(), LinkError> {
        if !self.speaks_version_or_later(4) {
            return self.request_from_device_or_stop_it_instead(&Request::ClearFaults).map(drop);
        }
        let Reply::NumberedFault { number, latched } =
            self.request_from_device_or_stop_it_instead(&Request::NumberedFault)?
        else {
            return Err(unexpected_reply_error("numbered-fault"));
        };
        if let (Some(wanted_code), Some(fault)) = (wanted_code_or_any, latched)
            && fault.code != wanted_code
        {
            return Err(LinkError::Refused(Refusal::OtherFault { number }));
        }
        self.request_from_device_or_stop_it_instead(&Request::ClearFault { number }).map(drop)
    }

    /// Logs a fault that was not there before, with what is known of the link, and returns the latter.
    pub(super) fn log_fault_with_link(
        &self,
        fault: &Fault,
        round_trips: RoundTripSummary,
        link: LinkStatistics,
    ) -> LinkAtFault {
        let DeviceSnapshot { longest_gap, outages, .. } = *self.publish.borrow();
        let known = LinkAtFault { silence: self.silence, round_trips, link, longest_gap, outages };
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        tracing::error!(
            code = fault.code.number(),
            name = fault.code.name(),
            detail = fault.detail,
            count = fault.count,
            keep_alive_age_ms = ms(known.silence),
            longest_gap_ms = ms(longest_gap),
            round_trip_ms = round_trips.median.map(ms),
            round_trip_worst_ms = round_trips.worst.map(ms),
            jitter_ms = round_trips.jitter.map(ms),
            repeats = link.repeats,
            bad_frames = link.bad_frames,
            outages,
            "the device has latched a fault: {}",
            fault.code.advice()
        );
        known
    }

    pub(super) fn check_no_fault_latched_in_snapshot(&self) -> Result<(), SessionError> {
        match self.publish.borrow().status.as_ref().and_then(|status| status.fault) {
            None => Ok(()),
            Some(fault) => Err(SessionError::Fault {
                number: fault.code.number(),
                name: fault.code.name(),
                advice: fault.code.advice(),
            }),
        }
    }

    /// Publishes that the device may be gone, unless it has not been there yet.
    pub(super) fn publish_that_device_may_be_gone_if_connected(
        publish: &watch::Sender<DeviceSnapshot>,
        request: &'static str,
        waited: Duration,
    ) {
        if !publish.borrow().connected {
            return;
        }
        tracing::warn!(
            request,
            waited_ms = waited.as_secs_f64() * 1e3,
            "the device does not answer; the daemon sends the request again"
        );
        publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (false, true);
            snapshot.doubts += 1;
            snapshot.problem = Some(format!(
                "the board has not answered a request for {:.0} ms, so the daemon sends the request again. If an armed board \
                 still does not answer, the daemon stops the board. An armed board that receives nothing for 250 ms \
                 switches its high voltage off",
                waited.as_secs_f64() * 1e3
            ));
        });
    }
}

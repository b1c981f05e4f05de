//! What stands between an order and a drive: faults, outages, a board that does not fit, and drives that are taken back.

use super::worker::Worker;
use super::{LinkAtFault, SessionError, Snapshot};
use crate::device::client::{LinkError, LinkStatistics};
use crate::device::round_trips::RoundTrips;
use era_shared::protocol::{Fault, FaultCode, Request};
use era_shared::safety::State;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Beside the time for arming, longest time that an order may wait for its turn.
const ORDER: Duration = Duration::from_secs(1);
/// After this program did not run for a while, what the system has kept for it meanwhile comes within this time.
const SETTLE: Duration = Duration::from_millis(500);

impl Worker {
    /// As [`Self::arm`], whatever the device was away for, and with rails that rise for the first touch.
    pub(super) fn arm_by_hand(&mut self, stops: u64) -> Result<(), SessionError> {
        if stops != self.stops.load(Ordering::SeqCst) {
            return Err(SessionError::Stopped);
        }
        self.connected()?;
        let begun = Instant::now();
        let was_away = self.away.take();
        self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = false);
        let armed = self.check_fit().and_then(|()| self.arm()).and_then(|fresh| match fresh {
            true => self.await_armed(stops),
            false => Ok(()),
        });
        let armed = armed.and_then(|()| self.raise_rails());
        self.idle_since = Instant::now();
        if let Err(error) = &armed {
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = was_away.is_some());
            self.away = was_away;
            if let SessionError::Link(error) = error {
                self.note_trouble(error);
            }
        }
        armed?;
        if let Err(error) = self.look() {
            self.note_trouble(&error);
            return Err(error.into());
        }
        if self.armed {
            return Ok(());
        }
        // It has restarted, or gone off by itself, meanwhile.
        self.check_fit()?;
        self.check_fault()?;
        let state = self.publish.borrow().state().map_or("unknown", State::name);
        Err(SessionError::NotArmed { waited: begun.elapsed(), state })
    }

    /// What was ended as its answer was late can be asked for again.
    pub(super) fn late(&self, error: SessionError) -> SessionError {
        match error {
            SessionError::Link(error @ LinkError::Halted { .. }) => {
                SessionError::Late { path: self.device.path().to_owned(), reason: error.to_string() }
            }
            error => error,
        }
    }

    /// What was asked for before the device was in doubt, or away, or while this program did not run, is not done long after it.
    pub(super) fn in_time(&self, asked: Instant) -> Result<(), SessionError> {
        let oldest = self.device.timing().arming.saturating_add(ORDER);
        if self.again_since.is_some_and(|since| asked < since) || asked.elapsed() > oldest {
            let reason = format!(
                "it did not answer, or this program did not run, until just now, and this request is from {:.0?} before",
                asked.elapsed()
            );
            return Err(SessionError::Late { path: self.device.path().to_owned(), reason });
        }
        Ok(())
    }

    /// Notices that this program did not run for a while, and ends what was driven or asked for before.
    pub(super) fn note_pause(&mut self) {
        let _ = self.end_for_pause();
    }

    /// The same; how long it did not run, if it did not. What waited in the system's buffers meanwhile comes within moments, and is not driven
    /// either. A board that has been on has gone off by its dead-man timer, and waits for a person as after any outage: who was there may have left.
    pub(super) fn end_for_pause(&mut self) -> Option<Duration> {
        let paused = self.awake.take_pause()?;
        self.client.as_ref()?;
        tracing::warn!(
            paused_s = paused.as_secs_f64(),
            "this program did not run (the computer slept, or the process was suspended): the board is told to \
             stop, and earlier requests are refused"
        );
        self.again_since = Some(Instant::now() + SETTLE);
        self.was_away(&format!("this computer slept, or the daemon was suspended, for {:.0} s", paused.as_secs_f64()));
        self.broke();
        if let Err(error) = self.halt() {
            self.note_trouble(&error);
        }
        Some(paused)
    }

    /// Refuses to drive a scene that the board is not made for, and a board that a person has to arm.
    pub(super) fn check_fit(&self) -> Result<(), SessionError> {
        if let Some(reason) = self.unfit.clone() {
            return Err(SessionError::Unfit { reason });
        }
        match self.away.clone() {
            Some(reason) => Err(SessionError::Away { reason, is_faulty: self.has_lasting_fault() }),
            None => Ok(()),
        }
    }

    /// Whether a fault is latched that arming does not clear.
    fn has_lasting_fault(&self) -> bool {
        let fault = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        fault.is_some_and(|fault| !(self.policy.clears_silence && fault.code == FaultCode::HostSilent))
    }

    /// From here on a person has to arm it, if that is the policy.
    pub(super) fn was_away(&mut self, reason: &str) {
        if !self.policy.arms_after_outage && self.board_id.is_some() && self.away.is_none() {
            self.away = Some(reason.to_owned());
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = true);
        }
    }

    /// What was asked for before this is not begun after it.
    pub(super) fn broke(&self) {
        self.publish.send_modify(|snapshot| snapshot.breaks += 1);
    }

    /// Whether the device is live though nobody here has armed it: before this program began, or by a mistake.
    pub(super) fn is_live_unasked(&self, state: State) -> bool {
        !self.armed && state.is_live()
    }

    /// From here on the device is told to stop: nothing that was seen of it before is told of it as it is after that.
    pub(super) fn note_stop(&mut self) {
        (self.armed, self.drive_until) = (false, None);
        (self.look_next, self.next_status, self.stop_is_seen) = (None, Instant::now(), false);
    }

    /// Everything off.
    pub(super) fn halt(&mut self) -> Result<(), LinkError> {
        self.note_stop();
        // Those that are counted while it is asked may have come too late for it.
        let stops = self.stops.load(Ordering::SeqCst);
        self.ask(&Request::Stop)?;
        self.obeyed = stops;
        Ok(())
    }

    /// Carries out the stops that have been asked for since the last one, all by one request, whatever else waits.
    pub(super) fn obey(&mut self) {
        if self.client.is_some()
            && self.obeyed != self.stops.load(Ordering::SeqCst)
            && let Err(error) = self.halt()
        {
            self.note_trouble(&error);
        }
    }

    /// Answers a stop: mostly it has been obeyed by now.
    pub(super) fn stop(&mut self, number: u64) -> Result<(), SessionError> {
        self.connected()?;
        let is_shown = self.publish.borrow().state().is_some_and(|state| !state.is_live());
        if self.obeyed >= number && self.stop_is_seen && is_shown {
            return Ok(());
        }
        let result = if self.obeyed >= number { Ok(()) } else { self.halt() }.and_then(|()| self.look());
        match result {
            // Another one came between this stop and the look at what it did: both have been obeyed, and the look is the other's.
            Err(LinkError::Halted { by_order: true, .. }) if self.obeyed >= number => Ok(()),
            Err(error) => {
                self.note_trouble(&error);
                Err(error.into())
            }
            Ok(()) => Ok(()),
        }
    }

    /// Drives that were set and then answered with an error must not run.
    pub(super) fn take_back(&mut self) {
        if let Err(error) = self.halt().and_then(|()| self.look()) {
            self.note_trouble(&error);
        }
    }

    /// Clears a latched silence of this host, if that is the policy.
    pub(super) fn clear_silence(&mut self) -> Result<(), SessionError> {
        let fault = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        if !self.policy.clears_silence || fault.is_none_or(|fault| fault.code != FaultCode::HostSilent) {
            return Ok(());
        }
        tracing::warn!("clearing the latched silence of this host (--clear-silence)");
        self.ask(&Request::ClearFaults)?;
        self.publish.send_modify(|snapshot| snapshot.cleared += 1);
        Ok(self.look()?)
    }

    /// Says what is known of the link when a fault is seen that was not there before.
    pub(super) fn report(&self, fault: &Fault, round_trips: RoundTrips, link: LinkStatistics) -> LinkAtFault {
        let Snapshot { longest_gap, outages, .. } = *self.publish.borrow();
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

    pub(super) fn check_fault(&self) -> Result<(), SessionError> {
        match self.publish.borrow().status.as_ref().and_then(|status| status.fault) {
            None => Ok(()),
            Some(fault) => Err(SessionError::Fault {
                number: fault.code.number(),
                name: fault.code.name(),
                advice: fault.code.advice(),
            }),
        }
    }

    /// The device may be gone. One that has not been there yet is no loss.
    pub(super) fn doubt(publish: &watch::Sender<Snapshot>, request: &'static str, waited: Duration) {
        if !publish.borrow().connected {
            return;
        }
        tracing::warn!(
            request,
            waited_ms = waited.as_secs_f64() * 1e3,
            "the device does not answer; the daemon continues to ask"
        );
        publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (false, true);
            snapshot.doubts += 1;
            snapshot.problem = Some(format!(
                "it did not answer for {:.0} ms, and the daemon asks again. If an armed board stays silent, the \
                 daemon tells it to stop. An armed board that receives nothing for 250 ms goes off by itself",
                waited.as_secs_f64() * 1e3
            ));
        });
    }
}

//! What stands between an order and a drive: faults, outages, a board that does not fit, and drives that are taken back.

use super::worker::Worker;
use super::{SessionError, Snapshot};
use crate::device::client::Client;
use era_shared::protocol::{Fault, FaultCode, Request};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::sync::watch;

impl Worker {
    /// As [`Self::arm`], whatever the device was away for.
    pub(super) fn arm_by_hand(&mut self, stops: u64) -> Result<(), SessionError> {
        if stops != self.stops.load(Ordering::SeqCst) {
            return Err(SessionError::Stopped);
        }
        self.connected()?;
        let was_away = self.away.take();
        self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = false);
        let armed = self.check_fit().and_then(|()| self.arm()).and_then(|fresh| match fresh {
            true => self.await_armed(stops),
            false => Ok(()),
        });
        self.idle_since = Instant::now();
        if let Err(error) = &armed {
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = was_away.is_some());
            self.away = was_away;
            if let SessionError::Link(error) = error {
                self.note_trouble(error);
            }
        }
        armed?;
        Ok(self.look()?)
    }

    /// Refuses to drive a scene that the board is not made for, and a board that a person has to arm.
    pub(super) fn check_fit(&self) -> Result<(), SessionError> {
        if let Some(reason) = self.unfit.clone() {
            return Err(SessionError::Unfit { reason });
        }
        match self.away.clone() {
            Some(reason) => Err(SessionError::Away { reason }),
            None => Ok(()),
        }
    }

    /// From here on a person has to arm it, if that is the policy.
    pub(super) fn was_away(&mut self, reason: &str) {
        if !self.policy.arms_after_outage && self.board_id.is_some() && self.away.is_none() {
            self.away = Some(reason.to_owned());
            self.publish.send_modify(|snapshot| snapshot.waits_to_be_armed = true);
        }
    }

    /// Drives that were set and then answered with an error must not run.
    pub(super) fn take_back(&mut self) {
        self.armed = false;
        self.drive_until = None;
        if let Err(error) = self.ask(&Request::Stop).and_then(|_| self.look()) {
            self.note_trouble(&error);
        }
    }

    /// Clears a latched silence of this host, if that is the policy.
    pub(super) fn clear_silence(&mut self) -> Result<(), SessionError> {
        let fault = self.publish.borrow().status.as_ref().and_then(|status| status.fault);
        if !self.policy.clears_silence || fault.is_none_or(|fault| fault.code != FaultCode::HostSilent) {
            return Ok(());
        }
        tracing::warn!("clearing the latched silence of this host, as is the policy");
        self.ask(&Request::ClearFaults)?;
        self.publish.send_modify(|snapshot| snapshot.cleared += 1);
        Ok(self.look()?)
    }

    /// Says what is known when a fault has been latched.
    pub(super) fn report(&self, fault: &Fault) {
        let snapshot = self.publish.borrow();
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let link = self.client.as_ref().map(Client::statistics).unwrap_or_default();
        tracing::error!(
            code = fault.code.number(),
            name = fault.code.name(),
            detail = fault.detail,
            count = fault.count,
            heard_ms_ago = ms(self.last_heard.elapsed()),
            longest_gap_ms = ms(snapshot.longest_gap),
            round_trip_ms = snapshot.round_trip.map(ms),
            repeats = link.repeats,
            bad_frames = link.bad_frames,
            outages = snapshot.outages,
            "the device has latched a fault: {}",
            fault.code.advice()
        );
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
        tracing::warn!(request, waited_ms = waited.as_secs_f64() * 1e3, "the device does not answer; it is asked on");
        publish.send_modify(|snapshot| {
            (snapshot.connected, snapshot.in_doubt) = (false, true);
            snapshot.doubts += 1;
            snapshot.problem = Some(format!(
                "nothing was heard of it for {:.0} ms, and it is asked on; if it is armed it goes off by itself, 250 ms after it was last asked \
                 something",
                waited.as_secs_f64() * 1e3
            ));
        });
    }
}

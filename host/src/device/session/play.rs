//! Effects: given to the board with a start in its own time, early enough that all of it has arrived by then.

use super::worker::{Worker, unexpected};
use super::{EffectOrder, Played, SessionError};
use crate::device::client::{Client, LinkError};
use crate::effects::envelope::length_s;
use era_shared::protocol::{AchievedDrive, Details, Refusal, Reply, Request};
use era_shared::safety::State;
use era_shared::supply::rail_of;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// A rail is up when it has this part of the voltage wanted, in per cent: 0.9 dB of force.
const RAIL_UP_PERCENT: u64 = 95;
/// Between two looks at the rails.
const RAILS_POLL: Duration = Duration::from_millis(5);
/// Added to the time that the frames take: the board looks for what is due every ms, and writes a period ahead.
const LEAD: Duration = Duration::from_millis(3);
/// The drive ends this long after its effect: what is left of a period, and the next look.
const AFTER: Duration = Duration::from_millis(50);
/// Most of the clock's error that is waited for, in s: a clock known worse than that is taken from its last answer.
const CLOCK_ERROR_S: f64 = 0.01;

impl Worker {
    pub(super) fn play(&mut self, order: EffectOrder) -> Result<Played, SessionError> {
        let mut result = self.try_play(order.clone());
        // A frame that was lost and repeated comes later than its start: nothing has begun, and the next start is later, too.
        if let Err(SessionError::Link(LinkError::Refused(Refusal::Start { .. }))) = &result {
            tracing::info!(plan = order.id, "the start of the effect had passed: sending the effect again");
            result = self.try_play(order);
        }
        if let Err(SessionError::Link(error)) = &result {
            self.note_trouble(error);
        }
        result
    }

    fn try_play(&mut self, order: EffectOrder) -> Result<Played, SessionError> {
        let EffectOrder { id, stops, drives, effects, start } = order;
        let channels: Vec<u8> = drives.iter().map(|drive| drive.channel).collect();
        self.check_stops(stops)?;
        self.connected()?;
        let prepare = Request::Prepare { drives: drives.into_iter().take(era_shared::MAX_CHANNELS).collect() };
        if !self.is_modern() {
            let spoken = self.client.as_ref().map_or(0, Client::version);
            return Err(LinkError::TooOld { request: "play", needed: prepare.since(), spoken }.into());
        }
        self.check_fit()?;
        if self.arm()? {
            self.await_armed(stops)?;
        }
        let Reply::Prepared { achieved } = self.ask(&prepare)? else { return Err(unexpected("prepare").into()) };
        self.drive_id = id;
        self.show(State::Running);
        // Whatever comes in between, these drives end.
        self.drive_until = Some(Instant::now() + self.device.timing().arming);
        self.await_rails(&achieved, stops)?;
        // Fresh, so that the start is right to a round trip even with a clock that cannot be followed.
        self.sample_clock()?;
        let soonest = Instant::now() + self.lead(achieved.len());
        let start = start.map_or(soonest, |start| start.max(soonest));
        let start_us = self.clock.board_us_at(start).ok_or_else(|| unexpected("clock"))?;
        let mut length = Duration::ZERO;
        for (channel, effect) in channels.into_iter().zip(effects) {
            let period_s = achieved.iter().find(|drive| drive.channel == channel).map_or(0.0, period_s);
            length = length.max(Duration::try_from_secs_f64(length_s(&effect, period_s)).unwrap_or(Duration::MAX));
            let play = Request::Play { channel, start_us, effect };
            if let Err(error) = self.ask(&play) {
                // None or all: what waits already is forgotten.
                if matches!(error, LinkError::Refused(_)) {
                    self.rest()?;
                }
                return Err(error.into());
            }
        }
        let end = start + length + AFTER;
        self.drive_until = Some(end);
        self.idle_since = end;
        Ok(Played { achieved: achieved.to_vec(), start_us, start, length })
    }

    /// Has the rails rise to where they stand ready, so that a first effect does not wait for their soft start. Silent drives bring them up,
    /// and a rail that feeds nobody stays charged: no electrode is on meanwhile, and they come down when the idle time ends. Rails that
    /// drives are on are left alone.
    pub(super) fn raise_rails(&mut self) -> Result<(), SessionError> {
        if !self.is_modern() || self.drive_until.is_some() {
            return Ok(());
        }
        let drives = self.publish.borrow().identity.as_ref().map(|board| self.needs.silent(board)).unwrap_or_default();
        match self.ask(&Request::Prepare { drives }).and_then(|_| self.rest()) {
            // Channels have to rest: they rise with the first touch.
            Err(LinkError::Refused(Refusal::Duty { .. })) => Ok(()),
            raised => Ok(raised?),
        }
    }

    pub(super) fn check_stops(&self, stops: u64) -> Result<(), SessionError> {
        if stops == self.stops.load(Ordering::SeqCst) { Ok(()) } else { Err(SessionError::Stopped) }
    }

    /// Waits until the rails have the voltages of the drives, as an effect does not wait for them: the soft start to 2 kV takes
    /// 100 ms. The board itself sees to rails that do not come.
    fn await_rails(&mut self, drives: &[AchievedDrive], stops: u64) -> Result<(), SessionError> {
        let begun = Instant::now();
        while begun.elapsed() < self.device.timing().arming {
            self.check_stops(stops)?;
            let Details { state, rail_millivolts: measured, .. } = self.details()?;
            if !state.is_live() {
                self.look()?;
                self.check_fault()?;
                return Err(SessionError::NotArmed { waited: begun.elapsed(), state: state.name() });
            }
            let is_up = |drive: &AchievedDrive| {
                let rail = measured.get(rail_of(usize::from(drive.channel))).copied().unwrap_or(0);
                u64::from(rail) * 100 >= u64::from(drive.voltage_millivolts) * RAIL_UP_PERCENT
            };
            if drives.iter().all(is_up) {
                break;
            }
            std::thread::sleep(RAILS_POLL);
        }
        Ok(())
    }

    /// How far ahead a start must be so that `frames` requests have arrived by then, one after the other and the last as
    /// late as any of late was.
    fn lead(&self, frames: usize) -> Duration {
        let trips = self.client.as_ref().map(Client::round_trips).and_then(|trips| trips.median.zip(trips.worst));
        let (median, worst) = trips.unwrap_or_default();
        let clock = self.clock.quality().map_or(0.0, |quality| quality.residual_worst_s.min(CLOCK_ERROR_S));
        let frames = u32::try_from(frames).unwrap_or(u32::MAX);
        median * frames + worst + Duration::from_secs_f64(clock) + LEAD
    }
}

/// Length of a drive's period in s.
#[expect(clippy::cast_precision_loss, reason = "nanohertz up to 1e12 are exact in an f64")]
fn period_s(drive: &AchievedDrive) -> f64 {
    1e9 / drive.frequency_nanohertz.max(1) as f64
}

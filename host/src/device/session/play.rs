//! Effects: given to the board with a start in its own time, early enough that all of it has arrived by then.

use super::worker::{SessionWorker, unexpected_reply_error};
use super::{EffectOrder, EffectResult, SessionError};
use crate::device::client::{Client, LinkError};
use crate::effects::envelope::length_s;
use era_shared::protocol::{AchievedDrive, DetailsReply, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use era_shared::supply::rail_index_of_channel;
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

impl SessionWorker {
    pub(super) fn play_effect(&mut self, order: EffectOrder) -> Result<EffectResult, SessionError> {
        let mut result = self.try_play_effect(order.clone());
        // A frame that was lost and repeated comes later than its start: nothing has begun, and the next start is later, too.
        if let Err(SessionError::Link(LinkError::Refused(Refusal::Start { .. }))) = &result {
            tracing::info!(plan = order.id, "the start of the effect had passed: sending the effect again");
            result = self.try_play_effect(order);
        }
        if let Err(SessionError::Link(error)) = &result {
            self.handle_link_error(error);
        }
        result
    }

    fn try_play_effect(&mut self, order: EffectOrder) -> Result<EffectResult, SessionError> {
        let EffectOrder { id, stops, drives, effects, start } = order;
        let channels: Vec<u8> = drives.iter().map(|drive| drive.channel).collect();
        self.check_not_stopped_since(stops)?;
        self.check_connected()?;
        let prepare = Request::Prepare { drives: drives.into_iter().take(era_shared::MAX_CHANNELS).collect() };
        if !self.speaks_version_2() {
            let spoken = self.client.as_ref().map_or(0, Client::protocol_version);
            return Err(LinkError::TooOld { request: "play", needed: prepare.introduced_in_version(), spoken }.into());
        }
        self.check_board_is_drivable()?;
        if self.begin_arming_if_needed()? {
            self.await_armed(stops)?;
        }
        let Reply::Prepared { achieved } = self.request_from_device(&prepare)? else {
            return Err(unexpected_reply_error("prepare").into());
        };
        self.drive_id = id;
        self.publish_state(SafetyState::Running);
        // Whatever comes in between, these drives end.
        self.drive_until = Some(Instant::now() + self.device.timing().arming);
        self.await_rails(&achieved, stops)?;
        // Fresh, so that the start is right to a round trip even with a clock that cannot be followed.
        self.sample_clock()?;
        let soonest = Instant::now() + self.lead_time_for_frames(achieved.len());
        let start = start.map_or(soonest, |start| start.max(soonest));
        let start_us = self.clock.board_time_us_at(start).ok_or_else(|| unexpected_reply_error("clock"))?;
        let mut length = Duration::ZERO;
        for (channel, effect) in channels.into_iter().zip(effects) {
            let period_s = achieved.iter().find(|drive| drive.channel == channel).map_or(0.0, period_s);
            length = length.max(Duration::try_from_secs_f64(length_s(&effect, period_s)).unwrap_or(Duration::MAX));
            let play = Request::Play { channel, start_us, effect };
            if let Err(error) = self.request_from_device(&play) {
                // None or all: what waits already is forgotten.
                if matches!(error, LinkError::Refused(_)) {
                    self.end_drives()?;
                }
                return Err(error.into());
            }
        }
        let end = start + length + AFTER;
        self.drive_until = Some(end);
        self.idle_since = end;
        Ok(EffectResult { achieved: achieved.to_vec(), start_us, start, length })
    }

    /// Charges the rails to the voltage at which they stand ready, so that a first effect does not wait for their soft start. Silent drives bring them up,
    /// and a rail that feeds nobody stays charged: no electrode is on meanwhile, and they come down when the idle time ends. Rails that
    /// drives are on are left alone.
    pub(super) fn precharge_rails(&mut self) -> Result<(), SessionError> {
        if !self.speaks_version_2() || self.drive_until.is_some() {
            return Ok(());
        }
        let drives = self
            .publish
            .borrow()
            .identity
            .as_ref()
            .map(|board| self.needs.make_rail_precharge_drives(board))
            .unwrap_or_default();
        match self.request_from_device(&Request::Prepare { drives }).and_then(|_| self.end_drives()) {
            // Channels have to rest: they rise with the first touch.
            Err(LinkError::Refused(Refusal::Duty { .. })) => Ok(()),
            raised => Ok(raised?),
        }
    }

    pub(super) fn check_not_stopped_since(&self, stop_count: u64) -> Result<(), SessionError> {
        if stop_count == self.stops.load(Ordering::SeqCst) { Ok(()) } else { Err(SessionError::Stopped) }
    }

    /// Waits until the rails have the voltages of the drives, as an effect does not wait for them: the soft start to 2 kV takes
    /// 100 ms. The board itself sees to rails that do not come.
    fn await_rails(&mut self, drives: &[AchievedDrive], stop_count: u64) -> Result<(), SessionError> {
        let begun = Instant::now();
        while begun.elapsed() < self.device.timing().arming {
            self.check_not_stopped_since(stop_count)?;
            let DetailsReply { state, rail_millivolts: measured, .. } = self.request_details()?;
            if !state.is_live() {
                self.refresh_snapshot()?;
                self.check_no_fault_latched()?;
                return Err(SessionError::NotArmed { waited: begun.elapsed(), state: state.name() });
            }
            let is_up = |drive: &AchievedDrive| {
                let rail = measured.get(rail_index_of_channel(usize::from(drive.channel))).copied().unwrap_or(0);
                u64::from(rail) * 100 >= u64::from(drive.voltage_millivolts) * RAIL_UP_PERCENT
            };
            if drives.iter().all(is_up) {
                break;
            }
            std::thread::sleep(RAILS_POLL);
        }
        Ok(())
    }

    /// How far ahead a start must be so that `frame_count` requests, one after the other, have arrived by then, the last one with the longest
    /// recent round trip.
    fn lead_time_for_frames(&self, frame_count: usize) -> Duration {
        let trips =
            self.client.as_ref().map(Client::summarise_round_trips).and_then(|trips| trips.median.zip(trips.worst));
        let (median, worst) = trips.unwrap_or_default();
        let clock = self.clock.quality().map_or(0.0, |quality| quality.residual_worst_s.min(CLOCK_ERROR_S));
        let frames = u32::try_from(frame_count).unwrap_or(u32::MAX);
        median * frames + worst + Duration::from_secs_f64(clock) + LEAD
    }
}

/// Length of a drive's period in s.
#[expect(clippy::cast_precision_loss, reason = "nanohertz up to 1e12 are exact in an f64")]
fn period_s(drive: &AchievedDrive) -> f64 {
    1e9 / drive.frequency_nanohertz.max(1) as f64
}

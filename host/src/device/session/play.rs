//! Effects: given to the board with a start in its own time, early enough that all of it has arrived by then.

use super::worker::{SessionWorker, unexpected_reply_error};
use super::{AskedAt, DriveResult, EffectTimes, SessionError};
use crate::device::client::{Client, LinkError};
use crate::effects::envelope::effect_duration_s;
use era_shared::protocol::{AchievedDrive, ChannelDrive, DetailsReply, Refusal, Reply, Request, WindowSequence};
use era_shared::safety::SafetyState;
use era_shared::supply::rail_index_of_channel;
use era_shared::waveform::Effect;
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
    /// Plays an effect from `start` on, and as soon as it can if it came too late for that: nothing has begun then. It does where a frame was lost and
    /// repeated, or where the rails take longer.
    pub(super) fn schedule_effect_retrying_if_start_passed(
        &mut self,
        id: u64,
        asked_at: AskedAt,
        start: Option<Instant>,
        schedule: impl Fn(&mut Self, Option<Instant>) -> Result<DriveResult, SessionError>,
    ) -> Result<DriveResult, SessionError> {
        self.check_connected_and_not_stopped_or_interrupted_since(asked_at)?;
        match schedule(self, start) {
            Err(SessionError::Link(LinkError::Refused(Refusal::Start { .. }))) => {
                tracing::info!(
                    plan = id,
                    "the board received the effect after its start time: sending the effect again with a later start"
                );
                self.check_connected_and_not_stopped_or_interrupted_since(asked_at)?;
                schedule(self, None)
            }
            result => result,
        }
    }

    /// Arms if need be, brings the rails up, and gives the board the envelopes with one start.
    pub(super) fn arm_if_needed_await_rails_and_schedule_envelopes(
        &mut self,
        id: u64,
        stop_count: u64,
        (drives, effects): (Vec<ChannelDrive>, Vec<Effect>),
        start: Option<Instant>,
    ) -> Result<DriveResult, SessionError> {
        let channels: Vec<u8> = drives.iter().map(|drive| drive.channel).collect();
        let prepare = Request::Prepare { drives: drives.into_iter().take(era_shared::MAX_CHANNELS).collect() };
        if !self.speaks_version_2_or_later() {
            let spoken = self.client.as_ref().map_or(0, Client::protocol_version);
            return Err(LinkError::TooOld { request: "play", needed: prepare.introduced_in_version(), spoken }.into());
        }
        self.check_board_fits_and_needs_no_manual_arming()?;
        if self.begin_arming_if_needed_and_is_self_test_pending()? {
            self.await_armed_or_stop_board(stop_count)?;
        }
        let Reply::Prepared { achieved } = self.request_from_device_or_stop_it_instead(&prepare)? else {
            return Err(unexpected_reply_error("prepare").into());
        };
        self.drive_id = id;
        self.publish_acknowledged_state(SafetyState::Running);
        // Whatever comes in between, these drives end.
        self.drive_until = Some(Instant::now() + self.device.timing().arming);
        self.await_rail_voltages_or_go_on_after_arming_time(&achieved, stop_count)?;
        // Fresh, so that the start is right to a round trip even with a clock that cannot be followed.
        self.request_clock_sample_and_publish_quality_if_supported()?;
        let soonest = Instant::now() + self.lead_time_for_frames(achieved.len());
        let start = start.map_or(soonest, |start| start.max(soonest));
        let start_us = self.clock.board_time_us_at(start).ok_or_else(|| unexpected_reply_error("clock"))?;
        let mut length = Duration::ZERO;
        for (channel, effect) in channels.into_iter().zip(effects) {
            let period_s = achieved.iter().find(|drive| drive.channel == channel).map_or(0.0, period_s);
            length =
                length.max(Duration::try_from_secs_f64(effect_duration_s(&effect, period_s)).unwrap_or(Duration::MAX));
            // A board that knows numbers does not play a request again that was repeated because its answer was lost.
            let play = if self.speaks_version_or_later(4) {
                self.play_number = self.play_number.wrapping_add(1);
                Request::PlayOnce { number: self.play_number, channel, start_us, effect }
            } else {
                Request::Play { channel, start_us, effect }
            };
            if let Err(error) = self.request_from_device_or_stop_it_instead(&play) {
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
        Ok(DriveResult { achieved: achieved.to_vec(), effect: Some(EffectTimes { start_us, start, length }) })
    }

    /// Arms if need be and gives the board a burst of single windows, which begins at `start`, or as soon as the rails have its voltages.
    pub(super) fn arm_if_needed_and_play_windows(
        &mut self,
        id: u64,
        stop_count: u64,
        mut sequence: WindowSequence,
        start: Option<Instant>,
    ) -> Result<DriveResult, SessionError> {
        self.play_number = self.play_number.wrapping_add(1);
        sequence.number = self.play_number;
        let start = start.filter(|start| *start > Instant::now());
        sequence.start_us = start.and_then(|start| self.clock.board_time_us_at(start)).unwrap_or(0);
        let length = sequence_duration(&sequence);
        let play = Request::PlayWindows(sequence);
        let needed = play.introduced_in_version();
        if !self.speaks_version_or_later(needed) {
            let spoken = self.client.as_ref().map_or(0, Client::protocol_version);
            return Err(LinkError::TooOld { request: "play-windows", needed, spoken }.into());
        }
        self.check_board_fits_and_needs_no_manual_arming()?;
        if self.begin_arming_if_needed_and_is_self_test_pending()? {
            self.await_armed_or_stop_board(stop_count)?;
        }
        // Windows end by themselves; what is driven until then is not changed by a refusal.
        let Reply::WindowsPlaying { start_us } = self.request_from_device_or_stop_it_instead(&play)? else {
            return Err(unexpected_reply_error("play-windows").into());
        };
        self.drive_id = id;
        self.publish_acknowledged_state(SafetyState::Running);
        self.request_clock_sample_and_publish_quality_if_supported()?;
        let now = Instant::now();
        let board_us = self.clock.board_time_us_at(now).ok_or_else(|| unexpected_reply_error("clock"))?;
        let start = now + Duration::from_micros(start_us.saturating_sub(board_us));
        let end = start + length + AFTER;
        (self.drive_until, self.idle_since) = (Some(end), end);
        Ok(DriveResult { achieved: Vec::new(), effect: Some(EffectTimes { start_us, start, length }) })
    }

    /// Charges the rails to the voltage at which they stand ready, so that a first effect does not wait for their soft start. Silent drives bring them up,
    /// and a rail that feeds nobody stays charged: no electrode is on meanwhile, and they come down when the idle time ends. Rails that
    /// drives are on are left alone.
    pub(super) fn precharge_rails_unless_driven(&mut self) -> Result<(), SessionError> {
        if !self.speaks_version_2_or_later() || self.drive_until.is_some() {
            return Ok(());
        }
        let drives = self
            .publish
            .borrow()
            .identity
            .as_ref()
            .map(|board| self.needs.make_drives_to_prepare_without_playing_at_standby_voltages(board))
            .unwrap_or_default();
        match self.request_from_device_or_stop_it_instead(&Request::Prepare { drives }).and_then(|_| self.end_drives())
        {
            // Channels have to rest: they rise with the first touch.
            Err(LinkError::Refused(Refusal::Duty { .. })) => Ok(()),
            raised => Ok(raised?),
        }
    }

    /// Waits until the rails have the voltages of the drives, as an effect does not wait for them: the soft start to 2 kV takes
    /// 100 ms. The board itself sees to rails that do not come.
    fn await_rail_voltages_or_go_on_after_arming_time(
        &mut self,
        drives: &[AchievedDrive],
        stop_count: u64,
    ) -> Result<(), SessionError> {
        let begun = Instant::now();
        while begun.elapsed() < self.device.timing().arming {
            self.check_not_stopped_since(stop_count)?;
            let DetailsReply { state, rail_millivolts: measured, .. } = self.request_details()?;
            if !state.is_live() {
                self.refresh_all_parts_of_snapshot()?;
                self.check_no_fault_latched_in_snapshot()?;
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
        let clock =
            self.clock.quality_if_two_samples().map_or(0.0, |quality| quality.residual_worst_s.min(CLOCK_ERROR_S));
        let frames = u32::try_from(frame_count).unwrap_or(u32::MAX);
        median * frames + worst + Duration::from_secs_f64(clock) + LEAD
    }
}

/// From the beginning of a sequence to the end of its last window.
fn sequence_duration(sequence: &WindowSequence) -> Duration {
    let mut ends_ticks = [0_u64; era_shared::MAX_CHANNELS];
    for window in &sequence.windows {
        if let Some(end) = ends_ticks.get_mut(usize::from(window.channel)) {
            *end += u64::from(window.wait_ticks) + u64::from(window.width_ticks);
        }
    }
    Duration::from_nanos(100 * ends_ticks.into_iter().max().unwrap_or(0))
}

/// Length of a drive's period in s.
#[expect(clippy::cast_precision_loss, reason = "nanohertz up to 1e12 are exact in an f64")]
fn period_s(drive: &AchievedDrive) -> f64 {
    1e9 / drive.frequency_nanohertz.max(1) as f64
}

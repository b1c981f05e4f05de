//! What each request does.

use super::{Device, Goals};
use crate::MAX_CHANNELS;
use crate::board::Board;
use crate::limits::{
    BURST_DEFAULT_MS, BURST_MAX_MS, DEADMAN_DEFAULT_MS, DEADMAN_MAX_MS, DEADMAN_MIN_MS, MAX_AVERAGE_MICROAMPS,
};
use crate::protocol::{
    AchievedDrive, BOOTLOADER_KEY, CURRENT_VERSION, ChannelCredit, ChannelDrive, ChannelStatus, ChargeRule,
    CreditReply, DetailsReply, FaultCode, HelloReply, LOG_CHUNK, MIN_VERSION, Refusal, Reply, Request, StatusReply,
    TelemetryReply, WelcomeReply,
};
use crate::safety::{DriveBudget, LinkId, SafetyEvent};
use crate::supply::{
    SensorReadings, encode_first_charged_rail_as_fault_detail_if_any, mean_current_of_drives_and_bleeders_microamps,
};
use crate::waveform::{ChannelGoal, DriveError, Effect, compute_channel_program};
use heapless::Vec;

/// An effect may be asked for this long after its start, in us: the host's view of the board's clock is never that wrong.
const LATEST_US: u64 = 100_000;
/// And this long before.
const EARLIEST_US: u64 = 10_000_000;
/// The shortest burst that can be asked for, in ms.
const BURST_MIN_MS: u16 = 1;

impl Device {
    pub(super) fn do_due_work_answer_request_and_note_sign_of_life(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        request: &Request,
        version: u8,
    ) -> Result<Reply, Refusal> {
        // Silence that has lasted too long is acted on before the frame that ends it: a late keep-alive must not
        // revive a drive.
        self.do_due_work_and_tell_next_due_us(board);
        let now_us = board.now_us();
        let result = self.carry_out_request(board, link, request, version, now_us);
        if result.is_ok() {
            // A host whose requests make no sense is none that looks after a drive.
            self.safety.note_sign_of_life_if_link_has_armed(link, now_us);
        }
        result
    }

    fn carry_out_request(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        request: &Request,
        version: u8,
        now_us: u64,
    ) -> Result<Reply, Refusal> {
        match request {
            Request::Hello { .. } if version >= 2 => Ok(Reply::Welcome(build_welcome_reply_to_hello(board))),
            Request::Hello { .. } => Ok(Reply::Hello(build_hello_reply(board))),
            Request::Arm { deadman_ms } => {
                let (deadman_ms, _) = self.arm_and_open_session(board, link, *deadman_ms, None, now_us)?;
                Ok(Reply::Armed { deadman_ms })
            }
            Request::ArmWith { deadman_ms, burst_ms } => {
                let (deadman_ms, burst_ms) = self.arm_and_open_session(board, link, *deadman_ms, *burst_ms, now_us)?;
                Ok(Reply::ArmedWith { deadman_ms, burst_ms })
            }
            Request::Disarm => {
                self.handle_safety_event(board, SafetyEvent::Disarm, &Goals::default()).map(|()| Reply::Disarmed)
            }
            Request::SetDrives { drives } => self
                .replace_drives_of_all_channels(board, link, drives, true)
                .map(|achieved| Reply::DrivesSet { achieved }),
            Request::Prepare { drives } => self
                .replace_drives_of_all_channels(board, link, drives, false)
                .map(|achieved| Reply::Prepared { achieved }),
            Request::Play { channel, start_us, effect } => {
                self.queue_effect_and_write_due_preloads(board, link, *channel, *start_us, effect, now_us)
            }
            Request::PlayOnce { number, channel, start_us, effect } => {
                if self.look_up_played_number_with_start_us_if_window_sequence(link, *number) == Some(None) {
                    return Ok(Reply::Playing);
                }
                let reply =
                    self.queue_effect_and_write_due_preloads(board, link, *channel, *start_us, effect, now_us)?;
                self.remember_played(link, *number, None);
                Ok(reply)
            }
            Request::PlayWindows(sequence) => {
                if let Some(Some(start_us)) =
                    self.look_up_played_number_with_start_us_if_window_sequence(link, sequence.number)
                {
                    return Ok(Reply::WindowsPlaying { start_us });
                }
                let start_us = self.play_window_sequence_and_get_start_us(board, link, sequence, now_us)?;
                self.remember_played(link, sequence.number, Some(start_us));
                Ok(Reply::WindowsPlaying { start_us })
            }
            Request::NumberedFault => Ok(Reply::NumberedFault {
                number: self.safety.sequence_number_of_last_latched_fault(),
                latched: self.safety.fault(),
            }),
            Request::ClearFault { number }
                if self.safety.fault().is_some() && *number != self.safety.sequence_number_of_last_latched_fault() =>
            {
                Err(Refusal::OtherFault { number: self.safety.sequence_number_of_last_latched_fault() })
            }
            Request::ClearFault { .. } => self.clear_fault(board),
            Request::Stop => {
                self.handle_safety_event(board, SafetyEvent::Stop, &Goals::default()).map(|()| Reply::Stopped)
            }
            Request::KeepAlive => Ok(Reply::Alive { state: self.state() }),
            Request::Status => Ok(Reply::Status(self.build_status_reply(board, now_us))),
            Request::Faults => Ok(Reply::Faults { latched: self.safety.fault() }),
            Request::ClearFaults => self.clear_fault(board),
            Request::Telemetry => {
                Ok(Reply::Telemetry(self.build_telemetry_of_drive_voltages_and_peak_acceleration(board, now_us)))
            }
            Request::Clock => Ok(Reply::Clock { now_us: board.now_us() }),
            Request::Details => Ok(Reply::Details(self.build_measurements_reply_latching_trip(board))),
            Request::Log => {
                let mut chunk = [0; LOG_CHUNK];
                let count = board.take_log_bytes(&mut chunk).min(LOG_CHUNK);
                Ok(Reply::Log { bytes: chunk.iter().take(count).copied().collect() })
            }
            Request::Bootloader { key } if *key == BOOTLOADER_KEY => {
                // In its bootloader the chip no longer holds what keeps the rails low, nor measures them.
                let readings = self.read_sensors_and_latch_trip(board)?;
                if self.state().is_live()
                    || encode_first_charged_rail_as_fault_detail_if_any(&readings).is_some()
                    || self.is_rail_measurement_distrusted(now_us)
                {
                    return Err(Refusal::Live(self.state()));
                }
                self.handle_safety_event(board, SafetyEvent::Stop, &Goals::default())?;
                self.restarting = true;
                board.request_bootloader_restart();
                Ok(Reply::Bootloader)
            }
            Request::Bootloader { .. } => Err(Refusal::Malformed),
            Request::Credit => Ok(Reply::Credit(self.build_credit_reply(board.info().channels.len()))),
        }
    }

    fn arm_and_open_session(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        deadman_ms: Option<u16>,
        burst_ms: Option<u16>,
        now_us: u64,
    ) -> Result<(u16, u16), Refusal> {
        if self.restarting {
            return Err(Refusal::Restarting);
        }
        if self.safety.is_armed_by_other_link(link) {
            return Err(Refusal::OtherLink);
        }
        let deadman_ms = deadman_ms.unwrap_or(DEADMAN_DEFAULT_MS);
        if !(DEADMAN_MIN_MS..=DEADMAN_MAX_MS).contains(&deadman_ms) {
            return Err(Refusal::Deadman { requested_ms: deadman_ms, min_ms: DEADMAN_MIN_MS, max_ms: DEADMAN_MAX_MS });
        }
        let burst_ms = burst_ms.unwrap_or(BURST_DEFAULT_MS);
        if !(BURST_MIN_MS..=BURST_MAX_MS).contains(&burst_ms) {
            return Err(Refusal::Burst { requested_ms: burst_ms, min_ms: BURST_MIN_MS, max_ms: BURST_MAX_MS });
        }
        self.handle_safety_event(board, SafetyEvent::Arm, &Goals::default())?;
        self.safety.open_session(link, deadman_ms, now_us);
        self.budget.set_burst_limit(burst_ms);
        Ok((deadman_ms, burst_ms))
    }

    fn replace_drives_of_all_channels(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        drives: &[ChannelDrive],
        drives_without_envelope: bool,
    ) -> Result<Vec<AchievedDrive, MAX_CHANNELS>, Refusal> {
        if self.safety.is_armed_by_other_link(link) {
            return Err(Refusal::OtherLink);
        }
        // All are computed and checked before any is applied.
        let mut goals = Goals::default();
        let mut achieved = Vec::new();
        let limits = &board.info().channels;
        for drive in drives {
            let refuse = |error| Refusal::Drive { channel: drive.channel, error };
            let channels = u8::try_from(limits.len()).unwrap_or(u8::MAX);
            let no_such_channel = DriveError::NoSuchChannel { channels };
            let index = usize::from(drive.channel);
            let limit = limits.get(index).ok_or(refuse(no_such_channel))?;
            let place = goals.get_mut(index).ok_or(refuse(no_such_channel))?;
            if place.is_some() {
                return Err(Refusal::DuplicateChannel { channel: drive.channel });
            }
            let program = compute_channel_program(limit, drive).map_err(refuse)?;
            if let Some(wait_ms) = self.budget.required_wait_ms(index) {
                return Err(Refusal::Duty { channel: drive.channel, wait_ms });
            }
            *place = Some(ChannelGoal { program, drives_without_envelope });
            // As long as `drives`, which has the same capacity.
            let _ = achieved.push(program.achieved);
        }
        // What the supply cannot deliver would end in a fault after some ms.
        let driven = goals.iter().enumerate().filter_map(|(channel, goal)| {
            // A drive without voltage has no windows, even if another drive brings its rail up.
            let program = &goal.as_ref().filter(|goal| goal.program.voltage_millivolts > 0)?.program;
            Some((channel, program.achieved.frequency_nanohertz))
        });
        let requested_microamps = mean_current_of_drives_and_bleeders_microamps(
            self.rail_target_millivolts_for_goals_keeping_unused(&goals),
            driven,
        );
        if requested_microamps > MAX_AVERAGE_MICROAMPS && !drives.is_empty() {
            return Err(Refusal::Current { requested_microamps, max_microamps: MAX_AVERAGE_MICROAMPS });
        }
        let event = if drives.is_empty() { SafetyEvent::Rest } else { SafetyEvent::Drive };
        self.handle_safety_event(board, event, &goals)?;
        Ok(achieved)
    }

    fn queue_effect_and_write_due_preloads(
        &mut self,
        board: &mut impl Board,
        link: LinkId,
        channel: u8,
        start_us: u64,
        effect: &Effect,
        now_us: u64,
    ) -> Result<Reply, Refusal> {
        if self.safety.is_armed_by_other_link(link) {
            return Err(Refusal::OtherLink);
        }
        if !effect.is_valid() {
            return Err(Refusal::Effect);
        }
        let start_us = match start_us {
            0 => {
                let end_us = self.sequencer.as_ref().and_then(|it| it.envelopes_end_us(usize::from(channel)));
                end_us.map_or(now_us, |end_us| end_us.max(now_us))
            }
            asked => asked,
        };
        if start_us.saturating_add(LATEST_US) < now_us || start_us > now_us.saturating_add(EARLIEST_US) {
            return Err(Refusal::Start { start_us, now_us });
        }
        let index = usize::from(channel);
        if let Some(wait_ms) = self.budget.required_wait_ms(index) {
            return Err(Refusal::Duty { channel, wait_ms });
        }
        let state = self.state();
        let not_now = Refusal::State { state, event: SafetyEvent::Drive };
        let sequencer = self.sequencer.as_mut().ok_or(not_now)?;
        if sequencer.goal(index).is_none() {
            return Err(Refusal::NoDrive { channel });
        }
        if !sequencer.queue_effect_if_goal_and_queue_not_full(index, start_us, effect) {
            return Err(Refusal::QueueFull { channel });
        }
        self.write_due_preloads_and_check_no_window_was_missed(board).map_err(|(code, detail)| {
            self.switch_all_off_and_latch_fault(board, code, detail, now_us);
            self.safety.fault().map_or(Refusal::Malformed, Refusal::Fault)
        })?;
        Ok(Reply::Playing)
    }

    fn look_up_played_number_with_start_us_if_window_sequence(&self, link: LinkId, number: u32) -> Option<Option<u64>> {
        let mut newest_first = self.played.iter().rev();
        newest_first.find(|(by, played, _)| (*by, *played) == (link, number)).map(|(_, _, start_us)| *start_us)
    }

    fn remember_played(&mut self, link: LinkId, number: u32, start_us: Option<u64>) {
        if self.played.is_full() {
            let _ = self.played.pop_front();
        }
        // There is room now.
        let _ = self.played.push_back((link, number, start_us));
    }

    /// The sensors' readings. What has tripped is told once, so that it is latched here and not lost to a request.
    fn read_sensors_and_latch_trip(&mut self, board: &mut impl Board) -> Result<SensorReadings, Refusal> {
        let readings = board.read_sensors_and_take_trip();
        if let Some((code, detail)) = readings.trip {
            let now_us = board.now_us();
            self.switch_all_off_and_latch_fault(board, code, detail, now_us);
            return Err(Refusal::StillThere(code));
        }
        Ok(readings)
    }

    fn clear_fault(&mut self, board: &mut impl Board) -> Result<Reply, Refusal> {
        if let Some(fault) = self.safety.fault() {
            let readings = self.read_sensors_and_latch_trip(board)?;
            if let Some((code, _)) = readings.standing_fault {
                return Err(Refusal::StillThere(code));
            }
            let still_there = match fault.code {
                FaultCode::InterlockOpen => !readings.interlock_closed,
                FaultCode::EmergencyStop => !readings.stop_released,
                FaultCode::EarthOpen => !readings.earth_bonded,
                FaultCode::Reference => {
                    self.reference.update_and_find_lasting_reference_fault(board.now_us(), &readings).is_some()
                }
                FaultCode::OverCurrent
                | FaultCode::OverVoltage
                | FaultCode::RailImplausible
                | FaultCode::RailCollapsed
                | FaultCode::DischargeFailed
                | FaultCode::DischargeSlow
                | FaultCode::ShortCircuit => encode_first_charged_rail_as_fault_detail_if_any(&readings).is_some(),
                _ => false,
            };
            if still_there {
                return Err(Refusal::StillThere(fault.code));
            }
            if let Some(_charged) = encode_first_charged_rail_as_fault_detail_if_any(&readings) {
                // Also where another fault came first.
                if self.still_charged {
                    return Err(Refusal::StillThere(FaultCode::DischargeFailed));
                }
                if self.discharges_slowly {
                    return Err(Refusal::StillThere(FaultCode::DischargeSlow));
                }
            }
        }
        self.handle_safety_event(board, SafetyEvent::Clear, &Goals::default()).map(|()| Reply::FaultsCleared)
    }

    fn build_status_reply(&self, board: &impl Board, uptime_us: u64) -> StatusReply {
        let info = board.info();
        StatusReply {
            state: self.state(),
            uptime_us,
            boot_id: info.boot_id,
            fault: self.safety.fault(),
            channels: self
                .active
                .iter()
                .take(info.channels.len())
                .map(|drive| ChannelStatus { drive: *drive })
                .collect(),
            link: self.counters,
        }
    }

    fn build_telemetry_of_drive_voltages_and_peak_acceleration(
        &mut self,
        board: &mut impl Board,
        uptime_us: u64,
    ) -> TelemetryReply {
        let millivolts = |drive: &Option<AchievedDrive>| drive.map_or(0, |drive| drive.voltage_millivolts);
        TelemetryReply {
            uptime_us,
            state: self.state(),
            acceleration_peak_mm_per_s2: board.take_peak_acceleration_mm_per_s2_if_sensor_exists(),
            rail_millivolts: self.active.iter().take(board.info().channels.len()).map(millivolts).collect(),
        }
    }

    fn build_credit_reply(&self, channel_count: usize) -> CreditReply {
        let credit = |channel| ChannelCredit {
            left_ms: self.budget.remaining_credit_ms(channel),
            charge_ppm: self.budget.last_credit_charge_rate(channel).as_ppm(),
        };
        CreditReply {
            rule: ChargeRule::ForceSquared,
            earned_ppm: DriveBudget::EARNED_PPM,
            channels: (0..channel_count.min(MAX_CHANNELS)).map(credit).collect(),
        }
    }

    fn build_measurements_reply_latching_trip(&mut self, board: &mut impl Board) -> DetailsReply {
        let readings = board.read_sensors_and_take_trip();
        if let Some((code, detail)) = readings.trip {
            // What tripped is told once; it must not be lost to a question.
            let now_us = board.now_us();
            self.switch_all_off_and_latch_fault(board, code, detail, now_us);
        }
        DetailsReply {
            state: self.state(),
            set_point_millivolts: self.supply.set_point_millivolts,
            rail_millivolts: readings.rail_millivolts,
            average_microamps: readings.average_microamps,
            interlock_closed: readings.interlock_closed,
            stop_released: readings.stop_released,
            earth_bonded: readings.earth_bonded,
            credit_ms: (0..board.info().channels.len())
                .map(|channel| self.budget.remaining_credit_ms(channel))
                .collect(),
        }
    }
}

fn build_hello_reply(board: &impl Board) -> HelloReply {
    let info = board.info();
    HelloReply {
        protocol_min: MIN_VERSION,
        protocol_current: CURRENT_VERSION,
        board: info.board,
        board_id: info.board_id,
        boot_id: info.boot_id,
        reset_cause: info.reset_cause,
        firmware: info.firmware,
        channels: info.channels.clone(),
        default_deadman_ms: DEADMAN_DEFAULT_MS,
    }
}

fn build_welcome_reply_to_hello(board: &impl Board) -> WelcomeReply {
    let info = board.info();
    WelcomeReply {
        protocol_min: MIN_VERSION,
        protocol_current: CURRENT_VERSION,
        board: info.board,
        board_id: info.board_id,
        boot_id: info.boot_id,
        reset_cause: info.reset_cause,
        image: info.image.clone(),
        firmware: info.firmware,
        channels: info.channels.clone(),
        failure: info.failure.clone(),
    }
}

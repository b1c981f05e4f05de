//! A board that remembers what it was told, and a host that talks to a device over it.
#![allow(dead_code, reason = "each test program uses a part of this")]

pub mod circuit;
pub mod golden;

use circuit::Circuit;
use era_shared::board::{Board, BoardInfo, KeptRun};
use era_shared::device::{Device, LinkReceiver};
use era_shared::limits::{TEST_PAUSE_MICROSECONDS, TEST_PULSE_MICROSECONDS, TEST_PULSES};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::safety::{ElectrodePulses, SafetyState};
use era_shared::supply::{RAILS, SensorReadings, SupplyCommand};
use era_shared::waveform::{Electrode, IDLE, TimerPeriod, TimerPreload};

/// Limits as the STM32G474 board reports them.
pub fn make_channel_limits() -> ChannelLimits {
    ChannelLimits {
        min_frequency_millihertz: 1_000,
        max_frequency_millihertz: 1_000_000,
        max_voltage_millivolts: 2_000_000,
        min_guard_ns: 200_000,
        timer_clock_hz: 170_000_000,
    }
}

/// How many random cases a property gets: an interpreter that checks every access is a thousand times slower.
pub const fn reduce_case_count_under_miri(many: u32) -> u32 {
    if cfg!(miri) { 10 } else { many }
}

/// After this many ms the self-test of a sound board has passed, its rails discharged before.
pub const ARMING_MS: u64 = 95;
/// After this many ms a rail of a sound board is discharged.
pub const DISCHARGE_MS: u64 = 10;

/// 150 Hz, 2/3 wide, 1 kV.
pub fn make_drive(channel: u8) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz: 150_000,
        pulse_width_ppm: 666_667,
        phase_microturns: 0,
        voltage_millivolts: 1_000_000,
    }
}

/// Sets the first two channels' drives.
pub fn make_two_drives_request() -> Request {
    Request::SetDrives { drives: heapless::Vec::from_slice(&[make_drive(0), make_drive(1)]).unwrap() }
}

pub fn make_arm_request() -> Request {
    Request::Arm { deadman_ms: None }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Did {
    Off,
    TestTrips,
    TestInputs([bool; RAILS]),
    Pulse(usize, Electrode),
    Start,
    Connect(bool),
}

/// A board that remembers, with the circuit of a sound board, unless told otherwise.
pub struct FakeBoard {
    pub info: BoardInfo,
    pub now_us: u64,
    pub log: Vec<Did>,
    pub supply: SupplyCommand,
    /// The timers run since this time.
    pub started_us: Option<u64>,
    pub connected: bool,
    /// Everything that was preloaded since the timers started, in order.
    pub preloads: Vec<TimerPreload>,
    pub fail_trips: bool,
    pub fail_start: bool,
    pub fail_preload: bool,
    pub stopped_timer: Option<u32>,
    pub interlock_closed: bool,
    pub stop_released: bool,
    pub loop_millivolts: [u32; 2],
    pub earth_bonded: bool,
    /// What flows besides what the circuit takes, in uA.
    pub more_microamps: u32,
    pub trip: Option<(FaultCode, u32)>,
    /// What the board finds wrong with itself.
    pub standing_fault: Option<(FaultCode, u32)>,
    /// What the rails show, where it is not what they have.
    pub rails_show: [Option<u32>; RAILS],
    /// What the chip's own reference shows of its supply.
    pub reference_millivolts: u32,
    /// What the board has kept for its next start.
    pub kept: Option<KeptRun>,
    pub circuit: Circuit,
    /// The measurements of the rails are exchanged.
    pub crossed_rails: bool,
    /// The comparators' inputs do not see the rails.
    pub dead_over_voltage: bool,
    pub bootloader: bool,
}

impl FakeBoard {
    pub fn new() -> Self {
        let channels = heapless::Vec::from_slice(&[make_channel_limits(); 4]).unwrap();
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: *b"golden-board",
                boot_id: 7,
                reset_cause: ResetCause::PowerOn,
                image: "fake".try_into().unwrap(),
                firmware: FirmwareVersion { major: 0, minor: 1, patch: 0, commit: *b"00000000" },
                channels,
                fault_before_reset: None,
                failure: heapless::String::new(),
                kept_before_reset: None,
            },
            now_us: 1_000,
            log: Vec::new(),
            supply: SupplyCommand { enabled: true, ..SupplyCommand::default() },
            started_us: None,
            connected: false,
            preloads: Vec::new(),
            fail_trips: false,
            fail_start: false,
            fail_preload: false,
            stopped_timer: None,
            interlock_closed: true,
            stop_released: true,
            loop_millivolts: [2_185; 2],
            earth_bonded: true,
            more_microamps: 0,
            trip: None,
            standing_fault: None,
            rails_show: [None; RAILS],
            reference_millivolts: 3_300,
            kept: None,
            circuit: Circuit::new(1_000),
            crossed_rails: false,
            dead_over_voltage: false,
            bootloader: false,
        }
    }

    /// Lets the circuit go on to now, as it was told last.
    fn advance_circuit(&mut self) {
        self.circuit.advance_to_time(self.now_us, &self.supply, self.started_us, self.connected);
    }

    fn shown_millivolts(&self, rail: usize) -> u32 {
        let measured = if self.crossed_rails { 1 - rail } else { rail };
        self.rails_show[rail].unwrap_or(self.circuit.rails[measured].round() as u32)
    }

    /// Whether anything could be at high voltage.
    pub fn is_live(&self) -> bool {
        self.supply.enabled || self.connected || self.started_us.is_some()
    }

    /// What a channel's timer does from now on, as far as it is known.
    pub fn find_latest_period(&self, channel: usize) -> TimerPeriod {
        self.preloads.iter().rev().find(|preload| preload.channel == channel).map_or(IDLE, |preload| preload.period)
    }

    pub fn is_any_channel_driven(&self) -> bool {
        (0..4).any(|channel| !self.find_latest_period(channel).has_no_windows())
    }
}

impl Board for FakeBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }
    fn now_us(&mut self) -> u64 {
        self.now_us
    }
    fn switch_outputs_off(&mut self) {
        self.log.push(Did::Off);
        self.advance_circuit();
        self.started_us = None;
        self.connected = false;
        self.preloads.clear();
        self.circuit.stop_timers();
        self.circuit.set_held_electrode(None);
        self.supply = SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() };
    }
    fn read_sensors_and_take_trip(&mut self) -> SensorReadings {
        self.advance_circuit();
        SensorReadings {
            rail_millivolts: [self.shown_millivolts(0), self.shown_millivolts(1)],
            average_microamps: self.more_microamps + self.circuit.measured_microamps().floor() as u32,
            interlock_closed: self.interlock_closed,
            stop_released: self.stop_released,
            interlock_millivolts: self.loop_millivolts[0],
            stop_millivolts: self.loop_millivolts[1],
            earth_bonded: self.earth_bonded,
            reference_millivolts: self.reference_millivolts,
            trip: self.trip.take(),
            standing_fault: self.standing_fault,
        }
    }
    fn test_trip_circuits(&mut self) -> Result<(), (FaultCode, u32)> {
        self.log.push(Did::TestTrips);
        assert!(!self.connected && !self.supply.enabled, "tripped with something live");
        if self.fail_trips { Err((FaultCode::SelfTest, 3)) } else { Ok(()) }
    }
    fn test_over_voltage_inputs(&mut self, charged: [bool; RAILS]) -> Result<(), (FaultCode, u32)> {
        self.log.push(Did::TestInputs(charged));
        self.advance_circuit();
        let trips = self.circuit.rails.map(|millivolts| millivolts > 25_000.0 && !self.dead_over_voltage);
        if trips == charged { Ok(()) } else { Err((FaultCode::SelfTest, 3_000)) }
    }
    fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        electrode: Electrode,
    ) -> Result<ElectrodePulses, (FaultCode, u32)> {
        self.log.push(Did::Pulse(channel, electrode));
        assert!(self.started_us.is_none() && !self.supply.enabled, "an electrode tried with something else live");
        assert!(self.supply.permitted, "an electrode tried without the permit");
        let mut seen = Vec::new();
        for _ in 0..TEST_PULSES {
            for (held, us) in [(Some((channel, electrode)), TEST_PULSE_MICROSECONDS), (None, TEST_PAUSE_MICROSECONDS)] {
                self.advance_circuit();
                self.circuit.set_held_electrode(held);
                self.now_us += u64::from(us);
            }
            self.advance_circuit();
            seen.push(self.shown_millivolts(channel % RAILS));
        }
        let (after_first_millivolts, after_last_millivolts) = (seen[0], *seen.last().unwrap());
        Ok(ElectrodePulses { after_first_millivolts, after_last_millivolts })
    }
    fn store_run_record_for_next_boot(&mut self, run: KeptRun) {
        self.kept = Some(run);
    }
    fn apply_supply_command(&mut self, supply: &SupplyCommand) {
        self.advance_circuit();
        self.supply = *supply;
    }
    fn start_timers(&mut self) -> Result<(), FaultCode> {
        self.log.push(Did::Start);
        assert!(!self.connected, "timers started with electrodes connected");
        if self.fail_start {
            return Err(FaultCode::ArmFailed);
        }
        self.advance_circuit();
        self.started_us = Some(self.now_us);
        Ok(())
    }
    fn set_timers_connected_to_electrodes(&mut self, connected: bool) -> Result<(), FaultCode> {
        self.log.push(Did::Connect(connected));
        assert!(self.started_us.is_some(), "electrodes connected to timers that do not run");
        self.advance_circuit();
        self.connected = connected;
        Ok(())
    }
    fn write_preload_and_check_read_back(&mut self, preload: &TimerPreload) -> Result<(), FaultCode> {
        let started_us = self.started_us.expect("preloaded a timer that does not run");
        assert!(preload.at >= (self.now_us - started_us + 50) * 170, "preloaded too near to its boundary");
        assert!(self.connected || preload.period.has_no_windows(), "windows for electrodes that are not connected");
        if self.fail_preload {
            return Err(FaultCode::ReadBack);
        }
        self.advance_circuit();
        self.circuit.schedule_preload(preload);
        self.preloads.push(*preload);
        Ok(())
    }
    fn check_timers_still_count_and_hold_settings(&mut self) -> Result<(), (FaultCode, u32)> {
        match self.stopped_timer {
            Some(channel) => Err((FaultCode::TimerStopped, channel)),
            None => Ok(()),
        }
    }
    fn take_peak_acceleration_mm_per_s2_if_sensor_exists(&mut self) -> Option<u32> {
        None
    }
    fn take_log_bytes(&mut self, out: &mut [u8]) -> usize {
        out[..3].copy_from_slice(b"log");
        3
    }
    fn request_bootloader_restart(&mut self) {
        assert!(!self.is_live(), "left for the bootloader while live");
        self.bootloader = true;
    }
}

/// A device, its board and one host on link 0.
pub struct Bench {
    pub device: Device,
    pub board: FakeBoard,
    pub ports: [LinkReceiver; 2],
    sequence: u16,
}

impl Bench {
    pub fn new() -> Self {
        let mut bench = Self {
            device: Device::new(),
            board: FakeBoard::new(),
            ports: LinkReceiver::new_for_each_link(),
            sequence: 0,
        };
        bench.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut bench.board);
        // Rails are seen to be discharged.
        bench.wait_ms(2);
        bench
    }

    /// Arms and waits until it is done.
    pub fn arm_and_await_armed(&mut self) {
        assert_eq!(self.send_request(&Request::Arm { deadman_ms: None }), Reply::Armed { deadman_ms: 250 });
        self.wait_ms(ARMING_MS);
        assert_eq!(self.state(), SafetyState::Armed);
    }

    pub fn send_request(&mut self, request: &Request) -> Reply {
        self.send_request_on_link(0, request)
    }

    pub fn send_request_on_link(&mut self, link: usize, request: &Request) -> Reply {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(CURRENT_VERSION, FrameKind::Request, self.sequence, request, &mut frame).unwrap();
        let answers = self.send_bytes_and_collect_answers(link, &frame[..length]);
        let (version, sequence, reply) = decode_reply(&answers);
        assert_eq!((version, sequence), (CURRENT_VERSION, self.sequence));
        reply
    }

    /// Everything that the device sends back.
    pub fn send_bytes_and_collect_answers(&mut self, link: usize, bytes: &[u8]) -> Vec<u8> {
        let mut answers = Vec::new();
        self.device
            .receive_bytes(&mut self.board, &mut self.ports[link], bytes, |answer| answers.extend_from_slice(answer));
        answers
    }

    pub fn wait_ms(&mut self, ms: u64) {
        for _ in 0..ms {
            let end_us = self.board.now_us + 1_000;
            // As the firmware does: whenever the device wants, and every ms.
            while self.board.now_us < end_us {
                let due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
                // The self-test holds the device up for some ms.
                let next_us = self.board.now_us + 1;
                self.board.now_us = due_us.clamp(next_us, end_us.max(next_us));
            }
            self.device.do_due_work_and_tell_next_due_us(&mut self.board);
        }
    }

    pub fn state(&self) -> SafetyState {
        self.device.state()
    }
}

/// The one reply in `bytes`.
pub fn decode_reply(bytes: &[u8]) -> (u8, u16, Reply) {
    let mut found = Vec::new();
    Decoder::new().feed_bytes(bytes, |result| {
        let frame = result.expect("a good frame");
        assert_eq!(frame.kind, FrameKind::Reply as u8);
        found.push((frame.version, frame.sequence, postcard::from_bytes::<Reply>(frame.body).unwrap()));
    });
    assert_eq!(found.len(), 1, "exactly one answer");
    found.remove(0)
}

//! A board that remembers what it was told, and a host that talks to a device over it.
#![allow(dead_code, reason = "each test file is its own program and uses a part of this")]

pub mod golden;

use era_shared::board::{Board, BoardInfo};
use era_shared::device::{Device, LinkReceiver};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::safety::{LinkId, SafetyState};
use era_shared::supply::{RAILS, SensorReadings, SupplyCommand};
use era_shared::waveform::{IDLE, TimerPeriod, TimerPreload};

/// Limits as the STM32G474 board reports them.
pub fn limits() -> ChannelLimits {
    ChannelLimits {
        min_frequency_millihertz: 1_000,
        max_frequency_millihertz: 1_000_000,
        max_voltage_millivolts: 2_000_000,
        min_guard_ns: 200_000,
        timer_clock_hz: 170_000_000,
    }
}

/// How many random cases a property gets: an interpreter that checks every access is a thousand times slower.
pub const fn cases(many: u32) -> u32 {
    if cfg!(miri) { 10 } else { many }
}

/// 150 Hz, 2/3 wide, 1 kV.
pub fn drive(channel: u8) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz: 150_000,
        pulse_width_ppm: 666_667,
        phase_microturns: 0,
        voltage_millivolts: 1_000_000,
    }
}

/// Sets the first two channels' drives.
pub fn both() -> Request {
    Request::SetDrives { drives: heapless::Vec::from_slice(&[drive(0), drive(1)]).unwrap() }
}

pub fn arm() -> Request {
    Request::Arm { deadman_ms: None }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Did {
    Off,
    TestTrips,
    Start,
    Connect(bool),
}

/// A board that remembers, with rails that follow their set-points at once and discharge at once, unless told otherwise.
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
    pub earth_bonded: bool,
    pub average_microamps: u32,
    pub trip: Option<(FaultCode, u32)>,
    /// What the rails show, where it is not what was set.
    pub rails_show: [Option<u32>; RAILS],
    pub bootloader: bool,
}

impl FakeBoard {
    pub fn new() -> Self {
        let channels = heapless::Vec::from_slice(&[limits(); 4]).unwrap();
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
            earth_bonded: true,
            average_microamps: 0,
            trip: None,
            rails_show: [None; RAILS],
            bootloader: false,
        }
    }

    /// Whether anything could be at high voltage.
    pub fn live(&self) -> bool {
        self.supply.enabled || self.connected || self.started_us.is_some()
    }

    /// What a channel's timer does from now on, as far as it is known.
    pub fn latest(&self, channel: usize) -> TimerPeriod {
        self.preloads.iter().rev().find(|preload| preload.channel == channel).map_or(IDLE, |preload| preload.period)
    }

    pub fn driving(&self) -> bool {
        (0..4).any(|channel| !self.latest(channel).is_blank())
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
        self.started_us = None;
        self.connected = false;
        self.preloads.clear();
        self.supply = SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() };
    }
    fn read_sensors(&mut self) -> SensorReadings {
        let rail = |rail: usize| {
            let driven = self.supply.enabled && !self.supply.discharge[rail];
            self.rails_show[rail].unwrap_or(if driven { self.supply.set_point_millivolts[rail] } else { 0 })
        };
        SensorReadings {
            rail_millivolts: [rail(0), rail(1)],
            average_microamps: self.average_microamps,
            interlock_closed: self.interlock_closed,
            stop_released: self.stop_released,
            earth_bonded: self.earth_bonded,
            trip: self.trip.take(),
        }
    }
    fn test_trip_circuits(&mut self) -> Result<(), (FaultCode, u32)> {
        self.log.push(Did::TestTrips);
        assert!(!self.connected && !self.supply.enabled, "tripped with something live");
        if self.fail_trips { Err((FaultCode::SelfTest, 3)) } else { Ok(()) }
    }
    fn apply_supply_command(&mut self, supply: &SupplyCommand) {
        self.supply = *supply;
    }
    fn start_timers(&mut self) -> Result<(), FaultCode> {
        self.log.push(Did::Start);
        assert!(!self.connected, "timers started with electrodes connected");
        if self.fail_start {
            return Err(FaultCode::ArmFailed);
        }
        self.started_us = Some(self.now_us);
        Ok(())
    }
    fn set_electrodes_connected(&mut self, connected: bool) -> Result<(), FaultCode> {
        self.log.push(Did::Connect(connected));
        assert!(self.started_us.is_some(), "electrodes connected to timers that do not run");
        self.connected = connected;
        Ok(())
    }
    fn write_preload(&mut self, preload: &TimerPreload) -> Result<(), FaultCode> {
        let started_us = self.started_us.expect("preloaded a timer that does not run");
        assert!(preload.at >= (self.now_us - started_us + 50) * 170, "preloaded too near to its boundary");
        assert!(self.connected || preload.period.is_blank(), "windows for electrodes that are not connected");
        if self.fail_preload {
            return Err(FaultCode::ReadBack);
        }
        self.preloads.push(*preload);
        Ok(())
    }
    fn check_timers(&mut self) -> Result<(), (FaultCode, u32)> {
        match self.stopped_timer {
            Some(channel) => Err((FaultCode::TimerStopped, channel)),
            None => Ok(()),
        }
    }
    fn take_peak_acceleration_mm_per_s2(&mut self) -> Option<u32> {
        None
    }
    fn take_log_bytes(&mut self, out: &mut [u8]) -> usize {
        out[..3].copy_from_slice(b"log");
        3
    }
    fn request_bootloader_restart(&mut self) {
        assert!(!self.live(), "left for the bootloader while live");
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
            ports: [LinkReceiver::new(LinkId(0)), LinkReceiver::new(LinkId(1))],
            sequence: 0,
        };
        bench.device.complete_boot(&mut bench.board);
        // Rails are seen to be discharged.
        bench.wait_ms(2);
        bench
    }

    /// Arms and waits until it is done.
    pub fn arm(&mut self) {
        assert_eq!(self.ask(&Request::Arm { deadman_ms: None }), Reply::Armed { deadman_ms: 250 });
        self.wait_ms(10);
        assert_eq!(self.state(), SafetyState::Armed);
    }

    pub fn ask(&mut self, request: &Request) -> Reply {
        self.ask_on(0, request)
    }

    pub fn ask_on(&mut self, link: usize, request: &Request) -> Reply {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(CURRENT_VERSION, FrameKind::Request, self.sequence, request, &mut frame).unwrap();
        let answers = self.raw(link, &frame[..length]);
        let (version, sequence, reply) = decode_reply(&answers);
        assert_eq!((version, sequence), (CURRENT_VERSION, self.sequence));
        reply
    }

    /// Everything that the device sends back.
    pub fn raw(&mut self, link: usize, bytes: &[u8]) -> Vec<u8> {
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
                let due_us = self.device.poll_next_due_us(&mut self.board);
                self.board.now_us = due_us.clamp(self.board.now_us + 1, end_us);
            }
            self.device.poll_next_due_us(&mut self.board);
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

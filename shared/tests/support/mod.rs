//! A board that remembers what it was told, and a host that talks to a device over it.
#![allow(dead_code, reason = "each test file is its own program and uses a part of this")]

use era_shared::board::{Board, BoardInfo, Measurements, Programs};
use era_shared::device::{Device, Port};
use era_shared::link::{Decoder, Kind, MAX_ENCODED, encode};
use era_shared::protocol::*;
use era_shared::safety::{LinkId, State};

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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Did {
    Off,
    Arm,
    Apply,
}

pub struct FakeBoard {
    pub info: BoardInfo,
    pub now_us: u64,
    pub log: Vec<Did>,
    pub programs: Programs,
    pub live: bool,
    pub fail_arm: bool,
    pub fail_apply: bool,
}

impl FakeBoard {
    pub fn new() -> Self {
        let channels = heapless::Vec::from_slice(&[limits(), limits()]).unwrap();
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: *b"golden-board",
                boot_id: 7,
                reset_cause: ResetCause::PowerOn,
                firmware: FirmwareVersion { major: 0, minor: 1, patch: 0, commit: *b"00000000" },
                channels,
                fault_before_reset: None,
            },
            now_us: 1_000,
            log: Vec::new(),
            programs: Programs::default(),
            live: true,
            fail_arm: false,
            fail_apply: false,
        }
    }
}

impl Board for FakeBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }
    fn now_us(&mut self) -> u64 {
        self.now_us
    }
    fn outputs_off(&mut self) {
        self.log.push(Did::Off);
        self.programs = Programs::default();
        self.live = false;
    }
    fn arm(&mut self) -> Result<(), FaultCode> {
        self.log.push(Did::Arm);
        if self.fail_arm {
            return Err(FaultCode::ArmFailed);
        }
        self.live = true;
        Ok(())
    }
    fn apply(&mut self, programs: &Programs) -> Result<(), FaultCode> {
        self.log.push(Did::Apply);
        assert!(self.live, "drives applied without arming");
        if self.fail_apply {
            return Err(FaultCode::DriveFailed);
        }
        self.programs = *programs;
        Ok(())
    }
    fn measure(&mut self) -> Measurements {
        Measurements::default()
    }
}

/// A device, its board and one host on link 0.
pub struct Bench {
    pub device: Device,
    pub board: FakeBoard,
    pub ports: [Port; 2],
    sequence: u16,
}

impl Bench {
    pub fn new() -> Self {
        let mut bench = Self {
            device: Device::new(),
            board: FakeBoard::new(),
            ports: [Port::new(LinkId(0)), Port::new(LinkId(1))],
            sequence: 0,
        };
        bench.device.start(&mut bench.board);
        bench
    }

    pub fn ask(&mut self, request: &Request) -> Reply {
        self.ask_on(0, request)
    }

    pub fn ask_on(&mut self, link: usize, request: &Request) -> Reply {
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; MAX_ENCODED];
        let length = encode(CURRENT_VERSION, Kind::Request, self.sequence, request, &mut frame).unwrap();
        let answers = self.raw(link, &frame[..length]);
        let (version, sequence, reply) = decode_reply(&answers);
        assert_eq!((version, sequence), (CURRENT_VERSION, self.sequence));
        reply
    }

    /// Everything that the device sends back.
    pub fn raw(&mut self, link: usize, bytes: &[u8]) -> Vec<u8> {
        let mut answers = Vec::new();
        self.device.receive(&mut self.board, &mut self.ports[link], bytes, |answer| answers.extend_from_slice(answer));
        answers
    }

    pub fn wait_ms(&mut self, ms: u64) {
        for _ in 0..ms {
            self.board.now_us += 1_000;
            self.device.poll(&mut self.board);
        }
    }

    pub fn state(&self) -> State {
        self.device.state()
    }
}

/// The one reply in `bytes`.
pub fn decode_reply(bytes: &[u8]) -> (u8, u16, Reply) {
    let mut found = Vec::new();
    Decoder::new().feed(bytes, |result| {
        let frame = result.expect("a good frame");
        assert_eq!(frame.kind, Kind::Reply as u8);
        found.push((frame.version, frame.sequence, postcard::from_bytes::<Reply>(frame.body).unwrap()));
    });
    assert_eq!(found.len(), 1, "exactly one answer");
    found.remove(0)
}

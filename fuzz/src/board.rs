//! A board that panics when it is asked for what must never be asked of a board.

use era_shared::board::{Board, BoardInfo, Measurements, Programs};
use era_shared::protocol::{BoardKind, ChannelLimits, FaultCode, FirmwareVersion, ResetCause};

/// Least guard time that any waveform may have, in ns: the product's floor, whatever the limits of a channel say.
const GUARD_FLOOR_NS: u32 = 50_000;

/// What a fuzzed device drives.
pub struct WatchedBoard {
    info: BoardInfo,
    /// Time since boot.
    pub now_us: u64,
    /// Whether high voltage is enabled. As at power-on it counts as on until it was switched off.
    pub live: bool,
    /// What the channels do.
    pub programs: Programs,
    /// Whether the hardware refuses to be armed.
    pub refuses_arming: bool,
    /// Whether the hardware refuses to be driven.
    pub refuses_drives: bool,
}

impl WatchedBoard {
    /// A board with as many channels as the protocol has room for.
    pub fn new() -> Self {
        let limits = ChannelLimits {
            min_frequency_millihertz: 1_000,
            max_frequency_millihertz: 1_000_000,
            max_voltage_millivolts: 2_000_000,
            min_guard_ns: 200_000,
            timer_clock_hz: 170_000_000,
        };
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: *b"fuzzed board",
                boot_id: 1,
                reset_cause: ResetCause::PowerOn,
                firmware: FirmwareVersion { major: 0, minor: 1, patch: 0, commit: *b"00000000" },
                channels: std::iter::repeat_n(limits, era_shared::MAX_CHANNELS).collect(),
                fault_before_reset: None,
            },
            now_us: 0,
            live: true,
            programs: Programs::default(),
            refuses_arming: false,
            refuses_drives: false,
        }
    }

    /// Whether nothing is energised and nothing is driven.
    pub fn is_off(&self) -> bool {
        !self.live && self.programs.iter().all(Option::is_none)
    }
}

impl Board for WatchedBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn outputs_off(&mut self) {
        self.live = false;
        self.programs = Programs::default();
    }

    fn arm(&mut self) -> Result<(), FaultCode> {
        assert!(self.is_off(), "armed while something was on");
        if self.refuses_arming {
            return Err(FaultCode::ArmFailed);
        }
        self.live = true;
        Ok(())
    }

    fn apply(&mut self, programs: &Programs) -> Result<(), FaultCode> {
        assert!(self.live, "driven without being armed");
        if self.refuses_drives {
            return Err(FaultCode::DriveFailed);
        }
        for (program, limits) in programs.iter().zip(&self.info.channels) {
            let Some(program) = program else { continue };
            let achieved = program.achieved;
            assert!(achieved.guard_ns >= limits.min_guard_ns.max(GUARD_FLOOR_NS), "guard: {program:?}");
            assert!(achieved.voltage_millivolts <= limits.max_voltage_millivolts, "voltage: {program:?}");
        }
        self.programs = *programs;
        Ok(())
    }

    fn measure(&mut self) -> Measurements {
        Measurements::default()
    }
}

//! The simulated board: timers and rails as numbers, the panel in their place.

use super::panel::Panel;
use super::source::Source;
use era_shared::board::{Board, BoardInfo, Measurements, Programs};
use era_shared::protocol::{BoardKind, ChannelLimits, FaultCode, FirmwareVersion, ResetCause};
use std::time::Instant;

/// Where the board's time comes from.
#[derive(Clone, Copy, Debug)]
pub enum Clock {
    /// Wall-clock time since the given instant.
    Wall(Instant),
    /// Time in us that the owner sets, for runs faster than real time.
    Manual(u64),
}

/// A board without hardware.
#[derive(Debug)]
pub struct SimBoard {
    info: BoardInfo,
    clock: Clock,
    panel: Panel,
    rails_millivolts: Vec<u32>,
    live: bool,
    applied: bool,
}

impl SimBoard {
    /// A board with one channel per actuator, `max_voltages_v` their voltage limits.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "`as` saturates; rounded down on purpose"
    )]
    pub fn new(panel: Panel, max_voltages_v: &[f64], clock: Clock) -> Self {
        let channels = max_voltages_v
            .iter()
            .map(|volts| ChannelLimits { max_voltage_millivolts: (volts * 1e3) as u32, ..ChannelLimits::BOARD })
            .take(era_shared::MAX_CHANNELS)
            .collect();
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: *b"sim-board-01",
                boot_id: 1,
                reset_cause: ResetCause::PowerOn,
                firmware: FirmwareVersion {
                    major: number(env!("CARGO_PKG_VERSION_MAJOR")),
                    minor: number(env!("CARGO_PKG_VERSION_MINOR")),
                    patch: number(env!("CARGO_PKG_VERSION_PATCH")),
                    commit: *b"00000000",
                },
                channels,
                fault_before_reset: None,
            },
            clock,
            panel,
            rails_millivolts: vec![0; max_voltages_v.len()],
            live: false,
            applied: false,
        }
    }

    /// The panel, for its accelerometer.
    pub const fn panel_mut(&mut self) -> &mut Panel {
        &mut self.panel
    }

    /// What the reset pin does: drives end and everything but the panel's motion is forgotten.
    pub fn restart(&mut self) {
        self.outputs_off();
        self.info.boot_id = self.info.boot_id.wrapping_add(1);
        self.info.reset_cause = ResetCause::Pin;
        self.clock = match self.clock {
            Clock::Wall(_) => Clock::Wall(Instant::now()),
            Clock::Manual(_) => Clock::Manual(0),
        };
        self.panel.restart_clock();
    }

    /// Sets a [`Clock::Manual`].
    pub const fn set_time_us(&mut self, time_us: u64) {
        self.clock = Clock::Manual(time_us);
    }

    /// Whether drives were set since this was last asked.
    pub const fn take_applied(&mut self) -> bool {
        std::mem::replace(&mut self.applied, false)
    }

    /// Lets the panel move up to now.
    pub fn advance(&mut self) {
        let now_s = self.time_s();
        self.panel.advance_to(now_s);
    }

    #[allow(clippy::cast_precision_loss, reason = "microseconds in an f64 are exact for 285 years")]
    fn time_s(&mut self) -> f64 {
        self.now_us() as f64 / 1e6
    }

    fn silence_sources(&mut self) {
        for channel in 0..era_shared::MAX_CHANNELS {
            self.panel.set_source(channel, None);
        }
        self.rails_millivolts.fill(0);
    }
}

fn number(text: &str) -> u8 {
    text.parse().unwrap_or(0)
}

impl Board for SimBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        match self.clock {
            Clock::Wall(start) => u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX),
            Clock::Manual(time_us) => time_us,
        }
    }

    fn outputs_off(&mut self) {
        // The panel has felt the old drives up to now.
        self.advance();
        self.silence_sources();
        self.live = false;
    }

    fn arm(&mut self) -> Result<(), FaultCode> {
        self.live = true;
        Ok(())
    }

    fn apply(&mut self, programs: &Programs) -> Result<(), FaultCode> {
        if !self.live {
            return Err(FaultCode::DriveFailed);
        }
        self.advance();
        self.silence_sources();
        self.applied = true;
        let now_s = self.time_s();
        for (channel, program) in programs.iter().enumerate() {
            let Some(program) = program else { continue };
            let scale = self.panel.newtons_per_volt_squared(channel).ok_or(FaultCode::DriveFailed)?;
            let source = Source::new(program, now_s, scale).map_err(|_| FaultCode::DriveFailed)?;
            self.panel.set_source(channel, Some(source));
            if let Some(rail) = self.rails_millivolts.get_mut(channel) {
                *rail = program.achieved.voltage_millivolts;
            }
        }
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    fn measure(&mut self) -> Measurements {
        self.advance();
        Measurements {
            acceleration_peak_mm_per_s2: Some((self.panel.accelerometer.peak_m_per_s2() * 1e3).round() as u32),
            rail_millivolts: self.rails_millivolts.iter().copied().take(era_shared::MAX_CHANNELS).collect(),
        }
    }
}

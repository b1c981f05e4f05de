//! The targets, and why one may be missing.

use crate::bench::Bench;
use crate::cases::CaseNeeds;
use std::process::{Command, Stdio};

/// A target of the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetKind {
    /// The simulated device.
    Sim,
    /// The firmware image in the emulator.
    Emulated,
    /// The board on the port that `ERA_DEVICE` names.
    Board,
}

impl TargetKind {
    /// All targets.
    pub const ALL: [TargetKind; 3] = [TargetKind::Sim, TargetKind::Emulated, TargetKind::Board];

    /// As in the names of the tests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            TargetKind::Sim => "sim",
            TargetKind::Emulated => "emulated",
            TargetKind::Board => "board",
        }
    }

    /// Why this target is not here; `None` if it is.
    #[must_use]
    pub fn missing_reason(self) -> Option<String> {
        match self {
            TargetKind::Sim => None,
            TargetKind::Emulated => {
                let python = Command::new("python3")
                    .args(["-c", "import venv, ensurepip"])
                    .stdout(Stdio::null())
                    .stderr(Stdio::null())
                    .status();
                let here = python.is_ok_and(|status| status.success());
                (!here).then(|| "python3 with venv is not installed".into())
            }
            TargetKind::Board => {
                board_port_from_environment().is_none().then(|| "ERA_DEVICE names no serial port".into())
            }
        }
    }

    /// Why a case with these needs cannot be run on this target; `None` if it can.
    #[must_use]
    pub const fn missing_need(self, needs: CaseNeeds) -> Option<&'static str> {
        match (self, needs) {
            (TargetKind::Emulated | TargetKind::Board, CaseNeeds::Knobs) => {
                Some("only the simulated device can stay silent, answer late or corrupt frames on request")
            }
            (TargetKind::Board, CaseNeeds::NothingConnected) => {
                Some("the case requests 1 kV, but something may be connected to the electrodes")
            }
            (TargetKind::Board, CaseNeeds::Breaking) => Some("the tests do not break the hardware of a board"),
            (TargetKind::Board, CaseNeeds::Reset) => Some("a board's reset button cannot be pressed from here"),
            _ => None,
        }
    }

    /// Whether the timers and pins at the electrodes can be observed. On a board, that would take a logic analyser.
    #[must_use]
    pub const fn can_observe_outputs(self) -> bool {
        matches!(self, TargetKind::Sim | TargetKind::Emulated)
    }

    /// Starts the target.
    ///
    /// # Errors
    /// Why it did not start.
    pub fn start_target(self) -> Result<Bench, String> {
        match self {
            TargetKind::Sim => Bench::start_simulated(),
            TargetKind::Emulated => Bench::start_emulated(),
            TargetKind::Board => Bench::open_board(&board_port_from_environment().unwrap_or_default()),
        }
    }
}

fn board_port_from_environment() -> Option<String> {
    std::env::var("ERA_DEVICE").ok().filter(|port| !port.is_empty())
}

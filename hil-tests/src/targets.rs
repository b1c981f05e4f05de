//! The targets, and why one may be missing.

use crate::bench::Bench;
use crate::cases::Needs;
use std::process::{Command, Stdio};

/// A target of the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The simulated device.
    Sim,
    /// The firmware image in the emulator.
    Emulated,
    /// The board on the port that `ERA_DEVICE` names.
    Board,
}

impl Kind {
    /// All targets.
    pub const ALL: [Kind; 3] = [Kind::Sim, Kind::Emulated, Kind::Board];

    /// As in the names of the tests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Kind::Sim => "sim",
            Kind::Emulated => "emulated",
            Kind::Board => "board",
        }
    }

    /// Why this target is not here; `None` if it is.
    #[must_use]
    pub fn missing(self) -> Option<String> {
        match self {
            Kind::Sim => None,
            Kind::Emulated => {
                let python = Command::new("python3")
                    .args(["-c", "import venv, ensurepip"])
                    .stdout(Stdio::null())
                    .stderr(Stdio::null())
                    .status();
                let here = python.is_ok_and(|status| status.success());
                (!here).then(|| "python3 with venv is not installed".into())
            }
            Kind::Board => board().is_none().then(|| "ERA_DEVICE names no serial port".into()),
        }
    }

    /// Why a case with these needs cannot be run on this target; `None` if it can.
    #[must_use]
    pub const fn lacks(self, needs: Needs) -> Option<&'static str> {
        match (self, needs) {
            (Kind::Emulated | Kind::Board, Needs::Knobs) => Some("only the simulated device has knobs"),
            (Kind::Board, Needs::NothingConnected) => Some("it asks for 1 kV, and something may be connected"),
            (Kind::Board, Needs::Breaking) => Some("a board's hardware is not broken on purpose"),
            (Kind::Board, Needs::Reset) => Some("a board's reset button cannot be pressed from here"),
            _ => None,
        }
    }

    /// Starts the target.
    ///
    /// # Errors
    /// Why it did not start.
    pub fn open(self) -> Result<Bench, String> {
        match self {
            Kind::Sim => Bench::sim(),
            Kind::Emulated => Bench::emulated(),
            Kind::Board => Bench::board(&board().unwrap_or_default()),
        }
    }
}

fn board() -> Option<String> {
    std::env::var("ERA_DEVICE").ok().filter(|port| !port.is_empty())
}

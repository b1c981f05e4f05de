//! Whether an image belongs on a board: asked before anything is erased.

use era_shared::image::ImageHeader;
use era_shared::protocol::{BoardKind, CURRENT_VERSION, FirmwareVersion, MIN_VERSION};
use era_shared::safety::SafetyState;
use std::fmt;

/// What is known of the board's present firmware: from its hello, or from the header in its flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstalledFirmware {
    /// Kind of board; `None` for one that this program does not know.
    pub board: Option<BoardKind>,
    /// Its firmware.
    pub firmware: FirmwareVersion,
    /// Newest protocol version that it speaks.
    pub protocol_current: u8,
}

impl From<&ImageHeader> for InstalledFirmware {
    fn from(header: &ImageHeader) -> Self {
        let ImageHeader { board, firmware, protocol_current, .. } = header;
        Self { board: *board, firmware: *firmware, protocol_current: *protocol_current }
    }
}

/// Why an image is not written to a board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckError {
    /// For another kind of board.
    #[error(
        "the image is for {}, but the connected board is {}: nothing was changed",
        board_name(*.image),
        board_name(*.board)
    )]
    Board {
        /// As in the image.
        image: Option<BoardKind>,
        /// As the board says.
        board: Option<BoardKind>,
    },
    /// There is no flash in a simulation.
    #[error(
        "the selected device is the simulated device, which has no firmware to \
    replace; name the board's port with --port"
    )]
    Simulated,
    /// It would speak less than now.
    #[error(
        "the image speaks ERA protocol versions up to {image}, but the board's firmware speaks versions up to {board}: \
         the image is older. --force writes the image nevertheless"
    )]
    Downgrade {
        /// Newest version that the image speaks.
        image: u8,
        /// Newest version that the board speaks.
        board: u8,
    },
    /// This program could not talk to it afterwards.
    #[error(
        "the image speaks ERA protocol versions {image_min} to {image_current}, but this program speaks versions \
         {MIN_VERSION} to {CURRENT_VERSION}: update this program first. --force writes the image nevertheless"
    )]
    Unspoken {
        /// Oldest version that the image speaks.
        image_min: u8,
        /// Newest version that the image speaks.
        image_current: u8,
    },
    /// It is driving.
    #[error(
        "the board is {}: stop and disarm the board with `era stop`, then run `era flash` again",
        state_name(*.0)
    )]
    Live(SafetyState),
}

/// Compares an image with what is on the board, as far as that is known. `force` lets pass what can be undone.
///
/// # Errors
/// [`CheckError`].
pub fn check_image(image: &ImageHeader, board: Option<&InstalledFirmware>, force: bool) -> Result<(), CheckError> {
    if image.board != Some(BoardKind::Stm32G474) {
        return Err(CheckError::Board { image: image.board, board: board.and_then(|it| it.board) });
    }
    if let Some(board) = board {
        match board.board {
            Some(BoardKind::Simulated) => return Err(CheckError::Simulated),
            kind if kind != image.board => return Err(CheckError::Board { image: image.board, board: kind }),
            _ => {}
        }
        if !force && image.protocol_current < board.protocol_current {
            return Err(CheckError::Downgrade { image: image.protocol_current, board: board.protocol_current });
        }
    }
    if !force && (image.protocol_min > CURRENT_VERSION || image.protocol_current < MIN_VERSION) {
        return Err(CheckError::Unspoken { image_min: image.protocol_min, image_current: image.protocol_current });
    }
    Ok(())
}

/// Whether a board in this state may be taken out of service.
///
/// # Errors
/// [`CheckError::Live`].
pub const fn check_idle(state: SafetyState) -> Result<(), CheckError> {
    match state {
        SafetyState::Boot | SafetyState::Safe | SafetyState::Fault => Ok(()),
        _ => Err(CheckError::Live(state)),
    }
}

/// A version as a person reads it: `0.1.0 (commit 0123abcd)`.
#[derive(Clone, Copy, Debug)]
pub struct Version(pub FirmwareVersion);

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FirmwareVersion { major, minor, patch, commit } = self.0;
        write!(f, "{major}.{minor}.{patch} (commit {})", String::from_utf8_lossy(&commit))
    }
}

/// A kind of board as a person reads it.
#[must_use]
pub const fn board_name(board: Option<BoardKind>) -> &'static str {
    match board {
        Some(BoardKind::Simulated) => "the simulated device",
        Some(BoardKind::Stm32G474) => "the STM32G474 actuator board",
        None => "a kind of board that this program does not know",
    }
}

const fn state_name(state: SafetyState) -> &'static str {
    match state {
        SafetyState::Running => "driving",
        SafetyState::Armed => "armed",
        SafetyState::Arming => "arming",
        SafetyState::Discharging => "discharging its rails",
        SafetyState::Boot | SafetyState::Safe | SafetyState::Fault => "idle",
    }
}

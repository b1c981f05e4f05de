//! What version 2 adds to the device's answers.

use super::{BoardKind, ChannelLimits, FirmwareVersion, ResetCause};
use crate::MAX_CHANNELS;
use crate::safety::SafetyState;
use crate::supply::RAILS;
use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

/// Most characters of the message that a failed run leaves: with it the longest [`WelcomeReply`] still fits a frame.
pub const FAILURE_MESSAGE: usize = 80;
/// Most characters of an image's name.
pub const IMAGE_NAME: usize = 16;
/// Most bytes of the log in one reply.
pub const LOG_CHUNK: usize = 200;

/// Who the device is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WelcomeReply {
    /// Oldest protocol version spoken.
    pub protocol_min: u8,
    /// Newest protocol version spoken.
    pub protocol_current: u8,
    /// Kind of board.
    pub board: BoardKind,
    /// Unique identifier of the chip.
    pub board_id: [u8; 12],
    /// Different after every start, so that the host notices a restart.
    pub boot_id: u32,
    /// Why it last started.
    pub reset_cause: ResetCause,
    /// Name of the image.
    pub image: String<IMAGE_NAME>,
    /// Its version.
    pub firmware: FirmwareVersion,
    /// One per channel.
    pub channels: Vec<ChannelLimits, MAX_CHANNELS>,
    /// What the previous run said when it failed; empty if it did not.
    pub failure: String<FAILURE_MESSAGE>,
}

/// What is measured, and what the board still allows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DetailsReply {
    /// The safety state.
    pub state: SafetyState,
    /// Set-point of each rail in mV.
    pub set_point_millivolts: [u32; RAILS],
    /// Measured voltage of each rail in mV.
    pub rail_millivolts: [u32; RAILS],
    /// Average current of the supply in uA.
    pub average_microamps: u32,
    /// The enclosure is closed.
    pub interlock_closed: bool,
    /// The emergency stop is not pressed.
    pub stop_released: bool,
    /// Panel and moving masses are bonded to earth.
    pub earth_bonded: bool,
    /// For how long each channel may still drive at its largest force in the long run, in ms.
    pub credit_ms: Vec<u32, MAX_CHANNELS>,
}

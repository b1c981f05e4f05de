//! Who a device is, whichever protocol version it says it in.

use era_shared::protocol::{BoardKind, ChannelLimits, FirmwareVersion, Reply, ResetCause};

/// What a device says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceIdentity {
    /// Oldest protocol version that it speaks.
    pub protocol_min: u8,
    /// Newest protocol version that it speaks.
    pub protocol_current: u8,
    /// Kind of board.
    pub board: BoardKind,
    /// Unique identifier of the chip.
    pub board_id: [u8; 12],
    /// Different after every start.
    pub boot_id: u32,
    /// Why it last started.
    pub reset_cause: ResetCause,
    /// Name of the image; empty with version 1.
    pub image: String,
    /// Its version.
    pub firmware: FirmwareVersion,
    /// One per channel.
    pub channels: Vec<ChannelLimits>,
    /// What the previous run said when it failed; empty if it did not, and with version 1.
    pub failure: String,
}

impl DeviceIdentity {
    /// Reads the answer to `Hello`; `None` if it is another one.
    #[must_use]
    pub fn from_reply_if_hello(reply: Reply) -> Option<Self> {
        match reply {
            Reply::Welcome(welcome) => Some(Self {
                protocol_min: welcome.protocol_min,
                protocol_current: welcome.protocol_current,
                board: welcome.board,
                board_id: welcome.board_id,
                boot_id: welcome.boot_id,
                reset_cause: welcome.reset_cause,
                image: welcome.image.as_str().into(),
                firmware: welcome.firmware,
                channels: welcome.channels.to_vec(),
                failure: welcome.failure.as_str().into(),
            }),
            Reply::Hello(hello) => Some(Self {
                protocol_min: hello.protocol_min,
                protocol_current: hello.protocol_current,
                board: hello.board,
                board_id: hello.board_id,
                boot_id: hello.boot_id,
                reset_cause: hello.reset_cause,
                image: String::new(),
                firmware: hello.firmware,
                channels: hello.channels.to_vec(),
                failure: String::new(),
            }),
            _ => None,
        }
    }

    /// A board's identifier in hexadecimal.
    #[must_use]
    pub fn board_id_hex(board_id: [u8; 12]) -> String {
        board_id.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The image's version, with the source's commit where it is known: `0.1.0+1a2b3c4d`.
    #[must_use]
    pub fn firmware_version_and_commit_text(&self) -> String {
        let FirmwareVersion { major, minor, patch, commit } = self.firmware;
        let numbers = format!("{major}.{minor}.{patch}");
        let commit = std::str::from_utf8(&commit).ok().filter(|commit| *commit != "00000000");
        commit.map_or(numbers.clone(), |commit| format!("{numbers}+{commit}"))
    }
}

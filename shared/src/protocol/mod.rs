//! Messages, append-only.
//!
//! Postcard encodes an enum by the position of its variant and a struct by the order of its fields, so variants are
//! only ever added at the end, fields never, and nothing is removed or moved within a version. `tests/golden_v*.rs` hold the bytes of every
//! message, one file per version.
//!
//! Units are in the names; integers throughout, so that both sides compute the same numbers to the last bit.

mod compat;
mod fault;
mod identity;
mod reply;
mod reply2;
mod reply3;
mod request;

pub use compat::translate_for_version;
pub use fault::{Fault, FaultCode};
pub use identity::{BoardKind, ChannelLimits, FirmwareVersion, ResetCause};
pub use reply::{AchievedDrive, ChannelStatus, HelloReply, LinkCounters, Refusal, Reply, StatusReply, TelemetryReply};
pub use reply2::{DetailsReply, FAILURE_MESSAGE, IMAGE_NAME, LOG_CHUNK, WelcomeReply};
pub use reply3::{ChannelCredit, ChargeRule, CreditReply};
pub use request::{BOOTLOADER_KEY, ChannelDrive, Request, WindowSequence};

/// Oldest protocol version that this code still speaks.
pub const MIN_VERSION: u8 = 1;
/// Protocol version that this code speaks by preference.
pub const CURRENT_VERSION: u8 = 4;

/// Whether this code can talk to a peer of this version.
#[must_use]
pub const fn is_version_supported(version: u8) -> bool {
    version >= MIN_VERSION && version <= CURRENT_VERSION
}

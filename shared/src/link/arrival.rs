//! What a link reports to the device.

use heapless::Vec;

/// Most bytes that one arrival carries: a full-speed USB packet.
pub const MAX_PACKET: usize = 64;

/// What a link reports to the device.
pub enum LinkArrival {
    /// Bytes, in order.
    Bytes(Vec<u8, MAX_PACKET>),
    /// The other end has gone, or is new: what came before does not belong to what comes now.
    Reopened,
}

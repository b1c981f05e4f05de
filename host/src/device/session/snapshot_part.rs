//! What a look at the device consists of.

/// A part of a look at the device: one request each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SnapshotPart {
    Status,
    Telemetry,
    /// Not of devices of version 1.
    Details,
    /// Not of devices of version 1 or 2.
    Credit,
}

//! Devices: how to reach one ([`target`]), how to talk to it ([`client`]), how to keep a session with it
//! ([`session`]), how its clock and ours agree ([`clock`]), and the simulated one ([`sim`]).
//!
//! Whatever the device is, the daemon opens a serial port and exchanges frames: the simulated device stands behind a
//! real pseudo-terminal, the emulated board's UART is bridged to one.

pub mod client;
pub mod clock;
pub mod convert;
pub mod pause_detector;

pub mod emulated;
pub mod identity;
pub mod port;
pub mod priority;
pub mod round_trips;
pub mod session;
pub mod sim;
pub mod target;
pub mod timing;
pub mod usb_ids;

pub use client::{Client, LinkError};
pub use clock::{ClockQuality, ClockSync};

pub use identity::DeviceIdentity;
pub use session::{AskedAt, DeviceSnapshot, DriveContent, DriveOrder, Session, SessionError};
pub use target::{KINDS as TARGET_KINDS, OpenDevice, Target, TargetError};

//! What the doctor knows before it judges.

pub use crate::device::port::users::{PortGroupAccess, PortHolder};
use crate::device::usb_ids::{ST, is_era_board};
use era_shared::protocol::FaultCode;

/// The device that is asked about.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Wanted {
    /// None is named: a board if there is one.
    #[default]
    Any,
    /// A board has to be there.
    Board,
    /// The serial port of this path.
    Port(String),
    /// The simulated device or the emulated board: no hardware.
    Simulated(&'static str),
}

/// A USB device behind a serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usb {
    /// Vendor number.
    pub vendor: u16,
    /// Product number.
    pub product: u16,
    /// The product's name, if it has one.
    pub name: Option<String>,
}

/// A serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Port {
    /// Its path.
    pub path: String,
    /// What is behind it, if it is on the USB bus.
    pub usb: Option<Usb>,
}

impl Port {
    /// Whether it is a board's own: numbers and name, as others have the same numbers.
    #[must_use]
    pub fn is_board(&self) -> bool {
        self.usb.as_ref().is_some_and(|usb| is_era_board(usb.vendor, usb.product, usb.name.as_deref()))
    }

    /// Whether it is that of ST's debug probe, which a Nucleo board's UART is at.
    #[must_use]
    pub fn is_probe(&self) -> bool {
        self.usb.as_ref().is_some_and(|usb| usb.vendor == ST)
    }
}

/// A udev rule about the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Its file.
    pub path: String,
    /// Whether it keeps ModemManager away.
    pub ignores_modem_manager: bool,
}

/// The port that is asked about.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// Its path.
    pub path: String,
    /// Who may use it.
    pub access: PortGroupAccess,
    /// Who has it open, as far as can be seen.
    pub holders: Vec<PortHolder>,
    /// What came of asking.
    pub answer: PortAnswer,
}

/// What came of asking a board.
#[derive(Clone, Debug, PartialEq)]
pub enum PortAnswer {
    /// Another process has the port, and would miss what the board answers.
    NotAsked,
    /// There is no such port.
    Missing,
    /// The system does not let this user open it.
    Denied,
    /// Another process holds it.
    Busy,
    /// It cannot be opened for another reason.
    Failed(String),
    /// What is there does not answer as a board does.
    Silent(String),
    /// It speaks protocol versions that this program does not.
    Version(String),
    /// It answers.
    Answered(BoardReport),
}

/// What a board says, over its port or through the daemon that has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardReport {
    /// Its firmware's version, with the commit where that is known.
    pub firmware: String,
    /// Protocol version spoken with it.
    pub protocol: Option<u8>,
    /// State of its safety machine.
    pub state: Option<String>,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// What the previous run of its firmware said when it failed.
    pub failure: Option<String>,
    /// Whether a watchdog was why it last started.
    pub was_watchdog: bool,
    /// Whether it was away, and its daemon drives nothing until a person arms it.
    pub waits_to_be_armed: bool,
    /// Supply and loops; with protocol version 1 they are not known.
    pub supply: Option<Supply>,
    /// Its clock beside this machine's.
    pub clock: Option<Clock>,
    /// Frames sent, and of these sent again.
    pub frames: (u64, u64),
}

/// A latched fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Its number.
    pub code: u64,
    /// Its name.
    pub name: String,
    /// What to do.
    pub advice: String,
}

impl From<FaultCode> for Fault {
    fn from(code: FaultCode) -> Self {
        Self { code: u64::from(code.number()), name: code.name().into(), advice: code.advice().into() }
    }
}

/// The high-voltage supply and the loops that switch it off.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Supply {
    /// What is measured on each rail in V.
    pub rail_v: Vec<f64>,
    /// The enclosure is closed.
    pub interlock_closed: bool,
    /// The emergency stop is not pressed.
    pub stop_released: bool,
    /// Panel and masses are bonded to earth.
    pub earth_bonded: bool,
}

/// A board's clock beside this machine's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// How much faster it runs in parts per million, where it was looked at for long enough.
    pub rate_ppm: Option<f64>,
    /// Least half round trip in s, which is how well its time is known at best.
    pub half_round_trip_s: f64,
    /// Largest difference in s between what was predicted and what it said.
    pub worst_s: f64,
}

/// Whether a daemon answers.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Daemon {
    /// Nobody listens.
    #[default]
    Absent,
    /// Something listens that is no daemon of this program.
    OtherProgram(String),
    /// A daemon answers, but tells its state only to whoever has the right.
    Guarded(String),
    /// It speaks TLS, or none, or has a certificate that does not fit: it can be asked otherwise.
    Hidden {
        /// What is there.
        found: String,
        /// How to ask it.
        advice: String,
    },
    /// It answers.
    Runs {
        /// Its version.
        version: String,
        /// The path of its device's port.
        port: String,
        /// `sim`, `emulated` or `serial`.
        kind: String,
        /// Why its device is not connected.
        problem: Option<String>,
        /// What its device says.
        heard: Option<Box<BoardReport>>,
    },
}

/// Whether a file can be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// The file.
    pub path: String,
    /// What is wrong with it.
    pub mistake: Option<String>,
}

/// All that was found out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// The device that is asked about.
    pub wanted: Wanted,
    /// The serial ports of the machine.
    pub ports: Vec<Port>,
    /// Whether a chip waits in its bootloader; `None` if the bus cannot be looked at.
    pub bootloader: Option<bool>,
    /// udev rules about the board; `None` where there is no udev.
    pub rules: Option<Vec<Rule>>,
    /// ModemManager's process, if it runs.
    pub modem_manager: Option<u32>,
    /// Highest real-time priority that this user's programs may have; `None` if it is not known.
    pub realtime: Option<u64>,
    /// The port that was asked.
    pub chosen: Option<Chosen>,
    /// The address where a daemon was looked for.
    pub address: String,
    /// Whether it was named, so that somebody is expected there.
    pub is_address_named: bool,
    /// What is there.
    pub daemon: Daemon,
    /// The configuration file, if one is named.
    pub config: Option<File>,
    /// The scene, if one is named.
    pub scene: Option<File>,
}

//! Which device to use, and how to open it.

use super::client::{Client, LinkError, Transport};
use super::emulated::{EmulatedBoard, EmulatedError};
use super::port::{self, Port, PortError, UsbName, Users};
use super::sim::{Panel, SimControl, SimDevice};
use super::timing::{REAL_TIME, Timing};
use std::fmt;
use std::str::FromStr;

/// A device as the command line names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// The simulated device, in this process.
    Sim,
    /// The firmware image in the emulator.
    Emulated,
    /// The first board that the computer's list of USB ports shows.
    Auto,
    /// A serial port by its path.
    Serial(String),
}

/// Kinds of devices, as [`OpenDevice::kind`] names them.
pub const KINDS: [&str; 3] = ["sim", "emulated", "serial"];

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "sim" => Ok(Target::Sim),
            "emulated" => Ok(Target::Emulated),
            "auto" => Ok(Target::Auto),
            path if is_path(path) => Ok(Target::Serial(path.into())),
            _ => Err("must be sim, emulated, auto or the path of a serial port, such as /dev/ttyACM0".into()),
        }
    }
}

/// Whether this may be a port's path, and not a mistyped word.
fn is_path(text: &str) -> bool {
    let is_com = text.get(..3).is_some_and(|begin| begin.eq_ignore_ascii_case("com"));
    text.contains(['/', '\\']) || is_com || std::path::Path::new(text).exists()
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Target::Sim => "sim",
            Target::Emulated => "emulated",
            Target::Auto => "auto",
            Target::Serial(path) => path,
        })
    }
}

/// Why a device could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// The port cannot be opened.
    #[error("{source}. Ports here: {available}")]
    Port {
        /// Why.
        source: PortError,
        /// What there is.
        available: String,
    },
    /// No port answered.
    #[error(
        "no ERA board is among the serial ports ({ports}). Connect a board, name its port if it is connected \
         through an ST-LINK, or use --device sim"
    )]
    NoneFound {
        /// Ports there are.
        ports: String,
    },
    /// No pseudo-terminal for the simulated device.
    #[error("cannot start the simulated device: {0}")]
    Sim(std::io::Error),
    /// The emulator did not start.
    #[error(transparent)]
    Emulated(#[from] EmulatedError),
    /// A simulation, where a board is wanted.
    #[error("the simulated device has no firmware: name a board's serial port, or auto")]
    NoBoard,
}

/// Opens a line to a device.
pub type Opener = Box<dyn Fn() -> Result<Box<dyn Transport>, PortError> + Send>;

/// What keeps a device alive while it is used.
enum Keeper {
    Sim(SimDevice),
    Emulated(EmulatedBoard),
    Line(Opener),
    Nothing,
}

impl fmt::Debug for Keeper {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Keeper::Sim(_) => "Sim",
            Keeper::Emulated(_) => "Emulated",
            Keeper::Line(_) => "Line",
            Keeper::Nothing => "Nothing",
        })
    }
}

/// A device that can be talked to.
#[derive(Debug)]
pub struct OpenDevice {
    kind: &'static str,
    path: String,
    timing: Timing,
    keeper: Keeper,
    /// Which board it is, where USB tells: it is found again by that, whatever path it has then.
    usb: Option<UsbName>,
    /// Any board will do that is found.
    any: bool,
}

impl OpenDevice {
    /// Starts or finds the device. `panel` makes the simulated panel with its channels' voltage limits; it is only
    /// called for [`Target::Sim`].
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn open(target: &Target, panel: impl FnOnce() -> (Panel, Vec<f64>)) -> Result<Self, TargetError> {
        match target {
            Target::Sim => {
                let (panel, max_voltages_v) = panel();
                let sim = SimDevice::start(panel, max_voltages_v).map_err(TargetError::Sim)?;
                let path = sim.path().to_owned();
                Ok(Self { kind: "sim", path, timing: REAL_TIME, keeper: Keeper::Sim(sim), usb: None, any: false })
            }
            board => Self::open_board(board),
        }
    }

    /// As [`Self::open`], for what runs the firmware: a board, or the emulated one.
    ///
    /// # Errors
    /// [`TargetError`]; [`TargetError::NoBoard`] for [`Target::Sim`].
    pub fn open_board(target: &Target) -> Result<Self, TargetError> {
        match target {
            Target::Sim => Err(TargetError::NoBoard),
            Target::Emulated => {
                let board = EmulatedBoard::start()?;
                let (path, timing) = (board.path().to_owned(), board.timing());
                Ok(Self { kind: "emulated", path, timing, keeper: Keeper::Emulated(board), usb: None, any: false })
            }
            Target::Serial(_) | Target::Auto => {
                let mut device = Self::absent(target).ok_or(TargetError::NoBoard)?;
                match device.locate().and_then(|()| device.transport()) {
                    Ok(_) => Ok(device),
                    Err(PortError::NotConnected { .. }) if device.any => {
                        Err(TargetError::NoneFound { ports: port::list() })
                    }
                    Err(source) => Err(TargetError::Port { source, available: port::list() }),
                }
            }
        }
    }

    /// A board that may come later; `None` for what this program starts itself.
    #[must_use]
    pub fn absent(target: &Target) -> Option<Self> {
        let (path, any) = match target {
            Target::Serial(path) => (path.clone(), false),
            Target::Auto => ("auto".to_owned(), true),
            Target::Sim | Target::Emulated => return None,
        };
        Some(Self { kind: "serial", path, timing: REAL_TIME, keeper: Keeper::Nothing, usb: None, any })
    }

    /// A device at the end of whatever `open` opens, which is called `path`: for lines that are no serial ports.
    #[must_use]
    pub fn over(path: &str, timing: Timing, open: Opener) -> Self {
        Self { kind: "serial", path: path.into(), timing, keeper: Keeper::Line(open), usb: None, any: false }
    }

    /// `sim`, `emulated` or `serial`.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        self.kind
    }

    /// Path of the serial port.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// How long to wait for it.
    #[must_use]
    pub const fn timing(&self) -> Timing {
        self.timing
    }

    /// The simulated device's knobs, where it is one.
    #[must_use]
    pub fn sim(&self) -> Option<SimControl> {
        match &self.keeper {
            Keeper::Sim(sim) => Some(sim.control()),
            _ => None,
        }
    }

    /// The emulated board, where it is one.
    #[must_use]
    pub const fn emulated(&self) -> Option<&EmulatedBoard> {
        match &self.keeper {
            Keeper::Emulated(board) => Some(board),
            _ => None,
        }
    }

    /// A failed link in words, with the programs that have the port open as well: an emulated board has no cable.
    #[must_use]
    pub fn trouble(&self, error: &LinkError) -> String {
        match (&self.keeper, error) {
            (Keeper::Emulated(_), LinkError::Io(source)) => {
                format!(
                    "the emulator's port failed: {source}. If the emulator's process has ended, the daemon starts it again"
                )
            }
            _ => link_trouble(&self.path, error),
        }
    }

    /// Starts the emulated board again where its process has ended; any other device is left as it is.
    ///
    /// # Errors
    /// [`EmulatedError`] where that fails.
    pub fn revive(&mut self) -> Result<(), EmulatedError> {
        if let Keeper::Emulated(board) = &mut self.keeper
            && let Some(status) = board.ended()
        {
            tracing::warn!(%status, "the emulator has ended; it is started again");
            *board = board.again()?;
            self.path = board.path().to_owned();
        }
        Ok(())
    }

    /// Looks where the board's port is now: USB may show the board that was found before at another path.
    ///
    /// # Errors
    /// That there is no such device if the board is not there.
    pub fn locate(&mut self) -> Result<(), PortError> {
        if self.any || self.usb.is_some() {
            self.path = port::find(self.usb.as_ref()).ok_or_else(|| {
                let what = self.usb.as_ref().map_or_else(|| "no ERA board".into(), |usb| format!("no board {usb}"));
                PortError::NotConnected { what }
            })?;
        }
        Ok(())
    }

    /// An ERA board has answered at this port: from now on that one is wanted, wherever USB shows it.
    pub fn remember(&mut self) {
        if self.usb.is_none() && self.kind == "serial" {
            self.usb = port::usb_of(&self.path);
        }
        self.any = self.any && self.usb.is_none();
    }

    /// Opens the port.
    ///
    /// # Errors
    /// As the port does.
    pub fn transport(&self) -> Result<Box<dyn Transport>, PortError> {
        match &self.keeper {
            Keeper::Line(open) => open(),
            _ => Ok(Box::new(Port::open(&self.path)?)),
        }
    }

    /// Opens the port and puts a client on it.
    ///
    /// # Errors
    /// As the port does.
    pub fn client(&self) -> Result<Client, PortError> {
        Ok(Client::patient(self.transport()?, self.timing.patience))
    }
}

/// A failed link over the port at `path` in words. Where the port is well and the board is not heard, another program may take what it says: those
/// that have the port open are named.
#[must_use]
pub fn link_trouble(path: &str, error: &LinkError) -> String {
    let users = match error {
        LinkError::Silent { .. } | LinkError::Blocked { .. } | LinkError::Unexpected { .. } => {
            Users::of(path).as_cause()
        }
        // A port that fails has most often lost its board: who may not be seen is not suspected.
        LinkError::Io(_) => {
            Some(Users::of(path)).filter(Users::are_known).map(|users| users.as_cause()).unwrap_or_default()
        }
        _ => String::new(),
    };
    let error = error.to_string();
    // A question ends its sentence itself.
    let users = if error.ends_with('?') { users.strip_prefix('.').unwrap_or(&users) } else { &users };
    format!("{error}{users}")
}

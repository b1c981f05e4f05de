//! Which device to use, and how to open it.

use super::client::{Client, LinkError, Transport};
use super::emulated::{EmulatedBoard, EmulatedError};
use super::port::{self, PortError, PortUsers, SerialPort, UsbIdentity};
use super::sim::{SimControl, SimDevice, SimPanel};
use super::timing::{LinkTiming, REAL_TIME};
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
            path if looks_like_path(path) => Ok(Target::Serial(path.into())),
            _ => Err("must be sim, emulated, auto or the path of a serial port, such as /dev/ttyACM0".into()),
        }
    }
}

/// Whether this may be a port's path, and not a mistyped word.
fn looks_like_path(text: &str) -> bool {
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
    #[error("{source}. Serial ports of this computer: {available}")]
    Port {
        /// Why.
        source: PortError,
        /// What there is.
        available: String,
    },
    /// No port answered.
    #[error(
        "no ERA board is among the serial ports ({ports}). Connect a board, or use --device sim. If a board is \
         connected through an ST-LINK, name its port with --device"
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
    #[error(
        "the simulated device has no firmware: give the serial port of a board, or `auto` to find the board over USB"
    )]
    NoBoard,
}

/// Opens a line to a device.
pub type Opener = Box<dyn Fn() -> Result<Box<dyn Transport>, PortError> + Send>;

/// What keeps a device alive while it is used.
enum DeviceBackend {
    Sim(SimDevice),
    Emulated(EmulatedBoard),
    Line(Opener),
    Nothing,
}

impl fmt::Debug for DeviceBackend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DeviceBackend::Sim(_) => "Sim",
            DeviceBackend::Emulated(_) => "Emulated",
            DeviceBackend::Line(_) => "Line",
            DeviceBackend::Nothing => "Nothing",
        })
    }
}

/// A device that can be talked to.
#[derive(Debug)]
pub struct OpenDevice {
    kind: &'static str,
    path: String,
    timing: LinkTiming,
    keeper: DeviceBackend,
    /// Which board it is, where USB tells: it is found again by that, whatever path it has then.
    usb: Option<UsbIdentity>,
    /// Any board will do that is found.
    any: bool,
}

impl OpenDevice {
    /// Starts or finds the device. `make_panel_if_sim` makes the simulated panel with its channels' voltage limits; it is only
    /// called for [`Target::Sim`].
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn open(
        target: &Target,
        make_panel_if_sim: impl FnOnce() -> (SimPanel, Vec<f64>),
    ) -> Result<Self, TargetError> {
        match target {
            Target::Sim => {
                let (panel, max_voltages_v) = make_panel_if_sim();
                let sim = SimDevice::start(panel, max_voltages_v).map_err(TargetError::Sim)?;
                let path = sim.port_path().to_owned();
                Ok(Self {
                    kind: "sim",
                    path,
                    timing: REAL_TIME,
                    keeper: DeviceBackend::Sim(sim),
                    usb: None,
                    any: false,
                })
            }
            board => Self::start_emulator_or_check_board_port_opens(board),
        }
    }

    /// As [`Self::open`], for what runs the firmware: a board, or the emulated one.
    ///
    /// # Errors
    /// [`TargetError`]; [`TargetError::NoBoard`] for [`Target::Sim`].
    pub fn start_emulator_or_check_board_port_opens(target: &Target) -> Result<Self, TargetError> {
        match target {
            Target::Sim => Err(TargetError::NoBoard),
            Target::Emulated => {
                let board = EmulatedBoard::find_or_build_firmware_and_start_emulator()?;
                let (path, timing) = (board.port_path().to_owned(), board.timing());
                Ok(Self {
                    kind: "emulated",
                    path,
                    timing,
                    keeper: DeviceBackend::Emulated(board),
                    usb: None,
                    any: false,
                })
            }
            Target::Serial(_) | Target::Auto => {
                let mut device = Self::new_unconnected_for_serial_or_auto(target).ok_or(TargetError::NoBoard)?;
                match device.update_port_path_from_usb().and_then(|()| device.open_transport()) {
                    Ok(_) => Ok(device),
                    Err(PortError::NotConnected { .. }) if device.any => {
                        Err(TargetError::NoneFound { ports: port::describe_port_names() })
                    }
                    Err(source) => Err(TargetError::Port { source, available: port::describe_port_names() }),
                }
            }
        }
    }

    /// A device for a board that may be connected later; `None` for a target that this program starts itself.
    #[must_use]
    pub fn new_unconnected_for_serial_or_auto(target: &Target) -> Option<Self> {
        let (path, any) = match target {
            Target::Serial(path) => (path.clone(), false),
            Target::Auto => ("auto".to_owned(), true),
            Target::Sim | Target::Emulated => return None,
        };
        Some(Self { kind: "serial", path, timing: REAL_TIME, keeper: DeviceBackend::Nothing, usb: None, any })
    }

    /// A device behind whatever `open` opens, shown as `path`: for lines that are not serial ports.
    #[must_use]
    pub fn with_opener(path: &str, timing: LinkTiming, open: Opener) -> Self {
        Self { kind: "serial", path: path.into(), timing, keeper: DeviceBackend::Line(open), usb: None, any: false }
    }

    /// `sim`, `emulated` or `serial`.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        self.kind
    }

    /// Path of the serial port.
    #[must_use]
    pub fn port_path(&self) -> &str {
        &self.path
    }

    /// How long to wait for the device.
    #[must_use]
    pub const fn timing(&self) -> LinkTiming {
        self.timing
    }

    /// The simulated device's knobs, where it is one.
    #[must_use]
    pub fn sim_control_if_simulated(&self) -> Option<SimControl> {
        match &self.keeper {
            DeviceBackend::Sim(sim) => Some(sim.control()),
            _ => None,
        }
    }

    /// The emulated board, where it is one.
    #[must_use]
    pub const fn emulated_board_if_emulated(&self) -> Option<&EmulatedBoard> {
        match &self.keeper {
            DeviceBackend::Emulated(board) => Some(board),
            _ => None,
        }
    }

    /// Describes a failed link, with the programs that have the port open as well. An emulated board has no cable.
    #[must_use]
    pub fn describe_link_error_for_emulator_or_name_programs_on_port(&self, error: &LinkError) -> String {
        match (&self.keeper, error) {
            (DeviceBackend::Emulated(_), LinkError::Io(source)) => {
                format!(
                    "the emulator's port failed: {source}. If the emulator's process has ended, the daemon starts it again"
                )
            }
            _ => describe_link_error_and_name_programs_on_port(&self.path, error),
        }
    }

    /// Starts the emulated board again where its process has ended; any other device is left as it is.
    ///
    /// # Errors
    /// [`EmulatedError`] where that fails.
    pub fn restart_emulator_if_ended(&mut self) -> Result<(), EmulatedError> {
        if let DeviceBackend::Emulated(board) = &mut self.keeper
            && let Some(status) = board.exit_status_if_ended()
        {
            tracing::warn!(%status, "the emulator has ended; the daemon starts the emulator again");
            *board = board.start_another_with_same_image()?;
            self.path = board.port_path().to_owned();
        }
        Ok(())
    }

    /// Updates the path of the board's port: USB may list the board that was found before at another path.
    ///
    /// # Errors
    /// That there is no such device if the board is not there.
    pub fn update_port_path_from_usb(&mut self) -> Result<(), PortError> {
        if self.any || self.usb.is_some() {
            self.path = port::find_board_port_by_identity_if_given_else_first(self.usb.as_ref()).ok_or_else(|| {
                let what = self.usb.as_ref().map_or_else(|| "no ERA board".into(), |usb| format!("no board {usb}"));
                PortError::NotConnected { what }
            })?;
        }
        Ok(())
    }

    /// Notes that an ERA board has answered at this port: from now on only this board is opened, wherever USB lists it.
    pub fn bind_to_usb_identity(&mut self) {
        if self.usb.is_none() && self.kind == "serial" {
            self.usb = port::find_usb_identity_of_port(&self.path);
        }
        self.any = self.any && self.usb.is_none();
    }

    /// Opens the port.
    ///
    /// # Errors
    /// As the port does.
    pub fn open_transport(&self) -> Result<Box<dyn Transport>, PortError> {
        match &self.keeper {
            DeviceBackend::Line(open) => open(),
            _ => Ok(Box::new(SerialPort::open(&self.path)?)),
        }
    }

    /// Opens the port and puts a client on it.
    ///
    /// # Errors
    /// As the port does.
    pub fn open_client(&self) -> Result<Client, PortError> {
        Ok(Client::with_retry_policy(self.open_transport()?, self.timing.retry_policy))
    }
}

/// Describes a failed link over the port at `path`. Where the port works and the board is not heard, another program may take its answers: the programs that
/// have the port open are named.
#[must_use]
pub fn describe_link_error_and_name_programs_on_port(path: &str, error: &LinkError) -> String {
    let users = match error {
        LinkError::Silent { .. } | LinkError::Blocked { .. } | LinkError::Unexpected { .. } => {
            PortUsers::find_for_port(path).sentence_about_visible_or_hidden_users_of_faulty_port_or_empty()
        }
        // A port that fails has most often lost its board: who may not be seen is not suspected.
        LinkError::Io(_) => Some(PortUsers::find_for_port(path))
            .filter(PortUsers::are_any_visible)
            .map(|users| users.sentence_about_visible_or_hidden_users_of_faulty_port_or_empty())
            .unwrap_or_default(),
        _ => String::new(),
    };
    let error = error.to_string();
    // A question ends its sentence itself.
    let users = if error.ends_with('?') { users.strip_prefix('.').unwrap_or(&users) } else { &users };
    format!("{error}{users}")
}

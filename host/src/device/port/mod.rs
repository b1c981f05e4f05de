//! Serial ports: which of them are boards, and one whose calls have limits.

mod call_limit;
mod error;
mod open;
pub mod users;

pub use call_limit::run_port_calls_in_thread_abandoned_after_limit;
pub use error::PortError;
pub use open::{SerialPort, open_pseudo_terminal};
pub use users::PortUsers;

use super::usb_ids::is_era_board;
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use std::fmt;

/// What USB says of a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbIdentity {
    vendor: u16,
    product: u16,
    serial_number: Option<String>,
}

impl UsbIdentity {
    fn from_port_info(info: &UsbPortInfo) -> Self {
        Self { vendor: info.vid, product: info.pid, serial_number: info.serial_number.clone() }
    }
}

impl fmt::Display for UsbIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}:{:04x}", self.vendor, self.product)?;
        self.serial_number.as_ref().map_or(Ok(()), |number| write!(f, " with serial number {number}"))
    }
}

/// All ports of this computer.
#[must_use]
pub fn list_serial_ports() -> Vec<SerialPortInfo> {
    // Without libudev the crate lists this folder, and panics where it is missing (a chroot without /sys).
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

/// The names of all ports, for messages.
#[must_use]
pub fn describe_port_names() -> String {
    let names: Vec<String> = list_serial_ports().into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "none found".into() } else { names.join(", ") }
}

/// The path of the port with this USB identity; without one, of the first ERA board.
#[must_use]
pub fn find_board_port_by_identity_if_given_else_first(wanted_identity: Option<&UsbIdentity>) -> Option<String> {
    find_board_port_by_identity_if_given_else_first_among(list_serial_ports(), wanted_identity)
}

fn find_board_port_by_identity_if_given_else_first_among(
    ports: Vec<SerialPortInfo>,
    wanted: Option<&UsbIdentity>,
) -> Option<String> {
    let is_it = |port: &SerialPortInfo| match (&port.port_type, wanted) {
        (SerialPortType::UsbPort(info), Some(wanted)) => UsbIdentity::from_port_info(info) == *wanted,
        (SerialPortType::UsbPort(info), None) => is_era_board(info.vid, info.pid, info.product.as_deref()),
        _ => false,
    };
    ports.into_iter().find(is_it).map(|port| port.port_name)
}

/// What USB says of the port at this path, if it is one of USB's.
#[must_use]
pub fn find_usb_identity_of_port(path: &str) -> Option<UsbIdentity> {
    // Links (/dev/serial/by-id/...) are listed by what they lead to.
    let real = std::fs::canonicalize(path).map_or_else(|_| path.to_owned(), |real| real.to_string_lossy().into_owned());
    list_serial_ports().into_iter().find(|port| port.port_name == real).and_then(|port| match port.port_type {
        SerialPortType::UsbPort(info) => Some(UsbIdentity::from_port_info(&info)),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use era_shared::link::{USB_PRODUCT, USB_VENDOR};

    fn usb(path: &str, vid: u16, pid: u16, product: Option<&str>, number: &str) -> SerialPortInfo {
        let info = UsbPortInfo {
            vid,
            pid,
            serial_number: Some(number.into()),
            manufacturer: None,
            product: product.map(Into::into),
        };
        SerialPortInfo { port_name: path.into(), port_type: SerialPortType::UsbPort(info) }
    }

    /// Nothing is written to a modem, to somebody else's test device, or to a board that is not the one.
    #[test]
    fn only_boards_are_found_and_again_only_the_same_one() {
        let all = || {
            vec![
                SerialPortInfo { port_name: "/dev/ttyS0".into(), port_type: SerialPortType::Unknown },
                usb("/dev/ttyACM0", 0x0483, 0x374e, Some("STLINK-V3"), "0"),
                usb("/dev/ttyACM1", USB_VENDOR, USB_PRODUCT, Some("somebody's keyboard"), "1"),
                usb("/dev/ttyACM4", USB_VENDOR, USB_PRODUCT, None, "2"),
                usb("/dev/ttyACM2", USB_VENDOR, USB_PRODUCT, Some("ERA_haptics_board"), "A"),
                usb("/dev/ttyACM3", USB_VENDOR, USB_PRODUCT, Some("ERA haptics board"), "B"),
            ]
        };
        assert_eq!(find_board_port_by_identity_if_given_else_first_among(all(), None).as_deref(), Some("/dev/ttyACM2"));
        let name =
            |number: &str| UsbIdentity { vendor: USB_VENDOR, product: USB_PRODUCT, serial_number: Some(number.into()) };
        assert_eq!(
            find_board_port_by_identity_if_given_else_first_among(all(), Some(&name("B"))).as_deref(),
            Some("/dev/ttyACM3")
        );
        assert_eq!(find_board_port_by_identity_if_given_else_first_among(all(), Some(&name("C"))), None);
        assert_eq!(
            find_board_port_by_identity_if_given_else_first_among(all().into_iter().take(4).collect(), None),
            None
        );
        assert_eq!(name("C").to_string(), "1209:0001 with serial number C");
    }
}

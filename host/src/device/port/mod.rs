//! Serial ports: which of them are boards, and one whose calls have limits.

mod error;
mod limit;
mod open;
pub mod users;

pub use error::PortError;
pub use limit::call_within;
pub use open::{Port, open_pseudo_terminal};
pub use users::Users;

use super::usb_ids::is_board;
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use std::fmt;

/// What USB says of a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbName {
    vendor: u16,
    product: u16,
    serial_number: Option<String>,
}

impl UsbName {
    fn of(info: &UsbPortInfo) -> Self {
        Self { vendor: info.vid, product: info.pid, serial_number: info.serial_number.clone() }
    }
}

impl fmt::Display for UsbName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}:{:04x}", self.vendor, self.product)?;
        self.serial_number.as_ref().map_or(Ok(()), |number| write!(f, " with serial number {number}"))
    }
}

/// All ports of this computer.
#[must_use]
pub fn ports() -> Vec<SerialPortInfo> {
    // Without libudev the crate lists this folder, and panics where it is missing (a chroot without /sys).
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

/// Their names, for messages.
#[must_use]
pub fn list() -> String {
    let names: Vec<String> = ports().into_iter().map(|port| port.port_name).collect();
    if names.is_empty() { "there is none".into() } else { names.join(", ") }
}

/// The path of that board, or of the first one.
#[must_use]
pub fn find(wanted: Option<&UsbName>) -> Option<String> {
    among(ports(), wanted)
}

fn among(ports: Vec<SerialPortInfo>, wanted: Option<&UsbName>) -> Option<String> {
    let is_it = |port: &SerialPortInfo| match (&port.port_type, wanted) {
        (SerialPortType::UsbPort(info), Some(wanted)) => UsbName::of(info) == *wanted,
        (SerialPortType::UsbPort(info), None) => is_board(info.vid, info.pid, info.product.as_deref()),
        _ => false,
    };
    ports.into_iter().find(is_it).map(|port| port.port_name)
}

/// What USB says of the port at this path, if it is one of USB's.
#[must_use]
pub fn usb_of(path: &str) -> Option<UsbName> {
    // Links (/dev/serial/by-id/...) are listed by what they lead to.
    let real = std::fs::canonicalize(path).map_or_else(|_| path.to_owned(), |real| real.to_string_lossy().into_owned());
    ports().into_iter().find(|port| port.port_name == real).and_then(|port| match port.port_type {
        SerialPortType::UsbPort(info) => Some(UsbName::of(&info)),
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
        assert_eq!(among(all(), None).as_deref(), Some("/dev/ttyACM2"));
        let name =
            |number: &str| UsbName { vendor: USB_VENDOR, product: USB_PRODUCT, serial_number: Some(number.into()) };
        assert_eq!(among(all(), Some(&name("B"))).as_deref(), Some("/dev/ttyACM3"));
        assert_eq!(among(all(), Some(&name("C"))), None);
        assert_eq!(among(all().into_iter().take(4).collect(), None), None);
        assert_eq!(name("C").to_string(), "1209:0001 with serial number C");
    }
}

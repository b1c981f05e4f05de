//! The ROM bootloader on the USB bus.

use super::dfuse::{ControlPipe, PipeError, TRANSFER_SIZE};
use super::layout::{Layout, LayoutError};
use crate::device::usb_ids::BOOTLOADER;
use nusb::descriptors::language_id::US_ENGLISH;
use nusb::transfer::{ControlIn, ControlOut, ControlType, Recipient, TransferError};
use nusb::{Device, DeviceInfo, Interface, MaybeFuture};
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

const VENDOR: u16 = BOOTLOADER.0;
const PRODUCT: u16 = BOOTLOADER.1;
/// Class and subclass of DFU, and its functional descriptor (DFU 1.1, section 4.1).
const CLASS: u8 = 0xFE;
const SUBCLASS: u8 = 0x01;
const FUNCTIONAL: u8 = 0x21;

/// Longest wait for one transfer. The device answers at once, except while it erases a page.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Longest wait until the bootloader is open, which takes three calls of the system and as many transfers.
const OPEN_LIMIT: Duration = Duration::from_secs(30);
/// Between two looks at the bus.
const LOOK_AGAIN: Duration = Duration::from_millis(200);

/// Why there is no bootloader to talk to.
#[derive(Debug, thiserror::Error)]
pub enum UsbError {
    /// The bus cannot be listed.
    #[error("cannot list the devices on the USB bus: {0}")]
    Bus(nusb::Error),
    /// Nobody there.
    #[error(
        "no connected board runs its bootloader (USB {VENDOR:04x}:{PRODUCT:04x}). If a daemon has the board's port open, stop this daemon. Connect a USB cable to the pins PA11 (D-) and PA12 (D+) of the board (the connector of a debug probe is not sufficient), then run the same command again. If the board does not start its bootloader, hold the pin BOOT0 (PB8) high while you switch the board on"
    )]
    None,
    /// More than one.
    #[error(
        "{0} devices that run ST's bootloader are connected, and the program cannot tell which of them is the board: \
         disconnect the other devices"
    )]
    Several(usize),
    /// It is there but cannot be used.
    #[error("{step} the board's bootloader failed: {reason}{}", if *.permission { ". Only root, and the group \
                                                                                   that `era install \
                                                                                   --flash-group` names, may \
                                                                                   write a board's firmware: run \
                                                                                   the same command with sudo. \
                                                                                   Nothing was erased: a board \
                                                                                   with complete firmware runs \
                                                                                   again after you switch its \
                                                                                   power off and on" } else { "" })]
    Open {
        /// What was tried.
        step: &'static str,
        /// The system's words.
        reason: String,
        /// Whether the system forbids it.
        permission: bool,
    },
    /// It takes less at a time than ST's bootloader.
    #[error(
        "the connected bootloader accepts fewer than {TRANSFER_SIZE} bytes at a time, so it is not ST's bootloader, and `era flash` cannot use it"
    )]
    SmallTransfers,
    /// It is another chip, or its flash is protected.
    #[error(transparent)]
    Layout(#[from] LayoutError),
}

impl UsbError {
    fn open(step: &'static str) -> impl FnOnce(nusb::Error) -> Self {
        move |error| {
            let permission = error.kind() == nusb::ErrorKind::PermissionDenied;
            Self::Open { step, reason: error.to_string(), permission }
        }
    }
}

/// The one bootloader on the bus, or `None`.
///
/// # Errors
/// [`UsbError::Bus`], [`UsbError::Several`], [`UsbError::Open`] if the system does not answer.
pub fn find_bootloader() -> Result<Option<DeviceInfo>, UsbError> {
    run_within_open_limit("finding", || {
        let devices = nusb::list_devices().wait().map_err(UsbError::Bus)?;
        let mut found: Vec<_> =
            devices.filter(|device| device.vendor_id() == VENDOR && device.product_id() == PRODUCT).collect();
        if found.len() > 1 {
            return Err(UsbError::Several(found.len()));
        }
        Ok(found.pop())
    })
}

/// Does `work` on a thread that is left behind if a driver keeps it for longer than [`OPEN_LIMIT`]: the system's calls have no time limit.
fn run_within_open_limit<T: Send + 'static>(
    step: &'static str,
    work: impl FnOnce() -> Result<T, UsbError> + Send + 'static,
) -> Result<T, UsbError> {
    let (sender, result) = sync_channel(1);
    let started = std::thread::Builder::new().spawn(move || sender.send(work()));
    started.map_err(|error| UsbError::Open { step, reason: error.to_string(), permission: false })?;
    result.recv_timeout(OPEN_LIMIT).unwrap_or_else(|_| {
        let reason = format!(
            "the operating system did not answer \
            within {OPEN_LIMIT:?}; disconnect the board and connect it again"
        );
        Err(UsbError::Open { step, reason, permission: false })
    })
}

/// Waits for the bootloader to come up.
///
/// # Errors
/// [`UsbError`]; [`UsbError::None`] when `patience` is over.
pub fn await_bootloader(patience: Duration) -> Result<DeviceInfo, UsbError> {
    let until = Instant::now() + patience;
    loop {
        match find_bootloader()? {
            Some(device) => return Ok(device),
            None if Instant::now() >= until => return Err(UsbError::None),
            None => std::thread::sleep(LOOK_AGAIN),
        }
    }
}

/// Opens the bootloader's interface to this chip's flash.
///
/// # Errors
/// [`UsbError`].
pub fn open_bootloader(info: &DeviceInfo) -> Result<(UsbPipe, Layout), UsbError> {
    let info = info.clone();
    run_within_open_limit("opening", move || open_and_claim_flash_interface(&info))
}

fn open_and_claim_flash_interface(info: &DeviceInfo) -> Result<(UsbPipe, Layout), UsbError> {
    let device = info.open().wait().map_err(UsbError::open("opening"))?;
    let (interface, alternate, layout) = find_flash_interface(&device)?;
    let interface = device.detach_and_claim_interface(interface).wait().map_err(UsbError::open("claiming"))?;
    interface.set_alt_setting(alternate).wait().map_err(UsbError::open("selecting the flash of"))?;
    Ok((UsbPipe { interface }, layout))
}

/// Interface, alternate setting and layout of the internal flash. Other alternate settings are the option bytes and the
/// like.
fn find_flash_interface(device: &Device) -> Result<(u8, u8, Layout), UsbError> {
    let broken = |reason: String| UsbError::Open { step: "reading the description of", reason, permission: false };
    let configuration = device.active_configuration().map_err(|error| broken(error.to_string()))?;
    let mut unfit = broken("the description lists no interface for the flash".into());
    for setting in configuration.interface_alt_settings() {
        let (Some(name), CLASS, SUBCLASS) = (setting.string_index(), setting.class(), setting.subclass()) else {
            continue;
        };
        let name = device.get_string_descriptor(name, US_ENGLISH, TIMEOUT).wait();
        let name = name.map_err(|error| broken(error.to_string()))?;
        if !name.starts_with("@Internal Flash") {
            continue;
        }
        // wTransferSize, bytes 5 and 6 of the functional descriptor, which follows the last alternate setting.
        let too_short = configuration.interface_alt_settings().flat_map(|it| it.descriptors()).any(|it| {
            it.descriptor_type() == FUNCTIONAL
                && matches!(it.as_bytes(), [_, _, _, _, _, low, high, ..]
                    if usize::from(u16::from_le_bytes([*low, *high])) < TRANSFER_SIZE)
        });
        match Layout::parse(&name) {
            Ok(layout) if !too_short => return Ok((setting.interface_number(), setting.alternate_setting(), layout)),
            Ok(_) => unfit = UsbError::SmallTransfers,
            Err(error) => unfit = error.into(),
        }
    }
    Err(unfit)
}

/// The bootloader's DFU interface.
pub struct UsbPipe {
    interface: Interface,
}

impl ControlPipe for UsbPipe {
    fn control_in(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, PipeError> {
        let index = u16::from(self.interface.interface_number());
        let (control_type, recipient) = (ControlType::Class, Recipient::Interface);
        let transfer = ControlIn { control_type, recipient, request, value, index, length };
        self.interface.control_in(transfer, TIMEOUT).wait().map_err(convert_transfer_error)
    }

    fn control_out(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), PipeError> {
        let index = u16::from(self.interface.interface_number());
        let (control_type, recipient) = (ControlType::Class, Recipient::Interface);
        let transfer = ControlOut { control_type, recipient, request, value, index, data };
        self.interface.control_out(transfer, TIMEOUT).wait().map_err(convert_transfer_error)
    }

    fn pause(&mut self, time: Duration) {
        std::thread::sleep(time);
    }
}

fn convert_transfer_error(error: TransferError) -> PipeError {
    match error {
        TransferError::Stall => PipeError::Stall,
        TransferError::Disconnected => PipeError::Gone,
        TransferError::Cancelled => PipeError::Other(format!("no answer within {TIMEOUT:?}")),
        error => PipeError::Other(error.to_string()),
    }
}

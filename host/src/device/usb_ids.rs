//! Who is who on the USB bus.

use era_shared::link::{USB_PRODUCT, USB_PRODUCT_NAME, USB_VENDOR};

/// USB vendor and product of the board's own connector: pid.codes' pair for tests and private use, so the product's
/// name counts as well.
pub const BOARD: (u16, u16) = (USB_VENDOR, USB_PRODUCT);
/// The board's name on the bus.
pub const BOARD_NAME: &str = USB_PRODUCT_NAME;
/// ST's bootloader, in the chip's ROM (AN2606, section 3).
pub const BOOTLOADER: (u16, u16) = (0x0483, 0xDF11);
/// ST's vendor number: that of the bootloader, and of the debug probe on a Nucleo board, which has a serial port too.
pub const ST: u16 = 0x0483;

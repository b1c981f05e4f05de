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

/// Whether USB says that this is an ERA board: its numbers, and its name, as anybody may use the numbers for tests. Some
/// systems write underscores for spaces.
#[must_use]
pub fn is_era_board(vendor: u16, product: u16, name: Option<&str>) -> bool {
    (vendor, product) == BOARD && name.is_some_and(|name| name.replace('_', " ").contains(BOARD_NAME))
}

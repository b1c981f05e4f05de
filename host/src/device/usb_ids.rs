//! Who is who on the USB bus.

/// USB vendor and product of the board's own connector: pid.codes' pair for tests and private use, so the product's
/// name counts as well.
pub const BOARD: (u16, u16) = (0x1209, 0x0001);
/// The board's name on the bus.
pub const BOARD_NAME: &str = "ERA haptics board";
/// ST's bootloader, in the chip's ROM (AN2606, section 3).
pub const BOOTLOADER: (u16, u16) = (0x0483, 0xDF11);
/// ST's vendor number: that of the bootloader, and of the debug probe on a Nucleo board, which has a serial port too.
pub const ST: u16 = 0x0483;

#[cfg(test)]
mod tests {
    use super::*;

    /// The firmware cannot share its constants, as it is a workspace of its own.
    #[test]
    fn the_board_is_who_its_firmware_says() {
        let firmware = include_str!("../../../firmware/src/links/usb.rs");
        for line in [
            format!("const VENDOR: u16 = 0x{:04x};", BOARD.0),
            format!("const PRODUCT: u16 = 0x{:04x};", BOARD.1),
            format!("const PRODUCT_NAME: &str = \"{BOARD_NAME}\";"),
        ] {
            assert!(firmware.contains(&line), "{line}");
        }
    }
}

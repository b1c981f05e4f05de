//! The udev rule: who may use the board, and that ModemManager leaves it alone.

use super::files::MARK;
use crate::device::usb_ids::{BOARD, BOARD_NAME, BOOTLOADER};

/// Where the rule goes. Its number is below that of systemd's `73-seat-late.rules`, which acts on `uaccess`.
pub const PATH: &str = "etc/udev/rules.d/70-era.rules";
/// Where packages may have put it.
pub const PACKAGED: [&str; 2] = ["usr/lib/udev/rules.d/70-era.rules", "lib/udev/rules.d/70-era.rules"];
/// The group that may use the board unless another one is named.
pub const GROUP: &str = "plugdev";

/// The rule's text, for a group of users.
#[must_use]
pub fn text(group: &str) -> String {
    let rights = format!("GROUP=\"{group}\", MODE=\"0660\", TAG+=\"uaccess\"");
    let matching = |(vendor, product): (u16, u16), attribute: &str| {
        format!("{attribute}{{idVendor}}==\"{vendor:04x}\", {attribute}{{idProduct}}==\"{product:04x}\"")
    };
    let (own, parent, bootloader) = (matching(BOARD, "ATTR"), matching(BOARD, "ATTRS"), matching(BOOTLOADER, "ATTR"));
    let usb = "SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\"";
    format!(
        "{MARK}\n\
         # Whoever sits at the machine and the group {group} may use the board; ModemManager does not try it for a modem.\n\
         ACTION==\"remove\", GOTO=\"era_end\"\n\n\
         # The board: its numbers are shared with other devices, its name is not.\n\
         {usb}, {own}, ATTR{{product}}==\"{BOARD_NAME}\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\", {rights}\n\
         SUBSYSTEM==\"tty\", {parent}, ATTRS{{product}}==\"{BOARD_NAME}\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\", \
         ENV{{ID_MM_PORT_IGNORE}}=\"1\", {rights}\n\n\
         # The bootloader in the chip's ROM, for `era flash`.\n\
         {usb}, {bootloader}, ENV{{ID_MM_DEVICE_IGNORE}}=\"1\", {rights}\n\n\
         LABEL=\"era_end\"\n"
    )
}

/// Whether a rule's text is about the board, whoever wrote it.
#[must_use]
pub fn is_for_board(text: &str) -> bool {
    let (vendor, product) = (format!("{:04x}", BOARD.0), format!("{:04x}", BOARD.1));
    text.lines().map(str::trim).any(|line| !line.starts_with('#') && line.contains(&vendor) && line.contains(&product))
}

/// Whether a rule's text keeps ModemManager away from the board.
#[must_use]
pub fn ignores_modem_manager(text: &str) -> bool {
    is_for_board(text) && text.lines().any(|line| !line.trim().starts_with('#') && line.contains("ID_MM_DEVICE_IGNORE"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_names_board_and_bootloader() {
        let text = text("plugdev");
        assert!(is_for_board(&text) && ignores_modem_manager(&text));
        for words in ["ATTR{idProduct}==\"df11\"", "ATTRS{idVendor}==\"1209\"", "TAG+=\"uaccess\"", "GROUP=\"plugdev\""]
        {
            assert!(text.contains(words), "{words} in {text}");
        }
        // udev continues no line, so each has to stand for itself.
        let rules: Vec<&str> = text.lines().filter(|line| line.starts_with("SUBSYSTEM")).collect();
        assert_eq!(rules.len(), 3);
        assert!(rules.iter().all(|rule| rule.contains("MODE=\"0660\"") && rule.contains("ID_MM_DEVICE_IGNORE")));
    }

    #[test]
    fn a_comment_is_no_rule() {
        let text = "# idVendor 1209, idProduct 0001\nATTRS{idVendor}==\"0483\", ATTRS{idProduct}==\"df11\"";
        assert!(!is_for_board(text) && !ignores_modem_manager(text));
        let older = "ATTRS{idVendor}==\"1209\", ATTRS{idProduct}==\"0001\", TAG+=\"uaccess\"";
        assert!(is_for_board(older) && !ignores_modem_manager(older));
    }
}

//! The udev rule: who may use the board, and that ModemManager leaves it alone.

use super::files::MARK;
use crate::device::usb_ids::{BOARD, BOARD_NAME, BOOTLOADER};

/// Where the rule goes. Its number is below that of systemd's `73-seat-late.rules`, which acts on `uaccess`.
pub const PATH: &str = "etc/udev/rules.d/70-era.rules";
/// Where packages may have put it.
pub const PACKAGED: [&str; 2] = ["usr/lib/udev/rules.d/70-era.rules", "lib/udev/rules.d/70-era.rules"];
/// The group that may use the board unless another one is named.
pub const GROUP: &str = "plugdev";

/// The rule's text, for a group of users who may drive the board, and one of those who may write its firmware, if there is to be one beside root.
///
/// Whoever may open the running board's USB device itself can reach around its serial port, and whoever may open the bootloader's can write any firmware, which need not keep any limit. So
/// nobody is given the first, and nobody the second for sitting at the machine.
#[must_use]
pub fn format_rule(group: &str, flash_group: Option<&str>) -> String {
    let rights = format!("GROUP=\"{group}\", MODE=\"0660\", TAG+=\"uaccess\"");
    let flashers = flash_group.map_or_else(|| "only root".into(), |group| format!("root and the group {group}"));
    let flash_rights = flash_group.map_or_else(String::new, |group| format!(", GROUP=\"{group}\", MODE=\"0660\""));
    let matching = |(vendor, product): (u16, u16), attribute: &str| {
        format!("{attribute}{{idVendor}}==\"{vendor:04x}\", {attribute}{{idProduct}}==\"{product:04x}\"")
    };
    let (own, parent, bootloader) = (matching(BOARD, "ATTR"), matching(BOARD, "ATTRS"), matching(BOOTLOADER, "ATTR"));
    let usb = "SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\"";
    format!(
        "{MARK}\n\
         # The group {group} and the user who is logged in at the machine may use the board's serial port. \
         ModemManager ignores this port.\n\
         ACTION==\"remove\", GOTO=\"era_end\"\n\n\
         # Other products have the same USB vendor and product IDs as the board, so these rules also check the \
         product name. Only root may use the board's USB device itself.\n\
         {usb}, {own}, ATTR{{product}}==\"{BOARD_NAME}\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\"\n\
         SUBSYSTEM==\"tty\", {parent}, ATTRS{{product}}==\"{BOARD_NAME}\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\", \
         ENV{{ID_MM_PORT_IGNORE}}=\"1\", {rights}\n\n\
         # The bootloader in the chip's ROM accepts any firmware. {flashers} may use this bootloader (`era \
         flash`).\n\
         {usb}, {bootloader}, ENV{{ID_MM_DEVICE_IGNORE}}=\"1\"{flash_rights}\n\n\
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
        let text = format_rule("plugdev", None);
        assert!(is_for_board(&text) && ignores_modem_manager(&text));
        for words in ["ATTR{idProduct}==\"df11\"", "ATTRS{idVendor}==\"1209\"", "TAG+=\"uaccess\"", "GROUP=\"plugdev\""]
        {
            assert!(text.contains(words), "{words} in {text}");
        }
        // udev continues no line, so each has to stand for itself.
        let rules: Vec<&str> = text.lines().filter(|line| line.starts_with("SUBSYSTEM")).collect();
        assert_eq!(rules.len(), 3);
        assert!(rules.iter().all(|rule| rule.contains("ID_MM_DEVICE_IGNORE")));
    }

    /// By the serial port alone: who has a board's USB device, or its bootloader's, can write another firmware.
    #[test]
    fn the_rule_lets_nobody_flash_who_is_not_named() {
        let rights = ["MODE", "GROUP", "OWNER", "uaccess", "0666", "0660"];
        let of = |text: &str| -> Vec<(bool, Vec<&'static str>)> {
            let lines: Vec<String> =
                text.lines().filter(|line| line.starts_with("SUBSYSTEM")).map(str::to_owned).collect();
            let given = |line: &String| rights.into_iter().filter(|word| line.contains(word)).collect();
            lines.iter().map(|line| (line.starts_with("SUBSYSTEM==\"tty\""), given(line))).collect()
        };
        let tty = vec!["MODE", "GROUP", "uaccess", "0660"];
        let alone = format_rule("plugdev", None);
        assert_eq!(of(&alone), [(false, vec![]), (true, tty.clone()), (false, vec![])]);
        let named = format_rule("plugdev", Some("builders"));
        assert_eq!(of(&named), [(false, vec![]), (true, tty), (false, vec!["MODE", "GROUP", "0660"])]);
        assert!(named.lines().any(|line| line.contains("df11") && line.contains("GROUP=\"builders\"")));
    }

    #[test]
    fn a_comment_is_no_rule() {
        let text = "# idVendor 1209, idProduct 0001\nATTRS{idVendor}==\"0483\", ATTRS{idProduct}==\"df11\"";
        assert!(!is_for_board(text) && !ignores_modem_manager(text));
        let older = "ATTRS{idVendor}==\"1209\", ATTRS{idProduct}==\"0001\", TAG+=\"uaccess\"";
        assert!(is_for_board(older) && !ignores_modem_manager(older));
    }
}

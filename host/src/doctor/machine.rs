//! What the machine itself tells: ports, rules, processes, limits. Paths are looked up below a folder, `/` but in tests.

use super::facts::{Port, Rule, Usb};
use crate::device::port;
pub use crate::device::port::users::{find_group_with_access_and_membership, find_other_processes_with_port_open};
use crate::device::port::users::{list_pids_and_proc_folders, read_process_name_or_unknown};
use crate::flash::usb::{UsbError, find_bootloader};
use crate::install::rule::{ignores_modem_manager, is_for_board};
use serialport::SerialPortType;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Folders of udev rules.
const RULES: [&str; 4] = ["etc/udev/rules.d", "run/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d"];

/// The serial ports, by path.
#[must_use]
pub fn list_serial_ports_with_usb_identity() -> Vec<Port> {
    let mut ports: Vec<Port> = port::list_serial_ports()
        .into_iter()
        .map(|port| Port {
            path: port.port_name,
            usb: match port.port_type {
                SerialPortType::UsbPort(usb) => Some(Usb { vendor: usb.vid, product: usb.pid, name: usb.product }),
                _ => None,
            },
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// Whether a chip waits in its bootloader; `None` if the bus cannot be looked at.
#[must_use]
pub fn is_chip_in_bootloader_on_usb_if_usb_is_readable() -> Option<bool> {
    match find_bootloader() {
        Ok(found) => Some(found.is_some()),
        Err(UsbError::Several(_)) => Some(true),
        Err(_) => None,
    }
}

/// The udev rules that name the board; `None` where there is no folder of rules.
#[must_use]
pub fn find_udev_rules_for_board_if_machine_has_udev(root: &Path) -> Option<Vec<Rule>> {
    let folders: Vec<_> = RULES.iter().filter_map(|folder| fs::read_dir(root.join(folder)).ok()).collect();
    if folders.is_empty() {
        return None;
    }
    // The last two folders are one on most machines.
    let mut seen = BTreeSet::new();
    let mut rules = Vec::new();
    for path in folders.into_iter().flatten().flatten().map(|entry| entry.path()) {
        let is_rule = path.extension().is_some_and(|extension| extension == "rules");
        if !is_rule || !seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
            continue;
        }
        if let Some(text) = fs::read_to_string(&path).ok().filter(|text| is_for_board(text)) {
            let ignores_modem_manager = ignores_modem_manager(&text);
            rules.push(Rule { path: path.display().to_string(), ignores_modem_manager });
        }
    }
    // What keeps ModemManager away is told first.
    rules.sort_by(|a, b| b.ignores_modem_manager.cmp(&a.ignores_modem_manager).then_with(|| a.path.cmp(&b.path)));
    Some(rules)
}

/// ModemManager's process, if it runs.
#[must_use]
pub fn find_modem_manager_pid(root: &Path) -> Option<u32> {
    list_pids_and_proc_folders(root)
        .into_iter()
        .find(|(_, folder)| read_process_name_or_unknown(folder) == "ModemManager")
        .map(|(pid, _)| pid)
}

/// The highest real-time priority that this process may ask for.
#[must_use]
pub fn read_realtime_priority_limit(root: &Path) -> Option<u64> {
    let limits = fs::read_to_string(root.join("proc/self/limits")).ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max realtime priority"))?;
    match line.split_whitespace().next()? {
        "unlimited" => Some(99),
        number => number.parse().ok(),
    }
}

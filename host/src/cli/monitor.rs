//! `era monitor`: the log of a board's firmware.

use super::args_board::Monitor;
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::device::Target;
use crate::doctor::machine;
use crate::flash::board::Board;
use crate::flash::check::Version;
use crate::flash::image::{Image, default_path};
use crate::flash::probe::ProbeRs;
use crate::monitor::LogTable;
use std::path::Path;
use std::time::Duration;

/// Between two looks at an empty log: short for a person, long for a link that also carries drives.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

pub fn decode_and_print_board_log(options: &Monitor) -> CommandResult {
    let target = options.port.clone().unwrap_or(Target::Auto);
    if !options.probe
        && let Some(taken) = describe_port_holders_with_advice_if_any(&target)
    {
        return Err(Failure::Failed(taken));
    }
    let path = options.elf.clone().unwrap_or_else(default_path);
    let (image, elf) = Image::read(&path).map_err(Failure::usage_error)?;
    if options.probe {
        return ProbeRs::default().show_log_until_interrupted(&path).map_err(Failure::runtime_error);
    }
    let table = LogTable::from_elf(&elf).map_err(Failure::usage_error)?;
    let mut board = Board::open(&target).map_err(Failure::runtime_error)?;
    let running = board.identity.firmware;
    tracing::info!("showing the log of firmware {} of the board at {}", Version(running), board.path());
    if running != image.header.firmware {
        tracing::warn!(
            "the image {} contains firmware {}, but the board runs firmware {}: lines of the log may be missing or \
            wrong. Write the image to the board with `era flash`, or name the image of the board's firmware with \
            --elf",
            path.display(),
            Version(image.header.firmware),
            Version(running)
        );
    }
    let mut decoder = table.decoder();
    loop {
        let bytes = board.log().map_err(Failure::runtime_error)?;
        if bytes.is_empty() {
            std::thread::sleep(LOOK_AGAIN);
            continue;
        }
        let mut lines = Vec::new();
        decoder.feed(&bytes, |line| lines.push(line));
        for line in lines {
            if options.json { print_json(&line)? } else { print_text_after_queued_log(&line.to_string())? }
        }
    }
}

/// Who has the port, if somebody has: two programs at one port take each other's bytes.
fn describe_port_holders_with_advice_if_any(target: &Target) -> Option<String> {
    let port = match target {
        Target::Serial(path) => path.clone(),
        Target::Auto => {
            machine::list_serial_ports_with_usb_identity().into_iter().find(crate::doctor::facts::Port::is_board)?.path
        }
        Target::Sim | Target::Emulated => return None,
    };
    let holders = machine::find_other_processes_with_port_open(Path::new("/"), &port);
    let names: Vec<String> = holders.iter().map(|it| format!("{} (process {})", it.name, it.pid)).collect();
    let advice = if holders.iter().any(|holder| holder.name == "era") {
        "only one program can use the port of a board: end the daemon first (`systemctl stop era`, if the daemon is the service)"
    } else {
        "end that program first"
    };
    (!names.is_empty()).then(|| format!("{port} is open in {}: {advice}", names.join(", ")))
}

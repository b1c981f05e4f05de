//! `era flash`: the firmware onto a board.

use super::args_board::Flash;
use super::terminal_messages::tell;
use super::{CommandResult, Failure, print_json};
use crate::device::{Target, TargetError};
use crate::flash::board::{Board, BoardError};
use crate::flash::check::{InstalledFirmware, Version, check_image};
use crate::flash::dfuse::Dfuse;
use crate::flash::image::{Image, default_path};
use crate::flash::probe::{ProbeError, ProbeRs};
use crate::flash::program::{Stage, program_image, read_header_on_board};
use crate::flash::usb;
use era_shared::image::FLASH_START;
use era_shared::protocol::FirmwareVersion;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::io::{BufRead, IsTerminal, Write};
use std::path::PathBuf;
use std::time::Duration;

/// How long the chip may take until its bootloader is on the bus.
const BOOTLOADER_START: Duration = Duration::from_secs(10);

/// How the image gets onto the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FlashRoute {
    Probe,
    Dfu,
}

pub fn run_flash(options: &Flash) -> CommandResult {
    if matches!(options.port, Some(Target::Sim | Target::Emulated)) {
        return Err(Failure::usage_error(
            "only a board can be flashed: use --port with auto or the path of a serial port",
        ));
    }
    let path = options.image.clone().unwrap_or_else(default_path);
    let (image, _) = Image::read(&path).map_err(Failure::usage_error)?;
    tell!(
        "image    {} {}, {} bytes, {}",
        image.header.name(),
        Version(image.header.firmware),
        image.bytes().len(),
        path.display()
    );
    let job = FlashJob { options, path, image };
    let way = job.choose_requested_route_or_probe_if_usable_else_dfu()?;
    let board = job.open_idle_board_unless_none_runs_firmware(way)?;
    let (before, first_stage_replaced) = match way {
        FlashRoute::Probe => (job.ask_and_flash_by_probe_and_get_previous_firmware(board)?, None),
        FlashRoute::Dfu => {
            let DfuFlashed { previous_firmware, was_first_stage_replaced } =
                job.ask_and_flash_by_dfu_entering_bootloader_first(board)?;
            (previous_firmware, Some(was_first_stage_replaced))
        }
    };
    let runs = job.await_new_firmware_false_if_silent_error_if_other_firmware()?;
    if options.json {
        return print_json(&json!({
            "image": {"path": job.path, "name": job.image.header.name(), "firmware": version_to_json(job.image.header.firmware)},
            "way": if way == FlashRoute::Probe { "probe" } else { "dfu" },
            "before": before.map(|it| version_to_json(it.firmware)),
            "first_stage_replaced": first_stage_replaced,
            "answers": runs,
        }));
    }
    Ok(())
}

/// What is known after an image was written over USB.
struct DfuFlashed {
    /// The firmware that was on the board, if there was one.
    previous_firmware: Option<InstalledFirmware>,
    /// Whether the image's first stage differed from the board's and was written too.
    was_first_stage_replaced: bool,
}

struct FlashJob<'a> {
    options: &'a Flash,
    path: PathBuf,
    image: Image,
}

impl FlashJob<'_> {
    /// A probe, if there is one; else USB.
    fn choose_requested_route_or_probe_if_usable_else_dfu(&self) -> Result<FlashRoute, Failure> {
        if self.options.dfu {
            return Ok(FlashRoute::Dfu);
        }
        match ProbeRs::default().check_probe_connected() {
            Ok(()) => Ok(FlashRoute::Probe),
            Err(error) if self.options.probe => Err(Failure::runtime_error(error)),
            Err(ProbeError::NotInstalled(_) | ProbeError::NoProbe) => Ok(FlashRoute::Dfu),
            Err(error) => {
                tell!("this command flashes over USB instead of the debug probe, which cannot be used: {error}");
                Ok(FlashRoute::Dfu)
            }
        }
    }

    /// The board, if its firmware answers. Where its port is not named, none need answer: it may be in its bootloader, or
    /// without a firmware.
    fn open_idle_board_unless_none_runs_firmware(&self, way: FlashRoute) -> Result<Option<Board>, Failure> {
        let waiting = way == FlashRoute::Dfu && usb::find_bootloader().map_err(Failure::runtime_error)?.is_some();
        match &self.options.port {
            Some(_) if waiting => Err(Failure::runtime_error(
                "a board is already in its bootloader, so --port cannot be used: omit --port to flash this board, or \
                 disconnect this board",
            )),
            None if waiting => Ok(None),
            port => match Board::open(port.as_ref().unwrap_or(&Target::Auto)) {
                Ok(mut board) => {
                    board.check_idle().map_err(Failure::runtime_error)?;
                    Ok(Some(board))
                }
                Err(BoardError::Target(TargetError::NoneFound { .. })) if port.is_none() => Ok(None),
                Err(error) => Err(Failure::runtime_error(error)),
            },
        }
    }

    fn ask_and_flash_by_probe_and_get_previous_firmware(
        &self,
        board: Option<Board>,
    ) -> Result<Option<InstalledFirmware>, Failure> {
        let probe = ProbeRs::default();
        probe.check_chip().map_err(Failure::runtime_error)?;
        let before = match &board {
            Some(board) => {
                if probe.read_board_id().map_err(Failure::runtime_error)? != board.identity.board_id {
                    return Err(Failure::runtime_error(format!(
                        "the debug probe is not connected to the board that answers at {}: nothing was changed. \
                         Connect the probe to this board, or name the port of the probe's board with --port",
                        board.path()
                    )));
                }
                Some(board.installed_firmware())
            }
            None => probe.read_header_on_board().map_err(Failure::runtime_error)?.as_ref().map(InstalledFirmware::from),
        };
        self.check_image_and_ask_before_flashing(before, "the debug probe")?;
        // Its port is closed, as the program may reset the board.
        drop(board);
        probe.write_and_start_image(&self.path).map_err(Failure::runtime_error)?;
        Ok(before)
    }

    fn ask_and_flash_by_dfu_entering_bootloader_first(&self, board: Option<Board>) -> Result<DfuFlashed, Failure> {
        let before = board.as_ref().map(Board::installed_firmware);
        let (device, allowed) = match board {
            Some(board) => {
                self.check_image_and_ask_before_flashing(before, board.path())?;
                board.enter_bootloader().map_err(Failure::runtime_error)?;
                (usb::await_bootloader(BOOTLOADER_START).map_err(Failure::runtime_error)?, true)
            }
            None => (usb::await_bootloader(Duration::ZERO).map_err(Failure::runtime_error)?, false),
        };
        let (pipe, layout) = usb::open_bootloader(&device).map_err(Failure::runtime_error)?;
        let mut dfu = Dfuse::open(pipe).map_err(Failure::runtime_error)?;
        let before = match before {
            Some(before) => Some(before),
            None => {
                read_header_on_board(&mut dfu).map_err(Failure::runtime_error)?.as_ref().map(InstalledFirmware::from)
            }
        };
        if !allowed {
            self.check_image_and_ask_before_flashing(before, "the USB bootloader")?;
        }
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{msg:9} {bar:40} {bytes}/{total_bytes} ({elapsed})") {
            bar.set_style(style);
        }
        let done = program_image(&mut dfu, &layout, &self.image, |stage, done, total| {
            bar.set_message(match stage {
                Stage::Erase => "erasing",
                Stage::Write => "writing",
                Stage::Verify => "verifying",
            });
            bar.set_length(total.into());
            bar.set_position(done.into());
        });
        bar.finish_and_clear();
        let done = done.map_err(Failure::runtime_error)?;
        dfu.leave_for_program_at(FLASH_START).map_err(Failure::runtime_error)?;
        Ok(DfuFlashed { previous_firmware: before, was_first_stage_replaced: done.first_stage_replaced })
    }

    /// Checks the image against the board, shows what is about to happen, and asks.
    fn check_image_and_ask_before_flashing(&self, before: Option<InstalledFirmware>, place: &str) -> CommandResult {
        let after = Version(self.image.header.firmware);
        match before {
            Some(before) => {
                tell!("board    firmware {} at {place}; to be replaced by {after}", Version(before.firmware));
            }
            None => tell!("board    no ERA firmware at {place}; firmware to be written: {after}"),
        }
        check_image(&self.image.header, before.as_ref(), self.options.force).map_err(Failure::runtime_error)?;
        if self.options.yes {
            return Ok(());
        }
        let question = "First switch the high-voltage supply off with the switch on the supply. While this program \
                        flashes the chip, the chip cannot keep the supply off.";
        if !std::io::stdin().is_terminal() {
            return Err(Failure::usage_error(format!("{question} Use --yes if the supply is off")));
        }
        eprint!("{question} Is the supply off? [y/N] ");
        let mut answer = String::new();
        std::io::stderr().flush().map_err(Failure::runtime_error)?;
        std::io::stdin().lock().read_line(&mut answer).map_err(Failure::runtime_error)?;
        if matches!(answer.trim(), "y" | "Y" | "yes") {
            return Ok(());
        }
        Err(Failure::runtime_error("the command was cancelled, and the board was not changed"))
    }

    /// Waits for the new firmware; whether it answers. Over which port it would is not known if none was named.
    fn await_new_firmware_false_if_silent_error_if_other_firmware(&self) -> Result<bool, Failure> {
        let target = self.options.port.clone().unwrap_or(Target::Auto);
        match Board::wait_for(&target) {
            Ok(board) if board.identity.firmware == self.image.header.firmware => {
                tell!(
                    "done     the board at {} answers with firmware {}",
                    board.path(),
                    Version(board.identity.firmware)
                );
                Ok(true)
            }
            Ok(board) => Err(Failure::runtime_error(format!(
                "the image was written and read back, but the board at {} answers with firmware {}: check that \
                 this board is the board that was flashed; if so, switch the board's power off and on",
                board.path(),
                Version(board.identity.firmware)
            ))),
            Err(error) => {
                tell!("done     the image was written and read back; no board answers yet: {error}");
                Ok(false)
            }
        }
    }
}

fn version_to_json(firmware: FirmwareVersion) -> Value {
    let FirmwareVersion { major, minor, patch, commit } = firmware;
    json!({"version": format!("{major}.{minor}.{patch}"), "commit": String::from_utf8_lossy(&commit)})
}

//! `era flash`: the firmware onto a board.

use super::args_board::Flash;
use super::told::tell;
use super::{Failure, Outcome, print_json};
use crate::device::{Target, TargetError};
use crate::flash::board::{Board, BoardError};
use crate::flash::check::{OnBoard, Version, check_image};
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
enum Way {
    Probe,
    Dfu,
}

pub fn run_flash(options: &Flash) -> Outcome {
    if matches!(options.port, Some(Target::Sim | Target::Emulated)) {
        return Err(Failure::usage("only a board can be flashed: use --port with auto or the path of a serial port"));
    }
    let path = options.image.clone().unwrap_or_else(default_path);
    let (image, _) = Image::read(&path).map_err(Failure::usage)?;
    tell!(
        "image    {} {}, {} bytes, {}",
        image.header.name(),
        Version(image.header.firmware),
        image.bytes().len(),
        path.display()
    );
    let job = Job { options, path, image };
    let way = job.way()?;
    let board = job.board(way)?;
    let (before, first_stage_replaced) = match way {
        Way::Probe => (job.by_probe(board)?, None),
        Way::Dfu => job.by_dfu(board).map(|(before, replaced)| (before, Some(replaced)))?,
    };
    let runs = job.confirm_start()?;
    if options.json {
        return print_json(&json!({
            "image": {"path": job.path, "name": job.image.header.name(), "firmware": version_json(job.image.header.firmware)},
            "way": if way == Way::Probe { "probe" } else { "dfu" },
            "before": before.map(|it| version_json(it.firmware)),
            "first_stage_replaced": first_stage_replaced,
            "answers": runs,
        }));
    }
    Ok(())
}

struct Job<'a> {
    options: &'a Flash,
    path: PathBuf,
    image: Image,
}

impl Job<'_> {
    /// A probe, if there is one; else USB.
    fn way(&self) -> Result<Way, Failure> {
        if self.options.dfu {
            return Ok(Way::Dfu);
        }
        match ProbeRs::default().find() {
            Ok(()) => Ok(Way::Probe),
            Err(error) if self.options.probe => Err(Failure::failed(error)),
            Err(ProbeError::NotInstalled(_) | ProbeError::NoProbe) => Ok(Way::Dfu),
            Err(error) => {
                tell!("no debug probe: {error}");
                Ok(Way::Dfu)
            }
        }
    }

    /// The board, if its firmware answers. Where its port is not named, none need answer: it may be in its bootloader, or
    /// without a firmware.
    fn board(&self, way: Way) -> Result<Option<Board>, Failure> {
        let waiting = way == Way::Dfu && usb::find_bootloader().map_err(Failure::failed)?.is_some();
        match &self.options.port {
            Some(_) if waiting => Err(Failure::failed(
                "a board is already in its bootloader: omit --port to flash that board, or disconnect it",
            )),
            None if waiting => Ok(None),
            port => match Board::open(port.as_ref().unwrap_or(&Target::Auto)) {
                Ok(mut board) => {
                    board.check_idle().map_err(Failure::failed)?;
                    Ok(Some(board))
                }
                Err(BoardError::Target(TargetError::NoneFound { .. })) if port.is_none() => Ok(None),
                Err(error) => Err(Failure::failed(error)),
            },
        }
    }

    fn by_probe(&self, board: Option<Board>) -> Result<Option<OnBoard>, Failure> {
        let probe = ProbeRs::default();
        probe.check_chip().map_err(Failure::failed)?;
        let before = match &board {
            Some(board) => {
                if probe.board_id().map_err(Failure::failed)? != board.identity.board_id {
                    return Err(Failure::failed(format!(
                        "the probe is connected to another board than the one that answers at {}: nothing was changed",
                        board.path()
                    )));
                }
                Some(board.on_board())
            }
            None => probe.header_on_board().map_err(Failure::failed)?.as_ref().map(OnBoard::from),
        };
        self.allow(before, "the debug probe")?;
        // Its port is closed, as the program may reset the board.
        drop(board);
        probe.write(&self.path).map_err(Failure::failed)?;
        Ok(before)
    }

    fn by_dfu(&self, board: Option<Board>) -> Result<(Option<OnBoard>, bool), Failure> {
        let before = board.as_ref().map(Board::on_board);
        let (device, allowed) = match board {
            Some(board) => {
                self.allow(before, board.path())?;
                board.enter_bootloader().map_err(Failure::failed)?;
                (usb::await_bootloader(BOOTLOADER_START).map_err(Failure::failed)?, true)
            }
            None => (usb::await_bootloader(Duration::ZERO).map_err(Failure::failed)?, false),
        };
        let (pipe, layout) = usb::open_bootloader(&device).map_err(Failure::failed)?;
        let mut dfu = Dfuse::open(pipe).map_err(Failure::failed)?;
        let before = match before {
            Some(before) => Some(before),
            None => read_header_on_board(&mut dfu).map_err(Failure::failed)?.as_ref().map(OnBoard::from),
        };
        if !allowed {
            self.allow(before, "USB, in its bootloader")?;
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
        let done = done.map_err(Failure::failed)?;
        dfu.leave(FLASH_START).map_err(Failure::failed)?;
        Ok((before, done.first_stage_replaced))
    }

    /// Checks the image against the board, shows what is about to happen, and asks.
    fn allow(&self, before: Option<OnBoard>, place: &str) -> Outcome {
        let after = Version(self.image.header.firmware);
        match before {
            Some(before) => tell!("board    {}, at {place} -> {after}", Version(before.firmware)),
            None => tell!("board    no ERA firmware on it, at {place} -> {after}"),
        }
        check_image(&self.image.header, before.as_ref(), self.options.force).map_err(Failure::failed)?;
        if self.options.yes {
            return Ok(());
        }
        let question = "The high-voltage supply must be off at its own switch: a chip that is being flashed does \
                        not hold the pins that disable the supply.";
        if !std::io::stdin().is_terminal() {
            return Err(Failure::usage(format!("{question} Use --yes if the supply is off")));
        }
        eprint!("{question} Is the supply off? [y/N] ");
        let mut answer = String::new();
        std::io::stderr().flush().map_err(Failure::failed)?;
        std::io::stdin().lock().read_line(&mut answer).map_err(Failure::failed)?;
        if matches!(answer.trim(), "y" | "Y" | "yes") {
            return Ok(());
        }
        Err(Failure::failed("nothing was changed"))
    }

    /// Waits for the new firmware; whether it answers. Over which port it would is not known if none was named.
    fn confirm_start(&self) -> Result<bool, Failure> {
        let target = self.options.port.clone().unwrap_or(Target::Auto);
        match Board::wait_for(&target) {
            Ok(board) if board.identity.firmware == self.image.header.firmware => {
                tell!("done     {} answers at {}", Version(board.identity.firmware), board.path());
                Ok(true)
            }
            Ok(board) => Err(Failure::failed(format!(
                "the image was written and read back, but the board at {} answers with {}: check that it is the \
                 same board, and if so power it down and up",
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

fn version_json(firmware: FirmwareVersion) -> Value {
    let FirmwareVersion { major, minor, patch, commit } = firmware;
    json!({"version": format!("{major}.{minor}.{patch}"), "commit": String::from_utf8_lossy(&commit)})
}

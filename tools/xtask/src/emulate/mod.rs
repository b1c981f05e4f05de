//! `cargo xtask emulate`: the firmware image on the emulated board.

pub mod bridge;
pub mod link;
pub mod report;
mod terminal;

use crate::error::Error;
use crate::process::run_command;
use crate::{elf, image, repository_root};
use bridge::{Bridge, Pace};
use clap::ValueEnum;
use report::{ReportEnd, ReportPart};
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;
use terminal::Terminal;

/// Options of `cargo xtask emulate`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Say hello this many times, print how long the answers took, and end.
    #[arg(long, value_name = "TIMES", conflicts_with = "report")]
    measure: Option<usize>,
    /// Take the image through everything it can do and every fault, print what its registers should hold and do hold, and
    /// fail on any difference.
    #[arg(long)]
    report: bool,
    /// End the report at its first wrong row.
    #[arg(long, requires = "report")]
    first_wrong: bool,
    /// Only this part of the report; may be given several times.
    #[arg(long = "part", value_name = "PART", requires = "report")]
    parts: Vec<ReportPart>,
    /// Run this image instead of building one.
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
}

/// Builds, starts the bridge, says hello, then hands the bridge's control channel to the terminal until it is closed.
///
/// # Errors
/// What went wrong on the way; [`Error::Report`] if the report found a difference.
pub fn build_image_and_run_emulator_or_board_report(options: &Options) -> Result<(), Error> {
    let image = match &options.image {
        Some(image) => image.clone(),
        None => image::build_image_and_return_target_source(false)?.0,
    };
    let usage = elf::read_memory_usage(&image)?;
    eprintln!("emulate: image of {} bytes, {}", usage.flash, image.display());
    if options.report {
        let end = if options.first_wrong { ReportEnd::FirstWrongRow } else { ReportEnd::LastRow };
        let parts = if options.parts.is_empty() { ReportPart::value_variants() } else { &options.parts };
        return report::run_board_checks_printing_report_exiting_at_first_wrong_if_asked(&image, parts, end);
    }
    let mut bridge = Bridge::start(&image, Pace::Wall)?;
    println!("{}", bridge.terminal_path().display());
    let mut terminal = Terminal::open(bridge.terminal_path())?;
    send_hello_and_print_answer(&mut terminal)?;
    if let Some(times) = options.measure {
        return measure_and_print_hello_round_trips(&mut bridge, &mut terminal, times);
    }
    drop(terminal);
    eprintln!("emulate: type commands of the bridge here, one JSON object per line; Ctrl-D ends the emulator");
    bridge.connect_control_channel_to_standard_io()
}

/// The tests of the emulated board itself, then the report.
///
/// # Errors
/// As [`build_image_and_run_emulator_or_board_report`].
pub fn run_emulator_self_test_and_board_report() -> Result<(), Error> {
    let image = image::build_image_and_return_target_source(false)?.0;
    run_command(
        Command::new("python3")
            .arg(repository_root()?.join("tools/emulator/launch.py"))
            .args(["--self-test", "--elf"])
            .arg(&image),
    )?;
    let parts = ReportPart::value_variants();
    report::run_board_checks_printing_report_exiting_at_first_wrong_if_asked(&image, parts, ReportEnd::LastRow)
}

fn send_hello_and_print_answer(terminal: &mut Terminal) -> Result<(), Error> {
    let started = Instant::now();
    let hello = terminal.send_hello()?;
    let version = hello.firmware;
    eprintln!(
        "emulate: hello from board {} after {:.0} ms: firmware {}.{}.{}, protocol {} to {}, {} channels",
        String::from_utf8_lossy(&hello.board_id),
        started.elapsed().as_secs_f64() * 1e3,
        version.major,
        version.minor,
        version.patch,
        hello.protocol_min,
        hello.protocol_current,
        hello.channels.len()
    );
    Ok(())
}

fn measure_and_print_hello_round_trips(
    bridge: &mut Bridge,
    terminal: &mut Terminal,
    repeats: usize,
) -> Result<(), Error> {
    let mut milliseconds = Vec::with_capacity(repeats);
    let before = bridge.read_emulated_and_wall_times()?;
    for _ in 0..repeats {
        let started = Instant::now();
        terminal.send_hello()?;
        milliseconds.push(started.elapsed().as_secs_f64() * 1e3);
    }
    let after = bridge.read_emulated_and_wall_times()?;
    milliseconds.sort_by(f64::total_cmp);
    let at = |fraction: f64| {
        let index = (fraction * (milliseconds.len().max(1) - 1) as f64).round() as usize;
        milliseconds.get(index).copied().unwrap_or(f64::NAN)
    };
    println!("round trips     {repeats}");
    println!("median          {:.1} ms", at(0.5));
    println!("99 % within     {:.1} ms", at(0.99));
    println!("virtual / wall  {:.2}", (after.virtual_s - before.virtual_s) / (after.wall_s - before.wall_s));
    Ok(())
}

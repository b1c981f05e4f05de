//! `cargo xtask emulate --report`: the shipped image taken through everything it can do and every fault that can be injected.
//!
//! What the registers should hold is worked out here from `era_shared::waveform`; what they hold is read from the board.
//! What the pins did is rebuilt from the history of the registers that counted, independently of what the firmware says
//! about itself. Emulated time passes only while the board is asked or told to run, so every number is the same each time.

mod board;
mod channels;
mod drives;
mod edges;
mod effects;
mod electrodes;
mod expected;
mod failures;
mod load;
mod permit;
mod session;
mod settings;
mod table;
mod trips;
mod windows;

use crate::error::Error;
use board::EmulatedBoard;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use table::ReportTable;

/// Where the report ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportEnd {
    /// After all rows.
    LastRow,
    /// At the first row that is wrong: enough where only that matters.
    FirstWrongRow,
}

/// A part of the report, which powers its board up itself. The longest come first, so that the processors end at about the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ReportPart {
    /// A healthy session, from the boot to a host that is silent.
    Session,
    /// Faults that trip the board while it drives and at arming.
    Trips,
    /// Failures of the processor and its supply, and the restarts after them.
    Failures,
    /// Average currents of intact and broken electrodes.
    Electrodes,
    /// The permit's line, and trips while the processor hangs.
    Permit,
    /// Registers that protect, and faults just within and beyond their limits.
    Settings,
    /// Load of the processor.
    Load,
}

impl ReportPart {
    const fn get_check(self) -> fn(&mut EmulatedBoard, &mut ReportTable) {
        match self {
            Self::Session => session::check_healthy_session_from_boot_to_host_silence,
            Self::Trips => trips::check_injected_trips_while_driving_and_at_arming,
            Self::Failures => failures::check_restart_after_injected_processor_failures,
            Self::Electrodes => electrodes::check_electrode_currents,
            Self::Permit => permit::check_permit_line_and_hardware_trips_with_hung_processor,
            Self::Settings => settings::check_protective_register_settings_and_trip_thresholds,
            Self::Load => load::check_processor_load,
        }
    }
}

/// Runs the parts, as many at a time as there are processors, each on a board of its own, and prints the rows of each when it is done. With
/// [`ReportEnd::FirstWrongRow`] the program ends at the first wrong row with exit code 1.
///
/// # Errors
/// [`Error::Report`] with the number of rows that are not as expected, or what kept the report from being made.
pub fn run_board_checks_printing_report_exiting_at_first_wrong_if_asked(
    image: &Path,
    parts: &[ReportPart],
    end: ReportEnd,
) -> Result<(), Error> {
    ReportTable::print_head();
    let (next, whole) = (AtomicUsize::new(0), Mutex::new(ReportTable::new(end)));
    let run_parts = || -> Result<(), Error> {
        while let Some(part) = parts.get(next.fetch_add(1, Ordering::Relaxed)) {
            let mut table = ReportTable::new(end);
            part.get_check()(&mut EmulatedBoard::start(image)?, &mut table);
            if let Ok(mut whole) = whole.lock() {
                table.print_rows();
                whole.append(table);
            }
        }
        Ok(())
    };
    let boards = thread::available_parallelism().map_or(1, usize::from).min(parts.len());
    thread::scope(|scope| {
        let threads: Vec<_> = (0..boards).map(|_| scope.spawn(run_parts)).collect();
        let ends = threads.into_iter().map(|thread| thread.join().unwrap_or(Err(Error::Report(1))));
        ends.collect::<Result<(), Error>>()
    })?;
    let whole = whole.into_inner().map_err(|_| Error::Report(1))?;
    whole.print_measured_values_and_wrong_rows();
    match whole.count_wrong_rows() {
        0 => Ok(()),
        wrong => Err(Error::Report(wrong)),
    }
}

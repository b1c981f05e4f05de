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
use table::ReportTable;

/// Runs it all and prints the table as it grows.
///
/// # Errors
/// [`Error::Report`] with the number of rows that are not as expected, or what kept the report from being made.
pub fn run_board_checks_printing_report(image: &Path) -> Result<(), Error> {
    let mut board = EmulatedBoard::start(image)?;
    let mut table = ReportTable::new();
    session::check_session(&mut board, &mut table);
    trips::check_trips(&mut board, &mut table);
    permit::check_permit(&mut board, &mut table);
    electrodes::check_electrode_currents(&mut board, &mut table);
    table.run_part_adding_row_on_error("settings", |table| {
        settings::check_register_settings_and_trip_thresholds(&mut board, table)
    });
    failures::check_failures(&mut board, &mut table);
    load::check_processor_load(&mut board, &mut table);
    table.print_figures_and_wrong_rows();
    match table.count_wrong_rows() {
        0 => Ok(()),
        wrong => Err(Error::Report(wrong)),
    }
}

//! `cargo xtask emulate --report`: the shipped image taken through everything it can do and every fault that can be injected.
//!
//! What the registers should hold is worked out here from `era_shared::waveform`; what they hold is read from the board.
//! What the pins did is rebuilt from the history of the registers that counted, independently of what the firmware says
//! about itself. Emulated time passes only while the board is asked or told to run, so every number is the same each time.

mod bench;
mod channels;
mod drives;
mod edges;
mod effects;
mod expected;
mod failures;
mod load;
mod session;
mod table;
mod trips;

use crate::error::Error;
use bench::Bench;
use std::path::Path;
use table::Table;

/// Runs it all and prints the table as it grows.
///
/// # Errors
/// [`Error::Report`] with the number of rows that are not as expected, or what kept the report from being made.
pub fn run_report(image: &Path) -> Result<(), Error> {
    let mut bench = Bench::start(image)?;
    let mut table = Table::new();
    session::steps(&mut bench, &mut table);
    trips::steps(&mut bench, &mut table);
    failures::steps(&mut bench, &mut table);
    load::steps(&mut bench, &mut table);
    table.summary();
    match table.wrong() {
        0 => Ok(()),
        wrong => Err(Error::Report(wrong)),
    }
}

//! Effect files of every format: what is read of each, what is left out, and what the example plate makes of it.

use crate::error::Error;
use crate::process::run_and_parse_json;
use crate::table::Table;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Touched place in mm, and the strength asked for in g.
const TOUCHED_MM: &str = "40,100";
const INTENSITY_G: &str = "0.5";

/// What of `era effect --file --json` the table shows.
#[derive(Deserialize)]
struct Reading {
    format: String,
    event_count: usize,
    duration_ms: f64,
    warnings: Vec<String>,
    parts: Vec<ReadPart>,
}

#[derive(Deserialize)]
struct ReadPart {
    kind: String,
    peak_g: f64,
}

/// Reads each file of `examples/effects` with the program, for the example plate.
///
/// # Errors
/// [`Error::File`], [`Error::Start`], [`Error::Failed`], [`Error::Json`].
pub fn build_table_of_effect_files() -> Result<Vec<Table>, Error> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new("."));
    let folder = root.join("examples/effects");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .map_err(Error::file_error(&folder))?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()
        .map_err(Error::file_error(&folder))?;
    files.sort();
    let title = format!("Effect files at {TOUCHED_MM} mm of the example plate, for {INTENSITY_G} g");
    let columns = ["file", "format", "events", "length", "parts on this panel, each with its peak", "warnings"];
    let mut table = Table::new(title, &columns);
    for file in files {
        let mut command = Command::new(root.join("target/release/era"));
        command.args(["effect", "--json", "--unit", "mm", "--at", TOUCHED_MM, "--intensity-g", INTENSITY_G, "--file"]);
        let reading: Reading = run_and_parse_json(command.arg(&file))?;
        let parts = reading.parts.iter().map(|part| format!("{} {:.2} g", part.kind, part.peak_g));
        table.add_row([
            file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            reading.format,
            reading.event_count.to_string(),
            format!("{:.0} ms", reading.duration_ms),
            parts.collect::<Vec<_>>().join(", "),
            reading.warnings.join("; "),
        ]);
    }
    Ok(vec![table])
}

//! Arguments of the commands that compute how a panel yields and moves: `era press`, `modes`, `sweep`, `response` and
//! `transient`.

use super::args::{CacheOptions, PanelOptions, TimeLimit, Unit};
use super::headings::{BAND, MOTION, NO_HEADING, OUTPUT};
use super::values::{
    Point, parse_comma_separated_grid_counts, parse_npy_path, parse_png_path, parse_press_n, parse_unitless_point,
};
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct Press {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    /// Force of the press in N, 0 to 1000 [default: force_n in [press] of the scene, or 5 if the scene has no force_n]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_press_n, help_heading = NO_HEADING)]
    pub force_n: Option<f64>,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Modes {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub time: TimeLimit,
    /// Highest frequency in Hz
    #[arg(long, value_name = "F", default_value_t = 500.0, allow_negative_numbers = true, help_heading = BAND)]
    pub max_hz: f64,
    /// Columns and rows of the grid for --csv, --npy and --png, with points on the borders; on a bar, NY is ignored, and the grid is one row of points along the axis
    #[arg(long, value_name = "NX,NY", value_parser = parse_comma_separated_grid_counts, default_value = "49,33",
        help_heading = BAND)]
    pub grid: (usize, usize),
    /// Write the mass-normalised shapes as CSV with the columns mode,frequency_hz,error_bound,x_mm,y_mm,shape_per_sqrt_kg, and with
    /// one line per mode and point; `-` is standard output
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub csv: Option<PathBuf>,
    /// Write the mass-normalised shapes: a NumPy array [mode, row, column] of float64 in kg^-1/2, NaN in cut-outs; also
    /// write the axes to the same folder (for modes.npy: modes.frequency_hz.npy, modes.y_m.npy, modes.x_m.npy)
    #[arg(long, value_name = "FILE.npy", value_parser = parse_npy_path, help_heading = OUTPUT)]
    pub npy: Option<PathBuf>,
    /// Draw all mode shapes in one picture, with the supports, masses, actuators and [[edge]] entries of the scene
    #[arg(long, value_name = "FILE.png", value_parser = parse_png_path, help_heading = OUTPUT)]
    pub png: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Sweep {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub time: TimeLimit,
    #[command(flatten)]
    pub band: Band,
    /// Columns and rows of the grid, with points on the borders; on a bar, NY is ignored, and the grid is one row of points along the axis
    #[arg(long, value_name = "NX,NY", value_parser = parse_comma_separated_grid_counts, default_value = "49,33",
        help_heading = BAND)]
    pub grid: (usize, usize),
    /// Write all values in m/s^2 per N: a NumPy array [frequency, actuator, row, column] of complex64, or of complex128
    /// if the tolerance is below 1e-5; also write the axes to the same folder (for plate.npy: plate.frequency_hz.npy,
    /// plate.y_m.npy, plate.x_m.npy)
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub npy: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}

/// Frequencies.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = BAND)]
pub struct Band {
    /// Lowest frequency in Hz
    #[arg(long, value_name = "F", default_value_t = 40.0, allow_negative_numbers = true)]
    pub from: f64,
    /// Highest frequency in Hz
    #[arg(long, value_name = "F", default_value_t = 400.0, allow_negative_numbers = true)]
    pub to: f64,
    /// Step in Hz
    #[arg(long, value_name = "F", default_value_t = 1.0, allow_negative_numbers = true)]
    pub step: f64,
}

#[derive(Clone, Debug, Args)]
pub struct Response {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub time: TimeLimit,
    /// Point on the surface
    #[arg(long, value_name = "X,Y", value_parser = parse_unitless_point, allow_hyphen_values = true, help_heading = BAND)]
    pub at: Point,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Mm, help_heading = BAND)]
    pub unit: Unit,
    #[command(flatten)]
    pub band: Band,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Transient {
    #[command(flatten)]
    pub panel: PanelOptions,
    /// Point on the surface
    #[arg(long, value_name = "X,Y", value_parser = parse_unitless_point, allow_hyphen_values = true, help_heading = MOTION)]
    pub at: Point,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Mm, help_heading = MOTION)]
    pub unit: Unit,
    /// A drive: ID of the actuator, frequency f in Hz, amplitude A in N and phase P in degrees of the force
    /// A cos(2 pi f t + P) (default of P:
    /// -90, which gives a sine); can be repeated
    #[arg(long, value_name = "ID:HZ:NEWTON[:DEG]", value_parser = parse_drive_id_hz_newton_and_optional_deg, required = true,
        help_heading = MOTION)]
    pub drive: Vec<DriveText>,
    /// Duration in s
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true, help_heading = MOTION)]
    pub duration: f64,
    /// Time step in s
    #[arg(long, value_name = "S", default_value_t = 1e-4, allow_negative_numbers = true, help_heading = MOTION)]
    pub step: f64,
    /// Write the motion to this CSV file, with the columns time_s, displacement_m and acceleration_m_per_s2; `-` is
    /// standard output
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub csv: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}

/// A drive as written on the command line.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveText {
    pub actuator: String,
    pub frequency_hz: f64,
    pub force_n: f64,
    pub phase_deg: f64,
}

fn parse_drive_id_hz_newton_and_optional_deg(text: &str) -> Result<DriveText, String> {
    let number = |part: &str| {
        part.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{part:?} is not a number"))
    };
    let parts: Vec<&str> = text.split(':').collect();
    let (id, rest) = parts.split_first().ok_or("empty")?;
    let (frequency, force, phase) = match rest {
        // A sine: the force rises from nothing.
        [frequency, force] => (frequency, force, &"-90"),
        [frequency, force, phase] => (frequency, force, phase),
        _ => return Err(format!("{text:?} is not of the form ID:HZ:NEWTON or ID:HZ:NEWTON:DEG")),
    };
    Ok(DriveText {
        actuator: (*id).to_owned(),
        frequency_hz: number(frequency)?,
        force_n: number(force)?,
        phase_deg: number(phase)?,
    })
}

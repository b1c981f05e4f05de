//! What the command line takes.

use crate::device::Target;
use crate::effects::NamedEffect;
use crate::model::Accuracy;
use crate::planner::cache::{Cache, DIRECTORY_VARIABLE};
use crate::scene::Scene;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::time::Duration;

use super::Failure;
pub use super::args_board::{Flash, Monitor};
pub use super::args_field::Field;
use super::wishes::Wishes;

/// Localized touch feedback on large surfaces: two to four electrostatic resonant actuators (ERAs) on a flexibly held
/// panel, each at its own frequency, placed by a finite-element model.
///
/// Without a command, `era` serves the example plate with a simulated device on http://127.0.0.1:7878.
#[derive(Debug, Parser)]
#[command(
    name = "era",
    version,
    max_term_width = 100,
    after_help = "\
Examples:
  era                                          the daemon and its web page, no hardware needed
  era touch 960 640 --intensity-g 0.3          make the middle of the screen vibrate
  era modes --scene my-panel.toml --max-hz 400 what frequencies a panel has
  era plan --at 480,640 --json                 what would be driven, without driving it
  era field --at 480,640 --png map.png         where on the surface it would be felt"
)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Log more (-v, -vv); the variable ERA_LOG takes a filter as tracing-subscriber understands it
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the daemon: device session, HTTP and WebSocket interface, web page
    #[command(after_help = "Example:\n  era serve --scene examples/scenes/plate.toml --listen 127.0.0.1:8080")]
    Serve(Serve),
    /// Ask a running daemon for a touch at screen pixels X Y
    #[command(after_help = "Example:\n  era touch 960 640 --intensity-g 0.3 --duration-ms 500")]
    Touch(Touch),
    /// Ask a running daemon to switch everything off
    #[command(after_help = "Example:\n  era stop")]
    Stop(Daemon),
    /// Show what a running daemon and its device are doing
    #[command(after_help = "Example:\n  era state --json")]
    State(Daemon),
    /// List a panel's modes: frequencies and damping ratios; write and draw their shapes
    #[command(after_help = "\
Examples:
  era modes --scene examples/scenes/bar.toml --max-hz 500 --tolerance 1e-6
  era modes --png modes.png --npy modes.npy        the shapes, as a picture and for NumPy")]
    Modes(Modes),
    /// Acceleration at a point per newton at each actuator, over frequency
    #[command(after_help = "Example:\n  era response --at 100,60 --from 50 --to 400 --step 2")]
    Response(Response),
    /// Acceleration at every point of a grid per newton at each actuator, over frequency
    #[command(after_help = "Example:\n  era sweep --from 50 --to 1000 --step 1 --grid 49,33 --npy plate.npy")]
    Sweep(Sweep),
    /// Motion of a point after drives are switched on
    #[command(
        after_help = "Example:\n  era transient --at 100,60 --drive left:120:0.1 --drive right:88:0.1:90 --duration 0.5 --csv -"
    )]
    Transient(Transient),
    /// The drives for a touch, without driving anything
    #[command(after_help = "\
Examples:
  era plan --at 100,60 --unit mm --json
  era plan --at 480,640 --also 1500,700:0.3 --quiet 960,640:15:0.02    two targets, and a place to be spared
  era plan --at 480,640 --window 0-300 --also 1500,700:0.3:200-500     one after the other")]
    Plan(super::plan::PlanOptions),
    /// An effect at a point: what the board would play, and what the panel would do, without driving anything
    #[command(after_help = "Example:\n  era effect --at 100,60 --unit mm --effect click --intensity-g 0.5")]
    Effect(super::effect::EffectOptions),
    /// Peak acceleration over the surface for a touch, or what can be reached at all, as CSV or PNG
    #[command(after_help = "\
Examples:
  era field --at 480,640 --png map.png --csv map.csv
  era field --reach --png reach.png       the strongest and the most contrasted at every point
  era field --schemes                     dead zones: one frequency, phases, distinct frequencies
  era field --schemes --from 124 --zone 0,0,150,200 --felt    of a band and a part of the surface, as it is felt")]
    Field(Field),
    /// Compare predicted peaks with those that the simulated device measures
    #[command(after_help = "Example:\n  era verify --scene examples/scenes/bar.toml --points 3")]
    Verify(Verify),
    /// Measure the time from a touch request to the last byte of its frame at the device
    #[command(after_help = "Example:\n  era latency --touches 200")]
    Latency(Latency),
    /// Write the firmware to a board, through a debug probe or over USB (not yet tried on a real board)
    #[command(after_help = "\
Everything is checked before anything is erased: that the file is a firmware image for this chip and kind of board,
and what runs on the board now. An update that was cut off is repaired by running the same command again.
Switch the high-voltage supply off first: in its bootloader the chip drives pins of its own choosing.

This has been tested against a bootloader in memory, not yet on a board.

Examples:
  era flash                               the image of this checkout, to the board that is connected
  era flash firmware.elf --port /dev/ttyACM0 --dfu
  PROBE_RS_PROBE=0483:374e:0012 era flash --probe")]
    Flash(Flash),
    /// Show the log of a board's firmware as it comes in
    #[command(after_help = "\
Examples:
  era monitor                             over the link of the board that is connected
  era monitor --port emulated             the firmware on the emulated board
  era monitor --probe                     through a debug probe (not yet tried on a real board)")]
    Monitor(Monitor),
}

/// The scene and how accurately to model it.
#[derive(Clone, Debug, Default, Args)]
pub struct Panel {
    /// Scene file (see docs/src/scene.md); the example plate if not given
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// fast (1e-2), balanced (1e-3, the default) or reference (1e-6)
    #[arg(long, value_name = "NAME", conflicts_with = "tolerance")]
    pub accuracy: Option<Accuracy>,
    /// Relative tolerance as a number, 1e-8 to 0.1
    #[arg(long, value_name = "REL")]
    pub tolerance: Option<f64>,
    /// For modes, response and sweep: the most accurate answer that fits in this time, 50ms or 2s say, instead of a tolerance;
    /// the bound says what was reached
    #[arg(long, value_name = "TIME", value_parser = parse_time, conflicts_with_all = ["tolerance", "accuracy"])]
    pub within: Option<Duration>,
    /// Say on standard error what was modelled, what was left out, and what each step towards the tolerance cost and bought
    #[arg(long)]
    pub explain: bool,
}

impl Panel {
    /// The scene.
    pub fn load(&self) -> Result<Scene, Failure> {
        Ok(self.load_text()?.0)
    }

    /// The scene, and its file's text.
    pub fn load_text(&self) -> Result<(Scene, String), Failure> {
        let (source, text) = match &self.scene {
            Some(path) => (path.display().to_string(), Scene::text(path).map_err(Failure::usage)?),
            None => ("examples/scenes/plate.toml".into(), crate::scene::EXAMPLE_PLATE.into()),
        };
        Ok((Scene::parse(&source, &text).map_err(Failure::usage)?, text))
    }

    /// The accuracy of what climbs from level to level: a tolerance, or the time that there is.
    pub fn climb(&self) -> Result<Accuracy, Failure> {
        self.within.map_or_else(|| self.accuracy(), |time| Ok(Accuracy::within(time)))
    }

    /// The accuracy of all else.
    pub fn accuracy(&self) -> Result<Accuracy, Failure> {
        if self.within.is_some() {
            return Err(Failure::usage(
                "--within is for modes, response and sweep: give --tolerance or --accuracy here",
            ));
        }
        match (self.accuracy, self.tolerance) {
            (_, Some(tolerance)) => Accuracy::tolerance(tolerance).map_err(Failure::usage),
            (Some(accuracy), None) => Ok(accuracy),
            (None, None) => Ok(Accuracy::BALANCED),
        }
    }
}

/// Times that make sense for an answer.
const TIMES: std::ops::RangeInclusive<f64> = 1e-3..=3600.0;

/// A time such as `50ms` or `2s`.
fn parse_time(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text:?} is not a time from 1ms to 3600s, such as 50ms or 2s");
    let (number, unit_s) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').ok_or_else(wrong)?, 1.0),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| wrong())? * unit_s;
    if TIMES.contains(&seconds) { Ok(Duration::from_secs_f64(seconds)) } else { Err(wrong()) }
}

/// Whether plan tables are kept on disk.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct Keep {
    /// Compute the plan table even if it is on disk, and leave it there as it is (see docs/src/accuracy.md, "Start-up")
    #[arg(long)]
    pub no_cache: bool,
}

impl Keep {
    /// Where they are kept.
    pub fn cache(self) -> Option<Cache> {
        if self.no_cache {
            return None;
        }
        let cache = Cache::of_user();
        if cache.is_none() {
            tracing::debug!("none of {DIRECTORY_VARIABLE}, XDG_CACHE_HOME and HOME names a directory: nothing is kept");
        }
        cache
    }
}

#[derive(Clone, Debug, Default, Args)]
pub struct Serve {
    #[command(flatten)]
    pub panel: Panel,
    #[command(flatten)]
    pub keep: Keep,
    /// sim (the default), emulated, auto, or the path of a serial port
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<Target>,
    /// Address and port to listen on [default: 127.0.0.1:7878]
    #[arg(long, value_name = "ADDR:PORT")]
    pub listen: Option<std::net::SocketAddr>,
}

/// Where the daemon is.
#[derive(Clone, Debug, Args)]
pub struct Daemon {
    /// The daemon's address, as http://HOST:PORT or HOST:PORT
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:7878", value_parser = super::client::parse_url)]
    pub url: String,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Touch {
    /// Screen pixels from the left
    #[arg(allow_negative_numbers = true, value_parser = parse_finite)]
    pub x_px: f64,
    /// Screen pixels from the top
    #[arg(allow_negative_numbers = true, value_parser = parse_finite)]
    pub y_px: f64,
    /// Peak acceleration wanted, in g
    #[arg(long, value_name = "A", allow_negative_numbers = true, value_parser = parse_finite)]
    pub intensity_g: Option<f64>,
    /// The same in dB above the threshold of feeling
    #[arg(long, value_name = "DB", allow_negative_numbers = true, value_parser = parse_finite, conflicts_with = "intensity_g")]
    pub intensity_db: Option<f64>,
    /// How long, in ms
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_finite)]
    pub duration_ms: Option<f64>,
    /// Play an effect instead of an even drive, timed by the board itself
    #[arg(long, value_name = "NAME")]
    pub effect: Option<NamedEffect>,
    #[command(flatten)]
    pub rhythm: Rhythm,
    #[command(flatten)]
    pub wishes: Wishes,
    /// Say what can be had instead where it cannot all be had
    #[arg(long)]
    pub trade: bool,
    #[command(flatten)]
    pub daemon: Daemon,
}

/// How often.
#[derive(Clone, Copy, Debug, Args)]
pub struct Rhythm {
    /// How many pulses
    #[arg(long, value_name = "N")]
    pub count: Option<u32>,
    /// From one click, pulse or crest to the next, in ms
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_finite)]
    pub period_ms: Option<f64>,
}

#[derive(Clone, Debug, Args)]
pub struct Modes {
    #[command(flatten)]
    pub panel: Panel,
    /// Highest frequency in Hz
    #[arg(long, value_name = "F", default_value_t = 500.0, allow_negative_numbers = true)]
    pub max_hz: f64,
    /// For --csv, --npy and --png: columns and rows of the grid, border to border; a bar has one row, its axis
    #[arg(long, value_name = "NX,NY", value_parser = parse_counts, default_value = "49,33")]
    pub grid: (usize, usize),
    /// Write the mass-normalised shapes, a line mode,frequency_hz,error_bound,x_mm,y_mm,shape_per_sqrt_kg per mode and point;
    /// `-` is standard output
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write the mass-normalised shapes: a NumPy array [mode, row, column] of float64 in kg^-1/2, NaN in cut-outs; and its axes
    /// beside it, for modes.npy in modes.frequency_hz.npy, modes.y_m.npy and modes.x_m.npy
    #[arg(long, value_name = "FILE.npy", value_parser = parse_npy)]
    pub npy: Option<PathBuf>,
    /// Draw the shapes on one sheet, with supports, masses, actuators and held edges
    #[arg(long, value_name = "FILE.png", value_parser = parse_png)]
    pub png: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Sweep {
    #[command(flatten)]
    pub panel: Panel,
    /// Columns and rows of the grid, border to border; a bar has one row, its axis
    #[arg(long, value_name = "NX,NY", value_parser = parse_counts, default_value = "49,33")]
    pub grid: (usize, usize),
    #[command(flatten)]
    pub band: Band,
    /// Write all values: a NumPy array [frequency, actuator, row, column] of complex64, or complex128 below a tolerance of
    /// 1e-5, in m/s^2 per N; and its axes beside it, for plate.npy in plate.frequency_hz.npy, plate.y_m.npy and plate.x_m.npy
    #[arg(long, value_name = "FILE")]
    pub npy: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Frequencies.
#[derive(Clone, Debug, Args)]
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
    pub panel: Panel,
    /// Point on the surface in mm
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    pub at: Point,
    #[command(flatten)]
    pub band: Band,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Transient {
    #[command(flatten)]
    pub panel: Panel,
    /// Point on the surface in mm
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    pub at: Point,
    /// An actuator, its frequency, force amplitude and phase of the cosine (-90, a sine, unless given); several times for
    /// several drives
    #[arg(long, value_name = "ID:HZ:NEWTON[:DEG]", value_parser = parse_drive, required = true)]
    pub drive: Vec<DriveText>,
    /// How long in s
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true)]
    pub duration: f64,
    /// Between two times in s
    #[arg(long, value_name = "S", default_value_t = 1e-4, allow_negative_numbers = true)]
    pub step: f64,
    /// Write time_s,displacement_m,acceleration_m_per_s2 lines; `-` is standard output
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
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

fn parse_drive(text: &str) -> Result<DriveText, String> {
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

/// Where a point's numbers count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Unit {
    /// Screen pixels
    Px,
    /// Millimetres on the surface
    Mm,
}

/// The touch to plan for.
#[derive(Clone, Debug, Args)]
pub struct At {
    /// The touched point
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    pub at: Point,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Px)]
    pub unit: Unit,
    /// Peak acceleration wanted, in g
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    pub intensity_g: Option<f64>,
}

#[derive(Clone, Debug, Args)]
pub struct Verify {
    #[command(flatten)]
    pub panel: Panel,
    #[command(flatten)]
    pub keep: Keep,
    /// Number of points, spread over the surface
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub points: u32,
    /// Peak acceleration wanted at each, in g
    #[arg(long, value_name = "A", default_value_t = crate::planner::DEFAULT_INTENSITY_G, allow_negative_numbers = true)]
    pub intensity_g: f64,
    /// Largest relative difference that passes
    #[arg(long, value_name = "REL", default_value_t = 0.05)]
    pub limit: f64,
    /// Random scenes in place of one: prediction and simulation on so many, with what is known of each difference
    #[arg(long, value_name = "N", conflicts_with_all = ["scene", "points", "intensity_g", "limit"])]
    pub scenes: Option<u64>,
    /// Touches on each random scene, at random places and intensities
    #[arg(long, value_name = "N", default_value_t = 10, requires = "scenes")]
    pub touches: u32,
    /// Another seed gives other scenes
    #[arg(long, value_name = "N", default_value_t = 1, requires = "scenes")]
    pub seed: u64,
    /// Scenes at a time; as many as there are processors if not given
    #[arg(long, value_name = "N", requires = "scenes")]
    pub jobs: Option<u16>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Latency {
    #[command(flatten)]
    pub panel: Panel,
    #[command(flatten)]
    pub keep: Keep,
    /// Number of touches
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub touches: u32,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A pair of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub x: f64,
    pub y: f64,
}

pub(super) fn parse_point(text: &str) -> Result<Point, String> {
    let number = |part: &str| {
        part.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{part:?} is not a number"))
    };
    let (x, y) = text.split_once(',').ok_or(format!("{text:?} is not of the form X,Y"))?;
    Ok(Point { x: number(x)?, y: number(y)? })
}

/// A number that JSON can carry: anything else would arrive as "not given".
pub(super) fn parse_finite(text: &str) -> Result<f64, String> {
    text.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{text:?} is not a finite number"))
}

/// Names of files are refused before anything is computed.
fn parse_npy(text: &str) -> Result<PathBuf, String> {
    named(text, "npy", "arrays are NumPy's, and the name has to end in .npy")
}

/// The extension says of what type a picture is.
pub(super) fn parse_png(text: &str) -> Result<PathBuf, String> {
    named(text, "png", "pictures are PNG, and the name has to end in .png")
}

fn named(text: &str, extension: &str, otherwise: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let fits = path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension));
    if fits { Ok(path) } else { Err(otherwise.to_owned()) }
}

fn parse_counts(text: &str) -> Result<(usize, usize), String> {
    let count = |part: &str| match part.trim().parse::<usize>() {
        Ok(count @ 1..=10_000) => Ok(count),
        _ => Err(format!("{part:?} is not a whole number from 1 to 10000")),
    };
    let (x, y) = text.split_once(',').ok_or(format!("{text:?} is not of the form NX,NY"))?;
    Ok((count(x)?, count(y)?))
}

//! Options that commands take, and what they may be.

use crate::connection::HostPort;
use crate::device::Target;
use crate::effect_files::FileFormat;
use crate::effects::NamedEffect;
use crate::model::Accuracy;
use crate::planner::cache::{Cache, DIRECTORY_VARIABLE};
use crate::planner::click::Preference;
use crate::scene::Scene;
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

use super::Failure;
use super::headings::{ACCESS, DAEMON, DEVICE, EFFECT, LISTENING, MODEL, NO_HEADING, PLANNER, RECORDING, TOUCH};
use super::values::{
    Point, parse_daemon_url_adding_http_if_no_scheme, parse_duration_with_unit_ms_or_s, parse_finite_number,
    parse_listen_address, parse_outgoing_http_proxy, parse_unitless_point,
};
use super::wishes::PlanWishes;

/// The scene and how accurately to model it.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = MODEL)]
pub struct PanelOptions {
    /// Scene file (see docs/src/scene.md) [default: the example plate]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Relative tolerance of the model by name: fast (1e-2), balanced (1e-3, the default) or reference (1e-6)
    #[arg(long, value_name = "NAME", conflicts_with = "tolerance")]
    pub accuracy: Option<Accuracy>,
    /// Relative tolerance of the model as a number, 1e-8 to 0.1
    #[arg(long, value_name = "REL")]
    pub tolerance: Option<f64>,
    /// Print on standard error what the model contains, what it omits, and the computation time and the error bound of each mesh
    #[arg(long)]
    pub explain: bool,
}

impl PanelOptions {
    /// The scene.
    pub fn load_scene(&self) -> Result<Scene, Failure> {
        Ok(self.load_scene_and_text()?.0)
    }

    /// The scene, and its file's text.
    pub fn load_scene_and_text(&self) -> Result<(Scene, String), Failure> {
        let (source, text) = match &self.scene {
            Some(path) => (path.display().to_string(), Scene::read_scene_text(path).map_err(Failure::usage_error)?),
            None => ("examples/scenes/plate.toml".into(), crate::scene::EXAMPLE_PLATE.into()),
        };
        Ok((Scene::parse(&source, &text).map_err(Failure::usage_error)?, text))
    }

    /// The accuracy of what climbs from level to level: a tolerance, or the time that there is.
    pub fn accuracy_from_time_limit_or_options(&self, time_limit: TimeLimit) -> Result<Accuracy, Failure> {
        time_limit.within.map_or_else(|| self.accuracy(), |time| Ok(Accuracy::best_within_time(time)))
    }

    /// The accuracy of all else.
    pub fn accuracy(&self) -> Result<Accuracy, Failure> {
        match (self.accuracy, self.tolerance) {
            (_, Some(tolerance)) => Accuracy::from_tolerance(tolerance).map_err(Failure::usage_error),
            (Some(accuracy), None) => Ok(accuracy),
            (None, None) => Ok(Accuracy::BALANCED),
        }
    }
}

/// A time in place of a tolerance, for commands that climb from level to level.
#[derive(Clone, Copy, Debug, Default, Args)]
#[command(next_help_heading = MODEL)]
pub struct TimeLimit {
    /// Time limit, such as 50ms or 2s, in place of a tolerance: compute the most accurate answer within this time; the
    /// error bound of the answer states its accuracy
    #[arg(long, value_name = "TIME", value_parser = parse_duration_with_unit_ms_or_s, conflicts_with_all = ["tolerance", "accuracy"])]
    pub within: Option<Duration>,
}

/// Whether plan tables are kept on disk.
#[derive(Clone, Copy, Debug, Default, Args)]
#[command(next_help_heading = MODEL)]
pub struct CacheOptions {
    /// Compute the plan table instead of reading it from disk, and do not write it to disk (see docs/src/accuracy.md,
    /// "Start-up")
    #[arg(long)]
    pub no_cache: bool,
}

impl CacheOptions {
    /// Where they are kept.
    pub fn open_table_cache_unless_disabled_or_without_folder(self) -> Option<Cache> {
        if self.no_cache {
            return None;
        }
        let cache = Cache::for_user_if_any_variable_set();
        if cache.is_none() {
            tracing::debug!(
                "none of {DIRECTORY_VARIABLE}, XDG_CACHE_HOME and HOME names a directory: plan tables are not stored"
            );
        }
        cache
    }
}

#[derive(Clone, Debug, Default, Args)]
pub struct Serve {
    /// Configuration file; options on the command line override its keys (see docs/src/service.md)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    /// Device: sim (simulated, the default), emulated (the firmware image in an emulator), auto (the connected board), or the path of a serial port
    #[arg(long, value_name = "DEVICE", help_heading = DEVICE)]
    pub device: Option<Target>,
    /// Address or host name to listen on, with a port, such as localhost:7878 or [::1]:7878 [default: 127.0.0.1:7878]
    #[arg(long, value_name = "ADDR:PORT", value_parser = parse_listen_address, help_heading = LISTENING)]
    pub listen: Option<HostPort>,
    /// Path of an additional Unix socket, which only this user can open; `none` for no socket [default: era.sock in
    /// $XDG_RUNTIME_DIR, if this variable is set]
    #[arg(long, value_name = "PATH", help_heading = LISTENING)]
    pub socket: Option<PathBuf>,
    /// File of tokens; each line has a role (view, touch or arm) and a secret. With this option, requests need a token
    #[arg(long, value_name = "FILE", help_heading = ACCESS)]
    pub token_file: Option<PathBuf>,
    /// Serve over TLS with the certificate in this file, in PEM
    #[arg(long, value_name = "FILE", requires = "tls_key", help_heading = LISTENING)]
    pub tls_cert: Option<PathBuf>,
    /// File with the private key of the certificate, in PEM
    #[arg(long, value_name = "FILE", requires = "tls_cert", help_heading = LISTENING)]
    pub tls_key: Option<PathBuf>,
    /// Serve over TLS with the certificate and key in this folder; if both are missing, the daemon makes both
    #[arg(long, value_name = "DIR", conflicts_with = "tls_cert", help_heading = LISTENING)]
    pub tls_dir: Option<PathBuf>,
    /// Origin, such as http://HOST:PORT, of web pages that may use the daemon in addition to the daemon's own page; can be
    /// repeated
    #[arg(long, value_name = "ORIGIN", value_parser = crate::daemon::Access::parse_origin, help_heading = ACCESS)]
    pub allow_origin: Vec<String>,
    /// Host name that clients may use for the daemon, in addition to localhost and numeric addresses; can be repeated
    #[arg(long, value_name = "NAME", value_parser = crate::daemon::Access::parse_host, help_heading = ACCESS)]
    pub allow_host: Vec<String>,
    /// Record requests and their results for `era replay`, to a new file or to a folder (an existing folder, or a path
    /// that ends in a slash); in a folder, each start makes a new file
    #[arg(long, value_name = "PATH", help_heading = RECORDING)]
    pub record: Option<PathBuf>,
    /// Largest size in MB of one file of a recording; above this size, the recording continues in a new file [default:
    /// 256]
    #[arg(long, value_name = "MB", value_parser = parse_recording_size_mb, help_heading = RECORDING)]
    pub record_file_mb: Option<f64>,
    /// Largest total size of the files of a recording, in MB; above this size, the daemon removes the oldest file. If
    /// the recording is a folder, the files of earlier runs of the daemon count too [default: 2000]
    #[arg(long, value_name = "MB", value_parser = parse_recording_size_mb, help_heading = RECORDING)]
    pub record_total_mb: Option<f64>,
    /// Disarm the board after this time without a touch, in s, 0.1 to 3600 [default: 5]
    #[arg(long, value_name = "S", value_parser = parse_idle_s, help_heading = DEVICE)]
    pub idle_s: Option<f64>,
    /// Clear the fault host-silent (the board received nothing from this daemon for 250 ms) at the next touch or POST
    /// /v1/arm; only a person can clear other faults
    #[arg(long, help_heading = DEVICE)]
    pub clear_silence: bool,
    /// Who arms the board again after an outage (a loss of the link to the board) [default: person]
    #[arg(long, value_name = "WHO", value_enum, help_heading = DEVICE)]
    pub after_outage: Option<AfterOutage>,
}

/// Who arms a board that was away.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AfterOutage {
    /// A person, with `era arm`, the page's button or `POST /v1/arm`
    Person,
    /// The next touch
    Touch,
}

/// Longest idle time: an hour at high voltage for a touch that may never come is enough.
const MAX_IDLE_S: f64 = 3600.0;

/// Sizes of recordings in MB.
pub fn parse_recording_size_mb(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (1.0..=1e6).contains(number));
    number.ok_or_else(|| format!("{text:?} is not a number from 1 to 1000000 (the size in MB)"))
}

pub fn parse_idle_s(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=MAX_IDLE_S).contains(seconds));
    seconds.ok_or_else(|| format!("must be a number from 0.1 to {MAX_IDLE_S}, in s"))
}

/// Where the daemon is.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = DAEMON)]
pub struct DaemonOptions {
    /// The daemon's address: http://HOST:PORT, https://HOST:PORT or HOST:PORT
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:7878", value_parser = parse_daemon_url_adding_http_if_no_scheme)]
    pub url: String,
    /// File with the token, if the daemon needs a token; or put the token into the environment variable ERA_TOKEN
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// File with the trusted certificate in PEM format: the certificate of the authority that has signed the daemon's
    /// certificate, or the daemon's own certificate if no authority has signed it
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// HTTP proxy for the connection to the daemon (method CONNECT), such as http://HOST:PORT; proxy variables of the
    /// environment are ignored
    #[arg(long, value_name = "URL", value_parser = parse_outgoing_http_proxy)]
    pub proxy: Option<HostPort>,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Touch {
    /// Horizontal position in screen pixels from the left edge
    #[arg(allow_negative_numbers = true, value_parser = parse_finite_number)]
    pub x_px: f64,
    /// Vertical position in screen pixels from the top edge
    #[arg(allow_negative_numbers = true, value_parser = parse_finite_number)]
    pub y_px: f64,
    /// Requested peak acceleration, in g [default: 0.5]
    #[arg(long, value_name = "A", allow_negative_numbers = true, value_parser = parse_finite_number, help_heading = TOUCH)]
    pub intensity_g: Option<f64>,
    /// Requested peak acceleration, in dB above the threshold of feeling (in place of --intensity-g)
    #[arg(long, value_name = "DB", allow_negative_numbers = true, value_parser = parse_finite_number,
        conflicts_with = "intensity_g", help_heading = TOUCH)]
    pub intensity_db: Option<f64>,
    /// Duration in ms [default: 1000]
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_finite_number, help_heading = TOUCH)]
    pub duration_ms: Option<f64>,
    /// Play this effect instead of a steady drive; the board itself controls the timing of the effect
    #[arg(long, value_name = "NAME", help_heading = EFFECT)]
    pub effect: Option<NamedEffect>,
    /// Play this effect file instead of a steady drive: TOML, JSON, AHAP, HJIF, HMPG, Lofelt .haptic or WAV; the daemon accepts at most 384 KiB
    #[arg(
        long,
        value_name = "FILE",
        help_heading = EFFECT,
        conflicts_with_all = ["effect", "duration_ms", "count", "period_ms", "crisp_ms", "prefer", "intensity_db", "window", "also",
            "quiet", "objective", "grouping", "weigh", "trade"]
    )]
    pub file: Option<PathBuf>,
    /// Format of the file [default: detected from the content of the file]
    #[arg(long, value_enum, requires = "file", help_heading = EFFECT)]
    pub format: Option<FileFormat>,
    #[command(flatten)]
    pub rhythm: Rhythm,
    #[command(flatten)]
    pub crispness: Crispness,
    #[command(flatten)]
    pub wishes: PlanWishes,
    /// Compute alternatives if the requested peaks and quiet zones conflict; --json prints the alternatives
    #[arg(long, help_heading = PLANNER)]
    pub trade: bool,
    #[command(flatten)]
    pub daemon: DaemonOptions,
}

/// How often.
#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = EFFECT)]
pub struct Rhythm {
    /// Number of pulses of the effect pulse_train
    #[arg(long, value_name = "N")]
    pub count: Option<u32>,
    /// Time from one click, pulse or crest to the next, in ms
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_finite_number)]
    pub period_ms: Option<f64>,
}

/// How crisp a click is.
#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = EFFECT)]
pub struct Crispness {
    /// Longest time in ms from a click's start until less than a tenth of its peak remains, 20 to 100 [default: 45]
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = parse_finite_number)]
    pub crisp_ms: Option<f64>,
    /// What has priority if a click cannot be both as strong as requested and crisp [default: strength]
    #[arg(long, value_enum)]
    pub prefer: Option<Preference>,
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
#[command(next_help_heading = TOUCH)]
pub struct At {
    /// The touched point
    #[arg(long, value_name = "X,Y", value_parser = parse_unitless_point, allow_hyphen_values = true)]
    pub at: Point,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Px)]
    pub unit: Unit,
    /// Requested peak acceleration, in g [default: 0.5]
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    pub intensity_g: Option<f64>,
}

#[derive(Clone, Debug, Args)]
pub struct Verify {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    /// Number of points, spread over the surface
    #[arg(long, value_name = "N", default_value_t = 10, help_heading = NO_HEADING)]
    pub points: u32,
    /// Requested peak acceleration at each point, in g
    #[arg(long, value_name = "A", default_value_t = crate::planner::DEFAULT_INTENSITY_G, allow_negative_numbers = true,
        help_heading = NO_HEADING)]
    pub intensity_g: f64,
    /// Largest allowed relative difference between prediction and simulation
    #[arg(long, value_name = "REL", default_value_t = 0.05, help_heading = NO_HEADING)]
    pub limit: f64,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct Replay {
    /// File that `era serve --record` wrote
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Speed relative to the recording, 0.01 to 100
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = parse_replay_speed)]
    pub speed: f64,
    #[command(flatten)]
    pub daemon: DaemonOptions,
}

fn parse_replay_speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.01..=100.0).contains(speed));
    speed.ok_or_else(|| "must be a number from 0.01 to 100".into())
}

#[derive(Clone, Debug, Args)]
pub struct Latency {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    /// Requested peak acceleration, in g [default: 0.5, as in a touch request]
    #[arg(long, value_name = "A", help_heading = NO_HEADING)]
    pub intensity_g: Option<f64>,
    /// Number of touches
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000),
        help_heading = NO_HEADING)]
    pub touches: u32,
    /// Instead of touches, measure N clicks that begin with discharged high-voltage rails, and N clicks that begin
    /// with rails that `POST /v1/arm` has charged
    #[arg(long, value_name = "N", conflicts_with = "touches", value_parser = clap::value_parser!(u32).range(1..=1000),
        help_heading = NO_HEADING)]
    pub first_clicks: Option<u32>,
    /// Print JSON
    #[arg(long, help_heading = NO_HEADING)]
    pub json: bool,
}

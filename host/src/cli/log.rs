//! The log: what of it is written to standard error, and how.

use super::progress;
use super::standard_error::Later;
use super::terminal_messages::LogFormat;
use std::io::IsTerminal;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{EnvFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Logs to standard error: warnings and the daemon's news, or what `-v`, `-vv` or the variable `ERA_LOG` ask for.
pub fn start_standard_error_log_filtered_by_era_log_or_verbosity(verbose: u8, format: LogFormat) {
    let default = match verbose {
        0 => "warn,era=info",
        1 => "info,era=debug",
        _ => "debug,era=trace",
    };
    let filter = EnvFilter::try_from_env("ERA_LOG").unwrap_or_else(|_| EnvFilter::new(default));
    // Colours for people; a file, a pipe and whoever sets NO_COLOR (https://no-color.org) get plain text.
    let is_coloured =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let layer = || tracing_subscriber::fmt::layer().with_writer(|| Later).with_target(false);
    let log = match format {
        LogFormat::Text => layer().with_ansi(is_coloured).boxed(),
        LogFormat::Json => {
            layer().json().flatten_event(true).with_current_span(false).with_span_list(false).with_ansi(false).boxed()
        }
    };
    // Whatever is logged: progress tells the model's levels.
    let levels = Targets::new().with_target(progress::LevelWatch::TARGET, tracing::Level::DEBUG);
    tracing_subscriber::registry().with(log.with_filter(filter)).with(progress::LevelWatch.with_filter(levels)).init();
    // What libraries trace are the bytes of requests, with their tokens (`ureq-proto`, `tungstenite`): no filter lets that through.
    log::set_max_level(log::max_level().min(log::LevelFilter::Debug));
}

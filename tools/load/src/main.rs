//! Loads for a running daemon: `cargo xtask soak`, and `cargo xtask bench` with `daemon`, `costs` or `slider`.
//!
//! The daemon is the program as it is shipped, in a process of its own. Its board is simulated in this one, behind a line that can be
//! pulled, cut and disturbed (`board`), so that what the board was told and went through is known without asking the daemon.

mod board;
mod costs;
mod daemon;
mod error;
mod http;
mod live;
mod pace;
mod slider;
mod soak;
mod times;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Loads for a running daemon.
#[derive(Parser)]
#[command(name = "era-load")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Many clients for a long time, with faults or without
    Soak(soak::Options),
    /// From a request to its answer, to the board and to a stop, at several rates and over every way in
    Daemon(pace::Options),
    /// What every route costs at its worst, and how long a stop takes beside it
    Costs(costs::Options),
    /// From a moving finger's message to the windows of a detent, at several speeds
    Slider(slider::Options),
}

/// A number of times, or of touches a second, that can be waited for.
fn parse_number_within_0_001_to_100000(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "must be a number".to_owned())?;
    if (1e-3..=1e5).contains(&number) { Ok(number) } else { Err("must be 0.001 to 100000".into()) }
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Soak(options) => soak::run_soak(&options),
        Command::Daemon(options) => pace::measure_and_print_touch_latency_failing_if_aim_is_missed(&options),
        Command::Costs(options) => costs::measure_and_print_route_costs_failing_if_a_stop_is_late(&options),
        Command::Slider(options) => slider::measure_and_print_slider_latency_failing_if_aim_is_missed(&options),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

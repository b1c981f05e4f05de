//! The commands of the command line.

use super::args::{DaemonOptions, Latency, Modes, Press, Replay, Response, Serve, Sweep, Touch, Transient, Verify};
use super::args_board::{Flash, Monitor};
use super::args_effect::EffectOptions;
use super::args_field::Field;
use super::args_study::Study;
use super::completions::{Completions, Man};
use super::config::Config;
use super::doctor::Doctor;
use super::install::Install;
use super::plan::PlanOptions;
use super::told::LogFormat;
use clap::{Parser, Subcommand};

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
    /// How the log and errors are written to standard error
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t, global = true)]
    pub log_format: LogFormat,
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
    Stop(DaemonOptions),
    /// Ask a running daemon to clear its device's latched fault, once the cause is gone; this does not arm the device
    #[command(
        after_help = "Example:\n  era clear\n  era clear --url https://panel.local:7878 --ca era-cert.pem --token-file token"
    )]
    Clear(DaemonOptions),
    /// Ask a running daemon to arm its device before a touch or after an outage; this begins with the self-test
    #[command(after_help = "Example:\n  era arm")]
    Arm(DaemonOptions),
    /// Show what a running daemon and its device are doing
    #[command(after_help = "Example:\n  era state --json")]
    State(DaemonOptions),
    /// Send the requests of a recording (`era serve --record`) to a running daemon again, at the recorded times, and compare
    /// the answers
    #[command(after_help = "Example:\n  era serve --record day.jsonl\n  era replay day.jsonl --speed 4")]
    Replay(Replay),
    /// List a panel's modes: frequencies and damping ratios; write and draw their shapes
    #[command(after_help = "\
Examples:
  era modes --scene examples/scenes/bar.toml --max-hz 500 --tolerance 1e-6
  era modes --png modes.png --npy modes.npy        the shapes, as a picture and for NumPy")]
    Modes(Modes),
    /// Show the effect of a finger's press on the gaps of actuators, and the voltage that is still safe
    #[command(after_help = "Example:\n  era press --scene examples/scenes/plate.toml --force-n 2")]
    Press(Press),
    /// Compute the acceleration at a point per newton at each actuator, over frequency
    #[command(after_help = "Example:\n  era response --at 100,60 --from 50 --to 400 --step 2")]
    Response(Response),
    /// Compute the acceleration at every point of a grid per newton at each actuator, over frequency
    #[command(after_help = "Example:\n  era sweep --from 50 --to 1000 --step 1 --grid 49,33 --npy plate.npy")]
    Sweep(Sweep),
    /// Compute the motion of a point after drives are switched on
    #[command(
        after_help = "Example:\n  era transient --at 100,60 --drive left:120:0.1 --drive right:88:0.1:90 --duration 0.5 --csv -"
    )]
    Transient(Transient),
    /// Plan the drives for a touch, without driving anything
    #[command(after_help = "\
Examples:
  era plan --at 100,60 --unit mm --json
  era plan --at 480,640 --also 1500,700:0.3 --quiet 960,640:15:0.02    two targets, and a place to be spared
  era plan --at 480,640 --window 0-300 --also 1500,700:0.3:200-500     one after the other")]
    Plan(PlanOptions),
    /// Design an effect at a point and predict the motion of the panel, without driving anything
    #[command(after_help = "Example:\n  era effect click --at 100,60 --unit mm --intensity-g 0.5")]
    Effect(EffectOptions),
    /// Compute the peak acceleration at every point of the surface, of one touch or the largest possible, or how crisp clicks are; write CSV or PNG
    #[command(after_help = "\
Examples:
  era field --at 480,640 --png map.png --csv map.csv
  era field --reach --png reach.png       the strongest and the most contrasted at every point
  era field --effect click --png clicks.png    where clicks are crisp
  era field --schemes                     dead zones: one frequency, phases, distinct frequencies
  era field --schemes --from 124 --zone 0,0,150,200 --felt    of a band and a part of the surface, as it is felt")]
    Field(Field),
    /// Run a design study: vary places, springs and materials, and write the best designs as scenes
    #[command(after_help = "\
Examples:
  era study examples/studies/placement.toml              after Ctrl-C, the same command resumes the study
  era study placement.toml --out results --shard 3/16    compute only the third of 16 shares, for a job array
  era study placement.toml --out results --gather        combine the results when all shares are complete")]
    Study(Study),
    /// Compare predicted peaks with the peaks that the simulated device measures
    #[command(after_help = "Example:\n  era verify --scene examples/scenes/bar.toml --points 3")]
    Verify(Verify),
    /// Measure the time from a touch request until the simulated device has received the last byte of the drives
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
    /// Show the log of a board's firmware continuously
    #[command(after_help = "\
Examples:
  era monitor                             over the link of the board that is connected
  era monitor --port emulated             the firmware on the emulated board
  era monitor --probe                     through a debug probe (not yet tried on a real board)")]
    Monitor(Monitor),
    /// Find problems with the board, the daemon and this machine, and say what to do; nothing is driven
    #[command(after_help = "\
Examples:
  era doctor
  era doctor --config /etc/era/era.toml
  era doctor --url https://panel.local:7878 --ca era-cert.pem --token-file token
  era doctor --device /dev/ttyACM0 --json")]
    Doctor(Doctor),
    /// Install the udev rule for the board and the systemd unit for the daemon (Linux)
    #[command(after_help = "\
Examples:
  era install --print                     look first
  sudo era install                        a service of the machine
  era install --user                      a service of this user; then: sudo era install --only rule
  era install --root pkg --program /usr/bin/era    for a package")]
    Install(Install),
    /// Check the daemon's configuration file, or print one
    Config(Config),
    /// Print a completion script for a shell
    #[command(after_help = "Example:\n  era completions bash > ~/.local/share/bash-completion/completions/era")]
    Completions(Completions),
    /// Print the program's man page, or write those of all commands
    #[command(after_help = "Example:\n  era man --dir ~/.local/share/man/man1")]
    Man(Man),
}

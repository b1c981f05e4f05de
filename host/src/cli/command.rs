//! The commands of the command line.

use super::args::{DaemonOptions, Latency, Replay, Serve, Touch, Verify};
use super::args_board::{Flash, Monitor};
use super::args_effect::EffectOptions;
use super::args_field::Field;
use super::args_panel::{Modes, Press, Response, Sweep, Transient};
use super::args_study::Study;
use super::completions::{Completions, Man};
use super::config::Config;
use super::doctor::Doctor;
use super::install::Install;
use super::plan::PlanOptions;
use super::terminal_messages::LogFormat;
use clap::{Parser, Subcommand};

/// Localized touch feedback on large surfaces: two to four electrostatic resonant actuators (ERAs) vibrate an
/// elastically supported panel, each at its own frequency; a finite-element model plans the vibration.
///
/// Without a command, `era` runs the daemon with the example plate and a simulated device on http://127.0.0.1:7878.
#[derive(Debug, Parser)]
#[command(
    name = "era",
    version,
    max_term_width = 100,
    after_help = "\
Examples:
  era                                          run the daemon and its web page; needs no hardware
  era touch 960 640 --intensity-g 0.3          make the middle of the screen vibrate
  era modes --scene my-panel.toml --max-hz 400 list the natural frequencies of a panel
  era plan --at 480,640 --json                 plan the drives of a touch, without driving
  era field --at 480,640 --png map.png         map the peak acceleration over the surface"
)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Log debug messages (-v), or also trace messages (-vv); the environment variable ERA_LOG, a filter in the
    /// syntax of the Rust crate tracing-subscriber, overrides this option
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    /// Format of the log and of errors on standard error
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t, global = true)]
    pub log_format: LogFormat,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the daemon: device session, HTTP and WebSocket interface, web page
    #[command(after_help = "Example:\n  era serve --scene examples/scenes/plate.toml --listen 127.0.0.1:8080")]
    Serve(Serve),
    /// Ask a running daemon to play a touch at the screen pixel X Y
    #[command(after_help = "Example:\n  era touch 960 640 --intensity-g 0.3 --duration-ms 500")]
    Touch(Touch),
    /// Ask a running daemon to stop all drives and to disarm its device
    #[command(after_help = "Example:\n  era stop")]
    Stop(DaemonOptions),
    /// Ask a running daemon to clear the latched fault of its device, after you have removed the cause; this does not
    /// arm the device
    #[command(
        after_help = "Example:\n  era clear\n  era clear --url https://panel.local:7878 --ca era-cert.pem --token-file token"
    )]
    Clear(DaemonOptions),
    /// Ask a running daemon to arm its device before a touch or after an outage; arming begins with the self-test
    #[command(after_help = "Example:\n  era arm")]
    Arm(DaemonOptions),
    /// Show the state of a running daemon and its device
    #[command(after_help = "Example:\n  era state --json")]
    State(DaemonOptions),
    /// Send the requests of a recording (`era serve --record`) to a running daemon again, at the recorded times, and compare
    /// the answers with the recorded answers
    #[command(after_help = "Example:\n  era serve --record day.jsonl\n  era replay day.jsonl --speed 4")]
    Replay(Replay),
    /// List the frequencies and damping ratios of a panel's modes; write or draw the mode shapes
    #[command(after_help = "\
Examples:
  era modes --scene examples/scenes/bar.toml --max-hz 500 --tolerance 1e-6
  era modes --png modes.png --npy modes.npy        write the shapes as a picture and as NumPy arrays")]
    Modes(Modes),
    /// Show how a finger's press changes the gaps of the actuators, and the highest voltage that is safe in these gaps
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
  era plan --at 480,640 --also 1500,700:0.3 --quiet 960,640:15:0.02    plan two targets and a quiet zone
  era plan --at 480,640 --window 0-300 --also 1500,700:0.3:200-500     plan two targets with time windows")]
    Plan(PlanOptions),
    /// Design an effect at a point and predict the motion of the panel, without driving anything
    #[command(after_help = "Example:\n  era effect click --at 100,60 --unit mm --intensity-g 0.5")]
    Effect(EffectOptions),
    /// Map over the surface the peak acceleration of one touch, the largest possible peaks, the lowest peaks of drive
    /// schemes, or how crisp clicks are; write CSV or PNG
    #[command(after_help = "\
Examples:
  era field --at 480,640 --png map.png --csv map.csv
  era field --reach --png reach.png       map the strongest peak and the highest contrast
  era field --effect click --png clicks.png    map where clicks are crisp
  era field --schemes                     compare the lowest peaks of three drive schemes
  era field --schemes --from 124 --zone 0,0,150,200 --felt
                                          compare in this band and zone, in dB above the threshold")]
    Field(Field),
    /// Run a design study: vary places, springs and materials, and write the best designs as scenes
    #[command(after_help = "\
Examples:
  era study examples/studies/placement.toml              after Ctrl-C, the same command resumes the study
  era study placement.toml --out results --shard 3/16    compute only share 3 of 16, for a job array
  era study placement.toml --out results --gather        combine the results when all shares are complete")]
    Study(Study),
    /// Compare predicted peaks with the peaks that the simulated device measures
    #[command(after_help = "Example:\n  era verify --scene examples/scenes/bar.toml --points 3")]
    Verify(Verify),
    /// Measure the time from a touch request until the simulated device has received the last byte of the drives
    #[command(after_help = "Example:\n  era latency --touches 200")]
    Latency(Latency),
    /// Write the firmware to a board, through a debug probe or over USB (not yet tested on a real board)
    #[command(after_help = "\
Before the command erases the flash, it checks that the file is a firmware image for this chip and kind of board. If a
board answers, the command also checks that the board's firmware does not speak a newer version of the ERA protocol than
the image. If an update was interrupted, run the same command again.
Switch the high-voltage supply off first: the bootloader of the chip drives some pins, and while the bootloader runs,
the firmware does not run and cannot keep the supply off.

This command has been tested with a simulated bootloader, not yet on a board.

Examples:
  era flash                               write the image of this checkout to the connected board
  era flash firmware.elf --port /dev/ttyACM0 --dfu    write over USB to the board at this port
  PROBE_RS_PROBE=0483:374e:0012 era flash --probe     write through this debug probe")]
    Flash(Flash),
    /// Show the log of a board's firmware continuously
    #[command(after_help = "\
Examples:
  era monitor                             show the log of the connected board
  era monitor --port emulated             show the log of the emulated board
  era monitor --probe                     show the log through a debug probe (not yet tested)")]
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
  era install --print                     print the files, without installing them
  sudo era install                        install a system service
  era install --user                      install a service of this user
  sudo era install --only rule            install the udev rule, which a service of a user also needs
  era install --root pkg --program /usr/bin/era    write the files below pkg, for a package")]
    Install(Install),
    /// Check a configuration file of the daemon, or print an example
    Config(Config),
    /// Print a completion script for a shell
    #[command(after_help = "Example:\n  era completions bash > ~/.local/share/bash-completion/completions/era")]
    Completions(Completions),
    /// Print the program's man page, or write the man pages of all commands
    #[command(after_help = "Example:\n  era man --dir ~/.local/share/man/man1")]
    Man(Man),
}

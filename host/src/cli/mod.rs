//! The command line.
//!
//! Exit codes: 0 done, 1 it failed, 2 bad use or a bad scene. Results go to standard output, everything else to standard
//! error.

mod args;
mod args_board;
mod args_effect;
mod args_field;
mod args_panel;
mod args_study;
mod client;
mod command;
mod completions;
mod config;
mod config_keys;
mod cost;
mod doctor;
mod effect;
mod effect_file;
mod effect_finger;
mod explain;
mod field;
mod field_click;
mod flash;
mod headings;
mod install;
mod latency;
mod live;
mod log;
mod modes;
mod monitor;
mod notify;
mod output;
mod panel;
mod plan;
mod plan_explain;
mod press;
mod progress;
mod progress_of;
mod reach;
mod replay;
mod serve;
mod signals;
mod standard_error;
mod study;
mod sweep;
mod terminal_messages;
mod token;
mod transient;
mod values;
mod verify;
mod wishes;

use clap::{CommandFactory, Parser};
use std::fmt;
use std::process::ExitCode;
use std::time::Instant;

/// Why a command ended early.
#[derive(Debug)]
pub enum Failure {
    /// Bad use, or a bad scene: exit code 2.
    Usage(String),
    /// It failed: exit code 1.
    Failed(String),
    /// A panic, which the panic hook has already reported: exit code 1.
    Defect,
}

impl Failure {
    fn usage_error(error: impl fmt::Display) -> Self {
        Failure::Usage(error.to_string())
    }

    fn runtime_error(error: impl fmt::Display) -> Self {
        Failure::Failed(error.to_string())
    }

    /// What is said of it; nothing where that has been told.
    fn message_or_empty_if_already_reported(&self) -> String {
        match self {
            Failure::Usage(text) | Failure::Failed(text) => text.clone(),
            Failure::Defect => String::new(),
        }
    }
}

type CommandResult = Result<(), Failure>;

/// Runs the program with the process's arguments.
#[must_use]
pub fn main() -> ExitCode {
    let started = Instant::now();
    era_files::tell_size_limit_as_error();
    let arguments = command::Arguments::try_parse().unwrap_or_else(|mut error| {
        hide_secrets_of_url_or_proxy_in_argument_error(&mut error);
        // `--help` is near every short option by its letters, but nobody has meant it.
        let suggested = error.get(clap::error::ContextKind::SuggestedArg).map(ToString::to_string);
        if suggested.as_deref() == Some("--help") {
            error.remove(clap::error::ContextKind::SuggestedArg);
        }
        // Nobody who mistypes an option means a value that begins with two dashes.
        error.remove(clap::error::ContextKind::Suggested);
        // Without a command the daemon runs, but its options belong to it.
        let given: Vec<String> = std::env::args().skip(1).collect();
        let has_command =
            command::Arguments::command().get_subcommands().any(|own| given.iter().any(|word| word == own.get_name()));
        if let (clap::error::ErrorKind::UnknownArgument, false) = (error.kind(), has_command) {
            let wrong = error.get(clap::error::ContextKind::InvalidArg).map(ToString::to_string).unwrap_or_default();
            print_argument_error_or_help_and_exit(
                &error,
                &format!("Options must follow a command; options of the daemon follow `serve`: era serve {wrong} ..."),
            );
        }
        print_argument_error_or_help_and_exit(&error, "")
    });
    terminal_messages::set_log_format(arguments.log_format);
    // Before any thread is started, the log's included.
    if matches!(arguments.command, None | Some(command::Command::Serve(_))) {
        signals::block_background_terminal_stop_signals();
    }
    log::start_standard_error_log_filtered_by_era_log_or_verbosity(arguments.verbose, arguments.log_format);
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(|at| format!(" at {}:{}", at.file(), at.line())).unwrap_or_default();
        let what = panic.payload_as_str().unwrap_or("no message").lines().next().unwrap_or_default();
        // Where standard error is closed (`2>&1 | head`) that is the panic, and another one would end in an abort.
        terminal_messages::tell_why_command_failed(&format!(
            "this is a defect of era itself{place}: {what}; please report this message together with the scene"
        ));
    }));
    // A panic is a defect, but never a status that scripts do not know, nor a page of frames for the user.
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run_command(arguments, started)));
    let code = match outcome.unwrap_or(Err(Failure::Defect)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Usage(message)) => {
            terminal_messages::tell_why_command_failed(&message);
            ExitCode::from(2)
        }
        Err(Failure::Failed(message)) => {
            terminal_messages::tell_why_command_failed(&message);
            ExitCode::FAILURE
        }
        // The hook has said what.
        Err(Failure::Defect) => ExitCode::FAILURE,
    };
    standard_error::wait_until_queue_is_written_or_timeout();
    code
}

/// Takes out of what is said of a wrong address what may be a password or a token.
fn hide_secrets_of_url_or_proxy_in_argument_error(error: &mut clap::Error) {
    use clap::error::{ContextKind, ContextValue};
    let option = error.get(ContextKind::InvalidArg).map(ToString::to_string).unwrap_or_default();
    if ["--url", "--proxy"].iter().any(|own| option.starts_with(own))
        && let Some(ContextValue::String(value)) = error.get(ContextKind::InvalidValue)
    {
        let told = values::hide_secret_parts(value);
        error.insert(ContextKind::InvalidValue, ContextValue::String(told));
    }
}

/// Ends the program as its arguments cannot be read, or ask for help.
fn print_argument_error_or_help_and_exit(error: &clap::Error, hint: &str) -> ! {
    match terminal_messages::find_requested_log_format(std::env::args_os()) {
        terminal_messages::LogFormat::Json if error.use_stderr() => {
            terminal_messages::tell_why_command_did_not_start(
                terminal_messages::LogFormat::Json,
                &format!("{error}{hint}"),
            );
            std::process::exit(2)
        }
        _ if hint.is_empty() => match error.print() {
            // Help that nobody could read; a reader that has gone away (`| head`) has read what it wanted.
            Err(lost) if !error.use_stderr() && lost.kind() != std::io::ErrorKind::BrokenPipe => {
                terminal_messages::tell_why_command_failed(&format!("cannot write to standard output: {lost}"));
                std::process::exit(1)
            }
            _ => std::process::exit(error.exit_code()),
        },
        format => {
            let _ = error.print();
            terminal_messages::tell_why_command_did_not_start(format, hint);
            std::process::exit(2)
        }
    }
}

fn run_command(arguments: command::Arguments, started: Instant) -> CommandResult {
    use command::Command;
    match arguments.command {
        // Without a command the main job runs: daemon, example plate, simulated device, web page.
        None => serve::run_serve(&args::Serve::default(), started),
        Some(Command::Serve(options)) => config::fill_in_options_from_config_file_if_named(&options)
            .and_then(|options| serve::run_serve(&options, started)),
        Some(Command::Touch(options)) => match &options.file {
            Some(file) => effect_file::play_effect_file_through_daemon_and_print_answer(&options, file),
            None => client::send_touch_to_daemon_and_print_answer(&options),
        },
        Some(Command::Stop(options)) => client::send_stop_to_daemon_and_print_state(&options),
        Some(Command::Clear(options)) => client::clear_faults_through_daemon_and_print_state(&options),
        Some(Command::Arm(options)) => client::arm_device_through_daemon_and_print_state(&options),
        Some(Command::State(options)) => client::show_device_state(&options),
        Some(Command::Modes(options)) => modes::run_modes(&options),
        Some(Command::Press(options)) => press::compute_and_print_actuator_gaps_under_finger_press(&options),
        Some(Command::Response(options)) => panel::compute_and_print_frequency_response_at_point(&options),
        Some(Command::Sweep(options)) => sweep::run_sweep(&options),
        Some(Command::Transient(options)) => transient::run_transient(&options),
        Some(Command::Plan(options)) => plan::run_plan(&options),
        Some(Command::Effect(options)) => effect::design_and_print_effect(&options),
        Some(Command::Field(options)) => field::map_touch_click_or_reach_or_compare_drive_schemes(&options),
        Some(Command::Study(options)) => study::run_study(&options),
        Some(Command::Verify(options)) => verify::verify_plans_by_time_simulation_failing_above_limit(&options),
        Some(Command::Replay(options)) => replay::run_replay(&options),
        Some(Command::Latency(options)) => latency::measure_touch_latency_on_simulated_device(&options),
        Some(Command::Flash(options)) => flash::run_flash(&options),
        Some(Command::Monitor(options)) => monitor::decode_and_print_board_log(&options),
        Some(Command::Doctor(options)) => doctor::run_doctor(&options),
        Some(Command::Install(options)) => install::install_print_or_remove_udev_rule_and_unit(&options),
        Some(Command::Config(options)) => config::run_config(&options),
        Some(Command::Completions(options)) => completions::print_completions(&options, command::Arguments::command()),
        Some(Command::Man(options)) => completions::print_or_write_man_pages(&options, command::Arguments::command()),
    }
}

/// Writes a line of JSON to standard output.
fn print_json(value: &impl serde::Serialize) -> CommandResult {
    let text = serde_json::to_string(value).map_err(Failure::runtime_error)?;
    print_text_after_queued_log(&text)
}

/// Writes to standard output; a reader that has gone away (`| head`) is no failure.
fn print_text_after_queued_log(text: &str) -> CommandResult {
    use std::io::{ErrorKind, Write};
    // What has been logged before stands before it.
    standard_error::wait_until_queue_is_written_or_timeout();
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::runtime_error(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::headings::{BAND, DAEMON, EFFECT, MODEL, PLANNER, TOUCH};
    use super::*;
    use clap::CommandFactory;
    use std::collections::{BTreeMap, BTreeSet};

    /// Every command's text for `--help` and for `-h`, with those of its subcommands.
    fn helps(command: &mut clap::Command) -> Vec<String> {
        let mut all = vec![command.render_long_help().to_string(), command.render_help().to_string()];
        command.get_subcommands_mut().for_each(|command| all.extend(helps(command)));
        all
    }

    /// Comments in the code are the texts of the help; what is a link in the one is noise in the other.
    #[test]
    fn no_help_has_a_link_of_rustdoc() {
        let mut command = command::Arguments::command();
        command.build();
        let all = helps(&mut command);
        assert!(all.len() > 30, "{}", all.len());
        // An address is none.
        for line in all.iter().flat_map(|text| text.lines()).map(|line| line.replace("[::1]", "")) {
            for link in ["[`", "`]", "](", "::"] {
                assert!(!line.contains(link), "{link} in {line:?}");
            }
        }
    }

    /// A group of options that is flattened into a command leaves its heading to all options after it: each of these must
    /// name its own.
    #[test]
    fn options_are_under_the_headings_that_are_theirs() {
        let program = command::Arguments::command();
        let mut groups: BTreeMap<(&str, &str), BTreeSet<&str>> = BTreeMap::new();
        for command in program.get_subcommands() {
            for option in command.get_arguments() {
                let Some(heading) = option.get_help_heading() else { continue };
                let (command, name) = (command.get_name(), option.get_id().as_str());
                assert!(!option.is_positional(), "era {command}: the argument {name} is under {heading}");
                groups.entry((command, heading)).or_default().insert(name);
            }
        }
        for ((command, heading), names) in &groups {
            assert!(names.len() > 1, "era {command}, {heading}: {names:?}");
        }
        for (heading, wanted) in [
            (MODEL, "accuracy explain no_cache scene tolerance within"),
            (BAND, "at from grid max_hz step to unit"),
            (TOUCH, "at duration_ms intensity_db intensity_g spread unit"),
            (EFFECT, "count crisp_ms duration_ms effect envelopes file format period_ms prefer"),
            (PLANNER, "also grouping objective quiet spread trade weigh window zone"),
            (DAEMON, "ca proxy token_file url"),
        ] {
            let with_heading = groups.iter().filter(|((_, own), _)| *own == heading);
            let names: BTreeSet<&str> = with_heading.flat_map(|(_, names)| names.iter().copied()).collect();
            assert_eq!(names.into_iter().collect::<Vec<_>>().join(" "), wanted, "{heading}");
        }
    }
}

//! `era doctor`: finds out, judges, and prints.

use super::args::Serve;
use super::client::DaemonContact;
use super::config::ConfigFile;
use super::headings::{CHECKED, DAEMON};
use super::serve::listen_place_or_default;
use super::token::read_token_from_file_or_else_environment;
use super::values::{parse_daemon_url_adding_http_if_no_scheme, parse_outgoing_http_proxy};
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::certificate::read_certificates;
use crate::connection::HostPort;
use crate::device::{Target, priority};
use crate::doctor::facts::{Chosen, Daemon, File, PortAnswer, Wanted};
use crate::doctor::{Facts, Finding, Verdict, board, daemon, judge_facts, machine};
use crate::private_file::TOKEN_VARIABLE;
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The certificate that `--tls-dir` makes.
const CERTIFICATE: &str = "era-cert.pem";

#[derive(Clone, Debug, Args)]
pub struct Doctor {
    /// The device to check: auto (finds the connected board), the path of a serial port, sim or emulated (sim and
    /// emulated need no hardware). The doctor opens only the serial port of this device [default: the device in the
    /// configuration, or the board that
    /// the doctor finds through the USB identity of the board]
    #[arg(long, value_name = "DEVICE", help_heading = CHECKED)]
    pub device: Option<Target>,
    /// The daemon's configuration file; the doctor checks the file, and the device and the address in it
    #[arg(long, value_name = "FILE", help_heading = CHECKED)]
    pub config: Option<PathBuf>,
    /// A scene file to check
    #[arg(long, value_name = "FILE", help_heading = CHECKED)]
    pub scene: Option<PathBuf>,
    /// The daemon's address: http://HOST:PORT, https://HOST:PORT or HOST:PORT [default: the address in the
    /// configuration, or http://127.0.0.1:7878]
    #[arg(long, value_name = "URL", value_parser = parse_daemon_url_adding_http_if_no_scheme, help_heading = DAEMON)]
    pub url: Option<String>,
    /// File with the token, if the daemon needs a token; or put the token into the environment variable ERA_TOKEN
    /// [default: the token file of the configuration]
    #[arg(long, value_name = "FILE", help_heading = DAEMON)]
    pub token_file: Option<PathBuf>,
    /// File with the trusted certificate in PEM for the connection to the daemon [default: the certificate of the
    /// configuration]
    #[arg(long, value_name = "FILE", help_heading = DAEMON)]
    pub ca: Option<PathBuf>,
    /// HTTP proxy for the connection to the daemon (method CONNECT), such as http://HOST:PORT; proxy variables of the
    /// environment are ignored
    #[arg(long, value_name = "URL", value_parser = parse_outgoing_http_proxy, help_heading = DAEMON)]
    pub proxy: Option<HostPort>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run_doctor(options: &Doctor) -> CommandResult {
    let findings = judge_facts(&gather_facts_asking_daemon_and_board_on_free_port(options)?);
    let count = |verdict| findings.iter().filter(|finding| finding.verdict == verdict).count();
    let (problems, warnings) = (count(Verdict::Problem), count(Verdict::Warning));
    if options.json {
        print_json(&json!({"findings": findings, "problems": problems, "warnings": warnings}))?;
    } else {
        print_text_after_queued_log(&format_findings(&findings))?;
    }
    match problems {
        0 => Ok(()),
        1 => Err(Failure::runtime_error("1 problem was found; the line below the problem says what to do")),
        many => Err(Failure::runtime_error(format!(
            "{many} problems were found; the line below each problem says what to do"
        ))),
    }
}

fn format_findings(findings: &[Finding]) -> String {
    let mut text = String::new();
    for (i, Finding { check, verdict, found, advice }) in findings.iter().enumerate() {
        let verdict = match verdict {
            Verdict::Ok => "ok",
            Verdict::Warning => "warning",
            Verdict::Problem => "PROBLEM",
        };
        let _ = write!(text, "{}{verdict:8} {check:14} {found}", if i > 0 { "\n" } else { "" });
        if let Some(advice) = advice {
            let _ = write!(text, "\n{:8} {:14} -> {advice}", "", "");
        }
    }
    text
}

/// Looks at everything. Only a port that is the board's or named is opened, and only if nobody else has it open.
fn gather_facts_asking_daemon_and_board_on_free_port(options: &Doctor) -> Result<Facts, Failure> {
    let root = Path::new("/");
    let (config, serve) = examine_config_file_and_read_serve_options(options);
    let wanted = match options.device.as_ref().or(serve.device.as_ref()) {
        None => Wanted::Any,
        Some(Target::Auto) => Wanted::Board,
        Some(Target::Serial(path)) => Wanted::Port(path.clone()),
        Some(Target::Sim) => Wanted::Simulated("sim"),
        Some(Target::Emulated) => Wanted::Simulated("emulated"),
    };
    let ports = machine::list_serial_ports_with_usb_identity();
    let path = match &wanted {
        Wanted::Port(path) => Some(path.clone()),
        Wanted::Any | Wanted::Board => ports.iter().find(|port| port.is_board()).map(|port| port.path.clone()),
        Wanted::Simulated(_) => None,
    };
    let (url, daemon) = find_url_and_ask_daemon(options, &serve)?;
    let chosen = path.map(|path| {
        // The same port may have several names, as in /dev/serial/by-id.
        let path = match &daemon {
            Daemon::Runs { port, .. } if is_same_file(port, &path) => port.clone(),
            _ => path,
        };
        let holders = machine::find_other_processes_with_port_open(root, &path);
        let is_daemons = matches!(&daemon, Daemon::Runs { port, .. } if *port == path);
        let is_free = holders.is_empty() && !is_daemons;
        let answer = if is_free { board::ask_board(&path) } else { PortAnswer::NotAsked };
        Chosen { access: machine::find_group_with_access_and_membership(root, &path), holders, answer, path }
    });
    let scene = options.scene.as_ref().or(serve.panel.scene.as_ref()).map(|path| {
        let panel = super::args::PanelOptions { scene: Some(path.clone()), ..super::args::PanelOptions::default() };
        let mistake = match panel.load_scene() {
            Err(Failure::Usage(text) | Failure::Failed(text)) => Some(text),
            _ => None,
        };
        File { path: path.display().to_string(), mistake }
    });
    Ok(Facts {
        wanted,
        ports,
        bootloader: machine::is_chip_in_bootloader_on_usb_if_usb_is_readable(),
        rules: machine::find_udev_rules_for_board_if_machine_has_udev(root),
        modem_manager: machine::find_modem_manager_pid(root),
        realtime: machine::read_realtime_priority_limit(root)
            .map(|limit| if priority::can_raise_thread_priority() { limit.max(1) } else { 0 }),
        chosen,
        address: url.split_once("://").map_or(url.as_str(), |(_, place)| place).to_owned(),
        is_address_named: options.url.is_some(),
        daemon,
        config,
        scene,
    })
}

/// Where a daemon is looked for, and what is there. The command line comes before the configuration.
fn find_url_and_ask_daemon(options: &Doctor, serve: &Serve) -> Result<(String, Daemon), Failure> {
    let listen = listen_place_or_default(serve)?;
    // A name is asked as it stands there.
    let place = listen
        .address()
        .map_or_else(|| listen.to_string(), |address| daemon::replace_unspecified_by_loopback(address).to_string());
    let speaks_tls = serve.tls_dir.is_some() || serve.tls_cert.is_some();
    let url = options.url.clone().unwrap_or_else(|| format!("{}://{place}", if speaks_tls { "https" } else { "http" }));
    let made = serve.tls_dir.as_ref().map(|folder| folder.join(CERTIFICATE));
    let configured = made.or_else(|| serve.tls_cert.clone());
    // A certificate of the configuration that is not there, not for this user, or none need not be: it is said what is missing.
    let ca = options.ca.clone().or_else(|| configured.filter(|file| read_certificates(file).is_ok()));
    let token = match (&options.token_file, &serve.token_file) {
        (Some(named), _) => read_token_from_file_or_else_environment(Some(named))?,
        (None, Some(configured)) if std::env::var_os(TOKEN_VARIABLE).is_none() => {
            read_token_from_file_or_else_environment(Some(configured)).ok().flatten()
        }
        (None, _) => read_token_from_file_or_else_environment(None)?,
    };
    let contact = DaemonContact::new(&url, ca.as_deref(), options.proxy.as_ref(), token)?;
    let way = daemon::DaemonRequestRoute { has_ca: ca.is_some(), has_proxy: options.proxy.is_some() };
    let found = daemon::ask_daemon(&url, &contact.way.make_agent(daemon::ANSWER), contact.bearer.as_deref(), way);
    Ok((url, found))
}

fn is_same_file(one: &str, other: &str) -> bool {
    let file = |path: &str| std::fs::canonicalize(path).ok();
    one == other || file(one).is_some_and(|one| file(other) == Some(one))
}

/// The configuration file, and what it makes the daemon use.
fn examine_config_file_and_read_serve_options(options: &Doctor) -> (Option<File>, Serve) {
    let Some(path) = &options.config else { return (None, Serve::default()) };
    let (mistake, serve) = match ConfigFile::read(path) {
        Ok(file) => {
            let mistakes: Vec<String> = file
                .find_mistakes_that_prevent_start_or_hinder_clients()
                .into_iter()
                .map(|mistake| mistake.text)
                .collect();
            ((!mistakes.is_empty()).then(|| mistakes.join("; ")), file.fill_in_missing_options(&Serve::default()))
        }
        Err(error) => (Some(error.to_string()), Serve::default()),
    };
    (Some(File { path: path.display().to_string(), mistake }), serve)
}

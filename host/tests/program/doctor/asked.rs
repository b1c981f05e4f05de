//! The command, beside a simulated device on a pseudo-terminal.

use crate::support::program::{ProgramOutput, build_era_command, run_command, run_era, run_era_json};
use era::device::sim::{Defects, SimControl, SimDevice, SimKnobs, SimPanel};
use era::doctor::facts::Daemon;
use era::planner::softening::Transducer;
use era::transient::reduced::ModalSystem;
use nalgebra::{DMatrix, DVector};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::time::Duration;

fn device() -> SimDevice {
    let none = ModalSystem { lambda: DVector::zeros(0), damping: DMatrix::zeros(0, 0), force: DMatrix::zeros(0, 2) };
    SimDevice::start(SimPanel::new(&none, vec![Transducer::with_fixed_force(0.0); 2]), vec![2000.0; 2]).unwrap()
}

fn spoil(control: &SimControl, defects: Defects) {
    control.set_knobs(SimKnobs { defects, ..SimKnobs::default() });
}

/// Findings by check, and the exit code; the address is one where nobody listens.
fn doctor(arguments: &[&str]) -> (Vec<Value>, Option<i32>) {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("era.toml");
    std::fs::write(&config, "version = 1\nlisten = \"127.0.0.1:1\"\n").unwrap();
    let mut command = build_era_command();
    command.args(["doctor", "--json", "--config", config.to_str().unwrap()]).args(arguments);
    let output = run_command(&mut command);
    let all = output.parse_json();
    (all["findings"].as_array().unwrap().clone(), output.code)
}

fn of<'a>(findings: &'a [Value], check: &str) -> &'a Value {
    findings.iter().find(|finding| finding["check"] == check).unwrap_or_else(|| panic!("no {check} in {findings:?}"))
}

#[test]
fn a_device_that_is_well_answers_and_is_not_armed() {
    let device = device();
    let ask = || doctor(&["--device", device.port_path()]);
    // The clock is that of a machine which other tests keep busy: it is told as a warning, and asked again.
    let is_late = |(findings, _): &(Vec<Value>, Option<i32>)| of(findings, "clock")["verdict"] == "warning";
    let first = (0..5).map(|_| ask()).find(|asked| !is_late(asked));
    let (findings, code) = first.unwrap_or_else(ask);
    assert_eq!(code, Some(0), "{findings:?}");
    for check in ["config", "permission", "port", "firmware", "fault", "interlock", "supply", "clock"] {
        assert_eq!(of(&findings, check)["verdict"], "ok", "{findings:?}");
    }
    assert!(of(&findings, "fault")["found"].as_str().unwrap().contains("safe"), "{findings:?}");
    assert!(device.control().last_drives_received_at().is_none());
}

#[test]
fn open_loops_a_silent_line_and_a_held_port_are_reported() {
    let device = device();
    spoil(&device.control(), Defects { interlock_open: true, ..Defects::default() });
    let (findings, code) = doctor(&["--device", device.port_path()]);
    assert!(code == Some(1) && of(&findings, "interlock")["verdict"] == "problem", "{findings:?}");
    device.control().set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    let (findings, code) = doctor(&["--device", device.port_path()]);
    assert!(code == Some(1) && of(&findings, "firmware")["verdict"] == "problem", "{findings:?}");
    // Somebody has the port: it is not touched, and it is said who.
    device.control().set_knobs(SimKnobs::default());
    let held = serialport::new(device.port_path(), 115_200).timeout(Duration::from_millis(10)).open().unwrap();
    let (findings, code) = doctor(&["--device", device.port_path()]);
    let port = of(&findings, "port");
    let told = port["found"].as_str().unwrap();
    assert!(code == Some(1) && told.contains(&format!("process {}", std::process::id())), "{findings:?}");
    assert_eq!(held.bytes_to_read().unwrap(), 0);
    let (findings, code) = doctor(&["--device", "/dev/none-of-these"]);
    assert!(code == Some(1) && of(&findings, "permission")["verdict"] == "problem", "{findings:?}");
}

#[test]
fn mistakes_in_files_are_reported_and_the_simulated_device_needs_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("panel.toml");
    std::fs::write(&scene, "version = 1\n").unwrap();
    let (findings, code) = doctor(&["--device", "sim", "--scene", scene.to_str().unwrap()]);
    assert!(code == Some(1) && of(&findings, "scene")["verdict"] == "problem", "{findings:?}");
    let (findings, code) = doctor(&["--device", "sim"]);
    assert!(code == Some(0) && of(&findings, "board")["verdict"] == "ok", "{findings:?}");
    let ProgramOutput { out: told, error, .. } = run_era(&["doctor", "--device", "/dev/none-of-these"]);
    assert!(told.contains("PROBLEM") && told.contains("-> name one of the ports"), "{told}");
    assert!(error.contains("error: ") && error.contains("problem"), "{error}");
}

/// A daemon that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A daemon that runs is asked in place of its board, which keeps its port to itself.
#[test]
fn a_daemon_is_asked_in_place_of_its_board() {
    let device = device();
    let mut command = build_era_command();
    command.args(["serve", "--listen", "127.0.0.1:0", "--accuracy", "fast", "--device", device.port_path()]);
    let mut daemon = Running(command.stderr(Stdio::piped()).spawn().unwrap());
    let mut lines = BufReader::new(daemon.0.stderr.take().unwrap()).lines().map_while(Result::ok);
    let line = lines.find(|line| line.contains("open http://")).unwrap();
    let address = line.split("http://").nth(1).unwrap().split_whitespace().next().unwrap().to_owned();
    // Nobody is held up by what it goes on to tell.
    std::thread::spawn(move || lines.for_each(drop));
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).proxy(None).build().into();
    let found = (0..100).find_map(|_| {
        std::thread::sleep(Duration::from_millis(50));
        match era::doctor::daemon::ask_daemon(
            &format!("http://{address}"),
            &agent,
            None,
            era::doctor::daemon::DaemonRequestRoute::default(),
        ) {
            Daemon::Runs { heard: Some(heard), port, .. } if heard.supply.is_some() => Some((*heard, port)),
            _ => None,
        }
    });
    let (heard, port) = found.expect("the daemon tells of its device");
    assert_eq!((port.as_str(), heard.protocol), (device.port_path(), Some(era_shared::protocol::CURRENT_VERSION)));
    assert!(heard.supply.is_some_and(|supply| supply.interlock_closed && supply.rail_v.len() == 2));
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("era.toml");
    std::fs::write(&config, format!("version = 1\nlisten = \"{address}\"\ndevice = \"{port}\"\n")).unwrap();
    let all = run_era_json(&["doctor", "--json", "--config", config.to_str().unwrap()]);
    let findings = all["findings"].as_array().unwrap();
    assert!(of(findings, "port")["found"].as_str().unwrap().contains("running daemon has"), "{findings:?}");
    assert_eq!(of(findings, "interlock")["verdict"], "ok");
    // Whoever else wants the port is told who has it.
    let told = run_era(&["monitor", "--port", &port]).error;
    assert!(told.contains(&format!("is open in era (process {})", daemon.0.id())), "{told}");
    // A latched fault is told without a word about the device, and `era clear` clears it.
    let asked = |arguments: &[&str]| {
        let output = run_command(build_era_command().args(arguments).args(["--url", &address]));
        (output.out, output.code)
    };
    let (told, code) = asked(&["arm"]);
    assert!(code == Some(0) && told.contains(": armed"), "{told}");
    device.control().set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    // The board's dead-man time, four times over.
    std::thread::sleep(Duration::from_secs(1));
    device.control().set_knobs(SimKnobs::default());
    let found = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        let (told, code) = asked(&["doctor", "--device", "sim"]);
        code == Some(1) && told.contains("0 (host-silent) is latched") && told.contains("`era clear`")
    });
    assert!(found, "{:?}", asked(&["doctor", "--device", "sim"]));
    assert!(asked(&["state"]).0.contains("fault 0 (host-silent)"));
    assert_eq!(asked(&["clear"]).1, Some(0));
    assert!(!asked(&["state"]).0.contains("fault 0"));
    // A board that was away waits for a person, unless the daemon was told otherwise; everybody says for whom.
    device.control().request_restart();
    let found = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        let (told, code) = asked(&["doctor", "--device", "sim"]);
        code == Some(0) && told.contains("waits to be armed") && told.contains("`era arm`")
    });
    assert!(found, "{:?}", asked(&["doctor", "--device", "sim"]));
    assert!(asked(&["state"]).0.contains("nothing is driven until `era arm` arms the device"));
    assert_eq!(asked(&["touch", "300", "900"]).1, Some(1));
    assert_eq!(asked(&["arm"]).1, Some(0));
    assert!(!asked(&["state"]).0.contains("era arm"));
    assert_eq!(asked(&["touch", "300", "900"]).1, Some(0));
}

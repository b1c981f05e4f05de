//! A second program at the board's port: whoever is waited for, nobody waits for ever, and the program is named.

use crate::reader::Reader;
use crate::serving::Serving;
use crate::support::program::run_era;
use crate::{TOUCH, drive, start_still_simulated_device, touches_are_driven, wait_until};
use era::device::Target;
use era::device::sim::SimDevice;
use era::doctor::facts::PortAnswer;
use era::flash::board::Board;
use std::process::Command;
use std::time::{Duration, Instant};

/// The board goes off, the reason is told and logged, a stop is answered, and when the program has gone everything goes on.
#[test]
fn a_session_survives_a_program_that_takes_its_answers() {
    let board = start_still_simulated_device();
    let mut reader = Reader::with_open(board.port_path());
    let serving = Serving::start(&board, &[]);
    let daemon = &serving.daemon;
    drive(daemon);
    reader.reads();
    wait_until("the board is off", || !board.control().observations_since_start().energised);
    let state = daemon.wait_for(|state| state["device"]["outages"] == 1);
    let problem = state["device"]["problem"].as_str().unwrap();
    assert!(problem.contains(&format!("end {}", reader.name())), "{problem}");
    let begun = Instant::now();
    let (status, _, told) = daemon.post("/v1/stop", "");
    assert!(status == 502 && begun.elapsed() < Duration::from_secs(4), "{:?} {told}", begun.elapsed());
    let (_, _, told) = daemon.post("/v1/touch", TOUCH);
    assert!(told["detail"].as_str().unwrap().contains(&reader.name()), "{told}");
    let name = reader.name();
    drop(reader);
    daemon.wait_for(|state| state["device"]["connected"] == true);
    daemon.post("/v1/faults/clear", "");
    wait_until("it is armed", || daemon.post("/v1/arm", "").0 == 200);
    touches_are_driven(daemon);
    let log = serving.end();
    let said = |line: &serde_json::Value| line.to_string().contains(&name);
    assert!(log.iter().any(said), "{log:?}");
}

/// A program that was there first: the doctor and the flasher end, and name it.
#[test]
fn the_doctor_and_the_flasher_end_and_name_the_program() {
    let board = start_still_simulated_device();
    let mut reader = Reader::with_open(board.port_path());
    reader.reads();
    let begun = Instant::now();
    let PortAnswer::Silent(told) = era::doctor::board::ask_board(board.port_path()) else { panic!("it answers") };
    assert!(told.contains(&reader.name()), "{told}");
    let Err(error) = Board::open(&Target::Serial(board.port_path().into())) else { panic!("it answers") };
    assert!(error.to_string().contains(&reader.name()), "{error}");
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
}

/// A program that has stopped the line's output: what is written stays where it is.
#[test]
fn a_line_that_takes_nothing_is_reported() {
    let board = start_still_simulated_device();
    let stop = "import sys, termios; termios.tcflow(0, termios.TCOOFF)";
    let port = std::fs::File::open(board.port_path()).unwrap();
    assert!(Command::new("python3").args(["-c", stop]).stdin(port).status().unwrap().success());
    let keeps = Reader::with_open(board.port_path());
    let begun = Instant::now();
    let PortAnswer::Silent(told) = era::doctor::board::ask_board(board.port_path()) else { panic!("it answers") };
    assert!(told.contains("accepted no bytes") && told.contains("sh (process"), "{told}");
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    drop(keeps);
}

/// A port that another program has for itself is in use, and nobody is sent to its cable.
#[test]
fn a_port_in_use_is_reported_as_one() {
    let board = start_still_simulated_device();
    let holder = hold(&board);
    let pid = holder.0.id();
    let path = board.port_path().to_owned();
    let named = format!("(process {pid})");
    let is_told = |text: &str| {
        assert!(text.contains(&named) && text.contains("in use"), "{text}");
        assert!(!text.contains("cable"), "{text}");
    };
    let Err(error) = Board::open(&Target::Serial(path.clone())) else { panic!("it is open twice") };
    is_told(&error.to_string());
    let daemon = crate::support::Daemon::at(
        era::scene::STARTING_PLATE,
        &path,
        era::device::session::policy::SessionPolicy::default(),
    );
    let state = daemon.wait_for(|state| state["device"]["problem"].is_string());
    is_told(state["device"]["problem"].as_str().unwrap());
    let (_, _, told) = daemon.post("/v1/touch", TOUCH);
    is_told(told["detail"].as_str().unwrap());
    let told = run_era(&["doctor", "--device", &path]).out;
    assert!(told.contains(&named), "{told}");
    drop(holder);
    daemon.wait_for(|state| state["device"]["connected"] == true);
}

struct Holder(std::process::Child);

impl Drop for Holder {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Another program that has locked the port, as programs for serial ports do.
fn hold(board: &SimDevice) -> Holder {
    let script = "import fcntl, os, sys, time\n\
                  port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\n\
                  fcntl.flock(port, fcntl.LOCK_EX)\n\
                  print('held', flush=True)\n\
                  time.sleep(600)";
    let mut command = Command::new("python3");
    let mut child =
        command.args(["-c", script, board.port_path()]).stdout(std::process::Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(child.stdout.as_mut().unwrap()), &mut line).unwrap();
    assert_eq!(line, "held\n");
    Holder(child)
}

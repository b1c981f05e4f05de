//! Boards that come late, go away, come back, are others, fall silent, take nothing, or are old.

use crate::support::{Daemon, old_board, panel_of, table};
use era::device::session::policy::SessionPolicy;
use era::device::sim::{SimBoard, SimDevice, SimKnobs};
use era::device::{Client, LinkError};
use era::planner::PlanTable;
use era::scene::STARTING_PLATE;
use era_shared::protocol::Request;
use serde_json::{Value, json};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#;
const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;
/// When both would end by themselves.
const OWN_END: Duration = Duration::from_secs(9);
const LONG_EFFECT: &str = r#"{"x_px": 300, "y_px": 900, "effect": "buzz", "duration_ms": 9000}"#;

/// A place into which boards are plugged: a link that leads to the pseudo-terminal of each.
struct Socket {
    link: PathBuf,
    table: PlanTable,
    _folder: tempfile::TempDir,
}

impl Socket {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { link: folder.path().join("board"), table: table(STARTING_PLATE), _folder: folder }
    }

    fn path(&self) -> &str {
        self.link.to_str().unwrap()
    }

    fn plug(&self, board_id: [u8; 12]) -> SimDevice {
        let (panel, volts) = panel_of(&self.table);
        let board = SimDevice::start_with_board_id(panel, volts, board_id).unwrap();
        self.lead_to(board.port_path());
        board
    }

    fn lead_to(&self, path: &str) {
        std::os::unix::fs::symlink(path, &self.link).unwrap();
    }

    fn unplug(&self, board: SimDevice) {
        std::fs::remove_file(&self.link).unwrap();
        drop(board);
    }
}

fn is_connected(state: &Value) -> bool {
    state["device"]["connected"] == true
}

#[test]
fn a_board_may_come_late_go_away_and_come_back() {
    let socket = Socket::new();
    let policy = SessionPolicy { arms_after_outage: true, ..SessionPolicy::default() };
    let daemon = Daemon::at(STARTING_PLATE, socket.path(), policy);
    let (status, _, problem) = daemon.post("/v1/touch", TOUCH);
    assert!(status == 502 && problem["detail"].as_str().unwrap().contains("not connected"), "{problem}");
    let board = socket.plug(SimBoard::ID);
    daemon.wait_for(is_connected);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    socket.unplug(board);
    daemon.wait_for(|state| !is_connected(state) && state["device"]["outages"] == 1);
    let board = socket.plug(SimBoard::ID);
    daemon.wait_for(is_connected);
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
    socket.unplug(board);
    daemon.wait_for(|state| !is_connected(state));
    // Another board has other limits, another calibration, and perhaps another panel.
    let other = socket.plug(*b"sim-board-02");
    let state = daemon.wait_for(|state| state["device"]["problem"].as_str().is_some_and(|p| p.contains("drives")));
    let [mine, others] = [SimBoard::ID, *b"sim-board-02"].map(era::device::DeviceIdentity::board_id_hex);
    let told = state["device"]["problem"].as_str().unwrap();
    assert!(told.contains(&mine) && told.contains(&others), "{told}");
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 502);
    socket.unplug(other);
    let _board = socket.plug(SimBoard::ID);
    daemon.wait_for(is_connected);
    assert!(daemon.get_text("/metrics").contains("era_device_outages_total 2"));
}

#[test]
fn after_an_outage_a_person_has_to_arm() {
    let socket = Socket::new();
    let daemon = Daemon::at(STARTING_PLATE, socket.path(), SessionPolicy::default());
    let board = socket.plug(SimBoard::ID);
    daemon.wait_for(is_connected);
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200, "nothing has happened yet");
    socket.unplug(board);
    daemon.wait_for(|state| !is_connected(state));
    let board = socket.plug(SimBoard::ID);
    let state = daemon.wait_for(is_connected);
    assert_eq!(state["device"]["waits_to_be_armed"], true);
    for body in [TOUCH, r#"{"x_px": 300, "y_px": 900, "effect": "click"}"#] {
        let (status, _, problem) = daemon.post("/v1/touch", body);
        assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:not-armed")), "{problem}");
        for way in ["`era arm`", "POST /v1/arm"] {
            assert!(problem["detail"].as_str().unwrap().contains(way), "{problem}");
        }
    }
    // Nor does a stop, or a fault that is cleared, arm it.
    for path in ["/v1/stop", "/v1/faults/clear"] {
        assert_eq!(daemon.post(path, "").0, 200);
        assert_eq!(daemon.post("/v1/touch", TOUCH).0, 409, "after {path}");
    }
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
    // A restart is an outage too.
    board.control().request_restart();
    daemon.wait_for(|state| state["device"]["waits_to_be_armed"] == true);
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 409);
}

/// The board goes off in any case; who clears it is a policy. Either way it is counted.
#[test]
fn a_silence_of_the_host_may_be_cleared_by_the_next_touch() {
    for (clears_silence, body) in [(false, LONG_TOUCH), (true, LONG_EFFECT)] {
        let daemon = Daemon::start_with(
            STARTING_PLATE,
            SessionPolicy { clears_silence, ..SessionPolicy::default() },
            Default::default(),
        );
        let begun = Instant::now();
        assert_eq!(daemon.post("/v1/touch", body).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
        std::thread::sleep(Duration::from_millis(600));
        daemon.sim.set_knobs(SimKnobs::default());
        // What the board does not drive any more is not shown either, although its time is not over.
        let state = daemon.wait_for(|state| state["device"]["state"] == "fault" && state["plan"].is_null());
        assert!(begun.elapsed() < OWN_END, "shown until its own end: {body}");
        assert_eq!((&state["device"]["fault"]["name"], &state["device"]["faults"]), (&json!("host-silent"), &json!(1)));
        let status = daemon.post("/v1/touch", TOUCH).0;
        assert_eq!(status, if clears_silence { 200 } else { 409 });
        let metrics = daemon.get_text("/metrics");
        let cleared = format!("era_device_silences_cleared_total {}", u8::from(clears_silence));
        assert!(metrics.contains(&cleared) && metrics.contains("era_device_faults_total 1"), "{metrics}");
    }
    // Any other fault waits for a person.
    let policy = SessionPolicy { clears_silence: true, ..SessionPolicy::default() };
    let daemon = Daemon::start_with(STARTING_PLATE, policy, Default::default());
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    let mut knobs = SimKnobs::default();
    knobs.defects.interlock_open = true;
    daemon.sim.set_knobs(knobs);
    daemon.wait_for(|state| state["device"]["state"] == "fault");
    daemon.sim.set_knobs(SimKnobs::default());
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 409);
}

#[test]
fn a_board_with_too_few_channels_is_not_driven() {
    let socket = Socket::new();
    let (panel, volts) = panel_of(&socket.table);
    let board = SimDevice::start(panel, volts[..1].to_vec()).unwrap();
    socket.lead_to(board.port_path());
    let daemon = Daemon::at(STARTING_PLATE, socket.path(), SessionPolicy::default());
    let state = daemon.wait_for(is_connected);
    assert!(state["device"]["mismatch"].as_str().unwrap().contains("2 actuators"), "{state}");
    let (status, _, problem) = daemon.post("/v1/touch", TOUCH);
    assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:device-unfit")), "{problem}");
    assert_eq!(daemon.post("/v1/arm", "").0, 409);
}

/// What an old board cannot do is refused, and everything else goes on.
#[test]
fn an_effect_does_not_end_the_link_to_an_old_board() {
    let socket = Socket::new();
    socket.lead_to(&old_board::behind_a_terminal(old_board::Board::speaking(1, 1)));
    let daemon = Daemon::at(STARTING_PLATE, socket.path(), SessionPolicy::default());
    daemon.wait_for(is_connected);
    let (status, _, problem) = daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "effect": "click"}"#);
    assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:device-refused")), "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("version"), "{problem}");
    let state = daemon.state();
    assert!(is_connected(&state) && state["device"]["outages"] == 0, "{state}");
}

/// A port whose device takes no bytes: nor does the port, or it keeps them.
struct Stuck {
    keeps: bool,
}

impl Write for Stuck {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        std::thread::sleep(Duration::from_millis(2));
        if self.keeps { Ok(bytes.len()) } else { Err(ErrorKind::TimedOut.into()) }
    }
    fn flush(&mut self) -> std::io::Result<()> {
        panic!("that is `tcdrain`, which would wait for ever");
    }
}

impl Read for Stuck {
    fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
        Err(ErrorKind::TimedOut.into())
    }
}

#[test]
fn a_board_that_takes_no_bytes_is_given_up() {
    let error = |keeps| {
        let mut client = Client::new(Box::new(Stuck { keeps }), Duration::from_millis(50));
        client.request(&Request::Status).unwrap_err()
    };
    let blocked = error(false);
    assert!(
        matches!(blocked, LinkError::Blocked { .. }) && blocked.to_string().contains("accepted no bytes"),
        "{blocked}"
    );
    assert!(matches!(error(true), LinkError::Silent { .. }));
}

#[test]
fn a_path_without_a_port_is_reported_with_its_name() {
    let missing = Path::new("/nonexistent/era-board");
    let daemon = Daemon::at(STARTING_PLATE, missing.to_str().unwrap(), SessionPolicy::default());
    let state = daemon.wait_for(|state| state["device"]["problem"].is_string());
    assert!(!is_connected(&state) && state["device"]["port"] == "/nonexistent/era-board", "{state}");
}

//! Signals: whatever ends the daemon, the board is stopped first.

use crate::serving::Serving;
use crate::{LONG_TOUCH, board, drive};

/// Every signal that would end a process and can be listened for. The board has heard a stop, and has not gone off by the silence alone.
#[test]
fn every_signal_that_ends_the_daemon_stops_the_board() {
    let board = board();
    for signal in
        ["HUP", "INT", "QUIT", "TERM", "USR1", "USR2", "ALRM", "VTALRM", "PROF", "XCPU", "IO", "PWR", "STKFLT"]
    {
        let serving = Serving::start(&board, &["--after-outage", "touch"]);
        drive(&serving.daemon);
        let before = board.control().stop_received();
        let log = serving.end_by(signal);
        assert_ne!(board.control().stop_received(), before, "{signal}: no stop was heard");
        assert!(!board.control().watch().energised, "{signal}");
        let name = format!("SIG{signal}");
        assert!(log.iter().any(|line| line.to_string().contains(&name)), "{signal}: {log:?}");
    }
}

/// Signals that end nothing, for a daemon too; one that was started to outlive its terminal (as `nohup` does) does.
#[test]
fn signals_that_end_nothing_do_not() {
    let board = board();
    let serving = Serving::start_under(&["sh", "-c", "trap '' HUP; exec \"$@\"", "sh"], &board, &[]);
    for signal in ["HUP", "PIPE", "WINCH", "CHLD", "URG", "CONT", "XFSZ"] {
        serving.signal(signal);
    }
    drive(&serving.daemon);
    serving.signal("HUP");
    serving.signal("PIPE");
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(serving.daemon.state()["device"]["state"], "running");
    let before = board.control().stop_received();
    serving.end();
    assert_ne!(board.control().stop_received(), before);
}

/// The command that has a daemon drive what was recorded: what it has begun is not driven on.
#[test]
fn a_replay_that_is_ended_stops_what_it_has_begun() {
    let board = board();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    let recording = Serving::start(&board, &["--record", file.to_str().unwrap()]);
    crate::wait_until("a touch", || recording.daemon.post("/v1/touch", LONG_TOUCH).0 == 200);
    assert_eq!(recording.daemon.post("/v1/stop", "").0, 200);
    recording.end();
    // The stop comes long after the touch.
    let text = std::fs::read_to_string(&file).unwrap();
    let later = text.lines().map(|line| {
        let mut line: serde_json::Value = serde_json::from_str(line).unwrap();
        if line["kind"].as_str().unwrap().contains("stop") {
            line["at_ms"] = 60_000.into();
        }
        line.to_string() + "\n"
    });
    std::fs::write(&file, later.collect::<String>()).unwrap();
    let serving = Serving::start(&board, &[]);
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_era"));
        command.args(["replay", file.to_str().unwrap(), "--url", &serving.daemon.url]);
        let mut replay = command.spawn().unwrap();
        serving.daemon.wait_for(|state| state["device"]["state"] == "running");
        let before = board.control().stop_received();
        let id = replay.id().to_string();
        assert!(std::process::Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        assert_eq!(replay.wait().unwrap().code(), Some(1), "{signal}");
        assert_ne!(board.control().stop_received(), before, "{signal}");
    }
    serving.end();
}

//! Signals: whatever ends the daemon, the board is stopped first.

use crate::serving::Serving;
use crate::support::program::{ERA, build_era_command, build_isolated_command};
use crate::{LONG_TOUCH, drive, start_still_simulated_device, touches_are_driven, wait_until};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

/// Starts a program with the signals that end one: whoever runs the tests may have been told to outlive its terminal, which is inherited.
const BY: [&str; 2] = ["env", "--default-signal=HUP,INT,QUIT"];

/// Every signal that would end a process and can be listened for. The board has heard a stop, and has not gone off by the silence alone.
#[test]
fn every_signal_that_ends_the_daemon_stops_the_board() {
    let board = start_still_simulated_device();
    for signal in [
        "HUP", "INT", "QUIT", "TRAP", "ABRT", "TERM", "USR1", "USR2", "ALRM", "VTALRM", "PROF", "XCPU", "IO", "PWR",
        "STKFLT", "SYS", "40",
    ] {
        let serving = Serving::start_under(&BY, &board, &["--after-outage", "touch"]);
        drive(&serving.daemon);
        let before = board.control().last_stop_received_at();
        let log = serving.end_by(signal);
        assert_ne!(board.control().last_stop_received_at(), before, "{signal}: no stop was heard");
        assert!(!board.control().observations_since_start().energised, "{signal}");
        // A real-time signal has a number alone.
        let name = if signal == "40" { "signal 40".into() } else { format!("SIG{signal}") };
        assert!(log.iter().any(|line| line.to_string().contains(&name)), "{signal}: {log:?}");
    }
}

/// Ctrl-Z: the board has heard a stop when the process is suspended, and may be driven again when it goes on.
#[test]
fn a_daemon_that_is_suspended_stops_the_board_first() {
    let board = start_still_simulated_device();
    let serving = Serving::start(&board, &["--after-outage", "touch"]);
    drive(&serving.daemon);
    let before = board.control().last_stop_received_at();
    serving.signal("TSTP");
    wait_until("it is suspended", || serving.is_suspended());
    assert_ne!(board.control().last_stop_received_at(), before, "no stop was heard");
    wait_until("the board is off", || !board.control().observations_since_start().energised);
    serving.signal("CONT");
    touches_are_driven(&serving.daemon);
    serving.end();
}

/// Signals that end nothing, for a daemon too; one that was started to outlive its terminal (as `nohup` does) does.
#[test]
fn signals_that_end_nothing_do_not() {
    let board = start_still_simulated_device();
    let serving = Serving::start_under(&["sh", "-c", "trap '' HUP; exec \"$@\"", "sh"], &board, &[]);
    for signal in ["HUP", "PIPE", "WINCH", "CHLD", "URG", "CONT", "XFSZ", "TTOU", "TTIN"] {
        serving.signal(signal);
    }
    drive(&serving.daemon);
    serving.signal("HUP");
    serving.signal("PIPE");
    // A terminal that does not let what runs in the background write (`stty tostop`) or read.
    serving.signal("TTOU");
    serving.signal("TTIN");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(serving.daemon.state()["device"]["state"], "running");
    let before = board.control().last_stop_received_at();
    serving.end();
    assert_ne!(board.control().last_stop_received_at(), before);
}

/// The command that has a daemon drive what was recorded: what it has begun is not driven on.
#[test]
fn a_replay_that_is_ended_stops_what_it_has_begun() {
    let board = start_still_simulated_device();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    let recording = Serving::start(&board, &["--record", file.to_str().unwrap()]);
    wait_until("a touch", || recording.daemon.post("/v1/touch", LONG_TOUCH).0 == 200);
    assert_eq!(recording.daemon.post("/v1/stop", "").0, 200);
    recording.end();
    // The stop comes long after the touch.
    let text = std::fs::read_to_string(&file).unwrap();
    let later = text.lines().map(|line| {
        let mut line: Value = serde_json::from_str(line).unwrap();
        if line["kind"].as_str().unwrap().contains("stop") {
            line["at_ms"] = 60_000.into();
        }
        line.to_string() + "\n"
    });
    std::fs::write(&file, later.collect::<String>()).unwrap();
    let serving = Serving::start(&board, &[]);
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        let mut command = build_isolated_command(BY[0]);
        command.args([BY[1], ERA, "replay", file.to_str().unwrap(), "--url", &serving.daemon.url]);
        let mut replay = command.spawn().unwrap();
        serving.daemon.wait_for(|state| state["device"]["state"] == "running");
        let before = board.control().last_stop_received_at();
        let id = replay.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        assert_eq!(replay.wait().unwrap().code(), Some(1), "{signal}");
        assert_ne!(board.control().last_stop_received_at(), before, "{signal}");
    }
    serving.end();
}

/// A daemon that is slow to answer the stop: what was recorded after that is not asked for any more, as it would be driven after the stop.
#[test]
fn a_replay_that_is_ended_asks_for_nothing_after_its_stop() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    // A touch every 20 ms for a minute.
    let mut text = json!({"at_ms": 0, "kind": "begin", "format": 1, "scene": "desk"}).to_string();
    for id in 1..3000 {
        let body = json!({"x_px": 300, "y_px": 900});
        text += &format!("\n{}", json!({"at_ms": id * 20, "kind": "touch", "id": id, "body": body}));
    }
    std::fs::write(&file, text + "\n").unwrap();

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let (told, asked) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let told = told.clone();
            std::thread::spawn(move || answer_slowly(stream, &told));
        }
    });
    let mut command = build_era_command();
    let mut replay = command.args(["replay", file.to_str().unwrap(), "--url", &url]).spawn().unwrap();
    let next = || asked.recv_timeout(crate::LIMIT).unwrap();
    // By then it listens for signals.
    for _ in 0..20 {
        while next() != "/v1/touch" {}
    }
    assert!(Command::new("kill").arg(replay.id().to_string()).status().unwrap().success());
    while next() != "/v1/stop" {}
    assert_eq!(replay.wait().unwrap().code(), Some(1));
    // One may have been on its way.
    let later: Vec<String> = asked.try_iter().collect();
    assert!(later.len() < 10, "{later:?}");
}

/// Answers a request as a daemon, a stop after 1 s, and tells its path.
fn answer_slowly(stream: TcpStream, told: &Sender<String>) {
    let mut reader = BufReader::new(&stream);
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        if reader.read_line(&mut head).unwrap_or(0) == 0 {
            return;
        }
    }
    let path = head.split_whitespace().nth(1).unwrap_or_default().to_owned();
    let is_stop = path == "/v1/stop";
    let _ = told.send(path);
    if is_stop {
        std::thread::sleep(Duration::from_secs(1));
    }
    let answer =
        "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 2\r\nConnection: close\r\n\r\n{}";
    let _ = (&stream).write_all(answer.as_bytes());
}

//! A recording holds whole records from its beginning on, wherever its writing was cut off.

use crate::build_limited_command;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// The lines of a daemon's log, up to one with these words; `None` if it ended before.
fn find_line(log: &Receiver<String>, words: &str) -> Option<String> {
    loop {
        // A hang, and nothing that is measured.
        match log.recv_timeout(Duration::from_secs(120)) {
            Ok(line) if line.contains(words) => return Some(line),
            Ok(_) => {}
            Err(std::sync::mpsc::RecvTimeoutError::Timeout) => panic!("no word of {words:?}"),
            Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => return None,
        }
    }
}

/// Starts a daemon in a folder, which records to `day.jsonl` there and serves `era.sock`, and may write files of so many bytes; and its log.
fn start_recording(folder: &Path, most_bytes: u64) -> (Child, Receiver<String>) {
    let mut daemon = build_limited_command(Some(most_bytes))
        .args(["serve", "--accuracy", "fast", "--listen", "127.0.0.1:0", "--socket", "era.sock"])
        .args(["--record", "day.jsonl"])
        .current_dir(folder)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(daemon.stderr.take().unwrap()).lines().map_while(Result::ok);
    let (put, log) = channel();
    std::thread::spawn(move || lines.for_each(|line| put.send(line).unwrap_or_default()));
    (daemon, log)
}

/// Posts a stop; the status line of the answer.
fn post_stop(socket: &Path) -> String {
    let mut stream = UnixStream::connect(socket).unwrap();
    let head = b"POST /v1/stop HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";
    stream.write_all(head).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.lines().next().unwrap_or_default().to_owned()
}

/// Room is made after a first start that had none: the second one records.
#[test]
fn a_start_without_disk_space_does_not_keep_later_ones_from_recording() {
    let folder = tempfile::tempdir().unwrap();
    for limit in [0, 1 << 20] {
        let (mut daemon, log) = start_recording(folder.path(), limit);
        let wanted = if limit == 0 { "File too large" } else { "ready after" };
        let said = find_line(&log, wanted).unwrap_or_else(|| panic!("{limit}: no {wanted:?}"));
        assert!(!said.contains("Name a new file"), "{said}");
        daemon.kill().unwrap();
        daemon.wait().unwrap();
    }
    assert!(fs::read_to_string(folder.path().join("day.jsonl")).unwrap().contains("begin"));
}

/// With room for half of its first line, and for a few lines and a part of one: the end is told, the daemon answers on, and what was recorded can be read.
#[test]
fn a_recording_without_disk_space_ends_with_a_whole_line() {
    for limit in [0, 1, 50, 1000, 2001] {
        let folder = tempfile::tempdir().unwrap();
        let (socket, recording) = (folder.path().join("era.sock"), folder.path().join("day.jsonl"));
        let (mut daemon, log) = start_recording(folder.path(), limit);
        if limit < 100 {
            // Not even the first line fits: whether the daemon starts at all, it says so.
            assert!(find_line(&log, "File too large").is_some(), "{limit}");
        } else {
            assert!(find_line(&log, "ready after").is_some(), "{limit}");
            (0..60).for_each(|_| drop(post_stop(&socket)));
            let said = find_line(&log, "the recording ends because of an error");
            assert!(said.is_some_and(|line| line.contains("File too large")), "{limit}");
            assert!(post_stop(&socket).starts_with("HTTP/1.1 "), "{limit}: the daemon goes on");
        }
        daemon.kill().unwrap();
        daemon.wait().unwrap();
        let text = fs::read_to_string(&recording).unwrap_or_default();
        assert!(text.len() as u64 <= limit && (text.is_empty() || text.ends_with('\n')), "{limit}: {text:?}");
        let kinds: Vec<String> = text
            .lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap_or_else(|error| panic!("{limit}: {error}: {line}")))
            .map(|line| line["kind"].as_str().unwrap().to_owned())
            .collect();
        assert_eq!(kinds.len() > 3, limit > 100, "{limit}: {kinds:?}");
        // One stop after the other, none left out.
        let begun = kinds.iter().position(|kind| kind == "begin");
        assert!(begun.is_none_or(|at| at == 0), "{limit}: {kinds:?}");
        let (stops, stopped): (Vec<usize>, Vec<usize>) =
            (0..kinds.len()).filter(|at| kinds[*at].starts_with("stop")).partition(|at| kinds[*at] == "stop");
        assert!(stops.len() == stopped.len() || stops.len() == stopped.len() + 1, "{limit}: {kinds:?}");
    }
}

//! `era serve` as a process of its own, beside a board of the test's.

use crate::support::Daemon;
use crate::support::program::{ERA, build_isolated_command};
use era::device::sim::{SimControl, SimDevice};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

/// `era serve` as a process of its own, which ends with the test.
#[allow(dead_code, reason = "two test programs (`daily` and `system`) use a part of this each")]
pub struct Serving {
    process: Child,
    pub daemon: Daemon,
    log: Option<JoinHandle<Vec<Value>>>,
}

#[allow(dead_code, reason = "two test programs (`daily` and `system`) call a part of these each")]
impl Serving {
    pub fn start(board: &SimDevice, more: &[&str]) -> Self {
        Self::start_under(&[], board, more)
    }

    /// The same by way of another program, which replaces itself by this one.
    pub fn start_under(by: &[&str], board: &SimDevice, more: &[&str]) -> Self {
        Self::start_at(by, board.port_path(), board.control(), more)
    }

    /// The same with a board at a path of any kind.
    pub fn start_at(by: &[&str], path: &str, board: SimControl, more: &[&str]) -> Self {
        let words: Vec<&str> = by.iter().copied().chain([ERA]).collect();
        let mut command = build_isolated_command(words[0]);
        command.args(&words[1..]);
        command.args(["--log-format", "json", "serve", "--listen", "127.0.0.1:0", "--socket", "none"]);
        command.args(["--accuracy", "fast", "--device", path]).args(more);
        let mut process = command.stderr(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let mut lines = lines.map(|line| serde_json::from_str::<Value>(&line).unwrap());
        let open =
            |line: Value| line["message"].as_str()?.split_once("open ")?.1.split_whitespace().next().map(str::to_owned);
        let url = lines.find_map(open).expect("it says where it serves");
        let log = Some(std::thread::spawn(move || lines.collect()));
        let daemon = Daemon { url, sim: board, background: None };
        daemon.wait_for(|state| state["device"]["connected"] == true);
        Self { process, daemon, log }
    }

    pub fn signal(&self, name: &str) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &id]).status().unwrap().success());
    }

    /// Whether it has a file open.
    pub fn has_open(&self, path: &str) -> bool {
        let files = std::fs::read_dir(format!("/proc/{}/fd", self.process.id())).unwrap();
        files.flatten().any(|file| std::fs::read_link(file.path()).is_ok_and(|open| open.to_str() == Some(path)))
    }

    /// Whether it is suspended.
    pub fn is_suspended(&self) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.process.id())).unwrap();
        stat.rsplit(')').next().unwrap().trim_start().starts_with('T')
    }

    /// How the system schedules a thread of it: 0 as any other, 2 in turn with others of its real-time priority (SCHED_RR).
    #[cfg(target_os = "linux")]
    pub fn policy_of(&self, thread: &str) -> u32 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.process.id())).unwrap();
        let read = |task: &std::path::Path, file: &str| std::fs::read_to_string(task.join(file)).unwrap_or_default();
        let mut tasks = tasks.map(|task| task.unwrap().path());
        let task = tasks.find(|task| read(task, "comm").trim() == thread).expect("such a thread");
        // Field 41 of proc(5); the second is a name in brackets.
        let stat = read(&task, "stat");
        stat.rsplit(')').next().unwrap().split_whitespace().nth(41 - 3).unwrap().parse().unwrap()
    }

    /// Ends it; all that it has logged since it was ready.
    pub fn end(self) -> Vec<Value> {
        self.end_by("TERM")
    }

    /// The same by another signal.
    pub fn end_by(mut self, signal: &str) -> Vec<Value> {
        self.signal(signal);
        assert!(self.process.wait().unwrap().success());
        self.log.take().unwrap().join().unwrap()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

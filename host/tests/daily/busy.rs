//! A busy host: the daemon's process does not run for a while, as where something else has the processor.

use crate::support::{Daemon, panel_of, table};
use era::device::sim::SimDevice;
use era::scene::EXAMPLE_PLATE;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#;
const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;

/// `era serve` as a process of its own, which ends with the test.
struct Serving {
    process: Child,
    daemon: Daemon,
    log: Option<JoinHandle<Vec<Value>>>,
}

impl Serving {
    fn start(board: &SimDevice, more: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_era"));
        command.args(["--log-format", "json", "serve", "--listen", "127.0.0.1:0", "--socket", "none"]);
        command.args(["--accuracy", "fast", "--device", board.path()]).args(more);
        command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR")).env_remove("ERA_LOG").stderr(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let lines = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let mut lines = lines.map(|line| serde_json::from_str::<Value>(&line).unwrap());
        let open =
            |line: Value| line["message"].as_str()?.split_once("open ")?.1.split_whitespace().next().map(str::to_owned);
        let url = lines.find_map(open).expect("it says where it serves");
        let log = Some(std::thread::spawn(move || lines.collect()));
        let daemon = Daemon { url, sim: board.control(), background: None };
        daemon.wait_for(|state| state["device"]["connected"] == true);
        Self { process, daemon, log }
    }

    fn signal(&self, name: &str) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args(["-s", name, &id]).status().unwrap().success());
    }

    /// How the system schedules a thread of it: 0 as any other, 2 in turn with others of its real-time priority (SCHED_RR).
    #[cfg(target_os = "linux")]
    fn policy_of(&self, thread: &str) -> u32 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.process.id())).unwrap();
        let read = |task: &std::path::Path, file: &str| std::fs::read_to_string(task.join(file)).unwrap_or_default();
        let mut tasks = tasks.map(|task| task.unwrap().path());
        let task = tasks.find(|task| read(task, "comm").trim() == thread).expect("such a thread");
        // Field 41 of proc(5); the second is a name in brackets.
        let stat = read(&task, "stat");
        stat.rsplit(')').next().unwrap().split_whitespace().nth(41 - 3).unwrap().parse().unwrap()
    }

    /// Ends it; all that it has logged since it was ready.
    fn end(mut self) -> Vec<Value> {
        self.signal("TERM");
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

/// For as long as the board takes to give its host up, and goes off. What has happened is told and logged, with its reason; then a person clears it,
/// or the next touch where that is the policy, and everything goes on.
#[test]
fn a_host_that_was_busy_tells_why_and_goes_on() {
    let (panel, volts) = panel_of(&table(EXAMPLE_PLATE));
    let board = SimDevice::start(panel, volts).unwrap();
    for (more, is_cleared) in [(&[][..], false), (&["--clear-silence"][..], true)] {
        let serving = Serving::start(&board, more);
        let daemon = &serving.daemon;
        assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        serving.signal("STOP");
        let deadline = Instant::now() + Duration::from_secs(30);
        while board.control().watch().energised {
            assert!(Instant::now() < deadline, "the board is still live");
            std::thread::sleep(Duration::from_millis(5));
        }
        serving.signal("CONT");
        let state = daemon.wait_for(|state| !state["device"]["fault"].is_null());
        let device = &state["device"];
        let told = (&device["fault"]["name"], &device["state"], &device["faults"]);
        assert_eq!(told, (&json!("host-silent"), &json!("fault"), &json!(1)), "{device}");
        let (status, _, answer) = daemon.post("/v1/touch", TOUCH);
        if is_cleared {
            assert_eq!(status, 200, "{answer}");
        } else {
            assert_eq!((status, &answer["type"]), (409, &json!("urn:era:problem:device-fault")), "{answer}");
            for piece in ["host-silent", "fell silent", "Check the cable", "`era clear`, or POST /v1/faults/clear"] {
                assert!(answer["detail"].as_str().unwrap().contains(piece), "{piece}: {answer}");
            }
            assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
            assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
        }
        let metrics = daemon.get_text("/metrics");
        let cleared = format!("era_device_silences_cleared_total {}", u8::from(is_cleared));
        assert!(metrics.contains(&cleared) && metrics.contains("era_device_faults_total 1"), "{metrics}");
        let log = serving.end();
        let latched: Vec<_> = log.iter().filter(|line| line["name"] == "host-silent").collect();
        let [latched] = latched[..] else { panic!("{log:?}") };
        let said = latched["message"].as_str().unwrap();
        assert!(latched["level"] == "ERROR" && said.contains("has latched a fault: The host"), "{latched}");
        assert!(latched["keep_alive_age_ms"].is_f64() && latched["longest_gap_ms"].is_f64(), "{latched}");
        let of_policy = log.iter().any(|line| line["message"].as_str().unwrap().contains("as is the policy"));
        assert_eq!(of_policy, is_cleared, "{log:?}");
    }
}

/// The session's thread goes before everything that has no real-time priority, where the system allows that: whether it does is asked of `chrt`.
#[cfg(target_os = "linux")]
#[test]
fn the_sessions_thread_is_preferred_where_that_is_allowed() {
    let (panel, volts) = panel_of(&table(EXAMPLE_PLATE));
    let board = SimDevice::start(panel, volts).unwrap();
    let serving = Serving::start(&board, &[]);
    let allowed = Command::new("chrt").args(["--rr", "1", "true"]).stderr(Stdio::null()).status();
    let wanted = if allowed.is_ok_and(|status| status.success()) { 2 } else { 0 };
    assert_eq!(serving.policy_of("device-session"), wanted);
}

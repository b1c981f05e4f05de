//! Standard streams and terminals that are closed, gone or stuck while the daemon drives.

use crate::support::Daemon;
use crate::support::program::{ERA, build_isolated_command};
use crate::{drive, start_still_simulated_device, wait_until};
use era::device::sim::SimDevice;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

struct Running {
    process: Child,
    daemon: Daemon,
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Running {
    /// `era serve` as this command line of the shell runs it (`$era` is the command), once it serves at a port of the test's.
    fn start(board: &SimDevice, script: &str, streams: impl FnOnce(&mut Command)) -> Self {
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let era = format!(
            "{ERA} -v serve --listen {free} --socket none --accuracy fast --after-outage touch --device {}",
            board.port_path()
        );
        let mut command = build_isolated_command("sh");
        command.args(["-c", &script.replace("$era", &era)]);
        streams(&mut command);
        let process = command.spawn().unwrap();
        let daemon = Daemon { url: format!("http://{free}"), sim: board.control(), background: None };
        let agent = Daemon::agent();
        wait_until("the daemon serves, with its board", || {
            agent.get(format!("{}/v1/state", daemon.url)).call().is_ok_and(|mut answer| {
                answer.body_mut().read_json::<serde_json::Value>().unwrap()["device"]["connected"] == true
            })
        });
        Self { process, daemon }
    }

    fn drives(&self) {
        drive(&self.daemon);
    }

    /// Ends it as a service manager does; the board has heard a stop, and the process has ended as one that was asked to.
    fn stop_and_check(mut self, board: &SimDevice) {
        let before = board.control().last_stop_received_at();
        assert!(Command::new("kill").arg(self.process.id().to_string()).status().unwrap().success());
        let begun = Instant::now();
        let status = self.process.wait().unwrap();
        assert!(status.success() && begun.elapsed() < Duration::from_secs(10), "{status} {:?}", begun.elapsed());
        assert_ne!(board.control().last_stop_received_at(), before);
    }
}

/// Closed before it starts: what it opens then is not taken for one of them.
#[test]
fn a_daemon_without_streams_serves_and_stops() {
    let board = start_still_simulated_device();
    for script in ["exec $era <&- >&- 2>&-", "exec $era 2>&-", "exec $era >/dev/full 2>/dev/full"] {
        let running = Running::start(&board, script, |_| {});
        running.drives();
        running.stop_and_check(&board);
    }
}

/// Whoever read its log has gone while it drives (EPIPE).
#[test]
fn a_log_that_nobody_reads_any_more_ends_nothing() {
    let board = start_still_simulated_device();
    let mut running = Running::start(&board, "exec $era 2>&1", |command| {
        command.stdout(Stdio::piped());
    });
    running.drives();
    drop(running.process.stdout.take());
    assert_eq!(running.daemon.post("/v1/stop", "").0, 200);
    running.drives();
    running.stop_and_check(&board);
}

/// Whoever reads its log reads no more of it, as a pager that waits, or a terminal that was stopped with Ctrl-S: the pipe is full.
#[test]
fn a_log_that_is_stuck_holds_nothing_up() {
    let board = start_still_simulated_device();
    // A pipe holds 64 kB.
    let script = "head -c 65536 /dev/zero; exec $era 2>&1";
    let mut running = Running::start(&board, script, |command| {
        command.stdout(Stdio::piped());
    });
    let stuck = running.process.stdout.take();
    running.drives();
    // Restarts, refusals and faults are logged, by the thread that keeps the board alive.
    running.daemon.sim.request_restart();
    wait_until("the restart of a live board is a fault", || !running.daemon.state()["device"]["fault"].is_null());
    assert_eq!(running.daemon.post("/v1/stop", "").0, 200);
    assert_eq!(running.daemon.post("/v1/faults/clear", "").0, 200);
    running.drives();
    let begun = Instant::now();
    assert_eq!(running.daemon.post("/v1/stop", "").0, 200);
    assert!(begun.elapsed() < Duration::from_secs(4), "{:?}", begun.elapsed());
    running.drives();
    running.stop_and_check(&board);
    drop(stuck);
}

/// Its terminal is closed (SIGHUP, then EIO for whatever it says): it stops the board and ends.
#[test]
fn a_closed_terminal_stops_the_board() {
    let board = start_still_simulated_device();
    // A session with a terminal of its own, which goes when this program ends.
    let terminal = "import os, pty, signal, sys\n\
                    signal.signal(signal.SIGHUP, signal.SIG_DFL)\n\
                    pid, master = pty.fork()\n\
                    if pid == 0:\n    os.execvp(sys.argv[1], sys.argv[1:])\n\
                    print(pid, flush=True)\n\
                    import threading\n\
                    def drain():\n    \
                        try:\n        \
                            while os.read(master, 4096): pass\n    \
                        except OSError: pass\n\
                    threading.Thread(target=drain, daemon=True).start()\n\
                    sys.stdin.read()\n\
                    os._exit(0)\n";
    let mut running = Running::start(&board, "exec python3 -c \"$TERMINAL\" $era", |command| {
        command.env("TERMINAL", terminal).stdin(Stdio::piped()).stdout(Stdio::piped());
    });
    let mut line = String::new();
    let out = running.process.stdout.as_mut().unwrap();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(out), &mut line).unwrap();
    let pid = line.trim().to_owned();
    running.drives();
    let before = board.control().last_stop_received_at();
    drop(running.process.stdin.take());
    wait_until("the daemon has ended", || {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.is_empty() || stat.rsplit(')').next().unwrap().trim_start().starts_with('Z')
    });
    assert_ne!(board.control().last_stop_received_at(), before, "no stop was heard");
    assert!(!board.control().observations_since_start().energised);
}

//! `era serve` as a process of its own: started, stopped for a while, killed, and what it takes of the machine.

use crate::board::PANEL_SCENE;
use crate::error::Error;
use crate::http::{Endpoint, Http};
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Longest time from its start until it serves: a model of the starting plate takes a second or two.
const START: Duration = Duration::from_secs(60);
/// Lines of its log that are kept for people.
const KEPT_LINES: usize = 40;

/// How a daemon is started.
#[derive(Clone, Debug)]
pub struct DaemonSetup {
    /// The program.
    pub program: PathBuf,
    /// The serial port, or a link to it.
    pub device: PathBuf,
    /// Its socket in the file system.
    pub socket: PathBuf,
    /// Where it keeps its tables.
    pub cache: PathBuf,
    /// Whether the next touch clears a silence that the board has latched: where such are made on purpose.
    pub clears_silence: bool,
}

/// A running daemon; it is killed when this is dropped.
#[derive(Debug)]
pub struct Daemon {
    child: Child,
    /// Where it listens.
    pub address: SocketAddr,
    log: Arc<Mutex<Vec<String>>>,
}

/// What a process takes.
#[derive(Clone, Copy, Debug, Default)]
pub struct MemoryThreadsAndHandles {
    /// Resident memory in kB.
    pub memory_kb: u64,
    /// Threads.
    pub threads: u64,
    /// Open file handles.
    pub handles: u64,
}

impl Daemon {
    /// Starts it and waits until it serves.
    ///
    /// # Errors
    /// [`Error::System`], [`Error::NoDaemon`].
    pub fn start(setup: &DaemonSetup) -> Result<Self, Error> {
        let scene = setup.socket.with_file_name("scene.toml");
        std::fs::write(&scene, PANEL_SCENE)
            .map_err(Error::system_error(format!("cannot write {}", scene.display())))?;
        let mut command = Command::new(&setup.program);
        command.args(["serve", "--listen", "127.0.0.1:0", "--accuracy", "fast"]).arg("--scene").arg(&scene);
        if setup.clears_silence {
            command.arg("--clear-silence");
        }
        // There is no person: the next touch arms a board that was away.
        command.args(["--after-outage", "touch"]);
        command.arg("--device").arg(&setup.device).arg("--socket").arg(&setup.socket);
        command.env("ERA_CACHE_DIR", &setup.cache).env("ERA_LOG", "warn,era=info").env("NO_COLOR", "1");
        let shown = format!("{command:?}");
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(Error::system_error(format!("cannot run {}", setup.program.display())))?;
        let log = Arc::new(Mutex::new(Vec::new()));
        let (found, address) = mpsc::channel();
        if let Some(stderr) = child.stderr.take() {
            let log = Arc::clone(&log);
            std::thread::spawn(move || {
                for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                    if let Some(address) = parse_address_if_ready_log_line(&line) {
                        let _ = found.send(address);
                    }
                    let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
                    if log.len() == KEPT_LINES {
                        log.remove(0);
                    }
                    log.push(line);
                }
            });
        }
        match address.recv_timeout(START) {
            Ok(address) => Ok(Self { child, address, log }),
            Err(_) => {
                let _ = child.kill();
                let _ = child.wait();
                let said = log.lock().unwrap_or_else(PoisonError::into_inner).join("\n");
                Err(Error::NoDaemon { command: shown, said })
            }
        }
    }

    /// Its process.
    #[must_use]
    pub fn process_id(&self) -> u32 {
        self.child.id()
    }

    /// Whether it has ended by itself.
    pub fn has_ended(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// The end of its log.
    #[must_use]
    pub fn recent_log(&self) -> String {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).join("\n")
    }

    /// Ends it without warning.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Keeps it from running, or lets it run on.
    ///
    /// # Errors
    /// [`Error::System`].
    pub fn set_paused(&self, is_paused: bool) -> Result<(), Error> {
        let signal = if is_paused { "-STOP" } else { "-CONT" };
        let status = Command::new("kill").args([signal, &self.process_id().to_string()]).status();
        let failed = "cannot send a signal to the daemon";
        match status.map_err(Error::system_error(failed))?.success() {
            true => Ok(()),
            false => Err(Error::Answer(failed.into())),
        }
    }

    /// How long processors have worked for it so far, in s; `None` where the system does not tell.
    #[must_use]
    pub fn processor_time_s(&self) -> Option<f64> {
        parse_processor_time_s(&std::fs::read_to_string(format!("/proc/{}/stat", self.process_id())).ok()?)
    }

    /// What it takes now.
    #[must_use]
    pub fn read_memory_threads_and_handles_or_zeros(&self) -> MemoryThreadsAndHandles {
        read_process_memory_threads_and_handles_or_zeros(self.process_id())
    }

    /// Waits until it has its device.
    ///
    /// # Errors
    /// [`Error::Answer`].
    pub fn await_device(&self) -> Result<(), Error> {
        let (mut http, begun) = (Http::new(Endpoint::Tcp(self.address)), Instant::now());
        while begun.elapsed() < START {
            if http.get("/v1/state").is_ok_and(|answer| answer.parse_json_body_or_null()["device"]["connected"] == true)
            {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Err(Error::Answer(format!("the daemon finds no device; its log:\n{}", self.recent_log())))
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The address in the line of the log that says that it serves.
fn parse_address_if_ready_log_line(line: &str) -> Option<SocketAddr> {
    let (_, rest) = line.split_once("ready after ")?;
    let (_, rest) = rest.split_once("http://")?;
    rest.split([',', ' ']).next()?.parse().ok()
}

fn read_process_memory_threads_and_handles_or_zeros(process_id: u32) -> MemoryThreadsAndHandles {
    let status = std::fs::read_to_string(format!("/proc/{process_id}/status")).unwrap_or_default();
    let number = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.and_then(|rest| rest.split_whitespace().next()).and_then(|word| word.parse().ok()).unwrap_or(0)
    };
    let handles = std::fs::read_dir(Path::new(&format!("/proc/{process_id}/fd"))).map_or(0, Iterator::count);
    MemoryThreadsAndHandles { memory_kb: number("VmRSS:"), threads: number("Threads:"), handles: handles as u64 }
}

/// Ticks of `/proc` in a second: USER_HZ, 100 wherever Linux runs.
const TICKS_PER_S: f64 = 100.0;

/// Time in s in user and in kernel mode, fields 14 and 15 of proc_pid_stat(5); the second, a name in brackets, may have blanks in it.
fn parse_processor_time_s(stat: &str) -> Option<f64> {
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_S)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn what_a_process_takes_is_read() {
        // A shell inherits what its parent left open; the second one opens three files besides. Its line is printed when they are open.
        let [plain, found] =
            ["echo; read line", "exec 7</dev/null 8</dev/null 9</dev/null; echo; read line"].map(|script| {
                let mut shell = Command::new("sh");
                shell.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
                let mut shell = shell.spawn().unwrap();
                shell.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
                let found = read_process_memory_threads_and_handles_or_zeros(shell.id());
                shell.kill().unwrap();
                shell.wait().unwrap();
                found
            });
        assert_eq!((found.threads, found.handles), (1, plain.handles + 3));
        assert!((100..100_000).contains(&found.memory_kb), "{found:?}");
        let own = read_process_memory_threads_and_handles_or_zeros(std::process::id());
        assert!(own.threads > 1 && own.memory_kb > found.memory_kb, "{own:?}");
    }

    #[test]
    fn the_time_of_processors_is_read_whatever_the_name_is() {
        let stat = "71 (a ) b) S 1 2 3 4 5 6 7 8 9 10 250 50 0 0 20 0 9";
        assert_eq!(parse_processor_time_s(stat), Some(3.0));
        assert_eq!(parse_processor_time_s("71 (era) S 1"), None);
    }

    #[test]
    fn the_address_is_read_from_the_log() {
        let line =
            "INFO era::cli::serve: ready after 0.1 s: open http://127.0.0.1:4711, unix:/tmp/a (scene x, device sim)";
        assert_eq!(parse_address_if_ready_log_line(line), "127.0.0.1:4711".parse().ok());
        assert_eq!(parse_address_if_ready_log_line("open http://127.0.0.1:4711"), None);
    }
}

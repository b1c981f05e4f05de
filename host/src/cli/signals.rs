//! Signals that would end the program: a daemon stops its board first, whichever comes.

use nix::sys::signal::SigSet;
use rustix::process::{Signal, getpid, kill_process};
use std::task::Poll;
use tokio::signal::unix::{Signal as Stream, SignalKind, signal};

/// Those with a name that end a process which does not listen, and that can be listened for. SIGPIPE is ignored by every program in Rust; SIGSEGV
/// and its like are mistakes, after which nothing here can be relied on; SIGKILL cannot be heard: after these the board goes off by its dead-man
/// timer. SIGXFSZ is no end but an error where a file is written, as [`era_files::tell_size_limit_as_error`] has it.
const NAMED: [(Signal, &str); 12] = [
    (Signal::HUP, "SIGHUP"),
    (Signal::INT, "SIGINT"),
    (Signal::QUIT, "SIGQUIT"),
    (Signal::TRAP, "SIGTRAP"),
    // What systemd sends where WatchdogSec has run out. A program that calls abort() ends all the same.
    (Signal::ABORT, "SIGABRT"),
    (Signal::TERM, "SIGTERM"),
    (Signal::USR1, "SIGUSR1"),
    (Signal::USR2, "SIGUSR2"),
    (Signal::ALARM, "SIGALRM"),
    (Signal::VTALARM, "SIGVTALRM"),
    (Signal::PROF, "SIGPROF"),
    (Signal::XCPU, "SIGXCPU"),
];
/// Those of Linux alone.
#[cfg(target_os = "linux")]
const OF_LINUX: [(Signal, &str); 4] =
    [(Signal::IO, "SIGIO"), (Signal::POWER, "SIGPWR"), (Signal::STKFLT, "SIGSTKFLT"), (Signal::SYS, "SIGSYS")];
#[cfg(not(target_os = "linux"))]
const OF_LINUX: [(Signal, &str); 0] = [];
/// Numbers of the real-time signals of Linux, which have no names: the C library keeps the two before them.
#[cfg(target_os = "linux")]
const REAL_TIME: std::ops::Range<i32> = 34..65;
#[cfg(not(target_os = "linux"))]
const REAL_TIME: std::ops::Range<i32> = 0..0;

/// Listens from when it is made on.
pub struct EndSignals(Vec<(String, Stream)>);

impl EndSignals {
    /// Listens for all of them, in the runtime that is entered. One that cannot be listened for is left as it is, and so is a SIGHUP that is
    /// ignored: `nohup` has a program outlive its terminal.
    #[must_use]
    pub fn listen() -> Self {
        let named = NAMED.iter().chain(&OF_LINUX).filter(|(kind, _)| *kind != Signal::HUP || !is_signal_ignored(*kind));
        let named = named.map(|(kind, name)| (kind.as_raw(), (*name).to_owned()));
        let real_time = REAL_TIME.map(|number| (number, format!("signal {number}")));
        let listened = named.chain(real_time).filter_map(|(number, name)| match signal(SignalKind::from_raw(number)) {
            Ok(stream) => Some((name, stream)),
            Err(error) => {
                tracing::debug!(%error, "cannot listen for the signal {name}");
                None
            }
        });
        Self(listened.collect())
    }

    /// Waits for the first, and gives its name.
    pub async fn wait_for_first_signal(mut self) -> String {
        std::future::poll_fn(move |context| {
            let come =
                self.0.iter_mut().find_map(|(name, stream)| stream.poll_recv(context).is_ready().then(|| name.clone()));
            come.map_or(Poll::Pending, Poll::Ready)
        })
        .await
    }
}

/// Has a thread listen, and do this on the first signal, in a command that has no runtime of its own.
pub fn run_in_thread_on_first_end_signal(what: impl FnOnce(&str) + Send + 'static) {
    let wait = move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() else { return };
        let name = runtime.block_on(async { EndSignals::listen().wait_for_first_signal().await });
        what(&name);
    };
    if let Err(error) = std::thread::Builder::new().name("signals".into()).spawn(wait) {
        tracing::warn!(%error, "cannot start the thread that waits for signals: a signal now ends the command at once");
    }
}

/// Keeps the terminal from suspending the process, in this thread and in all that it starts from now on: one in the background that writes
/// (SIGTTOU, after `stty tostop`) or reads (SIGTTIN) goes on, as it would leave its board. Blocked and not listened for: the system would repeat the
/// call, and the signal, for ever.
pub fn block_background_terminal_stop_signals() {
    let mut signals = SigSet::empty();
    signals.add(nix::sys::signal::SIGTTOU);
    signals.add(nix::sys::signal::SIGTTIN);
    if let Err(error) = signals.thread_block() {
        tracing::warn!(%error, "cannot block the signals SIGTTOU and SIGTTIN: the terminal may suspend the daemon");
    }
}

/// Lets the process be suspended from its terminal (Ctrl-Z) once `stop` is done: the board is not left to its dead-man timer.
pub async fn stop_and_suspend_on_terminal_request<F: Future<Output = ()>>(stop: impl Fn() -> F) {
    let Ok(mut asked) = signal(SignalKind::from_raw(Signal::TSTP.as_raw())) else { return };
    while asked.recv().await.is_some() {
        stop().await;
        if let Err(error) = kill_process(getpid(), Signal::STOP) {
            tracing::warn!(%error, "the process cannot be suspended");
        }
    }
}

/// Whether this process was started with a signal ignored.
fn is_signal_ignored(kind: Signal) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default();
    u32::try_from(kind.as_raw() - 1).is_ok_and(|bit| mask.checked_shr(bit).is_some_and(|rest| rest & 1 == 1))
}

//! What a limit of file sizes does to a process.

#[cfg(unix)]
use std::sync::{Arc, atomic::AtomicBool};

/// Makes a write beyond the process's limit of file sizes (`ulimit -f`, `LimitFSIZE=`) an error that is told, rather than a signal (`SIGXFSZ`) that ends the process.
#[cfg(unix)]
pub fn tell_size_limit_as_error() {
    // A handler, which programs that are started do not inherit, unlike a signal that is ignored. A system that has no such signal has no
    // such limit.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Makes a write beyond the process's limit of file sizes an error; here it is one anyway.
#[cfg(not(unix))]
pub fn tell_size_limit_as_error() {}

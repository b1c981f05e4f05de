//! A daemon whose calls of the C library go through a library of the test's: from outside, it is told which of them do not return, and what its
//! clocks say.

use crate::serving::Serving;
use era::device::sim::SimDevice;
use std::path::PathBuf;
use std::process::Command;
use tempfile::TempDir;

/// What is in the place of the calls, and the files that say what it does.
pub struct Preloaded {
    folder: TempDir,
    library: PathBuf,
}

impl Preloaded {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("preloaded.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/system/preloaded.c");
        let mut command = Command::new("cc");
        command.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).arg("-ldl");
        assert!(command.status().unwrap().success());
        Self { folder, library }
    }

    /// The daemon, once its board answers.
    pub fn serving(&self, board: &SimDevice, more: &[&str]) -> Serving {
        let words = self.words(board);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        Serving::start_under(&words, board, more)
    }

    /// What goes before a command.
    pub fn words(&self, board: &SimDevice) -> [String; 4] {
        [
            "env".into(),
            format!("LD_PRELOAD={}", self.library.display()),
            format!("HELD_DIR={}", self.folder.path().display()),
            format!("HELD_PORT={}", board.port_path()),
        ]
    }

    /// From now on this call on the port does not return.
    pub fn hold(&self, call: &str) {
        std::fs::write(self.folder.path().join(call), "").unwrap();
    }

    /// It returns again.
    pub fn let_go(&self, call: &str) {
        std::fs::remove_file(self.folder.path().join(call)).unwrap();
    }

    /// Sets a clock (`boottime` or `realtime`) so much ahead.
    pub fn set_ahead(&self, clock: &str, seconds: i64) {
        let new = self.folder.path().join("new");
        std::fs::write(&new, seconds.to_string()).unwrap();
        std::fs::rename(new, self.folder.path().join(clock)).unwrap();
    }
}

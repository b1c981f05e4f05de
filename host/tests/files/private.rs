//! What the program writes for itself is its user's alone, whatever the umask is: keys, recordings, tables, its socket, and their folders.

use crate::program::{ERA, build_isolated_command};
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Everything below a folder, with modes.
fn modes_in(folder: &Path) -> Vec<(PathBuf, u32, bool)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).unwrap().map(Result::unwrap) {
            let known = entry.metadata().unwrap();
            found.push((entry.path(), known.permissions().mode() & 0o7777, known.is_dir()));
            open.extend(known.is_dir().then(|| entry.path()));
        }
    }
    found
}

#[test]
fn files_of_the_daemon_are_private_with_any_umask() {
    for umask in ["000", "022", "077"] {
        let folder = tempfile::tempdir().unwrap();
        let mut daemon = build_isolated_command("sh")
            .args(["-c", &format!("umask {umask}; exec \"$0\" \"$@\""), ERA])
            .args(["serve", "--accuracy", "fast", "--listen", "127.0.0.1:0", "--socket", "run/deep/era.sock"])
            .args(["--tls-dir", "state/tls", "--record", "state/days/"])
            .env("ERA_CACHE_DIR", folder.path().join("state/cache"))
            .current_dir(folder.path())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(daemon.stderr.take().unwrap()).lines().map_while(Result::ok);
        let ready = log.find(|line| line.contains("ready after"));
        let found = modes_in(folder.path());
        daemon.kill().unwrap();
        daemon.wait().unwrap();
        assert!(ready.is_some(), "{found:?}");
        let mut seen = Vec::new();
        for (path, mode, is_folder) in found {
            let ending = path.extension().map(|ending| ending.to_string_lossy().into_owned()).unwrap_or_default();
            // A certificate is no secret.
            let wanted = match (is_folder, path.ends_with("era-cert.pem")) {
                (true, _) => 0o700,
                (false, true) => 0o644,
                (false, false) => 0o600,
            };
            assert_eq!(mode, wanted, "umask {umask}: {} has {mode:o}", path.display());
            seen.push(ending);
        }
        for ending in ["jsonl", "pem", "era-plan", "sock"] {
            assert!(seen.iter().any(|own| own == ending), "{ending} in {seen:?}");
        }
    }
}

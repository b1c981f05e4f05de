//! The command line as a client, beside independent small servers: where its requests and its secrets go.

#[path = "../support/mod.rs"]
mod support;

mod certificates;
mod listening;
mod marks;
mod proxies;
mod redirects;
mod servers;
mod tokens;

use std::path::Path;
use std::process::Command;

/// A file that only its owner may read.
pub fn write_secret(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).unwrap();
    #[cfg(unix)]
    std::fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
}

/// Runs `openssl`, an independent maker of keys and certificates.
pub fn run_openssl(folder: &Path, arguments: &str) {
    let output = Command::new("openssl").args(arguments.split(' ')).current_dir(folder).output();
    let output = output.unwrap_or_else(|error| panic!("openssl (Debian's package openssl): {error}"));
    assert!(output.status.success(), "openssl {arguments}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Every command that asks a daemon, with its arguments; `recording` is a file that [`write_recording`] wrote.
pub fn asking_commands(recording: &Path) -> Vec<Vec<String>> {
    let plain = ["stop", "state", "clear", "arm", "touch 960 640", "doctor --device sim"];
    let mut all: Vec<Vec<String>> = plain.iter().map(|line| line.split(' ').map(str::to_owned).collect()).collect();
    all.push(vec!["replay".into(), recording.display().to_string()]);
    all
}

/// A recording with every kind of request, a page's live socket among them.
pub fn write_recording(path: &Path) {
    let lines = [
        r#"{"at_ms":0,"kind":"begin","format":1,"version":"0","scene":"example plate","unix_s":0}"#,
        r#"{"at_ms":1,"kind":"touch","id":1,"body":{"x_px":960,"y_px":640}}"#,
        r#"{"at_ms":2,"kind":"fingers","socket":1,"message":{"type":"touch","touches":[]}}"#,
        r#"{"at_ms":3,"kind":"arm"}"#,
        r#"{"at_ms":4,"kind":"clear"}"#,
        r#"{"at_ms":5,"kind":"stop"}"#,
    ];
    std::fs::write(path, lines.join("\n")).unwrap();
}

//! The log as lines of JSON.

use super::{decode_utf8, make_era_command, run_era};
use serde_json::Value;

/// Every line of standard error; each has the three keys that a collector of logs wants.
fn lines(error: &[u8]) -> Vec<Value> {
    let lines: Vec<Value> = decode_utf8(error)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")))
        .collect();
    for line in &lines {
        for key in ["timestamp", "level", "message"] {
            assert!(line[key].is_string(), "{key} in {line}");
        }
    }
    lines
}

#[test]
fn warnings_news_and_errors_are_lines_of_json() {
    let folder = tempfile::tempdir().unwrap();
    let thick = era::scene::STARTING_PLATE.replace("thickness_mm = 2.0", "thickness_mm = 15.0");
    let scene = folder.path().join("thick.toml");
    std::fs::write(&scene, thick).unwrap();
    let output = run_era(&["-v", "modes", "--log-format", "json", "--scene", scene.to_str().unwrap()]);
    assert!(output.status.success() && !output.stdout.is_empty());
    let told = lines(&output.stderr);
    assert!(told.iter().any(|line| line["level"] == "WARN"), "{told:?}");
    // Progress and explanations are no log, but on the same stream.
    let told = lines(&run_era(&["modes", "--explain", "--log-format=json", "--accuracy", "fast"]).stderr);
    assert!(!told.is_empty());
}

#[test]
fn what_ends_a_command_is_a_line_of_json() {
    for (arguments, code, words) in [
        (&["state", "--url", "127.0.0.1:1"][..], 1, "no answer"),
        (&["modes", "--max-hz", "1e9"], 2, "1000000000"),
        (&["modes", "--scene", "/nowhere.toml"], 2, "/nowhere.toml"),
        (&["modes", "--max-herz", "100"], 2, "--max-herz"),
        (&["--listen", "127.0.0.1:0"], 2, "era serve --listen"),
    ] {
        let output = run_era(&[&["--log-format", "json"], arguments].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        let told = lines(&output.stderr);
        let last = told.last().unwrap();
        assert!(last["level"] == "ERROR" && last["message"].as_str().unwrap().contains(words), "{last}");
    }
}

/// Help is asked for by people.
#[test]
fn help_stays_text_and_so_does_the_log_unless_asked() {
    let help = run_era(&["--log-format", "json", "modes", "--help"]);
    assert!(help.status.success() && help.stderr.is_empty() && decode_utf8(&help.stdout).starts_with("List"));
    let plain = make_era_command().args(["state", "--url", "127.0.0.1:1"]).output().unwrap();
    assert!(decode_utf8(&plain.stderr).starts_with("error: no answer"));
}

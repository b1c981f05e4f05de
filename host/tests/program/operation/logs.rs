//! The log as lines of JSON.

use crate::support::program::run_era;
use serde_json::Value;

/// Every line of standard error; each has the three keys that a collector of logs wants.
fn parse_log_lines(error: &str) -> Vec<Value> {
    let lines: Vec<Value> = error
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
    assert!(output.is_success() && !output.out.is_empty());
    let told = parse_log_lines(&output.error);
    assert!(told.iter().any(|line| line["level"] == "WARN"), "{told:?}");
    // Progress and explanations are no log, but on the same stream.
    let told = parse_log_lines(&run_era(&["modes", "--explain", "--log-format=json", "--accuracy", "fast"]).error);
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
        assert_eq!(output.code, Some(code), "{arguments:?}");
        let told = parse_log_lines(&output.error);
        let last = told.last().unwrap();
        assert!(last["level"] == "ERROR" && last["message"].as_str().unwrap().contains(words), "{last}");
    }
}

/// Help is asked for by people.
#[test]
fn help_stays_text_and_so_does_the_log_unless_asked() {
    let help = run_era(&["--log-format", "json", "modes", "--help"]);
    assert!(help.is_success() && help.error.is_empty() && help.out.starts_with("List"));
    let plain = run_era(&["state", "--url", "127.0.0.1:1"]);
    assert!(plain.error.starts_with("error: no answer"));
}

//! Completion scripts and man pages.

use crate::support::program::run_era;
use std::io::Write;
use std::process::{Command, Stdio};

/// The commands that `era --help` lists.
fn commands() -> Vec<String> {
    let help = run_era(&["--help"]).out;
    let list = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let is_name = |line: &&str| line.starts_with("  ") && !line.starts_with("   ");
    let mut names: Vec<String> =
        list.lines().filter(is_name).map(|line| line.split_whitespace().next().unwrap().to_owned()).collect();
    names.retain(|name| name != "help");
    assert!(names.len() > 18, "{names:?}");
    names
}

#[test]
fn completion_scripts_know_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = run_era(&["completions", shell]);
        let script = &output.out;
        assert!(output.is_success() && output.error.is_empty(), "{shell}");
        for command in commands() {
            assert!(script.contains(&command), "{shell} does not know {command}");
        }
    }
    assert_eq!(run_era(&["completions", "tcsh"]).code, Some(2));
}

#[test]
fn bash_can_read_its_script() {
    let Ok(mut bash) = Command::new("bash").arg("-n").stdin(Stdio::piped()).spawn() else {
        eprintln!("no bash here: nothing was tried");
        return;
    };
    bash.stdin.take().unwrap().write_all(run_era(&["completions", "bash"]).out.as_bytes()).unwrap();
    assert!(bash.wait().unwrap().success());
}

#[test]
fn every_command_has_a_man_page() {
    let page = run_era(&["man"]).out;
    assert!(page.contains(".TH era 1") && page.contains("\\-\\-log\\-format"), "{page}");
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man1");
    let output = run_era(&["man", "--dir", pages.to_str().unwrap()]);
    assert!(output.is_success() && output.out.is_empty(), "{output:?}");
    for command in commands() {
        let own = std::fs::read_to_string(pages.join(format!("era-{command}.1"))).unwrap();
        assert!(own.contains(".TH ") && own.contains(&command.replace('-', "\\-")), "{command}: {own}");
    }
    assert!(pages.join("era.1").is_file() && pages.join("era-config-check.1").is_file());
    // Where nothing can be written.
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    assert_eq!(run_era(&["man", "--dir", blocked.to_str().unwrap()]).code, Some(1));
}

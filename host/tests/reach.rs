//! `era field --reach` and `--schemes` as they are called: the bar's table, what is refused, and the pictures.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn era(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_era"));
    command.env("ERA_CACHE_DIR", env!("CARGO_TARGET_TMPDIR")).args(arguments).output().unwrap()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn scratch(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// The example bar's path, written where tests may write.
fn bar() -> String {
    let file = scratch("reach-bar.toml");
    std::fs::write(&file, era::scene::EXAMPLE_BAR).unwrap();
    file.display().to_string()
}

#[test]
fn bands_zones_and_names_that_make_no_sense_are_refused() {
    let bar = bar();
    for (arguments, words) in [
        (
            &["--from", "100", "--to", "110"][..],
            &["--from 100 --to 110", "between 40 and 400 Hz", "20 Hz apart", "at least 20 Hz wide"][..],
        ),
        (&["--from", "300", "--to", "200"], &["--from 300 --to 200", "between 40 and 400 Hz"]),
        (&["--from", "500"], &["--from 500 --to 400", "between 40 and 400 Hz"]),
        (&["--from", "nan"], &["--from", "finite"]),
        (&["--zone", "0,0,300,10"], &["--zone", "x_mm is 300", "0 to 250"]),
        (&["--zone", "100.1,0,100.2,10"], &["--zone", "mm apart"]),
        (&["--zone", "1,2,3"], &["--zone", "X0,Y0,X1,Y1"]),
        (&["--png", "map.jpg"], &["--png", ".png"]),
    ] {
        let output = era(&[&["field", "--schemes", "--accuracy", "fast", "--scene", &bar], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", told(&output));
        for word in words {
            assert!(told(&output).contains(word), "{arguments:?}: {}", told(&output));
        }
        assert!(output.stdout.is_empty());
    }
}

/// Tables and pictures of a part of the bar and of its band, and what is said of the files.
#[test]
fn reach_is_told_and_drawn() {
    let bar = bar();
    let part = ["--zone", "100,0,150,20", "--from", "120", "--to", "180", "--accuracy", "fast", "--scene", &bar];
    for (what, columns, lines) in [
        ("--reach", "x_mm,y_mm,strongest_g,contrast_db,strongest_left_hz", &["strongest peak", "contrast"][..]),
        ("--schemes", "x_mm,y_mm,one_setting_1_g,per_touch_1_g", &["| distinct frequencies | ", "First mode"]),
    ] {
        let (png, csv) = (scratch(&format!("{what}.png")), scratch(&format!("{what}.csv")));
        let files = ["--png", &png.display().to_string(), "--csv", &csv.display().to_string()];
        let output = era(&[&["field", what], &part[..], &files].concat());
        assert!(output.status.success(), "{}", told(&output));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(lines.iter().all(|line| text.contains(line)) && text.contains("100 to 150 mm"), "{text}");
        assert!(told(&output).contains("wrote") && told(&output).contains("pixels"), "{}", told(&output));
        assert!(std::fs::read_to_string(&csv).unwrap().starts_with(columns));
        let picture = std::fs::read(&png).unwrap();
        assert!(picture.starts_with(b"\x89PNG") && picture.len() < 100_000, "{} bytes", picture.len());
    }
}

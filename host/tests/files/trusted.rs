//! A table that is kept on disk raises no voltage, whatever somebody has written into it, and whoever it was.

use crate::program::{ProgramOutput, build_era_command};
use serde_json::Value;
use std::fs;
use std::os::unix::fs::{PermissionsExt, chown, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// What makes a file or folder one that others may have changed: what is said of it, and doing it.
type Way<'a> = (&'a str, Box<dyn Fn() + 'a>);

/// The drives of the strongest touches at two places, and what was said besides.
fn plan(scene: &Path, cache: Option<&Path>) -> (Vec<(f64, f64)>, String) {
    let mut drives = Vec::new();
    let mut said = String::new();
    for at in ["480,640", "100,100"] {
        let mut command = build_era_command();
        command.args(["plan", "--accuracy", "fast", "--intensity-g", "50", "--json", "--at", at, "--scene"]).arg(scene);
        match cache {
            Some(folder) => command.env("ERA_CACHE_DIR", folder),
            None => command.arg("--no-cache"),
        };
        let mut child =
            command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
        let started = Instant::now();
        while child.try_wait().unwrap().is_none() {
            assert!(started.elapsed() < Duration::from_secs(120), "it hangs");
            std::thread::sleep(Duration::from_millis(20));
        }
        let ended = ProgramOutput::from(child.wait_with_output().unwrap());
        said += &ended.error;
        assert!(ended.is_success(), "{said}");
        let answer: Value = ended.parse_json();
        let plan = if answer["drives"].is_array() { &answer } else { &answer["plan"] };
        for drive in plan["drives"].as_array().unwrap() {
            drives.push((drive["frequency_hz"].as_f64().unwrap(), drive["voltage_v"].as_f64().unwrap()));
        }
    }
    assert!(drives.len() >= 4, "{drives:?}");
    (drives, said)
}

/// The only table in a folder.
fn only_table(folder: &Path) -> PathBuf {
    let mut files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let file = files.next().unwrap();
    assert!(files.next().is_none());
    file
}

/// The example plate without the stops that let its gaps hold more, and one that is held so stiffly that a press does not move it.
fn scenes(folder: &Path) -> [PathBuf; 2] {
    let bare: String = era::scene::STARTING_PLATE
        .lines()
        .filter(|line| !line.starts_with("stop_um"))
        .map(|line| format!("{line}\n"))
        .collect();
    let stiff = bare
        .replace("stiffness_n_per_m = 2000.0", "stiffness_n_per_m = 1e6")
        .replace("stiffness_n_per_m = 5000.0", "stiffness_n_per_m = 5e4");
    assert_ne!(bare, stiff);
    let paths = [folder.join("bare.toml"), folder.join("stiff.toml")];
    fs::write(&paths[0], bare).unwrap();
    fs::write(&paths[1], stiff).unwrap();
    paths
}

/// The table of a stiffer panel, in which everything fits together, under the name, the key and with the hash of a weaker one's.
#[test]
fn the_table_of_a_stiffer_panel_raises_no_voltage() {
    let folder = tempfile::tempdir().unwrap();
    let [bare, stiff] = scenes(folder.path());
    let (own, others) = (folder.path().join("own"), folder.path().join("others"));
    let (wanted, _) = plan(&bare, Some(&own));
    let (of_stiff, _) = plan(&stiff, Some(&others));
    assert_eq!(plan(&bare, None).0, wanted);
    let most = |drives: &[(f64, f64)]| drives.iter().map(|(_, voltage_v)| *voltage_v).fold(0.0, f64::max);
    assert!(most(&of_stiff) > most(&wanted) + 50.0, "{of_stiff:?} {wanted:?}");
    let whole = fs::read(only_table(&own)).unwrap();
    let mut edited = fs::read(only_table(&others)).unwrap();
    edited[12..44].copy_from_slice(&whole[12..44]);
    fs::write(only_table(&own), &edited).unwrap();
    let (drives, said) = plan(&bare, Some(&own));
    assert_eq!(drives, wanted, "{said}");
}

/// Each way in which somebody else could have written a table, or may: it is told, not read and not waited for; the plan is that of the scene.
#[test]
fn what_others_could_have_changed_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, _] = scenes(folder.path());
    let cache = folder.path().join("cache");
    let (wanted, said) = plan(&scene, Some(&cache));
    assert!(!said.contains("is not used"), "{said}");
    let table = only_table(&cache);
    let whole = fs::read(&table).unwrap();
    let mode = |path: &Path, mode: u32| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    let elsewhere = folder.path().join("elsewhere");
    fs::write(&elsewhere, &whole).unwrap();
    let is_root = fs::metadata(folder.path()).is_ok_and(|known| std::os::unix::fs::MetadataExt::uid(&known) == 0);
    let mut ways: Vec<Way<'_>> = vec![
        ("the mode is 0620", Box::new(|| mode(&table, 0o620))),
        ("the mode is 0602", Box::new(|| mode(&table, 0o602))),
        ("the mode is 0666", Box::new(|| mode(&table, 0o666))),
        (
            "a symbolic link was found",
            Box::new(|| {
                fs::remove_file(&table).unwrap();
                symlink(&elsewhere, &table).unwrap();
            }),
        ),
        (
            "a pipe was found",
            Box::new(|| {
                fs::remove_file(&table).unwrap();
                assert!(Command::new("mkfifo").arg(&table).status().unwrap().success());
            }),
        ),
    ];
    if is_root {
        // Only root can give files away.
        ways.push(("the owner has the user ID 65534", Box::new(|| chown(&table, Some(65_534), None).unwrap())));
    }
    for (reason, change) in &ways {
        change();
        let (drives, said) = plan(&scene, Some(&cache));
        assert!(said.contains("is not used") && said.contains(reason), "{reason}: {said}");
        assert_eq!(drives, wanted, "{reason}");
        // Another is in its place, and what it led to is as it was.
        let known = fs::symlink_metadata(&table).unwrap();
        assert!(known.is_file() && known.permissions().mode() & 0o777 == 0o600, "{reason}: {known:?}");
        assert_eq!(fs::read(&elsewhere).unwrap(), whole);
        assert!(!plan(&scene, Some(&cache)).1.contains("is not used"), "{reason}");
    }
    let mut ways: Vec<Way<'_>> = vec![
        ("the mode is 0770", Box::new(|| mode(&cache, 0o770))),
        ("the mode is 0702", Box::new(|| mode(&cache, 0o702))),
        ("the mode is 1777", Box::new(|| mode(&cache, 0o1777))),
    ];
    if is_root {
        ways.push((
            "the owner has the user ID 65534",
            Box::new(|| {
                mode(&cache, 0o700);
                chown(&cache, Some(65_534), None).unwrap();
            }),
        ));
    }
    for (reason, change) in &ways {
        change();
        fs::write(&table, &whole).unwrap();
        let (drives, said) = plan(&scene, Some(&cache));
        assert!(
            said.contains("is not used") && said.contains(reason) && said.contains("ERA_CACHE_DIR"),
            "{reason}: {said}"
        );
        assert_eq!(drives, wanted, "{reason}");
    }
}

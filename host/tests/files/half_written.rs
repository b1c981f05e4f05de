//! Whatever cuts the program's writing off, a file has its old content or all of its new one.

use super::{build_limited_command, files_in, run_limited};
use crate::program::{build_era_command, run_command};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

const STUDY: &str = "version = 1\nname = \"two\"\nscene = \"plate.toml\"\n[[variable]]\nname = \"springs_n_per_m\"\n\
                     key = \"support.*.stiffness_n_per_m\"\nfrom = 200\nto = 50000\nscale = \"log\"\nlevels = 2\n\
                     [[wish]]\nfigure = \"sag_um\"\nforce_n = 10\n[method]\nway = \"grid\"\nfinalists = 1\n";

/// A folder with what the commands read.
fn folder_with_inputs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("plate.toml"), era::scene::STARTING_PLATE).unwrap();
    fs::write(folder.path().join("bar.toml"), era::scene::EXAMPLE_BAR).unwrap();
    fs::write(folder.path().join("two.toml"), STUDY).unwrap();
    fs::write(folder.path().join("buzz.toml"), "version = 1\n[[events]]\nprimitive = \"buzz\"\n").unwrap();
    folder
}

/// What writes files below `out`, all of it.
fn writers() -> Vec<Vec<&'static str>> {
    [
        "effect --accuracy fast --at 480,640 --file buzz.toml --export out/a.csv",
        "effect --accuracy fast --at 480,640 --file buzz.toml --export out/a.wav",
        "effect --accuracy fast --at 480,640 --file buzz.toml --export out/a.png",
        "field --accuracy fast --at 480,640 --csv out/a.csv",
        "field --accuracy fast --at 480,640 --png out/a.png",
        "field --scene bar.toml --accuracy fast --reach --from 100 --to 121 --csv out/a.csv",
        "field --scene bar.toml --accuracy fast --schemes --from 100 --to 121 --png out/a.png",
        "modes --accuracy fast --csv out/a.csv",
        "modes --accuracy fast --png out/a.png",
        "modes --accuracy fast --npy out/a.npy",
        "sweep --accuracy fast --from 50 --to 100 --npy out/a.npy",
        "transient --accuracy fast --at 180,120 --drive left:150:0.1 --csv out/a.csv",
        "study two.toml --out out",
        "man --dir out",
        "install --root out --config /etc/era/era.toml --program /usr/bin/era",
        "install --root out --user --config /etc/era/era.toml --program /usr/bin/era",
    ]
    .into_iter()
    .map(|line| line.split(' ').collect())
    .collect()
}

/// Each writer with limits of 0, 1 and half of its largest file, where nothing was before and where old files were.
#[test]
fn a_full_disk_leaves_old_files_or_new_ones() {
    for arguments in writers() {
        let folder = folder_with_inputs();
        let out = folder.path().join("out");
        fs::create_dir(&out).unwrap();
        let done = run_limited(folder.path(), None, &arguments);
        assert!(done.is_success(), "{arguments:?}: {}", done.error);
        let whole = files_in(&out);
        let largest = whole.values().map(Vec::len).max().unwrap() as u64;
        for limit in [0, 1, largest / 2] {
            for has_old in [false, true] {
                fs::remove_dir_all(&out).unwrap();
                fs::create_dir(&out).unwrap();
                // A study's folder belongs to it, and what `era install` did not write it leaves alone.
                let old = if arguments[0] == "install" {
                    b"# Written by `era install`, which may replace or remove it.\nold".to_vec()
                } else {
                    b"old".to_vec()
                };
                if has_old && arguments[0] != "study" {
                    for path in whole.keys() {
                        fs::create_dir_all(out.join(path).parent().unwrap()).unwrap();
                        fs::write(out.join(path), &old).unwrap();
                    }
                }
                let ended = run_limited(folder.path(), Some(limit), &arguments);
                let said = &ended.error;
                let of = format!("{arguments:?}, at most {limit} bytes, old files {has_old}: {said}");
                assert_eq!(ended.code, Some(1), "{of}");
                assert!(said.contains("File too large") && said.contains("out"), "{of}");
                for (path, content) in files_in(&out) {
                    let new = whole.get(&path).unwrap_or_else(|| panic!("{} was left: {of}", path.display()));
                    let is_new = content == *new || arguments[0] == "study" && content.len() == new.len();
                    assert!(
                        is_new || has_old && content == old,
                        "{} has {} bytes: {of}",
                        path.display(),
                        content.len()
                    );
                }
            }
        }
        // What was left is in nobody's way.
        let again = run_limited(folder.path(), None, &arguments);
        assert!(again.is_success(), "{arguments:?}: {}", again.error);
        assert_eq!(files_in(&out).into_keys().collect::<Vec<_>>(), whole.into_keys().collect::<Vec<_>>());
    }
}

/// Standard output that a shell has sent into a file on a full disk is told, too.
#[test]
fn a_full_standard_output_is_reported() {
    for arguments in [&["completions", "bash"][..], &["man"], &["config", "example"], &["install", "--print"]] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let ended = run_command(build_era_command().args(arguments).stdout(full));
        let said = &ended.error;
        assert!(ended.code == Some(1) && said.contains("No space left on device"), "{arguments:?}: {said}");
    }
}

/// Links stay, modes are kept, and what cannot be replaced is written to.
#[test]
fn links_modes_and_pipes_are_as_before() {
    let folder = folder_with_inputs();
    let at = |name: &str| folder.path().join(name);
    let csv = |path: &str| {
        let done = run_limited(
            folder.path(),
            None,
            &["transient", "--accuracy", "fast", "--at", "180,120", "--drive", "left:150:0.1", "--json", "--csv", path],
        );
        assert!(done.is_success(), "{}", done.error);
        done.out
    };
    fs::create_dir(at("other")).unwrap();
    fs::write(at("other/target.csv"), "old").unwrap();
    fs::set_permissions(at("other/target.csv"), fs::Permissions::from_mode(0o640)).unwrap();
    std::os::unix::fs::symlink("other/target.csv", at("link.csv")).unwrap();
    csv("link.csv");
    let written = fs::read_to_string(at("other/target.csv")).unwrap();
    assert!(at("link.csv").is_symlink() && written.starts_with("time_s,"), "{written}");
    assert_eq!(fs::metadata(at("other/target.csv")).unwrap().permissions().mode() & 0o777, 0o640);
    assert!(csv("/dev/stdout").starts_with("time_s,") && csv("-").starts_with("time_s,"));
    csv("/dev/null");
    assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
    let pipe = at("pipe");
    let reader = std::thread::spawn(move || fs::read_to_string(pipe).unwrap());
    csv("pipe");
    assert_eq!(reader.join().unwrap(), written);
}

/// Starts the daemon until it is ready or ends; what it said.
fn serve(folder: &Path, limit: Option<u64>, more: &[&str]) -> (Option<i32>, String) {
    // The socket is taken, so that the daemon ends once it has its certificate.
    let arguments =
        [&["serve", "--listen", "127.0.0.1:0", "--socket", "taken.sock", "--accuracy", "fast"], more].concat();
    let socket = folder.join("taken.sock");
    let _ = fs::remove_file(&socket);
    let _taken = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let ended = run_limited(folder, limit, &arguments);
    (ended.code, ended.error)
}

/// The pair of certificate and key is there whole or not at all, and the next start has it.
#[test]
fn a_full_disk_leaves_a_certificate_that_the_next_start_makes() {
    let sizes = {
        let folder = folder_with_inputs();
        serve(folder.path(), None, &["--tls-dir", "tls"]);
        files_in(&folder.path().join("tls")).into_values().map(|content| content.len() as u64).collect::<Vec<_>>()
    };
    assert_eq!(sizes.len(), 2);
    let (least, most) = (sizes[0].min(sizes[1]), sizes[0].max(sizes[1]));
    for limit in [0, 1, least / 2, (least + most) / 2] {
        let folder = folder_with_inputs();
        let tls = folder.path().join("tls");
        let (code, said) = serve(folder.path(), Some(limit), &["--tls-dir", "tls"]);
        assert!(code == Some(1) && said.contains("cannot write tls/era-") && said.contains("File too large"), "{said}");
        assert!(files_in(&tls).is_empty(), "{limit}: {:?}", files_in(&tls).keys());
        let (_, said) = serve(folder.path(), None, &["--tls-dir", "tls"]);
        assert!(said.contains("another daemon listens on the socket"), "{said}");
        assert_eq!(files_in(&tls).len(), 2);
    }
}

/// Each of several daemons that make their certificate in one folder has the same one, with its key, and so has the next.
#[test]
fn daemons_that_start_at_once_share_one_certificate() {
    for _ in 0..4 {
        let shared = tempfile::tempdir().unwrap();
        let tls = shared.path().join("tls");
        let options = ["--tls-dir", tls.to_str().unwrap()];
        let start = || {
            let (_, said) = serve(folder_with_inputs().path(), None, &options);
            assert!(said.contains("another daemon listens on the socket"), "{said}");
        };
        std::thread::scope(|threads| (0..4).for_each(|_| drop(threads.spawn(start))));
        assert_eq!(files_in(&tls).len(), 2);
        start();
    }
}

/// What an older version, or a machine that lost its power, has left: reported, replaced, and kept beside.
#[test]
fn damaged_certificates_and_keys_are_reported_and_replaced() {
    let made = folder_with_inputs();
    serve(made.path(), None, &["--tls-dir", "tls"]);
    let (certificate, key) = {
        let read = |name: &str| fs::read(made.path().join("tls").join(name)).unwrap();
        (read("era-cert.pem"), read("era-key.pem"))
    };
    let half = |content: &[u8]| content[..content.len() / 2].to_vec();
    let zeros = |content: &[u8]| vec![0; content.len()];
    /// What is left of a file; nothing where there is none.
    type Left = Option<Vec<u8>>;
    let cases: [(Left, Left); 9] = [
        (None, Some(Vec::new())),
        (None, Some(half(&key))),
        (None, Some(key.clone())),
        (Some(Vec::new()), None),
        (Some(Vec::new()), Some(Vec::new())),
        (Some(certificate.clone()), Some(Vec::new())),
        (Some(certificate.clone()), Some(half(&key))),
        (Some(half(&certificate)), Some(key.clone())),
        (Some(zeros(&certificate)), Some(zeros(&key))),
    ];
    for (number, (damaged_certificate, damaged_key)) in cases.into_iter().enumerate() {
        let folder = folder_with_inputs();
        let tls = folder.path().join("tls");
        fs::create_dir(&tls).unwrap();
        for (name, content) in [("era-cert.pem", &damaged_certificate), ("era-key.pem", &damaged_key)] {
            if let Some(content) = content {
                fs::write(tls.join(name), content).unwrap();
                fs::set_permissions(tls.join(name), fs::Permissions::from_mode(0o600)).unwrap();
            }
        }
        fs::write(folder.path().join("era.toml"), "version = 1\nsocket = \"none\"\ntls_dir = \"tls\"\n").unwrap();
        let checked = run_limited(folder.path(), None, &["config", "check", "era.toml"]);
        assert!(checked.is_success(), "{number}: {}", checked.error);
        let (_, said) = serve(folder.path(), None, &["--tls-dir", "tls"]);
        assert!(
            said.contains("makes a new certificate and a new key. Clients need")
                && said.contains("another daemon listens"),
            "{number}: {said}"
        );
        for (name, old) in [("era-cert.pem", &damaged_certificate), ("era-key.pem", &damaged_key)] {
            assert_eq!(fs::read(tls.join(format!("{name}.damaged"))).ok(), *old, "{number}");
            assert_ne!(fs::read(tls.join(name)).ok(), *old, "{number}");
        }
        let (_, said) = serve(folder.path(), None, &["--tls-dir", "tls"]);
        assert!(!said.contains("made"), "{number}: {said}");
    }
    // A certificate that clients may have been given stays.
    let folder = folder_with_inputs();
    fs::create_dir(folder.path().join("tls")).unwrap();
    fs::write(folder.path().join("tls/era-cert.pem"), &certificate).unwrap();
    let (code, said) = serve(folder.path(), None, &["--tls-dir", "tls"]);
    assert!(code == Some(2) && said.contains("era-key.pem: the key is missing"), "{said}");
}

/// A table that cannot be kept is computed all the same, and a cut one is replaced.
#[test]
fn a_full_disk_keeps_no_table_and_changes_no_plan() {
    let folder = folder_with_inputs();
    let cache = folder.path().join("cache");
    let plan = |limit: Option<u64>| {
        let mut command = build_limited_command(limit);
        command.env("ERA_CACHE_DIR", &cache).current_dir(folder.path());
        let ended = run_command(command.args(["plan", "--accuracy", "fast", "--at", "480,640"]));
        assert!(ended.is_success(), "{}", ended.error);
        ended.error
    };
    for limit in [0, 1, 100_000] {
        plan(Some(limit));
        assert!(files_in(&cache).is_empty());
    }
    plan(None);
    let [(name, whole)] = files_in(&cache).into_iter().collect::<Vec<_>>().try_into().unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&cache), mode(&cache.join(&name))), (0o700, 0o600));
    for damaged in [0, 1, whole.len() / 2] {
        fs::write(cache.join(&name), &whole[..damaged]).unwrap();
        assert!(plan(Some(100_000)).contains("is not used, so the program computes the table again"));
        assert_eq!(fs::read(cache.join(&name)).unwrap().len(), damaged, "it stays where another cannot be written");
        assert!(plan(None).contains("is not used, so the program computes the table again"));
        assert_eq!(fs::read(cache.join(&name)).unwrap().len(), whole.len());
    }
}

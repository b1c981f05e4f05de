use super::*;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::process::{Command, Stdio};
use std::time::Instant;

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o7777
}

#[test]
fn a_file_is_made_and_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for text in ["a longer text", "short", ""] {
        replace_file(&path, Readers::ByUmask, text.as_bytes()).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }
    assert_eq!(names(folder.path()), ["a.csv"]);
    // A name of the longest length, too, to which nothing could be added.
    replace_file(&folder.path().join("n".repeat(255)), Readers::ByUmask, b"new").unwrap();
}

/// Whatever fails, the old content stays and nothing else is left.
#[test]
fn what_fails_leaves_the_old_content_and_nothing_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let fails = |file: &mut dyn Write| -> io::Result<()> {
        file.write_all(&[b'x'; 100_000])?;
        Err(ErrorKind::StorageFull.into())
    };
    assert_eq!(replace_file_by(&path, Readers::ByUmask, fails).unwrap_err().kind(), ErrorKind::StorageFull);
    assert_eq!(names(folder.path()), [""; 0]);
    fs::write(&path, "old").unwrap();
    assert!(replace_file_by(&path, Readers::ByUmask, fails).is_err());
    assert_eq!((fs::read_to_string(&path).unwrap().as_str(), names(folder.path())), ("old", vec!["a.csv".into()]));
    fs::create_dir(folder.path().join("folder")).unwrap();
    for refused in [folder.path().join("folder"), folder.path().join("none/a.csv"), "..".into(), "".into()] {
        assert!(replace_file(&refused, Readers::ByUmask, b"new").is_err(), "{}", refused.display());
    }
    assert_eq!(names(folder.path()), ["a.csv", "folder"]);
}

#[test]
fn links_are_followed_and_stay() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("other")).unwrap();
    fs::write(at("other/target"), "old").unwrap();
    symlink("other/target", at("link")).unwrap();
    symlink(at("link"), at("second")).unwrap();
    symlink("other/not-yet", at("to-nothing")).unwrap();
    symlink("circle", at("circle")).unwrap();
    replace_file(&at("second"), Readers::ByUmask, b"new").unwrap();
    replace_file(&at("to-nothing"), Readers::ByUmask, b"made").unwrap();
    assert!(replace_file(&at("circle"), Readers::ByUmask, b"new").is_err());
    assert!(["link", "second", "to-nothing", "circle"].iter().all(|name| at(name).is_symlink()));
    assert_eq!(fs::read_to_string(at("other/target")).unwrap(), "new");
    assert_eq!(fs::read_to_string(at("other/not-yet")).unwrap(), "made");
    // Where it is to be replaced itself, what it leads to stays.
    replace_link_or_file(&at("link"), Readers::Owner, b"own").unwrap();
    assert!(!at("link").is_symlink() && fs::read_to_string(at("link")).unwrap() == "own");
    assert_eq!(fs::read_to_string(at("other/target")).unwrap(), "new");
}

#[test]
fn modes_are_kept_or_as_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    for kept in [0o600, 0o640, 0o755, 0o666] {
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(kept)).unwrap();
        replace_file(&path, Readers::ByUmask, b"new").unwrap();
        assert_eq!(mode(&path), kept);
    }
    replace_file(&path, Readers::Owner, b"secret").unwrap();
    assert_eq!(mode(&path), 0o600);
    replace_file(&path, Readers::Everybody, b"public").unwrap();
    assert_eq!(mode(&path), 0o644);
    // A new one is as any program's.
    let (own, other) = (folder.path().join("own"), folder.path().join("other"));
    replace_file(&own, Readers::ByUmask, b"new").unwrap();
    fs::write(&other, "new").unwrap();
    assert_eq!(mode(&own), mode(&other));
    make_private_folder(&folder.path().join("made/inner")).unwrap();
    assert_eq!([mode(&folder.path().join("made")), mode(&folder.path().join("made/inner"))], [0o700; 2]);
}

/// Root may give files away and write to what it may not; whoever else is refused what opening the file refuses.
#[test]
fn owners_stay_and_what_may_not_be_written_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    fs::write(&path, "old").unwrap();
    if rustix::process::geteuid().is_root() {
        std::os::unix::fs::chown(&path, Some(65_534), Some(65_534)).unwrap();
        replace_file(&path, Readers::ByUmask, b"new").unwrap();
        let known = fs::metadata(&path).unwrap();
        assert_eq!((known.uid(), known.gid()), (65_534, 65_534));
    } else {
        fs::set_permissions(&path, fs::Permissions::from_mode(0o444)).unwrap();
        let error = replace_file(&path, Readers::ByUmask, b"new").unwrap_err();
        assert_eq!((error.kind(), fs::read_to_string(&path).unwrap().as_str()), (ErrorKind::PermissionDenied, "old"));
    }
}

#[test]
fn pipes_devices_and_open_files_are_written_to_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || fs::read_to_string(pipe).unwrap()
    });
    replace_file(&pipe, Readers::ByUmask, b"through a pipe").unwrap();
    assert_eq!(reader.join().unwrap(), "through a pipe");
    replace_file(Path::new("/dev/null"), Readers::ByUmask, b"nothing").unwrap();
    // An open file of this process, as a shell's `>` makes one: what was written to it stays, and so does the file.
    let path = folder.path().join("out");
    let mut out = OpenOptions::new().append(true).create_new(true).open(&path).unwrap();
    out.write_all(b"before ").unwrap();
    let descriptor = format!("/dev/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&out));
    replace_file(Path::new(&descriptor), Readers::ByUmask, b"between ").unwrap();
    out.write_all(b"after").unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "before between after");
    assert_eq!(names(folder.path()), ["out", "pipe"]);
}

/// What a program that is killed at any time leaves behind is removed once nobody can be writing to it.
#[test]
fn what_killed_writers_leave_is_removed_after_an_hour() {
    let folder = tempfile::tempdir().unwrap();
    let [old, new, other] = [".era-0123456789abcdef.part", ".era-fedcba9876543210.part", ".era-notes.part"];
    for name in [old, new, other] {
        fs::write(folder.path().join(name), "half").unwrap();
    }
    let long_ago = SystemTime::now() - 2 * LEFT_BEHIND;
    for name in [old, other] {
        File::options().append(true).open(folder.path().join(name)).unwrap().set_modified(long_ago).unwrap();
    }
    remove_unfinished(folder.path());
    assert_eq!(names(folder.path()), [new, other]);
}

/// Names the file that the other half of the next test writes to.
const TO_BE_KILLED: &str = "ERA_FILES_TEST_KILLED";

/// The other half of the next test, as a process of its own: it writes half a file, and waits to be killed.
#[test]
fn a_writer_that_waits_to_be_killed() {
    let Some(path) = std::env::var_os(TO_BE_KILLED) else { return };
    let _ = replace_file_by(Path::new(&path), Readers::ByUmask, |file| {
        file.write_all(&[b'x'; 1 << 20])?;
        file.flush()?;
        std::thread::sleep(Duration::from_secs(60));
        Ok(())
    });
}

#[test]
fn a_kill_leaves_the_old_content() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    fs::write(&path, "old").unwrap();
    let mut child = Command::new(std::env::current_exe().unwrap())
        .arg("a_writer_that_waits_to_be_killed")
        .env(TO_BE_KILLED, &path)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let started = Instant::now();
    let half = || {
        let entries = fs::read_dir(folder.path()).unwrap().map(Result::unwrap);
        entries
            .filter(|entry| is_unfinished_file_name(&entry.file_name()))
            .any(|entry| entry.metadata().unwrap().len() == 1 << 20)
    };
    while !half() {
        assert!(started.elapsed() < Duration::from_secs(60), "nothing was written");
        std::thread::sleep(Duration::from_millis(10));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
}

/// After a loss of power a name leads to what was forced onto the disk before it was given: the content before the rename, the folder after it. Seen by `strace`, where that is
/// installed.
#[cfg(target_os = "linux")]
#[test]
fn content_is_forced_onto_the_disk_before_its_name_and_the_folder_after_it() {
    let traced = Command::new("strace")
        .args(["-f", "-e", "trace=openat,write,fsync,rename"])
        .arg(std::env::current_exe().unwrap())
        .arg("modes_are_kept_or_as_asked_for")
        .output();
    let Ok(traced) = traced else {
        eprintln!("strace is not installed: the order of system calls is not looked at");
        return;
    };
    let said = String::from_utf8_lossy(&traced.stderr).into_owned();
    let calls: Vec<&str> = said.lines().filter_map(|line| line.split_once("] ").map(|(_, call)| call)).collect();
    let renames: Vec<usize> = (0..calls.len()).filter(|i| calls[*i].starts_with("rename(")).collect();
    assert!(renames.len() >= 7, "{said}");
    for at in renames {
        let before: Vec<&str> = calls[..at].iter().rev().take(2).copied().collect();
        assert!(before[0].starts_with("fsync(") && before[1].starts_with("write("), "{before:?}");
        assert!(calls[at + 1].contains("O_RDONLY") && calls[at + 2].starts_with("fsync("), "{:?}", &calls[at..at + 3]);
    }
}

//! The debug probe, with a script in the place of `probe-rs`.

use crate::elf::{HEADER_AT, flash_contents, version};
use era::flash::probe::{ProbeError, ProbeRs};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// A `probe-rs` that notes what it was told in `calls` and answers as given.
pub fn script(folder: &Path, probes: &str, idcode: &str, header: &[u8], write_status: u8) -> PathBuf {
    let path = folder.join("probe-rs");
    let bytes: Vec<String> = header.iter().map(|byte| format!("{byte:02x}")).collect();
    let script = format!(
        "#!/bin/sh\necho \"$@${{ERA_TOKEN:+ $ERA_TOKEN}}\" >> {}\ncase \"$1 $4\" in\n'list '*) printf '%s\\n' '{probes}';;\n'read b32') echo '{idcode}';;\n\
         'read b8') echo '{}';;\ndownload*) exit {write_status};;\nesac\n",
        folder.join("calls").display(),
        bytes.join(" "),
    );
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

fn program(folder: &Path, probes: &str, idcode: &str, header: &[u8], write_status: u8) -> ProbeRs {
    ProbeRs::new(script(folder, probes, idcode, header, write_status))
}

pub const ONE_PROBE: &str = "The following debug probes were found:\n[0]: STLink V3 -- 0483:374e:0012 (ST-LINK)";

#[test]
fn it_is_asked_for_the_chip_and_the_header_then_told_to_write() {
    let folder = tempfile::tempdir().unwrap();
    let contents = flash_contents(version(3, b"0123abcd"), (1, 2), 5000, 3);
    let probe = program(folder.path(), ONE_PROBE, "20036469", &contents[HEADER_AT..HEADER_AT + 64], 0);
    probe.check_probe_connected().unwrap();
    probe.check_chip().unwrap();
    assert_eq!(probe.read_header_on_board().unwrap().unwrap().firmware, version(3, b"0123abcd"));
    probe.write_and_start_image(Path::new("image.elf")).unwrap();
    let calls = std::fs::read_to_string(folder.path().join("calls")).unwrap();
    let expected = "list\nread --chip STM32G474RETx b32 0xe0042000 1\nread --chip STM32G474RETx b8 0x08001200 64\n\
                    download --chip STM32G474RETx --verify image.elf\nreset --chip STM32G474RETx\n";
    assert_eq!(calls, expected);
}

#[test]
fn what_is_wrong_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let missing = ProbeRs::new(folder.path().join("nothing"));
    assert!(matches!(missing.check_probe_connected(), Err(ProbeError::NotInstalled(_))));

    let none = program(folder.path(), "No debug probes were found.", "", &[], 0);
    assert!(matches!(none.check_probe_connected(), Err(ProbeError::NoProbe)));

    let other = program(folder.path(), ONE_PROBE, "20036468", &[0xFF; 64], 101);
    let error = other.check_chip().unwrap_err().to_string();
    assert!(error.contains("0x468") && error.contains("nothing was changed"), "{error}");
    assert_eq!(other.read_header_on_board().unwrap(), None);
    let error = other.write_and_start_image(Path::new("image.elf")).unwrap_err().to_string();
    assert!(error.contains("download --chip STM32G474RETx") && error.contains("again"), "{error}");
    let calls = std::fs::read_to_string(folder.path().join("calls")).unwrap();
    assert!(!calls.contains("reset"), "started after a failure");

    let mute = program(folder.path(), ONE_PROBE, "", &[], 0);
    assert!(matches!(mute.check_chip(), Err(ProbeError::OtherChip { .. })));
}

/// A program that waits for a probe that never answers is ended, with its name in the error.
#[test]
fn a_program_that_does_not_end_is_ended() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("probe-rs");
    std::fs::write(&path, "#!/bin/sh\nexec sleep 600\n").unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    let hung = ProbeRs::new(&path).with_time_limit(std::time::Duration::from_millis(200));
    let error = hung.check_probe_connected().unwrap_err();
    assert!(matches!(error, ProbeError::Late { .. }) && error.to_string().contains("probe-rs list"), "{error}");
}

//! `era flash` as a user runs it, with a script in the place of `probe-rs`.

use crate::elf::{HEADER_AT, elf_file, flash_contents, version};
use crate::probe::{ONE_PROBE, script};
use crate::support::old_board;
use crate::support::program::{ProgramOutput, build_era_command, run_command};
use era::device::Target;
use era::device::sim::SimBoard;
use era::flash::board::{Board, BoardError};
use era_shared::image::FLASH_START;
use era_shared::protocol::{BoardKind, CURRENT_VERSION};
use std::path::Path;

/// A token for a daemon, which is no concern of `probe-rs`.
const SECRET: &str = "a-secret-of-the-environment";

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// A folder with an image for this board and a `probe-rs` whose board holds `on_board`.
    fn new(on_board: &[u8]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let contents = flash_contents(version(2, b"0123abcd"), (1, CURRENT_VERSION), 5000, 3);
        std::fs::write(folder.path().join("image.elf"), elf_file(&[(FLASH_START, &contents)])).unwrap();
        script(folder.path(), ONE_PROBE, "20036469", on_board, 0);
        Self { folder }
    }

    fn run_era_flash(&self, arguments: &[&str]) -> ProgramOutput {
        let mut command = build_era_command();
        command.env("ERA_TOKEN", SECRET).env("PATH", format!("{}:/usr/bin:/bin", self.folder.path().display()));
        run_command(command.current_dir(self.folder.path()).arg("flash").args(arguments))
    }

    fn calls(&self) -> String {
        let calls = std::fs::read_to_string(self.folder.path().join("calls")).unwrap_or_default();
        assert!(!calls.contains(SECRET), "the token was handed on: {calls}");
        calls
    }
}

#[test]
fn without_a_word_on_the_high_voltage_supply_nothing_is_written() {
    let old = flash_contents(version(1, b"01d01d01"), (1, 1), 5000, 9);
    let bench = Bench::new(&old[HEADER_AT..HEADER_AT + 64]);
    let output = bench.run_era_flash(&["image.elf", "--probe"]);
    let said = &output.error;
    assert_eq!(output.code, Some(2), "{said}");
    assert!(
        said.contains("1.1.2 (commit 01d01d01) at the debug probe; to be replaced by 2.1.2 (commit 0123abcd)"),
        "{said}"
    );
    assert!(said.contains("high-voltage supply") && said.contains("--yes"), "{said}");
    assert!(bench.calls().contains("read") && !bench.calls().contains("download"), "{}", bench.calls());
}

#[test]
fn a_step_back_in_the_protocol_is_refused_before_anything_is_written() {
    let newer = flash_contents(version(1, b"01d01d01"), (1, CURRENT_VERSION + 1), 5000, 9);
    let bench = Bench::new(&newer[HEADER_AT..HEADER_AT + 64]);
    let output = bench.run_era_flash(&["image.elf", "--probe", "--yes"]);
    assert_eq!(output.code, Some(1));
    assert!(output.error.contains("--force"), "{}", output.error);
    assert!(!bench.calls().contains("download"));
}

#[test]
fn what_cannot_be_flashed_is_bad_use() {
    let bench = Bench::new(&[]);
    std::fs::write(bench.folder.path().join("text.elf"), "text").unwrap();
    for (arguments, expected) in [
        (&["text.elf"][..], "not a 32-bit ELF file"),
        (&["missing.elf"], "cargo xtask firmware"),
        (&["image.elf", "--port", "sim"], "only a board can be flashed"),
        (&["image.elf", "--port", "emulated"], "only a board can be flashed"),
        (&["image.elf", "--probe", "--dfu"], "cannot be used with"),
    ] {
        let output = bench.run_era_flash(arguments);
        assert_eq!(output.code, Some(2), "{arguments:?}: {}", output.error);
        assert!(output.error.contains(expected), "{arguments:?}: {}", output.error);
    }
    assert!(Path::new(&bench.folder.path().join("image.elf")).exists() && bench.calls().is_empty());
}

/// A board whose firmware speaks version 1 of the protocol answers with what version 1 has: it is known by that, and gets a new
/// image by the probe.
#[test]
fn a_board_with_firmware_of_version_1_gets_a_new_image() {
    let bench = Bench::new(&SimBoard::ID);
    let port = old_board::behind_a_terminal(old_board::Board::posing_as(BoardKind::Stm32G474, 1, 1));
    let output = bench.run_era_flash(&["image.elf", "--probe", "--yes", "--port", &port]);
    let said = &output.error;
    // What is behind the port does not restart: it still tells its own version, which is none of the image's.
    let from = concat!(env!("CARGO_PKG_VERSION"), " (commit 00000000) at ");
    assert!(said.contains(from) && said.contains("to be replaced by 2.1.2 (commit 0123abcd)"), "{said}");
    assert!(said.contains("the image was written and read back, but the board at"), "{said}");
    assert!(bench.calls().contains("download --chip STM32G474RETx --verify image.elf"), "{said}: {}", bench.calls());
}

/// Over USB it would have to be sent to its bootloader, of which version 1 knows nothing: what helps is told.
#[test]
fn a_board_with_firmware_of_version_1_is_not_sent_to_its_bootloader() {
    let port = old_board::behind_a_terminal(old_board::Board::posing_as(BoardKind::Stm32G474, 1, 1));
    let mut board = Board::open(&Target::Serial(port)).unwrap();
    board.check_idle().unwrap();
    assert_eq!(board.installed_firmware().protocol_current, 1);
    let error = board.enter_bootloader().unwrap_err();
    assert!(matches!(error, BoardError::TooOld(1)) && error.to_string().contains("BOOT0"), "{error}");
}

//! Against the bootloader in memory: the power goes at every single transfer, and the same command again repairs it.

use crate::elf::{flash_contents, version};
use crate::rom::{Rom, Start};
use era::flash::dfuse::{DfuError, Dfuse};
use era::flash::image::Image;
use era::flash::layout::Layout;
use era::flash::program::{ProgramError, ProgramResult, Stage, program_image, read_header_on_board};
use era_shared::image::FLASH_START;

/// Not a whole number of transfers nor of pages.
const LENGTH: usize = 21_003;

fn old() -> Vec<u8> {
    flash_contents(version(1, b"01d01d01"), (1, 1), 30_000, 0x11)
}

fn new() -> Image {
    Image::from_flash(flash_contents(version(2, b"ee33ee33"), (1, 2), LENGTH, 0x22)).unwrap()
}

fn update(rom: &mut Rom, image: &Image) -> Result<ProgramResult, ProgramError> {
    let layout = Layout::parse(&rom.description()).unwrap();
    let mut dfu = Dfuse::open(&mut *rom)?;
    let done = program_image(&mut dfu, &layout, image, |_, _, _| {})?;
    dfu.leave_for_program_at(FLASH_START)?;
    Ok(done)
}

fn holds(rom: &Rom, image: &[u8]) -> bool {
    rom.flash.starts_with(image)
}

#[test]
fn an_update_is_written_and_started() {
    for page_size in [2048, 4096] {
        let (mut rom, image) = (Rom::new(page_size, &old()), new());
        let mut stages = Vec::new();
        let layout = Layout::parse(&rom.description()).unwrap();
        let mut dfu = Dfuse::open(&mut rom).unwrap();
        let before = read_header_on_board(&mut dfu).unwrap().unwrap();
        assert_eq!(before.firmware, version(1, b"01d01d01"));
        let done = program_image(&mut dfu, &layout, &image, |stage, done, total| {
            assert!(done <= total);
            if stages.last() != Some(&stage) {
                stages.push(stage);
            }
        });
        assert_eq!(done, Ok(ProgramResult { first_stage_replaced: false }));
        assert_eq!(read_header_on_board(&mut dfu).unwrap(), Some(image.header));
        dfu.leave_for_program_at(FLASH_START).unwrap();
        assert!(holds(&rom, image.bytes()));
        assert_eq!(rom.left_for, Some(FLASH_START));
        assert_eq!(rom.power_up(), Start::Firmware);
        assert!(stages.starts_with(&[Stage::Verify, Stage::Erase, Stage::Write, Stage::Verify]), "{stages:?}");
        // Only what the image covers, behind the first stage: 21 003 bytes are six blocks of 4 KiB.
        assert_eq!(rom.pages_erased as usize * page_size, 6 * 4096);
    }
}

#[test]
fn a_cut_at_any_transfer_leaves_a_board_that_is_repaired_by_the_same_command() {
    let (image, old) = (new(), old());
    for page_size in [2048, 4096] {
        let mut whole = Rom::new(page_size, &old);
        update(&mut whole, &image).unwrap();
        let (mut kept_old, mut to_bootloader, mut have_new) = (0, 0, 0);
        for cut in 0..whole.transfers {
            let mut rom = Rom::new(page_size, &old);
            rom.cut_after(cut);
            // At the very last transfer the board has already left, whether it says so or not.
            let unnoticed = update(&mut rom, &image).is_ok();
            assert_eq!(unnoticed, cut == whole.transfers - 1, "cut {cut}");
            match rom.power_up() {
                // Never a mixture: what starts is the old firmware or the new one, whole.
                Start::Firmware if holds(&rom, &old) => kept_old += 1,
                Start::Firmware => {
                    assert!(holds(&rom, image.bytes()), "cut {cut}: a half-written firmware would start");
                    have_new += 1;
                }
                Start::Bootloader => to_bootloader += 1,
                Start::Nothing => panic!("cut {cut}: the board does not start"),
            }
            let done = update(&mut rom, &image);
            assert_eq!(done, Ok(ProgramResult { first_stage_replaced: false }), "cut {cut}");
            assert!(holds(&rom, image.bytes()), "cut {cut}");
            assert_eq!(rom.power_up(), Start::Firmware);
        }
        assert!(kept_old > 0 && to_bootloader > 0 && have_new > 0);
        println!(
            "pages of {page_size}: {kept_old} cuts keep the old firmware, {to_bootloader} lead to the bootloader, {have_new} have the new one"
        );
    }
}

#[test]
fn a_new_first_stage_is_the_only_window_without_a_way_back_by_power() {
    // As on a board whose firmware is from before there was a first stage, or which is fresh from the factory.
    let mut other = old();
    other[0x40] ^= 1;
    let image = new();
    for before in [&other[..], &[]] {
        let mut whole = Rom::new(2048, before);
        assert_eq!(update(&mut whole, &image), Ok(ProgramResult { first_stage_replaced: true }));
        let mut stuck = Vec::new();
        for cut in 0..whole.transfers {
            let mut rom = Rom::new(2048, before);
            rom.cut_after(cut);
            let _ = update(&mut rom, &image);
            if rom.power_up() == Start::Nothing && !before.is_empty() {
                stuck.push(cut);
            }
            // With BOOT0 high the bootloader comes up in any case.
            assert!(update(&mut rom, &image).is_ok(), "cut {cut}");
            assert!(holds(&rom, image.bytes()));
        }
        // One stretch: from the erasing of the first page to the writing of its first half, 12 transfers.
        let window = stuck.first().copied().unwrap_or(0)..stuck.last().map_or(0, |last| last + 1);
        assert_eq!(stuck, window.clone().collect::<Vec<_>>());
        assert!(window.len() <= 12, "{window:?}");
    }
}

#[test]
fn a_cable_out_is_reported_with_what_to_do() {
    let mut rom = Rom::new(2048, &old());
    rom.cut_after(40);
    let error = update(&mut rom, &new()).unwrap_err().to_string();
    assert!(
        error.contains("the device is no longer connected") && error.contains("run the same command again"),
        "{error}"
    );
}

#[test]
fn a_worn_byte_is_found_before_the_firmware_can_start() {
    let mut rom = Rom::new(2048, &old());
    let image = new();
    let worn = FLASH_START + 0x3007;
    assert_ne!(image.bytes()[0x3007], 0xFF);
    rom.worn = Some(worn);
    let error = update(&mut rom, &image).unwrap_err();
    assert!(matches!(error, ProgramError::Verify { address, found: 0xFF, .. } if address == worn), "{error:?}");
    assert_eq!(rom.power_up(), Start::Bootloader);
}

#[test]
fn a_protected_chip_says_so_and_is_left_as_it_is() {
    let mut rom = Rom::new(2048, &old());
    rom.protected = true;
    let error = update(&mut rom, &new()).unwrap_err();
    assert!(matches!(error, ProgramError::Dfu(DfuError::Status { status: 11, .. })), "{error:?}");
    assert!(error.to_string().contains("protected"), "{error}");
    assert!(holds(&rom, &old()));
    // It is told again, not something else: the error state was left.
    assert_eq!(update(&mut rom, &new()).unwrap_err(), error);
}

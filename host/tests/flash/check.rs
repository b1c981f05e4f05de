//! Which image may go to which board.

use crate::elf::{flash_contents, version};
use era::flash::check::{CheckError, InstalledFirmware, check_idle, check_image};
use era::flash::image::Image;
use era_shared::protocol::{BoardKind, CURRENT_VERSION};
use era_shared::safety::SafetyState;

fn image(protocol: (u8, u8)) -> Image {
    Image::from_flash(flash_contents(version(1, b"0123abcd"), protocol, 5000, 3)).unwrap()
}

fn make_installed_firmware(board: Option<BoardKind>, protocol_current: u8) -> InstalledFirmware {
    InstalledFirmware { board, firmware: version(9, b"ffffffff"), protocol_current }
}

#[test]
fn only_this_board_gets_it() {
    let header = image((1, CURRENT_VERSION)).header;
    assert_eq!(check_image(&header, None, false), Ok(()));
    // An older version of the firmware is no reason to refuse.
    assert_eq!(
        check_image(&header, Some(&make_installed_firmware(Some(BoardKind::Stm32G474), CURRENT_VERSION)), false),
        Ok(())
    );
    for force in [false, true] {
        let simulated = make_installed_firmware(Some(BoardKind::Simulated), CURRENT_VERSION);
        assert_eq!(check_image(&header, Some(&simulated), force), Err(CheckError::Simulated));
        let unknown = check_image(&header, Some(&make_installed_firmware(None, CURRENT_VERSION)), force);
        assert!(matches!(unknown, Err(CheckError::Board { board: None, .. })));
        let mut foreign = header;
        foreign.board = None;
        assert!(matches!(check_image(&foreign, None, force), Err(CheckError::Board { .. })));
    }
}

#[test]
fn a_step_back_in_the_protocol_needs_force() {
    let header = image((1, CURRENT_VERSION)).header;
    let newer = make_installed_firmware(Some(BoardKind::Stm32G474), CURRENT_VERSION + 1);
    let refused = check_image(&header, Some(&newer), false);
    assert_eq!(refused, Err(CheckError::Downgrade { image: CURRENT_VERSION, board: CURRENT_VERSION + 1 }));
    assert_eq!(check_image(&header, Some(&newer), true), Ok(()));

    let future = image((CURRENT_VERSION + 1, CURRENT_VERSION + 2)).header;
    let error = check_image(&future, None, false).unwrap_err();
    assert!(matches!(error, CheckError::Unspoken { .. }) && error.to_string().contains("update this program"));
    assert_eq!(check_image(&future, None, true), Ok(()));
}

#[test]
fn a_board_that_is_in_use_is_left_alone() {
    for state in SafetyState::ALL {
        let off = matches!(state, SafetyState::Boot | SafetyState::Safe | SafetyState::Fault);
        assert_eq!(check_idle(state).is_ok(), off, "{state:?}");
    }
}

//! Who this board is and why it started.

use crate::image::FIRMWARE;
use crate::{brown_out, fatal, watchdog};
use embassy_stm32::pac::{RCC, RNG};
use embassy_stm32::uid;
use embassy_time::Instant;
use era_shared::board::{BoardInfo, KeptRun};
use era_shared::protocol::{BoardKind, FAILURE_MESSAGE, FaultCode, ResetCause};
use heapless::{String, Vec};

/// Reads of the random number generator's status before giving up: a number takes about 50 of its 48 MHz clocks
/// (RM0440, section 26.3.5), 200 reads of it.
const RANDOM_ATTEMPTS: usize = 10_000;

/// Why the chip last started; forgets it, so that the next start tells its own cause. To be called once, before the
/// clocks are set up.
pub fn take_reset_cause() -> ResetCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    // A watchdog or software reset also pulls the reset pin low, so the pin's flag says least and is asked last.
    if flags.borrstf() {
        ResetCause::PowerOn
    } else if flags.iwdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if flags.lpwrrstf() || flags.oblrstf() {
        ResetCause::Other
    } else if flags.pinrstf() {
        ResetCause::Pin
    } else {
        ResetCause::Other
    }
}

/// What ended the previous run, if the host did not: fault, detail and message. To be called once, at boot.
pub fn take_previous_failure(
    reset_cause: ResetCause,
    was_live: bool,
) -> Option<(FaultCode, u32, String<FAILURE_MESSAGE>)> {
    // Both are called in any case, so that each clears its note.
    let note = fatal::take_failure_note();
    let dipped = brown_out::detect_supply_dip_reset_and_mark_running(reset_cause);
    match note {
        Some(note) => Some(note),
        None if reset_cause == ResetCause::Watchdog => {
            let (missing, text) = watchdog::find_mask_and_names_of_tasks_missing_before_reset();
            Some((FaultCode::Watchdog, missing, text))
        }
        None if dipped => Some((FaultCode::BrownOut, 0, String::new())),
        // The reset pin, a debug probe, or a reset that nobody has asked for.
        None if was_live => Some((FaultCode::ResetWhileLive, 0, String::new())),
        None => None,
    }
}

/// The facts about this board. The channels are added by the board itself.
pub fn build_board_info_without_channels(
    reset_cause: ResetCause,
    previous_failure: Option<(FaultCode, u32, String<FAILURE_MESSAGE>)>,
    kept_before_reset: Option<KeptRun>,
) -> BoardInfo {
    let (fault_before_reset, failure) = match previous_failure {
        Some((code, detail, text)) => (Some((code, detail)), text),
        None => (None, String::new()),
    };
    BoardInfo {
        board: BoardKind::Stm32G474,
        board_id: uid::uid(),
        boot_id: read_random_number().unwrap_or_else(derive_boot_id_without_rng),
        reset_cause,
        image: String::try_from(env!("CARGO_PKG_NAME")).unwrap_or_default(),
        firmware: FIRMWARE,
        channels: Vec::new(),
        fault_before_reset,
        kept_before_reset,
        failure,
    }
}

/// A number from the hardware generator; `None` if it does not deliver.
fn read_random_number() -> Option<u32> {
    RCC.ahb2enr().modify(|w| w.set_rngen(true));
    RNG.cr().modify(|w| w.set_rngen(true));
    let ready = (0..RANDOM_ATTEMPTS).any(|_| RNG.sr().read().drdy());
    let number = RNG.dr().read();
    RNG.cr().modify(|w| w.set_rngen(false));
    RCC.ahb2enr().modify(|w| w.set_rngen(false));
    // 0 is what the generator gives when it has failed (RM0440, section 26.3.3).
    (ready && number != 0).then_some(number)
}

/// A substitute for a random number: differs from board to board and, a little, from start to start.
fn derive_boot_id_without_rng() -> u32 {
    let seed = Instant::now().as_ticks() as u32;
    uid::uid().iter().fold(seed, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

//! Failures of the processor and its firmware, injected while four channels drive: everything off, a restart, and a board
//! that tells why and does not arm until it is told to.

use super::board::EmulatedBoard;
use super::drives::{add_reply_row, make_drive};
use super::expected::{ALL_OFF, describe_timer_enables_output_pins_and_rail_dac_codes};
use super::table::ReportTable;
use super::trips::{
    add_row_of_fault_state_and_latched_fault_code, delay_until_all_off_if_off_by_now_ms,
    heal_faults_and_add_rows_of_rearming, power_up_and_drive,
};
use crate::error::Error;
use era_shared::limits::DISCHARGE_LIMIT_MS;
use era_shared::protocol::{CURRENT_VERSION, FaultCode, MIN_VERSION, Refusal, Reply, Request, ResetCause};
use era_shared::safety::{SafetyEvent, SafetyState};
use serde_json::{Value, json};

/// The way out of a panic or a HardFault begins with the pins, within the first slice of the emulator, 5 us. The note and the reset that come after
/// them would end the windows as well, at the end of the third slice.
const AT_ONCE_MS: f64 = 0.01;
/// The last feed may come after the fault: as late as a task that waits for something else checks in, which is 20 units of 1.024 ms and one
/// more for rounding (21.5 ms). The watchdog's counter then takes up to 109 ms with its oscillator at its slowest.
const WATCHDOG_MS: f64 = 131.0;
/// What is waited for a restart, in s.
const RESTARTED_S: f64 = 0.02;
/// From power-on until the firmware is up, in ms: what USB may wait.
const STARTED_MS: f64 = 20.0;

/// Option bytes as delivered (RM0440, section 3.4.1).
const DELIVERED: u32 = 0xFFEF_F8AA;
/// SRAM_PE (bit 24; section 3.7.8) is active low.
const PARITY_ON: u32 = DELIVERED & !(1 << 24);
/// The part of the stack that the firmware may use, and steps in which words of the rest are looked at, in bytes.
const STACK_IN_USE: u32 = 16 * 1024;
const STACK_STEP: usize = 1_020;
/// After a reset, in ms: the start-up code prepares memory before the firmware's first lines, 0.085 ms here. The trial of the watchdog takes
/// 4 periods of 32 kHz more, 0.125 ms.
const PINS_LOW_MS: f64 = 0.15;
/// The first word of each copy of the run's record ("RARE" in the order of memory).
const RECORD_MAGIC: u32 = 0x4552_4152;
/// The CCM SRAM behind the other memory (RM0440, section 2.2): it has parity, and the stack begins at its end.
const CCM_SRAM: u32 = 0x2001_8000;
/// What memory is filled with: nothing that the firmware writes.
const FILLING: u32 = 0x6B8B_4567;

/// One failure.
struct InjectedFailure {
    name: &'static str,
    /// For `tools/emulator/faults.py`.
    fault: Value,
    code: FaultCode,
    cause: ResetCause,
    limit_ms: f64,
    /// How often the chip is reset: a start with the flag of a power-on tries the watchdog once more.
    resets: usize,
}

/// All of them, each from power-up.
pub fn check_restart_after_injected_processor_failures(board: &mut EmulatedBoard, table: &mut ReportTable) {
    let failure = |name, fault, code, cause, limit_ms| {
        let resets = if cause == ResetCause::PowerOn { 2 } else { 1 };
        InjectedFailure { name, fault, code, cause, limit_ms, resets }
    };
    let handler = |runs: &str, priority: u8| json!({"handler": {"runs": runs, "priority": priority}});
    let failures = [
        failure("panic", handler("_defmt_panic", 0), FaultCode::Panic, ResetCause::Software, AT_ONCE_MS),
        failure(
            "undefined instruction",
            handler("undefined", 0),
            FaultCode::HardFault,
            ResetCause::Software,
            AT_ONCE_MS,
        ),
        failure(
            "non-maskable interrupt",
            handler("NonMaskableInt", 0),
            FaultCode::HardFault,
            ResetCause::Software,
            AT_ONCE_MS,
        ),
        failure(
            "interrupt that nobody has enabled",
            handler("DefaultHandler", 0),
            FaultCode::HardFault,
            ResetCause::Software,
            AT_ONCE_MS,
        ),
        failure("thread mode hangs", handler("loop", 15), FaultCode::Watchdog, ResetCause::Watchdog, WATCHDOG_MS),
        failure("device task hangs", handler("loop", 5), FaultCode::Watchdog, ResetCause::Watchdog, WATCHDOG_MS),
        failure("everything hangs", handler("loop", 0), FaultCode::Watchdog, ResetCause::Watchdog, WATCHDOG_MS),
        failure(
            "time base stops",
            json!({"time_base": "stops"}),
            FaultCode::Watchdog,
            ResetCause::Watchdog,
            WATCHDOG_MS,
        ),
        failure(
            "reset pin while live",
            json!({"reset": "pin"}),
            FaultCode::ResetWhileLive,
            ResetCause::Pin,
            AT_ONCE_MS,
        ),
        failure("brown-out", json!({"reset": "brown_out"}), FaultCode::BrownOut, ResetCause::PowerOn, AT_ONCE_MS),
    ];
    for failure in &failures {
        table.run_part_adding_row_on_error(failure.name, |table| {
            add_rows_of_restart_after_failure(board, table, failure)
        });
    }
    table.run_part_adding_row_on_error("supply sags", |table| add_rows_of_supply_sag(board, table));
    table.run_part_adding_row_on_error("supply sags while safe", |table| {
        add_rows_of_supply_sag_while_safe(board, table)
    });
    table.run_part_adding_row_on_error("reset behind an open divider", |table| {
        add_row_of_discharge_wait_after_reset_with_open_divider(board, table)
    });
    table.run_part_adding_row_on_error("credit over a reset", |table| {
        add_rows_of_drive_time_left_after_reset(board, table)
    });
    table.run_part_adding_row_on_error("start: option bytes", |table| {
        add_rows_of_arming_with_option_bytes(board, table)
    });
    table.run_part_adding_row_on_error("start: SRAM parity", |table| {
        add_rows_of_memory_kept_over_brown_out_with_and_without_parity(board, table)
    });
    table.run_part_adding_row_on_error("start: watchdog tried", |table| {
        add_rows_of_watchdog_self_test_at_start(board, table)
    });
    table.run_part_adding_row_on_error("start: pins", |table| add_row_of_pins_low_while_starting(board, table));
    table.run_part_adding_row_on_error("start: boot id", |table| add_row_of_boot_ids_of_two_starts(board, table));
    for copy in 0..2 {
        let name = format!("reset while copy {} of the run's record is written", copy + 1);
        table.run_part_adding_row_on_error(&name, |table| {
            add_rows_of_reset_while_record_is_written(board, table, &name, copy)
        });
    }
}

/// Nothing but the firmware holds the pins low: they are low from its first lines on, also while the watchdog is tried for 10 ms.
fn add_row_of_pins_low_while_starting(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let high_ms = board.power_cycle_without_pull_downs_and_time_high_pads_ms()?;
    // Above 0: before these lines, the pins do float.
    table.add_time_range_row("start: pads high after a reset", 0.001, PINS_LOW_MS, Some(high_ms));
    Ok(())
}

/// A host tells a board that has started again by its boot id.
fn add_row_of_boot_ids_of_two_starts(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let mut read_boot_id = || -> Result<Option<u32>, Error> {
        board.power_cycle_healing_faults()?;
        Ok(match board.send_request(&Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION })? {
            Reply::Welcome(welcome) => Some(welcome.boot_id),
            _ => None,
        })
    };
    let (first, second) = (read_boot_id()?, read_boot_id()?);
    let differ = first.is_some() && second.is_some() && first != second;
    table.add_row("start: boot ids of two starts", "differ", &format!("{first:?}, {second:?}"), differ);
    Ok(())
}

/// A reset that comes while one copy of the run's record is written spoils it; the other one tells that the board was live.
fn add_rows_of_reset_while_record_is_written(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    copy: usize,
) -> Result<(), Error> {
    power_up_and_drive(board)?;
    let mut copies = Vec::new();
    for address in (board.find_symbol_address("__skept")?..board.find_symbol_address("__ekept")?).step_by(4) {
        // A note of the supply begins with the same word, followed by its complement.
        if board.read_memory_word(address)? == RECORD_MAGIC && board.read_memory_word(address + 4)? != !RECORD_MAGIC {
            copies.push(address);
        }
    }
    table.add_comparison_row(&format!("{name}: copies"), "2", &copies.len().to_string());
    if let Some(address) = copies.get(copy) {
        board.write_memory_word(*address, 0)?;
    }
    board.inject_fault(&json!({"reset": "pin"}))?;
    board.advance_time(RESTARTED_S)?;
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::ResetWhileLive)
}

/// The first start after power-on has itself reset by the watchdog. A board whose watchdog does not do that never arms.
fn add_rows_of_watchdog_self_test_at_start(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "start: watchdog tried";
    let up_ms = board.power_cycle_with_fault_and_time_boot_ms(&json!({}))?;
    table.add_comparison_row(
        name,
        "[\"watchdog\"]",
        &format!("{:?}", board.read_cause_of_each_reset_until_firmware_was_up()?),
    );
    // 4 periods of 32 kHz, and what the firmware does anyway.
    table.add_time_limit_row(&format!("{name}: firmware up"), STARTED_MS, Some(up_ms));
    table.add_comparison_row(&format!("{name}: reset cause in the hello"), "PowerOn", &read_reset_cause(board)?);
    let name = "start: watchdog broken";
    board.power_cycle_with_fault_and_time_boot_ms(&json!({"watchdog": "broken"}))?;
    table.add_comparison_row(name, "[]", &format!("{:?}", board.read_cause_of_each_reset_until_firmware_was_up()?));
    table.add_comparison_row(&format!("{name}: reset cause in the hello"), "PowerOn", &read_reset_cause(board)?);
    add_rows_of_fault_surviving_clear_and_arm(board, table, name, FaultCode::Watchdog, 1_000)?;
    // It resets the chip when it is tried, but then keeps its longest time, 512 ms.
    let name = "start: watchdog keeps its longest time";
    board.power_cycle_with_fault_and_time_boot_ms(&json!({"watchdog": "slow"}))?;
    table.add_comparison_row(
        name,
        "[\"watchdog\"]",
        &format!("{:?}", board.read_cause_of_each_reset_until_firmware_was_up()?),
    );
    add_rows_of_fault_surviving_clear_and_arm(board, table, name, FaultCode::Watchdog, 1_000)
}

/// A divider opens while its rail is at 2 kV, and a reset follows: the rail reads 0 V, which the next start does not take for discharged. It waits for
/// one bleeder alone, which needs 0.95 s from 2 kV to 60 V, and ends before the limit of a discharge.
fn add_row_of_discharge_wait_after_reset_with_open_divider(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
) -> Result<(), Error> {
    let name = "reset behind an open divider";
    power_up_and_drive(board)?;
    board.inject_fault(&json!({"rail_fault": {"rail": 1, "measured_factor": 0.0}}))?;
    board.advance_time(5e-3)?;
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::RailCollapsed)?;
    board.inject_fault(&json!({"reset": "pin"}))?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 2_000)?;
    table.add_time_range_row(&format!("{name}: safe after it"), 900.0, f64::from(DISCHARGE_LIMIT_MS), safe.ok());
    Ok(())
}

/// A drive near the largest force is charged by nearly all the time that passes; a reset does not give that back.
fn add_rows_of_drive_time_left_after_reset(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "credit over a reset";
    add_rows_of_drive_time_left_over_reset_or_brown_out(board, table, name, &json!({}), "pin")
}

/// Drives channel 0 near the largest force for half a second on a board with this defect, and resets it for this cause.
fn add_rows_of_drive_time_left_over_reset_or_brown_out(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    defect: &Value,
    reset: &str,
) -> Result<(), Error> {
    board.power_cycle_with_fault_and_time_boot_ms(defect)?;
    let full = read_drive_time_left_of_each_channel_ms(board)?;
    board.arm_and_wait()?;
    let refused = board.set_drives(&[make_drive(0, 200_000, 900_000, 0, 2_000_000)])?;
    table.add_comparison_row(&format!("{name}: drive set"), "None", &format!("{refused:?}"));
    board.advance_time_with_keep_alives(0.5)?;
    let spent = read_drive_time_left_of_each_channel_ms(board)?;
    board.inject_fault(&json!({"reset": reset}))?;
    board.advance_time(RESTARTED_S)?;
    let after = read_drive_time_left_of_each_channel_ms(board)?;
    let is_kept = match (full.first(), spent.first(), after.first()) {
        // At rest a channel earns less than it spends.
        (Some(full), Some(spent), Some(after)) => spent + 200 < *full && after.abs_diff(*spent) <= 100,
        _ => false,
    };
    let expected = format!("channel 0: before it 200 ms below {full:?} ms, after it within 100 ms of {spent:?} ms");
    table.add_row(&format!("{name}: credit after it"), &expected, &format!("{after:?} ms"), is_kept);
    Ok(())
}

/// The chip's option bytes as it is delivered, and with each setting that takes a protection away.
fn add_rows_of_arming_with_option_bytes(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let wrong = [
        // Bits 17, 18 and 20 of FLASH_OPTR.
        ("start: watchdog stands still in stop mode", DELIVERED & !(1 << 17)),
        ("start: watchdog stands still in standby mode", DELIVERED & !(1 << 18)),
        ("start: boots from bank 2", DELIVERED | 1 << 20),
    ];
    for (name, options) in wrong {
        board.power_cycle_with_fault_and_time_boot_ms(&json!({"option_bytes": options}))?;
        add_rows_of_fault_surviving_clear_and_arm(board, table, name, FaultCode::OptionBytes, options)?;
    }
    // BOR_LEV 4, single bank, other boot settings, a reset pin that is an input only, parity: all of them arm.
    let accepted = [
        ("start: option bytes as delivered", DELIVERED),
        ("start: brown-out level 4", DELIVERED | 4 << 8),
        ("start: single bank", DELIVERED & !(1 << 22)),
        ("start: BOOT0 by option", DELIVERED & !(1 << 26)),
        ("start: reset pin is an input", DELIVERED & !(1 << 29)),
        ("start: SRAM parity on", PARITY_ON),
    ];
    for (name, options) in accepted {
        board.power_cycle_with_fault_and_time_boot_ms(&json!({"option_bytes": options}))?;
        let armed = board.arm_and_wait();
        let seen = armed.as_ref().map_or_else(ToString::to_string, |()| "armed".to_owned());
        table.add_comparison_row(name, "armed", &seen);
    }
    Ok(())
}

/// A fault from the start on that neither a request nor an arming gets rid of.
fn add_rows_of_fault_surviving_clear_and_arm(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    code: FaultCode,
    detail: u32,
) -> Result<(), Error> {
    board.advance_time(RESTARTED_S)?;
    let fault = board.read_latched_fault()?.map(|fault| (fault.code, fault.detail));
    table.add_comparison_row(&format!("{name}: fault"), &format!("{:?}", Some((code, detail))), &format!("{fault:?}"));
    let clear = board.send_request(&Request::ClearFaults)?;
    let still_there = Reply::Refused(Refusal::StillThere(code));
    add_reply_row(clear, still_there, table, &format!("{name}: clear"));
    let arm = board.send_request(&Request::Arm { deadman_ms: None })?;
    let refused = Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm });
    add_reply_row(arm, refused, table, &format!("{name}: arm"));
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    Ok(())
}

/// What the board says of why it last started.
fn read_reset_cause(board: &mut EmulatedBoard) -> Result<String, Error> {
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    Ok(match board.send_request(&hello)? {
        Reply::Welcome(welcome) => format!("{:?}", welcome.reset_cause),
        other => format!("{other:?}"),
    })
}

fn add_rows_of_restart_after_failure(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    failure: &InjectedFailure,
) -> Result<(), Error> {
    let name = failure.name;
    power_up_and_drive(board)?;
    let since = board.read_clock_cycles()?;
    board.inject_fault(&failure.fault)?;
    board.advance_time(failure.limit_ms / 1e3 + RESTARTED_S)?;
    table.add_time_limit_row(
        &format!("{name}: electrodes off"),
        failure.limit_ms,
        delay_until_all_off_if_off_by_now_ms(board, since)?,
    );
    table.add_comparison_row(
        &format!("{name}: restarts"),
        &failure.resets.to_string(),
        &board.read_cause_of_each_reset_after_firmware_was_up()?.len().to_string(),
    );
    add_rows_of_reset_cause_fault_and_rearming_after_restart(board, table, name, failure.code, failure.cause)
}

/// The 3.3 V fall below the voltage detector's threshold and come back.
fn add_rows_of_supply_sag(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "3.3 V sags";
    power_up_and_drive(board)?;
    let since = board.read_clock_cycles()?;
    board.inject_fault(&json!({"pvd": "low"}))?;
    board.advance_time(RESTARTED_S)?;
    table.add_time_limit_row(
        &format!("{name}: electrodes off"),
        AT_ONCE_MS,
        delay_until_all_off_if_off_by_now_ms(board, since)?,
    );
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    board.inject_fault(&json!({"pvd": "ok"}))?;
    board.advance_time(RESTARTED_S)?;
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::BrownOut)?;
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// The same while the board is safe: no timer runs and the interrupt of the breaks is off, so that only the detector's own interrupt tells it.
fn add_rows_of_supply_sag_while_safe(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "3.3 V sags while safe";
    board.power_cycle_healing_faults()?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row(&format!("{name}: safe before"), 100.0, safe.ok());
    board.inject_fault(&json!({"pvd": "low"}))?;
    board.advance_time(2e-3)?;
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::BrownOut)?;
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// With parity, memory whose words were never written cannot be read: the stack's is written first at every power-on. What outlasts resets is
/// where parity does not reach, so that a dip of the supply is told as one with parity, too.
fn add_rows_of_memory_kept_over_brown_out_with_and_without_parity(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
) -> Result<(), Error> {
    for (name, options) in
        [("SRAM parity on, brown-out while live", PARITY_ON), ("SRAM parity off, brown-out while live", DELIVERED)]
    {
        let options = json!({"option_bytes": options});
        add_rows_of_drive_time_left_over_reset_or_brown_out(board, table, name, &options, "brown_out")?;
        add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::BrownOut)?;
        table.add_comparison_row(&format!("{name}: reset cause in the hello"), "PowerOn", &read_reset_cause(board)?);
    }
    for (name, options, reset, is_written) in [
        ("SRAM parity on, brown-out", PARITY_ON, "brown_out", true),
        ("SRAM parity on, option bytes loaded", PARITY_ON, "option_bytes", true),
        ("SRAM parity off, brown-out", DELIVERED, "brown_out", false),
    ] {
        board.power_cycle_with_fault_and_time_boot_ms(&json!({"option_bytes": options}))?;
        // Of the stack some words that are not in use, all of them in the CCM SRAM.
        let stack_top = board.find_symbol_address("_stack_start")?;
        for address in (CCM_SRAM..stack_top - STACK_IN_USE).step_by(STACK_STEP) {
            board.write_memory_word(address, FILLING)?;
        }
        board.inject_fault(&json!({"reset": reset}))?;
        board.advance_time(RESTARTED_S)?;
        let mut kept = 0;
        for address in (CCM_SRAM..stack_top - STACK_IN_USE).step_by(STACK_STEP) {
            kept += usize::from(board.read_memory_word(address)? == FILLING);
        }
        let expected = if is_written { "0" } else { "1 or more" };
        table.add_row(
            &format!("{name}: words of the stack that nobody has written since"),
            expected,
            &kept.to_string(),
            (kept == 0) == is_written,
        );
        let notes = [board.find_symbol_address("__skept")?, board.find_symbol_address("__ekept")?];
        // The first 32 KiB of SRAM1, and the CCM SRAM.
        let is_without_parity = notes[0] >= 0x2000_8000 && notes[1] <= CCM_SRAM;
        let seen = format!("{:#x} to {:#x}", notes[0], notes[1]);
        table.add_row(&format!("{name}: what is kept"), "0x20008000 to 0x20018000", &seen, is_without_parity);
    }
    Ok(())
}

/// What each channel may still drive, in ms.
fn read_drive_time_left_of_each_channel_ms(board: &mut EmulatedBoard) -> Result<Vec<u32>, Error> {
    match board.send_request(&Request::Credit)? {
        Reply::Credit(credit) => Ok(credit.channels.iter().map(|channel| channel.left_ms).collect()),
        other => Err(Error::NoReply(format!("the reply to Credit is {other:?}"))),
    }
}

/// Off, the cause told in the hello, the fault latched, no arming before it is cleared.
fn add_rows_of_reset_cause_fault_and_rearming_after_restart(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    code: FaultCode,
    cause: ResetCause,
) -> Result<(), Error> {
    table.add_comparison_row(
        &format!("{name}: registers after it"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let reply = board.send_request(&hello)?;
    let (seen, message) = match &reply {
        Reply::Welcome(welcome) => (format!("{:?}", welcome.reset_cause), welcome.failure.to_string()),
        other => (format!("{other:?}"), String::new()),
    };
    table.add_comparison_row(&format!("{name}: reset cause in the hello"), &format!("{cause:?}"), &seen);
    // A panic and a HardFault can say where; the others leave what they can.
    if matches!(code, FaultCode::Panic | FaultCode::HardFault) {
        table.add_row(&format!("{name}: message in the hello"), "some", &message, !message.is_empty());
    }
    add_row_of_fault_state_and_latched_fault_code(board, table, name, code)?;
    let arm = board.send_request(&Request::Arm { deadman_ms: None })?;
    let expected = Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm });
    add_reply_row(arm, expected, table, &format!("{name}: arm before clearing"));
    heal_faults_and_add_rows_of_rearming(board, table, name)?;
    // What the failure left is told once: another start while nothing is live is none.
    board.send_request(&Request::Disarm)?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row(&format!("{name}: disarmed, safe"), 100.0, safe.ok());
    board.inject_fault(&json!({"reset": "pin"}))?;
    board.advance_time(RESTARTED_S)?;
    let (seen, message) = match board.send_request(&hello)? {
        Reply::Welcome(welcome) => (format!("{:?}", welcome.reset_cause), welcome.failure.to_string()),
        other => (format!("{other:?}"), String::new()),
    };
    let fault = board.read_latched_fault()?.map(|fault| fault.code);
    table.add_comparison_row(
        &format!("{name}: another start"),
        "Pin, message \"\", fault None",
        &format!("{seen}, message {message:?}, fault {fault:?}"),
    );
    Ok(())
}

//! The permit: what it takes away when the processor hangs, and the break interrupt that works beside it.

use super::board::EmulatedBoard;
use super::expected::{ALL_OFF, describe_timer_enables_output_pins_and_rail_dac_codes};
use super::table::ReportTable;
use super::trips::{delay_until_all_off_if_off_by_now_ms, power_up_and_drive};
use crate::error::Error;
use era_shared::protocol::{FaultCode, Request};
use era_shared::safety::SafetyState;
use serde_json::{Value, json};

/// Break and gates act within a slice of the emulator, 5 us.
const IN_HARDWARE_MS: f64 = 0.02;
/// From the 600 V of the drives to 60 V, 2.26 nF through 1 Mohm take 5.2 ms; and a look.
const DISCHARGED_MS: f64 = 5.5;
/// Steps in which the rails are looked at, in s.
const LOOK_S: f64 = 1e-4;
/// How long the processor has hung before the interlock opens, in s: the watchdog needs 94 ms at least.
const HUNG_S: f64 = 0.01;
/// NVIC_ICER0 and the bit of TIM1_BRK_TIM15, interrupt 24 (RM0440, vector table; PM0214, 4.3).
const NVIC_ICER0: u32 = 0xE000_E180;
const TIM1_BREAK: u32 = 1 << 24;

/// A timer that no break reaches, and the detail of the self-test's fault: the first comparator that is tried, 7, and ten for each timer.
const MISSING_BREAKS: [(&str, &str, u32); 4] = [
    ("arm: break misses TIM1", "TIM1", 17),
    ("arm: break misses TIM8", "TIM8", 27),
    ("arm: break misses TIM20", "TIM20", 37),
    ("arm: break misses TIM16", "TIM16", 47),
];

/// All of it, each from power-up.
pub fn check_permit_line_and_hardware_trips_with_hung_processor(board: &mut EmulatedBoard, table: &mut ReportTable) {
    table
        .run_part_adding_row_on_error("permit", |table| add_row_of_permit_line_at_boot_armed_and_stopped(board, table));
    let (interlock, nothing) = (json!({"interlock": "open"}), json!({}));
    let trips = [
        ("processor hangs, then interlock opened", &nothing, &interlock),
        ("processor hangs, then over-current", &nothing, &json!({"overcurrent_ma": 15})),
        ("processor hangs, then 3.3 V sags", &nothing, &json!({"pvd": "low"})),
        // What MOE switches off is driven low (OSSI) and does not depend on resistors.
        ("processor hangs without pull-downs, then interlock opened", &json!({"pull_downs": "missing"}), &interlock),
    ];
    for (name, before, fault) in trips {
        table.run_part_adding_row_on_error(name, |table| {
            power_up_drive_inject_fault_and_hang_processor(board, before)?;
            add_rows_of_trip_of_hung_board(board, table, name, fault)
        });
    }
    let name = "processor runs astray, then interlock opened";
    table.run_part_adding_row_on_error(name, |table| {
        power_up_drive_inject_fault_and_hang_processor(board, &nothing)?;
        try_to_disable_locked_timer_breaks(board)?;
        add_rows_of_trip_of_hung_board(board, table, name, &interlock)
    });
    let name = "device task hangs, then interlock opened";
    table.run_part_adding_row_on_error(name, |table| add_row_of_break_interrupt_of_hung_device(board, table, name));
    for (name, timer, detail) in MISSING_BREAKS {
        table.run_part_adding_row_on_error(name, |table| {
            add_row_of_self_test_finding_timer_without_break_input(board, table, name, timer, detail)
        });
    }
    let name = "arm: break interrupt disabled in the NVIC";
    table.run_part_adding_row_on_error(name, |table| {
        add_row_of_self_test_finding_disabled_break_interrupt(board, table, name)
    });
}

/// The break interrupt alone switches everything off, set-points too: nobody else does so before the watchdog.
fn add_row_of_break_interrupt_of_hung_device(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
) -> Result<(), Error> {
    power_up_and_drive(board)?;
    board.inject_fault(&json!({"handler": {"runs": "loop", "priority": 5}}))?;
    board.advance_time(1e-3)?;
    board.inject_fault(&json!({"interlock": "open"}))?;
    board.advance_time(1e-3)?;
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    Ok(())
}

/// The line is low unless a rail may be charged.
fn add_row_of_permit_line_at_boot_armed_and_stopped(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    let line = |board: &mut EmulatedBoard| -> Result<Option<bool>, Error> {
        Ok(board.read_pins()?.get("permit").and_then(|pin| pin.high))
    };
    let at_boot = line(board)?;
    board.arm_and_wait()?;
    let armed = line(board)?;
    board.send_request(&Request::Stop)?;
    let stopped = line(board)?;
    let expected = "boot Some(false), armed Some(true), stopped Some(false)";
    table.add_comparison_row(
        "permit's line",
        expected,
        &format!("boot {at_boot:?}, armed {armed:?}, stopped {stopped:?}"),
    );
    Ok(())
}

/// No instruction is carried out any more, at any priority.
fn power_up_drive_inject_fault_and_hang_processor(board: &mut EmulatedBoard, fault: &Value) -> Result<(), Error> {
    power_up_and_drive(board)?;
    board.inject_fault(fault)?;
    board.inject_fault(&json!({"handler": {"runs": "loop", "priority": 0}}))?;
    board.advance_time(HUNG_S)
}

/// Stores of firmware that has run astray, to all that leads a break to a timer's outputs. They are locked (RM0440, 28.6.20, LOCK = 3).
fn try_to_disable_locked_timer_breaks(board: &mut EmulatedBoard) -> Result<(), Error> {
    // TIM1, TIM8, TIM20, TIM16.
    for base in [0x4001_2C00, 0x4001_3400, 0x4001_5000, 0x4001_4400] {
        // AF1: no source. BDTR: MOE (15) and AOE (14) without BKE (12), OSSI (10) and LOCK (9:8).
        board.write_memory_word(base + 0x60, 0)?;
        board.write_memory_word(base + 0x44, 0xC000)?;
    }
    board.advance_time(LOOK_S)
}

/// What switches off does so without the processor, which hangs.
fn add_rows_of_trip_of_hung_board(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    fault: &Value,
) -> Result<(), Error> {
    let live = board.read_set_points_and_rail_voltages()?.rail_volts;
    table.add_row(
        &format!("{name}: rails before"),
        "above 400 V",
        &format!("{:.0} V, {:.0} V", live[0], live[1]),
        live.into_iter().all(|volts| volts > 400.0),
    );
    let resets = board.read_cause_of_each_reset_after_firmware_was_up()?.len();
    let since = board.read_clock_cycles()?;
    board.inject_fault(fault)?;
    let mut discharged_ms = None;
    while discharged_ms.is_none() && board.milliseconds_since(since)? < 2.0 * DISCHARGED_MS {
        board.advance_time(LOOK_S)?;
        let volts = board.read_set_points_and_rail_voltages()?.rail_volts;
        if volts.into_iter().all(|volts| volts < 60.0) {
            discharged_ms = Some(board.milliseconds_since(since)?);
        }
    }
    let electrodes_ms = delay_until_all_off_if_off_by_now_ms(board, since)?;
    table.add_time_limit_row(&format!("{name}: electrodes off"), IN_HARDWARE_MS, electrodes_ms);
    table.add_time_limit_row(&format!("{name}: rails below 60 V"), DISCHARGED_MS, discharged_ms);
    let pins = board.read_pins()?;
    let is_gated_or_timed = |pin: &str| pin.starts_with("era") || pin == "permit";
    let high = pins.iter().filter(|(pin, state)| is_gated_or_timed(pin) && state.pad).map(|(pin, _)| pin.as_str());
    table.add_comparison_row(
        &format!("{name}: pads of electrodes and permit that are high"),
        "",
        &high.collect::<Vec<_>>().join(" "),
    );
    table.add_comparison_row(
        &format!("{name}: no reset meanwhile"),
        &resets.to_string(),
        &board.read_cause_of_each_reset_after_firmware_was_up()?.len().to_string(),
    );
    if let Some(ms) = discharged_ms {
        table.add_figure(&format!("{name}: rails below 60 V"), format!("{ms:.1} ms"));
    }
    Ok(())
}

/// A break that does not reach one of the timers: the self-test tells which.
fn add_row_of_self_test_finding_timer_without_break_input(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    timer: &str,
    detail: u32,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    board
        .await_state_and_measure_ms(SafetyState::Safe, 100)?
        .map_err(|state| Error::NoReply(format!("the state must be safe, but is {}", state.name())))?;
    board.inject_fault(&json!({"break": {"timer": timer, "works": false}}))?;
    board.send_request(&Request::Arm { deadman_ms: None })?;
    let _ = board.await_state_and_measure_ms(SafetyState::Fault, 200)?;
    let seen = board.read_latched_fault()?.map(|fault| (fault.code, fault.detail));
    let expected = Some((FaultCode::SelfTest, detail));
    table.add_comparison_row(name, &format!("{expected:?}"), &format!("{seen:?}"));
    Ok(())
}

/// A break clears the timers' outputs, but its interrupt does not run.
fn add_row_of_self_test_finding_disabled_break_interrupt(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    board
        .await_state_and_measure_ms(SafetyState::Safe, 100)?
        .map_err(|state| Error::NoReply(format!("the state must be safe, but is {}", state.name())))?;
    board.write_memory_word(NVIC_ICER0, TIM1_BREAK)?;
    board.send_request(&Request::Arm { deadman_ms: None })?;
    let _ = board.await_state_and_measure_ms(SafetyState::Fault, 200)?;
    let seen = board.read_latched_fault()?.map(|fault| (fault.code, fault.detail));
    // 4000, and the comparator with which it was tried: 7, the emergency stop.
    let expected = Some((FaultCode::SelfTest, 4_007));
    table.add_comparison_row(name, &format!("{expected:?}"), &format!("{seen:?}"));
    Ok(())
}

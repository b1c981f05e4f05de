//! Faults of the supply, the loops and the timers, injected while four channels drive: who notices, how soon everything is
//! off, and what it takes to go on.

use super::board::{CLOCKS_PER_MS, EmulatedBoard};
use super::drives::{FIRST, add_reply_row};
use super::expected::{ALL_OFF, describe_timer_enables_output_pins_and_rail_dac_codes};
use super::table::ReportTable;
use crate::error::Error;
use era_shared::limits::{DISCHARGE_LIMIT_MS, IMPLAUSIBLE_AFTER_MS};
use era_shared::protocol::{FaultCode, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use serde_json::{Value, json};

/// Hardware switches off within a slice of the emulator (5 us); the interrupt that pulls the pins of the timer without a
/// break low takes a few us more.
const IN_HARDWARE_MS: f64 = 0.02;
/// The device's task looks once a ms, and its look takes a moment.
const AT_NEXT_LOOK_MS: f64 = 2.0;

/// One fault.
struct InjectedTrip {
    name: &'static str,
    /// For `tools/emulator/faults.py`.
    fault: Value,
    code: FaultCode,
    /// When everything must be off, in ms after it.
    limit_ms: f64,
    /// It cannot be cleared while it is there.
    stays: bool,
}

/// All of them, each from power-up.
pub fn check_injected_trips_while_driving_and_at_arming(board: &mut EmulatedBoard, table: &mut ReportTable) {
    for trip in list_trips_while_driving() {
        table.run_part_adding_row_on_error(trip.name, |table| add_rows_of_trip_while_driving(board, table, &trip));
    }
    for (name, fault, code) in list_faults_before_arming() {
        table.run_part_adding_row_on_error(name, |table| add_rows_of_fault_at_arming(board, table, name, &fault, code));
    }
    table.run_part_adding_row_on_error("permit's line stuck high while safe", |table| {
        add_rows_of_stuck_permit_while_safe(board, table)
    });
    table.run_part_adding_row_on_error("rail stays charged", |table| {
        add_rows_of_undischarged_rail_after_stop(board, table)
    });
    let name = "interlock opened while an electrode is tried";
    table.run_part_adding_row_on_error(name, |table| add_rows_of_trip_while_electrode_is_tried(board, table, name));
    for (name, value) in VOLTAGE_DETECTOR_SETTINGS {
        table.run_part_adding_row_on_error(name, |table| {
            add_rows_of_arming_with_changed_voltage_detector(board, table, name, value)
        });
    }
    for register in &CHANGED_REGISTERS {
        table.run_part_adding_row_on_error(register.name, |table| add_rows_of_changed_register(board, table, register));
    }
}

fn list_trips_while_driving() -> Vec<InjectedTrip> {
    let trip = |name, fault, code, limit_ms, stays| InjectedTrip { name, fault, code, limit_ms, stays };
    let after = |ms: u32| f64::from(ms) + AT_NEXT_LOOK_MS;
    vec![
        trip("interlock opened", json!({"interlock": "open"}), FaultCode::InterlockOpen, IN_HARDWARE_MS, true),
        trip("emergency stop", json!({"estop": "pressed"}), FaultCode::EmergencyStop, IN_HARDWARE_MS, true),
        trip(
            "interlock loop shorted",
            json!({"interlock": "shorted"}),
            FaultCode::InterlockOpen,
            AT_NEXT_LOOK_MS,
            true,
        ),
        trip(
            "emergency stop loop shorted",
            json!({"estop": "shorted"}),
            FaultCode::EmergencyStop,
            AT_NEXT_LOOK_MS,
            true,
        ),
        trip("over-current, 15 mA", json!({"overcurrent_ma": 15}), FaultCode::OverCurrent, IN_HARDWARE_MS, false),
        trip(
            "over-voltage, rail 1",
            json!({"rail_fault": {"rail": 1, "volts": 2150}}),
            FaultCode::OverVoltage,
            IN_HARDWARE_MS,
            true,
        ),
        trip(
            "over-voltage, rail 2",
            json!({"rail_fault": {"rail": 2, "volts": 2150}}),
            FaultCode::OverVoltage,
            IN_HARDWARE_MS,
            true,
        ),
        trip(
            "average current, 0.8 mA",
            json!({"average_ma": 0.8}),
            FaultCode::OverCurrent,
            // A mean over 8.2 ms reaches 0.7 mA from 0 after 8.2 ms ln(0.8 / 0.1); the converter's own mean is complete after a ms.
            17.1 + 1.0,
            false,
        ),
        trip(
            "average current not measured",
            json!({"average": "stops"}),
            FaultCode::OverCurrent,
            // It counts as 2 mA: 8.2 ms ln(2 / 1.3). The last result may be read a ms after it was there, and is believed for 3 ms.
            3.6 + 1.0 + 3.0,
            false,
        ),
        trip("earth bond open", json!({"earth": "open"}), FaultCode::EarthOpen, AT_NEXT_LOOK_MS, true),
        trip(
            "rail 20 % low",
            json!({"rail_fault": {"rail": 2, "factor": 0.8}}),
            FaultCode::RailImplausible,
            // It sags with the supply's time constant, 2 ms.
            after(IMPLAUSIBLE_AFTER_MS) + 5.0,
            false,
        ),
        trip(
            "rail collapses",
            json!({"rail_fault": {"rail": 1, "volts": 100}}),
            FaultCode::RailCollapsed,
            AT_NEXT_LOOK_MS,
            true,
        ),
        trip(
            "3.3 V is 4 % high",
            json!({"reference": 1.04}),
            FaultCode::Reference,
            // It must last for 5 ms.
            5.0 + AT_NEXT_LOOK_MS,
            true,
        ),
        trip("watchdog's clock 30 % fast", json!({"lsi": 1.3}), FaultCode::Clock, 5.0 + AT_NEXT_LOOK_MS, true),
        trip("watchdog's clock 30 % slow", json!({"lsi": 0.7}), FaultCode::Clock, 5.0 + AT_NEXT_LOOK_MS, true),
        trip("watchdog's clock stops", json!({"lsi": 0}), FaultCode::Clock, 5.0 + AT_NEXT_LOOK_MS, true),
        trip(
            "permit's line stuck low",
            json!({"pin": {"name": "permit", "stuck": false}}),
            FaultCode::Permit,
            AT_NEXT_LOOK_MS,
            false,
        ),
        trip(
            "timer stands still",
            json!({"stall": {"timer": "TIM20"}}),
            FaultCode::TimerStopped,
            AT_NEXT_LOOK_MS,
            false,
        ),
        // The one that has no break.
        trip(
            "timer 4 stands still",
            json!({"stall": {"timer": "TIM4"}}),
            FaultCode::TimerStopped,
            AT_NEXT_LOOK_MS,
            false,
        ),
    ]
}

fn list_faults_before_arming() -> Vec<(&'static str, Value, FaultCode)> {
    vec![
        ("arm: interlock open", json!({"interlock": "open"}), FaultCode::InterlockOpen),
        ("arm: emergency stop pressed", json!({"estop": "pressed"}), FaultCode::EmergencyStop),
        ("arm: interlock loop shorted", json!({"interlock": "shorted"}), FaultCode::InterlockOpen),
        ("arm: emergency stop loop shorted", json!({"estop": "shorted"}), FaultCode::EmergencyStop),
        ("arm: earth bond open", json!({"earth": "open"}), FaultCode::EarthOpen),
        ("arm: rail shorted", json!({"rail_fault": {"rail": 2, "volts": 0}}), FaultCode::ShortCircuit),
        ("arm: current at test voltage", json!({"average_ma": 1.0}), FaultCode::ShortCircuit),
        ("arm: average current not measured", json!({"average": "stops"}), FaultCode::ShortCircuit),
        (
            "arm: dead over-voltage comparator",
            json!({"comparator": {"number": 3, "stuck": false}}),
            FaultCode::SelfTest,
        ),
        (
            "arm: dead over-current comparator",
            json!({"comparator": {"number": 4, "stuck": false}}),
            FaultCode::SelfTest,
        ),
        ("arm: measurements of the rails exchanged", json!({"measurements": "crossed"}), FaultCode::SelfTest),
        ("arm: supply cannot be disabled", json!({"enable": "stuck"}), FaultCode::SelfTest),
        ("arm: permit's line stuck low", json!({"pin": {"name": "permit", "stuck": false}}), FaultCode::Permit),
        ("arm: permit's line stuck high", json!({"pin": {"name": "permit", "stuck": true}}), FaultCode::Permit),
        ("arm: gates do not follow the permit", json!({"permit": "ignored"}), FaultCode::Permit),
        // The discharge switches close, and the supply goes on against them.
        (
            "arm: gate of the supply does not follow the permit",
            json!({"permit": "ignored_by_enable"}),
            FaultCode::Permit,
        ),
        // Of one port, and of one ERA; then of two.
        ("arm: electrodes' pads of an ERA touch", json!({"joined": ["era1_a", "era1_b"]}), FaultCode::ArmFailed),
        ("arm: electrodes' pads of two ERAs touch", json!({"joined": ["era1_a", "era2_b"]}), FaultCode::ArmFailed),
        ("arm: electrode's pad stuck low", json!({"pin": {"name": "era3_b", "stuck": false}}), FaultCode::ArmFailed),
        ("arm: electrode's pad stuck high", json!({"pin": {"name": "era4_a", "stuck": true}}), FaultCode::ArmFailed),
        (
            "arm: enable's pad stuck high",
            json!({"pin": {"name": "high_voltage_enable", "stuck": true}}),
            FaultCode::ArmFailed,
        ),
        ("arm: discharge switches stay open", json!({"discharge": "fails"}), FaultCode::DischargeSlow),
        (
            "arm: lines of the discharge switches stuck open",
            json!({"discharge": "line_open"}),
            FaultCode::DischargeSlow,
        ),
        ("arm: electrode open", make_electrode_fault_json(1, "a", "open"), FaultCode::Electrode),
        ("arm: electrode shorted", make_electrode_fault_json(4, "b", "shorted"), FaultCode::Electrode),
        ("arm: lower switch open", make_electrode_fault_json(2, "b", "lower_open"), FaultCode::Electrode),
        ("arm: lower switch always closed", make_electrode_fault_json(3, "a", "lower_stuck"), FaultCode::Electrode),
        ("arm: 3.3 V is 4 % low", json!({"reference": 0.96}), FaultCode::Reference),
        ("arm: dead interlock comparator", json!({"comparator": {"number": 5, "stuck": false}}), FaultCode::SelfTest),
        // At 3.3 V it never trips by its input, and does with its polarity inverted.
        (
            "arm: input of the interlock comparator not connected",
            json!({"comparator_in": {"number": 5, "volts": 3.3}}),
            FaultCode::SelfTest,
        ),
        (
            "arm: input of the emergency stop comparator not connected",
            json!({"comparator_in": {"number": 7, "volts": 3.3}}),
            FaultCode::SelfTest,
        ),
        // At 0 V it never sees its rail, and at 0.1 V, which is a rail of 76 V, it sees one that is discharged.
        (
            "arm: input of the over-voltage comparator of rail 2 not connected",
            json!({"comparator_in": {"number": 1, "volts": 0.0}}),
            FaultCode::SelfTest,
        ),
        (
            "arm: input of the over-voltage comparator of rail 1 not connected",
            json!({"comparator_in": {"number": 3, "volts": 0.0}}),
            FaultCode::SelfTest,
        ),
        (
            "arm: over-voltage comparator of rail 1 sees a voltage that is not its rail's",
            json!({"comparator_in": {"number": 3, "volts": 0.1}}),
            FaultCode::SelfTest,
        ),
        // The resistors behind electrodes are 5 % high and their rails have 20 % more capacitance: a short draws them down least.
        (
            "arm: electrode shorted, parts at their tolerances",
            json!({"tolerances": {"rail_farads": 1.2, "electrode_ohms": 1.05}, "electrode": {"era": 2, "electrode": "a", "is": "shorted"}}),
            FaultCode::Electrode,
        ),
        (
            "arm: lower switch always closed, parts at their tolerances",
            json!({"tolerances": {"rail_farads": 1.2, "electrode_ohms": 1.05}, "electrode": {"era": 1, "electrode": "b", "is": "lower_stuck"}}),
            FaultCode::Electrode,
        ),
    ]
}

/// One electrode of one ERA, counted from 1, is broken.
pub fn make_electrode_fault_json(era: u32, electrode: &str, defect: &str) -> Value {
    json!({"electrode": {"era": era, "electrode": electrode, "is": defect}})
}

/// From power-up to four channels driving.
///
/// # Errors
/// If the board does not come to that.
pub fn power_up_and_drive(board: &mut EmulatedBoard) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    board.arm_and_wait()?;
    if let Some(refusal) = board.set_drives(&FIRST)? {
        return Err(Error::NoReply(format!("the drives were refused: {refusal:?}")));
    }
    board.advance_time_with_keep_alives(0.1)?;
    board.update_pin_edges_until_now()
}

/// When the last electrode went off, in ms after `since_clock`.
///
/// # Errors
/// If the board does not answer.
pub fn delay_until_all_off_if_off_by_now_ms(board: &mut EmulatedBoard, since_clock: u64) -> Result<Option<f64>, Error> {
    board.update_pin_edges_until_now()?;
    Ok(board.edges.all_off_since_clock().map(|off| off.saturating_sub(since_clock) as f64 / CLOCKS_PER_MS))
}

fn add_rows_of_trip_while_driving(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    trip: &InjectedTrip,
) -> Result<(), Error> {
    power_up_and_drive(board)?;
    let name = trip.name;
    let since = board.read_clock_cycles()?;
    board.inject_fault(&trip.fault)?;
    board.advance_time(trip.limit_ms / 1e3 + 5e-3)?;
    let off = delay_until_all_off_if_off_by_now_ms(board, since)?;
    table.add_time_limit_row(&format!("{name}: electrodes off"), trip.limit_ms, off);
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    add_row_of_fault_state_and_latched_fault_code(board, table, name, trip.code)?;
    if trip.stays {
        let reply = board.send_request(&Request::ClearFaults)?;
        add_reply_row(
            reply,
            Reply::Refused(Refusal::StillThere(trip.code)),
            table,
            &format!("{name}: clear too early"),
        );
    }
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// The latched fault, whatever its detail.
///
/// # Errors
/// If the board does not answer.
pub fn add_row_of_fault_state_and_latched_fault_code(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    code: FaultCode,
) -> Result<(), Error> {
    let status = board.read_status()?;
    let seen = status.fault.map_or("none", |fault| fault.code.name());
    let told = |state: SafetyState, fault: &str| format!("state {}, fault {fault}", state.name());
    table.add_comparison_row(
        &format!("{name}: fault"),
        &told(SafetyState::Fault, code.name()),
        &told(status.state, seen),
    );
    Ok(())
}

/// The cause goes away: cleared, safe, and armed again.
///
/// # Errors
/// If the board does not answer or does not come to that.
pub fn heal_faults_and_add_rows_of_rearming(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
) -> Result<(), Error> {
    board.inject_fault(&json!({"heal": true}))?;
    board.advance_time(0.1)?;
    add_reply_row(board.send_request(&Request::ClearFaults)?, Reply::FaultsCleared, table, &format!("{name}: clear"));
    let armed = board.arm_and_wait();
    let seen = armed.as_ref().map_or_else(ToString::to_string, |()| "armed".to_owned());
    table.add_comparison_row(&format!("{name}: arm again"), "armed", &seen);
    Ok(())
}

fn add_rows_of_fault_at_arming(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    fault: &Value,
    code: FaultCode,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    board
        .await_state_and_measure_ms(SafetyState::Safe, 100)?
        .map_err(|state| Error::NoReply(format!("the state must be safe, but is {}", state.name())))?;
    board.inject_fault(fault)?;
    let reply = board.send_request(&Request::Arm { deadman_ms: None })?;
    let fails = board.await_state_and_measure_ms(SafetyState::Fault, 200)?;
    table.add_row(
        &format!("{name}: refused"),
        "the self-test fails within 200 ms",
        &fails.map_or_else(|state| format!("{reply:?}, then {}", state.name()), |ms| format!("after {ms:.1} ms")),
        fails.is_ok(),
    );
    add_row_of_fault_state_and_latched_fault_code(board, table, name, code)?;
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// A line that gives the permit although nobody has: noticed without an arming.
fn add_rows_of_stuck_permit_while_safe(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "permit's line stuck high while safe";
    board.power_cycle_healing_faults()?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row(&format!("{name}: safe before"), 100.0, safe.ok());
    board.inject_fault(&json!({"pin": {"name": "permit", "stuck": true}}))?;
    board.advance_time(AT_NEXT_LOOK_MS / 1e3)?;
    // 1: the line is high without the permit (docs/src/troubleshooting.md).
    let fault = board.read_latched_fault()?.map(|fault| (fault.code, fault.detail));
    let expected = Some((FaultCode::Permit, 1));
    table.add_comparison_row(&format!("{name}: fault"), &format!("{expected:?}"), &format!("{fault:?}"));
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// The discharge switch and the bleeder fail: nothing may call the board safe.
fn add_rows_of_undischarged_rail_after_stop(board: &mut EmulatedBoard, table: &mut ReportTable) -> Result<(), Error> {
    let name = "rail stays charged after stop";
    power_up_and_drive(board)?;
    board.inject_fault(&json!({"discharge": "fails", "rail_fault": {"rail": 1, "volts": 500}}))?;
    add_reply_row(board.send_request(&Request::Stop)?, Reply::Stopped, table, &format!("{name}: stop"));
    let status = board.read_status()?.state;
    table.add_comparison_row(&format!("{name}: state"), SafetyState::Discharging.name(), status.name());
    let took = board.await_state_and_measure_ms(SafetyState::Fault, 2 * DISCHARGE_LIMIT_MS)?;
    // 1 ms of contact, 9.5 ms through 1 Mohm with tolerances, 0.5 ms of filter, a ms until the next look; then the question that finds it.
    table.add_time_limit_row(&format!("{name}: noticed"), 25.0, took.ok());
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::DischargeSlow)?;
    let reply = board.send_request(&Request::ClearFaults)?;
    let expected = Reply::Refused(Refusal::StillThere(FaultCode::DischargeSlow));
    add_reply_row(reply, expected, table, &format!("{name}: clear too early"));
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// The self-test makes four pulses on each electrode: a trip in the first one ends all of them.
fn add_rows_of_trip_while_electrode_is_tried(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row(&format!("{name}: safe before"), 100.0, safe.ok());
    board.send_request(&Request::Arm { deadman_ms: Some(1_000) })?;
    let is_any_high = |board: &mut EmulatedBoard| -> Result<bool, Error> {
        board.advance_time(5e-5)?;
        Ok(board.read_pins()?.iter().any(|(pin, state)| pin.starts_with("era") && state.pad))
    };
    let begins = (0..4_000).try_fold(false, |begun, _| Ok::<_, Error>(begun || is_any_high(board)?))?;
    table.add_comparison_row(&format!("{name}: pulses begin"), "true", &begins.to_string());
    board.inject_fault(&json!({"interlock": "open"}))?;
    let pulses = (0..200).try_fold(0, |count, _| Ok::<_, Error>(count + u32::from(is_any_high(board)?)))?;
    table.add_comparison_row(&format!("{name}: looks at an electrode that is high after it"), "0", &pulses.to_string());
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::InterlockOpen)?;
    heal_faults_and_add_rows_of_rearming(board, table, name)
}

/// PWR_CR2 with PVDE (0) clear, and with the lowest level in PLS (3:1), in place of 0xD (RM0440, section 6.4.2).
const VOLTAGE_DETECTOR_SETTINGS: [(&str, u32); 2] =
    [("arm: voltage detector off", 0xC), ("arm: voltage detector at its lowest level", 0x1)];

/// The voltage detector has lost its settings while the board is safe: the self-test does not pass.
fn add_rows_of_arming_with_changed_voltage_detector(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
    value: u32,
) -> Result<(), Error> {
    board.power_cycle_healing_faults()?;
    let safe = board.await_state_and_measure_ms(SafetyState::Safe, 100)?;
    table.add_time_limit_row(&format!("{name}: safe before"), 100.0, safe.ok());
    board.inject_fault(&json!({"register": {"address": 0x4000_7004, "value": value}}))?;
    board.send_request(&Request::Arm { deadman_ms: None })?;
    let fails = board.await_state_and_measure_ms(SafetyState::Fault, 200)?;
    table.add_time_limit_row(&format!("{name}: refused"), 200.0, fails.ok());
    add_row_of_fault_state_and_latched_fault_code(board, table, name, FaultCode::SelfTest)
}

/// A register that protects and changes by itself, although it is locked or written once.
struct ChangedRegister {
    name: &'static str,
    address: u32,
    value: u32,
    /// What finds it while the board drives.
    found_by: FaultCode,
    /// What finds it when the board is armed again: compare modes are read, comparators and breaks are made to trip.
    found_by_arming: FaultCode,
    /// Whether it is looked at in every state, so that the fault cannot be cleared.
    is_standing: bool,
}

const fn new_changed_register(name: &'static str, address: u32, value: u32) -> ChangedRegister {
    ChangedRegister {
        name,
        address,
        value,
        found_by: FaultCode::ReadBack,
        found_by_arming: FaultCode::SelfTest,
        is_standing: false,
    }
}

/// ADC_CR of a converter with ADVREGEN alone. What it measures counts as unknown, which is neither a closed loop nor an open one.
const fn new_changed_register_disabling_adc(name: &'static str, address: u32) -> ChangedRegister {
    ChangedRegister {
        found_by: FaultCode::InterlockOpen,
        found_by_arming: FaultCode::InterlockOpen,
        is_standing: true,
        ..new_changed_register(name, address, 1 << 28)
    }
}

/// One of each kind, addresses by RM0440. All but the converters are in the table of settings that are read after boot.
const CHANGED_REGISTERS: [ChangedRegister; 19] = [
    // TIM2_PSC: time runs at 170/171 of its rate.
    ChangedRegister {
        found_by_arming: FaultCode::ReadBack,
        is_standing: true,
        ..new_changed_register("rate of the board's time changed (TIM2_PSC)", 0x4000_0028, 170)
    },
    // TIM1_CCMR1: outputs frozen.
    ChangedRegister {
        found_by_arming: FaultCode::ReadBack,
        ..new_changed_register("compare mode changed", 0x4001_2C18, 0)
    },
    // TIM4_CCMR1, of the timer that has no break.
    ChangedRegister {
        found_by_arming: FaultCode::ReadBack,
        ..new_changed_register("compare mode of TIM4 changed", 0x4000_0818, 0)
    },
    // TIM4_AF2: the current's comparator does not clear its outputs.
    ChangedRegister {
        found_by_arming: FaultCode::ReadBack,
        ..new_changed_register("TIM4 not cleared by the comparator of the current (AF2)", 0x4000_0864, 0)
    },
    new_changed_register("break of TIM8 without comparators (AF1)", 0x4001_3460, 0),
    new_changed_register("permit without comparators (TIM16_AF1)", 0x4001_4460, 0),
    // Without BKE; MOE is set, so that it does not show.
    new_changed_register("break of TIM8 disabled (BDTR)", 0x4001_3444, 0xAF00),
    new_changed_register("break of the permit disabled (TIM16_BDTR)", 0x4001_4444, 0xAF00),
    new_changed_register("comparator of the current off (COMP4_CSR)", 0x4001_020C, 0),
    new_changed_register("comparator of rail 2 off (COMP1_CSR)", 0x4001_0200, 0),
    // To full scale: 2500 V, and 20 mA.
    new_changed_register("over-voltage threshold raised (DAC3)", 0x5000_1008, 4095),
    new_changed_register("over-current threshold raised (DAC3)", 0x5000_1014, 4095),
    // MODE2: to a pin that there is not, so that the comparator of the current has no threshold; then EN2.
    new_changed_register("over-current threshold not connected (DAC3_MCR)", 0x5000_103C, 0x0000_8003),
    new_changed_register("over-current threshold not enabled (DAC3_CR)", 0x5000_1000, 0x0000_0001),
    new_changed_register("threshold of the loops lowered (DAC4)", 0x5000_1408, 0),
    new_changed_register("threshold of the loops not connected (DAC4_MCR)", 0x5000_143C, 0x0003_8000),
    new_changed_register_disabling_adc("converter of the rails off (ADC1_CR)", 0x5000_0008),
    new_changed_register_disabling_adc("converter of the interlock off (ADC3_CR)", 0x5000_0408),
    new_changed_register_disabling_adc("converter of the emergency stop off (ADC4_CR)", 0x5000_0508),
];

fn add_rows_of_changed_register(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    &ChangedRegister { name, address, value, found_by, found_by_arming, is_standing }: &ChangedRegister,
) -> Result<(), Error> {
    power_up_and_drive(board)?;
    let since = board.read_clock_cycles()?;
    board.inject_fault(&json!({"register": {"address": address, "value": value}}))?;
    board.advance_time(5e-3)?;
    let pins = board.read_pins()?;
    let low = pins.iter().filter(|(pin, state)| pin.starts_with("era") && state.high == Some(false)).count();
    let took = board.milliseconds_since(since)?;
    table.add_row(&format!("{name}: electrodes low"), "8 within 5 ms", &format!("{low} after {took:.1} ms"), low == 8);
    table.add_comparison_row(
        &format!("{name}: registers"),
        ALL_OFF,
        &describe_timer_enables_output_pins_and_rail_dac_codes(board)?,
    );
    add_row_of_fault_state_and_latched_fault_code(board, table, name, found_by)?;
    if found_by == FaultCode::InterlockOpen {
        add_row_of_rails_reported_as_unmeasured_in_details(board, table, name)?;
    }
    // Modes are written at boot and locked: clearing the fault does not mend them, a restart does.
    let cleared = if is_standing { Reply::Refused(Refusal::StillThere(found_by)) } else { Reply::FaultsCleared };
    add_reply_row(board.send_request(&Request::ClearFaults)?, cleared, table, &format!("{name}: clear"));
    let again = board.arm_and_wait();
    let fault = board.read_latched_fault()?.map(|fault| fault.code);
    let seen = format!("armed {}, fault {fault:?}", again.is_ok());
    let expected = format!("armed false, fault Some({found_by_arming:?})");
    table.add_comparison_row(&format!("{name}: arm again"), &expected, &seen);
    board.power_cycle_healing_faults()?;
    let armed = board.arm_and_wait();
    let seen = armed.as_ref().map_or_else(ToString::to_string, |()| "armed".to_owned());
    table.add_comparison_row(&format!("{name}: arm after power-up"), "armed", &seen);
    Ok(())
}

/// What is not measured shows as more than any rail can have, not as a rail that is discharged.
fn add_row_of_rails_reported_as_unmeasured_in_details(
    board: &mut EmulatedBoard,
    table: &mut ReportTable,
    name: &str,
) -> Result<(), Error> {
    let seen = match board.send_request(&Request::Details)? {
        Reply::Details(details) => format!("{:?} mV", details.rail_millivolts),
        other => format!("{other:?}"),
    };
    table.add_comparison_row(&format!("{name}: rails in the details"), "[4294967295, 4294967295] mV", &seen);
    Ok(())
}

//! Faults of the supply, the loops and the timers, injected while four channels drive: who notices, how soon everything is
//! off, and what it takes to go on.

use super::bench::{Bench, CLOCKS_PER_MS};
use super::drives::{FIRST, show};
use super::expected::{ALL_OFF, off_as_seen};
use super::table::Table;
use crate::error::Error;
use era_shared::limits::{DISCHARGE_LIMIT_MS, IMPLAUSIBLE_AFTER_MS, OVER_CURRENT_AFTER_MS};
use era_shared::protocol::{FaultCode, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use serde_json::{Value, json};

/// Hardware switches off within a slice of the emulator (5 us); the interrupt that pulls the pins of the timer without a
/// break low takes a few us more.
const IN_HARDWARE_MS: f64 = 0.02;
/// The device's task looks once a ms, and its look takes a moment.
const AT_NEXT_LOOK_MS: f64 = 2.0;

/// One fault.
struct Trip {
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
pub fn steps(bench: &mut Bench, table: &mut Table) {
    for trip in while_driving() {
        table.part(trip.name, |table| driving(bench, table, &trip));
    }
    for (name, fault, code) in before_arming() {
        table.part(name, |table| arming(bench, table, name, &fault, code));
    }
    table.part("rail stays charged", |table| stays_charged(bench, table));
    table.part("register changed", |table| register_changed(bench, table));
}

fn while_driving() -> Vec<Trip> {
    let trip = |name, fault, code, limit_ms, stays| Trip { name, fault, code, limit_ms, stays };
    let after = |ms: u32| f64::from(ms) + AT_NEXT_LOOK_MS;
    vec![
        trip("interlock opened", json!({"interlock": "open"}), FaultCode::InterlockOpen, IN_HARDWARE_MS, true),
        trip("emergency stop", json!({"estop": "pressed"}), FaultCode::EmergencyStop, IN_HARDWARE_MS, true),
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
            after(OVER_CURRENT_AFTER_MS),
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
            "timer stands still",
            json!({"stall": {"timer": "TIM20"}}),
            FaultCode::TimerStopped,
            AT_NEXT_LOOK_MS,
            false,
        ),
    ]
}

fn before_arming() -> Vec<(&'static str, Value, FaultCode)> {
    vec![
        ("arm: interlock open", json!({"interlock": "open"}), FaultCode::InterlockOpen),
        ("arm: emergency stop pressed", json!({"estop": "pressed"}), FaultCode::EmergencyStop),
        ("arm: earth bond open", json!({"earth": "open"}), FaultCode::EarthOpen),
        ("arm: rail shorted", json!({"rail_fault": {"rail": 2, "volts": 0}}), FaultCode::ShortCircuit),
        ("arm: current at test voltage", json!({"average_ma": 1.0}), FaultCode::ShortCircuit),
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
        ("arm: dead interlock comparator", json!({"comparator": {"number": 5, "stuck": false}}), FaultCode::SelfTest),
    ]
}

/// From power-up to four channels driving.
///
/// # Errors
/// If the board does not come to that.
pub fn bring_up(bench: &mut Bench) -> Result<(), Error> {
    bench.restart()?;
    bench.arm()?;
    if let Some(refusal) = bench.drive(&FIRST)? {
        return Err(Error::NoReply(format!("drives: {refusal:?}")));
    }
    bench.keep_alive(0.1)?;
    bench.follow_edges()
}

/// When the last electrode went off, in ms after `since`.
///
/// # Errors
/// If the board does not answer.
pub fn off_after(bench: &mut Bench, since: u64) -> Result<Option<f64>, Error> {
    bench.follow_edges()?;
    Ok(bench.edges.all_off_since().map(|off| off.saturating_sub(since) as f64 / CLOCKS_PER_MS))
}

fn driving(bench: &mut Bench, table: &mut Table, trip: &Trip) -> Result<(), Error> {
    bring_up(bench)?;
    let name = trip.name;
    let since = bench.clock()?;
    bench.inject(&trip.fault)?;
    bench.run(trip.limit_ms / 1e3 + 5e-3)?;
    let off = off_after(bench, since)?;
    table.within(&format!("{name}: electrodes off"), trip.limit_ms, off);
    table.same(&format!("{name}: registers"), ALL_OFF, &off_as_seen(bench)?);
    expect_fault(bench, table, name, trip.code)?;
    if trip.stays {
        let reply = bench.request(&Request::ClearFaults)?;
        show(reply, Reply::Refused(Refusal::StillThere(trip.code)), table, &format!("{name}: clear too early"));
    }
    recover(bench, table, name)
}

/// The latched fault, whatever its detail.
///
/// # Errors
/// If the board does not answer.
pub fn expect_fault(bench: &mut Bench, table: &mut Table, name: &str, code: FaultCode) -> Result<(), Error> {
    let status = bench.status()?;
    let seen = status.fault.map_or("none", |fault| fault.code.name());
    let told = |state: SafetyState, fault: &str| format!("state {}, fault {fault}", state.name());
    table.same(&format!("{name}: fault"), &told(SafetyState::Fault, code.name()), &told(status.state, seen));
    Ok(())
}

/// The cause goes away: cleared, safe, and armed again.
///
/// # Errors
/// If the board does not answer or does not come to that.
pub fn recover(bench: &mut Bench, table: &mut Table, name: &str) -> Result<(), Error> {
    bench.inject(&json!({"heal": true}))?;
    bench.run(0.1)?;
    show(bench.request(&Request::ClearFaults)?, Reply::FaultsCleared, table, &format!("{name}: clear"));
    let armed = bench.arm();
    let seen = armed.as_ref().map_or_else(ToString::to_string, |()| "armed".to_owned());
    table.same(&format!("{name}: arm again"), "armed", &seen);
    Ok(())
}

fn arming(bench: &mut Bench, table: &mut Table, name: &str, fault: &Value, code: FaultCode) -> Result<(), Error> {
    bench.restart()?;
    bench.wait_for(SafetyState::Safe, 100)?.map_err(|state| Error::NoReply(format!("safe: it is {}", state.name())))?;
    bench.inject(fault)?;
    let reply = bench.request(&Request::Arm { deadman_ms: None })?;
    let fails = bench.wait_for(SafetyState::Fault, 200)?;
    table.row(
        &format!("{name}: refused"),
        "the self-test fails within 200 ms",
        &fails.map_or_else(|state| format!("{reply:?}, then {}", state.name()), |ms| format!("after {ms:.1} ms")),
        fails.is_ok(),
    );
    expect_fault(bench, table, name, code)?;
    table.same(&format!("{name}: registers"), ALL_OFF, &off_as_seen(bench)?);
    recover(bench, table, name)
}

/// The discharge switch and the bleeder fail: nothing may call the board safe.
fn stays_charged(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let name = "rail stays charged after stop";
    bring_up(bench)?;
    bench.inject(&json!({"discharge": "fails", "rail_fault": {"rail": 1, "volts": 500}}))?;
    show(bench.request(&Request::Stop)?, Reply::Stopped, table, &format!("{name}: stop"));
    let status = bench.status()?.state;
    table.same(&format!("{name}: state"), SafetyState::Discharging.name(), status.name());
    let took = bench.wait_for(SafetyState::Fault, 2 * DISCHARGE_LIMIT_MS)?;
    table.within(&format!("{name}: noticed"), f64::from(DISCHARGE_LIMIT_MS) * 1.1, took.ok());
    expect_fault(bench, table, name, FaultCode::DischargeFailed)?;
    let reply = bench.request(&Request::ClearFaults)?;
    let expected = Reply::Refused(Refusal::StillThere(FaultCode::DischargeFailed));
    show(reply, expected, table, &format!("{name}: clear too early"));
    recover(bench, table, name)
}

/// A compare mode that is not what was written: TIM1.CCMR1 to 0, outputs frozen.
fn register_changed(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    /// TIM1_CCMR1.
    const CCMR1: u32 = 0x4001_2C18;
    let name = "compare mode changed";
    bring_up(bench)?;
    let since = bench.clock()?;
    bench.write(CCMR1, 0)?;
    bench.run(5e-3)?;
    let pins = bench.pins()?;
    let low = pins.iter().filter(|(pin, state)| pin.starts_with("era") && state.high == Some(false)).count();
    let took = bench.milliseconds_since(since)?;
    table.row(&format!("{name}: electrodes low"), "8 within 5 ms", &format!("{low} after {took:.1} ms"), low == 8);
    table.same(&format!("{name}: registers"), ALL_OFF, &off_as_seen(bench)?);
    expect_fault(bench, table, name, FaultCode::ReadBack)?;
    // Modes are written at boot and locked: clearing the fault does not mend them, a restart does.
    show(bench.request(&Request::ClearFaults)?, Reply::FaultsCleared, table, &format!("{name}: clear"));
    let again = bench.arm();
    let fault = bench.fault()?.map(|fault| fault.code);
    let seen = format!("armed {}, fault {fault:?}", again.is_ok());
    table.same(&format!("{name}: arm again"), "armed false, fault Some(ReadBack)", &seen);
    bench.restart()?;
    let armed = bench.arm();
    let seen = armed.as_ref().map_or_else(ToString::to_string, |()| "armed".to_owned());
    table.same(&format!("{name}: arm after power-up"), "armed", &seen);
    Ok(())
}

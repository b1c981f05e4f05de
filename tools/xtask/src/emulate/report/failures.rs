//! Failures of the processor and its firmware, injected while four channels drive: everything off, a restart, and a board
//! that tells why and does not arm until it is told to.

use super::bench::Bench;
use super::drives::show;
use super::expected::{ALL_OFF, off_as_seen};
use super::table::Table;
use super::trips::{bring_up, expect_fault, off_after, recover};
use crate::error::Error;
use era_shared::protocol::{CURRENT_VERSION, FaultCode, MIN_VERSION, Refusal, Reply, Request, ResetCause};
use era_shared::safety::{SafetyEvent, SafetyState};
use serde_json::{Value, json};

/// The way out of a panic or a HardFault begins with the pins.
const AT_ONCE_MS: f64 = 0.05;
/// The watchdog's 100 ms, and the tenth by which its oscillator may be slow.
const WATCHDOG_MS: f64 = 130.0;
/// What is waited for a restart, in s.
const RESTARTED_S: f64 = 0.02;

/// One failure.
struct Failure {
    name: &'static str,
    /// For `tools/emulator/faults.py`.
    fault: Value,
    code: FaultCode,
    cause: ResetCause,
    limit_ms: f64,
}

/// All of them, each from power-up.
pub fn steps(bench: &mut Bench, table: &mut Table) {
    let failure = |name, fault, code, cause, limit_ms| Failure { name, fault, code, cause, limit_ms };
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
        failure("brown-out", json!({"reset": "brown_out"}), FaultCode::BrownOut, ResetCause::PowerOn, AT_ONCE_MS),
    ];
    for failure in &failures {
        table.part(failure.name, |table| restarts(bench, table, failure));
    }
    table.part("supply sags", |table| sags(bench, table));
}

fn restarts(bench: &mut Bench, table: &mut Table, failure: &Failure) -> Result<(), Error> {
    let name = failure.name;
    bring_up(bench)?;
    let since = bench.clock()?;
    bench.inject(&failure.fault)?;
    bench.run(failure.limit_ms / 1e3 + RESTARTED_S)?;
    table.within(&format!("{name}: electrodes off"), failure.limit_ms, off_after(bench, since)?);
    table.same(&format!("{name}: restarts"), "1", &bench.resets()?.len().to_string());
    told_after_restart(bench, table, name, failure.code, failure.cause)
}

/// The 3.3 V fall below the voltage detector's threshold and come back.
fn sags(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let name = "3.3 V sags";
    bring_up(bench)?;
    let since = bench.clock()?;
    bench.inject(&json!({"pvd": "low"}))?;
    bench.run(RESTARTED_S)?;
    table.within(&format!("{name}: electrodes off"), AT_ONCE_MS, off_after(bench, since)?);
    table.same(&format!("{name}: registers"), ALL_OFF, &off_as_seen(bench)?);
    bench.inject(&json!({"pvd": "ok"}))?;
    bench.run(RESTARTED_S)?;
    expect_fault(bench, table, name, FaultCode::BrownOut)?;
    recover(bench, table, name)
}

/// Off, the cause told in the hello, the fault latched, no arming before it is cleared.
fn told_after_restart(
    bench: &mut Bench,
    table: &mut Table,
    name: &str,
    code: FaultCode,
    cause: ResetCause,
) -> Result<(), Error> {
    table.same(&format!("{name}: registers after it"), ALL_OFF, &off_as_seen(bench)?);
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let reply = bench.request(&hello)?;
    let (seen, message) = match &reply {
        Reply::Welcome(welcome) => (format!("{:?}", welcome.reset_cause), welcome.failure.to_string()),
        other => (format!("{other:?}"), String::new()),
    };
    table.same(&format!("{name}: reset cause in the hello"), &format!("{cause:?}"), &seen);
    // A panic and a HardFault can say where; the others leave what they can.
    if matches!(code, FaultCode::Panic | FaultCode::HardFault) {
        table.row(&format!("{name}: message in the hello"), "some", &message, !message.is_empty());
    }
    expect_fault(bench, table, name, code)?;
    let arm = bench.request(&Request::Arm { deadman_ms: None })?;
    let expected = Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm });
    show(arm, expected, table, &format!("{name}: arm before clearing"));
    recover(bench, table, name)
}

//! What keeps the device from doing harm: the self-test, faults while live, measured rails, budgets.

use crate::bench::{Bench, Outcome, Session, VOLTAGE_MILLIVOLTS, check_pins_low, drive, equal};
use crate::breakage::Breakage;
use era::device::LinkError;
use era_shared::limits::{BURST_MAX_MS, DISCHARGED_MILLIVOLTS, REST_MS};
use era_shared::protocol::{ChannelDrive, ChargeRule, FaultCode, Refusal, Reply, Request};
use era_shared::safety::{Event, State};
use std::time::{Duration, Instant};

/// Highest of the measured rails in mV.
fn highest(rails: &[u32]) -> u32 {
    rails.iter().copied().max().unwrap_or(0)
}

pub(crate) fn details(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let channels = usize::from(session.channels()?);
    let safe = session.details()?;
    equal("state", safe.state, State::Safe)?;
    equal("safe rails are discharged", highest(&safe.rail_millivolts) < DISCHARGED_MILLIVOLTS, true)?;
    equal("safe rails are set to nothing", highest(&safe.set_point_millivolts), 0)?;
    let loops = [safe.interlock_closed, safe.stop_released, safe.earth_bonded];
    equal("interlock, emergency stop and earth", loops, [true; 3])?;
    equal("credits", safe.credit_ms.len(), channels)?;
    session.arm()?;
    session.drive(&[drive(0, 150_000), drive(1, 150_000)])?;
    bench.be_silent(Duration::from_millis(100))?;
    let running = session.details()?;
    equal("state", running.state, State::Running)?;
    for (set, measured) in running.set_point_millivolts.into_iter().zip(running.rail_millivolts) {
        equal(&format!("a set-point of {set} mV"), set.abs_diff(VOLTAGE_MILLIVOLTS) < 1_000, true)?;
        equal(&format!("a rail of {measured} mV"), measured.abs_diff(VOLTAGE_MILLIVOLTS) < 15_000, true)?;
    }
    let credit = match session.ask(&Request::Credit)? {
        Reply::Credit(credit) => credit,
        other => return Err(format!("credit was answered {other:?}")),
    };
    equal("what is charged by", credit.rule, ChargeRule::ForceSquared)?;
    let charged: Vec<bool> = credit.channels.iter().map(|channel| channel.charge_ppm > 0).collect();
    let driven: Vec<bool> = (0..channels).map(|channel| channel < 2).collect();
    equal("who is charged", charged, driven)?;
    equal("so weak a drive never runs out", credit.lasts_ms(0), None)?;
    session.disarm()
}

pub(crate) fn drives_set_while_arming(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    equal("arm", session.ask(&Request::Arm { deadman_ms: Some(1000) })?, Reply::Armed { deadman_ms: 1000 })?;
    let achieved = session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    session.await_state(State::Running)?;
    let status = session.expect_state(State::Running)?;
    let shown: Vec<_> = status.channels.iter().filter_map(|channel| channel.drive).collect();
    equal("drives in the status", shown, achieved)?;
    session.disarm()
}

pub(crate) fn burst_limit(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let arm = |burst_ms| Request::ArmWith { deadman_ms: Some(1000), burst_ms: Some(burst_ms) };
    let refusal = session.refused(&arm(BURST_MAX_MS + 1))?;
    let wanted = Refusal::Burst { requested_ms: BURST_MAX_MS + 1, min_ms: 1, max_ms: BURST_MAX_MS };
    equal("too long a burst", refusal, wanted)?;
    equal("arm", session.ask(&arm(200))?, Reply::ArmedWith { deadman_ms: 1000, burst_ms: 200 })?;
    session.await_state(State::Armed)?;
    // Asked for again and again, so that the refusal is not missed: a rest ends it.
    let begun = Instant::now();
    let wait_ms = loop {
        let drives = [drive(0, 150_000)].into_iter().collect();
        match session.client.request(&Request::SetDrives { drives }) {
            Ok(Reply::DrivesSet { .. }) if begun.elapsed() < Duration::from_secs(60) => {
                std::thread::sleep(Duration::from_millis(5));
            }
            Err(LinkError::Refused(Refusal::Duty { channel: 0, wait_ms })) => break wait_ms,
            other => return Err(format!("a drive beyond its burst got {other:?}")),
        }
    };
    equal("a rest at most", (1..=REST_MS).contains(&wait_ms), true)?;
    session.disarm()?;
    // A rest counts while not armed, too: drives can be set as soon as the device arms.
    bench.be_silent(Duration::from_millis(u64::from(REST_MS) + 50))?;
    equal("arm", session.ask(&arm(200))?, Reply::ArmedWith { deadman_ms: 1000, burst_ms: 200 })?;
    session.drive(&[drive(0, 150_000)])?;
    session.disarm()
}

/// Waits for the fault, which must be `code`; everything must be off then.
fn expect_fault(bench: &Bench, session: &mut Session<'_>, code: FaultCode) -> Outcome {
    session.await_fault()?;
    let status = session.expect_state(State::Fault)?;
    equal("fault", status.fault.map(|fault| fault.code), Some(code))?;
    let refusal = session.refused(&Request::Arm { deadman_ms: None })?;
    equal("refusal", refusal, Refusal::State { state: State::Fault, event: Event::Arm })?;
    check_pins_low(bench)
}

/// The fault can be cleared once the rails are discharged, and the device becomes safe.
fn recover(session: &mut Session<'_>) -> Outcome {
    let begun = Instant::now();
    loop {
        match session.client.request(&Request::ClearFaults) {
            Ok(Reply::FaultsCleared) => return session.await_state(State::Safe),
            Err(LinkError::Refused(Refusal::StillThere(_))) if begun.elapsed() < Duration::from_secs(20) => {}
            other => return Err(format!("clear-faults was answered {other:?}")),
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

pub(crate) fn arming_tests_every_loop(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let breakages = [
        (Breakage::Interlock, FaultCode::InterlockOpen, true),
        (Breakage::EmergencyStop, FaultCode::EmergencyStop, true),
        (Breakage::Earth, FaultCode::EarthOpen, true),
        (Breakage::Short, FaultCode::ShortCircuit, false),
        (Breakage::Leakage, FaultCode::ShortCircuit, false),
    ];
    for (breakage, code, stays) in breakages {
        let broken = bench.break_it(breakage)?;
        // A board whose hardware has noticed already is in its fault before it is asked.
        match session.client.request(&Request::Arm { deadman_ms: Some(1000) }) {
            Ok(Reply::Armed { .. }) | Err(LinkError::Refused(Refusal::State { state: State::Fault, .. })) => {}
            other => return Err(format!("{breakage:?}: arm was answered {other:?}")),
        }
        expect_fault(bench, &mut session, code).map_err(|error| format!("{breakage:?}: {error}"))?;
        if stays {
            let refusal = session.refused(&Request::ClearFaults)?;
            equal("the cause is still there", refusal, Refusal::StillThere(code))?;
        }
        drop(broken);
        recover(&mut session).map_err(|error| format!("{breakage:?}: {error}"))?;
    }
    session.arm()?;
    session.disarm()
}

pub(crate) fn live_board_sees_what_breaks(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let low = VOLTAGE_MILLIVOLTS;
    let breakages = [
        (Breakage::Interlock, low, FaultCode::InterlockOpen),
        (Breakage::EmergencyStop, low, FaultCode::EmergencyStop),
        (Breakage::Earth, low, FaultCode::EarthOpen),
        (Breakage::Leakage, low, FaultCode::OverCurrent),
        (Breakage::StoppedTimer, low, FaultCode::TimerStopped),
        (Breakage::Short, low, FaultCode::RailImplausible),
        // High enough for an arc to be told from a rail that is not where it was set.
        (Breakage::Short, 500_000, FaultCode::RailCollapsed),
    ];
    for (breakage, voltage_millivolts, code) in breakages {
        session.arm()?;
        let driven = |channel| ChannelDrive { voltage_millivolts, ..drive(channel, 150_000) };
        session.drive(&[driven(0), driven(1)])?;
        bench.be_silent(Duration::from_millis(100))?;
        session.expect_state(State::Running)?;
        let broken = bench.break_it(breakage)?;
        expect_fault(bench, &mut session, code).map_err(|error| format!("{breakage:?}: {error}"))?;
        drop(broken);
        recover(&mut session).map_err(|error| format!("{breakage:?}: {error}"))?;
    }
    Ok(())
}

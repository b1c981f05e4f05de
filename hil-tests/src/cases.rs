//! The suite: what a device does with arm, drive, stop, silence, restart. `link_cases` has what it does with bytes,
//! `play_cases` effects and clocks, `safety_cases` self-test, faults and budgets, `version_cases` older hosts.

use crate::bench::{Bench, Outcome, Session, check_pins_low, drive, equal};
use crate::{link_cases, play_cases, safety_cases, version_cases};
use era_shared::protocol::{
    AchievedDrive, BoardKind, CURRENT_VERSION, ChannelDrive, FaultCode, Refusal, Reply, Request,
};
use era_shared::safety::{Event, State};
use era_shared::waveform::{DriveError, Windows};
use std::time::Duration;

/// What a case needs of its target beyond a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Nothing,
    /// A reset that can be given from outside.
    Reset,
    /// The simulated device's knobs.
    Knobs,
    /// Hardware that can be broken on demand.
    Breaking,
    /// That nothing is connected to the electrodes: it asks for 1 kV.
    NothingConnected,
}

/// One case of the suite.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Its name.
    pub name: &'static str,
    /// What it needs.
    pub needs: Needs,
    /// What it does.
    pub run: fn(&Bench) -> Outcome,
}

const fn case(name: &'static str, run: fn(&Bench) -> Outcome) -> Case {
    Case { name, needs: Needs::Nothing, run }
}

/// All cases, in the order in which a person would try them.
pub const CASES: &[Case] = &[
    case("hello", hello),
    case("version_mismatch", link_cases::version_mismatch),
    case("nothing_drives_unarmed", nothing_drives_unarmed),
    case("arm_and_disarm", arm_and_disarm),
    case("drive_two_frequencies", drive_two_frequencies),
    case("change_drives", change_drives),
    case("drives_to_the_timer_step", drives_to_the_timer_step),
    case("equal_frequencies_keep_their_phase", equal_frequencies_keep_their_phase),
    case("refused_drives_change_nothing", refused_drives_change_nothing),
    case("stop", stop),
    case("silence", silence),
    case("keep_alive_holds", keep_alive_holds),
    case("garbage", link_cases::garbage),
    case("frames_in_pieces", link_cases::frames_in_pieces),
    case("clock", play_cases::clock),
    case("details", safety_cases::details),
    case("effect_on_all_channels", play_cases::effect_on_all_channels),
    case("effects_queue", play_cases::effects_queue),
    case("late_and_early_effects", play_cases::late_and_early_effects),
    case("drives_set_while_arming", safety_cases::drives_set_while_arming),
    case("burst_limit", safety_cases::burst_limit),
    Case { name: "version_1_session", needs: Needs::NothingConnected, run: version_cases::version_1_session },
    Case { name: "arming_tests_every_loop", needs: Needs::Breaking, run: safety_cases::arming_tests_every_loop },
    Case {
        name: "live_board_sees_what_breaks",
        needs: Needs::Breaking,
        run: safety_cases::live_board_sees_what_breaks,
    },
    Case { name: "restart", needs: Needs::Reset, run: restart },
    Case { name: "silent_device", needs: Needs::Knobs, run: link_cases::silent_device },
    Case { name: "slow_device", needs: Needs::Knobs, run: link_cases::slow_device },
    Case { name: "corrupting_line", needs: Needs::Knobs, run: link_cases::corrupting_line },
];

fn hello(bench: &Bench) -> Outcome {
    let hello = bench.session()?.hello()?;
    let wanted = if bench.knobs().is_some() { BoardKind::Simulated } else { BoardKind::Stm32G474 };
    equal("board", hello.board, wanted)?;
    equal("channels", hello.channels.len(), 4)?;
    equal("newest version", hello.protocol_current, CURRENT_VERSION)?;
    equal("the image has a name", hello.image.is_empty(), false)?;
    for limits in &hello.channels {
        equal("guard time is at least 50 us", limits.min_guard_ns >= 50_000, true)?;
        equal("voltage limit is at most 2 kV", limits.max_voltage_millivolts <= 2_000_000, true)?;
    }
    Ok(())
}

fn nothing_drives_unarmed(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.expect_state(State::Safe)?;
    let drives = heapless::Vec::from_slice(&[drive(0, 100_000)]).map_err(|_| "capacity")?;
    let refusal = session.refused(&Request::SetDrives { drives })?;
    equal("refusal", refusal, Refusal::State { state: State::Safe, event: Event::Drive })?;
    session.expect_state(State::Safe)?;
    Ok(())
}

fn arm_and_disarm(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    session.expect_state(State::Armed)?;
    equal("disarm", session.ask(&Request::Disarm)?, Reply::Disarmed)?;
    session.await_state(State::Safe)?;
    session.expect_state(State::Safe)?;
    let refusal = session.refused(&Request::Arm { deadman_ms: Some(5) })?;
    equal("refusal", refusal, Refusal::Deadman { requested_ms: 5, min_ms: 50, max_ms: 1000 })?;
    session.expect_state(State::Safe)?;
    Ok(())
}

fn drive_two_frequencies(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    let achieved = session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    let status = session.expect_state(State::Running)?;
    let shown: Vec<_> = status.channels.iter().filter_map(|channel| channel.drive).collect();
    equal("drives in the status", shown, achieved.clone())?;
    check_timers(bench, &mut session, &achieved)?;
    session.ask(&Request::Stop)?;
    Ok(())
}

fn change_drives(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    let narrower = ChannelDrive { pulse_width_ppm: 300_000, ..drive(0, 150_000) };
    for drives in [&[narrower, drive(1, 270_500)][..], &[drive(0, 60_000), drive(1, 399_999)], &[drive(1, 200_000)]] {
        let achieved = session.drive(drives)?;
        check_timers(bench, &mut session, &achieved)?;
        session.expect_state(State::Running)?;
    }
    session.drive(&[])?;
    session.expect_state(State::Armed)?;
    session.disarm()
}

/// Frequencies at the ends and in the middle of the range, all within the timers' own step.
fn drives_to_the_timer_step(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    for frequency_millihertz in [1_000, 19_999, 40_000, 123_457, 333_333, 1_000_000] {
        let wide = ChannelDrive { pulse_width_ppm: 500_000, ..drive(0, frequency_millihertz) };
        let achieved = session.drive(&[wide, ChannelDrive { channel: 1, ..wide }])?;
        check_timers(bench, &mut session, &achieved)?;
        for achieved in achieved {
            let hertz = achieved.frequency_nanohertz as f64 / 1e9;
            let off_ppm = (hertz / (f64::from(frequency_millihertz) / 1e3) - 1.0) * 1e6;
            equal(&format!("{hertz} Hz is within 20 ppm of the request"), off_ppm.abs() < 20.0, true)?;
            equal("guard time", achieved.guard_ns >= 200_000, true)?;
        }
    }
    session.ask(&Request::Stop)?;
    Ok(())
}

fn equal_frequencies_keep_their_phase(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    for phase_microturns in [0, 125_000, 500_000, 999_999] {
        let second = ChannelDrive { phase_microturns, ..drive(1, 180_000) };
        let achieved = session.drive(&[drive(0, 180_000), second])?;
        check_timers(bench, &mut session, &achieved)?;
        equal("equal frequencies", achieved[0].frequency_nanohertz, achieved[1].frequency_nanohertz)?;
        let off = (i64::from(achieved[1].phase_microturns) - i64::from(phase_microturns)).rem_euclid(1_000_000);
        equal("phase within a tick", off.min(1_000_000 - off) <= 16, true)?;
        // What is read back is preloaded: the phase is reached after a blank period and two more at most.
        bench.let_pass(Duration::from_millis(30))?;
        check_phase(bench, &achieved)?;
    }
    session.ask(&Request::Stop)?;
    Ok(())
}

fn refused_drives_change_nothing(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    let before = session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    let good = drive(0, 100_000);
    let bad = [
        (ChannelDrive { frequency_millihertz: 1_000_001, ..drive(1, 0) }, "frequency"),
        (ChannelDrive { voltage_millivolts: 2_000_001, ..drive(1, 100_000) }, "voltage"),
        (ChannelDrive { pulse_width_ppm: 1_000_000, ..drive(1, 100_000) }, "guard time"),
        (ChannelDrive { pulse_width_ppm: 0, ..drive(1, 100_000) }, "no pulse"),
        (ChannelDrive { phase_microturns: 1_000_000, ..drive(1, 100_000) }, "phase"),
        (drive(9, 100_000), "no such channel"),
    ];
    for (bad, what) in bad {
        let drives = heapless::Vec::from_slice(&[good, bad]).map_err(|_| "capacity")?;
        match session.refused(&Request::SetDrives { drives })? {
            Refusal::Drive { channel, error } => {
                equal(what, channel, bad.channel)?;
                equal(what, matches!(error, DriveError::NoSuchChannel { channels: 4 }), bad.channel == 9)?;
            }
            other => return Err(format!("{what}: refused with {other:?}")),
        }
        let status = session.expect_state(State::Running)?;
        let still: Vec<_> = status.channels.iter().filter_map(|channel| channel.drive).collect();
        equal(what, still, before.clone())?;
    }
    check_timers(bench, &mut session, &before)?;
    session.ask(&Request::Stop)?;
    Ok(())
}

fn stop(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    equal("stop", session.ask(&Request::Stop)?, Reply::Stopped)?;
    check_pins_low(bench)?;
    session.await_state(State::Safe)?;
    session.expect_state(State::Safe)?;
    equal("stop again", session.ask(&Request::Stop)?, Reply::Stopped)?;
    Ok(())
}

fn silence(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    equal("default dead-man time", session.ask(&Request::Arm { deadman_ms: None })?, Reply::Armed { deadman_ms: 250 })?;
    session.await_state(State::Armed)?;
    session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    // Twice the time, for a real board whose clock nobody can stop; to the millisecond in the emulator's report.
    bench.be_silent(Duration::from_millis(500))?;
    let status = session.expect_state(State::Fault)?;
    let fault = status.fault.ok_or("no fault is latched")?;
    equal("fault", fault.code, FaultCode::HostSilent)?;
    equal("silence noticed after 250 ms", (250..300).contains(&fault.detail), true)?;
    check_pins_low(bench)?;
    let refusal = session.refused(&Request::Arm { deadman_ms: None })?;
    equal("refusal", refusal, Refusal::State { state: State::Fault, event: Event::Arm })?;
    equal("clear", session.ask(&Request::ClearFaults)?, Reply::FaultsCleared)?;
    session.await_state(State::Safe)?;
    session.expect_state(State::Safe)?;
    session.arm()?;
    session.disarm()?;
    Ok(())
}

fn keep_alive_holds(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    session.drive(&[drive(0, 150_000)])?;
    // Longer than the dead-man time, shorter than the longest burst.
    for _ in 0..6 {
        bench.be_silent(Duration::from_millis(250))?;
        equal("keep-alive", session.ask(&Request::KeepAlive)?, Reply::Alive { state: State::Running })?;
    }
    session.expect_state(State::Running)?;
    session.ask(&Request::Stop)?;
    Ok(())
}

fn restart(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let before = session.hello()?.boot_id;
    session.arm()?;
    session.drive(&[drive(0, 150_000), drive(1, 270_500)])?;
    bench.restart()?;
    session.await_state(State::Safe)?;
    let status = session.expect_state(State::Safe)?;
    equal("a new boot identifier", status.boot_id != before, true)?;
    check_pins_low(bench)?;
    Ok(())
}

/// In the emulator: the timers come to do what was achieved, to the last tick, and no two electrodes of one ERA are ever on
/// together. A change waits for the end of a period, of 1 s at 1 Hz, and perhaps for its phase.
fn check_timers(bench: &Bench, session: &mut Session<'_>, achieved: &[AchievedDrive]) -> Outcome {
    for _ in 0..150 {
        match differing(bench, achieved)? {
            None => return Ok(()),
            Some(_) => {
                bench.let_pass(Duration::from_millis(20))?;
                session.ask(&Request::KeepAlive)?;
            }
        }
    }
    differing(bench, achieved)?.map_or(Ok(()), Err)
}

/// What the timers do that was not achieved, if anything; an error is what they must never do.
fn differing(bench: &Bench, achieved: &[AchievedDrive]) -> Result<Option<String>, String> {
    let Some(timers) = bench.timers()? else { return Ok(None) };
    for (channel, registers) in (0_u8..).zip(&timers) {
        let windows = Windows::from_registers(registers).map_err(|error| format!("channel {channel}: {error:?}"))?;
        equal("ticks with both electrodes on", windows.overlap(), 0)?;
        let tick_s = windows.tick_s(170_000_000);
        if let Some(ticks) = windows.guard() {
            let guard_s = f64::from(ticks) * tick_s;
            equal(&format!("guard of {guard_s} s"), guard_s >= 200e-6, true)?;
        }
        let Some(drive) = achieved.iter().find(|drive| drive.channel == channel) else {
            if windows.a.length + windows.b.length > 0 {
                return Ok(Some(format!("channel {channel} energises electrodes")));
            }
            continue;
        };
        if windows.a.length == 0 || windows.a.length != windows.b.length {
            return Ok(Some(format!("channel {channel} does not use both electrodes alike")));
        }
        let frequency_hz = 1.0 / (f64::from(windows.period) * tick_s);
        let told_hz = drive.frequency_nanohertz as f64 / 1e9;
        if (frequency_hz / told_hz - 1.0).abs() > 1e-9 {
            return Ok(Some(format!("channel {channel} is at {frequency_hz} Hz, not {told_hz} Hz")));
        }
    }
    Ok(None)
}

/// In the emulator: the counters of two drives of one frequency are as far apart as their phases, to a tick each for the
/// two roundings and one for the phase's.
fn check_phase(bench: &Bench, achieved: &[AchievedDrive]) -> Outcome {
    let (Some(counts), [first, second, ..]) = (bench.counts()?, achieved) else { return Ok(()) };
    let [(first_count, ticks), (second_count, _), ..] = counts[..] else { return Err("two counters".into()) };
    let turn = 1e-6 * (f64::from(second.phase_microturns) - f64::from(first.phase_microturns));
    let off = (f64::from(second_count) - f64::from(first_count)) / f64::from(ticks) - turn;
    let off_ticks = (off - off.round()).abs() * f64::from(ticks);
    equal(&format!("{off_ticks} ticks off the phase"), off_ticks <= 3.0, true)
}

//! The suite: what a device does with arm, drive, stop, silence, restart. `link_cases` has what it does with bytes,
//! `play_cases` effects and clocks, `safety_cases` self-test, faults and budgets, `version_cases` older hosts.

use crate::bench::{Bench, CaseResult, TestSession, check_equal, check_pins_low, make_drive};
use crate::outputs::OutputCheck::{self, Effects, Energised, Phase, PinsLow, Windows};
use crate::{link_cases, play_cases, safety_cases, version_cases};
use era_shared::protocol::{
    AchievedDrive, BoardKind, CURRENT_VERSION, ChannelDrive, FaultCode, Refusal, Reply, Request,
};
use era_shared::safety::{SafetyEvent, SafetyState};
use era_shared::waveform::DriveError;
use std::time::Duration;

/// What a case needs of its target beyond a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaseNeeds {
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
    pub needs: CaseNeeds,
    /// What it does.
    pub run: fn(&Bench) -> CaseResult,
    /// The checks of outputs that it makes.
    pub output_checks: &'static [OutputCheck],
}

impl Case {
    /// Runs the case. Returns the checks that it did not make because the outputs of this target cannot be observed: if
    /// there are any, the case has not passed.
    ///
    /// # Errors
    /// What was wrong; also if the case has made other checks of outputs than [`Case::output_checks`].
    pub fn run_and_list_unobserved_checks(&self, bench: &Bench) -> Result<Vec<OutputCheck>, String> {
        bench.take_check_record();
        (self.run)(bench)?;
        let record = bench.take_check_record();
        let mut listed = self.output_checks.to_vec();
        listed.sort_unstable();
        check_equal("checks of outputs", record.keys().copied().collect(), listed)?;
        Ok(record.into_iter().filter_map(|(check, observed)| (!observed).then_some(check)).collect())
    }
}

const fn make_case(name: &'static str, run: fn(&Bench) -> CaseResult, output_checks: &'static [OutputCheck]) -> Case {
    Case { name, needs: CaseNeeds::Nothing, run, output_checks }
}

/// All cases, in the order in which a person would try them.
pub const CASES: &[Case] = &[
    make_case("hello", check_hello_reply, &[]),
    make_case("version_mismatch", link_cases::version_mismatch, &[]),
    make_case("nothing_drives_unarmed", nothing_drives_unarmed, &[Energised]),
    make_case("arm_and_disarm", arm_and_disarm, &[Energised]),
    make_case("drive_two_frequencies", drive_two_frequencies, &[Energised, Windows]),
    make_case("change_drives", change_drives, &[Energised, Windows]),
    make_case("drives_to_the_timer_step", drives_to_the_timer_step, &[Windows]),
    make_case("equal_frequencies_keep_their_phase", equal_frequencies_keep_their_phase, &[Windows, Phase]),
    make_case("refused_drives_change_nothing", refused_drives_change_nothing, &[Energised, Windows]),
    make_case("stop", check_stop_request, &[Energised, PinsLow]),
    make_case("silence", check_host_silence_is_fault, &[Energised, PinsLow]),
    make_case("keep_alive_holds", keep_alive_holds, &[Energised]),
    make_case("garbage", link_cases::check_garbage_is_ignored_and_counted, &[Energised]),
    make_case("frames_in_pieces", link_cases::frames_in_pieces, &[]),
    make_case("clock", play_cases::check_clock_advances, &[]),
    make_case("details", safety_cases::check_details_and_credit, &[]),
    make_case("effect_on_all_channels", play_cases::effect_on_all_channels, &[Energised, Effects]),
    make_case("effects_queue", play_cases::effects_queue, &[]),
    make_case("late_and_early_effects", play_cases::late_and_early_effects, &[]),
    make_case("drives_set_while_arming", safety_cases::drives_set_while_arming, &[Energised]),
    make_case("burst_limit", safety_cases::burst_limit, &[]),
    Case {
        needs: CaseNeeds::NothingConnected,
        ..make_case("version_1_session", version_cases::version_1_session, &[])
    },
    Case {
        needs: CaseNeeds::Breaking,
        ..make_case("arming_tests_every_loop", safety_cases::arming_tests_every_loop, &[Energised, PinsLow])
    },
    Case {
        needs: CaseNeeds::Breaking,
        ..make_case("live_board_sees_what_breaks", safety_cases::live_board_sees_what_breaks, &[Energised, PinsLow])
    },
    Case { needs: CaseNeeds::Reset, ..make_case("restart", check_reset_while_live_is_fault, &[Energised, PinsLow]) },
    Case { needs: CaseNeeds::Knobs, ..make_case("silent_device", link_cases::silent_device, &[Energised]) },
    Case { needs: CaseNeeds::Knobs, ..make_case("slow_device", link_cases::slow_device, &[Energised]) },
    Case { needs: CaseNeeds::Knobs, ..make_case("corrupting_line", link_cases::corrupting_line, &[Energised]) },
];

fn check_hello_reply(bench: &Bench) -> CaseResult {
    let hello = bench.begin_session()?.request_hello()?;
    let wanted = if bench.sim_control().is_some() { BoardKind::Simulated } else { BoardKind::Stm32G474 };
    check_equal("board", hello.board, wanted)?;
    check_equal("channels", hello.channels.len(), 4)?;
    check_equal("newest version", hello.protocol_current, CURRENT_VERSION)?;
    check_equal("the image has a name", hello.image.is_empty(), false)?;
    for limits in &hello.channels {
        check_equal("guard time is at least 88 us", limits.min_guard_ns >= 88_000, true)?;
        check_equal("voltage limit is at most 2 kV", limits.max_voltage_millivolts <= 2_000_000, true)?;
    }
    Ok(())
}

fn nothing_drives_unarmed(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.expect_state(SafetyState::Safe)?;
    let drives = heapless::Vec::from_slice(&[make_drive(0, 100_000)]).map_err(|_| "capacity")?;
    let refusal = session.expect_refusal(&Request::SetDrives { drives })?;
    check_equal("refusal", refusal, Refusal::State { state: SafetyState::Safe, event: SafetyEvent::Drive })?;
    session.expect_state(SafetyState::Safe)?;
    Ok(())
}

fn arm_and_disarm(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    session.expect_state(SafetyState::Armed)?;
    check_equal("disarm", session.send_request(&Request::Disarm)?, Reply::Disarmed)?;
    session.await_state(SafetyState::Safe)?;
    session.expect_state(SafetyState::Safe)?;
    let refusal = session.expect_refusal(&Request::Arm { deadman_ms: Some(5) })?;
    check_equal("refusal", refusal, Refusal::Deadman { requested_ms: 5, min_ms: 50, max_ms: 1000 })?;
    session.expect_state(SafetyState::Safe)?;
    Ok(())
}

fn drive_two_frequencies(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    let achieved = session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    let status = session.expect_state(SafetyState::Running)?;
    let shown: Vec<_> = status.channels.iter().filter_map(|channel| channel.drive).collect();
    check_equal("drives in the status", shown, achieved.clone())?;
    await_achieved_timers(bench, &mut session, &achieved)?;
    session.send_request(&Request::Stop)?;
    Ok(())
}

fn change_drives(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    let narrower = ChannelDrive { pulse_width_ppm: 300_000, ..make_drive(0, 150_000) };
    for drives in [
        &[narrower, make_drive(1, 270_500)][..],
        &[make_drive(0, 60_000), make_drive(1, 399_999)],
        &[make_drive(1, 200_000)],
    ] {
        let achieved = session.set_drives(drives)?;
        await_achieved_timers(bench, &mut session, &achieved)?;
        session.expect_state(SafetyState::Running)?;
    }
    session.set_drives(&[])?;
    session.expect_state(SafetyState::Armed)?;
    session.disarm_and_await_safe()
}

/// Frequencies at the ends and in the middle of the range, all within the timers' own step.
fn drives_to_the_timer_step(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    for frequency_millihertz in [1_000, 19_999, 40_000, 123_457, 333_333, 1_000_000] {
        let wide = ChannelDrive { pulse_width_ppm: 500_000, ..make_drive(0, frequency_millihertz) };
        let achieved = session.set_drives(&[wide, ChannelDrive { channel: 1, ..wide }])?;
        await_achieved_timers(bench, &mut session, &achieved)?;
        for achieved in achieved {
            let hertz = achieved.frequency_nanohertz as f64 / 1e9;
            let off_ppm = (hertz / (f64::from(frequency_millihertz) / 1e3) - 1.0) * 1e6;
            check_equal(&format!("{hertz} Hz is within 20 ppm of the request"), off_ppm.abs() < 20.0, true)?;
            check_equal("guard time", achieved.guard_ns >= 200_000, true)?;
        }
    }
    session.send_request(&Request::Stop)?;
    Ok(())
}

fn equal_frequencies_keep_their_phase(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    for phase_microturns in [0, 125_000, 500_000, 999_999] {
        let second = ChannelDrive { phase_microturns, ..make_drive(1, 180_000) };
        let achieved = session.set_drives(&[make_drive(0, 180_000), second])?;
        await_achieved_timers(bench, &mut session, &achieved)?;
        check_equal("equal frequencies", achieved[0].frequency_nanohertz, achieved[1].frequency_nanohertz)?;
        let off = (i64::from(achieved[1].phase_microturns) - i64::from(phase_microturns)).rem_euclid(1_000_000);
        check_equal("the phase is within a tick of the requested phase", off.min(1_000_000 - off) <= 16, true)?;
        // The drives before had the same frequency, so the timers may not have changed yet. The phase is reached after the
        // active and the preloaded period, a blank one and two more, of 5.6 ms each, at most.
        bench.wait_silently(Duration::from_millis(60))?;
        check_phase(bench, &achieved)?;
    }
    session.send_request(&Request::Stop)?;
    Ok(())
}

fn refused_drives_change_nothing(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    let before = session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    let good = make_drive(0, 100_000);
    let bad = [
        (ChannelDrive { frequency_millihertz: 1_000_001, ..make_drive(1, 0) }, "frequency"),
        (ChannelDrive { voltage_millivolts: 2_000_001, ..make_drive(1, 100_000) }, "voltage"),
        (ChannelDrive { pulse_width_ppm: 1_000_000, ..make_drive(1, 100_000) }, "guard time"),
        (ChannelDrive { pulse_width_ppm: 0, ..make_drive(1, 100_000) }, "no pulse"),
        (ChannelDrive { phase_microturns: 1_000_000, ..make_drive(1, 100_000) }, "phase"),
        (make_drive(9, 100_000), "no such channel"),
    ];
    for (bad, what) in bad {
        let drives = heapless::Vec::from_slice(&[good, bad]).map_err(|_| "capacity")?;
        match session.expect_refusal(&Request::SetDrives { drives })? {
            Refusal::Drive { channel, error } => {
                check_equal(what, channel, bad.channel)?;
                check_equal(what, matches!(error, DriveError::NoSuchChannel { channels: 4 }), bad.channel == 9)?;
            }
            other => return Err(format!("{what}: refused with {other:?}")),
        }
        let status = session.expect_state(SafetyState::Running)?;
        let still: Vec<_> = status.channels.iter().filter_map(|channel| channel.drive).collect();
        check_equal(what, still, before.clone())?;
    }
    // 8 x 116 pF x 2 kV x 1 kHz are 1856 uA; on a board for less voltage, that is too high.
    let beyond = |channel| ChannelDrive {
        pulse_width_ppm: 500_000,
        voltage_millivolts: 2_000_000,
        ..make_drive(channel, 1_000_000)
    };
    let drives = heapless::Vec::from_slice(&[0, 1, 2, 3].map(beyond)).map_err(|_| "capacity")?;
    match session.expect_refusal(&Request::SetDrives { drives })? {
        Refusal::Current { max_microamps: 500, .. } | Refusal::Drive { .. } => {}
        other => return Err(format!("drives beyond the limit of the supply were refused with {other:?}")),
    }
    await_achieved_timers(bench, &mut session, &before)?;
    session.send_request(&Request::Stop)?;
    Ok(())
}

fn check_stop_request(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    check_equal("stop", session.send_request(&Request::Stop)?, Reply::Stopped)?;
    check_pins_low(bench)?;
    session.await_state(SafetyState::Safe)?;
    session.expect_state(SafetyState::Safe)?;
    check_equal("stop again", session.send_request(&Request::Stop)?, Reply::Stopped)?;
    Ok(())
}

fn check_host_silence_is_fault(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    check_equal(
        "default dead-man time",
        session.send_request(&Request::Arm { deadman_ms: None })?,
        Reply::Armed { deadman_ms: 250 },
    )?;
    session.await_state(SafetyState::Armed)?;
    session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    // Twice the time, for a real board whose clock nobody can stop; to the millisecond in the emulator's report.
    bench.wait_silently(Duration::from_millis(500))?;
    let status = session.expect_state(SafetyState::Fault)?;
    let fault = status.fault.ok_or("no fault is latched")?;
    check_equal("fault", fault.code, FaultCode::HostSilent)?;
    check_equal("silence noticed after 250 ms", (250..300).contains(&fault.detail), true)?;
    check_pins_low(bench)?;
    let refusal = session.expect_refusal(&Request::Arm { deadman_ms: None })?;
    check_equal("refusal", refusal, Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm })?;
    check_equal("clear", session.send_request(&Request::ClearFaults)?, Reply::FaultsCleared)?;
    session.await_state(SafetyState::Safe)?;
    session.expect_state(SafetyState::Safe)?;
    session.arm_and_await_armed()?;
    session.disarm_and_await_safe()?;
    Ok(())
}

fn keep_alive_holds(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    session.set_drives(&[make_drive(0, 150_000)])?;
    // Longer than the dead-man time, shorter than the longest burst.
    for _ in 0..6 {
        bench.wait_silently(Duration::from_millis(250))?;
        check_equal(
            "keep-alive",
            session.send_request(&Request::KeepAlive)?,
            Reply::Alive { state: SafetyState::Running },
        )?;
    }
    session.expect_state(SafetyState::Running)?;
    session.send_request(&Request::Stop)?;
    Ok(())
}

fn check_reset_while_live_is_fault(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    let before = session.request_hello()?.boot_id;
    session.arm_and_await_armed()?;
    session.set_drives(&[make_drive(0, 150_000), make_drive(1, 270_500)])?;
    bench.reset_device()?;
    // It was live: whoever has reset it is asked for.
    session.await_fault()?;
    let status = session.expect_state(SafetyState::Fault)?;
    check_equal("a new boot identifier", status.boot_id != before, true)?;
    check_equal("fault", status.fault.map(|fault| fault.code), Some(FaultCode::ResetWhileLive))?;
    check_pins_low(bench)?;
    check_equal("clear", session.send_request(&Request::ClearFaults)?, Reply::FaultsCleared)?;
    session.await_state(SafetyState::Safe)
}

/// The timers come to do what was achieved, to the last tick, and no two electrodes of one ERA are ever on together. A
/// change waits for the end of a period, of 1 s at 1 Hz, and perhaps for its phase.
fn await_achieved_timers(bench: &Bench, session: &mut TestSession<'_>, achieved: &[AchievedDrive]) -> CaseResult {
    for _ in 0..150 {
        match find_timer_mismatch(bench, achieved)? {
            None => return Ok(()),
            Some(_) => {
                bench.wait_silently(Duration::from_millis(20))?;
                session.send_request(&Request::KeepAlive)?;
            }
        }
    }
    find_timer_mismatch(bench, achieved)?.map_or(Ok(()), Err)
}

/// What the timers do that was not achieved, if anything; an error is what they must never do.
fn find_timer_mismatch(bench: &Bench, achieved: &[AchievedDrive]) -> Result<Option<String>, String> {
    let Some(outputs) = bench.observe_outputs_for(Windows)? else { return Ok(None) };
    for (channel, output) in (0_u8..).zip(outputs) {
        let windows = output.windows.map_err(|error| format!("channel {channel}: {error}"))?;
        check_equal("ticks with both electrodes on", windows.overlap_ticks(), 0)?;
        let tick_s = windows.tick_length_s(170_000_000);
        if let Some(ticks) = windows.shortest_guard_ticks_if_both_have_windows() {
            let guard_s = f64::from(ticks) * tick_s;
            check_equal(&format!("the guard time of {guard_s} s is at least 200 us"), guard_s >= 200e-6, true)?;
        }
        let Some(drive) = achieved.iter().find(|drive| drive.channel == channel) else {
            if windows.a.length + windows.b.length > 0 {
                return Ok(Some(format!("channel {channel} energises electrodes, but has no drive")));
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

/// The periods of two drives of one frequency begin as far apart as their phases, to a tick each for the two roundings and
/// one for the phase's.
fn check_phase(bench: &Bench, achieved: &[AchievedDrive]) -> CaseResult {
    let Some(outputs) = bench.observe_outputs_for(Phase)? else { return Ok(()) };
    let ([first, second, ..], [first_output, second_output, ..]) = (achieved, &outputs[..]) else {
        return Err("two channels".into());
    };
    let ticks = f64::from(first_output.windows.clone()?.period);
    let turn = 1e-6 * (f64::from(second.phase_microturns) - f64::from(first.phase_microturns));
    let off = (second_output.position_ticks - first_output.position_ticks) / ticks - turn;
    let off_ticks = (off - off.round()).abs() * ticks;
    check_equal(&format!("the phase error of {off_ticks} ticks is at most 3 ticks"), off_ticks <= 3.0, true)
}

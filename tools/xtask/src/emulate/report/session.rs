//! The image in good health: boot, hello, refusals, arm, drive, change, envelope, stop, silence.

use super::bench::{Bench, CLOCKS_PER_MS};
use super::channels::CHANNELS;
use super::drives::{self, change, drives_in_force, many_changes, show};
use super::effects;
use super::expected::{ALL_OFF, off_as_seen, registers, switches, told, told_as_seen};
use super::table::Table;
use crate::error::Error;
use era_shared::limits::DEADMAN_DEFAULT_MS;
use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, ChannelDrive, FaultCode, MIN_VERSION, Refusal, Reply, Request};
use era_shared::safety::{SafetyEvent, SafetyState};

/// What the dead-man time may be exceeded by in ms: one tick of the device's task, one slice of the emulator.
const SILENCE_MARGIN_MS: f64 = 2.0;
/// A version that is not spoken yet.
const TOO_NEW: u8 = CURRENT_VERSION + 7;

type Part = fn(&mut Bench, &mut Table) -> Result<(), Error>;

/// All of it, in one life of the board; what cannot be carried out ends it.
pub fn steps(bench: &mut Bench, table: &mut Table) {
    let parts: [(&str, Part); 7] = [
        ("boot and questions", questions),
        ("refusals", refusals),
        ("arm", arm),
        ("drive and change", drive),
        ("envelopes", effects::steps),
        ("stop", stop),
        ("silence", silence),
    ];
    // Each part begins where the one before it has ended.
    let _ = parts.into_iter().all(|(name, part)| table.part(name, |table| part(bench, table)));
}

fn questions(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    table.same("boot", ALL_OFF, &off_as_seen(bench)?);
    let safe = bench.wait_for(SafetyState::Safe, 100)?;
    table.within("boot: rails measured, safe", 100.0, safe.ok());
    let hello = Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION };
    let versions = |min: u8, current: u8, channels: usize| format!("protocol {min} to {current}, {channels} channels");
    let expected = versions(MIN_VERSION, CURRENT_VERSION, CHANNELS.len());
    let seen = match bench.request(&hello)? {
        Reply::Welcome(welcome) => versions(welcome.protocol_min, welcome.protocol_current, welcome.channels.len()),
        other => format!("{other:?}"),
    };
    table.same("hello", &expected, &seen);
    let seen = match bench.request_as(1, &hello)? {
        Reply::Hello(hello) => versions(hello.protocol_min, hello.protocol_current, hello.channels.len()),
        other => format!("{other:?}"),
    };
    table.same("hello in the words of version 1", &expected, &seen);
    let refused =
        Reply::Refused(Refusal::Version { got: TOO_NEW, device_min: MIN_VERSION, device_current: CURRENT_VERSION });
    let seen = bench.request_as(TOO_NEW, &hello)?;
    table.same("hello in a version that is too new", &format!("{refused:?}"), &format!("{seen:?}"));
    Ok(())
}

fn refusals(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let refused = bench.drive(&drives::FIRST)?;
    let expected = Some(Refusal::State { state: SafetyState::Safe, event: SafetyEvent::Drive });
    table.same("drive without arming", &format!("{expected:?}"), &format!("{refused:?}"));
    let before = bench.status()?.link;
    bench.raw(&garbage()?, 0.05)?;
    let after = bench.status()?;
    let seen = format!("state {}, {} bad frames", after.state.name(), after.link.bad_frames - before.bad_frames);
    table.same("garbage, a cut frame, a changed bit", "state safe, 3 bad frames", &seen);
    table.same("after refusals and garbage", ALL_OFF, &off_as_seen(bench)?);
    Ok(())
}

/// A stretch of bytes that is no frame, the first half of an `Arm`, and an `Arm` with one bit changed.
fn garbage() -> Result<Vec<u8>, Error> {
    let mut frame = [0; MAX_ENCODED];
    let arm = Request::Arm { deadman_ms: None };
    let length = encode_frame(CURRENT_VERSION, FrameKind::Request, 9, &arm, &mut frame).map_err(Error::Encode)?;
    let frame: Vec<u8> = frame.iter().take(length).copied().collect();
    // Every value but the frame's end, scattered.
    let noise = (0..300_u32).map(|i| u8::try_from(i * 167 % 255 + 1).unwrap_or(1));
    let mut changed = frame.clone();
    if let Some(byte) = changed.get_mut(length / 2) {
        *byte ^= 0x10;
    }
    let half = frame.iter().copied().take(length / 2);
    Ok(noise.chain([0]).chain(half).chain([0]).chain(changed).collect())
}

fn arm(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let begin = bench.clock()?;
    bench.arm()?;
    let took = bench.milliseconds_since(begin)?;
    table.within("arm: self-test passed", 1_000.0, Some(took));
    table.figure("from arm to armed (self-test)", format!("{took:.1} ms"));
    for (channel, seen) in CHANNELS.into_iter().zip(bench.timers()?) {
        let name = format!("armed: {} counts, blank", channel.timer);
        let expected = registers(channel, None)?;
        // Nothing may reach a pin before a drive is set, whether MOE is on already or not.
        let main_output = told_as_seen(channel, &seen).ends_with("MOE 1");
        table.same(&name, &told(channel, &expected, main_output), &told_as_seen(channel, &seen));
    }
    table.same("armed: switches", "HV 1 discharge 11", &switches(&bench.pins()?));
    bench.follow_edges()?;
    let (_, _, pulses) = bench.edges.total();
    table.same("armed: pulses on any electrode", "0", &pulses.to_string());
    Ok(())
}

fn drive(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    change(bench, table, "drive", None, &drives::FIRST)?;
    let mut now = drives::FIRST;
    let mut next = |table: &mut Table, name: &str, edit: &dyn Fn(&mut [ChannelDrive; 4])| {
        let before = now;
        edit(&mut now);
        change(bench, table, name, Some(&before), &now)
    };
    next(table, "other frequency", &|drives| {
        drives[0].frequency_millihertz = 250_000;
        drives[1].frequency_millihertz = 250_000;
    })?;
    next(table, "other width", &|drives| drives[0].pulse_width_ppm = 400_000)?;
    next(table, "other phase", &|drives| drives[1].phase_microturns = 600_000)?;
    next(table, "lowest and highest frequency", &|drives| {
        drives[2].frequency_millihertz = 20_000;
        drives[3].frequency_millihertz = 999_999;
    })?;
    // The board stays as it is for half a second: equal frequencies must not drift by a tick.
    bench.keep_alive(0.5)?;
    bench.follow_edges()?;
    drives_in_force(bench, table, "half a second later", &now)?;
    many_changes(bench, table, &now)
}

fn stop(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let before = bench.clock()?;
    bench.request(&Request::Stop)?;
    let answered = bench.milliseconds_since(before)?;
    bench.follow_edges()?;
    let off = bench.edges.all_off_since().map(|off| off.saturating_sub(before) as f64 / CLOCKS_PER_MS);
    table.within("stop: all electrodes off", answered, off);
    table.same("stop", ALL_OFF, &off_as_seen(bench)?);
    let safe = bench.wait_for(SafetyState::Safe, 1_100)?;
    let volts = bench.rails()?.rail_volts;
    table.within("stop: safe", 1_000.0, safe.ok());
    let highest = volts.into_iter().fold(0.0, f64::max);
    table.row("stop: true rail voltage when safe", "below 60 V", &format!("{highest:.1} V"), highest < 60.0);
    Ok(())
}

fn silence(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    bench.arm()?;
    let refused = bench.drive(&drives::FIRST)?;
    table.same("silence: drives set", "None", &format!("{refused:?}"));
    bench.keep_alive(0.2)?;
    let last = bench.clock()?;
    bench.request(&Request::KeepAlive)?;
    bench.run(2.0 * f64::from(DEADMAN_DEFAULT_MS) / 1e3)?;
    bench.follow_edges()?;
    let off = bench.edges.all_off_since().map(|off| off.saturating_sub(last) as f64 / CLOCKS_PER_MS);
    let deadman_ms = f64::from(DEADMAN_DEFAULT_MS);
    table.between("silence: all electrodes off", deadman_ms, deadman_ms + SILENCE_MARGIN_MS, off);
    if let Some(off) = off {
        table.figure(
            "from the last keep-alive to all outputs off",
            format!("{off:.3} ms (dead-man time {DEADMAN_DEFAULT_MS} ms)"),
        );
    }
    table.same("silence", ALL_OFF, &off_as_seen(bench)?);
    let fault = bench.fault()?.map(|fault| fault.code);
    table.same("silence: fault", &format!("{:?}", Some(FaultCode::HostSilent)), &format!("{fault:?}"));
    let arm = bench.request(&Request::Arm { deadman_ms: None })?;
    let expected = Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Arm });
    table.same("silence: arm before clearing", &format!("{expected:?}"), &format!("{arm:?}"));
    show(bench.request(&Request::ClearFaults)?, Reply::FaultsCleared, table, "silence: clear");
    let safe = bench.wait_for(SafetyState::Safe, 1_100)?;
    table.within("silence: cleared, safe", 1_000.0, safe.ok());
    Ok(())
}

//! Effects, and the clock that they are timed by.

use crate::bench::{Bench, Outcome, Session, drive, equal};
use era_shared::protocol::{Refusal, Reply, Request};
use era_shared::safety::State;
use era_shared::waveform::{Effect, Segment};
use std::time::Duration;

/// In us: an effect may be this much late, and start this far ahead; see the protocol's documentation.
const LATEST_US: u64 = 100_000;
const EARLIEST_US: u64 = 10_000_000;

fn prepare(session: &mut Session<'_>, channels: u8) -> Outcome {
    let drives = (0..channels).map(|channel| drive(channel, 200_000)).collect();
    match session.ask(&Request::Prepare { drives })? {
        Reply::Prepared { achieved } => equal("prepared channels", achieved.len(), usize::from(channels)),
        other => Err(format!("prepare was answered {other:?}")),
    }
}

fn play(channel: u8, start_us: u64, effect: Effect) -> Request {
    Request::Play { channel, start_us, effect }
}

pub(crate) fn clock(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let before_us = session.clock_us()?;
    let status = session.status()?;
    let after_us = session.clock_us()?;
    equal("the status' time is between two of the clock", (before_us..=after_us).contains(&status.uptime_us), true)?;
    bench.be_silent(Duration::from_millis(100))?;
    equal("100 ms are 100 ms or more", session.clock_us()? >= after_us + 100_000, true)
}

pub(crate) fn effect_on_all_channels(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    let channels = session.channels()?;
    session.arm()?;
    prepare(&mut session, channels)?;
    session.expect_state(State::Running)?;
    equal("prepared drives are silent", windows_on(bench)?.unwrap_or(0), 0)?;
    let start_us = session.clock_us()? + 50_000;
    // Longer than it takes to look at it.
    let pulse = Effect::pulse_train(600, 0, 1);
    for channel in 0..channels {
        equal("play", session.ask(&play(channel, start_us, pulse.clone()))?, Reply::Playing)?;
    }
    bench.be_silent(Duration::from_millis(100))?;
    equal("all play", windows_on(bench)?.unwrap_or(usize::from(channels)), usize::from(channels))?;
    bench.be_silent(Duration::from_millis(800))?;
    equal("and then none", windows_on(bench)?.unwrap_or(0), 0)?;
    // Braked clicks, from a start that the board chooses.
    for channel in 0..channels {
        equal("play at once", session.ask(&play(channel, 0, Effect::click(3, 2)))?, Reply::Playing)?;
    }
    session.expect_state(State::Running)?;
    session.disarm()
}

/// Channels whose timers have windows, where that can be seen.
fn windows_on(bench: &Bench) -> Result<Option<usize>, String> {
    let Some(timers) = bench.timers()? else { return Ok(None) };
    let mut on = 0;
    for registers in &timers {
        let windows = era_shared::waveform::Windows::from_registers(registers).map_err(|error| format!("{error:?}"))?;
        equal("ticks with both electrodes on", windows.overlap(), 0)?;
        on += usize::from(windows.a.length > 0);
    }
    Ok(Some(on))
}

pub(crate) fn effects_queue(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    let click = Effect::click(3, 2);
    let refusal = session.refused(&play(0, 0, click.clone()))?;
    equal("without a drive", refusal, Refusal::NoDrive { channel: 0 })?;
    prepare(&mut session, 1)?;
    equal("beyond the channels", session.refused(&play(9, 0, click.clone()))?, Refusal::NoDrive { channel: 9 })?;
    let start_us = session.clock_us()? + 5_000_000;
    for i in 0..4 {
        let request = play(0, start_us + i * 100_000, click.clone());
        equal("queued", session.ask(&request)?, Reply::Playing)?;
    }
    let refusal = session.refused(&play(0, start_us, click.clone()))?;
    equal("one too many", refusal, Refusal::QueueFull { channel: 0 })?;
    // Setting drives forgets what waits.
    prepare(&mut session, 1)?;
    equal("room again", session.ask(&play(0, start_us, click.clone()))?, Reply::Playing)?;
    let bad = [
        Effect::default(),
        Effect { times: 0, ..click.clone() },
        Effect { times: 1001, ..click },
        Effect { segments: [Segment::Hold { level: 1001, milliseconds: 10 }].into_iter().collect(), times: 1 },
    ];
    for effect in bad {
        equal("an effect out of range", session.refused(&play(0, start_us, effect))?, Refusal::Effect)?;
    }
    session.disarm()?;
    let not_armed = session.refused(&play(0, 0, Effect::click(1, 0)))?;
    equal("not armed", matches!(not_armed, Refusal::State { state: State::Safe, .. }), true)
}

pub(crate) fn late_and_early_effects(bench: &Bench) -> Outcome {
    let mut session = bench.session()?;
    session.arm()?;
    prepare(&mut session, 1)?;
    while session.clock_us()? < 2 * LATEST_US {
        bench.be_silent(Duration::from_millis(50))?;
    }
    let click = Effect::click(3, 2);
    let now_us = session.clock_us()?;
    // Later than this by the time it arrives.
    match session.refused(&play(0, now_us - LATEST_US, click.clone()))? {
        Refusal::Start { start_us, now_us: then_us } => {
            equal("as asked for", start_us, now_us - LATEST_US)?;
            equal("the board's time", then_us >= now_us, true)?;
        }
        other => return Err(format!("a late effect was refused with {other:?}")),
    }
    let far_us = session.clock_us()? + 2 * EARLIEST_US;
    let refusal = session.refused(&play(0, far_us, click.clone()))?;
    equal("too far ahead", matches!(refusal, Refusal::Start { start_us, .. } if start_us == far_us), true)?;
    let ahead_us = session.clock_us()? + 1_000_000;
    equal("in time", session.ask(&play(0, ahead_us, click))?, Reply::Playing)?;
    session.disarm()
}

//! Effects, and the clock that they are timed by.

use crate::bench::{Bench, CaseResult, TestSession, check_equal, make_drive};
use crate::outputs::OutputCheck;
use era_shared::protocol::{Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use era_shared::waveform::{Effect, Segment};
use std::time::Duration;

/// In us: an effect may be this much late, and start this far ahead; see the protocol's documentation.
const LATEST_US: u64 = 100_000;
const EARLIEST_US: u64 = 10_000_000;

fn prepare_drives(session: &mut TestSession<'_>, channels: u8) -> CaseResult {
    let drives = (0..channels).map(|channel| make_drive(channel, 200_000)).collect();
    match session.send_request(&Request::Prepare { drives })? {
        Reply::Prepared { achieved } => check_equal("prepared channels", achieved.len(), usize::from(channels)),
        other => Err(format!("prepare was answered with {other:?}")),
    }
}

fn make_play_request(channel: u8, start_us: u64, effect: Effect) -> Request {
    Request::Play { channel, start_us, effect }
}

pub(crate) fn check_clock_advances(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    let before_us = session.request_clock_us()?;
    let status = session.request_status()?;
    let after_us = session.request_clock_us()?;
    check_equal(
        "the uptime in the status is between the clock readings before and after the status",
        (before_us..=after_us).contains(&status.uptime_us),
        true,
    )?;
    bench.wait_silently(Duration::from_millis(100))?;
    check_equal("the clock advances by 100 ms or more", session.request_clock_us()? >= after_us + 100_000, true)
}

pub(crate) fn effect_on_all_channels(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    let channels = session.request_channel_count()?;
    session.arm_and_await_armed()?;
    prepare_drives(&mut session, channels)?;
    session.expect_state(SafetyState::Running)?;
    check_driving_channel_count(bench, "channels that drive before the effect", 0)?;
    let start_us = session.request_clock_us()? + 50_000;
    // Longer than it takes to look at it.
    let pulse = Effect::new_pulse_train(600, 0, 1);
    for channel in 0..channels {
        check_equal(
            "play",
            session.send_request(&make_play_request(channel, start_us, pulse.clone()))?,
            Reply::Playing,
        )?;
    }
    bench.wait_silently(Duration::from_millis(100))?;
    check_driving_channel_count(bench, "channels that drive during the effect", channels.into())?;
    bench.wait_silently(Duration::from_millis(800))?;
    check_driving_channel_count(bench, "channels that drive after the effect", 0)?;
    // Braked clicks, from a start that the board chooses.
    for channel in 0..channels {
        check_equal(
            "play at once",
            session.send_request(&make_play_request(channel, 0, Effect::new_click(3, 2)))?,
            Reply::Playing,
        )?;
    }
    session.expect_state(SafetyState::Running)?;
    session.disarm_and_await_safe()
}

/// So many channels have windows, and none of them has both electrodes on together.
fn check_driving_channel_count(bench: &Bench, quantity: &str, wanted: usize) -> CaseResult {
    let Some(outputs) = bench.observe_outputs_for(OutputCheck::Effects)? else { return Ok(()) };
    let mut driving = 0;
    for channel in outputs {
        let windows = channel.windows?;
        check_equal("ticks with both electrodes on", windows.overlap_ticks(), 0)?;
        driving += usize::from(windows.a.length > 0);
    }
    check_equal(quantity, driving, wanted)
}

pub(crate) fn effects_queue(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    let click = Effect::new_click(3, 2);
    let refusal = session.expect_refusal(&make_play_request(0, 0, click.clone()))?;
    check_equal("without a drive", refusal, Refusal::NoDrive { channel: 0 })?;
    prepare_drives(&mut session, 1)?;
    check_equal(
        "beyond the channels",
        session.expect_refusal(&make_play_request(9, 0, click.clone()))?,
        Refusal::NoDrive { channel: 9 },
    )?;
    let start_us = session.request_clock_us()? + 5_000_000;
    for i in 0..4 {
        let request = make_play_request(0, start_us + i * 100_000, click.clone());
        check_equal("queued", session.send_request(&request)?, Reply::Playing)?;
    }
    let refusal = session.expect_refusal(&make_play_request(0, start_us, click.clone()))?;
    check_equal("one too many", refusal, Refusal::QueueFull { channel: 0 })?;
    // Setting drives forgets what waits.
    prepare_drives(&mut session, 1)?;
    check_equal("room again", session.send_request(&make_play_request(0, start_us, click.clone()))?, Reply::Playing)?;
    let bad = [
        Effect::default(),
        Effect { times: 0, ..click.clone() },
        Effect { times: 1001, ..click },
        Effect { segments: [Segment::Hold { level: 1001, milliseconds: 10 }].into_iter().collect(), times: 1 },
    ];
    for effect in bad {
        check_equal(
            "an effect out of range",
            session.expect_refusal(&make_play_request(0, start_us, effect))?,
            Refusal::Effect,
        )?;
    }
    session.disarm_and_await_safe()?;
    let not_armed = session.expect_refusal(&make_play_request(0, 0, Effect::new_click(1, 0)))?;
    check_equal("not armed", matches!(not_armed, Refusal::State { state: SafetyState::Safe, .. }), true)
}

pub(crate) fn late_and_early_effects(bench: &Bench) -> CaseResult {
    let mut session = bench.begin_session()?;
    session.arm_and_await_armed()?;
    prepare_drives(&mut session, 1)?;
    while session.request_clock_us()? < 2 * LATEST_US {
        bench.wait_silently(Duration::from_millis(50))?;
    }
    let click = Effect::new_click(3, 2);
    let now_us = session.request_clock_us()?;
    // Later than this by the time it arrives.
    match session.expect_refusal(&make_play_request(0, now_us - LATEST_US, click.clone()))? {
        Refusal::Start { start_us, now_us: then_us } => {
            check_equal("as asked for", start_us, now_us - LATEST_US)?;
            check_equal("the board's time", then_us >= now_us, true)?;
        }
        other => return Err(format!("a late effect was refused with {other:?}")),
    }
    let far_us = session.request_clock_us()? + 2 * EARLIEST_US;
    let refusal = session.expect_refusal(&make_play_request(0, far_us, click.clone()))?;
    check_equal("too far ahead", matches!(refusal, Refusal::Start { start_us, .. } if start_us == far_us), true)?;
    let ahead_us = session.request_clock_us()? + 1_000_000;
    check_equal("in time", session.send_request(&make_play_request(0, ahead_us, click))?, Reply::Playing)?;
    session.disarm_and_await_safe()
}

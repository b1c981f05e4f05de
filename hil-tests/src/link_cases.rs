//! What a device, and the host's client, do with bytes that are not as they should be.

use crate::bench::{Bench, CaseResult, check_equal, encode_request_frame, make_drive};
use era::device::LinkError;
use era::device::sim::SimKnobs;
use era_shared::protocol::{CURRENT_VERSION, MIN_VERSION, Refusal, Reply, Request};
use era_shared::safety::SafetyState;
use std::time::Duration;

pub(crate) fn version_mismatch(bench: &Bench) -> CaseResult {
    bench.begin_session()?;
    for (got, answered_in) in [(CURRENT_VERSION + 1, CURRENT_VERSION), (99, CURRENT_VERSION), (0, MIN_VERSION)] {
        let replies = bench.exchange_raw_bytes(&[&encode_request_frame(got, 77, &Request::Status)?])?;
        let refusal = Refusal::Version { got, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
        check_equal("answer", replies, vec![(answered_in, 77, Reply::Refused(refusal))])?;
    }
    Ok(())
}

pub(crate) fn check_garbage_is_ignored_and_counted(bench: &Bench) -> CaseResult {
    bench.begin_session()?;
    let good = encode_request_frame(CURRENT_VERSION, 21, &Request::Faults)?;
    // A byte sequence without pattern, zeros among it, longer than any frame.
    let noise: Vec<u8> = (0_u32..700).map(|i| (i.wrapping_mul(2_654_435_761) >> 13).to_le_bytes()[0]).collect();
    let mut flipped = good.clone();
    if let Some(byte) = flipped.get_mut(3) {
        *byte ^= 0x40;
    }
    let replies = bench.exchange_raw_bytes(&[&noise, &[0], &flipped, &good, &[0, 0], &noise[..40], &[0]])?;
    check_equal(
        "one answer, to the one good frame",
        replies,
        vec![(CURRENT_VERSION, 21, Reply::Faults { latched: None })],
    )?;
    let mut session = bench.begin_session()?;
    let status = session.expect_state(SafetyState::Safe)?;
    check_equal("bad frames are counted", status.link.bad_frames > 0, true)?;
    Ok(())
}

pub(crate) fn frames_in_pieces(bench: &Bench) -> CaseResult {
    bench.begin_session()?;
    let both = [
        encode_request_frame(CURRENT_VERSION, 31, &Request::Faults)?,
        encode_request_frame(CURRENT_VERSION, 32, &Request::KeepAlive)?,
    ]
    .concat();
    let bytes: Vec<&[u8]> = both.chunks(1).collect();
    let wanted = vec![
        (CURRENT_VERSION, 31, Reply::Faults { latched: None }),
        (CURRENT_VERSION, 32, Reply::Alive { state: SafetyState::Safe }),
    ];
    check_equal("byte by byte", bench.exchange_raw_bytes(&bytes)?, wanted.clone())?;
    check_equal("all at once", bench.exchange_raw_bytes(&[&both])?, wanted)?;
    Ok(())
}

pub(crate) fn silent_device(bench: &Bench) -> CaseResult {
    let control = bench.sim_control().ok_or("no knobs")?;
    let mut session = bench.begin_session()?;
    {
        let _turned = Bench::set_knobs_until_dropped(&control, SimKnobs { silent: true, ..SimKnobs::default() });
        match session.client.request(&Request::Status) {
            Err(LinkError::Silent { request: "status", attempts: 2.., .. }) => {}
            other => return Err(format!("a silent device gave {other:?}")),
        }
    }
    session.expect_state(SafetyState::Safe)?;
    Ok(())
}

pub(crate) fn slow_device(bench: &Bench) -> CaseResult {
    let control = bench.sim_control().ok_or("no knobs")?;
    let mut session = bench.begin_session()?;
    let _turned = Bench::set_knobs_until_dropped(
        &control,
        SimKnobs { reply_delay: Duration::from_millis(60), ..SimKnobs::default() },
    );
    session.arm_and_await_armed()?;
    session.set_drives(&[make_drive(0, 100_000)])?;
    session.expect_state(SafetyState::Running)?;
    session.send_request(&Request::Stop)?;
    Ok(())
}

pub(crate) fn corrupting_line(bench: &Bench) -> CaseResult {
    let control = bench.sim_control().ok_or("no knobs")?;
    let mut session = bench.begin_session()?;
    let _turned = Bench::set_knobs_until_dropped(&control, SimKnobs { corrupt_every: Some(2), ..SimKnobs::default() });
    session.arm_and_await_armed()?;
    for _ in 0..5 {
        session.set_drives(&[make_drive(0, 100_000), make_drive(1, 150_000)])?;
        session.expect_state(SafetyState::Running)?;
    }
    check_equal("broken answers were noticed", session.client.link_statistics().bad_frames > 0, true)?;
    check_equal("broken answers were requested again", session.client.link_statistics().repeats > 0, true)?;
    session.send_request(&Request::Stop)?;
    Ok(())
}

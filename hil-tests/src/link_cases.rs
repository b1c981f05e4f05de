//! What a device, and the host's client, do with bytes that are not as they should be.

use crate::bench::{Bench, Outcome, drive, equal, frame};
use era::device::LinkError;
use era::device::sim::Knobs;
use era_shared::protocol::{CURRENT_VERSION, MIN_VERSION, Refusal, Reply, Request};
use era_shared::safety::State;
use std::time::Duration;

pub(crate) fn version_mismatch(bench: &Bench) -> Outcome {
    bench.session()?;
    for (got, answered_in) in [(CURRENT_VERSION + 1, CURRENT_VERSION), (99, CURRENT_VERSION), (0, MIN_VERSION)] {
        let replies = bench.raw(&[&frame(got, 77, &Request::Status)?])?;
        let refusal = Refusal::Version { got, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
        equal("answer", replies, vec![(answered_in, 77, Reply::Refused(refusal))])?;
    }
    Ok(())
}

pub(crate) fn garbage(bench: &Bench) -> Outcome {
    bench.session()?;
    let good = frame(CURRENT_VERSION, 21, &Request::Faults)?;
    // A byte sequence without pattern, zeros among it, longer than any frame.
    let noise: Vec<u8> = (0_u32..700).map(|i| (i.wrapping_mul(2_654_435_761) >> 13).to_le_bytes()[0]).collect();
    let mut flipped = good.clone();
    if let Some(byte) = flipped.get_mut(3) {
        *byte ^= 0x40;
    }
    let replies = bench.raw(&[&noise, &[0], &flipped, &good, &[0, 0], &noise[..40], &[0]])?;
    equal("one answer, to the one good frame", replies, vec![(CURRENT_VERSION, 21, Reply::Faults { latched: None })])?;
    let mut session = bench.session()?;
    let status = session.expect_state(State::Safe)?;
    equal("bad frames are counted", status.link.bad_frames > 0, true)?;
    Ok(())
}

pub(crate) fn frames_in_pieces(bench: &Bench) -> Outcome {
    bench.session()?;
    let both =
        [frame(CURRENT_VERSION, 31, &Request::Faults)?, frame(CURRENT_VERSION, 32, &Request::KeepAlive)?].concat();
    let bytes: Vec<&[u8]> = both.chunks(1).collect();
    let wanted = vec![
        (CURRENT_VERSION, 31, Reply::Faults { latched: None }),
        (CURRENT_VERSION, 32, Reply::Alive { state: State::Safe }),
    ];
    equal("byte by byte", bench.raw(&bytes)?, wanted.clone())?;
    equal("all at once", bench.raw(&[&both])?, wanted)?;
    Ok(())
}

pub(crate) fn silent_device(bench: &Bench) -> Outcome {
    let control = bench.knobs().ok_or("no knobs")?;
    let mut session = bench.session()?;
    {
        let _turned = Bench::turn(&control, Knobs { silent: true, ..Knobs::default() });
        match session.client.request(&Request::Status) {
            Err(LinkError::Silent { request: "status", attempts: 2.., .. }) => {}
            other => return Err(format!("a silent device gave {other:?}")),
        }
    }
    session.expect_state(State::Safe)?;
    Ok(())
}

pub(crate) fn slow_device(bench: &Bench) -> Outcome {
    let control = bench.knobs().ok_or("no knobs")?;
    let mut session = bench.session()?;
    let _turned = Bench::turn(&control, Knobs { reply_delay: Duration::from_millis(60), ..Knobs::default() });
    session.arm()?;
    session.drive(&[drive(0, 100_000)])?;
    session.expect_state(State::Running)?;
    session.ask(&Request::Stop)?;
    Ok(())
}

pub(crate) fn corrupting_line(bench: &Bench) -> Outcome {
    let control = bench.knobs().ok_or("no knobs")?;
    let mut session = bench.session()?;
    let _turned = Bench::turn(&control, Knobs { corrupt_every: Some(2), ..Knobs::default() });
    session.arm()?;
    for _ in 0..5 {
        session.drive(&[drive(0, 100_000), drive(1, 150_000)])?;
        session.expect_state(State::Running)?;
    }
    equal("broken answers were noticed", session.client.statistics().bad_frames > 0, true)?;
    equal("and asked for again", session.client.statistics().repeats > 0, true)?;
    session.ask(&Request::Stop)?;
    Ok(())
}

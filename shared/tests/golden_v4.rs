//! The bytes of what protocol version 4 adds. What it shares with versions 1 to 3 has the bytes of their files, but for the version and the
//! checksum.
//!
//! **If a test here fails, do not change the test**: a released host or board speaks these bytes. Change the code so
//! that it still does, and give new messages new variants at the end and lines here.

mod support;

use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::waveform::{Effect, Electrode, MAX_WINDOWS, SequenceError, SequenceWindow};
use heapless::Vec as Short;
use support::golden::check_message_bytes;

const VERSION: u8 = 4;

fn check_request_bytes(message: Request, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Request, message, expected);
}

fn check_reply_bytes(message: Reply, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Reply, message, expected);
}

fn make_window(channel: u8, electrode: Electrode, wait_ticks: u32, width_ticks: u32) -> SequenceWindow {
    SequenceWindow { channel, electrode, wait_ticks, width_ticks }
}

#[test]
fn requests() {
    let click = Effect::new_click(2, 1);
    check_request_bytes(
        Request::PlayOnce { number: 300, channel: 1, start_us: 1_000_000, effect: click },
        "1a0401341212ac0201c0843d0202d00f0202cf0f0101aac3afe000",
    );
    let windows = [make_window(0, Electrode::A, 2_000, 10_000), make_window(3, Electrode::B, 70_000, 3_000)];
    check_request_bytes(
        Request::PlayWindows(WindowSequence {
            number: 7,
            start_us: 0,
            rail_millivolts: [2_000_000, 500_000],
            windows: Short::from_slice(&windows).unwrap(),
        }),
        "070401341213070880897aa0c21e020110d00f904e0301f0a204b817323e731300",
    );
    check_request_bytes(Request::NumberedFault, "0a04013412145adf52ca00");
    check_request_bytes(Request::ClearFault { number: 129 }, "0c040134121581019d51bc4300");
}

#[test]
fn replies() {
    check_reply_bytes(Reply::WindowsPlaying { start_us: 123_456_789 }, "0e0402341214959aef3a6d4b621b00");
    let fault = Fault { code: FaultCode::DischargeSlow, at_us: 5_000, detail: 10_900, count: 2 };
    check_reply_bytes(
        Reply::NumberedFault { number: 3, latched: Some(fault) },
        "1204023412150301138827945502591458bc00",
    );
    check_reply_bytes(Reply::NumberedFault { number: 0, latched: None }, "0604023412150105afbab79000");
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::ResetWhileLive, ..fault }) },
        "1104023412070114882794550281facf9800",
    );
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::Reference, ..fault }) },
        "110402341207011588279455022429935300",
    );
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::Electrode, ..fault }) },
        "110402341207011688279455028a5b07d500",
    );
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::Permit, ..fault }) },
        "110402341207011788279455022f885b1e00",
    );
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::Clock, ..fault }) },
        "11040234120701188827945502fa3a0def00",
    );
    check_reply_bytes(
        Reply::Faults { latched: Some(Fault { code: FaultCode::OptionBytes, ..fault }) },
        "110402341207011988279455025fe9512400",
    );
    check_reply_bytes(Reply::Refused(Refusal::Restarting), "0b040234120a10d35020d700");
    check_reply_bytes(Reply::Refused(Refusal::OtherFault { number: 4 }), "0c040234120a1104ebb979d300");
    let current = Refusal::Current { requested_microamps: 640, max_microamps: 500 };
    check_reply_bytes(Reply::Refused(current), "0f040234120a138005f4030dffc1b100");
    let errors = [
        (SequenceError::Empty, "07040234120a1205312e39ff00"),
        (SequenceError::NoSuchChannel { window: 23, channels: 4 }, "0e040234120a1201170403cd7e5800"),
        (
            SequenceError::Width { window: 1, requested_ticks: 5, min_ticks: 3_000, max_ticks: 56_034 },
            "13040234120a12020105b817e2b503d877d12f00",
        ),
        (
            SequenceError::Wait { window: 2, requested_ticks: 6, min_ticks: 2_000, max_ticks: 10_000_000 },
            "14040234120a12030206d00f80ade204a1f71c8500",
        ),
        (SequenceError::TooLong { requested_ms: 2_003, max_ms: 2_000 }, "10040234120a1204d30fd00f01663ca300"),
        (
            SequenceError::Voltage { rail: 2, requested_millivolts: 2_000_001, max_millivolts: 2_000_000 },
            "13040234120a12050281897a80897a5323a9d500",
        ),
    ];
    for (error, bytes) in errors {
        check_reply_bytes(Reply::Refused(Refusal::Sequence(error)), bytes);
    }
}

/// The longest sequence fits a frame.
#[test]
fn as_many_windows_as_there_can_be_fit_a_frame() {
    let longest = make_window(3, Electrode::B, 10_000_000, 56_034);
    // Waits of a second are for few: a sequence of 24 windows of 4 ms after pauses of 16 ms lasts nearly half a second.
    let usual = make_window(3, Electrode::B, 160_000, 40_000);
    let mut out = [0; MAX_ENCODED];
    let mut encode = |windows: &[SequenceWindow]| {
        let sequence = WindowSequence {
            number: u32::MAX,
            start_us: u64::MAX,
            rail_millivolts: [2_000_000; 2],
            windows: Short::from_slice(windows).unwrap(),
        };
        encode_frame(VERSION, FrameKind::Request, 0, &Request::PlayWindows(sequence), &mut out)
    };
    assert!(encode(&[usual; MAX_WINDOWS]).is_ok());
    assert!(encode(&[longest; 22]).is_ok());
}

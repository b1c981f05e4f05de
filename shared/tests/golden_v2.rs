//! The bytes of what protocol version 2 adds. What it shares with version 1 has the bytes of `golden_v1.rs`, but for the version
//! and the checksum.
//!
//! **If a test here fails, do not change the test**: a released host or board speaks these bytes. Change the code so
//! that it still does, and give new messages new variants at the end and lines here.

mod support;

use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::safety::{SafetyEvent, SafetyState};
use era_shared::waveform::{Effect, Segment};
use heapless::Vec as Short;
use serde::Serialize;
use support::golden::check_message_bytes;

const VERSION: u8 = 2;

fn check_request_bytes(message: Request, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Request, message, expected);
}

fn check_reply_bytes(message: Reply, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Reply, message, expected);
}

fn make_welcome_reply() -> WelcomeReply {
    WelcomeReply {
        protocol_min: 1,
        protocol_current: 2,
        board: BoardKind::Stm32G474,
        board_id: *b"golden-board",
        boot_id: 0xDEAD_BEEF,
        reset_cause: ResetCause::Watchdog,
        image: "era-firmware".try_into().unwrap(),
        firmware: FirmwareVersion { major: 0, minor: 2, patch: 0, commit: *b"0123abcd" },
        channels: Short::from_slice(&[support::make_channel_limits()]).unwrap(),
        failure: "panicked at src/main.rs:7".try_into().unwrap(),
    }
}

#[test]
fn requests() {
    check_request_bytes(
        Request::ArmWith { deadman_ms: None, burst_ms: Some(10_000) },
        "06020134120a0801904e7c8a30bd00",
    );
    check_request_bytes(
        Request::Prepare { drives: Short::from_slice(&[support::make_drive(0)]).unwrap() },
        "07020134120b0107f09309abd82808c0843d102c932e00",
    );
    check_request_bytes(
        Request::Play { channel: 3, start_us: 123_456_789, effect: Effect::new_click(3, 2) },
        "19020134120c03959aef3a0202d00f0302cf0f02018c0d53e600",
    );
    check_request_bytes(
        Request::Play { channel: 0, start_us: 0, effect: Effect::new_swell(50, 300, 400) },
        "06020134120c0103030104d00f3208d00fac0201d00f08900301d898a5fe00",
    );
    let levels = [Segment::Hold { level: -1000, milliseconds: 65_535 }, Segment::Cycles { level: 1, count: 1 }];
    let effect = Effect { segments: Short::from_slice(&levels).unwrap(), times: 1_000 };
    check_request_bytes(
        Request::Play { channel: 1, start_us: u64::MAX, effect },
        "12020134120c01ffffffffffffffffff01020fcf0fffff03020201e8077bcab67600",
    );
    check_request_bytes(Request::Clock, "0a020134120d3a82792100");
    check_request_bytes(Request::Details, "0a020134120e80d370b800");
    check_request_bytes(Request::Log, "0a020134120f16e377cf00");
    check_request_bytes(Request::Bootloader { key: BOOTLOADER_KEY }, "0f0201341210d49ebd92043f7062aa00");
}

#[test]
fn replies() {
    check_reply_bytes(
        Reply::Welcome(make_welcome_reply()),
        "28020234120b010201676f6c64656e2d626f617264effdb6f50d030c6572612d6669726d77617265020237303132336162636401e807c0843d80897ac09a0c80fd87511970616e69636b6564206174207372632f6d61696e2e72733a374a7ec39100",
    );
    check_reply_bytes(Reply::ArmedWith { deadman_ms: 250, burst_ms: 2_000 }, "0e020234120cfa01d00fffb086a400");
    check_reply_bytes(Reply::Prepared { achieved: Short::new() }, "06020234120d056d358f5300");
    check_reply_bytes(Reply::Playing, "0a020234120e6e7cc5aa00");
    check_reply_bytes(Reply::Clock { now_us: 123_456_789 }, "0e020234120f959aef3a7494487f00");
    check_reply_bytes(
        Reply::Details(DetailsReply {
            state: SafetyState::Discharging,
            set_point_millivolts: [1_700_000, 50_000],
            rail_millivolts: [1_699_000, 49_000],
            average_microamps: 40,
            interlock_closed: true,
            stop_released: false,
            earth_bonded: true,
            credit_ms: Short::from_slice(&[60_000, 0]).unwrap(),
        }),
        "15020234121006a0e167d08603b8d967e8fe022801060102e0d403051b1f022900",
    );
    check_reply_bytes(Reply::Log { bytes: Short::from_slice(&[1, 0, 255]).unwrap() }, "080202341211030106ffe28d1dfb00");
    check_reply_bytes(Reply::Bootloader, "0a02023412122120c4be00");
    check_reply_bytes(Reply::Alive { state: SafetyState::Arming }, "0b020234120505ea4b3ceb00");
    let fault = Fault { code: FaultCode::TimerStopped, at_us: 1, detail: 3, count: 1 };
    check_reply_bytes(Reply::Faults { latched: Some(fault) }, "0f02023412070112010301d3cfd2bf00");
}

#[test]
fn refusals() {
    check_reply_bytes(Reply::Refused(Refusal::Duty { channel: 2, wait_ms: 100 }), "0d020234120a0802647b3e142c00");
    check_reply_bytes(Reply::Refused(Refusal::StillThere(FaultCode::InterlockOpen)), "0c020234120a0908a358043b00");
    check_reply_bytes(Reply::Refused(Refusal::NoDrive { channel: 1 }), "0c020234120a0a01c4b3f56900");
    check_reply_bytes(
        Reply::Refused(Refusal::Start { start_us: 5, now_us: 1_000_000 }),
        "0f020234120a0b05c0843df625f24f00",
    );
    check_reply_bytes(Reply::Refused(Refusal::Effect), "0b020234120a0c81ef781500");
    check_reply_bytes(Reply::Refused(Refusal::QueueFull { channel: 1 }), "0c020234120a0d010325b42600");
    check_reply_bytes(
        Reply::Refused(Refusal::Burst { requested_ms: 0, min_ms: 1, max_ms: 10_000 }),
        "07020234120a0e0801904e105103c700",
    );
    check_reply_bytes(Reply::Refused(Refusal::Live(SafetyState::Running)), "0c020234120a0f03ad268cfa00");
}

/// The numbers of plain enums: their order is wire format.
#[test]
fn plain_enums_keep_their_numbers() {
    fn encode_variant_number<E: Serialize>(entry: &E) -> u8 {
        let mut out = [0; 4];
        postcard::to_slice(entry, &mut out).unwrap()[0]
    }
    use FaultCode as F;
    let faults = [
        (F::OverCurrent, 6),
        (F::OverVoltage, 7),
        (F::InterlockOpen, 8),
        (F::EmergencyStop, 9),
        (F::EarthOpen, 10),
        (F::RailImplausible, 11),
        (F::RailCollapsed, 12),
        (F::DischargeFailed, 13),
        (F::SelfTest, 14),
        (F::ShortCircuit, 15),
        (F::Watchdog, 16),
        (F::BrownOut, 17),
        (F::TimerStopped, 18),
    ];
    for (code, wire) in faults {
        assert_eq!((encode_variant_number(&code), code.number()), (wire, wire), "{code:?}");
    }
    assert_eq!((encode_variant_number(&SafetyState::Arming), encode_variant_number(&SafetyState::Discharging)), (5, 6));
    assert_eq!(
        (encode_variant_number(&SafetyEvent::Discharged), encode_variant_number(&SafetyEvent::TestPassed)),
        (9, 10)
    );
    for (index, code) in F::ALL.iter().enumerate() {
        assert_eq!(usize::from(code.number()), index, "in order");
    }
}

/// The longest welcome fits a frame.
#[test]
fn the_longest_messages_fit() {
    let most = ChannelLimits {
        min_frequency_millihertz: u32::MAX,
        max_frequency_millihertz: u32::MAX,
        max_voltage_millivolts: u32::MAX,
        min_guard_ns: u32::MAX,
        timer_clock_hz: u32::MAX,
    };
    let typical = WelcomeReply {
        channels: Short::from_slice(&[support::make_channel_limits(); 4]).unwrap(),
        image: "x".repeat(IMAGE_NAME).as_str().try_into().unwrap(),
        failure: "x".repeat(FAILURE_MESSAGE).as_str().try_into().unwrap(),
        boot_id: u32::MAX,
        ..make_welcome_reply()
    };
    let mut out = [0; MAX_ENCODED];
    assert!(encode_frame(2, FrameKind::Reply, 0, &Reply::Welcome(typical.clone()), &mut out).is_ok());
    let extreme = WelcomeReply { channels: Short::from_slice(&[most; 4]).unwrap(), ..typical };
    assert!(encode_frame(2, FrameKind::Reply, 0, &Reply::Welcome(extreme), &mut out).is_ok());
    let longest = Effect {
        segments: Short::from_slice(&[Segment::Ramp { from: -1000, to: 1000, milliseconds: u16::MAX }; 8]).unwrap(),
        times: 1_000,
    };
    let play = Request::Play { channel: 255, start_us: u64::MAX, effect: longest };
    assert!(encode_frame(2, FrameKind::Request, 0, &play, &mut out).is_ok());
    let log = Reply::Log { bytes: Short::from_slice(&[255; LOG_CHUNK]).unwrap() };
    assert!(encode_frame(2, FrameKind::Reply, 0, &log, &mut out).is_ok());
}

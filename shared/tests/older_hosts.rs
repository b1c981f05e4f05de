//! Hosts of other protocol versions: answered in their own words, or told which versions there are.

mod support;

use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use era_shared::safety::{SafetyEvent, SafetyState};
use era_shared::waveform::{Electrode, SequenceWindow};
use heapless::Vec as Short;
use support::{Bench, make_arm_request, make_two_drives_request};

/// Asks as a host of a version does; the answer is in the same version.
fn send_request_in_version(bench: &mut Bench, version: u8, request: &Request) -> Reply {
    let mut frame = [0; MAX_ENCODED];
    let length = encode_frame(version, FrameKind::Request, 9, request, &mut frame).unwrap();
    let (answered_in, sequence, reply) =
        support::decode_reply(&bench.send_bytes_and_collect_answers(0, &frame[..length]));
    assert_eq!((answered_in, sequence), (version, 9));
    reply
}

/// A host of version 2 is answered in version 2; the credit that it is told of is that at the largest force.
#[test]
fn a_host_of_version_2_is_answered_in_its_words() {
    let mut bench = Bench::new();
    let ask = |bench: &mut Bench, request: &Request| send_request_in_version(bench, 2, request);
    let Reply::Welcome(welcome) = ask(&mut bench, &Request::Hello { host_min: 1, host_current: 2 }) else { panic!() };
    assert_eq!((welcome.protocol_min, welcome.protocol_current), (1, 4));
    assert_eq!(ask(&mut bench, &make_arm_request()), Reply::Armed { deadman_ms: 250 });
    assert_eq!(ask(&mut bench, &Request::KeepAlive), Reply::Alive { state: SafetyState::Arming });
    let Reply::Details(details) = ask(&mut bench, &Request::Details) else { panic!() };
    assert_eq!(details.credit_ms.as_slice(), [60_000; 4]);
    assert_eq!(ask(&mut bench, &Request::Credit), Reply::Refused(Refusal::Malformed));
}

#[test]
fn both_versions_are_reported_to_a_foreign_version() {
    let mut bench = Bench::new();
    for (got, answered_in) in [(0_u8, MIN_VERSION), (CURRENT_VERSION + 1, CURRENT_VERSION), (255, CURRENT_VERSION)] {
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(got, FrameKind::Request, 5, &Request::Status, &mut frame).unwrap();
        let (version, sequence, reply) =
            support::decode_reply(&bench.send_bytes_and_collect_answers(0, &frame[..length]));
        assert_eq!((version, sequence), (answered_in, 5));
        let refusal = Refusal::Version { got, device_min: MIN_VERSION, device_current: CURRENT_VERSION };
        assert_eq!(reply, Reply::Refused(refusal));
    }
}

/// A host of version 1 is told nothing that it does not know, whatever happens.
#[test]
fn a_host_of_version_1_is_answered_in_its_words() {
    let mut bench = Bench::new();
    let ask = |bench: &mut Bench, request: &Request| {
        let mut frame = [0; MAX_ENCODED];
        let length = encode_frame(1, FrameKind::Request, 9, request, &mut frame).unwrap();
        let (version, sequence, reply) =
            support::decode_reply(&bench.send_bytes_and_collect_answers(0, &frame[..length]));
        assert_eq!((version, sequence), (1, 9));
        reply
    };
    let Reply::Hello(hello) = ask(&mut bench, &Request::Hello { host_min: 1, host_current: 1 }) else { panic!() };
    assert_eq!((hello.protocol_min, hello.protocol_current), (1, 4));
    assert_eq!(ask(&mut bench, &make_arm_request()), Reply::Armed { deadman_ms: 250 });
    assert_eq!(ask(&mut bench, &Request::KeepAlive), Reply::Alive { state: SafetyState::Armed }, "arming may be live");
    assert!(
        matches!(ask(&mut bench, &make_two_drives_request()), Reply::DrivesSet { .. }),
        "at once, as it is used to"
    );
    bench.wait_ms(support::ARMING_MS);
    assert_eq!(bench.state(), SafetyState::Running);
    assert_eq!(ask(&mut bench, &Request::Stop), Reply::Stopped);
    assert_eq!(ask(&mut bench, &Request::KeepAlive), Reply::Alive { state: SafetyState::Boot }, "not called safe yet");
    bench.wait_ms(support::DISCHARGE_MS);
    assert_eq!(ask(&mut bench, &Request::KeepAlive), Reply::Alive { state: SafetyState::Safe });
    bench.board.interlock_closed = false;
    ask(&mut bench, &make_arm_request());
    bench.wait_ms(2);
    let Reply::Faults { latched: Some(fault) } = ask(&mut bench, &Request::Faults) else { panic!() };
    assert_eq!(fault.code, FaultCode::DriveFailed, "a code that it knows");
    let clear = ask(&mut bench, &Request::ClearFaults);
    assert_eq!(clear, Reply::Refused(Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Clear }));
    let later =
        [Request::Clock, Request::Details, Request::Log, Request::Bootloader { key: BOOTLOADER_KEY }, Request::Credit];
    for later in later {
        assert_eq!(ask(&mut bench, &later), Reply::Refused(Refusal::Malformed));
    }
}

/// Hosts of version 3 are told of what they know, and nothing sounds safer to them than it is.
#[test]
fn a_host_of_version_3_is_answered_in_its_words() {
    let mut bench = Bench::new();
    let ask = |bench: &mut Bench, request: &Request| send_request_in_version(bench, 3, request);
    let window = SequenceWindow { channel: 0, electrode: Electrode::A, wait_ticks: 2_000, width_ticks: 10_000 };
    let windows = Short::from_slice(&[window]).unwrap();
    let one_window = WindowSequence { number: 1, start_us: 0, rail_millivolts: [500_000; 2], windows };
    assert_eq!(
        ask(&mut bench, &Request::PlayWindows(one_window)),
        Reply::Refused(Refusal::Malformed),
        "it does not know windows"
    );
    assert_eq!(ask(&mut bench, &Request::NumberedFault), Reply::Refused(Refusal::Malformed));
    let known = [
        (FaultCode::DischargeSlow, FaultCode::DischargeFailed),
        (FaultCode::ResetWhileLive, FaultCode::DriveFailed),
        (FaultCode::Reference, FaultCode::RailImplausible),
        (FaultCode::Electrode, FaultCode::ShortCircuit),
        (FaultCode::Permit, FaultCode::SelfTest),
        (FaultCode::Clock, FaultCode::ReadBack),
        (FaultCode::OptionBytes, FaultCode::SelfTest),
        (FaultCode::TimerStopped, FaultCode::TimerStopped),
    ];
    for (code, told) in known {
        let now_us = bench.board.now_us;
        bench.device.switch_all_off_and_latch_fault(&mut bench.board, code, 0, now_us);
        let Reply::Faults { latched: Some(fault) } = ask(&mut bench, &Request::Faults) else { panic!() };
        assert_eq!(fault.code, told);
        let Reply::Status(status) = ask(&mut bench, &Request::Status) else { panic!() };
        assert_eq!(status.fault.map(|fault| fault.code), Some(told));
        assert_eq!(ask(&mut bench, &Request::ClearFaults), Reply::FaultsCleared);
    }
}

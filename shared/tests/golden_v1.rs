//! The bytes of protocol version 1.
//!
//! **If a test here fails, do not change the test**: a released host or board speaks these bytes. Change the code so
//! that it still does, and give new messages new variants at the end and lines here.

mod support;

use era_shared::link::FrameKind;
use era_shared::protocol::*;
use era_shared::safety::{SafetyEvent, SafetyState};
use era_shared::waveform::DriveError;
use heapless::Vec as Short;
use serde::Serialize;
use support::golden::check_message_bytes;

const VERSION: u8 = 1;

fn check_request_bytes(message: Request, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Request, message, expected);
}

fn check_reply_bytes(message: Reply, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Reply, message, expected);
}

fn make_achieved_drive() -> AchievedDrive {
    AchievedDrive {
        channel: 1,
        frequency_nanohertz: 150_000_123_456,
        pulse_width_ppm: 666_665,
        phase_microturns: 250_000,
        guard_ns: 1_111_118,
        voltage_millivolts: 999_755,
    }
}

fn make_fault() -> Fault {
    Fault { code: FaultCode::HostSilent, at_us: 123_456_789, detail: 250, count: 2 }
}

#[test]
fn requests() {
    check_request_bytes(Request::Hello { host_min: 1, host_current: 1 }, "0501013412070101ea87ea3000");
    check_request_bytes(Request::Arm { deadman_ms: None }, "060101341201051f720e3e00");
    check_request_bytes(Request::Arm { deadman_ms: Some(250) }, "0d010134120101fa01e9611eaa00");
    check_request_bytes(Request::Disarm, "0a01013412027be566f600");
    check_request_bytes(
        Request::SetDrives { drives: Short::from_slice(&[support::make_drive(0), support::make_drive(1)]).unwrap() },
        "0701013412030207f09309abd8280bc0843d01f09309abd82808c0843dc6560fc800",
    );
    check_request_bytes(Request::Stop, "0a01013412044e40051f00");
    check_request_bytes(Request::KeepAlive, "0a0101341205d870026800");
    check_request_bytes(Request::Status, "0a010134120662210bf100");
    check_request_bytes(Request::Faults, "0a0101341207f4110c8600");
    check_request_bytes(Request::ClearFaults, "0a0101341208650cb31600");
    check_request_bytes(Request::Telemetry, "0a0101341209f33cb46100");
}

#[test]
fn replies() {
    check_reply_bytes(
        Reply::Hello(HelloReply {
            protocol_min: 1,
            protocol_current: 1,
            board: BoardKind::Stm32G474,
            board_id: *b"golden-board",
            boot_id: 0xDEAD_BEEF,
            reset_cause: ResetCause::Watchdog,
            firmware: FirmwareVersion { major: 0, minor: 1, patch: 2, commit: *b"0123abcd" },
            channels: Short::from_slice(&[support::make_channel_limits()]).unwrap(),
            default_deadman_ms: 250,
        }),
        "050102341216010101676f6c64656e2d626f617264effdb6f50d03210102303132336162636401e807c0843d80897ac09a0c80fd8751fa01c495490800",
    );
    check_reply_bytes(Reply::Armed { deadman_ms: 250 }, "0c0102341201fa0105a7f44000");
    check_reply_bytes(Reply::Disarmed, "0a0102341202954ad3e400");
    check_reply_bytes(
        Reply::DrivesSet { achieved: Short::from_slice(&[make_achieved_drive()]).unwrap() },
        "1e01023412030101c0fcd0e5ae04a9d82890a10fcee843cb823d5764524900",
    );
    check_reply_bytes(Reply::Stopped, "0a0102341204a0efb00d00");
    check_reply_bytes(Reply::Alive { state: SafetyState::Fault }, "0b010234120504d209af1a00");
    check_reply_bytes(
        Reply::Status(StatusReply {
            state: SafetyState::Running,
            uptime_us: 10_000_000,
            boot_id: 7,
            fault: Some(make_fault()),
            channels: Short::from_slice(&[
                ChannelStatus { drive: None },
                ChannelStatus { drive: Some(make_achieved_drive()) },
            ])
            .unwrap(),
            link: LinkCounters { good_frames: 300, bad_frames: 2, refused: 1 },
        }),
        "0d01023412060380ade204070109959aef3afa0102021d0101c0fcd0e5ae04a9d82890a10fcee843cb823dac020201fd9a21bd00",
    );
    check_reply_bytes(Reply::Faults { latched: Some(make_fault()) }, "070102341207010c959aef3afa0102afd0a34300");
    check_reply_bytes(Reply::Faults { latched: None }, "0601023412070549aff42f00");
    check_reply_bytes(Reply::FaultsCleared, "0a01023412088ba3060400");
    check_reply_bytes(
        Reply::Telemetry(TelemetryReply {
            uptime_us: 99,
            state: SafetyState::Armed,
            acceleration_peak_mm_per_s2: Some(24_525),
            rail_millivolts: Short::from_slice(&[1_700_000, 0]).unwrap(),
        }),
        "100102341209630201cdbf0102a0e16705250e908200",
    );
}

#[test]
fn refusals() {
    check_reply_bytes(
        Reply::Refused(Refusal::Version { got: 9, device_min: 1, device_current: 1 }),
        "06010234120a08090101b807188a00",
    );
    check_reply_bytes(Reply::Refused(Refusal::Malformed), "0b010234120a0192e15ded00");
    check_reply_bytes(
        Reply::Refused(Refusal::State { state: SafetyState::Safe, event: SafetyEvent::Drive }),
        "0d010234120a020103761bf75700",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive { channel: 1, error: DriveError::NoSuchChannel { channels: 2 } }),
        "08010234120a030106021599ac1600",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive {
            channel: 1,
            error: DriveError::Frequency { requested_millihertz: 5, min_millihertz: 1_000, max_millihertz: 1_000_000 },
        }),
        "13010234120a03010105e807c0843da758b9ca00",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive {
            channel: 1,
            error: DriveError::Voltage { requested_millivolts: 3_000_000, max_millivolts: 2_000_000 },
        }),
        "14010234120a030102c08db70180897a8d93af3b00",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive {
            channel: 1,
            error: DriveError::PulseTooWide { requested_ppm: 990_000, widest_ppm: 939_000, min_guard_ns: 200_000 },
        }),
        "16010234120a030103b0b63cf8a739c09a0c42f4fafd00",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive {
            channel: 1,
            error: DriveError::PulseTooNarrow { requested_ppm: 0, narrowest_ppm: 31 },
        }),
        "09010234120a030104061f5460fe0700",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive { channel: 1, error: DriveError::Phase { requested_microturns: 1_000_000 } }),
        "10010234120a030105c0843de56acd5d00",
    );
    check_reply_bytes(
        Reply::Refused(Refusal::Drive { channel: 1, error: DriveError::NotRepresentable { timer_clock_hz: 1_000 } }),
        "0f010234120a030106e8078855b18100",
    );
    check_reply_bytes(Reply::Refused(Refusal::DuplicateChannel { channel: 3 }), "0c010234120a0403fbe5902800");
    check_reply_bytes(Reply::Refused(Refusal::OtherLink), "0b010234120a058b2530ea00");
    check_reply_bytes(
        Reply::Refused(Refusal::Deadman { requested_ms: 7, min_ms: 50, max_ms: 1_000 }),
        "0f010234120a060732e80768c8584f00",
    );
    check_reply_bytes(Reply::Refused(Refusal::Fault(make_fault())), "07010234120a070c959aef3afa0102952247c500");
}

/// The numbers of plain enums: their order is wire format.
#[test]
fn plain_enums_keep_their_numbers() {
    fn encode_variant_numbers<E: Serialize>(all: &[E]) -> Vec<u8> {
        let mut out = [0; 4];
        all.iter().map(|entry| postcard::to_slice(entry, &mut out).unwrap()[0]).collect()
    }
    use FaultCode as F;
    let faults = [F::HostSilent, F::ArmFailed, F::DriveFailed, F::Panic, F::HardFault, F::ReadBack];
    assert_eq!(encode_variant_numbers(&faults), [0, 1, 2, 3, 4, 5]);
    assert_eq!(faults.map(FaultCode::number), [0, 1, 2, 3, 4, 5]);
    let states = [SafetyState::Boot, SafetyState::Safe, SafetyState::Armed, SafetyState::Running, SafetyState::Fault];
    assert_eq!(encode_variant_numbers(&states), [0, 1, 2, 3, 4]);
    use SafetyEvent as E;
    let events = [E::BootComplete, E::Arm, E::Disarm, E::Drive, E::Rest, E::Stop, E::HostSilent, E::Fault, E::Clear];
    assert_eq!(encode_variant_numbers(&events), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(encode_variant_numbers(&[BoardKind::Simulated, BoardKind::Stm32G474]), [0, 1]);
    use ResetCause as R;
    assert_eq!(encode_variant_numbers(&[R::PowerOn, R::Pin, R::Software, R::Watchdog, R::Other]), [0, 1, 2, 3, 4]);
}

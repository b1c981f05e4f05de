//! The seeds: frames as they are on the wire, and the sessions that a person would try first.

use crate::board::outside;
use crate::decoder::encode_unchecked_frame;
use crate::step::Step;
use era_shared::link::{FrameKind, MAX_BODY, MAX_ENCODED, encode_frame};
use era_shared::protocol::{BOOTLOADER_KEY, CURRENT_VERSION, ChannelDrive, MIN_VERSION, Request, WindowSequence};
use era_shared::waveform::{Effect, Electrode, Segment, SequenceWindow};

/// Name of a seed, which is that of its file, and its bytes.
pub type Seed = (&'static str, Vec<u8>);

/// Seeds of [`crate::decoder::check_decoder_against_reference`]: how many bytes arrive at once, then the bytes.
#[must_use]
pub fn make_decoder_seeds() -> Vec<Seed> {
    let hello = encode_request_frame(&Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION });
    let drives = encode_request_frame(&make_set_drives_request([make_drive(0, 150_000), make_drive(1, 151_500)]));
    let two = [&hello[..], &drives].concat();
    let mut broken = drives.clone();
    broken[5] ^= 0x10;
    let longest = encode_unchecked_frame(CURRENT_VERSION, FrameKind::Request as u8, 1, &[0x5A; MAX_BODY]);
    let too_long = encode_unchecked_frame(CURRENT_VERSION, FrameKind::Request as u8, 1, &[0x5A; MAX_BODY + 1]);
    vec![
        ("frames_at_once", [&[0], &two[..]].concat()),
        ("frames_byte_by_byte", [&[1], &two[..]].concat()),
        ("frames_in_sevens", [&[7], &two[..]].concat()),
        ("broken_then_good", [&[0], &broken[..], &hello].concat()),
        ("cut_then_good", [&[0], &drives[..9], &[0], &hello].concat()),
        ("empty_stretches", [&[3], &[0; 5][..], &hello, &[0; 4]].concat()),
        ("too_short", vec![0, 4, 1, 1, 1, 0, 2, 9, 0]),
        ("stuffing_past_the_end", vec![0, 200, 1, 2, 3, 0]),
        ("longest_frame", [&[0], &longest[..], &hello].concat()),
        ("a_byte_too_long", [&[0], &too_long[..], &hello].concat()),
        ("endless", [&[64], &[0xFF; 600][..], &[0], &hello].concat()),
    ]
}

/// Seeds of [`crate::handle_frame::run_script_with_safety_checks`]: scripts.
#[must_use]
pub fn make_handle_frame_seeds() -> Vec<Seed> {
    let session = [
        make_request_step(0, &Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION }),
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: Some(100) }),
        make_request_step(0, &make_set_drives_request([make_drive(0, 150_000), make_drive(1, 151_500)])),
        ARMING,
        make_request_step(0, &Request::KeepAlive),
        make_request_step(
            0,
            &make_set_drives_request([
                make_drive(3, 20_000),
                make_drive(2, 1_000_000),
                make_drive(0, 150_000),
                make_drive(1, 150_000),
            ]),
        ),
        Step::Wait { ms: 60 },
        make_request_step(0, &Request::Status),
        make_request_step(0, &Request::Telemetry),
        make_request_step(0, &make_set_drives_request([])),
        Step::Wait { ms: 60 },
        make_request_step(0, &Request::Stop),
        ARMING,
        make_request_step(0, &Request::Disarm),
    ];
    let effects = [
        ARMING,
        make_request_step(0, &Request::ArmWith { deadman_ms: Some(1_000), burst_ms: Some(500) }),
        ARMING,
        make_request_step(
            0,
            &Request::Prepare { drives: [make_drive(0, 200_000), make_drive(1, 90_000)].into_iter().collect() },
        ),
        make_request_step(0, &Request::Play { channel: 0, start_us: 0, effect: Effect::new_click(3, 2) }),
        make_request_step(
            0,
            &Request::Play { channel: 1, start_us: 50_000, effect: make_effect_of_every_segment_kind() },
        ),
        make_request_step(
            0,
            &Request::PlayOnce { number: 1, channel: 0, start_us: 0, effect: Effect::new_click(1, 1) },
        ),
        Step::Wait { ms: 200 },
        make_request_step(0, &Request::Play { channel: 0, start_us: 0, effect: make_effect_of_every_segment_kind() }),
        make_request_step(0, &make_set_drives_request([make_drive(0, 201_000)])),
        Step::Wait { ms: 600 },
        make_request_step(0, &Request::Clock),
        make_request_step(0, &Request::Details),
        make_request_step(0, &Request::Log),
        make_request_step(0, &Request::Credit),
        make_request_step(0, &Request::PlayWindows(make_window_sequence())),
        Step::Wait { ms: 200 },
        make_request_step(0, &Request::PlayWindows(make_window_sequence())),
        make_request_step(0, &Request::NumberedFault),
        make_request_step(0, &Request::ClearFault { number: 0 }),
        make_request_step(0, &Request::Bootloader { key: BOOTLOADER_KEY }),
        make_request_step(0, &Request::Disarm),
        make_request_step(0, &Request::Bootloader { key: BOOTLOADER_KEY }),
        make_request_step(0, &Request::Bootloader { key: 1 }),
    ];
    let silence = [
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: None }),
        ARMING,
        make_request_step(0, &make_set_drives_request([make_drive(0, 80_000)])),
        Step::Wait { ms: 300 },
        make_request_step(0, &Request::Faults),
        make_request_step(0, &Request::Arm { deadman_ms: None }),
        make_request_step(0, &Request::ClearFaults),
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: Some(50) }),
        Step::Late { ms: 51 },
        make_request_step(0, &Request::KeepAlive),
    ];
    let two_links = [
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: Some(1_000) }),
        ARMING,
        make_request_step(1, &Request::Arm { deadman_ms: None }),
        make_request_step(1, &make_set_drives_request([make_drive(0, 100_000)])),
        make_request_step(0, &make_set_drives_request([make_drive(0, 100_000)])),
        make_request_step(1, &Request::KeepAlive),
        make_request_step(1, &Request::Stop),
        ARMING,
        make_request_step(1, &Request::Arm { deadman_ms: None }),
        Step::Wait { ms: 1_001 },
    ];
    let faults = [
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: None }),
        Step::Fault { code: 5, detail: 2 },
        Step::Fault { code: 2, detail: 3 },
        // Of another number, then of its own, twice; and one that is cleared too late to meet its fault.
        make_request_step(0, &Request::ClearFault { number: 2 }),
        make_request_step(0, &Request::ClearFault { number: 1 }),
        make_request_step(0, &Request::ClearFault { number: 1 }),
        Step::Fault { code: 4, detail: 0 },
        make_request_step(0, &Request::ClearFault { number: 1 }),
        make_request_step(0, &Request::ClearFaults),
        ARMING,
        Step::Outside { wrong: outside::INTERLOCK },
        make_request_step(0, &Request::Arm { deadman_ms: None }),
        ARMING,
        make_request_step(0, &Request::ClearFaults),
        Step::Outside { wrong: 0 },
        make_request_step(0, &Request::ClearFaults),
        ARMING,
        Step::Trip { code: 7 },
        ARMING,
        make_request_step(0, &Request::ClearFaults),
        Step::Outside { wrong: outside::RAILS },
        Step::Wait { ms: 1_100 },
    ];
    // Each kind of hardware that refuses, from arming to driving.
    let hardware = (0..5).flat_map(|bit| {
        [
            Step::Hardware { refuses: 1 << bit },
            make_request_step(0, &Request::ClearFaults),
            ARMING,
            make_request_step(0, &Request::Arm { deadman_ms: None }),
            ARMING,
            make_request_step(0, &make_set_drives_request([make_drive(0, 100_000)])),
            ARMING,
        ]
    });
    let out_of_range = [
        ARMING,
        make_request_step(0, &Request::Arm { deadman_ms: Some(7) }),
        make_request_step(0, &Request::Arm { deadman_ms: None }),
        ARMING,
        make_request_step(0, &make_set_drives_request([make_drive(9, 100_000)])),
        make_request_step(0, &make_set_drives_request([make_drive(0, 2_000_000)])),
        make_request_step(0, &make_set_drives_request([make_drive(0, 100_000), make_drive(0, 100_000)])),
        make_request_step(
            0,
            &make_set_drives_request([ChannelDrive { pulse_width_ppm: 999_999, ..make_drive(0, 900_000) }]),
        ),
        make_request_step(0, &make_set_drives_request([ChannelDrive { pulse_width_ppm: 0, ..make_drive(0, 900_000) }])),
        make_request_step(
            0,
            &make_set_drives_request([ChannelDrive { voltage_millivolts: 9_000_000, ..make_drive(0, 900_000) }]),
        ),
        make_request_step(
            0,
            &make_set_drives_request([ChannelDrive { phase_microturns: 1_000_000, ..make_drive(0, 900_000) }]),
        ),
    ];
    let keep_alive = encode_request_frame(&Request::KeepAlive);
    let noise = [
        Step::Bytes { link: 0, bytes: vec![0xA5; 40] },
        Step::Bytes { link: 0, bytes: keep_alive[..4].to_vec() },
        Step::Reopen { link: 0 },
        Step::Bytes { link: 0, bytes: keep_alive },
        Step::Request { link: 0, body: vec![0xEE; 3] },
        Step::Request { link: 0, body: vec![1; MAX_BODY] },
        Step::Frame { link: 1, version: 0, kind: 1, body: vec![5] },
        Step::Frame { link: 1, version: 200, kind: 1, body: vec![5] },
        Step::Frame { link: 1, version: CURRENT_VERSION, kind: 2, body: vec![2] },
        Step::Frame { link: 1, version: CURRENT_VERSION, kind: 9, body: vec![5] },
    ];
    // Every version that is spoken gets the same session.
    let versions = (MIN_VERSION..=CURRENT_VERSION).flat_map(|version| {
        let say = move |request: Request| {
            [
                Step::Frame { link: 0, version, kind: FrameKind::Request as u8, body: encode_request_body(&request) },
                ARMING,
            ]
        };
        let hello = Request::Hello { host_min: version, host_current: version };
        let arm = Request::Arm { deadman_ms: None };
        [
            hello,
            arm,
            make_set_drives_request([make_drive(0, 150_000)]),
            Request::Status,
            Request::Clock,
            Request::Disarm,
        ]
        .into_iter()
        .flat_map(say)
    });
    vec![
        ("session", encode_script(session)),
        ("effects", encode_script(effects)),
        ("hardware", encode_script(hardware)),
        ("silence", encode_script(silence)),
        ("two_links", encode_script(two_links)),
        ("faults", encode_script(faults)),
        ("out_of_range", encode_script(out_of_range)),
        ("noise", encode_script(noise)),
        ("versions", encode_script(versions)),
    ]
}

/// Time for rails to be seen as discharged, or for a self-test to be done.
const ARMING: Step = Step::Wait { ms: 20 };

/// An effect with each kind of segment.
fn make_effect_of_every_segment_kind() -> Effect {
    let segments = [
        Segment::Ramp { from: 0, to: 1_000, milliseconds: 20 },
        Segment::Hold { level: 500, milliseconds: 10 },
        Segment::Cycles { level: -1_000, count: 2 },
        Segment::Hold { level: 0, milliseconds: 5 },
    ];
    Effect { segments: segments.into_iter().collect(), times: 3 }
}

fn encode_script(steps: impl IntoIterator<Item = Step>) -> Vec<u8> {
    let mut bytes = Vec::new();
    steps.into_iter().for_each(|step| step.append_encoded_step(&mut bytes));
    bytes
}

fn make_request_step(link: usize, request: &Request) -> Step {
    Step::Request { link, body: encode_request_body(request) }
}

fn encode_request_body(request: &Request) -> Vec<u8> {
    let mut bytes = [0; MAX_BODY];
    postcard::to_slice(request, &mut bytes).map(|body| body.to_vec()).unwrap_or_default()
}

fn encode_request_frame(request: &Request) -> Vec<u8> {
    let mut bytes = [0; MAX_ENCODED];
    let length = encode_frame(CURRENT_VERSION, FrameKind::Request, 1, request, &mut bytes).unwrap_or(0);
    bytes[..length].to_vec()
}

fn make_set_drives_request(drives: impl IntoIterator<Item = ChannelDrive>) -> Request {
    Request::SetDrives { drives: drives.into_iter().collect() }
}

/// Half a half period wide, so that 1 kHz is possible; 1 kV.
fn make_drive(channel: u8, frequency_millihertz: u32) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz,
        pulse_width_ppm: 500_000,
        phase_microturns: 0,
        voltage_millivolts: 1_000_000,
    }
}

/// Two windows on each of two channels.
fn make_window_sequence() -> WindowSequence {
    let window = |channel, electrode| SequenceWindow { channel, electrode, wait_ticks: 2_000, width_ticks: 10_000 };
    let of = |channel| [window(channel, Electrode::A), window(channel, Electrode::B)];
    WindowSequence {
        number: 7,
        start_us: 0,
        rail_millivolts: [500_000, 700_000],
        windows: of(0).into_iter().chain(of(3)).collect(),
    }
}

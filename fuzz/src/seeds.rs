//! The seeds: frames as they are on the wire, and the sessions that a person would try first.

use crate::decoder::encoded;
use crate::step::Step;
use era_shared::link::{Kind, MAX_BODY, MAX_ENCODED, encode};
use era_shared::protocol::{CURRENT_VERSION, ChannelDrive, MIN_VERSION, Request};

/// Name of a seed, which is that of its file, and its bytes.
pub type Seed = (&'static str, Vec<u8>);

/// Seeds of [`crate::decoder::run`]: how many bytes arrive at once, then the bytes.
#[must_use]
pub fn decoder() -> Vec<Seed> {
    let hello = wire(&Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION });
    let drives = wire(&set([drive(0, 150_000), drive(1, 151_500)]));
    let two = [&hello[..], &drives].concat();
    let mut broken = drives.clone();
    broken[5] ^= 0x10;
    let longest = encoded(CURRENT_VERSION, Kind::Request as u8, 1, &[0x5A; MAX_BODY]);
    let too_long = encoded(CURRENT_VERSION, Kind::Request as u8, 1, &[0x5A; MAX_BODY + 1]);
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

/// Seeds of [`crate::handle_frame::run`]: scripts.
#[must_use]
pub fn handle_frame() -> Vec<Seed> {
    let session = [
        ask(0, &Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION }),
        ask(0, &Request::Arm { deadman_ms: Some(100) }),
        ask(0, &set([drive(0, 150_000), drive(1, 151_500)])),
        Step::Wait { ms: 60 },
        ask(0, &Request::KeepAlive),
        ask(0, &set([drive(3, 20_000), drive(2, 1_000_000)])),
        ask(0, &Request::Status),
        ask(0, &Request::Telemetry),
        ask(0, &set([])),
        ask(0, &Request::Stop),
        ask(0, &Request::Disarm),
    ];
    let silence = [
        ask(0, &Request::Arm { deadman_ms: None }),
        ask(0, &set([drive(0, 80_000)])),
        Step::Wait { ms: 300 },
        ask(0, &Request::Faults),
        ask(0, &Request::Arm { deadman_ms: None }),
        ask(0, &Request::ClearFaults),
        ask(0, &Request::Arm { deadman_ms: Some(50) }),
        Step::Late { ms: 51 },
        ask(0, &Request::KeepAlive),
    ];
    let two_links = [
        ask(0, &Request::Arm { deadman_ms: Some(1_000) }),
        ask(1, &Request::Arm { deadman_ms: None }),
        ask(1, &set([drive(0, 100_000)])),
        ask(0, &set([drive(0, 100_000)])),
        ask(1, &Request::KeepAlive),
        ask(1, &Request::Stop),
        ask(1, &Request::Arm { deadman_ms: None }),
        Step::Wait { ms: 1_001 },
    ];
    let faults = [
        ask(0, &Request::Arm { deadman_ms: None }),
        Step::Fault { code: 5, detail: 2 },
        Step::Fault { code: 2, detail: 3 },
        ask(0, &Request::ClearFaults),
        Step::Hardware { refuses: 1 },
        ask(0, &Request::Arm { deadman_ms: None }),
        ask(0, &Request::ClearFaults),
        Step::Hardware { refuses: 2 },
        ask(0, &Request::Arm { deadman_ms: None }),
        ask(0, &set([drive(0, 100_000)])),
        Step::Hardware { refuses: 0 },
    ];
    let out_of_range = [
        ask(0, &Request::Arm { deadman_ms: Some(7) }),
        ask(0, &Request::Arm { deadman_ms: None }),
        ask(0, &set([drive(9, 100_000)])),
        ask(0, &set([drive(0, 2_000_000)])),
        ask(0, &set([drive(0, 100_000), drive(0, 100_000)])),
        ask(0, &set([ChannelDrive { pulse_width_ppm: 999_999, ..drive(0, 900_000) }])),
        ask(0, &set([ChannelDrive { pulse_width_ppm: 0, ..drive(0, 900_000) }])),
        ask(0, &set([ChannelDrive { voltage_millivolts: 9_000_000, ..drive(0, 900_000) }])),
        ask(0, &set([ChannelDrive { phase_microturns: 1_000_000, ..drive(0, 900_000) }])),
    ];
    let keep_alive = wire(&Request::KeepAlive);
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
        [Request::Arm { deadman_ms: None }, set([drive(0, 150_000)]), Request::Status, Request::Disarm]
            .map(|request| Step::Frame { link: 0, version, kind: Kind::Request as u8, body: body(&request) })
    });
    vec![
        ("session", script(session)),
        ("silence", script(silence)),
        ("two_links", script(two_links)),
        ("faults", script(faults)),
        ("out_of_range", script(out_of_range)),
        ("noise", script(noise)),
        ("versions", script(versions)),
    ]
}

fn script(steps: impl IntoIterator<Item = Step>) -> Vec<u8> {
    let mut bytes = Vec::new();
    steps.into_iter().for_each(|step| step.write(&mut bytes));
    bytes
}

fn ask(link: usize, request: &Request) -> Step {
    Step::Request { link, body: body(request) }
}

fn body(request: &Request) -> Vec<u8> {
    let mut bytes = [0; MAX_BODY];
    postcard::to_slice(request, &mut bytes).map(|body| body.to_vec()).unwrap_or_default()
}

fn wire(request: &Request) -> Vec<u8> {
    let mut bytes = [0; MAX_ENCODED];
    let length = encode(CURRENT_VERSION, Kind::Request, 1, request, &mut bytes).unwrap_or(0);
    bytes[..length].to_vec()
}

fn set(drives: impl IntoIterator<Item = ChannelDrive>) -> Request {
    Request::SetDrives { drives: drives.into_iter().collect() }
}

/// Two thirds wide, 1 kV.
fn drive(channel: u8, frequency_millihertz: u32) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz,
        pulse_width_ppm: 600_000,
        phase_microturns: 0,
        voltage_millivolts: 1_000_000,
    }
}

//! A host of protocol version 1.

use crate::bench::{Bench, CaseResult, check_equal};
use era_shared::protocol::{FaultCode, Refusal, Reply};
use era_shared::safety::SafetyState;

/// Requests as a host of version 1 sends them, to the byte; `shared/tests/golden_v1.rs` has them too. Arming and driving
/// come so close together that the self-test does not end before `Stop`. They ask for 1 kV, so no real board gets them.
const REQUESTS: [(&str, &str); 14] = [
    ("stop", "0a01013412044e40051f00"),
    ("clear-faults", "0a0101341208650cb31600"),
    ("hello", "0501013412070101ea87ea3000"),
    ("status", "0a010134120662210bf100"),
    ("arm", "060101341201051f720e3e00"),
    ("arm 250", "0d010134120101fa01e9611eaa00"),
    ("set-drives", "0701013412030207f09309abd8280bc0843d01f09309abd82808c0843dc6560fc800"),
    ("keep-alive", "0a0101341205d870026800"),
    ("telemetry", "0a0101341209f33cb46100"),
    ("status", "0a010134120662210bf100"),
    ("faults", "0a0101341207f4110c8600"),
    ("disarm", "0a01013412027be566f600"),
    ("keep-alive", "0a0101341205d870026800"),
    ("set-drives", "0701013412030207f09309abd8280bc0843d01f09309abd82808c0843dc6560fc800"),
];

fn parse_hex(hex: &str) -> Result<Vec<u8>, String> {
    let digits: Vec<char> = hex.chars().filter(|digit| !digit.is_whitespace()).collect();
    digits
        .chunks(2)
        .map(|pair| u8::from_str_radix(&pair.iter().collect::<String>(), 16).map_err(|error| error.to_string()))
        .collect()
}

/// Whether version 1 has this state.
const fn is_version_1_state(state: SafetyState) -> bool {
    matches!(
        state,
        SafetyState::Boot | SafetyState::Safe | SafetyState::Armed | SafetyState::Running | SafetyState::Fault
    )
}

pub(crate) fn version_1_session(bench: &Bench) -> CaseResult {
    bench.begin_session()?;
    let frames = REQUESTS.iter().map(|(_, hex)| parse_hex(hex)).collect::<Result<Vec<_>, _>>()?;
    let replies = bench.exchange_raw_bytes(&[&frames.concat()])?;
    check_equal("answers", replies.len(), REQUESTS.len())?;
    for ((name, _), (version, sequence, reply)) in REQUESTS.iter().zip(&replies) {
        check_equal(&format!("{name}: version and sequence"), (*version, *sequence), (1, 0x1234))?;
        let known = match (*name, reply) {
            ("stop", Reply::Stopped)
            | ("clear-faults", Reply::FaultsCleared)
            | ("arm" | "arm 250", Reply::Armed { deadman_ms: 250 })
            | ("faults", Reply::Faults { latched: None })
            | ("disarm", Reply::Disarmed) => true,
            ("hello", Reply::Hello(hello)) => hello.protocol_min == 1 && hello.default_deadman_ms == 250,
            ("keep-alive", Reply::Alive { state }) => is_version_1_state(*state),
            ("telemetry", Reply::Telemetry(telemetry)) => is_version_1_state(telemetry.state),
            ("status", Reply::Status(status)) => {
                let fault_known = status.fault.is_none_or(|fault| fault.code.number() <= FaultCode::ReadBack.number());
                is_version_1_state(status.state) && fault_known
            }
            ("set-drives", Reply::DrivesSet { achieved }) => achieved.len() == 2,
            ("set-drives", Reply::Refused(Refusal::State { state, .. })) => is_version_1_state(*state),
            _ => false,
        };
        check_equal(&format!("the answer {reply:?} to {name} is valid in version 1"), known, true)?;
    }
    let answer = |place: usize| replies.get(place).map(|(_, _, reply)| reply);
    // What tests itself may be live; what discharges is not called safe.
    let armed = matches!(answer(7), Some(Reply::Alive { state: SafetyState::Armed | SafetyState::Running }));
    check_equal("while armed", armed, true)?;
    check_equal("drives are set while armed", matches!(answer(6), Some(Reply::DrivesSet { .. })), true)?;
    let refused = matches!(answer(13), Some(Reply::Refused(Refusal::State { .. })));
    check_equal("drives are refused after disarm", refused, true)
}

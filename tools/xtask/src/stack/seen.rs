//! What the stack really held: the most that was in use on the emulated board through a session that does everything, and
//! whether its interrupts have the priorities that the analysis counts with.

use super::{Program, StackError};
use crate::emulate::bridge::{Bridge, Pace};
use crate::emulate::link::{Link, encode_request_frame, exchange_bytes_until_first_frame};
use crate::error::Error;
use era_shared::protocol::{CURRENT_VERSION, ChannelDrive, Reply, Request, WindowSequence};
use era_shared::waveform::{Effect, Electrode, MAX_WINDOWS, SequenceWindow};
use serde::Deserialize;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Interrupt set-enable registers and priority registers (ARMv7-M, B3.4.4 and B3.4.9).
const NVIC_ISER: usize = 0xE000_E100;
const NVIC_IPR: usize = 0xE000_E400;
/// Of a priority's byte, this chip has the upper four bits.
const PRIORITY_SHIFT: usize = 4;
/// First interrupt in the vector table.
const FIRST_INTERRUPT: usize = 16;
/// Longest wait for the rails' discharge and for a self-test, in s.
const READY_S: f64 = 0.1;

#[derive(Deserialize)]
struct Used {
    used: u32,
}

#[derive(Deserialize)]
struct Word {
    value: u32,
}

/// Runs the image through the session and returns the most bytes of stack that were in use, start-up included.
///
/// # Errors
/// What the bridge says, or [`StackError::Priority`].
pub fn check_interrupt_priorities_and_measure_most_stack_bytes_in_use(
    image: &Path,
    program: &Program,
    priorities: &BTreeMap<String, u8>,
) -> Result<u32, Error> {
    let mut bridge = Bridge::start(image, Pace::Paused)?;
    let asked = run_session_of_all_requests_noise_and_silence_returning_names(&mut bridge)?;
    let missing: Vec<&str> = REQUESTS.iter().copied().filter(|name| !asked.contains(name)).collect();
    if !missing.is_empty() {
        let source = StackError::NotAsked(missing.join(", "));
        return Err(Error::Stack { path: image.to_path_buf(), source });
    }
    check_interrupt_priorities(&mut bridge, program, priorities)
        .map_err(|source| Error::Stack { path: image.to_path_buf(), source })?;
    let Used { used } = bridge.send_command_and_parse(&json!({"op": "stack"}))?;
    Ok(used)
}

/// Every request, four channels at the highest frequency and with effects, noise while they run, silence, and a fault cleared. The names
/// of the requests.
fn run_session_of_all_requests_noise_and_silence_returning_names(
    bridge: &mut Bridge,
) -> Result<BTreeSet<&'static str>, Error> {
    let mut link = Link::default();
    let mut asked = BTreeSet::new();
    let prepared = (0..4).map(|channel| make_drive(channel, 1_000_000)).collect();
    let drives = |frequency_millihertz| Request::SetDrives {
        drives: (0..4).map(|channel| make_drive(channel, frequency_millihertz)).collect(),
    };
    let play = |channel| Request::Play { channel, start_us: 0, effect: Effect::new_swell(20, 20, 20) };
    let questions = [
        Request::Status,
        Request::Telemetry,
        Request::Faults,
        Request::Clock,
        Request::Details,
        Request::Log,
        Request::Credit,
        Request::NumberedFault,
    ];
    let mut ask = |bridge: &mut Bridge, request: &Request| {
        asked.insert(name(request));
        match link.send_request(bridge, request)? {
            Reply::Refused(refusal) => Err(Error::NoReply(format!("{request:?} was refused: {refusal:?}"))),
            _ => Ok(()),
        }
    };

    ask(bridge, &Request::Hello { host_min: 1, host_current: CURRENT_VERSION })?;
    advance_time(bridge, READY_S)?;
    ask(bridge, &Request::Arm { deadman_ms: Some(1_000) })?;
    advance_time(bridge, READY_S)?;
    ask(bridge, &Request::Disarm)?;
    advance_time(bridge, READY_S)?;
    ask(bridge, &Request::ArmWith { deadman_ms: Some(1_000), burst_ms: None })?;
    advance_time(bridge, READY_S)?;
    for frequency_millihertz in [1_000_000, 150_000, 999_999] {
        ask(bridge, &drives(frequency_millihertz))?;
        advance_time(bridge, 0.1)?;
    }
    for channel in 0..4 {
        ask(bridge, &play(channel))?;
        ask(
            bridge,
            &Request::PlayOnce {
                number: 1 + u32::from(channel),
                channel,
                start_us: 0,
                effect: Effect::new_click(1, 1),
            },
        )?;
    }
    ask(bridge, &Request::PlayWindows(make_longest_window_sequence_on_all_channels()))?;
    ask(bridge, &Request::KeepAlive)?;
    for question in &questions {
        ask(bridge, question)?;
    }
    exchange_bytes_until_first_frame(bridge, &[0xA5; 600], 0.05)?;
    exchange_bytes_until_first_frame(bridge, &encode_request_frame(u8::MAX, 1, &Request::Status)?, 0.05)?;
    advance_time(bridge, 0.1)?;
    ask(bridge, &Request::Prepare { drives: prepared })?;
    for channel in 0..4 {
        ask(bridge, &play(channel))?;
    }
    advance_time(bridge, 0.1)?;
    ask(bridge, &drives(20_000))?;
    // The dead-man time is 1 s.
    advance_time(bridge, 1.2)?;
    ask(bridge, &Request::Faults)?;
    ask(bridge, &Request::ClearFaults)?;
    ask(bridge, &Request::ClearFault { number: 1 })?;
    ask(bridge, &Request::Stop)?;
    Ok(asked)
}

/// Names of all requests, the compiler sees to that; those of a session are all but that for the bootloader, which ends the program whose
/// stack is looked at.
macro_rules! requests {
    ($($name:ident),+) => {
        const REQUESTS: &[&str] = &[$(stringify!($name)),+];

        const fn name(request: &Request) -> &'static str {
            match request {
                $(Request::$name { .. } => stringify!($name),)+
                Request::Bootloader { .. } => "Bootloader",
            }
        }
    };
}

requests!(
    Hello,
    Arm,
    Disarm,
    SetDrives,
    Stop,
    KeepAlive,
    Status,
    Faults,
    ClearFaults,
    Telemetry,
    ArmWith,
    Prepare,
    Play,
    Clock,
    Details,
    Log,
    Credit,
    PlayOnce,
    PlayWindows,
    NumberedFault,
    ClearFault
);

/// Half of the half period wide, as 1 kHz with its guards allows.
const fn make_drive(channel: u8, frequency_millihertz: u32) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz,
        pulse_width_ppm: 500_000,
        phase_microturns: 0,
        voltage_millivolts: 200_000,
    }
}

/// As many windows as there can be, on all channels, 1 ms each.
fn make_longest_window_sequence_on_all_channels() -> WindowSequence {
    let window = |channel| SequenceWindow { channel, electrode: Electrode::A, wait_ticks: 40_000, width_ticks: 10_000 };
    let windows = (0_u8..4).cycle().take(MAX_WINDOWS).map(window).collect();
    WindowSequence { number: 100, start_us: 0, rail_millivolts: [200_000; 2], windows }
}

fn advance_time(bridge: &mut Bridge, seconds: f64) -> Result<(), Error> {
    bridge.send_command(&json!({"op": "run_for", "seconds": seconds})).map(drop)
}

/// Every interrupt that is enabled must have the priority that the budget says, 0 where it says nothing.
fn check_interrupt_priorities(
    bridge: &mut Bridge,
    program: &Program,
    priorities: &BTreeMap<String, u8>,
) -> Result<(), StackError> {
    let mut word = |address: usize| {
        let answer = bridge.send_command_and_parse(&json!({"op": "read", "address": address}));
        answer.map(|Word { value }| value).map_err(|error| StackError::Board(error.to_string()))
    };
    for (vector, position) in program.vectors.range(FIRST_INTERRUPT..) {
        let number = vector - FIRST_INTERRUPT;
        if word(NVIC_ISER + number / 32 * 4)? >> (number % 32) & 1 == 0 {
            continue;
        }
        let names = program.functions.get(*position).map(|function| &function.names[..]).unwrap_or_default();
        let budget = names.iter().find_map(|name| priorities.get(name)).copied().unwrap_or(0);
        let byte = word(NVIC_IPR + number / 4 * 4)? >> (number % 4 * 8) & 0xFF;
        let found = byte >> PRIORITY_SHIFT;
        if found != u32::from(budget) {
            return Err(StackError::Priority { handler: names.join(", "), number, found, budget });
        }
    }
    Ok(())
}

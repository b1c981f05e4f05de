//! What a host of an older version is told: nothing that it does not know, and nothing that sounds safer than it is.

use super::{CURRENT_VERSION, Fault, FaultCode, Refusal, Reply};
use crate::safety::{Event, State};

/// A reply in the words of `version`.
#[must_use]
pub fn for_version(reply: Reply, version: u8) -> Reply {
    // Not "from 3 on": what a fourth version adds would have to be put into the words of the third.
    match version {
        CURRENT_VERSION.. => reply,
        2 => for_2(reply),
        _ => for_1(reply),
    }
}

/// Version 3 adds an answer, to a request that version 2 does not have, and nothing else.
fn for_2(reply: Reply) -> Reply {
    if matches!(reply, Reply::Credit(_)) { Reply::Refused(Refusal::Malformed) } else { reply }
}

fn for_1(reply: Reply) -> Reply {
    match reply {
        Reply::Alive { state } => Reply::Alive { state: state_of_1(state) },
        Reply::Status(mut status) => {
            status.state = state_of_1(status.state);
            status.fault = status.fault.map(fault_of_1);
            Reply::Status(status)
        }
        Reply::Faults { latched } => Reply::Faults { latched: latched.map(fault_of_1) },
        Reply::Telemetry(mut telemetry) => {
            telemetry.state = state_of_1(telemetry.state);
            Reply::Telemetry(telemetry)
        }
        Reply::Refused(refusal) => Reply::Refused(refusal_of_1(refusal)),
        known @ (Reply::Hello(_)
        | Reply::Armed { .. }
        | Reply::Disarmed
        | Reply::DrivesSet { .. }
        | Reply::Stopped
        | Reply::FaultsCleared) => known,
        // Answers to requests that version 1 does not have.
        Reply::Welcome(_)
        | Reply::ArmedWith { .. }
        | Reply::Prepared { .. }
        | Reply::Playing
        | Reply::Clock { .. }
        | Reply::Details(_)
        | Reply::Log { .. }
        | Reply::Bootloader
        | Reply::Credit(_) => Reply::Refused(Refusal::Malformed),
    }
}

/// Version 1 has neither a self-test nor a measured discharge. What is being tested may be live, and what is being
/// discharged is not called safe.
const fn state_of_1(state: State) -> State {
    match state {
        State::Arming => State::Armed,
        State::Discharging => State::Boot,
        known => known,
    }
}

fn fault_of_1(fault: Fault) -> Fault {
    let known = fault.code.number() <= FaultCode::ReadBack.number();
    Fault { code: if known { fault.code } else { FaultCode::DriveFailed }, ..fault }
}

fn refusal_of_1(refusal: Refusal) -> Refusal {
    match refusal {
        Refusal::State { state, event } => Refusal::State { state: state_of_1(state), event },
        Refusal::Fault(fault) => Refusal::Fault(fault_of_1(fault)),
        Refusal::Duty { .. } => Refusal::State { state: State::Armed, event: Event::Drive },
        Refusal::StillThere(_) => Refusal::State { state: State::Fault, event: Event::Clear },
        Refusal::Live(state) => Refusal::State { state: state_of_1(state), event: Event::Stop },
        known @ (Refusal::Version { .. }
        | Refusal::Malformed
        | Refusal::Drive { .. }
        | Refusal::DuplicateChannel { .. }
        | Refusal::OtherLink
        | Refusal::Deadman { .. }) => known,
        Refusal::NoDrive { .. }
        | Refusal::Start { .. }
        | Refusal::Effect
        | Refusal::QueueFull { .. }
        | Refusal::Burst { .. } => Refusal::Malformed,
    }
}

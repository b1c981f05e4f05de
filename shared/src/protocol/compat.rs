//! What a host of an older version is told: nothing that it does not know, and nothing that sounds safer than it is.

use super::{CURRENT_VERSION, Fault, FaultCode, Refusal, Reply};
use crate::safety::{SafetyEvent, SafetyState};

/// Replaces what a host of `version` does not know by what it knows.
#[must_use]
pub fn translate_for_version(reply: Reply, version: u8) -> Reply {
    // Not "from 4 on": what a fifth version adds would have to be translated for the fourth.
    match version {
        CURRENT_VERSION.. => reply,
        3 => translate_for_version_3(reply),
        2 => translate_version_3_reply_to_2(translate_for_version_3(reply)),
        _ => translate_for_version_1(translate_for_version_3(reply)),
    }
}

/// Version 4 adds faults, refusals, and answers to requests that version 3 does not have.
fn translate_for_version_3(reply: Reply) -> Reply {
    match reply {
        Reply::Status(mut status) => {
            status.fault = status.fault.map(translate_fault_for_version_3);
            Reply::Status(status)
        }
        Reply::Faults { latched } => Reply::Faults { latched: latched.map(translate_fault_for_version_3) },
        Reply::Refused(refusal) => Reply::Refused(match refusal {
            Refusal::Fault(fault) => Refusal::Fault(translate_fault_for_version_3(fault)),
            Refusal::StillThere(code) => Refusal::StillThere(translate_code_for_version_3(code)),
            Refusal::Restarting => Refusal::State { state: SafetyState::Boot, event: SafetyEvent::Arm },
            Refusal::Current { .. } => Refusal::State { state: SafetyState::Armed, event: SafetyEvent::Drive },
            Refusal::OtherFault { .. } | Refusal::Sequence(_) => Refusal::Malformed,
            known => known,
        }),
        Reply::WindowsPlaying { .. } | Reply::NumberedFault { .. } => Reply::Refused(Refusal::Malformed),
        known => known,
    }
}

fn translate_fault_for_version_3(fault: Fault) -> Fault {
    Fault { code: translate_code_for_version_3(fault.code), ..fault }
}

/// The fault of version 3 that says nothing safer.
const fn translate_code_for_version_3(code: FaultCode) -> FaultCode {
    match code {
        FaultCode::DischargeSlow => FaultCode::DischargeFailed,
        FaultCode::ResetWhileLive => FaultCode::DriveFailed,
        FaultCode::Reference => FaultCode::RailImplausible,
        FaultCode::Electrode => FaultCode::ShortCircuit,
        FaultCode::Permit => FaultCode::SelfTest,
        FaultCode::Clock => FaultCode::ReadBack,
        FaultCode::OptionBytes => FaultCode::SelfTest,
        known => known,
    }
}

/// Version 3 adds an answer, to a request that version 2 does not have, and nothing else.
fn translate_version_3_reply_to_2(reply: Reply) -> Reply {
    if matches!(reply, Reply::Credit(_)) { Reply::Refused(Refusal::Malformed) } else { reply }
}

fn translate_for_version_1(reply: Reply) -> Reply {
    match reply {
        Reply::Alive { state } => Reply::Alive { state: translate_state_for_version_1(state) },
        Reply::Status(mut status) => {
            status.state = translate_state_for_version_1(status.state);
            status.fault = status.fault.map(translate_fault_for_version_1);
            Reply::Status(status)
        }
        Reply::Faults { latched } => Reply::Faults { latched: latched.map(translate_fault_for_version_1) },
        Reply::Telemetry(mut telemetry) => {
            telemetry.state = translate_state_for_version_1(telemetry.state);
            Reply::Telemetry(telemetry)
        }
        Reply::Refused(refusal) => Reply::Refused(translate_refusal_for_version_1(refusal)),
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
        | Reply::Credit(_)
        | Reply::WindowsPlaying { .. }
        | Reply::NumberedFault { .. } => Reply::Refused(Refusal::Malformed),
    }
}

/// Version 1 has neither a self-test nor a measured discharge. A board under self-test may be live, so it is reported as armed; a board
/// that discharges is not reported as safe.
const fn translate_state_for_version_1(state: SafetyState) -> SafetyState {
    match state {
        SafetyState::Arming => SafetyState::Armed,
        SafetyState::Discharging => SafetyState::Boot,
        known => known,
    }
}

fn translate_fault_for_version_1(fault: Fault) -> Fault {
    let known = fault.code.number() <= FaultCode::ReadBack.number();
    Fault { code: if known { fault.code } else { FaultCode::DriveFailed }, ..fault }
}

fn translate_refusal_for_version_1(refusal: Refusal) -> Refusal {
    match refusal {
        Refusal::State { state, event } => Refusal::State { state: translate_state_for_version_1(state), event },
        Refusal::Fault(fault) => Refusal::Fault(translate_fault_for_version_1(fault)),
        Refusal::Duty { .. } => Refusal::State { state: SafetyState::Armed, event: SafetyEvent::Drive },
        Refusal::StillThere(_) => Refusal::State { state: SafetyState::Fault, event: SafetyEvent::Clear },
        Refusal::Live(state) => {
            Refusal::State { state: translate_state_for_version_1(state), event: SafetyEvent::Stop }
        }
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
        | Refusal::Burst { .. }
        | Refusal::Restarting
        | Refusal::OtherFault { .. }
        | Refusal::Sequence(_)
        | Refusal::Current { .. } => Refusal::Malformed,
    }
}

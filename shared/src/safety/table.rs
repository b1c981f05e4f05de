//! The transition table.

use serde::{Deserialize, Serialize};

/// Safety states. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SafetyState {
    /// Starting; outputs are off and nothing is accepted but questions.
    Boot,
    /// Off. High voltage is disabled and every rail is measured to be harmless.
    Safe,
    /// High voltage is enabled, no drive is set (one that was ended runs to its next boundary), the dead-man timer runs.
    Armed,
    /// At least one channel drives its electrodes, the dead-man timer runs.
    Running,
    /// Off, with a latched fault that must be cleared by command.
    Fault,
    /// The self-test before arming: at most 50 V on the rails, electrodes off, the dead-man timer runs.
    Arming,
    /// Off. The rails are not yet measured to be harmless.
    Discharging,
}

impl SafetyState {
    /// Every state, in order.
    pub const ALL: [SafetyState; 7] = [
        SafetyState::Boot,
        SafetyState::Safe,
        SafetyState::Armed,
        SafetyState::Running,
        SafetyState::Fault,
        SafetyState::Arming,
        SafetyState::Discharging,
    ];

    /// Lower-case name, as in logs and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            SafetyState::Boot => "boot",
            SafetyState::Safe => "safe",
            SafetyState::Armed => "armed",
            SafetyState::Running => "running",
            SafetyState::Fault => "fault",
            SafetyState::Arming => "arming",
            SafetyState::Discharging => "discharging",
        }
    }

    /// Whether high voltage may be on in this state.
    #[must_use]
    pub const fn is_live(self) -> bool {
        matches!(self, SafetyState::Arming | SafetyState::Armed | SafetyState::Running)
    }
}

/// What can happen. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SafetyEvent {
    /// Start-up is complete.
    BootComplete,
    /// The host asks to arm.
    Arm,
    /// The host ends its session.
    Disarm,
    /// The host sets drives, at least one of them on.
    Drive,
    /// The host sets all drives off but stays armed.
    Rest,
    /// The host wants everything off at once.
    Stop,
    /// The host that armed was silent for too long.
    HostSilent,
    /// Something went wrong on the board.
    Fault,
    /// The host clears the latched fault.
    Clear,
    /// The rails are measured to be harmless.
    Discharged,
    /// The self-test before arming has passed.
    TestPassed,
}

impl SafetyEvent {
    /// Every event, in order.
    pub const ALL: [SafetyEvent; 11] = [
        SafetyEvent::BootComplete,
        SafetyEvent::Arm,
        SafetyEvent::Disarm,
        SafetyEvent::Drive,
        SafetyEvent::Rest,
        SafetyEvent::Stop,
        SafetyEvent::HostSilent,
        SafetyEvent::Fault,
        SafetyEvent::Clear,
        SafetyEvent::Discharged,
        SafetyEvent::TestPassed,
    ];

    /// Lower-case name, as in logs and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            SafetyEvent::BootComplete => "boot-complete",
            SafetyEvent::Arm => "arm",
            SafetyEvent::Disarm => "disarm",
            SafetyEvent::Drive => "drive",
            SafetyEvent::Rest => "rest",
            SafetyEvent::Stop => "stop",
            SafetyEvent::HostSilent => "host-silent",
            SafetyEvent::Fault => "fault",
            SafetyEvent::Clear => "clear",
            SafetyEvent::Discharged => "discharged",
            SafetyEvent::TestPassed => "test-passed",
        }
    }
}

/// What the device must do on a transition, before anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SafetyAction {
    /// Leave the outputs as they are.
    Keep,
    /// Everything off: [`crate::board::Board::switch_outputs_off`].
    Off,
    /// Begin the self-test.
    Test,
    /// Start the timers, blank, and enable the supply.
    Enable,
    /// Set the drives; while arming, keep them until the self-test has passed.
    Apply,
}

/// An entry of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transition {
    /// Go to the state and carry out the action.
    Go(SafetyState, SafetyAction),
    /// Not in this state: nothing changes.
    Refuse,
}

use SafetyAction::{Apply, Enable, Keep, Off, Test};
use SafetyState::{Armed, Arming, Boot, Discharging, Fault, Running, Safe};
use Transition::{Go, Refuse};

/// What `event` does in `state`. Every pair is written out, or falls under a rule that is written out. Every transition to a state that
/// is not live switches everything off, even if it is off already: an order to be off is never answered by doing nothing.
#[must_use]
pub const fn look_up_transition(state: SafetyState, event: SafetyEvent) -> Transition {
    match (state, event) {
        // From every state.
        (_, SafetyEvent::Fault) => Go(Fault, Off),
        (Armed | Running | Arming, SafetyEvent::HostSilent) => Go(Fault, Off),
        (Armed | Running | Arming, SafetyEvent::Stop | SafetyEvent::Disarm) => Go(Discharging, Off),
        (Boot | Safe | Fault | Discharging, SafetyEvent::Stop | SafetyEvent::Disarm | SafetyEvent::HostSilent) => {
            Go(state, Off)
        }

        (Boot, SafetyEvent::BootComplete) => Go(Discharging, Off),
        (Discharging, SafetyEvent::Discharged) => Go(Safe, Off),
        // While the rails still fall the self-test waits for them.
        (Safe | Discharging, SafetyEvent::Arm) => Go(Arming, Test),
        (Safe | Discharging, SafetyEvent::Clear) => Go(state, Off),
        // Only an explicit Clear leads out of a fault.
        (Fault, SafetyEvent::Clear) => Go(Discharging, Off),

        (Arming, SafetyEvent::TestPassed) => Go(Armed, Enable),
        (Arming, SafetyEvent::Drive | SafetyEvent::Rest) => Go(Arming, Apply),
        // Arming again renews the dead-man time and nothing else.
        (Arming | Armed | Running, SafetyEvent::Arm) => Go(state, Keep),
        (Armed | Running, SafetyEvent::Drive) => Go(Running, Apply),
        (Armed | Running, SafetyEvent::Rest) => Go(Armed, Apply),

        (Boot | Fault, SafetyEvent::Arm) => Refuse,
        (Boot | Safe | Fault | Discharging, SafetyEvent::Drive | SafetyEvent::Rest) => Refuse,
        (Boot | Arming | Armed | Running, SafetyEvent::Clear) => Refuse,
        (Boot | Safe | Fault | Arming | Armed | Running, SafetyEvent::Discharged) => Refuse,
        (Boot | Safe | Fault | Discharging | Armed | Running, SafetyEvent::TestPassed) => Refuse,
        (Safe | Fault | Discharging | Arming | Armed | Running, SafetyEvent::BootComplete) => Refuse,
    }
}

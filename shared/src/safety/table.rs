//! The transition table.

use serde::{Deserialize, Serialize};

/// Safety states. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
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

impl State {
    /// Every state, in order.
    pub const ALL: [State; 7] =
        [State::Boot, State::Safe, State::Armed, State::Running, State::Fault, State::Arming, State::Discharging];

    /// Lower-case name, as in logs and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            State::Boot => "boot",
            State::Safe => "safe",
            State::Armed => "armed",
            State::Running => "running",
            State::Fault => "fault",
            State::Arming => "arming",
            State::Discharging => "discharging",
        }
    }

    /// Whether high voltage may be on in this state.
    #[must_use]
    pub const fn is_live(self) -> bool {
        matches!(self, State::Arming | State::Armed | State::Running)
    }
}

/// What can happen. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Event {
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

impl Event {
    /// Every event, in order.
    pub const ALL: [Event; 11] = [
        Event::BootComplete,
        Event::Arm,
        Event::Disarm,
        Event::Drive,
        Event::Rest,
        Event::Stop,
        Event::HostSilent,
        Event::Fault,
        Event::Clear,
        Event::Discharged,
        Event::TestPassed,
    ];

    /// Lower-case name, as in logs and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Event::BootComplete => "boot-complete",
            Event::Arm => "arm",
            Event::Disarm => "disarm",
            Event::Drive => "drive",
            Event::Rest => "rest",
            Event::Stop => "stop",
            Event::HostSilent => "host-silent",
            Event::Fault => "fault",
            Event::Clear => "clear",
            Event::Discharged => "discharged",
            Event::TestPassed => "test-passed",
        }
    }
}

/// What the device must do on a transition, before anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Leave the outputs as they are.
    Keep,
    /// Everything off: [`crate::board::Board::outputs_off`].
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
pub enum Outcome {
    /// Go to the state and carry out the action.
    Go(State, Action),
    /// Not in this state: nothing changes.
    Refuse,
}

use Action::{Apply, Enable, Keep, Off, Test};
use Outcome::{Go, Refuse};
use State::{Armed, Arming, Boot, Discharging, Fault, Running, Safe};

/// What `event` does in `state`. Every pair is written out or falls under a rule that is; whatever ends in a state that is
/// not live switches everything off, even where it already is: an order to be off is never answered by doing nothing.
#[must_use]
pub const fn transition(state: State, event: Event) -> Outcome {
    match (state, event) {
        // From every state.
        (_, Event::Fault) => Go(Fault, Off),
        (Armed | Running | Arming, Event::HostSilent) => Go(Fault, Off),
        (Armed | Running | Arming, Event::Stop | Event::Disarm) => Go(Discharging, Off),
        (Boot | Safe | Fault | Discharging, Event::Stop | Event::Disarm | Event::HostSilent) => Go(state, Off),

        (Boot, Event::BootComplete) => Go(Discharging, Off),
        (Discharging, Event::Discharged) => Go(Safe, Off),
        // While the rails still fall the self-test waits for them.
        (Safe | Discharging, Event::Arm) => Go(Arming, Test),
        (Safe | Discharging, Event::Clear) => Go(state, Off),
        // Only an explicit Clear leads out of a fault.
        (Fault, Event::Clear) => Go(Discharging, Off),

        (Arming, Event::TestPassed) => Go(Armed, Enable),
        (Arming, Event::Drive | Event::Rest) => Go(Arming, Apply),
        // Arming again renews the dead-man time and nothing else.
        (Arming | Armed | Running, Event::Arm) => Go(state, Keep),
        (Armed | Running, Event::Drive) => Go(Running, Apply),
        (Armed | Running, Event::Rest) => Go(Armed, Apply),

        (Boot | Fault, Event::Arm) => Refuse,
        (Boot | Safe | Fault | Discharging, Event::Drive | Event::Rest) => Refuse,
        (Boot | Arming | Armed | Running, Event::Clear) => Refuse,
        (Boot | Safe | Fault | Arming | Armed | Running, Event::Discharged) => Refuse,
        (Boot | Safe | Fault | Discharging | Armed | Running, Event::TestPassed) => Refuse,
        (Safe | Fault | Discharging | Arming | Armed | Running, Event::BootComplete) => Refuse,
    }
}

//! The transition table.

use serde::{Deserialize, Serialize};

/// Safety states. Wire format: append only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// Starting; outputs are off and nothing is accepted but questions.
    Boot,
    /// Off. High voltage is disabled.
    Safe,
    /// High voltage is enabled, no electrode is driven, the dead-man timer runs.
    Armed,
    /// At least one channel drives its electrodes, the dead-man timer runs.
    Running,
    /// Off, with a latched fault that must be cleared by command.
    Fault,
}

impl State {
    /// Every state, in order.
    pub const ALL: [State; 5] = [State::Boot, State::Safe, State::Armed, State::Running, State::Fault];

    /// Lower-case name, as in logs and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            State::Boot => "boot",
            State::Safe => "safe",
            State::Armed => "armed",
            State::Running => "running",
            State::Fault => "fault",
        }
    }

    /// Whether high voltage may be on in this state.
    #[must_use]
    pub const fn is_live(self) -> bool {
        matches!(self, State::Armed | State::Running)
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
}

impl Event {
    /// Every event, in order.
    pub const ALL: [Event; 9] = [
        Event::BootComplete,
        Event::Arm,
        Event::Disarm,
        Event::Drive,
        Event::Rest,
        Event::Stop,
        Event::HostSilent,
        Event::Fault,
        Event::Clear,
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
        }
    }
}

/// What the board must do on a transition, before anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Leave the outputs as they are.
    Keep,
    /// Everything off: [`crate::board::Board::outputs_off`].
    Off,
    /// Make ready: [`crate::board::Board::arm`].
    Enable,
    /// Set the drives: [`crate::board::Board::apply`].
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

use Action::{Apply, Enable, Keep, Off};
use Outcome::{Go, Refuse};
use State::{Armed, Boot, Fault, Running, Safe};

/// Rows: state before. Columns: events in the order of [`Event::ALL`]. Whatever ends outside Armed and Running
/// switches everything off, even where it already is: an order to be off is never answered by doing nothing.
const TABLE: [[Outcome; Event::ALL.len()]; State::ALL.len()] = [
    //            BootComplete    Arm                  Disarm          Drive                Rest                Stop           HostSilent      Fault           Clear
    /* Boot */
    [Go(Safe, Off), Refuse, Go(Boot, Off), Refuse, Refuse, Go(Boot, Off), Go(Boot, Off), Go(Fault, Off), Refuse],
    /* Safe */
    [
        Refuse,
        Go(Armed, Enable),
        Go(Safe, Off),
        Refuse,
        Refuse,
        Go(Safe, Off),
        Go(Safe, Off),
        Go(Fault, Off),
        Go(Safe, Off),
    ],
    /* Armed: arming again renews the dead-man time and nothing else */
    [
        Refuse,
        Go(Armed, Keep),
        Go(Safe, Off),
        Go(Running, Apply),
        Go(Armed, Apply),
        Go(Safe, Off),
        Go(Fault, Off),
        Go(Fault, Off),
        Refuse,
    ],
    /* Running */
    [
        Refuse,
        Go(Running, Keep),
        Go(Safe, Off),
        Go(Running, Apply),
        Go(Armed, Apply),
        Go(Safe, Off),
        Go(Fault, Off),
        Go(Fault, Off),
        Refuse,
    ],
    /* Fault: only an explicit Clear leads out */
    [Refuse, Refuse, Go(Fault, Off), Refuse, Refuse, Go(Fault, Off), Go(Fault, Off), Go(Fault, Off), Go(Safe, Off)],
];

/// What `event` does in `state`.
#[must_use]
pub const fn transition(state: State, event: Event) -> Outcome {
    TABLE[state as usize][event as usize]
}

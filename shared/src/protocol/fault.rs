//! Fault codes: why the device switched everything off.

use serde::{Deserialize, Serialize};

/// Why the device latched a fault. Numbers are wire format and documentation ("fault 3"): never reuse one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultCode {
    /// 0: the host that armed the board was silent for longer than the dead-man time.
    HostSilent,
    /// 1: the hardware refused to be armed.
    ArmFailed,
    /// 2: the hardware refused a drive.
    DriveFailed,
    /// 3: the firmware panicked; it is told after the reset.
    Panic,
    /// 4: the processor took a HardFault; it is told after the reset.
    HardFault,
    /// 5: registers read back did not hold what was written.
    ReadBack,
}

impl FaultCode {
    /// Every code, in order.
    pub const ALL: [FaultCode; 6] = [
        FaultCode::HostSilent,
        FaultCode::ArmFailed,
        FaultCode::DriveFailed,
        FaultCode::Panic,
        FaultCode::HardFault,
        FaultCode::ReadBack,
    ];

    /// The number on the wire and in the documentation.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Short name, as in logs and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            FaultCode::HostSilent => "host-silent",
            FaultCode::ArmFailed => "arm-failed",
            FaultCode::DriveFailed => "drive-failed",
            FaultCode::Panic => "panic",
            FaultCode::HardFault => "hard-fault",
            FaultCode::ReadBack => "read-back",
        }
    }

    /// What a person should know and do.
    #[must_use]
    pub const fn advice(self) -> &'static str {
        match self {
            FaultCode::HostSilent => {
                "The host that armed the board fell silent, so the board switched everything off. Check the cable and \
                 that the daemon runs, then clear the fault."
            }
            FaultCode::ArmFailed => {
                "The board could not make its outputs ready. Nothing is energised. Look at the board's log, then clear \
                 the fault and arm again."
            }
            FaultCode::DriveFailed => {
                "The board could not set the drives as commanded and switched everything off. Look at the board's log; \
                 if it happens again, replace the board."
            }
            FaultCode::Panic | FaultCode::HardFault => {
                "The firmware failed, switched everything off and started again. Please keep the log and report it; \
                 clear the fault to go on."
            }
            FaultCode::ReadBack => {
                "A timer register did not hold what was written to it; everything is off. Power the board down and up \
                 again; if it stays, replace the board."
            }
        }
    }
}

/// A latched fault: the first reason is kept until it is cleared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// The first reason.
    pub code: FaultCode,
    /// When, in us since boot (0 for one carried over a reset).
    pub at_us: u64,
    /// A number that goes with it: the channel, the silence in ms, a program counter; see the protocol documentation.
    pub detail: u32,
    /// Faults raised since, this one included.
    pub count: u16,
}

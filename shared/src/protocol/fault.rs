//! Fault codes: why the device switched everything off.

use serde::{Deserialize, Serialize};

/// Why the device latched a fault. Numbers are wire format and documentation ("fault 3"): never reuse one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultCode {
    /// 0: the host that armed the board was silent for longer than the dead-man time.
    HostSilent,
    /// 1: the hardware refused to be armed. Detail: the output that is not low, as 100 x its port (1 for A) + its number; 0 for another reason.
    ArmFailed,
    /// 2: the hardware refused a drive.
    DriveFailed,
    /// 3: the firmware panicked; it is told after the reset.
    Panic,
    /// 4: the processor took a HardFault; it is told after the reset.
    HardFault,
    /// 5: registers read back did not hold what was written.
    ReadBack,
    /// 6: more current than the supply may deliver. Detail: the average in uA; 0 if the comparator tripped.
    OverCurrent,
    /// 7: a rail above the highest voltage. Detail: 10 000 x rail + volts; 0 if the comparator tripped.
    OverVoltage,
    /// 8: the enclosure was opened. Detail: the loop's level in mV; 0 if the comparator tripped.
    InterlockOpen,
    /// 9: the emergency stop was pressed. Detail: as for 8.
    EmergencyStop,
    /// 10: panel or moving masses are not bonded to protective earth.
    EarthOpen,
    /// 11: a rail is not where it was set. Detail: 10 000 x rail + volts measured.
    RailImplausible,
    /// 12: a rail lost its voltage at once: an arc or a short. Detail: 10 000 x rail + volts left.
    RailCollapsed,
    /// 13: a rail was not discharged in time. Detail: 10 000 x rail + volts left.
    DischargeFailed,
    /// 14: what has to switch off, or to measure, did not do so when it was tried. Detail: which, see the troubleshooting table.
    SelfTest,
    /// 15: at the test voltage a rail did not come up (detail: which) or a current flowed (detail 0).
    ShortCircuit,
    /// 16: the watchdog reset the processor. Detail: the tasks that had not checked in, one bit each; 1000 if it did not reset the
    /// processor when it was tried after power-on.
    Watchdog,
    /// 17: the supply of the processor failed.
    BrownOut,
    /// 18: a timer that makes electrode windows stands still. Detail: the channel.
    TimerStopped,
    /// 19: a rail falls more slowly than its discharge switch makes it fall. Detail: 10 000 x rail + volts left. From version 4 on.
    DischargeSlow,
    /// 20: the processor was reset from outside while high voltage was on; it is told after the reset. From version 4 on.
    ResetWhileLive,
    /// 21: the reference of the converters is wrong, with which set-points, measurements and trips are wrong together. Detail: the
    /// supply's voltage in mV that the chip's own reference shows. From version 4 on.
    Reference,
    /// 22: an electrode takes too little or too much charge: it, its cable or a switch is open or shorted. Detail: which, or how much, see
    /// the troubleshooting table. From version 4 on.
    Electrode,
    /// 23: the permit, without which nothing outside the chip is energised, is not as it was set, or does not do what it should.
    /// Detail: see the troubleshooting table. From version 4 on.
    Permit,
    /// 24: the processor's clock and that of the watchdog disagree. Detail: the frequency in Hz that the watchdog's clock has by the
    /// processor's; 0 if it stands still. From version 4 on.
    Clock,
    /// 25: an option byte of the chip takes a protection away. Detail: the option bytes (FLASH_OPTR). From version 4 on.
    OptionBytes,
}

impl FaultCode {
    /// Every code, in order.
    pub const ALL: [FaultCode; 26] = [
        FaultCode::HostSilent,
        FaultCode::ArmFailed,
        FaultCode::DriveFailed,
        FaultCode::Panic,
        FaultCode::HardFault,
        FaultCode::ReadBack,
        FaultCode::OverCurrent,
        FaultCode::OverVoltage,
        FaultCode::InterlockOpen,
        FaultCode::EmergencyStop,
        FaultCode::EarthOpen,
        FaultCode::RailImplausible,
        FaultCode::RailCollapsed,
        FaultCode::DischargeFailed,
        FaultCode::SelfTest,
        FaultCode::ShortCircuit,
        FaultCode::Watchdog,
        FaultCode::BrownOut,
        FaultCode::TimerStopped,
        FaultCode::DischargeSlow,
        FaultCode::ResetWhileLive,
        FaultCode::Reference,
        FaultCode::Electrode,
        FaultCode::Permit,
        FaultCode::Clock,
        FaultCode::OptionBytes,
    ];

    /// The number on the wire and in the documentation.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Whether the measurement of the rails may be wrong after this fault, so that it is not believed until a bleeder has done its work.
    #[must_use]
    pub const fn casts_doubt_on_rail_measurement(self) -> bool {
        matches!(
            self,
            FaultCode::OverVoltage
                | FaultCode::RailImplausible
                | FaultCode::RailCollapsed
                | FaultCode::DischargeFailed
                | FaultCode::DischargeSlow
                | FaultCode::ShortCircuit
                | FaultCode::Reference
        )
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
            FaultCode::OverCurrent => "over-current",
            FaultCode::OverVoltage => "over-voltage",
            FaultCode::InterlockOpen => "interlock-open",
            FaultCode::EmergencyStop => "emergency-stop",
            FaultCode::EarthOpen => "earth-open",
            FaultCode::RailImplausible => "rail-implausible",
            FaultCode::RailCollapsed => "rail-collapsed",
            FaultCode::DischargeFailed => "discharge-failed",
            FaultCode::SelfTest => "self-test",
            FaultCode::ShortCircuit => "short-circuit",
            FaultCode::Watchdog => "watchdog",
            FaultCode::BrownOut => "brown-out",
            FaultCode::TimerStopped => "timer-stopped",
            FaultCode::DischargeSlow => "discharge-slow",
            FaultCode::ResetWhileLive => "reset-while-live",
            FaultCode::Reference => "reference",
            FaultCode::Electrode => "electrode",
            FaultCode::Permit => "permit",
            FaultCode::Clock => "clock",
            FaultCode::OptionBytes => "option-bytes",
        }
    }

    /// What a person should know and do about this fault, as one or two sentences.
    #[must_use]
    pub const fn advice(self) -> &'static str {
        match self {
            FaultCode::HostSilent => {
                "The host that armed the board sent nothing for longer than the dead-man time, so the board switched \
                 everything off. Check the cable, check that the daemon runs, then clear the fault."
            }
            FaultCode::ArmFailed => {
                "The board could not prepare its outputs for arming. Nothing is energised. Read the board's log, then \
                 clear the fault and arm the board again."
            }
            FaultCode::DriveFailed => {
                "The board could not set the commanded drives and switched everything off. Read the board's log, then \
                 clear the fault. If the fault occurs again, replace the board."
            }
            FaultCode::Panic | FaultCode::HardFault => {
                "The firmware failed, switched everything off and restarted. Save the board's log and report the \
                 failure, then clear the fault."
            }
            FaultCode::ReadBack => {
                "A register of the board's chip did not contain the value that the firmware had written, so the board \
                 switched everything off. Switch the board's power off and on. If the fault occurs again, replace the \
                 board."
            }
            FaultCode::OverCurrent | FaultCode::ShortCircuit => {
                "Too much current flowed, or a rail did not reach its voltage: an arc or a short circuit in an actuator \
                 or in its cable. Disconnect the supply, wait until the rails are discharged, inspect the actuators \
                 and cables, then clear the fault."
            }
            FaultCode::OverVoltage | FaultCode::RailImplausible => {
                "The voltage of a rail differs from the set-point. Check the supply, the set-point and the divider \
                 that measures the rail, then clear the fault."
            }
            FaultCode::RailCollapsed => {
                "A rail lost voltage within 1 ms, as happens in an arc. Look for traces of an arc in the actuators and \
                 at the connectors. If the air is humid or dusty, lower the voltage. Then clear the fault."
            }
            FaultCode::InterlockOpen => "The enclosure is open. Close the enclosure, then clear the fault.",
            FaultCode::EmergencyStop => {
                "The emergency stop is pressed. Release the emergency stop, then clear the fault."
            }
            FaultCode::EarthOpen => {
                "The panel or a moving mass is not bonded to protective earth. Do not touch the panel or the masses. \
                 Repair the bond, then clear the fault."
            }
            FaultCode::DischargeFailed => {
                "A rail is still charged. Do not open the enclosure. Switch the supply off, wait a \
                 minute, then measure the rails. The supply still feeds the rail, or the rail's discharge switch or a \
                 bleeder is broken."
            }
            FaultCode::SelfTest => {
                "The self-test failed: a part that must switch off or measure (a comparator, a break input, the enable \
                 input of the supply, a divider) did not work. Do not use the board. The manual (troubleshooting, \
                 details of the self-test) lists the part for each detail of the fault."
            }
            FaultCode::Watchdog => {
                "The firmware stopped responding, so the watchdog reset the board. Save the board's log and report the \
                 failure, then clear the fault. The detail 1000 means that the watchdog does not work: replace the \
                 board."
            }
            FaultCode::BrownOut => {
                "The 3.3 V supply of the board failed for a moment. Check the cable and the power supply, then clear \
                 the fault."
            }
            FaultCode::TimerStopped => {
                "A timer that switches the electrodes has stopped. Switch the board's power off and on. If the fault \
                 occurs again, replace the board."
            }
            FaultCode::DischargeSlow => {
                "The voltage of a rail falls too slowly: the discharge switch does not close, or the supply still \
                 feeds the rail. Do not open the enclosure before you have measured that the rails are discharged. \
                 Repair the cause before you use the board."
            }
            FaultCode::ResetWhileLive => {
                "The board was reset while high voltage was on. Find the cause of the reset (reset button, debug \
                 probe, interference), then clear the fault."
            }
            FaultCode::Reference => {
                "The board's 3.3 V reference is wrong by more than 3 %, so every set-point and measurement is wrong. \
                 Do not use the board; check its 3.3 V supply."
            }
            FaultCode::Electrode => {
                "An electrode takes too little or too much current: the electrode, its cable or one of its switches is \
                 open or shorted. Disconnect the supply, wait until the rails are discharged, then inspect the \
                 electrode. The detail of the fault shows which electrode or actuator is affected (see the table on the \
                 troubleshooting page of the manual)."
            }
            FaultCode::Permit => {
                "The permit, the line that switches supply and electrodes off in hardware, does not work. Do not use \
                 the board. The table of fault codes on the troubleshooting page of the manual explains the fault's \
                 detail."
            }
            FaultCode::Clock => {
                "The processor's clock and the watchdog's clock disagree, so durations and frequencies may be wrong. \
                 Switch the board's power off and on. If the fault occurs again, replace the board."
            }
            FaultCode::OptionBytes => {
                "An option byte of the chip disables a protection. Set the option bytes as the bring-up page of the \
                 manual describes, then switch the board's power off and on."
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

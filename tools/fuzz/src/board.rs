//! A board that panics when it is asked for what must never be asked of a board. Its timers are modelled up to the pins.

use era_shared::MAX_CHANNELS;
use era_shared::board::{Board, BoardInfo, KeptRun};
use era_shared::limits::{GUARD_NANOSECONDS, MAX_RAIL_MILLIVOLTS};
use era_shared::protocol::{BoardKind, ChannelLimits, FaultCode, FirmwareVersion, ResetCause};
use era_shared::safety::ElectrodePulses;
use era_shared::supply::{FaultFinding, RAILS, SensorReadings, SupplyCommand};
use era_shared::waveform::{Electrode, IDLE, OutputPair, Pulse, PulseCheck, TimerModel, TimerPreload, TimerRegisters};
use std::collections::VecDeque;

/// Clock of the timers in MHz.
const CLOCK_MHZ: u32 = 170;
/// A preload is for a boundary at least this far away, in us.
const MARGIN_US: u64 = 50;
/// Least guard time between two pulses in clocks.
const GUARD_CLOCKS: u64 = GUARD_NANOSECONDS as u64 * CLOCK_MHZ as u64 / 1_000;
/// Which outputs of each timer are the electrodes'.
const OUTPUTS: OutputPair = OutputPair { a: 1, b: 3 };

/// What the hardware refuses, as bits of [`crate::step::Step::Hardware`].
pub mod refuses {
    /// A comparator does not trip when it is tried.
    pub const TRIPS: u8 = 1;
    /// The timers do not start.
    pub const START: u8 = 2;
    /// A preload register does not hold its value.
    pub const PRELOAD: u8 = 4;
    /// The pins are not given to the timers.
    pub const CONNECT: u8 = 8;
    /// A timer stands still.
    pub const COUNTING: u8 = 16;
}

/// What is wrong outside, as bits of [`crate::step::Step::Outside`].
pub mod outside {
    /// The enclosure is open.
    pub const INTERLOCK: u8 = 1;
    /// The emergency stop is pressed.
    pub const STOP: u8 = 2;
    /// The bond to earth is missing.
    pub const EARTH: u8 = 4;
    /// Rail 1 stays at 1 kV whatever it is told; rail 2 at 0.
    pub const RAILS: u8 = 8;
    /// Too much current flows.
    pub const CURRENT: u8 = 16;
    /// All loops that must be closed for anything to be live.
    pub const LOOPS: u8 = INTERLOCK | STOP | EARTH;
}

struct Timers {
    started_us: u64,
    models: [TimerModel; MAX_CHANNELS],
    checks: [PulseCheck; MAX_CHANNELS],
    /// Up to when each channel's electrodes were on last, in clocks, and how often they were switched on so far.
    last_on: [Option<(Electrode, u64)>; MAX_CHANNELS],
    charges: [u64; MAX_CHANNELS],
}

/// What a fuzzed device drives.
pub struct WatchedBoard {
    info: BoardInfo,
    /// Time since boot.
    pub now_us: u64,
    /// As at power-on it counts as on until it was switched off.
    pub supply: SupplyCommand,
    timers: Option<Timers>,
    /// Whether the timers reach the electrodes.
    pub connected: bool,
    /// Bits of [`refuses`].
    pub refused: u8,
    /// Bits of [`outside`].
    pub wrong: u8,
    /// What the hardware switched off for, until it is asked.
    pub trip: Option<FaultFinding>,
    /// What was delivered up to some moments of the last ms, in us and fC, and the charges that are in it.
    delivered: VecDeque<(u64, u64)>,
    counted: [u64; MAX_CHANNELS],
}

impl Default for WatchedBoard {
    /// A board with as many channels as the protocol has room for.
    fn default() -> Self {
        let limits = ChannelLimits {
            min_frequency_millihertz: 1_000,
            max_frequency_millihertz: 1_000_000,
            max_voltage_millivolts: MAX_RAIL_MILLIVOLTS,
            min_guard_ns: GUARD_NANOSECONDS,
            timer_clock_hz: CLOCK_MHZ * 1_000_000,
        };
        Self {
            info: BoardInfo {
                board: BoardKind::Simulated,
                board_id: *b"fuzzed board",
                boot_id: 0,
                reset_cause: ResetCause::PowerOn,
                image: heapless::String::new(),
                firmware: FirmwareVersion { major: 0, minor: 1, patch: 0, commit: *b"00000000" },
                channels: std::iter::repeat_n(limits, MAX_CHANNELS).collect(),
                fault_before_reset: None,
                failure: heapless::String::new(),
                kept_before_reset: None,
            },
            now_us: 0,
            supply: SupplyCommand { enabled: true, ..SupplyCommand::default() },
            timers: None,
            connected: false,
            refused: 0,
            wrong: 0,
            trip: None,
            delivered: VecDeque::new(),
            counted: [0; MAX_CHANNELS],
        }
    }
}

impl WatchedBoard {
    /// Whether nothing is energised, nothing is driven, and what was charged is being discharged.
    pub fn is_off(&self) -> bool {
        let SupplyCommand { enabled, discharge, set_point_millivolts, permitted } = self.supply;
        !enabled
            && !permitted
            && discharge == [true; RAILS]
            && set_point_millivolts == [0; RAILS]
            && !self.can_drive_electrodes()
    }

    /// Whether the timers can reach the electrodes.
    pub fn can_drive_electrodes(&self) -> bool {
        self.connected || self.timers.is_some()
    }

    /// What the rails are at: they follow at once, unless something is wrong with them.
    pub fn compute_rail_voltages_millivolts(&self) -> [u32; RAILS] {
        if self.wrong & outside::RAILS != 0 {
            return [1_000_000, 0];
        }
        std::array::from_fn(|rail| {
            let fed = self.supply.enabled && self.supply.permitted && !self.supply.discharge[rail];
            if fed { self.supply.set_point_millivolts[rail] } else { 0 }
        })
    }

    /// What the supply has delivered to bleeders and electrodes since power-on, in fC; to be called at least every ms for the mean.
    fn record_delivered_charge(&mut self) {
        self.run_timers_and_check_pulses();
        let (last_us, mut delivered) = self.delivered.back().copied().unwrap_or_default();
        let charges = self.timers.as_ref().map(|timers| timers.charges).unwrap_or_default();
        let rails = self.compute_rail_voltages_millivolts();
        for (channel, (now, before)) in charges.into_iter().zip(self.counted).enumerate() {
            // 116 pF times mV is fC.
            delivered += now.saturating_sub(before) * 116 * u64::from(rails[channel % RAILS]);
        }
        self.counted = charges;
        // Two bleeders of 100 Mohm each: mV times us over ohm is nC.
        delivered += rails.iter().map(|rail| u64::from(*rail) / 50 * (self.now_us - last_us)).sum::<u64>();
        self.delivered.push_back((self.now_us, delivered));
        while self.delivered.len() > 2 && self.delivered[1].0 + 1_000 <= self.now_us {
            self.delivered.pop_front();
        }
    }

    /// The mean current of the last ms, or since the last look if that is longer, in uA.
    fn measure_mean_current_microamps(&mut self) -> u32 {
        self.record_delivered_charge();
        let (Some((from_us, before)), Some((to_us, after))) = (self.delivered.front(), self.delivered.back()) else {
            return 0;
        };
        // fC in a us is nA.
        u32::try_from((after - before) / (to_us - from_us).max(1) / 1_000).unwrap_or(u32::MAX)
    }

    fn is_refused(&self, bit: u8) -> bool {
        self.refused & bit != 0
    }

    /// Lets the pins move up to now and looks at what they did.
    fn run_timers_and_check_pulses(&mut self) {
        let Some(timers) = &mut self.timers else { return };
        let now = (self.now_us - timers.started_us) * u64::from(CLOCK_MHZ);
        let counts = timers.last_on.iter_mut().zip(&mut timers.charges);
        for ((model, check), (last_on, charges)) in timers.models.iter_mut().zip(&mut timers.checks).zip(counts) {
            let note = |pulse: Pulse| {
                check.add_pulse_to_guard_and_overlap_statistics(pulse);
                // A pulse that a look has cut in two is one.
                *charges += u64::from(*last_on != Some((pulse.electrode, pulse.from)));
                *last_on = Some((pulse.electrode, pulse.to));
            };
            model.run_until(now, note).expect("registers that make windows");
            assert_eq!(check.overlap, 0, "both electrodes on");
            assert!(check.least_guard.is_none_or(|guard| guard >= GUARD_CLOCKS), "guard of {:?}", check.least_guard);
        }
    }
}

impl Board for WatchedBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn switch_outputs_off(&mut self) {
        self.record_delivered_charge();
        self.timers = None;
        self.counted = [0; MAX_CHANNELS];
        self.connected = false;
        self.supply = SupplyCommand { discharge: [true; RAILS], ..SupplyCommand::default() };
    }

    fn read_sensors_and_take_trip(&mut self) -> SensorReadings {
        let average_microamps = self.measure_mean_current_microamps();
        SensorReadings {
            rail_millivolts: self.compute_rail_voltages_millivolts(),
            average_microamps: if self.wrong & outside::CURRENT != 0 { 5_000 } else { average_microamps },
            interlock_closed: self.wrong & outside::INTERLOCK == 0,
            stop_released: self.wrong & outside::STOP == 0,
            interlock_millivolts: 0,
            stop_millivolts: 0,
            earth_bonded: self.wrong & outside::EARTH == 0,
            reference_millivolts: 3_300,
            trip: self.trip.take(),
            standing_fault: None,
        }
    }

    fn test_trip_circuits(&mut self) -> Result<(), FaultFinding> {
        assert!(self.is_off(), "comparators tried while something was on");
        if self.is_refused(refuses::TRIPS) { Err((FaultCode::SelfTest, 1)) } else { Ok(()) }
    }

    fn test_over_voltage_inputs(&mut self, charged: [bool; RAILS]) -> Result<(), FaultFinding> {
        assert!(
            (self.supply.enabled || charged == [false; RAILS]) && !self.can_drive_electrodes(),
            "inputs tried while something was driven, or nothing charged"
        );
        let trips = self.compute_rail_voltages_millivolts().map(|millivolts| millivolts > 25_000);
        if trips == charged { Ok(()) } else { Err((FaultCode::SelfTest, 3_001)) }
    }

    fn pulse_electrode_and_get_rail_mv_after_first_and_last(
        &mut self,
        channel: usize,
        _electrode: Electrode,
    ) -> Result<ElectrodePulses, FaultFinding> {
        assert!(
            !self.can_drive_electrodes() && !self.supply.enabled,
            "an electrode tried while something else was live"
        );
        assert!(self.supply.permitted, "an electrode tried without the permit");
        assert!(channel < self.info.channels.len(), "an electrode tried that is not there");
        self.now_us += 2_400;
        // 6 % less after each of three pulses.
        Ok(ElectrodePulses { after_first_millivolts: 47_000, after_last_millivolts: 39_000 })
    }

    fn store_run_record_for_next_boot(&mut self, run: KeptRun) {
        assert!(run.is_live || !self.can_drive_electrodes(), "the next start would not know that something was driven");
    }

    fn apply_supply_command(&mut self, supply: &SupplyCommand) {
        let highest = supply.set_point_millivolts.into_iter().max();
        assert!(highest <= Some(MAX_RAIL_MILLIVOLTS), "set to {highest:?} mV");
        self.record_delivered_charge();
        self.supply = *supply;
    }

    fn start_timers(&mut self) -> Result<(), FaultCode> {
        assert!(!self.can_drive_electrodes(), "timers started twice, or under connected electrodes");
        if self.is_refused(refuses::START) {
            return Err(FaultCode::ArmFailed);
        }
        let model = TimerModel::new(TimerRegisters::for_running_timer(&IDLE, OUTPUTS), 0);
        self.timers = Some(Timers {
            started_us: self.now_us,
            models: std::array::from_fn(|_| model.clone()),
            checks: Default::default(),
            last_on: Default::default(),
            charges: Default::default(),
        });
        Ok(())
    }

    fn set_timers_connected_to_electrodes(&mut self, connected: bool) -> Result<(), FaultCode> {
        self.record_delivered_charge();
        assert!(self.timers.is_some() && self.supply.enabled, "electrodes connected without being armed");
        if self.is_refused(refuses::CONNECT) {
            return Err(FaultCode::DriveFailed);
        }
        self.connected = connected;
        Ok(())
    }

    fn write_preload_and_check_read_back(&mut self, preload: &TimerPreload) -> Result<(), FaultCode> {
        assert!(self.connected || preload.period.has_no_windows(), "windows for electrodes that are not connected");
        self.run_timers_and_check_pulses();
        let timers = self.timers.as_mut().expect("timers that run");
        let model = timers.models.get_mut(preload.channel).expect("a channel that is there");
        let earliest = (self.now_us - timers.started_us + MARGIN_US) * u64::from(CLOCK_MHZ);
        assert!(preload.at >= earliest, "preloaded too near to the boundary");
        assert_eq!(preload.at, model.next_update_clock(), "preloaded for another boundary than the next");
        if self.refused & refuses::PRELOAD != 0 {
            return Err(FaultCode::ReadBack);
        }
        model.write_preload_registers(TimerRegisters::for_running_timer(&preload.period, OUTPUTS));
        Ok(())
    }

    fn check_timers_still_count_and_hold_settings(&mut self) -> Result<(), FaultFinding> {
        assert!(self.timers.is_some(), "timers looked at that do not run");
        if self.is_refused(refuses::COUNTING) { Err((FaultCode::TimerStopped, 0)) } else { Ok(()) }
    }

    fn take_peak_acceleration_mm_per_s2_if_sensor_exists(&mut self) -> Option<u32> {
        None
    }

    fn take_log_bytes(&mut self, out: &mut [u8]) -> usize {
        out.fill(0xA5);
        out.len()
    }

    fn request_bootloader_restart(&mut self) {
        assert!(self.is_off(), "left for the bootloader while something was on");
    }
}

//! The hardware behind the device logic of `era-shared`.

use crate::clocks::TIMER_CLOCK_HZ;
use crate::outputs;
use crate::pins::CHANNELS;
use crate::pwm;
use embassy_time::Instant;
use era_shared::board::{Board, BoardInfo, Measurements, Programs};
use era_shared::protocol::{ChannelLimits, FaultCode};
use era_shared::waveform::{ChannelProgram, TimerProgram, TimerRegisters};
use heapless::Vec;

/// What each channel can do.
pub const CHANNEL_LIMITS: ChannelLimits = ChannelLimits::BOARD;
// What the shared limits say must be what this board's clock tree and rail really are.
const _: () = assert!(CHANNEL_LIMITS.timer_clock_hz == TIMER_CLOCK_HZ);
const _: () = assert!(CHANNEL_LIMITS.max_voltage_millivolts == outputs::RAIL_FULL_SCALE_MILLIVOLTS);

/// The STM32G474 actuator board.
pub struct Stm32Board {
    info: BoardInfo,
    active: [Option<ChannelProgram>; CHANNELS],
}

impl Stm32Board {
    /// The board, with everything off.
    pub fn new(mut info: BoardInfo) -> Self {
        info.channels = core::iter::repeat_n(CHANNEL_LIMITS, CHANNELS).collect();
        outputs::force_off();
        Self { info, active: [None; CHANNELS] }
    }

    /// Changes the running channels in place, if nothing but window widths and voltages changes and no channel starts.
    fn retune(&mut self, wanted: &[Option<ChannelProgram>; CHANNELS]) -> bool {
        let possible = self.active.iter().zip(wanted).all(|(now, then)| match (now, then) {
            (_, None) => true,
            (None, Some(_)) => false,
            (Some(now), Some(then)) => pwm::can_retune(&now.timer, &then.timer),
        });
        if possible {
            for (channel, program) in wanted.iter().enumerate() {
                match program {
                    Some(program) => pwm::retune(channel, &program.timer),
                    None => outputs::electrode_pair_off(channel),
                }
            }
        }
        possible
    }

    /// Stops all channels, then starts those wanted from a common origin.
    fn restart(wanted: &[Option<ChannelProgram>; CHANNELS]) {
        outputs::electrodes_off();
        let mut timers: [Option<TimerProgram>; CHANNELS] = [None; CHANNELS];
        for (channel, (program, timer)) in wanted.iter().zip(&mut timers).enumerate() {
            if let Some(program) = program {
                pwm::load(channel, &program.timer);
                // Still low: the timer's outputs are off and driven low until MOE.
                outputs::connect_to_timer(channel);
                *timer = Some(program.timer);
            }
        }
        pwm::start(&timers);
    }

    fn verify(wanted: &[Option<ChannelProgram>; CHANNELS]) -> Result<(), FaultCode> {
        let holds = wanted.iter().enumerate().all(|(channel, program)| match program {
            Some(program) => {
                pwm::read_back(channel) == TimerRegisters::running(&program.timer)
                    && outputs::rail(channel) == program.rail_code
            }
            None => !pwm::read_back(channel).is_driving() && outputs::rail(channel) == 0,
        });
        if holds { Ok(()) } else { Err(FaultCode::ReadBack) }
    }
}

impl Board for Stm32Board {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn now_us(&mut self) -> u64 {
        Instant::now().as_micros()
    }

    fn outputs_off(&mut self) {
        outputs::force_off();
        self.active = [None; CHANNELS];
    }

    fn arm(&mut self) -> Result<(), FaultCode> {
        let rails_at_zero = (0..CHANNELS).all(|channel| outputs::rail(channel) == 0);
        if !outputs::electrodes_are_held_low() || !rails_at_zero {
            return Err(FaultCode::ArmFailed);
        }
        outputs::enable_high_voltage(true);
        if outputs::high_voltage_enabled() { Ok(()) } else { Err(FaultCode::ArmFailed) }
    }

    fn apply(&mut self, programs: &Programs) -> Result<(), FaultCode> {
        let (ours, beyond) = programs.split_at(CHANNELS);
        let wanted: [Option<ChannelProgram>; CHANNELS] = ours.try_into().map_err(|_| FaultCode::DriveFailed)?;
        if !outputs::high_voltage_enabled() || beyond.iter().any(Option::is_some) {
            return Err(FaultCode::DriveFailed);
        }
        if !self.retune(&wanted) {
            Self::restart(&wanted);
        }
        self.active = wanted;
        for (channel, program) in wanted.iter().enumerate() {
            outputs::set_rail(channel, program.map_or(0, |program| program.rail_code));
        }
        Self::verify(&wanted)
    }

    fn measure(&mut self) -> Measurements {
        let rail_millivolts: Vec<u32, { era_shared::MAX_CHANNELS }> =
            self.active.iter().map(|program| program.map_or(0, |it| it.achieved.voltage_millivolts)).collect();
        Measurements { acceleration_peak_mm_per_s2: None, rail_millivolts }
    }
}

//! The hardware behind the device logic of `era-shared`.

use crate::clocks::TIMER_CLOCK_HZ;
use crate::pins::CHANNELS;
use crate::{bootloader, breaks, comparators, log, outputs, sense, supply, timers, trip};
use embassy_time::{Duration, Instant};
use era_shared::board::{Board, BoardInfo};
use era_shared::protocol::{ChannelLimits, FaultCode};
use era_shared::supply::{Finding, Senses, Supply};
use era_shared::waveform::{IDLE, Period, Preload};

/// What each channel can do.
pub const CHANNEL_LIMITS: ChannelLimits = ChannelLimits::BOARD;
// What the shared limits say must be what this board's clock tree really is.
const _: () = assert!(CHANNEL_LIMITS.timer_clock_hz == TIMER_CLOCK_HZ);

/// Clocks in a us.
const CLOCKS_PER_US: u64 = TIMER_CLOCK_HZ as u64 / 1_000_000;
/// A preload nearer than this to its boundary, in us, is too late: writing it takes 2 us.
const TOO_LATE_US: u64 = 5;
/// Least time in which a counter is looked at again when it seems to stand.
const COUNT_WAIT: Duration = Duration::from_micros(20);

/// Detail of a finding about the comparators' settings, beyond all channels.
const DETAIL_COMPARATORS: u32 = 10;

/// A trip makes everything else fail that is done at the same time; it is then the reason.
fn first_reason(code: FaultCode) -> FaultCode {
    trip::take().map_or(code, |(code, _)| code)
}

/// The STM32G474 actuator board.
pub struct Stm32Board {
    info: BoardInfo,
    /// When the timers were started, in us of the board's time.
    started_us: u64,
    /// What each timer's preload registers hold.
    loaded: [Period; CHANNELS],
    /// Each counter at the last look.
    counts: [Option<u16>; CHANNELS],
    connected: bool,
}

impl Stm32Board {
    /// The board, with everything off.
    pub fn new(mut info: BoardInfo) -> Self {
        info.channels = core::iter::repeat_n(CHANNEL_LIMITS, CHANNELS).collect();
        outputs::force_off();
        Self { info, started_us: 0, loaded: [IDLE; CHANNELS], counts: [None; CHANNELS], connected: false }
    }

    /// Whether a counter has moved since the last look.
    fn moves(&mut self, channel: usize) -> bool {
        let (Some(last), Some(period)) = (self.counts.get_mut(channel), self.loaded.get(channel)) else {
            return false;
        };
        let now = timers::count(channel);
        let Some(before) = last.replace(now) else { return true };
        if now != before {
            return true;
        }
        // A period that divides the time between two looks brings the counter back to where it was: two ticks decide.
        let ticks = Duration::from_micros(u64::from(period.divider) * 2 / CLOCKS_PER_US);
        let end = Instant::now() + ticks.max(COUNT_WAIT);
        while Instant::now() <= end {
            let now = timers::count(channel);
            if now != before {
                *last = Some(now);
                return true;
            }
        }
        false
    }

    fn look_at_timers(&mut self) -> Result<(), Finding> {
        if !comparators::hold() {
            return Err((FaultCode::ReadBack, DETAIL_COMPARATORS));
        }
        if self.connected && !timers::WITH_BREAK.into_iter().all(timers::outputs_enabled) {
            // A break whose interrupt has not run, or not been enabled.
            return Err(breaks::cause());
        }
        for (channel, number) in (0..CHANNELS).zip(0..) {
            if !timers::counts(channel) || !self.moves(channel) {
                return Err((FaultCode::TimerStopped, number));
            }
            let loaded = self.loaded.get(channel).is_some_and(|it| timers::holds(channel, it, self.connected));
            if !loaded {
                return Err((FaultCode::ReadBack, number));
            }
        }
        Ok(())
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
        self.connected = false;
    }

    fn sense(&mut self) -> Senses {
        let measured = sense::measure();
        Senses {
            rail_millivolts: measured.rail_millivolts,
            average_microamps: measured.average_microamps,
            interlock_closed: comparators::interlock_closed(),
            stop_released: comparators::stop_released(),
            earth_bonded: measured.earth_bonded,
            trip: trip::take(),
        }
    }

    fn test_trips(&mut self) -> Result<(), Finding> {
        if outputs::all_low() { breaks::test() } else { Err((FaultCode::ArmFailed, 0)) }
    }

    fn set_supply(&mut self, supply: &Supply) {
        supply::set(supply);
    }

    fn start_timers(&mut self) -> Result<(), FaultCode> {
        self.loaded = [IDLE; CHANNELS];
        self.counts = [None; CHANNELS];
        // With interrupts masked, so that the time noted is that of the start.
        cortex_m::interrupt::free(|_| {
            let started = timers::start();
            self.started_us = Instant::now().as_micros();
            if started { Ok(()) } else { Err(FaultCode::ReadBack) }
        })
        .map_err(first_reason)
    }

    fn connect_electrodes(&mut self, connected: bool) -> Result<(), FaultCode> {
        cortex_m::interrupt::free(|_| {
            if let Some((code, _)) = trip::take() {
                return Err(code);
            }
            if connected {
                // Still low: outputs that MOE switches off are driven low, and TIM4 runs blank periods.
                outputs::connect_electrodes(true);
                timers::enable_outputs(true);
            } else {
                timers::enable_outputs(false);
                outputs::connect_electrodes(false);
            }
            self.connected = connected;
            Ok(())
        })
    }

    fn preload(&mut self, preload: &Preload) -> Result<(), FaultCode> {
        let Some(loaded) = self.loaded.get_mut(preload.channel) else { return Err(FaultCode::DriveFailed) };
        // With interrupts masked for 2 us, so that nothing comes between the look at the clock and the last register.
        cortex_m::interrupt::free(|_| {
            let now_us = Instant::now().as_micros().saturating_sub(self.started_us);
            if (now_us + TOO_LATE_US) * CLOCKS_PER_US > preload.at {
                // Its place in time is lost, and with it the phase.
                return Err(FaultCode::DriveFailed);
            }
            *loaded = preload.period;
            if timers::preload(preload.channel, &preload.period) { Ok(()) } else { Err(FaultCode::ReadBack) }
        })
        .map_err(first_reason)
    }

    /// Detail: the channel, or [`DETAIL_COMPARATORS`].
    fn check_timers(&mut self) -> Result<(), Finding> {
        self.look_at_timers().map_err(|finding| trip::take().unwrap_or(finding))
    }

    fn acceleration_peak_mm_per_s2(&mut self) -> Option<u32> {
        None
    }

    fn take_log(&mut self, out: &mut [u8]) -> usize {
        log::take(out)
    }

    fn enter_bootloader(&mut self) {
        bootloader::request();
    }
}

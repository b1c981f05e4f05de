//! One ERA's electrode windows in time, as its timer makes them.

use super::outputs::ActivePeriod;
use era_shared::protocol::ChannelLimits;
use era_shared::waveform::{ElectrodeWindows, IDLE, OutputPair, TickWindow, TimerPeriod, TimerRegisters, WindowsError};
use std::collections::VecDeque;

/// Outputs of the simulated timers: the first channel of each pair.
const OUTPUTS: OutputPair = OutputPair { a: 1, b: 3 };

/// Equal periods from one boundary on.
#[derive(Clone, Copy, Debug)]
struct PeriodStretch {
    from_s: f64,
    windows: ElectrodeWindows,
    tick_s: f64,
}

impl PeriodStretch {
    fn new(from_s: f64, period: &TimerPeriod) -> Result<Self, WindowsError> {
        let windows = ElectrodeWindows::from_registers(&TimerRegisters::for_running_timer(period, OUTPUTS))?;
        Ok(Self { from_s, windows, tick_s: windows.tick_length_s(ChannelLimits::BOARD.timer_clock_hz) })
    }

    fn has_no_electrode_windows(&self) -> bool {
        self.windows.a.length == 0 && self.windows.b.length == 0
    }

    /// The part of a window, repeated in every period, between two times, as begin and end in s.
    fn first_on_interval_of_repeating_window_within_s(
        &self,
        window: TickWindow,
        from_s: f64,
        to_s: f64,
    ) -> Option<(f64, f64)> {
        if window.length == 0 {
            return None;
        }
        let period_s = f64::from(self.windows.period) * self.tick_s;
        let first_s = self.from_s + f64::from(window.start) * self.tick_s;
        let number = ((from_s - first_s) / period_s).floor();
        [number, number + 1.0].into_iter().find_map(|number| {
            let begin_s = first_s + number * period_s;
            let (on_s, off_s) = (begin_s.max(from_s), (begin_s + f64::from(window.length) * self.tick_s).min(to_s));
            (off_s > on_s).then_some((on_s, off_s))
        })
    }

    /// How long A and B are on from `from_s` to `to_s`, in s.
    fn electrode_on_durations_s(&self, from_s: f64, to_s: f64) -> [f64; 2] {
        let (from, to) = ((from_s - self.from_s) / self.tick_s, (to_s - self.from_s) / self.tick_s);
        let period = self.windows.period;
        let on = |window: TickWindow| {
            cumulative_window_on_ticks_up_to_a_constant(window, period, to)
                - cumulative_window_on_ticks_up_to_a_constant(window, period, from)
        };
        [on(self.windows.a) * self.tick_s, on(self.windows.b) * self.tick_s]
    }
}

/// A running timer: what it does now, and what it will do from the boundaries on at which its preloaded registers take
/// effect.
#[derive(Clone, Debug)]
pub struct SimTimer {
    /// In order of time; each lasts until the next begins. Never empty.
    stretches: VecDeque<PeriodStretch>,
}

impl SimTimer {
    /// A timer that starts, blank, at `started_s`.
    ///
    /// # Errors
    /// [`WindowsError`] if the idle period is not one.
    pub fn new(started_s: f64) -> Result<Self, WindowsError> {
        Ok(Self { stretches: VecDeque::from([PeriodStretch::new(started_s, &IDLE)?]) })
    }

    /// From the boundary at `from_s` on the timer repeats `period`; what was preloaded for that boundary or later is overwritten.
    /// Periods that ended before `forget_before_s` are forgotten.
    ///
    /// # Errors
    /// [`WindowsError`] if the registers of `period` do not describe alternating windows.
    pub fn preload_repeating_period_and_drop_later_ones(
        &mut self,
        period: &TimerPeriod,
        from_s: f64,
        forget_before_s: f64,
    ) -> Result<(), WindowsError> {
        let next = PeriodStretch::new(from_s, period)?;
        // Half a tick of the fastest timer: boundaries are the same if they are nearer.
        self.stretches.retain(|stretch| stretch.from_s < from_s - 3e-9);
        while self.stretches.get(1).is_some_and(|second| second.from_s <= forget_before_s) {
            self.stretches.pop_front();
        }
        self.stretches.push_back(next);
        Ok(())
    }

    /// Makes a mistake: in the period that was preloaded last, electrode B is on when A is.
    pub fn make_b_overlap_a_in_last_preload(&mut self) {
        if let Some(last) = self.stretches.back_mut() {
            last.windows.b = last.windows.a;
        }
    }

    /// Makes a mistake: the period that was preloaded last is a tick too long.
    pub fn lengthen_last_preloaded_period_by_one_tick(&mut self) {
        if let Some(last) = self.stretches.back_mut() {
            last.windows.period += 1;
        }
    }

    /// The period that the timer repeats at `time_s`; the first that is known if that begins later.
    #[must_use]
    pub fn active_period_at_or_first_if_none_has_begun(&self, time_s: f64) -> Option<ActivePeriod> {
        let begun = self.stretches.iter().rev().find(|stretch| stretch.from_s <= time_s);
        let active = begun.or_else(|| self.stretches.front())?;
        let ticks = (time_s - active.from_s) / active.tick_s;
        Some(ActivePeriod { windows: active.windows, position_ticks: ticks.rem_euclid(active.windows.period.into()) })
    }

    /// Whether no electrode is on, now or after what is preloaded.
    #[must_use]
    pub fn has_no_electrode_windows_now_or_preloaded(&self) -> bool {
        self.stretches.iter().all(PeriodStretch::has_no_electrode_windows)
    }

    /// The parts of the time from `from_s` to `from_s + step_s` for which electrodes A and B are on. The mean, not a
    /// sample: edges fall anywhere within a step, and their exact area is what moves the panel.
    #[must_use]
    pub fn electrode_on_fractions(&self, from_s: f64, step_s: f64) -> [f64; 2] {
        let to_s = from_s + step_s;
        let mut sum_s = [0.0; 2];
        let mut end_s = to_s;
        for stretch in self.stretches.iter().rev() {
            let begin_s = stretch.from_s.max(from_s);
            if begin_s < end_s {
                if !stretch.has_no_electrode_windows() {
                    let on_s = stretch.electrode_on_durations_s(begin_s, end_s);
                    sum_s = [sum_s[0] + on_s[0], sum_s[1] + on_s[1]];
                }
                end_s = begin_s;
            }
            if end_s <= from_s {
                break;
            }
        }
        sum_s.map(|on_s| on_s / step_s)
    }

    /// The stretches of the time from `from_s` to `from_s + step_s` in which electrodes A and B are on, as begin and end in s from `from_s`.
    /// A step is shorter than half a period, so that no electrode has two of them; where a boundary lies within the step, both are off there.
    #[must_use]
    pub fn on_stretch_of_each_electrode_from_step_start_s(&self, from_s: f64, step_s: f64) -> [Option<(f64, f64)>; 2] {
        let to_s = from_s + step_s;
        let mut found: [Option<(f64, f64)>; 2] = [None; 2];
        let mut end_s = to_s;
        for stretch in self.stretches.iter().rev() {
            let begin_s = stretch.from_s.max(from_s);
            if begin_s < end_s {
                for (found, window) in found.iter_mut().zip([stretch.windows.a, stretch.windows.b]) {
                    let on = stretch.first_on_interval_of_repeating_window_within_s(window, begin_s, end_s);
                    // The first of two would be the earlier stretch's.
                    *found = on.map(|(on_s, off_s)| (on_s - from_s, off_s - from_s)).or(*found);
                }
                end_s = begin_s;
            }
            if end_s <= from_s {
                break;
            }
        }
        found
    }

    /// A time in s at which the force is at its greatest without resistors, the middle of a window of A, in the stretch that was preloaded
    /// last; `None` if that is blank.
    #[must_use]
    pub fn time_s_of_force_peak_in_last_preload_unless_blank(&self) -> Option<f64> {
        let last = self.stretches.back().filter(|stretch| !stretch.has_no_electrode_windows())?;
        let window = last.windows.a;
        Some(last.from_s + (f64::from(window.start) + f64::from(window.length) / 2.0) * last.tick_s)
    }
}

/// Ticks for which the window is on from the counter's zero to `ticks` (which may be many periods on), up to a constant.
fn cumulative_window_on_ticks_up_to_a_constant(window: TickWindow, period: u32, ticks: f64) -> f64 {
    let (period, length) = (f64::from(period), f64::from(window.length));
    let since_start = ticks - f64::from(window.start);
    let periods = (since_start / period).floor();
    periods * length + (since_start - periods * period).min(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preload_takes_effect_at_its_boundary_and_not_before() {
        // 1 ms periods with windows of 0.25 ms, each in the middle of its half: A from 0.125 to 0.375 ms.
        let period = TimerPeriod::with_windows(17, 10_000, 2_500, false);
        let mut source = SimTimer::new(0.0).expect("idle");
        source.preload_repeating_period_and_drop_later_ones(&period, 2e-3, 0.0).expect("a period");
        let is = |source: &SimTimer, from_s: f64, step_s: f64, a: f64, b: f64| {
            let [on_a, on_b] = source.electrode_on_fractions(from_s, step_s);
            (on_a - a).abs() < 1e-9 && (on_b - b).abs() < 1e-9
        };
        assert!(is(&source, 0.0, 2e-3, 0.0, 0.0));
        assert!(is(&source, 2e-3, 0.5e-3, 0.5, 0.0), "A is on for half of its half period");
        assert!(is(&source, 2.5e-3, 0.5e-3, 0.0, 0.5), "then B");
        assert!(is(&source, 1e-3, 1.5e-3, 0.25 / 1.5, 0.0), "a step over the boundary has its part");
        assert!(is(&source, 1e-3, 2e-3, 0.125, 0.125), "both have theirs");
        // The same as begin and end.
        let stretches = |from_s: f64, step_s: f64| {
            source
                .on_stretch_of_each_electrode_from_step_start_s(from_s, step_s)
                .map(|on| on.map(|(on, off)| [on, off].map(|s| (s * 1e9).round())))
        };
        assert_eq!(stretches(1.9e-3, 25e-6), [None, None]);
        assert_eq!(stretches(2.1e-3, 50e-6), [Some([25e3, 50e3]), None], "A from 2.125 ms on");
        assert_eq!(stretches(2.36e-3, 25e-6), [Some([0.0, 15e3]), None], "to 2.375 ms");
        assert_eq!(stretches(3.6e-3, 50e-6), [None, Some([25e3, 50e3])], "and B, in the next period");
        assert_eq!(stretches(1.975e-3, 200e-6), [Some([150e3, 200e3]), None], "over the boundary");
        assert!(
            (source.time_s_of_force_peak_in_last_preload_unless_blank().expect("it drives") - 2.25e-3).abs() < 1e-12
        );

        // What is observed from outside: blank before the boundary, and a quarter of the third period after it.
        let observed =
            |time_s| source.active_period_at_or_first_if_none_has_begun(time_s).expect("a timer has a period");
        assert_eq!(observed(1.9e-3).windows.a.length, 0);
        assert_eq!(observed(4.25e-3).windows.a.length, 2_500);
        assert!((observed(4.25e-3).position_ticks - 2_500.0).abs() < 1e-3);

        // Overwritten before it takes effect; then silent again.
        let mut changed = source.clone();
        changed
            .preload_repeating_period_and_drop_later_ones(
                &TimerPeriod::with_windows(17, 10_000, 2_500, true),
                2e-3,
                0.0,
            )
            .expect("a period");
        changed.preload_repeating_period_and_drop_later_ones(&IDLE, 5e-3, 4e-3).expect("idle");
        assert!(is(&changed, 2e-3, 0.5e-3, 0.0, 0.5), "reversed");
        assert!(is(&changed, 5e-3, 1.0, 0.0, 0.0));
        assert!(
            changed.time_s_of_force_peak_in_last_preload_unless_blank().is_none()
                && !changed.has_no_electrode_windows_now_or_preloaded()
        );
    }
}

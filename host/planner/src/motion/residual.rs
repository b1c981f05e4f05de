//! What is left of the touches before, and whether the next one fits on top of it.
//!
//! What moves is the steady motion of the drives that are on, and free motions, which only decay, each pole at its own rate.
//! Their phases are not known, so that amplitudes add up. A drive that ends leaves its part of the steady motion of every
//! pole; one that begins from nothing begins with as much, against it, and after a short time has brought no more than that
//! time allows. A drive that is changed while it is on goes on from the boundary of its period, whatever its new frequency:
//! of a pole only the difference of the two steady motions is left, next to nothing while a finger is drawn.

use crate::drive::Drive;
use crate::motion::plan_motion::{ForceLine, PerActuator, PlanMotion};
use crate::physics::rise::{Participation, PoleDecayAndTravel};
use crate::scene::MAX_ACTUATORS;
use crate::table::SOFTENING_GROWTH;

/// Part of a limit that may be exceeded: a plan at the limit leaves no room at all, and free motions never end.
pub const LIMIT_TOLERANCE: f64 = 0.02;
/// Longest time in s for which a touch is held back: beyond it a finger feels a click as late.
pub const LONGEST_WAIT_S: f64 = 0.03;
/// How many times as strong a touch has to become by waiting: twice is 6 dB, a difference that fingers feel; less is not worth the
/// delay.
const WORTH_WAITING: f64 = 2.0;
/// Until drives end that were told to, in s, beside a period of theirs: the link, and whoever tells them.
const LATE_S: f64 = 0.01;
/// Longest that drives which are set again and again count as the same in s: then the board's bursts end.
const SAME_S: f64 = 9.5;
/// Until rails are up that rise from zero, in s: discharge and self-test take 40 ms, 2 kV 100 ms.
const RISEN_S: f64 = 0.25;
/// Time in s after which drives that began weaker are looked at again: free motions decay within some tenths of a second.
pub const NEXT_LOOK_S: f64 = 0.02;
/// Parts of the missing force that a step may bring. Each swings up itself, so that next to a limit there is room for some four tenths;
/// less is not worth one.
const GROWS_BY: [f64; 3] = [1.0, 0.6, 0.3];
/// Halvings of a wait or of a part: to 30 us and less than a thousandth.
const HEADROOM_HALVINGS: u32 = 10;
/// Parts of the forces of a change that are looked at.
const FRACTION_STEPS: u32 = 20;
/// Part of the room that is taken where a first try was not enough.
const SURELY: f64 = 0.98;
/// How often no more than that is taken away.
const NEARBY: u32 = 3;
/// Part of a plan's forces below which nothing is driven: 40 dB less than was asked for.
const MIN_FORCE_FRACTION: f64 = 0.01;
/// Distance in Hz within which two frequencies may be one to the board's timers, which then has one phase.
const ONE_HZ: f64 = 0.1;

/// What the board is doing at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RailState {
    /// Its rails are down, or will be before it drives: they rise with the next drives.
    Down,
    /// Its rails may be up.
    Up,
    /// It drives.
    Driving,
}

/// How drives end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// As the last period does.
    AtItsBoundary,
    /// A stop takes the pins.
    AtOnce,
}

/// What the limits leave for drives that are to begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartHeadroom {
    /// After which time in s they may begin, at most [`LONGEST_WAIT_S`]; until then everything is off, unless `goes_on`.
    pub wait_s: f64,
    /// For which part of their forces there is room then: 1 is all of them.
    pub force_fraction: f64,
    /// Whether what is driven goes on until then: it has hardly begun.
    pub goes_on: bool,
}

impl StartHeadroom {
    /// All forces, at once.
    pub const ALL: Self = Self::without_wait(1.0);

    /// This fraction of the forces, without a wait.
    const fn without_wait(force_fraction: f64) -> Self {
        Self { wait_s: 0.0, force_fraction, goes_on: false }
    }
}

/// Free motions, and the drives that are on.
#[derive(Clone, Debug)]
pub struct ResidualVibration {
    modes: Vec<PoleDecayAndTravel>,
    /// Amplitudes of the poles at `left_s`.
    left: Vec<f64>,
    left_s: f64,
    /// Those of drives that end, from when they count as ended.
    ending: Vec<(f64, Vec<f64>)>,
    /// Since when nothing is driven, in s.
    off_since_s: f64,
    current: Option<CurrentDrives>,
    /// How often drives have begun.
    begun: u64,
}

#[derive(Clone, Debug)]
struct CurrentDrives {
    id: u64,
    /// Of even drives.
    drives: Option<Vec<Drive>>,
    lines: Vec<ForceLine>,
    /// Amplitudes of the free motions that it began with.
    start: Vec<f64>,
    /// Amplitudes that what was driven before would have left, had it ended when this began.
    before: Vec<f64>,
    /// Whether its rails rise with it.
    is_soft: bool,
    since_s: f64,
    until_s: f64,
    /// How much later it may end.
    late_s: f64,
}

impl CurrentDrives {
    /// Whether it is an even drive that goes on.
    fn is_ongoing_steady_drive(&self, now_s: f64) -> bool {
        self.drives.is_some() && now_s < self.until_s
    }

    /// When it ends, if it is told to at `stop_s`.
    const fn latest_end_time_if_stopped_at_s(&self, stop_s: f64) -> f64 {
        self.until_s.min(stop_s) + self.late_s
    }

    /// The integral of a line's force over a time from the beginning in s, relative to the whole force: with a rail that rises
    /// it grows with the square of the time.
    fn relative_force_integral_s(&self, line: &ForceLine, time_s: f64) -> f64 {
        let rising_s = if self.is_soft { line.rise_s.min(time_s) } else { 0.0 };
        let risen = if rising_s > 0.0 { rising_s / line.rise_s } else { 0.0 };
        time_s - rising_s + rising_s * risen * risen / 3.0
    }

    /// What of a pole is left of its beginning, and the most that it can have brought, at `at_s`.
    fn pole_amplitude_left_of_start_and_bound_on_amplitude_gained(
        &self,
        pole: usize,
        rate_per_s: f64,
        at_s: f64,
    ) -> (f64, f64) {
        let time_s = (at_s - self.since_s).max(0.0);
        let gained = |line: &ForceLine| {
            line.participations.get(pole).map_or(0.0, |participation| participation.gain_per_s)
                * self.relative_force_integral_s(line, time_s)
        };
        let kept = (-rate_per_s * time_s).exp();
        let most =
            self.before.get(pole).map_or(0.0, |before| before * kept) + self.lines.iter().map(gained).sum::<f64>();
        let left = self.start.get(pole).copied().unwrap_or(0.0) * kept;
        let is_up = self.is_soft && time_s > RISEN_S;
        (if is_up { left.min(pole_free_amplitude_after_rails_rise_or_effect(&self.lines, pole)) } else { left }, most)
    }

    /// Amplitudes that it leaves when it ends at `end_s`.
    fn pole_amplitudes_after_end(&self, modes: &[PoleDecayAndTravel], end_s: f64) -> Vec<f64> {
        let is_over = self.drives.is_none() && end_s > self.until_s;
        let of = |(k, mode): (usize, &PoleDecayAndTravel)| {
            let (start, most) =
                self.pole_amplitude_left_of_start_and_bound_on_amplitude_gained(k, mode.rate_per_s, end_s);
            let left = if is_over {
                pole_free_amplitude_after_rails_rise_or_effect(&self.lines, k)
            } else {
                pole_amplitude_ringing_after_steady_forces_end(&self.lines, k)
            };
            (start + left).min(most)
        };
        modes.iter().enumerate().map(of).collect()
    }

    /// The same beside the steady motion of a part of `next`, which takes its place at `end_s`.
    fn free_pole_amplitudes_left_by_change_to_next_drives(
        &self,
        modes: &[PoleDecayAndTravel],
        next: &[ForceLine],
        next_fraction: f64,
        end_s: f64,
    ) -> Vec<f64> {
        let goes_on = |old: &ForceLine| {
            next.iter().find(|new| old.can_change_to_new_line_at_period_boundary_without_restart(new, &self.lines))
        };
        let pairs: Vec<(&ForceLine, Option<&ForceLine>)> = self.lines.iter().map(|old| (old, goes_on(old))).collect();
        let is_new =
            |new: &&ForceLine| !pairs.iter().any(|(_, known)| known.is_some_and(|known| std::ptr::eq(known, *new)));
        let fresh: Vec<&ForceLine> = next.iter().filter(is_new).collect();
        let left = |line: &ForceLine, k: usize| {
            line.participations.get(k).map_or(0.0, Participation::amplitude_ringing_after_force_ends)
        };
        let of = |(k, mode): (usize, &PoleDecayAndTravel)| {
            let (start, most) =
                self.pole_amplitude_left_of_start_and_bound_on_amplitude_gained(k, mode.rate_per_s, end_s);
            let changed =
                |(old, new): &(&ForceLine, Option<&ForceLine>)| match new {
                    Some(new) => old.participations.get(k).zip(new.participations.get(k)).map_or(0.0, |(old, new)| {
                        old.amplitude_ringing_after_change_to_other_force(new, next_fraction)
                    }),
                    None => left(old, k),
                };
            let changes: f64 = pairs.iter().map(changed).sum::<f64>()
                + next_fraction * fresh.iter().map(|new| left(new, k)).sum::<f64>();
            (start + changes).min(most + next_fraction * pole_amplitude_ringing_after_steady_forces_end(next, k))
        };
        modes.iter().enumerate().map(of).collect()
    }
}

fn participations_of_pole(lines: &[ForceLine], pole: usize) -> impl Iterator<Item = &Participation> {
    lines.iter().filter_map(move |line| line.participations.get(pole))
}

/// Amplitude of a pole that steady forces leave.
fn pole_amplitude_ringing_after_steady_forces_end(lines: &[ForceLine], pole: usize) -> f64 {
    participations_of_pole(lines, pole).map(Participation::amplitude_ringing_after_force_ends).sum()
}

/// Amplitude of a pole when the rails are up, or an effect has ended.
fn pole_free_amplitude_after_rails_rise_or_effect(lines: &[ForceLine], pole: usize) -> f64 {
    participations_of_pole(lines, pole).map(|participation| participation.free_amplitude_after_rise_or_effect).sum()
}

impl ForceLine {
    /// Whether the board lets this go on as `new` from the next boundary of its period: the timer of its channel does, unless
    /// it has to keep in phase with another's, now or before.
    fn can_change_to_new_line_at_period_boundary_without_restart(
        &self,
        new: &ForceLine,
        current_lines: &[ForceLine],
    ) -> bool {
        let is_anothers =
            |line: &ForceLine| line.channel != new.channel && (line.drive_hz - new.drive_hz).abs() < ONE_HZ;
        (self.channel, self.harmonic, self.phase_rad.to_bits()) == (new.channel, new.harmonic, new.phase_rad.to_bits())
            && !self.is_shared
            && !new.is_shared
            && !current_lines.iter().any(is_anothers)
    }
}

impl ResidualVibration {
    /// A panel at rest, with its poles ([`crate::PlanTable::decay_rate_and_travel_of_each_pole`]).
    #[must_use]
    pub fn new(modes: Vec<PoleDecayAndTravel>) -> Self {
        Self {
            left: vec![0.0; modes.len()],
            modes,
            left_s: 0.0,
            ending: Vec::new(),
            off_since_s: f64::NEG_INFINITY,
            current: None,
            begun: 0,
        }
    }

    /// The headroom for `new_drives_unless_effect`, whose motion is `motion`, from `now_s` on in place of the present drives. `None` is
    /// an effect, which is no steady drive. If all forces fit, the headroom is 1. Otherwise the drives begin weaker,
    /// and after a wait if that makes them much stronger.
    #[must_use]
    pub fn find_wait_and_force_fraction_within_travel_limits(
        &self,
        motion: &PlanMotion,
        new_drives_unless_effect: Option<&[Drive]>,
        now_s: f64,
        board: RailState,
    ) -> StartHeadroom {
        let force_fraction =
            self.max_force_fraction_that_fits_without_wait(motion, new_drives_unless_effect, now_s, board);
        if force_fraction >= 1.0 {
            return StartHeadroom::ALL;
        }
        // A finger that is drawn would otherwise end again and again what has not yet come up, and leave room for nothing.
        let is_even = |current: &&CurrentDrives| board == RailState::Driving && current.is_ongoing_steady_drive(now_s);
        if let Some(current) = self.current.as_ref().filter(is_even) {
            let wait_s = (current.since_s + LONGEST_WAIT_S).min(current.until_s) - now_s;
            if wait_s > 0.0 {
                return StartHeadroom { wait_s, force_fraction, goes_on: true };
            }
        }
        let off = |wait_s: f64| self.max_force_fraction_that_fits_after_time_off(motion, now_s, wait_s, board);
        // Touches that follow each other quickly are not held back one after the other, with nothing driven in between.
        let off_since_s = self.current.as_ref().map_or(self.off_since_s, |current| current.until_s.min(now_s));
        let longest_s = (LONGEST_WAIT_S - (now_s - off_since_s)).max(0.0);
        let largest_fraction = off(longest_s);
        if largest_fraction < WORTH_WAITING * force_fraction || largest_fraction <= 0.0 {
            return StartHeadroom::without_wait(force_fraction);
        }
        let (mut low, mut high) = (0.0, longest_s);
        for _ in 0..HEADROOM_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if off(middle) >= largest_fraction { &mut high } else { &mut low }) = middle;
        }
        StartHeadroom { wait_s: high, force_fraction: largest_fraction, goes_on: false }
    }

    /// The fraction of the forces of `new_drives_unless_effect` that fits at `now_s` without a wait.
    #[must_use]
    pub fn max_force_fraction_that_fits_without_wait(
        &self,
        motion: &PlanMotion,
        new_drives_unless_effect: Option<&[Drive]>,
        now_s: f64,
        board: RailState,
    ) -> f64 {
        if board == RailState::Driving
            && self.are_drives_same_as_ongoing_ones_whose_board_burst_lasts(new_drives_unless_effect, now_s)
        {
            return 1.0;
        }
        let fraction_after_restart = self.max_force_fraction_that_fits_after_time_off(motion, now_s, 0.0, board);
        let goes_on = |current: &&CurrentDrives| {
            board == RailState::Driving && new_drives_unless_effect.is_some() && current.is_ongoing_steady_drive(now_s)
        };
        let Some(current) = self.current.as_ref().filter(goes_on).filter(|_| fraction_after_restart < 1.0) else {
            return fraction_after_restart;
        };
        let (begun_m, left_m, free_m) = (
            largest_starting_travel_of_each_mass_m(motion, board),
            self.bound_travel_left_after_end_m(now_s, now_s),
            self.bound_travel_left_by_earlier_drives_m(now_s),
        );
        let end_s = current.latest_end_time_if_stopped_at_s(now_s);
        let fits = |part: f64| {
            let changed_m = self.pole_amplitudes_to_travel_m(
                &current.free_pole_amplitudes_left_by_change_to_next_drives(&self.modes, &motion.lines, part, end_s),
            );
            (0..MAX_ACTUATORS).all(|i| {
                let restart_m = motion.growth[i] * left_m[i] + part * begun_m[i];
                let changed_m =
                    motion.growth[i] * free_m[i] + SOFTENING_GROWTH * changed_m[i] + part * motion.steady_m[i];
                restart_m.min(changed_m) <= (1.0 + LIMIT_TOLERANCE) * motion.limit_m[i]
            })
        };
        // As near to what is driven now as it is, the least change is none: a weaker one may not fit where a stronger one does.
        let parts = (0..=FRACTION_STEPS)
            .rev()
            .map(|k| f64::from(k) / f64::from(FRACTION_STEPS))
            .take_while(|part| *part > fraction_after_restart);
        let Some(mut low) = parts.into_iter().find(|part| fits(*part)) else { return fraction_after_restart };
        let mut high = (low + 1.0 / f64::from(FRACTION_STEPS)).min(1.0);
        for _ in 0..HEADROOM_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if fits(middle) { &mut low } else { &mut high }) = middle;
        }
        low
    }

    /// The fraction that fits `off_s` later if everything is off until then.
    fn max_force_fraction_that_fits_after_time_off(
        &self,
        motion: &PlanMotion,
        now_s: f64,
        off_s: f64,
        board: RailState,
    ) -> f64 {
        let left_m = self.bound_travel_left_after_end_m(now_s, now_s + off_s);
        let begun_m = largest_starting_travel_of_each_mass_m(motion, board);
        let of = |i: usize| {
            let headroom_m = (1.0 + LIMIT_TOLERANCE) * motion.limit_m[i] - motion.growth[i] * left_m[i];
            if begun_m[i] <= headroom_m { 1.0 } else { (headroom_m / begun_m[i]).max(0.0) }
        };
        (0..MAX_ACTUATORS).map(of).fold(1.0, f64::min)
    }

    /// Records that drives begin at `now_s` in place of any others, with the board in the state that
    /// [`ResidualVibration::find_wait_and_force_fraction_within_travel_limits`] was given. They end at `until_s` unless another call changes that.
    pub fn record_drives_that_begin_in_place_of_others(
        &mut self,
        id: u64,
        motion: &PlanMotion,
        new_drives_unless_effect: Option<&[Drive]>,
        board: RailState,
        now_s: f64,
        until_s: f64,
    ) {
        self.begun += 1;
        if board == RailState::Driving
            && self.are_drives_same_as_ongoing_ones_whose_board_burst_lasts(new_drives_unless_effect, now_s)
            && let Some(current) = &mut self.current
        {
            (current.id, current.until_s) = (id, until_s);
            return;
        }
        let goes_on = |current: &mut CurrentDrives| {
            board == RailState::Driving && new_drives_unless_effect.is_some() && current.is_ongoing_steady_drive(now_s)
        };
        let before = self.current.take_if(goes_on);
        let start = match &before {
            Some(before) => before.free_pole_amplitudes_left_by_change_to_next_drives(
                &self.modes,
                &motion.lines,
                1.0,
                before.latest_end_time_if_stopped_at_s(now_s),
            ),
            None if new_drives_unless_effect.is_some() => (0..self.modes.len())
                .map(|k| pole_amplitude_ringing_after_steady_forces_end(&motion.lines, k))
                .collect(),
            // In all that it may leave its beginning counts already.
            None => vec![0.0; self.modes.len()],
        };
        let left_before = before
            .as_ref()
            .map(|before| before.pole_amplitudes_after_end(&self.modes, before.latest_end_time_if_stopped_at_s(now_s)));
        self.record_end_of_current_drives(now_s, Ending::AtItsBoundary);
        self.merge_recorded_endings_that_are_past_into_free_motions(now_s);
        let lowest_hz = motion.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
        self.current = Some(CurrentDrives {
            id,
            drives: new_drives_unless_effect.map(<[Drive]>::to_vec),
            lines: motion.lines.clone(),
            start,
            is_soft: board == RailState::Down && new_drives_unless_effect.is_some(),
            before: left_before.unwrap_or_else(|| vec![0.0; self.modes.len()]),
            since_s: now_s,
            until_s,
            late_s: LATE_S + 1.0 / lowest_hz,
        });
    }

    /// Records that the present drives end at `when_s`.
    pub fn record_end_of_current_drives(&mut self, when_s: f64, ending: Ending) {
        if let Some(mut current) = self.current.take() {
            if ending == Ending::AtOnce {
                current.late_s = LATE_S;
            }
            let end_s = current.latest_end_time_if_stopped_at_s(when_s);
            self.off_since_s = when_s.min(current.until_s);
            self.ending.push((end_s, current.pole_amplitudes_after_end(&self.modes, end_s)));
        }
    }

    /// Records that the drives named `id` end at `when_s`; others go on.
    pub fn record_end_of_drives_with_id(&mut self, id: u64, when_s: f64) {
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id) {
            current.until_s = current.until_s.min(when_s);
        }
    }

    /// Records that the drives named `id`, if they are on at `now_s`, go on until `until_s`.
    pub fn record_extension_of_drives_with_id(&mut self, id: u64, now_s: f64, until_s: f64) {
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id && now_s < current.until_s) {
            current.until_s = current.until_s.max(until_s);
        }
    }

    /// How often drives have begun. A caller that compares two values knows whether other drives have begun in
    /// between.
    #[must_use]
    pub const fn count_begun_drives(&self) -> u64 {
        self.begun
    }

    /// The id of the present drives, whether or not they have ended by themselves.
    #[must_use]
    pub fn current_drive_id_even_if_past_its_end(&self) -> Option<u64> {
        self.current.as_ref().map(|current| current.id)
    }

    /// Upper bound in m on the travel of every actuator at `at_s` if the present drives end at `stop_s`.
    #[must_use]
    pub fn bound_travel_left_after_end_m(&self, stop_s: f64, at_s: f64) -> PerActuator {
        let Some(current) = &self.current else { return self.bound_travel_left_by_earlier_drives_m(at_s) };
        let end_s = current.latest_end_time_if_stopped_at_s(stop_s);
        sum_per_actuator(
            &self.bound_travel_left_by_earlier_drives_m(at_s),
            &self.pole_amplitudes_to_travel_m(
                &self.pole_amplitudes_after_time(&current.pole_amplitudes_after_end(&self.modes, end_s), at_s - end_s),
            ),
        )
    }

    /// The same bound for the free motions of earlier drives only.
    fn bound_travel_left_by_earlier_drives_m(&self, at_s: f64) -> PerActuator {
        let ending =
            self.ending.iter().map(|(from_s, amplitudes)| self.pole_amplitudes_after_time(amplitudes, at_s - from_s));
        ending.fold(
            self.pole_amplitudes_to_travel_m(&self.pole_amplitudes_after_time(&self.left, at_s - self.left_s)),
            |all, more| sum_per_actuator(&all, &self.pole_amplitudes_to_travel_m(&more)),
        )
    }

    /// Amplitudes after a time.
    fn pole_amplitudes_after_time(&self, amplitudes: &[f64], time_s: f64) -> Vec<f64> {
        let kept =
            |(amplitude, mode): (&f64, &PoleDecayAndTravel)| amplitude * (-mode.rate_per_s * time_s.max(0.0)).exp();
        amplitudes.iter().zip(&self.modes).map(kept).collect()
    }

    /// Travel in m of all poles' amplitudes together.
    fn pole_amplitudes_to_travel_m(&self, amplitudes: &[f64]) -> PerActuator {
        amplitudes.iter().zip(&self.modes).fold([0.0; MAX_ACTUATORS], |all, (amplitude, mode)| {
            sum_per_actuator(&all, &mode.travel.map(|travel| travel * amplitude))
        })
    }

    /// Whether `new_drives_unless_effect` are what is driven.
    fn are_drives_same_as_ongoing_ones_whose_board_burst_lasts(
        &self,
        new_drives_unless_effect: Option<&[Drive]>,
        now_s: f64,
    ) -> bool {
        let is_it = |current: &CurrentDrives| {
            let is_same = current.drives.as_deref().is_some_and(|known| new_drives_unless_effect == Some(known));
            is_same && current.is_ongoing_steady_drive(now_s) && now_s - current.since_s < SAME_S
        };
        self.current.as_ref().is_some_and(is_it)
    }

    /// Adds what has ended by `now_s` to the free motions.
    fn merge_recorded_endings_that_are_past_into_free_motions(&mut self, now_s: f64) {
        let mut left = self.pole_amplitudes_after_time(&self.left, now_s - self.left_s);
        for (from_s, amplitudes) in self.ending.extract_if(.., |(from_s, _)| *from_s <= now_s).collect::<Vec<_>>() {
            let more = self.pole_amplitudes_after_time(&amplitudes, now_s - from_s);
            left.iter_mut().zip(more).for_each(|(left, more)| *left += more);
        }
        (self.left, self.left_s) = (left, now_s.max(self.left_s));
    }
}

/// `full_plan`, or a weaker version of it by `weakened_to_fraction`, whose forces all fit according to `headroom_of`; with the fraction of the
/// forces that it has.
///
/// # Errors
/// Those of `weakened_to_fraction`.
pub fn find_fraction_and_plan_within_headroom<T, E>(
    full_plan: T,
    weakened_to_fraction: impl Fn(f64) -> Result<T, E>,
    headroom_of: impl Fn(&T) -> f64,
) -> Result<(f64, T), E> {
    let (mut fitted, mut part) = (full_plan, 1.0);
    for tries in 0_u32.. {
        let left = headroom_of(&fitted);
        if left >= 1.0 || part <= 0.0 {
            break;
        }
        part *= match tries {
            0 => left,
            // As electrodes soften less, a weaker plan is not just a smaller one. What is nearly what is driven now may still have room
            // a little lower, and next to none much lower.
            1..=NEARBY => SURELY,
            _ => SURELY * left,
        };
        if part < MIN_FORCE_FRACTION {
            part = 0.0;
        }
        fitted = weakened_to_fraction(part)?;
    }
    Ok((part, fitted))
}

/// A stronger version of a plan of which the fraction `driven_fraction` is driven: the new fraction and what `plan_at_fraction` makes for
/// it. `None` if no step is worth it yet.
///
/// # Errors
/// Those of `plan_at_fraction`.
pub fn find_larger_fraction_and_plan_within_headroom_if_any<T, E>(
    driven_fraction: f64,
    plan_at_fraction: impl Fn(f64) -> Result<T, E>,
    headroom_of: impl Fn(&T) -> f64,
) -> Result<Option<(f64, T)>, E> {
    for step in GROWS_BY {
        let driven_fraction = 1.0 - (1.0 - step) * (1.0 - driven_fraction);
        let grown = plan_at_fraction(driven_fraction)?;
        if headroom_of(&grown) >= 1.0 {
            return Ok(Some((driven_fraction, grown)));
        }
    }
    Ok(None)
}

/// Largest travel in m with which drives begin on a panel at rest.
fn largest_starting_travel_of_each_mass_m(motion: &PlanMotion, board: RailState) -> PerActuator {
    if board == RailState::Down { motion.soft_m } else { motion.at_once_m }
}

fn sum_per_actuator(a: &PerActuator, b: &PerActuator) -> PerActuator {
    std::array::from_fn(|i| a[i] + b[i])
}

#[cfg(test)]
mod tests;

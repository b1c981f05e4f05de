//! What is left of the touches before, and whether the next one fits on top of it.
//!
//! What moves is the steady motion of the drives that are on, and free motions, which only decay, each pole at its own rate.
//! Their phases are not known, so that amplitudes add up. A drive that ends leaves its part of the steady motion of every
//! pole; one that begins from nothing begins with as much, against it, and after a short time has brought no more than that
//! time allows. A drive that is changed while it is on goes on from the boundary of its period, whatever its new frequency:
//! of a pole only the difference of the two steady motions is left, next to nothing while a finger is drawn.

use crate::drive::Drive;
use crate::motion::plan_motion::{ForceLine, PerActuator, PlanMotion};
use crate::physics::rise::{DecayingMode, Participation};
use crate::scene::MAX_ACTUATORS;
use crate::table::GROWN;

/// Part of a limit that may be exceeded: a plan at the limit leaves no room at all, and free motions never end.
pub const CONCEDED: f64 = 0.02;
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
const ROOM_HALVINGS: u32 = 10;
/// Parts of the forces of a change that are looked at.
const PARTS: u32 = 20;
/// Part of the room that is taken where a first try was not enough.
const SURELY: f64 = 0.98;
/// How often no more than that is taken away.
const NEARBY: u32 = 3;
/// Part of a plan's forces below which nothing is driven: 40 dB less than was asked for.
const LEAST_PART: f64 = 0.01;
/// Distance in Hz within which two frequencies may be one to the board's timers, which then has one phase.
const ONE_HZ: f64 = 0.1;

/// What the board does at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
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

/// What is left of the limits for drives that are to begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// After which time in s they may begin, at most [`LONGEST_WAIT_S`]; until then everything is off, unless `goes_on`.
    pub after_s: f64,
    /// For which part of their forces there is room then: 1 is all of them.
    pub part: f64,
    /// Whether what is driven goes on until then: it has hardly begun.
    pub goes_on: bool,
}

impl Room {
    /// All forces, at once.
    pub const ALL: Self = Self::at_once(1.0);

    const fn at_once(part: f64) -> Self {
        Self { after_s: 0.0, part, goes_on: false }
    }
}

/// Free motions, and the drives that are on.
#[derive(Clone, Debug)]
pub struct ResidualVibration {
    modes: Vec<DecayingMode>,
    /// Amplitudes of the poles at `left_s`.
    left: Vec<f64>,
    left_s: f64,
    /// Those of drives that end, from when they count as ended.
    ending: Vec<(f64, Vec<f64>)>,
    /// Since when nothing is driven, in s.
    off_since_s: f64,
    current: Option<Current>,
    /// How often drives have begun.
    begun: u64,
}

#[derive(Clone, Debug)]
struct Current {
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

impl Current {
    /// Whether it is an even drive that goes on.
    fn is_even(&self, now_s: f64) -> bool {
        self.drives.is_some() && now_s < self.until_s
    }

    /// When it ends, if it is told to at `now_s`.
    const fn end_s(&self, now_s: f64) -> f64 {
        self.until_s.min(now_s) + self.late_s
    }

    /// The integral of a line's force over a time from the beginning in s, relative to the whole force: with a rail that rises
    /// it grows with the square of the time.
    fn forced_s(&self, line: &ForceLine, time_s: f64) -> f64 {
        let rising_s = if self.is_soft { line.rise_s.min(time_s) } else { 0.0 };
        let risen = if rising_s > 0.0 { rising_s / line.rise_s } else { 0.0 };
        time_s - rising_s + rising_s * risen * risen / 3.0
    }

    /// What of pole `k` is left of its beginning, and the most that it can have brought, at `at_s`.
    fn begun(&self, k: usize, rate_per_s: f64, at_s: f64) -> (f64, f64) {
        let time_s = (at_s - self.since_s).max(0.0);
        let gained = |line: &ForceLine| {
            line.participations.get(k).map_or(0.0, |participation| participation.gain_per_s)
                * self.forced_s(line, time_s)
        };
        let kept = (-rate_per_s * time_s).exp();
        let most = self.before.get(k).map_or(0.0, |before| before * kept) + self.lines.iter().map(gained).sum::<f64>();
        let left = self.start.get(k).copied().unwrap_or(0.0) * kept;
        let is_up = self.is_soft && time_s > RISEN_S;
        (if is_up { left.min(afterwards(&self.lines, k)) } else { left }, most)
    }

    /// Amplitudes that it leaves when it ends at `end_s`.
    fn leaves(&self, modes: &[DecayingMode], end_s: f64) -> Vec<f64> {
        let is_over = self.drives.is_none() && end_s > self.until_s;
        let of = |(k, mode): (usize, &DecayingMode)| {
            let (start, most) = self.begun(k, mode.rate_per_s, end_s);
            let left = if is_over { afterwards(&self.lines, k) } else { steady(&self.lines, k) };
            (start + left).min(most)
        };
        modes.iter().enumerate().map(of).collect()
    }

    /// The same beside the steady motion of a part of `next`, which takes its place at `end_s`.
    fn changes(&self, modes: &[DecayingMode], next: &[ForceLine], part: f64, end_s: f64) -> Vec<f64> {
        let goes_on = |old: &ForceLine| next.iter().find(|new| old.goes_on_as(new, &self.lines));
        let pairs: Vec<(&ForceLine, Option<&ForceLine>)> = self.lines.iter().map(|old| (old, goes_on(old))).collect();
        let is_new =
            |new: &&ForceLine| !pairs.iter().any(|(_, known)| known.is_some_and(|known| std::ptr::eq(known, *new)));
        let fresh: Vec<&ForceLine> = next.iter().filter(is_new).collect();
        let left = |line: &ForceLine, k: usize| line.participations.get(k).map_or(0.0, Participation::left);
        let of = |(k, mode): (usize, &DecayingMode)| {
            let (start, most) = self.begun(k, mode.rate_per_s, end_s);
            let changed = |(old, new): &(&ForceLine, Option<&ForceLine>)| match new {
                Some(new) => old
                    .participations
                    .get(k)
                    .zip(new.participations.get(k))
                    .map_or(0.0, |(old, new)| old.left_beside(new, part)),
                None => left(old, k),
            };
            let changes: f64 =
                pairs.iter().map(changed).sum::<f64>() + part * fresh.iter().map(|new| left(new, k)).sum::<f64>();
            (start + changes).min(most + part * steady(next, k))
        };
        modes.iter().enumerate().map(of).collect()
    }
}

fn participations(lines: &[ForceLine], k: usize) -> impl Iterator<Item = &Participation> {
    lines.iter().filter_map(move |line| line.participations.get(k))
}

/// Amplitude of a pole that steady forces leave.
fn steady(lines: &[ForceLine], k: usize) -> f64 {
    participations(lines, k).map(Participation::left).sum()
}

/// Amplitude of a pole when the rails are up, or an effect has ended.
fn afterwards(lines: &[ForceLine], k: usize) -> f64 {
    participations(lines, k).map(|participation| participation.afterwards).sum()
}

impl ForceLine {
    /// Whether the board lets this go on as `new` from the next boundary of its period: the timer of its channel does, unless
    /// it has to keep in phase with another's, now or before.
    fn goes_on_as(&self, new: &ForceLine, old: &[ForceLine]) -> bool {
        let is_anothers =
            |line: &ForceLine| line.channel != new.channel && (line.drive_hz - new.drive_hz).abs() < ONE_HZ;
        (self.channel, self.harmonic, self.phase_rad.to_bits()) == (new.channel, new.harmonic, new.phase_rad.to_bits())
            && !self.is_shared
            && !new.is_shared
            && !old.iter().any(is_anothers)
    }
}

impl ResidualVibration {
    /// A panel at rest, with its poles ([`crate::PlanTable::decaying_modes`]).
    #[must_use]
    pub fn new(modes: Vec<DecayingMode>) -> Self {
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

    /// The room for `drives`, whose motion is `motion`, from `now_s` on in place of what is driven now. `None` is an effect, which
    /// is no even drive. With all of them there is room for the whole; otherwise they begin weaker, and after a wait where that
    /// makes them much stronger.
    #[must_use]
    pub fn room(&self, motion: &PlanMotion, drives: Option<&[Drive]>, now_s: f64, board: Board) -> Room {
        let part = self.part(motion, drives, now_s, board);
        if part >= 1.0 {
            return Room::ALL;
        }
        // A finger that is drawn would otherwise end again and again what has not yet come up, and leave room for nothing.
        let is_even = |current: &&Current| board == Board::Driving && current.is_even(now_s);
        if let Some(current) = self.current.as_ref().filter(is_even) {
            let after_s = (current.since_s + LONGEST_WAIT_S).min(current.until_s) - now_s;
            if after_s > 0.0 {
                return Room { after_s, part, goes_on: true };
            }
        }
        let off = |after_s: f64| self.part_anew(motion, now_s, after_s, board);
        // Touches that follow each other quickly are not held back one after the other, with nothing driven in between.
        let off_since_s = self.current.as_ref().map_or(self.off_since_s, |current| current.until_s.min(now_s));
        let longest_s = (LONGEST_WAIT_S - (now_s - off_since_s)).max(0.0);
        let most = off(longest_s);
        if most < WORTH_WAITING * part || most <= 0.0 {
            return Room::at_once(part);
        }
        let (mut low, mut high) = (0.0, longest_s);
        for _ in 0..ROOM_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if off(middle) >= most { &mut high } else { &mut low }) = middle;
        }
        Room { after_s: high, part: most, goes_on: false }
    }

    /// The part of the forces of `drives` for which there is room at `now_s`, without a wait.
    #[must_use]
    pub fn part(&self, motion: &PlanMotion, drives: Option<&[Drive]>, now_s: f64, board: Board) -> f64 {
        if board == Board::Driving && self.continues(drives, now_s) {
            return 1.0;
        }
        let anew = self.part_anew(motion, now_s, 0.0, board);
        let goes_on = |current: &&Current| board == Board::Driving && drives.is_some() && current.is_even(now_s);
        let Some(current) = self.current.as_ref().filter(goes_on).filter(|_| anew < 1.0) else { return anew };
        let (begun_m, left_m, free_m) = (begun_m(motion, board), self.left_at(now_s, now_s), self.free_at(now_s));
        let end_s = current.end_s(now_s);
        let fits = |part: f64| {
            let changed_m = self.travel(&current.changes(&self.modes, &motion.lines, part, end_s));
            (0..MAX_ACTUATORS).all(|i| {
                let anew_m = motion.growth[i] * left_m[i] + part * begun_m[i];
                let changed_m = motion.growth[i] * free_m[i] + GROWN * changed_m[i] + part * motion.steady_m[i];
                anew_m.min(changed_m) <= (1.0 + CONCEDED) * motion.limit_m[i]
            })
        };
        // As near to what is driven now as it is, the least change is none: a weaker one may not fit where a stronger one does.
        let parts = (0..=PARTS).rev().map(|k| f64::from(k) / f64::from(PARTS)).take_while(|part| *part > anew);
        let Some(mut low) = parts.into_iter().find(|part| fits(*part)) else { return anew };
        let mut high = (low + 1.0 / f64::from(PARTS)).min(1.0);
        for _ in 0..ROOM_HALVINGS {
            let middle = 0.5 * (low + high);
            *(if fits(middle) { &mut low } else { &mut high }) = middle;
        }
        low
    }

    /// The same `after_s` later, with everything off until then.
    fn part_anew(&self, motion: &PlanMotion, now_s: f64, after_s: f64, board: Board) -> f64 {
        let left_m = self.left_at(now_s, now_s + after_s);
        let begun_m = begun_m(motion, board);
        let of = |i: usize| {
            let room_m = (1.0 + CONCEDED) * motion.limit_m[i] - motion.growth[i] * left_m[i];
            if begun_m[i] <= room_m { 1.0 } else { (room_m / begun_m[i]).max(0.0) }
        };
        (0..MAX_ACTUATORS).map(of).fold(1.0, f64::min)
    }

    /// Drives begin at `now_s`, in place of any others, while the board does what [`ResidualVibration::room`] was told, and end at
    /// `until_s` unless they are told otherwise.
    pub fn begin(
        &mut self,
        id: u64,
        motion: &PlanMotion,
        drives: Option<&[Drive]>,
        board: Board,
        now_s: f64,
        until_s: f64,
    ) {
        self.begun += 1;
        if board == Board::Driving
            && self.continues(drives, now_s)
            && let Some(current) = &mut self.current
        {
            (current.id, current.until_s) = (id, until_s);
            return;
        }
        let goes_on = |current: &mut Current| board == Board::Driving && drives.is_some() && current.is_even(now_s);
        let before = self.current.take_if(goes_on);
        let start = match &before {
            Some(before) => before.changes(&self.modes, &motion.lines, 1.0, before.end_s(now_s)),
            None if drives.is_some() => (0..self.modes.len()).map(|k| steady(&motion.lines, k)).collect(),
            // In all that it may leave its beginning counts already.
            None => vec![0.0; self.modes.len()],
        };
        let left_before = before.as_ref().map(|before| before.leaves(&self.modes, before.end_s(now_s)));
        self.end(now_s, Ending::AtItsBoundary);
        self.pass(now_s);
        let lowest_hz = motion.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
        self.current = Some(Current {
            id,
            drives: drives.map(<[Drive]>::to_vec),
            lines: motion.lines.clone(),
            start,
            is_soft: board == Board::Down && drives.is_some(),
            before: left_before.unwrap_or_else(|| vec![0.0; self.modes.len()]),
            since_s: now_s,
            until_s,
            late_s: LATE_S + 1.0 / lowest_hz,
        });
    }

    /// Whatever is driven ends at `when_s`.
    pub fn end(&mut self, when_s: f64, how: Ending) {
        if let Some(mut current) = self.current.take() {
            if how == Ending::AtOnce {
                current.late_s = LATE_S;
            }
            let end_s = current.end_s(when_s);
            self.off_since_s = when_s.min(current.until_s);
            self.ending.push((end_s, current.leaves(&self.modes, end_s)));
        }
    }

    /// The drives named `id` end at `when_s`, others go on.
    pub fn end_of(&mut self, id: u64, when_s: f64) {
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id) {
            current.until_s = current.until_s.min(when_s);
        }
    }

    /// The drives named `id`, if they are on at `now_s`, go on until `until_s`.
    pub fn prolong(&mut self, id: u64, now_s: f64, until_s: f64) {
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id && now_s < current.until_s) {
            current.until_s = current.until_s.max(until_s);
        }
    }

    /// How often drives have begun: who has seen it knows later whether something else has begun since.
    #[must_use]
    pub const fn begun(&self) -> u64 {
        self.begun
    }

    /// What is driven, whether or not it has ended by itself.
    #[must_use]
    pub fn driven(&self) -> Option<u64> {
        self.current.as_ref().map(|current| current.id)
    }

    /// Most that is left at `at_s` of every actuator's motion in m if what is driven ends at `now_s`.
    #[must_use]
    pub fn left_at(&self, now_s: f64, at_s: f64) -> PerActuator {
        let Some(current) = &self.current else { return self.free_at(at_s) };
        let end_s = current.end_s(now_s);
        sum(&self.free_at(at_s), &self.travel(&self.decayed(&current.leaves(&self.modes, end_s), at_s - end_s)))
    }

    /// The same of what does not belong to what is driven.
    fn free_at(&self, at_s: f64) -> PerActuator {
        let ending = self.ending.iter().map(|(from_s, amplitudes)| self.decayed(amplitudes, at_s - from_s));
        ending.fold(self.travel(&self.decayed(&self.left, at_s - self.left_s)), |all, more| {
            sum(&all, &self.travel(&more))
        })
    }

    /// Amplitudes after a time.
    fn decayed(&self, amplitudes: &[f64], time_s: f64) -> Vec<f64> {
        let kept = |(amplitude, mode): (&f64, &DecayingMode)| amplitude * (-mode.rate_per_s * time_s.max(0.0)).exp();
        amplitudes.iter().zip(&self.modes).map(kept).collect()
    }

    /// Travel in m of all poles' amplitudes together.
    fn travel(&self, amplitudes: &[f64]) -> PerActuator {
        amplitudes.iter().zip(&self.modes).fold([0.0; MAX_ACTUATORS], |all, (amplitude, mode)| {
            sum(&all, &mode.travel.map(|travel| travel * amplitude))
        })
    }

    /// Whether `drives` are what is driven.
    fn continues(&self, drives: Option<&[Drive]>, now_s: f64) -> bool {
        let is_it = |current: &Current| {
            let is_same = current.drives.as_deref().is_some_and(|known| drives == Some(known));
            is_same && current.is_even(now_s) && now_s - current.since_s < SAME_S
        };
        self.current.as_ref().is_some_and(is_it)
    }

    /// What has ended by `now_s` joins what is left.
    fn pass(&mut self, now_s: f64) {
        let mut left = self.decayed(&self.left, now_s - self.left_s);
        for (from_s, amplitudes) in self.ending.extract_if(.., |(from_s, _)| *from_s <= now_s).collect::<Vec<_>>() {
            let more = self.decayed(&amplitudes, now_s - from_s);
            left.iter_mut().zip(more).for_each(|(left, more)| *left += more);
        }
        (self.left, self.left_s) = (left, now_s.max(self.left_s));
    }
}

/// `whole`, or what `weaker` makes of it for a part of its forces, so that there is room for all of it, as `room` says; with that part.
///
/// # Errors
/// Those of `weaker`.
pub fn fitted<T, E>(whole: T, weaker: impl Fn(f64) -> Result<T, E>, room: impl Fn(&T) -> f64) -> Result<(f64, T), E> {
    let (mut fitted, mut part) = (whole, 1.0);
    for tries in 0_u32.. {
        let left = room(&fitted);
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
        if part < LEAST_PART {
            part = 0.0;
        }
        fitted = weaker(part)?;
    }
    Ok((part, fitted))
}

/// As much more of a plan as there is room for, where a `part` of its forces is driven: the new part and what `of_part` makes for it.
/// `None` if no step is worth it yet.
///
/// # Errors
/// Those of `of_part`.
pub fn grown<T, E>(
    part: f64,
    of_part: impl Fn(f64) -> Result<T, E>,
    room: impl Fn(&T) -> f64,
) -> Result<Option<(f64, T)>, E> {
    for step in GROWS_BY {
        let part = 1.0 - (1.0 - step) * (1.0 - part);
        let grown = of_part(part)?;
        if room(&grown) >= 1.0 {
            return Ok(Some((part, grown)));
        }
    }
    Ok(None)
}

/// Most travel in m with which drives begin on a panel at rest.
fn begun_m(motion: &PlanMotion, board: Board) -> PerActuator {
    if board == Board::Down { motion.soft_m } else { motion.at_once_m }
}

fn sum(a: &PerActuator, b: &PerActuator) -> PerActuator {
    std::array::from_fn(|i| a[i] + b[i])
}

#[cfg(test)]
mod tests;

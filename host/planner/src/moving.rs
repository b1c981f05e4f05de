//! What is left of the touches before, and whether the next one fits on top of it.
//!
//! What moves is the steady motion of the drives that are on, and free motions, which only decay, each pole at its own rate.
//! Their phases are not known, so that amplitudes add up. A drive that ends leaves its part of the steady motion of every
//! pole; one that begins from nothing begins with as much, against it, and after a short time has brought no more than that
//! time allows. A drive that is changed while it is on goes on from the boundary of its period, whatever its new frequency:
//! of a pole only the difference of the two steady motions is left, next to nothing while a finger is drawn.

use super::plan::Drive;
use super::rise::{Ring, Share};
use super::succession::{PerActuator, Swing, SwingLine};
use super::table::GROWN;
use crate::scene::MAX_ACTUATORS;

/// Part of a limit that may be exceeded: a plan at the limit leaves no room at all, and free motions never end.
pub const CONCEDED: f64 = 0.02;
/// Longest wait in s that a touch is worth.
pub const LONGEST_WAIT_S: f64 = 1.5;
/// Until drives end that were told to, in s, beside a period of theirs: the link, and whoever tells them.
const LATE_S: f64 = 0.01;
/// Longest that drives which are set again and again count as the same in s: then the board's bursts end.
const SAME_S: f64 = 9.5;
/// Until rails are up that rise from zero, in s: discharge and self-test take 40 ms, 2 kV 100 ms.
const RISEN_S: f64 = 0.25;
/// A drive that has just begun is left on until then, in s, if the next one does not fit: a finger that is drawn would
/// otherwise switch off again and again what has not yet been felt.
const FELT_S: f64 = 0.3;
/// Halvings of a wait: to 1.5 ms.
const HALVINGS: u32 = 10;
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

/// Whether, and how, drives may begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// As they are.
    AtOnce,
    /// Not yet: what is driven has hardly begun, and goes on until it is asked again.
    Later {
        /// When, in s.
        after_s: f64,
    },
    /// Only with rails that rise from zero, and after a wait, with everything off.
    Softly {
        /// The wait in s.
        after_s: f64,
    },
    /// Not within the longest wait: with what is then left some mass would go this far, as a part of what is allowed.
    TooFar {
        /// More than 1.
        part: f64,
    },
}

/// Free motions, and the drives that are on.
#[derive(Clone, Debug)]
pub struct Moving {
    rings: Vec<Ring>,
    /// Amplitudes of the poles at `left_s`.
    left: Vec<f64>,
    left_s: f64,
    /// Those of drives that end, from when they count as ended.
    ending: Vec<(f64, Vec<f64>)>,
    current: Option<Current>,
}

#[derive(Clone, Debug)]
struct Current {
    id: u64,
    /// Of even drives.
    drives: Option<Vec<Drive>>,
    lines: Vec<SwingLine>,
    /// Amplitudes of the free motions that it began with.
    start: Vec<f64>,
    /// Whether its rails rise with it.
    is_soft: bool,
    /// Whether nothing was driven before.
    is_first: bool,
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
    fn forced_s(&self, line: &SwingLine, time_s: f64) -> f64 {
        let rising_s = if self.is_soft { line.rise_s.min(time_s) } else { 0.0 };
        let risen = if rising_s > 0.0 { rising_s / line.rise_s } else { 0.0 };
        time_s - rising_s + rising_s * risen * risen / 3.0
    }

    /// What of pole `k` is left of its beginning, and the most that it can have brought, at `at_s`.
    fn begun(&self, k: usize, rate_per_s: f64, at_s: f64) -> (f64, f64) {
        let time_s = (at_s - self.since_s).max(0.0);
        let gained =
            |line: &SwingLine| line.shares.get(k).map_or(0.0, |share| share.gain_per_s) * self.forced_s(line, time_s);
        let most = if self.is_first { self.lines.iter().map(gained).sum() } else { f64::INFINITY };
        let left = self.start.get(k).copied().unwrap_or(0.0) * (-rate_per_s * time_s).exp();
        let is_up = self.is_soft && time_s > RISEN_S;
        (if is_up { left.min(afterwards(&self.lines, k)) } else { left }, most)
    }

    /// Amplitudes that it leaves when it ends at `end_s`.
    fn leaves(&self, rings: &[Ring], end_s: f64) -> Vec<f64> {
        let is_over = self.drives.is_none() && end_s > self.until_s;
        let of = |(k, ring): (usize, &Ring)| {
            let (start, most) = self.begun(k, ring.rate_per_s, end_s);
            let left = if is_over { afterwards(&self.lines, k) } else { steady(&self.lines, k) };
            (start + left).min(most)
        };
        rings.iter().enumerate().map(of).collect()
    }

    /// The same beside the steady motion of `next`, which takes its place at `end_s`.
    fn changes(&self, rings: &[Ring], next: &[SwingLine], end_s: f64) -> Vec<f64> {
        let goes_on = |old: &SwingLine| next.iter().find(|new| old.goes_on_as(new, &self.lines));
        let pairs: Vec<(&SwingLine, Option<&SwingLine>)> = self.lines.iter().map(|old| (old, goes_on(old))).collect();
        let is_new =
            |new: &&SwingLine| !pairs.iter().any(|(_, known)| known.is_some_and(|known| std::ptr::eq(known, *new)));
        let fresh: Vec<&SwingLine> = next.iter().filter(is_new).collect();
        let left = |line: &SwingLine, k: usize| line.shares.get(k).map_or(0.0, Share::left);
        let of = |(k, ring): (usize, &Ring)| {
            let (start, most) = self.begun(k, ring.rate_per_s, end_s);
            let changed = |(old, new): &(&SwingLine, Option<&SwingLine>)| match new {
                Some(new) => old.shares.get(k).zip(new.shares.get(k)).map_or(0.0, |(old, new)| old.left_beside(new)),
                None => left(old, k),
            };
            let changes: f64 =
                pairs.iter().map(changed).sum::<f64>() + fresh.iter().map(|new| left(new, k)).sum::<f64>();
            (start + changes).min(most + steady(next, k))
        };
        rings.iter().enumerate().map(of).collect()
    }
}

fn shares(lines: &[SwingLine], k: usize) -> impl Iterator<Item = &Share> {
    lines.iter().filter_map(move |line| line.shares.get(k))
}

/// Amplitude of a pole that steady forces leave.
fn steady(lines: &[SwingLine], k: usize) -> f64 {
    shares(lines, k).map(Share::left).sum()
}

/// Amplitude of a pole when the rails are up, or an effect has ended.
fn afterwards(lines: &[SwingLine], k: usize) -> f64 {
    shares(lines, k).map(|share| share.afterwards).sum()
}

impl SwingLine {
    /// Whether the board lets this go on as `new` from the next boundary of its period: the timer of its channel does, unless
    /// it has to keep in phase with another's, now or before.
    fn goes_on_as(&self, new: &SwingLine, old: &[SwingLine]) -> bool {
        let is_anothers =
            |line: &SwingLine| line.channel != new.channel && (line.drive_hz - new.drive_hz).abs() < ONE_HZ;
        (self.channel, self.harmonic, self.phase_rad.to_bits()) == (new.channel, new.harmonic, new.phase_rad.to_bits())
            && !self.is_shared
            && !new.is_shared
            && !old.iter().any(is_anothers)
    }
}

impl Moving {
    /// A panel at rest, with its poles ([`super::PlanTable::rings`]).
    #[must_use]
    pub fn new(rings: Vec<Ring>) -> Self {
        Self { left: vec![0.0; rings.len()], rings, left_s: 0.0, ending: Vec::new(), current: None }
    }

    /// Whether `drives`, whose motion is `swing`, may begin at `now_s` in place of what is driven now. `None` is an effect,
    /// which is no even drive.
    #[must_use]
    pub fn fits(&self, swing: &Swing, drives: Option<&[Drive]>, now_s: f64, board: Board) -> Verdict {
        if board == Board::Driving && self.continues(drives, now_s) {
            return Verdict::AtOnce;
        }
        let most = 1.0 + CONCEDED;
        let part = |travel_m: &PerActuator| {
            let parts = travel_m.iter().zip(&swing.limit_m).filter(|(_, limit)| limit.is_finite());
            parts.map(|(travel, limit)| travel / limit).fold(0.0, f64::max)
        };
        let anew = |after_s: f64, begun_m: &PerActuator| sum(&self.left_at(now_s, now_s + after_s), begun_m);
        let mut travel_m = anew(0.0, if board == Board::Down { &swing.soft_m } else { &swing.at_once_m });
        let goes_on = |current: &&Current| board == Board::Driving && drives.is_some() && current.is_even(now_s);
        if let Some(current) = self.current.as_ref().filter(goes_on) {
            let changed = self.travel(&current.changes(&self.rings, &swing.lines, current.end_s(now_s)));
            let changed_m = sum(&sum(&self.free_at(now_s), &changed.map(|m| GROWN * m)), &swing.steady_m);
            travel_m.iter_mut().zip(changed_m).for_each(|(travel, changed)| *travel = travel.min(changed));
        }
        if part(&travel_m) <= most {
            return Verdict::AtOnce;
        }
        if let Some(current) = self.current.as_ref().filter(|current| board == Board::Driving && current.is_even(now_s))
        {
            let after_s = (current.since_s + FELT_S).min(current.until_s) - now_s;
            if after_s > 0.0 {
                return Verdict::Later { after_s };
            }
        }
        let softly = |after_s: f64| part(&anew(after_s, &swing.soft_m));
        if softly(0.0) <= most {
            return Verdict::Softly { after_s: 0.0 };
        }
        let (mut low, mut high) = (0.0, LONGEST_WAIT_S);
        if softly(high) > most {
            return Verdict::TooFar { part: softly(high) };
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if softly(middle) <= most { &mut high } else { &mut low }) = middle;
        }
        Verdict::Softly { after_s: high }
    }

    /// Drives begin at `now_s`, in place of any others, while the board does what [`Moving::fits`] was told, and end at
    /// `until_s` unless they are told otherwise.
    pub fn begin(&mut self, id: u64, swing: &Swing, drives: Option<&[Drive]>, board: Board, now_s: f64, until_s: f64) {
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
            Some(before) => before.changes(&self.rings, &swing.lines, before.end_s(now_s)),
            None if drives.is_some() => (0..self.rings.len()).map(|k| steady(&swing.lines, k)).collect(),
            // In all that it may leave its beginning counts already.
            None => vec![0.0; self.rings.len()],
        };
        self.end(now_s, Ending::AtItsBoundary);
        self.pass(now_s);
        let lowest_hz = swing.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
        self.current = Some(Current {
            id,
            drives: drives.map(<[Drive]>::to_vec),
            lines: swing.lines.clone(),
            start,
            is_soft: board == Board::Down && drives.is_some(),
            is_first: before.is_none(),
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
            self.ending.push((end_s, current.leaves(&self.rings, end_s)));
        }
    }

    /// The drives named `id` end at `when_s`, others go on.
    pub fn end_of(&mut self, id: u64, when_s: f64) {
        if let Some(current) = self.current.as_mut().filter(|current| current.id == id) {
            current.until_s = current.until_s.min(when_s);
        }
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
        sum(&self.free_at(at_s), &self.travel(&self.decayed(&current.leaves(&self.rings, end_s), at_s - end_s)))
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
        let kept = |(amplitude, ring): (&f64, &Ring)| amplitude * (-ring.rate_per_s * time_s.max(0.0)).exp();
        amplitudes.iter().zip(&self.rings).map(kept).collect()
    }

    /// Travel in m of all poles' amplitudes together.
    fn travel(&self, amplitudes: &[f64]) -> PerActuator {
        amplitudes.iter().zip(&self.rings).fold([0.0; MAX_ACTUATORS], |all, (amplitude, ring)| {
            sum(&all, &ring.travel.map(|travel| travel * amplitude))
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

fn sum(a: &PerActuator, b: &PerActuator) -> PerActuator {
    std::array::from_fn(|i| a[i] + b[i])
}

#[cfg(test)]
mod tests;

//! From one drive to the next: what each timer's preload registers must hold before its next boundary.
//!
//! All timers start together, blank, and run until everything goes off, so that every boundary is known exactly, in clocks
//! since that start: a boundary plus whole periods. The clock on the board's wall only tells which boundary is the next.
//! Nothing is ever stopped or set while it runs: a change is written to the preload registers and takes effect by itself.
//!
//! Channels with one frequency (equal divider and ticks) have a common origin of phase. A channel whose next boundary is
//! not where its phase wants it goes through a blank period of the length that is missing.

use super::envelope::{Envelope, FULL_STRENGTH, Playing, width_for};
use super::period::{IDLE, Period};
use super::program::ChannelProgram;
use crate::MAX_CHANNELS;
use heapless::Vec;

/// A boundary nearer than this, in us, is left to pass: working out what a timer must do takes 20 us, writing its registers
/// 2 us, and interrupts in between 20 us.
const MARGIN_US: u64 = 100;
/// A boundary is taken to have passed this long after it should have, in us: the moment of the start is known to 1 us on the
/// board, and to 5 us where timers are simulated in steps. What is written before a boundary takes effect at it.
const CERTAIN_US: u64 = 20;
/// Least length of a blank period, in us: longer than the ms between two looks and the margin, so that what follows it is
/// written in time. If it is not, the blank period is simply repeated.
const LEAST_GAP_US: u64 = 1_500;
/// Dividers tried for the blank period: one of them divides its length, or nearly.
const DIVIDERS_TRIED: u32 = 16;
/// Later chances of the lattice that are tried, if none of the dividers fits the first.
const CHANCES: u64 = 3;
/// Envelopes that wait for one channel, the one that plays included.
const QUEUE: usize = 4;

/// What is to be written to a timer's preload registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preload {
    /// 0-based.
    pub channel: usize,
    /// Rhythm and windows.
    pub period: Period,
    /// When it takes effect, in clocks since the timers' start.
    pub at: u64,
}

/// What a channel is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Goal {
    /// Rhythm and greatest windows.
    pub program: ChannelProgram,
    /// Whether it drives when no envelope says otherwise.
    pub continuous: bool,
}

#[derive(Clone, Debug)]
struct Track {
    /// What the timer does from `boundary` on.
    active: Period,
    /// A boundary that has passed, or 0.
    boundary: u64,
    /// What the preload registers hold, if it is something else, and when it takes effect.
    pending: Option<(Period, u64)>,
    goal: Option<Goal>,
    /// One of the boundaries at which the goal's phase is kept.
    lattice: u64,
    /// Part of the full force that the rail's voltage leaves to the window's width.
    strength: u32,
    queue: Vec<Envelope, QUEUE>,
    /// The next boundary was too near to be changed when it was last looked at.
    passing: bool,
}

impl Track {
    const fn new() -> Self {
        Self {
            active: IDLE,
            boundary: 0,
            pending: None,
            goal: None,
            lattice: 0,
            strength: FULL_STRENGTH,
            queue: Vec::new(),
            passing: false,
        }
    }

    /// Takes note of what has happened up to `now`.
    fn settle(&mut self, now: u64) {
        if let Some((period, at)) = self.pending
            && at <= now
        {
            (self.active, self.boundary, self.pending) = (period, at, None);
        }
        let period = self.active.clocks();
        self.boundary += now.saturating_sub(self.boundary) / period * period;
    }

    /// The boundary after `now`.
    const fn next_boundary(&self) -> u64 {
        self.boundary + self.active.clocks()
    }

    /// The first boundary, not before `earliest`, for which something can still be preloaded.
    const fn next_change(&self, earliest: u64) -> u64 {
        let next = self.next_boundary();
        if next >= earliest { next } else { next + self.preloaded().clocks() }
    }

    const fn preloaded(&self) -> Period {
        match self.pending {
            Some((period, _)) => period,
            None => self.active,
        }
    }

    /// What the period from the boundary `at` on should be.
    fn wanted(&mut self, at: u64, clocks_per_us: u64) -> Period {
        let Some(goal) = self.goal else { return IDLE };
        let program = goal.program;
        let clocks = program.clocks();
        let late = (at + clocks - self.lattice % clocks) % clocks;
        if late > 0 {
            let (gap, reached) = gap(clocks - late, clocks, LEAST_GAP_US * clocks_per_us);
            // Where that ends is on time: a clock or two from where it should be if no divider fits exactly.
            self.lattice = at + reached;
            return gap;
        }
        let level = self.level(goal, at, clocks_per_us);
        let width = width_for(program.ticks, program.width, level, self.strength);
        Period::driving(program.divider, program.ticks, width, level < 0)
    }

    fn level(&mut self, goal: Goal, at: u64, clocks_per_us: u64) -> i16 {
        while let Some(envelope) = self.queue.first_mut() {
            match envelope.at(at, goal.program.clocks(), 1000 * clocks_per_us) {
                Playing::Waiting => break,
                Playing::Level(level) => return level,
                Playing::Ended => {
                    self.queue.remove(0);
                }
            }
        }
        if goal.continuous { super::FULL_LEVEL } else { 0 }
    }
}

/// A blank period of `missing` clocks, or that and whole periods of `clocks` more, that is at least `least` long, and how
/// many clocks it really has.
fn gap(missing: u64, clocks: u64, least: u64) -> (Period, u64) {
    let first = missing + least.saturating_sub(missing).div_ceil(clocks) * clocks;
    // In 32 bits, which hold 25 s: the processor of the board divides them in hardware.
    let number = |value: u64| u32::try_from(value).unwrap_or(u32::MAX / 2);
    let mut best = (u32::MAX, 1, 2);
    for length in (0..CHANCES).map(|chance| number(first + chance * clocks)) {
        let coarsest = length.div_ceil(Period::MOST_TICKS).max(1);
        for divider in coarsest..coarsest + DIVIDERS_TRIED {
            let ticks = (length + divider / 2) / divider;
            let error = (ticks * divider).abs_diff(length);
            if error < best.0 && ticks <= Period::MOST_TICKS {
                best = (error, divider, ticks);
            }
            if error == 0 {
                break;
            }
        }
        if best.0 == 0 {
            break;
        }
    }
    let (_, divider, ticks) = best;
    (Period::blank(divider, ticks), u64::from(divider) * u64::from(ticks))
}

/// All channels of a board.
#[derive(Clone, Debug)]
pub struct Sequencer {
    clocks_per_us: u64,
    started_us: u64,
    tracks: [Track; MAX_CHANNELS],
}

impl Sequencer {
    /// Timers that started together at `started_us` of the board's time, blank ([`IDLE`]), with a clock of
    /// `clocks_per_us` MHz.
    #[must_use]
    pub const fn new(clocks_per_us: u32, started_us: u64) -> Self {
        Self { clocks_per_us: clocks_per_us as u64, started_us, tracks: [const { Track::new() }; MAX_CHANNELS] }
    }

    /// The board's time in clocks since the start.
    #[must_use]
    pub const fn clocks_at(&self, time_us: u64) -> u64 {
        time_us.saturating_sub(self.started_us) * self.clocks_per_us
    }

    /// Gives every channel its goal; `None` lets it fall silent at its next boundary. A channel whose goal does not change
    /// goes on undisturbed. Envelopes that wait are forgotten.
    pub fn set_goals(&mut self, goals: &[Option<Goal>; MAX_CHANNELS], now_us: u64) {
        let (now, margin) = (self.clocks_at(now_us), MARGIN_US * self.clocks_per_us);
        let passed = self.certainly_passed(now);
        for track in &mut self.tracks {
            track.settle(passed);
            track.queue.clear();
        }
        let before: [Option<(Goal, u64)>; MAX_CHANNELS] =
            core::array::from_fn(|i| self.tracks.get(i).and_then(|track| track.goal.map(|goal| (goal, track.lattice))));
        let mut origins: [Option<u64>; MAX_CHANNELS] = [None; MAX_CHANNELS];
        let rhythm = |program: &ChannelProgram| (program.divider, program.ticks);
        for (i, goal) in goals.iter().enumerate() {
            let Some(goal) = goal else { continue };
            let program = &goal.program;
            let same =
                |j: usize| goals.get(j).and_then(Option::as_ref).is_some_and(|g| rhythm(&g.program) == rhythm(program));
            // The origin of a channel that keeps its frequency, else that of one that has just been given one, else any:
            // then this channel begins at its next boundary.
            let kept = before.iter().enumerate().find_map(|(j, old)| {
                let (old, lattice) = (*old)?;
                (same(j) && rhythm(&old.program) == rhythm(program)).then(|| lattice + old.program.origin_clocks)
            });
            let given = (0..i).find_map(|j| if same(j) { origins.get(j).copied().flatten() } else { None });
            let next = self.tracks.get(i).map_or(0, |track| track.next_change(now + margin));
            let origin = kept.or(given).unwrap_or(next + program.origin_clocks);
            let clocks = program.clocks();
            // Brought forward by a period where it would be before the start: only its place in a period counts.
            let lattice = origin + clocks - program.origin_clocks;
            let own = before.get(i).copied().flatten().filter(|(old, _)| rhythm(&old.program) == rhythm(program));
            // A channel that is where it should be but for the clocks that its gap could not hit stays there.
            let stays = own.map(|(_, old)| old).filter(|old| {
                let apart = lattice.abs_diff(*old) % clocks;
                apart.min(clocks - apart) <= u64::from(program.divider) / 2
            });
            if let (Some(place), Some(track)) = (origins.get_mut(i), self.tracks.get_mut(i)) {
                *place = Some(origin);
                track.lattice = stays.unwrap_or(lattice);
            }
        }
        for (track, goal) in self.tracks.iter_mut().zip(goals) {
            track.goal = *goal;
        }
    }

    /// Adds an envelope that starts at `start_us` of the board's time; `false` if the channel has no goal or as many wait
    /// as can.
    pub fn play(&mut self, channel: usize, start_us: u64, effect: &super::Effect) -> bool {
        let start = self.clocks_at(start_us);
        let Some(track) = self.tracks.get_mut(channel).filter(|track| track.goal.is_some()) else { return false };
        let place = track.queue.iter().position(|other| other.start > start).unwrap_or(track.queue.len());
        track.queue.insert(place, Envelope { effect: effect.clone(), start, begun: false }).is_ok()
    }

    /// Part of the full force, in parts of [`FULL_STRENGTH`], that the rail's voltage leaves to the window's width: the square of the voltage
    /// wanted over the one there is.
    pub fn set_strength(&mut self, channel: usize, strength: u32) {
        if let Some(track) = self.tracks.get_mut(channel) {
            track.strength = strength;
        }
    }

    /// Ends the drive of one channel at its next boundary.
    pub fn end(&mut self, channel: usize) {
        if let Some(track) = self.tracks.get_mut(channel) {
            track.goal = None;
            track.queue.clear();
        }
    }

    /// The goal of a channel.
    #[must_use]
    pub fn goal(&self, channel: usize) -> Option<Goal> {
        self.tracks.get(channel).and_then(|track| track.goal)
    }

    /// Whether a channel's electrodes are in use, now or from the next boundary on.
    #[must_use]
    pub fn drives(&self, channel: usize) -> bool {
        self.tracks.get(channel).is_some_and(|track| !track.active.is_blank() || !track.preloaded().is_blank())
    }

    /// The stronger of the two periods that a channel's timer goes through now and from its next boundary on: that with the
    /// wider windows for its length; `None` if both are blank.
    #[must_use]
    pub fn strongest(&self, channel: usize) -> Option<Period> {
        let track = self.tracks.get(channel)?;
        let (now, next) = (track.active, track.preloaded());
        // Of 16 bits each, so that the products fit.
        let share = |of: &Period, other: &Period| u32::from(of.widest()).saturating_mul(other.ticks);
        let strongest = if share(&now, &next) >= share(&next, &now) { now } else { next };
        (!strongest.is_blank()).then_some(strongest)
    }

    /// What must be written to a channel's preload registers now, if anything. To be asked of every channel at least every
    /// ms, and again at [`Self::due_us`].
    pub fn next(&mut self, channel: usize, now_us: u64) -> Option<Preload> {
        let (now, clocks_per_us) = (self.clocks_at(now_us), self.clocks_per_us);
        let passed = self.certainly_passed(now);
        let track = self.tracks.get_mut(channel)?;
        track.settle(passed);
        let at = track.next_boundary();
        track.passing = at < now + MARGIN_US * clocks_per_us;
        if track.passing {
            return None;
        }
        let period = track.wanted(at, clocks_per_us);
        if period == track.preloaded() {
            return None;
        }
        track.pending = Some((period, at));
        Some(Preload { channel, period, at })
    }

    /// What must be written to all channels' preload registers now.
    pub fn poll(&mut self, now_us: u64) -> Vec<Preload, MAX_CHANNELS> {
        (0..MAX_CHANNELS).filter_map(|channel| self.next(channel, now_us)).collect()
    }

    const fn certainly_passed(&self, now: u64) -> u64 {
        now.saturating_sub(CERTAIN_US * self.clocks_per_us)
    }

    /// When the sequencer wants to be asked again, if that is before the next ms: right after the next boundary of a
    /// channel that plays an envelope, so that none of its periods is missed, or of one whose boundary was too near. (Periods
    /// of 1 ms would otherwise be too near every time.)
    #[must_use]
    pub fn due_us(&self) -> Option<u64> {
        // An envelope that begins only later is none yet.
        let plays = |track: &Track| {
            let soon = track.next_boundary() + track.active.clocks();
            track.goal.is_some() && track.queue.first().is_some_and(|first| first.begun || first.start <= soon)
        };
        let waits = |track: &&Track| track.passing || plays(track);
        let next = self.tracks.iter().filter(waits).map(Track::next_boundary).min()?;
        Some(self.started_us + next / self.clocks_per_us + CERTAIN_US + 1)
    }
}

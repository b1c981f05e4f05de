//! From one drive to the next: what each timer's preload registers must hold before its next boundary.
//!
//! All timers start together, blank, and run until everything goes off, so that every boundary is known exactly, in clocks
//! since that start: a boundary plus whole periods. The clock on the board's wall only tells which boundary is the next.
//! Nothing is ever stopped or set while it runs: a change is written to the preload registers and takes effect by itself.
//!
//! Channels with one frequency (equal divider and ticks) have a common origin of phase. A channel whose next boundary is
//! not where its phase wants it goes through a blank period of the length that is missing.

use super::envelope::{Envelope, EnvelopeLevel, FULL_STRENGTH, window_ticks_for_level};
use super::period::{IDLE, TimerPeriod};
use super::program::ChannelProgram;
use super::window_sequence::{LEAST_LEAD_CLOCKS, PlacedWindows};
use crate::MAX_CHANNELS;
use crate::circuit::least_electrode_charge_permille;
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
/// Most envelopes that wait for one channel, with the one that plays.
const QUEUE: usize = 4;

/// What is to be written to a timer's preload registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimerPreload {
    /// 0-based.
    pub channel: usize,
    /// Rhythm and windows.
    pub period: TimerPeriod,
    /// When it takes effect, in clocks since the timers' start.
    pub at: u64,
}

/// A preload nearer than this to its boundary, in us, is too late: writing it takes 2 us.
const TOO_LATE_US: u64 = 5;

impl TimerPreload {
    /// Whether less than 5 us are left until it takes effect, `elapsed_us` after the timers' start.
    #[must_use]
    pub const fn is_too_late_to_write(&self, elapsed_us: u64, clocks_per_us: u64) -> bool {
        elapsed_us.saturating_add(TOO_LATE_US).saturating_mul(clocks_per_us) > self.at
    }
}

/// What a channel is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelGoal {
    /// Rhythm and greatest windows.
    pub program: ChannelProgram,
    /// Whether it drives when no envelope says otherwise.
    pub drives_without_envelope: bool,
}

/// How often the electrodes of a channel were charged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElectrodeCharges {
    /// In thousandths of a full charge at least: a narrow window does not charge its electrode in full.
    pub least_permille: u32,
    /// At most: each window counts in full.
    pub most_permille: u32,
}

impl ElectrodeCharges {
    const NONE: Self = Self { least_permille: 0, most_permille: 0 };

    /// Adds the windows of so many equal periods.
    fn add_least_and_most_charges_of_periods(&mut self, period: &TimerPeriod, count: u64, clocks_per_us: u64) {
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        for window in [period.a, period.b].into_iter().filter(|window| window.off > window.on) {
            let clocks = u64::from(window.off - window.on) * u64::from(period.divider);
            let least_permille = least_electrode_charge_permille(clocks * 1_000 / clocks_per_us);
            self.least_permille = self.least_permille.saturating_add(least_permille.saturating_mul(count));
            self.most_permille = self.most_permille.saturating_add(1_000_u32.saturating_mul(count));
        }
    }
}

#[derive(Clone, Debug)]
struct ChannelTrack {
    /// What the timer does from `boundary` on.
    active: TimerPeriod,
    /// A boundary that has passed, or 0.
    boundary: u64,
    /// What the preload registers hold, if it is something else, and when it takes effect.
    pending: Option<(TimerPeriod, u64)>,
    goal: Option<ChannelGoal>,
    /// One of the boundaries at which the goal's phase is kept.
    lattice: u64,
    /// Part of the full force that the rail's voltage leaves to the window's width.
    force_fraction: u32,
    queue: Vec<Envelope, QUEUE>,
    /// Windows that are given one by one take the place of a goal.
    plays_windows: bool,
    /// A boundary of these windows passed before it could be prepared.
    missed: bool,
    /// The next boundary was too near to be changed when it was last looked at.
    passing: bool,
    /// The charges of all periods that are over and have not been taken.
    charges: ElectrodeCharges,
}

impl ChannelTrack {
    const fn new() -> Self {
        Self {
            active: IDLE,
            boundary: 0,
            pending: None,
            goal: None,
            lattice: 0,
            force_fraction: FULL_STRENGTH,
            queue: Vec::new(),
            plays_windows: false,
            missed: false,
            passing: false,
            charges: ElectrodeCharges::NONE,
        }
    }

    /// Updates the running period for all boundaries up to `now`.
    fn advance_to_now_noting_missed_windows(
        &mut self,
        now: u64,
        clocks_per_us: u64,
        windows: Option<(&PlacedWindows, u8)>,
    ) {
        if let Some((period, at)) = self.pending
            && at <= now
        {
            self.advance_boundary_by_periods_and_add_their_charges(
                at.saturating_sub(self.boundary) / self.active.length_clocks(),
                clocks_per_us,
            );
            (self.active, self.boundary, self.pending) = (period, at, None);
        }
        // Whatever is played by a rhythm may go on until its next boundary. Of windows that are given one by one, each has its own.
        while let Some((windows, channel)) = windows.filter(|_| self.plays_windows) {
            let (next, length) = (self.next_boundary_clock(), self.active.length_clocks());
            if next > now {
                break;
            }
            let is_prepared =
                windows.period_from_boundary_unless_windows_over(channel, next).unwrap_or(IDLE) == self.active;
            if !is_prepared && !windows.is_start_reachable_from_boundary(next + length) {
                (self.plays_windows, self.missed) = (false, true);
            }
            self.advance_boundary_by_periods_and_add_their_charges(1, clocks_per_us);
        }
        self.advance_boundary_by_periods_and_add_their_charges(
            now.saturating_sub(self.boundary) / self.active.length_clocks(),
            clocks_per_us,
        );
    }

    /// So many periods of the running kind are over.
    fn advance_boundary_by_periods_and_add_their_charges(&mut self, count: u64, clocks_per_us: u64) {
        self.boundary += count * self.active.length_clocks();
        if count > 0 {
            self.charges.add_least_and_most_charges_of_periods(&self.active, count, clocks_per_us);
        }
    }

    /// The boundary after `now`.
    const fn next_boundary_clock(&self) -> u64 {
        self.boundary + self.active.length_clocks()
    }

    /// The first boundary, not before `earliest`, for which something can still be preloaded.
    const fn next_changeable_boundary_clock(&self, earliest: u64) -> u64 {
        let next = self.next_boundary_clock();
        if next >= earliest { next } else { next + self.preloaded_or_else_active_period().length_clocks() }
    }

    const fn preloaded_or_else_active_period(&self) -> TimerPeriod {
        match self.pending {
            Some((period, _)) => period,
            None => self.active,
        }
    }

    /// The period that should begin at `boundary`.
    fn choose_period_from(
        &mut self,
        boundary: u64,
        clocks_per_us: u64,
        windows: Option<(&PlacedWindows, u8)>,
    ) -> TimerPeriod {
        if let Some((windows, channel)) = windows.filter(|_| self.plays_windows) {
            if let Some(period) = windows.period_from_boundary_unless_windows_over(channel, boundary) {
                return period;
            }
            self.plays_windows = false;
        }
        let Some(goal) = self.goal else { return IDLE };
        let program = goal.program;
        let clocks = program.period_clocks();
        let late = (boundary + clocks - self.lattice % clocks) % clocks;
        if late > 0 {
            let (gap, reached) =
                make_blank_gap_and_its_actual_clocks(clocks - late, clocks, LEAST_GAP_US * clocks_per_us);
            // The phase is right where the gap ends, or a clock or two off if no divider fits exactly.
            self.lattice = boundary + reached;
            return gap;
        }
        let level = self.envelope_level_or_goal_default_at(goal, boundary, clocks_per_us);
        let width = window_ticks_for_level(program.ticks, program.width, level, self.force_fraction);
        TimerPeriod::with_windows(program.divider, program.ticks, width, level < 0)
    }

    fn envelope_level_or_goal_default_at(&mut self, goal: ChannelGoal, boundary: u64, clocks_per_us: u64) -> i16 {
        while let Some(envelope) = self.queue.first_mut() {
            match envelope.begin_if_due_and_get_level(boundary, goal.program.period_clocks(), 1000 * clocks_per_us) {
                EnvelopeLevel::Waiting => break,
                EnvelopeLevel::Level(level) => return level,
                EnvelopeLevel::Ended => {
                    self.queue.remove(0);
                }
            }
        }
        if goal.drives_without_envelope { super::FULL_LEVEL } else { 0 }
    }
}

/// A blank period of `missing_clocks` plus as many whole periods of `period_clocks` as make it `least_clocks` or longer. Returns the period and how
/// many clocks it really has.
fn make_blank_gap_and_its_actual_clocks(
    missing_clocks: u64,
    period_clocks: u64,
    least_clocks: u64,
) -> (TimerPeriod, u64) {
    let first = missing_clocks + least_clocks.saturating_sub(missing_clocks).div_ceil(period_clocks) * period_clocks;
    // In 32 bits, which hold 25 s: the processor of the board divides them in hardware.
    let number = |value: u64| u32::try_from(value).unwrap_or(u32::MAX / 2);
    let mut best = (u32::MAX, 1, 2);
    for length in (0..CHANCES).map(|chance| number(first + chance * period_clocks)) {
        let coarsest = length.div_ceil(TimerPeriod::MOST_TICKS).max(1);
        for divider in coarsest..coarsest + DIVIDERS_TRIED {
            let ticks = (length + divider / 2) / divider;
            let error = (ticks * divider).abs_diff(length);
            if error < best.0 && ticks <= TimerPeriod::MOST_TICKS {
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
    (TimerPeriod::without_windows(divider, ticks), u64::from(divider) * u64::from(ticks))
}

/// All channels of a board.
#[derive(Clone, Debug)]
pub struct Sequencer {
    clocks_per_us: u64,
    started_us: u64,
    tracks: [ChannelTrack; MAX_CHANNELS],
    /// Windows that are given one by one, while a channel plays them.
    windows: Option<PlacedWindows>,
}

impl Sequencer {
    /// Timers that started together at `started_us` of the board's time, blank ([`IDLE`]), with a clock of
    /// `clocks_per_us` MHz.
    #[must_use]
    pub const fn new(clocks_per_us: u32, started_us: u64) -> Self {
        Self {
            clocks_per_us: clocks_per_us as u64,
            started_us,
            tracks: [const { ChannelTrack::new() }; MAX_CHANNELS],
            windows: None,
        }
    }

    /// The board's time in clocks since the start; at most [`u64::MAX`], because a host may name any time.
    #[must_use]
    pub const fn clocks_since_start(&self, time_us: u64) -> u64 {
        time_us.saturating_sub(self.started_us).saturating_mul(self.clocks_per_us)
    }

    /// The board's time in us of a clock since the start, rounded down.
    #[must_use]
    pub const fn board_time_of_clock_us(&self, clock: u64) -> u64 {
        self.started_us + clock / self.clocks_per_us
    }

    /// Sets the goal of every channel; a channel with `None` ends its drive at its next boundary. A channel whose goal does not change is not
    /// disturbed. Envelopes that wait are dropped.
    pub fn set_or_end_drives_from_next_boundary(&mut self, goals: &[Option<ChannelGoal>; MAX_CHANNELS], now_us: u64) {
        let (now, margin) = (self.clocks_since_start(now_us), MARGIN_US * self.clocks_per_us);
        let passed = self.latest_certainly_passed_clock(now);
        self.advance_all_channels_to_clock(passed);
        for track in &mut self.tracks {
            track.queue.clear();
            track.plays_windows = false;
        }
        let before: [Option<(ChannelGoal, u64)>; MAX_CHANNELS] =
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
            let next = self.tracks.get(i).map_or(0, |track| track.next_changeable_boundary_clock(now + margin));
            let origin = kept.or(given).unwrap_or(next + program.origin_clocks);
            let clocks = program.period_clocks();
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
    pub fn queue_effect_if_goal_and_queue_not_full(
        &mut self,
        channel: usize,
        start_us: u64,
        effect: &super::Effect,
    ) -> bool {
        let start = self.clocks_since_start(start_us);
        let Some(track) = self.tracks.get_mut(channel).filter(|track| track.goal.is_some()) else { return false };
        let place = track.queue.iter().position(|other| other.start > start).unwrap_or(track.queue.len());
        track.queue.insert(place, Envelope { effect: effect.clone(), start, begun: false }).is_ok()
    }

    /// When the last envelope that waits for a channel, or plays, has ended, in us of the board's time; `None` if there is none.
    #[must_use]
    pub fn envelopes_end_us(&self, channel: usize) -> Option<u64> {
        let track = self.tracks.get(channel)?;
        let clocks = track.goal?.program.period_clocks();
        let end = track
            .queue
            .iter()
            .map(|envelope| envelope.start + envelope.length_clocks(clocks, 1000 * self.clocks_per_us));
        Some(self.started_us + end.max()? / self.clocks_per_us)
    }

    /// The earliest beginning of a sequence of windows on these channels, in clocks since the start: all of them are led from their
    /// boundaries to it.
    #[must_use]
    pub fn earliest_sequence_start_clock(&mut self, channels: [bool; MAX_CHANNELS], now_us: u64) -> u64 {
        let (now, margin) = (self.clocks_since_start(now_us), MARGIN_US * self.clocks_per_us);
        let passed = self.latest_certainly_passed_clock(now);
        self.advance_all_channels_to_clock(passed);
        let mut earliest = now;
        for (track, _) in self.tracks.iter().zip(channels).filter(|(_, used)| *used) {
            // One more period than can be changed, should its boundary pass before the device looks again.
            let changeable = track.next_changeable_boundary_clock(now + margin)
                + track.preloaded_or_else_active_period().length_clocks();
            earliest = earliest.max(changeable + LEAST_LEAD_CLOCKS);
        }
        earliest
    }

    /// Plays windows that are given one by one. Whatever was driven ends at its next boundary.
    pub fn play_windows_at_their_times_ending_drives_at_next_boundary(&mut self, windows: &PlacedWindows, now_us: u64) {
        self.set_or_end_drives_from_next_boundary(&[None; MAX_CHANNELS], now_us);
        for (track, used) in self.tracks.iter_mut().zip(windows.used_channels()) {
            (track.plays_windows, track.missed) = (used, false);
        }
        self.windows = Some(windows.clone());
    }

    fn advance_all_channels_to_clock(&mut self, clock_since_start: u64) {
        for (channel, track) in (0..).zip(&mut self.tracks) {
            let windows = self.windows.as_ref().map(|windows| (windows, channel));
            track.advance_to_now_noting_missed_windows(clock_since_start, self.clocks_per_us, windows);
        }
    }

    /// Whether a channel has windows that are given one by one and not yet over.
    #[must_use]
    pub fn has_unfinished_window_sequence(&self, channel: usize) -> bool {
        self.tracks.get(channel).is_some_and(|track| track.plays_windows)
    }

    /// The first channel of which a window could not be prepared in time; its windows have been dropped.
    #[must_use]
    pub fn first_channel_with_missed_window(&self) -> Option<usize> {
        self.tracks.iter().position(|track| track.missed)
    }

    /// Sets the fraction of the full force, in parts of [`FULL_STRENGTH`], that the window's width has to make: the square of the wanted voltage
    /// over the rail's.
    pub fn set_force_fraction_q16_of_drive_windows(&mut self, channel: usize, force_fraction: u32) {
        if let Some(track) = self.tracks.get_mut(channel) {
            track.force_fraction = force_fraction;
        }
    }

    /// Ends the drive of one channel at its next boundary.
    pub fn end_drive_at_next_boundary(&mut self, channel: usize) {
        if let Some(track) = self.tracks.get_mut(channel) {
            track.goal = None;
            track.queue.clear();
            track.plays_windows = false;
        }
    }

    /// The goal of a channel.
    #[must_use]
    pub fn goal(&self, channel: usize) -> Option<ChannelGoal> {
        self.tracks.get(channel).and_then(|track| track.goal)
    }

    /// Whether a channel's electrodes are in use, now or from the next boundary on.
    #[must_use]
    pub fn is_active_or_preloaded_period_driving(&self, channel: usize) -> bool {
        self.tracks.get(channel).is_some_and(|track| {
            !track.active.has_no_windows() || !track.preloaded_or_else_active_period().has_no_windows()
        })
    }

    /// The stronger of the two periods that a channel's timer goes through now and from its next boundary on: that with the
    /// wider windows for its length; `None` if both are blank.
    #[must_use]
    pub fn stronger_of_active_and_preloaded_period_if_any_driving(&self, channel: usize) -> Option<TimerPeriod> {
        let track = self.tracks.get(channel)?;
        let (now, next) = (track.active, track.preloaded_or_else_active_period());
        // Of 16 bits each, so that the products fit.
        let share =
            |of: &TimerPeriod, other: &TimerPeriod| u32::from(of.widest_window_ticks()).saturating_mul(other.ticks);
        let strongest = if share(&now, &next) >= share(&next, &now) { now } else { next };
        (!strongest.has_no_windows()).then_some(strongest)
    }

    /// How often each channel's electrodes were charged in the periods that have ended since the last call.
    pub fn take_electrode_charge_counts(&mut self) -> [ElectrodeCharges; MAX_CHANNELS] {
        core::array::from_fn(|channel| {
            self.tracks.get_mut(channel).map(|track| core::mem::take(&mut track.charges)).unwrap_or_default()
        })
    }

    /// What must be written to a channel's preload registers now, if anything. To be called for every channel at least every
    /// ms, and again at [`Self::next_extra_poll_time_us_if_playing_or_too_near`].
    pub fn advance_and_prepare_next_preload_if_changed(&mut self, channel: usize, now_us: u64) -> Option<TimerPreload> {
        let (now, clocks_per_us) = (self.clocks_since_start(now_us), self.clocks_per_us);
        let passed = self.latest_certainly_passed_clock(now);
        let track = self.tracks.get_mut(channel)?;
        let windows = self.windows.as_ref().zip(u8::try_from(channel).ok());
        track.advance_to_now_noting_missed_windows(passed, clocks_per_us, windows);
        let at = track.next_boundary_clock();
        track.passing = at < now + MARGIN_US * clocks_per_us;
        if track.passing {
            return None;
        }
        let period = track.choose_period_from(at, clocks_per_us, windows);
        if period == track.preloaded_or_else_active_period() {
            return None;
        }
        track.pending = Some((period, at));
        Some(TimerPreload { channel, period, at })
    }

    /// What must be written to all channels' preload registers now.
    pub fn take_due_preloads(&mut self, now_us: u64) -> Vec<TimerPreload, MAX_CHANNELS> {
        (0..MAX_CHANNELS)
            .filter_map(|channel| self.advance_and_prepare_next_preload_if_changed(channel, now_us))
            .collect()
    }

    const fn latest_certainly_passed_clock(&self, now: u64) -> u64 {
        now.saturating_sub(CERTAIN_US * self.clocks_per_us)
    }

    /// Time in us at which the sequencer must be asked again, if that is before the next ms: right after the next boundary of a
    /// channel that plays an envelope, so that none of its periods is missed, or of a channel whose boundary was too near. (Periods
    /// of 1 ms would otherwise be too near every time.)
    #[must_use]
    pub fn next_extra_poll_time_us_if_playing_or_too_near(&self) -> Option<u64> {
        // An envelope that begins only later is none yet.
        let plays = |track: &ChannelTrack| {
            let soon = track.next_boundary_clock() + track.active.length_clocks();
            track.plays_windows
                || track.goal.is_some() && track.queue.first().is_some_and(|first| first.begun || first.start <= soon)
        };
        let waits = |track: &&ChannelTrack| track.passing || plays(track);
        let next = self.tracks.iter().filter(waits).map(ChannelTrack::next_boundary_clock).min()?;
        Some(self.started_us + next / self.clocks_per_us + CERTAIN_US + 1)
    }
}

//! One touch after the other: none overtakes a newer one, and none begins while too much is left of those before.

use super::burst::Burst;
use super::problem::{Kind, Problem};
use crate::device::{SessionError, Snapshot};
use crate::planner::Drive;
use crate::planner::plan_motion::PlanMotion;
use crate::planner::residual::{Board, Ending, ResidualVibration, Room};
use crate::planner::rise::DecayingMode;
use era_shared::safety::State;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What has been driven, and what is left of it.
#[derive(Debug)]
pub struct Turns {
    /// The newest plan that has been driven, or waits to be.
    newest: tokio::sync::Mutex<u64>,
    /// The same, for those that do not wait for it.
    latest: AtomicU64,
    residual: Mutex<ResidualVibration>,
    burst: Mutex<Option<Burst>>,
    /// Wakes those that wait for their turn: nobody wants it any more.
    unwanted: tokio::sync::Notify,
    /// Zero of [`ResidualVibration`]'s time.
    started: Instant,
}

/// Leave to drive, for as long as it is held.
#[derive(Debug)]
pub struct Turn<'a> {
    turns: &'a Turns,
    id: u64,
    board: Board,
    since: Instant,
    waits: Option<Instant>,
    newest: Newest<'a>,
}

/// The newest plan, locked. One that drives nothing in its turn has not taken the place of the one before.
#[derive(Debug)]
pub struct Newest<'a> {
    locked: tokio::sync::MutexGuard<'a, u64>,
    latest: &'a AtomicU64,
    before: u64,
    has_driven: AtomicBool,
}

impl Drop for Newest<'_> {
    fn drop(&mut self) {
        if !*self.has_driven.get_mut() {
            let id = std::mem::replace(&mut *self.locked, self.before);
            // Unless a newer one has come meanwhile.
            let _ = self.latest.compare_exchange(id, self.before, Ordering::SeqCst, Ordering::SeqCst);
        }
    }
}

impl Newest<'_> {
    /// It stays the newest.
    pub fn stays(&self) {
        self.has_driven.store(true, Ordering::SeqCst);
    }
}

impl Turns {
    /// For a panel at rest with these poles.
    #[must_use]
    pub fn new(modes: Vec<DecayingMode>) -> Self {
        let (newest, residual) = (tokio::sync::Mutex::new(0), Mutex::new(ResidualVibration::new(modes)));
        Self {
            newest,
            latest: AtomicU64::new(0),
            residual,
            burst: Mutex::new(None),
            unwanted: tokio::sync::Notify::new(),
            started: Instant::now(),
        }
    }

    /// Waits as long as that makes `drives` much stronger on top of what is left of the touches before ([`ResidualVibration::room`]); those that
    /// are on then are ended by `release`. A newer turn takes the place of one that waits.
    ///
    /// # Errors
    /// [`Problem`]: there was a newer turn, or a stop.
    pub async fn take(
        &self,
        id: u64,
        motion: &PlanMotion,
        drives: Option<&[Drive]>,
        board: impl Fn() -> Board,
        release: impl Fn(u64),
        is_stopped: impl Fn() -> bool,
    ) -> Result<Turn<'_>, Problem> {
        let newest = self.overtake(id).await?;
        let (board_now, now) = (board(), Instant::now());
        let turn = |board, since, waits, newest| Turn { turns: self, id, board, since, waits, newest };
        let Room { after_s, part, goes_on } = self.residual().room(motion, drives, self.s(now), board_now);
        if after_s <= 0.0 {
            return Ok(turn(board_now, now, None, newest));
        }
        if !goes_on {
            let driven = self.residual().driven();
            if let Some(driven) = driven {
                release(driven);
            }
            self.residual().end(self.s(now), Ending::AtItsBoundary);
        }
        tracing::info!(plan = id, wait_ms = after_s * 1e3, part, "waits for what is left of the touches before");
        // Whatever becomes of it, those before have made way.
        newest.stays();
        drop(newest);
        let is_wanted = tokio::select! {
            () = tokio::time::sleep(Duration::from_secs_f64(after_s)) => true,
            () = self.unwanted.notified() => false,
        };
        if is_stopped() {
            return Err(SessionError::Stopped.into());
        }
        if !is_wanted {
            return Err(superseded());
        }
        let newest = self.overtake(id).await?;
        Ok(turn(board(), Instant::now(), Some(now), newest))
    }

    /// A turn for plan `id`, to change its drives, which were the `begun`th to begin ([`Turn::drives`]); `None` if others have begun
    /// since or are to, or if the board has gone off.
    pub async fn again(&self, id: u64, begun: u64, board: impl Fn() -> Board) -> Option<Turn<'_>> {
        let newest = self.newest(id).await.ok()?;
        let board = board();
        let is_driven = self.residual().begun() == begun && board != Board::Down;
        is_driven.then(|| Turn { turns: self, id, board, since: Instant::now(), waits: None, newest })
    }

    /// Ends the turns of older plans than `id`.
    ///
    /// # Errors
    /// [`Problem`]: there was a newer one.
    pub async fn overtake(&self, id: u64) -> Result<Newest<'_>, Problem> {
        // Those that wait for the same hear of it at once: while the board arms or rests they would all be driven in turn.
        self.latest.fetch_max(id, Ordering::SeqCst);
        let newest = self.newest(id).await?;
        self.check(id)?;
        Ok(newest)
    }

    /// The same, of what is driven already.
    async fn newest(&self, id: u64) -> Result<Newest<'_>, Problem> {
        let mut locked = self.newest.lock().await;
        if id < *locked {
            return Err(superseded());
        }
        let before = std::mem::replace(&mut *locked, id);
        self.latest.fetch_max(id, Ordering::SeqCst);
        Ok(Newest { locked, latest: &self.latest, before, has_driven: AtomicBool::new(false) })
    }

    /// Whether this is still the newest plan.
    ///
    /// # Errors
    /// [`Problem`]: there was a newer one.
    pub fn check(&self, id: u64) -> Result<(), Problem> {
        if id < self.latest.load(Ordering::SeqCst) { Err(superseded()) } else { Ok(()) }
    }

    /// Ends all waits; who has not begun to wait is not concerned.
    pub fn drop_waiting(&self) {
        self.unwanted.notify_waiters();
    }

    /// The drives of plan `id` end at `when`.
    pub fn end_of(&self, id: u64, when: Instant) {
        let mut residual = self.residual();
        residual.end_of(id, self.s(when));
        if residual.driven() == Some(id)
            && let Some(burst) = self.burst().as_mut()
        {
            burst.end_by(when);
        }
    }

    /// The drives of plan `id`, if they are on, go on until `until`.
    pub fn prolong(&self, id: u64, until: Instant) {
        let mut residual = self.residual();
        residual.prolong(id, self.s(Instant::now()), self.s(until));
        if residual.driven() == Some(id)
            && let Some(burst) = self.burst().as_mut()
        {
            burst.go_on(until);
        }
    }

    /// Whatever is driven ends with a stop.
    pub fn stop(&self) {
        let now = Instant::now();
        self.residual().end(self.s(now), Ending::AtOnce);
        if let Some(burst) = self.burst().as_mut() {
            burst.end_by(now);
        }
    }

    /// When the board has to rest, if what is driven goes on until `until`.
    pub fn rest_due(&self, until: Instant) -> Option<Instant> {
        self.burst().as_ref().and_then(|burst| burst.due(until))
    }

    fn burst(&self) -> MutexGuard<'_, Option<Burst>> {
        self.burst.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn residual(&self) -> MutexGuard<'_, ResidualVibration> {
        self.residual.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn s(&self, when: Instant) -> f64 {
        when.saturating_duration_since(self.started).as_secs_f64()
    }
}

impl Turn<'_> {
    /// The plan that it is the turn of.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// Whether the rails have to rise with the drives.
    #[must_use]
    pub fn is_soft(&self) -> bool {
        self.board == Board::Down
    }

    /// The part of these drives' forces for which there is room.
    #[must_use]
    pub fn part(&self, motion: &PlanMotion, drives: Option<&[Drive]>) -> f64 {
        self.turns.residual().part(motion, drives, self.turns.s(self.since), self.board)
    }

    /// How long it has waited until now, if it had to.
    #[must_use]
    pub fn delayed(&self) -> Option<Duration> {
        self.waits.map(|since| since.elapsed())
    }

    /// The drives have begun, since it is this one's turn, and will end at `until`. How many have begun until now.
    pub fn drives(&self, motion: &PlanMotion, drives: Option<&[Drive]>, until: Instant) -> u64 {
        let turns = self.turns;
        self.newest.stays();
        let mut residual = turns.residual();
        residual.begin(self.id, motion, drives, self.board, turns.s(self.since), turns.s(until));
        let lowest_hz = motion.lines.iter().map(|line| line.drive_hz).fold(f64::INFINITY, f64::min);
        let mut burst = turns.burst();
        *burst = Some(Burst::begun(*burst, Instant::now(), until, lowest_hz));
        residual.begun()
    }

    /// Nothing is driven from here on, though the turn lasts; when the board has rested.
    pub fn rest(&self) -> Option<Instant> {
        let now = Instant::now();
        self.turns.residual().end(self.turns.s(now), Ending::AtItsBoundary);
        let mut burst = self.turns.burst();
        let burst = burst.as_mut()?;
        burst.end_by(now);
        Some(burst.rested())
    }

    /// The same turn after a while, for a board that does this now.
    #[must_use]
    pub fn later(self, board: Board) -> Self {
        Self { board, since: Instant::now(), ..self }
    }
}

/// What the board does, as far as its state has been told.
#[must_use]
pub fn board(device: &Snapshot) -> Board {
    match device.state() {
        Some(State::Running) => Board::Driving,
        Some(State::Armed | State::Arming) | None => Board::Up,
        Some(State::Boot | State::Safe | State::Fault | State::Discharging) => Board::Down,
    }
}

/// That a newer touch stands in this one's place.
#[must_use]
pub fn superseded() -> Problem {
    let detail = "a newer touch was driven meanwhile";
    Problem::new(Kind::Superseded, detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::MAX_ACTUATORS;

    fn nothing() -> PlanMotion {
        let (none, one) = ([0.0; MAX_ACTUATORS], [1.0; MAX_ACTUATORS]);
        let limit_m = [f64::INFINITY; MAX_ACTUATORS];
        PlanMotion { limit_m, steady_m: none, at_once_m: none, soft_m: none, growth: one, lines: Vec::new() }
    }

    /// A touch with two time windows drives twice under one number: what began weaker in the first must not come back in the second,
    /// nor on a board that has gone off.
    #[tokio::test]
    async fn only_the_last_drives_are_changed_again() {
        let (turns, motion) = (Turns::new(Vec::new()), nothing());
        let until = Instant::now() + Duration::from_secs(9);
        let drive = async |id: u64| {
            let turn = turns.take(id, &motion, Some(&[]), || Board::Driving, |_| {}, || false).await?;
            Ok::<_, Problem>(turn.drives(&motion, Some(&[]), until))
        };
        let first = drive(1).await.unwrap();
        assert!(turns.again(1, first, || Board::Driving).await.is_some());
        assert!(turns.again(1, first, || Board::Down).await.is_none());
        let second = drive(1).await.unwrap();
        assert!(turns.again(1, first, || Board::Driving).await.is_none());
        assert!(turns.again(1, second, || Board::Driving).await.is_some());
        drive(2).await.unwrap();
        assert!(turns.again(1, second, || Board::Driving).await.is_none());
        assert!(drive(1).await.unwrap_err().is("superseded"));
    }

    /// A newer one that is refused leaves the older one what it was: there to be looked after.
    #[tokio::test]
    async fn one_that_drives_nothing_takes_nobodys_place() {
        let turns = Turns::new(Vec::new());
        let (motion, until) = (nothing(), Instant::now() + Duration::from_secs(9));
        let take = |id: u64| turns.take(id, &motion, Some(&[]), || Board::Driving, |_| {}, || false);
        let begun = take(5).await.unwrap().drives(&motion, Some(&[]), until);
        drop(take(7).await.unwrap());
        assert!(turns.again(5, begun, || Board::Driving).await.is_some());
        assert!(turns.check(6).is_ok());
        take(7).await.unwrap().drives(&motion, Some(&[]), until);
        assert!(turns.again(5, begun, || Board::Driving).await.is_none() && turns.check(6).is_err());
    }

    /// Of several that wait while the board arms or rests only the newest is driven, whichever asked first.
    #[tokio::test]
    async fn those_that_wait_for_the_same_make_way_for_the_newest() {
        let turns = Turns::new(Vec::new());
        let motion = nothing();
        let take = |id: u64| turns.take(id, &motion, Some(&[]), || Board::Driving, |_| {}, || false);
        let first = take(1).await.unwrap();
        let mut waiting: Vec<_> = [2, 4, 3].into_iter().map(|id| Box::pin(take(id))).collect();
        for turn in &mut waiting {
            assert!(
                std::future::poll_fn(|context| std::task::Poll::Ready(turn.as_mut().poll(context).is_pending())).await
            );
        }
        drop(first);
        let mut driven = Vec::new();
        for turn in waiting {
            if let Ok(turn) = turn.await {
                turn.drives(&motion, Some(&[]), Instant::now() + Duration::from_secs(9));
                driven.push(turn.id());
            }
        }
        assert_eq!(driven, [4]);
    }
}

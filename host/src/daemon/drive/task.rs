//! The task that owns what is driven.
//!
//! It does one thing at a time with the board, which is its lane: a touch waits for what is left of those before, or is on its way to
//! the board, or the board rests. Commands are taken meanwhile: a newer touch takes the place of one that waits; a release, or more time,
//! goes to the session at once. A stop goes to the session first and is told here afterwards, so that nothing here can hold it up.

use super::active::{Active, AskedAt, Current, Sustained, Touched, Update};
use super::command::{Command, Published, Request, is_current, say_superseded};
use super::equipment::{Begun, Equipment, NotBegun};
use super::order::{Drivable, Mode, Order};
use super::state::DriveState;
use crate::daemon::api::kinds::Kind;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::answer::Achieved;
use crate::daemon::touch::check::DriveMode;
use crate::daemon::touch::plan_view::{PlanView, Thinned};
use crate::daemon::touch::request::Finger;
use crate::device::SessionError;
use crate::planner::Plan;
use crate::planner::residual::{Board, Ending, Room, fitted};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// The task.
#[derive(Debug)]
pub struct Task {
    /// Of the daemon, which may end in between.
    equipment: Weak<Equipment>,
    inbox: mpsc::UnboundedReceiver<Command>,
    publish: watch::Sender<Published>,
    updates: broadcast::Sender<Update>,
    pub(super) state: DriveState,
    pub(super) lane: Lane,
    /// What waits for the lane: the newest.
    next: Option<Next>,
    /// When what goes on was looked at last.
    pub(super) looked: Instant,
}

/// What waits for the lane.
#[derive(Debug)]
enum Next {
    Drive(Box<Request>),
    Overtake { id: u64, reply: oneshot::Sender<()> },
}

impl Next {
    const fn touch_id(&self) -> u64 {
        match self {
            Self::Drive(request) => request.order.id,
            Self::Overtake { id, .. } => *id,
        }
    }
}

type Answer = Pin<Box<dyn Future<Output = Result<Begun, NotBegun>> + Send>>;

/// What there is to do with the board.
pub enum Lane {
    /// Nothing.
    Free,
    /// A touch waits for what is left of those before.
    Settling { request: Box<Request>, since: Instant, until: Instant },
    /// The board has been told to drive, and has not answered yet.
    Ordered { sent: Box<Sent>, answer: Answer },
    /// The board rests, at least until `until`, for a drive that goes on afterwards.
    Resting { held: Box<Sustained>, until: Instant, looks: u32 },
}

impl std::fmt::Debug for Lane {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Free => "Free",
            Self::Settling { .. } => "Settling",
            Self::Ordered { .. } => "Ordered",
            Self::Resting { .. } => "Resting",
        })
    }
}

impl Lane {
    async fn wait_for_answer(&mut self) -> Result<Begun, NotBegun> {
        match self {
            Self::Ordered { answer, .. } => answer.await,
            _ => std::future::pending().await,
        }
    }
}

/// What the board has been told to drive.
#[derive(Debug)]
pub struct Sent {
    /// What for.
    pub purpose: Purpose,
    /// The plan, with the fraction of its forces for which there is room.
    pub drivable: Drivable,
    /// That fraction.
    pub part: f64,
    /// What the board did before.
    pub board: Board,
    /// When it was told.
    pub since: Instant,
    /// [`DriveState::newest`] before.
    pub newest: u64,
}

/// What the board has been told to drive something for.
#[derive(Debug)]
pub enum Purpose {
    /// A touch, which has waited for what is left of those before.
    Touch { request: Box<Request>, waited: Option<Duration> },
    /// A drive that goes on, after a rest or with other forces.
    Again { held: Box<Sustained>, has_rested: bool },
}

impl Task {
    /// A task for a panel at rest.
    #[must_use]
    pub fn new(
        equipment: &Arc<Equipment>,
        inbox: mpsc::UnboundedReceiver<Command>,
        publish: watch::Sender<Published>,
        updates: broadcast::Sender<Update>,
    ) -> Self {
        let state = DriveState::new(equipment.table.decaying_modes(), Instant::now());
        let equipment = Arc::downgrade(equipment);
        Self { equipment, inbox, publish, updates, state, lane: Lane::Free, next: None, looked: Instant::now() }
    }

    /// Carries out commands until nobody is there to send any.
    pub async fn run(mut self) {
        loop {
            let due = self.find_due();
            let sleep = async {
                match due {
                    Some(due) => tokio::time::sleep_until(due.into()).await,
                    None => std::future::pending().await,
                }
            };
            // What the board has answered comes before what is said next, and what is due before that: however much is said, it is done in time.
            let is_due = due.is_some_and(|due| due <= Instant::now());
            let (command, answer) = tokio::select! {
                biased;
                answer = self.lane.wait_for_answer() => (None, Some(answer)),
                () = std::future::ready(()), if is_due => (None, None),
                command = self.inbox.recv() => match command {
                    Some(command) => (Some(command), None),
                    None => return,
                },
                () = sleep => (None, None),
            };
            // Held only meanwhile, so that the daemon can end in between.
            let Some(equipment) = self.equipment.upgrade() else { return };
            match (command, answer) {
                (_, Some(answer)) => self.take_answer(&equipment, answer),
                (Some(command), _) => self.carry_out_command(&equipment, command),
                (None, None) => self.do_what_is_due(&equipment),
            }
            self.start_next(&equipment);
            self.publish_state();
        }
    }

    /// When something is to be done without being told.
    fn find_due(&self) -> Option<Instant> {
        match &self.lane {
            Lane::Free => self.find_next_look(),
            Lane::Settling { until, .. } | Lane::Resting { until, .. } => Some(*until),
            Lane::Ordered { .. } => None,
        }
    }

    fn do_what_is_due(&mut self, equipment: &Arc<Equipment>) {
        match std::mem::replace(&mut self.lane, Lane::Free) {
            Lane::Free => self.look_after(equipment),
            Lane::Settling { request, since, .. } => {
                if request.order.since.stops == equipment.session.stop_count() {
                    self.drive_touch(equipment, request, Some(since));
                } else {
                    request.refuse(SessionError::Stopped);
                }
            }
            Lane::Resting { held, looks, .. } => self.end_rest(equipment, held, looks),
            ordered @ Lane::Ordered { .. } => self.lane = ordered,
        }
    }

    fn carry_out_command(&mut self, equipment: &Arc<Equipment>, command: Command) {
        match command {
            Command::Drive(request) => {
                // Nobody waits for a place that a newer one has.
                if request.order.id < self.find_newest() {
                    request.refuse(say_superseded());
                } else {
                    self.replace_next(Next::Drive(request));
                }
            }
            Command::Overtake { id, reply } => {
                if id >= self.find_newest() {
                    self.replace_next(Next::Overtake { id, reply });
                }
            }
            Command::Release { id, when } => self.release(equipment, id, when),
            Command::Renew { id, until, reply } => {
                let _ = reply.send(self.renew(equipment, id, until));
            }
            Command::Withdraw { id } => {
                if matches!(&self.lane, Lane::Settling { request, .. } if request.order.id == id) {
                    self.refuse_settling(say_superseded);
                }
            }
            Command::Stopped { when } => {
                self.state.end_all(Ending::AtOnce, when);
                self.refuse_settling(|| SessionError::Stopped.into());
                if matches!(self.lane, Lane::Resting { .. }) {
                    self.lane = Lane::Free;
                }
                self.state.current.take_if(|current| current.stops != equipment.session.stop_count());
            }
        }
    }

    /// The newest touch that is driven, or is to be.
    fn find_newest(&self) -> u64 {
        let waiting = match &self.lane {
            Lane::Settling { request, .. } => request.order.id,
            _ => 0,
        };
        self.state.newest().max(self.next.as_ref().map_or(0, Next::touch_id)).max(waiting)
    }

    fn replace_next(&mut self, next: Next) {
        self.refuse_settling(say_superseded);
        if let Some(Next::Drive(older)) = self.next.replace(next) {
            older.refuse(say_superseded());
        }
    }

    fn refuse_settling(&mut self, problem: impl Fn() -> Problem) {
        match std::mem::replace(&mut self.lane, Lane::Free) {
            Lane::Settling { request, .. } => request.refuse(problem()),
            other => self.lane = other,
        }
    }

    fn start_next(&mut self, equipment: &Arc<Equipment>) {
        while matches!(self.lane, Lane::Free)
            && let Some(next) = self.next.take()
        {
            match next {
                Next::Drive(request) => self.take_turn(equipment, request),
                Next::Overtake { id, reply } => {
                    self.state.raise_newest(id);
                    let older =
                        self.state.current.as_ref().map(|current| current.active.id).filter(|older| *older < id);
                    if let Some(older) = older {
                        self.release(equipment, older, Instant::now());
                    }
                    let _ = reply.send(());
                }
            }
        }
    }

    /// Has a touch wait for as long as that makes its drives much stronger on top of what is left of the touches before, which end then;
    /// or drives it.
    fn take_turn(&mut self, equipment: &Arc<Equipment>, request: Box<Request>) {
        if request.order.since.stops != equipment.session.stop_count() {
            return request.refuse(SessionError::Stopped);
        }
        let (id, now, first) = (request.order.id, Instant::now(), &request.order.first);
        let board = equipment.read_board();
        let find_room = || Ok(self.state.find_room(&first.motion, first.even_drives(), board, now));
        let Room { after_s, part, goes_on } = match compute(find_room) {
            Ok(room) => room,
            Err(problem) => return request.refuse(problem),
        };
        if after_s <= 0.0 {
            return self.drive_touch(equipment, request, None);
        }
        if !goes_on {
            if let Some(driven) = self.state.find_driven() {
                self.release(equipment, driven, now);
            }
            self.state.end_residual(now);
        }
        tracing::info!(plan = id, wait_ms = after_s * 1e3, part, "waits for what is left of the touches before");
        // Whatever becomes of it, those before have made way.
        self.state.raise_newest(id);
        self.lane = Lane::Settling { request, since: now, until: now + Duration::from_secs_f64(after_s) };
    }

    /// Has the board drive a touch that has waited `since` then, with as much of its forces as there is room for.
    fn drive_touch(&mut self, equipment: &Arc<Equipment>, request: Box<Request>, since: Option<Instant>) {
        let (board, now) = (equipment.read_board(), Instant::now());
        let Order { id, thin, manner, ref whole, ref first, .. } = request.order;
        match self.fit(equipment, (id, first.clone()), whole, thin, manner, (board, now)) {
            Err(problem) => request.refuse(problem),
            Ok((part, drivable)) => {
                equipment.place_sensor(id, &drivable.plan);
                // Until it goes to the board: what that takes to answer is no wait.
                let waited = since.map(|since| since.elapsed());
                let asked = request.order.since;
                let purpose = Purpose::Touch { request, waited };
                self.send(equipment, (id, asked), Sent { purpose, drivable, part, board, since: now, newest: 0 });
            }
        }
    }

    /// As much of `first`, the fraction `thin` of a `whole` plan, as there is room for on top of what is left of the touches before,
    /// and the fraction of its forces that this is.
    pub(super) fn fit(
        &self,
        equipment: &Equipment,
        (id, first): (u64, Drivable),
        whole: &Plan,
        thin: f64,
        manner: DriveMode,
        (board, now): (Board, Instant),
    ) -> Result<(f64, Drivable), Problem> {
        let weaker = |part: f64| {
            tracing::info!(plan = id, part, "weaker, for what is left of the touches before");
            equipment.prepare_fraction(whole, thin, part, manner)
        };
        let room = |drivable: &Drivable| self.state.find_fraction(&drivable.motion, drivable.even_drives(), board, now);
        compute(|| fitted(first, weaker, room))
    }

    /// Tells the board.
    pub(super) fn send(&mut self, equipment: &Arc<Equipment>, (id, asked): (u64, AskedAt), sent: Sent) {
        let newest = self.state.raise_newest(id);
        let is_soft = sent.board == Board::Down;
        let answer = Arc::clone(equipment).begin_drive(id, asked, sent.drivable.clone(), is_soft);
        self.lane = Lane::Ordered { sent: Box::new(Sent { newest, ..sent }), answer: Box::pin(answer) };
    }

    fn take_answer(&mut self, equipment: &Arc<Equipment>, answer: Result<Begun, NotBegun>) {
        let Lane::Ordered { sent, .. } = std::mem::replace(&mut self.lane, Lane::Free) else { return };
        let Sent { purpose, drivable, part, board, since, newest } = *sent;
        let id = match &purpose {
            Purpose::Touch { request, .. } => request.order.id,
            Purpose::Again { held, .. } => held.active.id,
        };
        let begin = |state: &mut DriveState, until: Instant| {
            state.begin(id, &drivable.motion, drivable.even_drives(), board, [since, until])
        };
        let begun = match answer {
            Ok(Begun { achieved, until }) => Ok((achieved, until, begin(&mut self.state, until))),
            Err(NotBegun { error, may_drive }) => {
                if may_drive {
                    begin(&mut self.state, Instant::now());
                } else {
                    self.state.restore_newest(newest);
                }
                Err(Problem::from(error))
            }
        };
        match (purpose, begun) {
            (Purpose::Touch { request, .. }, Err(problem)) => {
                if let Some(current) =
                    self.state.current.as_ref().filter(|it| is_current(it, equipment, Instant::now()))
                {
                    // What was driven before goes on, and so does its measurement.
                    equipment.place_sensor(current.active.id, current.active.plan.plan());
                }
                request.refuse(problem);
            }
            (Purpose::Touch { request, waited }, Ok((achieved, until, begun))) => {
                let achieved = achieved.delayed(waited);
                let Request { order, reply } = *request;
                let touched = self.show_touch(equipment, order, drivable, part, (begun, until), achieved);
                // Before its sender hears of it.
                self.publish_state();
                let _ = reply.send(touched);
            }
            (Purpose::Again { held, has_rested }, begun) => {
                let begun = begun.map(|(_, _, begun)| begun);
                self.go_on(equipment, *held, drivable.plan, part, begun, has_rested);
            }
        }
    }

    /// Shows what has begun for a touch, unless everything was stopped meanwhile.
    fn show_touch(
        &mut self,
        equipment: &Equipment,
        order: Order,
        drivable: Drivable,
        part: f64,
        (begun, until): (u64, Instant),
        device: Achieved,
    ) -> Result<Touched, Problem> {
        let Order { id, since, touches, manner, whole, thin, .. } = order;
        let stops = since.stops;
        if equipment.session.stop_count() != stops {
            // The stop came after the board's answer: what was entered since then is not driven.
            self.state.end_plan(id, Instant::now());
            return Err(SessionError::Stopped.into());
        }
        let Drivable { plan, mode, .. } = drivable;
        let active = match mode {
            Mode::Hold(_) => show_even(equipment, id, plan, touches, Thinned::by_credit(thin)),
            // What is told is what the effect does, and not the even motion that it was designed from.
            Mode::Effect(design) => {
                let plan = compute(|| Ok(PlanView::played(plan, &design)));
                plan.map(|plan| Arc::new(Active::new(id, plan, touches, device.effect().cloned())))
            }
        };
        // What cannot be shown is not driven on.
        let active = active.inspect_err(|_| self.release(equipment, id, Instant::now()))?;
        self.state.current = Some(Current { active: Arc::clone(&active), until, stops });
        self.tell_pages(Update::Plan(Arc::clone(&active)));
        self.looked = Instant::now();
        self.state.sustained = matches!(manner, DriveMode::Hold(_)).then(|| {
            let breaks = since.breaks.or_else(|| Some(equipment.count_breaks()));
            let since = AskedAt { stops, breaks };
            Sustained { begun, since, whole, thin, part, active: Arc::clone(&active) }
        });
        Ok(Touched { active, device, stretches: None, trade: None })
    }

    /// Ends the drive of touch `id` at `when`.
    pub(super) fn release(&mut self, equipment: &Equipment, id: u64, when: Instant) {
        equipment.session.end_drive_at(id, when);
        if self.state.end_plan(id, when) {
            self.tell_pages(Update::Ends);
        }
    }

    /// Has the drive of touch `id` go on until `until`; whether it is still what is shown.
    pub(super) fn renew(&mut self, equipment: &Equipment, id: u64, until: Instant) -> bool {
        let (board, now) = (equipment.read_board(), Instant::now());
        let Some(current) = self.state.current.as_mut() else { return false };
        if current.active.id != id || !is_current(current, equipment, now) {
            return false;
        }
        if board == Board::Driving || current.active.plan.rests() {
            current.until = until.max(current.until);
            let until = current.until;
            equipment.session.extend_drive_until(id, until);
            self.state.prolong_plan(id, now, until);
        }
        true
    }

    /// Publishes first what is told: whoever is told of it may ask for it.
    pub(super) fn tell_pages(&self, update: Update) {
        self.publish_state();
        // Nobody listening is no error.
        let _ = self.updates.send(update);
    }

    fn publish_state(&self) {
        self.publish.send_replace(Published { newest: self.find_newest(), current: self.state.current.clone() });
    }
}

/// An evenly driven plan as it is shown.
pub(super) fn show_even(
    equipment: &Equipment,
    id: u64,
    plan: Plan,
    touches: Vec<Finger>,
    thinned: Option<Thinned>,
) -> Result<Arc<Active>, Problem> {
    compute(|| {
        let plan = PlanView::new(&equipment.table, plan).thinned(thinned);
        Ok(Arc::new(Active::new(id, plan, touches, None)))
    })
}

/// Works something out. A mistake there takes the one touch with it, and not the task.
pub(super) fn compute<T>(work: impl FnOnce() -> Result<T, Problem>) -> Result<T, Problem> {
    tokio::task::block_in_place(|| catch_unwind(AssertUnwindSafe(work))).unwrap_or_else(|_| {
        Err(Problem::new(Kind::Internal, "working out the drives failed; the daemon's log says why"))
    })
}

//! How others talk to the task that owns what is driven ([`super::task`]).

use super::active::{Current, Touched, Update};
use super::command::{Command, Published, Request, is_current, say_superseded};
use super::equipment::Equipment;
use super::order::Order;
use super::task::Task;
use crate::daemon::api::problem::Problem;
use crate::device::SessionError;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// Events kept for a slow page before it misses some.
const EVENTS: usize = 16;

/// Sends commands to the task, and reads what it publishes.
#[derive(Debug)]
pub struct Controller {
    equipment: Arc<Equipment>,
    commands: mpsc::UnboundedSender<Command>,
    published: watch::Receiver<Published>,
    updates: broadcast::Sender<Update>,
    /// Until it is started: there may be no runtime before.
    task: Mutex<Option<Task>>,
}

impl Controller {
    /// A controller for a panel at rest. Its task ends when the controller is dropped.
    #[must_use]
    pub fn new(equipment: Arc<Equipment>) -> Self {
        let (commands, inbox) = mpsc::unbounded_channel();
        let (publish, published) = watch::channel(Published::default());
        let updates = broadcast::channel(EVENTS).0;
        let task = Mutex::new(Some(Task::new(&equipment, inbox, publish, updates.clone())));
        Self { equipment, commands, published, updates, task }
    }

    fn send(&self, command: Command) {
        if let Some(task) = self.task.lock().unwrap_or_else(PoisonError::into_inner).take() {
            tokio::spawn(task.run());
        }
        // The task ends with its runtime only, and then nothing is driven any more.
        let _ = self.commands.send(command);
    }

    /// Drives a touch, once there is room beside what is left of those before. It is driven whether or not anybody waits for the answer.
    ///
    /// # Errors
    /// [`Problem`]: there was a newer touch or a stop, or what the session says.
    pub async fn drive(&self, order: Order) -> Result<Touched, Problem> {
        let (reply, answer) = oneshot::channel();
        self.send(Command::Drive(Box::new(Request { order, reply })));
        answer.await.unwrap_or_else(|_| Err(SessionError::Closed.into()))
    }

    /// Ends what is driven for touches before `id`, which drives nothing yet.
    pub async fn overtake(&self, id: u64) {
        let (reply, done) = oneshot::channel();
        self.send(Command::Overtake { id, reply });
        let _ = done.await;
    }

    /// Ends the drive of touch `id` at `when`: its fingers have been lifted.
    pub fn release(&self, id: u64, when: Instant) {
        self.send(Command::Release { id, when });
    }

    /// Has the drive of touch `id` go on until `until`: its fingers are still down. Whether it is still what is shown; one that the board does
    /// not drive is given no more time.
    pub async fn renew(&self, id: u64, until: Instant) -> bool {
        let (reply, answer) = oneshot::channel();
        self.send(Command::Renew { id, until, reply });
        answer.await.unwrap_or(false)
    }

    /// Drops touch `id` if it waits for what is left of those before: nobody wants it any more.
    pub fn withdraw(&self, id: u64) {
        self.send(Command::Withdraw { id });
    }

    /// Says that everything has been stopped. The session has been told before.
    pub fn end_stopped(&self) {
        self.send(Command::Stopped { when: Instant::now() });
    }

    /// Refuses touch `id` if there is a newer one.
    ///
    /// # Errors
    /// [`Problem`]: there is.
    pub fn check_newest(&self, id: u64) -> Result<(), Problem> {
        if id < self.published.borrow().newest { Err(say_superseded()) } else { Ok(()) }
    }

    /// What is driven now.
    #[must_use]
    pub fn find_current(&self) -> Option<Current> {
        let current = self.published.borrow().current.clone();
        current.filter(|current| is_current(current, &self.equipment, Instant::now()))
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn subscribe(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
    }

    /// Tells pages that everything has been stopped.
    pub fn tell_stopped(&self) {
        // Nobody listening is no error.
        let _ = self.updates.send(Update::Stopped);
    }
}

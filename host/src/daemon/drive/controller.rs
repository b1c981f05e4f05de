//! How others talk to the task that owns what is driven ([`super::task`]).

use super::active::{CurrentPlan, Update};
use super::command::{
    DriveCommand, DriveRequest, NextRequest, PublishedDriveState, is_plan_neither_over_nor_stopped, superseded_problem,
};
use super::equipment::DriveEquipment;
use super::order::TouchOrder;
use super::task::DriveTask;
use crate::daemon::api::problem::Problem;
use crate::daemon::touch::answer::TouchedView;
use crate::device::SessionError;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;
use tokio::sync::{broadcast, mpsc, oneshot, watch};

/// Events kept for a slow page before it misses some.
const EVENTS: usize = 16;

/// Sends commands to the task, and reads what it publishes.
#[derive(Debug)]
pub struct DriveController {
    equipment: Arc<DriveEquipment>,
    commands: mpsc::UnboundedSender<DriveCommand>,
    published: watch::Receiver<PublishedDriveState>,
    updates: broadcast::Sender<Update>,
    /// Until it is started: there may be no runtime before.
    task: Mutex<Option<DriveTask>>,
}

impl DriveController {
    /// A controller for a panel at rest. Its task ends when the controller is dropped.
    #[must_use]
    pub fn new(equipment: Arc<DriveEquipment>) -> Self {
        let (commands, inbox) = mpsc::unbounded_channel();
        let (publish, published) = watch::channel(PublishedDriveState::default());
        let updates = broadcast::channel(EVENTS).0;
        let task = Mutex::new(Some(DriveTask::new(&equipment, inbox, publish, updates.clone())));
        Self { equipment, commands, published, updates, task }
    }

    fn send_command_to_task_starting_it_first_if_needed(&self, command: DriveCommand) {
        if let Some(task) = self.task.lock().unwrap_or_else(PoisonError::into_inner).take() {
            tokio::spawn(task.run_until_closed());
        }
        // The task ends with its runtime only, and then nothing is driven any more.
        let _ = self.commands.send(command);
    }

    /// Drives a touch, once there is room beside what is left of those before. It is driven whether or not anybody waits for the answer.
    ///
    /// # Errors
    /// [`Problem`]: there was a newer touch or a stop, or what the session says.
    pub async fn queue_touch_order_and_wait_until_begun(&self, order: TouchOrder) -> Result<TouchedView, Problem> {
        let (reply, answer) = oneshot::channel();
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Queue(NextRequest::Drive(Box::new(
            DriveRequest { order, reply },
        ))));
        answer.await.unwrap_or_else(|_| Err(SessionError::Closed.into()))
    }

    /// Ends what is driven for touches before `id`, which drives nothing yet.
    pub async fn end_drives_of_touches_before(&self, id: u64) {
        let (reply, done) = oneshot::channel();
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Queue(NextRequest::Overtake { id, reply }));
        let _ = done.await;
    }

    /// Ends the drive of touch `id` at `when`: its fingers have been lifted.
    pub fn end_touch_at(&self, id: u64, when: Instant) {
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Release { id, when });
    }

    /// Has the drive of touch `id` go on until `until`: its fingers are still down. Whether it is still what is shown; one that the board does
    /// not drive is given no more time.
    pub async fn extend_touch_and_check_if_still_active(&self, id: u64, until: Instant) -> bool {
        let (reply, answer) = oneshot::channel();
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Renew { id, until, reply });
        answer.await.unwrap_or(false)
    }

    /// Drops touch `id` if it waits for what is left of those before: nobody wants it any more.
    pub fn drop_waiting_touch(&self, id: u64) {
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Withdraw { id });
    }

    /// Says that everything has been stopped. The session has been told before.
    pub fn tell_task_all_stopped(&self) {
        self.send_command_to_task_starting_it_first_if_needed(DriveCommand::Stopped { when: Instant::now() });
    }

    /// Refuses touch `id` if there is a newer one.
    ///
    /// # Errors
    /// [`Problem`]: there is.
    pub fn check_not_superseded(&self, id: u64) -> Result<(), Problem> {
        if id < self.published.borrow().newest { Err(superseded_problem()) } else { Ok(()) }
    }

    /// What is driven now.
    #[must_use]
    pub fn find_current_plan(&self) -> Option<CurrentPlan> {
        let current = self.published.borrow().current.clone();
        current.filter(|current| is_plan_neither_over_nor_stopped(current, &self.equipment, Instant::now()))
    }

    /// Plans and stops as they happen.
    #[must_use]
    pub fn subscribe_updates(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
    }

    /// Tells pages that everything has been stopped.
    pub fn tell_pages_all_stopped(&self) {
        // Nobody listening is no error.
        let _ = self.updates.send(Update::Stopped);
    }
}

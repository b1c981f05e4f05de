//! Slots for what takes long: each client has one at a time, and one request that waits for the next; a newer one takes its place.

use crate::daemon::access::client::Client;
use crate::daemon::api::problem::{Problem, ProblemKind};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// When to come again where all places to wait are taken, in ms: one slot is free by then, most often.
const RETRY_MS: u64 = 1000;

/// So many slots, and those who wait for one.
#[derive(Debug)]
pub struct Slots {
    state: Mutex<State>,
    slots: usize,
    most_waiting: usize,
}

#[derive(Debug, Default)]
struct State {
    /// Whose slots are taken.
    taken: Vec<Client>,
    /// In the order of asking.
    waiting: VecDeque<Waiting>,
    last_ticket: u64,
}

#[derive(Debug)]
struct Waiting {
    client: Client,
    ticket: u64,
    slot: oneshot::Sender<Slot>,
}

/// A slot, for as long as it is held.
#[derive(Debug)]
pub struct Slot {
    of: Option<Arc<Slots>>,
    client: Client,
}

impl Slots {
    /// So many slots, for which so many clients may wait.
    #[must_use]
    pub fn new(slots: usize, most_waiting: usize) -> Arc<Self> {
        Arc::new(Self { state: Mutex::default(), slots, most_waiting })
    }

    /// A slot, when it is the client's turn. Whoever drops this waits no more.
    ///
    /// # Errors
    /// [`Problem`]: a newer request of this client came while it waited, or too many clients wait.
    pub async fn wait_for_slot_replacing_waiting_request_of_same_client(
        self: &Arc<Self>,
        client: Client,
    ) -> Result<Slot, Problem> {
        let (sender, slot) = oneshot::channel();
        let ticket = self.join_queue_in_place_of_own_older_and_return_ticket(client, sender)?;
        let _leaves = LeaveOnDrop { slots: self, ticket };
        self.give_free_slots_to_waiting_clients();
        slot.await.map_err(|_| {
            let detail = "a newer request of this client replaced this request, which was still waiting";
            Problem::new(ProblemKind::ComputationSuperseded, detail)
        })
    }

    /// Waits in the place of the client's older one, if there is one; its number.
    fn join_queue_in_place_of_own_older_and_return_ticket(
        &self,
        client: Client,
        slot: oneshot::Sender<Slot>,
    ) -> Result<u64, Problem> {
        let mut state = self.lock_state();
        state.last_ticket += 1;
        let waiting = Waiting { client, ticket: state.last_ticket, slot };
        let ticket = waiting.ticket;
        let depth = state.waiting.len();
        match state.waiting.iter_mut().find(|other| other.client == client) {
            Some(older) => *older = waiting,
            None if depth >= self.most_waiting => {
                let detail = format!(
                    "the queue for this kind of computation is full ({depth} clients wait): try again in {RETRY_MS} ms"
                );
                return Err(Problem::new(ProblemKind::QueueFull, detail).with_retry(RETRY_MS, Some(depth)));
            }
            None => state.waiting.push_back(waiting),
        }
        Ok(ticket)
    }

    /// Gives free slots to those who wait and have none.
    fn give_free_slots_to_waiting_clients(self: &Arc<Self>) {
        loop {
            let next = {
                let mut state = self.lock_state();
                if state.taken.len() >= self.slots {
                    return;
                }
                let has_none = |own: &Waiting| !state.taken.contains(&own.client);
                let Some(at) = state.waiting.iter().position(has_none) else { return };
                let Some(next) = state.waiting.remove(at) else { return };
                state.taken.push(next.client);
                next
            };
            let slot = Slot { of: Some(Arc::clone(self)), client: next.client };
            // Not under the lock. Who has gone at this moment does not take it, and the next one is asked.
            if let Err(mut back) = next.slot.send(slot) {
                back.of = None;
                self.mark_slot_of_client_as_free(next.client);
            }
        }
    }

    fn mark_slot_of_client_as_free(&self, client: Client) {
        let mut state = self.lock_state();
        if let Some(at) = state.taken.iter().position(|own| *own == client) {
            state.taken.swap_remove(at);
        }
    }

    fn lock_state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        if let Some(slots) = self.of.take() {
            slots.mark_slot_of_client_as_free(self.client);
            slots.give_free_slots_to_waiting_clients();
        }
    }
}

/// Takes whoever waits no more out of the line.
struct LeaveOnDrop<'a> {
    slots: &'a Slots,
    ticket: u64,
}

impl Drop for LeaveOnDrop<'_> {
    fn drop(&mut self) {
        let ticket = self.ticket;
        let gone: Vec<Waiting> = {
            let mut state = self.slots.lock_state();
            let at = state.waiting.iter().position(|own| own.ticket == ticket);
            at.and_then(|at| state.waiting.remove(at)).into_iter().collect()
        };
        drop(gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::Pin;
    use std::task::{Context, Poll, Waker};

    type Taking<'a> = Pin<Box<dyn Future<Output = Result<Slot, Problem>> + 'a>>;

    fn poll(taking: &mut Taking<'_>) -> Poll<Result<Slot, Problem>> {
        taking.as_mut().poll(&mut Context::from_waker(Waker::noop()))
    }

    fn taken(taking: &mut Taking<'_>) -> Slot {
        match poll(taking) {
            Poll::Ready(slot) => slot.unwrap(),
            Poll::Pending => panic!("it waits"),
        }
    }

    #[test]
    fn a_client_has_one_slot_whatever_is_free_and_its_newest_request_waits() {
        let slots = Slots::new(2, 2);
        let take = |client: usize| -> Taking<'_> {
            Box::pin(slots.wait_for_slot_replacing_waiting_request_of_same_client(Client::with_token_number(client)))
        };
        let first = taken(&mut take(1));
        let mut older = take(1);
        assert!(poll(&mut older).is_pending(), "though a slot is free");
        let mut newer = take(1);
        assert!(poll(&mut newer).is_pending());
        assert!(matches!(poll(&mut older), Poll::Ready(Err(problem)) if problem.is_kind("superseded")));
        // Others are in nobody's way.
        let other = taken(&mut take(2));
        let mut third = take(3);
        assert!(poll(&mut third).is_pending());
        let mut fourth = take(4);
        assert!(matches!(poll(&mut fourth), Poll::Ready(Err(problem)) if problem.is_kind("busy")));
        drop(first);
        let newer = taken(&mut newer);
        assert!(poll(&mut third).is_pending());
        drop(other);
        let third = taken(&mut third);
        drop((newer, third));
        assert!(slots.lock_state().taken.is_empty() && slots.lock_state().waiting.is_empty());
    }

    #[test]
    fn who_goes_takes_nothing_with_him() {
        let slots = Slots::new(1, 4);
        let take = |client: usize| -> Taking<'_> {
            Box::pin(slots.wait_for_slot_replacing_waiting_request_of_same_client(Client::with_token_number(client)))
        };
        let first = taken(&mut take(1));
        let (mut second, mut third) = (take(2), take(3));
        assert!(poll(&mut second).is_pending() && poll(&mut third).is_pending());
        // Gone while it waits, and gone with a slot that has been sent and not been looked at.
        drop(second);
        drop(first);
        drop(third);
        let last = taken(&mut take(4));
        drop(last);
        assert!(slots.lock_state().taken.is_empty());
    }
}

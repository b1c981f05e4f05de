//! Places at the planner, and those who wait for one.

use super::fair::{FairQueue, JoinedQueue};
use crate::daemon::access::client::Client;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// Some places, and a bounded number of those who wait.
#[derive(Debug)]
pub struct Places(Mutex<State>);

#[derive(Debug)]
struct State {
    /// None of them while somebody waits.
    free: usize,
    waiting: FairQueue<Client, oneshot::Sender<PlannerPlaceGuard>>,
}

/// A place, for as long as it is held; then it is the next one's.
#[derive(Debug)]
pub struct PlannerPlaceGuard(Option<Arc<Places>>);

/// As many wait as may.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueFull {
    /// How many.
    pub waiting: usize,
}

impl Places {
    /// So many places, and so many who may wait for them.
    #[must_use]
    pub fn new(places: usize, most_waiting: usize) -> Arc<Self> {
        Arc::new(Self(Mutex::new(State { free: places, waiting: FairQueue::new(most_waiting) })))
    }

    /// A place, when it is the client's turn. Whoever drops this waits no more.
    ///
    /// # Errors
    /// [`QueueFull`], at once or when a client that has less comes.
    pub async fn wait_for_place(self: &Arc<Self>, client: Client) -> Result<PlannerPlaceGuard, QueueFull> {
        let (sender, place) = oneshot::channel();
        let JoinedQueue { ticket, pushed_out } = {
            let mut state = self.lock_state();
            if state.free > 0 {
                state.free -= 1;
                return Ok(PlannerPlaceGuard(Some(Arc::clone(self))));
            }
            let waiting = state.waiting.count_waiting();
            state
                .waiting
                .join_queue_displacing_from_busiest_client(client, sender)
                .map_err(|_| QueueFull { waiting })?
        };
        // Who waits for it hears that it is gone.
        drop(pushed_out);
        let _waits = LeaveOnDrop { places: self, ticket };
        place.await.map_err(|_| QueueFull { waiting: self.count_waiting_requests() })
    }

    /// How many places nobody has.
    pub fn count_free_places(&self) -> usize {
        self.lock_state().free
    }

    /// How many wait.
    pub fn count_waiting_requests(&self) -> usize {
        self.lock_state().waiting.count_waiting()
    }

    /// Gives a place to whoever is next, to nobody if nobody waits.
    fn pass_on_or_free_released_place(self: &Arc<Self>) {
        loop {
            let next = {
                let mut state = self.lock_state();
                let next = state.waiting.take_item_of_next_client_in_turn();
                state.free += usize::from(next.is_none());
                next
            };
            let Some(next) = next else { return };
            // Not under the lock: what is sent to somebody who goes at that moment is dropped there, and comes here again.
            let Err(mut back) = next.send(PlannerPlaceGuard(Some(Arc::clone(self)))) else { return };
            // It is still in hand.
            back.0 = None;
        }
    }

    fn lock_state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for PlannerPlaceGuard {
    fn drop(&mut self) {
        if let Some(places) = self.0.take() {
            places.pass_on_or_free_released_place();
        }
    }
}

/// Takes whoever waits no more out of the queue.
struct LeaveOnDrop<'a> {
    places: &'a Places,
    ticket: u64,
}

impl Drop for LeaveOnDrop<'_> {
    fn drop(&mut self) {
        let gone = self.places.lock_state().waiting.remove_by_ticket(self.ticket);
        drop(gone);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::pin::Pin;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::task::{Context, Poll, Wake, Waker};

    const PLACES: usize = 2;
    const MOST: usize = 5;

    #[derive(Clone, Copy, Debug)]
    enum PlaceStep {
        Ask(usize),
        /// One that has been woken, as an executor does.
        Poll(usize),
        HangUp(usize),
        GiveBack(usize),
    }

    fn arbitrary_place_step() -> impl Strategy<Value = PlaceStep> {
        prop_oneof![
            3 => (0..3_usize).prop_map(PlaceStep::Ask),
            2 => any::<usize>().prop_map(PlaceStep::Poll),
            1 => any::<usize>().prop_map(PlaceStep::HangUp),
            2 => any::<usize>().prop_map(PlaceStep::GiveBack),
        ]
    }

    #[derive(Default)]
    struct Flag(AtomicBool);

    impl Wake for Flag {
        fn wake(self: Arc<Self>) {
            self.0.store(true, Ordering::SeqCst);
        }
    }

    struct Asking {
        future: Pin<Box<dyn Future<Output = Result<PlannerPlaceGuard, QueueFull>>>>,
        woken: Arc<Flag>,
    }

    impl Asking {
        fn new(places: &Arc<Places>, client: usize) -> Self {
            let (places, client) = (Arc::clone(places), Client::with_token_number(client));
            Self { future: Box::pin(async move { places.wait_for_place(client).await }), woken: Arc::default() }
        }

        fn poll(&mut self) -> Poll<Result<PlannerPlaceGuard, QueueFull>> {
            self.woken.0.store(false, Ordering::SeqCst);
            self.future.as_mut().poll(&mut Context::from_waker(&Waker::from(Arc::clone(&self.woken))))
        }

        fn is_woken(&self) -> bool {
            self.woken.0.load(Ordering::SeqCst)
        }
    }

    proptest! {
        /// Whoever waits gets a place or an answer, whatever others do, and never are there more places than there are.
        #[test]
        fn nobody_is_forgotten(steps in prop::collection::vec(arbitrary_place_step(), 0..80)) {
            let places = Places::new(PLACES, MOST);
            let (mut asking, mut held) = (Vec::<Asking>::new(), Vec::<PlannerPlaceGuard>::new());
            let ready = |asked: &mut Asking, held: &mut Vec<PlannerPlaceGuard>| match asked.poll() {
                Poll::Pending => false,
                Poll::Ready(answer) => {
                    held.extend(answer);
                    true
                }
            };
            for step in steps {
                match step {
                    PlaceStep::Ask(client) => {
                        let mut asked = Asking::new(&places, client);
                        if !ready(&mut asked, &mut held) {
                            asking.push(asked);
                        }
                    }
                    PlaceStep::Poll(which) => {
                        let woken: Vec<usize> = (0..asking.len()).filter(|i| asking[*i].is_woken()).collect();
                        if let Some(i) = woken.get(which % woken.len().max(1)).copied() {
                            prop_assert!(ready(&mut asking[i], &mut held));
                            drop(asking.remove(i));
                        }
                    }
                    PlaceStep::HangUp(which) if !asking.is_empty() => drop(asking.remove(which % asking.len())),
                    PlaceStep::GiveBack(which) if !held.is_empty() => drop(held.remove(which % held.len())),
                    PlaceStep::HangUp(_) | PlaceStep::GiveBack(_) => {}
                }
                prop_assert!(held.len() <= PLACES && places.count_waiting_requests() <= MOST);
                let asleep = asking.iter().filter(|asked| !asked.is_woken()).count();
                prop_assert_eq!(places.count_waiting_requests(), asleep, "who waits, and nobody else, is in the queue");
            }
            while !asking.is_empty() {
                held.clear();
                let woken = asking.iter().position(Asking::is_woken);
                prop_assert!(woken.is_some(), "{} wait for ever", asking.len());
                let mut asked = asking.remove(woken.unwrap());
                prop_assert!(ready(&mut asked, &mut held));
            }
            held.clear();
            let free = places.lock_state().free;
            prop_assert_eq!((free, places.count_waiting_requests()), (PLACES, 0));
        }
    }
}

//! Who is next: numbers at arrival, a bounded queue for the planner, and what became of each request.

mod fair;
mod places;

use super::outcome::RequestOutcome;
use crate::daemon::access::client::Client;
use crate::daemon::api::problem::{Problem, ProblemKind};
pub use places::PlannerPlaceGuard;
use places::{Places, QueueFull};
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Plans at once: one that takes long (what can be had instead, say) leaves the other place to touches.
const AT_ONCE: usize = 2;
/// Most that may wait: 64 plans of 1 ms in two places are 32 ms, after which a finger feels a touch as late.
const MOST_WAITING: usize = 64;
/// When to come again, in ms: half the queue is done by then.
const RETRY_MS: u64 = 20;
/// The same for requests to arm and to clear a fault, which people make: one is carried out at a time, so that a touch waits for one of
/// them at most in the session. Arming takes some 80 ms, so eight are done before somebody has taken his hand from the button.
const MOST_BY_HAND: usize = 8;
/// When to come again with one of these, in ms: one more is done by then.
const BY_HAND_RETRY_MS: u64 = 100;
/// Most that may wait for what can be had instead: one is worked out at a time, for up to some seconds.
const MOST_TRADES: usize = 4;
/// Requests whose outcome is kept.
const KEPT: usize = 256;
/// Longest name that a client may give to a request.
pub const MAX_NAME: usize = 64;

/// Requests in their order.
#[derive(Debug)]
pub struct Admission {
    last_id: AtomicU64,
    planner: Arc<Places>,
    by_hand: Arc<Places>,
    trades: Arc<Places>,
    refused: AtomicU64,
    known: Mutex<VecDeque<KnownRequest>>,
}

#[derive(Debug)]
struct KnownRequest {
    id: u64,
    /// Whose it is.
    client: Client,
    /// As that client calls it.
    name: Option<String>,
    arrived: Instant,
    outcome: Option<AnswerInMemory>,
}

#[derive(Debug)]
struct AnswerInMemory {
    at: Instant,
    result: Result<Value, Problem>,
}

impl Default for Admission {
    fn default() -> Self {
        Self {
            last_id: AtomicU64::new(0),
            planner: Places::new(AT_ONCE, MOST_WAITING),
            by_hand: Places::new(1, MOST_BY_HAND),
            trades: Places::new(1, MOST_TRADES),
            refused: AtomicU64::new(0),
            known: Mutex::new(VecDeque::with_capacity(KEPT)),
        }
    }
}

impl Admission {
    /// The number of a client's request that has just arrived: a later one is larger, whichever is planned first. Where as many are kept as may be, the
    /// oldest one of whoever has the most makes way.
    pub fn register_request(&self, client: Client, name: Option<String>) -> u64 {
        // Under the lock, so that the list is in the order of the numbers.
        let mut known = self.lock_known_requests();
        let id = self.allocate_request_number();
        if known.len() == KEPT {
            let mut counts: Vec<(Client, usize)> = Vec::new();
            for own in known.iter() {
                match counts.iter_mut().find(|(client, _)| client.shares_request_names_with(&own.client)) {
                    Some((_, count)) => *count += 1,
                    None => counts.push((own.client, 1)),
                }
            }
            let crowded = counts.into_iter().max_by_key(|(_, count)| *count);
            let oldest = crowded
                .and_then(|(client, _)| known.iter().position(|own| own.client.shares_request_names_with(&client)));
            oldest.and_then(|at| known.remove(at));
        }
        known.push_back(KnownRequest { id, client, name, arrived: Instant::now(), outcome: None });
        id
    }

    /// A number alone, for touches whose outcome their sender is told anyway: fingers that move would push all others out of
    /// what is kept.
    pub fn allocate_request_number(&self) -> u64 {
        self.last_id.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// A place at the planner: turns go round between clients, each one's own in the order of asking.
    ///
    /// # Errors
    /// [`Problem`] with status 429: too many wait, and this client has as many of them as any.
    pub async fn wait_for_planner_place_unless_queue_full(&self, client: Client) -> Result<PlannerPlaceGuard, Problem> {
        self.planner
            .wait_for_place(client)
            .await
            .map_err(|full| self.count_refusal_and_build_queue_full_problem(full, "wait for the planner", RETRY_MS))
    }

    /// A place for a request to arm or to clear a fault, with turns as at the planner.
    ///
    /// # Errors
    /// As [`Self::wait_for_planner_place_unless_queue_full`].
    pub async fn wait_for_place_to_arm_or_clear_fault_unless_queue_full(
        &self,
        client: Client,
    ) -> Result<PlannerPlaceGuard, Problem> {
        let wait = "wait to arm or to clear a fault";
        self.by_hand
            .wait_for_place(client)
            .await
            .map_err(|full| self.count_refusal_and_build_queue_full_problem(full, wait, BY_HAND_RETRY_MS))
    }

    /// A place for working out what can be had instead; `None` if too many wait.
    pub async fn wait_for_trade_off_place_or_none_if_queue_full(&self, client: Client) -> Option<PlannerPlaceGuard> {
        self.trades.wait_for_place(client).await.ok()
    }

    fn count_refusal_and_build_queue_full_problem(
        &self,
        QueueFull { waiting }: QueueFull,
        awaited: &str,
        retry_ms: u64,
    ) -> Problem {
        self.refused.fetch_add(1, Ordering::Relaxed);
        let detail = format!(
            "the queue is full: {waiting} requests already {awaited}. This request is refused because no other client has \
             more requests in the queue than this client; try again in {retry_ms} ms"
        );
        Problem::new(ProblemKind::QueueFull, detail).with_retry(retry_ms, Some(waiting))
    }

    /// Whether nobody plans.
    pub fn is_planner_idle(&self) -> bool {
        self.planner.count_free_places() == AT_ONCE
    }

    /// Keeps what became of a request.
    pub fn record_outcome(&self, id: u64, result: Result<Value, Problem>) {
        let mut known = self.lock_known_requests();
        if let Some(known) = known.iter_mut().find(|known| known.id == id) {
            known.outcome = Some(AnswerInMemory { at: Instant::now(), result });
        }
    }

    /// What is known of a request, by its number or by the client's own name for it, of the latest of that name. Nobody finds others' requests by
    /// their names.
    ///
    /// # Errors
    /// [`Problem`] if nothing is.
    pub fn find_outcome_by_request_number_or_own_name(
        &self,
        client: Client,
        key: &str,
    ) -> Result<RequestOutcome, Problem> {
        let known = self.lock_known_requests();
        // Of the ways to write a number its own only: `+3` and `03` are no names of the third.
        let id = key.parse().ok().filter(|id: &u64| id.to_string() == key);
        let is_it = |known: &&KnownRequest| {
            Some(known.id) == id
                || known.name.as_deref() == Some(key) && known.client.shares_request_names_with(&client)
        };
        let Some(known) = known.iter().rev().find(is_it) else {
            let detail = format!(
                "this client has no request {key:?}, or the daemon no longer keeps the outcome of this request: the \
                 daemon keeps at most {KEPT} requests \
                 of all clients together"
            );
            return Err(Problem::new(ProblemKind::NotFound, detail));
        };
        let ms = |until: Instant| until.saturating_duration_since(known.arrived).as_secs_f64() * 1e3;
        let mut told = RequestOutcome {
            id: known.id,
            name: known.name.clone(),
            state: "waiting",
            age_ms: ms(Instant::now()),
            took_ms: None,
            status: None,
            answer: None,
            acceleration_peak_g: None,
            problem: None,
        };
        if let Some(AnswerInMemory { at, result }) = &known.outcome {
            told.took_ms = Some(ms(*at));
            (told.state, told.status) = match result {
                Ok(_) => ("done", Some(200)),
                Err(problem) => ("failed", Some(problem.status().as_u16())),
            };
            told.answer = result.as_ref().ok().cloned();
            told.problem = result.as_ref().err().cloned();
        }
        Ok(told)
    }

    /// How many wait for the planner.
    pub fn count_waiting_for_planner(&self) -> usize {
        self.planner.count_waiting_requests()
    }

    /// How many were refused as too many waited.
    pub fn count_requests_refused_by_full_queue(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    fn lock_known_requests(&self) -> MutexGuard<'_, VecDeque<KnownRequest>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::pin::Pin;
    use std::task::{Context, Waker};

    fn is_ready<F: Future>(future: Pin<&mut F>) -> bool {
        future.poll(&mut Context::from_waker(Waker::noop())).is_ready()
    }

    #[tokio::test]
    async fn more_than_the_planner_can_do_soon_are_sent_away() {
        let admission = Admission::default();
        let place = || admission.wait_for_planner_place_unless_queue_full(Client::default());
        let first = [place().await.unwrap(), place().await.unwrap()];
        let mut waiting: Vec<_> = (0..MOST_WAITING).map(|_| Box::pin(place())).collect();
        for place in &mut waiting {
            assert!(!is_ready(place.as_mut()));
        }
        let refused = place().await.unwrap_err();
        let told = json!(refused);
        assert_eq!((refused.status().as_u16(), &told["depth"]), (429, &json!(MOST_WAITING)), "{told}");
        assert!(
            told["retry_after_ms"].as_u64() > Some(0) && admission.count_requests_refused_by_full_queue() == 1,
            "{told}"
        );
        // First come, first served; who gives up leaves the queue.
        drop(waiting.pop());
        drop(first);
        assert!(is_ready(waiting[0].as_mut()));
        assert!(!is_ready(waiting[5].as_mut()));
        // One has gone, two had their turn, and the first of these has given its place to the next already.
        assert_eq!(admission.count_waiting_for_planner(), MOST_WAITING - 4);
    }

    #[test]
    fn the_outcome_is_found_by_number_and_by_name() {
        let admission = Admission::default();
        let own = Client::default();
        let (a, b) = (admission.register_request(own, Some("tap".into())), admission.register_request(own, None));
        assert!(b > a);
        assert_eq!(admission.find_outcome_by_request_number_or_own_name(own, "tap").unwrap().state, "waiting");
        admission.record_outcome(a, Ok(json!({"plan_id": a})));
        admission.record_outcome(b, Err(Problem::bad_body("no".into())));
        for key in ["tap", &a.to_string()] {
            let told = json!(admission.find_outcome_by_request_number_or_own_name(own, key).unwrap());
            assert_eq!(
                (&told["id"], &told["answer"], &told["status"]),
                (&json!(a), &json!({"plan_id": a}), &json!(200))
            );
        }
        assert_eq!(
            json!(admission.find_outcome_by_request_number_or_own_name(own, &b.to_string()).unwrap())["problem"]["status"],
            400
        );
        for _ in 0..KEPT {
            admission.register_request(own, None);
        }
        assert_eq!(
            admission.find_outcome_by_request_number_or_own_name(own, "tap").unwrap_err().status().as_u16(),
            404
        );
    }

    #[test]
    fn a_name_is_its_clients_own_and_nobody_pushes_anothers_out() {
        let admission = Admission::default();
        let (one, other) = (Client::with_token_number(1), Client::with_token_number(2));
        let first = admission.register_request(one, Some("tap-1".into()));
        assert_eq!(
            admission.find_outcome_by_request_number_or_own_name(other, "tap-1").unwrap_err().status().as_u16(),
            404
        );
        let second = admission.register_request(other, Some("tap-1".into()));
        for _ in 0..2 * KEPT {
            admission.register_request(other, None);
        }
        assert_eq!(admission.find_outcome_by_request_number_or_own_name(one, "tap-1").unwrap().id, first);
        assert_eq!(
            admission.find_outcome_by_request_number_or_own_name(other, "tap-1").unwrap_err().status().as_u16(),
            404,
            "{second} has made way"
        );
    }
}

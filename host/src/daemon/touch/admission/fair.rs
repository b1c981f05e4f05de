//! Who is next where several ask for more than there is: turns go round between clients, each client's own in the order of
//! asking.

use std::collections::VecDeque;

/// Those who wait, by client. The first client is the next.
#[derive(Debug)]
pub struct FairQueue<K, T> {
    clients: VecDeque<ClientLine<K, T>>,
    waiting: usize,
    most: usize,
    last_ticket: u64,
}

/// What one client waits for, the oldest first; never empty.
#[derive(Debug)]
struct ClientLine<K, T> {
    client: K,
    items: VecDeque<(u64, T)>,
}

/// Somebody who has got a place to wait.
#[derive(Debug)]
pub struct JoinedQueue<T> {
    /// Names it for [`FairQueue::remove_by_ticket`].
    pub ticket: u64,
    /// Who had to go for it.
    pub pushed_out: Option<T>,
}

impl<K: Eq, T> FairQueue<K, T> {
    /// Nobody yet, and never more than `most`.
    #[must_use]
    pub const fn new(most: usize) -> Self {
        Self { clients: VecDeque::new(), waiting: 0, most, last_ticket: 0 }
    }

    /// How many wait.
    #[must_use]
    pub const fn count_waiting(&self) -> usize {
        self.waiting
    }

    /// Waits behind the client's own. Where all places are taken, the newest of the client that has the most goes for it, if
    /// that client still has as many as this one then: so a client that is alone may have all of the places, and whoever
    /// comes later finds one until its share is as large as any other's. A fixed share for each would leave places empty with
    /// one client, and be too much with many.
    ///
    /// # Errors
    /// The item, if its client has as many as any.
    pub fn join_queue_displacing_from_busiest_client(&mut self, client: K, item: T) -> Result<JoinedQueue<T>, T> {
        let mut pushed_out = None;
        if self.waiting >= self.most {
            let own = self.clients.iter().find(|line| line.client == client).map_or(0, |line| line.items.len());
            let longest = self.clients.iter().enumerate().max_by_key(|(_, line)| line.items.len());
            let Some(longest) = longest.filter(|(_, line)| line.items.len() > own + 1).map(|(at, _)| at) else {
                return Err(item);
            };
            // Of two or more, so that its line stays.
            pushed_out = self.clients.get_mut(longest).and_then(|line| line.items.pop_back()).map(|(_, item)| item);
            self.waiting -= 1;
        }
        self.last_ticket += 1;
        let ticket = self.last_ticket;
        match self.clients.iter_mut().find(|line| line.client == client) {
            Some(line) => line.items.push_back((ticket, item)),
            None => self.clients.push_back(ClientLine { client, items: VecDeque::from([(ticket, item)]) }),
        }
        self.waiting += 1;
        Ok(JoinedQueue { ticket, pushed_out })
    }

    /// Whose turn it is; its client is the last one after that.
    pub fn take_item_of_next_client_in_turn(&mut self) -> Option<T> {
        let mut line = self.clients.pop_front()?;
        let (_, item) = line.items.pop_front()?;
        if !line.items.is_empty() {
            self.clients.push_back(line);
        }
        self.waiting -= 1;
        Some(item)
    }

    /// Waits no more; `None` if its turn has come, or it had to go, before.
    pub fn remove_by_ticket(&mut self, ticket: u64) -> Option<T> {
        let of = |line: &ClientLine<K, T>| line.items.iter().position(|(known, _)| *known == ticket);
        let (client, place) = self.clients.iter().enumerate().find_map(|(at, line)| Some((at, of(line)?)))?;
        let line = self.clients.get_mut(client)?;
        let (_, item) = line.items.remove(place)?;
        if line.items.is_empty() {
            self.clients.remove(client);
        }
        self.waiting -= 1;
        Some(item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    #[test]
    fn one_request_waits_for_one_turn_of_each_other_client() {
        let mut fair = FairQueue::new(64);
        for n in 0..40 {
            fair.join_queue_displacing_from_busiest_client("many", n).unwrap();
        }
        fair.join_queue_displacing_from_busiest_client("few", 100).unwrap();
        fair.join_queue_displacing_from_busiest_client("one", 200).unwrap();
        fair.join_queue_displacing_from_busiest_client("few", 101).unwrap();
        let turns: Vec<i32> = std::iter::from_fn(|| fair.take_item_of_next_client_in_turn()).collect();
        assert_eq!(turns[..7], [0, 100, 200, 1, 101, 2, 3]);
        assert_eq!((turns.len(), fair.count_waiting()), (43, 0));
    }

    #[test]
    fn who_has_the_most_goes_first_where_all_is_taken() {
        let mut fair = FairQueue::new(6);
        for n in 0..6 {
            fair.join_queue_displacing_from_busiest_client('a', n).unwrap();
        }
        assert_eq!(
            fair.join_queue_displacing_from_busiest_client('a', 6).unwrap_err(),
            6,
            "alone it has them all, and no more"
        );
        let pushed: Vec<_> =
            (10..13).map(|n| fair.join_queue_displacing_from_busiest_client('b', n).unwrap().pushed_out).collect();
        assert_eq!(pushed, [Some(5), Some(4), Some(3)]);
        assert_eq!(fair.join_queue_displacing_from_busiest_client('b', 13).unwrap_err(), 13, "three each");
        assert!(fair.join_queue_displacing_from_busiest_client('c', 20).unwrap().pushed_out.is_some());
    }

    #[derive(Clone, Copy, Debug)]
    enum FairStep {
        Join(u8),
        Next,
        Leave(u8),
    }

    fn arbitrary_fair_step() -> impl Strategy<Value = FairStep> {
        prop_oneof![4 => (0..4_u8).prop_map(FairStep::Join), 2 => Just(FairStep::Next), 1 => any::<u8>().prop_map(FairStep::Leave)]
    }

    /// One list in the order of arrival, and when each client was served last or came: who has waited longest for that is next.
    #[derive(Default)]
    struct Model {
        waiting: Vec<(u8, u32)>,
        since: BTreeMap<u8, u64>,
        clock: u64,
    }

    impl Model {
        fn count(&self, client: u8) -> usize {
            self.waiting.iter().filter(|(other, _)| *other == client).count()
        }

        fn take(&mut self, at: usize) -> u32 {
            let (client, item) = self.waiting.remove(at);
            if self.count(client) == 0 {
                self.since.remove(&client);
            }
            item
        }

        fn join(&mut self, client: u8, item: u32, most: usize) -> Result<Option<u32>, ()> {
            let mut pushed = None;
            if self.waiting.len() == most {
                let largest = (0..=u8::MAX).map(|other| self.count(other)).max().unwrap();
                if largest <= self.count(client) + 1 {
                    return Err(());
                }
                // Of clients with as many the one that would have to wait longest.
                let worst = self.since.iter().filter(|(other, _)| self.count(**other) == largest);
                let worst = *worst.max_by_key(|(_, since)| **since).unwrap().0;
                let newest = self.waiting.iter().rposition(|(other, _)| *other == worst).unwrap();
                pushed = Some(self.take(newest));
            }
            self.clock += 1;
            self.since.entry(client).or_insert(self.clock);
            self.waiting.push((client, item));
            Ok(pushed)
        }

        fn next(&mut self) -> Option<u32> {
            let client = *self.since.iter().min_by_key(|(_, since)| **since)?.0;
            let oldest = self.waiting.iter().position(|(other, _)| *other == client)?;
            let item = self.take(oldest);
            self.clock += 1;
            self.since.entry(client).and_modify(|since| *since = self.clock);
            Some(item)
        }
    }

    proptest! {
        #[test]
        fn it_does_as_the_model(steps in prop::collection::vec(arbitrary_fair_step(), 0..120), most in 1..9_usize) {
            let (mut fair, mut model) = (FairQueue::new(most), Model::default());
            let mut tickets = Vec::new();
            for (item, step) in (0..).zip(steps) {
                match step {
                    FairStep::Join(client) => {
                        let wanted = model.join(client, item, most);
                        match fair.join_queue_displacing_from_busiest_client(client, item) {
                            Ok(JoinedQueue { ticket, pushed_out }) => {
                                prop_assert_eq!(wanted, Ok(pushed_out));
                                tickets.push((ticket, item));
                            }
                            Err(refused) => prop_assert_eq!((wanted, refused), (Err(()), item)),
                        }
                    }
                    FairStep::Next => prop_assert_eq!(fair.take_item_of_next_client_in_turn(), model.next()),
                    FairStep::Leave(which) => {
                        let Some((ticket, item)) = tickets.get(usize::from(which) % tickets.len().max(1)).copied() else {
                            continue;
                        };
                        let at = model.waiting.iter().position(|(_, known)| *known == item);
                        prop_assert_eq!(fair.remove_by_ticket(ticket), at.map(|at| model.take(at)));
                    }
                }
                prop_assert_eq!(fair.count_waiting(), model.waiting.len());
            }
        }
    }
}

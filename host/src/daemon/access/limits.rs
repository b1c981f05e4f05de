//! How long, and how many at once.

use std::time::Duration;

/// What connections may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once at each place to listen, of those places apart. A page takes one or two, each task some 20 kB.
    pub connections: usize,
    /// Connections beside them on which only `POST /v1/stop` is taken, so that nobody can keep a stop out by opening many. The oldest
    /// that has said nothing makes way for one more.
    pub stop_connections: usize,
    /// The handshake and the headers of these, instead of the times below: whoever comes for a stop says so at once, and nobody keeps
    /// the place from others for longer. One segment may be lost.
    pub stop_headers: Duration,
    /// For a TLS handshake: two round trips and some ms of arithmetic, with three segments lost (1 + 2 + 4 s until they are sent again).
    pub handshake: Duration,
    /// From a connection's start, or the end of its last answer, to the last byte of the next request's headers. So it is also how
    /// long a connection is kept for the next request: clients keep theirs for 15 s (`ureq`) to minutes (browsers, which open another).
    pub headers: Duration,
    /// From a request's headers to the last byte of its body: the longest body takes 1.2 s at 1 Mbit/s, and one segment that is lost
    /// twice 3 s more.
    pub body: Duration,
    /// For which nothing of an answer is taken. As a body's: the longest answer, a map or the page's script, has some 100 kB, of which the system
    /// keeps the most.
    pub answer: Duration,
    /// Between two signs of life that a page is asked for: three in the time below, of which two may be lost.
    pub ping: Duration,
    /// A page of which nothing was heard for so long has lifted its fingers. A touch ends after 10 s by itself; browsers slow the scripts of hidden
    /// pages down, but answer pings.
    pub silence: Duration,
    /// For which a page may take nothing. It has the newest state at once when it reads again.
    pub page: Duration,
    /// For answers that are on their way when the daemon ends; the device is off by then.
    pub goodbye: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 256,
            stop_connections: 32,
            stop_headers: Duration::from_secs(2),
            handshake: Duration::from_secs(10),
            headers: Duration::from_secs(30),
            body: Duration::from_secs(5),
            answer: Duration::from_secs(5),
            ping: Duration::from_secs(5),
            silence: Duration::from_secs(15),
            page: Duration::from_secs(5),
            goodbye: Duration::from_secs(2),
        }
    }
}

//! Whoever takes too long, or does not take what it asked for, is let go. Limits of some 200 ms stand for the daemon's own; each
//! test waits much longer than that for the end, and has all other limits far off.

use crate::raw::post;
use crate::support::Daemon;
use crate::support::served::Served;
use era::daemon::listener::{TlsFiles, find_or_make_certificate};
use era::daemon::{Access, Limits};
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SHORT: Duration = Duration::from_millis(200);
const FAR: Duration = Duration::from_secs(3600);
/// How long an end is waited for.
const WAIT: Duration = Duration::from_secs(10);

/// No limit that a test would meet.
fn none() -> Limits {
    Limits {
        handshake: FAR,
        headers: FAR,
        stop_headers: FAR,
        body: FAR,
        answer: FAR,
        silence: FAR,
        page: FAR,
        ping: SHORT / 4,
        ..Limits::default()
    }
}

/// A daemon with these limits.
struct Limited {
    address: String,
    _served: Served,
}

impl Limited {
    fn start(limits: Limits, tls: Option<&TlsFiles>) -> Self {
        let mut app = Daemon::app(STARTING_PLATE, Access::default());
        app.limits = limits;
        let mut device = app.driver.subscribe_device_snapshots();
        let (served, url) = Served::at_a_port(&Arc::new(app), tls);
        served.runtime.block_on(async { device.wait_for(|snapshot| snapshot.connected).await.map(drop) }).unwrap();
        Self { address: url.rsplit('/').next().unwrap().to_owned(), _served: served }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(WAIT)).unwrap();
        stream.set_write_timeout(Some(WAIT)).unwrap();
        stream
    }

    /// What is answered to a request on a connection of its own; nothing if it is closed first. All of it where the request has the
    /// connection closed afterwards, else the beginning.
    fn answer(&self, request: &str) -> String {
        let mut stream = self.connect();
        let _ = stream.write_all(request.as_bytes());
        if request.contains("Connection: close") {
            return String::from_utf8_lossy(&until_closed(&mut stream)).into_owned();
        }
        let mut answer = [0; 4096];
        let length = stream.read(&mut answer).unwrap_or(0);
        String::from_utf8_lossy(&answer[..length]).into_owned()
    }
}

/// All that comes until the connection is closed; that it is not is a failure.
#[track_caller]
fn until_closed(stream: &mut TcpStream) -> Vec<u8> {
    let (mut all, mut buffer, begun) = (Vec::new(), vec![0; 1 << 16], Instant::now());
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return all,
            Ok(length) => all.extend(&buffer[..length]),
            Err(error) if error.kind() == ErrorKind::ConnectionReset => return all,
            Err(error) => panic!("still open: {error}"),
        }
        assert!(begun.elapsed() < WAIT, "still open, and {} bytes have come", all.len());
    }
}

fn is_over(deadline: Instant) -> bool {
    std::thread::sleep(Duration::from_millis(20));
    Instant::now() >= deadline
}

#[test]
fn half_a_header_and_nothing_at_all_are_let_go() {
    let daemon = Limited::start(Limits { headers: SHORT, ..none() }, None);
    for words in ["", "POST /v1/touch HTTP/1.1\r\nHost: loc"] {
        let mut stream = daemon.connect();
        stream.write_all(words.as_bytes()).unwrap();
        until_closed(&mut stream);
    }
    // A connection on which something was answered, too.
    let mut stream = daemon.connect();
    stream.write_all(post("/v1/stop", "").as_bytes()).unwrap();
    let answered = until_closed(&mut stream);
    assert!(answered.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answered));
}

#[test]
fn half_a_body_is_answered_and_let_go() {
    let daemon = Limited::start(Limits { body: SHORT, ..none() }, None);
    for path in ["/v1/touch", "/v1/preview"] {
        let mut stream = daemon.connect();
        write!(stream, "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{{").unwrap();
        let mut answer = [0; 1024];
        let length = stream.read(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer[..length]);
        assert!(answer.starts_with("HTTP/1.1 408") && answer.contains("slow-body"), "{answer}");
    }
}

#[test]
fn a_handshake_that_does_not_begin_is_let_go() {
    let folder = tempfile::tempdir().unwrap();
    let files = find_or_make_certificate(folder.path(), &[]).unwrap();
    let daemon = Limited::start(Limits { handshake: SHORT, ..none() }, Some(&files));
    // Nothing, and the beginning of a client's first record.
    for words in [&b""[..], &[22, 3, 1, 2, 0, 1]] {
        let mut stream = daemon.connect();
        stream.write_all(words).unwrap();
        until_closed(&mut stream);
    }
}

/// Answers that nobody takes: its place is free again, and not all of them have been written.
#[test]
fn whoever_takes_no_answers_is_let_go() {
    // 24 MB, of which the system keeps some 10 at most.
    const ASKED: usize = 400;
    let daemon = Limited::start(Limits { answer: SHORT, connections: 1, ..none() }, None);
    let request = "GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let mut stream = daemon.connect();
    stream.write_all(request.repeat(ASKED).as_bytes()).unwrap();
    let (last, deadline) =
        ("GET /v1/scene HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", Instant::now() + WAIT);
    while !daemon.answer(last).starts_with("HTTP/1.1 200") {
        assert!(!is_over(deadline), "its place is still taken");
    }
    let written = until_closed(&mut stream);
    let answers = written.windows(17).filter(|bytes| bytes == b"HTTP/1.1 200 OK\r\n").count();
    assert!(answers > 0 && answers < ASKED, "{answers} answers in {} bytes", written.len());
}

/// A socket that was taken, and whose stream is then used by hand: nothing is answered that the test does not answer.
fn live(daemon: &Limited, send: &str) -> TcpStream {
    let url = format!("ws://{}/v1/live?send={send}", daemon.address);
    let (socket, _) = tungstenite::client(url, daemon.connect()).unwrap();
    let stream = socket.get_ref().try_clone().unwrap();
    // Not closed, as `into_inner` of its stream would be.
    std::mem::forget(socket);
    stream
}

/// A frame from a page: text (1) or the answer to a ping (10), masked with zeros.
fn frame(kind: u8, text: &str) -> Vec<u8> {
    let length = u8::try_from(text.len()).unwrap();
    assert!(length < 126);
    [&[0x80 | kind, 0x80 | length, 0, 0, 0, 0], text.as_bytes()].concat()
}

/// As long after its last word as is said, wherever pings are: one that answers them is heard just after one.
#[test]
fn a_page_that_says_nothing_is_let_go() {
    for ping in [SHORT / 4, FAR] {
        is_let_go_with_its_finger(Limits { silence: SHORT, ping, ..none() });
    }
}

fn is_let_go_with_its_finger(limits: Limits) {
    let daemon = Limited::start(limits, None);
    let mut page = live(&daemon, "state");
    page.write_all(&frame(1, r#"{"type":"touch","touches":[{"x_px":400,"y_px":500}]}"#)).unwrap();
    // Its pings stay without an answer.
    until_closed(&mut page);
    // With it went its finger, which would be down for seconds.
    let deadline = Instant::now() + WAIT;
    let state = |daemon: &Limited| {
        let answer = daemon.answer("GET /v1/state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        let (_, body) = answer.split_once("\r\n\r\n").unwrap();
        serde_json::from_str::<Value>(body).unwrap()
    };
    while state(&daemon)["touches"] != json!([]) {
        assert!(!is_over(deadline), "its finger is still down");
    }
}

#[test]
fn a_page_that_takes_nothing_is_let_go() {
    let daemon = Limited::start(Limits { page: SHORT, ..none() }, None);
    let mut page = live(&daemon, "plan,field");
    let deadline = Instant::now() + 12 * WAIT;
    // It answers as if it read, and asks for plans, 16 kB each; the system keeps some MB of them.
    let mut x_px = 0;
    loop {
        x_px = (x_px + 7) % 1900;
        let touch =
            format!(r#"{{"type":"touch","touches":[{{"id":{x_px},"x_px":{x_px},"y_px":500,"intensity_g":0.1}}]}}"#);
        if page.write_all(&frame(10, "")).and_then(|()| page.write_all(&frame(1, &touch))).is_err() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
        assert!(Instant::now() < deadline, "it is still served");
    }
}

/// 256 for all, 32 for stops, of which each has said something, and the one after them is closed; when one of the 288 goes its place is free.
#[test]
fn more_connections_than_there_may_be_are_closed() {
    let daemon = Limited::start(none(), None);
    let (stop, busy) = (post("/v1/stop", ""), "HTTP/1.1 503");
    let mut crowd: Vec<_> = (0..256).map(|_| daemon.connect()).collect();
    for _ in 0..32 {
        // So it is there, and has a place for stops; and it is not kept.
        let mut stream = daemon.connect();
        stream.write_all(post("/v1/arm", "").as_bytes()).unwrap();
        let answer = String::from_utf8_lossy(&until_closed(&mut stream)).to_lowercase();
        assert!(answer.starts_with(&busy.to_lowercase()) && answer.contains("connection: close"), "{answer}");
    }
    for _ in 0..32 {
        let mut stream = daemon.connect();
        stream.write_all(stop.as_bytes()).unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"HTTP/1.1 200");
        crowd.push(stream);
    }
    for _ in 0..3 {
        assert_eq!(daemon.answer(&stop), "", "the 289th was served");
    }
    crowd.truncate(280);
    let deadline = Instant::now() + WAIT;
    while !daemon.answer(&stop).starts_with("HTTP/1.1 200") {
        assert!(!is_over(deadline), "no place became free");
    }
    // The places for everything are still taken.
    assert!(daemon.answer(&post("/v1/arm", "")).starts_with(busy));
}

/// Nobody keeps a stop out by opening connections and saying nothing: the oldest makes way.
#[test]
fn connections_that_say_nothing_keep_no_stop_out() {
    let daemon = Limited::start(none(), None);
    let mut crowd: Vec<_> = (0..288).map(|_| daemon.connect()).collect();
    for _ in 0..3 {
        let answer = daemon.answer(&post("/v1/stop", ""));
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
    // Those that have all paths stay.
    let stop = post("/v1/stop", "");
    crowd[0].write_all(stop.as_bytes()).unwrap();
    let mut answer = [0; 12];
    crowd[0].read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 200");
}

/// Who says half of something in a place for stops has little time for the rest.
#[test]
fn places_for_stops_are_not_held_for_long() {
    let daemon = Limited::start(Limits { stop_headers: SHORT, ..none() }, None);
    let crowd: Vec<_> = (0..256).map(|_| daemon.connect()).collect();
    let mut half = daemon.connect();
    half.write_all(b"POST /v1/st").unwrap();
    until_closed(&mut half);
    drop(crowd);
}

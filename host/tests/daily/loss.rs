//! A board that falls silent is told of before it is given up, and one that was only late is not given up.

use crate::line::{Ear, daemon, daemon_with, plate};
use era::device::Client;
use era::device::session::policy::SessionPolicy;
use era::device::sim::SimKnobs;
use era::device::timing::{LinkTiming, REAL_TIME, RetryPolicy};
use era_shared::link::{Decoder, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use era_shared::safety::SafetyState;
use serde_json::json;
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

const TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#;
const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;
/// One that is not given up while a test lasts.
const FOREVER: LinkTiming =
    LinkTiming { retry_policy: RetryPolicy { tries: 3000, ..REAL_TIME.retry_policy }, ..REAL_TIME };

fn silent(silent: bool) -> SimKnobs {
    SimKnobs { silent, ..SimKnobs::default() }
}

/// Idle and while it drives: the silence is told, touches are refused with the reason, and when the board answers again all
/// goes on over the same line.
#[test]
fn a_board_that_is_late_is_reported_and_not_given_up() {
    let (daemon, line) = daemon(FOREVER);
    for (before, doubts) in [(None, 1), (Some(LONG_TOUCH), 2)] {
        if let Some(touch) = before {
            assert_eq!(daemon.post("/v1/touch", touch).0, 200);
            daemon.wait_for(|state| state["device"]["state"] == "running");
        }
        line.sim().set_knobs(silent(true));
        let state = daemon.wait_for(|state| state["device"]["in_doubt"] == true);
        let device = &state["device"];
        let told = (&device["connected"], &device["outages"], device["doubts"].as_u64().unwrap() >= doubts);
        assert_eq!(told, (&json!(false), &json!(0), true), "{device}");
        // What was seen of it before is not told as if it were so now.
        for gone in [&device["state"], &device["supply"], &state["telemetry"]] {
            assert!(gone.is_null(), "{state}");
        }
        assert!(device["problem"].as_str().unwrap().contains("the board has not answered a request for"), "{device}");
        let (status, _, problem) = daemon.post("/v1/touch", TOUCH);
        assert_eq!((status, &problem["type"]), (503, &json!("urn:era:problem:device-late")), "{problem}");
        assert!(
            problem["retry_after_ms"].is_u64()
                && problem["detail"].as_str().unwrap().contains("the board has not answered a request for")
        );
        assert_eq!(daemon.post("/v1/arm", "").0, 503);
        assert!(daemon.get_text("/metrics").contains("era_device_connected 0"));
        // Where it drove it goes off by itself.
        line.goes_off();
        line.sim().set_knobs(silent(false));
        let state = daemon.wait_for(|state| state["device"]["connected"] == true);
        let device = &state["device"];
        assert_eq!(
            (&device["in_doubt"], &device["problem"], &device["outages"]),
            (&json!(false), &json!(null), &json!(0))
        );
        assert!(
            device["state"].is_string() && device["supply"].is_object() && state["telemetry"].is_object(),
            "{state}"
        );
    }
    assert_eq!(line.ear().opened, 1, "the line was opened anew");
    daemon.wait_for(|state| state["device"]["fault"]["name"] == "host-silent");
}

/// One that stays silent is an outage, once, and is looked for.
#[test]
fn a_board_that_stays_silent_is_given_up() {
    let (daemon, line) = daemon(REAL_TIME);
    line.sim().set_knobs(silent(true));
    let state = daemon.wait_for(|state| state["device"]["outages"] == 1);
    assert_eq!(state["device"]["in_doubt"], false, "{state}");
    let (status, _, problem) = daemon.post("/v1/touch", TOUCH);
    assert_eq!((status, &problem["type"]), (502, &json!("urn:era:problem:device-lost")), "{problem}");
    line.sim().set_knobs(silent(false));
    let state = daemon.wait_for(|state| state["device"]["connected"] == true);
    assert_eq!(state["device"]["outages"], 1, "{state}");
    assert!(line.ear().opened > 1);
}

/// A board that answers the first try when the third has been sent.
#[derive(Default)]
struct Late {
    asked: Vec<u16>,
    decoder: Option<Decoder>,
    answers: VecDeque<u8>,
}

impl Write for Late {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let asked = &mut self.asked;
        self.decoder
            .get_or_insert_with(Decoder::new)
            .feed_bytes(bytes, |frame| asked.extend(frame.map(|it| it.sequence)));
        if let [first, _, _] = self.asked[..] {
            self.asked.clear();
            let mut frame = [0; MAX_ENCODED];
            let reply = Reply::Alive { state: SafetyState::Safe };
            let length = encode_frame(CURRENT_VERSION, FrameKind::Reply, first, &reply, &mut frame).unwrap();
            self.answers.extend(&frame[..length]);
        }
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Read for Late {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        std::thread::sleep(Duration::from_millis(1));
        if self.answers.is_empty() { Err(ErrorKind::TimedOut.into()) } else { self.answers.read(buffer) }
    }
}

#[test]
fn a_late_answer_to_an_earlier_try_counts() {
    let mut client = Client::new(Box::new(Late::default()), Duration::from_millis(20));
    let reply = client.request(&Request::KeepAlive);
    assert!(matches!(reply, Ok(Reply::Alive { state: SafetyState::Safe })), "{reply:?}");
    assert_eq!(client.link_statistics().repeats, 2);
    // Its time is that of the try which it answers: two waits ago, of which the board's clock must know.
    let sent = client.last_answered_frame_written_at().unwrap();
    let took = client.last_reply_read_at().unwrap() - sent;
    assert!(took >= Duration::from_millis(40), "{took:?}");
}

/// A mistake in the session's thread: everybody is told, nothing is driven any more, and the daemon ends as one that failed.
#[test]
fn a_session_that_breaks_is_reported_and_ends_the_daemon() {
    let (daemon, line) = daemon(REAL_TIME);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    line.set(|ear| ear.breaks = true);
    let state = daemon.wait_for(|state| state["device"]["connected"] == false);
    assert!(state["device"]["problem"].as_str().unwrap().contains("session with the device has ended"), "{state}");
    assert!(daemon.get_text("/metrics").contains("era_device_connected 0"));
    for (path, body) in [
        ("/v1/touch", TOUCH),
        ("/v1/touch", r#"{"x_px": 9, "y_px": 9, "effect": "click"}"#),
        ("/v1/arm", ""),
        ("/v1/stop", ""),
    ] {
        let (status, _, problem) = daemon.post(path, body);
        assert_eq!((status, &problem["type"]), (503, &json!("urn:era:problem:session-ended")), "{path}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains("switched its high voltage off"), "{problem}");
    }
    line.goes_off();
}

#[test]
fn a_daemon_without_its_session_ends_and_is_not_told_to_be_well() {
    let (app, line) = plate(REAL_TIME);
    let app = Arc::new(app);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let device = app.driver.subscribe_device_snapshots();
    runtime.block_on(async {
        let listener = era::daemon::Listener::bind_tcp("127.0.0.1:0".parse().unwrap(), None, false).await.unwrap();
        let serving = tokio::spawn(era::daemon::serve_until_shutdown_or_session_end(
            Arc::clone(&app),
            vec![listener],
            std::future::pending::<()>(),
        ));
        device.clone().wait_for(|snapshot| snapshot.connected).await.unwrap();
        assert!(app.driver.is_session_thread_working(), "of which the service manager is told");
        line.set(|ear| ear.breaks = true);
        let ended = tokio::time::timeout(Duration::from_secs(30), serving).await;
        assert_eq!(ended.expect("it still serves").unwrap(), era::daemon::EndReason::Session);
    });
    assert!(!app.driver.is_session_thread_working());
}

/// The line is dead one way: what the host asks arrives, and would keep the board alive. It is told to stop instead, while the host still
/// waits and before it gives the board up: the first three tries wait for 175 ms, of which 150 are over when the stop is due.
#[test]
fn a_board_that_receives_but_is_not_received_is_stopped() {
    let (daemon, line) = daemon(FOREVER);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let since = line.mark(|ear| ear.is_deaf = true);
    line.is_stopped_within(since, 3);
    line.goes_off();
    line.set(|ear| ear.is_deaf = false);
    let state = daemon.wait_for(|state| state["device"]["connected"] == true);
    // Told in time, so that there is no silence to latch.
    assert_eq!((&state["device"]["fault"], &state["device"]["outages"]), (&json!(null), &json!(0)), "{state}");
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
}

/// A touch with a stretch that is due after this.
const LATER: &str = r#"{"x_px": 300, "y_px": 900, "from_ms": 0, "to_ms": 1000, "also": [{"x_px": 1500, "y_px": 900, "from_ms": 3000, "to_ms": 4000}]}"#;
/// The same for a part of an effect file.
const LATER_PART: &str = r#"{"x_px": 300, "y_px": 900, "effect": {"version": 1, "events": [{"primitive": "tick"}, {"primitive": "click", "pause_ms": 3000}]}}"#;
/// When its end is due as well.
const LATER_OVER: Duration = Duration::from_millis(4200);

/// The daemon does not run for a while, so that the board goes off and latches the silence. Whoever clears that makes it ready for
/// what is asked for then, and not for what is left of a touch of before, also where silences are cleared by policy.
#[test]
fn what_is_left_of_a_touch_is_not_driven_after_a_fault() {
    let both =
        |clears_silence: bool| [("/v1/touch", LATER), ("/v1/effects", LATER_PART)].map(|asked| (clears_silence, asked));
    for (clears_silence, (path, body)) in [false, true].into_iter().flat_map(both) {
        let policy = SessionPolicy { clears_silence, arms_after_outage: true, ..SessionPolicy::default() };
        let (daemon, line) = daemon_with(FOREVER, policy);
        let begun = Instant::now();
        let (status, _, told) = daemon.post(path, body);
        assert_eq!(status, 200, "{told}");
        let since = line.mark(|ear| ear.is_held = true);
        line.goes_off();
        line.set(|ear| ear.is_held = false);
        daemon.wait_for(|state| state["device"]["fault"]["name"] == "host-silent");
        if !clears_silence {
            assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
        }
        std::thread::sleep((begun + LATER_OVER).saturating_duration_since(Instant::now()));
        let drives = |request: &&Request| {
            use Request::{Arm, ArmWith, Play, PlayOnce, PlayWindows, Prepare};
            matches!(
                request,
                Arm { .. } | ArmWith { .. } | Play { .. } | PlayOnce { .. } | PlayWindows(_) | Prepare { .. }
            ) || matches!(request, Request::SetDrives { drives } if !drives.is_empty())
        };
        assert_eq!(line.ear().asked[since..].iter().find(drives), None, "{path}, {clears_silence}");
        // What is asked for from here on is driven.
        let (status, _, told) = daemon.post("/v1/touch", TOUCH);
        assert_eq!(status, 200, "{told}");
    }
}

/// Nothing has come between: the board has rested by order meanwhile, and is armed for it.
#[test]
fn what_is_left_of_a_touch_is_driven_after_a_pause() {
    let policy = SessionPolicy { idle: Duration::from_millis(500), ..SessionPolicy::default() };
    let (daemon, line) = daemon_with(FOREVER, policy);
    assert_eq!(daemon.post("/v1/touch", LATER).0, 200);
    let arms = |ear: &Ear| ear.asked.iter().filter(|request| matches!(request, Request::ArmWith { .. })).count();
    drop(line.wait_for(|ear| arms(ear) == 2));
    daemon.wait_for(|state| state["device"]["state"] == "running");
}

/// The session's thread neither ends nor does anything: in a driver, say. Whoever asks is answered, everybody is told, and the daemon ends when
/// it is asked to.
#[test]
fn a_session_that_hangs_is_reported_and_does_not_keep_the_daemon() {
    let (mut daemon, line) = daemon(REAL_TIME);
    line.set(|ear| ear.is_held = true);
    drop(line.wait_for(|ear| ear.waiting > 0));
    std::thread::scope(|threads| {
        for (path, body) in [("/v1/touch", TOUCH), ("/v1/stop", ""), ("/v1/arm", ""), ("/v1/faults/clear", "")] {
            let daemon = &daemon;
            threads.spawn(move || {
                let (status, _, problem) = daemon.post(path, body);
                let told = (status, problem["type"].as_str().unwrap());
                // The stop beside it may come first, and is as good a reason.
                let is_stopped = path != "/v1/stop" && told == (409, "urn:era:problem:stopped");
                assert!(is_stopped || told == (504, "urn:era:problem:session-hangs"), "{path}: {status} {problem}");
            });
        }
    });
    let state = daemon.state();
    assert_eq!((&state["device"]["connected"], &state["device"]["state"]), (&json!(false), &json!(null)), "{state}");
    assert!(state["device"]["problem"].as_str().unwrap().contains("hangs"), "{state}");
    assert!(daemon.get_text("/metrics").contains("era_device_connected 0"));
    // Ends while the thread is still held: the line lets it go only when it is dropped itself.
    drop(daemon.background.take());
    assert!(line.ear().waiting > 0);
}

/// The board has gone off by its dead-man timer, and was away: what is told is what it takes, all of it, in its order.
#[test]
fn a_line_that_is_lost_while_driving_takes_two_steps_which_are_reported() {
    let (daemon, line) = daemon(REAL_TIME);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    // Deaf both ways.
    line.sim().set_knobs(silent(true));
    daemon.wait_for(|state| state["device"]["outages"] == 1);
    line.sim().set_knobs(silent(false));
    daemon.wait_for(|state| state["device"]["connected"] == true);
    let fault = daemon.state()["device"]["fault"]["name"].clone();
    let (status, _, problem) = daemon.post("/v1/touch", TOUCH);
    assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:not-armed")), "{problem}");
    let detail = problem["detail"].as_str().unwrap();
    assert_eq!(detail.contains("`era clear`"), fault.is_string(), "{fault}: {problem}");
    assert!(fault == "host-silent" && detail.find("`era clear`") < detail.find("`era arm`"), "{problem}");
    assert_eq!(daemon.post("/v1/arm", "").0, 409);
    assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
}

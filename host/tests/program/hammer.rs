//! The daemon's locks under load: plan, state and the device's snapshot, by everybody at once.

use crate::support;
use era::daemon::{Access, App};
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};
use support::Daemon;
use support::served::Served;
use tungstenite::Message;

/// Nobody at all is answered for so long: the daemon hangs.
const STILL: Duration = Duration::from_secs(20);
/// What each client asks for.
const REQUESTS: usize = 60;

/// Whoever asks, and what for; `None` is a touch, on a page too.
const CLIENTS: [(&str, Option<&str>); 9] = [
    ("a touch", None),
    ("a touch on a page", None),
    ("a stop", Some("/v1/stop")),
    ("the state", Some("/v1/state")),
    ("the state again", Some("/v1/state")),
    ("the state once more", Some("/v1/state")),
    ("the field", Some("/v1/field")),
    ("the field of a place", Some("/v1/field?x_px=300&y_px=900")),
    ("the counters", Some("/metrics")),
];

fn touch(i: usize) -> serde_json::Value {
    json!({"x_px": 300 + 10 * i, "y_px": 600, "intensity_g": 0.1, "duration_ms": 2000})
}

fn ask(daemon: &str, (who, path): (&'static str, Option<&str>), answered: &Sender<&'static str>) {
    if who.ends_with("page") {
        return touch_on_a_page(daemon, who, answered);
    }
    let agent = Daemon::agent();
    for i in 0..REQUESTS {
        let url = format!("{daemon}{}", path.unwrap_or("/v1/touch"));
        let answer = match path {
            None => agent.post(url).send(touch(i).to_string()),
            Some("/v1/stop") => {
                // Now and then: there has to be something to stop.
                std::thread::sleep(Duration::from_millis(50));
                agent.post(url).send("")
            }
            Some(_) => agent.get(url).call(),
        };
        let mut answer = answer.unwrap();
        // Also the whole body. A touch may be too late, as others stop, or come later, or full of others before it; nothing else is wrong
        // with what is asked here.
        let (status, body) = (answer.status().as_u16(), answer.body_mut().read_to_string().unwrap());
        let is_late = ["stopped", "superseded", "busy"].iter().any(|kind| body.contains(&format!("problem:{kind}\"")));
        assert!(status == 200 || (path.is_none() && is_late), "{who}: {status} {body}");
        answered.send(who).unwrap();
    }
}

fn touch_on_a_page(daemon: &str, who: &'static str, answered: &Sender<&'static str>) {
    let (mut page, _) = tungstenite::connect(format!("{}/v1/live", daemon.replace("http", "ws"))).unwrap();
    for i in 0..REQUESTS {
        let finger =
            json!({"type": "touch", "touches": [{"id": 1, "x_px": 300 + 10 * i, "y_px": 500}], "intensity_g": 0.1});
        page.send(Message::text(finger.to_string())).unwrap();
        while !matches!(page.read().unwrap(), Message::Text(_)) {}
        answered.send(who).unwrap();
    }
}

/// What many pages do whose fingers rest: they look at the plan, and give it more time. By the calls themselves, as a page does so once a second.
fn rest(app: &App, runtime: &tokio::runtime::Runtime, is_over: &AtomicBool) {
    let mut next = Instant::now();
    while !is_over.load(Ordering::SeqCst) {
        let active = app.driver.find_active_plan();
        if Instant::now() >= next {
            next = Instant::now() + Duration::from_micros(100);
            if let Some(active) = active {
                runtime.block_on(
                    app.driver
                        .extend_touch_and_check_if_still_active(active.id, Instant::now() + Duration::from_secs(1)),
                );
            }
        }
    }
}

fn hammer(answered: &Sender<&'static str>) {
    let app = Arc::new(Daemon::app(STARTING_PLATE, Access::default()));
    let (served, url) = Served::at_a_port(&app, None);
    served
        .runtime
        .block_on(async { app.driver.subscribe_device_snapshots().wait_for(|device| device.connected).await.map(drop) })
        .unwrap();
    let url = url.as_str();
    assert_eq!(Daemon::agent().post(format!("{url}/v1/touch")).send(touch(0).to_string()).unwrap().status(), 200);
    let is_over = AtomicBool::new(false);
    let results: Vec<_> = std::thread::scope(|threads| {
        for _ in 0..2 {
            threads.spawn(|| rest(&app, &served.runtime, &is_over));
        }
        let clients = CLIENTS.map(|client| threads.spawn(move || ask(url, client, answered)));
        let results = clients.into_iter().map(|client| client.join()).collect();
        is_over.store(true, Ordering::SeqCst);
        results
    });
    for result in results {
        result.unwrap();
    }
    // What nobody asked for has not come of it: no fault, and the next touch is driven.
    let mut state = Daemon::agent().get(format!("{url}/v1/state")).call().unwrap();
    let state: serde_json::Value = state.body_mut().read_json().unwrap();
    let device = &state["device"];
    assert!(device["fault"].is_null() && device["faults"] == 0 && device["outages"] == 0, "{device}");
    let mut last = Daemon::agent().post(format!("{url}/v1/touch")).send(touch(1).to_string()).unwrap();
    assert_eq!(last.status(), 200, "{}", last.body_mut().read_to_string().unwrap());
}

/// Whoever holds the plan must not wait for the device's snapshot, nor the other way round, as the session's thread waits to publish meanwhile. What
/// hangs is not waited for: it ends with the test's process.
#[test]
fn everybody_at_once_is_answered() {
    let (answered, answers) = channel();
    let hammering = std::thread::spawn(move || hammer(&answered));
    let mut counts = CLIENTS.map(|(who, _)| (who, 0));
    loop {
        match answers.recv_timeout(STILL) {
            Ok(who) => counts.iter_mut().filter(|(known, _)| *known == who).for_each(|(_, count)| *count += 1),
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => panic!("the daemon hangs; until then it has answered {counts:?}"),
        }
    }
    hammering.join().unwrap();
    assert_eq!(counts, CLIENTS.map(|(who, _)| (who, REQUESTS)));
}

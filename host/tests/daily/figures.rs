//! Figures of the link: what is done to it shows in them, and each fault tells what they were.

use crate::line::{CALM, Ear};
use crate::serving::Serving;
use crate::support::{Daemon, panel_of, table};
use era::device::sim::{SimDevice, SimKnobs};
use era::scene::STARTING_PLATE;
use era_shared::protocol::Request;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;
/// How long a board is silent: longer than its dead-man time (250 ms), and not for so long that it is given up (1.1 s).
const SILENCE: Duration = Duration::from_millis(600);

fn number(state: &Value, pointer: &str) -> f64 {
    state.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

/// A value of `/metrics`.
fn metric(daemon: &Daemon, name: &str) -> f64 {
    let text = daemon.get_text("/metrics");
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    value.unwrap_or_else(|| panic!("no {name} in {text}")).parse().unwrap()
}

fn answers_after(daemon: &Daemon, ms: u64) {
    daemon.sim.set_knobs(SimKnobs { reply_delay: Duration::from_millis(ms), ..SimKnobs::default() });
}

fn silent_for(sim: &era::device::sim::SimControl, time: Duration) {
    sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    std::thread::sleep(time);
    sim.set_knobs(SimKnobs::default());
}

/// Answers that take now longer, now less long, are jitter; those that all take long are none.
#[test]
fn jitter_is_reported() {
    let daemon = Daemon::start(STARTING_PLATE);
    let deadline = Instant::now() + Duration::from_secs(30);
    for turn in 0_u64.. {
        // Less than the 50 ms after which it would be in doubt.
        answers_after(&daemon, 30 * (turn % 2));
        std::thread::sleep(Duration::from_millis(20));
        if number(&daemon.state(), "/link/round_trip_ms_jitter") > 5.0 {
            break;
        }
        assert!(Instant::now() < deadline, "{}", daemon.state()["link"]);
    }
    answers_after(&daemon, 30);
    let state = daemon.wait_for(|state| {
        let [median, jitter] = ["median", "jitter"].map(|name| number(state, &format!("/link/round_trip_ms_{name}")));
        median >= 30.0 && jitter < 0.5 * median
    });
    assert!(metric(&daemon, "era_link_round_trip_seconds") >= 0.03, "{state}");
    let jitter_s = metric(&daemon, "era_link_round_trip_jitter_seconds");
    assert!(jitter_s > 0.0 && jitter_s < metric(&daemon, "era_link_round_trip_worst_seconds"), "{jitter_s}");
}

#[test]
fn the_age_of_the_last_sign_of_life_grows_while_the_board_is_silent() {
    let age = |state: &Value| number(state, "/link/keep_alive_age_ms");
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.wait_for(|state| age(state) < 500.0);
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    daemon.wait_for(|state| age(state) > 500.0);
    assert!(metric(&daemon, "era_link_keep_alive_age_seconds") > 0.5);
    // It goes on when the link is given up, and what the link did before is not forgotten.
    let lost = daemon.wait_for(|state| state["device"]["outages"] == 1);
    let sent = number(&lost, "/link/frames_sent");
    assert!(age(&lost) > 500.0 && number(&lost, "/link/repeats") >= 1.0, "{lost}");
    daemon.sim.set_knobs(SimKnobs::default());
    let back = daemon.wait_for(|state| age(state) < 500.0 && state["device"]["connected"] == true);
    assert!(number(&back, "/link/frames_sent") > sent && number(&back, "/link/repeats") >= 1.0, "{back}");
    assert!(metric(&daemon, "era_link_keep_alive_age_seconds") < metric(&daemon, "era_link_repeats_total"));
}

#[test]
fn a_fault_reports_what_was_known_of_the_link() {
    let daemon = Daemon::start(STARTING_PLATE);
    assert_eq!(daemon.state()["device"]["fault"], json!(null));
    let spoil = |at_least: f64| {
        daemon.sim.set_knobs(SimKnobs { corrupt_every: Some(2), ..SimKnobs::default() });
        daemon.wait_for(|state| number(state, "/link/crc_errors") >= at_least);
        daemon.sim.set_knobs(SimKnobs::default());
    };
    spoil(2.0);
    assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    daemon.wait_for(|state| state["device"]["state"] == "running");
    silent_for(&daemon.sim, SILENCE);
    let state = daemon.wait_for(|state| state["device"]["fault"]["name"] == "host-silent");
    let link = state["device"]["fault"]["link"].clone();
    assert!(number(&link, "/keep_alive_age_ms") >= 600.0 && number(&link, "/longest_gap_ms") >= 600.0, "{link}");
    assert!(number(&link, "/crc_errors") >= 2.0 && number(&link, "/repeats") >= 1.0, "{link}");
    for trips in ["median", "worst", "jitter"] {
        assert!(number(&link, &format!("/round_trip_ms_{trips}")) > 0.0, "{link}");
    }
    assert_eq!(link["outages"], 0);
    // It stays as it was, whatever becomes of the link.
    spoil(number(&link, "/crc_errors") + 2.0);
    assert_eq!(daemon.state()["device"]["fault"]["link"], link);
    assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
    assert_eq!(daemon.state()["device"]["fault"], json!(null));

    // A fault that has nothing to do with the link, after an outage: of the silence then nothing is said.
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    daemon.wait_for(|state| state["device"]["outages"] == 1);
    daemon.sim.set_knobs(SimKnobs::default());
    daemon.wait_for(|state| state["device"]["connected"] == true && state["device"]["state"] == "safe");
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut knobs = SimKnobs::default();
    knobs.defects.interlock_open = true;
    daemon.sim.set_knobs(knobs);
    let state = daemon.wait_for(|state| state["device"]["fault"]["name"] == "interlock-open");
    let link = &state["device"]["fault"]["link"];
    assert_eq!(link["outages"], 1, "{link}");
    // An outage is a silence of more than a second.
    assert!(number(link, "/keep_alive_age_ms") < 1000.0, "{link}");
}

/// The log has the same in one line.
#[test]
fn a_fault_is_logged_with_what_was_known_of_the_link() {
    let (panel, volts) = panel_of(&table(STARTING_PLATE));
    let board = SimDevice::start(panel, volts).unwrap();
    let serving = Serving::start(&board, &[]);
    assert_eq!(serving.daemon.post("/v1/touch", LONG_TOUCH).0, 200);
    silent_for(&board.control(), SILENCE);
    serving.daemon.wait_for(|state| state["device"]["fault"]["name"] == "host-silent");
    let log = serving.end();
    let line = log.iter().find(|line| line["name"] == "host-silent").expect("the fault is logged");
    for key in ["keep_alive_age_ms", "longest_gap_ms"] {
        assert!(number(line, &format!("/{key}")) >= 600.0, "{key} in {line}");
    }
    for key in ["round_trip_ms", "round_trip_worst_ms", "jitter_ms", "repeats"] {
        assert!(number(line, &format!("/{key}")) > 0.0, "{key} in {line}");
    }
    assert_eq!((&line["outages"], &line["bad_frames"], &line["code"]), (&json!(0), &json!(0), &json!(0)), "{line}");
}

/// While the board is on, what a touch needs is kept at hand: nothing of that is driven, and it counts as no touch, no plan and no refusal.
#[test]
fn what_keeps_touches_quick_drives_nothing_and_is_counted_nowhere() {
    let (daemon, line) = crate::line::daemon(CALM);
    let (status, _, state) = daemon.post("/v1/arm", "");
    assert_eq!(status, 200, "{state}");
    let counts =
        || ["era_touches_total", "era_plans_total", "era_requests_refused_total"].map(|name| metric(&daemon, name));
    let before = counts();
    let since = line.mark(|_| {});
    // Looks are 100 ms apart.
    let looks = |ear: &Ear| ear.asked[since..].iter().filter(|request| **request == Request::Status).count();
    let ear = line.wait_for(|ear| looks(ear) >= 8);
    let is_order = |request: &&Request| {
        use Request::{Clock, Credit, Details, KeepAlive, Status, Telemetry};
        !matches!(request, Clock | Credit | Details | KeepAlive | Status | Telemetry)
    };
    assert_eq!(ear.asked[since..].iter().find(is_order), None);
    drop(ear);
    assert_eq!(counts(), before);
    let state = daemon.state();
    assert_eq!((&state["device"]["state"], &state["plan"]), (&json!("armed"), &Value::Null), "{state}");
}

/// As Prometheus names them: what only grows is a counter, which ends in `_total`, and nothing else does; each has its unit or says what
/// it counts, its help and its type before it, once (<https://prometheus.io/docs/practices/naming>).
#[test]
fn what_counts_is_a_counter_by_its_name() {
    let daemon = Daemon::start(STARTING_PLATE);
    daemon.wait_for(|state| state["device"]["clock"]["samples"].as_u64() >= Some(2));
    let text = daemon.get_text("/metrics");
    let mut types = std::collections::BTreeMap::new();
    for line in text.lines().filter_map(|line| line.strip_prefix("# TYPE ")) {
        let (name, kind) = line.split_once(' ').unwrap();
        assert_eq!(kind == "counter", name.ends_with("_total"), "{line}");
        assert!(kind == "counter" || kind == "gauge", "{line}");
        assert!(text.contains(&format!("# HELP {name} ")), "{line}");
        assert!(types.insert(name, kind).is_none(), "{name} is there twice");
    }
    assert_eq!(types.get("era_clock_outliers_total"), Some(&"counter"), "{text}");
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let (name, value) = line.split_once([' ', '{']).unwrap();
        assert!(types.contains_key(name) && !value.is_empty(), "{line}");
    }
}

//! A busy host: the daemon's process does not run for a while, as where something else has the processor.

use crate::serving::Serving;
use crate::support::{panel_of, table};
use era::device::sim::SimDevice;
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 200}"#;
const LONG_TOUCH: &str = r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#;

/// For as long as the board takes to give its host up, and goes off. What has happened is told and logged, with its reason; then a person clears it,
/// or the next touch where that is the policy, and everything goes on.
#[test]
fn a_host_that_was_busy_reports_why_and_goes_on() {
    let (panel, volts) = panel_of(&table(STARTING_PLATE));
    let board = SimDevice::start(panel, volts).unwrap();
    for (more, is_cleared) in [(&[][..], false), (&["--clear-silence"][..], true)] {
        let serving = Serving::start(&board, more);
        let daemon = &serving.daemon;
        assert_eq!(daemon.post("/v1/touch", LONG_TOUCH).0, 200);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        serving.signal("STOP");
        let deadline = Instant::now() + Duration::from_secs(30);
        while board.control().observations_since_start().energised {
            assert!(Instant::now() < deadline, "the board is still live");
            std::thread::sleep(Duration::from_millis(5));
        }
        serving.signal("CONT");
        let state = daemon.wait_for(|state| !state["device"]["fault"].is_null());
        let device = &state["device"];
        let told = (&device["fault"]["name"], &device["state"], &device["faults"]);
        assert_eq!(told, (&json!("host-silent"), &json!("fault"), &json!(1)), "{device}");
        let (status, _, answer) = daemon.post("/v1/touch", TOUCH);
        if is_cleared {
            assert_eq!(status, 200, "{answer}");
        } else {
            assert_eq!((status, &answer["type"]), (409, &json!("urn:era:problem:device-fault")), "{answer}");
            for piece in ["host-silent", "dead-man time", "Check the cable", "`era clear`, or POST /v1/faults/clear"] {
                assert!(answer["detail"].as_str().unwrap().contains(piece), "{piece}: {answer}");
            }
            assert_eq!(daemon.post("/v1/faults/clear", "").0, 200);
            assert_eq!(daemon.post("/v1/touch", TOUCH).0, 200);
        }
        let metrics = daemon.get_text("/metrics");
        let cleared = format!("era_device_silences_cleared_total {}", u8::from(is_cleared));
        assert!(metrics.contains(&cleared) && metrics.contains("era_device_faults_total 1"), "{metrics}");
        let log = serving.end();
        let latched: Vec<_> = log.iter().filter(|line| line["name"] == "host-silent").collect();
        let [latched] = latched[..] else { panic!("{log:?}") };
        let said = latched["message"].as_str().unwrap();
        assert!(latched["level"] == "ERROR" && said.contains("has latched a fault: The host"), "{latched}");
        assert!(latched["keep_alive_age_ms"].is_f64() && latched["longest_gap_ms"].is_f64(), "{latched}");
        let of_policy = log.iter().any(|line| line["message"].as_str().unwrap().contains("(--clear-silence)"));
        assert_eq!(of_policy, is_cleared, "{log:?}");
    }
}

/// The session's thread goes before everything that has no real-time priority, where the system allows that: whether it does is asked of `chrt`.
#[cfg(target_os = "linux")]
#[test]
fn the_sessions_thread_is_preferred_where_that_is_allowed() {
    let (panel, volts) = panel_of(&table(STARTING_PLATE));
    let board = SimDevice::start(panel, volts).unwrap();
    let serving = Serving::start(&board, &[]);
    let allowed = Command::new("chrt").args(["--rr", "1", "true"]).stderr(Stdio::null()).status();
    let wanted = if allowed.is_ok_and(|status| status.success()) { 2 } else { 0 };
    assert_eq!(serving.policy_of("device-session"), wanted);
}

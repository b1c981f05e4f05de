//! What is not a request is refused by name.

use crate::support::Daemon;
use era::scene::EXAMPLE_PLATE;
use serde_json::{Value, json};

#[test]
fn only_json_objects_in_their_ranges_are_taken() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let refused: &[(&str, Option<&str>, &str)] = &[
        (r#"{"x_px": 1, "y_px": 1, "intensity_g": 1e9}"#, Some("intensity_g"), "0 to 1000"),
        (
            r#"{"x_px": 1, "y_px": 1, "also": [{"x_px": 1, "y_px": 1, "intensity_g": 1e9}]}"#,
            Some("also[0].intensity_g"),
            "0 to 1000",
        ),
        ("[300, 900]", None, "a list"),
        (r#"{"x_px": 1, "y_px": 1, "also": [[300, 900]]}"#, Some("also[0]"), "an object"),
        (r#"{"x_px": 1, "y_px": 1, "count": 1.5, "effect": "buzz"}"#, Some("count"), "a whole number"),
        ("7", None, "a number"),
    ];
    for (body, field, wanted) in refused {
        let (status, _, problem) = daemon.post("/v1/touch", body);
        assert_eq!((status, problem["field"].as_str()), (400, *field), "{body}: {problem}");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(wanted), "{body}: {detail}");
        for rust in ["i64", "u32", "f64", "struct", "sequence"] {
            assert!(!detail.contains(rust), "{body}: {detail}");
        }
    }
    assert_eq!(daemon.state()["device"]["state"], "safe", "nothing was driven");
    assert_eq!(daemon.post("/v1/touch", r#"{"x_px": 1, "y_px": 1, "intensity_g": 1000}"#).0, 200);
}

#[test]
fn what_says_that_it_is_something_else_is_not_read_as_json() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let send = |kind: &str| {
        let mut answer = Daemon::agent()
            .post(format!("{}/v1/touch", daemon.url))
            .header("Content-Type", kind)
            .send(r#"{"x_px": 300, "y_px": 900}"#)
            .unwrap();
        let value: Value = answer.body_mut().read_json().unwrap();
        (answer.status().as_u16(), value)
    };
    for kind in ["application/xml", "text/html", "multipart/form-data; boundary=x", "image/png"] {
        let (status, problem) = send(kind);
        assert_eq!((status, &problem["allowed"]), (415, &json!("application/json")), "{kind}: {problem}");
    }
    for kind in [
        "application/json",
        "Application/JSON; charset=utf-8",
        "application/vnd.api+json",
        "application/x-www-form-urlencoded",
    ] {
        assert_eq!(send(kind).0, 200, "{kind}");
    }
}

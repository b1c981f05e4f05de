//! What is not a request is refused by name.

use crate::raw::connect;
use crate::support::Daemon;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::io::{Read, Write};

#[test]
fn only_json_objects_in_their_ranges_are_taken() {
    let daemon = Daemon::start(STARTING_PLATE);
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
        (r#"{"x_px": 1e999, "y_px": 1}"#, Some("x_px"), "x_px is 1e999"),
        (
            "{\"x_px\": 1,\n \"y_px\": 1, \"also\": [{\"x_px\": -2.5E+400, \"y_px\": 1}]}",
            Some("also[0].x_px"),
            "is -2.5E+400",
        ),
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
    let daemon = Daemon::start(STARTING_PLATE);
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

/// Said beforehand or not, a body is read up to what its path takes, and the first byte over that ends it: here no other byte follows.
#[test]
fn no_body_is_read_beyond_its_paths_limit() {
    let daemon = Daemon::start(STARTING_PLATE);
    for (path, most) in [("/v1/touch", 16 << 10), ("/v1/preview", 144 << 10), ("/v1/effects", 528 << 10)] {
        let status = |head: &str, body: &[u8]| {
            let mut stream = connect(&daemon);
            write!(stream, "POST {path} HTTP/1.1\r\nHost: localhost\r\n{head}\r\n\r\n").unwrap();
            stream.write_all(body).unwrap();
            let mut answer = [0; 12];
            stream.read_exact(&mut answer).unwrap();
            String::from_utf8_lossy(&answer[9..]).into_owned()
        };
        for (length, wanted) in [(most, "400"), (most + 1, "413")] {
            let body = vec![b' '; length];
            assert_eq!(status(&format!("Content-Length: {length}"), &body), wanted, "{path} {length}");
            let chunk = [format!("{length:x}\r\n").as_bytes(), &body].concat();
            let end = if length == most { &b"\r\n0\r\n\r\n"[..] } else { b"" };
            assert_eq!(
                status("Transfer-Encoding: chunked", &[&chunk, end].concat()),
                wanted,
                "{path} {length} chunked"
            );
        }
    }
}

/// What is wrong is told in the words of the interface, with its field.
#[test]
fn what_is_wrong_is_named_as_it_was_written() {
    let daemon = Daemon::start(STARTING_PLATE);
    for (body, field, words) in [
        (
            r#"{"x_px": 1, "y_px": 1, "effect": "click", "from_ms": 5}"#,
            "from_ms",
            "from_ms is 5, but is not allowed together with `effect`",
        ),
        (
            r#"{"x_px": 1, "y_px": 1, "effect": "click", "to_ms": 5}"#,
            "to_ms",
            "to_ms is 5, but is not allowed together with `effect`",
        ),
        (
            r#"{"x_px": 1, "y_px": 1, "effect": "click", "also": [{"x_px": 9, "y_px": 9, "from_ms": 5}]}"#,
            "also[0].from_ms",
            "also[0].from_ms is 5",
        ),
        (r#"{"x_px": 1, "y_px": 1, "also": [{"x_px": 9}]}"#, "also[0].y_px", "also[0].y_px is missing"),
        (r#"{"x_px": 1, "y_px": 1, "quiet": [{"z": 9}]}"#, "quiet[0].z", "quiet[0].z is not a known field"),
    ] {
        let (status, _, problem) = daemon.post("/v1/touch", body);
        assert_eq!((status, &problem["field"]), (400, &json!(field)), "{problem}");
        assert!(problem["detail"].as_str().unwrap().starts_with(words), "{problem}");
    }
    let (status, _, problem) = daemon.post("/v1/touch", r#"{"x_px": [1, 2}"#);
    let detail = problem["detail"].as_str().unwrap();
    assert!(
        status == 400 && detail.starts_with("the body is not valid JSON: ") && !detail.contains("f64"),
        "{problem}"
    );
    for (path, takes) in [("/v1/touch", "accepts POST, but not GET;"), ("/v1/stop", "accepts POST, but not GET;")] {
        let (status, problem) = daemon.get(path);
        assert!(status == 405 && problem["detail"].as_str().unwrap().contains(takes), "{problem}");
    }
    let (status, _, problem) = daemon.post("/v1/requests/1", "");
    assert!(status == 405 && problem["detail"].as_str().unwrap().contains("accepts GET, but not POST;"), "{problem}");
    // Its own page has its own scheme.
    for (scheme, status) in [("http", 200), ("https", 403)] {
        let origin = daemon.url.replace("http", scheme);
        let answer =
            Daemon::agent().post(format!("{}/v1/stop", daemon.url)).header("origin", &origin).send("").unwrap();
        assert_eq!(answer.status(), status, "{origin}");
    }
}

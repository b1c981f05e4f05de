//! What the daemon answers is what its description (`/openapi.json`) says: every answer fits its schema, has no key that the schema
//! does not name, and no status or kind of problem that its path does not declare. `support::Daemon` looks at every answer of every
//! test so; here are answers of each kind, and the proof that what is not described is found.

use crate::support;
use era::daemon::Access;
use era::device::session::policy::SessionPolicy;
use era::device::sim::SimKnobs;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use support::Daemon;
use support::described::described;
use tungstenite::Message;

/// Bodies of touches, one of each kind.
fn touches() -> Vec<Value> {
    let touch = |more: Value| {
        let mut body = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "duration_ms": 20});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        body
    };
    vec![
        touch(json!({})),
        touch(json!({"intensity_g": 20.0})),
        touch(json!({"objective": "power"})),
        touch(json!({"objective": "reach"})),
        touch(json!({"grouping": "shared"})),
        touch(json!({"also": [{"x_px": 1500, "y_px": 700, "intensity_g": 2.0}], "trade": true})),
        touch(json!({"quiet": [{"x_px": 1500, "y_px": 700, "radius_mm": 5.0, "at_most_g": 0.01}]})),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "effect": "click"}),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "effect": "swell"}),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "effect": "pulse_train", "count": 2, "period_ms": 50}),
        json!({"x_px": 480, "y_px": 640, "intensity_g": 0.1, "from_ms": 0, "to_ms": 30,
               "also": [{"x_px": 1500, "y_px": 700, "intensity_g": 0.1, "from_ms": 40, "to_ms": 60}]}),
    ]
}

#[test]
fn answers_are_as_described() {
    let daemon = Daemon::start(STARTING_PLATE);
    let told: Value = serde_json::from_str(&daemon.get_text("/openapi.json")).unwrap();
    assert_eq!(told, serde_json::from_str::<Value>(era::daemon::description()).unwrap());
    for path in ["/v1/state", "/v1/scene", "/v1/field", "/v1/field?x_px=480&y_px=640"] {
        assert_eq!(daemon.get(path).0, 200, "{path}");
    }
    let asked = described().schema("/paths/~1v1~1touch/post/requestBody/content/application~1json/schema");
    for body in touches() {
        assert!(asked.is_valid(&body), "{body}: {:?}", asked.validate(&body));
        let (status, _, answer) = daemon.post("/v1/touch", &body.to_string());
        assert_eq!(status, 200, "{body}: {answer}");
        daemon.state();
    }
    let preview = json!({"x_px": 480, "y_px": 640, "moves": {"actuator[1]": {"x_mm": 80.0}}});
    let asked = described().schema("/paths/~1v1~1preview/post/requestBody/content/application~1json/schema");
    assert!(asked.is_valid(&preview));
    assert_eq!(daemon.post("/v1/preview", &preview.to_string()).0, 200);
    assert_eq!(daemon.get("/v1/requests/1").0, 200);
    for path in ["/v1/arm", "/v1/stop", "/v1/faults/clear"] {
        daemon.post(path, "");
    }
}

/// What the daemon refuses, the description refuses as well, as far as a schema can say it; and the refusal is a declared one.
#[test]
fn refusals_are_as_described() {
    let daemon = Daemon::start(STARTING_PLATE);
    let asked = described().schema("/paths/~1v1~1touch/post/requestBody/content/application~1json/schema");
    let wrong = [
        json!({"x_px": -1, "y_px": 1}),
        json!({"x_px": "left"}),
        json!({"x_px": 1, "y_px": 1, "objective": "noise"}),
        json!({"x_px": 1, "y_px": 1, "intensity_g": 1000.5}),
        json!({"x_px": 1, "y_px": 1, "intensity_db": 80.5}),
        json!({"x_px": 1, "y_px": 1, "duration_ms": 0.5}),
        json!({"x_px": 1, "y_px": 1, "effect": "pulse_train", "count": 101}),
        json!({"x_px": 1, "y_px": 1, "effect": "pulse_train", "period_ms": 9}),
        json!({"x_px": 1, "y_px": 1, "to_ms": 10_001}),
        json!({"x_px": 1, "y_px": 1, "from_ms": -1}),
        json!({"x_px": 1, "y_px": 1, "more": 1}),
        json!({"x_px": 1, "y_px": 1, "also": vec![json!({"x_px": 1, "y_px": 1}); 10]}),
        json!({"x_px": 1, "y_px": 1, "quiet": vec![json!({"x_px": 1, "y_px": 1, "radius_mm": 1, "at_most_g": 1}); 9]}),
        json!({"x_px": 1, "y_px": 1, "quiet": [{"x_px": 1, "y_px": 1, "radius_mm": 101, "at_most_g": 1}]}),
    ];
    for body in wrong {
        assert!(!asked.is_valid(&body), "{body} fits the description");
        assert_eq!(daemon.post("/v1/touch", &body.to_string()).0, 400, "{body}");
    }
    let together = json!({"x_px": 1, "y_px": 1, "grouping": "shared", "objective": "power"});
    assert_eq!(daemon.post("/v1/touch", &together.to_string()).0, 400);
    for path in ["/v1/requests/none", "/v1/nothing"] {
        assert_eq!(daemon.get(path).0, 404, "{path}");
    }
    for path in ["/v1/field?x_px=1", "/v1/field?x_px=-1&y_px=1", "/v1/requests/%ff", "/v1/live?send=map", "/v1/live"] {
        assert!((400..=426).contains(&daemon.get(path).0), "{path}");
    }
    assert_eq!(daemon.get("/v1/touch").0, 405);
    assert_eq!(daemon.post("/v1/touch", &" ".repeat(20_000)).0, 413);
    let scene = json!({"x_px": 1, "y_px": 1, "scene": "no TOML"}).to_string();
    assert_eq!(daemon.post("/v1/preview", &scene).0, 400);
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    // Late at first, and then lost.
    daemon.wait_for(|state| state["device"]["in_doubt"] == true);
    daemon.wait_for(|state| state["device"]["connected"] == false && state["device"]["in_doubt"] == false);
    for (path, body) in [("/v1/touch", r#"{"x_px": 1, "y_px": 1}"#), ("/v1/stop", ""), ("/v1/arm", "")] {
        assert_eq!(daemon.post(path, body).0, 502, "{path}");
    }
}

#[test]
fn what_a_token_does_not_open_is_as_described() {
    let tokens = Access::parse_tokens("view AAAAAAAAAAAAAAAAAAAAAA\narm CCCCCCCCCCCCCCCCCCCCCCCC\n").unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    assert_eq!((daemon.get("/v1/state").0, daemon.post("/v1/stop", "").0), (401, 401));
    for (path, item) in described().whole["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let wants_a_token = !operation["x-role"].is_null();
            let path = path.replace("{id}", "1");
            let status = match method.as_str() {
                "get" => Daemon::agent().get(format!("{}{path}", daemon.url)).call().unwrap().status().as_u16(),
                "post" => daemon.post(&path, "").0,
                other => panic!("{other}"),
            };
            assert_eq!(status == 401, wants_a_token, "{method} {path}");
        }
    }
}

/// What is said on the live socket, in and out.
#[test]
fn live_messages_are_as_described() {
    let daemon = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), Access::default());
    let (takes, sends) =
        (described().schema("/components/schemas/LiveIn"), described().schema("/components/schemas/LiveOut"));
    let all = "/v1/live?send=scene,state,plan,field";
    let (mut socket, _) = tungstenite::connect(format!("{}{all}", daemon.url.replace("http", "ws"))).unwrap();
    let finger = json!([{"id": 1, "x_px": 400.0, "y_px": 500.0}]);
    let slider = |detents: u32| json!({"kind": "slider", "x_px": -9, "y_px": 9, "width_px": 500, "height_px": 90, "detents": detents});
    let said = [
        (json!({"type": "touch", "touches": finger, "intensity_g": 0.1}), true, "plan"),
        (json!({"type": "touch", "touches": []}), true, "state"),
        (json!({"type": "touch", "touches": finger, "effect": "click"}), true, "plan"),
        (json!({"type": "touch", "touches": finger, "loud": true}), false, "error"),
        (json!({"type": "controls", "controls": [slider(11)]}), true, "state"),
        (json!({"type": "controls", "controls": [slider(1)]}), false, "error"),
        (json!({"type": "stop"}), true, "state"),
    ];
    for (message, is_right, answer) in said {
        assert_eq!(takes.is_valid(&message), is_right, "{message}");
        socket.send(Message::text(message.to_string())).unwrap();
        // States come all the time; whatever is waited for comes among the first of them.
        for waited in 0.. {
            assert!(waited < 500, "no {answer} to {message}");
            let Message::Text(text) = socket.read().unwrap() else { continue };
            let told: Value = serde_json::from_str(&text).unwrap();
            let wrong: Vec<String> = sends.iter_errors(&told).map(|error| error.to_string()).collect();
            assert!(wrong.is_empty(), "{wrong:?} in {told}");
            if told["type"] == answer {
                let mut more = told;
                more["more"] = json!(1);
                assert!(!sends.is_valid(&more), "a key more in {answer}");
                break;
            }
        }
    }
}

/// Each object in a value, by the pointer to it.
fn objects(value: &Value, at: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(map) => {
            found.push(at.to_owned());
            map.iter().for_each(|(key, own)| objects(own, &format!("{at}/{key}"), found));
        }
        Value::Array(list) => list.iter().enumerate().for_each(|(i, own)| objects(own, &format!("{at}/{i}"), found)),
        _ => {}
    }
}

/// A key that nothing names is found in every object of an answer; so is one that is missing and one of another type, a status
/// and a kind of problem that the path does not declare.
#[test]
fn what_is_not_described_is_found() {
    let daemon = Daemon::start(STARTING_PLATE);
    let described = described();
    let wrong = |path: &str, method: &str, answer: &Value| {
        !described.wrong(method, path, 200, "application/json", answer).is_empty()
    };
    let (status, _, touched) = daemon.post("/v1/touch", &touches()[9].to_string());
    assert_eq!(status, 200, "{touched}");
    let told = daemon.get("/v1/requests/1").1;
    let answers = [
        ("/v1/touch", "post", &touched),
        ("/v1/touch", "post", &daemon.post("/v1/touch", &touches()[5].to_string()).2),
        ("/v1/state", "get", &daemon.state()),
        ("/v1/scene", "get", &daemon.get("/v1/scene").1),
        ("/v1/field", "get", &daemon.get("/v1/field").1),
        ("/v1/requests/1", "get", &told),
    ];
    for (path, method, right) in answers {
        assert!(!wrong(path, method, right), "{right}");
        let mut places = Vec::new();
        objects(right, "", &mut places);
        for place in places {
            let mut more = right.clone();
            more.pointer_mut(&place).unwrap()["planted"] = json!(1);
            assert!(wrong(path, method, &more), "{path}: a key more at {place:?} is not found");
        }
    }
    for (pointer, key) in [
        ("", "drives"),
        ("", "optimality_gap"),
        ("", "error_bound"),
        ("/predicted", "target_peak_g"),
        ("/drives/0", "force_n"),
        ("/device/effect", "limited_by"),
    ] {
        let mut less = touched.clone();
        less.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(key).unwrap();
        assert!(wrong("/v1/touch", "post", &less), "{pointer}/{key} is missing");
    }
    let mut other = touched.clone();
    other["drives"][0]["frequency_hz"] = json!("fast");
    assert!(wrong("/v1/touch", "post", &other));
    // Problems: of the path and status, and none else.
    let problem = |kind: &str, status: u16| json!({"type": format!("urn:era:problem:{kind}"), "title": "t", "status": status, "detail": "d"});
    let found = |path: &str, told: &Value, status: u16| {
        !described.wrong("post", path, status, "application/problem+json", told).is_empty()
    };
    assert!(!found("/v1/touch", &problem("superseded", 409), 409));
    assert!(found("/v1/touch", &problem("too-large", 409), 409), "a kind of another path");
    assert!(found("/v1/touch", &problem("stopped", 400), 409), "another status in the body");
    assert!(found("/v1/touch", &problem("stopped", 418), 418), "a status that is not declared");
    assert!(found("/v1/stop", &problem("busy", 503), 503), "a stop is never too much");
    assert!(found("/v1/nothing", &problem("stopped", 409), 409), "a path that is not declared");
}

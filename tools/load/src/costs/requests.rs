//! Every route of the daemon, with the dearest that it takes and the dearest that it refuses.

use era::scene::STARTING_PLATE;
use serde_json::{Value, json};

/// How a request is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sending {
    /// And its answer waited for.
    Answered,
    /// And its sender hangs up.
    HangUp,
    /// As a message on a live socket.
    Live,
}

/// Requests of one kind.
pub struct Case {
    /// Method and path, and which of its requests these are.
    pub route: &'static str,
    /// What bounds their cost.
    pub bound: &'static str,
    pub sending: Sending,
    /// Method, path and body, sent in turn.
    pub requests: Vec<(&'static str, String, String)>,
}

const STUDY: &str = "version = 1\nname = \"costs\"\nscene = \"plate.toml\"\n[[wish]]\nfigure = \"weakest_g\"\n";

fn make_case(route: &'static str, bound: &'static str, method: &'static str, path: &str, bodies: Vec<String>) -> Case {
    let requests = bodies.into_iter().map(|body| (method, path.to_owned(), body)).collect();
    Case { route, bound, sending: Sending::Answered, requests }
}

fn make_get_case(route: &'static str, bound: &'static str, path: &str) -> Case {
    make_case(route, bound, "GET", path, vec![String::new()])
}

/// With ten targets and eight quiet zones.
fn make_large_touch_body(turn: u32, extra_keys: &Value) -> String {
    let place = |k: u32| (f64::from((turn * 733 + k * 379) % 1920), f64::from((turn * 541 + k * 251) % 1280));
    let target = |k: u32| json!({"x_px": place(k).0, "y_px": place(k).1, "intensity_g": 0.1 * f64::from(k)});
    let quiet = |k: u32| json!({"x_px": place(k).0, "y_px": place(k).1, "radius_mm": 20, "at_most_g": 0.01});
    let mut body = target(5);
    body["also"] = (1..10).map(target).collect();
    body["quiet"] = (20..28).map(quiet).collect();
    if let (Some(body), Some(extra_keys)) = (body.as_object_mut(), extra_keys.as_object()) {
        body.extend(extra_keys.clone());
    }
    body.to_string()
}

fn make_effect_touch_body(turn: u32, effect: &str) -> String {
    let (x_px, y_px) = (f64::from(turn * 733 % 1920), f64::from(turn * 541 % 1280));
    json!({"x_px": x_px, "y_px": y_px, "intensity_g": 0.3, "effect": effect}).to_string()
}

/// Ten targets with time windows that overlap, so that each end begins another plan.
fn make_touch_body_with_time_windows(turn: u32) -> String {
    let target = |k: u32| {
        let (x_px, y_px) = ((turn * 733 + k * 379) % 1920, (turn * 541 + k * 251) % 1280);
        json!({"x_px": x_px, "y_px": y_px, "intensity_g": 0.1, "from_ms": 100 * k, "to_ms": 100 * k + 950})
    };
    let mut body = target(0);
    body["also"] = (1..10).map(target).collect();
    body.to_string()
}

/// `events` may end with a comma.
fn make_effect_body(turn: u32, events: &str) -> String {
    let events = events.trim_end_matches(',');
    let x_px = 200 + 97 * turn;
    format!(r#"{{"x_px": {x_px}, "y_px": 640, "intensity_g": 0.1, "effect": {{"version": 1, "events": [{events}]}}}}"#)
}

fn make_many_clicks_effect_body(turn: u32) -> String {
    let click =
        |i: u32| format!(r#"{{"primitive": "tick", "time_ms": {}, "dx_mm": {}}},"#, 100 * i, f64::from(i) / 4.0);
    make_effect_body(turn, &(0..100).map(click).collect::<String>())
}

fn make_weak_vibrations_effect_body() -> String {
    let buzz = |i: u32| {
        let dx_mm = f64::from(i) / 1000.0;
        format!(r#"{{"primitive": "buzz", "time_ms": 0, "duration_ms": 30000, "intensity": 0.01, "dx_mm": {dx_mm}}},"#)
    };
    make_effect_body(0, &(0..1000).map(buzz).collect::<String>())
}

fn make_scene_with_masses(count: usize) -> String {
    let one = |i: usize| {
        let (x, y) = (15 + 10 * (i % 27), 20 + (37 * i) % 160);
        format!("[[mass]]\nx_mm = {x}\ny_mm = {y}\nmass_g = 1\n")
    };
    format!("{STARTING_PLATE}\n{}", (0..count).map(one).collect::<String>())
}

fn make_scene_with_thickness_patches(patch_count: usize) -> String {
    let one = |i: usize| {
        let (x, y) = (i % 20 * 14, i / 20 * 9);
        format!("[[patch]]\nx_mm = {x}\ny_mm = {y}\nlength_mm = 8\nwidth_mm = 5\nthickness_mm = 2.5\n")
    };
    format!("{STARTING_PLATE}\n{}", (0..patch_count).map(one).collect::<String>())
}

fn make_scene_of_length(length_mm: u32) -> String {
    STARTING_PLATE.replacen("length_mm = 300", &format!("length_mm = {length_mm}"), 1)
}

fn make_preview_body(scene_toml: &str) -> String {
    json!({"x_px": 960, "y_px": 640, "scene": scene_toml}).to_string()
}

fn make_study_body(study_toml: &str) -> String {
    json!({ "study": study_toml }).to_string()
}

fn make_wrong_study_body(variable_count: usize) -> String {
    let one = |i: usize| format!("[[variable]]\nname = \"v{i}\"\nkey = \"support[1].x_mm\"\nfrom = 1000\nto = 2000\n");
    make_study_body(&format!("{STUDY}{}", (0..variable_count).map(one).collect::<String>()))
}

/// All of them; the stop itself is measured beside each.
pub fn list_request_kinds_to_measure_cost_of() -> Vec<Case> {
    let text = |length: usize| json!({"x_px": 1, "y_px": 2, "also": "x".repeat(length)}).to_string();
    let live = |route, bound, bodies: Vec<String>| Case {
        sending: Sending::Live,
        ..make_case(route, bound, "GET", "/v1/live", bodies)
    };
    let finger = |k: u32| json!({"id": k, "x_px": 100 * k, "y_px": 100 * k, "intensity_g": 0.1});
    let fingers = |from: u32| json!({"type": "touch", "touches": (from..from + 10).map(finger).collect::<Vec<_>>()});
    let thickness = format!("{STUDY}[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1.5\nto = 3\n");
    vec![
        make_case(
            "`POST /v1/touch`, 10 targets, 8 quiet zones",
            "16 KiB; 2 planned at a time, 64 wait, by turns",
            "POST",
            "/v1/touch",
            (0..8)
                .map(|turn| {
                    make_large_touch_body(
                        turn,
                        &json!({"objective": (if turn % 2 == 0 { "power" } else { "contrast" })}),
                    )
                })
                .collect(),
        ),
        make_case(
            "the same with `trade`",
            "one at a time, 4 wait, 5 s, ends with its sender",
            "POST",
            "/v1/touch",
            (0..4).map(|turn| make_large_touch_body(turn, &json!({"trade": true}))).collect(),
        ),
        make_case("the same, 16 kB that are no touch", "16 KiB", "POST", "/v1/touch", vec![text(16_000)]),
        make_case(
            "the same with an effect, at ever new places",
            "as a touch",
            "POST",
            "/v1/touch",
            (0..200).map(|turn| make_effect_touch_body(turn, "click")).collect(),
        ),
        make_case(
            "the same with ten time windows",
            "as a touch",
            "POST",
            "/v1/touch",
            (0..8).map(make_touch_body_with_time_windows).collect(),
        ),
        make_get_case("`GET /v1/effects`", "made once", "/v1/effects"),
        make_case(
            "`POST /v1/effects`, 100 clicks at places of their own",
            "2 at a time, one of each client, 16 wait, 10 s, ends with its sender",
            "POST",
            "/v1/effects",
            (0..4).map(make_many_clicks_effect_body).collect(),
        ),
        make_case(
            "the same, 1000 weak vibrations at places of their own",
            "1000 events, 100 places",
            "POST",
            "/v1/effects",
            vec![make_weak_vibrations_effect_body()],
        ),
        make_case(
            "the same, 520 kB of empty events",
            "528 KiB",
            "POST",
            "/v1/effects",
            vec![make_effect_body(0, &"{},".repeat(173_000))],
        ),
        make_get_case("`GET /v1/requests/{id}`", "the last 256", "/v1/requests/none"),
        make_case(
            "`POST /v1/preview`, the starting plate",
            "2 at a time, one of each client, 16 wait, 10 s, ends with its sender",
            "POST",
            "/v1/preview",
            vec![json!({"x_px": 960, "y_px": 640}).to_string()],
        ),
        make_case(
            "the same, 32 attachments",
            "32 attachments, 80 000 unknowns times attachments",
            "POST",
            "/v1/preview",
            vec![make_preview_body(&make_scene_with_masses(26))],
        ),
        make_case(
            "the same, 100 modes",
            "100 modes, 6000 unknowns",
            "POST",
            "/v1/preview",
            vec![make_preview_body(&make_scene_of_length(3000))],
        ),
        make_case(
            "the same, 10 m long",
            "100 modes",
            "POST",
            "/v1/preview",
            vec![make_preview_body(&make_scene_of_length(10_000))],
        ),
        make_case(
            "the same, 200 patches",
            "24 patches and cut-outs",
            "POST",
            "/v1/preview",
            vec![make_preview_body(&make_scene_with_thickness_patches(200))],
        ),
        Case {
            sending: Sending::HangUp,
            ..make_case(
                "the same, 32 attachments, hung up",
                "ends with its sender",
                "POST",
                "/v1/preview",
                vec![make_preview_body(&make_scene_with_masses(26))],
            )
        },
        make_case(
            "`POST /v1/study`, values that are all refused",
            "one at a time; 64 entries, 4 MB of scenes read",
            "POST",
            "/v1/study",
            vec![make_wrong_study_body(60)],
        ),
        Case {
            sending: Sending::HangUp,
            ..make_case("the same, 50 kB, hung up", "64 entries", "POST", "/v1/study", vec![make_wrong_study_body(600)])
        },
        make_case(
            "the same, a Latin hypercube of 10^7",
            "2000 looks, before any is listed",
            "POST",
            "/v1/study",
            vec![make_study_body(&format!("{thickness}[method]\nway = \"latin_hypercube\"\ndesigns = 10000000\n"))],
        ),
        make_case(
            "the same, 2000 designs",
            "one at a time, 300 s, `POST /v1/study/stop`",
            "POST",
            "/v1/study",
            vec![make_study_body(&format!("{thickness}[method]\ndesigns = 1999\n"))],
        ),
        make_get_case("`GET /v1/study`", "what is known is kept", "/v1/study"),
        make_case("`POST /v1/study/stop`", "a flag", "POST", "/v1/study/stop", vec![String::new()]),
        make_case(
            "`POST /v1/tolerances`",
            "as previews; one at a time, 128 panels, 300 s",
            "POST",
            "/v1/tolerances",
            vec![make_preview_body(&make_scene_with_masses(8))],
        ),
        make_get_case("`GET /v1/tolerances`", "what is known is kept", "/v1/tolerances"),
        make_case("`POST /v1/tolerances/stop`", "a flag", "POST", "/v1/tolerances/stop", vec![String::new()]),
        make_case("`POST /v1/arm`", "one at a time, 8 wait, by turns", "POST", "/v1/arm", vec![String::new()]),
        make_case("`POST /v1/faults/clear`", "as `POST /v1/arm`", "POST", "/v1/faults/clear", vec![String::new()]),
        make_get_case("`GET /v1/state`", "some kB", "/v1/state"),
        make_get_case("`GET /v1/scene`", "made once", "/v1/scene"),
        make_get_case("`GET /v1/field?x_px=&y_px=`", "as `POST /v1/touch`", "/v1/field?x_px=960&y_px=640"),
        make_get_case("`GET /v1/field`", "one at a time, made once for what is driven", "/v1/field"),
        make_get_case("`GET /metrics`", "some kB", "/metrics"),
        make_get_case("`GET /openapi.json`", "made once", "/openapi.json"),
        make_get_case("`GET /`, and its files", "made once", "/"),
        make_get_case("what is not there (404)", "", "/v1/nothing"),
        make_case("another method (405)", "the methods are made once", "DELETE", "/v1/touch", vec![String::new()]),
        live(
            "`/v1/live`, ten fingers",
            "16 KiB; 32 steps wait",
            vec![fingers(1).to_string(), json!({"type": "touch", "touches": []}).to_string()],
        ),
        live(
            "the same, 16 kB that are no message",
            "16 KiB answered, 256 KiB read",
            vec![json!({"type": "x".repeat(15_000)}).to_string()],
        ),
        live(
            "the same, 250 kB that are no message",
            "16 KiB answered, 256 KiB read; each 2 KiB count as one request at the pace",
            vec![format!(r#"{{"type": "touch", "touches": [{}]}}"#, r#"{"id":1},"#.repeat(27_000))],
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the interface offers costs something: each of its operations is measured, but for the stop, which is measured beside each.
    #[test]
    fn every_operation_of_the_interface_has_a_case() {
        let description: Value = serde_json::from_str(era::daemon::description()).unwrap();
        let cases = list_request_kinds_to_measure_cost_of();
        let requests: Vec<(&str, &str)> =
            cases.iter().flat_map(|case| &case.requests).map(|(method, path, _)| (*method, path.as_str())).collect();
        for (path, operations) in description["paths"].as_object().unwrap() {
            // A path that has a parameter is one with anything in its place.
            let begin = path.split('{').next().unwrap();
            let is_file = path == "/" || path.ends_with(".css") || path.ends_with(".js") || path.ends_with(".svg");
            for method in operations.as_object().unwrap().keys().map(|method| method.to_uppercase()) {
                let is_measured = requests.iter().any(|(of, to)| {
                    let to = to.split('?').next().unwrap();
                    *of == method && if begin == path.as_str() { to == path } else { to.starts_with(begin) }
                });
                assert!(is_measured || is_file || path == "/v1/stop", "{method} {path} has no case");
            }
        }
    }
}

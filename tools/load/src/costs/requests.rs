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
pub fn list_cases() -> Vec<Case> {
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
    ]
}

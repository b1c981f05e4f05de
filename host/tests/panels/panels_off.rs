//! What tolerances do to a plan, over HTTP and on the page: the numbers and words of `era plan --spread`, beside touches and stops; refusals; an end
//! by whoever asked.

use crate::support;
use era::scene::{EXAMPLE_BAR, STARTING_PLATE};
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use support::Daemon;
use support::browser::{Browser, browser_or_skip, save};
use support::program::{build_era_command, run_command};

const PATH: &str = "/v1/tolerances";

/// What `era plan` says of a touch of the example plate, on the levels that the tests' daemon plans with.
fn planned(more: &[&str]) -> String {
    let place = tempfile::tempdir().unwrap();
    let scene = place.path().join("plate.toml");
    std::fs::write(&scene, STARTING_PLATE).unwrap();
    let mut command = build_era_command();
    command.args(["plan", "--at", "480,640", "--intensity-g", "0.3", "--accuracy", "fast", "--no-cache", "--scene"]);
    let output = run_command(command.arg(&scene).args(more));
    assert!(output.is_success(), "{}", output.error);
    output.out
}

/// What is known of the newest look once it has ended.
fn ended(daemon: &Daemon) -> Value {
    let deadline = Instant::now() + Duration::from_secs(300);
    loop {
        let (status, told) = daemon.get(PATH);
        assert_eq!(status, 200, "{told}");
        if told["stage"] != "running" {
            return told;
        }
        assert!(Instant::now() < deadline, "{told}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn http_reports_what_the_command_line_reports() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (_, none) = daemon.get(PATH);
    assert_eq!(
        (&none["stage"], &none["id"], &none["plan"], &none["off"]),
        (&json!("none"), &json!(0), &json!(null), &json!(null))
    );
    let touch = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.3});
    let (status, _, begun) = daemon.post(PATH, &touch.to_string());
    assert_eq!(
        (status, &begun["stage"], &begun["id"], &begun["all"]),
        (200, &json!("running"), &json!(1), &json!(128)),
        "{begun}"
    );
    let told = ended(&daemon);
    assert_eq!(
        (&told["stage"], &told["there"], &told["problem"]),
        (&json!("done"), &json!(128), &json!(null)),
        "{told}"
    );
    let command: Value = serde_json::from_str(&planned(&["--spread", "--json"])).unwrap();
    for key in ["drives", "error_bound"] {
        assert_eq!(told["plan"][key], command[key], "{key}");
    }
    assert_eq!(told["off"], command["off"]);
    // What the bound knows nothing of is thousands of times the bound: 1 dB is 12 %.
    assert!(told["plan"]["error_bound"].as_f64().unwrap() < 1e-2, "{told}");
    assert!(told["off"]["most_db"].as_f64().unwrap() - told["off"]["least_db"].as_f64().unwrap() > 2.0, "{told}");
    let words = told["words"].as_str().unwrap();
    // The option's former name is taken as well.
    assert!(planned(&["--tolerances"]).trim_end().ends_with(&format!("\n{words}")), "{words}");
    assert!(daemon.sim.last_drives_received_at().is_none(), "nothing was driven");
}

/// With a scene or moves, even none, the plan is the preview's; what may not be off is not off.
#[test]
fn a_previews_plan_is_looked_at_with_the_tolerances_that_are_given() {
    let daemon = Daemon::start(EXAMPLE_BAR);
    let moves = json!({"actuator[1]": {"x_mm": 60.0}});
    let preview = json!({"x_px": 700, "y_px": 1, "intensity_g": 0.2, "scene": EXAMPLE_BAR, "moves": moves});
    let (status, _, previewed) = daemon.post("/v1/preview", &preview.to_string());
    assert_eq!(status, 200, "{previewed}");
    let mut request = preview;
    request["tolerances"] = json!({"springs": 0, "youngs_modulus": 0.0, "places_mm": 0, "thickness": 0.03});
    let (status, _, begun) = daemon.post(PATH, &request.to_string());
    assert_eq!(status, 200, "{begun}");
    let told = ended(&daemon);
    assert_eq!(told["plan"]["drives"], previewed["plan"]["drives"]);
    let off = &told["off"];
    assert_eq!(off["tolerances"], json!({"springs": 0.0, "youngs_modulus": 0.0, "thickness": 0.03, "places_mm": 0.0}));
    for own in off["of"].as_array().unwrap() {
        let is_off = own["most_db"].as_f64().unwrap() - own["least_db"].as_f64().unwrap() > 0.0;
        assert_eq!(is_off, own["what"] == "thickness", "{own}");
    }
    // What is usual where nothing is given.
    let (_, _, begun) = daemon.post(PATH, &json!({"x_px": 700, "y_px": 1, "moves": {}}).to_string());
    assert_eq!((&begun["stage"], &begun["id"], &begun["off"]), (&json!("running"), &json!(2), &json!(null)));
    let told = ended(&daemon);
    assert_eq!(
        told["off"]["tolerances"],
        json!({"springs": 0.2, "youngs_modulus": 0.1, "thickness": 0.05, "places_mm": 1.0})
    );
}

#[test]
fn what_cannot_be_looked_at_is_refused_with_its_field() {
    let daemon = Daemon::start(STARTING_PLATE);
    let wide = STARTING_PLATE.replace("thickness_mm = 2.0", "thickness_mm = 0.02");
    let idle = STARTING_PLATE.split("# Two ERAs").next().unwrap();
    let cases = [
        (json!({"tolerances": {"springs": 0.95}}), 400, "out-of-range", "tolerances.springs", "0 to 0.9"),
        (json!({"tolerances": {"youngs_modulus": -0.1}}), 400, "out-of-range", "tolerances.youngs_modulus", "0 to 0.9"),
        (json!({"tolerances": {"thickness": 1}}), 400, "out-of-range", "tolerances.thickness", "0 to 0.9"),
        (json!({"tolerances": {"places_mm": 100.5}}), 400, "out-of-range", "tolerances.places_mm", "0 to 100"),
        (json!({"tolerances": {"places_mm": "1"}}), 400, "bad-body", "tolerances.places_mm", "a number"),
        (json!({"tolerances": {"screws": 1}}), 400, "bad-body", "tolerances.screws", ""),
        (json!({"tolerances": [0.2]}), 400, "bad-body", "tolerances[0]", "an object"),
        (json!({"x_px": 1921}), 400, "out-of-range", "x_px", "0 to 1920"),
        (json!({"x_px": 1921, "moves": {}}), 400, "out-of-range", "x_px", "0 to 1920"),
        (json!({"intensity_g": 1001}), 400, "out-of-range", "intensity_g", "0 to 1000"),
        (json!({"intensity_g": -1, "moves": {}}), 400, "out-of-range", "intensity_g", "0 to 1000"),
        (json!({"moves": {"support[1]": {"x_mm": 400}}}), 400, "bad-scene", "support[1].x_mm", "0 to 300"),
        (json!({"scene": "no TOML"}), 400, "bad-scene", "", ""),
        (json!({"scene": wide}), 422, "too-large", "surface", "at most"),
        (json!({"scene": idle}), 422, "no-plan", "", ""),
    ];
    for (more, status, kind, field, allowed) in cases {
        let mut body = json!({"x_px": 960, "y_px": 640});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let (told, _, problem) = daemon.post(PATH, &body.to_string());
        assert_eq!((told, &problem["type"]), (status, &json!(format!("urn:era:problem:{kind}"))), "{more}: {problem}");
        assert_eq!(problem["field"].as_str().unwrap_or_default(), field, "{problem}");
        assert!(problem["allowed"].as_str().unwrap_or_default().starts_with(allowed), "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains(field), "{problem}");
    }
    let (_, told) = daemon.get(PATH);
    assert_eq!((&told["stage"], &told["id"]), (&json!("none"), &json!(0)), "nothing has begun");
}

/// One piece of work at a time, which touches and stops do not wait for; it ends soon after it is told to, and leaves room for another.
#[test]
fn one_at_a_time_beside_touches_until_it_is_stopped() {
    let daemon = Daemon::start(STARTING_PLATE);
    let touch = r#"{"x_px": 480, "y_px": 640, "intensity_g": 0.3}"#;
    assert_eq!(daemon.post(PATH, touch).0, 200);
    let study =
        json!({"study": "version = 1\nname = \"t\"\nscene = \"s\"\n[[variable]]\nkey = \"surface.thickness_mm\"\n\
        from = 2.0\nto = 4.0\n[[wish]]\nfigure = \"weakest_g\"\n[method]\nway = \"sobol\"\ndesigns = 1500\n"})
        .to_string();
    for (path, body) in [(PATH, touch), ("/v1/study", &study)] {
        let (status, _, problem) = daemon.post(path, body);
        assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:tolerances-run")), "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains("POST /v1/tolerances/stop"), "{problem}");
    }
    assert_eq!(daemon.post("/v1/touch", touch).0, 200);
    assert_eq!(daemon.post("/v1/stop", "").0, 200);
    assert_eq!(daemon.get(PATH).1["stage"], "running", "a stop of the device is none of it");
    assert_eq!(daemon.post("/v1/tolerances/stop", "").0, 200);
    let told = ended(&daemon);
    assert_eq!(
        (&told["stage"], &told["off"], &told["words"]),
        (&json!("stopped"), &json!(null), &json!(null)),
        "{told}"
    );
    assert!(told["there"].as_u64().unwrap() < 128, "{told}");
    assert_eq!(daemon.post("/v1/study", &study).0, 200);
    let (status, _, problem) = daemon.post(PATH, touch);
    assert_eq!((status, &problem["type"]), (409, &json!("urn:era:problem:study-runs")), "{problem}");
    assert_eq!(daemon.post("/v1/study/stop", "").0, 200);
}

/// Design mode shows the range beside the bound, in the command line's words; another plan ends a look, and so does its button.
#[test]
fn the_page_shows_the_range_beside_the_bound() {
    const READY: &str =
        "document.body.dataset.preview === 'ready' && !document.querySelector('#tolerances-run').disabled";
    const RUNS: &str =
        "document.body.dataset.tolerances === 'running' && !document.querySelector('#tolerances-progress').hidden";
    const STATUS: &str = "document.querySelector('#tolerances-status').textContent";
    const RANGE: &str = "document.querySelector('#off-g').textContent";
    const RUN: &str = "document.querySelector('#tolerances-run').click()";
    let Some(program) = browser_or_skip() else { return };
    let daemon = Daemon::start(STARTING_PLATE);
    let mut browser = Browser::start(program, 1280, 1000);
    browser.open(&daemon.url);
    browser.wait_for("document.body?.dataset.state === 'safe'");
    assert_eq!(browser.value("document.querySelector('#tolerances').hidden"), true, "for what is previewed");
    browser.value("document.querySelector('#design').click()");
    browser.wait_for(READY);
    assert_eq!(browser.value(RANGE), "not computed");
    browser.value(RUN);
    browser.wait_for(RUNS);
    ended(&daemon);
    browser.wait_for("document.body.dataset.tolerances === 'done'");
    let (_, told) = daemon.get(PATH);
    assert_eq!(browser.value(STATUS), told["words"], "{told}");
    let shown: Value = serde_json::from_str(browser.value("document.body.dataset.plan").as_str().unwrap()).unwrap();
    // A browser writes 268 where the daemon writes 268.0.
    let forces = |plan: &Value| -> Vec<Option<f64>> {
        plan["drives"].as_array().unwrap().iter().map(|drive| drive["force_n"].as_f64()).collect()
    };
    assert_eq!(forces(&shown), forces(&told["plan"]), "the plan that is shown");
    let peak = |end: &str| {
        let part = 10_f64.powf(told["off"][end].as_f64().unwrap() / 20.0);
        shown["predicted"]["target_peak_g"].as_f64().unwrap() * part
    };
    assert_eq!(browser.value(RANGE), format!("{:.3} to {:.3} g", peak("least_db"), peak("most_db")));
    save(&mut browser, "tolerances");

    // Another plan: what was found was not of it.
    let elsewhere = browser.point("#panel", 0.6, 0.8);
    browser.click(elsewhere);
    browser.wait_for(&format!("{RANGE} === 'not computed' && {STATUS} === ''"));
    browser.wait_for(READY);
    browser.value(RUN);
    browser.wait_for(RUNS);
    let elsewhere = browser.point("#panel", 0.5, 0.25);
    browser.click(elsewhere);
    browser.wait_for(&format!("{STATUS} === 'Stopped because the plan has changed.'"));
    assert_eq!(ended(&daemon)["stage"], "stopped");
    browser.wait_for(READY);
    browser.value(RUN);
    browser.wait_for(RUNS);
    save(&mut browser, "tolerances-running");
    browser.value("document.querySelector('#tolerances-stop').click()");
    browser.wait_for(&format!("{STATUS} === 'Stopped.' && document.querySelector('#tolerances-stop').hidden"));
    // What is refused is told.
    assert_eq!(daemon.post(PATH, &json!({"x_px": 480, "y_px": 640, "moves": {}}).to_string()).0, 200);
    browser.value(RUN);
    browser.wait_for(&format!("{STATUS}.includes('POST /v1/tolerances/stop ends it')"));
    daemon.post("/v1/tolerances/stop", "");
    assert!(daemon.sim.last_drives_received_at().is_none(), "nothing was driven");
}

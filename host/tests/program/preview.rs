//! Previews of changed scenes: what a plan would do, without driving; bad scenes are told; newer requests go first.

use crate::support;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use support::Daemon;

#[test]
fn a_preview_of_the_unchanged_scene_is_its_plan() {
    let daemon = Daemon::start(STARTING_PLATE);
    let touch = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.4}).to_string();
    let (status, _, preview) = daemon.post("/v1/preview", &touch);
    assert_eq!(status, 200, "{preview}");
    assert_eq!(preview["scene_toml"], STARTING_PLATE);
    let bound = preview["plan"]["error_bound"].as_f64().unwrap();
    assert!(bound > 0.0 && bound < preview["tolerance"].as_f64().unwrap(), "{bound}");
    assert_eq!(preview["plan"]["drives"].as_array().unwrap().len(), 2);
    assert!((preview["plan"]["predicted"]["target_peak_g"].as_f64().unwrap() - 0.4).abs() < 1e-9);
    assert!(preview["elapsed_ms"].as_f64().unwrap() > 0.0);

    let (_, field) = daemon.get("/v1/field?x_px=480&y_px=640&intensity_g=0.4");
    for key in ["nx", "ny", "x_mm", "y_mm"] {
        assert_eq!(preview["field"][key], field[key], "{key}");
    }
    // The daemon's own model is a step finer: the same frequencies, and a field that differs by less than the tolerance.
    let values = |field: &Value| -> Vec<f64> {
        field["peak_g"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let top = field["max_g"].as_f64().unwrap();
    let (here, there) = (values(&preview["field"]), values(&field));
    assert!(here.len() == there.len() && there.len() > 1000);
    for (a, b) in here.iter().zip(&there) {
        assert!((a - b).abs() < 1e-2 * top, "{a} and {b} of {top}");
    }
    // The same scene as text in the request is the same.
    let whole = json!({"x_px": 480, "y_px": 640, "intensity_g": 0.4, "scene": STARTING_PLATE}).to_string();
    let (status, _, again) = daemon.post("/v1/preview", &whole);
    assert_eq!((status, &again["field"]), (200, &preview["field"]));
    assert_eq!(daemon.state()["device"]["state"], "safe", "nothing was driven");
    assert!(daemon.sim.last_drives_received_at().is_none(), "nothing was sent either");
    assert!(daemon.state()["plan"].is_null());
}

#[test]
fn a_moved_support_is_the_scene_written_with_it_there() {
    let daemon = Daemon::start(STARTING_PLATE);
    let ask = |body: Value| daemon.post("/v1/preview", &body.to_string());
    let (_, _, still) = ask(json!({"x_px": 960, "y_px": 640}));
    let moves = json!({"support[1]": {"x_mm": 40.0, "y_mm": 30.5}, "actuator[2]": {"x_mm": 210.0}});
    let (status, _, moved) = ask(json!({"x_px": 960, "y_px": 640, "moves": moves}));
    assert_eq!(status, 200, "{moved}");
    assert_ne!(moved["field"]["peak_g"], still["field"]["peak_g"]);
    let text = moved["scene_toml"].as_str().unwrap();
    let wanted = STARTING_PLATE.replacen("x_mm = 0.0\ny_mm = 0.0", "x_mm = 40.0\ny_mm = 30.5", 1).replacen(
        "x_mm = 225.0",
        "x_mm = 210.0",
        1,
    );
    assert_eq!(text, wanted, "comments and everything else stay");
    let (_, _, written) = ask(json!({"x_px": 960, "y_px": 640, "scene": text}));
    assert_eq!(written["field"], moved["field"]);
    // The daemon's own scene has not changed.
    let (_, scene) = daemon.get("/v1/scene");
    assert_eq!((&scene["supports"][0]["x_mm"], &scene["actuators"][1]["x_mm"]), (&json!(0.0), &json!(225.0)));
    assert!(daemon.sim.last_drives_received_at().is_none());
    // Drives go on while previews are made, and a preview does not touch them.
    daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#);
    let before = daemon.wait_for(|state| state["device"]["state"] == "running")["plan"].clone();
    assert_eq!(ask(json!({"x_px": 960, "y_px": 640})).0, 200);
    assert_eq!(daemon.state()["plan"], before);
    daemon.post("/v1/stop", "");
}

#[test]
fn a_scene_that_cannot_be_previewed_is_reported_with_its_field() {
    let daemon = Daemon::start(STARTING_PLATE);
    let line = |piece: &str| STARTING_PLATE.lines().position(|line| line.starts_with(piece)).unwrap() + 1;
    let ask = |more: Value| {
        let mut body = json!({"x_px": 960, "y_px": 640});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let (status, kind, problem) = daemon.post("/v1/preview", &body.to_string());
        assert_eq!(kind, "application/problem+json", "{problem}");
        (status, problem)
    };
    let fields = |problem: &Value| {
        let kind = problem["type"].as_str().unwrap().rsplit(':').next().unwrap().to_owned();
        (kind, problem["field"].clone(), problem["value"].clone(), problem["allowed"].clone())
    };

    let (status, problem) = ask(json!({"moves": {"support[2]": {"x_mm": 400.0, "y_mm": -1.5}}}));
    assert_eq!(status, 400);
    assert_eq!(
        fields(&problem),
        ("bad-scene".into(), json!("support[2].x_mm"), json!(400), json!("0 to 300")),
        "{problem}"
    );
    assert_eq!(problem["mistakes"].as_array().unwrap().len(), 2);
    assert!(problem["mistakes"][1]["detail"].as_str().unwrap().contains("support[2].y_mm is -1.5"));

    let thin = STARTING_PLATE.replace("thickness_mm = 2.0", "thickness_mm = \"thin\"");
    let (_, problem) = ask(json!({"scene": thin}));
    assert_eq!(fields(&problem).1, "surface.thickness_mm");
    assert_eq!((&problem["value"], &problem["line"]), (&json!("thin"), &json!(line("thickness_mm"))));
    let (_, problem) = ask(json!({"scene": "version = 1\nname = "}));
    assert_eq!((&problem["type"], &problem["line"]), (&json!("urn:era:problem:bad-scene"), &json!(2)), "{problem}");

    let (status, problem) = ask(json!({"moves": {"support[5]": {"x_mm": 1.0}}}));
    assert_eq!(status, 400);
    assert!(fields(&problem).3.as_str().unwrap().contains("support[1] to support[4]"), "{problem}");
    let (_, problem) = ask(json!({"moves": {"support[1]": {"x": 1.0}}}));
    assert!(problem["detail"].as_str().unwrap().contains("x_mm"), "{problem}");
    let (_, problem) = ask(json!({"x_px": 1921}));
    assert_eq!(fields(&problem).1, "x_px");

    // More than plans are made for, and more than a preview takes the time for.
    let actuator = STARTING_PLATE.split("[[actuator]]").nth(1).unwrap();
    let many = (0..3).fold(STARTING_PLATE.to_owned(), |text, i| {
        text + "\n[[actuator]]" + &actuator.replace("\"left\"", &format!("\"more {i}\""))
    });
    let (status, problem) = ask(json!({"scene": many}));
    assert_eq!(status, 422);
    assert_eq!(fields(&problem), ("too-large".into(), json!("actuator"), json!(5), json!("at most 4 actuators")));
    let fifth = many.lines().enumerate().filter(|(_, line)| *line == "[[actuator]]").nth(4).unwrap().0 + 1;
    assert_eq!(problem["line"], fifth);
    let held = format!("{STARTING_PLATE}\n{}", "[[mass]]\nx_mm = 1\ny_mm = 1\nmass_g = 1\n".repeat(27));
    let (status, problem) = ask(json!({"scene": held}));
    assert!(status == 422 && problem["value"] == 33, "{problem}");
    let foil = STARTING_PLATE.replace("thickness_mm = 2.0", "thickness_mm = 0.02");
    let (status, problem) = ask(json!({"scene": foil}));
    assert!(status == 422 && problem["field"] == "surface" && problem["value"].as_f64().unwrap() > 6000.0, "{problem}");
    let (status, problem) = ask(json!({"scene": "#".repeat(66_000)}));
    assert!(status == 422 && problem["field"] == "scene", "{problem}");
    let (status, problem) = ask(json!({"scene": "#".repeat(200_000)}));
    assert!(status == 413 && problem["type"] == "urn:era:problem:bad-body", "{problem}");
    let idle = STARTING_PLATE.split("# Two ERAs").next().unwrap();
    let (status, problem) = ask(json!({"scene": idle}));
    assert!(status == 422 && problem["type"] == "urn:era:problem:no-plan", "{problem}");
    assert_eq!(daemon.state()["device"]["state"], "safe");
}

/// Which of several comes first is chance, but each has a preview or was superseded, and one that is alone has one.
#[test]
fn previews_at_once_are_answered_or_superseded() {
    let daemon = Daemon::start(STARTING_PLATE);
    let answers: Vec<(u16, Value)> = std::thread::scope(|threads| {
        let ask = |i: usize| {
            let (status, _, answer) =
                daemon.post("/v1/preview", &json!({"x_px": 100 * (i + 1), "y_px": 640}).to_string());
            (status, answer)
        };
        let asking: Vec<_> = (0..8).map(|i| threads.spawn(move || ask(i))).collect();
        asking.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    for (status, answer) in &answers {
        assert!(*status == 200 || *status == 409 && answer["type"] == "urn:era:problem:superseded", "{answer}");
    }
    let good = answers.iter().filter(|(status, _)| *status == 200).count();
    assert!(good >= 1);
    assert_eq!(daemon.post("/v1/preview", r#"{"x_px": 5, "y_px": 5}"#).0, 200);
    let metrics = daemon.get_text("/metrics");
    for line in [format!("era_previews_total {}", good + 1), format!("era_preview_failures_total {}", 8 - good)] {
        assert!(metrics.lines().any(|found| found == line), "{line} in {metrics}");
    }
    assert_eq!(daemon.state()["device"]["state"], "safe");
}

/// A study of the thickness, with further sections and a method.
fn study(sections: &str, method: &str) -> String {
    let text = format!(
        "version = 1\nname = \"thickness\"\nscene = \"plate.toml\"\n\
         [[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 2.0\nto = 4.0\n\
         [[wish]]\nfigure = \"sag_um\"\nforce_n = 10\n{sections}[method]\n{method}\n"
    );
    json!({ "study": text }).to_string()
}

/// What a study of a grid comes to.
fn studied(daemon: &Daemon, sections: &str) -> Value {
    let (status, _, begun) = daemon.post("/v1/study", &study(sections, "way = \"grid\""));
    assert_eq!(status, 200, "{begun}");
    loop {
        let (_, told) = daemon.get("/v1/study");
        match told["stage"].as_str() {
            Some("running" | "finishing") => std::thread::sleep(std::time::Duration::from_millis(50)),
            _ => return told,
        }
    }
}

/// No two ERAs are 5 m apart on a plate of 300 mm: nothing is said of limits, which nobody has set.
#[test]
fn a_study_in_which_all_designs_fail_reports_why() {
    let daemon = Daemon::start(STARTING_PLATE);
    let done = studied(&daemon, "[[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 5000\n");
    assert_eq!((&done["stage"], &done["best"], &done["nearest"]), (&json!("done"), &json!([]), &Value::Null), "{done}");
    let reason = done["all_failed"].as_str().unwrap();
    assert!(reason.contains("5000"), "{reason}");
}

/// The lightest of the plates, the one of 2 mm, weighs 324 g and 20 g of ERAs more; none is within 100 g, and it comes nearest.
#[test]
fn a_study_in_which_no_design_keeps_the_limits_reports_the_nearest() {
    let daemon = Daemon::start(STARTING_PLATE);
    let done = studied(&daemon, "[[limit]]\nfigure = \"mass_g\"\nmost = 100\n");
    assert_eq!((&done["stage"], &done["best"]), (&json!("done"), &json!([])), "{done}");
    assert_eq!((&done["nearest"]["design"], &done["all_failed"]), (&json!(1), &Value::Null), "{done}");
    let reason = done["nearest"]["reason"].as_str().unwrap();
    assert!(reason.contains("mass_g is 344.0") && reason.contains("at most 100"), "{reason}");
}

/// What is too much for a daemon that has touches to answer is refused with what is allowed, and nothing begins.
#[test]
fn studies_that_are_too_much_are_refused() {
    let daemon = Daemon::start(STARTING_PLATE);
    for (method, field) in [
        ("way = \"grid\"\nlook = \"thorough\"", "method.look"),
        ("way = \"sobol\"\ndesigns = 1000000", "method.designs"),
        ("way = \"sobol\"\ndesigns = 8\nfinalists = 100", "method.finalists"),
    ] {
        let (status, _, problem) = daemon.post("/v1/study", &study("", method));
        assert!((400..500).contains(&status), "{field}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(field), "{problem}");
    }
    assert_eq!(daemon.get("/v1/study").1["stage"], "none");
}

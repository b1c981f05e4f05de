//! What one client can make the daemon do: its cost is told before it is begun, it ends with whoever asked, and it is in nobody's way.

use crate::raw::{connect, post, post_with};
use crate::support::{Daemon, served::Served};
use era::daemon::Access;
use era::device::session::policy::SessionPolicy;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// No time of the daemon's, but what a hang would be: what is refused at once takes some ms, and builds may run beside the tests.
const PATIENCE: Duration = Duration::from_secs(20);
const STUDY: &str =
    "version = 1\nname = \"costs\"\nscene = \"plate.toml\"\n[[wish]]\nfigure = \"sag_um\"\nforce_n = 1\n";

/// A scene that is nearly as much as previews take: 20 attachments, some two seconds of work.
fn heavy_scene() -> String {
    let masses = (0..14).map(|i| {
        let (x, y) = (15 + 10 * (i % 27), 20 + (37 * i) % 160);
        format!("[[mass]]\nx_mm = {x}\ny_mm = {y}\nmass_g = 1\n")
    });
    format!("{STARTING_PLATE}\n{}", masses.collect::<String>())
}

fn preview(scene: &str) -> String {
    json!({"x_px": 960, "y_px": 640, "scene": scene}).to_string()
}

fn patches(count: usize, table: &str) -> String {
    let one = |i: usize| {
        let (x, y) = (i % 20 * 14, i / 20 * 9);
        format!("[[{table}]]\nx_mm = {x}\ny_mm = {y}\nlength_mm = 8\nwidth_mm = 5\n")
    };
    format!("{STARTING_PLATE}\n{}", (0..count).map(one).collect::<String>())
}

/// Asks, and how long the answer takes.
fn refused(daemon: &Daemon, path: &str, body: &str) -> (u16, Value) {
    let asked = Instant::now();
    let (status, _, problem) = daemon.post(path, body);
    let took = asked.elapsed();
    assert!(took < PATIENCE, "{took:?} for {problem}");
    (status, problem)
}

/// Peak of the memory of this process in MB.
fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.split_whitespace().next().unwrap().parse::<u64>().unwrap() / 1024
}

/// Every count that a scene or a study may have is looked at before anything is made of it.
#[test]
fn what_costs_too_much_is_refused_before_it_costs_anything() {
    let daemon = Daemon::start(STARTING_PLATE);
    let large = |text: &str, of: &str, to: &str| text.replacen(of, to, 1);
    let long = large(STARTING_PLATE, "length_mm = 300", "length_mm = 10000");
    let foil = large(STARTING_PLATE, "thickness_mm = 2.0", "thickness_mm = 0.02");
    let layers = "[[layer]]\nthickness_mm = 0.1\n".repeat(400);
    let scenes = [
        (patches(200, "patch"), "patches"),
        (patches(600, "patch"), "patches"),
        (patches(300, "cutout"), "cut-outs"),
        (long, "modes"),
        (foil, "unknowns"),
        (format!("{STARTING_PLATE}\n{layers}"), "layers"),
        (format!("{STARTING_PLATE}\n{}", "[[mass]]\nx_mm = 1\ny_mm = 1\nmass_g = 1\n".repeat(900)), "supports"),
    ];
    for (scene, what) in &scenes {
        let whole = json!({"x_px": 9, "y_px": 9, "scene": scene});
        let study = json!({"study": STUDY, "scene": scene});
        for (path, body) in [("/v1/preview", &whole), ("/v1/tolerances", &whole), ("/v1/study", &study)] {
            let (status, problem) = refused(&daemon, path, &body.to_string());
            assert!(status == 422 && problem["detail"].as_str().unwrap().contains(what), "{path}, {what}: {problem}");
        }
    }
    let number =
        |more: &str| format!("{STUDY}[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1.5\nto = 3\n{more}");
    let off = "[[uncertain]]\nkey = \"support.*.stiffness_n_per_m\"\npart = 0.1\n";
    let many = |entry: &str, count: usize| format!("{STUDY}{}", entry.repeat(count));
    let before = peak_mb();
    for (study, field) in [
        (number("[method]\nway = \"latin_hypercube\"\ndesigns = 10000000\n"), "method.designs"),
        (number("[method]\nway = \"sobol\"\ndesigns = 100000000\n"), "method.designs"),
        (number("step = 0.000002\n[method]\nway = \"grid\"\n"), "method.designs"),
        (
            number("[method]\nway = \"evolution\"\ndesigns = 100000000\npopulation = 10000\nruns = 10000\n"),
            "method.designs",
        ),
        (number(&format!("{off}[method]\ndesigns = 2\nsamples = 10000\n")), "method.designs"),
        (number("[method]\ndesigns = 2\nfinalists = 6\n"), "method.finalists"),
        (many("[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1\nto = 2\n", 100), "study"),
        (many("[[limit]]\nfigure = \"mass_g\"\nmost = 900\n", 100), "study"),
        (number(&format!("[[apart]]\nplaces = [{}]\ndistance_mm = 1\n", "\"support.*\", ".repeat(600))), "study"),
        (
            format!(
                "{STUDY}[[variable]]\nkey = \"support.*.stiffness_n_per_m\"\nvalues = [\"{}\"]\n",
                "x".repeat(40_000)
            ),
            "study",
        ),
    ] {
        let (status, problem) = refused(&daemon, "/v1/study", &json!({ "study": study }).to_string());
        assert_eq!((status, &problem["field"]), (422, &json!(field)), "{problem}");
    }
    let grown = peak_mb().saturating_sub(before);
    assert!(grown < 250, "{grown} MB");
}

/// A study with 60 variables, of which no value is on the surface.
fn study_whose_values_are_all_refused() -> String {
    let wrong =
        |i: usize| format!("[[variable]]\nname = \"v{i}\"\nkey = \"support[1].x_mm\"\nfrom = 1000\nto = 2000\n");
    format!("{STUDY}{}", (0..60).map(wrong).collect::<String>())
}

/// The longest time that this takes is bounded by the bytes that are read, not by the number of variables.
#[test]
fn variables_whose_values_are_all_refused_cost_little() {
    let daemon = Daemon::start(STARTING_PLATE);
    let study = study_whose_values_are_all_refused();
    let (status, problem) = refused(&daemon, "/v1/study", &json!({ "study": study }).to_string());
    assert!(status == 400 && problem["detail"].as_str().unwrap().contains("variable[1]"), "{problem}");
}

/// A design may be larger than the scene of its study.
#[test]
fn a_design_that_is_too_large_fails_and_costs_nothing() {
    let daemon = Daemon::start(STARTING_PLATE);
    let text =
        format!("{STUDY}[[variable]]\nkey = \"surface.length_mm\"\nvalues = [9000, 9500]\n[method]\nway = \"grid\"\n");
    assert_eq!(daemon.post("/v1/study", &json!({ "study": text }).to_string()).0, 200);
    let deadline = Instant::now() + PATIENCE;
    let told = loop {
        let (_, told) = daemon.get("/v1/study");
        if !["running", "finishing"].contains(&told["stage"].as_str().unwrap()) {
            break told;
        }
        assert!(Instant::now() < deadline, "{told}");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(told["all_failed"].as_str().is_some_and(|reason| reason.contains("modes")), "{told}");
}

/// The figure of a metric.
fn metric(daemon: &Daemon, name: &str) -> f64 {
    let text = daemon.get_text("/metrics");
    text.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok()).unwrap()
}

/// Whoever hangs up has no work left behind, and a slot is free as soon as what was begun can end.
#[test]
fn work_ends_with_its_sender() {
    let daemon = Daemon::start(STARTING_PLATE);
    let scene = heavy_scene();
    assert_eq!(daemon.post("/v1/preview", &preview(&scene)).0, 200, "it is taken");
    for round in 1..=4 {
        let mut stream = connect(&daemon);
        stream.write_all(post("/v1/preview", &preview(&scene)).as_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(50));
        drop(stream);
        // Before its time is over, which would end it as well.
        let deadline = Instant::now() + Duration::from_secs(8);
        while metric(&daemon, "era_preview_failures_total") < f64::from(round) {
            assert!(Instant::now() < deadline, "round {round} goes on without its sender");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    assert_eq!(daemon.post("/v1/preview", &preview(STARTING_PLATE)).0, 200);
    // A study whose sender has gone before it was begun is not.
    let mut stream = connect(&daemon);
    let study = format!("{STUDY}{}", "# a long file\n".repeat(3000));
    stream.write_all(post("/v1/study", &json!({ "study": study }).to_string()).as_bytes()).unwrap();
    drop(stream);
    // Its place is free again, whatever became of it.
    let deadline = Instant::now() + PATIENCE;
    while daemon.post("/v1/study", &json!({"study": "no TOML ="}).to_string()).0 != 400 {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// One client's wrong studies, as many as there may be, do not keep another's study or tolerance study from the one place for them.
#[test]
fn wrong_studies_of_a_client_take_no_place_from_others() {
    let daemon = Daemon::start(STARTING_PLATE);
    let study = study_whose_values_are_all_refused();
    let request =
        post_with("/v1/study", "User-Agent: greedy\r\nConnection: close\r\n", &json!({ "study": study }).to_string());
    let good = json!({"study": format!("{STUDY}[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1.9\nto = 2.1\n[method]\ndesigns = 500\n")});
    let over = AtomicBool::new(false);
    let has_ended = |path: &str| daemon.get(path).1["stage"] != "running";
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    let mut stream = connect(&daemon);
                    let mut answer = Vec::new();
                    let asked = stream.write_all(request.as_bytes());
                    let _ = asked.and_then(|()| stream.read_to_end(&mut answer));
                }
            });
        }
        let wait = |is_so: &dyn Fn() -> bool| {
            let deadline = Instant::now() + PATIENCE;
            while !is_so() && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        let touch = json!({"x_px": 960, "y_px": 640, "intensity_g": 0.2});
        let mut answers = Vec::new();
        for (path, body) in [("/v1/study", &good), ("/v1/tolerances", &touch)].repeat(3) {
            answers.push((path, daemon.post(path, &body.to_string())));
            daemon.post(&format!("{path}/stop"), "");
            wait(&|| has_ended(path));
        }
        over.store(true, Ordering::Relaxed);
        for (path, (status, _, answer)) in answers {
            assert_eq!(status, 200, "{path}: {answer}");
        }
    });
}

/// One client's previews, as many and as large as may be, do not keep another's from being computed.
#[test]
fn a_client_has_one_preview_at_a_time_and_others_have_theirs_beside_it() {
    let daemon = Daemon::start(STARTING_PLATE);
    let scene = heavy_scene();
    let mut greedy: Vec<_> = (0..6).map(|_| connect(&daemon)).collect();
    for stream in &mut greedy {
        let request = post_with("/v1/preview", "User-Agent: greedy\r\n", &preview(&scene));
        stream.write_all(request.as_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(daemon.post("/v1/preview", &preview(STARTING_PLATE)).0, 200);
    // Of the six the first is computed and the last waits; the others were superseded by it.
    let mut statuses: Vec<String> = Vec::new();
    for mut stream in greedy {
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        statuses.push(String::from_utf8_lossy(&answer[9..]).into_owned());
    }
    assert_eq!(statuses.iter().filter(|status| *status == "409").count(), 4, "{statuses:?}");
}

/// A touch of the example plate with an effect file of these events.
fn effect_body(events: &str) -> String {
    format!(r#"{{"x_px": 960, "y_px": 640, "intensity_g": 0.2, "effect": {{"version": 1, "events": [{events}]}}}}"#)
}

fn repeat_events(count: usize, event: impl Fn(usize) -> String) -> String {
    (0..count).map(event).collect::<Vec<_>>().join(",")
}

/// Files of many places, of long envelopes and of nothing at all take neither memory nor a touch's place, and end with their senders.
#[test]
fn effect_files_cost_little_and_end_with_their_senders() {
    let daemon = Daemon::start(STARTING_PLATE);
    let weak = |i: usize| {
        let dx_mm = 0.001 * i as f64;
        format!(r#"{{"primitive": "buzz", "time_ms": 0, "duration_ms": 30000, "intensity": 0.01, "dx_mm": {dx_mm}}}"#)
    };
    let before = peak_mb();
    for (events, status, words) in [
        (repeat_events(1000, weak), 400, "places"),
        (repeat_events(170_000, |_| "{}".into()), 400, "events[0].primitive is missing"),
        (format!(r#"{{"events": [{}], "repeat": {{"count": 1000}}}}"#, "{\"events\": []}"), 400, "event"),
    ] {
        for _ in 0..3 {
            let (code, problem) = refused(&daemon, "/v1/effects", &effect_body(&events));
            assert!(code == status && problem["detail"].as_str().unwrap().contains(words), "{words}: {problem}");
        }
    }
    let grown = peak_mb().saturating_sub(before);
    assert!(grown < 250, "{grown} MB");
    // A hundred clicks at places of their own: seconds of work, which has an end, and beside which touches have their places.
    let tick = |i: usize| format!(r#"{{"primitive": "tick", "time_ms": {}, "dx_mm": {}}}"#, 100 * i, i / 2);
    let many = effect_body(&repeat_events(100, tick));
    let mut greedy: Vec<_> = (0..2).map(|_| connect(&daemon)).collect();
    for (i, stream) in greedy.iter_mut().enumerate() {
        stream.write_all(post_with("/v1/effects", &format!("User-Agent: {i}\r\n"), &many).as_bytes()).unwrap();
    }
    let touch = json!({"x_px": 500, "y_px": 640, "intensity_g": 0.1}).to_string();
    for _ in 0..5 {
        assert_eq!(refused(&daemon, "/v1/touch", &touch).0, 200);
    }
    drop(greedy);
    let (status, _, answer) = daemon.post("/v1/effects", &effect_body(r#"{"primitive": "click"}"#));
    assert_eq!(status, 200, "{answer}");
}

/// A stop is carried out, and the daemon ends, whatever is computed.
#[test]
fn neither_a_stop_nor_the_end_waits_for_what_is_computed() {
    let app = Arc::new(Daemon::app(STARTING_PLATE, Access::default()));
    let (mut served, url) = Served::at_a_port(&app, None);
    let daemon = Daemon { url, sim: Default::default(), background: None };
    // First, so that the previews have just begun when the stops are sent.
    daemon.wait_for(|state| state["device"]["connected"] == true);
    let scene = heavy_scene();
    let mut streams: Vec<_> = (0..2).map(|_| connect(&daemon)).collect();
    for (i, stream) in streams.iter_mut().enumerate() {
        let request = post_with("/v1/preview", &format!("User-Agent: {i}\r\n"), &preview(&scene));
        stream.write_all(request.as_bytes()).unwrap();
    }
    let mut times = Vec::new();
    for _ in 0..20 {
        let asked = Instant::now();
        assert_eq!(daemon.post("/v1/stop", "").0, 200);
        times.push(asked.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!("stops beside two large previews: median {:.1} ms, longest {:.1} ms", times[10], times[19]);
    // All of them were answered before either preview was.
    for stream in &streams {
        stream.set_nonblocking(true).unwrap();
        let found = stream.peek(&mut [0]).map_err(|error| error.kind());
        assert!(matches!(found, Err(std::io::ErrorKind::WouldBlock)), "a preview ended first: {found:?}");
        stream.set_nonblocking(false).unwrap();
    }
    served.ends();
    let ending = Instant::now();
    drop(served);
    println!("the daemon's end beside them: {:.0} ms", ending.elapsed().as_secs_f64() * 1e3);
    assert!(ending.elapsed() < Duration::from_secs(8));
}

fn named(daemon: &Daemon, headers: &[(&str, &str)], path: &str, body: Option<&str>) -> (u16, Value) {
    let mut request = ureq::http::Request::builder()
        .method(if body.is_some() { "POST" } else { "GET" })
        .uri(format!("{}{path}", daemon.url));
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let agent = Daemon::agent();
    let mut answer = match body {
        Some(text) => agent.run(request.body(text.to_owned()).unwrap()),
        None => agent.run(request.body(()).unwrap()),
    }
    .unwrap();
    (answer.status().as_u16(), answer.body_mut().read_json().unwrap())
}

/// What one client calls its request is no name of another's, with tokens and without.
#[test]
fn names_of_requests_are_their_clients_own() {
    let touch = |x: u32| json!({"x_px": x, "y_px": 640, "intensity_g": 0.1}).to_string();
    let secrets = ["a".repeat(22), "b".repeat(22)];
    let access = Access {
        tokens: Access::parse_tokens(&format!("touch {}\ntouch {}\n", secrets[0], secrets[1])).unwrap(),
        ..Access::default()
    };
    let daemon = Daemon::start_guarded(STARTING_PLATE, access);
    let bearer: Vec<String> = secrets.iter().map(|secret| format!("Bearer {secret}")).collect();
    let with = |token: usize, agent: &'static str| [("Authorization", bearer[token].as_str()), ("User-Agent", agent)];
    // Whatever becomes of it: on a busy machine the device may be late.
    let tap = |headers: [(&str, &str); 2], x: u32| {
        let named_tap = [headers[0], headers[1], ("X-Request-Id", "tap-1")];
        named(&daemon, &named_tap, "/v1/touch", Some(&touch(x)));
    };
    let known = |headers: [(&str, &str); 2]| named(&daemon, &headers, "/v1/requests/tap-1", None);
    tap(with(0, "one"), 500);
    assert_eq!(known(with(1, "one")).0, 404);
    tap(with(1, "one"), 900);
    // The same token finds it from another program.
    let (first, second) = (known(with(0, "two")), known(with(1, "one")));
    assert_eq!((first.0, second.0), (200, 200));
    assert!(first.1["id"].as_u64() < second.1["id"].as_u64(), "{first:?} {second:?}");
    let open = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), Access::default());
    let agents = [[("User-Agent", "one")], [("User-Agent", "two")]];
    let named_tap = [agents[0][0], ("X-Request-Id", "tap-1")];
    named(&open, &named_tap, "/v1/touch", Some(&touch(500)));
    assert_eq!(named(&open, &agents[0], "/v1/requests/tap-1", None).0, 200);
    assert_eq!(named(&open, &agents[1], "/v1/requests/tap-1", None).0, 404);
}

//! The page in a real browser: load, click, see plan and map, stop. Needs Chromium; without it the test says so and
//! counts as passed only where `ERA_NO_BROWSER` is set.

mod support;

use era::daemon::Access;
use era::device::sim::SimKnobs;
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::net::TcpListener;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use support::Daemon;
use support::browser::{Browser, browser_or_skip, save, serve_page};

/// Browsers take turns, as between six of them the simulated board's link would often get no processor for a while.
static TURN: Mutex<()> = Mutex::new(());
/// How often a test may begin anew because the machine stood still for longer than the board accepts.
const STALLS: usize = 3;

/// Runs `test` with a browser on the page of a fresh daemon; saves a picture if `ERA_SCREENSHOTS` names a folder.
///
/// A simulated board that hears nothing for a quarter of a second switches everything off, as a real one does, and on a busy
/// machine that comes without anyone's fault. A test that failed and finds that fault latched begins anew; a daemon that
/// really falls silent does so every time.
fn with_page(width: u32, height: u32, test: impl Fn(&Daemon, &mut Browser)) {
    let Some(program) = browser_or_skip() else { return };
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    for stalls in 0.. {
        let daemon = Daemon::start(STARTING_PLATE);
        let mut browser = Browser::start(program, width, height);
        browser.open(&daemon.url);
        browser.wait_for("document.body?.dataset.state === 'safe'");
        let Err(failure) = catch_unwind(AssertUnwindSafe(|| test(&daemon, &mut browser))) else { return };
        if daemon.state()["device"]["fault"]["name"] != "host-silent" || stalls == STALLS {
            resume_unwind(failure);
        }
        eprintln!("the machine stood still for longer than the dead-man time: once more");
    }
}

#[test]
fn a_click_shows_plan_and_map_and_stop_stops() {
    with_page(1280, 800, |daemon, browser| {
        assert_eq!(browser.value("document.body.dataset.plan"), "");
        assert_eq!(browser.value("document.querySelector('#heat').dataset.maxG"), "0");
        let first = browser.point("#panel", 0.3, 0.4);
        browser.mouse("mousePressed", first);
        browser.wait_for("document.body.dataset.plan !== '' && document.body.dataset.state === 'running'");
        browser.wait_for("Number(document.querySelector('#heat').dataset.maxG) > 0");
        browser.wait_for("parseFloat(document.querySelector('#measured-g').textContent) > 0.1");
        save(browser, "wide");
        let drives = browser.value("JSON.parse(document.body.dataset.plan).drives.length");
        assert_eq!(drives, 2, "both ERAs");
        let rows = browser.value("document.querySelectorAll('#plan-table tbody tr').length");
        assert_eq!(rows, 2);
        let running = daemon.wait_for(|state| state["device"]["state"] == "running");
        assert!(running["telemetry"]["channels"].as_array().unwrap().iter().all(|channel| channel["active"] == true));
        let target = browser.value("JSON.parse(document.body.dataset.plan).target_mm");
        assert!((target[0].as_f64().unwrap() - 90.0).abs() < 1.0 && (target[1].as_f64().unwrap() - 80.0).abs() < 1.0);
        browser.mouse("mouseReleased", first);

        // Another place gives another plan and another map.
        let before = browser.value("[document.body.dataset.plan, document.querySelector('#heat').dataset.planId]");
        let second = browser.point("#panel", 0.8, 0.7);
        browser.mouse("mousePressed", second);
        browser.wait_for(&format!(
            "document.body.dataset.plan !== {} && document.querySelector('#heat').dataset.planId !== {}",
            before[0], before[1]
        ));
        daemon.wait_for(|state| state["device"]["state"] == "running");

        // Stop is there whatever else is on the page, and the device is off, with the finger still down.
        let stop = browser.point("#stop", 0.5, 0.5);
        browser.value("document.querySelector('#stop').click()");
        daemon.wait_for(|state| state["device"]["state"] == "safe" && state["plan"].is_null());
        browser.wait_for("document.body.dataset.state === 'safe' && document.body.dataset.plan === ''");
        assert!(stop.0 < 1280.0 && stop.1 < 800.0, "on the screen");
    });
}

#[test]
fn a_touch_plays_the_chosen_effect_once() {
    with_page(1280, 900, |daemon, browser| {
        let button = browser.point("#effects [value=click]", 0.5, 0.5);
        browser.click(button);
        assert_eq!(browser.value("document.querySelector('#effects :checked').value"), "click");
        let place = browser.point("#panel", 0.4, 0.5);
        browser.mouse("mousePressed", place);
        browser.wait_for("document.querySelector('#effect-told').textContent.startsWith('click: ')");
        // The finger is still down, and it is over.
        daemon.wait_for(|state| state["device"]["state"] == "armed" && state["plan"].is_null());
        save(browser, "effect");
        browser.mouse("mouseReleased", place);
        let hold = browser.point("#effects label", 0.5, 0.5);
        browser.click(hold);
        browser.mouse("mousePressed", place);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        browser.wait_for("document.querySelector('#effect-told').hidden");
        browser.mouse("mouseReleased", place);
    });
}

/// A click that its limits keep below the wish: the bold figure is what the click does, as the answer to a request has it; what was measured of it
/// stands beside it and stays; and while the board is armed the page does not say that it is off.
#[test]
fn a_clicks_own_figures_are_shown_and_that_the_rails_are_up() {
    with_page(1280, 900, |daemon, browser| {
        let text = |id: &str| format!("document.querySelector('#{id}').textContent");
        let figure = |browser: &mut Browser, id: &str| -> f64 {
            let told = browser.value(&text(id));
            told.as_str().unwrap().split(' ').next().unwrap().parse().unwrap_or(f64::NAN)
        };
        let body = r#"{"x_px": 256, "y_px": 1088, "intensity_g": 3.0, "effect": "click"}"#;
        let (status, _, answer) = daemon.post("/v1/touch", body);
        assert_eq!(status, 200, "{answer}");
        let peak = answer["device"]["effect"]["predicted"]["peak_g"].as_f64().unwrap();
        assert!(peak < 2.7, "it is limited: {peak} g");
        browser.wait_for(&format!("{}.startsWith('click: ')", text("effect-told")));
        daemon.wait_for(|state| state["device"]["state"] == "armed" && state["plan"].is_null());
        browser.wait_for(&format!("Math.abs(parseFloat({}) - {peak}) < 1e-3", text("target-g")));
        let limited = browser.value(&text("limited"));
        let limit = answer["limited_by"].as_str().unwrap();
        assert!(limited.as_str().unwrap().contains(limit), "{limited}");
        browser.wait_for(&format!("{}.startsWith('last plan, device armed, rails up (')", text("mode")));
        let id = &answer["plan_id"];
        let state = daemon.state();
        let measured = state["telemetry"]["touch_peaks"].as_array().unwrap().iter().find(|own| own["plan_id"] == *id);
        let measured = measured.unwrap()["peak_g"].as_f64().unwrap();
        assert!(measured > 0.5 * peak, "{measured} g of {peak} g");
        browser.wait_for(&format!("Math.abs(parseFloat({}) - {measured}) < 1e-3", text("measured-g")));
        save(browser, "click-limited");
        // In design mode nothing of it is left: another panel is shown.
        browser.value("document.querySelector('#design').click()");
        browser.wait_for("document.querySelector('#effect-told').hidden");
        browser.wait_for(READY);
        assert_eq!(browser.value(&text("measured-g")), "–");
        assert_eq!(browser.value("document.querySelector('#effect-told').hidden"), true);
        let shown: f64 = figure(browser, "target-g");
        let preview = browser.value("JSON.parse(document.body.dataset.plan).predicted.target_peak_g");
        assert!((shown - preview.as_f64().unwrap()).abs() < 1e-3, "{shown}, {preview}");
        // Nor is a click previewed, so none can be chosen.
        assert_eq!(browser.value("document.querySelector('#effects').disabled"), true);
        save(browser, "click-then-design");
        // Entering it has stopped the device: everything is off, and so it says afterwards.
        daemon.wait_for(|state| state["device"]["state"] == "safe");
        browser.value("document.querySelector('#design').click()");
        browser.wait_for(&format!("{} === ''", text("mode")));
        assert_eq!(browser.value("document.querySelector('#effects').disabled"), false);
    });
}

#[test]
fn a_phone_with_two_fingers_and_a_real_tap_on_stop() {
    with_page(390, 844, |daemon, browser| {
        let fingers = [browser.point("#panel", 0.25, 0.5), browser.point("#panel", 0.75, 0.5)];
        browser.touch("touchStart", &fingers);
        browser.wait_for(
            "document.body.dataset.plan !== '' && JSON.parse(document.body.dataset.plan).targets.length === 2",
        );
        daemon
            .wait_for(|state| state["device"]["state"] == "running" && state["touches"].as_array().unwrap().len() == 2);
        browser.wait_for("document.body.dataset.state === 'running'");
        save(browser, "phone");
        let wide = browser.value("document.documentElement.scrollWidth <= window.innerWidth");
        assert_eq!(wide, true, "nothing sticks out to the side");
        browser.touch("touchEnd", &[]);
        let stop = browser.point("#stop", 0.5, 0.5);
        let hit = browser.value(&format!("document.elementFromPoint({}, {}).id", stop.0, stop.1));
        assert_eq!(hit, "stop", "nothing covers the button");
        browser.click(stop);
        daemon.wait_for(|state| state["device"]["state"] == "safe");
    });
}

#[test]
fn the_keyboard_alone_touches_and_stops() {
    with_page(1280, 800, |daemon, browser| {
        browser.value("document.querySelector('#panel').focus()");
        for _ in 0..3 {
            browser.key("keyDown", "ArrowRight");
            browser.key("keyUp", "ArrowRight");
        }
        browser.key("keyDown", "Enter");
        daemon.wait_for(|state| state["device"]["state"] == "running");
        browser.wait_for("JSON.parse(document.body.dataset.plan || '{}').target_mm?.[0] > 160");
        browser.key("keyDown", "Escape");
        daemon.wait_for(|state| state["device"]["state"] == "safe");
    });
}

/// The numbers of the map that is shown, to be compared.
const MAP: &str = "document.querySelector('#heat').toDataURL()";
const READY: &str = "document.body.dataset.preview === 'ready'";
/// Whether the scene's first support is drawn where the file has it: in the corner.
const IN_THE_CORNER: &str = "document.querySelector('#overlay .support').getAttribute('d').startsWith('M0 ')";

#[test]
fn a_dragged_support_changes_the_map_and_nothing_is_driven() {
    with_page(1280, 800, |daemon, browser| {
        let button = browser.point("#design", 0.5, 0.5);
        browser.click(button);
        browser.wait_for(READY);
        let original = browser.value(MAP);
        let status = browser.value("document.querySelector('#preview-status').textContent");
        for piece in ["Preview, nothing is driven", "error at most ±", " ms"] {
            assert!(status.as_str().unwrap().contains(piece), "{status} lacks {piece}");
        }
        assert_eq!(browser.value("document.querySelectorAll('.handle').length"), 6);
        assert_eq!(browser.value(IN_THE_CORNER), true);

        // Taken beside its middle, in steps as a hand makes them; the map follows before the hand lets go.
        let handle = "[data-name=\"support[1]\"]";
        let (x, y) = browser.point(handle, 0.6, 0.7);
        browser.mouse("mousePressed", (x, y));
        for step in 1..=8 {
            browser.mouse("mouseMoved", (x + 12.0 * f64::from(step), y + 9.0 * f64::from(step)));
        }
        browser.wait_for(&format!("{READY} && {MAP} !== {original}"));
        browser.mouse("mouseReleased", (x + 96.0, y + 72.0));
        assert_eq!(browser.value(IN_THE_CORNER), false);
        save(browser, "design");
        // To the pixel where the hand left it, to the tenth of a millimetre in the scene's text.
        let mm_per_px = browser.value("300 / document.querySelector('#panel').getBoundingClientRect().width");
        browser.wait_for(READY);
        let copy = browser.point("#copy", 0.5, 0.5);
        browser.click(copy);
        browser.wait_for("!document.querySelector('#scene-toml').hidden");
        let text = browser.value("document.querySelector('#scene-toml').value");
        let scene = era::scene::Scene::parse("copied", text.as_str().unwrap()).unwrap();
        let original_scene = era::scene::Scene::parse("example", STARTING_PLATE).unwrap();
        let (moved, mm_per_px) = (scene.supports[0], mm_per_px.as_f64().unwrap());
        for (place_m, pixels) in [(moved.x_m, 96.0), (moved.y_m, 72.0)] {
            assert!((place_m * 1e3 - pixels * mm_per_px).abs() < 0.1, "{place_m} m after {pixels} px");
        }
        assert_eq!(scene.supports[1..], original_scene.supports[1..]);
        assert_eq!(scene.actuators, original_scene.actuators);

        let reset = browser.point("#reset", 0.5, 0.5);
        browser.click(reset);
        browser.wait_for(&format!("{READY} && {IN_THE_CORNER} && {MAP} === {original}"));

        // A click beside the attachments moves the previewed touch.
        let place = browser.point("#panel", 0.6, 0.8);
        browser.click(place);
        browser
            .wait_for(&format!("{READY} && Math.abs(JSON.parse(document.body.dataset.plan).target_mm[0] - 180) < 1"));
        assert_ne!(browser.value(MAP), original);
        assert_eq!(browser.value("document.querySelector('#mode').textContent"), "preview, nothing is driven");
        assert!(daemon.sim.last_drives_received_at().is_none(), "nothing was driven");
        assert_eq!(daemon.state()["device"]["state"], "safe");

        // Back again: the page drives as before.
        browser.click(button);
        browser.wait_for("document.querySelectorAll('.handle').length === 0 && document.body.dataset.plan === ''");
        browser.mouse("mousePressed", place);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        // Entering it stops what is driven, with the finger still down.
        browser.value("document.querySelector('#design').click()");
        daemon.wait_for(|state| state["device"]["state"] == "safe" && state["plan"].is_null());
        browser.wait_for(READY);
        browser.mouse("mouseReleased", place);
    });
}

#[test]
fn design_by_keyboard_and_by_finger_with_stop_in_reach() {
    with_page(390, 844, |daemon, browser| {
        browser.value("document.querySelector('#design').click()");
        browser.wait_for(READY);
        let place = |browser: &mut Browser, name: &str| {
            let label = browser.value(&format!("document.querySelector('[data-name=\"{name}\"]').ariaLabel"));
            label.as_str().unwrap().split(". ").next().unwrap().to_owned()
        };
        assert_eq!(place(browser, "actuator[1]"), "actuator left at 75, 100 mm");
        let before = browser.value(MAP);
        browser.value("document.querySelector('[data-name=\"actuator[1]\"]').focus()");
        for key in ["ArrowRight", "ArrowRight", "ArrowUp"] {
            browser.key("keyDown", key);
            browser.key("keyUp", key);
        }
        assert_eq!(place(browser, "actuator[1]"), "actuator left at 77, 99 mm");
        browser.wait_for(&format!("{READY} && {MAP} !== {before}"));

        // A finger; beyond the surface it stays at the edge.
        let before = browser.value(MAP);
        let (x, y) = browser.point("[data-name=\"support[4]\"]", 0.5, 0.5);
        browser.touch("touchStart", &[(x, y)]);
        browser.touch("touchMove", &[(x - 40.0, y + 30.0)]);
        browser.touch("touchMove", &[(x - 80.0, y + 60.0)]);
        browser.touch("touchEnd", &[]);
        let moved = place(browser, "support[4]");
        assert!(moved.ends_with(", 200 mm") && moved != "support 4 at 300, 200 mm", "{moved}");
        browser.wait_for(&format!("{READY} && {MAP} !== {before}"));
        save(browser, "design-phone");
        let wide = browser.value("document.documentElement.scrollWidth");
        assert!(wide.as_f64().unwrap() <= 390.0, "{wide} px: nothing sticks out to the side");

        // Something else drives: the page says so, and its stop stops it.
        daemon.post("/v1/touch", r#"{"x_px": 300, "y_px": 900, "duration_ms": 9000}"#);
        browser.wait_for("document.querySelector('#mode').textContent.includes('another client drives the device')");
        let stop = browser.point("#stop", 0.5, 0.5);
        let hit = browser.value(&format!("document.elementFromPoint({}, {}).id", stop.0, stop.1));
        assert_eq!(hit, "stop", "nothing covers the button");
        browser.click(stop);
        daemon.wait_for(|state| state["device"]["state"] == "safe");
        assert_eq!(browser.value("document.body.dataset.design"), "on");
    });
}

/// A board that was away is armed by a person, at the page say.
#[test]
fn a_board_that_was_away_is_armed_by_the_pages_button() {
    with_page(1280, 800, |daemon, browser| {
        assert_eq!(browser.value("document.querySelector('#fault').hidden"), true);
        daemon.sim.request_restart();
        browser.wait_for("document.querySelector('#fault button')?.textContent === 'Arm the device'");
        let told = browser.value("document.querySelector('#fault').textContent");
        assert!(told.as_str().unwrap().contains("had an outage"), "{told}");
        // Until then a touch does nothing, and its error is gone with what it was about.
        let place = browser.point("#panel", 0.4, 0.5);
        browser.click(place);
        browser.wait_for("document.querySelector('#error-text').textContent.includes('waits to be armed')");
        assert!(daemon.sim.last_drives_received_at().is_none());
        browser.value("document.querySelector('#fault button').click()");
        daemon.wait_for(|state| state["device"]["state"] == "armed");
        browser.wait_for("document.querySelector('#fault').hidden && document.querySelector('#error').hidden");
        browser.mouse("mousePressed", place);
        daemon.wait_for(|state| state["device"]["state"] == "running");
        browser.mouse("mouseReleased", place);
    });
}

#[test]
fn a_lost_daemon_is_shown() {
    let Some(program) = browser_or_skip() else { return };
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let daemon = Daemon::start(STARTING_PLATE);
    let mut browser = Browser::start(program, 800, 600);
    browser.open(&daemon.url);
    browser.wait_for("document.querySelector('#connection')?.className.includes('good')");
    drop(daemon);
    browser.wait_for("document.querySelector('#connection').textContent.includes('lost')");
    assert_eq!(browser.value("document.body.dataset.state"), "unknown");
}

/// A daemon that asks for a token serves its page to everybody; what the page does needs the token behind its address.
#[test]
fn a_page_brings_its_token() {
    let Some(program) = browser_or_skip() else { return };
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let secret = "T".repeat(32);
    let tokens = Access::parse_tokens(&format!("touch {secret}")).unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    let mut browser = Browser::start(program, 1280, 800);
    browser.open(&format!("{}/#token={secret}", daemon.url));
    browser.wait_for("document.body?.dataset.state === 'safe'");
    let mut without = Browser::start(program, 1280, 800);
    without.open(&daemon.url);
    // What is wrong is said, and not that the connection was lost.
    without.wait_for("document.querySelector('#connection')?.textContent === 'this daemon requires a token'");
    without.wait_for("document.querySelector('#error-text').textContent.includes('#token=TOKEN')");
    assert_ne!(without.value("document.body.dataset.state ?? ''"), "safe");
    // A token put behind the address of the open page counts, also with what a file has around it.
    without.value(&format!("location.hash = 'token=%EF%BB%BF{secret}%0D%0A'"));
    without.wait_for("document.body?.dataset.state === 'safe'");
    // A fault wants a token of another role than this one.
    without.value(&format!(
        "fetch('/v1/touch', {{method: 'POST', headers: {{authorization: 'Bearer {secret}'}},
         body: '{{\"x_px\": 300, \"y_px\": 900, \"duration_ms\": 5000}}'}}) && 0"
    ));
    without.wait_for("document.body.dataset.state === 'running'");
    daemon.sim.set_knobs(SimKnobs { silent: true, ..SimKnobs::default() });
    std::thread::sleep(std::time::Duration::from_millis(600));
    daemon.sim.set_knobs(SimKnobs::default());
    without.wait_for("document.querySelector('#fault button') !== null");
    without.value("document.querySelector('#fault button').click()");
    without.wait_for("document.querySelector('#error-text').textContent.includes('this request needs the role arm')");
    let told = without.value("document.querySelector('#error-text').textContent");
    assert!(told.as_str().unwrap().starts_with("The fault is not cleared: "), "{told}");
}

/// Another page, of an origin that is allowed, posts a touch and opens the socket; of one that is not, neither.
#[test]
fn a_page_of_an_allowed_origin_talks_to_the_daemon() {
    let Some(program) = browser_or_skip() else { return };
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let [mine, other] = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    let [mine_url, other_url] = [&mine, &other].map(|page| format!("http://{}", page.local_addr().unwrap()));
    let access = Access { origins: vec![Access::parse_origin(&mine_url).unwrap()], ..Access::default() };
    let daemon = Daemon::start_with(STARTING_PLATE, era::device::session::policy::SessionPolicy::default(), access);
    let html = format!(
        r#"<!doctype html><body><script>
        const say = (name, text) => (document.body.dataset[name] = text);
        fetch("{url}/v1/touch", {{
          method: "POST", headers: {{ "content-type": "application/json" }},
          body: JSON.stringify({{ x_px: 300, y_px: 900, duration_ms: 100 }}),
        }}).then((answer) => answer.json()).then((plan) => say("touch", String(plan.drives.length)), () => say("touch", "refused"));
        const socket = new WebSocket("{ws}/v1/live");
        socket.onmessage = (message) => say("socket", JSON.parse(message.data).type);
        socket.onclose = () => document.body.dataset.socket ?? say("socket", "refused");
        </script></body>"#,
        url = daemon.url,
        ws = daemon.url.replace("http", "ws")
    );
    for page in [mine, other] {
        serve_page(page, html.clone());
    }
    for (url, touch, is_let_in) in [(mine_url, "2", true), (other_url, "refused", false)] {
        let mut browser = Browser::start(program, 800, 600);
        browser.open(&url);
        browser.wait_for("document.body?.dataset.touch !== undefined && document.body.dataset.socket !== undefined");
        assert_eq!(browser.value("document.body.dataset.touch"), touch, "{url}");
        let socket = browser.value("document.body.dataset.socket");
        assert_eq!(socket != "refused", is_let_in, "{url}: {socket}");
    }
}

/// A page from elsewhere that puts the daemon's into a frame, to have it clicked there, shows nothing of it; another page in the
/// same place is shown.
#[test]
fn another_page_cannot_show_the_daemons_in_a_frame() {
    let Some(program) = browser_or_skip() else { return };
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let daemon = Daemon::start(STARTING_PLATE);
    let harmless = serve_page(TcpListener::bind("127.0.0.1:0").unwrap(), "<!doctype html><body>harmless</body>".into());
    for (framed, is_shown) in [(&harmless, true), (&daemon.url, false)] {
        let html = format!(
            r#"<!doctype html><body>
            <iframe src="{framed}/" width="780" height="500" onload="document.body.dataset.loaded = '1'"></iframe></body>"#
        );
        let framing = serve_page(TcpListener::bind("127.0.0.1:0").unwrap(), html);
        let mut browser = Browser::start(program, 800, 600);
        browser.open(&framing);
        // An error page in the frame is loaded, too.
        browser.wait_for("document.body?.dataset.loaded === '1'");
        let frame = browser.call("Page.getFrameTree", json!({}))["frameTree"]["childFrames"][0]["frame"].clone();
        let named = |key: &str| frame[key].as_str().unwrap_or_default().starts_with(framed.as_str());
        assert_eq!([named("url"), named("unreachableUrl")], [is_shown, !is_shown], "{framed}: {frame}");
        let middle = browser.point("iframe", 0.5, 0.5);
        browser.click(middle);
        save(&mut browser, if is_shown { "framed-harmless" } else { "framed" });
    }
    let state = daemon.state();
    assert!(state["plan"].is_null() && state["touches"].as_array().is_none_or(Vec::is_empty), "{state}");
}

/// A study runs beside the page, its best design opens, and so do files; nothing is driven.
#[test]
fn a_study_is_run_and_its_best_designs_are_opened() {
    with_page(1280, 800, |daemon, browser| {
        browser.value("document.querySelector('#design').click()");
        browser.wait_for(READY);
        browser.value("document.querySelector('#study-run').click()");
        browser.wait_for(
            "document.body.dataset.study === 'running' && document.querySelector('#study-progress').value > 0",
        );
        save(browser, "study-running");
        // Some seconds, and many more on a busy machine.
        for _ in 0..200 {
            if browser.value("document.body.dataset.study") == "done" {
                break;
            }
            std::thread::sleep(Duration::from_millis(500));
        }
        browser.wait_for("document.body.dataset.study === 'done'");
        let words = browser.value("[...document.querySelectorAll('#designs button')].map((own) => own.textContent)");
        let peaks: Vec<f64> = (words.as_array().unwrap().iter())
            .map(|words| words.as_str().unwrap().rsplit(' ').next().unwrap().parse().unwrap())
            .collect();
        assert_eq!(peaks.len(), 4, "{words}: as it is, and three");
        assert!(peaks[1] > 2.0 * peaks[0], "{words}");
        // The study is the daemon's: its answer has the scene that the page then shows.
        let (status, study) = daemon.get("/v1/study");
        assert_eq!(status, 200);
        let best = study["best"][0]["scene_toml"].as_str().unwrap();
        let best = era::scene::Scene::parse("best", best).unwrap();
        browser.value("document.querySelectorAll('#designs button')[1].click()");
        browser.wait_for(&format!(
            "{READY} && Math.abs(parseFloat(document.querySelector('.handle.actuator').style.left) - {}) < 0.01",
            100.0 * best.actuators[0].x_m / 0.3
        ));
        save(browser, "study-best");
        // A file, as the command line writes it, of another size; and back to the daemon's own scene.
        let file =
            STARTING_PLATE.replace("length_mm = 300.0", "length_mm = 411.0").replace("x_mm = 300.0", "x_mm = 411.0");
        let file = json!(format!("# Best 1 of the study \"a\": design 7.\n# weakest_g = 0.9\n\n{file}"));
        browser.value(&format!(
            "(() => {{ const input = document.querySelector('#open-scenes'), data = new DataTransfer(); \
             data.items.add(new File([{file}], 'best-1.toml')); input.files = data.files; \
             input.dispatchEvent(new Event('change')); }})()"
        ));
        browser.wait_for(&format!(
            "{READY} && document.querySelector('#overlay').getAttribute('viewBox') === '0 0 411 200' && \
             document.querySelector('#designs').textContent === 'best-1.toml, weakest_g = 0.9'"
        ));
        browser.value("document.querySelector('#reset').click()");
        browser.wait_for(&format!(
            "{READY} && document.querySelector('#overlay').getAttribute('viewBox') === '0 0 300 200'"
        ));
        assert!(daemon.sim.last_drives_received_at().is_none(), "nothing was driven");
    });
}

//! The page in a real browser: load, click, see plan and map, stop. Needs Chromium; without it the test says so and
//! counts as passed only where `ERA_NO_BROWSER` is set.

mod support;

use era::scene::EXAMPLE_PLATE;
use support::Daemon;
use support::browser::{Browser, program};

/// Runs `test` with a browser on the page of a fresh daemon; saves a picture if `ERA_SCREENSHOTS` names a folder.
fn with_page(width: u32, height: u32, test: impl FnOnce(&Daemon, &mut Browser)) {
    let Some(program) = program() else {
        assert!(std::env::var_os("ERA_NO_BROWSER").is_some(), "no Chromium here: install it, or set ERA_NO_BROWSER");
        eprintln!("skipped: no Chromium here and ERA_NO_BROWSER is set");
        return;
    };
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let mut browser = Browser::start(program, width, height);
    browser.open(&daemon.url);
    browser.wait_for("document.body?.dataset.state === 'safe'");
    test(&daemon, &mut browser);
}

fn save(browser: &mut Browser, name: &str) {
    if let Some(folder) = std::env::var_os("ERA_SCREENSHOTS") {
        let path = std::path::Path::new(&folder).join(format!("{name}.png.base64"));
        std::fs::write(path, browser.screenshot()).unwrap();
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

#[test]
fn a_lost_daemon_is_shown() {
    let Some(program) = program() else { return };
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let mut browser = Browser::start(program, 800, 600);
    browser.open(&daemon.url);
    browser.wait_for("document.querySelector('#connection')?.className.includes('good')");
    drop(daemon);
    browser.wait_for("document.querySelector('#connection').textContent.includes('lost')");
    assert_eq!(browser.value("document.body.dataset.state"), "unknown");
}

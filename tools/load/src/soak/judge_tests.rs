//! The judge judged: boards and daemons that do what they must not, each by a mistake that is planted, and a verdict that names it.
//!
//! Why so many lines for a judge: a soak that finds nothing is worth what its judge would have found, and no soak of a sound daemon
//! shows that. Each test plants one mistake and goes the whole way from the board or the daemon to the words of the verdict; all
//! tests of this crate take 8 s. Thresholds alone are tested beside them (`growth.rs`, `report.rs`).

use super::faults::{Faults, check_high_voltage_stays_off_returning_zero_time, wait_until};
use super::ledger::{FaultKind, FaultLedger};
use super::tally::Tally;
use super::world::SoakState;
use super::{Options, clients, make_report, run_until_end_with_faults_if_enabled_failing_if_daemon_ends};
use crate::board::{Bench, Direction, PANEL_SCENE, build_plan_table_of_simulated_panel};
use crate::daemon::{Daemon, DaemonSetup, MemoryThreadsAndHandles};
use era::daemon::{Access, App, BackgroundDaemon};
use era::device::session::policy::SessionPolicy;
use era::device::sim::{Mistakes, SimKnobs};
use era::device::{OpenDevice, Target};
use fastrand::Rng;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, OnceLock};
use std::time::{Duration, Instant};

/// How long a board may take to do what it must not.
const WAIT: Duration = Duration::from_secs(20);
/// As strong as it can be, where the masses travel farthest.
const STRONG: &str = r#"{"x_px": 480, "y_px": 960, "duration_ms": 3000, "intensity_g": 1000}"#;

static OPTIONS: LazyLock<Options> =
    LazyLock::new(|| Options { minutes: 1.0, faults: false, seed: 1, program: PathBuf::new() });

/// A program that says it serves at `address`, and then does `shell_commands`.
fn write_fake_daemon(folder: &Path, address: SocketAddr, shell_commands: &str) -> PathBuf {
    let path = folder.join("era");
    let script =
        // Descriptors that whoever runs the tests has left open are none that a daemon opens.
        format!(
            "#!/bin/sh\nexec 3<&- 4<&- 5<&- 6<&- 7<&- 8<&- 9<&-\n\
             echo 'ready after 0 s: open http://{address}, nothing else' >&2\n{shell_commands}\n"
        );
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

fn make_daemon_setup(folder: &Path, program: PathBuf) -> DaemonSetup {
    let [device, socket, cache] = ["board", "era.sock", "cache"].map(|name| folder.join(name));
    DaemonSetup { program, device, socket, cache, clears_silence: true }
}

/// The verdict on a board with `mistakes` after `act`, behind a daemon in this process. What is started as the daemon only sleeps.
fn verdict_on_board(mistakes: Mistakes, act: impl FnOnce(&mut Faults<'_>)) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("board");
    let bench = Bench::new(path.clone()).unwrap();
    let device =
        OpenDevice::new_unconnected_for_serial_or_auto(&Target::Serial(path.to_str().unwrap().into())).unwrap();
    let policy = SessionPolicy { clears_silence: true, arms_after_outage: true, ..SessionPolicy::default() };
    let app = App::start_session_with_policy_and_access(
        build_plan_table_of_simulated_panel().unwrap(),
        device,
        PANEL_SCENE.into(),
        policy,
        Access::default(),
    )
    .unwrap();
    let background = BackgroundDaemon::start(app).unwrap();
    run_and_find_failures(folder.path(), bench, background.address(), |faults| {
        faults.daemon.await_device().unwrap();
        faults.sim_control().set_knobs(SimKnobs { mistakes, ..SimKnobs::default() });
        act(faults);
    })
}

/// The verdict on what serves at `address` after `act`, with a board that it does not know.
fn verdict_on_address(address: SocketAddr, act: impl FnOnce(&mut Faults<'_>)) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path().join("board")).unwrap();
    run_and_find_failures(folder.path(), bench, address, act)
}

fn run_and_find_failures(
    folder: &Path,
    bench: Bench,
    address: SocketAddr,
    act: impl FnOnce(&mut Faults<'_>),
) -> Option<String> {
    let plan = make_daemon_setup(folder, write_fake_daemon(folder, address, "exec sleep 600"));
    let daemon = Daemon::start(&plan).unwrap();
    let (world, at_start) = (SoakState::default(), daemon.read_memory_threads_and_handles_or_zeros());
    world.set_serving_daemon_incrementing_generation(daemon.address);
    let (ledger, random) = (FaultLedger::default(), Rng::with_seed(1));
    let mut faults =
        Faults { world: &world, bench, plan, daemon, ledger, random, outages: 0, faults: 0, before_kill: None };
    act(&mut faults);
    let report = make_report(&OPTIONS, Instant::now(), at_start, Tally::with_one_driven_touch(), faults);
    println!("{}", report.format_table());
    report.find_failures()
}

fn send_strong_touch(faults: &mut Faults<'_>) {
    let answer = faults.new_http_client().post("/v1/touch", STRONG).unwrap();
    assert_eq!(answer.status, 200, "{}", answer.parse_json_body_or_null());
}

#[test]
fn a_sound_board_at_full_strength_is_no_reason_for_a_verdict() {
    let sound = verdict_on_board(Mistakes::default(), |faults| {
        send_strong_touch(faults);
        std::thread::sleep(Duration::from_secs(1));
        let travel = faults.sim_control().observations_since_start().travel_part;
        assert!(travel > 0.02, "it was not driven: {travel}");
    });
    assert_eq!(sound, None);
}

#[test]
fn both_electrodes_on_together_are_named() {
    let mistakes = Mistakes { both_electrodes: true, ..Mistakes::default() };
    let found = verdict_on_board(mistakes, |faults| {
        faults.post_touches_until_high_voltage_is_on().unwrap();
        wait_until(WAIT, || faults.sim_control().observations_since_start().overlaps > 0)
            .expect("they are on together");
    });
    assert!(found.as_ref().is_some_and(|found| found.contains("both electrodes of an ERA were on")), "{found:?}");
}

#[test]
fn travel_beyond_the_limit_is_named() {
    let mistakes = Mistakes { rails_percent: Some(300), ..Mistakes::default() };
    let found = verdict_on_board(mistakes, |faults| {
        send_strong_touch(faults);
        wait_until(WAIT, || faults.sim_control().observations_since_start().travel_part > 0.5)
            .expect("it is pulled in");
    });
    assert!(found.as_ref().is_some_and(|found| found.contains("a mass travelled")), "{found:?}");
}

/// A board that stays on when nobody is heard is seen by two looks: by the board's own watch, and by that of the fault.
#[test]
fn high_voltage_that_stays_on_is_named() {
    let mistakes = Mistakes { deaf_to_silence: true, ..Mistakes::default() };
    let both_directions = [Direction::ToBoard, Direction::ToHost];
    let found = verdict_on_board(mistakes, |faults| {
        faults.cut_line_and_record_detection_and_recovery(FaultKind::DeadLine, &both_directions).unwrap()
    })
    .expect("a verdict");
    assert!(found.contains("observations after the dead-man time"), "{found}");
    assert!(
        found.contains("line dead for a while: not detected: the board's high voltage was still on after"),
        "{found}"
    );
}

/// The daemon gives up a board that it does not hear; one that hears and does not obey stays on meanwhile, as every try of the daemon is a
/// sign of life to it.
#[test]
fn a_board_that_goes_on_while_its_answers_are_lost_is_named() {
    let mistakes = Mistakes { deaf_to_stops: true, ..Mistakes::default() };
    let found = verdict_on_board(mistakes, |faults| {
        faults.cut_line_and_record_detection_and_recovery(FaultKind::AnswersLost, &[Direction::ToHost]).unwrap()
    })
    .expect("a verdict");
    let named = "answers lost, requests heard: not detected: the board's high voltage was still on after";
    assert!(found.contains(named), "{found}");
}

#[test]
fn a_board_that_goes_on_while_requests_are_lost_is_named() {
    let mistakes = Mistakes { deaf_to_silence: true, ..Mistakes::default() };
    let found = verdict_on_board(mistakes, |faults| {
        faults.cut_line_and_record_detection_and_recovery(FaultKind::RequestsLost, &[Direction::ToBoard]).unwrap()
    });
    let named = "requests lost, answers heard: not detected: the board's high voltage was still on after";
    assert!(found.as_ref().is_some_and(|found| found.contains(named)), "{found:?}");
}

#[test]
fn high_voltage_that_comes_again_is_named() {
    let mut looks = 0;
    let third = || {
        looks += 1;
        looks == 3
    };
    let found = check_high_voltage_stays_off_returning_zero_time(WAIT, third).unwrap_err();
    assert!(found.contains("the board's high voltage was on again"), "{found}");
    assert!(check_high_voltage_stays_off_returning_zero_time(Duration::ZERO, || false).is_ok());
}

/// Says at `/metrics` that the board is there until some time after `lost` is set.
fn serve_metrics_with_late_loss(lost: Arc<OnceLock<Instant>>, after: Duration) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            // A request ends with an empty line, and says to have no body.
            for line in BufReader::new(stream.try_clone().unwrap()).lines().map_while(Result::ok) {
                if line.is_empty() {
                    let is_told = lost.get().is_some_and(|lost| lost.elapsed() >= after);
                    let text = format!("era_device_connected {}\n", u8::from(!is_told));
                    let answer = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{text}", text.len());
                    if stream.write_all(answer.as_bytes()).is_err() {
                        break;
                    }
                }
            }
        }
    });
    address
}

#[test]
fn a_loss_that_is_reported_late_is_named() {
    let lost = Arc::new(OnceLock::new());
    let address = serve_metrics_with_late_loss(Arc::clone(&lost), Duration::from_millis(150));
    let found = verdict_on_address(address, |faults| {
        let told = faults
            .remove_board_record_loss_time_and_get_later_of_loss_and_off_time(|_| {
                let _ = lost.set(Instant::now());
                Ok(())
            })
            .unwrap();
        told.unwrap();
    });
    let named = "1 of 1 losses of the board were reported after more than 100 ms";
    assert!(found.as_ref().is_some_and(|found| found.contains(named)), "{found:?}");
}

/// Has a board that has latched a fault, and refuses every touch; ends the world after some.
fn serve_refusing_every_touch(world: Arc<SoakState>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for (asked, mut stream) in listener.incoming().map_while(Result::ok).enumerate() {
            let mut first = String::new();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let _ = reader.read_line(&mut first);
            let (mut line, mut length) = (String::from(" "), 0);
            while !line.trim().is_empty() {
                line.clear();
                let _ = reader.read_line(&mut line);
                length =
                    line.strip_prefix("Content-Length: ").and_then(|text| text.trim().parse().ok()).unwrap_or(length);
            }
            // What is closed unread takes its answer with it.
            let _ = reader.read_exact(&mut vec![0; length]);
            let (status, text) = match first.starts_with("GET /metrics") {
                true => ("200 OK", "era_device_connected 1\nera_device_faults_total 1\n"),
                false => ("409 Conflict", r#"{"type": "urn:era:problem:device-fault", "detail": "a fault"}"#),
            };
            let head = format!("HTTP/1.1 {status}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n", text.len());
            let _ = stream.write_all(format!("{head}{text}").as_bytes());
            if asked >= 20 {
                world.tell_clients_to_end();
            }
        }
    });
    address
}

#[test]
fn a_daemon_that_refuses_every_touch_is_named() {
    let world = Arc::new(SoakState::default());
    let address = serve_refusing_every_touch(Arc::clone(&world));
    world.set_serving_daemon_incrementing_generation(address);
    let tally = clients::run_http_client(&world, None, 0, Rng::with_seed(1));
    let found = super::report::tests::make_report_with_tally(tally).find_failures().unwrap();
    assert!(found.contains("no touch was driven") && found.contains("with 409 device-fault"), "{found}");
    // Its board's fault is counted whatever became of touches.
    let found = verdict_on_address(address, |_| {}).unwrap();
    assert!(found.contains("the board has latched 1 faults, but only 0 were injected"), "{found}");
}

/// The verdict on a daemon that opens as many files as `descriptors` names descriptors, while clients are at it.
fn verdict_after_opening_files(descriptors: &[u32]) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (closed, asked, opened) = (path("closed"), path("asked"), path("opened"));
    let opens: String = descriptors.iter().map(|descriptor| format!(" {descriptor}</dev/null")).collect();
    let then = format!(
        "exec 3<&- 4<&- 5<&- 6<&- 7<&- 8<&-; touch '{}'; while [ ! -e '{}' ]; do sleep 0.01; done; exec{opens}; touch '{}'; exec sleep 600",
        closed.display(),
        asked.display(),
        opened.display()
    );
    let plan =
        make_daemon_setup(folder.path(), write_fake_daemon(folder.path(), "127.0.0.1:9".parse().unwrap(), &then));
    let daemon = Daemon::start(&plan).unwrap();
    // What it was started with would be opened again, and not be more. `touch` is a process of its own: a redirection of
    // the shell would hold two more descriptors at the moment its file appears.
    wait_until(WAIT, || closed.exists()).expect("it has closed what it was started with");
    let warm = daemon.read_memory_threads_and_handles_or_zeros();
    let (world, bench) = (SoakState::default(), Bench::new(path("board")).unwrap());
    let (ledger, random) = (FaultLedger::default(), Rng::with_seed(1));
    let faults =
        Faults { world: &world, bench, plan, daemon, ledger, random, outages: 0, faults: 0, before_kill: None };
    std::fs::write(asked, "").unwrap();
    wait_until(WAIT, || opened.exists()).expect("it has opened them");
    make_report(&OPTIONS, Instant::now(), warm, Tally::with_one_driven_touch(), faults).find_failures()
}

#[test]
fn a_daemon_that_opens_more_and_more_is_named() {
    assert_eq!(verdict_after_opening_files(&[3]), None);
    let found = verdict_after_opening_files(&[3, 4, 5, 6, 7, 8]);
    assert!(found.as_ref().is_some_and(|found| found.starts_with("handles grew from")), "{found:?}");
}

/// Closes connections on which a touch came, and knows nothing of any; ends the world at the first.
fn serve_closing_touch_connections(world: Arc<SoakState>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let mut first = String::new();
            let _ = BufReader::new(&stream).read_line(&mut first);
            match first.starts_with("GET /v1/requests/") {
                true => {
                    world.tell_clients_to_end();
                    let _ = (&stream).write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 2\r\n\r\n{}");
                }
                false => drop(stream),
            }
        }
    });
    address
}

#[test]
fn a_touch_without_an_answer_is_named() {
    let world = Arc::new(SoakState::default());
    world.set_serving_daemon_incrementing_generation(serve_closing_touch_connections(Arc::clone(&world)));
    let tally = clients::run_http_client(&world, None, 0, Rng::with_seed(1));
    assert!(tally.lost > 0 && tally.losses.iter().all(|loss| loss.contains("client0.")), "{:?}", tally.losses);
    assert!(super::report::tests::make_report_with_tally(tally).find_failures().unwrap().contains("touches were lost"));
}

#[test]
fn a_gesture_without_an_answer_is_named() {
    let world = Arc::new(SoakState::default());
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    world.set_serving_daemon_incrementing_generation(listener.local_addr().unwrap());
    let over = Arc::clone(&world);
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        let mut socket = tungstenite::accept(stream).unwrap();
        // One word of it, and the page is left alone.
        let _ = socket.read();
        over.tell_clients_to_end();
    });
    let tally = clients::run_live_client(&world, 0, Rng::with_seed(1));
    server.join().unwrap();
    assert_eq!((tally.sent, tally.lost), (1, 1), "{:?}", tally.losses);
    assert!(super::report::tests::make_report_with_tally(tally).find_failures().unwrap().contains("touches were lost"));
}

#[test]
fn a_daemon_that_ends_by_itself_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let address = "127.0.0.1:9".parse().unwrap();
    let plan = make_daemon_setup(
        folder.path(),
        write_fake_daemon(folder.path(), address, "echo 'out of everything' >&2; exit 1"),
    );
    let bench = Bench::new(folder.path().join("board")).unwrap();
    let daemon = Daemon::start(&plan).unwrap();
    let world = SoakState::default();
    let (ledger, random) = (FaultLedger::default(), Rng::with_seed(1));
    let mut faults =
        Faults { world: &world, bench, plan, daemon, ledger, random, outages: 0, faults: 0, before_kill: None };
    wait_until(WAIT, || faults.daemon.has_ended() && faults.daemon.recent_log().contains("out of"))
        .expect("its last words");
    let error = run_until_end_with_faults_if_enabled_failing_if_daemon_ends(&OPTIONS, Instant::now(), &mut faults)
        .unwrap_err()
        .to_string();
    assert!(error.contains("the daemon has ended by itself") && error.contains("out of everything"), "{error}");
    let found = make_report(
        &OPTIONS,
        Instant::now(),
        MemoryThreadsAndHandles::default(),
        Tally::with_one_driven_touch(),
        faults,
    )
    .find_failures()
    .unwrap();
    assert!(found.contains("the daemon has ended by itself") && found.contains("out of everything"), "{found}");
}

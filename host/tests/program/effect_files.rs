//! Effects as files, from the file to the panel: what the command line prints and writes, and what the daemon plays.

use crate::support;
use era::effect_files::motion::{RATE_HZ, sample_acceleration_g};
use era::effect_files::panel::{PartKind, design_parts_for_panel};
use era::effect_files::parts::cut_events_into_parts;
use era::effect_files::read_effect_bytes;
use era::scene::EXAMPLE_PLATE;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;
use support::Daemon;
use support::program::{ProgramOutput, build_era_command, run_command};

const AHAP: &str = r#"{"Version": 1, "Metadata": {"Project": "two"}, "Pattern": [
    {"Event": {"Time": 0, "EventType": "HapticTransient", "EventParameters": [
        {"ParameterID": "HapticIntensity", "ParameterValue": 0.25}, {"ParameterID": "HapticSharpness", "ParameterValue": 0.5}]}},
    {"Event": {"Time": 0.4, "EventType": "HapticTransient", "EventParameters": [
        {"ParameterID": "HapticIntensity", "ParameterValue": 1.0}, {"ParameterID": "HapticSharpness", "ParameterValue": 0.5}]}},
    {"Event": {"Time": 0.6, "EventType": "AudioCustom"}}]}"#;

fn find_largest_magnitude(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// Pulses and vibrations have the peaks that are predicted of them, and weaker pulses the part of it.
#[test]
fn the_acceleration_is_what_is_predicted() {
    let table = support::table(EXAMPLE_PLATE);
    let poles = table.panel_poles().unwrap();
    let text = "version = 1\n[[events]]\nprimitive = \"tick\"\nintensity = 1\n[[events]]\nprimitive = \"click\"\ntime_ms = 1000\n\
        [[events]]\nprimitive = \"click\"\ntime_ms = 2000\nintensity = 0.25\n[[events]]\nprimitive = \"thud\"\ntime_ms = 3000\n\
        [[events]]\nprimitive = \"buzz\"\ntime_ms = 4000\nduration_ms = 600\nintensity = 0.5\n";
    let list = read_effect_bytes(text.as_bytes(), None).unwrap();
    let (parts, warnings) = cut_events_into_parts(&list).unwrap();
    assert_eq!((parts.len(), &warnings[..]), (5, &[][..]));
    let effect = design_parts_for_panel(&table, poles, &parts, ((0.04, 0.1), 0.3), true).unwrap();
    let kinds: Vec<PartKind> = effect.parts.iter().map(|part| part.kind).collect();
    assert_eq!(kinds, [PartKind::Tick, PartKind::Click, PartKind::Click, PartKind::Thud, PartKind::Envelope]);
    let all = sample_acceleration_g(&table, poles, &effect).unwrap();
    let second =
        |from_s: usize| find_largest_magnitude(&all[0][from_s * RATE_HZ as usize..(from_s + 1) * RATE_HZ as usize]);
    for (k, part) in effect.parts.iter().enumerate() {
        let (found_g, predicted) = (second(k), part.design.predicted);
        // Of windows the motion is known; of drives it is one of those that their phases may make.
        if part.design.windows.is_empty() {
            assert!(
                (0.9 * predicted.peak_least_g..1.1 * predicted.peak_most_g).contains(&found_g),
                "{k}: {found_g} {predicted:?}"
            );
        } else {
            assert!((found_g / predicted.peak_g - 1.0).abs() < 0.02, "{k}: {found_g} {predicted:?}");
        }
    }
    // Half of tick's own intensity is 1 here; a quarter of a click is a quarter of its peak.
    assert!((second(2) / second(1) - 0.25).abs() < 0.01, "{} {}", second(2), second(1));
    // Half of the level: the steady peak of half of 0.3 g, but for narrower windows and how it begins.
    assert!((0.12..0.25).contains(&second(4)), "{}", second(4));
}

fn run_era_effect(folder: &Path, arguments: &[&str]) -> ProgramOutput {
    let mut command = build_era_command();
    command.current_dir(folder).args(["effect", "--accuracy", "fast", "--at", "256,640"]);
    run_command(command.args(arguments))
}

#[test]
fn the_command_line_reads_prints_and_exports() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("two.ahap"), AHAP).unwrap();
    let output = run_era_effect(path, &["--file", "two.ahap", "--json", "--export", "two.csv"]);
    let told = output.parse_json();
    assert_eq!((&told["name"], &told["format"], &told["event_count"]), (&json!("two"), &json!("ahap"), &json!(2)));
    assert_eq!(
        told["warnings"],
        json!(["Pattern[2].Event is left out: its EventType is AudioCustom, which is a sound"])
    );
    let parts = told["parts"].as_array().unwrap();
    assert_eq!((&parts[0]["kind"], &parts[1]["begin_ms"]), (&json!("click"), &json!(400)));
    let peak = |part: &Value| part["peak_g"].as_f64().unwrap();
    assert!((peak(&parts[0]) / peak(&parts[1]) - 0.25).abs() < 1e-9);
    assert!((told["scales"][0]["peak_g"].as_f64().unwrap() - peak(&parts[1])).abs() < 1e-9);
    let csv = std::fs::read_to_string(path.join("two.csv")).unwrap();
    assert!(csv.starts_with("time_s,acceleration_g at 40.0 mm 100.0 mm\n"));
    let column: Vec<f64> = csv.lines().skip(1).map(|line| line.split_once(',').unwrap().1.parse().unwrap()).collect();
    let (first, second) = column.split_at(4 * RATE_HZ as usize / 10);
    assert!(
        (find_largest_magnitude(first) / peak(&parts[0]) - 1.0).abs() < 0.02
            && (find_largest_magnitude(second) / peak(&parts[1]) - 1.0).abs() < 0.02
    );

    // A named effect, too: windows, and drives.
    for (name, allowed) in [("click", 0.02), ("buzz", 0.35)] {
        let told = run_era_effect(path, &[name, "--json", "--export", "named.csv"]).parse_json();
        let csv = std::fs::read_to_string(path.join("named.csv")).unwrap();
        assert!(csv.starts_with("time_s,acceleration_g at 40.0 mm 100.0 mm\n"), "{name}");
        let column: Vec<f64> =
            csv.lines().skip(1).map(|line| line.split_once(',').unwrap().1.parse().unwrap()).collect();
        let predicted_g = told["predicted"]["peak_g"].as_f64().unwrap();
        // Two drives begin at unknown phases, of which the file has one.
        assert!((find_largest_magnitude(&column) / predicted_g - 1.0).abs() < allowed, "{name}: {predicted_g}");
    }

    let output = run_era_effect(path, &["--file", "two.ahap", "--export", "two.wav"]);
    let text = &output.out;
    assert!(
        text.contains("two: 2 events in 400 ms, file format AHAP") && text.contains("warning: Pattern[2]"),
        "{text}"
    );
    // What was written is read again, as an intensity over time.
    let output = run_era_effect(path, &["--file", "two.wav", "--export", "two.png"]);
    assert!(output.out.contains("file format WAV"));
    assert!(std::fs::read(path.join("two.png")).unwrap().starts_with(b"\x89PNG"));

    for (arguments, message) in [
        (&["--file", "none.toml"][..], "cannot read none.toml"),
        (&["--file", "two.ahap", "--format", "hjif"], "the key `perceptions` is missing"),
        (&["--file", "two.ahap", "--export", "two.txt"], "the name must end in .csv, .wav or .png"),
        (&["--file", "two.ahap", "click"], "cannot be used with"),
        (&["--format", "hjif", "click"], "--file"),
    ] {
        let output = run_era_effect(path, arguments);
        let told = &output.error;
        assert!(!output.is_success() && told.contains(message), "{arguments:?}: {told}");
    }
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/effects/confirm.toml");
    let output = run_era_effect(path, &["--file", example.to_str().unwrap()]);
    let text = &output.out;
    assert!(text.starts_with("confirm: 4 events") && !text.contains("warning"), "{text}");
}

#[test]
fn the_daemon_lists_names_and_plays_files() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let (status, named) = daemon.get("/v1/effects");
    let has = |name: &str, used_in: &str| {
        let is = |own: &&Value| own["name"] == name && own["used_in"] == used_in;
        named.as_array().unwrap().iter().find(is).is_some()
    };
    assert!(status == 200 && has("click", "touch") && has("tick", "file") && has("texture", "touch"), "{named}");

    let body = json!({"x_px": 256, "y_px": 640, "intensity_g": 0.3, "file": AHAP});
    let (status, _, told) = daemon.post("/v1/effects", &body.to_string());
    assert_eq!(status, 200, "{told}");
    assert_eq!((&told["name"], &told["device"]["acknowledged"]), (&json!("two"), &json!(true)));
    assert_eq!(told["warnings"].as_array().unwrap().len(), 1, "{told}");
    let id = told["plan_id"].as_u64().unwrap();
    let peaks: Vec<f64> =
        told["parts"].as_array().unwrap().iter().map(|part| part["peak_g"].as_f64().unwrap()).collect();
    // The second pulse is four times as strong as the first one, and comes without being asked for.
    let peak = |state: &Value| {
        let all = state["telemetry"]["touch_peaks"].as_array().cloned().unwrap_or_default();
        all.iter().find(|peak| peak["plan_id"] == id).and_then(|peak| peak["peak_g"].as_f64()).unwrap_or(0.0)
    };
    daemon.wait_for(|state| peak(state) > 0.5 * (peaks[0] + peaks[1]));

    // A stop ends what has not begun.
    let later = json!({"x_px": 256, "y_px": 640, "effect": {"version": 1, "events": [
        {"primitive": "tick"}, {"primitive": "click", "pause_ms": 800}]}});
    let (status, _, told) = daemon.post("/v1/effects", &later.to_string());
    assert_eq!(status, 200, "{told}");
    let id = told["plan_id"].as_u64().unwrap();
    assert_eq!(daemon.post("/v1/stop", "").0, 200);
    std::thread::sleep(Duration::from_millis(1200));
    let state = daemon.state();
    let peak = |state: &Value| {
        let all = state["telemetry"]["touch_peaks"].as_array().cloned().unwrap_or_default();
        all.iter().find(|peak| peak["plan_id"] == id).and_then(|peak| peak["peak_g"].as_f64()).unwrap_or(0.0)
    };
    let second = told["parts"][1]["peak_g"].as_f64().unwrap();
    assert!(peak(&state) < 0.7 * second, "{} of {second}: {state}", peak(&state));
}

/// A live socket that hears of plans.
fn open_socket(daemon: &Daemon) -> tungstenite::WebSocket<tungstenite::stream::MaybeTlsStream<std::net::TcpStream>> {
    let url = format!("{}/v1/live?send=plan", daemon.url.replace("http", "ws"));
    tungstenite::connect(url).unwrap().0
}

/// When the next effect that a socket hears of begins, in ms of the board's time.
fn next_effect_start_ms(
    socket: &mut tungstenite::WebSocket<tungstenite::stream::MaybeTlsStream<std::net::TcpStream>>,
) -> f64 {
    let begun = std::time::Instant::now();
    loop {
        // Questions for a sign of life end a wait for nothing.
        assert!(begun.elapsed() < Duration::from_secs(30), "no effect has begun");
        if let tungstenite::Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            if let Some(start_us) = message["effect"]["start_board_us"].as_f64() {
                return start_us / 1e3;
            }
        }
    }
}

/// The board is off, so that the first part waits for its rails; the others come at their distances from it, of the same strength and of others,
/// for which the rails change.
#[test]
fn parts_keep_their_distances_from_the_first_one() {
    for intensities in [[1.0, 1.0, 1.0], [0.3, 1.0, 0.3]] {
        let events: Vec<Value> = intensities
            .iter()
            .enumerate()
            .map(|(i, intensity)| {
                let pause_ms = if i == 0 { 0 } else { 150 };
                json!({"primitive": "click", "intensity": intensity, "pause_ms": pause_ms})
            })
            .collect();
        let body = json!({"x_px": 256, "y_px": 640, "intensity_g": 0.3, "effect": {"version": 1, "events": events}});
        let mut off_ms = Vec::new();
        // Other programs may hold the computer up for longer than parts are sent ahead.
        for _ in 0..4 {
            let daemon = Daemon::start(EXAMPLE_PLATE);
            let mut socket = open_socket(&daemon);
            let (status, _, told) = daemon.post("/v1/effects", &body.to_string());
            assert_eq!(status, 200, "{told}");
            let starts_ms: Vec<f64> = (0..3).map(|_| next_effect_start_ms(&mut socket)).collect();
            let wanted_ms = |i: usize| {
                told["parts"][i]["begin_ms"].as_f64().unwrap() - told["parts"][0]["begin_ms"].as_f64().unwrap()
            };
            off_ms = (1..3).map(|i| starts_ms[i] - starts_ms[0] - wanted_ms(i)).collect();
            if off_ms.iter().all(|off_ms| off_ms.abs() < 1.0) {
                break;
            }
        }
        assert!(off_ms.iter().all(|off_ms| off_ms.abs() < 1.0), "{intensities:?}: {off_ms:?} ms off");
    }
}

/// The finger's drive was ended by the first part, and goes on after the last one.
#[test]
fn a_resting_finger_does_not_end_an_effect_in_its_pauses() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let mut finger = open_socket(&daemon);
    let message = json!({"type": "touch", "touches": [{"id": 1, "x_px": 900, "y_px": 400}], "intensity_g": 0.05});
    finger.send(tungstenite::Message::text(message.to_string())).unwrap();
    daemon.wait_for(|state| state["device"]["state"] == "running");
    let mut socket = open_socket(&daemon);
    let body = json!({"x_px": 256, "y_px": 640, "effect": {"version": 1, "events": [
        {"primitive": "click"}, {"primitive": "click", "pause_ms": 2500}]}});
    let (status, _, told) = daemon.post("/v1/effects", &body.to_string());
    assert_eq!(status, 200, "{told}");
    let first_ms = next_effect_start_ms(&mut socket);
    let apart_ms = next_effect_start_ms(&mut socket) - first_ms;
    assert!((apart_ms - 2500.0).abs() < 500.0, "{apart_ms}");
    daemon.wait_for(|state| state["touches"][0]["id"] == 1 && state["device"]["state"] == "running");
}

#[test]
fn what_cannot_be_played_is_refused_with_the_field() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let event = |more: Value| json!({"version": 1, "events": [more]});
    let many = json!({"version": 1, "events": [{"primitive": "click", "repeat": {"count": 200, "period_ms": 60}}]});
    for (more, status, field, detail) in [
        (json!({}), 400, "effect", "`effect`, `file` and `file_base64` are missing"),
        (json!({"effect": event(json!({"primitive": "click"})), "file": AHAP}), 400, "effect", "only one is allowed"),
        (json!({"file": AHAP, "file_base64": ""}), 400, "file", "only one is allowed"),
        (json!({"file_base64": "UklGR"}), 400, "file_base64", "not base64 text"),
        (json!({"file_base64": "UklGRgAAAAA="}), 400, "file_base64", "WAV"),
        (
            json!({"effect": event(json!({"primitive": "click"})), "format": "json"}),
            400,
            "format",
            "only together with `file`",
        ),
        (json!({"file": AHAP, "format": "wav"}), 400, "file", "use `file_base64`"),
        (json!({"file": AHAP, "format": "mp3"}), 400, "format", "mp3"),
        (json!({"file": "{}"}), 400, "file", "version is missing"),
        (json!({"effect": event(json!({"primitive": "bang"}))}), 400, "effect.events[0].primitive", "bang"),
        (
            json!({"effect": event(json!({"primitive": "click", "intensity": 2}))}),
            400,
            "effect",
            "events[0].intensity is 2",
        ),
        (json!({"effect": event(json!({"primitive": "click", "dx_mm": 1999}))}), 400, "dx_mm", "is not on the surface"),
        (json!({"effect": event(json!({"primitive": "click"})), "intensity_g": -1}), 400, "intensity_g", "-1"),
        (json!({"effect": many}), 422, "", "has 200 parts"),
    ] {
        let mut body = json!({"x_px": 256, "y_px": 640});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let (found, _, problem) = daemon.post("/v1/effects", &body.to_string());
        assert_eq!(found, status, "{body}: {problem}");
        assert_eq!(problem["field"].as_str().unwrap_or_default(), field, "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains(detail), "{detail}: {problem}");
    }
    // A file of the largest size is taken, one byte more is not.
    let long =
        |bytes: usize| json!({"x_px": 256, "y_px": 640, "file": format!("{}{AHAP}", " ".repeat(bytes - AHAP.len()))});
    assert_eq!(daemon.post("/v1/effects", &long(256 * 1024).to_string()).0, 200);
    let (status, _, problem) = daemon.post("/v1/effects", &long(256 * 1024 + 1).to_string());
    assert!(status == 400 && problem["detail"].as_str().unwrap().contains("262145 bytes"), "{problem}");
}

/// Each format's example has the events, and the warnings, that its author wrote into it; by hand.
#[test]
fn the_example_of_each_format_is_read_as_it_was_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/effects");
    for (file, format, events, duration_ms, warnings) in [
        ("bands.hjif", "hjif", 4, 1400.0, 3),
        ("confirm.toml", "toml", 4, 550.0, 0),
        ("engine.wav", "wav", 1, 400.0, 1),
        ("ramp.haptic", "haptic", 2, 400.0, 1),
        ("reference.hmpg", "hmpg", 5, 2300.0, 1),
        ("taps.ahap", "ahap", 3, 900.0, 4),
    ] {
        let path = folder.join(file);
        let output = run_era_effect(&folder, &["--file", path.to_str().unwrap(), "--json"]);
        let answer: Value = serde_json::from_str(&output.out).unwrap_or_else(|error| panic!("{file}: {error}"));
        let found = (
            answer["format"].as_str().unwrap(),
            answer["event_count"].as_u64().unwrap(),
            answer["duration_ms"].as_f64().unwrap().round(),
            answer["warnings"].as_array().unwrap().len(),
        );
        assert_eq!(found, (format, events, duration_ms, warnings), "{file}: {answer}");
        assert!(
            answer["parts"].as_array().unwrap().iter().all(|part| part["peak_g"].as_f64().unwrap() > 0.01),
            "{file}"
        );
    }
}

/// The daemon reads each file as `era effect` does, also those that are no text, and plays it.
#[test]
fn era_touch_plays_files_of_every_format() {
    let daemon = Daemon::start(EXAMPLE_PLATE);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/effects");
    for file in ["bands.hjif", "confirm.toml", "engine.wav", "ramp.haptic", "reference.hmpg", "taps.ahap"] {
        let path = folder.join(file);
        let mut command = build_era_command();
        command.args(["touch", "256", "640", "--json", "--url", &daemon.url, "--file"]).arg(&path);
        let played = run_command(&mut command).parse_json();
        let read = run_era_effect(&folder, &["--file", file, "--json"]).parse_json();
        for key in ["format", "event_count", "duration_ms", "warnings"] {
            assert_eq!(played[key], read[key], "{file}: {key}");
        }
        let begins = |answer: &Value| {
            answer["parts"].as_array().unwrap().iter().map(|part| part["begin_ms"].clone()).collect::<Vec<_>>()
        };
        assert_eq!(begins(&played), begins(&read), "{file}");
        assert_eq!(played["device"]["acknowledged"], true, "{file}: {played}");
    }
    let large = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(large.path(), [&b"RIFF"[..], &vec![0; 400 * 1024]].concat()).unwrap();
    let mut command = build_era_command();
    command.args(["touch", "256", "640", "--url", &daemon.url, "--file"]).arg(large.path());
    let refused = run_command(&mut command);
    assert!(refused.code == Some(2) && refused.error.contains("at most 393216"), "{refused:?}");
}

//! Byte order marks at the beginning of whatever text comes in: files, bodies, messages.

use crate::support::Daemon;
use crate::support::program::run_era;
use crate::{run_openssl, write_recording, write_secret};
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::path::Path;
use tungstenite::Message;

const MARK: &str = "\u{feff}";

/// As Windows' editors write a text: with a mark, and lines that end in CR LF.
fn as_windows_text(text: &str) -> String {
    format!("{MARK}{}", text.replace("\r\n", "\n").replace('\n', "\r\n"))
}

fn as_utf16(text: &str) -> Vec<u8> {
    format!("{MARK}{text}").encode_utf16().flat_map(u16::to_le_bytes).collect()
}

/// Every file of text that a command reads: its name, what it says, and the command.
fn text_files(folder: &Path) -> Vec<(&'static str, String, Vec<String>)> {
    let line = |text: &str| -> Vec<String> {
        text.split(' ').map(|word| word.replace("DIR", folder.to_str().unwrap())).collect()
    };
    write_recording(&folder.join("day.jsonl"));
    let recording = std::fs::read_to_string(folder.join("day.jsonl")).unwrap();
    vec![
        ("era.toml", "version = 1\n\nlisten = \"127.0.0.1:9000\"\n".into(), line("config check DIR/era.toml")),
        ("scene.toml", STARTING_PLATE.into(), line("modes --max-hz 60 --accuracy fast --scene DIR/scene.toml")),
        ("doctor.toml", STARTING_PLATE.into(), line("doctor --device sim --scene DIR/doctor.toml")),
        ("day.jsonl", recording, line("replay DIR/day.jsonl")),
    ]
}

#[test]
fn files_with_a_mark_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = crate::servers::Server::daemon();
    for (name, text, mut command) in text_files(folder.path()) {
        if command[0] == "replay" {
            command.extend(["--url".to_owned(), daemon.url()]);
        }
        let arguments: Vec<&str> = command.iter().map(String::as_str).collect();
        let file = folder.path().join(name);
        std::fs::write(&file, as_windows_text(&text)).unwrap();
        let said = run_era(&arguments);
        assert_eq!(said.code, Some(0), "{name}: {}", said.error);
        // UTF-16 is named, and not told as broken text.
        std::fs::write(&file, as_utf16(&text)).unwrap();
        let said = run_era(&arguments);
        let told = format!("{}{}", said.out, said.error);
        assert!(said.code != Some(0) && told.contains("UTF-16") && told.contains("UTF-8"), "{name}: {told}");
    }
    // Lines are counted as without it.
    let file = folder.path().join("wrong.toml");
    std::fs::write(&file, as_windows_text("version = 1\nsceen = \"x\"\n")).unwrap();
    let said = run_era(&["config", "check", file.to_str().unwrap()]);
    assert!(said.error.contains("wrong.toml:2: unknown key `sceen`"), "{}", said.error);
}

/// A study and the scene that it names.
#[test]
fn a_study_with_marks_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let study = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/studies/placement.toml");
    let text = std::fs::read_to_string(study).unwrap();
    let scene = text.lines().find_map(|line| line.strip_prefix("scene = ")).unwrap().trim().trim_matches('"');
    let own = folder.path().join("studies");
    std::fs::create_dir_all(own.join(scene).parent().unwrap()).unwrap();
    std::fs::write(own.join(scene), as_windows_text(STARTING_PLATE)).unwrap();
    std::fs::write(own.join("study.toml"), as_windows_text(&text)).unwrap();
    let study = era::study::run::Study::load(&own.join("study.toml"));
    assert!(study.is_ok(), "{}", study.unwrap_err());
    std::fs::write(own.join("study.toml"), as_utf16(&text)).unwrap();
    let told = era::study::run::Study::load(&own.join("study.toml")).unwrap_err().to_string();
    assert!(told.contains("UTF-16"), "{told}");
}

/// Certificates and keys.
#[test]
fn pem_files_with_marks_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    run_openssl(
        path,
        "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout key.pem -out cert.pem -days 30 -subj /CN=x \
         -addext subjectAltName=DNS:localhost",
    );
    for name in ["key.pem", "cert.pem"] {
        let text = std::fs::read_to_string(path.join(name)).unwrap();
        write_secret(&path.join(name), as_windows_text(&text).as_bytes());
    }
    std::fs::write(path.join("era.toml"), "version = 1\ntls_cert = \"cert.pem\"\ntls_key = \"key.pem\"\n").unwrap();
    let said = run_era(&["config", "check", path.join("era.toml").to_str().unwrap()]);
    assert_eq!(said.code, Some(0), "{}", said.error);
    // As what a daemon's certificate is trusted by: it gets as far as a daemon that is not there.
    let ca = path.join("cert.pem");
    let said = run_era(&["state", "--url", "https://127.0.0.1:1", "--ca", ca.to_str().unwrap()]);
    assert!(said.code == Some(1) && said.error.contains("no answer"), "{}", said.error);
}

/// Bodies of JSON (RFC 8259, 8.1, lets a parser pass over a mark), and the files as texts in them.
#[test]
fn bodies_with_a_mark_are_read() {
    let daemon = Daemon::start(STARTING_PLATE);
    let study = "version = 1\nname = \"t\"\nscene = \"s\"\n[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 2.0\nto = 4.0\n\
                 [[wish]]\nfigure = \"sag_um\"\nforce_n = 10\n[method]\nway = \"grid\"\n";
    let place = json!({"x_px": 960, "y_px": 640, "intensity_g": 0.1});
    for (path, body) in [
        ("/v1/touch", place.to_string()),
        ("/v1/preview", place.to_string()),
        ("/v1/preview", json!({"x_px": 960, "y_px": 640, "scene": as_windows_text(STARTING_PLATE)}).to_string()),
        (
            "/v1/preview",
            json!({"x_px": 960, "y_px": 640, "scene": as_windows_text(STARTING_PLATE), "moves": {"support[1]": {"x_mm": 40}}})
                .to_string(),
        ),
        ("/v1/study", json!({"study": as_windows_text(study), "scene": as_windows_text(STARTING_PLATE)}).to_string()),
        ("/v1/study/stop", "{}".to_owned()),
        ("/v1/tolerances", place.to_string()),
        ("/v1/tolerances/stop", "{}".to_owned()),
        ("/v1/arm", "{}".to_owned()),
        ("/v1/faults/clear", "{}".to_owned()),
        ("/v1/stop", "{}".to_owned()),
    ] {
        let (status, _, told) = daemon.post(path, &format!("{MARK}{body}"));
        // A board that is late, on a busy machine, is another matter.
        let is_of_the_board = matches!(status, 409 | 502 | 503);
        assert!(status == 200 || is_of_the_board, "{path}: {status} {told}");
    }
    // Nothing else goes before a body, and one mark is enough.
    for text in [format!("{MARK}{MARK}{place}"), format!("{place}{MARK}"), MARK.to_owned()] {
        assert_eq!(daemon.post("/v1/touch", &text).0, 400, "{text:?}");
    }
}

/// Messages of the live socket, a stop above all.
#[test]
fn messages_with_a_mark_are_read() {
    let daemon = Daemon::start(STARTING_PLATE);
    let (mut socket, _) =
        tungstenite::connect(format!("{}/v1/live?send=plan", daemon.url.replace("http", "ws"))).unwrap();
    let finger = json!({"type": "touch", "touches": [{"id": 1, "x_px": 960, "y_px": 640}], "intensity_g": 0.1});
    let mut say = |message: &Value| socket.send(Message::text(format!("{MARK}{message}"))).unwrap();
    say(&finger);
    daemon.wait_for(|state| !state["plan"].is_null());
    say(&json!({"type": "stop"}));
    daemon.wait_for(|state| state["plan"].is_null());
}

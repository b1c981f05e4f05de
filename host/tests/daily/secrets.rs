//! Tokens and keys: who may read them, and where they are not written.

use crate::access::ask_era;
use crate::support::Daemon;
use crate::support::program::{build_era_command, run_command};
use era::daemon::{Access, BackgroundDaemon, Recorder};
use era::scene::STARTING_PLATE;
use serde_json::json;
use std::path::Path;
use tungstenite::Message;
use tungstenite::client::IntoClientRequest;

/// A file that only its owner may read.
pub fn write_secret(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap();
    #[cfg(unix)]
    set_mode(path, 0o600);
}

#[cfg(unix)]
fn set_mode(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

/// The daemon does not start with a secret that others may read or write, and commands do not send one.
#[cfg(unix)]
#[test]
fn a_secret_that_others_may_read_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (tokens, tls) = (folder.path().join("tokens"), folder.path().join("tls"));
    write_secret(&tokens, &format!("touch {}\n", "T".repeat(32)));
    let files = era::daemon::listener::find_or_make_certificate(&tls, &[]).unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let [token, certificate, key] = [&tokens, &files.certificate, &files.key].map(|path| path.to_str().unwrap());
    let with_tokens = ["serve", "--listen", &address, "--token-file", token];
    let with_tls = ["serve", "--listen", &address, "--tls-cert", certificate, "--tls-key", key];
    let url = format!("http://{address}");
    let command = ["stop", "--url", &url, "--token-file", token];
    // With files in order the daemon gets as far as its port, which is taken.
    for (file, arguments) in [(token, &with_tokens[..]), (key, &with_tls[..])] {
        for mode in [0o400, 0o600] {
            set_mode(Path::new(file), mode);
            let (code, said) = ask_era(arguments);
            assert!(code == 1 && said.contains("cannot listen on"), "{mode:o}: {code} {said}");
        }
    }
    for mode in [0o640, 0o604, 0o644, 0o620, 0o602, 0o666] {
        for (file, arguments) in [(token, &with_tokens[..]), (key, &with_tls[..]), (token, &command[..])] {
            set_mode(Path::new(file), mode);
            let (code, said) = ask_era(arguments);
            assert_eq!(code, 2, "{mode:o} {arguments:?}: {said}");
            for piece in [format!("its mode is {mode:04o}"), format!("chmod 600 {file}")] {
                assert!(said.contains(&piece), "{piece:?} not in {said}");
            }
            assert!(!said.contains("TTTT"), "{said}");
            set_mode(Path::new(file), 0o600);
        }
    }
    // The certificate is for everybody.
    set_mode(&files.certificate, 0o644);
    assert_eq!(ask_era(&with_tls).0, 1);
}

/// The owner of a file can change it, and a pipe that nobody writes to has no end to wait for.
#[cfg(unix)]
#[test]
fn a_secret_is_a_file_of_ones_own_or_of_root() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (another, pipe, place) = (at("another"), at("pipe"), at("place"));
    write_secret(&another, &format!("touch {}\n", "T".repeat(32)));
    std::fs::create_dir(&place).unwrap();
    assert!(std::process::Command::new("mkfifo").args(["-m", "600"]).arg(&pipe).status().unwrap().success());
    let mut cases = vec![(&pipe, "token"), (&place, "but it is a folder")];
    // Only root can give a file away.
    if std::os::unix::fs::chown(&another, Some(12_345), None).is_ok() {
        cases.push((&another, "its owner (user ID 12345) can change the file"));
    }
    for (file, piece) in cases {
        let file = file.to_str().unwrap();
        let address = "127.0.0.1:1";
        for arguments in [
            &["serve", "--listen", address, "--token-file", file][..],
            &["stop", "--url", "http://127.0.0.1:1", "--token-file", file],
            &["serve", "--listen", address, "--tls-cert", file, "--tls-key", file],
        ] {
            let (code, said) = ask_era(arguments);
            assert!(
                code == 2 && (said.contains(piece) || arguments.contains(&"--tls-key")),
                "{arguments:?}: {code} {said}"
            );
            assert!(!said.contains("TTTT"), "{said}");
        }
    }
}

/// systemd's access control list for a service's credentials shows as 0440; others are refused there, too.
#[cfg(unix)]
#[test]
fn a_credential_of_the_service_manager_may_have_its_lists_mask() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    write_secret(&tokens, "arm short\n");
    for (mode, credentials, piece) in [
        (0o440, folder.path(), "line 1"),
        (0o444, folder.path(), "its mode is 0444"),
        (0o440, Path::new("/nowhere"), "its mode is 0440"),
        (0o440, Path::new(""), "its mode is 0440"),
    ] {
        set_mode(&tokens, mode);
        let mut command = build_era_command();
        command.args(["serve", "--token-file"]).arg(&tokens).env("CREDENTIALS_DIRECTORY", credentials);
        let said = run_command(&mut command).error;
        assert!(said.contains(piece), "{mode:o} {}: {said}", credentials.display());
    }
}

/// Clients have been given the certificate that is there: it stays, and what it is not good for is said.
#[test]
fn a_certificate_that_lacks_a_name_is_kept_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let tls = folder.path().join("tls");
    let socket = folder.path().join("taken.sock");
    let _taken = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    // The socket is taken, so that the daemon ends once it has its certificate.
    let serve = |more: &[&str]| {
        let (code, said) =
            ask_era(&[&["serve", "--listen", "127.0.0.1:0", "--socket", socket.to_str().unwrap()], more].concat());
        assert!(code == 1 && said.contains("another daemon listens on the socket"), "{more:?}: {code} {said}");
        said
    };
    let of_dir = |names: &[&str]| {
        let names = names.iter().flat_map(|name| ["--allow-host", name]);
        serve(&["--tls-dir", tls.to_str().unwrap()].into_iter().chain(names).collect::<Vec<_>>())
    };
    let [certificate, key] = ["era-cert.pem", "era-key.pem"].map(|name| tls.join(name));
    let read = || [&certificate, &key].map(|path| std::fs::read(path).unwrap());
    assert!(!of_dir(&["old.local"]).contains("does not contain"));
    let first = read();
    assert!(!of_dir(&["old.local"]).contains("does not contain"));
    let said = of_dir(&["old.local", "new.local", "10.1.2.3"]);
    assert!(
        said.contains("does not contain the names new.local, 10.1.2.3: the daemon keeps the certificate")
            && said.contains("move era-cert"),
        "{said}"
    );
    assert_eq!(read(), first, "clients trust it");
    let own = ["--tls-cert", certificate.to_str().unwrap(), "--tls-key", key.to_str().unwrap()];
    let said = serve(&[&own[..], &["--allow-host", "new.local", "--allow-host", "old.local"]].concat());
    assert!(said.contains("does not contain the names new.local: clients that use"), "{said}");
    // As it advises.
    std::fs::remove_file(&certificate).unwrap();
    std::fs::remove_file(&key).unwrap();
    assert!(!of_dir(&["old.local", "new.local", "10.1.2.3"]).contains("does not contain"));
    assert_ne!(read(), first);
}

/// However a token came, right or wrong: none is in the recording.
#[test]
fn a_recording_has_no_token_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.jsonl");
    let [right, wrong] = ["RIGHT", "WRONG"].map(|word| word.repeat(6));
    let access = Access { tokens: Access::parse_tokens(&format!("arm {right}")).unwrap(), ..Access::default() };
    let mut app = Daemon::app(STARTING_PLATE, access);
    app.record = Some(Recorder::start(&file, "example plate").unwrap());
    let background = BackgroundDaemon::start(app).unwrap();
    let at = background.address();
    let post = |path: &str, token: &str, body: &str| {
        let bearer = format!("Bearer {token}");
        let answer = Daemon::agent().post(format!("http://{at}{path}")).header("Authorization", bearer).send(body);
        answer.unwrap().status().as_u16()
    };
    let body = json!({"x_px": 300, "y_px": 600, "intensity_g": 0.1, "duration_ms": 20}).to_string();
    for path in ["/v1/touch", "/v1/arm", "/v1/faults/clear", "/v1/stop"] {
        assert_ne!(post(path, &right, &body), 401, "{path}");
        assert_eq!(post(path, &wrong, &body), 401, "{path}");
        // In an address, too, where none is looked for.
        assert_ne!(post(&format!("{path}?token={right}"), &right, &body), 401, "{path}");
    }
    let tap = json!({"type": "touch", "touches": [{"id": 1, "x_px": 400.0, "y_px": 500.0}], "intensity_g": 0.1});
    let by_address = format!("ws://{at}/v1/live?send=plan&token={right}").into_client_request().unwrap();
    let mut by_header = format!("ws://{at}/v1/live?send=plan").into_client_request().unwrap();
    by_header.headers_mut().insert("authorization", format!("Bearer {right}").parse().unwrap());
    for request in [by_address, by_header] {
        let (mut socket, _) = tungstenite::connect(request).unwrap();
        socket.send(Message::text(tap.to_string())).unwrap();
        while !matches!(socket.read().unwrap(), Message::Text(_)) {}
    }
    assert!(tungstenite::connect(format!("ws://{at}/v1/live?token={wrong}")).is_err());
    drop(background);
    let recorded = std::fs::read_to_string(&file).unwrap();
    for kind in ["touch", "arm", "clear", "stop", "fingers"] {
        assert!(recorded.contains(&format!("\"kind\":\"{kind}\"")), "no {kind} in {recorded}");
    }
    for secret in [&right, &wrong] {
        assert!(!recorded.contains(secret.as_str()), "{recorded}");
    }
}

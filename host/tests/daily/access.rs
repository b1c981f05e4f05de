//! Who is let in: the threats of docs/src/safety.md, one by one.

use crate::fingers::{Socket, live, next, say};
use crate::raw::{connect, send_and_listen};
use crate::secrets::write_secret;
use crate::support::Daemon;
use crate::support::program::{build_era_command, run_era};
use crate::support::served::Served;
use era::daemon::{Access, Listener};
use era::device::session::policy::SessionPolicy;
use era::scene::STARTING_PLATE;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::process::Stdio;
use std::time::Duration;
use tungstenite::Message;

fn request(
    daemon: &Daemon,
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
) -> (u16, ureq::http::HeaderMap, String) {
    let mut request = ureq::http::Request::builder().method(method).uri(format!("{}{path}", daemon.url));
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let agent: ureq::Agent = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .proxy(None)
        .allow_non_standard_methods(true)
        .timeout_global(Some(Duration::from_secs(30)))
        .build()
        .into();
    let mut answer = agent.run(request.body(()).unwrap()).unwrap();
    let text = answer.body_mut().read_to_string().unwrap();
    (answer.status().as_u16(), answer.headers().clone(), text)
}

#[test]
fn other_pages_are_let_in_by_name_only() {
    let own = "https://kiosk.example:8443";
    let access = Access { origins: vec![Access::parse_origin(own).unwrap()], ..Access::default() };
    let daemon = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), access);
    let (status, headers, _) = request(&daemon, "POST", "/v1/stop", &[("Origin", own)]);
    assert_eq!((status, headers.get("access-control-allow-origin").unwrap().to_str().unwrap()), (200, own));
    // What a browser asks before it lets the page post JSON.
    let asks = [
        ("Origin", own),
        ("Access-Control-Request-Method", "POST"),
        ("Access-Control-Request-Headers", "content-type"),
    ];
    let (status, headers, _) = request(&daemon, "OPTIONS", "/v1/touch", &asks);
    assert_eq!(status, 204);
    assert!(headers["access-control-allow-methods"].to_str().unwrap().contains("POST"));
    assert!(headers["access-control-allow-headers"].to_str().unwrap().contains("content-type"));
    for foreign in ["https://kiosk.example", "https://kiosk.example:8443.evil.example", "null"] {
        let (status, headers, text) = request(&daemon, "POST", "/v1/stop", &[("Origin", foreign)]);
        assert_eq!(status, 403, "{foreign}: {text}");
        assert!(headers.get("access-control-allow-origin").is_none(), "{foreign}");
        let (status, ..) = request(&daemon, "OPTIONS", "/v1/touch", &[("Origin", foreign), asks[1]]);
        assert_eq!(status, 403);
    }
    // The page may also open the socket, which browsers ask nobody about.
    let mut live = ureq::http::Request::builder().uri(format!("{}/v1/live", daemon.url.replace("http", "ws")));
    for (name, value) in [
        ("Host", "localhost"),
        ("Connection", "Upgrade"),
        ("Upgrade", "websocket"),
        ("Sec-WebSocket-Version", "13"),
        ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="),
        ("Origin", own),
    ] {
        live = live.header(name, value);
    }
    let (parts, ()) = live.body(()).unwrap().into_parts();
    let mut wanted = tungstenite::http::Request::builder().uri(parts.uri.to_string());
    for (name, value) in &parts.headers {
        wanted = wanted.header(name.as_str(), value.as_bytes());
    }
    tungstenite::connect(wanted.body(()).unwrap()).unwrap();
}

#[test]
fn a_request_from_another_site_without_an_origin_is_refused() {
    let daemon = Daemon::start(STARTING_PLATE);
    for site in ["cross-site", "same-site"] {
        let (status, _, text) = request(&daemon, "POST", "/v1/stop", &[("Sec-Fetch-Site", site)]);
        assert_eq!(status, 403, "{text}");
        assert_eq!(request(&daemon, "GET", "/v1/state", &[("Sec-Fetch-Site", site)]).0, 403);
    }
    assert_eq!(request(&daemon, "POST", "/v1/stop", &[("Sec-Fetch-Site", "same-origin")]).0, 200);
    let link = [("Sec-Fetch-Site", "cross-site"), ("Sec-Fetch-Mode", "navigate")];
    assert_eq!(request(&daemon, "GET", "/", &link).0, 200);
}

#[test]
fn names_that_are_not_ascii_are_not_taken_for_absent() {
    let daemon = Daemon::start(STARTING_PLATE);
    for headers in ["Host: pan\u{e9}l.example\r\n", "Host: localhost\r\nOrigin: http://pan\u{e9}l.example\r\n"] {
        let request = format!("POST /v1/stop HTTP/1.1\r\n{headers}Content-Length: 0\r\n\r\n");
        let answer = send_and_listen(&daemon, &request);
        assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    }
}

#[test]
fn tokens_open_what_their_role_allows() {
    let [view, touch, arm] = ["V", "T", "A"].map(|letter| letter.repeat(32));
    let tokens = Access::parse_tokens(&format!("view {view}\ntouch {touch}\narm {arm}\n")).unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    let status = |method: &str, path: &str, token: Option<&String>| {
        let bearer = token.map(|token| format!("Bearer {token}")).unwrap_or_default();
        let headers: Vec<(&str, &str)> = if token.is_some() { vec![("Authorization", &bearer)] } else { Vec::new() };
        request(&daemon, method, path, &headers).0
    };
    assert_eq!(status("GET", "/v1/state", None), 401);
    assert_eq!(status("POST", "/v1/stop", None), 401);
    assert_eq!(status("GET", "/v1/state", Some(&view)), 200);
    assert_eq!(status("POST", "/v1/stop", Some(&view)), 403);
    assert_eq!(status("POST", "/v1/stop", Some(&touch)), 200);
    assert_eq!(status("POST", "/v1/faults/clear", Some(&touch)), 403);
    assert_ne!(status("POST", "/v1/faults/clear", Some(&arm)), 403);
    assert_eq!(status("GET", "/v1/state", Some(&"X".repeat(32))), 401);
    let (.., text) = request(&daemon, "GET", "/v1/state", &[]);
    let problem: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(problem["type"], json!("urn:era:problem:token"));
    assert!(!text.contains(&view) && problem["detail"].as_str().unwrap().contains("Bearer"));
}

/// Who may look gets the plans and the state on a live socket, and nothing that is said there is done; with the role to touch, it is.
#[test]
fn a_socket_that_may_only_look_is_told_and_does_nothing() {
    let [view, touch] = ["V", "T"].map(|letter| letter.repeat(32));
    let tokens = Access::parse_tokens(&format!("view {view}\ntouch {touch}\n")).unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    let mut watching = live(&daemon, &format!("?send=plan&token={view}"));
    let mut touching = live(&daemon, &format!("?send=plan&token={touch}"));
    let finger = json!({"type": "touch", "touches": [{"id": 1, "x_px": 400, "y_px": 500}], "intensity_g": 0.1});
    let refused = |socket: &mut Socket| loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(message["type"], "error", "{message}");
            return message["problem"]["type"].clone();
        }
    };
    say(&mut watching, &finger);
    assert_eq!(refused(&mut watching), "urn:era:problem:role");
    say(&mut touching, &finger);
    let plan = next(&mut touching, "plan");
    // The first plan that the other one is told is this one: its own finger was not planned for.
    assert_eq!(next(&mut watching, "plan")["plan"]["drives"], plan["plan"]["drives"]);
    say(&mut watching, &json!({"type": "stop"}));
    assert_eq!(refused(&mut watching), "urn:era:problem:role");
    say(&mut touching, &json!({"type": "touch", "touches": [{"id": 1, "x_px": 900, "y_px": 500}], "intensity_g": 0.1}));
    assert_ne!(next(&mut touching, "plan")["plan"]["drives"], plan["plan"]["drives"], "it was not stopped");
}

/// Runs the program with these arguments; its exit code, and what it has printed to standard error.
pub fn ask_era(arguments: &[&str]) -> (i32, String) {
    let output = run_era(arguments);
    (output.code.unwrap(), output.error)
}

#[test]
fn the_network_is_served_only_with_a_token_and_tls() {
    for listen in ["0.0.0.0:0", "[::]:0"] {
        let (code, said) = ask_era(&["serve", "--listen", listen]);
        assert!(code == 2 && said.contains("--token-file") && said.contains("--tls-cert"), "{code} {said}");
    }
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    write_secret(&tokens, &format!("arm {}\n", "A".repeat(32)));
    let (code, said) = ask_era(&["serve", "--listen", "0.0.0.0:0", "--token-file", tokens.to_str().unwrap()]);
    assert!(code == 2 && said.contains("--tls-cert"), "{code} {said}");
    let tls = folder.path().join("tls");
    let (code, said) = ask_era(&["serve", "--listen", "0.0.0.0:0", "--tls-dir", tls.to_str().unwrap()]);
    assert!(code == 2 && said.contains("--token-file"), "{code} {said}");
    let default: std::net::SocketAddr = era::daemon::DEFAULT_LISTEN.parse().unwrap();
    assert!(default.ip().is_loopback(), "{default}");
    write_secret(&tokens, "arm short\n");
    let (code, said) = ask_era(&["serve", "--token-file", tokens.to_str().unwrap()]);
    assert!(code == 2 && said.contains("line 1"), "{code} {said}");
}

/// From another machine's point of view: a certificate that the daemon made, a token, the command line and any TLS client.
#[test]
fn tls_and_a_token_open_the_daemon_from_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let (tokens, tls) = (folder.path().join("tokens"), folder.path().join("tls"));
    write_secret(&tokens, &format!("touch {}\n", "T".repeat(32)));
    let mut serving = build_era_command()
        .args(["serve", "--listen", "0.0.0.0:0", "--socket", "none", "--accuracy", "fast", "--no-cache"])
        .arg("--token-file")
        .arg(&tokens)
        .arg("--tls-dir")
        .arg(&tls)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let log = BufReader::new(serving.stderr.take().unwrap());
    let port = log.lines().map_while(Result::ok).find_map(|line| {
        let (_, rest) = line.split_once("https://localhost:")?;
        rest.split(|c: char| !c.is_ascii_digit()).next().map(str::to_owned)
    });
    let url = format!("https://localhost:{}", port.unwrap());
    let (certificate, key) = (tls.join("era-cert.pem"), tls.join("era-key.pem"));
    let [ca, token] = [&certificate, &tokens].map(|path| path.to_str().unwrap());
    let mut all = vec![
        (ask_era(&["state", "--url", &url, "--ca", ca, "--token-file", token]), 0, ""),
        (ask_era(&["stop", "--url", &url, "--ca", ca, "--token-file", token]), 0, ""),
        (ask_era(&["state", "--url", &url, "--ca", ca]), 1, "token"),
        // Nobody else vouches for it.
        (ask_era(&["state", "--url", &url, "--token-file", token]), 1, "is not trusted"),
        (ask_era(&["state", "--url", &url.replace("https", "http"), "--token-file", token]), 1, "speaks TLS"),
        (ask_era(&["state", "--url", &url.replace("localhost", "127.0.0.2"), "--ca", ca]), 1, "is for other names"),
        (ask_era(&["doctor", "--url", &url.replace("https", "http")]), 0, ""),
    ];
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(&key).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode, 0o600, "the key is for its owner alone");
    }
    serving.kill().unwrap();
    serving.wait().unwrap();
    for ((code, said), wanted, piece) in all.drain(..) {
        assert!(code == wanted && said.contains(piece), "{code} {said:?}, {wanted} {piece:?} wanted");
    }
}

/// Whoever may open the socket needs no token; nobody else may open it, and the next daemon finds its place free.
#[cfg(unix)]
#[test]
fn the_socket_in_the_file_system_is_for_its_owner() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::net::UnixStream;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep/era.sock");
    let access =
        Access { tokens: Access::parse_tokens(&format!("touch {}", "T".repeat(32))).unwrap(), ..Access::default() };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    for _ in 0..2 {
        let app = std::sync::Arc::new(Daemon::app(STARTING_PLATE, access.clone()));
        let listener = runtime.block_on(async { Listener::bind_unix(&path) }).unwrap();
        let mode = std::fs::metadata(&path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode, 0o600);
        let taken = runtime.block_on(async { Listener::bind_unix(&path) }).unwrap_err();
        assert!(taken.to_string().contains("another daemon"), "{taken}");
        let served = Served::on(&app, async { vec![listener] });
        let mut stream = UnixStream::connect(&path).unwrap();
        stream.write_all(b"GET /v1/state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        drop(served);
        assert!(!path.exists(), "the socket goes with its daemon");
    }
    // What a killed daemon left behind is in nobody's way; what is no socket is not touched.
    drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
    assert!(path.exists());
    runtime.block_on(async { Listener::bind_unix(&path) }).unwrap();
    std::fs::write(&path, "a file").unwrap();
    let kept = runtime.block_on(async { Listener::bind_unix(&path) });
    assert!(kept.is_err() && std::fs::read_to_string(&path).unwrap() == "a file");
}

/// Whoever fills the port keeps its owner's stop out of the port, and not out of the socket.
#[cfg(unix)]
#[test]
fn a_crowd_at_the_port_is_not_at_the_socket() {
    use std::os::unix::net::UnixStream;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("era.sock");
    let app = std::sync::Arc::new(Daemon::app(STARTING_PLATE, Access::default()));
    let mut address = String::new();
    let _served = Served::on(&app, async {
        let port = Listener::bind_tcp("127.0.0.1:0".parse().unwrap(), None, false).await.unwrap();
        address = port.url().trim_start_matches("http://").to_owned();
        vec![port, Listener::bind_unix(&path).unwrap()]
    });
    let crowd: Vec<_> = (0..300).map(|_| std::net::TcpStream::connect(&address).unwrap()).collect();
    let mut stream = UnixStream::connect(&path).unwrap();
    stream
        .write_all(b"POST /v1/stop HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")
        .unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    // The simulated device may not have answered yet: what counts is that the stop was taken.
    assert!(answer.starts_with("HTTP/1.1 200") || answer.starts_with("HTTP/1.1 502"), "{answer}");
    drop(crowd);
}

/// One connection after the other is asked for its token before anything is read of it.
#[test]
fn a_token_is_asked_for_before_the_body_is_read() {
    let access =
        Access { tokens: Access::parse_tokens(&format!("touch {}", "T".repeat(32))).unwrap(), ..Access::default() };
    let daemon = Daemon::start_guarded(STARTING_PLATE, access);
    let mut stream = connect(&daemon);
    stream.write_all(b"POST /v1/touch HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n\r\n").unwrap();
    let mut first = [0; 12];
    stream.read_exact(&mut first).unwrap();
    assert_eq!(&first, b"HTTP/1.1 401");
}

/// Every file of the page forbids other pages to show it in a frame; what a browser makes of that is in `page.rs`.
#[test]
fn no_file_of_the_page_may_be_framed() {
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access::default());
    for path in
        ["/", "/app.js", "/design.js", "/heat.js", "/link.js", "/panel.js", "/readout.js", "/style.css", "/icon.svg"]
    {
        let (status, headers, _) = request(&daemon, "GET", path, &[]);
        let policy = headers.get("content-security-policy").map_or("", |value| value.to_str().unwrap());
        let has = policy.split(';').any(|directive| directive.trim() == "frame-ancestors 'none'");
        assert!(status == 200 && has, "{path}: {status}, {policy:?}");
    }
}

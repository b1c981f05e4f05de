//! Pages of other origins: whatever the option takes lets in the page that a browser, or an application's web view, opens so.

use crate::access::ask_era;
use crate::raw::{address, send_and_listen};
use crate::support::Daemon;
use era::daemon::Access;
use era::device::session::policy::SessionPolicy;
use era::scene::STARTING_PLATE;

/// What is allowed, and the `Origin` that is sent for it (as the platforms document them, or as <https://url.spec.whatwg.org> has it).
const LET_IN: &[(&str, &str)] = &[
    ("tauri://localhost", "tauri://localhost"),
    ("http://tauri.localhost", "http://tauri.localhost"),
    ("https://tauri.localhost", "https://tauri.localhost"),
    ("capacitor://localhost", "capacitor://localhost"),
    ("ionic://localhost", "ionic://localhost"),
    ("app://obsidian.md", "app://obsidian.md"),
    ("app://localhost", "app://localhost"),
    ("app://.", "app://."),
    ("app://-", "app://-"),
    ("wails://wails.localhost:34115", "wails://wails.localhost:34115"),
    ("vscode-webview://1a2b3c4d", "vscode-webview://1a2b3c4d"),
    ("vscode-file://vscode-app", "vscode-file://vscode-app"),
    ("chrome-extension://aapbdbdomjkkjkaonfhkkikfgjllcleb", "chrome-extension://aapbdbdomjkkjkaonfhkkikfgjllcleb"),
    ("moz-extension://7d3a5b1e-0c6f-4a3e-9c1d-2f1f5a0b7c11", "moz-extension://7d3a5b1e-0c6f-4a3e-9c1d-2f1f5a0b7c11"),
    ("safari-web-extension://7D3A5B1E-0C6F", "safari-web-extension://7D3A5B1E-0C6F"),
    ("TAURI://LocalHost", "tauri://localhost"),
    ("https://kiosk.example", "https://kiosk.example"),
    ("https://kiosk.example:443", "https://kiosk.example"),
    ("http://kiosk.example:80", "http://kiosk.example"),
    ("http://kiosk.example:443", "http://kiosk.example:443"),
    ("https://kiosk.example:80", "https://kiosk.example:80"),
    ("https://kiosk.example:0443", "https://kiosk.example"),
    ("https://kiosk.example:", "https://kiosk.example"),
    ("HTTPS://Kiosk.Example:8443", "https://kiosk.example:8443"),
    ("https://xn--mnchen-3ya.example", "https://xn--mnchen-3ya.example"),
    ("http://[::1]:80", "http://[::1]"),
    ("http://[0:0:0:0:0:0:0:1]:3000", "http://[::1]:3000"),
    ("http://[::ffff:127.0.0.1]", "http://[::ffff:7f00:1]"),
    ("http://127.0.0.1:3000", "http://127.0.0.1:3000"),
    ("http://localhost:3000", "http://localhost:3000"),
    ("http://kiosk_2", "http://kiosk_2"),
];

/// What no browser ever sends, or nobody should let in.
const REFUSED: &[&str] = &[
    "",
    "*",
    "null",
    "kiosk",
    "kiosk.example:8443",
    "http://",
    "http://*",
    "https://*.kiosk.example",
    "app://*",
    "https://kiosk.example.",
    "https://kiosk.example.:8443",
    "https://.kiosk.example",
    "https://kiosk..example",
    "tauri://localhost.",
    "http://kiosk/",
    "http://kiosk/page",
    "http://kiosk?x",
    "http://kiosk#x",
    "http://kiosk\\page",
    "http://user@kiosk",
    "http://user:word@kiosk",
    "http://kiosk:99999",
    "http://kiosk:-1",
    "http://kiosk:80a",
    "http://ki osk",
    " http://kiosk",
    "http://kiosk ",
    "http://kiosk, http://other",
    "http://[::1",
    "http://[fe80::1%25eth0]",
    "http://256.1.1.1",
    "https://m\u{fc}nchen.example",
    "http://kiosk\u{3002}example",
    "http://127.1",
    "http://0x7f.0.0.1",
    "http://2130706433",
    "http://127.0.0.01",
    "http://kiosk%2eexample",
    "http://kiosk\tx",
    "tauri://localhost/",
    "tauri://localhost/index.html",
    "tauri://",
    "tauri:localhost",
    "app://k\u{f6}nig",
    "file://",
    "file:///home/kiosk/index.html",
    "file://localhost",
    "data://x",
    "blob://x",
    "about://blank",
    "javascript://x",
    "ws://kiosk",
    "wss://kiosk",
    "ftp://kiosk",
    "1app://x",
    "a_b://x",
    "://x",
];

#[test]
fn a_page_whose_origin_is_allowed_is_let_in_however_it_was_written() {
    for (allowed, sent) in LET_IN {
        assert_eq!(Access::parse_origin(allowed).as_deref(), Ok(sent.to_lowercase().as_str()), "{allowed}");
    }
    let origins = LET_IN.iter().map(|(allowed, _)| Access::parse_origin(allowed).unwrap()).collect();
    let daemon = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), Access { origins, ..Access::default() });
    let ask = |origin: &str| {
        let lines = format!("Host: {}\r\nOrigin: {origin}\r\nSec-Fetch-Site: cross-site", address(&daemon));
        send_and_listen(&daemon, &format!("POST /v1/stop HTTP/1.1\r\n{lines}\r\n\r\n"))
    };
    for (_, sent) in LET_IN {
        let answer = ask(sent);
        assert!(answer.starts_with("HTTP/1.1 200"), "{sent}: {answer}");
        assert!(answer.contains(&format!("access-control-allow-origin: {sent}\r\n")), "{answer}");
        for other in [format!("{sent}.evil.example"), format!("{sent}:1"), format!("{sent}/"), format!("x{sent}")] {
            assert!(ask(&other).starts_with("HTTP/1.1 403"), "{other} is let in");
        }
    }
    for other in ["null", "https://evil.example", "file://", "http://kiosk.example:8080", "app://other"] {
        assert!(ask(other).starts_with("HTTP/1.1 403"), "{other} is let in");
    }
}

#[test]
fn what_could_never_match_is_refused_at_the_start() {
    for text in REFUSED {
        let found = Access::parse_origin(text);
        assert!(found.is_err(), "{text:?} is taken as {found:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("era.toml");
    for text in ["https://kiosk.example.", "https://*.kiosk.example", "file://", "http://kiosk/page", "ws://kiosk"] {
        let (code, said) = ask_era(&["serve", "--allow-origin", text]);
        assert!(code == 2 && said.contains("--allow-origin") && said.contains(text), "{text}: {code} {said}");
        std::fs::write(&file, format!("version = 1\nallow_origin = [\"{text}\"]\n")).unwrap();
        let (code, said) = ask_era(&["config", "check", file.to_str().unwrap()]);
        assert!(code == 2 && said.contains("allow_origin"), "{text}: {code} {said}");
    }
}

#[test]
fn a_name_that_is_allowed_is_known_however_it_is_written() {
    let names = [
        ("PANEL.local", "panel.LOCAL:7878", "panel.local"),
        ("desk.local.", "desk.local", "desk.local"),
        ("stand.local", "stand.local.", "stand.local"),
        ("XN--mnchen-3ya.example", "xn--mnchen-3ya.example", "xn--mnchen-3ya.example"),
        ("panel_2", "panel_2", "panel_2"),
        ("192.168.1.20", "192.168.1.20", "192.168.1.20"),
        ("[fe80::1]", "[fe80::1]:7878", "fe80::1"),
        ("fe80:0::2", "[fe80::2]", "fe80::2"),
    ];
    let hosts = names.iter().map(|(allowed, ..)| Access::parse_host(allowed).unwrap()).collect();
    let daemon = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), Access { hosts, ..Access::default() });
    let ask = |host: &str| send_and_listen(&daemon, &format!("GET /v1/state HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    for (allowed, taken, kept) in names {
        assert_eq!(Access::parse_host(allowed).as_deref(), Ok(kept));
        let answer = ask(taken);
        assert!(answer.starts_with("HTTP/1.1 200"), "{allowed}, {taken}: {answer}");
    }
    for other in ["panel.local.evil.example", "local", "xpanel.local", "panel"] {
        assert!(ask(other).starts_with("HTTP/1.1 403"), "{other}");
    }
    for text in [
        "",
        ".",
        "*",
        "*.local",
        "panel.local:7878",
        "http://panel.local",
        "panel.local/",
        "user@panel",
        "a..b",
        ".local",
        "pa nel",
        "panel.local..",
        "[panel]",
        "256.1.1.1",
        "panel%20local",
        "[fe80::1]:7878",
        "panel.local:",
        "m\u{fc}nchen.example",
        "127.1",
    ] {
        let found = Access::parse_host(text);
        assert!(found.is_err(), "{text:?} is taken as {found:?}");
    }
}

/// The daemon's own page, by each way to write where it is.
#[test]
fn the_own_page_is_known_with_and_without_the_usual_port() {
    let daemon = Daemon::start(STARTING_PLATE);
    for (host, origin, is_own) in [
        ("localhost", "http://localhost", true),
        ("localhost:80", "http://localhost", true),
        ("localhost", "http://localhost:80", true),
        ("LOCALHOST:7878", "http://localhost:7878", true),
        ("localhost.:7878", "http://localhost.:7878", true),
        ("[::1]:7878", "http://[::1]:7878", true),
        ("localhost", "https://localhost", false),
        ("localhost:443", "http://localhost", false),
        ("localhost:7878", "http://localhost:7879", false),
        ("localhost:7878", "http://127.0.0.1:7878", false),
        ("localhost.:7878", "http://localhost:7878", false),
        ("localhost:7878", "tauri://localhost:7878", false),
        ("localhost:7878", "http://user@localhost:7878", false),
        ("localhost:7878", "http://localhost:7878/", false),
        ("localhost:7878", "localhost:7878", false),
        ("localhost:7878", "", false),
    ] {
        let answer =
            send_and_listen(&daemon, &format!("POST /v1/stop HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\n\r\n"));
        let wanted = if is_own { "HTTP/1.1 200" } else { "HTTP/1.1 403" };
        assert!(answer.starts_with(wanted), "{host} {origin}: {answer}");
    }
}

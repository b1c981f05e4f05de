//! The daemon behind nginx, below a prefix and with TLS, by the configurations that the manual prints (docs/src/reverse-proxy.md). Needs
//! nginx; without it the test says so and counts as passed only where `ERA_NO_NGINX` is set.

mod support;

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use support::browser::{Browser, browser_or_skip};
use support::program::{build_era_command, run_era};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use tungstenite::{Message, WebSocket};

const PAGE: &str = include_str!("../../docs/src/reverse-proxy.md");
const NAME: &str = "panel.example";
const TOKEN: &str = "T0123456789abcdef0123456789";
const WAIT: Duration = Duration::from_secs(60);

/// nginx; `None` where the test is to be skipped.
fn nginx_or_skip() -> Option<&'static str> {
    let runs =
        |name: &&str| Command::new(name).arg("-v").stderr(Stdio::null()).status().is_ok_and(|status| status.success());
    let program = ["nginx", "/usr/sbin/nginx"].into_iter().find(runs);
    if program.is_none() {
        assert!(std::env::var_os("ERA_NO_NGINX").is_some(), "no nginx here: install it, or set ERA_NO_NGINX");
        eprintln!("skipped: no nginx here and ERA_NO_NGINX is set");
    }
    program
}

/// The only block of a language on the manual's page.
fn printed(language: &str) -> String {
    let blocks: Vec<&str> = PAGE.split("```").skip(1).step_by(2).collect();
    let of =
        |block: &&str| block.split_once('\n').filter(|(name, _)| *name == language).map(|(_, text)| text.to_owned());
    let found: Vec<String> = blocks.iter().filter_map(of).collect();
    assert_eq!(found.len(), 1, "{language}");
    found.into_iter().next().unwrap()
}

/// Puts this machine's places into a printed file; each of them stands there once.
fn placed(mut text: String, places: &[(&str, String)]) -> String {
    for (printed, own) in places {
        assert_eq!(text.matches(printed).count(), 1, "{printed:?} in {text}");
        text = text.replace(printed, own);
    }
    text
}

/// A process that ends with the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // nginx ends its workers where it is asked to end.
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(10) && matches!(self.0.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The daemon and nginx before it.
struct Proxied {
    daemon: Option<Process>,
    _nginx: Process,
    port: u16,
    tls: Arc<ClientConfig>,
    folder: tempfile::TempDir,
}

impl Proxied {
    fn start(nginx: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        let (daemon, address) = start_daemon(folder.path());
        let made = rcgen::generate_simple_self_signed([NAME.to_owned(), "localhost".to_owned()]).unwrap();
        std::fs::write(at("cert.pem"), made.cert.pem()).unwrap();
        std::fs::write(at("key.pem"), made.signing_key.serialize_pem()).unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let site = placed(
            printed("nginx"),
            &[
                ("listen 443 ssl", format!("listen 127.0.0.1:{port} ssl")),
                ("/etc/ssl/certs/panel.example.pem", at("cert.pem")),
                ("/etc/ssl/private/panel.example.key", at("key.pem")),
                ("127.0.0.1:7878", address),
            ],
        );
        std::fs::write(at("site"), site).unwrap();
        let scratch: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .iter()
            .map(|name| format!("{name}_temp_path {};\n", at(name)))
            .collect();
        // What Debian's own file has around the sites, with places that this user may write to.
        let whole = format!(
            "user root root;\ndaemon off;\nworker_processes 1;\npid {};\nerror_log {} info;\nevents {{}}\nhttp {{\naccess_log {};\n{scratch}include {};\n}}\n",
            at("pid"),
            at("error.log"),
            at("access.log"),
            at("site")
        );
        std::fs::write(at("nginx.conf"), whole).unwrap();
        let process = Command::new(nginx)
            .args(["-p", folder.path().to_str().unwrap(), "-c", &at("nginx.conf"), "-e", &at("error.log")])
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut roots = RootCertStore::empty();
        roots.add(CertificateDer::from(made.cert.der().to_vec())).unwrap();
        let tls = ClientConfig::builder().with_root_certificates(roots).with_no_client_auth();
        let proxied = Self { daemon: Some(daemon), _nginx: Process(process), port, tls: Arc::new(tls), folder };
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            let log = std::fs::read_to_string(proxied.folder.path().join("error.log")).unwrap_or_default();
            assert!(begun.elapsed() < WAIT, "nginx does not listen: {log}");
            std::thread::sleep(Duration::from_millis(50));
        }
        proxied
    }

    fn connect(&self) -> StreamOwned<ClientConnection, TcpStream> {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(WAIT)).unwrap();
        let name = ServerName::try_from(NAME).unwrap();
        StreamOwned::new(ClientConnection::new(Arc::clone(&self.tls), name).unwrap(), stream)
    }

    /// Status, head in lower case, and body of the answer to a request with these header lines.
    fn ask(&self, first: &str, lines: &[&str], body: &str) -> (u16, String, String) {
        let mut stream = self.connect();
        let lines: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
        let length = body.len();
        let head = format!("{first} HTTP/1.1\r\n{lines}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}");
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = Vec::new();
        // Some servers end a connection without TLS's own end.
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        (status, head.to_ascii_lowercase(), body.to_owned())
    }

    /// What nginx has logged, in all of its files.
    fn logs(&self) -> String {
        ["access.log", "error.log"]
            .map(|name| std::fs::read_to_string(self.folder.path().join(name)).unwrap_or_default())
            .join("\n")
    }
}

/// The daemon by the printed configuration, with the simulated device; and where it listens.
fn start_daemon(folder: &Path) -> (Process, String) {
    let (config, tokens) = (folder.join("era.toml"), folder.join("tokens"));
    // Where it is told otherwise, the command line counts.
    std::fs::write(&config, printed("toml")).unwrap();
    write_secret(&tokens, &format!("arm {TOKEN}\n"));
    let mut command = build_era_command();
    command.args(["--log-format", "json", "serve", "--config", config.to_str().unwrap()]);
    command.args(["--listen", "127.0.0.1:0", "--device", "sim", "--socket", "none", "--accuracy", "fast"]);
    command.args(["--token-file", tokens.to_str().unwrap()]);
    let mut process = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
    let open = |line: String| {
        let line: Value = serde_json::from_str(&line).unwrap();
        line["message"].as_str()?.split_once("open http://")?.1.split_whitespace().next().map(str::to_owned)
    };
    let address = lines.find_map(open).expect("it says where it serves");
    std::thread::spawn(move || lines.for_each(drop));
    (Process(process), address)
}

fn write_secret(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
    }
}

/// Whether the daemon took it, and said so itself. Its simulated board may be late, or off, where the machine stood still.
fn is_of_the_daemon(status: u16, told: &str) -> bool {
    status == 200 || [409, 502, 503].contains(&status) && told.contains("urn:era:problem:device-")
}

/// The next message of a kind.
fn next<S: Read + Write>(socket: &mut WebSocket<S>, is_wanted: impl Fn(&str) -> bool) -> Value {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < WAIT, "no such message has come");
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            let kind = message["type"].as_str().unwrap();
            if is_wanted(kind) && !(kind == "plan" && message["plan"].is_null()) {
                return message;
            }
        }
    }
}

#[test]
fn the_manuals_configuration_serves_requests_and_the_live_socket() {
    let Some(nginx) = nginx_or_skip() else { return };
    let mut proxied = Proxied::start(nginx);
    let host = format!("Host: {NAME}");
    let token = format!("Authorization: Bearer {TOKEN}");
    let own = format!("Origin: https://{NAME}");
    // The page, and every file that it names, below the prefix.
    let (status, head, _) = proxied.ask("GET /era", &[&host], "");
    assert!(status == 301 && head.contains("/era/"), "{status} {head}");
    let (status, _, page) = proxied.ask("GET /era/", &[&host], "");
    assert_eq!(status, 200, "{page}");
    let mut files = 0;
    for part in page.split(['"', '\'']).filter(|part| [".css", ".js", ".svg"].iter().any(|end| part.ends_with(end))) {
        assert!(!part.starts_with('/'), "{part} leads away from the prefix");
        let (status, ..) = proxied.ask(&format!("GET /era/{part}"), &[&host], "");
        assert_eq!(status, 200, "{part}");
        files += 1;
    }
    assert!(files >= 3, "{page}");
    // Tokens, pages and names are looked at as without nginx.
    let (status, head, _) = proxied.ask("GET /era/v1/state", &[&host], "");
    assert!(status == 401 && head.contains("www-authenticate: bearer"), "{head}");
    assert_eq!(proxied.ask("GET /era/v1/state", &[&host, &token], "").0, 200);
    assert_eq!(proxied.ask("GET /era/metrics", &[&host, &token], "").0, 200);
    let touch = r#"{"x_px": 960, "y_px": 640, "intensity_g": 0.1, "duration_ms": 9000}"#;
    let (status, _, told) = proxied.ask("POST /era/v1/touch", &[&host, &token, &own], touch);
    assert!(is_of_the_daemon(status, &told), "{status} {told}");
    for line in ["Origin: https://elsewhere.example", "Sec-Fetch-Site: cross-site"] {
        let (status, _, told) = proxied.ask("POST /era/v1/touch", &[&host, &token, line], touch);
        assert!(status == 403 && told.contains("foreign-origin"), "{line}: {told}");
    }
    let (status, _, told) = proxied.ask("GET /era/v1/state", &["Host: elsewhere.example", &token], "");
    assert!(status == 403 && told.contains("foreign-host"), "{told}");
    let (status, _, told) = proxied.ask("POST /era/v1/touch", &[&host, &token], &" ".repeat(20_000));
    assert!(status == 413 && told.contains("urn:era:problem:bad-body"), "{status} {told}");
    assert_eq!(proxied.ask("GET /v1/state", &[&host, &token], "").0, 404, "nothing but the prefix is the daemon's");
    let (status, _, told) = proxied.ask("POST /era/v1/stop", &[&host, &token, &own], "");
    assert!(is_of_the_daemon(status, &told), "{status} {told}");
    // The live socket, as a page opens it.
    let request = tungstenite::http::Request::builder()
        .uri(format!("wss://{NAME}/era/v1/live?send=state,plan&token={TOKEN}"))
        .header("Host", NAME)
        .header("Origin", format!("https://{NAME}"))
        .header("Connection", "Upgrade")
        .header("Upgrade", "websocket")
        .header("Sec-WebSocket-Version", "13")
        .header("Sec-WebSocket-Key", tungstenite::handshake::client::generate_key())
        .body(())
        .unwrap();
    let (mut socket, _) = tungstenite::client(request, proxied.connect()).unwrap();
    next(&mut socket, |kind| kind == "state");
    let finger = json!({"type": "touch", "touches": [{"id": 1, "x_px": 480, "y_px": 640}], "intensity_g": 0.1});
    socket.send(Message::text(finger.to_string())).unwrap();
    let told = next(&mut socket, |kind| kind == "plan" || kind == "error");
    let problem = told["problem"]["type"].as_str().unwrap_or_default();
    assert!(told["touches"][0]["x_px"] == 480.0 || problem.contains(":device-"), "{told}");
    socket.send(Message::text(json!({"type": "stop"}).to_string())).unwrap();
    let begun = Instant::now();
    while !next(&mut socket, |kind| kind == "state")["plan"].is_null() {
        assert!(begun.elapsed() < WAIT, "it is not stopped");
    }
    // The commands, with the prefix in their address.
    let at = |name: &str| proxied.folder.path().join(name).display().to_string();
    let url = format!("https://localhost:{}/era", proxied.port);
    for command in ["state", "stop"] {
        let output = run_era(&[command, "--url", &url, "--ca", &at("cert.pem"), "--token-file", &at("tokens")]);
        let is_late = output.error.contains("the device at");
        assert!(output.is_success() || is_late, "{command}: {output:?}");
    }
    // Where the daemon has ended the page is told so, and nginx answers by itself.
    drop(proxied.daemon.take());
    let closed = loop {
        match socket.read() {
            Ok(Message::Close(frame)) => break frame,
            Ok(_) => {}
            Err(error) => panic!("no close: {error}"),
        }
    };
    assert_eq!(closed.map(|frame| u16::from(frame.code)), Some(1001));
    let live = format!("GET /era/v1/live?token={TOKEN}");
    assert_eq!(proxied.ask(&live, &[&host], "").0, 502);
    let logs = proxied.logs();
    assert!(!logs.contains(TOKEN), "{logs}");
    assert!(logs.contains("GET /v1/state"), "what is not the daemon's is logged: {logs}");
}

#[test]
fn the_page_works_below_a_prefix() {
    let Some((nginx, program)) = nginx_or_skip().zip(browser_or_skip()) else { return };
    let proxied = Proxied::start(nginx);
    // As if the machine had this name, and the usual port.
    let rules = format!("--host-resolver-rules=MAP {NAME}:443 127.0.0.1:{}", proxied.port);
    let mut browser = Browser::start_with(program, 1280, 800, &[&rules, "--ignore-certificate-errors"]);
    browser.open(&format!("https://{NAME}/era/#token={TOKEN}"));
    browser.wait_for("document.body?.dataset.state === 'safe'");
    browser.wait_for("document.querySelector('#connection').textContent === 'connected'");
    let sheets =
        "[...document.styleSheets].some(sheet => sheet.href.endsWith('/era/style.css') && sheet.cssRules.length)";
    assert_eq!(browser.value(sheets), true, "no style");
    let at = browser.point("#panel", 0.3, 0.4);
    browser.mouse("mousePressed", at);
    // What the board says to it is another matter: on a busy machine it may have gone off.
    browser.wait_for("document.body.dataset.plan !== '' || !document.querySelector('#error').hidden");
    browser.value("document.querySelector('#stop').click()");
    let stopped = "performance.getEntriesByType('resource').filter(entry => entry.name.endsWith('/era/v1/stop')\
                   && [200, 502, 503].includes(entry.responseStatus)).length";
    browser.wait_for(stopped);
    browser.mouse("mouseReleased", at);
    let away = "performance.getEntriesByType('resource').map(entry => new URL(entry.name).pathname)\
                .filter(path => !path.startsWith('/era/')).join()";
    assert_eq!(browser.value(away), "", "nothing is asked for beside the prefix");
    let asked = browser.value("performance.getEntriesByType('resource').length");
    assert!(asked.as_u64() > Some(8), "{asked}");
}

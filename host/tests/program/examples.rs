//! The examples of `docs/src/http.md`, as they stand there, against daemons; only ports are others. Those of `docs/src/studies.md`, as studies.

use crate::support;
use era::daemon::Access;
use era::device::session::policy::SessionPolicy;
use era::device::sim::SimKnobs;
use era::scene::STARTING_PLATE;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::LazyLock;
use support::Daemon;
use support::browser::{Browser, browser_or_skip, serve_page};
use support::program::{build_era_command, make_scratch_path};

/// Where the page's examples expect a daemon.
const HERE: &str = "127.0.0.1:7878";
const ELSEWHERE: &str = "panel.local:7878";

/// A file of the repository.
fn file(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)).unwrap()
}

/// Every piece of code in a page of the manual: its language, and its lines.
fn code(page: &str) -> Vec<(String, String)> {
    let page = file(&format!("docs/src/{page}"));
    // Between the marks, text and code take turns.
    let pieces = page.split("\n```").skip(1).step_by(2);
    pieces.map(|piece| piece.split_once('\n').unwrap()).map(|(kind, text)| (kind.to_owned(), text.to_owned())).collect()
}

/// The only piece of that language that has these words in it.
fn example(language: &str, words: &str) -> String {
    let mut found = code("http.md").into_iter().filter(|(kind, text)| kind == language && text.contains(words));
    let (_, text) = found.next().unwrap_or_else(|| panic!("no {language} with {words:?}"));
    assert!(found.next().is_none(), "several {language} with {words:?}");
    text
}

/// How often an example may be begun anew as the board was late, which is the machine's fault: Chromium's start takes all of it.
const LATE: usize = 5;

/// What a program in Python prints, in a folder with its files.
fn python(interpreter: &Path, program: &str, folder: &Path) -> Vec<String> {
    std::fs::write(folder.join("example.py"), program).unwrap();
    for times in 0.. {
        let mut command = Command::new(interpreter);
        command.arg("example.py").current_dir(folder).env("PYTHONPATH", folder).env("NO_PROXY", "");
        // Nobody listens there, and nothing is to be written there: the examples let neither lead them.
        for variable in ["http_proxy", "HTTP_PROXY", "https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"] {
            command.env(variable, "http://127.0.0.1:9");
        }
        let keys = folder.join("keys.log");
        let output = command.env("SSLKEYLOGFILE", &keys).output();
        assert!(!keys.exists(), "the keys of a connection were written down");
        let output = output.unwrap_or_else(|error| panic!("{}: {error}", interpreter.display()));
        let [told, wrong] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        if output.status.success() && wrong.is_empty() {
            return told.lines().map(str::to_owned).collect();
        }
        assert!(wrong.contains("HTTP Error 503") && times < LATE, "{told}{wrong}");
    }
    unreachable!("it ends with an answer or fails")
}

/// Of the 0.2 g that the examples ask for, which the plate has room for everywhere; to a thousandth.
fn is_plan(line: &str) -> bool {
    let peak_g = line.strip_prefix("plan: ").and_then(|peak| peak.parse::<f64>().ok());
    peak_g.is_some_and(|peak_g| (peak_g - 0.2).abs() < 2e-4)
}

fn is_off(state: &str) -> bool {
    ["safe", "discharging"].contains(&state)
}

/// A new example wants a test here.
#[test]
fn every_example_is_one_that_is_run() {
    let count = |language: &str| code("http.md").iter().filter(|(kind, _)| kind == language).count();
    assert_eq!((count("python"), count("html"), count("javascript"), count("js")), (3, 1, 0, 0));
    assert!(code("http.md").iter().all(|(kind, _)| ["python", "html", "console"].contains(&kind.as_str())));
}

/// `curl` goes where the environment sends it, also with requests for this machine, unless it is told not to.
#[test]
fn every_example_of_curl_leaves_proxies_alone() {
    let mut count = 0;
    for page in ["README.md", "docs/src/http.md", "docs/src/network.md", "docs/src/guide-first-application.md"] {
        for line in file(page).lines().filter(|line| line.starts_with("curl ") || line.starts_with("$ curl ")) {
            assert!(line.contains("--noproxy '*'") || line.contains("--unix-socket"), "{page}: {line}");
            count += 1;
        }
    }
    assert!(count > 8, "{count}");
}

/// What sends elsewhere gets no `POST` turned into a `GET`, and no token: the examples call it an error.
#[test]
fn the_python_examples_follow_no_redirect() {
    let elsewhere = TcpListener::bind("127.0.0.1:0").unwrap();
    let there = elsewhere.local_addr().unwrap();
    elsewhere.set_nonblocking(true).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for status in [301, 302, 303, 307, 308] {
        let front = TcpListener::bind("127.0.0.1:0").unwrap();
        let here = front.local_addr().unwrap().to_string();
        std::thread::spawn(move || {
            use std::io::Write;
            for stream in front.incoming().map_while(Result::ok) {
                let mut lines = BufReader::new(&stream).lines().map_while(Result::ok);
                while lines.next().is_some_and(|line| !line.is_empty()) {}
                let answer = format!(
                    "HTTP/1.1 {status} Elsewhere\r\nLocation: http://{there}/v1/touch\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
                );
                let _ = (&stream).write_all(answer.as_bytes());
            }
        });
        let program = example("python", "def ask_again").replace(HERE, &here);
        std::fs::write(folder.path().join("example.py"), program).unwrap();
        let output = Command::new("python3").arg("example.py").current_dir(folder.path()).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(told.contains(&status.to_string()), "{status}: {told}");
        assert!(elsewhere.accept().is_err(), "{status}: it went elsewhere");
    }
}

/// Plain Python, when all is well and when it is not.
#[test]
fn plain_python_touches_and_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(STARTING_PLATE);
    let program = example("python", "def ask_again").replace(HERE, daemon.url.trim_start_matches("http://"));
    assert!(program.contains(&daemon.url));
    let run = || python(Path::new("python3"), &program, folder.path());
    let told = run();
    let number = told[0].strip_suffix(" None").and_then(|number| number.parse::<u64>().ok());
    assert!(number.is_some() && (told.len(), told[1].as_str()) == (3, "done"), "{told:?}");
    assert!(is_off(&told[2]) && daemon.sim.last_drives_received_at().is_some(), "{told:?}");
    // A board that was away, a fault, and no daemon at all.
    daemon.sim.request_restart();
    daemon.wait_for(|state| state["device"]["waits_to_be_armed"] == true);
    let told = run();
    assert!(told.len() == 1 && told[0].starts_with("a person has to look: 409 not-armed:"), "{told:?}");
    assert_eq!(daemon.post("/v1/arm", "").0, 200);
    let mut knobs = SimKnobs::default();
    knobs.defects.interlock_open = true;
    daemon.sim.set_knobs(knobs);
    daemon.wait_for(|state| state["device"]["state"] == "fault");
    let told = run();
    assert!(told.len() == 1 && told[0].starts_with("a person has to look: 409 device-fault:"), "{told:?}");
    drop(daemon);
    let told = run();
    assert!(told.len() == 1 && told[0].starts_with("no daemon:"), "{told:?}");
}

/// The live socket, with the package that the page names.
#[test]
fn python_draws_a_finger_over_the_live_socket() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(STARTING_PLATE);
    let program = example("python", "from websockets").replace(HERE, daemon.url.trim_start_matches("http://"));
    let told = python(&with_websockets(), &program, folder.path());
    assert!(!told.is_empty() && told.iter().all(|line| is_plan(line)), "{told:?}");
    daemon.wait_for(|state| state["plan"].is_null());
}

fn secret() -> String {
    "T".repeat(32)
}

/// The interpreter of an environment with the package that the page names. It is made once, whoever asks first.
fn with_websockets() -> PathBuf {
    static ENVIRONMENT: LazyLock<PathBuf> = LazyLock::new(|| {
        let requirements = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/examples/requirements.txt");
        let environment = make_scratch_path("examples-venv");
        python_environment::ensure_environment_and_return_interpreter(&requirements, &environment).unwrap()
    });
    ENVIRONMENT.clone()
}

/// A daemon behind tokens and TLS, started as `docs/src/network.md` says.
struct Guarded {
    process: Child,
    port: String,
}

impl Guarded {
    fn start(folder: &Path) -> Self {
        let mut command = build_era_command();
        command.args(["serve", "--listen", "0.0.0.0:0", "--token-file", "tokens", "--tls-dir", "tls"]);
        command.args(["--allow-host", "panel.local", "--socket", "none", "--accuracy", "fast"]);
        let mut process = command.current_dir(folder).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let port = lines.find_map(|line| {
            let (_, rest) = line.split_once("https://panel.local:")?;
            rest.split(|c: char| !c.is_ascii_digit()).next().map(str::to_owned)
        });
        // Nobody is held up by what it goes on to tell.
        std::thread::spawn(move || lines.for_each(drop));
        Self { process, port: port.expect("it says where it serves") }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// What a client on another machine is given: the certificate, and the secret of one line. It knows the machine by its name.
fn on_another_machine(daemon: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(daemon.join("tls/era-cert.pem"), folder.path().join("era-cert.pem")).unwrap();
    std::fs::write(folder.path().join("token"), format!("{}\n", secret())).unwrap();
    let names = "import socket\n_ask = socket.getaddrinfo\n\
                 socket.getaddrinfo = lambda host, *more, **named: _ask(\n    \
                 '127.0.0.1' if host == 'panel.local' else host, *more, **named)\n";
    std::fs::write(folder.path().join("sitecustomize.py"), names).unwrap();
    folder
}

/// What the page says for tokens, of requests and of the live socket.
#[test]
fn python_with_token_and_certificate_touches_from_elsewhere() {
    let own = tempfile::tempdir().unwrap();
    let tokens = own.path().join("tokens");
    std::fs::write(&tokens, format!("touch {}\n", secret())).unwrap();
    #[cfg(unix)]
    std::fs::set_permissions(&tokens, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let daemon = Guarded::start(own.path());
    let client = on_another_machine(own.path());
    let there = format!("panel.local:{}", daemon.port);
    // Its simulated device may not have answered yet.
    let wait = format!(
        "import ssl, time, urllib.request\ntls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)\n\
         tls.load_verify_locations('era-cert.pem')\nopener = urllib.request.build_opener(urllib.request.ProxyHandler({{}}), \
         urllib.request.HTTPSHandler(context=tls))\nwhile True:\n    request = urllib.request.Request('https://{there}/v1/state', \
         headers={{'Authorization': 'Bearer {}'}})\n    told = opener.open(request).read()\n    \
         if b'\"connected\":true' in told: break\n    time.sleep(0.05)\n",
        secret()
    );
    python(Path::new("python3"), &wait, client.path());
    let program = example("python", "HTTPSHandler(context=TLS)").replace(ELSEWHERE, &there);
    let told = python(Path::new("python3"), &program, client.path());
    assert!(told.len() == 2 && told[0].parse::<u64>().is_ok() && is_off(&told[1]), "{told:?}");

    let program = example("python", "from websockets");
    let (_, arguments) = program.split_once("# With a token: ").unwrap();
    let (arguments, _) = arguments.split_once("\nwith connect(").unwrap();
    let arguments = arguments.replace("\n# ", "\n").replace(ELSEWHERE, &there);
    let (plain, guarded) =
        (format!("\"ws://{HERE}/v1/live?send=plan\", proxy=None"), format!("with connect({arguments})"));
    let program = program.replace(&format!("with connect({plain})"), &guarded);
    assert!(program.contains(&guarded), "{program}");
    let program = format!(
        "import ssl\nTOKEN = open(\"token\").read().strip()\nTLS = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)\n\
         TLS.load_verify_locations(\"era-cert.pem\")\n{program}"
    );
    let told = python(&with_websockets(), &program, client.path());
    assert!(!told.is_empty() && told.iter().all(|line| is_plan(line)), "{told:?}");
}

/// The page of another origin, in a browser. What its script has read is put where the test sees it.
#[test]
fn a_page_of_another_origin_touches() {
    let Some(program) = browser_or_skip() else { return };
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let origin = format!("http://{}", listener.local_addr().unwrap());
    let access = Access { origins: vec![Access::parse_origin(&origin).unwrap()], ..Access::default() };
    let daemon = Daemon::start_with(STARTING_PLATE, SessionPolicy::default(), access);
    let html = example("html", "type=\"module\"").replace(HERE, daemon.url.trim_start_matches("http://"));
    let seen = "document.title = `${answer.status}, ${told.type ?? `plan ${told.plan_id}`}`;\n</script>";
    let html = html.replace("</script>", seen);
    serve_page(listener, format!("<!doctype html><body></body>{html}"));
    let mut browser = Browser::start(program, 800, 600);
    let told = (0..=LATE).find_map(|_| {
        browser.open(&origin);
        browser.wait_for(&format!("location.origin === '{origin}' && document.title !== ''"));
        let told = browser.value("document.title").as_str().unwrap().to_owned();
        browser.open("about:blank");
        (told != "503, urn:era:problem:device-late").then_some(told)
    });
    let told = told.expect("the board is late for ever");
    assert!(told.strip_prefix("200, plan ").is_some_and(|id| id.parse::<u64>().is_ok()), "{told}");
    assert!(daemon.sim.last_drives_received_at().is_some());
}

/// The manual's first study is the one that comes with the program, with which its figures were found; all are studies of the example plate.
#[test]
fn the_studies_of_the_manual_are_studies() {
    let studies: Vec<String> =
        code("studies.md").into_iter().filter(|(kind, _)| kind == "toml").map(|(_, text)| text).collect();
    let example = file("examples/studies/placement.toml");
    assert_eq!(studies.first().map(|text| text.trim_end()), Some(example.trim_end()));
    assert!(studies.len() >= 2, "{}", studies.len());
    for text in studies {
        let study = era::study::run::Study::parse_texts("studies.md", &text, "plate.toml", STARTING_PLATE);
        assert!(study.is_ok(), "{}", study.unwrap_err());
    }
}

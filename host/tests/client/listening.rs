//! `--listen` and the configuration's `listen`: names, addresses of both kinds, and what is said of anything else.

use crate::support::program::{build_era_command, run_era};
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};

struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a daemon, and reads the addresses that it names.
fn start_daemon(listen: &str) -> (Running, Vec<String>) {
    let mut command = build_era_command();
    command.args(["serve", "--listen", listen, "--socket", "none", "--accuracy", "fast"]).stderr(Stdio::piped());
    let mut daemon = Running(command.spawn().unwrap());
    let mut lines = BufReader::new(daemon.0.stderr.take().unwrap()).lines().map_while(Result::ok);
    let mut told = String::new();
    let line = lines.by_ref().find(|line| {
        told.push_str(line);
        line.contains("open http")
    });
    let line = line.unwrap_or_else(|| panic!("it does not serve: {told}"));
    std::thread::spawn(move || lines.for_each(drop));
    let (_, places) = line.split_once("open ").unwrap();
    let (places, _) = places.split_once(" (scene").unwrap();
    (daemon, places.split(", ").map(str::to_owned).collect())
}

fn has_ipv6() -> bool {
    TcpListener::bind("[::1]:0").is_ok()
}

/// A name is served at every address that it has on this machine, at one port.
#[test]
fn a_daemon_listens_at_a_name() {
    let (_daemon, places) = start_daemon("localhost:0");
    let port = places[0].rsplit_once(':').unwrap().1.to_owned();
    assert_eq!(places[0], format!("http://127.0.0.1:{port}"));
    if has_ipv6() {
        assert_eq!(places.get(1), Some(&format!("http://[::1]:{port}")));
        TcpStream::connect(format!("[::1]:{port}")).unwrap();
    }
    let said = run_era(&["state", "--url", &format!("localhost:{port}")]);
    assert!(said.code == Some(0), "{}", said.error);
    // Another name of this machine (RFC 6761, 6.3), by which it is called then, too.
    let (_daemon, places) = start_daemon("panel.localhost:0");
    let port = places[0].rsplit_once(':').unwrap().1.to_owned();
    let said = run_era(&["state", "--url", &format!("panel.localhost:{port}")]);
    assert!(said.code == Some(0), "{}", said.error);
}

#[test]
fn a_daemon_listens_at_an_address_of_either_kind() {
    let listens = if has_ipv6() { vec!["127.0.0.2:0", "[::1]:0"] } else { vec!["127.0.0.2:0"] };
    for listen in listens {
        let (_daemon, places) = start_daemon(listen);
        let host = listen.rsplit_once(':').unwrap().0;
        assert!(places.len() == 1 && places[0].starts_with(&format!("http://{host}:")), "{places:?}");
        assert_eq!(run_era(&["state", "--url", &places[0]]).code, Some(0));
    }
}

/// What is not a place to listen is refused with what is wrong with it, on the command line and in a file.
#[test]
fn what_is_wrong_with_a_place_to_listen_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    for (listen, words) in [
        ("localhost", "port"),
        ("127.0.0.1", "port"),
        ("7878", "127.0.0.1:7878"),
        (":7878", "127.0.0.1:7878"),
        ("*:7878", "0.0.0.0:7878"),
        ("::1", "[::1]:7878"),
        ("::1:7878", "[::1]:7878"),
        ("[::1]", "port"),
        ("[::g]:7878", "[::g]"),
        ("127.0.0.1:99999", "99999"),
        ("127.0.0.1:http", "http"),
        ("127.0.0.1:-1", "-1"),
        ("http://127.0.0.1:7878", "http://"),
        ("127.0.0.1:7878/", "/"),
        ("300.0.0.1:7878", "300.0.0.1"),
        ("127.0.0:7878", "127.0.0"),
        ("unix:/run/era.sock", "--socket"),
        ("pan el:7878", "pan el"),
        ("", "127.0.0.1:7878"),
    ] {
        let said = run_era(&["serve", "--listen", listen]);
        assert!(said.code == Some(2) && said.error.contains(words), "{listen:?}: {:?} {}", said.code, said.error);
        assert!(!said.error.contains("syntax"), "{listen:?}: {}", said.error);
        let config = folder.path().join("era.toml");
        std::fs::write(&config, format!("version = 1\nlisten = {listen:?}\n")).unwrap();
        for command in [["config", "check"], ["serve", "--config"]] {
            let said = run_era(&[command[0], command[1], config.to_str().unwrap()]);
            assert!(said.code == Some(2) && said.error.contains(":2: listen"), "{listen:?}: {}", said.error);
            assert!(said.error.contains(words), "{listen:?}: {}", said.error);
        }
    }
}

/// What the system says against a place: each reason has its own advice.
#[test]
fn why_a_place_cannot_be_had_is_reported() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    for listen in [format!("127.0.0.1:{port}"), format!("localhost:{port}")] {
        let said = run_era(&["serve", "--listen", &listen]);
        assert!(said.code == Some(1) && said.error.contains("another daemon"), "{listen}: {}", said.error);
    }
    // A name that is none (RFC 6761): a name server that does not answer yet may know it later, so the code is 1.
    let said = run_era(&["serve", "--listen", "panel.invalid:7878"]);
    assert!(said.code == Some(1) && said.error.contains("panel.invalid"), "{}", said.error);
    assert!(!said.error.contains("another daemon"), "{}", said.error);
}

/// The doctor looks for the daemon where its configuration lets it listen.
#[test]
fn the_doctor_finds_a_daemon_at_a_name() {
    let (_daemon, places) = start_daemon("localhost:0");
    let port = places[0].rsplit_once(':').unwrap().1;
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("era.toml");
    std::fs::write(&config, format!("version = 1\nlisten = \"localhost:{port}\"\n")).unwrap();
    let said = run_era(&["doctor", "--device", "sim", "--config", config.to_str().unwrap()]);
    assert!(said.out.contains(&format!("runs at localhost:{port}")), "{}", said.out);
}

//! Servers in front of a daemon that send elsewhere: nothing goes there, and it is said where that is.

use crate::servers::{Server, read_request};
use crate::support::browser::{Browser, browser_or_skip};
use crate::support::program::{build_era_command, run_command};
use crate::{asking_commands, write_recording};

const SECRET: &str = "TTTTTTTTTTTTTTTTTTTTTTTTTTTTTTTT";

/// No request is repeated elsewhere or turned into another, and its token stays; the error names the new address.
#[test]
fn no_command_follows_a_redirect() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("day.jsonl");
    write_recording(&recording);
    for status in [300, 301, 302, 303, 307, 308] {
        for arguments in asking_commands(&recording) {
            let elsewhere = Server::daemon();
            let front = Server::redirecting(status, format!("{}/era/v1/stop", elsewhere.url()));
            let mut command = build_era_command();
            command.args(&arguments).args(["--url", &front.url()]).env("ERA_TOKEN", SECRET);
            let said = run_command(&mut command);
            let told = format!("{}{}", said.out, said.error);
            let received = front.received();
            assert_eq!(elsewhere.received(), Vec::<String>::new(), "{status} {arguments:?} went elsewhere");
            assert!(told.contains(&format!("{}/era", elsewhere.url())), "{status} {arguments:?}: {told}");
            assert!(told.contains(&status.to_string()) && !told.contains("Check that the daemon runs"), "{told}");
            // The doctor warns of what it finds.
            let wanted = if arguments[0] == "doctor" { 0 } else { 1 };
            assert_eq!(said.code, Some(wanted), "{status} {arguments:?}: {told}");
            let method = if ["state", "doctor", "replay"].contains(&arguments[0].as_str()) { "GET " } else { "POST " };
            assert!(received.len() == 1 && received[0].starts_with(method), "{status} {arguments:?}: {received:?}");
        }
    }
}

/// The address is told as one that `--url` takes, whatever the server wrote.
#[test]
fn the_new_address_is_told_whole() {
    for (location, url) in [
        ("https://panel.example/v1/stop", "--url https://panel.example"),
        ("https://panel.example:8443/era/v1/stop?x=1", "--url https://panel.example:8443/era"),
        ("//panel.example/v1/stop", "--url http://panel.example"),
        ("/era/v1/stop", "/era"),
        ("login", "login"),
        ("https://panel.example/login?back=%2Fv1%2Fstop", "https://panel.example/login?back=%2Fv1%2Fstop"),
    ] {
        let front = Server::redirecting(308, location);
        let said = run_command(build_era_command().args(["stop", "--url", &front.url()]));
        let wanted = match location {
            "/era/v1/stop" => format!("--url {}{url}", front.url()),
            "login" => format!("{}/v1/login", front.url()),
            _ => url.to_owned(),
        };
        assert!(said.code == Some(1) && said.error.contains(&wanted), "{location}: {wanted} not in {}", said.error);
    }
}

/// A live socket that is sent elsewhere: a recording's pages say so.
#[test]
fn a_live_socket_follows_no_redirect() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("day.jsonl");
    write_recording(&recording);
    let elsewhere = Server::daemon();
    let there = format!("{}/v1/live?send=", elsewhere.url());
    let front = Server::start(move |mut stream| {
        let head = read_request(&mut stream);
        let is_socket = head.starts_with(b"GET /v1/live");
        let answer = if is_socket {
            format!("HTTP/1.1 307 Elsewhere\r\nLocation: {there}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        } else {
            let body = r#"{"name":"example plate"}"#;
            format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}", body.len())
        };
        let _ = std::io::Write::write_all(&mut stream, answer.as_bytes());
        head
    });
    let mut command = build_era_command();
    command.arg("replay").arg(&recording).args(["--url", &front.url()]).env("ERA_TOKEN", SECRET);
    let said = run_command(&mut command);
    let told = format!("{}{}", said.out, said.error);
    assert!(elsewhere.received().is_empty() && told.contains("307"), "{told}");
    assert!(told.contains(&format!("--url {}", elsewhere.url())), "{told}");
}

/// The daemon's page behind something that sends its requests elsewhere: a stop is not turned into a GET there, and the page says so.
#[test]
fn the_page_follows_no_redirect() {
    let Some(browser) = browser_or_skip() else { return };
    let front = Server::start(|mut stream| {
        let request = read_request(&mut stream);
        let head = String::from_utf8_lossy(&request).into_owned();
        let path = head.split(' ').nth(1).unwrap_or_default();
        let status = path.strip_prefix("/v1/").unwrap_or_default();
        let page = "<script type=\"module\">import { request } from \"/link.js\";
            const told = [];
            for (const status of [301, 302, 303, 307, 308])
              told.push(await request(\"POST\", `/v1/${status}`).then(() => \"done\", (problem) => problem.detail));
            document.title = told.join(\"|\");</script>";
        let answer = match path {
            "/" => ("text/html", page),
            "/link.js" => ("text/javascript", include_str!("../../web/link.js")),
            _ => ("application/json", "{\"device\": {}}"),
        };
        let first = if status.starts_with('3') {
            format!("{status} Elsewhere\r\nLocation: /v1/elsewhere")
        } else {
            "200 OK".to_owned()
        };
        let (kind, body) = answer;
        let answer = format!(
            "HTTP/1.1 {first}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        let _ = std::io::Write::write_all(&mut stream, answer.as_bytes());
        request
    });
    let mut browser = Browser::start(browser, 800, 600);
    browser.open(&front.url());
    browser.wait_for("document.title !== ''");
    let told = browser.value("document.title").as_str().unwrap().to_owned();
    assert!(told.split('|').count() == 5 && told.split('|').all(|one| one.contains("redirects the request")), "{told}");
    let received = front.received();
    assert_eq!(received.iter().filter(|request| request.starts_with("POST /v1/3")).count(), 5, "{received:?}");
    assert!(!received.iter().any(|request| request.contains("/v1/elsewhere")), "{received:?}");
}

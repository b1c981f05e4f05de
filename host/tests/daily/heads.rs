//! What stands in the head of a request: who it is for, how its body is written, who asks (RFC 9110, 9112, 6750).

use crate::raw::{address, connect, send_and_listen};
use crate::support::Daemon;
use era::daemon::Access;
use era::scene::STARTING_PLATE;
use std::io::{Read, Write};

/// Status of an answer, its head in lower case, and its body.
fn parts(answer: &str) -> (u16, String, &str) {
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((answer, ""));
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    (status, head.to_ascii_lowercase(), body)
}

/// Status of the answer to a request without a body, whose first line and header lines are these.
#[track_caller]
fn status(daemon: &Daemon, first: &str, headers: &[&str]) -> (u16, String) {
    let lines: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
    let answer = send_and_listen(daemon, &format!("{first}\r\n{lines}\r\n"));
    (parts(&answer).0, answer)
}

#[test]
fn a_request_names_exactly_one_host() {
    let daemon = Daemon::start(STARTING_PLATE);
    for target in ["GET /v1/state", "POST /v1/stop", "GET /", "GET /nothing", "PUT /v1/touch"] {
        let refused: &[&[&str]] = &[
            &[],
            &["Host:"],
            &["Host: localhost", "Host: localhost"],
            &["Host: localhost", "Host: elsewhere.example"],
            &["Host: localhost:7878:7878"],
            &["Host: localhost:99999"],
            &["Host: localhost:+80"],
            &["Host: user@localhost"],
            &["Host: localhost/v1"],
            &["Host: localhost?x"],
            &["Host: localhost#x"],
            &["Host: local host"],
            &["Host: localhost, localhost"],
            &["Host: http://localhost"],
            &["Host: [::1"],
            &["Host: \\localhost"],
        ];
        for headers in refused {
            let (found, answer) = status(&daemon, &format!("{target} HTTP/1.1"), headers);
            assert_eq!(found, 400, "{target} {headers:?}: {answer}");
            assert!(answer.contains("urn:era:problem:bad-header") && answer.contains("\"host\""), "{answer}");
        }
    }
    for host in
        ["localhost", "LOCALHOST", "localhost:", "localhost:80", "localhost.", "127.0.0.1:7", "[::1]", "[::1]:7"]
    {
        let (found, answer) = status(&daemon, "GET /v1/state HTTP/1.1", &[&format!("Host: {host}")]);
        assert_eq!(found, 200, "{host}: {answer}");
    }
    // Before HTTP/1.1 there need not be one, and no two either.
    assert_eq!(status(&daemon, "GET /v1/state HTTP/1.0", &[]).0, 200);
    assert_eq!(status(&daemon, "GET /v1/state HTTP/1.0", &["Host: localhost", "Host: localhost"]).0, 400);
}

/// What stands once only, and says who asks, is not there twice: two readers could take two different ones.
#[test]
fn who_asks_is_said_once() {
    let daemon = Daemon::start(STARTING_PLATE);
    for line in
        ["Origin: http://localhost", "Authorization: Bearer x", "Sec-Fetch-Site: none", "Sec-Fetch-Mode: navigate"]
    {
        let twice = ["Host: localhost", line, line];
        let (found, answer) = status(&daemon, "GET /v1/state HTTP/1.1", &twice);
        // Which header it is is not looked at where no token is asked for.
        let is_looked_at = !line.starts_with("Authorization");
        assert_eq!(found, if is_looked_at { 400 } else { 200 }, "{line}: {answer}");
    }
}

/// RFC 9112, 3.2.2: the target's own authority counts, and Host does not.
#[test]
fn an_absolute_target_names_the_host() {
    let daemon = Daemon::start(STARTING_PLATE);
    let own = address(&daemon);
    let own_page = format!("Origin: http://{own}");
    let cases: &[(&str, &[&str], u16)] = &[
        ("GET http://localhost/v1/state", &["Host: elsewhere.example"], 200),
        ("GET HTTP://LOCALHOST/v1/state", &["Host: localhost"], 200),
        ("GET http://elsewhere.example/v1/state", &["Host: localhost"], 403),
        ("POST http://elsewhere.example/v1/stop", &["Host: localhost"], 403),
        ("GET http://localhost/v1/state", &[], 400),
        ("GET http://localhost/v1/state", &["Host: localhost", "Host: localhost"], 400),
        ("GET http://user@localhost/v1/state", &["Host: localhost"], 400),
        ("GET ftp://localhost/v1/state", &["Host: localhost"], 400),
        ("GET localhost:80", &["Host: localhost"], 400),
        ("GET *", &["Host: localhost"], 400),
        ("POST http://localhost/v1/stop", &["Host: localhost", &own_page], 403),
        (&format!("POST http://{own}/v1/stop"), &["Host: elsewhere.example", &own_page], 200),
        (&format!("POST http://{own}/v1/stop"), &[&format!("Host: {own}"), "Origin: http://elsewhere.example"], 403),
    ];
    for (target, headers, wanted) in cases {
        let (found, answer) = status(&daemon, &format!("{target} HTTP/1.1"), headers);
        assert_eq!(found, *wanted, "{target} {headers:?}: {answer}");
    }
}

#[test]
fn a_body_comes_as_it_is_or_in_chunks() {
    let daemon = Daemon::start(STARTING_PLATE);
    let body = r#"{"x_px": 300, "y_px": 900, "duration_ms": 20}"#;
    let chunks = format!("{:x}\r\n{body}\r\n0\r\n\r\n", body.len());
    let send = |path: &str, lines: &str| {
        let answer =
            send_and_listen(&daemon, &format!("POST {path} HTTP/1.1\r\nHost: localhost\r\n{lines}\r\n\r\n{chunks}"));
        (parts(&answer).0, answer)
    };
    for path in
        ["/v1/touch", "/v1/stop", "/v1/effects", "/v1/preview", "/v1/study", "/v1/tolerances", "/v1/arm", "/nothing"]
    {
        for lines in [
            "Transfer-Encoding: gzip, chunked",
            "Transfer-Encoding: gzip\r\nTransfer-Encoding: chunked",
            "Transfer-Encoding: x-gzip,chunked",
            "Transfer-Encoding: deflate, gzip, chunked",
            "Transfer-Encoding: compress, chunked",
            "Transfer-Encoding: br, chunked",
            "Transfer-Encoding: identity, chunked",
        ] {
            let (found, answer) = send(path, lines);
            assert!(found == 501 && answer.contains("urn:era:problem:transfer-coding"), "{path} {lines}: {answer}");
        }
        for lines in ["Transfer-Encoding: chunked, chunked", "Transfer-Encoding: chunked\r\nTE: gzip, chunked"] {
            let (found, answer) = send(path, lines);
            assert!(found == 400 && answer.contains("urn:era:problem:bad-header"), "{path} {lines}: {answer}");
        }
    }
    // The end of such a body cannot be found.
    for lines in ["Transfer-Encoding: gzip", "Transfer-Encoding: chunked, gzip"] {
        assert_eq!(send("/v1/touch", lines).0, 400, "{lines}");
    }
    for lines in [
        "Transfer-Encoding: chunked",
        "Transfer-Encoding: Chunked",
        "Transfer-Encoding: chunked\r\nTE: trailers, gzip;q=0.5",
    ] {
        let (found, answer) = send("/v1/tolerances/stop", lines);
        assert_eq!(found, 200, "{lines}: {answer}");
    }
}

#[test]
fn no_body_is_taken_compressed() {
    let daemon = Daemon::start(STARTING_PLATE);
    let body = r#"{"x_px": 300, "y_px": 900, "duration_ms": 20}"#;
    let send = |path: &str, lines: &str| {
        let length = body.len();
        let head = format!("POST {path} HTTP/1.1\r\nHost: localhost\r\n{lines}\r\nContent-Length: {length}\r\n\r\n");
        send_and_listen(&daemon, &format!("{head}{body}"))
    };
    for path in ["/v1/touch", "/v1/effects", "/v1/preview", "/v1/study", "/v1/tolerances", "/v1/arm"] {
        for coding in ["gzip", "GZIP", "x-gzip", "deflate", "br", "zstd", "compress", "identity, gzip", "nonsense"] {
            let answer = send(path, &format!("Content-Encoding: {coding}"));
            let (found, head, told) = parts(&answer);
            assert_eq!(found, 415, "{path} {coding}: {answer}");
            assert!(head.contains("accept-encoding: identity"), "{answer}");
            assert!(
                told.contains("urn:era:problem:content-coding") && told.contains("\"content-encoding\""),
                "{answer}"
            );
        }
        let two = send(path, "Content-Encoding: identity\r\nContent-Encoding: gzip");
        assert_eq!(parts(&two).0, 415, "{two}");
    }
    assert_eq!(parts(&send("/v1/tolerances/stop", "Content-Encoding: Identity")).0, 200);
    // Of a stop nothing is read. The board may be late on a busy machine.
    let stopped = send("/v1/stop", "Content-Encoding: gzip");
    assert!([200, 502, 503].contains(&parts(&stopped).0), "{stopped}");
}

/// Nobody is told to go on with a body that is refused anyway: too long, not the daemon's, without a token, compressed.
#[test]
fn nobody_is_told_to_go_on_with_what_is_refused() {
    let tokens = Access::parse_tokens(&format!("arm {}", "T".repeat(32))).unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    let token = format!("Authorization: Bearer {}\r\n", "T".repeat(32));
    let first = |path: &str, lines: &str, length: u64| {
        let mut stream = connect(&daemon);
        let head = format!("POST {path} HTTP/1.1\r\n{lines}Expect: 100-continue\r\nContent-Length: {length}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        String::from_utf8_lossy(&answer[9..]).into_owned()
    };
    for (path, most) in [
        ("/v1/touch", 16 << 10),
        ("/v1/arm", 16 << 10),
        ("/v1/preview", 144 << 10),
        ("/v1/tolerances", 144 << 10),
        ("/v1/study", 272 << 10),
    ] {
        let own = format!("Host: localhost\r\n{token}");
        assert_eq!(first(path, &own, 99_000_000), "413", "{path}");
        assert_eq!(first(path, &own, most + 1), "413", "{path}");
        assert_eq!(first(path, &own, most), "100", "{path}");
        assert_eq!(first(path, "Host: localhost\r\n", 20), "401", "{path}");
        assert_eq!(first(path, &token, 20), "400", "{path}");
        assert_eq!(first(path, &format!("Host: elsewhere.example\r\n{token}"), 20), "403", "{path}");
        assert_eq!(first(path, &format!("{own}Content-Encoding: gzip\r\n"), 20), "415", "{path}");
    }
    assert_eq!(first("/v1/stop", &format!("Host: localhost\r\n{token}"), 99_000_000), "200");
}

/// Whoever sends a body that is too long to its end has the answer all the same, as does who reads only after that.
#[test]
fn the_refusal_of_a_long_body_is_read_after_it() {
    let daemon = Daemon::start(STARTING_PLATE);
    for length in [20_000, 3_000_000] {
        let mut stream = connect(&daemon);
        let head = format!("POST /v1/touch HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        stream.write_all(&vec![b' '; length]).expect("the daemon lets the sender end");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("the answer comes whole");
        assert!(answer.starts_with("HTTP/1.1 413"), "{length}: {answer}");
    }
}

#[test]
fn the_scheme_of_a_token_has_no_case() {
    let [view, touch] = ["V", "T"].map(|letter| letter.repeat(32));
    let tokens = Access::parse_tokens(&format!("view {view}\ntouch {touch}\n")).unwrap();
    let daemon = Daemon::start_guarded(STARTING_PLATE, Access { tokens, ..Access::default() });
    let ask = |line: &str| {
        let answer = send_and_listen(&daemon, &format!("POST /v1/stop HTTP/1.1\r\nHost: localhost\r\n{line}\r\n\r\n"));
        let (found, head, _) = parts(&answer);
        let challenge = head.lines().find_map(|line| line.strip_prefix("www-authenticate: ").map(str::to_owned));
        (found, challenge.unwrap_or_default())
    };
    for scheme in ["Bearer", "bearer", "BEARER", "bEaReR", "Bearer "] {
        assert_eq!(ask(&format!("Authorization: {scheme} {touch}")), (200, String::new()), "{scheme}");
    }
    for wrong in [
        "X-Nothing: 1".to_owned(),
        "Authorization: Bearer".into(),
        format!("Authorization: Bearer{touch}"),
        format!("Authorization: Basic {touch}"),
        format!("Authorization: {touch}"),
        "Authorization:".into(),
    ] {
        let (found, challenge) = ask(&wrong);
        assert!(found == 401 && challenge == "bearer realm=\"era\"", "{wrong}: {found} {challenge:?}");
    }
    // RFC 6750, 3.1: one that is not known, and one that is not enough.
    let (found, challenge) = ask(&format!("Authorization: Bearer {}", "X".repeat(32)));
    assert!(found == 401 && challenge.contains("error=\"invalid_token\""), "{found} {challenge:?}");
    let (found, challenge) = ask(&format!("Authorization: Bearer {view}"));
    assert!(found == 403 && challenge.contains("error=\"insufficient_scope\""), "{found} {challenge:?}");
    // Two of them: which counts cannot be told.
    let two = format!("Authorization: Bearer {touch}\r\nAuthorization: Bearer {view}");
    assert_eq!(ask(&two).0, 400);
}

#[test]
fn the_live_socket_names_the_version_that_it_speaks() {
    let daemon = Daemon::start(STARTING_PLATE);
    const KEY: &str = "dGhlIHNhbXBsZSBub25jZQ==";
    let ask = |lines: &str| {
        let upgrade = "Host: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n";
        let answer = send_and_listen(&daemon, &format!("GET /v1/live?send= HTTP/1.1\r\n{upgrade}{lines}\r\n\r\n"));
        let (found, head, _) = parts(&answer);
        (found, head)
    };
    let with_version = |version: &str| ask(&format!("Sec-WebSocket-Key: {KEY}\r\nSec-WebSocket-Version: {version}"));
    for version in ["12", "8", "0", "14", "013", "13, 8", "thirteen", ""] {
        let (found, head) = with_version(version);
        assert_eq!(found, 426, "{version:?}: {head}");
        assert!(head.contains("sec-websocket-version: 13"), "{head}");
        // RFC 9110, 15.5.22.
        assert!(head.contains("upgrade: websocket") && head.contains("connection: upgrade"), "{head}");
    }
    assert_eq!(with_version("13").0, 101);
    let with_key = |key: &str| ask(&format!("Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}"));
    for key in [
        "",
        "x",
        "dGhlIHNhbXBsZSBub25jZQ",
        "dGhlIHNhbXBsZSBub25jZQ=",
        "dGhlIHNhbXBsZSBub25j",
        "dGhlIHNhbXBsZSBub25jZSE=",
        "dGhlIHNhbXBsZSBub25jZSEh",
        "dGhlIHNhbXBsZSBub25jZ-==",
        "dGhlIHNhbXBsZSBub25j ZQ=",
        "AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=",
    ] {
        let (found, head) = with_key(key);
        assert_eq!(found, 400, "{key:?}: {head}");
    }
    assert_eq!(with_key("AAAAAAAAAAAAAAAAAAAAAA==").0, 101);
    let twice = format!("Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {KEY}\r\nSec-WebSocket-Key: {KEY}");
    assert_eq!(ask(&twice).0, 400);
    let twice = format!("Sec-WebSocket-Version: 13\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {KEY}");
    assert_eq!(ask(&twice).0, 400);
    assert_eq!(ask("Sec-WebSocket-Version: 13").0, 400, "no key");
    let no_version = ask(&format!("Sec-WebSocket-Key: {KEY}"));
    assert!(no_version.0 == 400 && no_version.1.contains("sec-websocket-version: 13"), "{no_version:?}");
}

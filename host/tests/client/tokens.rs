//! Tokens as files, variables and addresses have them: with line ends, spaces and byte order marks around them.

use crate::servers::Server;
use crate::support::Daemon;
use crate::support::program::{ProgramOutput, build_era_command, run_command};
use crate::{asking_commands, write_recording, write_secret};
use era::daemon::Access;
use era::scene::STARTING_PLATE;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

const SECRET: &str = "TTTTTTTTTTTTTTTTTTTTTTTTTTTTTTTT";
const MARK: &str = "\u{feff}";

/// A secret with what editors, shells and other systems put around it.
fn wrap_text(text: &str) -> Vec<String> {
    let around = [
        ("", ""),
        ("", "\n"),
        ("", "\r\n"),
        ("", "\r"),
        ("", "\n\n"),
        (" ", " \t"),
        ("\n", "\n"),
        (MARK, ""),
        (MARK, "\r\n"),
    ];
    around.map(|(before, after)| format!("{before}{text}{after}")).to_vec()
}

/// Asks a daemon that notes what it is sent; the token is of a file or of the variable.
fn ask_daemon(arguments: &[String], file: Option<&Path>, variable: Option<&[u8]>) -> (ProgramOutput, Vec<String>) {
    let daemon = Server::daemon();
    let mut command = build_era_command();
    command.args(arguments).args(["--url", &daemon.url()]);
    if let Some(file) = file {
        command.arg("--token-file").arg(file);
    }
    if let Some(variable) = variable {
        command.env("ERA_TOKEN", std::ffi::OsStr::from_bytes(variable));
    }
    (run_command(&mut command), daemon.received())
}

/// Every command sends the token alone, over HTTP and to the live socket.
#[test]
fn what_is_around_a_token_is_not_sent() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, file) = (folder.path().join("day.jsonl"), folder.path().join("token"));
    write_recording(&recording);
    let mut texts = wrap_text(SECRET);
    // A file of the daemon's does as well.
    texts.extend(wrap_text(&format!("touch {SECRET}")));
    texts.push(format!("{MARK}# of the panel\r\ntouch {SECRET}\r\n"));
    for text in &texts {
        for arguments in asking_commands(&recording) {
            write_secret(&file, text.as_bytes());
            for (said, received) in
                [ask_daemon(&arguments, Some(&file), None), ask_daemon(&arguments, None, Some(text.as_bytes()))]
            {
                assert_eq!(said.code, Some(0), "{text:?} {arguments:?}: {}", said.error);
                let is_right = |request: &String| {
                    request.lines().any(|line| line.eq_ignore_ascii_case(&format!("authorization: Bearer {SECRET}")))
                };
                assert!(!received.is_empty() && received.iter().any(is_right), "{text:?} {arguments:?}: {received:?}");
                assert!(!received.iter().any(|request| request.contains('\u{feff}')), "{text:?}");
            }
        }
    }
}

/// What can be no token is told where it is, without the token, and nothing is sent.
#[test]
fn what_can_be_no_token_is_reported_and_not_sent() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, file) = (folder.path().join("day.jsonl"), folder.path().join("token"));
    write_recording(&recording);
    let utf16: Vec<u8> = format!("{MARK}{SECRET}\r\n").encode_utf16().flat_map(u16::to_le_bytes).collect();
    let latin: Vec<u8> = [SECRET.as_bytes(), b"\xe9"].concat();
    let accented = format!("{SECRET}\u{e9}");
    let bell = format!("{SECRET}\u{7}");
    for (bytes, words, is_for_variable) in [
        (utf16.as_slice(), "UTF-16", false),
        (&latin, "UTF-8", true),
        (accented.as_bytes(), "character", true),
        (bell.as_bytes(), "character", true),
        (b"", "no token", false),
        (b"\n", "no token", false),
        (b"# a comment alone\n", "no token", false),
    ] {
        for arguments in asking_commands(&recording) {
            write_secret(&file, bytes);
            let mut all = vec![(ask_daemon(&arguments, Some(&file), None), file.to_str().unwrap())];
            if is_for_variable {
                all.push((ask_daemon(&arguments, None, Some(bytes)), "ERA_TOKEN"));
            }
            for ((said, received), place) in all {
                assert_eq!(said.code, Some(2), "{bytes:?} {arguments:?}: {}", said.error);
                assert!(said.error.contains(words) && said.error.contains(place), "{bytes:?}: {}", said.error);
                assert!(
                    !said.error.contains("TTTT") && !said.error.contains("Check that the daemon runs"),
                    "{}",
                    said.error
                );
                assert!(received.is_empty(), "{bytes:?} {arguments:?}: {received:?}");
            }
        }
    }
    // A variable that is set to nothing is none.
    for nothing in ["", "\n", " "] {
        let (said, received) = ask_daemon(&["state".to_owned()], None, Some(nothing.as_bytes()));
        assert!(said.code == Some(0) && !received[0].to_lowercase().contains("authorization"), "{received:?}");
    }
}

/// The daemon's file of tokens, and the other way in for it, a credential of the service manager.
#[test]
fn the_daemon_reads_tokens_with_marks_and_any_line_ends() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tokens");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let lines = [format!("touch {SECRET}"), format!("arm {}", "A".repeat(32))];
    for text in lines.iter().flat_map(|line| wrap_text(line)).chain([
        format!("{MARK}# of the panel\r\n{}\r\n{}\r\n", lines[0], lines[1]),
        format!("{}\r{}\r", lines[0], lines[1]),
    ]) {
        write_secret(&file, text.as_bytes());
        let mut command = build_era_command();
        // With a file in order it gets as far as its port, which is taken.
        let said = run_command(command.args(["serve", "--listen", &address, "--token-file"]).arg(&file));
        assert!(said.code == Some(1) && said.error.contains("cannot listen on"), "{text:?}: {}", said.error);
    }
    let utf16: Vec<u8> = format!("{MARK}{}", lines[0]).encode_utf16().flat_map(u16::to_be_bytes).collect();
    write_secret(&file, &utf16);
    let said = run_command(build_era_command().args(["serve", "--listen", &address, "--token-file"]).arg(&file));
    assert!(said.code == Some(2) && said.error.contains("UTF-16") && !said.error.contains("TTTT"), "{}", said.error);
}

/// Headers and addresses in which a token has line ends or a mark around it.
#[test]
fn the_daemon_takes_tokens_with_what_is_around_them() {
    let access = Access { tokens: Access::parse_tokens(&format!("touch {SECRET}")).unwrap(), ..Access::default() };
    let daemon = Daemon::start_guarded(STARTING_PLATE, access);
    let at = daemon.url.trim_start_matches("http://").to_owned();
    let status = |path: &str, headers: &str| {
        let mut stream = TcpStream::connect(&at).unwrap();
        let upgrade = if path.starts_with("/v1/live") {
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        } else {
            "Connection: close\r\n"
        };
        stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: {at}\r\n{upgrade}{headers}\r\n").as_bytes()).unwrap();
        let mut first = [0; 12];
        stream.read_exact(&mut first).unwrap();
        String::from_utf8_lossy(&first[9..]).into_owned()
    };
    for (before, after) in
        [("", ""), ("", "%0A"), ("", "%0D%0A"), ("", "%0D"), ("%EF%BB%BF", ""), ("%20", "%20"), ("", "+")]
    {
        let wanted = "101";
        assert_eq!(
            status(&format!("/v1/live?send=&token={before}{SECRET}{after}"), ""),
            wanted,
            "{before:?} {after:?}"
        );
    }
    // As some write all of it.
    let escaped: String = SECRET.bytes().map(|byte| format!("%{byte:02X}")).collect();
    assert_eq!(status(&format!("/v1/live?token={escaped}&send="), ""), "101");
    for wrong in ["%00", "%0Ax", "x", "%C3%A9", "%FF"] {
        assert_eq!(status(&format!("/v1/live?send=&token={SECRET}{wrong}"), ""), "401", "{wrong:?}");
    }
    for (path, good) in [("/v1/state", "200"), ("/v1/live?send=", "101")] {
        for around in [
            "Authorization: Bearer TOKEN\r\n",
            "Authorization: Bearer   TOKEN \t\r\n",
            "Authorization:Bearer TOKEN\r\n",
        ] {
            assert_eq!(status(path, &around.replace("TOKEN", SECRET)), good, "{path} {around:?}");
        }
        // A mark in a header is told as what it is, and a bare CR ends the request (RFC 9112, 2.2).
        assert_eq!(status(path, &format!("Authorization: Bearer {MARK}{SECRET}\r\n")), "400");
        assert_eq!(status(path, &format!("Authorization: Bearer {SECRET}\r\r\n")), "400");
    }
}

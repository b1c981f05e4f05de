//! How live sockets are closed: with a code that says why (RFC 6455, 7.4.1), told by frames that are written and read by hand.

use crate::raw::connect;
use crate::support::Daemon;
use crate::support::served::Served;
use era::daemon::{Access, Limits};
use era::scene::STARTING_PLATE;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;

const TEXT: u8 = 0x81;
const FIRST: u8 = 0x01;
const MORE: u8 = 0x00;
const LAST: u8 = 0x80;
const CLOSE: u8 = 0x88;
const PING: u8 = 0x89;

/// The client's end of a live socket.
struct Page(TcpStream);

impl Page {
    fn open(mut stream: TcpStream) -> Self {
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let head = "GET /v1/live?send= HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
                    Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).unwrap();
            answer.extend(byte);
        }
        assert!(answer.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&answer));
        Self(stream)
    }

    /// A frame's head, for so many bytes.
    fn head(first: u8, is_masked: bool, length: usize) -> Vec<u8> {
        let mask = u8::from(is_masked) << 7;
        let mut head = vec![first];
        match length {
            0..=125 => head.push(mask | length as u8),
            126..=0xffff => {
                head.push(mask | 126);
                head.extend((length as u16).to_be_bytes());
            }
            _ => {
                head.push(mask | 127);
                head.extend((length as u64).to_be_bytes());
            }
        }
        if is_masked {
            // A mask of zeros leaves the payload as it is.
            head.extend([0; 4]);
        }
        head
    }

    fn send(&mut self, first: u8, payload: &[u8]) {
        self.0.write_all(&[Self::head(first, true, payload.len()), payload.to_vec()].concat()).unwrap();
    }

    /// First byte and payload of the next frame; none where the connection has ended.
    fn frame(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).ok()?;
        let length = match head[1] {
            126 => {
                let mut length = [0; 2];
                self.0.read_exact(&mut length).ok()?;
                usize::from(u16::from_be_bytes(length))
            }
            127 => {
                let mut length = [0; 8];
                self.0.read_exact(&mut length).ok()?;
                u64::from_be_bytes(length) as usize
            }
            short => usize::from(short),
        };
        let mut payload = vec![0; length];
        self.0.read_exact(&mut payload).ok()?;
        Some((head[0], payload))
    }

    /// The code with which it is closed, and the reason; 1005 for a close without a code, 1006 for none at all (7.1.5).
    fn closed(mut self) -> (u16, String) {
        while let Some((first, payload)) = self.frame() {
            if first == CLOSE {
                let Some((code, reason)) = payload.split_at_checked(2) else { return (1005, String::new()) };
                return (u16::from_be_bytes([code[0], code[1]]), String::from_utf8(reason.to_vec()).unwrap());
            }
        }
        (1006, String::new())
    }
}

#[test]
fn a_socket_that_breaks_the_protocol_is_closed_with_the_code_that_says_so() {
    let daemon = Daemon::start(STARTING_PLATE);
    type Case = (&'static str, u16, fn(&mut Page));
    let cases: &[Case] = &[
        ("not masked", 1002, |page| page.0.write_all(&[TEXT, 2, b'{', b'}']).unwrap()),
        ("a reserved bit", 1002, |page| page.send(TEXT | 0x40, b"{}")),
        ("another reserved bit", 1002, |page| page.send(TEXT | 0x10, b"{}")),
        ("an opcode that is none", 1002, |page| page.send(0x83, b"{}")),
        ("a control opcode that is none", 1002, |page| page.send(0x8b, b"{}")),
        ("a ping in pieces", 1002, |page| page.send(PING & 0x7f, b"x")),
        ("a ping that is too long", 1002, |page| page.send(PING, &[b'x'; 126])),
        ("a continuation of nothing", 1002, |page| page.send(LAST, b"{}")),
        ("a message within another", 1002, |page| {
            page.send(FIRST, b"{\"type\":");
            page.send(TEXT, b"{}");
        }),
        ("a close of one byte", 1002, |page| page.send(CLOSE, &[3])),
        ("a close with a code that is none", 1002, |page| page.send(CLOSE, &999_u16.to_be_bytes())),
        ("a close with a code that is not sent", 1002, |page| page.send(CLOSE, &1005_u16.to_be_bytes())),
        ("a close whose reason is no text", 1007, |page| page.send(CLOSE, &[3, 232, 0xff])),
        ("text that is no UTF-8", 1007, |page| page.send(TEXT, b"{\"type\": \"st\xff\"}")),
        ("text that is none in pieces", 1007, |page| {
            page.send(FIRST, b"{\"type\": \"st\xc3");
            page.send(LAST, b"(\"}");
        }),
        ("a surrogate", 1007, |page| page.send(TEXT, b"\xed\xa0\x80")),
        ("a message that is announced as too long", 1009, |page| {
            page.0.write_all(&Page::head(TEXT, true, 10 << 20)).unwrap();
        }),
        ("a message of half the address space", 1009, |page| {
            page.0.write_all(&Page::head(TEXT, true, usize::MAX / 2)).unwrap();
        }),
        ("a message that is too long", 1009, |page| page.send(TEXT, &vec![b' '; 300 << 10])),
        ("a binary message that is too long", 1009, |page| page.send(0x82, &vec![0; 300 << 10])),
        ("empty pieces without an end", 1009, |page| {
            page.send(FIRST, b"");
            // What is sent behind the close is not read.
            let _ = page.0.write_all(&Page::head(MORE, true, 0).repeat(120_000));
        }),
        ("pieces that are too long together", 1009, |page| {
            page.send(FIRST, &vec![b' '; 200 << 10]);
            page.send(MORE, &vec![b' '; 200 << 10]);
        }),
    ];
    for (what, code, wrong) in cases {
        let mut page = Page::open(connect(&daemon));
        wrong(&mut page);
        let (found, reason) = page.closed();
        assert_eq!(found, *code, "{what}: {reason:?}");
    }
    // What the page says of its end is said back.
    for code in [1000_u16, 1001, 4000] {
        let mut page = Page::open(connect(&daemon));
        page.send(CLOSE, &code.to_be_bytes());
        assert_eq!(page.closed().0, code);
    }
    // What is not JSON is an error of this message, and nothing of the socket's.
    let mut page = Page::open(connect(&daemon));
    for text in [&b"no JSON"[..], b"", b"{\"type\": \"dance\"}", &[b' '; 20 << 10]] {
        page.send(TEXT, text);
        let mut answer = page.frame().unwrap();
        while answer.0 == PING {
            answer = page.frame().unwrap();
        }
        let (first, told) = answer;
        assert!(first == TEXT && String::from_utf8_lossy(&told).contains("urn:era:problem:bad-body"), "{first}");
    }
}

/// What a finger of such a page drives ends with it. Where the machine stood still the simulated board has gone off by itself, and that
/// is tried again.
#[test]
fn a_page_that_is_closed_has_lifted_its_fingers() {
    for _ in 0..5 {
        let daemon = Daemon::start(STARTING_PLATE);
        let mut page = Page::open(connect(&daemon));
        page.send(TEXT, br#"{"type": "touch", "touches": [{"id": 1, "x_px": 900, "y_px": 500}], "intensity_g": 0.1}"#);
        std::thread::sleep(Duration::from_millis(500));
        if daemon.state()["plan"].is_null() {
            continue;
        }
        page.send(TEXT, b"\xff");
        assert_eq!(page.closed().0, 1007);
        // Held, it would go on for as long as the page lives.
        daemon.wait_for(|state| state["plan"].is_null());
        return;
    }
    panic!("nothing was driven five times");
}

#[test]
fn a_daemon_that_ends_says_so_to_every_page() {
    for _ in 0..5 {
        let app = Arc::new(Daemon::app(STARTING_PLATE, Access::default()));
        let (mut served, url) = Served::at_a_port(&app, None);
        let address = url.trim_start_matches("http://");
        let pages: Vec<Page> = (0..20).map(|_| Page::open(TcpStream::connect(address).unwrap())).collect();
        served.ends();
        for page in pages {
            let (code, reason) = page.closed();
            assert_eq!(code, 1001, "{reason:?}");
        }
    }
}

#[test]
fn a_page_that_is_silent_is_told_so() {
    let mut app = Daemon::app(STARTING_PLATE, Access::default());
    app.limits = Limits { silence: Duration::from_millis(200), ping: Duration::from_secs(3600), ..Limits::default() };
    let (_served, url) = Served::at_a_port(&Arc::new(app), None);
    let page = Page::open(TcpStream::connect(url.trim_start_matches("http://")).unwrap());
    let (code, reason) = page.closed();
    assert!(code == 1008 && reason.contains("nothing was received"), "{code} {reason:?}");
}

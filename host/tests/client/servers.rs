//! Servers that share nothing with the program: a daemon that says yes to everything, one that redirects, a proxy.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio_rustls::rustls::{ServerConfig, ServerConnection, StreamOwned};

/// Longest wait for the next bytes of a client.
const PATIENCE: Duration = Duration::from_secs(20);

/// A server with all that it was sent.
pub struct Server {
    pub address: SocketAddr,
    received: Arc<Mutex<Vec<String>>>,
}

impl Server {
    /// Handles every connection with `serve`, which returns what it was sent.
    pub fn start(serve: impl Fn(TcpStream) -> Vec<u8> + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let received = Arc::new(Mutex::new(Vec::new()));
        let (own, serve) = (Arc::clone(&received), Arc::new(serve));
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                stream.set_read_timeout(Some(PATIENCE)).unwrap();
                let (own, serve) = (Arc::clone(&own), Arc::clone(&serve));
                // A place in the list from the connection on: one that sends nothing counts, too.
                let place = {
                    let mut all = own.lock().unwrap();
                    all.push(String::new());
                    all.len() - 1
                };
                std::thread::spawn(move || {
                    let told = String::from_utf8_lossy(&serve(stream)).into_owned();
                    own.lock().unwrap()[place] = told;
                });
            }
        });
        Self { address, received }
    }

    /// A daemon that says yes to everything.
    pub fn daemon() -> Self {
        Self::start(|mut stream| answer_as_daemon(&mut stream))
    }

    /// The same over TLS.
    pub fn tls_daemon(config: ServerConfig) -> Self {
        let config = Arc::new(config);
        Self::start(move |stream| {
            let connection = ServerConnection::new(Arc::clone(&config)).unwrap();
            answer_as_daemon(&mut StreamOwned::new(connection, stream))
        })
    }

    /// Answers every request with the same bytes.
    pub fn answering(answer: impl Into<String>) -> Self {
        let answer = answer.into();
        Self::start(move |mut stream| {
            let request = read_request(&mut stream);
            let _ = stream.write_all(answer.as_bytes());
            request
        })
    }

    /// Answers with a status and an address where to go instead.
    pub fn redirecting(status: u16, location: impl Into<String>) -> Self {
        let location = location.into();
        Self::answering(format!(
            "HTTP/1.1 {status} Elsewhere\r\nLocation: {location}\r\nContent-Type: text/html\r\nContent-Length: 5\r\n\
             Connection: close\r\n\r\nmoved"
        ))
    }

    /// A proxy that connects where it is told to (`CONNECT`), and notes what it sees on the way there.
    pub fn proxy() -> Self {
        Self::start(|mut stream| {
            let mut seen = read_request(&mut stream);
            let head = String::from_utf8_lossy(&seen).into_owned();
            let Some(target) = head.strip_prefix("CONNECT ").and_then(|rest| rest.split(' ').next()) else {
                return seen;
            };
            let Ok(there) = TcpStream::connect(target) else { return seen };
            stream.write_all(b"HTTP/1.1 200 Connection established\r\n\r\n").unwrap();
            let (mut back, mut from) = (stream.try_clone().unwrap(), there.try_clone().unwrap());
            let returning = std::thread::spawn(move || {
                let _ = std::io::copy(&mut from, &mut back);
                let _ = back.shutdown(std::net::Shutdown::Both);
            });
            let (mut bytes, mut there) = ([0; 4096], there);
            while let Ok(count @ 1..) = stream.read(&mut bytes) {
                seen.extend_from_slice(&bytes[..count]);
                if there.write_all(&bytes[..count]).is_err() {
                    break;
                }
            }
            let _ = there.shutdown(std::net::Shutdown::Both);
            let _ = returning.join();
            seen
        })
    }

    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// What each connection has sent so far, an empty text where it has not ended yet.
    pub fn received(&self) -> Vec<String> {
        // The last connections' threads may be about to note what they have read.
        for _ in 0..20 {
            std::thread::sleep(Duration::from_millis(50));
            if !self.received.lock().unwrap().iter().any(String::is_empty) {
                break;
            }
        }
        self.received.lock().unwrap().clone()
    }
}

/// A request's head and body.
pub fn read_request(stream: &mut impl Read) -> Vec<u8> {
    let (mut request, mut byte) = (Vec::new(), [0]);
    while !request.ends_with(b"\r\n\r\n") {
        match stream.read(&mut byte) {
            Ok(1) => request.push(byte[0]),
            _ => return request,
        }
    }
    let head = String::from_utf8_lossy(&request).to_ascii_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")?.trim().parse::<usize>().ok());
    let mut body = vec![0; length.unwrap_or(0)];
    if stream.read_exact(&mut body).is_ok() {
        request.extend(body);
    }
    request
}

/// Takes one request, and says yes.
fn answer_as_daemon(stream: &mut (impl Read + Write)) -> Vec<u8> {
    let request = read_request(stream);
    let head = String::from_utf8_lossy(&request).into_owned();
    let key = head.lines().find_map(|line| {
        let (name, value) = line.split_once(": ")?;
        name.eq_ignore_ascii_case("sec-websocket-key").then(|| value.trim().to_owned())
    });
    if let Some(key) = key {
        let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
        let answer = format!(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
        );
        let _ = stream.write_all(answer.as_bytes()).and_then(|()| stream.flush());
        // Until the page goes.
        let mut rest = [0; 512];
        while matches!(stream.read(&mut rest), Ok(1..)) {}
        return request;
    }
    let body = r#"{"name":"example plate","daemon":{"version":"0.0.0"},"device":{"kind":"sim","port":"/dev/pts/9","state":"safe","connected":true},"telemetry":null,"drives":[],"predicted":{}}"#;
    let answer = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    let _ = stream.write_all(answer.as_bytes()).and_then(|()| stream.flush());
    request
}

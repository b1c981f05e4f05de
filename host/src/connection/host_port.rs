//! A host and a port, as `127.0.0.1:7878`, `localhost:7878` and `[::1]:7878` say them.

use std::fmt;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::time::{Duration, Instant};

/// A name or an address in numbers, and a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostPort {
    /// An address of IPv6 without its brackets.
    host: String,
    port: u16,
}

impl HostPort {
    /// A host, with or without the brackets of IPv6, and a port.
    #[must_use]
    pub fn new(host: &str, port: u16) -> Self {
        Self { host: host.trim_start_matches('[').trim_end_matches(']').to_owned(), port }
    }

    /// The host, without brackets.
    #[must_use]
    pub fn host(&self) -> &str {
        &self.host
    }

    /// Its address, where it is one in numbers.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.host.parse::<IpAddr>().ok().map(|ip| SocketAddr::new(ip, self.port))
    }

    /// Its name, where it has one other than `localhost`.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        (self.address().is_none() && !self.host.eq_ignore_ascii_case("localhost")).then_some(&self.host)
    }

    /// Whether a text is the path of a Unix socket, which is no address.
    #[must_use]
    pub fn is_unix_socket_path(text: &str) -> bool {
        text.starts_with("unix:") || text.starts_with('/')
    }

    fn is_localhost(&self) -> bool {
        let name = self.host.trim_end_matches('.').to_ascii_lowercase();
        name == "localhost" || name.ends_with(".localhost")
    }

    /// All its addresses, one at least.
    ///
    /// # Errors
    /// That the name is not known, with [`io::ErrorKind::NotFound`].
    pub fn find_addresses(&self) -> io::Result<Vec<SocketAddr>> {
        // Whatever name servers and variables of the resolver (HOSTALIASES, LOCALDOMAIN) say, this is this machine (RFC 6761, 6.3).
        if self.is_localhost() {
            return Ok([IpAddr::from(Ipv4Addr::LOCALHOST), Ipv6Addr::LOCALHOST.into()]
                .map(|ip| SocketAddr::new(ip, self.port))
                .to_vec());
        }
        let unknown = |why: String| {
            io::Error::new(io::ErrorKind::NotFound, format!("the name {} has no IP address ({why})", self.host))
        };
        let found: Vec<SocketAddr> =
            (self.host.as_str(), self.port).to_socket_addrs().map_err(|error| unknown(error.to_string()))?.collect();
        if found.is_empty() { Err(unknown("the resolver found no address".into())) } else { Ok(found) }
    }

    /// Connects to the first of its addresses that takes a connection, within a time that they share: each has its part of what is left.
    ///
    /// # Errors
    /// Those of [`Self::find_addresses`], and that of the last address.
    pub fn connect_within(&self, longest: Duration) -> io::Result<TcpStream> {
        let mut result = Err(io::ErrorKind::NotFound.into());
        let addresses = self.find_addresses()?;
        let end = Instant::now() + longest;
        for (address, left) in addresses.iter().zip((1..=addresses.len()).rev()) {
            let own = end.saturating_duration_since(Instant::now()) / u32::try_from(left).unwrap_or(u32::MAX);
            // No time at all is an error of its own.
            result = TcpStream::connect_timeout(address, own.max(Duration::from_millis(1)));
            if result.is_ok() {
                break;
            }
        }
        result
    }
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

impl FromStr for HostPort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const WANTED: &str = "an address must have the form ADDRESS:PORT or NAME:PORT, such as 127.0.0.1:7878, \
                              localhost:7878 or [::1]:7878";
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        if let Some((scheme, _)) = text.split_once("://") {
            return Err(format!("{scheme}:// is not allowed here: {WANTED}"));
        }
        if Self::is_unix_socket_path(text) {
            return Err(format!("the path of a Unix socket is not allowed here: {WANTED}"));
        }
        if is_number(text) {
            return Err(format!(
                "the address before the port is missing; for example 127.0.0.1:{text}, which only this machine can \
                 reach"
            ));
        }
        let (host, port) = if let Some(rest) = text.strip_prefix('[') {
            let (host, behind) =
                rest.split_once(']').ok_or_else(|| format!("the closing bracket is missing: {WANTED}"))?;
            // What is behind `%` is the name of an interface.
            let (ip, _) = host.split_once('%').unwrap_or((host, ""));
            ip.parse::<Ipv6Addr>().map_err(|_| format!("[{host}] is not an IPv6 address: {WANTED}"))?;
            (host, behind.strip_prefix(':').ok_or_else(|| format!("the port is missing; for example [{host}]:7878"))?)
        } else {
            let (host, port) = text.rsplit_once(':').ok_or_else(|| match text {
                "" => format!("the address is empty: {WANTED}"),
                _ => format!("the port is missing; for example {text}:7878"),
            })?;
            if host.contains(':') {
                return Err(format!("an IPv6 address must be in brackets: {WANTED}"));
            }
            (host, port)
        };
        let number = port.parse::<u16>().ok().filter(|_| is_number(port));
        let number =
            number.ok_or_else(|| format!("{port:?} is not a port: it must be a whole number from 0 to 65535"))?;
        match host {
            "" => return Err(format!("the address before the port is missing; for example 127.0.0.1{text}")),
            "*" => {
                return Err(format!(
                    "* is not an address: for all addresses of this machine, use 0.0.0.0:{number} (IPv4) or [::]:{number} (IPv4 and IPv6)"
                ));
            }
            _ => {}
        }
        let is_numeric = host.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
        if is_numeric && host.parse::<Ipv4Addr>().is_err() {
            return Err(format!("{host} is not an IPv4 address, which has four numbers from 0 to 255"));
        }
        let is_of_name = |c: char| c.is_ascii_alphanumeric() || "-_.:%".contains(c);
        if !host.chars().all(is_of_name) {
            return Err(format!("{host:?} is not the name of a machine: a name has letters, digits, '-' and '.' only"));
        }
        Ok(Self::new(host, number))
    }
}

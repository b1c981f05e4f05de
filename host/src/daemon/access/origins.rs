//! Origins of pages and names of this daemon, written as browsers write them (<https://url.spec.whatwg.org>): what could never match
//! a request is refused before the daemon starts.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

const ORIGIN: &str = "must be an origin as browsers send it: a scheme, a host name, a port unless it \
                      is the default port of the scheme, and no path, such as https://kiosk.example:8443, tauri://localhost or chrome-extension://ID";
const NAME: &str = "must be a host name or an IP address, without a scheme, a port or a path, such as panel.local";

/// An origin as it stands in the header `Origin`: of `https://Kiosk.Example:443` that is `https://kiosk.example`.
///
/// Beside `http` and `https` any scheme of an application's own is taken (`tauri://localhost`, `app://.`). Their names are those of the
/// application, without usual ports, and are only put into lower case.
///
/// # Errors
/// What is wrong with it, and what to write.
pub fn normalize_origin(text: &str) -> Result<String, String> {
    let (scheme, rest) = text.split_once("://").ok_or(ORIGIN)?;
    let scheme = scheme.to_ascii_lowercase();
    check_scheme_has_origins(&scheme)?;
    let because = |what: &'static str| format!("{ORIGIN}; {what}");
    if rest.contains('*') {
        return Err(because("wildcards are not supported: name each origin"));
    }
    if !rest.is_ascii() {
        return Err(because(
            "write a name with non-ASCII characters in the form that browsers send (xn--...): the daemon's log \
             shows this form when the daemon refuses a page",
        ));
    }
    let authority = Authority::parse(rest).ok_or(ORIGIN)?;
    match &authority.host {
        // What some applications call their own files.
        Host::Name(name) if name == "." && find_default_port(&scheme).is_none() => {}
        Host::Name(name) => check_host_name(name).map_err(because)?,
        Host::Address(_) => {}
    }
    Ok(authority.format_origin(&scheme))
}

/// That pages of this scheme have an origin of their own.
fn check_scheme_has_origins(scheme: &str) -> Result<(), String> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "+-.".contains(c);
    if !scheme.starts_with(|c: char| c.is_ascii_lowercase()) || !scheme.chars().all(is_plain) {
        return Err(ORIGIN.into());
    }
    match scheme {
        "file" => {
            Err("must not begin with file:, because pages opened as files have no origin of their own (browsers \
                       send null): serve the folder of the page (python3 -m http.server 8000), and allow \
                       http://localhost:8000"
                .into())
        }
        "ws" | "wss" => {
            let page = if scheme == "ws" { "http" } else { "https" };
            Err(format!(
                "{ORIGIN}; to allow a live socket (WebSocket), give the origin of the page that opens the socket, not \
                 the address of the socket. The origin of the page begins with {page}://"
            ))
        }
        "about" | "blob" | "data" | "ftp" | "javascript" => {
            Err(format!("{ORIGIN}; pages of the scheme {scheme} have no origin"))
        }
        _ => Ok(()),
    }
}

/// That a browser could ask for this name, as it is.
fn check_host_name(name: &str) -> Result<(), &'static str> {
    let last = name.rsplit('.').next().unwrap_or_default();
    if name.ends_with('.') {
        Err("the name ends with a dot: remove the dot")
    } else if name.split('.').any(str::is_empty) {
        Err("the name begins with a dot, or has two dots in a row")
    } else if last.bytes().all(|byte| byte.is_ascii_digit()) || last.starts_with("0x") {
        // A browser takes it for one, and puts it into its usual form.
        Err("the name ends with a number like an IPv4 address, but is not four numbers from 0 to 255")
    } else {
        Ok(())
    }
}

/// A name by which the daemon may be called, as a Host header has it, without brackets and without the dot that may end it.
///
/// # Errors
/// What is wrong with it.
pub fn normalize_host_name(text: &str) -> Result<String, String> {
    if let Ok(address) = text.parse::<Ipv6Addr>() {
        return Ok(address.to_string());
    }
    if !text.is_ascii() {
        return Err(format!(
            "{NAME}; this name has non-ASCII characters: write the name in the form that browsers \
                            send (xn--...)"
        ));
    }
    match Authority::parse(text) {
        Some(Authority { host, port: None }) if !text.ends_with(':') => match host {
            Host::Address(address) => Ok(address.to_string()),
            Host::Name(name) => {
                let name = name.strip_suffix('.').unwrap_or(&name);
                check_host_name(name).map_err(|what| format!("{NAME}; {what}"))?;
                Ok(name.to_owned())
            }
        },
        _ => Err(NAME.into()),
    }
}

/// The port that an origin does not name.
fn find_default_port(scheme: &str) -> Option<u16> {
    match scheme {
        "http" => Some(80),
        "https" => Some(443),
        _ => None,
    }
}

/// Name and port that a request is for, as its target or its Host header has them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Authority {
    host: Host,
    port: Option<u16>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Host {
    /// In lower case.
    Name(String),
    Address(IpAddr),
}

impl Authority {
    /// From `NAME`, `NAME:PORT`, and addresses in their place; nothing where it is none of these.
    pub fn parse(text: &str) -> Option<Self> {
        let (host, port) = match text.strip_prefix('[').and_then(|text| text.split_once(']')) {
            Some((address, rest)) => {
                let port = if rest.is_empty() { "" } else { rest.strip_prefix(':')? };
                (Host::Address(IpAddr::V6(address.parse().ok()?)), port)
            }
            None => {
                let (name, port) = text.split_once(':').unwrap_or((text, ""));
                let is_plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
                if name.is_empty() || !name.chars().all(is_plain) {
                    return None;
                }
                let address = name.parse::<Ipv4Addr>().map(|address| Host::Address(IpAddr::V4(address)));
                (address.unwrap_or_else(|_| Host::Name(name.to_ascii_lowercase())), port)
            }
        };
        let port = match port {
            "" => None,
            digits if digits.bytes().all(|byte| byte.is_ascii_digit()) => Some(digits.parse().ok()?),
            _ => return None,
        };
        Some(Self { host, port })
    }

    /// Whether it names this machine beyond doubt: localhost, or an address in numbers.
    pub fn is_localhost_or_ip_address(&self) -> bool {
        match &self.host {
            Host::Name(name) => name.strip_suffix('.').unwrap_or(name) == "localhost",
            Host::Address(_) => true,
        }
    }

    /// Whether it has this name, which [`normalize_host_name`] has made.
    pub fn has_host_name(&self, name: &str) -> bool {
        match &self.host {
            Host::Name(own) => own.strip_suffix('.').unwrap_or(own) == name,
            Host::Address(own) => own.to_string() == name,
        }
    }

    /// Whether a page of this origin, as its header has it, is this daemon's own; `connection_scheme` is that of the connection, where it has one.
    pub fn matches_origin(&self, origin: &str, connection_scheme: Option<&str>) -> bool {
        let Some((own, rest)) = origin.split_once("://") else { return false };
        let is_ours = find_default_port(own).is_some()
            && connection_scheme.is_none_or(|connection_scheme| connection_scheme == own);
        is_ours && Self::parse(rest).is_some_and(|page| page.format_origin(own) == self.format_origin(own))
    }

    /// The origin of its pages.
    fn format_origin(&self, scheme: &str) -> String {
        let host = match &self.host {
            Host::Name(name) => name.clone(),
            Host::Address(IpAddr::V4(address)) => address.to_string(),
            Host::Address(IpAddr::V6(address)) => match (address.to_ipv4_mapped(), address.segments()) {
                // Browsers write the end of these as of all others.
                (Some(_), [.., high, low]) => format!("[::ffff:{high:x}:{low:x}]"),
                _ => format!("[{address}]"),
            },
        };
        match self.port.filter(|port| find_default_port(scheme) != Some(*port)) {
            Some(port) => format!("{scheme}://{host}:{port}"),
            None => format!("{scheme}://{host}"),
        }
    }
}

impl std::fmt::Display for Authority {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.host {
            Host::Name(name) => f.write_str(name)?,
            Host::Address(IpAddr::V4(address)) => write!(f, "{address}")?,
            Host::Address(IpAddr::V6(address)) => write!(f, "[{address}]")?,
        }
        self.port.map_or(Ok(()), |port| write!(f, ":{port}"))
    }
}

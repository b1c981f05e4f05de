//! Why nobody answers at a daemon's address: what each end speaks, and whose certificate it is.

use crate::certificate::describe_date_fault;
use crate::connection::{HostPort, ProxyError};
use std::io::{Read, Write};
use std::time::Duration;
use tokio_rustls::rustls::{self, CertificateError, InvalidMessage};

/// Longest wait for a connection, and for its first bytes.
const WAIT: Duration = Duration::from_millis(500);

/// Why there was no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RequestTrouble {
    /// Asked without TLS, and TLS is spoken there.
    SpeaksTls,
    /// Asked with TLS, and none is spoken there.
    SpeaksPlain,
    /// A certificate that nobody known here vouches for.
    Untrusted(String),
    /// A certificate for other names than the one that it was called by.
    OtherName(String),
    /// A certificate that has run out or is not valid yet: since when, or from when on.
    Dates(String),
    /// The proxy that was named is no help.
    Proxy(String),
    /// Anything else.
    Other(String),
}

impl RequestTrouble {
    /// Why asking `url` failed. Where something unreadable came back, it is looked at once more for TLS, but not past a proxy.
    #[must_use]
    pub fn find_trouble_probing_address_for_tls(error: &ureq::Error, url: &str, has_proxy: bool) -> Self {
        match find_tls_error(error) {
            Some(rustls::Error::InvalidCertificate(
                CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. },
            )) => return Self::OtherName(error.to_string()),
            Some(rustls::Error::InvalidCertificate(fault)) => {
                return describe_date_fault(fault).map_or_else(|| Self::Untrusted(error.to_string()), Self::Dates);
            }
            Some(rustls::Error::InvalidMessage(InvalidMessage::InvalidContentType)) => return Self::SpeaksPlain,
            _ => {}
        }
        if let ureq::Error::Io(error) = error
            && error.get_ref().is_some_and(|inner| inner.is::<ProxyError>())
        {
            return Self::Proxy(error.to_string());
        }
        match url.strip_prefix("http://") {
            Some(place)
                if !has_proxy
                    && matches!(error, ureq::Error::Protocol(_) | ureq::Error::Io(_))
                    && answers_plain_http_with_tls_alert(place) =>
            {
                Self::SpeaksTls
            }
            _ => Self::Other(error.to_string()),
        }
    }

    /// What is there, and what to give, for the commands that take `--url` and `--ca`; nothing where that is no help.
    #[must_use]
    pub fn describe_with_advice(&self, url: &str, has_ca: bool) -> Option<(String, String)> {
        let place = url.split_once("://").map_or(url, |(_, place)| place);
        let authority = place.split('/').next().unwrap_or(place);
        let host = authority.rsplit_once(':').map_or(authority, |(host, _)| host);
        Some(match self {
            Self::Other(_) => return None,
            Self::SpeaksTls => (
                format!("{place} speaks TLS, but the request was sent without TLS"),
                format!(
                    "use --url https://{place} and --ca with the daemon's certificate (era-cert.pem in the folder of the daemon's option --tls-dir)"
                ),
            ),
            Self::SpeaksPlain => {
                (format!("{place} does not speak TLS, but the request was sent over TLS"), format!("use --url http://{place}"))
            }
            Self::Untrusted(reason) if has_ca => (
                format!("the certificate of {url} is not trusted ({reason}), although --ca is given"),
                "if the daemon made its certificate itself, copy era-cert.pem again from its --tls-dir; if an \
                 authority signed the certificate, the file of --tls-cert must contain the intermediate certificates \
                 after the daemon's own certificate, and --ca must name the root certificate of the authority"
                    .into(),
            ),
            Self::Untrusted(reason) => (
                format!("the certificate of {url} is not trusted ({reason})"),
                "use --ca with the daemon's certificate (era-cert.pem in its --tls-dir)".into(),
            ),
            Self::Dates(told) => (
                format!("the certificate of {url} {told}"),
                "if the clock is right, replace the certificate of the daemon (if the daemon made the certificate: \
                 move era-cert.pem and era-key.pem out of its --tls-dir, and restart the daemon), and use the new \
                 certificate in --ca of every client"
                    .into(),
            ),
            Self::Proxy(told) => (
                told.clone(),
                "check that --proxy names the right proxy, and that this proxy may connect to the daemon's port; without \
                 --proxy, the connection is direct"
                    .into(),
            ),
            Self::OtherName(reason) => (
                format!("the certificate of {url} is for other names ({reason})"),
                format!(
                    "use one of these names in --url; or move era-cert.pem and era-key.pem out of the daemon's \
                     --tls-dir, restart the daemon with --allow-host {host}, and give the new era-cert.pem to every client"
                ),
            ),
        })
    }
}

/// What TLS has against the other end.
fn find_tls_error(error: &ureq::Error) -> Option<&rustls::Error> {
    match error {
        ureq::Error::Rustls(error) => Some(error),
        ureq::Error::Io(error) => error.get_ref()?.downcast_ref::<rustls::Error>(),
        _ => None,
    }
}

/// Whether plain HTTP is answered with a record of TLS: an alert (RFC 8446, 5.1), its type 21 and the version's first byte 3.
fn answers_plain_http_with_tls_alert(host_port_and_path: &str) -> bool {
    // A daemon may be below a prefix.
    let place = host_port_and_path.split('/').next().unwrap_or(host_port_and_path);
    let (host, port) = match place.rsplit_once(':').map(|(host, port)| (host, port.parse::<u16>())) {
        Some((host, Ok(port))) => (host, port),
        _ => (place, 80),
    };
    let first_bytes = || -> std::io::Result<[u8; 2]> {
        let mut stream = HostPort::new(host, port).connect_within(WAIT)?;
        stream.set_read_timeout(Some(WAIT))?;
        stream.set_write_timeout(Some(WAIT))?;
        stream.write_all(b"GET / HTTP/1.0\r\n\r\n")?;
        let mut first = [0; 2];
        stream.read_exact(&mut first)?;
        Ok(first)
    };
    first_bytes().is_ok_and(|first| first == [21, 3])
}

//! Connections to a daemon: direct, or through a proxy that an option names; plain, or with TLS.
//!
//! Nothing here looks at the environment: where a request goes and whose certificate is trusted is said by options alone.

mod host_port;
mod proxy;
mod redirect;
mod transport;
mod trust;

pub use host_port::HostPort;
pub use proxy::ProxyError;
pub use redirect::describe_redirect;
pub use trust::client_config;

use std::fmt;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, ClientConnection, StreamOwned};
use ureq::http::Uri;

/// Longest wait for a connection: behind a firewall there is no answer at all.
const CONNECT: Duration = Duration::from_secs(3);
/// Longest wait for the next bytes, unless somebody sets another.
const PATIENCE: Duration = Duration::from_secs(30);

/// How a daemon is reached.
#[derive(Clone, Debug)]
pub struct DaemonRoute {
    /// Which certificates are trusted.
    pub tls: Arc<ClientConfig>,
    /// What is in between, if an option names it.
    pub proxy: Option<HostPort>,
}

impl DaemonRoute {
    /// Opens a connection to the host of an address (`http`, `https`, `ws` or `wss`). The handshake of TLS comes with the first bytes.
    ///
    /// # Errors
    /// As the system has it; [`ProxyError`] inside where it is the proxy's.
    pub fn open_connection(&self, uri: &Uri) -> io::Result<DaemonConnection> {
        let is_tls = matches!(uri.scheme_str(), Some("https" | "wss"));
        let port = uri.port_u16().unwrap_or(if is_tls { 443 } else { 80 });
        let target = HostPort::new(uri.host().unwrap_or_default(), port);
        let stream = match &self.proxy {
            None => target.connect_within(CONNECT)?,
            Some(proxy) => proxy::open_tunnel(proxy, &target)?,
        };
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        if !is_tls {
            return Ok(DaemonConnection::Plain(stream));
        }
        let name = ServerName::try_from(target.host().to_owned()).map_err(io::Error::other)?;
        let connection = ClientConnection::new(Arc::clone(&self.tls), name).map_err(io::Error::other)?;
        Ok(DaemonConnection::Tls(Box::new(StreamOwned::new(connection, stream))))
    }

    /// What asks over this way, with a connection of its own for each request: it takes no status for an error and follows no redirect.
    #[must_use]
    pub fn make_agent(&self, patience: Duration) -> ureq::Agent {
        let config = ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(patience));
        // The way has its own proxy or none: this keeps the agent from looking for one in the environment.
        let config = config.proxy(None).max_redirects(0).build();
        ureq::Agent::with_parts(config, transport::Connector(self.clone()), transport::NoResolver)
    }
}

/// A connection.
pub enum DaemonConnection {
    /// Without TLS.
    Plain(TcpStream),
    /// With TLS.
    Tls(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl DaemonConnection {
    /// What it goes over.
    #[must_use]
    pub fn tcp_stream(&self) -> &TcpStream {
        match self {
            Self::Plain(stream) => stream,
            Self::Tls(stream) => &stream.sock,
        }
    }
}

impl fmt::Debug for DaemonConnection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("DaemonConnection").field(self.tcp_stream()).finish()
    }
}

impl Read for DaemonConnection {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(into),
            Self::Tls(stream) => stream.read(into),
        }
    }
}

impl Write for DaemonConnection {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.write(bytes),
            Self::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.flush(),
            Self::Tls(stream) => stream.flush(),
        }
    }
}

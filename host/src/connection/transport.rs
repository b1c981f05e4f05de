//! The agent's connections, made by a [`DaemonRoute`] and not by the agent itself.

use super::{DaemonConnection, DaemonRoute};
use std::io::{self, ErrorKind, Read, Write};
use std::net::SocketAddr;
use std::time::Duration;
use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::{Buffers, ConnectionDetails, LazyBuffers, NextTimeout, Transport};
use ureq::{Error, Timeout};

/// Shortest wait that a socket takes, and the longest that makes sense.
const WAITS: [Duration; 2] = [Duration::from_millis(1), Duration::from_secs(3600)];

/// Opens connections for the agent.
#[derive(Debug)]
pub struct Connector(pub DaemonRoute);

impl ureq::unversioned::transport::Connector for Connector {
    type Out = ConnectionTransport;

    fn connect(&self, details: &ConnectionDetails<'_>, _: Option<()>) -> Result<Option<ConnectionTransport>, Error> {
        let line = self.0.open_connection(details.uri).map_err(|error| convert_error(error, Timeout::Connect))?;
        let buffers = LazyBuffers::new(details.config.input_buffer_size(), details.config.output_buffer_size());
        Ok(Some(ConnectionTransport { line, buffers }))
    }
}

/// Leaves names to the way: a proxy knows them, perhaps, and this machine does not.
#[derive(Debug)]
pub struct NoResolver;

impl Resolver for NoResolver {
    fn resolve(&self, _: &Uri, _: &Config, _: NextTimeout) -> Result<ResolvedSocketAddrs, Error> {
        let mut none = self.empty();
        // The agent wants an address; nothing connects to it.
        none.push(SocketAddr::from(([0, 0, 0, 0], 0)));
        Ok(none)
    }
}

/// A connection as the agent uses it.
#[derive(Debug)]
pub struct ConnectionTransport {
    line: DaemonConnection,
    buffers: LazyBuffers,
}

fn limit_wait(timeout: NextTimeout) -> Duration {
    (*timeout.after).clamp(WAITS[0], WAITS[1])
}

/// An error of the system, with a time that has run out as such.
fn convert_error(error: io::Error, reason: Timeout) -> Error {
    match error.kind() {
        ErrorKind::TimedOut | ErrorKind::WouldBlock => Error::Timeout(reason),
        _ => Error::Io(error),
    }
}

impl Transport for ConnectionTransport {
    fn buffers(&mut self) -> &mut dyn Buffers {
        &mut self.buffers
    }

    fn transmit_output(&mut self, amount: usize, timeout: NextTimeout) -> Result<(), Error> {
        let failed = |error| convert_error(error, timeout.reason);
        // A handshake reads as well.
        self.line.tcp_stream().set_write_timeout(Some(limit_wait(timeout))).map_err(failed)?;
        self.line.tcp_stream().set_read_timeout(Some(limit_wait(timeout))).map_err(failed)?;
        let output = self.buffers.output().get(..amount).unwrap_or_default();
        self.line.write_all(output).and_then(|()| self.line.flush()).map_err(failed)
    }

    fn await_input(&mut self, timeout: NextTimeout) -> Result<bool, Error> {
        let failed = |error| convert_error(error, timeout.reason);
        self.line.tcp_stream().set_read_timeout(Some(limit_wait(timeout))).map_err(failed)?;
        let amount = self.line.read(self.buffers.input_append_buf()).map_err(failed)?;
        self.buffers.input_appended(amount);
        Ok(amount > 0)
    }

    fn is_tls(&self) -> bool {
        matches!(self.line, DaemonConnection::Tls(_))
    }

    /// Nothing is asked twice over it.
    fn is_open(&mut self) -> bool {
        false
    }
}

//! Whether whoever sent a request still waits for its answer. What takes long ends when nobody does; all else is carried out in any case.

use crate::daemon::api::problem::{Problem, ProblemKind};
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use std::convert::Infallible;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, Interest, ReadBuf};
use tokio::net::{TcpStream, tcp};
#[cfg(unix)]
use tokio::net::{UnixStream, unix};

/// Between two looks at a connection over which something has come that nobody reads yet: the next request, say.
const LOOK: Duration = Duration::from_millis(20);

/// Who has sent a request: the end of a connection from which something is read. The default is one of which nothing is known: it never closes.
#[derive(Clone, Debug, Default)]
pub struct RequestSender {
    source: Option<ReadHalf>,
    read: Arc<ReadBytes>,
}

/// Bytes that were read from a connection since they were last taken.
#[derive(Debug, Default)]
struct ReadBytes {
    count: AtomicUsize,
    /// Most of them; 0 for no limit.
    most: AtomicUsize,
}

#[derive(Clone, Debug)]
enum ReadHalf {
    Tcp(Arc<tcp::OwnedReadHalf>),
    #[cfg(unix)]
    Unix(Arc<unix::OwnedReadHalf>),
}

/// A connection whose sender is looked at while it is served.
#[derive(Debug)]
pub struct WatchedConnection<W> {
    source: ReadHalf,
    sink: W,
    read: Arc<ReadBytes>,
}

impl RequestSender {
    /// A connection, and who is at its other end.
    #[must_use]
    pub fn pair_peer_close_watcher_with_tcp_connection(
        stream: TcpStream,
    ) -> (Self, WatchedConnection<tcp::OwnedWriteHalf>) {
        let (read, sink) = stream.into_split();
        Self::pair_peer_close_watcher_with_split_connection(ReadHalf::Tcp(Arc::new(read)), sink)
    }

    /// The same of a connection through the file system.
    #[cfg(unix)]
    #[must_use]
    pub fn pair_peer_close_watcher_with_unix_connection(
        stream: UnixStream,
    ) -> (Self, WatchedConnection<unix::OwnedWriteHalf>) {
        let (read, sink) = stream.into_split();
        Self::pair_peer_close_watcher_with_split_connection(ReadHalf::Unix(Arc::new(read)), sink)
    }

    fn pair_peer_close_watcher_with_split_connection<W>(source: ReadHalf, sink: W) -> (Self, WatchedConnection<W>) {
        let read = Arc::new(ReadBytes::default());
        (Self { source: Some(source.clone()), read: Arc::clone(&read) }, WatchedConnection { source, sink, read })
    }

    /// How many bytes were read from the connection since the last call.
    #[must_use]
    pub fn take_read_byte_count(&self) -> usize {
        self.read.count.swap(0, Ordering::Relaxed)
    }

    /// Reading fails from here on ([`io::ErrorKind::QuotaExceeded`]) when more than so many bytes come between two calls of [`Self::take_read_byte_count`].
    pub fn fail_reads_beyond_bytes_between_takes_of_byte_count(&self, most_bytes: usize) {
        self.read.count.store(0, Ordering::Relaxed);
        self.read.most.store(most_bytes, Ordering::Relaxed);
    }

    /// Resolves once it has closed the connection, or its half of it. The two cannot be told from each other before something is written.
    async fn wait_until_connection_closed(&self) {
        let Some(source) = &self.source else { return std::future::pending().await };
        loop {
            let ready = match source {
                ReadHalf::Tcp(read) => read.ready(Interest::READABLE).await,
                #[cfg(unix)]
                ReadHalf::Unix(read) => read.ready(Interest::READABLE).await,
            };
            if ready.map_or(true, |ready| ready.is_read_closed()) {
                return;
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    /// The result of `work`, which ends when the sender closes the connection.
    ///
    /// # Errors
    /// [`Problem`]: that of `work`, or that the connection is closed.
    pub async fn run_until_connection_closed<T>(
        &self,
        work: impl Future<Output = Result<T, Problem>>,
    ) -> Result<T, Problem> {
        tokio::select! {
            result = work => result,
            () = self.wait_until_connection_closed() => {
                Err(Problem::new(ProblemKind::PreviewFailed, "the client closed the connection"))
            }
        }
    }
}

impl<S: Sync> FromRequestParts<S> for RequestSender {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get().cloned().unwrap_or_default())
    }
}

impl ReadHalf {
    fn poll_read_ready(&self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self {
            Self::Tcp(read) => AsRef::<TcpStream>::as_ref(&**read).poll_read_ready(context),
            #[cfg(unix)]
            Self::Unix(read) => AsRef::<UnixStream>::as_ref(&**read).poll_read_ready(context),
        }
    }

    fn try_read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(read) => read.try_read(buffer),
            #[cfg(unix)]
            Self::Unix(read) => read.try_read(buffer),
        }
    }
}

impl<W: Unpin> AsyncRead for WatchedConnection<W> {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        loop {
            ready!(self.source.poll_read_ready(context))?;
            match self.source.try_read(buffer.initialize_unfilled()) {
                Ok(read) => {
                    buffer.advance(read);
                    let count = self.read.count.fetch_add(read, Ordering::Relaxed).saturating_add(read);
                    let most = self.read.most.load(Ordering::Relaxed);
                    let is_too_much = most > 0 && count > most;
                    return Poll::Ready(if is_too_much { Err(io::ErrorKind::QuotaExceeded.into()) } else { Ok(()) });
                }
                // It was not ready after all, and is asked again.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Poll::Ready(Err(error)),
            }
        }
    }
}

impl<W: AsyncWrite + Unpin> AsyncWrite for WatchedConnection<W> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.sink).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.sink).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.sink).poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.sink).poll_write_vectored(context, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.sink.is_write_vectored()
    }
}

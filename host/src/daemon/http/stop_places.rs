//! Connections in the places that are kept for stops: who has said nothing there makes way for whoever comes.

use std::collections::VecDeque;
use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::task::{Context, Poll};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::{Notify, OwnedSemaphorePermit};

/// A connection's place, for as long as it has it.
#[derive(Debug)]
pub struct StopConnection {
    place: Mutex<Option<OwnedSemaphorePermit>>,
    has_spoken: Arc<AtomicBool>,
    leaves: Notify,
}

impl StopConnection {
    /// In this place.
    pub fn new(place: OwnedSemaphorePermit) -> Self {
        let has_spoken = Arc::new(AtomicBool::new(false));
        Self { place: Mutex::new(Some(place)), has_spoken, leaves: Notify::new() }
    }

    /// Its connection, listened to.
    pub fn wrap_stream_to_note_first_received_bytes<S>(&self, stream: S) -> WatchedStream<S> {
        WatchedStream { stream, has_spoken: Arc::clone(&self.has_spoken) }
    }

    /// Serves it until it is done or has to make way.
    pub async fn serve_until_evicted(&self, serving: impl Future<Output = ()>) {
        tokio::select! {
            () = self.leaves.notified() => tracing::debug!(
                "closing a connection that has sent nothing: the maximum number of connections is open, and a new connection \
                 has arrived"
            ),
            () = serving => {}
        }
    }
}

/// Guests in their order.
#[derive(Debug, Default)]
pub struct StopConnections(Mutex<VecDeque<Weak<StopConnection>>>);

impl StopConnections {
    /// One more.
    pub fn add_connection(&self, connection: &Arc<StopConnection>) {
        let mut connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        connections.retain(|known| known.strong_count() > 0);
        connections.push_back(Arc::downgrade(connection));
    }

    /// The place of the oldest that has said nothing, which is sent away.
    pub fn evict_oldest_silent_connection(&self) -> Option<OwnedSemaphorePermit> {
        let connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let silent = |guest: &Arc<StopConnection>| !guest.has_spoken.load(Ordering::SeqCst);
        connections.iter().filter_map(Weak::upgrade).filter(silent).find_map(|guest| {
            let place = guest.place.lock().unwrap_or_else(PoisonError::into_inner).take()?;
            guest.leaves.notify_one();
            Some(place)
        })
    }
}

/// A connection of which is known whether anything has come over it.
#[derive(Debug)]
pub struct WatchedStream<S> {
    stream: S,
    has_spoken: Arc<AtomicBool>,
}

impl<S: AsyncRead + Unpin> AsyncRead for WatchedStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        if buffer.filled().len() > before {
            self.has_spoken.store(true, Ordering::SeqCst);
        }
        read
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for WatchedStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}

//! The daemon: HTTP and WebSocket in front of one device session.
//!
//! `app` holds what a touch needs and does it, `stretches` what has time windows; `asked` is what goes to the planner; `preview` answers what a changed scene would do, without driving it;
//! `routes` and `live` are the two ways in; `view` is what goes out as JSON; `problem` is how errors are told (RFC 9457).

mod active;
mod app;
mod asked;
mod assets;
mod attachments;
mod body;
mod grow;
mod live;
mod messages;
mod metrics;
mod preview;
mod problem;
mod routes;
mod stretches;
mod touch;
mod turns;
mod view;

pub use app::App;
pub use attachments::Place;
pub use preview::{Preview, PreviewRequest};
pub use problem::Problem;
pub use touch::TouchRequest;
pub use view::{FieldView, PlanView};

use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

/// Where the daemon listens unless told otherwise: loopback only.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7878";

/// Serves `app` on `listener` until `shutdown` resolves, then stops and disarms the device.
///
/// # Errors
/// If the listener fails.
pub async fn serve(
    app: Arc<App>,
    listener: TcpListener,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> std::io::Result<()> {
    let router = routes::router(Arc::clone(&app));
    // Open WebSockets would hold a graceful shutdown up for ever, so they watch the same signal.
    let closing = app.closing();
    let result = axum::serve(listener, router)
        .with_graceful_shutdown(async move {
            shutdown.await;
            closing.send_replace(true);
        })
        .await;
    if let Err(error) = app.stop().await {
        tracing::warn!(%error, "could not stop the device on leaving; its dead-man timer does it");
    }
    result
}

/// A daemon in a thread of its own, for programs and tests that need one for a while.
#[derive(Debug)]
pub struct Background {
    address: SocketAddr,
    shutdown: Option<oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Background {
    /// Starts serving `app` on a free loopback port.
    ///
    /// # Errors
    /// If there is no port, thread or runtime to be had.
    pub fn start(app: App) -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0"))?;
        let address = listener.local_addr()?;
        let (shutdown, signal) = oneshot::channel();
        let thread = std::thread::Builder::new().name("daemon".into()).spawn(move || {
            let until = async move {
                let _ = signal.await;
            };
            if let Err(error) = runtime.block_on(serve(Arc::new(app), listener, until)) {
                tracing::error!(%error, "the daemon failed");
            }
        })?;
        Ok(Self { address, shutdown: Some(shutdown), thread: Some(thread) })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        drop(self.shutdown.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

//! The daemon: HTTP and WebSocket in front of one device session.
//!
//! Its folders, in the order in which they use each other: `api` (what all requests and answers have in common), `access` (who may do
//! what, and how often), `touch` (what is asked for and answered), `observe` (state, counters, recordings), `design` (previews, studies,
//! tolerances), `drive` (what the board drives), `live` (the socket), `http` (connections and paths). `app` holds all parts of a daemon;
//! only `live` and `http` may use it.

mod access;
mod api;
mod app;
mod design;
mod drive;
mod http;
mod live;
mod observe;
mod touch;

pub use access::limits::Limits;
pub use access::permissions::{Access, Token};
pub use api::problem::Problem;
pub use app::App;
pub use design::attachments::Place;
pub use design::preview::{Preview, PreviewRequest};
pub use design::studies::{StudyRequest, StudyView};
pub use design::tolerances::{TolerancesRequest, TolerancesView};
pub use http::listener::{self, Listener};
pub use http::routes::openapi_description_json as description;
pub use http::server::{EndReason, serve, serve_until_shutdown_or_session_end};
pub use observe::recording::{KeptBytes, Recorder};
pub use observe::scene::SceneView;
pub use touch::plan_view::{FieldView, PlanView};
pub use touch::request::{OtherTarget, QuietZone, TouchRequest};

use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

/// Where the daemon listens unless told otherwise: loopback only.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7878";

/// A daemon in a thread of its own, for programs and tests that need one for a while.
#[derive(Debug)]
pub struct BackgroundDaemon {
    address: SocketAddr,
    shutdown: Option<oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl BackgroundDaemon {
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
            runtime.block_on(serve(Arc::new(app), vec![Listener::Tcp(listener)], until));
        })?;
        Ok(Self { address, shutdown: Some(shutdown), thread: Some(thread) })
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for BackgroundDaemon {
    fn drop(&mut self) {
        drop(self.shutdown.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

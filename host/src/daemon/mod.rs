//! The daemon: HTTP and WebSocket in front of one device session.
//!
//! `server` accepts connections and gives every request a task of its own, `guests` keeps a way in for stops, `linger` ends connections whose sender still sends;
//! `head` looks at the head of a request, `pace` has those wait whose client asks too fast, `access` says who may do what, by `origins` and tokens;
//! `routes` and `live`
//! are the two ways in. `admission` numbers requests and queues them for the planner, by `client`. `app` holds what a touch needs and plans
//! it, `drive` has the board drive it, `stretches` what has time windows; `asked` is what goes to the planner; `preview` answers what a changed scene would
//! do, without driving it, in `slots` of its own, `studies` which of many would do it best, `tolerances` what a plan does on a panel that is a little off; the last two are the one
//! `background` work that there may be at a time. What takes long is done `aside`, no longer than its `sender` waits. `answers` and `view` are what goes out as JSON; `problem` is how errors are told (RFC 9457), `kinds` which there
//! are. `description` makes the interface's description (OpenAPI) from all of these.

mod access;
mod admission;
mod answers;
mod app;
mod aside;
mod asked;
mod assets;
mod attachments;
mod background;
mod body;
mod client;
mod description;
mod drive;
mod guests;
mod head;
mod kinds;
mod leftover;
mod limits;
mod linger;
pub mod listener;
mod live;
mod measured;
mod metrics;
mod origins;
mod pace;
mod planned;
mod preview;
mod problem;
mod query;
mod record;
mod routes;
mod sender;
mod server;
mod slots;
mod strangers;
mod stretches;
mod studies;
mod tolerances;
mod touch;
mod view;
mod warm;
mod whole;

pub use access::{Access, Token};
pub use answers::scene::SceneView;
pub use app::App;
pub use attachments::Place;
pub use limits::Limits;
pub use listener::Listener;
pub use preview::{Preview, PreviewRequest};
pub use problem::Problem;
pub use record::{Kept, Recorder};
pub use routes::described as description;
pub use server::{Ended, serve, serve_while_alive};
pub use studies::{StudyRequest, StudyView};
pub use tolerances::{TolerancesRequest, TolerancesView};
pub use touch::TouchRequest;
pub use view::{FieldView, PlanView};

use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

/// Where the daemon listens unless told otherwise: loopback only.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:7878";

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

impl Drop for Background {
    fn drop(&mut self) {
        drop(self.shutdown.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

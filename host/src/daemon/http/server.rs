//! Connections: accepted, limited, served, and ended.
//!
//! Every request runs in a task of its own from its last header byte on. A sender that hangs up ends its connection and
//! nothing else: a stop is carried out, and a touch is driven, shown and counted, whoever still listens for the answer.

use super::linger::Lingering;
use super::listener::{Incoming, Listener};
use super::routes;
use super::stop_places::{StopConnection, StopConnections};
use crate::daemon::access::client::Peer;
use crate::daemon::access::limits::Limits;
use crate::daemon::access::permissions::{Owner, Scheme};
use crate::daemon::access::sender::RequestSender;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::daemon::app::App;
use crate::daemon::drive::wait_for_closing;
use crate::daemon::observe::measurements::record_every_change_and_measurements_while_rails_up;
use crate::device::{DeviceSnapshot, SessionError};
use axum::Router;
use axum::response::{IntoResponse, Response};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio_io_timeout::TimeoutStream;
use tower_service::Service;

/// After an accept that failed: the system is out of file handles, most often.
const ACCEPT_AGAIN: Duration = Duration::from_millis(50);

/// Why a daemon has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndReason {
    /// It was asked to.
    Asked,
    /// The thread that looks after the device is no more, by a mistake in this program.
    Session,
}

/// As [`serve`], and no longer than the session with the device lasts. Its thread is not started anew: it ended by a panic, so what it knew of
/// the board is worth nothing. The board has gone off by its dead-man time and can only be driven by a daemon that begins with its hello;
/// one that went on without would look alive and answer every touch with 503.
pub async fn serve_until_shutdown_or_session_end(
    app: Arc<App>,
    listeners: Vec<Listener>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> EndReason {
    let (watched, (told, ended)) = (Arc::clone(&app), watch::channel(EndReason::Asked));
    let until = async move {
        tokio::select! {
            () = shutdown => {}
            () = watched.driver.wait_for_session_end() => {
                tracing::error!(
                    "{}. The daemon now exits; if a service manager runs the daemon, the service manager restarts the \
                     daemon",
                    SessionError::Ended
                );
                told.send_replace(EndReason::Session);
            }
        }
    };
    serve(app, listeners, until).await;
    *ended.borrow()
}

/// Serves `app` on all `listeners` until `shutdown` resolves. The device is stopped first then, whatever connections do.
pub async fn serve(app: Arc<App>, listeners: Vec<Listener>, shutdown: impl Future<Output = ()> + Send + 'static) {
    let closing = app.driver.subscribe_closing();
    let mut all = JoinSet::new();
    for listener in listeners {
        // Each with places of its own: a crowd at one is in nobody's way at another.
        all.spawn(accept_connections(listener, ConnectionServer::new(&app), closing.clone()));
    }
    all.spawn(super::cache_warmer::keep_caches_warm_while_armed_and_idle(Arc::clone(&app)));
    if app.record.is_some() {
        all.spawn(record_device_measurements(Arc::clone(&app)));
    }
    shutdown.await;
    app.begin_closing_and_stop_studies_and_device().await;
    // Pages are told so before the process ends.
    let told = tokio::time::timeout(app.limits.goodbye, app.wait_until_all_sockets_closed());
    let _ = tokio::join!(told, async { while all.join_next().await.is_some() {} });
}

async fn record_device_measurements(app: Arc<App>) {
    let Some(recorder) = &app.record else { return };
    let view = |device: &DeviceSnapshot| app.build_recorded_device_view(device);
    record_every_change_and_measurements_while_rails_up(
        app.driver.subscribe_device_snapshots(),
        app.driver.subscribe_closing(),
        recorder,
        view,
    )
    .await;
}

/// Accepts connections until the daemon ends, and gives those that are open then a moment.
async fn accept_connections(listener: Listener, server: ConnectionServer, mut closing: watch::Receiver<bool>) {
    let mut tasks = JoinSet::new();
    loop {
        tokio::select! {
            () = wait_for_closing(&mut closing) => break,
            Some(_) = tasks.join_next(), if !tasks.is_empty() => {}
            accepted = listener.accept() => match accepted {
                Ok(incoming) => server.spawn_task_serving_all_or_stop_only_or_drop_if_full(incoming, &mut tasks),
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    tokio::time::sleep(ACCEPT_AGAIN).await;
                }
            },
        }
    }
    drop(listener);
    let goodbye = server.limits.goodbye;
    let all = async { while tasks.join_next().await.is_some() {} };
    if tokio::time::timeout(goodbye, all).await.is_err() {
        tracing::info!(open = tasks.len(), "closing connections that did not end in time");
    }
}

/// What connections are served with.
struct ConnectionServer {
    all: Router,
    stop_only: Router,
    places: Arc<Semaphore>,
    stop_places: Arc<Semaphore>,
    connections: StopConnections,
    limits: Limits,
    closing: watch::Receiver<bool>,
}

impl ConnectionServer {
    fn new(app: &Arc<App>) -> Self {
        Self {
            all: routes::build_router(Arc::clone(app)),
            stop_only: routes::build_stop_only_router(Arc::clone(app)),
            places: Arc::new(Semaphore::new(app.limits.connections)),
            stop_places: Arc::new(Semaphore::new(app.limits.stop_connections)),
            connections: StopConnections::default(),
            limits: app.limits,
            closing: app.driver.subscribe_closing(),
        }
    }

    /// Serves a connection in a task of its own, or drops it where there is no place.
    fn spawn_task_serving_all_or_stop_only_or_drop_if_full(&self, incoming: Incoming, tasks: &mut JoinSet<()>) {
        let place = |places: &Arc<Semaphore>| Arc::clone(places).try_acquire_owned().ok();
        let mut limits = self.limits;
        let (router, stop_connection) = match place(&self.places) {
            Some(place) => (self.all.clone(), Arc::new(StopConnection::new(place))),
            None => match place(&self.stop_places).or_else(|| self.connections.evict_oldest_silent_connection()) {
                Some(place) => {
                    limits.handshake = limits.handshake.min(limits.stop_headers);
                    limits.headers = limits.headers.min(limits.stop_headers);
                    let stop_connection = Arc::new(StopConnection::new(place));
                    self.connections.add_connection(&stop_connection);
                    (self.stop_only.clone(), stop_connection)
                }
                None => return tracing::warn!("too many connections are open; the daemon refuses a new connection"),
            },
        };
        let closing = self.closing.clone();
        match incoming {
            Incoming::Tcp(stream) => {
                let peer = Peer::from_address_or_unknown_if_error(stream.peer_addr());
                let (sender, stream) = RequestSender::pair_peer_close_watcher_with_tcp_connection(stream);
                let (end, stream) = (
                    ConnectionEnd { peer, sender, scheme: Some(Scheme("http")) },
                    Lingering::new(stop_connection.wrap_stream_to_note_first_received_bytes(stream)),
                );
                tasks.spawn(async move {
                    stop_connection.serve_until_evicted(serve_connection(stream, end, router, limits, closing)).await
                })
            }
            #[cfg(unix)]
            Incoming::Unix(stream) => {
                let peer = Peer::Process(stream.peer_cred().ok().and_then(|process| process.pid()));
                let (sender, stream) = RequestSender::pair_peer_close_watcher_with_unix_connection(stream);
                let (end, stream) = (
                    ConnectionEnd { peer, sender, scheme: None },
                    Lingering::new(stop_connection.wrap_stream_to_note_first_received_bytes(stream)),
                );
                tasks.spawn(async move {
                    stop_connection.serve_until_evicted(serve_connection(stream, end, router, limits, closing)).await
                })
            }
            Incoming::Tls(stream, acceptor) => {
                let peer = Peer::from_address_or_unknown_if_error(stream.peer_addr());
                let (sender, stream) = RequestSender::pair_peer_close_watcher_with_tcp_connection(stream);
                let (end, stream) = (
                    ConnectionEnd { peer, sender, scheme: Some(Scheme("https")) },
                    Lingering::new(stop_connection.wrap_stream_to_note_first_received_bytes(stream)),
                );
                let serving = async move {
                    match tokio::time::timeout(limits.handshake, acceptor.accept(stream)).await {
                        Ok(Ok(stream)) => serve_connection(stream, end, router, limits, closing).await,
                        Ok(Err(error)) => tracing::debug!(%error, "a TLS handshake failed"),
                        Err(_) => tracing::debug!("a TLS handshake took too long"),
                    }
                };
                tasks.spawn(async move { stop_connection.serve_until_evicted(serving).await })
            }
        };
    }
}

/// The other end of a connection, for whoever answers its requests.
#[derive(Clone)]
struct ConnectionEnd {
    peer: Peer,
    sender: RequestSender,
    /// `None` through the socket in the file system, whose permissions have asked who it is.
    scheme: Option<Scheme>,
}

impl ConnectionEnd {
    fn insert_into_extensions(&self, extensions: &mut hyper::http::Extensions) {
        extensions.insert(self.peer);
        extensions.insert(self.sender.clone());
        match self.scheme {
            Some(scheme) => drop(extensions.insert(scheme)),
            None => drop(extensions.insert(Owner)),
        }
    }
}

/// One connection to its end.
async fn serve_connection<S>(
    stream: S,
    end: ConnectionEnd,
    router: Router,
    limits: Limits,
    mut closing: watch::Receiver<bool>,
) where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    // Of answers that nobody takes; hyper has limits for what comes in only.
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(limits.answer));
    let stream = Box::pin(stream);
    let service = service_fn(move |mut request: hyper::Request<hyper::body::Incoming>| {
        end.insert_into_extensions(request.extensions_mut());
        let mut router = router.clone();
        // Begun here and not when the answer is first waited for: by then the sender may have hung up, and hyper drops what
        // it waits for.
        let task = tokio::spawn(async move { router.call(request).await });
        async move {
            let answer: Result<Response, Infallible> = match task.await {
                Ok(answer) => answer,
                Err(error) => {
                    tracing::error!(%error, "a request failed");
                    Ok(failed_request_problem().into_response())
                }
            };
            answer
        }
    });
    let mut builder = http1::Builder::new();
    // A sender that closes its half of the connection still wants its answer (`nc -N`).
    builder.half_close(true).timer(TokioTimer::new()).header_read_timeout(limits.headers);
    let mut connection = std::pin::pin!(builder.serve_connection(TokioIo::new(stream), service).with_upgrades());
    let result = tokio::select! {
        result = &mut connection => result,
        () = wait_for_closing(&mut closing) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(%error, "a connection ended because of an error");
    }
}

fn failed_request_problem() -> Problem {
    let detail = "this request caused an internal error; the daemon's log has the details";
    Problem::new(ProblemKind::Internal, detail)
}

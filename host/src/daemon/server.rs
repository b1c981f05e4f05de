//! Connections: accepted, limited, served, and ended.
//!
//! Every request runs in a task of its own from its last header byte on. A sender that hangs up ends its connection and
//! nothing else: a stop is carried out, and a touch is driven, shown and counted, whoever still listens for the answer.

use super::access::Owner;
use super::app::{App, closed};
use super::listener::{Incoming, Listener};
use super::problem::{Kind, Problem};
use super::routes;
use axum::Router;
use axum::response::{IntoResponse, Response};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::JoinSet;
use tower_service::Service;

/// Connections at once. A page takes one or two, each task some 20 kB.
const CONNECTIONS: usize = 256;
/// Connections beside them on which only `POST /v1/stop` is taken, so that nobody can keep a stop out by opening many.
const STOP_CONNECTIONS: usize = 32;
/// For a TLS handshake.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// From a connection's start, or the end of its last answer, to the last byte of the next request's headers.
const HEADER_TIME: Duration = Duration::from_secs(30);
/// For answers that are on their way when the daemon ends; the device is off by then.
const GOODBYE: Duration = Duration::from_secs(2);
/// After an accept that failed: the system is out of file handles, most often.
const ACCEPT_AGAIN: Duration = Duration::from_millis(50);

/// Serves `app` on all `listeners` until `shutdown` resolves. The device is stopped first then, whatever connections do.
pub async fn serve(app: Arc<App>, listeners: Vec<Listener>, shutdown: impl Future<Output = ()> + Send + 'static) {
    let closing = app.closing();
    let mut all = JoinSet::new();
    for listener in listeners {
        // Each with places of its own: a crowd at one is in nobody's way at another.
        all.spawn(listen(listener, Doors::new(&app), closing.clone()));
    }
    shutdown.await;
    app.close().await;
    while all.join_next().await.is_some() {}
}

/// Accepts connections until the daemon ends, and gives those that are open then a moment.
async fn listen(listener: Listener, doors: Doors, mut closing: watch::Receiver<bool>) {
    let mut tasks = JoinSet::new();
    loop {
        tokio::select! {
            () = closed(&mut closing) => break,
            Some(_) = tasks.join_next(), if !tasks.is_empty() => {}
            accepted = listener.accept() => match accepted {
                Ok(incoming) => doors.enter(incoming, &mut tasks),
                Err(error) => {
                    tracing::warn!(%error, "a connection could not be accepted");
                    tokio::time::sleep(ACCEPT_AGAIN).await;
                }
            },
        }
    }
    drop(listener);
    let all = async { while tasks.join_next().await.is_some() {} };
    if tokio::time::timeout(GOODBYE, all).await.is_err() {
        tracing::info!(open = tasks.len(), "connections that do not end are closed");
    }
}

/// What connections are served with.
struct Doors {
    all: Router,
    stop_only: Router,
    places: Arc<Semaphore>,
    stop_places: Arc<Semaphore>,
    closing: watch::Receiver<bool>,
}

impl Doors {
    fn new(app: &Arc<App>) -> Self {
        Self {
            all: routes::router(Arc::clone(app)),
            stop_only: routes::stop_only(Arc::clone(app)),
            places: Arc::new(Semaphore::new(CONNECTIONS)),
            stop_places: Arc::new(Semaphore::new(STOP_CONNECTIONS)),
            closing: app.closing(),
        }
    }

    /// Serves a connection in a task of its own, or drops it where there is no place.
    fn enter(&self, incoming: Incoming, tasks: &mut JoinSet<()>) {
        let place = |places: &Arc<Semaphore>| Arc::clone(places).try_acquire_owned().ok();
        let (router, place) = match place(&self.places) {
            Some(place) => (self.all.clone(), place),
            None => match place(&self.stop_places) {
                Some(place) => (self.stop_only.clone(), place),
                None => return tracing::warn!("too many connections; one is refused"),
            },
        };
        let closing = self.closing.clone();
        match incoming {
            Incoming::Tcp(stream) => tasks.spawn(connection(stream, router, place, closing)),
            #[cfg(unix)]
            Incoming::Unix(stream) => {
                // The file's permissions have asked already.
                let router = router.layer(axum::Extension(Owner));
                tasks.spawn(connection(stream, router, place, closing))
            }
            Incoming::Tls(stream, acceptor) => tasks.spawn(async move {
                match tokio::time::timeout(HANDSHAKE, acceptor.accept(stream)).await {
                    Ok(Ok(stream)) => connection(stream, router, place, closing).await,
                    Ok(Err(error)) => tracing::debug!(%error, "a handshake failed"),
                    Err(_) => tracing::debug!("a handshake took too long"),
                }
            }),
        };
    }
}

/// One connection to its end.
async fn connection<S>(stream: S, router: Router, _place: OwnedSemaphorePermit, mut closing: watch::Receiver<bool>)
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let service = service_fn(move |request: hyper::Request<hyper::body::Incoming>| {
        let mut router = router.clone();
        // Begun here and not when the answer is first waited for: by then the sender may have hung up, and hyper drops what
        // it waits for.
        let task = tokio::spawn(async move { router.call(request).await });
        async move {
            let answer: Result<Response, Infallible> = match task.await {
                Ok(answer) => answer,
                Err(error) => {
                    tracing::error!(%error, "a request failed");
                    Ok(failed().into_response())
                }
            };
            answer
        }
    });
    let mut builder = http1::Builder::new();
    // A sender that closes its half of the connection still wants its answer (`nc -N`).
    builder.half_close(true).timer(TokioTimer::new()).header_read_timeout(HEADER_TIME);
    let mut connection = std::pin::pin!(builder.serve_connection(TokioIo::new(stream), service).with_upgrades());
    let result = tokio::select! {
        result = &mut connection => result,
        () = closed(&mut closing) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(%error, "a connection ended");
    }
}

fn failed() -> Problem {
    let detail = "the daemon made a mistake with this request; its log says which";
    Problem::new(Kind::Internal, detail)
}

//! An app that a test serves itself, on listeners of its own.

use era::daemon::listener::TlsFiles;
use era::daemon::{App, Listener, serve};
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// How long its end is waited for: connections have 2 s then.
const WAIT: Duration = Duration::from_secs(10);

/// Served until this is dropped.
pub struct Served {
    pub runtime: Runtime,
    end: Option<oneshot::Sender<()>>,
    serving: Option<JoinHandle<()>>,
}

impl Served {
    /// On what `listeners` opens.
    pub fn on(app: &Arc<App>, listeners: impl Future<Output = Vec<Listener>>) -> Self {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let listeners = runtime.block_on(listeners);
        let (end, ended) = oneshot::channel();
        let until = async {
            let _ = ended.await;
        };
        let serving = runtime.spawn(serve(Arc::clone(app), listeners, until));
        Self { runtime, end: Some(end), serving: Some(serving) }
    }

    /// On a free loopback port; and where that is.
    pub fn at_a_port(app: &Arc<App>, tls: Option<&TlsFiles>) -> (Self, String) {
        let mut url = String::new();
        let served = Self::on(app, async {
            let listener = Listener::bind_tcp("127.0.0.1:0".parse().unwrap(), tls, false).await.unwrap();
            url = listener.url();
            vec![listener]
        });
        (served, url)
    }

    /// Asks it to end.
    pub fn ends(&mut self) {
        let _ = self.end.take().map(|end| end.send(()));
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.ends();
        let Some(serving) = self.serving.take() else { return };
        let ended = self.runtime.block_on(async { tokio::time::timeout(WAIT, serving).await });
        assert!(matches!(ended, Ok(Ok(()))) || std::thread::panicking(), "it still serves, or has failed: {ended:?}");
    }
}

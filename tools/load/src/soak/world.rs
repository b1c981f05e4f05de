//! What clients and faults have in common: which daemon there is now, and whether to go on.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

/// A daemon among those that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServingDaemon {
    /// Counted from 1.
    pub generation: u64,
    /// Where it listens.
    pub address: SocketAddr,
}

/// Which daemon there is now.
#[derive(Debug, Default)]
pub struct SoakState {
    serving: RwLock<Option<SocketAddr>>,
    generation: AtomicU64,
    over: AtomicBool,
}

impl SoakState {
    /// A daemon serves.
    pub fn set_serving_daemon_incrementing_generation(&self, address: SocketAddr) {
        let mut serving = self.serving.write().unwrap_or_else(PoisonError::into_inner);
        self.generation.fetch_add(1, Ordering::SeqCst);
        *serving = Some(address);
    }

    /// It is about to be killed: from here on nobody can know what becomes of what it was sent.
    pub fn clear_daemon(&self) {
        *self.serving.write().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// The daemon that serves now, if any does.
    #[must_use]
    pub fn current_daemon(&self) -> Option<ServingDaemon> {
        // Under the lock, so that a number goes with its address.
        let serving = self.serving.read().unwrap_or_else(PoisonError::into_inner);
        serving.map(|address| ServingDaemon { generation: self.generation.load(Ordering::SeqCst), address })
    }

    /// Whether this daemon still serves.
    #[must_use]
    pub fn is_current_daemon(&self, serving: ServingDaemon) -> bool {
        self.current_daemon() == Some(serving)
    }

    /// Clients shall end.
    pub fn tell_clients_to_end(&self) {
        self.over.store(true, Ordering::SeqCst);
    }

    /// Whether clients shall end.
    #[must_use]
    pub fn should_clients_end(&self) -> bool {
        self.over.load(Ordering::SeqCst)
    }
}

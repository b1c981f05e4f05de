//! What the daemon shows of itself: its state and the device's, the scene, counters, and recordings.
//!
//! Uses `api`, `access` and `touch`.

mod device;
pub mod measurements;
pub mod metrics;
pub mod recording;
pub mod scene;
pub mod state;

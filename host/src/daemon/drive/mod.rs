//! What the board drives: one task owns it, takes commands, and publishes what is driven.
//!
//! `driver` is the one way from a touch to the board; it plans (`plan`; `stretches` for time windows, `sequence` for effect files), and hands what is to be driven to
//! the `controller`. `prepare` turns a plan into an `order` that the session takes, `equipment` is what that needs: table, session,
//! simulated sensor, and `known_clicks`, which are not designed twice. `state` is what has been driven, what is left of it, and what is shown of it, as data with times handed in. `task`
//! changes it, one `activity` of the board at a time, and looks after a drive that goes on (`sustained`); the `controller` is how others talk to it, by `command`s. `active` is
//! what they are told, `burst` and `credit` are the board's limits on drives that go on.
//!
//! Uses `api`, `access`, `touch`, `observe` and `design`.

pub mod active;
mod activity;
mod burst;
mod command;
mod controller;
mod credit;
mod driver;
mod equipment;
mod known_clicks;
mod order;
mod plan;
mod prepare;
mod sequence;
mod state;
mod stretches;
mod sustained;
mod task;

pub use command::superseded_problem;
pub use controller::DriveController;
pub use driver::TouchDriver;
pub use equipment::DriveEquipment;

use tokio::sync::watch;

/// Resolves when the daemon ends.
pub async fn wait_for_closing(closing: &mut watch::Receiver<bool>) {
    // An error means that it is gone already.
    let _ = closing.wait_for(|closing| *closing).await.map(|_| ());
}

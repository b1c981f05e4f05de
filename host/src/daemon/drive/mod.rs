//! What the board drives: one task owns it, takes commands, and publishes what is driven.
//!
//! `prepare` makes of a plan an `order` that the session takes, `equipment` is what that needs: table, session, simulated sensor.
//! `state` is what has been driven, what is left of it, and what is shown of it, as data with times handed in. `task` changes it, and looks
//! after a drive that goes on (`sustained`); `controller` is how others talk to it, by `command`s. `active` is what they are told, `burst` and `credit` are
//! the board's limits on what goes on and on.
//!
//! Uses `api`, `access`, `touch`, `observe` and `design`.

pub mod active;
mod burst;
mod command;
mod controller;
pub mod credit;
mod equipment;
mod order;
mod plan;
mod prepare;
mod state;
mod stretches;
mod sustained;
mod task;

pub use command::say_superseded;
pub use controller::Controller;
pub use equipment::Equipment;

//! What changed scenes would do, without driving anything: previews, small studies, tolerances of a plan.
//!
//! `attachments` moves supports, masses and actuators in a scene's text. `low_priority` runs what takes long on threads of its own;
//! `slots` limits how many previews there are at once, `background` is the one place for studies and tolerances.
//!
//! Uses `api`, `access`, `touch` and `observe`.

pub mod attachments;
pub mod background;
pub mod low_priority;
pub mod preview;
pub mod slots;
pub mod studies;
pub mod tolerances;

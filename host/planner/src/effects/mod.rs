//! Effects: clicks, buzzes, pulse trains, textures, as envelopes that the board plays by its own clock.
//!
//! [`named`] holds what there is and the parameters it takes, [`envelope`] what an envelope's segments are cycle by cycle,
//! [`motion`] what a point does under them (harmonics of the square-edged force included), [`click`] pushes and brakes
//! designed from the panel's poles, [`mod@design`] the whole for a plan, [`intensity`] strengths in g or dB above threshold.

pub mod click;
pub mod design;
mod effect_drive;
pub mod envelope;
mod error;
pub mod intensity;
pub mod motion;
pub mod named;
mod plan_view;
mod supply;
mod travel;
pub mod view;

pub use design::{Design, design};
pub use error::DesignError;
pub use intensity::{Intensity, at_level, plan_with};
pub use named::{EffectError, EffectRequest, NamedEffect};

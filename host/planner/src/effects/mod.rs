//! Effects: clicks, buzzes, pulse trains, textures, as envelopes that the board plays by its own clock.
//!
//! [`named`] holds what there is and the parameters it takes, [`envelope`] what an envelope's segments are cycle by cycle,
//! [`motion`] what a point does under them (harmonics of the square-edged force included), [`click`] pushes and brakes
//! designed from the panel's poles, [`mod@design`] the whole for a plan, [`windows`] clicks of single windows, [`intensity`] strengths in g or dB above threshold.

pub mod click;
pub mod design;
mod effect_drive;
mod effect_window;
pub mod envelope;
mod error;
pub mod intensity;
pub mod motion;
pub mod named;
mod plan_view;
mod quiet;
mod sampled;
mod supply;
mod travel;
pub mod view;
mod weaker;
pub mod windows;

pub use design::{EffectDesign, design_effect, design_effect_with_given_envelope};
pub use effect_window::EffectWindow;
pub use error::DesignError;
pub use intensity::{
    Intensity, plan_request_with_intensity_for_targets_without_one, set_missing_target_peaks_from_level_if_given,
};
pub use named::{EffectError, EffectRequest, NamedEffect};
pub use sampled::sample_acceleration_of_design_unless_undamped_m_per_s2;
pub use windows::{
    design_effect_of_windows_if_common_click_exists_else_of_drives,
    is_click_for_up_to_three_targets_without_quiet_zones,
};

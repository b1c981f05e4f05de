//! Crisp clicks: bursts of single windows on all electrodes from one clock edge, chosen by a linear programme.
//!
//! A click is crisp if it comes at once and leaves nothing: its peak within 15 ms, and below a tenth of it from 30 or 45 ms on. What a
//! place does under the forces of windows in slots of 1 ms is linear in these forces (`slots`); the forces of least effort that make the
//! peak, and leave no more than allowed on the panel and on panels whose stiffness is off, are a linear programme (`program`). Its
//! solutions are sparse: most slots have no force, and most others nearly the full one. Each force becomes one window of an electrode
//! (`realise`) at the voltage of its rail (`rails`), whose motion is then computed with the electrodes' charging and the moving gaps (`motion`); what that differs by is
//! given back to the programme. [`measures`] has the figures of a click, [`bound`] the strongest crisp click that no drive of these
//! actuators can exceed, [`sound`] how loud a click is, and [`design`] the whole.
//!
//! What counts is the felt band ([`felt`]): full up to 300 Hz and nothing from 500 Hz on. Method: minimum-effort input shaping
//! (Singhose, Command shaping for flexible systems, 2009), with the constraints as Chebyshev bounds in time.

mod actuator;
pub mod bound;
pub mod design;
mod designer;
mod dual_simplex;
pub mod felt;
pub mod measures;
mod motion;
mod options;
pub mod places;
mod program;
mod realise;
mod slots;
pub mod sound;
mod window;

pub use design::{ClickDesign, design_click_windows, simulate_felt_acceleration_of_windows_m_per_s2};
pub use options::{CRISP_RANGE_S, ClickOptions, LATEST_PEAK_S, MAX_STANDING_RAIL_RATIO, Preference};
pub use window::{ClickWindow, LEAD_S};

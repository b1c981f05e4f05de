//! The finite-element model of a panel.
//!
//! * [`hermite`]: cubic Hermite functions and their one-dimensional matrices,
//! * [`mesh`]: grid lines through every attachment, fine enough for the shortest wave,
//! * [`grid`]: the lines' nodes and the numbering of their unknowns,
//! * [`assembly`]: the panel's sparse matrices: bar elements, or Bogner-Fox-Schmit plate elements (tensor products of the
//!   bar's functions, conforming), supports, masses, ERAs,
//! * [`sparse`]: the matrices and their factorisation,
//! * [`rigid`]: motions that nothing holds,
//! * [`eigen`]: the modes, by shift-invert block Lanczos,
//! * [`damping`]: dampers, loss factor, Rayleigh's and modal damping over a basis,
//! * [`reduced`]: modes and residual shapes as a small model for response, planning and simulation.
//!
//! Data flows down this list; [`PanelModel`] is what the rest of the program uses.

pub mod accuracy;
pub mod assembly;
pub mod damping;
pub mod eigen;
mod error;
pub mod grid;
pub mod hermite;
pub mod mesh;
mod panel;
pub mod reduced;
pub mod rigid;
pub mod sparse;

pub use accuracy::Accuracy;
pub use error::ModelError;
pub use panel::{Mode, PanelModel};
pub use reduced::ReducedModel;

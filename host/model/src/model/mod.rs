//! The finite-element model of a panel.
//!
//! * [`shape`]: functions of a cell of any order and their one-dimensional matrices,
//! * [`singular`]: what point forces do to a plate, as functions of their own,
//! * [`mesh`]: grid lines, fine enough for the shortest wave,
//! * [`sections`]: what each cell is made of,
//! * `corners`: where moments are unbounded,
//! * `surroundings`: how far the function of an attachment may reach,
//! * `neighbours`: attachments, and which of them are very near to each other,
//! * `placement`: where the scene asks for lines and for those functions,
//! * [`points`]: deflections of stiffly held points as unknowns of their own,
//! * [`grid`]: the lines' functions and the numbering of their unknowns,
//! * [`assembly`]: the panel's sparse matrices: bar elements, or plate elements as tensor products of the bar's functions,
//!   supports, masses, ERAs,
//! * [`sparse`]: the matrices and their factorisation,
//! * [`rigid`]: motions that nothing holds,
//! * `columns`: an iteration's basis,
//! * [`eigen`]: the modes, by shift-invert block Lanczos,
//! * [`damping`]: dampers, loss factor, Rayleigh's and modal damping over a basis,
//! * [`poles`]: what becomes of modes under damping,
//! * [`reduced`]: modes and residual shapes as a small model for response, planning and simulation,
//! * `steady`: what steady forces do to it, by its springs alone,
//! * [`coupled`]: one panel with many designs of what is attached to it,
//! * [`bounded`]: the same question at rising orders until the bound meets a tolerance, or as long as there is time,
//! * [`estimator`]: a bound from the differences of the orders,
//! * [`levels`]: models of three orders to plan with,
//! * [`stored`]: reduced models as plain numbers, to be kept on disk,
//! * [`validity`]: where the theory of thin plates ends.
//!
//! Data flows down this list; [`PanelModel`] is what the rest of the program uses.

pub mod accuracy;
pub mod assembly;
mod attached;
mod bound;
pub mod bounded;
mod columns;
mod corners;
pub mod coupled;
pub mod damping;
mod edges;
pub mod eigen;
mod enriched;
mod error;
pub mod estimator;
mod fineness;
pub mod grid;
pub mod levels;
pub mod mesh;
mod neighbours;
mod orthotropic;
pub mod panel;
mod placement;
pub mod points;
pub mod poles;
mod questions;
pub mod reduced;
pub mod rigid;
pub mod sections;
pub mod shape;
pub mod singular;
pub mod sparse;
mod steady;
pub mod stored;
mod surroundings;
mod thin_cells;
pub mod validity;
mod wave;

pub use accuracy::Accuracy;
pub use bound::Bound;
pub use bounded::BoundedAnswer;
pub use coupled::{BarePanel, SurfaceCompliance};
pub use error::ModelError;
pub use fineness::Fineness;
pub use panel::{MeshCounts, PanelMode, PanelModel};
pub use poles::Pole;
pub use questions::compute_modes_with_error_bounds;
pub use reduced::ReducedModel;

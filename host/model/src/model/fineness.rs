//! How fine a mesh is.

use serde::{Deserialize, Serialize};

/// How fine a mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fineness {
    /// Widest cell in m.
    pub cell_m: f64,
    /// Order of the elements.
    pub order: usize,
    /// Most cells that shrink towards places where the shapes are singular; `corners` knows how many are of use where.
    pub layers: usize,
}

//! What panels do, in terms of relations and closed formulas: steady forces, attachments that are next to each other.

mod near;
mod steady;

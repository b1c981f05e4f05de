//! What panels do, in terms of relations and closed formulas: steady forces, poles of damped modes, attachments that are next to each other.

mod near;
mod poles;
mod steady;

//! What panels do, in terms of relations and closed formulas: steady forces, poles of damped modes and of dashpots that couple them, attachments that are next to each other.

mod coupled;
mod near;
mod poles;
mod steady;

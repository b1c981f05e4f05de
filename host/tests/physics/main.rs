//! What panels do, in terms of relations and closed formulas: attachments that are next to each other.

mod near;

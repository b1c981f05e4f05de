//! The model against closed formulas, converged references, series, relations and its own finer answers.

mod air;
mod bounds;
mod coupled;
mod held_by_springs;
mod losses;
mod many_modes;
mod model_extremes;
mod model_reference;
mod near;
mod patches;
mod poles;
mod response_checks;
mod scenes;
mod springs_in_line;
mod stiff_edges;
mod sweep;
mod transient;

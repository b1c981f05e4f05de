//! The program's own solution of the problem, timed.

use crate::clock::{median, timed};
use crate::error::Error;
use crate::problem::{Curves, MAX_HZ, Problem};
use era::model::grid::Fineness;
use era::model::{Accuracy, PanelModel};

/// The mesh of the tightest answer: highest order, cells a third of what the band needs.
pub const TIGHTEST: Fineness = Fineness { cell_m: 0.05, order: 15, layers: 4 };
/// The next lower order on the same mesh: how far it is from the tightest says how far that may be from the truth.
pub const NEXT: Fineness = Fineness { order: 13, ..TIGHTEST };

/// One solution.
#[derive(Clone, Copy, Debug)]
pub struct Own {
    /// Order of the elements.
    pub order: usize,
    /// Unknowns of the mesh.
    pub unknowns: usize,
    /// Modes and residual shapes.
    pub coordinates: usize,
    /// From the scene to modes, and the shapes at the points, in s.
    pub set_up_s: f64,
    /// All responses in s.
    pub sweep_s: f64,
    /// Largest on any curve, relative to its peak.
    pub error: f64,
}

/// Solves the problem `runs` times; times are medians.
///
/// # Errors
/// [`Error::Model`], [`Error::Response`].
pub fn solve(problem: &Problem, accuracy: Accuracy, reference: &Curves, runs: usize) -> Result<Own, Error> {
    let (mut set_up, mut sweep) = (Vec::new(), Vec::new());
    let mut out = None;
    for _ in 0..runs {
        let (model, model_s) = timed(|| PanelModel::build(&problem.scene, accuracy, MAX_HZ))?;
        let (reduced, reduce_s) = timed(|| model.reduce(MAX_HZ, &[]))?;
        let (curves, sweep_s) = timed(|| problem.reference(model.fineness()))?;
        set_up.push(model_s + reduce_s);
        sweep.push(sweep_s);
        out = Some((
            model.order(),
            model.dofs(),
            reduced.order(),
            reference.error_of(|p, f| curves.values[p * curves.count + f]),
        ));
    }
    let (order, unknowns, coordinates, error) = out.unwrap_or_default();
    Ok(Own { order, unknowns, coordinates, set_up_s: median(set_up), sweep_s: median(sweep), error })
}

//! How far a panel yields where it is pressed.

use super::{EvaluateError, Figures};
use crate::spec::{Figure, WantedFigure};
use era_model::model::BarePanel;
use era_model::scene::Scene;
use era_planner::maps::sag::{SoftestPlace, find_softest_place_under_steady_force};

/// Whether any sag is wanted.
pub(super) fn is_any_sag_wanted(wanted: &[WantedFigure]) -> bool {
    wanted.iter().any(is_sag_figure)
}

fn is_sag_figure(wanted: &WantedFigure) -> bool {
    wanted.figure == Figure::SagUm
}

/// Fills in the sags that are wanted of a design of `panel`. Returns the bound on their relative error; `None` where the panel yields without
/// end, and with cut-outs.
///
/// # Errors
/// [`EvaluateError::Model`].
pub(super) fn fill_in_wanted_sags_and_find_relative_error_bound_if_finite(
    figures: &mut Figures,
    wanted: &[WantedFigure],
    scene: &Scene,
    max_hz: f64,
    panel: &BarePanel,
) -> Result<Option<f64>, EvaluateError> {
    let SoftestPlace { m_per_n, error_m_per_n, .. } = find_softest_place_under_steady_force(panel, scene, max_hz)?;
    for (value, wanted) in figures.values.iter_mut().zip(wanted).filter(|(_, wanted)| is_sag_figure(wanted)) {
        *value = m_per_n * wanted.force_n.unwrap_or(scene.press_n) * 1e6;
    }
    let bound = error_m_per_n / m_per_n;
    Ok(bound.is_finite().then_some(bound))
}

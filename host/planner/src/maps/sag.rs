//! Where a panel yields most to a steady force, and how far.

use crate::table::SurfaceGrid;
use era_model::model::{BarePanel, ModelError, SurfaceCompliance};
use era_model::scene::Scene;

/// The softest place of a panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftestPlace {
    /// How far it yields to 1 N there, in m; infinite where nothing holds the panel.
    pub m_per_n: f64,
    /// What that may be off by, in m/N, of the model; what lies between the grid's points is not in it. Infinite with cut-outs, whose borders are no
    /// lines of the grid and where a panel may be softest.
    pub error_m_per_n: f64,
    /// The point of the grid next to it, in m.
    pub at_m: (f64, f64),
}

/// The softest place of a design of a panel, on the grid for frequencies up to `grid_for_up_to_hz`. Between the grid's points the yield is taken for
/// a parabola through the softest of them and its neighbours. The dimple that a fingertip makes in the panel right below it, which thin plates do not
/// have, is not in it.
///
/// # Errors
/// As [`BarePanel::compute_static_compliance_at_grid_points`].
pub fn find_softest_place_under_steady_force(
    panel: &BarePanel,
    scene: &Scene,
    grid_for_up_to_hz: f64,
) -> Result<SoftestPlace, ModelError> {
    let grid = SurfaceGrid::points_without_shapes(scene, grid_for_up_to_hz);
    let SurfaceCompliance { m_per_n, error_m_per_n } =
        panel.compute_static_compliance_at_grid_points(scene, &grid.x_m, &grid.y_m)?;
    let known = m_per_n.iter().enumerate().filter(|(_, yields)| !yields.is_nan());
    // Of equals the first.
    let (softest, most) = known.fold((0, 0.0), |most, (p, yields)| if *yields > most.1 { (p, *yields) } else { most });
    let (columns, rows) = (grid.x_m.len().max(1), grid.y_m.len());
    let (column, row) = (softest % columns, softest / columns);
    let beyond = |before: Option<usize>, after: Option<usize>| {
        let of = |p: Option<usize>| p.and_then(|p| m_per_n.get(p).copied()).filter(|yields| yields.is_finite());
        of(before)
            .zip(of(after))
            .map_or(0.0, |(before, after)| parabola_vertex_height_above_middle_value(before, most, after))
    };
    let along_x = beyond(column.checked_sub(1).map(|_| softest - 1), (column + 1 < columns).then_some(softest + 1));
    let along_y = beyond(softest.checked_sub(columns), (row + 1 < rows).then_some(softest + columns));
    let error = error_m_per_n.get(softest).copied().filter(|_| scene.cutouts.is_empty());
    Ok(SoftestPlace {
        m_per_n: most + along_x + along_y,
        error_m_per_n: error.unwrap_or(f64::INFINITY),
        at_m: (grid.x_m.get(column).copied().unwrap_or_default(), grid.y_m.get(row).copied().unwrap_or_default()),
    })
}

/// By how much the top of a parabola through three equidistant values is above the middle one, the largest.
fn parabola_vertex_height_above_middle_value(left_value: f64, middle: f64, right_value: f64) -> f64 {
    let bend = 2.0 * middle - left_value - right_value;
    if bend > 0.0 { (right_value - left_value).powi(2) / (8.0 * bend) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_has_its_top_between_points() {
        let of = |x: f64| 7.0 - 3.0 * (x - 0.2) * (x - 0.2);
        assert!((of(0.0) + parabola_vertex_height_above_middle_value(of(-1.0), of(0.0), of(1.0)) - 7.0).abs() < 1e-12);
        assert!(parabola_vertex_height_above_middle_value(1.0, 1.0, 1.0).abs() < 1e-300);
    }
}

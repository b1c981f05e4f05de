//! Models of three orders, for answers that are asked for over and over.

use super::bounded::RefinementLevel;
use super::estimator::ErrorEstimator;
use super::fineness::Fineness;
use super::grid::count_mesh_unknowns_before_edges_and_cutouts;
use super::panel::{PanelModel, choose_fineness};
use super::sections::CellSection;
use super::{Accuracy, ModelError, ReducedModel};
use crate::scene::{Scene, SurfaceKind, SurfaceLayer};
use crate::stop::StopRequest;
use std::f64::consts::{PI, TAU};
use std::time::Instant;

/// Size of the cells of a plate with cut-outs over the usual one.
const BESIDE_CUTOUTS: f64 = 0.5;

/// Highest frequency of the modes that a reduced model keeps, over the highest that is asked for.
const KEPT_MODES: f64 = 2.5;

/// Orders above that of a first try.
const MORE: usize = 2;
/// The same on plates with an actuator inside a cell. With orders 5, 7 and 9 the bounds of the example plate's plans were up to 2e-2, with 7, 9 and
/// 11 they are 3e-5 at most; with actuators on lines of the mesh, or where 1e-2 is enough, the lower orders are.
const MORE_INSIDE_CELLS: usize = 4;
/// The same on bars, which cost next to nothing: harmonics lie above `max_hz`, and on a light bar one at 2.5 times it was 3.5 % off.
const MORE_ON_BARS: usize = 4;

/// Reduced models of three levels, for answers that are asked for over and over.
#[derive(Clone, Debug)]
pub struct ReducedLevels {
    /// The finest.
    pub fine: ReducedModel,
    /// The next coarser one, and the one before that.
    pub coarser: [ReducedModel; 2],
    /// What makes a bound of their differences.
    pub estimator: ErrorEstimator,
    /// The levels, coarsest first; bounds belong to each answer.
    pub steps: Vec<RefinementLevel>,
}

/// Whether an actuator is inside a cell of a plate whose cells are all alike, at most `cell_m` long, and none is heavier than the panel.
fn has_only_light_actuators_and_one_inside_regular_cell(scene: &Scene, cell_m: f64) -> bool {
    /// Part of a cell that counts as none.
    const ON_LINE: f64 = 1e-6;
    let is_inside = |at_m: f64, side_m: f64| {
        let place = at_m / side_m * (side_m / cell_m).ceil().max(1.0);
        (place - place.round()).abs() > ON_LINE
    };
    let surface = &scene.surface;
    // With masses beyond that of the panel, rounding takes more than higher orders gain: a bound of 2e-4 for two of 1 t.
    let is_light = |mass_kg: f64| mass_kg < scene.surface_mass_without_air_kg();
    scene.actuators.iter().all(|own| is_light(own.moving_mass_kg))
        && scene.patches.is_empty()
        && scene.cutouts.is_empty()
        && scene.actuators.iter().any(|own| is_inside(own.x_m, surface.length_m) && is_inside(own.y_m, surface.width_m))
}

impl ReducedLevels {
    /// About how many unknowns the finest level has, before anything is built.
    ///
    /// # Errors
    /// As [`super::bounded::answer_with_error_bounds()`], if the mesh would be too fine.
    #[expect(clippy::cast_precision_loss, reason = "about")]
    pub fn estimate_unknown_count_of_finest_level(
        scene: &Scene,
        accuracy: Accuracy,
        max_hz: f64,
    ) -> Result<f64, ModelError> {
        Ok(count_mesh_unknowns_before_edges_and_cutouts(
            scene,
            Self::choose_three_meshes_finest_first(scene, accuracy, max_hz)?[0],
        ) as f64)
    }

    /// About how many modes a model for frequencies up to `max_hz` keeps, before anything is built: by Weyl's law, which counts those of a plate
    /// as its area times the square of the wave number over 4 pi, and those of a bar as its length times the wave number over pi.
    #[must_use]
    pub fn estimate_kept_mode_count(scene: &Scene, max_hz: f64) -> f64 {
        let omega = TAU * KEPT_MODES * max_hz;
        let of_layer = |(extent, layer): (f64, SurfaceLayer)| {
            let section = CellSection::from_layer(scene.surface.kind, &layer);
            // Of free waves, in rad/m, squared.
            let square = omega * (section.per_area / section.rigidity).sqrt();
            extent * if scene.surface.kind == SurfaceKind::Bar { square.sqrt() / PI } else { square / (4.0 * PI) }
        };
        scene.layout().areas_or_bar_lengths_with_layers().map(of_layer).sum()
    }

    /// Levels that meet a tolerance for frequencies up to `max_hz`, unless a panel is hardly damped.
    ///
    /// # Errors
    /// As [`super::bounded::answer_with_error_bounds()`].
    pub fn build(scene: &Scene, accuracy: Accuracy, max_hz: f64) -> Result<Self, ModelError> {
        Self::build_on_meshes(scene, Self::choose_three_meshes_finest_first(scene, accuracy, max_hz)?, max_hz)
    }

    /// The meshes for frequencies up to `max_hz`, finest first: of higher order than a first try, as nobody climbs from here, and
    /// cells of half the size where a cut-out's corners let errors fall with the square of the order only.
    ///
    /// # Errors
    /// As [`super::bounded::answer_with_error_bounds()`].
    pub(super) fn choose_three_meshes_finest_first(
        scene: &Scene,
        accuracy: Accuracy,
        max_hz: f64,
    ) -> Result<[Fineness; 3], ModelError> {
        let part = if scene.cutouts.is_empty() { 1.0 } else { BESIDE_CUTOUTS };
        let order = accuracy.choose_element_order_for_tolerance();
        let more = if scene.surface.kind == SurfaceKind::Bar {
            MORE_ON_BARS
        } else if accuracy.relative_tolerance_or_tightest() < Accuracy::FAST.relative_tolerance_or_tightest()
            && has_only_light_actuators_and_one_inside_regular_cell(
                scene,
                choose_fineness(scene, order, part, max_hz)?.cell_m,
            )
        {
            MORE_INSIDE_CELLS
        } else {
            MORE
        };
        Self::choose_meshes_of_three_orders_two_apart(scene, order + more, part, max_hz)
    }

    /// The meshes of an order and of the orders 2 and 4 below it, finest first.
    fn choose_meshes_of_three_orders_two_apart(
        scene: &Scene,
        order: usize,
        cell_fraction: f64,
        max_hz: f64,
    ) -> Result<[Fineness; 3], ModelError> {
        let of = |order| choose_fineness(scene, order, cell_fraction, max_hz);
        Ok([of(order)?, of(order - 2)?, of(order - 4)?])
    }

    /// Levels of elements of `order` (7 and above) and of the orders 2 and 4 below it.
    ///
    /// # Errors
    /// As [`super::bounded::answer_with_error_bounds()`].
    pub fn build_with_order_and_two_lower(scene: &Scene, order: usize, max_hz: f64) -> Result<Self, ModelError> {
        Self::build_on_meshes(scene, Self::choose_meshes_of_three_orders_two_apart(scene, order, 1.0, max_hz)?, max_hz)
    }

    /// The finest level alone, with what makes a bound of its differences to others.
    ///
    /// # Errors
    /// As [`super::bounded::answer_with_error_bounds()`].
    pub(super) fn build_finest_level_with_error_estimator(
        scene: &Scene,
        fineness: Fineness,
        max_hz: f64,
    ) -> Result<(ErrorEstimator, ReducedModel), ModelError> {
        let model = PanelModel::build_with_fineness(scene, fineness)?;
        let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(max_hz, &[])?;
        Ok((ErrorEstimator::new(scene, &model), reduced))
    }

    /// Solves the three levels, coarsest first.
    fn build_on_meshes(scene: &Scene, [fine, middle, coarse]: [Fineness; 3], max_hz: f64) -> Result<Self, ModelError> {
        let mut steps = Vec::new();
        let mut level = |fineness: Fineness| -> Result<_, ModelError> {
            if StopRequest::current_request_of_thread().is_stop_requested_or_deadline_over() {
                return Err(ModelError::Stopped);
            }
            let started = Instant::now();
            let model = PanelModel::build_with_fineness(scene, fineness)?;
            let reduced = model.reduce_with_residual_shapes_of_actuators_damping_and_points(max_hz, &[])?;
            let elapsed_ms = started.elapsed().as_secs_f64() * 1e3;
            steps.push(RefinementLevel {
                fineness,
                parts: model.count_cells_point_functions_stiff_points_and_known_modes(),
                dofs: model.count_unknowns(),
                elapsed_ms,
                bound: f64::INFINITY,
            });
            Ok((ErrorEstimator::new(scene, &model), reduced))
        };
        let (_, coarse) = level(coarse)?;
        let (_, middle) = level(middle)?;
        let (estimator, fine) = level(fine)?;
        Ok(Self { fine, coarser: [middle, coarse], estimator, steps })
    }
}

//! What the planner knows before a touch comes: how every actuator moves the panel at every frequency of a grid.

mod actuator_setting;
mod band;
mod build;
mod efficiency_bounds;
mod entry;
mod forces;
mod gains;
mod grid;
pub mod press;
mod quadrature;
pub(crate) mod shared_limits;
pub(super) mod stored;
pub mod touched;
mod view;

pub use actuator_setting::ActuatorSetting;
pub use band::BandError;
pub use efficiency_bounds::EfficiencyBounds;
pub use entry::{Entry, HARMONICS, PulseOption, acceleration_at_point_from_coordinates};
pub use forces::WIDEST_PULSE;
pub(super) use forces::{
    SOFTENING_GROWTH, bound_travel_by_harmonics_above_fundamental_m_per_n,
    bound_travel_with_harmonics_and_overshoot_m_per_n, compute_travel_of_each_actuator,
};
pub use gains::{AccelerationCoordinates, SINGLE_PRECISION_ERROR};
pub use grid::SurfaceGrid;
pub use view::{EmptyRegionError, PointView, Region};

use crate::MIN_SPACING_HZ;
use crate::model::ReducedModel;
use crate::model::estimator::ErrorEstimator;
use crate::model::levels::ReducedLevels;
use crate::physics::PerPair;
use crate::physics::limits::Electrodes;
use crate::physics::rise::{PanelPoles, PoleDecayAndTravel, SwitchOnModel};
use crate::physics::softening::{Transducer, static_receptance_magnitude_or_infinity_m_per_n};
use crate::response::ResponseError;
use crate::scene::{MAX_ACTUATORS, Scene};
use era_shared::supply::rail_index_of_channel;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use press::PressEffect;
use shared_limits::SharedLimits;
use std::sync::OnceLock;

/// Why a result has no error bound.
pub(crate) const NO_LEVELS: &str = "no coarser model was computed for a comparison";
/// Why a result has no error bound.
pub(crate) const UNBOUNDED: &str =
    "the response of a coarser model is unbounded, at the resonance of a mode without damping";

/// The frequency grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableOptions {
    /// Lowest frequency in Hz.
    pub from_hz: f64,
    /// Highest frequency in Hz.
    pub to_hz: f64,
    /// Step in Hz.
    pub step_hz: f64,
}

impl Default for TableOptions {
    /// 40 to 400 Hz: what the skin feels well and ERAs reach; 1 Hz is the half-power width of a mode of 1 % loss factor at
    /// 100 Hz, and a small part of the 18 % difference that fingers can tell. Plans are refined between the grid's frequencies.
    fn default() -> Self {
        Self { from_hz: 40.0, to_hz: 400.0, step_hz: 1.0 }
    }
}

impl TableOptions {
    /// For a table that is made anew for every picture: half the frequencies.
    #[must_use]
    pub fn for_preview() -> Self {
        Self { step_hz: 2.0, ..Self::default() }
    }

    /// The frequencies.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "small counts"
    )]
    pub fn frequencies_hz(&self) -> Vec<f64> {
        let steps = ((self.to_hz - self.from_hz) / self.step_hz + 1e-9).floor().max(0.0) as usize;
        (0..=steps).map(|i| self.from_hz + i as f64 * self.step_hz).collect()
    }
}

/// The computed parts of a table, from which the rest follows.
struct ComputedTable {
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    entries: Vec<Vec<Option<Entry>>>,
    electrodes: Vec<Electrodes>,
    pressed: Vec<PressEffect>,
    grid: SurfaceGrid,
    products: DMatrix<f64>,
    free: Option<(PanelPoles, SwitchOnModel)>,
}

/// The table of one scene.
#[derive(Clone, Debug)]
pub struct PlanTable {
    /// The panel's reduced model.
    pub model: ReducedModel,
    /// Coarser ones, which tell how wrong it may be; without them plans have no error bound.
    pub coarser: Option<([ReducedModel; 2], ErrorEstimator)>,
    /// The scene.
    pub scene: Scene,
    /// Frequencies in Hz, ascending.
    pub frequencies_hz: Vec<f64>,
    /// `entries[actuator][frequency]`; `None` where the response is unbounded.
    pub entries: Vec<Vec<Option<Entry>>>,
    /// The electrodes of each actuator.
    pub electrodes: Vec<Electrodes>,
    /// What a press does to each of them.
    pub pressed: Vec<PressEffect>,
    /// The same as what makes forces in moving gaps.
    pub transducers: Vec<Transducer>,
    /// Travel of every actuator (row) per steady force on every one, in m/N.
    pub(crate) static_receptance: [[f64; MAX_ACTUATORS]; MAX_ACTUATORS],
    /// The surface.
    pub grid: SurfaceGrid,
    /// Length of the shortest bending wave in m, at the highest frequency.
    pub(super) wave_m: f64,
    /// Accelerations of all actuators on the coarser models, level by level at every frequency of the grid.
    pub(super) coarser_rows: [Vec<Option<Vec<DVector<Complex64>>>>; 2],
    /// Weighted products of the shapes over the surface, n x n.
    products: DMatrix<f64>,
    /// The entries' accelerations, in the order in which a touch asks for them.
    gains: AccelerationCoordinates,
    /// Limits that actuators share.
    pub(crate) limits: SharedLimits,
    /// For bounds.
    pub(super) rough: EfficiencyBounds,
    /// Made when it is first asked for.
    over_surface: OnceLock<Vec<PerPair>>,
    /// What [`crate::click::sound`] needs of the panel; of whoever computes it first.
    pub(crate) products_of_cells: OnceLock<Vec<PerPair>>,
    /// The panel's free motion; `None` for a model without poles to tell it by, which no scene is known to have.
    free: Option<(PanelPoles, SwitchOnModel)>,
    /// The setting with the largest minimum over the surface and by which part another could have a larger one; of whoever finds
    /// it first.
    pub(crate) evened: OnceLock<Option<(Vec<ActuatorSetting>, f64)>>,
}

impl PlanTable {
    /// Computes the table of the finest level; the coarser ones give its plans an error bound.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub fn from_levels(scene: &Scene, levels: ReducedLevels, options: TableOptions) -> Result<Self, ResponseError> {
        Self::build_from_levels(scene, levels, options, None)
    }

    /// Builds the table of `scene`, which is this table's scene with fingers on it ([`Scene::replace_finger_by_masses_and_supports_at_places`]), from its own
    /// levels. The press effects are those of this table, because a finger that is part of the panel does not hold it
    /// against another press.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub fn build_for_scene_with_fingers_keeping_press_effects(
        &self,
        scene: &Scene,
        levels: ReducedLevels,
        options: TableOptions,
    ) -> Result<Self, ResponseError> {
        Self::build_from_levels(scene, levels, options, Some(&self.pressed))
    }

    /// Builds the table of the finest level and the acceleration rows of the coarser ones.
    fn build_from_levels(
        scene: &Scene,
        levels: ReducedLevels,
        options: TableOptions,
        known_press_effects: Option<&[PressEffect]>,
    ) -> Result<Self, ResponseError> {
        let mut table = build::build_table(scene, levels.fine, options, known_press_effects)?;
        table.coarser_rows = levels.coarser.each_ref().map(|model| {
            build::acceleration_coordinates_per_newton_of_each_actuator_by_frequency(model, &table.frequencies_hz)
        });
        table.coarser = Some((levels.coarser, levels.estimator));
        Ok(table)
    }

    /// For each actuator the voltage in V that its rail may have before a touch: no more than the scene allows and
    /// than every gap on that rail withstands under a press with its mass at rest. Plans have lower limits, because
    /// their masses move.
    #[must_use]
    pub fn max_rail_voltage_with_masses_at_rest_of_each_actuator_v(&self) -> Vec<f64> {
        let holds_v = |electrodes: &Electrodes| {
            electrodes.max_voltage_v.min(electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(0.0)).max(0.0)
        };
        let of_rail = |i: usize| {
            let fed = self
                .electrodes
                .iter()
                .enumerate()
                .filter(|(other, _)| rail_index_of_channel(*other) == rail_index_of_channel(i));
            fed.map(|(_, electrodes)| holds_v(electrodes)).fold(f64::INFINITY, f64::min)
        };
        (0..self.electrodes.len()).map(of_rail).collect()
    }

    /// Completes a table from its computed parts.
    fn from_computed(scene: &Scene, computed: ComputedTable) -> Self {
        let ComputedTable { model, frequencies_hz, entries, electrodes, pressed, grid, products, free } = computed;
        let transducers: Vec<Transducer> = scene.actuators.iter().map(Transducer::from_actuator).collect();
        let static_receptance = static_receptance_magnitude_or_infinity_m_per_n(&model);
        Self {
            gains: AccelerationCoordinates::new(&entries, model.count_coordinates()),
            static_receptance,
            limits: SharedLimits::new(&electrodes, &transducers, static_receptance, &entries),
            rough: EfficiencyBounds::new(scene, &entries),
            wave_m: grid::shortest_bending_wavelength_m(scene, frequencies_hz.last().copied().unwrap_or_default()),
            model,
            coarser: None,
            coarser_rows: [Vec::new(), Vec::new()],
            scene: scene.clone(),
            frequencies_hz,
            entries,
            electrodes,
            pressed,
            transducers,
            grid,
            products,
            over_surface: OnceLock::new(),
            products_of_cells: OnceLock::new(),
            free,
            evened: OnceLock::new(),
        }
    }

    /// Computes the table.
    ///
    /// # Errors
    /// As the response does, other than for a single unbounded frequency, which is left out.
    pub fn build(scene: &Scene, model: ReducedModel, options: TableOptions) -> Result<Self, ResponseError> {
        build::build_table(scene, model, options, None)
    }

    /// Builds a table for the strongest drives at these frequencies, over these points. It has no energies, so it
    /// cannot be used for plans.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub(crate) fn build_for_strongest_drives_only(
        scene: &Scene,
        model: ReducedModel,
        frequencies_hz: Vec<f64>,
        grid: SurfaceGrid,
    ) -> Result<Self, ResponseError> {
        build::build_table_for_strongest_drives_only(
            scene,
            model,
            frequencies_hz,
            grid,
            build::TablePurpose::Strongest(None),
        )
    }

    /// The table reduced to its frequencies between two; `None` if there are none.
    #[must_use]
    pub fn keep_frequencies_between_if_any(self, from_hz: f64, to_hz: f64) -> Option<Self> {
        let kept: Vec<bool> = self.frequencies_hz.iter().map(|hz| (from_hz..=to_hz).contains(hz)).collect();
        fn keep_marked<T>(list: Vec<T>, kept: &[bool]) -> Vec<T> {
            list.into_iter().zip(kept).filter(|(_, kept)| **kept).map(|(item, _)| item).collect()
        }
        let Self { model, coarser, scene, frequencies_hz, entries, electrodes, pressed, grid, coarser_rows, .. } = self;
        let (products, free) = (self.products, self.free);
        let frequencies_hz = keep_marked(frequencies_hz, &kept);
        if frequencies_hz.is_empty() {
            return None;
        }
        let entries = entries.into_iter().map(|list| keep_marked(list, &kept)).collect();
        let computed = ComputedTable { model, frequencies_hz, entries, electrodes, pressed, grid, products, free };
        let mut table = Self::from_computed(&scene, computed);
        table.coarser = coarser;
        table.coarser_rows = coarser_rows.map(|rows| keep_marked(rows, &kept));
        Some(table)
    }

    /// The table reduced to the given band; an end that is `None` stays as it is.
    ///
    /// # Errors
    /// [`BandError`] if what is left has no room for a frequency of each actuator.
    pub fn restrict_to_band(self, from_hz: Option<f64>, to_hz: Option<f64>) -> Result<Self, BandError> {
        if from_hz.is_none() && to_hz.is_none() {
            return Ok(self);
        }
        let ends = |table: &Self| table.frequencies_hz.first().copied().zip(table.frequencies_hz.last().copied());
        let (least_hz, most_hz) = ends(&self).unwrap_or_default();
        let (from_hz, to_hz) = (from_hz.unwrap_or(least_hz), to_hz.unwrap_or(most_hz));
        let actuators = self.electrodes.len();
        // A small count.
        let needed_hz = (1..actuators).fold(0.0, |sum, _| sum + MIN_SPACING_HZ);
        let error = BandError { from_hz, to_hz, least_hz, most_hz, actuators, needed_hz };
        let table = self.keep_frequencies_between_if_any(from_hz, to_hz).ok_or(error)?;
        let (first, last) = ends(&table).unwrap_or_default();
        if last - first < needed_hz { Err(error) } else { Ok(table) }
    }

    /// The entries of all actuators at the k-th frequency of the grid.
    pub(crate) fn entries_of_all_actuators_at_index(&self, frequency_index: usize) -> Vec<Entry> {
        self.entries.iter().filter_map(|list| list.get(frequency_index)?.clone()).collect()
    }

    /// The decaying modes that [`crate::plan_motion::PlanMotion`] refers to.
    #[must_use]
    pub fn decay_rate_and_travel_of_each_pole(&self) -> Vec<PoleDecayAndTravel> {
        self.switch_on_model().map_or_else(Vec::new, SwitchOnModel::list_decay_rate_and_travel_of_each_pole)
    }

    /// The entries of all actuators at any frequency, on the grid or between its frequencies.
    ///
    /// # Errors
    /// [`ResponseError::Unbounded`].
    pub fn compute_entries_of_all_actuators_at_hz(&self, frequency_hz: f64) -> Result<Vec<Entry>, ResponseError> {
        build::look_up_or_compute_entries_of_all_actuators_at_hz(self, frequency_hz, None)
    }

    /// The same entries, with force limits and pulse widths for `compute_limits_only_for` alone: those of the other actuators are
    /// not computed.
    pub(super) fn compute_all_entries_at_hz_with_driven_limits_only(
        &self,
        frequency_hz: f64,
        compute_limits_only_for: usize,
    ) -> Result<Vec<Entry>, ResponseError> {
        build::look_up_or_compute_entries_of_all_actuators_at_hz(self, frequency_hz, Some(compute_limits_only_for))
    }

    /// Mean square over the surface of a motion with these coordinates.
    #[must_use]
    pub fn mean_square_over_surface(&self, coordinates: &DVector<Complex64>) -> f64 {
        build::mean_square_over_surface(&self.products, coordinates)
    }

    /// At every frequency of the grid the means over the surface of conj(a_i) a_j for 1 N at each actuator alone.
    pub(super) fn mean_products_over_surface_at_each_frequency(&self) -> &[PerPair] {
        self.over_surface
            .get_or_init(|| build::mean_products_over_surface_at_each_frequency(&self.products, &self.entries))
    }

    /// The poles of the panel's free motion, from which rise and decay times follow; `None` if they could not be
    /// found.
    #[must_use]
    pub fn panel_poles(&self) -> Option<&PanelPoles> {
        self.free.as_ref().map(|(rise, _)| rise)
    }

    /// The poles as the actuators excite them and as they move the masses, from which the motion during switching on
    /// follows.
    pub(super) fn switch_on_model(&self) -> Option<&SwitchOnModel> {
        self.free.as_ref().map(|(_, onset)| onset)
    }

    /// The acceleration coordinates of all actuators, ready for products with the mode shapes at targets.
    #[must_use]
    pub const fn acceleration_coordinates(&self) -> &AccelerationCoordinates {
        &self.gains
    }

    /// The entry of an actuator at a frequency of the grid.
    #[must_use]
    pub fn entry(&self, actuator: usize, frequency_index: usize) -> Option<&Entry> {
        self.entries.get(actuator)?.get(frequency_index)?.as_ref()
    }

    /// The quiet pulse width of an actuator at a frequency of the grid; `None` between its frequencies.
    fn quiet_pulse_width_if_frequency_in_table(&self, actuator: usize, frequency_hz: f64) -> Option<f64> {
        let at = self.frequencies_hz.partition_point(|hz| *hz < frequency_hz);
        let is_it = self.frequencies_hz.get(at).is_some_and(|hz| hz.total_cmp(&frequency_hz).is_eq());
        self.entry(actuator, at).filter(|_| is_it).map(|entry| entry.widths[0].pulse_width)
    }

    /// Number of bytes in the arrays of the table and of its models.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let n = self.model.count_coordinates();
        let entries = self.entries.iter().flatten().flatten().count();
        let coarser = self
            .coarser
            .iter()
            .flat_map(|(models, _)| models)
            .map(ReducedModel::size_of_matrices_in_bytes)
            .sum::<usize>();
        let rows = self.coarser_rows.iter().flatten().flatten().flatten().map(DVector::len).sum::<usize>();
        entries * (size_of::<Entry>() + size_of::<Complex64>() * n)
            + self.gains.memory_bytes()
            + size_of::<f64>() * (self.grid.shapes.len() + self.products.len())
            + self.model.size_of_matrices_in_bytes()
            + coarser
            + size_of::<Complex64>() * rows
    }
}

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

pub use actuator_setting::Part;
pub use band::BandError;
pub use efficiency_bounds::Rough;
pub use entry::{Entry, HARMONICS, Width, at_point};
pub use forces::WIDEST;
pub(super) use forces::{GROWN, harmonic_part, harmonics_m_per_n, travel_by, travel_m_per_n};
pub use gains::{Gains, SINGLE};
pub use grid::SurfaceGrid;
pub use view::{NoPoint, Region, View};

use crate::MIN_SPACING_HZ;
use crate::model::ReducedModel;
use crate::model::estimator::ErrorEstimator;
use crate::model::levels::ReducedLevels;
use crate::physics::PerPair;
use crate::physics::limits::Electrodes;
use crate::physics::rise::{DecayingMode, Onset, RiseTimes};
use crate::physics::softening::{Transducer, static_receptance};
use crate::response::ResponseError;
use crate::scene::{MAX_ACTUATORS, Scene};
use era_shared::supply::rail_index_of_channel;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use press::Pressed;
use shared_limits::SharedLimits;
use std::sync::OnceLock;

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
    pub fn preview() -> Self {
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

/// What a table is made of when its scene, model and frequencies are known; everything else follows.
struct Computed {
    model: ReducedModel,
    frequencies_hz: Vec<f64>,
    entries: Vec<Vec<Option<Entry>>>,
    electrodes: Vec<Electrodes>,
    pressed: Vec<Pressed>,
    grid: SurfaceGrid,
    products: DMatrix<f64>,
    free: Option<(RiseTimes, Onset)>,
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
    pub pressed: Vec<Pressed>,
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
    gains: Gains,
    /// Limits that actuators share.
    pub(crate) limits: SharedLimits,
    /// For bounds.
    pub(super) rough: Rough,
    /// Made when it is first asked for.
    over_surface: OnceLock<Vec<PerPair>>,
    /// The panel's free motion; `None` for a model without poles to tell it by, which no scene is known to have.
    free: Option<(RiseTimes, Onset)>,
    /// The setting with the largest minimum over the surface and by which part another could have a larger one; of whoever finds
    /// it first.
    pub(crate) evened: OnceLock<Option<(Vec<Part>, f64)>>,
}

impl PlanTable {
    /// Computes the table of the finest level; the coarser ones give its plans an error bound.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub fn with_levels(scene: &Scene, levels: ReducedLevels, options: TableOptions) -> Result<Self, ResponseError> {
        Self::of_levels(scene, levels, options, None)
    }

    /// The table of `scene`, which is this table's with fingers on it ([`Scene::with_finger_at_places`]), from its own levels. What a press does to the
    /// gaps is as on this one: a finger that is part of the panel does not hold it against another one.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub fn touched(&self, scene: &Scene, levels: ReducedLevels, options: TableOptions) -> Result<Self, ResponseError> {
        Self::of_levels(scene, levels, options, Some(&self.pressed))
    }

    fn of_levels(
        scene: &Scene,
        levels: ReducedLevels,
        options: TableOptions,
        pressed: Option<&[Pressed]>,
    ) -> Result<Self, ResponseError> {
        let mut table = build::table(scene, levels.fine, options, pressed)?;
        table.coarser_rows = levels.coarser.each_ref().map(|model| build::rows(model, &table.frequencies_hz));
        table.coarser = Some((levels.coarser, levels.estimator));
        Ok(table)
    }

    /// For each actuator the voltage in V at which its rail may stand ready before a touch: what the scene allows and every gap on that
    /// rail holds under a press, its mass at rest. Plans have no more, as their masses move besides.
    #[must_use]
    pub fn ready_v(&self) -> Vec<f64> {
        let holds_v = |electrodes: &Electrodes| electrodes.max_voltage_v.min(electrodes.holds_v(0.0)).max(0.0);
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

    /// The table of what was computed, or kept from when it was.
    fn of(scene: &Scene, computed: Computed) -> Self {
        let Computed { model, frequencies_hz, entries, electrodes, pressed, grid, products, free } = computed;
        let transducers: Vec<Transducer> = scene.actuators.iter().map(Transducer::of).collect();
        let static_receptance = static_receptance(&model);
        Self {
            gains: Gains::new(&entries, model.count_coordinates()),
            static_receptance,
            limits: SharedLimits::new(&electrodes, &transducers, static_receptance, &entries),
            rough: Rough::new(scene, &entries),
            wave_m: grid::bending_wave_m(scene, frequencies_hz.last().copied().unwrap_or_default()),
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
            free,
            evened: OnceLock::new(),
        }
    }

    /// Computes the table.
    ///
    /// # Errors
    /// As the response does, other than for a single unbounded frequency, which is left out.
    pub fn build(scene: &Scene, model: ReducedModel, options: TableOptions) -> Result<Self, ResponseError> {
        build::table(scene, model, options, None)
    }

    /// A table for the strongest drives at these frequencies, over these points: it tells no plan, whose energies it has not.
    ///
    /// # Errors
    /// As [`PlanTable::build`].
    pub(crate) fn for_strongest(
        scene: &Scene,
        model: ReducedModel,
        frequencies_hz: Vec<f64>,
        grid: SurfaceGrid,
    ) -> Result<Self, ResponseError> {
        build::strongest(scene, model, frequencies_hz, grid, build::Purpose::Strongest(None))
    }

    /// The table of those of its frequencies that lie between two; `None` if none does.
    #[must_use]
    pub fn between(self, from_hz: f64, to_hz: f64) -> Option<Self> {
        let kept: Vec<bool> = self.frequencies_hz.iter().map(|hz| (from_hz..=to_hz).contains(hz)).collect();
        fn keep<T>(list: Vec<T>, kept: &[bool]) -> Vec<T> {
            list.into_iter().zip(kept).filter(|(_, kept)| **kept).map(|(item, _)| item).collect()
        }
        let Self { model, coarser, scene, frequencies_hz, entries, electrodes, pressed, grid, coarser_rows, .. } = self;
        let (products, free) = (self.products, self.free);
        let frequencies_hz = keep(frequencies_hz, &kept);
        if frequencies_hz.is_empty() {
            return None;
        }
        let entries = entries.into_iter().map(|list| keep(list, &kept)).collect();
        let computed = Computed { model, frequencies_hz, entries, electrodes, pressed, grid, products, free };
        let mut table = Self::of(&scene, computed);
        table.coarser = coarser;
        table.coarser_rows = coarser_rows.map(|rows| keep(rows, &kept));
        Some(table)
    }

    /// The table without the frequencies below and above what is asked for, all of it where nothing is.
    ///
    /// # Errors
    /// [`BandError`] if what is left has no room for a frequency of each actuator.
    pub fn in_band(self, from_hz: Option<f64>, to_hz: Option<f64>) -> Result<Self, BandError> {
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
        let table = self.between(from_hz, to_hz).ok_or(error)?;
        let (first, last) = ends(&table).unwrap_or_default();
        if last - first < needed_hz { Err(error) } else { Ok(table) }
    }

    /// All entries at a frequency of the grid.
    pub(crate) fn entries_at(&self, k: usize) -> Vec<Entry> {
        self.entries.iter().filter_map(|list| list.get(k)?.clone()).collect()
    }

    /// The poles that [`crate::plan_motion::PlanMotion`]s tell of.
    #[must_use]
    pub fn decaying_modes(&self) -> Vec<DecayingMode> {
        self.onset().map_or_else(Vec::new, Onset::decaying_modes)
    }

    /// The entries of all actuators at one frequency, on the grid or off it.
    ///
    /// # Errors
    /// [`ResponseError::Unbounded`].
    pub fn row_at(&self, frequency_hz: f64) -> Result<Vec<Entry>, ResponseError> {
        build::row_at(self, frequency_hz, None)
    }

    /// The same for a drive of one actuator: forces and pulse widths of the others are of no account.
    pub(super) fn row_for(&self, frequency_hz: f64, driven: usize) -> Result<Vec<Entry>, ResponseError> {
        build::row_at(self, frequency_hz, Some(driven))
    }

    /// Mean square over the surface of a motion with these coordinates.
    #[must_use]
    pub fn mean_square(&self, coordinates: &DVector<Complex64>) -> f64 {
        build::mean_square(&self.products, coordinates)
    }

    /// At every frequency of the grid the means over the surface of conj(a_i) a_j for 1 N at each actuator alone.
    pub(super) fn over_surface(&self) -> &[PerPair] {
        self.over_surface.get_or_init(|| build::over_surface(&self.products, &self.entries))
    }

    /// What rise and decay are told from; `None` for a model whose free motion has no poles to tell it by.
    #[must_use]
    pub fn rise(&self) -> Option<&RiseTimes> {
        self.free.as_ref().map(|(rise, _)| rise)
    }

    /// What switching on is told from.
    pub(super) fn onset(&self) -> Option<&Onset> {
        self.free.as_ref().map(|(_, onset)| onset)
    }

    /// What actuators move at the targets, ready for products with mode shapes.
    #[must_use]
    pub const fn gains(&self) -> &Gains {
        &self.gains
    }

    /// The entry of an actuator at a frequency of the grid.
    #[must_use]
    pub fn entry(&self, actuator: usize, frequency: usize) -> Option<&Entry> {
        self.entries.get(actuator)?.get(frequency)?.as_ref()
    }

    /// The quiet pulse width of an actuator at a frequency of the grid.
    fn quiet_width(&self, actuator: usize, frequency_hz: f64) -> Option<f64> {
        let at = self.frequencies_hz.partition_point(|hz| *hz < frequency_hz);
        let is_it = self.frequencies_hz.get(at).is_some_and(|hz| hz.total_cmp(&frequency_hz).is_eq());
        self.entry(actuator, at).filter(|_| is_it).map(|entry| entry.widths[0].pulse_width)
    }

    /// Bytes that the table's arrays and those of its models take.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let n = self.model.count_coordinates();
        let entries = self.entries.iter().flatten().flatten().count();
        let coarser =
            self.coarser.iter().flat_map(|(models, _)| models).map(ReducedModel::size_in_bytes).sum::<usize>();
        let rows = self.coarser_rows.iter().flatten().flatten().flatten().map(DVector::len).sum::<usize>();
        entries * (size_of::<Entry>() + size_of::<Complex64>() * n)
            + self.gains.bytes()
            + size_of::<f64>() * (self.grid.shapes.len() + self.products.len())
            + self.model.size_in_bytes()
            + coarser
            + size_of::<Complex64>() * rows
    }
}

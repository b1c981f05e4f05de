//! Values that may be off: which, by how much, and the samples that all designs are looked at with.

use super::design;
use super::document::{number_at_place_if_any, put_value_if_its_table_exists, surface_sides_if_numbers_mm};
use crate::spec::{PathStep, UncertainValue, UncertaintySampling};
use era_model::scene::random::RandomSequence;
use toml_edit::{DocumentMut, Value};

/// A stream of random numbers of its own.
const STREAM: u64 = 0x0ff5;

/// The samples of what may be off: the same for all designs, so that their differences are those of the designs.
#[derive(Clone, Debug, PartialEq)]
pub struct UncertaintySamples(
    /// One number from -1 to 1 for each value that may be off.
    pub Vec<Vec<f64>>,
);

impl UncertaintySamples {
    /// How many there are for so many values that may be off, before any is listed.
    #[must_use]
    pub fn count_samples(uncertain_values: usize, sampling: UncertaintySampling) -> usize {
        match sampling {
            _ if uncertain_values == 0 => 0,
            UncertaintySampling::Corners => u32::try_from(uncertain_values)
                .ok()
                .and_then(|uncertain_values| 1_usize.checked_shl(uncertain_values))
                .unwrap_or(usize::MAX),
            UncertaintySampling::LatinHypercube { samples } => samples,
        }
    }

    /// For so many values that may be off.
    #[must_use]
    pub fn new(values: usize, robust: UncertaintySampling, seed: u64) -> Self {
        if values == 0 {
            return Self(Vec::new());
        }
        Self(match robust {
            UncertaintySampling::Corners => (0..1_usize << values)
                .map(|corner| (0..values).map(|k| if corner >> k & 1 == 1 { 1.0 } else { -1.0 }).collect())
                .collect(),
            UncertaintySampling::LatinHypercube { samples } => {
                let mut random = RandomSequence::new(seed, STREAM);
                let points = super::draw_latin_hypercube(values, samples, &mut random);
                points.into_iter().map(|point| point.into_iter().map(|part| 2.0 * part - 1.0).collect()).collect()
            }
        })
    }
}

/// Number of values of one uncertainty that are off by themselves.
pub(super) fn count_independent_values(value: &UncertainValue, places: &[Vec<PathStep>]) -> usize {
    if value.together { 1 } else { places.len() }
}

/// Moves values by parts of what they may be off. Coordinates among them stay on the surface, whose sides may be off themselves.
pub(super) fn deviate_uncertain_values_keeping_coordinates_on_surface(
    document: &mut DocumentMut,
    uncertain_values: &[UncertainValue],
    places: &[Vec<Vec<PathStep>>],
    tolerance_fractions: &[f64],
) {
    let mut first = 0;
    for (own, places) in uncertain_values.iter().zip(places) {
        for (k, place) in places.iter().enumerate() {
            let part = tolerance_fractions.get(first + if own.together { 0 } else { k }).copied().unwrap_or(0.0);
            // None where this design does without.
            let Some(value) = number_at_place_if_any(document, place) else { continue };
            let moved = design::round_to_six_significant_digits(value * (1.0 + own.part * part) + own.by * part);
            put_value_if_its_table_exists(document, place, &Value::from(moved));
        }
        first += count_independent_values(own, places);
    }
    let [length_mm, width_mm] = surface_sides_if_numbers_mm(document);
    for place in places.iter().flatten() {
        let side_mm = match place.last() {
            Some(PathStep::Key(key)) if key == "x_mm" => length_mm,
            Some(PathStep::Key(key)) if key == "y_mm" => width_mm,
            _ => None,
        };
        let Some((at_mm, side_mm)) = number_at_place_if_any(document, place).zip(side_mm) else { continue };
        // Not `clamp`, which a side below 0 would make panic: the scene refuses it.
        let on_mm = at_mm.min(side_mm).max(0.0);
        if on_mm != at_mm {
            put_value_if_its_table_exists(document, place, &Value::from(on_mm));
        }
    }
}

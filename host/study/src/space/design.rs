//! A choice of all variables, and how points of the unit cube become one.

use crate::spec::{NumberRange, NumberScale, PlaceArea, StudyVariable, VariableKind};
use serde::{Deserialize, Serialize};

/// Digits of numbers that are chosen: what a person would write, and finer than anything is made.
const DIGITS: usize = 6;
/// Places are whole multiples of this, in mm.
const PLACE_MM: f64 = 1e-3;

/// What one variable is set to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum VariableSetting {
    /// What the scene's file says.
    Kept,
    /// A number.
    Number(f64),
    /// One of a list, from zero.
    Choice(usize),
    /// A place in mm.
    Place([f64; 2]),
    /// How many there are.
    Count(usize),
}

/// A choice of all variables, in their order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Design {
    /// One for each variable.
    pub settings: Vec<VariableSetting>,
}

/// A dimension of the unit cube.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeDimension {
    /// Which variable it belongs to.
    pub variable: usize,
    /// What plots call it.
    pub name: String,
    /// How many values it has; `None` if any between two will do.
    pub count: Option<usize>,
    /// Of how many a grid is made, if the file says so.
    pub levels: Option<usize>,
}

/// A column of a table of designs.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignColumn {
    /// Its name.
    pub name: String,
    /// Which variable it belongs to.
    pub variable: usize,
    /// Which of a place's numbers it is.
    pub coordinate: usize,
    /// The words that stand for a choice's numbers, if it is one.
    pub words: Option<Vec<String>>,
    /// Whether it follows from another column.
    pub follows: bool,
}

impl DesignColumn {
    /// Its number in a design; `None` where the scene's own is kept.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    pub fn number_or_choice_index_in_design_unless_scene_value_kept(&self, design: &Design) -> Option<f64> {
        match design.settings.get(self.variable)? {
            VariableSetting::Kept => None,
            VariableSetting::Number(number) => Some(*number),
            VariableSetting::Choice(choice) => Some(*choice as f64),
            VariableSetting::Place(place) => place.get(self.coordinate).copied(),
            VariableSetting::Count(count) => Some(*count as f64),
        }
    }

    /// Its value in a design as text; `None` where the scene's own is kept.
    #[must_use]
    pub fn text_in_design_unless_scene_value_kept(&self, design: &Design) -> Option<String> {
        match (design.settings.get(self.variable)?, &self.words) {
            (VariableSetting::Choice(choice), Some(words)) => words.get(*choice).cloned(),
            _ => self.number_or_choice_index_in_design_unless_scene_value_kept(design).map(|number| number.to_string()),
        }
    }
}

pub(super) fn dimensions_of_variables(variables: &[StudyVariable]) -> Vec<CubeDimension> {
    let mut dimensions = Vec::new();
    for (variable, own) in variables.iter().enumerate() {
        let mut add = |name: String, count: Option<usize>| {
            dimensions.push(CubeDimension { variable, name, count, levels: own.levels });
        };
        match &own.what {
            VariableKind::Number { numbers, .. } => add(own.name.clone(), numbers.count_values_if_stepped()),
            VariableKind::Choice { values, .. } => add(own.name.clone(), Some(values.len())),
            VariableKind::Count { from, to, .. } => add(own.name.clone(), Some(to - from + 1)),
            VariableKind::Place { area: PlaceArea::Rectangle { x, y }, .. } => {
                add(format!("{}.x_mm", own.name), x.count_values_if_stepped());
                add(format!("{}.y_mm", own.name), y.count_values_if_stepped());
            }
            VariableKind::Place { area: PlaceArea::Line { along, .. }, .. } => {
                add(format!("{} along", own.name), along.count_values_if_stepped())
            }
            VariableKind::Mirror { .. } => {}
        }
    }
    dimensions
}

pub(super) fn columns_of_variables(variables: &[StudyVariable]) -> Vec<DesignColumn> {
    let mut columns = Vec::new();
    for (variable, own) in variables.iter().enumerate() {
        let mut add = |name: String, coordinate: usize, words: Option<Vec<String>>, follows: bool| {
            columns.push(DesignColumn { name, variable, coordinate, words, follows });
        };
        match &own.what {
            VariableKind::Number { .. } | VariableKind::Count { .. } => add(own.name.clone(), 0, None, false),
            VariableKind::Choice { names, .. } => add(own.name.clone(), 0, Some(names.clone()), false),
            VariableKind::Place { .. } | VariableKind::Mirror { .. } => {
                let follows = matches!(own.what, VariableKind::Mirror { .. });
                add(format!("{}.x_mm", own.name), 0, None, follows);
                add(format!("{}.y_mm", own.name), 1, None, follows);
            }
        }
    }
    columns
}

/// The design at a point, mirror images left as they are in the scene's file: they take the design's sides, see [`set_mirrored_places`].
pub(super) fn design_at_point_without_mirrored_places(
    variables: &[StudyVariable],
    dimensions: &[CubeDimension],
    point: &[f64],
) -> Design {
    let part = |variable: usize, coordinate: usize| -> f64 {
        let own = dimensions.iter().zip(point).filter(|(dimension, _)| dimension.variable == variable);
        own.map(|(_, part)| part.clamp(0.0, 1.0)).nth(coordinate).unwrap_or(0.0)
    };
    let mut settings: Vec<VariableSetting> = Vec::with_capacity(variables.len());
    for (variable, own) in variables.iter().enumerate() {
        let first = part(variable, 0);
        settings.push(match &own.what {
            VariableKind::Number { numbers, .. } => VariableSetting::Number(number_at_fraction(numbers, first)),
            VariableKind::Choice { values, .. } => VariableSetting::Choice(index_at_fraction(values.len(), first)),
            VariableKind::Count { from, to, .. } => {
                VariableSetting::Count(from + index_at_fraction(to - from + 1, first))
            }
            VariableKind::Place { area: PlaceArea::Rectangle { x, y }, .. } => VariableSetting::Place([
                round_coordinate_to_thousandths_of_mm(number_at_fraction(x, first)),
                round_coordinate_to_thousandths_of_mm(number_at_fraction(y, part(variable, 1))),
            ]),
            VariableKind::Place { area: PlaceArea::Line { from, to, along }, .. } => {
                let part = if along.to > 0.0 { number_at_fraction(along, first) / along.to } else { 0.0 };
                VariableSetting::Place(
                    [0, 1].map(|k| round_coordinate_to_thousandths_of_mm(from[k] + part * (to[k] - from[k]))),
                )
            }
            VariableKind::Mirror { .. } => VariableSetting::Kept,
        });
    }
    Design { settings }
}

/// Sets the mirror images of a design's places, on a surface with these sides in mm.
pub(super) fn set_mirrored_places(variables: &[StudyVariable], design: &mut Design, sides_mm: [Option<f64>; 2]) {
    let settings = &mut design.settings;
    for (number, own) in variables.iter().enumerate() {
        let VariableKind::Mirror { from, x, y, .. } = &own.what else { continue };
        // The space's reader makes sure that what it is an image of comes before it.
        let other = variables[..number].iter().position(|other| other.is_place_or_mirror_variable_of_table(from));
        let Some(VariableSetting::Place(place)) = other.and_then(|other| settings.get(other).copied()) else {
            continue;
        };
        let along = |axis: usize, is_mirrored: bool| {
            if is_mirrored {
                sides_mm[axis].map(|side| round_coordinate_to_thousandths_of_mm(side - place[axis]))
            } else {
                Some(place[axis])
            }
        };
        // A surface without sides is refused whatever is on it.
        if let (Some(x), Some(y)) = (along(0, *x), along(1, *y)) {
            settings[number] = VariableSetting::Place([x, y]);
        }
    }
}

/// The number of a part, 0 to 1, of a range.
#[expect(clippy::cast_precision_loss, reason = "at most a million")]
fn number_at_fraction(numbers: &NumberRange, fraction: f64) -> f64 {
    let NumberRange { from, to, scale, step } = *numbers;
    let number = match (scale, step.zip(numbers.count_values_if_stepped())) {
        (_, Some((step, count))) => from + step * index_at_fraction(count, fraction) as f64,
        (NumberScale::Linear, None) => from + fraction * (to - from),
        (NumberScale::Log, None) => from * (to / from).powf(fraction),
    };
    round_to_six_significant_digits(number).clamp(from, to)
}

/// Which of some a part, 0 to 1, stands for: equal parts for all.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "below the count"
)]
pub fn index_at_fraction(count: usize, fraction: f64) -> usize {
    ((fraction * count as f64) as usize).min(count.saturating_sub(1))
}

/// A number with as many digits as a person would write.
#[must_use]
pub fn round_to_six_significant_digits(number: f64) -> f64 {
    if number == 0.0 || !number.is_finite() {
        return number;
    }
    // By text: a product and its inverse would leave 0.30000000000000004.
    format!("{number:.*e}", DIGITS - 1).parse().unwrap_or(number)
}

fn round_coordinate_to_thousandths_of_mm(coordinate_mm: f64) -> f64 {
    (coordinate_mm / PLACE_MM).round() / PLACE_MM.recip()
}

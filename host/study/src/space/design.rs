//! A choice of all variables, and how points of the unit cube become one.

use crate::spec::{Numbers, Scale, Variable, What, Where};
use serde::{Deserialize, Serialize};

/// Digits of numbers that are chosen: what a person would write, and finer than anything is made.
const DIGITS: usize = 6;
/// Places are whole multiples of this, in mm.
const PLACE_MM: f64 = 1e-3;

/// What one variable is set to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Setting {
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
    pub settings: Vec<Setting>,
}

/// A dimension of the unit cube.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
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
pub struct Column {
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

impl Column {
    /// Its number in a design; `None` where the scene's own is kept.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    pub fn number(&self, design: &Design) -> Option<f64> {
        match design.settings.get(self.variable)? {
            Setting::Kept => None,
            Setting::Number(number) => Some(*number),
            Setting::Choice(choice) => Some(*choice as f64),
            Setting::Place(place) => place.get(self.coordinate).copied(),
            Setting::Count(count) => Some(*count as f64),
        }
    }

    /// The same as text.
    #[must_use]
    pub fn text(&self, design: &Design) -> Option<String> {
        match (design.settings.get(self.variable)?, &self.words) {
            (Setting::Choice(choice), Some(words)) => words.get(*choice).cloned(),
            _ => self.number(design).map(|number| number.to_string()),
        }
    }
}

pub(super) fn dimensions(variables: &[Variable]) -> Vec<Dimension> {
    let mut dimensions = Vec::new();
    for (variable, own) in variables.iter().enumerate() {
        let mut add = |name: String, count: Option<usize>| {
            dimensions.push(Dimension { variable, name, count, levels: own.levels });
        };
        match &own.what {
            What::Number { numbers, .. } => add(own.name.clone(), numbers.count()),
            What::Choice { values, .. } => add(own.name.clone(), Some(values.len())),
            What::Count { from, to, .. } => add(own.name.clone(), Some(to - from + 1)),
            What::Place { area: Where::Rectangle { x, y }, .. } => {
                add(format!("{}.x_mm", own.name), x.count());
                add(format!("{}.y_mm", own.name), y.count());
            }
            What::Place { area: Where::Line { along, .. }, .. } => add(format!("{} along", own.name), along.count()),
            What::Mirror { .. } => {}
        }
    }
    dimensions
}

pub(super) fn columns(variables: &[Variable]) -> Vec<Column> {
    let mut columns = Vec::new();
    for (variable, own) in variables.iter().enumerate() {
        let mut add = |name: String, coordinate: usize, words: Option<Vec<String>>, follows: bool| {
            columns.push(Column { name, variable, coordinate, words, follows });
        };
        match &own.what {
            What::Number { .. } | What::Count { .. } => add(own.name.clone(), 0, None, false),
            What::Choice { names, .. } => add(own.name.clone(), 0, Some(names.clone()), false),
            What::Place { .. } | What::Mirror { .. } => {
                let follows = matches!(own.what, What::Mirror { .. });
                add(format!("{}.x_mm", own.name), 0, None, follows);
                add(format!("{}.y_mm", own.name), 1, None, follows);
            }
        }
    }
    columns
}

/// The design at a point, mirror images left as they are in the scene's file: they take the design's sides, see [`mirror`].
pub(super) fn at(variables: &[Variable], dimensions: &[Dimension], point: &[f64]) -> Design {
    let part = |variable: usize, coordinate: usize| -> f64 {
        let own = dimensions.iter().zip(point).filter(|(dimension, _)| dimension.variable == variable);
        own.map(|(_, part)| part.clamp(0.0, 1.0)).nth(coordinate).unwrap_or(0.0)
    };
    let mut settings: Vec<Setting> = Vec::with_capacity(variables.len());
    for (variable, own) in variables.iter().enumerate() {
        let first = part(variable, 0);
        settings.push(match &own.what {
            What::Number { numbers, .. } => Setting::Number(number(numbers, first)),
            What::Choice { values, .. } => Setting::Choice(one_of(values.len(), first)),
            What::Count { from, to, .. } => Setting::Count(from + one_of(to - from + 1, first)),
            What::Place { area: Where::Rectangle { x, y }, .. } => {
                Setting::Place([millimetres(number(x, first)), millimetres(number(y, part(variable, 1)))])
            }
            What::Place { area: Where::Line { from, to, along }, .. } => {
                let part = if along.to > 0.0 { number(along, first) / along.to } else { 0.0 };
                Setting::Place([0, 1].map(|k| millimetres(from[k] + part * (to[k] - from[k]))))
            }
            What::Mirror { .. } => Setting::Kept,
        });
    }
    Design { settings }
}

/// Sets the mirror images of a design's places, on a surface with these sides in mm.
pub(super) fn mirror(variables: &[Variable], design: &mut Design, sides_mm: [Option<f64>; 2]) {
    let settings = &mut design.settings;
    for (number, own) in variables.iter().enumerate() {
        let What::Mirror { from, x, y, .. } = &own.what else { continue };
        // The space's reader makes sure that what it is an image of comes before it.
        let other = variables[..number].iter().position(|other| other.is_place_of(from));
        let Some(Setting::Place(place)) = other.and_then(|other| settings.get(other).copied()) else { continue };
        let along = |axis: usize, is_mirrored: bool| {
            if is_mirrored { sides_mm[axis].map(|side| millimetres(side - place[axis])) } else { Some(place[axis]) }
        };
        // A surface without sides is refused whatever is on it.
        if let (Some(x), Some(y)) = (along(0, *x), along(1, *y)) {
            settings[number] = Setting::Place([x, y]);
        }
    }
}

/// The number of a part, 0 to 1, of a range.
#[expect(clippy::cast_precision_loss, reason = "at most a million")]
fn number(numbers: &Numbers, part: f64) -> f64 {
    let Numbers { from, to, scale, step } = *numbers;
    let number = match (scale, step.zip(numbers.count())) {
        (_, Some((step, count))) => from + step * one_of(count, part) as f64,
        (Scale::Linear, None) => from + part * (to - from),
        (Scale::Log, None) => from * (to / from).powf(part),
    };
    rounded(number).clamp(from, to)
}

/// Which of some a part, 0 to 1, stands for: equal parts for all.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "below the count"
)]
pub fn one_of(count: usize, part: f64) -> usize {
    ((part * count as f64) as usize).min(count.saturating_sub(1))
}

/// A number with as many digits as a person would write.
#[must_use]
pub fn rounded(number: f64) -> f64 {
    if number == 0.0 || !number.is_finite() {
        return number;
    }
    // By text: a product and its inverse would leave 0.30000000000000004.
    format!("{number:.*e}", DIGITS - 1).parse().unwrap_or(number)
}

fn millimetres(at: f64) -> f64 {
    (at / PLACE_MM).round() / PLACE_MM.recip()
}

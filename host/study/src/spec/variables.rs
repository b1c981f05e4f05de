//! What may change, and what is not known.

use super::path::ScenePath;
use toml_edit::Value;

/// How numbers are spread between two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberScale {
    /// Equal differences.
    Linear,
    /// Equal ratios.
    Log,
}

/// Numbers between two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberRange {
    /// Least.
    pub from: f64,
    /// Most.
    pub to: f64,
    /// How they are spread.
    pub scale: NumberScale,
    /// Only `from` and whole steps beyond it, linear scale only.
    pub step: Option<f64>,
}

impl NumberRange {
    /// How many there are; `None` if any number between the two will do.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most a million, by the file's reader"
    )]
    pub fn count_values_if_stepped(&self) -> Option<usize> {
        self.step.map(|step| ((self.to - self.from) / step + 1e-9).floor() as usize + 1)
    }
}

/// Where a place may be, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaceArea {
    /// In a rectangle.
    Rectangle {
        /// Between two columns.
        x: NumberRange,
        /// Between two rows.
        y: NumberRange,
    },
    /// On a straight line.
    Line {
        /// One end.
        from: [f64; 2],
        /// The other.
        to: [f64; 2],
        /// How far it is from one to the other.
        along: NumberRange,
    },
}

/// What a variable changes, and to what.
#[derive(Clone, Debug)]
pub enum VariableKind {
    /// A number for one key or several.
    Number {
        /// Where it goes.
        paths: Vec<ScenePath>,
        /// What it may be.
        numbers: NumberRange,
    },
    /// One value, or table, of a list.
    Choice {
        /// Where it goes.
        paths: Vec<ScenePath>,
        /// What it may be.
        values: Vec<Value>,
        /// What these are called.
        names: Vec<String>,
        /// What each costs beside the parts; zeros where the file says nothing.
        costs: Vec<f64>,
    },
    /// `x_mm` and `y_mm` together.
    Place {
        /// The table that has them.
        of: ScenePath,
        /// Where it may be.
        area: PlaceArea,
    },
    /// The mirror image of another place.
    Mirror {
        /// The table that is moved.
        of: ScenePath,
        /// The one that it is an image of.
        from: ScenePath,
        /// Whether x is mirrored about the surface's middle.
        x: bool,
        /// Whether y is.
        y: bool,
    },
    /// How many of a list's tables there are: the first ones.
    Count {
        /// The list.
        list: String,
        /// Least.
        from: usize,
        /// Most.
        to: usize,
    },
}

/// One thing that may change.
#[derive(Clone, Debug)]
pub struct StudyVariable {
    /// What tables and plots call it.
    pub name: String,
    /// What it is.
    pub what: VariableKind,
    /// How many values a grid has of it (for a rectangle along either side); the method's if `None`.
    pub levels: Option<usize>,
    /// Its line in the file.
    pub line: usize,
}

impl StudyVariable {
    /// Whether it moves the table that a path leads to.
    #[must_use]
    pub fn is_place_or_mirror_variable_of_table(&self, path: &ScenePath) -> bool {
        matches!(&self.what, VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. } if of == path)
    }
}

/// Places that keep a distance from each other.
#[derive(Clone, Debug)]
pub struct MinimumDistance {
    /// The tables that have them.
    pub places: Vec<ScenePath>,
    /// Least distance in mm.
    pub distance_mm: f64,
    /// Its line in the file.
    pub line: usize,
}

/// What is not known of a design: a value that may be off.
#[derive(Clone, Debug)]
pub struct UncertainValue {
    /// What tables call it.
    pub name: String,
    /// Which keys.
    pub paths: Vec<ScenePath>,
    /// By which part of itself it may be more or less.
    pub part: f64,
    /// By how much, in the key's unit, it may be more or less.
    pub by: f64,
    /// Whether all keys are off by the same.
    pub together: bool,
    /// Its line in the file.
    pub line: usize,
}

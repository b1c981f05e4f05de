//! What a study's file says: a scene, what may change in it, what is wanted, and how to look for it.
//!
//! The format is TOML, `version = 1`; `docs/src/studies.md` is its reference. Every mistake in a file is told with its key, value,
//! allowed range and line, all of them at once, as a scene's are.

mod method;
mod parse;
mod parse_method;
mod path;
#[cfg(test)]
mod tests;
mod variables;
mod wishes;

pub use method::{PointMethod, StudyMethod, UncertaintySampling};
pub(crate) use parse::can_try_all_corners;
pub(crate) use parse_method::MOST_DESIGNS;
pub use path::{PathError, PathStep, ScenePath, TABLE_NAMES};
pub use variables::{
    MinimumDistance, NumberRange, NumberScale, PlaceArea, StudyVariable, UncertainValue, VariableKind,
};
pub use wishes::{Figure, FigureLimit, FrequencyGrouping, PartCosts, SettingScope, WantedFigure, Wish, WishGoal};

use era_model::scene::SceneError;

/// A study's file as it was read.
#[derive(Clone, Debug)]
pub struct StudySpec {
    /// Its name.
    pub name: String,
    /// The scene's file, as the study's names it: from the study's own folder.
    pub scene: String,
    /// What may change, in the file's order.
    pub variables: Vec<StudyVariable>,
    /// What keeps its distance.
    pub apart: Vec<MinimumDistance>,
    /// What is wanted, at least one.
    pub wishes: Vec<Wish>,
    /// What has to hold.
    pub limits: Vec<FigureLimit>,
    /// What is not known.
    pub uncertain: Vec<UncertainValue>,
    /// What parts cost.
    pub costs: PartCosts,
    /// How designs are chosen, and how they are looked at.
    pub method: StudyMethod,
}

impl StudySpec {
    /// Reads a study from text; `source` is what messages call it.
    ///
    /// # Errors
    /// [`SceneError`] with every mistake found.
    pub fn parse(source: &str, text: &str) -> Result<Self, SceneError> {
        parse::parse_study_spec(source, text)
    }

    /// The figures that are computed of every design: of wishes and limits, each once, in the file's order.
    #[must_use]
    pub fn distinct_figures_of_wishes_and_limits(&self) -> Vec<WantedFigure> {
        let mut figures: Vec<WantedFigure> = Vec::new();
        let all = self.wishes.iter().map(|wish| &wish.wanted).chain(self.limits.iter().map(|limit| &limit.wanted));
        for wanted in all {
            if !figures.contains(wanted) {
                figures.push(wanted.clone());
            }
        }
        figures
    }
}

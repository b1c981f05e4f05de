//! From a point of the unit cube to a scene: [`Space`] knows the variables, [`Design`] is a choice of all of them, `document` writes it
//! into the scene's own text, so that every key that a scene has can vary, is held to its range as any scene is, and stays beside its
//! comments.

mod check;
mod design;
mod document;
mod kept;
mod uncertain;

#[cfg(test)]
mod tests;

pub use design::{Column, Design, Dimension, Setting, one_of};
pub use document::Refused;
pub use uncertain::Scenarios;

use crate::spec::{Apart, Path, PathError, Spec, Step, Uncertain, Variable, What};
use era_model::scene::read::Report;
use era_model::scene::{Actuator, Mount, Scene, SceneError};
use std::fmt::Write;
use toml_edit::DocumentMut;

/// What may change of a scene.
#[derive(Clone, Debug)]
pub struct Space {
    /// The scene as it is in its file.
    base: DocumentMut,
    /// How long that is.
    bytes: usize,
    /// What messages call that file.
    source: String,
    variables: Vec<Variable>,
    dimensions: Vec<Dimension>,
    apart: Vec<Apart>,
    uncertain: Vec<Uncertain>,
}

impl Space {
    /// The space of a study over a scene's text. `source` and `text` are the study's, for messages with lines; `scene_source` is what
    /// messages call the scene.
    ///
    /// # Errors
    /// [`SceneError`]: the scene's mistakes, or the study's where variables do not fit the scene.
    pub fn new(
        spec: &Spec,
        source: &str,
        text: &str,
        scene_source: &str,
        scene_text: &str,
    ) -> Result<Self, SceneError> {
        let space = Self::read_scene(spec, scene_source, scene_text)?;
        space.check_study(spec, source, text)?;
        Ok(space)
    }

    /// The same of a study that is not checked against its scene yet.
    ///
    /// # Errors
    /// [`SceneError`]: the scene's mistakes.
    pub(crate) fn read_scene(spec: &Spec, scene_source: &str, scene_text: &str) -> Result<Self, SceneError> {
        Scene::parse(scene_source, scene_text)?;
        let base: DocumentMut = scene_text.parse().map_err(|error: toml_edit::TomlError| {
            SceneError::of(scene_source, 0, format!("not valid TOML: {}", error.message()))
        })?;
        Ok(Self {
            base,
            bytes: scene_text.len(),
            source: scene_source.into(),
            variables: spec.variables.clone(),
            dimensions: design::dimensions(&spec.variables),
            apart: spec.apart.clone(),
            uncertain: spec.uncertain.clone(),
        })
    }

    /// Checks the study, whose source and text these are, against its scene.
    ///
    /// # Errors
    /// [`SceneError`]: where variables do not fit the scene.
    pub(crate) fn check_study(&self, spec: &Spec, source: &str, text: &str) -> Result<(), SceneError> {
        let report = Report::new(text);
        self.check(&report, text, &spec.figures());
        report.finish(source)
    }

    /// How many places of the scene a path leads to; none where it leads nowhere.
    pub(crate) fn places_of(&self, path: &Path) -> usize {
        path.places(&self.base).map_or(0, |places| places.len())
    }

    /// The dimensions of the unit cube.
    #[must_use]
    pub fn dimensions(&self) -> &[Dimension] {
        &self.dimensions
    }

    /// The variables.
    #[must_use]
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// The columns of a table of designs.
    #[must_use]
    pub fn columns(&self) -> Vec<Column> {
        design::columns(&self.variables)
    }

    /// The design at a point of the unit cube, one number for each dimension.
    #[must_use]
    pub fn design(&self, point: &[f64]) -> Design {
        let mut design = design::at(&self.variables, &self.dimensions, point);
        if self.variables.iter().any(|own| matches!(own.what, What::Mirror { .. })) {
            // About the middle of the surface that this design has.
            let sides_mm = self.document(&design).map_or([None; 2], |document| document::sides_mm(&document));
            design::mirror(&self.variables, &mut design, sides_mm);
        }
        design
    }

    /// A design as a scene's text.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn text(&self, design: &Design) -> Result<String, Refused> {
        Ok(self.document(design)?.to_string())
    }

    /// A design as a scene, with its uncertain values off by parts of what they may be, -1 to 1 each (none of them off if there are
    /// none).
    ///
    /// # Errors
    /// [`Refused`].
    pub fn scene(&self, design: &Design, off: &[f64]) -> Result<Scene, Refused> {
        let mut document = self.document(design)?;
        // The scene as it is is what designs are compared with, whether or not it keeps what they have to keep.
        if design.settings.iter().any(|setting| *setting != Setting::Kept) {
            document::check_apart(&document, &self.apart)?;
        }
        if !off.is_empty() {
            uncertain::apply(&mut document, &self.uncertain, &self.uncertain_places(), off);
        }
        document::scene(&self.source, &document)
    }

    /// A scene of its text, as [`Space::text`] makes it.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn read(&self, text: &str) -> Result<Scene, Refused> {
        document::read(&self.source, text)
    }

    /// The scene as it is in its file, whether or not it keeps what designs have to keep (`[[apart]]`).
    ///
    /// # Errors
    /// [`Refused`]; it has been read before.
    pub fn base(&self, off: &[f64]) -> Result<Scene, Refused> {
        let nothing = Design { settings: vec![Setting::Kept; self.variables.len()] };
        self.scene(&nothing, off)
    }

    /// The scene as it is, where nothing but its spring holds some mass against a press: that may be worth a word. `None` with stops for all.
    #[must_use]
    pub fn without_stops(&self) -> Option<Scene> {
        let is_free = |own: &Actuator| own.mount == Mount::Grounded && own.stop_m.is_none();
        self.base(&[]).ok().filter(|scene| scene.actuators.iter().any(is_free))
    }

    /// The design that the scene's file itself is. [`Setting::Kept`] is left where the file has no value of the variable's kind: no such key,
    /// different values for one variable, or none of a choice's.
    #[must_use]
    pub fn as_it_is(&self) -> Design {
        let kept = |number| kept::setting(self, number).unwrap_or(Setting::Kept);
        Design { settings: (0..self.variables.len()).map(kept).collect() }
    }

    /// A design with the choices that it keeps as they are in the scene's file, where that has one of the values.
    #[must_use]
    pub fn with_own_choices(&self, design: &Design) -> Design {
        let mut design = design.clone();
        for (number, (setting, own)) in design.settings.iter_mut().zip(&self.variables).enumerate() {
            if *setting == Setting::Kept && matches!(own.what, What::Choice { .. }) {
                *setting = kept::setting(self, number).unwrap_or(Setting::Kept);
            }
        }
        design
    }

    /// Length and width in mm of the surface of all designs; `None` of a side that a variable changes.
    #[must_use]
    pub fn known_sides_mm(&self) -> [Option<f64>; 2] {
        let [length, width] = document::sides_mm(&self.base);
        let is_known = |key: &str| !self.changes(&["surface", key]);
        [length.filter(|_| is_known("length_mm")), width.filter(|_| is_known("width_mm"))]
    }

    /// Whether a variable changes a key, or a table or list that it is in, by another value. Counts and places do not.
    #[must_use]
    pub fn changes(&self, key: &[&str]) -> bool {
        let has_it = |place: &Vec<Step>| {
            let mut steps = place.iter().zip(key);
            place.len() <= key.len() && steps.all(|(step, name)| matches!(step, Step::Key(own) if own == name))
        };
        self.variables.iter().any(|own| match &own.what {
            What::Number { paths, .. } | What::Choice { paths, .. } => {
                all_places(paths, &self.base).is_ok_and(|places| places.iter().any(has_it))
            }
            _ => false,
        })
    }

    /// How many values may be off by themselves.
    #[must_use]
    pub fn uncertain_values(&self) -> usize {
        self.uncertain_places().iter().zip(&self.uncertain).map(|(places, own)| uncertain::values(own, places)).sum()
    }

    fn uncertain_places(&self) -> Vec<Vec<Vec<Step>>> {
        self.uncertain.iter().map(|own| all_places(&own.paths, &self.base).unwrap_or_default()).collect()
    }

    fn document(&self, design: &Design) -> Result<DocumentMut, Refused> {
        let mut document = self.base.clone();
        for (variable, setting) in self.variables.iter().zip(&design.settings) {
            document::set(&mut document, &self.base, variable, *setting)?;
        }
        Ok(document)
    }
}

/// All places of some paths.
fn all_places(paths: &[Path], document: &DocumentMut) -> Result<Vec<Vec<Step>>, PathError> {
    let each = paths.iter().map(|path| path.places(document));
    Ok(each.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}

/// A variable in words.
#[must_use]
pub fn described(variable: &Variable) -> String {
    let mut text = variable.name.clone();
    match &variable.what {
        What::Number { numbers, .. } => {
            let _ = write!(text, ", {} to {}", numbers.from, numbers.to);
        }
        What::Choice { names, .. } => {
            let _ = write!(text, ", one of {}", names.join(", "));
        }
        What::Place { .. } => text.push_str(", a place"),
        What::Mirror { from, .. } => {
            let _ = write!(text, ", the mirror image of {from}");
        }
        What::Count { from, to, .. } => {
            let _ = write!(text, ", {from} to {to}");
        }
    }
    text
}

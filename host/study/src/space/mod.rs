//! From a point of the unit cube to a scene: [`DesignSpace`] knows the variables, [`Design`] is a choice of all of them, `document` writes it
//! into the scene's own text, so that every key that a scene has can vary, is held to its range as any scene is, and stays beside its
//! comments.

mod check;
mod design;
mod document;
mod kept;
mod latin_hypercube;
mod uncertain;

#[cfg(test)]
mod tests;

pub use design::{CubeDimension, Design, DesignColumn, VariableSetting, index_at_fraction};
pub use document::RefusedDesign;
pub use latin_hypercube::draw_latin_hypercube;
pub use uncertain::UncertaintySamples;

use crate::spec::{
    MinimumDistance, PathError, PathStep, ScenePath, StudySpec, StudyVariable, UncertainValue, VariableKind,
};
use era_model::scene::read::MistakeReport;
use era_model::scene::{Actuator, Mount, Scene, SceneError};
use std::fmt::Write;
use toml_edit::DocumentMut;

/// What may change of a scene.
#[derive(Clone, Debug)]
pub struct DesignSpace {
    /// The scene as it is in its file.
    base: DocumentMut,
    /// How long that is.
    bytes: usize,
    /// What messages call that file.
    source: String,
    variables: Vec<StudyVariable>,
    dimensions: Vec<CubeDimension>,
    apart: Vec<MinimumDistance>,
    uncertain: Vec<UncertainValue>,
}

impl DesignSpace {
    /// The space of a study over a scene's text. `source` and `text` are the study's, for messages with lines; `scene_source` is what
    /// messages call the scene.
    ///
    /// # Errors
    /// [`SceneError`]: the scene's mistakes, or the study's where variables do not fit the scene.
    pub fn new(
        spec: &StudySpec,
        source: &str,
        text: &str,
        scene_source: &str,
        scene_text: &str,
    ) -> Result<Self, SceneError> {
        let space = Self::from_scene_text_without_checking_study(spec, scene_source, scene_text)?;
        space.check_study_against_scene(spec, source, text)?;
        Ok(space)
    }

    /// The same of a study that is not checked against its scene yet.
    ///
    /// # Errors
    /// [`SceneError`]: the scene's mistakes.
    pub(crate) fn from_scene_text_without_checking_study(
        spec: &StudySpec,
        scene_source: &str,
        scene_text: &str,
    ) -> Result<Self, SceneError> {
        Scene::parse(scene_source, scene_text)?;
        let base: DocumentMut = scene_text.parse().map_err(|error: toml_edit::TomlError| {
            SceneError::from_single_mistake(scene_source, 0, format!("not valid TOML: {}", error.message()))
        })?;
        Ok(Self {
            base,
            bytes: scene_text.len(),
            source: scene_source.into(),
            variables: spec.variables.clone(),
            dimensions: design::dimensions_of_variables(&spec.variables),
            apart: spec.apart.clone(),
            uncertain: spec.uncertain.clone(),
        })
    }

    /// Checks the study, whose source and text these are, against its scene.
    ///
    /// # Errors
    /// [`SceneError`]: where variables do not fit the scene.
    pub(crate) fn check_study_against_scene(
        &self,
        spec: &StudySpec,
        source: &str,
        text: &str,
    ) -> Result<(), SceneError> {
        let report = MistakeReport::new(text);
        self.report_all_that_does_not_fit_scene(&report, text, &spec.distinct_figures_of_wishes_and_limits());
        report.into_result(source)
    }

    /// How many places of the scene a path leads to; none where it leads nowhere.
    pub(crate) fn count_matches_of_path_in_base_scene_or_zero(&self, path: &ScenePath) -> usize {
        path.find_places_allowing_new_last_key(&self.base).map_or(0, |places| places.len())
    }

    /// The dimensions of the unit cube.
    #[must_use]
    pub fn dimensions(&self) -> &[CubeDimension] {
        &self.dimensions
    }

    /// The variables.
    #[must_use]
    pub fn variables(&self) -> &[StudyVariable] {
        &self.variables
    }

    /// The columns of a table of designs.
    #[must_use]
    pub fn table_columns(&self) -> Vec<DesignColumn> {
        design::columns_of_variables(&self.variables)
    }

    /// The design at a point of the unit cube, one number for each dimension.
    #[must_use]
    pub fn design_at_point(&self, point: &[f64]) -> Design {
        let mut design = design::design_at_point_without_mirrored_places(&self.variables, &self.dimensions, point);
        if self.variables.iter().any(|own| matches!(own.what, VariableKind::Mirror { .. })) {
            // About the middle of the surface that this design has.
            let sides_mm = self
                .design_as_document(&design)
                .map_or([None; 2], |document| document::surface_sides_if_numbers_mm(&document));
            design::set_mirrored_places(&self.variables, &mut design, sides_mm);
        }
        design
    }

    /// A design as a scene's text.
    ///
    /// # Errors
    /// [`RefusedDesign`].
    pub fn design_as_scene_text(&self, design: &Design) -> Result<String, RefusedDesign> {
        Ok(self.design_as_document(design)?.to_string())
    }

    /// A design as a scene, with its uncertain values off by parts of what they may be, -1 to 1 each (none of them off if there are
    /// none).
    ///
    /// # Errors
    /// [`RefusedDesign`].
    pub fn build_scene_of_design_with_deviations_checking_distances(
        &self,
        design: &Design,
        tolerance_fractions: &[f64],
    ) -> Result<Scene, RefusedDesign> {
        let mut document = self.design_as_document(design)?;
        // The scene as it is is what designs are compared with, whether or not it keeps what they have to keep.
        if design.settings.iter().any(|setting| *setting != VariableSetting::Kept) {
            document::check_minimum_distances(&document, &self.apart)?;
        }
        if !tolerance_fractions.is_empty() {
            uncertain::deviate_uncertain_values_keeping_coordinates_on_surface(
                &mut document,
                &self.uncertain,
                &self.places_of_each_uncertain_value(),
                tolerance_fractions,
            );
        }
        document::parse_document_as_scene(&self.source, &document)
    }

    /// A scene of its text, as [`DesignSpace::design_as_scene_text`] makes it.
    ///
    /// # Errors
    /// [`RefusedDesign`].
    pub fn parse_scene_text(&self, text: &str) -> Result<Scene, RefusedDesign> {
        document::parse_text_as_scene(&self.source, text)
    }

    /// The scene as it is in its file, whether or not it keeps what designs have to keep (`[[apart]]`).
    ///
    /// # Errors
    /// [`RefusedDesign`]; it has been read before.
    pub fn scene_of_file_with_deviations(&self, tolerance_fractions: &[f64]) -> Result<Scene, RefusedDesign> {
        let nothing = Design { settings: vec![VariableSetting::Kept; self.variables.len()] };
        self.build_scene_of_design_with_deviations_checking_distances(&nothing, tolerance_fractions)
    }

    /// The scene as it is, where nothing but its spring holds some mass against a press: that may be worth a word. `None` with stops for all.
    #[must_use]
    pub fn base_scene_if_any_ground_mounted_actuator_lacks_end_stop(&self) -> Option<Scene> {
        let is_free = |own: &Actuator| own.mount == Mount::Grounded && own.stop_m.is_none();
        self.scene_of_file_with_deviations(&[]).ok().filter(|scene| scene.actuators.iter().any(is_free))
    }

    /// The design that the scene's file itself is. [`VariableSetting::Kept`] is left where the file has no value of the variable's kind: no such key,
    /// different values for one variable, or none of a choice's.
    #[must_use]
    pub fn design_of_scene_file(&self) -> Design {
        let kept = |number| {
            kept::variable_setting_in_scene_file_if_all_places_agree(self, number).unwrap_or(VariableSetting::Kept)
        };
        Design { settings: (0..self.variables.len()).map(kept).collect() }
    }

    /// A design with the choices that it keeps as they are in the scene's file, where that has one of the values.
    #[must_use]
    pub fn replace_kept_choices_by_scene_file_values(&self, design: &Design) -> Design {
        let mut design = design.clone();
        for (number, (setting, own)) in design.settings.iter_mut().zip(&self.variables).enumerate() {
            if *setting == VariableSetting::Kept && matches!(own.what, VariableKind::Choice { .. }) {
                *setting = kept::variable_setting_in_scene_file_if_all_places_agree(self, number)
                    .unwrap_or(VariableSetting::Kept);
            }
        }
        design
    }

    /// Length and width in mm of the surface of all designs; `None` of a side that a variable changes.
    #[must_use]
    pub fn sides_unchanged_by_variables_mm(&self) -> [Option<f64>; 2] {
        let [length, width] = document::surface_sides_if_numbers_mm(&self.base);
        let is_known = |key: &str| !self.is_key_or_its_table_set_by_number_or_choice_variable(&["surface", key]);
        [length.filter(|_| is_known("length_mm")), width.filter(|_| is_known("width_mm"))]
    }

    /// Whether a variable changes a key, or a table or list that it is in, by another value. Counts and places do not.
    #[must_use]
    pub fn is_key_or_its_table_set_by_number_or_choice_variable(&self, key: &[&str]) -> bool {
        let has_it = |place: &Vec<PathStep>| {
            let mut steps = place.iter().zip(key);
            place.len() <= key.len() && steps.all(|(step, name)| matches!(step, PathStep::Key(own) if own == name))
        };
        self.variables.iter().any(|own| match &own.what {
            VariableKind::Number { paths, .. } | VariableKind::Choice { paths, .. } => {
                collect_all_places_of_paths(paths, &self.base).is_ok_and(|places| places.iter().any(has_it))
            }
            _ => false,
        })
    }

    /// Number of values that may be off by themselves.
    #[must_use]
    pub fn count_independent_uncertain_values(&self) -> usize {
        self.places_of_each_uncertain_value()
            .iter()
            .zip(&self.uncertain)
            .map(|(places, own)| uncertain::count_independent_values(own, places))
            .sum()
    }

    fn places_of_each_uncertain_value(&self) -> Vec<Vec<Vec<PathStep>>> {
        self.uncertain
            .iter()
            .map(|own| collect_all_places_of_paths(&own.paths, &self.base).unwrap_or_default())
            .collect()
    }

    fn design_as_document(&self, design: &Design) -> Result<DocumentMut, RefusedDesign> {
        let mut document = self.base.clone();
        for (variable, setting) in self.variables.iter().zip(&design.settings) {
            document::set_variable(&mut document, &self.base, variable, *setting)?;
        }
        Ok(document)
    }
}

/// All places of some paths.
fn collect_all_places_of_paths(paths: &[ScenePath], document: &DocumentMut) -> Result<Vec<Vec<PathStep>>, PathError> {
    let each = paths.iter().map(|path| path.find_places_allowing_new_last_key(document));
    Ok(each.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}

/// A variable in words.
#[must_use]
pub fn describe_variable_name_and_allowed_values(variable: &StudyVariable) -> String {
    let mut text = variable.name.clone();
    match &variable.what {
        VariableKind::Number { numbers, .. } => {
            let _ = write!(text, ", {} to {}", numbers.from, numbers.to);
        }
        VariableKind::Choice { names, .. } => {
            let _ = write!(text, ", one of {}", names.join(", "));
        }
        VariableKind::Place { .. } => text.push_str(", a place"),
        VariableKind::Mirror { from, .. } => {
            let _ = write!(text, ", the mirror image of {from}");
        }
        VariableKind::Count { from, to, .. } => {
            let _ = write!(text, ", {from} to {to}");
        }
    }
    text
}

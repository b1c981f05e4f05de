//! What a study may take, told before anything is listed or computed: for whoever computes studies of others.

use crate::methods::count_designs_of_method;
use crate::space::DesignSpace;
use crate::spec::{ScenePath, StudyMethod, StudySpec, VariableKind};
use era_model::scene::SceneError;

/// Bytes that a number takes in a scene's text at most, as studies write it.
const NUMBER: usize = 32;

/// The most that is taken of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StudyBounds {
    /// `[[variable]]`, `[[apart]]`, `[[wish]]`, `[[limit]]` and `[[uncertain]]` together.
    pub entries: usize,
    /// Places in the scene that these lead to, together.
    pub places: usize,
    /// Bytes that one design writes into the scene's text.
    pub written: usize,
    /// Looks at designs: one at each, and one more for each sample of what may be off.
    pub looks: usize,
    /// Designs that are looked at again thoroughly.
    pub finalists: usize,
}

/// More of something than the bounds allow.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {value} {unit}, but at most {most} are allowed")]
pub struct ExceededBound {
    /// The study's key, or the study.
    pub field: &'static str,
    /// How many there are; more than can be counted is the largest number.
    pub value: usize,
    /// Of what.
    pub unit: &'static str,
    /// How many there may be.
    pub most: usize,
}

/// Why a study is not begun.
#[derive(Clone, Debug, thiserror::Error)]
pub enum UnusableStudy {
    /// Mistakes in its file, or in the scene's.
    #[error(transparent)]
    Mistakes(#[from] SceneError),
    /// It takes more than the bounds allow.
    #[error(transparent)]
    Excess(#[from] ExceededBound),
}

fn check_count_at_most(
    field: &'static str,
    value: usize,
    unit: &'static str,
    most: usize,
) -> Result<(), ExceededBound> {
    if value > most { Err(ExceededBound { field, value, unit, most }) } else { Ok(()) }
}

impl StudyBounds {
    /// What the study's file alone tells.
    ///
    /// # Errors
    /// [`ExceededBound`].
    pub(crate) fn check_summed_spec_entry_count_and_finalist_count(
        &self,
        spec: &StudySpec,
    ) -> Result<(), ExceededBound> {
        let entries =
            [spec.variables.len(), spec.apart.len(), spec.wishes.len(), spec.limits.len(), spec.uncertain.len()];
        check_count_at_most("study", entries.iter().sum(), "variables, wishes and other entries", self.entries)?;
        check_count_at_most("method.finalists", spec.method.finalists, "finalists", self.finalists)
    }

    /// What it takes of its scene.
    ///
    /// # Errors
    /// [`ExceededBound`].
    pub(crate) fn check_scene_key_reference_count_and_bytes_written_per_design(
        &self,
        spec: &StudySpec,
        space: &DesignSpace,
    ) -> Result<(), ExceededBound> {
        let count = |paths: &[ScenePath]| -> usize {
            paths.iter().map(|path| space.count_matches_of_path_in_base_scene_or_zero(path)).sum()
        };
        let (mut places, mut written) = (0_usize, 0_usize);
        for variable in &spec.variables {
            let (own, longest) = match &variable.what {
                VariableKind::Number { paths, .. } => (count(paths), NUMBER),
                VariableKind::Choice { paths, values, .. } => {
                    (count(paths), values.iter().map(|value| value.to_string().len()).max().unwrap_or(0))
                }
                VariableKind::Place { of, .. } | VariableKind::Mirror { of, .. } => {
                    (2 * space.count_matches_of_path_in_base_scene_or_zero(of), NUMBER)
                }
                VariableKind::Count { .. } => (0, 0),
            };
            places = places.saturating_add(own);
            written = written.saturating_add(own.saturating_mul(longest));
        }
        places += spec.apart.iter().map(|apart| count(&apart.places)).sum::<usize>();
        places += spec.uncertain.iter().map(|own| count(&own.paths)).sum::<usize>();
        check_count_at_most("study", places, "references to keys of the scene", self.places)?;
        check_count_at_most("study", written, "bytes to write into the scene for each design", self.written)
    }

    /// How often designs are looked at; `samples` are those of what may be off.
    ///
    /// # Errors
    /// [`ExceededBound`].
    pub(crate) fn check_evaluation_count_of_study(
        &self,
        method: &StudyMethod,
        space: &DesignSpace,
        samples: usize,
    ) -> Result<(), ExceededBound> {
        let looks = count_designs_of_method(method, space.dimensions()).saturating_mul(samples.saturating_add(1));
        check_count_at_most("method.designs", looks, "evaluations (designs x (samples + 1))", self.looks)
    }
}

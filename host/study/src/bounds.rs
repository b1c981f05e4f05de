//! What a study may take, told before anything is listed or computed: for whoever computes studies of others.

use crate::space::Space;
use crate::spec::{Method, Path, Spec, What};
use crate::ways::designs_of;
use era_model::scene::SceneError;

/// Bytes that a number takes in a scene's text at most, as studies write it.
const NUMBER: usize = 32;

/// The most that is taken of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
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
#[error("{field} has {value} {unit}, but at most {most} are taken")]
pub struct Excess {
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
pub enum Unusable {
    /// Mistakes in its file, or in the scene's.
    #[error(transparent)]
    Mistakes(#[from] SceneError),
    /// It takes more than the bounds allow.
    #[error(transparent)]
    Excess(#[from] Excess),
}

fn check_count(field: &'static str, value: usize, unit: &'static str, most: usize) -> Result<(), Excess> {
    if value > most { Err(Excess { field, value, unit, most }) } else { Ok(()) }
}

impl Bounds {
    /// What the study's file alone tells.
    ///
    /// # Errors
    /// [`Excess`].
    pub(crate) fn check_spec(&self, spec: &Spec) -> Result<(), Excess> {
        let entries =
            [spec.variables.len(), spec.apart.len(), spec.wishes.len(), spec.limits.len(), spec.uncertain.len()];
        check_count("study", entries.iter().sum(), "variables, wishes and other entries", self.entries)?;
        check_count("method.finalists", spec.method.finalists, "finalists", self.finalists)
    }

    /// What it takes of its scene.
    ///
    /// # Errors
    /// [`Excess`].
    pub(crate) fn check_space(&self, spec: &Spec, space: &Space) -> Result<(), Excess> {
        let count = |paths: &[Path]| -> usize { paths.iter().map(|path| space.places_of(path)).sum() };
        let (mut places, mut written) = (0_usize, 0_usize);
        for variable in &spec.variables {
            let (own, longest) = match &variable.what {
                What::Number { paths, .. } => (count(paths), NUMBER),
                What::Choice { paths, values, .. } => {
                    (count(paths), values.iter().map(|value| value.to_string().len()).max().unwrap_or(0))
                }
                What::Place { of, .. } | What::Mirror { of, .. } => (2 * space.places_of(of), NUMBER),
                What::Count { .. } => (0, 0),
            };
            places = places.saturating_add(own);
            written = written.saturating_add(own.saturating_mul(longest));
        }
        places += spec.apart.iter().map(|apart| count(&apart.places)).sum::<usize>();
        places += spec.uncertain.iter().map(|own| count(&own.paths)).sum::<usize>();
        check_count("study", places, "places that its keys lead to", self.places)?;
        check_count("study", written, "bytes that a design writes into the scene", self.written)
    }

    /// How often designs are looked at; `samples` are those of what may be off.
    ///
    /// # Errors
    /// [`Excess`].
    pub(crate) fn check_looks(&self, method: &Method, space: &Space, samples: usize) -> Result<(), Excess> {
        let looks = designs_of(method, space.dimensions()).saturating_mul(samples.saturating_add(1));
        check_count("method.designs", looks, "looks at designs", self.looks)
    }
}

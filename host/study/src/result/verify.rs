//! The finalists, looked at again thoroughly, beside the scene as it is in its file.

use super::finalists::finalists;
use super::table::{Entry, Table};
use crate::evaluate::{Thorough, Verified};
use crate::run::Study;
use crate::space::Refused;

/// A design that was looked at again.
#[derive(Clone, Debug)]
pub struct Finalist {
    /// Its number in the table, from 1; 0 for the scene as it is in its file.
    pub design: usize,
    /// The scene, as a file's text.
    pub text: String,
    /// What was found.
    pub verified: Result<Verified, String>,
}

/// The scene of the file and the finalists.
#[derive(Clone, Debug)]
pub struct Finals {
    /// The scene of the file.
    pub base: Finalist,
    /// The best first.
    pub best: Vec<Finalist>,
    /// The tolerance that the models were made for.
    pub tolerance: f64,
}

impl Finals {
    /// Looks at them; `None` if `stops` said so in between.
    ///
    /// # Errors
    /// [`Refused`], for a scene that was not refused before.
    pub fn of(study: &Study, table: &Table, stops: &dyn Fn() -> bool) -> Result<Option<Self>, Refused> {
        let thorough = Thorough::new(study.options());
        let base = finalist(study, &thorough, 0, &table.base)?;
        let mut best = Vec::new();
        for own in finalists(study, table, study.spec.method.finalists) {
            if stops() {
                return Ok(None);
            }
            best.push(finalist(study, &thorough, own + 1, &table.entries[own])?);
        }
        Ok(Some(Self { base, best, tolerance: thorough.tolerance() }))
    }
}

fn finalist(study: &Study, thorough: &Thorough, design: usize, entry: &Entry) -> Result<Finalist, Refused> {
    let own = &entry.row.design;
    let text = study.space.text(own)?;
    let scene = study.space.scene(own, &[])?;
    let verified = thorough.verified(&scene, &study.figures).map_err(|error| error.to_string());
    let verified = verified.map(|mut verified| {
        study.add_parts(&scene, own, &mut verified.figures);
        verified
    });
    Ok(Finalist { design, text, verified })
}

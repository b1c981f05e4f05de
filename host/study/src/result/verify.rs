//! The finalists, looked at again thoroughly, beside the scene as it is in its file.

use super::finalists::finalists;
use super::limits::broken_limits;
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

impl Finalist {
    /// The limits that its figures, as they were computed anew, break; `None` if it keeps all, or has none.
    #[must_use]
    pub fn breaks(&self, study: &Study) -> Option<String> {
        let values = self.verified.as_ref().ok().map(|verified| verified.figures.values.as_slice())?;
        broken_limits(study, |figure| values.get(figure).map(|value| (*value, *value)))
    }

    /// Its row of a study's table; `None` if it has none.
    #[must_use]
    pub fn entry<'t>(&self, table: &'t Table) -> Option<&'t Entry> {
        match self.design.checked_sub(1) {
            None => Some(&table.base),
            Some(at) => table.entries.get(at),
        }
    }
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
        in_order(study, &mut best);
        Ok(Some(Self { base, best, tolerance: thorough.tolerance() }))
    }
}

/// Puts those that break a limit as the thorough look tells it last, and those that failed after them. Of the others the one with the better figure is first, not where there are
/// several wishes, between which the first one is best, nor where the worst of uncertain ones decides, which is not looked at again.
fn in_order(study: &Study, best: &mut [Finalist]) {
    let rank = |own: &Finalist| match own.verified {
        Err(_) => 2,
        Ok(_) if own.breaks(study).is_some() => 1,
        Ok(_) => 0,
    };
    best.sort_by_key(rank);
    let ([wish], true) = (study.spec.wishes.as_slice(), study.spec.uncertain.is_empty()) else { return };
    let Some(place) = study.figures.iter().position(|wanted| *wanted == wish.wanted) else { return };
    let loss = |own: &Finalist| {
        let figure = own.verified.as_ref().ok().and_then(|verified| verified.figures.values.get(place).copied());
        figure.map_or(f64::INFINITY, |figure| wish.goal.loss(figure))
    };
    best.sort_by(|a, b| rank(a).cmp(&rank(b)).then(loss(a).total_cmp(&loss(b))));
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

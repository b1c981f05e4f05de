//! The finalists, looked at again thoroughly, beside the scene as it is in its file.

use super::finalists::choose_distinct_finalist_indices_meeting_limits_best_first;
use super::limits::describe_broken_limits_if_any;
use super::table::{DesignTable, TableEntry};
use crate::evaluate::{ThoroughEvaluator, VerifiedFigures};
use crate::run::Study;
use crate::space::RefusedDesign;

/// A design that was looked at again.
#[derive(Clone, Debug)]
pub struct Finalist {
    /// Its number in the table, from 1; 0 for the scene as it is in its file.
    pub design: usize,
    /// The scene, as a file's text.
    pub text: String,
    /// What was found.
    pub verified: Result<VerifiedFigures, String>,
}

impl Finalist {
    /// The limits that its figures, as they were computed anew, break; `None` if it keeps all, or has none.
    #[must_use]
    pub fn describe_broken_limits_if_any_unless_verification_failed(&self, study: &Study) -> Option<String> {
        let values = self.verified.as_ref().ok().map(|verified| verified.figures.values.as_slice())?;
        describe_broken_limits_if_any(study, |figure| values.get(figure).map(|value| (*value, *value)))
    }

    /// Its row of a study's table; `None` if it has none.
    #[must_use]
    pub fn entry_of_base_or_design_in_table<'t>(&self, table: &'t DesignTable) -> Option<&'t TableEntry> {
        match self.design.checked_sub(1) {
            None => Some(&table.base),
            Some(at) => table.entries.get(at),
        }
    }
}

/// The scene of the file and the finalists.
#[derive(Clone, Debug)]
pub struct VerifiedFinalists {
    /// The scene of the file.
    pub base: Finalist,
    /// The best first.
    pub best: Vec<Finalist>,
    /// The tolerance that the models were made for.
    pub tolerance: f64,
}

impl VerifiedFinalists {
    /// Looks at them; `None` if `is_stop_wanted` said so in between.
    ///
    /// # Errors
    /// [`RefusedDesign`], for a scene that was not refused before.
    pub fn evaluate_scene_and_chosen_finalists_thoroughly_unless_stopped(
        study: &Study,
        table: &DesignTable,
        is_stop_wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Self>, RefusedDesign> {
        let thorough = ThoroughEvaluator::new(study.plan_table_options());
        let base = evaluate_finalist_thoroughly_recording_failure(study, &thorough, 0, &table.base)?;
        let mut best = Vec::new();
        for own in choose_distinct_finalist_indices_meeting_limits_best_first(study, table, study.spec.method.finalists)
        {
            if is_stop_wanted() {
                return Ok(None);
            }
            best.push(evaluate_finalist_thoroughly_recording_failure(study, &thorough, own + 1, &table.entries[own])?);
        }
        // The last look may have been ended on its way.
        if is_stop_wanted() {
            return Ok(None);
        }
        sort_finalists_meeting_limits_first_then_breaking_then_failed(study, &mut best);
        Ok(Some(Self { base, best, tolerance: thorough.relative_tolerance() }))
    }
}

/// Puts those that break a limit as the thorough look tells it last, and those that failed after them. Of the others the one with the better figure is first, not where there are
/// several wishes, between which the first one is best, nor where the worst of uncertain ones decides, which is not looked at again.
fn sort_finalists_meeting_limits_first_then_breaking_then_failed(study: &Study, finalists: &mut [Finalist]) {
    let rank = |own: &Finalist| match own.verified {
        Err(_) => 2,
        Ok(_) if own.describe_broken_limits_if_any_unless_verification_failed(study).is_some() => 1,
        Ok(_) => 0,
    };
    finalists.sort_by_key(rank);
    let ([wish], true) = (study.spec.wishes.as_slice(), study.spec.uncertain.is_empty()) else { return };
    let Some(place) = study.figures.iter().position(|wanted| *wanted == wish.wanted) else { return };
    let loss = |own: &Finalist| {
        let figure = own.verified.as_ref().ok().and_then(|verified| verified.figures.values.get(place).copied());
        figure.map_or(f64::INFINITY, |figure| wish.goal.loss_of_figure(figure))
    };
    finalists.sort_by(|a, b| rank(a).cmp(&rank(b)).then(loss(a).total_cmp(&loss(b))));
}

fn evaluate_finalist_thoroughly_recording_failure(
    study: &Study,
    thorough: &ThoroughEvaluator,
    design_number: usize,
    entry: &TableEntry,
) -> Result<Finalist, RefusedDesign> {
    let own = &entry.row.design;
    let text = study.space.design_as_scene_text(own)?;
    let scene = study.space.build_scene_of_design_with_deviations_checking_distances(own, &[])?;
    let verified = thorough
        .compute_figures_refining_once_if_weakest_peak_misses_tolerance(&scene, &study.figures)
        .map_err(|error| error.to_string());
    let verified = verified.map(|mut verified| {
        study.fill_in_mass_and_cost_figures(&scene, own, &mut verified.figures);
        verified
    });
    Ok(Finalist { design: design_number, text, verified })
}

//! What a study leaves in its folder, and what is said of it: the same whoever has computed it.

use crate::report::{
    format_bound_in_scientific_notation_rounded_up_to_one_digit, format_four_significant_digits_or_no_value_if_nan,
    write_report_html,
};
use crate::result::{
    DesignStatus, DesignTable, Finalist, GatherError, TableEntry, TableError, VerifiedFinalists, write_parquet,
};
use crate::run::{FolderError, Study, StudyFolder};
use crate::space::RefusedDesign;
use crate::spec::WantedFigure;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Results that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Designs are missing, or the folder cannot be read.
    #[error(transparent)]
    Gather(#[from] GatherError),
    /// A file cannot be written.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The table is none that Parquet takes.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A finalist is no scene.
    #[error(transparent)]
    Refused(#[from] RefusedDesign),
}

/// What has been written.
#[derive(Clone, Debug)]
pub struct StudyResults {
    /// All designs.
    pub table: DesignTable,
    /// The best, computed anew.
    pub finals: VerifiedFinalists,
}

/// Computes the finalists anew and writes `designs.parquet`, `best-1.toml`, ... and `report.html`; `None` if `is_stop_wanted` said so.
///
/// # Errors
/// [`WriteError`].
pub fn verify_and_write_results_unless_stopped(
    study: &Study,
    folder: &StudyFolder,
    is_stop_wanted: &dyn Fn() -> bool,
) -> Result<Option<StudyResults>, WriteError> {
    let table = DesignTable::gather_from_folder(study, folder)?;
    folder.write_file_atomically("designs.parquet", &write_parquet(&table)?)?;
    let Some(finals) = VerifiedFinalists::evaluate_scene_and_chosen_finalists_thoroughly_unless_stopped(
        study,
        &table,
        is_stop_wanted,
    )?
    else {
        return Ok(None);
    };
    for (number, best) in finals.best.iter().enumerate() {
        folder.write_file_atomically(
            &format!("best-{}.toml", number + 1),
            format_scene_file_of_finalist(study, &table, best, number + 1).as_bytes(),
        )?;
    }
    folder.write_file_atomically("report.html", write_report_html(study, &table, &finals).as_bytes())?;
    Ok(Some(StudyResults { table, finals }))
}

/// A finalist's scene, with what it is above it.
fn format_scene_file_of_finalist(study: &Study, table: &DesignTable, finalist: &Finalist, rank: usize) -> String {
    let mut text = format!("# Rank {rank} in the study {:?}: design {}.\n", study.spec.name, finalist.design);
    for (name, value) in names_and_verified_figures_or_none_if_finalist_failed(study, finalist) {
        let _ = writeln!(text, "# {name} = {}", format_four_significant_digits_or_no_value_if_nan(value));
    }
    for (name, value) in names_and_worst_case_wish_figures_if_uncertain(study, table, finalist) {
        let _ = writeln!(
            text,
            "# {name} = {} at worst, over the samples of the uncertain values (in the quick evaluation of the study)",
            format_four_significant_digits_or_no_value_if_nan(value)
        );
    }
    if let Some(limits) = finalist.describe_broken_limits_if_any_unless_verification_failed(study) {
        let _ = writeln!(text, "# In the thorough evaluation, this design breaks a limit: {limits}.");
    }
    format!("{text}\n{}", finalist.text)
}

/// Of a finalist the worst of what may be off of each figure that is wished for, as it was looked at first, with the names of their columns; none where
/// nothing may be off.
#[must_use]
pub fn names_and_worst_case_wish_figures_if_uncertain(
    study: &Study,
    table: &DesignTable,
    finalist: &Finalist,
) -> Vec<(String, f64)> {
    let entry = finalist.entry_of_base_or_design_in_table(table).filter(|_| table.has_ends);
    let worst = entry.map(|entry| entry.wishes.as_slice()).unwrap_or_default();
    study.spec.wishes.iter().map(|wish| wish.wanted.column_name()).zip(worst.iter().copied()).collect()
}

/// The figures of a finalist with the names of their columns; none if it failed.
#[must_use]
pub fn names_and_verified_figures_or_none_if_finalist_failed(study: &Study, finalist: &Finalist) -> Vec<(String, f64)> {
    let names = study.figures.iter().map(|wanted| wanted.column_name());
    let values = finalist.verified.as_ref().map(|verified| verified.figures.values.clone()).unwrap_or_default();
    names.zip(values).collect()
}

/// Bounds on the relative errors of a finalist's figures with the names of their columns; `None` where none is known.
#[must_use]
pub fn names_and_relative_error_bounds_of_finalist(study: &Study, finalist: &Finalist) -> Vec<(String, Option<f64>)> {
    let names = study.figures.iter().map(|wanted| wanted.column_name());
    let bounds = finalist.verified.as_ref().map(|verified| verified.bounds.as_slice()).unwrap_or_default();
    names.enumerate().map(|(k, name)| (name, bounds.get(k).copied().flatten())).collect()
}

impl StudyResults {
    fn count_designs_with_status(&self, status: DesignStatus) -> usize {
        self.table.entries.iter().filter(|entry| entry.status == status).count()
    }

    /// What a design's variables are set to.
    fn describe_settings_of_design(&self, entry: &TableEntry) -> String {
        let columns = self.table.columns.iter();
        let values = columns.filter_map(|column| {
            Some(format!("{} = {}", column.name, column.text_in_design_unless_scene_value_kept(&entry.row.design)?))
        });
        values.collect::<Vec<_>>().join(", ")
    }

    /// The results as JSON, for programs.
    #[must_use]
    pub fn summarise_as_json(&self, study: &Study, results_folder: &Path) -> Value {
        let Self { table, finals } = self;
        let told = |own: &Finalist| {
            let verified = own.verified.as_ref();
            json!({
                "design": own.design,
                "figures": names_and_verified_figures_or_none_if_finalist_failed(study, own).into_iter().collect::<BTreeMap<_, _>>(),
                "weakest_mm": verified.ok().and_then(|verified| verified.figures.weakest_mm),
                "error_bound": verified.ok().and_then(|verified| verified.bound),
                "error_bounds": names_and_relative_error_bounds_of_finalist(study, own).into_iter().collect::<BTreeMap<_, _>>(),
                "tolerance_met": verified.ok().and_then(|verified| verified.is_tolerance_met_by_boundable_figures_if_any_and_all_bounded(&study.figures, finals.tolerance)),
                "worst": names_and_worst_case_wish_figures_if_uncertain(study, table, own).into_iter().collect::<BTreeMap<_, _>>(),
                "breaks": own.describe_broken_limits_if_any_unless_verification_failed(study),
                "failed": verified.err(),
            })
        };
        json!({
            "study": study.spec.name, "folder": results_folder, "designs": table.entries.len(), "kept": self.count_designs_with_status(DesignStatus::Kept),
            "broken": self.count_designs_with_status(DesignStatus::Broken), "failed": self.count_designs_with_status(DesignStatus::Failed),
            "on_front": table.entries.iter().filter(|entry| entry.is_on_front).count(),
            "nearest": table.find_one_based_design_nearest_to_limits_if_none_meets_them().map(|(design, entry)| json!({"design": design, "reason": entry.reason})),
            "tolerance": finals.tolerance, "as_it_is": told(&finals.base),
            "best": finals.best.iter().map(told).collect::<Vec<_>>(),
        })
    }

    /// The scene as it is and the best designs as a table: their figures as they were computed anew, with bounds beside those that have them.
    fn format_markdown_table_of_scene_and_best_designs(&self, study: &Study) -> String {
        let finals = &self.finals;
        let all: Vec<(String, &Finalist)> = std::iter::once(("unchanged scene".to_owned(), &finals.base))
            .chain(finals.best.iter().enumerate().map(|(k, own)| (format!("best {}", k + 1), own)))
            .collect();
        let bound = |own: &Finalist, k: usize| own.verified.as_ref().ok()?.bounds.get(k).copied().flatten();
        let is_bounded: Vec<bool> =
            (0..study.figures.len()).map(|k| all.iter().any(|(_, own)| bound(own, k).is_some())).collect();
        let mut head = vec![String::new(), "design".into()];
        for (wanted, is_bounded) in study.figures.iter().zip(&is_bounded) {
            let name = wanted.column_name();
            let bound_head = is_bounded.then(|| format!("{name}: relative error at most"));
            head.push(name);
            head.extend(bound_head);
        }
        let mut text = format!("\n\n| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
        for (name, own) in &all {
            let mut cells = vec![name.clone(), own.design.to_string()];
            for (k, is_bounded) in is_bounded.iter().enumerate() {
                let value = own.verified.as_ref().ok().and_then(|verified| verified.figures.values.get(k));
                cells.push(value.map_or_else(
                    || "failed".into(),
                    |value| format_four_significant_digits_or_no_value_if_nan(*value),
                ));
                cells.extend(is_bounded.then(|| {
                    bound(own, k)
                        .map_or_else(|| "not known".into(), format_bound_in_scientific_notation_rounded_up_to_one_digit)
                }));
            }
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        let _ = write!(text, "\n(thorough evaluation with models for a relative tolerance of {:.0e}", finals.tolerance);
        let is_missing = |k: usize| is_bounded[k] && all.iter().any(|(_, own)| bound(own, k).is_none());
        if (0..study.figures.len()).any(is_missing) {
            text.push_str("; \"not known\" means that the model of the design gave no error bound");
        }
        let missed = |own: &Finalist| {
            own.verified.as_ref().is_ok_and(|found| {
                found.is_tolerance_met_by_boundable_figures_if_any_and_all_bounded(&study.figures, finals.tolerance)
                    != Some(true)
            }) && study.figures.iter().any(WantedFigure::can_have_error_bound)
        };
        let missed: Vec<&str> = all.iter().filter(|(_, own)| missed(own)).map(|(name, _)| name.as_str()).collect();
        if !missed.is_empty() {
            let _ = write!(text, "; the errors of {} may exceed this tolerance", missed.join(", "));
        }
        if is_bounded.contains(&false) {
            text.push_str("; if a figure has no error column, its error is not known");
        }
        text.push_str(")\n");
        text
    }

    /// The results as text, for people.
    #[must_use]
    pub fn summarise_as_text(&self, study: &Study, results_folder: &Path) -> String {
        let Self { table, finals } = self;
        let mut text = format!(
            "{}: {} designs (method {}): {} meet all limits, {} break at least one limit, {} failed",
            study.spec.name,
            table.entries.len(),
            study.spec.method.way.name(),
            self.count_designs_with_status(DesignStatus::Kept),
            self.count_designs_with_status(DesignStatus::Broken),
            self.count_designs_with_status(DesignStatus::Failed)
        );
        let first = table.entries.iter().find(|entry| entry.status == DesignStatus::Failed);
        if let Some(reason) =
            first.and_then(|entry| entry.reason.as_deref()).filter(|_| !table.have_all_designs_failed())
        {
            let _ = write!(text, " (the first failed because: {reason})");
        }
        if study.spec.wishes.len() > 1 {
            let front = table.entries.iter().filter(|entry| entry.is_on_front).count();
            let _ = write!(text, "; {front} designs on the Pareto front");
        }
        text.push_str(&self.format_markdown_table_of_scene_and_best_designs(study));
        for (k, own) in finals.best.iter().enumerate() {
            let entry = own.entry_of_base_or_design_in_table(table);
            let _ = write!(
                text,
                "\nbest {}: {}",
                k + 1,
                entry.map(|entry| self.describe_settings_of_design(entry)).unwrap_or_default()
            );
            for (name, value) in names_and_worst_case_wish_figures_if_uncertain(study, table, own) {
                let _ = write!(
                    text,
                    "; {name} is {} at worst, over the samples of the uncertain values (in the quick evaluation of the study)",
                    format_four_significant_digits_or_no_value_if_nan(value)
                );
            }
            if let Some(limits) = own.describe_broken_limits_if_any_unless_verification_failed(study) {
                let _ = write!(text, " (in the thorough evaluation, this design breaks a limit: {limits})");
            }
            if let Err(reason) = &own.verified {
                let _ = write!(text, " (failed: {reason})");
            }
        }
        if finals.best.is_empty() {
            text.push_str(if table.have_all_designs_failed() {
                "\nAll designs failed."
            } else {
                "\nNo design meets all limits."
            });
            if let Some((design, entry)) = table.find_one_based_design_nearest_to_limits_if_none_meets_them() {
                let reason = entry.reason.as_deref().unwrap_or_default();
                let _ = write!(
                    text,
                    " Design {design} comes nearest to the limits: {reason}\ndesign {design}: {}",
                    self.describe_settings_of_design(entry)
                );
            } else if let Some(reason) = table.entries.iter().find_map(|entry| entry.reason.as_ref()) {
                let _ = write!(text, " The first failed because: {reason}");
            }
        }
        let _ = write!(text, "\n\nthe results are in {}", results_folder.display());
        text
    }
}

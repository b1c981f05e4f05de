//! The report's tables: what was found, how sure it is, what failed.

use super::{
    escape_html, format_bound_in_scientific_notation_rounded_up_to_one_digit,
    format_four_significant_digits_or_no_value_if_nan,
};
use crate::result::{DesignStatus, DesignTable, Finalist, VerifiedFinalists};
use crate::run::Study;
use crate::space::describe_variable_name_and_allowed_values;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Reasons for failures that are listed.
const MOST_REASONS: usize = 20;
/// Characters of a reason by which failures are counted together: numbers differ from design to design.
const ALIKE: usize = 48;

/// What the study did and found, as HTML.
pub(super) fn write_summary_html(study: &Study, table: &DesignTable, finals: &VerifiedFinalists) -> String {
    let count = |status: DesignStatus| table.entries.iter().filter(|entry| entry.status == status).count();
    let method = &study.spec.method;
    let mut html = format!(
        "<p>{} designs (method {}), for frequencies from {:.0} to {:.0} Hz: {} meet all limits, {} break at least one \
         limit, {} failed.",
        table.entries.len(),
        escape_html(method.way.name()).replace('_', " "),
        method.from_hz,
        method.to_hz,
        count(DesignStatus::Kept),
        count(DesignStatus::Broken),
        count(DesignStatus::Failed)
    );
    if study.count_uncertainty_samples() > 0 {
        let _ = write!(
            html,
            " For each wish and limit, the worst of {} samples of the uncertain values counts.",
            study.count_uncertainty_samples()
        );
    }
    html.push_str("</p>\n<p>Variables:</p>\n<ul>\n");
    for variable in study.space.variables() {
        let _ = writeln!(html, "<li>{}</li>", escape_html(&describe_variable_name_and_allowed_values(variable)));
    }
    html.push_str("</ul>\n<p>Wishes: ");
    let wishes = study.spec.wishes.iter().map(|wish| format!("{} {}", wish.goal.name(), wish.wanted.column_name()));
    html.push_str(&escape_html(&wishes.collect::<Vec<_>>().join(", ")));
    let limits = study.spec.limits.iter().map(|limit| {
        let name = limit.wanted.column_name();
        match (limit.least.is_finite(), limit.most.is_finite()) {
            (true, true) => format!("{name} from {} to {}", limit.least, limit.most),
            (true, false) => format!("{name} at least {}", limit.least),
            _ => format!("{name} at most {}", limit.most),
        }
    });
    let limits: Vec<String> = limits.collect();
    if !limits.is_empty() {
        let _ = write!(html, "; limits: {}", escape_html(&limits.join(", ")));
    }
    html.push_str(".</p>\n");
    html.push_str(&write_html_table_of_scene_and_best_designs(study, table, finals));
    html
}

/// The scene as it is beside the best designs, figures computed anew.
fn write_html_table_of_scene_and_best_designs(
    study: &Study,
    table: &DesignTable,
    finals: &VerifiedFinalists,
) -> String {
    let mut html = String::from("<table>\n<tr><th></th><th>unchanged scene</th>");
    for number in 1..=finals.best.len() {
        let _ = write!(html, "<th>best {number}</th>");
    }
    html.push_str("</tr>\n<tr><th>design</th><td>0</td>");
    finals.best.iter().for_each(|own| {
        let _ = write!(html, "<td>{}</td>", own.design);
    });
    html.push_str("</tr>\n");
    let as_it_is = study.space.design_of_scene_file();
    for column in &table.columns {
        let text =
            column.text_in_design_unless_scene_value_kept(&as_it_is).unwrap_or_else(|| "as in the scene file".into());
        let _ = write!(html, "<tr><th>{}</th><td>{}</td>", escape_html(&column.name), escape_html(&text));
        for own in &finals.best {
            let text = own
                .entry_of_base_or_design_in_table(table)
                .and_then(|entry| column.text_in_design_unless_scene_value_kept(&entry.row.design));
            let _ = write!(html, "<td>{}</td>", escape_html(&text.unwrap_or_default()));
        }
        html.push_str("</tr>\n");
    }
    for (k, wanted) in study.figures.iter().enumerate() {
        let _ = write!(html, "<tr class=\"figure\"><th>{}</th>", escape_html(&wanted.column_name()));
        for own in std::iter::once(&finals.base).chain(&finals.best) {
            html.push_str(&html_cell_of_verified_figure_or_failure_reason(study, own, k));
        }
        html.push_str("</tr>\n");
    }
    if table.has_ends {
        for (k, wish) in study.spec.wishes.iter().enumerate() {
            let name = escape_html(&wish.wanted.column_name());
            let _ = write!(html, "<tr><th>{name}, the worst over the uncertain values (quick evaluation)</th>");
            for own in std::iter::once(&finals.base).chain(&finals.best) {
                let worst = own.entry_of_base_or_design_in_table(table).and_then(|entry| entry.wishes.get(k)).copied();
                let _ = write!(
                    html,
                    "<td>{}</td>",
                    worst.map_or_else(String::new, format_four_significant_digits_or_no_value_if_nan)
                );
            }
            html.push_str("</tr>\n");
        }
    }
    if !study.spec.limits.is_empty() {
        html.push_str("<tr><th>limits</th>");
        for own in std::iter::once(&finals.base).chain(&finals.best) {
            html.push_str(&html_cell_both_evaluations_meet_limits(study, table, own));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</table>\n");
    if finals.best.is_empty() {
        html.push_str(if table.have_all_designs_failed() {
            "<p>All designs failed."
        } else {
            "<p>No design meets all limits."
        });
        if let Some((design, near)) = table.find_one_based_design_nearest_to_limits_if_none_meets_them() {
            let reason = escape_html(near.reason.as_deref().unwrap_or_default());
            let _ = write!(html, " Design {design} comes nearest to the limits: {reason}.");
        } else if let Some(reason) = table.entries.iter().find_map(|entry| entry.reason.as_deref()) {
            let _ = write!(html, " The first failed because: {}.", escape_html(reason));
        }
        html.push_str("</p>\n");
    } else {
        html.push_str(
            "<p>The scene files of the best designs are in the folder of this report: <code>best-1.toml</code> and so \
             on. <code>era serve --scene best-1.toml</code> starts the daemon with such a scene.</p>\n",
        );
    }
    html
}

/// A figure of a finalist, as a table's cell.
fn html_cell_of_verified_figure_or_failure_reason(study: &Study, finalist: &Finalist, figure_index: usize) -> String {
    match &finalist.verified {
        Ok(verified) => {
            let value = verified.figures.values.get(figure_index).copied();
            value.map_or_else(
                || "<td></td>".into(),
                |value| html_cell_of_figure_marking_broken_limit(study, figure_index, value),
            )
        }
        Err(reason) => format!("<td>{}</td>", escape_html(reason)),
    }
}

/// A figure as a table's cell, with a mark where it is beyond a limit.
fn html_cell_of_figure_marking_broken_limit(study: &Study, figure_index: usize, value: f64) -> String {
    match describe_allowed_if_limit_broken(study, figure_index, value) {
        Some(allowed) => {
            format!(
                "<td class=\"unmet\" title=\"{}\">{} (not met)</td>",
                escape_html(&allowed),
                format_four_significant_digits_or_no_value_if_nan(value)
            )
        }
        None => format!("<td>{}</td>", format_four_significant_digits_or_no_value_if_nan(value)),
    }
}

/// What the limit that a figure breaks allows; `None` if it breaks none.
fn describe_allowed_if_limit_broken(study: &Study, figure_index: usize, value: f64) -> Option<String> {
    let wanted = study.figures.get(figure_index)?;
    let limits = study.spec.limits.iter().filter(|limit| limit.wanted == *wanted);
    limits
        .filter_map(|limit| limit.violating_value_and_allowed_text_if_limit_broken(value, value))
        .map(|(_, allowed)| allowed)
        .next()
}

/// Whether a finalist keeps all limits, as a table's cell: as it was computed anew, and as it was looked at, with all that may be off.
fn html_cell_both_evaluations_meet_limits(study: &Study, table: &DesignTable, finalist: &Finalist) -> String {
    match finalist.entry_of_base_or_design_in_table(table) {
        Some(found) if found.status == DesignStatus::Broken => {
            let reason = found.reason.as_deref().unwrap_or_default();
            format!("<td class=\"unmet\" title=\"{}\">not met</td>", escape_html(reason))
        }
        _ if finalist.describe_broken_limits_if_any_unless_verification_failed(study).is_some() => {
            "<td class=\"unmet\">not met</td>".into()
        }
        Some(found) if found.status == DesignStatus::Kept => "<td>met</td>".into(),
        _ => "<td>not known</td>".into(),
    }
}

/// How much the quick look and the thorough one differ, whether a search had arrived, and why designs failed.
pub(super) fn write_accuracy_convergence_and_failures_html(
    study: &Study,
    table: &DesignTable,
    finals: &VerifiedFinalists,
) -> String {
    let mut html = format!(
        "<p>The program first computed all designs with the {} evaluation (column \"first value\"). The scene itself and the best designs were then \
        computed again, with models whose relative error should be at most {:.0e} (column \"computed again\"). The \
        column \"error at most\" is an upper bound of the relative error of the value computed again. The program \
        computes this bound for three kinds of figures only: the largest possible peak at the weakest place, the frequencies \
        of modes, and sag_um.</p>\n\
         <table>\n<tr><th>design</th><th>figure</th><th>first value</th><th>computed \
         again</th><th>difference</th><th>error at most</th></tr>\n",
        if study.spec.method.thorough { "thorough" } else { "quick" },
        finals.tolerance
    );
    for own in std::iter::once(&finals.base).chain(&finals.best) {
        let Some(figures) =
            own.entry_of_base_or_design_in_table(table).and_then(|entry| entry.row.figures_unless_failed())
        else {
            continue;
        };
        for (k, wanted) in study.figures.iter().enumerate() {
            let first = figures.values.get(k).copied().unwrap_or(f64::NAN);
            let Ok(verified) = &own.verified else { continue };
            let anew = verified.figures.values.get(k).copied().unwrap_or(f64::NAN);
            let difference = if first.is_nan() || anew.is_nan() {
                String::from("unknown")
            } else if wanted.figure.is_level_in_db() {
                format!("{:+.2} dB", first - anew)
            } else {
                format!("{:+.2} %", 100.0 * (first / anew - 1.0))
            };
            let bound = match verified.bounds.get(k).copied().flatten() {
                Some(bound) => format_bound_in_scientific_notation_rounded_up_to_one_digit(bound),
                None => "not known".into(),
            };
            let _ = writeln!(
                html,
                "<tr><td>{}</td><td>{}</td>{}{}<td>{difference}</td><td>{bound}</td></tr>",
                own.design,
                escape_html(&wanted.column_name()),
                html_cell_of_figure_marking_broken_limit(study, k, first),
                html_cell_of_figure_marking_broken_limit(study, k, anew)
            );
        }
    }
    html.push_str("</table>\n");
    html.push_str(&write_improvement_by_last_quarter_html_or_empty_unless_one_wish(study, table));
    html.push_str(&write_html_table_of_failure_and_broken_limit_reasons(table));
    html
}

/// Whether the last quarter of the designs found better ones than those before.
fn write_improvement_by_last_quarter_html_or_empty_unless_one_wish(study: &Study, table: &DesignTable) -> String {
    let [wish] = study.spec.wishes.as_slice() else { return String::new() };
    let mut order: Vec<usize> = (0..table.entries.len()).collect();
    if let Some(evolution) = study.evolution_if_points_depend_on_results() {
        // Generations of all searches side by side.
        let (own, generations) = (evolution.designs_per_generation_of_one_search(), evolution.generations_per_search());
        order.sort_by_key(|k| ((k / own) % generations.max(1), *k));
    }
    let best = |part: &[usize]| {
        let kept = part.iter().map(|k| &table.entries[*k]).filter(|entry| entry.status == DesignStatus::Kept);
        kept.map(|entry| wish.goal.loss_of_figure(entry.wishes[0])).fold(f64::INFINITY, f64::min)
    };
    let (before, last) = order.split_at(order.len() - order.len() / 4);
    let (before, last) = (best(before), best(last));
    if !before.is_finite() || !last.is_finite() {
        return String::new();
    }
    let name = escape_html(&wish.wanted.column_name());
    if last < before {
        let more = 100.0 * (before - last) / before.abs().max(1e-12);
        format!(
            "<p>The last quarter of the designs still improved {name} from {} to {} ({more:.2} %): a study \
             with more designs may find a better design.</p>\n",
            format_four_significant_digits_or_no_value_if_nan(wish.goal.loss_of_figure(before)),
            format_four_significant_digits_or_no_value_if_nan(wish.goal.loss_of_figure(last))
        )
    } else {
        format!(
            "<p>In the last quarter of the designs, no design has a better {name} than the best of the earlier \
             designs.</p>\n"
        )
    }
}

/// A table of the reasons for which designs failed, with how many failed for each.
fn write_html_table_of_failure_and_broken_limit_reasons(table: &DesignTable) -> String {
    let mut counts: BTreeMap<String, (usize, usize, &str)> = BTreeMap::new();
    for (number, entry) in table.entries.iter().enumerate() {
        if let Some(reason) = &entry.reason {
            let key: String = reason.chars().filter(|c| !c.is_ascii_digit() && *c != '.').take(ALIKE).collect();
            counts.entry(key).or_insert((0, number + 1, reason)).0 += 1;
        }
    }
    if counts.is_empty() {
        return "<p>No design failed or broke a limit.</p>\n".into();
    }
    let mut all: Vec<_> = counts.into_values().collect();
    all.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut html = String::from(
        "<table>\n<tr><th>number of designs</th><th>first design</th><th>why the design failed, or which limit it \
         breaks</th></tr>\n",
    );
    for (count, first, reason) in all.iter().take(MOST_REASONS) {
        let _ = writeln!(html, "<tr><td>{count}</td><td>{first}</td><td>{}</td></tr>", escape_html(reason));
    }
    html.push_str("</table>\n");
    if all.len() > MOST_REASONS {
        let _ = writeln!(
            html,
            "<p>Number of other reasons, which are not listed here: {}. The table of designs has \
                                the reasons of all designs.</p>",
            all.len() - MOST_REASONS
        );
    }
    html
}

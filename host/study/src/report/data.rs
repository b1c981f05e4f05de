//! The designs as data for the report's script, and the places where it draws them.

use crate::result::{DesignStatus, DesignTable, TableEntry, VerifiedFinalists};
use crate::run::Study;
use crate::space::Design;
use crate::spec::WishGoal;
use serde_json::{Value, json};

/// Most designs that the report shows: more are slow to draw. All are in the table.
const MOST: usize = 5000;

/// The places of the plots, as HTML.
pub(super) fn write_plots_section_html(study: &Study, table: &DesignTable) -> String {
    let what = if study.spec.wishes.len() > 1 {
        "Large dots are designs that no other design surpasses in all wishes. Numbered red rings are the best designs."
    } else {
        "The large dot is the design with the best figure. Numbered red rings are the best designs of the thorough evaluation."
    };
    let off = if table.has_ends {
        " For a figure that a wish uses, the plots show the worst value over the samples of the uncertain values."
    } else {
        ""
    };
    let all = table.entries.len();
    let shown = if all > MOST {
        format!(
            " The plots show at most {MOST} of {all} designs: the best designs, and other designs at even intervals of the design number."
        )
    } else {
        String::new()
    };
    let lines = if table.entries.iter().any(|entry| entry.status == DesignStatus::Kept) {
        "Each line is a design that meets the limits."
    } else {
        "No design meets the limits, so each line is a design that did not fail."
    };
    format!(
        "<p>{what} Crosses are designs that do not meet the limits; the diamond is the unchanged scene. Point at a \
         mark to read the values of its design.{off}{shown}</p>\n\
         <p class=\"axes\"><label>horizontal axis <select id=\"across\"></select></label> <label>vertical axis <select \
         id=\"up\"></select></label></p>\n\
         <div id=\"scatter\"></div>\n<p id=\"told\" aria-live=\"polite\"></p>\n\
         <h3>All columns side by side</h3>\n<p>{lines} The lighter a line, the better its design meets the first wish. \
         Drag along an axis to select a range: the plot then shows only the lines in this range. Click the axis to \
         remove the range.</p>\n<div \
         id=\"parallel\"></div>\n"
    )
}

/// What the script draws: names of columns, and a row of numbers for each design.
pub(super) fn write_plot_data_json(study: &Study, table: &DesignTable, finals: &VerifiedFinalists) -> String {
    let wishes = study.spec.wishes.iter().map(|wish| wish.wanted.column_name());
    let mut columns: Vec<Value> = vec![json!({"name": "design"})];
    columns.extend(table.columns.iter().map(|column| match &column.words {
        Some(words) => json!({"name": column.name, "words": words}),
        None => json!({"name": column.name}),
    }));
    let first_figure = columns.len();
    columns.extend(table.figures.iter().map(|wanted| json!({"name": wanted.column_name()})));
    let goals: Vec<Value> = study
        .spec
        .wishes
        .iter()
        .zip(wishes)
        .map(|(wish, name)| {
            let column = table.figures.iter().position(|wanted| *wanted == wish.wanted).map(|k| first_figure + k);
            json!({"name": name, "column": column, "most": wish.goal == WishGoal::Most})
        })
        .collect();
    let finalists: Vec<usize> = finals.best.iter().map(|own| own.design).collect();
    let rows: Vec<Value> = choose_one_based_unfailed_designs_to_plot_thinning_if_too_many(study, table, &finalists)
        .into_iter()
        .map(|number| {
            let entry = &table.entries[number - 1];
            json!([
                plot_code_0_not_meeting_limits_1_meeting_2_on_pareto_front(entry),
                plot_row_of_number_settings_and_worst_case_figures_to_six_digits(
                    study,
                    table,
                    entry,
                    &entry.row.design,
                    number
                )
            ])
        })
        .collect();
    let base = json!([
        plot_code_0_not_meeting_limits_1_meeting_2_on_pareto_front(&table.base),
        plot_row_of_number_settings_and_worst_case_figures_to_six_digits(
            study,
            table,
            &table.base,
            &study.space.design_of_scene_file(),
            0
        )
    ]);
    let data = json!({"columns": columns, "wishes": goals, "best": finalists, "rows": rows, "base": base});
    // Nothing of it ends the script that it stands in.
    data.to_string().replace('<', "\\u003c")
}

/// 0 breaks a limit, 1 keeps all, 2 is on the front.
fn plot_code_0_not_meeting_limits_1_meeting_2_on_pareto_front(entry: &TableEntry) -> u8 {
    match (entry.status, entry.is_on_front) {
        (DesignStatus::Kept, true) => 2,
        (DesignStatus::Kept, false) => 1,
        _ => 0,
    }
}

/// A row's numbers, to six digits, in the columns' order. Figures are the worst of what may be off where they are wished for.
fn plot_row_of_number_settings_and_worst_case_figures_to_six_digits(
    study: &Study,
    table: &DesignTable,
    entry: &TableEntry,
    design: &Design,
    design_number: usize,
) -> Vec<Value> {
    let rounded = |value: f64| format!("{value:.5e}").parse::<f64>().map_or(Value::Null, Value::from);
    let mut values = vec![Value::from(design_number)];
    values.extend(table.columns.iter().map(|column| {
        column.number_or_choice_index_in_design_unless_scene_value_kept(design).map_or(Value::Null, rounded)
    }));
    let figures = entry.row.figures_unless_failed();
    values.extend(table.figures.iter().enumerate().map(|(k, wanted)| {
        let wish = study.spec.wishes.iter().position(|wish| wish.wanted == *wanted);
        let worst = wish.and_then(|wish| entry.wishes.get(wish));
        let own = worst.or_else(|| figures.and_then(|own| own.values.get(k)));
        own.map_or(Value::Null, |value| rounded(*value))
    }));
    values
}

/// The designs that are shown, by number: those of the front, the finalists, and others evenly.
fn choose_one_based_unfailed_designs_to_plot_thinning_if_too_many(
    study: &Study,
    table: &DesignTable,
    finalist_numbers: &[usize],
) -> Vec<usize> {
    let with_figures: Vec<usize> =
        (1..=table.entries.len()).filter(|number| table.entries[number - 1].status != DesignStatus::Failed).collect();
    if with_figures.len() <= MOST {
        return with_figures;
    }
    let mut best: Vec<usize> = with_figures.clone();
    if let Some(goal) = study.spec.wishes.first().map(|wish| wish.goal) {
        let loss = |number: &usize| {
            table.entries[number - 1].wishes.first().map_or(f64::INFINITY, |own| goal.loss_of_figure(*own))
        };
        best.sort_by(|a, b| loss(a).total_cmp(&loss(b)));
    }
    let front = with_figures.iter().copied().filter(|number| table.entries[number - 1].is_on_front).take(MOST / 4);
    let evenly = with_figures.iter().copied().step_by(with_figures.len().div_ceil(MOST / 2));
    let mut all: Vec<usize> =
        front.chain(best.into_iter().take(MOST / 4)).chain(finalist_numbers.iter().copied()).chain(evenly).collect();
    all.sort_unstable();
    all.dedup();
    all
}

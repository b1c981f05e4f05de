//! A study's report: one file of HTML with its pictures, its data and what makes them move, that asks no other address for anything.

mod data;
mod maps;
mod pictures;
mod tables;

use crate::result::{DesignTable, VerifiedFinalists};
use crate::run::Study;
use std::fmt::Write;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The report of a study as HTML.
#[must_use]
pub fn write_report_html(study: &Study, table: &DesignTable, finals: &VerifiedFinalists) -> String {
    let name = escape_html(&study.spec.name);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{name}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{name}</h1>\n"
    );
    html.push_str(&tables::write_summary_html(study, table, finals));
    add_html_section(&mut html, "designs", "All designs", &data::write_plots_section_html(study, table));
    add_html_section(
        &mut html,
        "maps",
        "Largest possible peak at each place",
        &maps::write_peak_maps_of_base_and_best_html(study, finals),
    );
    add_html_section(
        &mut html,
        "effects",
        "Effects of the variables",
        &pictures::write_main_effects_and_interactions_on_wishes_html(study, table),
    );
    add_html_section(
        &mut html,
        "doubts",
        "Accuracy, convergence and failures",
        &tables::write_accuracy_convergence_and_failures_html(study, table, finals),
    );
    let data = data::write_plot_data_json(study, table, finals);
    let _ = write!(
        html,
        "<script type=\"application/json\" id=\"data\">{data}</script>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
    );
    html
}

fn add_html_section(html: &mut String, id: &str, title: &str, body: &str) {
    let _ = write!(html, "<section id=\"{id}\">\n<h2>{title}</h2>\n{body}</section>\n");
}

/// Text as HTML writes it.
fn escape_html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            other => out.push(other),
        }
    }
    out
}

/// A bound with one digit, no less than it is.
#[must_use]
pub fn format_bound_in_scientific_notation_rounded_up_to_one_digit(bound: f64) -> String {
    let unit = 10.0_f64.powf(bound.log10().floor());
    let up = (bound / unit * (1.0 - 1e-9)).ceil() * unit;
    if up.is_finite() { format!("{up:.0e}") } else { format!("{bound:.0e}") }
}

/// Four digits, or that there is no value.
#[must_use]
pub fn format_four_significant_digits_or_no_value_if_nan(number: f64) -> String {
    if number.is_nan() {
        return "no value".into();
    }
    if number == 0.0 || !number.is_finite() || number.abs() >= 1e4 {
        return format!("{number:.0}");
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 9")]
    let digits = (3.0 - number.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{number:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_never_reported_smaller() {
        let told =
            [1.4e-3, 1e-3, 9.5e-5, 0.0, f64::INFINITY].map(format_bound_in_scientific_notation_rounded_up_to_one_digit);
        assert_eq!(told, ["2e-3", "1e-3", "1e-4", "0e0", "inf"]);
    }

    #[test]
    fn numbers_have_four_digits_and_text_no_tags() {
        assert_eq!(
            [0.0, 0.371_49, 12.345_6, 98_765.4, -0.001_234_56].map(format_four_significant_digits_or_no_value_if_nan),
            ["0", "0.3715", "12.35", "98765", "-0.001235"]
        );
        assert_eq!(
            [f64::NAN, f64::INFINITY].map(format_four_significant_digits_or_no_value_if_nan),
            ["no value", "inf"]
        );
        assert_eq!(escape_html("<b>&\"</b>"), "&lt;b&gt;&amp;&quot;&lt;/b&gt;");
    }
}

//! Main effects and interactions, as pictures and tables.

use super::maps::color_of_fraction;
use super::{escape_html, format_four_significant_digits_or_no_value_if_nan};
use crate::result::{DesignTable, DimensionLevels, EffectAnalysis, Interaction};
use crate::run::Study;
use crate::space::CubeDimension;
use crate::spec::PointMethod;
use std::fmt::Write;

/// Width and height of a panel in pixels.
const PANEL: (f64, f64) = (196.0, 120.0);
/// Room for the numbers left of a panel's axis, in pixels.
const BESIDE: f64 = 44.0;
/// About the width of a character of the pictures' text, in pixels.
const CHARACTER: f64 = 5.8;
/// Least room between two texts, in pixels.
const GAP: f64 = 3.0;
/// Pairs that are drawn: those with the largest interactions.
const MOST_PAIRS: usize = 6;

/// Main effects and interactions of all wishes, as HTML.
pub(super) fn write_main_effects_and_interactions_on_wishes_html(study: &Study, table: &DesignTable) -> String {
    let dimensions = study.space.dimensions();
    let mut html = String::from(
        "<p>Main effects: the mean of a figure over all designs whose variable lies in the same section of its range. \
         The percentage is the share of the variance that the variable explains (sum of squares between the sections, \
         divided by the total sum of squares); the number in brackets is the share that chance alone would give. \
         Interactions: the share that a pair of variables explains beyond the two main effects.</p>\n",
    );
    if study.spec.method.way == PointMethod::Evolution {
        html.push_str(
            "<p>An evolution chose these designs: most of them are near the best design, so the effects are valid for \
             this region only. A grid, a Latin hypercube or a Sobol sequence shows the whole range.</p>\n",
        );
    }
    for (k, wish) in study.spec.wishes.iter().enumerate() {
        let name = wish.wanted.column_name();
        let points: Vec<(&[f64], f64)> = table
            .entries
            .iter()
            .filter_map(|entry| Some((entry.row.point.as_slice(), entry.wishes.get(k).copied()?)))
            .filter(|(_, figure)| figure.is_finite())
            .collect();
        let Some(found) = EffectAnalysis::analyse_variance_if_figures_differ(dimensions, &points) else {
            let _ = writeln!(
                html,
                "<p>{}: the variables have no effect on this figure, because it is the same for all \
                                designs or was not computed.</p>",
                escape_html(&name)
            );
            continue;
        };
        let _ = writeln!(
            html,
            "<h3>{}: {} designs, mean {}</h3>",
            escape_html(&name),
            found.count,
            format_four_significant_digits_or_no_value_if_nan(found.mean)
        );
        html.push_str(&draw_main_effects_html(study, dimensions, &found));
        html.push_str(&draw_largest_interactions_html(study, dimensions, &found));
    }
    html
}

/// What a level of a dimension is called: its value, or the middle of its part of the range, or of several values the first and the last.
fn label_of_level(
    study: &Study,
    dimension: &CubeDimension,
    dimension_index: usize,
    levels: &DimensionLevels,
    level: usize,
) -> String {
    let name = |at: f64| label_of_value_at_coordinate(study, dimension, dimension_index, at);
    match levels.first_and_last_unit_coordinate_in_level_if_values_are_grouped(level).map(|ends| ends.map(name)) {
        Some([first, last]) if first != last => format!("{first} to {last}"),
        _ => levels.at.get(level).map(|at| name(*at)).unwrap_or_default(),
    }
}

/// What a dimension's value at a coordinate is called.
fn label_of_value_at_coordinate(
    study: &Study,
    dimension: &CubeDimension,
    dimension_index: usize,
    coordinate: f64,
) -> String {
    let mut point = vec![0.5; study.space.dimensions().len()];
    point[dimension_index] = coordinate;
    let design = study.space.design_at_point(&point);
    let own = |column: &&crate::space::DesignColumn| {
        column.variable == dimension.variable
            && !column.follows
            && (column.name == dimension.name || column.coordinate == 0)
    };
    let columns = study.space.table_columns();
    let named = columns.iter().find(|column| column.name == dimension.name && column.variable == dimension.variable);
    let column = named.or_else(|| columns.iter().find(own));
    let text = column.and_then(|column| match column.words {
        Some(_) => column.text_in_design_unless_scene_value_kept(&design),
        None => column
            .number_or_choice_index_in_design_unless_scene_value_kept(&design)
            .map(format_four_significant_digits_or_no_value_if_nan)
            .map(trim_trailing_zeros),
    });
    text.unwrap_or_default()
}

/// A number without zeros at the end of its fraction.
fn trim_trailing_zeros(number: String) -> String {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.').to_owned() } else { number }
}

/// What is written of the `labels` of the levels below an axis on which each has `room_per_label_px` pixels: words are cut to that, and numbers left
/// out that would meet the one before.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a few characters"
)]
fn shorten_words_and_omit_crowded_numbers(labels: &[String], room_per_label_px: f64) -> Vec<String> {
    let most = ((room_per_label_px - GAP) / CHARACTER).floor().max(1.0) as usize;
    let mut end = f64::NEG_INFINITY;
    let each = labels.iter().enumerate().map(|(level, label)| {
        let length = label.chars().count();
        if label.parse::<f64>().is_err() && length > most {
            return label.chars().take(most - 1).chain(['\u{2026}']).collect();
        }
        let (middle, half) = ((level as f64 + 0.5) * room_per_label_px, 0.5 * CHARACTER * length as f64);
        if middle - half < end + GAP {
            return String::new();
        }
        end = middle + half;
        label.clone()
    });
    each.collect()
}

/// The main effect of each dimension on a figure, as pictures.
fn draw_main_effects_html(study: &Study, dimensions: &[CubeDimension], found: &EffectAnalysis) -> String {
    let means = || found.main.iter().flat_map(|own| own.levels.iter().filter_map(|(_, mean)| *mean));
    let (least, most) = (means().fold(f64::INFINITY, f64::min), means().fold(f64::NEG_INFINITY, f64::max));
    let span = if most > least { most - least } else { 1.0 };
    let (w, h) = PANEL;
    let mut html = String::from("<div class=\"effects\">\n");
    for own in &found.main {
        let dimension = &dimensions[own.dimension];
        #[expect(clippy::cast_precision_loss, reason = "a few levels")]
        let room = (w - BESIDE - 18.0) / own.levels.len() as f64;
        #[expect(clippy::cast_precision_loss, reason = "a few levels")]
        let x = |level: usize| BESIDE + 4.0 + room * (level as f64 + 0.5);
        let y = |mean: f64| 12.0 + (h - 40.0) * (1.0 - (mean - least) / span);
        let _ = write!(
            html,
            "<figure>\n<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" role=\"img\">\n\
             <path class=\"axis\" d=\"M{BESIDE} 8V{0:.0}H{1:.0}\"/>\n<text x=\"{4}\" y=\"16\" class=\"end\">{2}</text>\n\
             <text x=\"{4}\" y=\"{0:.0}\" class=\"end\">{3}</text>\n",
            h - 26.0,
            w - 8.0,
            format_four_significant_digits_or_no_value_if_nan(most),
            format_four_significant_digits_or_no_value_if_nan(least),
            BESIDE - 2.0
        );
        let points: Vec<(usize, f64)> =
            own.levels.iter().enumerate().filter_map(|(level, (_, mean))| Some((level, (*mean)?))).collect();
        let line: Vec<String> =
            points.iter().map(|(level, mean)| format!("{:.1},{:.1}", x(*level), y(*mean))).collect();
        let _ = writeln!(html, "<polyline class=\"effect\" points=\"{}\"/>", line.join(" "));
        let names: Vec<String> = (0..own.levels.len())
            .map(|level| label_of_level(study, dimension, own.dimension, &own.cut, level))
            .collect();
        let below = shorten_words_and_omit_crowded_numbers(&names, room);
        for (level, mean) in points {
            let _ = writeln!(
                html,
                "<circle class=\"effect\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\"><title>{}: mean {}, {} \
                 designs</title></circle>\n\
                 <text x=\"{:.1}\" y=\"{:.0}\" class=\"middle\">{}</text>",
                x(level),
                y(mean),
                escape_html(&names[level]),
                format_four_significant_digits_or_no_value_if_nan(mean),
                own.levels[level].0,
                x(level),
                h - 14.0,
                escape_html(&below[level])
            );
        }
        let _ = writeln!(
            html,
            "</svg>\n<figcaption>{}: {:.1} % (chance {:.1} %)</figcaption>\n</figure>",
            escape_html(&dimension.name),
            100.0 * own.part,
            100.0 * own.by_chance
        );
    }
    html.push_str("</div>\n");
    html
}

/// The largest interactions of two dimensions, as pictures.
fn draw_largest_interactions_html(study: &Study, dimensions: &[CubeDimension], found: &EffectAnalysis) -> String {
    let mut order: Vec<&Interaction> = found.pairs.iter().filter(|pair| pair.part > 0.0).collect();
    order.sort_by(|a, b| {
        (b.part - b.by_chance).total_cmp(&(a.part - a.by_chance)).then(a.dimensions.cmp(&b.dimensions))
    });
    if order.is_empty() {
        return String::new();
    }
    let mut html = String::from("<div class=\"effects\">\n");
    for pair in order.into_iter().take(MOST_PAIRS) {
        let means = || pair.means.iter().flatten().filter_map(|mean| *mean);
        let (least, most) = (means().fold(f64::INFINITY, f64::min), means().fold(f64::NEG_INFINITY, f64::max));
        let [i, j] = pair.dimensions;
        let (one, other) = (&dimensions[i], &dimensions[j]);
        let (w, h) = PANEL;
        #[expect(clippy::cast_precision_loss, reason = "a few levels")]
        let (cell_w, cell_h) =
            ((w - 8.0) / pair.means.len() as f64, (h - 8.0) / pair.means.first().map_or(1, Vec::len) as f64);
        let _ = writeln!(html, "<figure>\n<svg viewBox=\"0 0 {w} {h}\" width=\"{w}\" role=\"img\">");
        for (a, row) in pair.means.iter().enumerate() {
            for (b, mean) in row.iter().enumerate() {
                let Some(mean) = mean else { continue };
                let part = if most > least { (mean - least) / (most - least) } else { 0.5 };
                #[expect(clippy::cast_precision_loss, reason = "a few levels")]
                let (x, y) = (4.0 + a as f64 * cell_w, 4.0 + b as f64 * cell_h);
                let _ = writeln!(
                    html,
                    "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{cell_w:.1}\" height=\"{cell_h:.1}\" fill=\"{}\"><title>{} {}, {} {}: \
                     {}</title></rect>",
                    color_of_fraction(part),
                    escape_html(&one.name),
                    escape_html(&label_of_level(study, one, i, &found.main[i].cut, a)),
                    escape_html(&other.name),
                    escape_html(&label_of_level(study, other, j, &found.main[j].cut, b)),
                    format_four_significant_digits_or_no_value_if_nan(*mean)
                );
            }
        }
        let _ = writeln!(
            html,
            "</svg>\n<figcaption>{} (horizontal) and {} (vertical): {:.1} % (chance {:.1} %), means {} to \
             {}</figcaption>\n</figure>",
            escape_html(&one.name),
            escape_html(&other.name),
            100.0 * pair.part,
            100.0 * pair.by_chance,
            format_four_significant_digits_or_no_value_if_nan(least),
            format_four_significant_digits_or_no_value_if_nan(most)
        );
    }
    html.push_str("</div>\n");
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_levels_do_not_meet() {
        let below = |names: &[&str], room: f64| {
            shorten_words_and_omit_crowded_numbers(&names.iter().map(|own| (*own).to_owned()).collect::<Vec<_>>(), room)
        };
        assert_eq!(below(&["38", "94", "150", "206", "262"], 26.8), ["38", "94", "150", "206", "262"]);
        // One that has no room is left out, and the next one has.
        assert_eq!(below(&["659.8", "1149", "2000"], 26.8), ["659.8", "", "2000"]);
        assert_eq!(below(&["aluminium", "glass"], 40.0), ["alumi\u{2026}", "glass"]);
        assert_eq!(
            ["38.00", "100", "0.250", "1200"].map(|text| trim_trailing_zeros(text.into())),
            ["38", "100", "0.25", "1200"]
        );
    }
}

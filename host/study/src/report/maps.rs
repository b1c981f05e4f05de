//! Maps of the strongest peak at every point: the scene as it is beside the best design.

use super::{escape_html, format_four_significant_digits_or_no_value_if_nan};
use crate::evaluate::VerifiedFigures;
use crate::result::{Finalist, VerifiedFinalists};
use crate::run::Study;
use std::fmt::Write;

/// Longer side of a map in pixels.
const SIDE: f64 = 460.0;
/// Least height, for bars.
const LEAST_HEIGHT: f64 = 60.0;
/// Steps of the colour scale; areas of one colour are drawn as one.
const BANDS: f64 = 24.0;
/// The colour scale, from dark to light (viridis, at equal steps).
const COLORS: [[f64; 3]; 6] = [
    [68.0, 1.0, 84.0],
    [65.0, 68.0, 135.0],
    [42.0, 120.0, 142.0],
    [34.0, 168.0, 132.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
];

/// The maps of the scene of the file and of the best design side by side, as HTML.
pub(super) fn write_peak_maps_of_base_and_best_html(study: &Study, finals: &VerifiedFinalists) -> String {
    let Some(best) = finals.best.first() else { return "<p>There is no best design.</p>\n".into() };
    let both: Vec<(&str, &Finalist, &VerifiedFigures)> = [("unchanged scene", &finals.base), ("best 1", best)]
        .into_iter()
        .filter_map(|(name, own)| Some((name, own, own.verified.as_ref().ok()?)))
        .collect();
    let peaks = || both.iter().flat_map(|(_, _, verified)| verified.strongest_g.iter().flatten().copied());
    let (least, most) = (peaks().fold(f64::INFINITY, f64::min), peaks().fold(0.0, f64::max));
    if !study.figures.iter().any(|wanted| wanted.figure.is_evaluated_at_weakest_place()) {
        return "<p>There is no map: no wish and no limit depends on the largest possible peak at each place.</p>\n"
            .into();
    }
    if !(least > 0.0 && most > least) {
        return "<p>There is no map: the peaks are not known, are equal everywhere, or are 0 at some place.</p>\n"
            .into();
    }
    let mut html = format!(
        "<p>The maps show the largest possible peak at each place if frequencies, amplitudes and phases are chosen \
         for this place. The scale is logarithmic, from {} g (dark) to {} g (light). Circles are actuators, squares \
         are supports, and the cross is the weakest place (the place with the smallest of these peaks).</p>\n\
         <div class=\"maps\">\n",
        format_four_significant_digits_or_no_value_if_nan(least),
        format_four_significant_digits_or_no_value_if_nan(most)
    );
    for (name, own, verified) in &both {
        let weakest = verified.strongest_g.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let _ = write!(html, "<figure>\n{}", draw_peak_map_svg(study, own, verified, (least, most)));
        let _ = writeln!(
            html,
            "<figcaption>{}: {} g at the weakest place</figcaption>\n</figure>",
            escape_html(name),
            format_four_significant_digits_or_no_value_if_nan(weakest)
        );
    }
    html.push_str("</div>\n");
    html
}

/// A map of the strongest peaks as SVG, with supports, actuators and the weakest place.
fn draw_peak_map_svg(
    study: &Study,
    finalist: &Finalist,
    verified: &VerifiedFigures,
    (least, most): (f64, f64),
) -> String {
    let Ok(scene) = study.space.parse_scene_text(&finalist.text) else { return String::new() };
    let (length, width) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    let scale = SIDE / length.max(width);
    let (w, h) = (length * scale, (width * scale).max(LEAST_HEIGHT));
    let up = if verified.y_mm.len() < 2 { 0.0 } else { h / width };
    let mut svg =
        format!("<svg viewBox=\"-8 -8 {:.0} {:.0}\" width=\"{:.0}\" role=\"img\">\n", w + 16.0, h + 16.0, w + 16.0);
    let (x, y) =
        (cell_borders_between_lines(&verified.x_mm, length), cell_borders_between_lines(&verified.y_mm, width));
    let columns = verified.x_mm.len();
    for (j, row) in verified.strongest_g.chunks(columns.max(1)).enumerate() {
        let (top, bottom) =
            if up > 0.0 { (round_to_tenths(y[j] * up), round_to_tenths(y[j + 1] * up)) } else { (0.0, h) };
        let band = |peak: Option<f64>| {
            peak.map(|peak| ((peak / least).ln() / (most / least).ln() * BANDS).floor().min(BANDS - 1.0))
        };
        let mut from = 0;
        while from < columns {
            let band_here = band(row[from]);
            let to = (from..columns).find(|k| band(row[*k]) != band_here).unwrap_or(columns);
            if let Some(band_here) = band_here {
                let (left, right) = (round_to_tenths(x[from] * scale), round_to_tenths(x[to] * scale));
                let _ = writeln!(
                    svg,
                    "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                    right - left,
                    bottom - top,
                    color_of_fraction((band_here + 0.5) / BANDS)
                );
            }
            from = to;
        }
    }
    let at = |x_m: f64, y_m: f64| (x_m * 1e3 * scale, if up > 0.0 { y_m * 1e3 * up } else { h / 2.0 });
    for support in &scene.supports {
        let (x, y) = at(support.x_m, support.y_m);
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"8\" height=\"8\" class=\"support\"/>",
            x - 4.0,
            y - 4.0
        );
    }
    for actuator in &scene.actuators {
        let (x, y) = at(actuator.x_m, actuator.y_m);
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\" class=\"actuator\"><title>{}</title></circle>",
            escape_html(&actuator.id)
        );
    }
    let places = verified.strongest_g.iter().enumerate().filter_map(|(k, peak)| Some((k, (*peak)?)));
    if let Some((k, _)) = places.min_by(|a, b| a.1.total_cmp(&b.1)) {
        let (x, y) = at(verified.x_mm[k % columns] / 1e3, verified.y_mm[k / columns] / 1e3);
        let _ = writeln!(svg, "<path d=\"M{:.1} {:.1}l12 12m0 -12l-12 12\" class=\"weakest\"/>", x - 6.0, y - 6.0);
    }
    svg.push_str("</svg>\n");
    svg
}

/// In tenths of a pixel, as it is written: rounded sizes would leave gaps between rounded corners.
fn round_to_tenths(coordinate_px: f64) -> f64 {
    (10.0 * coordinate_px).round() / 10.0
}

/// The borders of the areas that a grid's lines stand for.
fn cell_borders_between_lines(lines_mm: &[f64], side_mm: f64) -> Vec<f64> {
    let between = lines_mm.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
    std::iter::once(0.0).chain(between).chain(std::iter::once(side_mm)).collect()
}

/// The colour of a fraction, 0 to 1, of the scale.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "parts of 255, and of a short list")]
pub(super) fn color_of_fraction(fraction: f64) -> String {
    let at = fraction.clamp(0.0, 1.0) * 5.0;
    let first = (at as usize).min(COLORS.len() - 2);
    let rest = at - first as f64;
    let mixed = |k: usize| (COLORS[first][k] * (1.0 - rest) + COLORS[first + 1][k] * rest).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(0), mixed(1), mixed(2))
}

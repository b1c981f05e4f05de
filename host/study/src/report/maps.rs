//! Maps of the strongest peak at every point: the scene as it is beside the best design.

use super::{escaped, shown};
use crate::evaluate::Verified;
use crate::result::{Finalist, Finals};
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

pub(super) fn side_by_side(study: &Study, finals: &Finals) -> String {
    let Some(best) = finals.best.first() else { return "<p>There is no best design.</p>\n".into() };
    let both: Vec<(&str, &Finalist, &Verified)> = [("as it is", &finals.base), ("best 1", best)]
        .into_iter()
        .filter_map(|(name, own)| Some((name, own, own.verified.as_ref().ok()?)))
        .collect();
    let peaks = || both.iter().flat_map(|(_, _, verified)| verified.strongest_g.iter().flatten().copied());
    let (least, most) = (peaks().fold(f64::INFINITY, f64::min), peaks().fold(0.0, f64::max));
    if !study.figures.iter().any(|wanted| wanted.figure.is_of_settings()) {
        return "<p>There is no map: nothing that is wanted depends on what can be had at each place.</p>\n".into();
    }
    if !(least > 0.0 && most > least) {
        return "<p>There is no map.</p>\n".into();
    }
    let mut html = format!(
        "<p>The strongest peak that can be had at each place, with a setting for every touch, from {} g (dark) to {} g (light), \
         colours by ratio; circles are actuators, squares supports, the cross is the weakest place.</p>\n<div class=\"maps\">\n",
        shown(least),
        shown(most)
    );
    for (name, own, verified) in &both {
        let weakest = verified.strongest_g.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let _ = write!(html, "<figure>\n{}", map(study, own, verified, (least, most)));
        let _ = writeln!(
            html,
            "<figcaption>{}: {} g at the weakest place</figcaption>\n</figure>",
            escaped(name),
            shown(weakest)
        );
    }
    html.push_str("</div>\n");
    html
}

fn map(study: &Study, own: &Finalist, verified: &Verified, (least, most): (f64, f64)) -> String {
    let Ok(scene) = study.space.read(&own.text) else { return String::new() };
    let (length, width) = (scene.surface.length_m * 1e3, scene.surface.width_m * 1e3);
    let scale = SIDE / length.max(width);
    let (w, h) = (length * scale, (width * scale).max(LEAST_HEIGHT));
    let up = if verified.y_mm.len() < 2 { 0.0 } else { h / width };
    let mut svg =
        format!("<svg viewBox=\"-8 -8 {:.0} {:.0}\" width=\"{:.0}\" role=\"img\">\n", w + 16.0, h + 16.0, w + 16.0);
    let (x, y) = (borders(&verified.x_mm, length), borders(&verified.y_mm, width));
    let columns = verified.x_mm.len();
    for (j, row) in verified.strongest_g.chunks(columns.max(1)).enumerate() {
        let (top, bottom) = if up > 0.0 { (tenths(y[j] * up), tenths(y[j + 1] * up)) } else { (0.0, h) };
        let band = |peak: Option<f64>| {
            peak.map(|peak| ((peak / least).ln() / (most / least).ln() * BANDS).floor().min(BANDS - 1.0))
        };
        let mut from = 0;
        while from < columns {
            let own = band(row[from]);
            let to = (from..columns).find(|k| band(row[*k]) != own).unwrap_or(columns);
            if let Some(own) = own {
                let (left, right) = (tenths(x[from] * scale), tenths(x[to] * scale));
                let _ = writeln!(
                    svg,
                    "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{}\"/>",
                    right - left,
                    bottom - top,
                    color((own + 0.5) / BANDS)
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
            escaped(&actuator.id)
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
fn tenths(at: f64) -> f64 {
    (10.0 * at).round() / 10.0
}

/// The borders of the areas that a grid's lines stand for.
fn borders(lines_mm: &[f64], side_mm: f64) -> Vec<f64> {
    let between = lines_mm.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
    std::iter::once(0.0).chain(between).chain(std::iter::once(side_mm)).collect()
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "parts of 255, and of a short list")]
pub(super) fn color(part: f64) -> String {
    let at = part.clamp(0.0, 1.0) * 5.0;
    let first = (at as usize).min(COLORS.len() - 2);
    let rest = at - first as f64;
    let mixed = |k: usize| (COLORS[first][k] * (1.0 - rest) + COLORS[first + 1][k] * rest).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(0), mixed(1), mixed(2))
}

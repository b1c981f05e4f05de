//! The plot of what accuracy costs.

use crate::error::Error;
use crate::tradeoff::TimeErrorAndBound;
use plotters::prelude::*;
use std::path::Path;

/// Writes a plot of the times of responses and modes over error and bound, as SVG.
///
/// # Errors
/// [`Error::Plot`].
pub fn write_accuracy_cost_svg(
    path: &Path,
    responses: &[TimeErrorAndBound],
    modes: &[TimeErrorAndBound],
) -> Result<(), Error> {
    draw_accuracy_cost_svg(path, responses, modes)
        .map_err(|error| Error::Plot { path: path.to_path_buf(), reason: error.to_string() })
}

fn draw_accuracy_cost_svg(
    path: &Path,
    responses: &[TimeErrorAndBound],
    modes: &[TimeErrorAndBound],
) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::new(path, (760, 460)).into_drawing_area();
    root.fill(&WHITE)?;
    let times = responses.iter().chain(modes).map(|point| point.time_s * 1e3);
    let (least, most) = times.fold((f64::INFINITY, 0.0_f64), |(least, most), ms| (least.min(ms), most.max(ms)));
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(62)
        .caption("Accuracy and time, scene to answer", ("sans-serif", 18))
        .build_cartesian_2d((1e-11_f64..1e-1).log_scale(), (0.5 * least..2.0 * most).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("relative error (dots), bound (circles)")
        .y_desc("time in ms")
        .x_label_formatter(&|x| format!("{x:.0e}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .light_line_style(WHITE)
        .draw()?;
    let series = [
        ("951 responses of the starting plate", responses, RGBColor(31, 90, 160)),
        ("modes of nine reference panels", modes, RGBColor(190, 80, 20)),
    ];
    for (name, points, colour) in series {
        let errors: Vec<_> = points.iter().map(|point| (point.error.max(1e-11), point.time_s * 1e3)).collect();
        let bounds: Vec<_> = points
            .iter()
            .filter(|point| point.bound.is_finite())
            .map(|point| (point.bound.clamp(1e-11, 1e-1), point.time_s * 1e3))
            .collect();
        chart
            .draw_series(LineSeries::new(errors.clone(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(errors.iter().map(|at| Circle::new(*at, 4, colour.filled())))?;
        chart.draw_series(LineSeries::new(bounds.clone(), colour.mix(0.4)))?;
        chart.draw_series(bounds.iter().map(|at| Circle::new(*at, 4, colour.stroke_width(1))))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    root.present()?;
    Ok(())
}

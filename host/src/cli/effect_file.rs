//! `era effect --file`: what is read of an effect file, and what a panel makes of it. `era touch --file`: the daemon plays it.

use super::args::Touch;
use super::args_effect::EffectOptions;
use super::client::request_body_failing_on_error_status;
use super::panel::{make_target_from_at_and_intensity_options, prepare_table_with_scene_finger_if_any_at_places};
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::effect_files::motion::{RATE_HZ, format_csv, format_wav, sample_acceleration_g};
use crate::effect_files::panel::{PanelEffectError, PartKind, ScaleView, design_parts_for_panel, place_of_part_m};
use crate::effect_files::parts::cut_events_into_parts;
use crate::effect_files::view::{PartView, ReadingView};
use crate::effect_files::{FileFormat, ReadError, detect_format, read_effect_bytes};
use crate::effects::DesignError;
use crate::maps::over_time::write_accelerations_png;
use crate::planner::DEFAULT_INTENSITY_G;
use crate::planner::rise::PanelPoles;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use era_files::{Readers, replace_file};
use serde_json::{Value, json};
use std::fmt::Write;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of a file that are sent to the daemon: in base64 they are 512 KiB, beside which a body has 16 KiB for its other keys.
const MAX_SENT_BYTES: usize = 384 * 1024;
/// Parts that are printed as text.
const PRINTED_PARTS: usize = 40;

impl From<PanelEffectError> for Failure {
    fn from(error: PanelEffectError) -> Self {
        match error {
            PanelEffectError::Plan(error) => error.into(),
            PanelEffectError::Offset { .. } => Failure::usage_error(error),
            PanelEffectError::Design(error) => Failure::runtime_error(error),
        }
    }
}

pub fn design_effect_file_for_panel_print_and_export_if_asked(options: &EffectOptions, path: &Path) -> CommandResult {
    let scene = options.panel.load_scene()?;
    let named = |error: ReadError| Failure::usage_error(format!("{}: {error}", path.display()));
    let list = read_effect_bytes(&read_file_cut_one_byte_over_limit(path)?, options.from_file.format).map_err(named)?;
    let (parts, warnings) = cut_events_into_parts(&list).map_err(named)?;
    let target = make_target_from_at_and_intensity_options(&scene, &options.at)?;
    let touched_m = (target.x_m, target.y_m);
    let mut places_m: Vec<(f64, f64)> = parts.iter().map(|part| place_of_part_m(part, touched_m)).collect();
    places_m.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    places_m.dedup();
    let table = prepare_table_with_scene_finger_if_any_at_places(&options.panel, options.keep, &scene, &places_m)?;
    let poles = PanelPoles::find_poles_if_converged(&table.model)
        .ok_or(DesignError::Unbounded)
        .map_err(Failure::runtime_error)?;
    let asked_g = options.at.intensity_g.unwrap_or(DEFAULT_INTENSITY_G);
    let effect = design_parts_for_panel(&table, &poles, &parts, (touched_m, asked_g), true)?;
    if let Some(export) = &options.from_file.export {
        let samples = sample_acceleration_g(&table, &poles, &effect)
            .ok_or(DesignError::Unbounded)
            .map_err(Failure::runtime_error)?;
        let places_mm: Vec<(f64, f64)> = effect.places.iter().map(|place| (1e3 * place.x_m, 1e3 * place.y_m)).collect();
        let title = format!("{}: {}", table.scene.name, path.display());
        write_accelerations_as_png_csv_or_wav_by_extension(export, &title, &places_mm, &samples)?;
    }
    let view = ReadingView::new(&list, &warnings, &effect);
    if options.json {
        let mut answer = json!(view);
        answer["events"] = json!(list.events);
        return print_json(&answer);
    }
    print_text_after_queued_log(&format_effect_file_report(path, &view))
}

/// Lets the daemon play a file at the touched place.
pub fn play_effect_file_through_daemon_and_print_answer(options: &Touch, path: &Path) -> CommandResult {
    let bytes = read_file_cut_one_byte_over_limit(path)?;
    let named = |error: ReadError| Failure::usage_error(format!("{}: {error}", path.display()));
    let format = options.format.map_or_else(|| detect_format(&bytes), Ok).map_err(named)?;
    let max = format.max_bytes().min(MAX_SENT_BYTES);
    if bytes.len() > max {
        return Err(named(ReadError::TooLarge { bytes: bytes.len(), format, max }));
    }
    let mut body =
        json!({"x_px": options.x_px, "y_px": options.y_px, "format": format, "file_base64": BASE64.encode(&bytes)});
    if let Some(intensity_g) = options.intensity_g {
        body["intensity_g"] = json!(intensity_g);
    }
    let answer = request_body_failing_on_error_status(&options.daemon, "POST", "/v1/effects", Some(body))?;
    if options.daemon.json {
        return print_json(&answer);
    }
    print_text_after_queued_log(&format_played_effect_file(path, &answer))
}

fn format_played_effect_file(path: &Path, answer: &Value) -> String {
    let parts = answer["parts"].as_array().map_or(&[][..], Vec::as_slice);
    let peak_g = parts.iter().filter_map(|part| part["peak_g"].as_f64()).fold(0.0, f64::max);
    let mut text = format!(
        "{}: {} events, duration {:.0} ms; the board plays these events as {} parts, and the strongest part has a \
        predicted peak of {peak_g:.3} g",
        answer["name"].as_str().map_or_else(|| path.display().to_string(), str::to_owned),
        answer["event_count"].as_u64().unwrap_or(0),
        answer["duration_ms"].as_f64().unwrap_or(f64::NAN),
        parts.len(),
    );
    for warning in answer["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        let _ = write!(text, "\nwarning: {warning}");
    }
    text
}

/// A file, unless it is larger than any format allows.
fn read_file_cut_one_byte_over_limit(path: &Path) -> Result<Vec<u8>, Failure> {
    let failed = |error: std::io::Error| Failure::runtime_error(format!("cannot read {}: {error}", path.display()));
    let mut bytes = Vec::new();
    // One byte more shows that it is too large.
    let most = FileFormat::MOST_BYTES as u64 + 1;
    File::open(path).map_err(failed)?.take(most).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Writes the accelerations in g of some places, with [`RATE_HZ`] samples a second.
pub fn write_accelerations_as_png_csv_or_wav_by_extension(
    output_path: &Path,
    title: &str,
    places_mm: &[(f64, f64)],
    samples_g: &[Vec<f64>],
) -> CommandResult {
    let extension = output_path.extension().map(|own| own.to_ascii_lowercase()).unwrap_or_default();
    if extension == "png" {
        let names = places_mm.iter().map(|(x_mm, y_mm)| format!("{x_mm:.1} mm, {y_mm:.1} mm"));
        let curves: Vec<(String, &[f64])> = names.zip(samples_g.iter().map(Vec::as_slice)).collect();
        let rate_hz = f64::from(RATE_HZ);
        return write_accelerations_png(output_path, title, rate_hz, &curves)
            .map(|_| ())
            .map_err(Failure::runtime_error);
    }
    let bytes = if extension == "csv" {
        format_csv(places_mm, samples_g).into_bytes()
    } else {
        format_wav(samples_g).map_err(Failure::runtime_error)?
    };
    replace_file(output_path, Readers::ByUmask, &bytes)
        .map_err(|error| Failure::runtime_error(format!("cannot write {}: {error}", output_path.display())))
}

fn format_effect_file_report(path: &Path, view: &ReadingView) -> String {
    let mut text = format!(
        "{}: {} events in {:.0} ms, file format {}",
        view.name.clone().unwrap_or_else(|| path.display().to_string()),
        view.event_count,
        view.duration_ms,
        view.format
    );
    for (i, place) in view.places.iter().enumerate() {
        let _ = write!(text, "\nplace {i}: {:.1} mm, {:.1} mm", place.x_mm, place.y_mm);
    }
    for scale in &view.scales {
        let _ = write!(text, "\n  {}", describe_peak_at_full_intensity_of_part_kind(scale));
    }
    let _ = write!(
        text,
        "\n{:>10} {:>9} {:>6}  {:9} {:>9} {:>9} {:>8}",
        "begin ms", "length ms", "place", "kind", "intensity", "sharpness", "peak g"
    );
    for part in view.parts.iter().take(PRINTED_PARTS) {
        let PartView { begin_ms, duration_ms, place, kind, intensity, sharpness, peak_g, limited_by, .. } = part;
        let limit = limited_by.as_ref().map(|limit| format!("  limited by {limit}")).unwrap_or_default();
        let _ = write!(
            text,
            "\n{begin_ms:>10} {duration_ms:>9.1} {place:>6}  {:9} {intensity:>9.2} {sharpness:>9.2} {peak_g:>8.3}{limit}",
            kind.name()
        );
    }
    if view.parts.len() > PRINTED_PARTS {
        let _ = write!(text, "\n{} more parts; --json prints all parts", view.parts.len() - PRINTED_PARTS);
    }
    for warning in &view.warnings {
        let _ = write!(text, "\nwarning: {warning}");
    }
    text
}

fn describe_peak_at_full_intensity_of_part_kind(scale: &ScaleView) -> String {
    let ScaleView { kind, asked_g, peak_g, limited_by, quiet_ms, frequencies_hz, .. } = scale;
    let sharpness = match kind {
        PartKind::Tick => "sharpness 0.67 to 1",
        PartKind::Click => "sharpness 0.33 to 0.67",
        PartKind::Thud => "sharpness 0 to 0.33",
        PartKind::Envelope => "any sharpness",
    };
    let mut text =
        format!("{:9} ({sharpness}): intensity 1 gives {peak_g:.3} g of the requested {asked_g} g", kind.name());
    if let Some(quiet_ms) = quiet_ms {
        let _ = write!(text, ", quiet after {quiet_ms:.1} ms");
    }
    let frequencies: Vec<String> = frequencies_hz.iter().map(|hz| format!("{hz:.0}")).collect();
    if !frequencies.is_empty() {
        let _ = write!(text, ", at {} Hz", frequencies.join(" and "));
    }
    if let Some(limit) = limited_by {
        let _ = write!(text, ", limited by {limit}");
    }
    text
}

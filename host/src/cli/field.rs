//! The command `field`: a touch over the surface.

use super::args::At;
use super::args_field::Field;
use super::output::write_text_file;
use super::panel::{target, tell_missing, tell_plan, touched_table};
use super::progress::with_progress;
use super::told::tell;
use super::{Failure, Outcome, print_json, print_text, reach};
use crate::design::tolerances;
use crate::model::Bound;
use crate::study;
use serde_json::json;

/// Runs it.
pub fn run_field(options: &Field) -> Outcome {
    let at = match options.at {
        _ if options.reach => return reach::write_maps(options),
        _ if options.schemes => return reach::compare_schemes(options),
        Some(at) => At { at, unit: options.unit, intensity_g: options.intensity_g },
        None => return Err(Failure::usage("--at X,Y, --reach or --schemes is needed")),
    };
    let scene = options.panel.load()?;
    let target = target(&scene, &at)?;
    let touched = [(target.x_m, target.y_m)];
    let table = touched_table(&options.panel, options.keep, &scene, &touched)?;
    let plan = table.plan(&[target])?;
    let field = study::Field::of(&table, &plan);
    let bound = crate::planner::plan::bound_field_error(&table, &plan);
    let accuracy = options.panel.accuracy()?;
    tell_missing(&[bound], accuracy);
    tell_plan(&[&plan], accuracy, options.panel.explain);
    if let Some(path) = &options.png {
        reach::tell_written(path, study::write_png(path, &scene, &plan, &field).map_err(Failure::failed)?);
    }
    if let (Some(bound), false) = (bound.known_limit(), options.json) {
        tell!("error at most {bound:.0e} of the largest value");
    }
    let to_output = options.csv.as_ref().is_some_and(|path| path.as_os_str() == "-");
    if let Some(path) = options.csv.as_ref().filter(|_| !to_output) {
        write_text_file(path, &field.csv())?;
    }
    let off = options.spread.map(|off| {
        let looked = || tolerances::compute_tolerance_spread(&scene, &touched, &plan, off);
        with_progress("computing panels within the tolerances", looked).map_err(Failure::failed)
    });
    let off = off.transpose()?;
    if options.json {
        let mut map = json!(field);
        // As the daemon's.
        (map["nx"], map["ny"]) = (json!(field.x_mm.len()), json!(field.y_mm.len()));
        map["max_g"] = json!(field.peak_g.iter().flatten().copied().fold(0.0, f64::max));
        let mut answer = json!({
            "plan": plan, "field": map, "error_bound": bound.known_limit(), "tolerance": accuracy.relative_tolerance(),
            "tolerance_met": Bound::all_meet_accuracy(&[bound], accuracy),
        });
        if let Some(off) = off {
            answer["off"] = json!(off);
        }
        return print_json(&answer);
    }
    if let Some(off) = off {
        tell!("{}", off.describe_in_words());
    }
    if to_output || options.png.is_none() && options.csv.is_none() {
        return print_text(field.csv().trim_end());
    }
    Ok(())
}

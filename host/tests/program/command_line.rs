//! The program as it is called: what is warned about, refused, and written to files.

use crate::support::program::{build_era_command, make_scratch_path, run_command, run_era, run_era_json};
use serde_json::Value;

/// Thin-plate theory ends somewhere: the number is said, and the answer given all the same.
#[test]
fn a_thick_panel_is_warned_about_with_its_number() {
    let scene = |thickness_mm: &str| {
        let text = era::scene::STARTING_PLATE.replace("thickness_mm = 2.0", &format!("thickness_mm = {thickness_mm}"));
        let file = make_scratch_path(&format!("thick-{thickness_mm}.toml"));
        std::fs::write(&file, text).unwrap();
        file.display().to_string()
    };
    // Nothing holds an edge, so that the longer side bends: 15 mm of 300 mm is 0.050; 9 mm is 0.030, under 1/30.
    let (thick, thin) = (run_era(&["modes", "--scene", &scene("15.0")]), run_era(&["modes", "--scene", &scene("9.0")]));
    assert!(thick.is_success() && thick.error.contains("0.050"), "{}", thick.error);
    assert!(thin.is_success() && !thin.error.contains("thickness"), "{}", thin.error);
}

/// What is refused is not computed, and not warned about; and what is told to a file has no colours in it.
#[test]
fn what_is_refused_is_not_warned_about() {
    let refused = run_era(&["modes", "--max-hz", "1e9"]);
    let text = &refused.error;
    assert!(refused.code == Some(2) && !text.contains("WARN") && text.contains("error:"), "{text}");
    let thick = run_era(&["modes", "--max-hz", "20000", "--accuracy", "fast"]);
    assert!(thick.error.contains("WARN") && !thick.error.contains('\x1b'), "{}", thick.error);
}

/// What a newcomer types first, and gets wrong: the daemon's option without its command, a modulus in GPa where Pa is meant.
#[test]
fn first_mistakes_are_answered_with_what_would_do() {
    let output = run_era(&["--listen", "127.0.0.1:0"]);
    let text = &output.error;
    assert!(output.code == Some(2) && text.contains("era serve --listen"), "{text}");
    let soft = era::scene::STARTING_PLATE.replace("youngs_modulus_pa = 69e9", "youngs_modulus_pa = 69");
    let file = make_scratch_path("soft.toml");
    std::fs::write(&file, soft).unwrap();
    let text = run_era(&["modes", "--scene", &file.display().to_string()]).error;
    assert!(text.contains("check that youngs_modulus_pa is correct and in Pa"), "{text}");
}

/// The array's numbers are those of `era response`, and the header is what NumPy reads.
#[test]
fn a_sweep_is_written_for_numpy() {
    let file = make_scratch_path("sweep.npy");
    let band = ["--from", "100", "--to", "300", "--step", "10"];
    let name = file.display().to_string();
    let told = run_era_json(&[&["sweep", "--grid", "7,5", "--npy", &name, "--json"], &band[..]].concat());
    assert_eq!((&told["points"], &told["frequencies"]), (&Value::from(35), &Value::from(21)));
    let bytes = std::fs::read(&file).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((10 + length) % 64, 0);
    let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
    assert!(header.contains("'<c8'") && header.contains("(21, 2, 5, 7") && header.ends_with('\n'), "{header}");
    let values: Vec<f32> =
        bytes[10 + length..].chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    assert_eq!(values.len(), 2 * 21 * 2 * 35);
    // Third row, fifth column: 200 mm, 100 mm.
    let curve = run_era_json(&[&["response", "--at", "200,100", "--json"], &band[..]].concat());
    for (actuator, response) in curve["actuators"].as_array().unwrap().iter().enumerate() {
        let part =
            |key: &str| response[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
        let (re, im) = (part("acceleration_re"), part("acceleration_im"));
        let peak = re.iter().zip(&im).map(|(re, im)| re.hypot(*im)).fold(0.0, f64::max);
        for k in 0..21 {
            let at = 2 * ((k * 2 + actuator) * 35 + 2 * 7 + 4);
            let difference = (f64::from(values[at]) - re[k]).hypot(f64::from(values[at + 1]) - im[k]);
            assert!(difference < 2e-3 * peak, "actuator {actuator}, frequency {k}: {difference} of {peak}");
        }
    }
}

/// The sound of a click is a figure of clicks alone.
#[test]
fn a_click_has_a_sound() {
    let effect =
        |name: &str| run_era_json(&["effect", name, "--at", "100,60", "--unit", "mm", "--accuracy", "fast", "--json"]);
    let click = effect("click");
    let sound_db = click["predicted"]["sound_db"].as_f64().unwrap();
    assert!((-60.0..60.0).contains(&sound_db), "{sound_db}");
    let buzz = effect("buzz");
    assert!(buzz["predicted"]["sound_db"].is_null() && buzz["predicted"]["peak_g"].is_f64(), "{}", buzz["predicted"]);
    let output = run_era(&["effect", "click", "--at", "100,60", "--unit", "mm", "--accuracy", "fast"]);
    let text = &output.out;
    assert!(text.contains(&format!("sound: {sound_db:.1} dB")), "{text}");
    let contrast_db = click["predicted"]["contrast_db"].as_f64().unwrap();
    assert!(text.contains(&format!("contrast of the click: {contrast_db:.1} dB")), "{text}");
    assert!(
        buzz["predicted"]["contrast_db"].is_null() && buzz["predicted"]["crisp"].is_null(),
        "{}",
        buzz["predicted"]
    );
}

/// A click that rings for longer than was asked for says so; a crisp one does not.
#[test]
fn a_click_that_is_not_crisp_says_so() {
    let base = ["effect", "click", "--at", "960,640", "--accuracy", "fast"];
    for (crisp_ms, is_crisp) in [("45", true), ("20", false)] {
        let click = run_era_json(&[&base[..], &["--crisp-ms", crisp_ms, "--json"]].concat());
        let predicted = &click["predicted"];
        assert_eq!(predicted["crisp"], is_crisp, "{predicted}");
        assert_eq!(predicted["quiet_ms"].as_f64().unwrap() <= crisp_ms.parse().unwrap(), is_crisp, "{predicted}");
        let output = run_era(&[&base[..], &["--crisp-ms", crisp_ms]].concat());
        let text = &output.out;
        let said = format!("below a tenth of the peak within {crisp_ms} ms");
        assert_eq!(text.contains("not crisp: ") && text.contains(&said), !is_crisp, "{text}");
    }
}

#[test]
fn sweeps_that_make_no_sense_are_refused() {
    for (arguments, words) in [
        (&["--grid", "0,3"][..], &["--grid", "1 to 10000"][..]),
        (&["--grid", "9000,3000"], &["--grid", "27000000 points", "allowed"]),
        (&["--from", "0"], &["--from is 0", "above 0 Hz"]),
        (&["--to", "10"], &["--to is 10", "40 Hz (--from)"]),
        (&["--npy", "/nowhere/at/all.npy"], &["/nowhere/at/all.npy"]),
    ] {
        let output = run_era(&[&["sweep", "--step", "50"], arguments].concat());
        let told = &output.error;
        assert!(!output.is_success() && words.iter().all(|word| told.contains(word)), "{arguments:?}: {told}");
        assert!(output.out.is_empty());
    }
}

/// A script that keeps the help of a command in a file hears that it is not there.
#[test]
fn help_that_cannot_be_written_is_an_error() {
    for arguments in [&["--help"][..], &["--version"], &["plan", "--help"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = run_command(build_era_command().args(arguments).stdout(full));
        assert_eq!(output.code, Some(1), "{arguments:?}");
        assert!(output.error.contains("cannot write to standard output"), "{arguments:?}");
    }
}

#[test]
fn a_plan_table_is_kept_and_a_damaged_one_is_reported() {
    let cache = tempfile::tempdir().unwrap();
    let bar = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/scenes/bar.toml");
    let plan = |more: &[&str]| {
        let mut command = build_era_command();
        command.env("ERA_CACHE_DIR", cache.path()).args(["plan", "--at", "480,80", "--accuracy", "fast", "--json"]);
        let output = run_command(command.args(["--scene", bar]).args(more));
        let mut plan = output.parse_json();
        // The one figure that is not of the plan.
        plan.as_object_mut().unwrap().remove("elapsed_us");
        (plan, output.error)
    };
    let files = || std::fs::read_dir(cache.path()).unwrap().map(|file| file.unwrap().path()).collect::<Vec<_>>();
    let (first, _) = plan(&["--no-cache"]);
    assert!(files().is_empty());
    assert_eq!(plan(&[]).0, first);
    let [file] = &files()[..] else { panic!("{:?}", files()) };
    let bytes = std::fs::read(file).unwrap();
    let (kept, told) = plan(&[]);
    assert_eq!(kept, first);
    assert!(!told.contains("WARN"), "{told}");
    std::fs::write(file, &bytes[..1000]).unwrap();
    let (again, told) = plan(&[]);
    assert_eq!(again, first);
    assert!(told.contains(file.to_str().unwrap()) && told.contains("the table in the file has 916 bytes"), "{told}");
    assert_eq!(std::fs::read(file).unwrap().len(), bytes.len());
}

/// Groups of actuators with a frequency each were taken out.
#[test]
fn a_grouping_that_there_is_not_is_refused_with_those_that_there_are() {
    for command in [&["plan", "--at", "1,1"][..], &["touch", "1", "1"]] {
        let refused = run_era(&[command, &["--grouping", "mixed"]].concat());
        let text = &refused.error;
        assert_eq!(refused.code, Some(2), "{text}");
        assert!(
            text.contains("'mixed' for '--grouping") && text.contains("[possible values: distinct, shared]"),
            "{text}"
        );
    }
}

/// What JSON has no number for would arrive as "not given", and drive at the default.
#[test]
fn a_touch_that_is_no_number_is_refused() {
    for arguments in [
        ["touch", "960", "640", "--intensity-g", "nan"],
        ["touch", "960", "640", "--intensity-db", "inf"],
        ["touch", "960", "640", "--duration-ms", "nan"],
        ["touch", "nan", "640", "--intensity-g", "0.1"],
    ] {
        let output = run_era(&arguments);
        assert_eq!(output.code, Some(2), "{arguments:?}: {}", output.error);
        assert!(output.error.contains("is not a finite number"), "{arguments:?}: {}", output.error);
    }
}

const BAR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/scenes/bar.toml");

/// Whoever reads the table has the bound with it: a column for each actuator, as in JSON.
#[test]
fn a_response_has_its_bounds_in_the_table() {
    let arguments = ["response", "--scene", BAR, "--at", "100,10", "--from", "100", "--to", "120", "--step", "5"];
    let told = run_era_json(&[&arguments[..], &["--json"]].concat());
    let text = run_era(&arguments).out;
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(lines.len(), 6);
    assert!(lines.iter().all(|line| line.len() == 7), "{text}");
    for (number, actuator) in told["actuators"].as_array().unwrap().iter().enumerate() {
        assert_eq!(lines[0][5 + number], format!("{}_error_bound", actuator["id"].as_str().unwrap()));
        let bound = actuator["error_bound"].as_f64().unwrap();
        assert!(bound > 0.0 && bound <= told["error_bound"].as_f64().unwrap());
        for line in &lines[1..] {
            let value: f64 = line[5 + number].parse().unwrap();
            // Three digits are printed.
            assert!((value / bound - 1.0).abs() < 5.1e-3, "{value} {bound}");
        }
    }
}

/// What is not as right as was asked for is said, by every command that has a bound.
#[test]
fn a_bound_above_the_tolerance_is_reported() {
    let plan = ["plan", "--at", "480,80"];
    let field = ["field", "--at", "480,80"];
    let response = ["response", "--at", "100,10", "--from", "100", "--to", "120", "--step", "5"];
    let modes = ["modes"];
    for command in [&plan[..], &field, &response, &modes] {
        // Rounding alone is more than the tightest tolerance, but for a bar's frequencies.
        for (tolerance, is_met) in [("0.1", true), ("1e-8", command == modes)] {
            let output = run_era(
                &[command, &["--scene", BAR, "--no-cache", "--json", "--tolerance", tolerance]]
                    .concat()
                    .into_iter()
                    .filter(
                        // Of those that keep nothing there is nothing to be left.
                        |argument| *argument != "--no-cache" || ["plan", "field"].contains(&command[0]),
                    )
                    .collect::<Vec<_>>(),
            );
            let answer = output.parse_json();
            assert_eq!(answer["tolerance"], tolerance.parse::<f64>().unwrap(), "{command:?}");
            assert_eq!(answer["tolerance_met"], is_met, "{command:?} {tolerance}: {}", output.error);
            assert_eq!(output.error.contains("is above the tolerance"), !is_met, "{command:?}: {}", output.error);
        }
    }
    let explained =
        run_era(&["plan", "--at", "480,80", "--scene", BAR, "--no-cache", "--tolerance", "0.1", "--explain"]);
    assert!(
        explained.error.contains("tolerance 1e-1 met: the relative error of the target's peak is at most"),
        "{}",
        explained.error
    );
}

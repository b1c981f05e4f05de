//! Plans of the example scenes as they were recorded, asked for through the program's command line: whatever is rebuilt behind it,
//! they stay what they are.
//!
//! `ERA_RECORD=1 cargo test -p era-host --test panels golden_plans` records them again. What a change is meant to change then shows in the
//! difference of `host/tests/golden`.

use crate::support::program::{build_era_command, run_command};
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// The variable that has the plans recorded instead of compared.
const RECORD: &str = "ERA_RECORD";
/// How that is done.
const HOW: &str = "ERA_RECORD=1 cargo test -p era-host --test panels golden_plans";
/// What is not compared: times of this machine; and what else could be had, which is searched to half a per cent.
const LEFT_OUT: [&str; 2] = ["elapsed_us", "trade"];

/// Relative tolerance of frequencies. On the grid they are exact; between its points they are a parabola's vertex, to which rounding
/// does 1e-12 to 1e-10.
const FREQUENCY: f64 = 1e-9;
/// Relative tolerance of everything else. The same optimum by another order of sums differs by rounding, which resonances and
/// differences of large numbers make 1e-9, seldom 1e-8: seen with Young's moduli that differ by parts from 1e-13 to 1e-11. The least
/// change of substance, another frequency of the grid or another limit that binds, is far above this. The places below are such
/// that rounding decides nothing: with those moduli all answers stayed within these tolerances.
const RELATIVE: f64 = 1e-6;
/// The same of amplitudes in dB: 20 log10(1 + 1e-6).
const DB: f64 = 8.7e-6;
/// Relative tolerance of error bounds, which are small differences of large numbers.
const BOUND: f64 = 1e-3;
/// Differences below this are rounding of what should be nothing, in any unit: g, N, V, mm, ms.
const NOTHING: f64 = 1e-9;

/// Where a scene is touched, as `X,Y` in mm.
struct Places {
    scene: &'static str,
    /// Near the middle. In the very middle of a symmetric scene a plan is as good as its mirror image, and rounding decides.
    middle: &'static str,
    edge: &'static str,
    corner: &'static str,
    off_axis: &'static str,
    other: &'static str,
    spared: &'static str,
    /// `X0,Y0,X1,Y1`: what counts for the reach, not symmetric either.
    zone: &'static str,
}

impl Places {
    /// What is asked, by name.
    fn requests(&self) -> Vec<(&'static str, Vec<String>)> {
        let Self { middle, edge, corner, off_axis, other, spared, zone, .. } = self;
        let (also, quiet) = (format!("{other}:0.1"), format!("{spared}:12.5:0.02"));
        let asked: [(&str, &str, &[&str]); 10] = [
            ("in the middle", middle, &[]),
            ("at an edge", edge, &[]),
            ("weak, in a corner", corner, &["--intensity-g", "0.1"]),
            ("out of reach", off_axis, &["--intensity-g", "5"]),
            ("two targets", off_axis, &["--intensity-g", "0.2", "--also", &also]),
            ("a quiet zone", off_axis, &["--intensity-g", "0.2", "--quiet", &quiet]),
            ("least power", off_axis, &["--objective", "power"]),
            ("reach", middle, &["--objective", "reach", "--zone", zone]),
            ("one frequency", off_axis, &["--grouping", "shared"]),
            ("as it is felt", edge, &["--weigh", "felt"]),
        ];
        let text = |at: &str, more: &[&str]| {
            let all = [&["plan", "--at", at, "--unit", "mm", "--json"], more].concat();
            all.into_iter().map(str::to_owned).collect()
        };
        asked.into_iter().map(|(name, at, more)| (name, text(at, more))).collect()
    }

    /// The answer to one request.
    fn answer(&self, arguments: &[String]) -> Value {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/scenes").join(self.scene);
        let mut command = build_era_command();
        let output = run_command(command.args(arguments).arg("--scene").arg(scene));
        let mut answer: Map<String, Value> =
            serde_json::from_str(&output.out).unwrap_or_else(|error| panic!("{command:?}: {error}: {}", output.error));
        answer.retain(|key, _| !LEFT_OUT.contains(&key.as_str()));
        answer.into()
    }

    fn file(&self) -> PathBuf {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(self.scene);
        file.with_extension("json")
    }

    /// Asks everything, and records the answers or compares them with those that were recorded.
    fn check(&self) {
        let found: Map<String, Value> = self
            .requests()
            .into_iter()
            .map(|(name, arguments)| {
                (name.to_owned(), json!({ "answer": self.answer(&arguments), "arguments": arguments }))
            })
            .collect();
        let found = Value::from(found);
        let file = self.file();
        if std::env::var_os(RECORD).is_some_and(|value| value == "1") {
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            return std::fs::write(&file, format!("{found:#}\n")).unwrap();
        }
        let recorded =
            std::fs::read(&file).unwrap_or_else(|error| panic!("{}: {error}; `{HOW}` records it", file.display()));
        let differences = differences(&serde_json::from_slice(&recorded).unwrap(), &found);
        let told: Vec<String> = differences.iter().map(|difference| format!("{}: {difference}", self.scene)).collect();
        assert!(told.is_empty(), "{}\nif this was meant: `{HOW}`", told.join("\n"));
    }
}

/// Where answers differ from those recorded, as `request: field: what`. Requests are the same; answers may have more fields.
fn differences(recorded: &Value, found: &Value) -> Vec<String> {
    let mut all = Vec::new();
    let empty = Map::new();
    let of = |value: &Value| value.as_object().unwrap_or(&empty).keys().cloned().collect::<Vec<_>>();
    for name in of(found).iter().filter(|name| recorded.get(*name).is_none()) {
        all.push(format!("{name}: is not recorded"));
    }
    for name in of(recorded) {
        if found.get(&name).is_none() {
            all.push(format!("{name}: is recorded, but not asked"));
            continue;
        }
        let mut here = Vec::new();
        compare("", &recorded[&name], &found[&name], &mut here);
        all.extend(here.into_iter().map(|difference| format!("{name}: {difference}")));
    }
    all
}

fn compare(field: &str, recorded: &Value, found: &Value, differences: &mut Vec<String>) {
    match (recorded, found) {
        (Value::Object(fields), Value::Object(_)) => {
            for (key, value) in fields {
                let field = if field.is_empty() { key.clone() } else { format!("{field}.{key}") };
                compare(&field, value, &found[key], differences);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{field}[{i}]"), a, b, differences);
            }
        }
        (Value::Number(a), Value::Number(b)) if is_same(field, a.as_f64().unwrap(), b.as_f64().unwrap()) => {}
        _ if recorded == found => {}
        _ => differences.push(format!("{field}: recorded {recorded}, found {found}")),
    }
}

/// Whether two values of a field are the same but for rounding.
fn is_same(field: &str, a: f64, b: f64) -> bool {
    let name = field.rsplit('.').next().unwrap_or(field);
    let apart = (a - b).abs();
    let relative = |tolerance: f64| apart <= tolerance * a.abs().max(b.abs()) + NOTHING;
    match name {
        "frequency_hz" => apart <= FREQUENCY * a.abs(),
        // Phases go round.
        "phase_rad" => (apart - TAU * (apart / TAU).round()).abs() <= RELATIVE,
        "optimality_gap" => apart <= RELATIVE && (a == 0.0) == (b == 0.0),
        "error_bound" | "harmonics_error_bound" | "strongest_harmonic_error_db" => apart <= BOUND * a,
        name if name.ends_with("_db") => apart <= DB,
        _ => relative(RELATIVE),
    }
}

#[test]
fn the_starting_plate() {
    Places {
        scene: "starting_plate.toml",
        middle: "151.3,98.7",
        edge: "297.15,83.4",
        corner: "4.85,193.65",
        off_axis: "101.37,61.13",
        other: "231.9,142.6",
        spared: "150.25,101.5",
        zone: "21.3,14.9,187.6,171.2",
    }
    .check();
}

#[test]
fn a_plate_with_a_bezel() {
    Places {
        scene: "bezel.toml",
        middle: "148.9,101.7",
        // On the thinned rim, and across its border.
        edge: "213.7,4.3",
        corner: "291.6,9.35",
        off_axis: "96.83,147.21",
        other: "222.4,51.9",
        spared: "10.0,188.3",
        zone: "0,0,203.7,148.1",
    }
    .check();
}

#[test]
fn a_plate_with_a_camera_hole() {
    Places {
        scene: "camera.toml",
        middle: "152.6,103.3",
        // Between the hole and the edge, with the disc around it cut by both.
        edge: "141.7,6.45",
        corner: "296.2,195.75",
        off_axis: "181.7,147.3",
        other: "60.9,30.3",
        spared: "60.65,60.3",
        zone: "104.4,0,291.8,181.3",
    }
    .check();
}

#[test]
fn the_example_bar() {
    Places {
        scene: "bar.toml",
        middle: "126.4,10",
        edge: "248.6,10",
        corner: "1.35,19.3",
        off_axis: "83.17,3.4",
        other: "201.3,10",
        spared: "140.2,10",
        zone: "13.7,0,161.9,20",
    }
    .check();
}

#[test]
fn a_stepped_bar() {
    Places {
        scene: "stepped_bar.toml",
        middle: "123.6,10",
        edge: "247.9,10",
        corner: "0.65,0.65",
        // At the step.
        off_axis: "80,6.7",
        other: "193.55,10",
        spared: "30.4,10",
        zone: "97.3,0,250,20",
    }
    .check();
}

/// One planted difference at a time, and what is none.
#[test]
fn differences_are_reported_with_request_field_and_values() {
    let answer = |key: &str, value: Value| {
        let mut drive = json!({ "frequency_hz": 120.0, "force_n": 0.25, "phase_rad": 3.0 });
        let mut answer =
            json!({ "limited_by": "voltage of left", "optimality_gap": 0.0, "contrast_db": 3.0, "error_bound": 1e-4 });
        let place = if drive.get(key).is_some() { &mut drive } else { &mut answer };
        place[key] = value;
        answer["drives"] = json!([{ "force_n": 0.0 }, drive]);
        json!({ "a touch": { "answer": answer } })
    };
    let recorded = answer("force_n", json!(0.25));
    for (key, value, told) in [
        ("frequency_hz", json!(120.000_000_3), "answer.drives[1].frequency_hz: recorded 120.0, found 120.0000003"),
        ("force_n", json!(0.250_000_5), "answer.drives[1].force_n: recorded 0.25, found 0.2500005"),
        ("force_n", json!(null), "answer.drives[1].force_n: recorded 0.25, found null"),
        ("phase_rad", json!(-3.0), "answer.drives[1].phase_rad: recorded 3.0, found -3.0"),
        ("contrast_db", json!(3.000_01), "answer.contrast_db: recorded 3.0, found 3.00001"),
        ("error_bound", json!(1.01e-4), "answer.error_bound: recorded 0.0001, found 0.000101"),
        ("optimality_gap", json!(1e-8), "answer.optimality_gap: recorded 0.0, found 1e-8"),
        (
            "limited_by",
            json!("voltage of right"),
            r#"answer.limited_by: recorded "voltage of left", found "voltage of right""#,
        ),
    ] {
        assert_eq!(differences(&recorded, &answer(key, value)), [format!("a touch: {told}")]);
    }
    for (key, value) in [
        ("frequency_hz", json!(120.000_000_1)),
        ("force_n", json!(0.250_000_2)),
        ("phase_rad", json!(3.0 - TAU)),
        ("contrast_db", json!(3.000_008)),
        ("error_bound", json!(1.0005e-4)),
        ("new", json!(1)),
    ] {
        assert_eq!(differences(&recorded, &answer(key, value)), [""; 0], "{key}");
    }
    let (other, nothing) = (json!({ "another": {} }), json!({}));
    assert_eq!(differences(&nothing, &other), ["another: is not recorded"]);
    assert_eq!(differences(&other, &nothing), ["another: is recorded, but not asked"]);
}

//! The study file's keys and what they may be.

use super::Spec;
use super::method::{Method, Robust, Way};
use super::path::Path;
use super::variables::{Apart, Numbers, Scale, Uncertain, Variable, What, Where};
use super::wishes::{Costs, Drives, Figure, Goal, Limit, Settings, Wanted, Wish};
use era_model::scene::SceneError;
use era_model::scene::read::{self, Allowed, Report, Section};
use era_planner::TableOptions;
use toml_edit::{DocumentMut, Value};

/// The version of study files that is read.
const VERSION: f64 = 1.0;
/// Any number that is one.
const ANY: Allowed = Allowed::Within(-1e20, 1e20);
/// Places, in mm: a panel's sides are no longer.
const MM: Allowed = Allowed::Within(-10_000.0, 10_000.0);
/// Most designs of a study.
pub(crate) const MOST_DESIGNS: u32 = 100_000_000;
/// Most designs that depend on each other, and are all listed first.
const MOST_LISTED: u32 = 10_000_000;
/// Most values of a variable that goes in steps.
const MOST_STEPS: f64 = 1e6;
/// Most values of each variable on a grid.
const MOST_LEVELS: u32 = 1000;
/// Most corners that uncertain values have together: 8 of them.
const MOST_CORNERS: usize = 256;

pub(super) fn spec(source: &str, text: &str) -> Result<Spec, SceneError> {
    let document = read::document(source, text)?;
    // The same text again, for values that go into the scene as they are written.
    let values: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        SceneError::of(source, 0, format!("not valid TOML: {}", error.message()))
    })?;
    let report = Report::new(text);
    let file = Section::new(&report, document.get_ref(), String::new(), 0..0);
    let spec = whole(&file, &values);
    file.close();
    report.finish(source)?;
    Ok(spec)
}

fn whole(file: &Section<'_, '_>, values: &DocumentMut) -> Spec {
    file.number("version", Allowed::Within(VERSION, VERSION));
    let name = file.text("name");
    let scene = file.text("scene");
    let lists = values.get("variable").and_then(|item| item.as_array_of_tables());
    let list_of = |i: usize| lists.and_then(|lists| lists.get(i)?.get("values")?.as_array());
    let sections = file.tables("variable");
    let variables: Vec<Variable> =
        sections.into_iter().enumerate().filter_map(|(i, section)| variable(section, list_of(i))).collect();
    let apart = file.tables("apart").into_iter().map(apart).collect();
    let sections = file.tables("wish");
    let is_wished = !sections.is_empty();
    let wishes: Vec<Wish> = sections.into_iter().filter_map(wish).collect();
    if !is_wished {
        file.report().add(&(0..0), "wish is missing: at least one [[wish]] says what is wanted");
    }
    let limits = file.tables("limit").into_iter().filter_map(limit).collect();
    let uncertain: Vec<Uncertain> = file.tables("uncertain").into_iter().map(uncertain).collect();
    let costs = file.table("cost").map_or_else(Costs::default, costs);
    let method = method(file, &uncertain);
    Spec { name, scene, variables, apart, wishes, limits, uncertain, costs, method }
}

/// A path, told if it is none.
fn path(section: &Section<'_, '_>, key: &'static str, text: &str) -> Option<Path> {
    Path::parse(text)
        .map_err(|error| section.report().add(&section.place(key), format!("{}: {error}", section.key(key))))
        .ok()
}

fn paths(section: &Section<'_, '_>, key: &'static str) -> Vec<Path> {
    let texts = section.texts(key).unwrap_or_default();
    texts.iter().filter_map(|text| path(section, key, text)).collect()
}

fn one_path(section: &Section<'_, '_>, key: &'static str) -> Option<Path> {
    path(section, key, &section.text(key))
}

fn variable(section: Section<'_, '_>, list: Option<&toml_edit::Array>) -> Option<Variable> {
    let kinds = ["key", "place", "count"].map(|kind| section.has(kind));
    let given = if section.has("name") { Some(section.text("name")) } else { None };
    let levels = section.has("levels").then(|| section.count("levels", MOST_LEVELS) as usize);
    let line = section.report().line(section.place("name").start);
    let (usual, what) = match kinds {
        [true, false, false] => {
            let paths = paths(&section, "key");
            let name = paths.first().map_or_else(String::new, ToString::to_string);
            let what = if section.has("values") {
                left_out(&section, ["from", "to", "scale", "step"], "as `values` are given");
                choice(&section, paths, list)
            } else {
                left_out(&section, ["names", "costs"], "as there are no `values`");
                Some(What::Number { paths, numbers: numbers(&section, "step", ANY) })
            };
            (name, what)
        }
        [false, true, false] => {
            let of = one_path(&section, "place");
            let name = of.as_ref().map_or_else(String::new, ToString::to_string);
            (name, of.and_then(|of| place(&section, of)))
        }
        [false, false, true] => {
            let list = section.text("count");
            let (from, to) = (section.count("from", 1000) as usize, section.count("to", 1000) as usize);
            if from > to {
                section.wrong("from", from.to_string(), &format!("at most `to`, {to}"));
            }
            (format!("number of {}", plural(&list)), Some(What::Count { list, from, to }))
        }
        _ => {
            one_of(&section, "name", [("key", kinds[0]), ("place", kinds[1]), ("count", kinds[2])]);
            return None;
        }
    };
    let name = given.unwrap_or(usual);
    section.close();
    what.map(|what| Variable { name, what, levels, line })
}

/// Several of what a scene has a list of.
fn plural(list: &str) -> String {
    match list {
        "mass" | "patch" => format!("{list}es"),
        _ => format!("{}s", list.trim_end_matches('s')),
    }
}

/// Tells that not one of three keys is given, but none or several; `at` is the key whose line is told.
fn one_of(section: &Section<'_, '_>, at: &str, given: [(&str, bool); 3]) {
    let [a, b, c] = given.map(|(key, _)| key);
    let there: Vec<&str> = given.into_iter().filter(|(_, is_given)| *is_given).map(|(key, _)| key).collect();
    let text = match there.is_empty() {
        true => format!("{}: one of {a}, {b} and {c} is needed", section.path()),
        false => {
            format!("{}: {} are given, but only one of {a}, {b} and {c} may be", section.path(), there.join(" and "))
        }
    };
    section.report().add(&section.place(at), text);
}

/// `from`, `to`, `scale` and a step.
fn numbers(section: &Section<'_, '_>, step_key: &'static str, allowed: Allowed) -> Numbers {
    let (from, to) = (section.number("from", allowed), section.number("to", allowed));
    if from > to {
        section.wrong("from", from.to_string(), &format!("at most `to`, {to}"));
    }
    let words = [("linear", Scale::Linear), ("log", Scale::Log)];
    let scale = if section.has("scale") { section.word("scale", &words) } else { None };
    let scale = scale.unwrap_or(Scale::Linear);
    if scale == Scale::Log && from <= 0.0 {
        section.wrong("from", from.to_string(), "above 0, as the scale is \"log\"");
    }
    let step = step(section, step_key, to - from);
    if scale == Scale::Log && step.is_some() {
        section.wrong(step_key, step.unwrap_or_default().to_string(), "left out, as the scale is \"log\"");
    }
    Numbers { from, to, scale, step }
}

fn step(section: &Section<'_, '_>, key: &'static str, span: f64) -> Option<f64> {
    let least = (span / MOST_STEPS).max(f64::MIN_POSITIVE);
    section.has(key).then(|| section.number(key, Allowed::Within(least, 1e20)))
}

fn choice(section: &Section<'_, '_>, paths: Vec<Path>, list: Option<&toml_edit::Array>) -> Option<What> {
    let Some(list) = list.filter(|list| !list.is_empty()) else {
        section.wrong("values", "no list, or an empty one".into(), "a list of values or tables");
        return None;
    };
    let values: Vec<Value> = list.iter().cloned().map(Value::decorated_plainly).collect();
    let written = || values.iter().map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_owned));
    let names = section.has("names").then(|| section.texts("names")).flatten().unwrap_or_else(|| written().collect());
    let costs = section.has("costs").then(|| section.numbers("costs", &[values.len()], ANY)).flatten();
    if names.len() != values.len() {
        section.wrong(
            "names",
            format!("{} names", names.len()),
            &format!("as many as there are values, {}", values.len()),
        );
    }
    let costs = costs.unwrap_or_else(|| vec![0.0; values.len()]);
    Some(What::Choice { paths, values, names, costs })
}

/// Values without the blanks and comments that are around them in the study's file.
trait Plain {
    fn decorated_plainly(self) -> Self;
}

impl Plain for Value {
    fn decorated_plainly(mut self) -> Self {
        self.decor_mut().clear();
        self
    }
}

fn place(section: &Section<'_, '_>, of: Path) -> Option<What> {
    let given = ["within_mm", "line_mm", "mirror_of"].map(|key| section.has(key));
    let linear = |from: f64, to: f64, step: Option<f64>| Numbers { from, to, scale: Scale::Linear, step };
    if given[2] {
        left_out(section, ["step_mm"], "as a mirror image follows from `mirror_of`");
    } else {
        left_out(section, ["mirrored"], "as there is no `mirror_of`");
    }
    match given {
        [true, false, false] => {
            let corners = section.numbers("within_mm", &[4], MM)?;
            let (x, y) = ([corners[0], corners[2]], [corners[1], corners[3]]);
            let order = |[a, b]: [f64; 2]| (a.min(b), a.max(b));
            let step = step(section, "step_mm", (x[1] - x[0]).abs().max((y[1] - y[0]).abs()));
            let ((x0, x1), (y0, y1)) = (order(x), order(y));
            Some(What::Place { of, area: Where::Rectangle { x: linear(x0, x1, step), y: linear(y0, y1, step) } })
        }
        [false, true, false] => {
            let ends = section.numbers("line_mm", &[4], MM)?;
            let (from, to) = ([ends[0], ends[1]], [ends[2], ends[3]]);
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            let step = step(section, "step_mm", length);
            Some(What::Place { of, area: Where::Line { from, to, along: linear(0.0, length, step) } })
        }
        [false, false, true] => {
            let from = one_path(section, "mirror_of");
            let words = [("x", (true, false)), ("y", (false, true)), ("both", (true, true))];
            let (x, y) = section.word("mirrored", &words)?;
            Some(What::Mirror { of, from: from?, x, y })
        }
        _ => {
            one_of(section, "place", [("within_mm", given[0]), ("line_mm", given[1]), ("mirror_of", given[2])]);
            None
        }
    }
}

fn apart(section: Section<'_, '_>) -> Apart {
    let apart = Apart {
        places: paths(&section, "places"),
        distance_mm: section.number("distance_mm", Allowed::Within(0.0, 1e4)),
        line: section.report().line(section.place("places").start),
    };
    section.close();
    apart
}

fn wanted(section: &Section<'_, '_>) -> Option<Wanted> {
    let words = Figure::ALL.map(|figure| (figure.name(), figure));
    let Some(figure) = section.word("figure", &words) else {
        // Known, but nobody can say whether they apply.
        for key in ["setting", "drives", "at_mm", "force_n"] {
            let _ = section.has(key);
        }
        return None;
    };
    let settings = [("every_touch", Settings::EveryTouch), ("one", Settings::One)];
    let setting =
        if figure.is_of_settings() && section.has("setting") { section.word("setting", &settings) } else { None };
    let mut drives = Drives::Distinct;
    if figure.is_of_the_weakest_place() && section.has("drives") {
        drives = section.word("drives", &Drives::ALL.map(|drives| (drives.name(), drives))).unwrap_or(drives);
        if drives != Drives::Distinct && setting == Some(Settings::One) {
            section.wrong("drives", format!("{:?}", drives.name()), "\"distinct\", where setting is \"one\"");
        }
    }
    let at_mm = if figure.is_of_a_place() {
        if !section.has("at_mm") {
            section.wrong("at_mm", "missing".into(), "the place, [x, y] in mm");
        }
        Some(section.numbers("at_mm", &[2], MM).map(|at| [at[0], at[1]])?)
    } else {
        None
    };
    let is_of_no = |what: &str| format!("as {} is no figure {what}", figure.name());
    if !figure.is_of_settings() {
        left_out(section, ["setting"], &is_of_no("of settings"));
    }
    if !figure.is_of_the_weakest_place() {
        left_out(section, ["drives"], &is_of_no("of the weakest place's peak"));
    }
    if !figure.is_of_a_place() {
        left_out(section, ["at_mm"], &is_of_no("of a place"));
    }
    if figure != Figure::SagUm {
        left_out(section, ["force_n"], &is_of_no("of a press"));
    }
    let is_pressed = figure == Figure::SagUm && section.has("force_n");
    let force_n = is_pressed.then(|| section.number("force_n", Allowed::Within(0.0, era_model::scene::MOST_PRESS_N)));
    Some(Wanted { figure, setting: setting.unwrap_or(Settings::EveryTouch), drives, at_mm, force_n })
}

fn wish(section: Section<'_, '_>) -> Option<Wish> {
    let wanted = wanted(&section);
    let words = [("most", Goal::Most), ("least", Goal::Least)];
    let goal = if section.has("goal") { section.word("goal", &words) } else { None };
    section.close();
    let wanted = wanted?;
    let goal = goal.unwrap_or(wanted.figure.usual_goal());
    Some(Wish { wanted, goal })
}

fn limit(section: Section<'_, '_>) -> Option<Limit> {
    let wanted = wanted(&section);
    if !section.has("least") & !section.has("most") {
        section.report().add(&section.place("figure"), format!("{}: least or most is needed", section.path()));
    }
    let least = section.number_or("least", f64::NEG_INFINITY, ANY);
    let most = section.number_or("most", f64::INFINITY, ANY);
    if least > most {
        section.wrong("least", least.to_string(), &format!("at most `most`, {most}"));
    }
    section.close();
    Some(Limit { wanted: wanted?, least, most })
}

fn uncertain(section: Section<'_, '_>) -> Uncertain {
    let paths = paths(&section, "key");
    let usual = paths.first().map_or_else(String::new, ToString::to_string);
    let name = if section.has("name") { section.text("name") } else { usual };
    if section.has("part") == section.has("by") {
        section.report().add(&section.place("key"), format!("{}: one of part and by is needed", section.path()));
    }
    let part = section.number_or("part", 0.0, Allowed::Within(0.0, 0.99));
    let by = section.number_or("by", 0.0, Allowed::Within(0.0, 1e20));
    let words = [("each", false), ("together", true)];
    let together = section.has("vary").then(|| section.word("vary", &words)).flatten().unwrap_or(false);
    let line = section.report().line(section.place("key").start);
    section.close();
    Uncertain { name, paths, part, by, together, line }
}

fn costs(section: Section<'_, '_>) -> Costs {
    let each = |key| section.number_or(key, 0.0, Allowed::Within(0.0, 1e12));
    let costs =
        Costs { actuator: each("actuator"), support: each("support"), mass: each("mass"), per_kg: each("per_kg") };
    section.close();
    costs
}

fn method(file: &Section<'_, '_>, uncertain: &[Uncertain]) -> Method {
    let usual = TableOptions::default();
    let mut method = Method {
        way: Way::Sobol,
        designs: 256,
        seed: 0,
        levels: 5,
        population: 16,
        runs: 4,
        finalists: 3,
        chunk: None,
        robust: Robust::LatinHypercube { samples: 16 },
        from_hz: usual.from_hz,
        to_hz: usual.to_hz,
        thorough: false,
    };
    let Some(section) = file.table("method") else { return method };
    let ways = [Way::Grid, Way::LatinHypercube, Way::Sobol, Way::Evolution].map(|way| (way.name(), way));
    if section.has("way") {
        method.way = section.word("way", &ways).unwrap_or(method.way);
    }
    let count = |key: &'static str, usual: usize, most: u32| -> usize {
        if section.has(key) { section.count(key, most) as usize } else { usual }
    };
    if method.way == Way::Grid {
        method.levels = count("levels", method.levels, MOST_LEVELS);
        left_out(&section, ["designs", "seed"], "as a grid has the designs that `levels` makes");
    } else {
        left_out(&section, ["levels"], "as `way` is not \"grid\"");
        let most = if method.way == Way::LatinHypercube { MOST_LISTED } else { MOST_DESIGNS };
        method.designs = count("designs", method.designs, most);
        method.seed = u64::from(u32::try_from(count("seed", 0, u32::MAX)).unwrap_or(0));
    }
    if method.way == Way::Evolution {
        method.population = count("population", method.population, 10_000);
        method.runs = count("runs", method.runs, 10_000);
        let least = method.population * method.runs;
        if method.population < 4 {
            section.wrong("population", method.population.to_string(), "4 to 10000");
        } else if method.designs < least {
            let wanted = format!("at least one generation of each run, {least}");
            section.wrong("designs", method.designs.to_string(), &wanted);
        }
        left_out(&section, ["chunk"], "as a generation is what is computed together");
    } else {
        method.chunk = section.has("chunk").then(|| section.count("chunk", 1_000_000) as usize);
        left_out(&section, ["population", "runs"], "as `way` is not \"evolution\"");
    }
    method.finalists = count("finalists", method.finalists, 100);
    let band = Allowed::Within(1.0, 1000.0);
    method.from_hz = section.number_or("from_hz", method.from_hz, band);
    method.to_hz = section.number_or("to_hz", method.to_hz, band);
    if method.from_hz > method.to_hz {
        section.wrong("from_hz", method.from_hz.to_string(), &format!("at most `to_hz`, {}", method.to_hz));
    }
    let words = [("quick", false), ("thorough", true)];
    method.thorough = section.has("look").then(|| section.word("look", &words)).flatten().unwrap_or(false);
    if !uncertain.is_empty() {
        let words = [("corners", true), ("latin_hypercube", false)];
        let corners = section.has("robust").then(|| section.word("robust", &words)).flatten().unwrap_or(false);
        if corners {
            left_out(&section, ["samples"], "as the corners are the samples");
            method.robust = Robust::Corners;
        } else {
            method.robust = Robust::LatinHypercube { samples: count("samples", 16, 10_000) };
        }
    } else {
        left_out(&section, ["robust", "samples"], "as there is no [[uncertain]]");
    }
    section.close();
    method
}

/// Tells of keys that are there though nothing asks for them; `why` goes on after "must be left out, ".
fn left_out<const N: usize>(section: &Section<'_, '_>, keys: [&'static str; N], why: &str) {
    for key in keys.into_iter().filter(|key| section.has(key)) {
        section.wrong_list(key, &format!("left out, {why}"));
    }
}

/// Whether so many uncertain values have few enough corners.
#[must_use]
pub(crate) fn has_few_corners(values: usize) -> bool {
    values < usize::BITS as usize && 1_usize << values <= MOST_CORNERS
}

//! `era study` as it is called: stopped by a signal and gone on with, in shares, refused; what it writes is what other commands compute. Its
//! report in Chromium (`ERA_NO_BROWSER=1` skips).

use crate::support;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use support::browser::{Browser, browser_or_skip};
use support::program::{ProgramOutput, build_era_command, run_era, run_era_json};

/// One ERA of the bar moves, the springs change: little work, and two panels.
const STUDY: &str = "version = 1\nname = \"bar\"\nscene = \"bar.toml\"\n\
    [[variable]]\nkey = \"actuator[1].x_mm\"\nfrom = 20\nto = 140\n\
    [[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 2\nto = 4\nstep = 2\n\
    [[wish]]\nfigure = \"weakest_g\"\n[[wish]]\nfigure = \"mass_g\"\n";
const SOBOL: &str = "[method]\nway = \"sobol\"\ndesigns = 12\nchunk = 2\nfinalists = 1\n";

/// A folder with a scene and a study of it.
fn prepared(method: &str) -> (tempfile::TempDir, String) {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("bar.toml"), era::scene::EXAMPLE_BAR).unwrap();
    let study = place.path().join("study.toml");
    fs::write(&study, format!("{STUDY}{method}")).unwrap();
    (place, study.display().to_string())
}

/// The results, and the rows that they are made of.
fn results(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let folders = [folder.to_owned(), folder.join("rows")];
    let files = folders.into_iter().flat_map(|path| fs::read_dir(path).unwrap());
    let files = files.map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
    files.map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), fs::read(&path).unwrap())).collect()
}

#[test]
fn a_study_is_stopped_gone_on_with_and_shared_and_comes_out_the_same() {
    let (place, study) = prepared(SOBOL);
    let out = |name: &str| place.path().join(name).display().to_string();
    let whole = run_era(&["study", &study, "--out", &out("whole"), "--json"]);
    assert!(whole.is_success(), "{}", whole.error);
    let wanted = results(&place.path().join("whole"));
    for file in ["designs.parquet", "report.html", "best-1.toml", "study.key", "base.rows", "designs-0000005.rows"] {
        assert!(wanted.contains_key(file), "{file}: {:?}", wanted.keys());
    }
    // The best design is a scene, and what the other commands say of it is what the study says.
    let summary: Value = whole.parse_json();
    assert_eq!((&summary["designs"], &summary["failed"]), (&12.into(), &0.into()));
    let best = place.path().join("whole/best-1.toml").display().to_string();
    let reach = run_era_json(&["field", "--reach", "--json", "--no-cache", "--scene", &best]);
    let (own, field) = (&summary["best"][0], &reach["strongest_g"]);
    let weakest = own["figures"]["weakest_g"].as_f64().unwrap();
    assert!((weakest / field["least"].as_f64().unwrap() - 1.0).abs() < 1e-12, "{own} {field}");
    assert_eq!(own["weakest_mm"], field["least_at_mm"]);
    assert!(own["error_bound"].as_f64().unwrap() <= 1e-3, "{own}");
    // In shares, with other numbers of workers.
    for (shard, workers) in [("2/2", "1"), ("1/2", "4")] {
        let share = run_era(&["study", &study, "--out", &out("shared"), "--shard", shard, "--workers", workers]);
        assert!(share.is_success(), "{}", share.error);
    }
    let gathered = run_era(&["study", &study, "--out", &out("shared"), "--gather"]);
    assert!(gathered.is_success(), "{}", gathered.error);
    assert_eq!(results(&place.path().join("shared")), wanted);
}

/// A process killed without a word leaves what others go on from; one that is asked to stop says how far it came.
#[cfg(unix)]
#[test]
fn a_study_that_is_killed_or_asked_to_stop_goes_on() {
    let (place, study) = prepared(&SOBOL.replace("designs = 12", "designs = 4000"));
    let out = place.path().join("out");
    let rows = || fs::read_dir(out.join("rows")).map_or(0, Iterator::count);
    let start = || {
        let mut command = build_era_command();
        command.args(["study", &study, "--out", &out.display().to_string()]);
        command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap()
    };
    let mut killed = start();
    while rows() < 4 {
        assert!(killed.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    let before = rows();
    let asked = start();
    while rows() < before + 4 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let stopped = Command::new("kill").args(["-INT", &asked.id().to_string()]).status().unwrap();
    assert!(stopped.success());
    let ended = ProgramOutput::from(asked.wait_with_output().unwrap());
    let text = &ended.error;
    assert_eq!(ended.code, Some(1), "{text}");
    assert!(text.contains("designs are already computed") && text.contains("of 4000 designs are in"), "{text}");
    let left: Vec<String> = results(&out)
        .into_keys()
        .filter(|name| !name.ends_with(".rows") && !name.ends_with(".part") && name != "study.key")
        .collect();
    assert!(left.is_empty(), "no results of half a study: {left:?}");
}

#[test]
fn what_a_study_cannot_be_is_reported() {
    let (place, study) = prepared(SOBOL);
    let out = place.path().join("out").display().to_string();
    let refused = |arguments: &[&str], code: i32, wanted: &str| {
        let output = run_era(arguments);
        let text = &output.error;
        assert!(output.code == Some(code) && text.contains(wanted), "{arguments:?}: {text}");
    };
    refused(&["study", &place.path().join("none.toml").display().to_string()], 2, "none.toml");
    refused(&["study", &study, "--out", &out, "--shard", "3/2"], 2, "\"3/2\" is not of the form I/N");
    refused(&["study", &study, "--out", &out, "--gather"], 1, "of 12 designs are missing");
    let wrong = place.path().join("wrong.toml");
    fs::write(&wrong, STUDY.replace("actuator[1].x_mm", "actuator[9].x_mm")).unwrap();
    refused(
        &["study", &wrong.display().to_string(), "--out", &out],
        2,
        "wrong.toml:4: variable[1] (actuator[9].x_mm): ",
    );
    // Another study's folder.
    fs::write(&study, format!("{STUDY}{}", SOBOL.replace("designs = 12", "designs = 13"))).unwrap();
    refused(&["study", &study, "--out", &out, "--gather"], 2, "has results of another study");
    // Where there is a file in the folder's place.
    refused(&["study", &study, "--out", &wrong.display().to_string()], 1, "cannot create the folder");
}

/// The study that comes with the program: 2.5 times the weakest place of its scene, and the best first by the thorough look, whose order is not the quick
/// one's.
#[test]
fn the_example_study_finds_better_places_and_reports_the_best_first() {
    let study = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/studies/placement.toml");
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out").display().to_string();
    let found = run_era(&["study", study.to_str().unwrap(), "--out", &out, "--json"]);
    assert!(found.is_success(), "{}", found.error);
    let summary: Value = found.parse_json();
    let weakest = |own: &Value| own["figures"]["weakest_g"].as_f64().unwrap();
    let best: Vec<f64> = summary["best"].as_array().unwrap().iter().map(weakest).collect();
    assert!(best.len() == 3 && best.is_sorted_by(|a, b| a >= b), "{best:?}");
    assert!(best[0] > 2.5 * weakest(&summary["as_it_is"]), "{summary}");
}

/// What other commands say of a scene whose ERAs lack stops is said of a study's, word for word and once, however many designs there are.
#[test]
fn stops_that_are_missing_are_reported_once() {
    let (place, study) = prepared(SOBOL);
    let bar = place.path().join("bar.toml");
    let warned = |arguments: &[&str]| {
        let output = run_era(arguments);
        assert!(output.is_success(), "{}", output.error);
        let text = &output.error;
        // The logger's time stands before the words.
        let own = text.lines().filter_map(|line| Some(line[line.find("a press of")?..].to_owned()));
        own.collect::<Vec<String>>()
    };
    let out = |name: &str| place.path().join(name).display().to_string();
    assert!(warned(&["study", &study, "--out", &out("with")]).is_empty());
    let without: Vec<&str> = era::scene::EXAMPLE_BAR.lines().filter(|line| !line.starts_with("stop_um")).collect();
    fs::write(&bar, without.join("\n")).unwrap();
    let wanted = warned(&["plan", "--at", "480,100", "--no-cache", "--scene", &bar.display().to_string()]);
    assert!(!wanted.is_empty() && wanted.iter().all(|line| line.contains("stop_um = ")), "{wanted:?}");
    assert_eq!(warned(&["study", &study, "--out", &out("without")]), wanted);
}

/// Pairs of texts of a picture that lie on each other, and texts that stand out over its sides.
const COLLIDING: &str = "[...document.querySelectorAll('svg')].flatMap((svg) => {
    const own = svg.getBoundingClientRect();
    const all = [...svg.querySelectorAll('text')].filter((text) => text.textContent !== '')
        .map((text) => ({ word: text.textContent, box: text.getBoundingClientRect() }));
    const out = all.filter(({ box }) => box.left < own.left || box.right > own.right || box.top < own.top || box.bottom > own.bottom);
    const meets = (a, b) => a.left < b.right - .5 && b.left < a.right - .5 && a.top < b.bottom - .5 && b.top < a.bottom - .5;
    const pairs = all.flatMap((one, k) => all.slice(k + 1).filter((other) => meets(one.box, other.box)).map((other) => [one.word, other.word]));
    return [...out.map(({ word }) => [word, 'the side']), ...pairs];
})";

/// The best designs are named in the plot, texts do not lie on each other, and what does not meet a limit is marked.
#[test]
fn the_reports_texts_do_not_meet_and_what_breaks_a_limit_is_marked() {
    let Some(program) = browser_or_skip() else { return };
    let (place, study) = prepared(
        "[[variable]]\nname = \"metal\"\nkey = \"surface.material.density_kg_m3\"\nvalues = [2700.0, 7800.0, 8900.0]\n\
         names = [\"aluminium of the usual alloy\", \"steel\", \"copper\"]\n\
         [[limit]]\nfigure = \"mass_g\"\nleast = 50\n[method]\nway = \"sobol\"\ndesigns = 32\nseed = 3\n",
    );
    let out = place.path().join("out");
    let done = run_era(&["study", &study, "--out", &out.display().to_string()]);
    assert!(done.is_success(), "{}", done.error);
    let mut browser = Browser::start(program, 1200, 2600);
    browser.open(&format!("file://{}", out.join("report.html").display()));
    browser.wait_for("document.querySelector('#parallel svg')");
    let texts = browser.value("[...document.querySelectorAll('#scatter text.mark')].map((text) => text.textContent)");
    let head = browser.value("[...document.querySelector('table tr').cells].slice(1).map((cell) => cell.textContent)");
    let names = head.as_array().unwrap();
    assert!(names.len() >= 3, "{head}");
    assert!(names.iter().all(|name| texts.as_array().unwrap().contains(name)), "{head} {texts}");
    // Of all columns, each against each.
    let columns = browser.value("document.getElementById('up').options.length").as_u64().unwrap();
    for (across, up) in (0..columns).flat_map(|across| (0..columns).map(move |up| (across, up))) {
        let collides = browser.value(&format!(
            "[['across', {across}], ['up', {up}]].forEach(([id, value]) => {{ const list = document.getElementById(id); list.value = value; \
             list.dispatchEvent(new Event('change')); }}); {COLLIDING}"
        ));
        assert_eq!(collides, serde_json::json!([]), "across {across}, up {up}");
    }
    let blank = browser.value(
        "[...document.querySelector('table').rows].filter((row) => [...row.cells].slice(1).some((cell) => cell.textContent === '')).length",
    );
    assert_eq!(blank, 0);
    let marked = browser.value("[...document.querySelectorAll('td.unmet')].map((cell) => cell.textContent)");
    assert!(marked.as_array().unwrap().iter().any(|text| text == "not met"), "{marked}");
}

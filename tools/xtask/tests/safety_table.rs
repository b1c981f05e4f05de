//! The hazard table of docs/src/safety.md: every row has a mechanism, a place and a test, and what it names exists.
//!
//! In its column of places, what stands in backticks and has a `/` is a path from the repository's root. In its column
//! of tests, what stands in backticks is a test: `name` of a function with the attribute `test`, `emulated::name` (or
//! `sim::`, `board::`) of a case of the suite in hil-tests, `report::name` of a step of `cargo xtask emulate --report`.
//!
//! So for the threat table of the same file, which has no column of places.

use std::fs;
use std::path::{Path, PathBuf};

/// What is in the repository, as far as the table speaks of it.
struct Repository {
    root: PathBuf,
    /// Texts of all Rust files.
    sources: Vec<(PathBuf, String)>,
}

impl Repository {
    fn read() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository").to_path_buf();
        let mut sources = Vec::new();
        for folder in ["host", "shared", "firmware/src", "hil-tests", "tools/xtask", "tools/fuzz"] {
            collect(&root.join(folder), &mut sources);
        }
        Self { root, sources }
    }

    fn has_path(&self, path: &str) -> bool {
        self.root.join(path).exists()
    }

    fn has_test(&self, name: &str) -> bool {
        match name.split_once("::") {
            None => self.sources.iter().any(|(_, text)| is_test(text, name)),
            Some(("sim" | "emulated" | "board", case)) => self.has_string("hil-tests/src", case),
            Some(("report", step)) => self.has_string("tools/xtask/src/emulate", step),
            Some(_) => false,
        }
    }

    /// Whether a file under `place` has this string literal.
    fn has_string(&self, place: &str, literal: &str) -> bool {
        let place = self.root.join(place);
        let quoted = format!("\"{literal}\"");
        self.sources.iter().any(|(path, text)| path.starts_with(&place) && text.contains(&quoted))
    }
}

fn collect(folder: &Path, sources: &mut Vec<(PathBuf, String)>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            collect(&path, sources);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap_or_default();
            sources.push((path, text));
        }
    }
}

/// Whether `text` has a function of this name under an attribute `#[test]` (or `#[tokio::test]` and the like).
fn is_test(text: &str, name: &str) -> bool {
    let declaration = format!("fn {name}(");
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    lines.iter().enumerate().any(|(number, line)| {
        let above = lines.iter().take(number).rev().take_while(|line| line.starts_with("#[") || line.starts_with("//"));
        line.contains(&declaration) && above.into_iter().any(|line| line.starts_with("#[") && line.contains("test"))
    })
}

/// The cells of each row of the table that begins with the column `first`.
fn rows<'t>(text: &'t str, first: &str) -> Vec<Vec<&'t str>> {
    let head = format!("| {first} |");
    let lines = text.lines().skip_while(|line| !line.starts_with(&head)).skip(2);
    lines
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim().trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// What stands in backticks.
fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

/// Everything that is wrong with the table in `text`.
fn mistakes(text: &str, repository: &Repository) -> Vec<String> {
    let mut mistakes = Vec::new();
    let rows = rows(text, "hazard");
    if rows.is_empty() {
        mistakes.push("no table that begins with `| hazard |`".to_owned());
    }
    for row in rows {
        let [hazard, mechanism, places, tests] = row[..] else {
            mistakes.push(format!("not four cells: {}", row.join(" | ")));
            continue;
        };
        if hazard.is_empty() || mechanism.is_empty() {
            mistakes.push(format!("a hazard without a mechanism, or the reverse: {hazard}{mechanism}"));
        }
        if quoted(places).next().is_none() {
            mistakes.push(format!("{hazard}: names no place"));
        }
        if quoted(tests).next().is_none() {
            mistakes.push(format!("{hazard}: names no test"));
        }
        for path in quoted(places).filter(|path| !path.contains('/') || !repository.has_path(path)) {
            mistakes.push(format!("{hazard}: there is no file {path} (paths are from the repository's root)"));
        }
        for test in quoted(tests).filter(|test| !repository.has_test(test)) {
            mistakes.push(format!("{hazard}: there is no test {test}"));
        }
    }
    mistakes
}

/// Everything that is wrong with the threat table in `text`.
fn mistakes_of_threats(text: &str, repository: &Repository) -> Vec<String> {
    let mut mistakes = Vec::new();
    let rows = rows(text, "threat");
    if rows.is_empty() {
        mistakes.push("no table that begins with `| threat |`".to_owned());
    }
    for row in rows {
        let [threat, mechanism, tests] = row[..] else {
            mistakes.push(format!("not three cells: {}", row.join(" | ")));
            continue;
        };
        if threat.is_empty() || mechanism.is_empty() {
            mistakes.push(format!("a threat without a mechanism, or the reverse: {threat}{mechanism}"));
        }
        let says_none = ["no test", "no mechanism"].iter().any(|words| row.iter().any(|cell| cell.contains(words)));
        if says_none {
            mistakes.push(format!("{threat}: says that there is no test"));
        }
        if quoted(tests).next().is_none() {
            mistakes.push(format!("{threat}: names no test"));
        }
        for test in quoted(tests).filter(|test| !repository.has_test(test)) {
            mistakes.push(format!("{threat}: there is no test {test}"));
        }
    }
    mistakes
}

#[test]
fn every_threat_has_a_mechanism_and_tests_that_exist() {
    let repository = Repository::read();
    let text = fs::read_to_string(repository.root.join("docs/src/safety.md")).expect("docs/src/safety.md");
    let mistakes = mistakes_of_threats(&text, &repository);
    assert!(mistakes.is_empty(), "docs/src/safety.md:\n  {}", mistakes.join("\n  "));
}

#[test]
fn what_is_missing_for_a_threat_is_named() {
    let repository = Repository::read();
    let wrong = "\
| threat | mechanism | test |
|---|---|---|
| good | m | `what_is_missing_is_named`, `a_stop_gets_through_a_crowd` |
| half | m | `what_is_missing_is_named`; the rest: no test |
| none | m | to come |
| renamed | m | `a_test_that_was_renamed` |
| bare | | `what_is_missing_is_named` |
| short | m |
";
    let found = mistakes_of_threats(wrong, &repository);
    let expected = [
        "half: says that there is no test",
        "none: names no test",
        "renamed: there is no test a_test_that_was_renamed",
        "a threat without a mechanism",
        "not three cells: short",
    ];
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (mistake, start) in found.iter().zip(expected) {
        assert!(mistake.starts_with(start), "{mistake} is not {start}");
    }
    assert_eq!(mistakes_of_threats("| hazard |", &repository).len(), 1);
}

#[test]
fn every_hazard_has_a_mechanism_a_place_and_tests_that_exist() {
    let repository = Repository::read();
    let text = fs::read_to_string(repository.root.join("docs/src/safety.md")).expect("docs/src/safety.md");
    let mistakes = mistakes(&text, &repository);
    assert!(mistakes.is_empty(), "docs/src/safety.md:\n  {}", mistakes.join("\n  "));
}

#[test]
fn what_is_missing_is_named() {
    let repository = Repository::read();
    let wrong = "\
| hazard | mechanism | where | test |
|---|---|---|---|
| good | m | `shared/src/lib.rs` | `what_is_missing_is_named`, `emulated::silence` |
| no test | m | `shared/src/lib.rs` | none yet |
| renamed test | m | `shared/src/lib.rs` | `a_test_that_was_renamed` |
| a function | m | `shared/src/lib.rs` | `collect` |
| no case | m | `shared/src/lib.rs` | `emulated::no_such_case` |
| moved | m | `shared/src/no_such_file.rs` | `what_is_missing_is_named` |
| short path | m | `lib.rs` | `what_is_missing_is_named` |
| | | | |
";
    let found = mistakes(wrong, &repository);
    let expected = [
        "no test: names no test",
        "renamed test: there is no test a_test_that_was_renamed",
        "a function: there is no test collect",
        "no case: there is no test emulated::no_such_case",
        "moved: there is no file shared/src/no_such_file.rs",
        "short path: there is no file lib.rs",
        "a hazard without a mechanism",
        "names no place",
        "names no test",
    ];
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (mistake, start) in found.iter().zip(expected) {
        assert!(mistake.contains(start), "{mistake} is not {start}");
    }
    assert_eq!(mistakes("no table", &repository).len(), 1);
}

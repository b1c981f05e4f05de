//! Crates made up in memory, and the checkout itself.

use super::order::{DAEMON, FolderOrder, ORDERS};
use super::survey::Survey;
use super::{describe_survey_findings_if_any, survey_each_crate};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The survey of a library whose files are in `src`.
fn survey(files: &[(&str, &str)]) -> Survey {
    let texts: BTreeMap<PathBuf, String> =
        files.iter().map(|(file, text)| (PathBuf::from("src").join(file), (*text).to_owned())).collect();
    Survey::new(&texts, &["src/lib.rs".into()]).unwrap()
}

/// The circles between files, each as its files with spaces between them.
fn circles(files: &[(&str, &str)]) -> Vec<String> {
    let survey = survey(files);
    assert_eq!(survey.lost, [""; 0]);
    survey.circles.iter().map(|circle| circle.keys().map(String::as_str).collect::<Vec<_>>().join(" ")).collect()
}

/// Three files, the last of which closes the circle in every way that a path can be written.
#[test]
fn a_circle_is_found_however_its_paths_are_written() {
    for (way, closing) in [
        ("use", "use crate::a::A;"),
        ("a nested group", "use super::{a::{A as Other, f}, b};"),
        ("everything", "use super::a::*;"),
        ("a module", "use super::a;"),
        ("in a function", "fn g() { use crate::a::f; f() }"),
        ("a call", "fn g() { super::a::f() }"),
        ("a type", "struct C(Vec<crate::a::A>);"),
        ("a trait's path", "fn g() -> <super::a::A as Iterator>::Item {}"),
        ("a macro", "fn g() { println!(\"{}\", [1, crate::a::f(2)]) }"),
        ("an attribute", "struct C { #[arg(default_value_t = crate::a::A)] c: u8 }"),
        ("a name of the parent's", "use super::Handed;"),
        ("a module written out", "mod inner { fn g() { super::super::a::f() } }"),
    ] {
        let files = [
            ("lib.rs", "mod a; mod b; mod c; mod d; use a::A as Handed;"),
            ("a.rs", "use crate::b::B; pub struct A; pub fn f() {}"),
            ("b.rs", "pub struct B(super::c::C);"),
            ("c.rs", closing),
            // In no circle: nothing leads back to it.
            ("d.rs", "use crate::{a, c};"),
        ];
        assert_eq!(circles(&files), ["a.rs b.rs c.rs"], "{way}");
    }
}

#[test]
fn what_leads_elsewhere_closes_no_circle() {
    for other in [
        // Another crate's, though of the same name.
        "use ::a::A;",
        "fn g() { ::a::A::new() }",
        "fn g() { write!(x, \"\", ::a::A) }",
        // Words that only look like it.
        "/// [`super::a::A`]\nfn g() { let x = \"super::a::A\"; }",
        // Its own, not its neighbour's.
        "mod a { pub struct A; } use a::A; fn g() { self::a::A; }",
    ] {
        let files = [("lib.rs", "mod a; mod c;"), ("a.rs", "use super::c;"), ("c.rs", other)];
        assert_eq!(circles(&files), [""; 0], "{other}");
    }
}

#[test]
fn parent_and_child_may_import_each_other() {
    let files = [
        ("lib.rs", "mod room; pub const HERE: u8 = room::low::deep::DEPTH; pub fn root() {}"),
        ("room/mod.rs", "pub mod low; use low::deep::DEPTH; use crate::root; pub struct R;"),
        ("room/low.rs", "pub mod deep; use super::R;"),
        ("room/low/deep.rs", "use super::super::R; fn f() { crate::root() } pub const DEPTH: u8 = crate::HERE;"),
    ];
    assert_eq!(circles(&files), [""; 0]);
}

/// What a parent hands on is its child's: siblings that meet there import each other.
#[test]
fn a_circle_through_a_re_export_is_found() {
    for (way, front) in [
        ("by name", "pub use maker::Thing;"),
        ("under another name", "pub use maker::Made as Thing;"),
        ("everything", "pub use maker::*;"),
        ("twice", "mod front { pub use super::maker::Thing; } pub use front::Thing;"),
    ] {
        let front = format!("mod maker; mod user; {front}");
        let files = [
            ("lib.rs", "mod room;"),
            ("room/mod.rs", front.as_str()),
            ("room/maker.rs", "use super::user::use_it; pub struct Thing; pub struct Made;"),
            ("room/user.rs", "use super::Thing; pub fn use_it() {}"),
        ];
        assert_eq!(circles(&files), ["room/maker.rs room/user.rs"], "{way}");
    }
}

/// From outside, what a room hands on is not its front's, which may import what uses it; a neighbour that hands something on is imported.
#[test]
fn a_front_is_not_imported_and_a_neighbour_that_hands_on_is() {
    let front = [
        ("lib.rs", "mod room; mod user;"),
        ("room/mod.rs", "mod maker; pub use maker::Thing; use crate::user::User;"),
        ("room/maker.rs", "pub struct Thing;"),
        ("user.rs", "use crate::room::Thing; pub struct User;"),
    ];
    assert_eq!(circles(&front), [""; 0]);
    let neighbour = [
        ("lib.rs", "mod maker; mod shop; mod user;"),
        ("maker.rs", "pub struct Thing;"),
        ("shop.rs", "pub use super::maker::Thing; use super::user::User;"),
        ("user.rs", "use super::shop::Thing; pub struct User;"),
    ];
    assert_eq!(circles(&neighbour), ["shop.rs user.rs"]);
}

#[test]
fn imports_of_tests_are_not_reported() {
    for closing in [
        "#[cfg(test)]\nmod tests { use crate::a::A; }",
        "#[cfg(test)]\nmod tests;",
        "#[cfg(test)]\nmod seen;",
        "#[cfg(test)]\nuse crate::a::A;",
        "#[cfg(all(test, unix))]\nfn g() { crate::a::f() }",
        "impl C { #[cfg(test)]\nfn g() { crate::a::f() } }",
    ] {
        let mut files =
            vec![("lib.rs", "mod a; mod c;"), ("a.rs", "use super::c::C; pub struct A;"), ("c.rs", closing)];
        for (file, declared) in [("c/tests.rs", "mod tests;"), ("c/seen.rs", "mod seen;")] {
            files.extend(closing.ends_with(declared).then_some((file, "use crate::a::A;")));
        }
        assert_eq!(circles(&files), [""; 0], "{closing}");
    }
    // The same without the condition, and with one that holds outside tests.
    for closing in [
        "mod seen { use crate::a::A; }",
        "#[cfg(not(test))]\nuse crate::a::A;",
        "#[cfg(any(test, unix))]\nuse crate::a::A;",
    ] {
        let files = [("lib.rs", "mod a; mod c;"), ("a.rs", "use super::c::C; pub struct A;"), ("c.rs", closing)];
        assert_eq!(circles(&files), ["a.rs c.rs"], "{closing}");
    }
}

#[test]
fn long_and_lost_files_and_circles_are_printed() {
    let found = survey(&[
        ("lib.rs", "mod a; mod c;"),
        ("a.rs", "use super::c::C; pub struct A;"),
        ("c.rs", &format!("use crate::a::A; pub struct C;{}", "\n".repeat(501))),
        ("lost.rs", ""),
    ]);
    let lines = [
        "made-up: c.rs has 501 lines, more than 500",
        "made-up: no `mod` leads to lost.rs",
        "made-up: a circle of 2 files, each with the files of the circle that it imports:",
        "  a.rs -> c.rs",
        "  c.rs -> a.rs",
    ];
    assert_eq!(describe_survey_findings_if_any("made-up", &found), lines.map(|line| format!("{line}\n")).concat());
    assert_eq!(describe_survey_findings_if_any("made-up", &survey(&[("lib.rs", "mod a;"), ("a.rs", "")])), "");
}

/// Whoever uses a later folder, or adds one that has no place in the order, is named.
#[test]
fn an_import_against_the_order_of_folders_is_named() {
    let files = |closing: &'static str| {
        [
            ("lib.rs", "mod daemon;"),
            ("daemon/mod.rs", "mod api; mod http; mod new; use http::routes::Route; pub struct Daemon;"),
            ("daemon/api/mod.rs", "pub mod problem;"),
            ("daemon/api/problem.rs", closing),
            ("daemon/http/mod.rs", "pub mod routes;"),
            ("daemon/http/routes.rs", "use crate::daemon::api::problem::Problem; pub struct Route;"),
            ("daemon/new.rs", "use super::Daemon;"),
        ]
    };
    let breaches = |closing| DAEMON.find_order_breaches(&survey(&files(closing)).imports);
    assert_eq!(breaches("use crate::daemon::Daemon; pub struct Problem;"), [""; 0]);
    assert_eq!(breaches("use crate::daemon::http::routes::Route;"), ["daemon/api/problem.rs -> daemon/http/routes.rs"]);
    assert_eq!(breaches("use crate::daemon::new::New;"), ["daemon/api/problem.rs -> daemon/new.rs"]);
}

/// Of each order, its most basic entry is used, and nothing is used against the order.
#[test]
fn folders_use_each_other_in_one_direction() {
    let all = survey_each_crate(&crate::repository_root().unwrap()).unwrap();
    for order in ORDERS {
        let survey = &all.iter().find(|(name, _)| name == order.crate_name).unwrap().1;
        assert_eq!(order.find_order_breaches(&survey.imports), [""; 0], "{}", order.crate_name);
        let reversed: Vec<&'static str> = order.entries.iter().rev().copied().collect();
        let against = FolderOrder { entries: reversed.leak(), ..order };
        assert!(against.find_order_breaches(&survey.imports).len() > 5, "{}: no import is seen", order.crate_name);
    }
}

/// Every crate is read, and every file of a `src` is led to: otherwise its imports would be missing.
#[test]
fn this_repository_is_read_whole() {
    let all = survey_each_crate(&crate::repository_root().unwrap()).unwrap();
    let names: Vec<&str> = all.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "era-host",
            "era-model",
            "era-planner",
            "era-python",
            "era-study",
            "era-files",
            "era-shared",
            "hil-tests",
            "xtask",
            "era-bench",
            "era-load",
            "era-fuzz",
            "workspace-hack",
            "era-firmware"
        ]
    );
    for (name, survey) in &all {
        assert_eq!(survey.lost, [""; 0], "{name}");
    }
}

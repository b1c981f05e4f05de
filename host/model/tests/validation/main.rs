//! Published results beside the program's. `cargo test -p era-model --test validation -- --nocapture --test-threads 1` prints the
//! tables of `docs/src/validation.md`; the page must hold them.

mod cases;
mod closed;
mod panel;
mod ritz;
#[path = "../numerics/scenes.rs"]
#[expect(dead_code, reason = "shared with other tests")]
mod scenes;
mod table;
mod thick;

const PAGE: &str = include_str!("../../../../docs/src/validation.md");

/// Prints a table, and holds the page to it.
fn on_the_page(lines: &[String]) {
    for line in lines {
        println!("{line}");
    }
    let missing: Vec<&String> = lines.iter().filter(|line| !PAGE.lines().any(|on| on == *line)).collect();
    assert!(missing.is_empty(), "docs/src/validation.md lacks {missing:#?}");
}

fn hold(cases: &[table::Case]) {
    let lines: Vec<String> = cases.iter().flat_map(table::Case::table).collect();
    on_the_page(&lines);
}

#[test]
fn nafems() {
    hold(&cases::nafems_cases());
}

#[test]
fn leissa() {
    hold(&cases::leissa_cases());
}

#[test]
fn corner_points() {
    hold(&[cases::corner_case()]);
}

#[test]
fn tuned_mass() {
    hold(&cases::tuned_mass_cases());
}

#[test]
fn beams() {
    hold(&cases::beam_cases());
}

#[test]
fn plies() {
    hold(&[cases::laminate_case()]);
}

/// The references are not the program's: a plate, a beam and a mass that are wrong by a part in a thousand are found.
#[test]
#[should_panic(expected = "is off")]
fn a_wrong_plate_is_found() {
    let mut case = cases::corner_case();
    case.scene.surface.thickness_m *= 1.001;
    case.table();
}

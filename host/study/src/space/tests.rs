//! Designs against what the scene reads back.

use super::*;
use era_model::scene::{EXAMPLE_BAR, EdgeKind, STARTING_PLATE};

fn space_of(study: &str, scene: &str) -> Result<DesignSpace, SceneError> {
    let text = format!("version = 1\nname = \"s\"\nscene = \"x.toml\"\n{study}\n[[wish]]\nfigure = \"weakest_g\"\n");
    DesignSpace::new(&StudySpec::parse("study.toml", &text)?, "study.toml", &text, "x.toml", scene)
}

fn space(study: &str) -> DesignSpace {
    space_of(study, STARTING_PLATE).unwrap()
}

fn scene(space: &DesignSpace, point: &[f64]) -> Scene {
    space.build_scene_of_design_with_deviations_checking_distances(&space.design_at_point(point), &[]).unwrap()
}

#[test]
fn numbers_go_where_their_paths_lead() {
    let study = "[[variable]]\nkey = \"support.*.stiffness_n_per_m\"\nfrom = 500\nto = 8000\nscale = \"log\"\n\
                 [[variable]]\nkey = [\"surface.thickness_mm\"]\nfrom = 1\nto = 3\nstep = 0.5\n\
                 [[variable]]\nkey = \"surface.damping.loss_factor\"\nfrom = 0\nto = 0.2\n";
    let space = space(study);
    let found = scene(&space, &[0.5, 0.999, 0.25]);
    assert!(found.supports.iter().all(|support| support.stiffness_n_per_m == 2000.0), "{:?}", found.supports);
    assert_eq!(found.surface.thickness_m, 3e-3);
    assert_eq!(found.surface.damping, era_model::scene::SurfaceDamping::LossFactor(0.05));
    assert_eq!(space.dimensions()[1].count, Some(5));
    // A key that the file does not have.
    let space = super::tests::space("[[variable]]\nkey = \"actuator.left.housing_mass_g\"\nfrom = 1\nto = 2\n");
    assert_eq!(scene(&space, &[0.5]).actuators[0].housing_mass_kg, 1.5e-3);
}

#[test]
fn places_are_free_on_a_line_and_mirrored() {
    let study = "[[variable]]\nplace = \"actuator.left\"\nwithin_mm = [10, 20, 110, 120]\n\
                 [[variable]]\nplace = \"actuator.right\"\nmirror_of = \"actuator.left\"\nmirrored = \"both\"\n\
                 [[variable]]\nplace = \"support[1]\"\nline_mm = [0, 0, 40, 30]\nstep_mm = 25\n";
    let space = space(study);
    let found = scene(&space, &[0.25, 0.5, 0.6]);
    let at = |x: f64, y: f64| (x / 1e3, y / 1e3);
    assert_eq!((found.actuators[0].x_m, found.actuators[0].y_m), at(35.0, 70.0));
    assert_eq!((found.actuators[1].x_m, found.actuators[1].y_m), at(265.0, 130.0));
    assert_eq!((found.supports[0].x_m, found.supports[0].y_m), at(20.0, 15.0));
    assert_eq!(space.dimensions().len(), 3);
    let columns = space.table_columns();
    assert_eq!(columns.len(), 6);
    let design = space.design_at_point(&[0.25, 0.5, 0.6]);
    assert_eq!(columns[2].number_or_choice_index_in_design_unless_scene_value_kept(&design), Some(265.0));
    assert!(columns[2].follows && !columns[0].follows);
}

#[test]
fn choices_take_tables_and_words() {
    let study = "[[variable]]\nkey = \"surface.material\"\nnames = [\"metal\", \"glass\"]\nvalues = [\n\
                 { youngs_modulus_pa = 69e9, poisson_ratio = 0.33, density_kg_m3 = 2700.0 }, # light\n\
                 { youngs_modulus_pa = 72e9, poisson_ratio = 0.22, density_kg_m3 = 2500.0 },\n]\n\
                 [[variable]]\nkey = \"edge[1].kind\"\nvalues = [\"pinned\", \"clamped\"]\n";
    let plate = format!("{STARTING_PLATE}\n[[edge]]\nside = \"left\"\nkind = \"pinned\"\n");
    let space = space_of(study, &plate).unwrap();
    let found = scene(&space, &[0.9, 0.9]);
    assert_eq!((found.surface.material.density_kg_m3, found.edges[0].kind), (2500.0, EdgeKind::Clamped));
    let found = scene(&space, &[0.1, 0.1]);
    assert_eq!((found.surface.material.density_kg_m3, found.edges[0].kind), (2700.0, EdgeKind::Pinned));
    let design = space.design_at_point(&[0.9, 0.1]);
    assert_eq!(space.table_columns()[0].text_in_design_unless_scene_value_kept(&design).as_deref(), Some("glass"));
    // The heading and what stands beside values stay.
    let text = space.design_as_scene_text(&design).unwrap();
    assert!(text.contains("[surface.material]") && text.contains("# about 5 % of critical"), "{text}");
}

#[test]
fn choices_take_tables_of_lists() {
    let study = "[[variable]]\nkey = \"support[1]\"\nvalues = [\n\
                 { x_mm = 0.0, y_mm = 0.0, stiffness_n_per_m = 500.0 },\n\
                 { x_mm = 10.0, y_mm = 0.0, stiffness_n_per_m = 50000.0, damping_n_s_per_m = 2.0 },\n]\n\
                 [[variable]]\nkey = \"edge[1]\"\nvalues = [\n\
                 { side = \"left\", kind = \"clamped\" },\n{ side = \"right\", kind = \"pinned\" },\n]\n";
    let plate = format!("{STARTING_PLATE}\n[[edge]]\nside = \"left\"\nkind = \"pinned\"\n");
    let space = space_of(study, &plate).unwrap();
    let found = scene(&space, &[0.9, 0.9]);
    let support = |scene: &Scene, k: usize| {
        let own = &scene.supports[k];
        (own.x_m, own.stiffness_n_per_m, own.damping_n_s_per_m)
    };
    assert_eq!((support(&found, 0), found.edges[0].kind), ((0.01, 50000.0, 2.0), EdgeKind::Pinned));
    let found = scene(&space, &[0.1, 0.1]);
    // What the table does not have is not that of the scene's file.
    assert_eq!((support(&found, 0), found.edges[0].kind), ((0.0, 500.0, 0.0), EdgeKind::Clamped));
    assert_eq!(support(&found, 1), (0.3, 2000.0, 1.3));
    let text = space.design_as_scene_text(&space.design_at_point(&[0.9, 0.9])).unwrap();
    assert!(text.contains("# Four corner springs") && text.matches("[[support]]").count() == 4, "{text}");
}

#[test]
fn tables_of_lists_take_nothing_but_tables() {
    let study = "[[variable]]\nkey = \"support[1]\"\nfrom = 1\nto = 2\n\
                 [[variable]]\nkey = \"actuator.*\"\nvalues = [1, { x_mm = 0.0 }]\n";
    let error = space_of(study, STARTING_PLATE).unwrap_err();
    hold(
        &error,
        &[
            (
                4,
                "support[1] is the path of a table, not of a single value: add a key of this table to the path, or make each entry of `values` a table",
            ),
            (8, "actuator.* is the path of a table"),
        ],
    );
}

#[test]
fn a_count_takes_the_first_ones_and_all_else_does_without_the_rest() {
    let study = "[[variable]]\ncount = \"actuator\"\nfrom = 1\nto = 2\n\
                 [[variable]]\nplace = \"actuator.right\"\nwithin_mm = [70, 90, 80, 110]\n\
                 [[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 30\n";
    let space = space(study);
    let one = scene(&space, &[0.2, 0.5, 0.5]);
    assert_eq!(one.actuators.len(), 1);
    let refused = space
        .build_scene_of_design_with_deviations_checking_distances(&space.design_at_point(&[0.8, 0.5, 0.5]), &[])
        .unwrap_err();
    assert_eq!(refused.to_string(), "left and right are 0.0 mm apart, but must be at least 30 mm apart");
}

#[test]
fn what_may_be_off_is_off_by_parts_and_amounts() {
    let study = "[[uncertain]]\nkey = \"support.*.stiffness_n_per_m\"\npart = 0.2\n\
                 [[uncertain]]\nkey = \"actuator.*.x_mm\"\nby = 2.0\nvary = \"together\"\n\
                 [[uncertain]]\nkey = \"support[1].x_mm\"\nby = 2.0\n";
    let space = space(study);
    assert_eq!(space.count_independent_uncertain_values(), 6);
    let found = space.scene_of_file_with_deviations(&[1.0, -1.0, 0.5, 0.0, 1.0, -1.0]).unwrap();
    let springs: Vec<f64> = found.supports.iter().map(|support| support.stiffness_n_per_m).collect();
    assert_eq!(springs, [2400.0, 1600.0, 2200.0, 2000.0]);
    assert_eq!([found.actuators[0].x_m, found.actuators[1].x_m], [0.077, 0.227]);
    // No place is off the surface.
    assert_eq!(found.supports[0].x_m, 0.0);
}

/// A panel is mirrored about the middle that it has, and ends where it ends, be its sides those of the scene's file or a variable's.
#[test]
fn sides_are_those_of_the_design() {
    let places = "[[variable]]\nplace = \"actuator.left\"\nwithin_mm = [10, 20, 110, 120]\n\
                  [[variable]]\nplace = \"actuator.right\"\nmirror_of = \"actuator.left\"\nmirrored = \"both\"\n\
                  [[uncertain]]\nkey = [\"support[2].x_mm\", \"support[3].y_mm\"]\nby = 5\n";
    let sides = "[[variable]]\nkey = [\"surface.length_mm\", \"support[2].x_mm\", \"support[4].x_mm\"]\nfrom = 240\nto = 400\n\
                 [[variable]]\nkey = [\"surface.width_mm\", \"support[3].y_mm\", \"support[4].y_mm\"]\nfrom = 140\nto = 260\n";
    let varied = space(&format!("{places}{sides}"));
    for (part, length, width) in [(0.0, "240.0", "140.0"), (1.0, "400.0", "260.0")] {
        let plate = STARTING_PLATE.replace("300.0", length).replace("_mm = 200.0", &format!("_mm = {width}"));
        let own = space_of(places, &plate).unwrap();
        for off in [vec![], vec![1.0, 1.0], vec![-1.0, 0.5]] {
            let found = varied
                .build_scene_of_design_with_deviations_checking_distances(
                    &varied.design_at_point(&[0.25, 0.5, part, part]),
                    &off,
                )
                .unwrap();
            assert_eq!(
                found,
                own.build_scene_of_design_with_deviations_checking_distances(&own.design_at_point(&[0.25, 0.5]), &off)
                    .unwrap(),
                "{length} {off:?}"
            );
            let (length_m, width_m) = (found.surface.length_m, found.surface.width_m);
            let right = &found.actuators[1];
            assert!((right.x_m - length_m + 0.035).abs() < 1e-9 && (right.y_m - width_m + 0.07).abs() < 1e-9);
        }
    }
}

#[test]
fn coordinates_stay_on_a_surface_whose_sides_are_off() {
    let length = "[[uncertain]]\nkey = [\"surface.length_mm\", \"support[2].x_mm\", \"support[4].x_mm\"]\nby = 3\nvary = \"together\"\n";
    let together = space(length);
    for (off, length_m) in [(1.0, 0.303), (-1.0, 0.297)] {
        let found = together.scene_of_file_with_deviations(&[off]).unwrap();
        assert_eq!([found.surface.length_m, found.supports[1].x_m, found.supports[3].x_m], [length_m; 3]);
    }
    let coordinates = "[[uncertain]]\nkey = \"support.*.x_mm\"\nby = 2\nvary = \"together\"\n\
                       [[uncertain]]\nkey = \"surface.length_mm\"\nby = 1\n";
    let found = space(coordinates).scene_of_file_with_deviations(&[1.0, 1.0]).unwrap();
    assert_eq!([0, 1, 2, 3].map(|k: usize| found.supports[k].x_m), [0.002, 0.301, 0.002, 0.301]);
}

/// Each mistake with its line, and what its text has to have.
fn hold(error: &SceneError, expected: &[(usize, &str)]) {
    let told: Vec<(usize, &str)> = error.mistakes.iter().map(|mistake| (mistake.line, mistake.text.as_str())).collect();
    assert_eq!(told.len(), expected.len(), "{told:?}");
    for ((line, text), (wanted_line, wanted)) in told.iter().zip(expected) {
        assert!(line == wanted_line && text.contains(wanted), "{line}: {text}; wanted {wanted_line}: {wanted}");
    }
}

#[test]
fn what_leads_nowhere_or_is_never_taken_is_reported_with_its_line() {
    let study = "[[variable]]\nkey = \"support[7].x_mm\"\nfrom = 0\nto = 1\n\
                 [[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 200\nto = 300\n\
                 [[variable]]\nplace = \"actuator.right\"\nmirror_of = \"actuator.left\"\nmirrored = \"x\"\n\
                 [[variable]]\ncount = \"actuator\"\nfrom = 1\nto = 3\n\
                 [[variable]]\nkey = \"surface.tickness_mm\"\nfrom = 1\nto = 3\n";
    let error = space_of(study, STARTING_PLATE).unwrap_err();
    let expected = [
        (4, "the scene has no support[7]"),
        (
            8,
            "the scene is valid with none of them (with the first of these values, the scene is not valid for this reason: surface.thickness_mm is 200, \
             but must be 0.001 to 100",
        ),
        (12, "must be the `place` of an earlier [[variable]]"),
        (16, "`to` is 3, but the scene has only 2 [[actuator]] tables"),
        (20, "unknown key `surface.tickness_mm`; did you mean thickness_mm?"),
    ];
    hold(&error, &expected);
}

#[test]
fn a_count_of_what_is_no_list_is_reported_with_what_may_be_meant() {
    for (list, hint) in [("actuators", "did you mean actuator?"), ("mass", "lists in the scene: support, actuator")] {
        let study = format!("[[variable]]\ncount = \"{list}\"\nfrom = 1\nto = 2\n");
        let expected = format!("the scene has no [[{list}]]; {hint}");
        hold(&space_of(&study, STARTING_PLATE).unwrap_err(), &[(4, expected.as_str())]);
    }
}

#[test]
fn a_count_is_called_by_the_plural_of_its_list() {
    let mass = "[[mass]]\nx_mm = 30\ny_mm = 40\nmass_g = 5\n";
    for (list, name) in [("actuator", "number of actuators"), ("mass", "number of masses")] {
        let study = format!("[[variable]]\ncount = \"{list}\"\nfrom = 1\nto = 1\n");
        let space = space_of(&study, &format!("{STARTING_PLATE}{mass}")).unwrap();
        assert_eq!(space.table_columns()[0].name, name);
    }
}

#[test]
fn values_that_the_scene_takes_in_some_designs_are_no_mistake() {
    let shorter = STARTING_PLATE.replace("300.0", "240.0");
    let longer = "[[variable]]\nkey = [\"surface.length_mm\", \"support[2].x_mm\", \"support[4].x_mm\"]\nfrom = 400\nto = 500\n\
                  [[variable]]\nplace = \"actuator.right\"\nwithin_mm = [260, 10, 380, 100]\n";
    let space = space_of(longer, &shorter).unwrap();
    assert_eq!(scene(&space, &[0.0, 0.5, 0.5]).actuators[1].x_m, 0.32);
    // A tenth of this is on the panel, but neither an end nor a middle of it.
    let small = shorter.replace("_mm = 200.0", "_mm = 113.0");
    assert!(space_of("[[variable]]\nplace = \"actuator.right\"\nwithin_mm = [-10, -10, 500, 500]\n", &small).is_ok());
    // What is never taken is told, and what goes together is not told because of it.
    let thick = format!("{longer}[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 200\nto = 300\n");
    hold(
        &space_of(&thick, &shorter).unwrap_err(),
        &[(11, "variable[3] (surface.thickness_mm): the program tried several values")],
    );
}

/// Of two variables that change the same the first would come to nothing, and of two columns with one name one would be lost.
#[test]
fn variables_that_are_not_held_apart_are_reported_with_both_lines() {
    let study = "[[variable]]\nkey = \"support[1].x_mm\"\nfrom = 0\nto = 1\n\
                 [[variable]]\nname = \"other\"\nkey = \"support.*.x_mm\"\nfrom = 0\nto = 300\n\
                 [[variable]]\nname = \"status\"\nkey = \"surface.thickness_mm\"\nfrom = 1\nto = 2\n\
                 [[variable]]\nname = \"weakest_g_low\"\nkey = \"support[1].y_mm\"\nfrom = 0\nto = 1\n\
                 [[variable]]\nname = \"a\"\nplace = \"actuator.left\"\nwithin_mm = [10, 20, 110, 120]\n\
                 [[variable]]\nname = \"a.y_mm\"\nkey = \"support[2].y_mm\"\nfrom = 0\nto = 1\n\
                 [[variable]]\nkey = \"actuator.left.x_mm\"\nfrom = 20\nto = 30\n";
    let expected = [
        (
            9,
            "variable[2] (other): this variable and variable[1] (support[1].x_mm) in line 4 both change \
             support[1].x_mm",
        ),
        (
            14,
            "variable[3] (status): the name of this variable's column in the table of designs would be \"status\", \
             but the table itself already has",
        ),
        (
            19,
            "variable[4] (weakest_g_low): the name of this variable's column in the table of designs would be \
             \"weakest_g_low\", but a figure already has",
        ),
        (
            28,
            "variable[6] (a.y_mm): the name of this variable's column in the table of designs would be \"a.y_mm\", \
             but variable[5] in line 24 already has",
        ),
        (32, "this variable and variable[5] (a) in line 24 both change actuator[1].x_mm"),
    ];
    hold(&space_of(study, STARTING_PLATE).unwrap_err(), &expected);
    // A table takes a key of it that was set before with it, and leaves one that is set afterwards.
    let key = "[[variable]]\nkey = \"surface.material.density_kg_m3\"\nfrom = 2600\nto = 2800\n";
    let table = "[[variable]]\nkey = \"surface.material\"\nvalues = [{ youngs_modulus_pa = 69e9, poisson_ratio = 0.33, density_kg_m3 = 1.0 }]\n";
    let error = space_of(&format!("{key}{table}"), STARTING_PLATE).unwrap_err();
    let both = "in line 4 both change surface.material.density_kg_m3";
    hold(&error, &[(8, both)]);
    let space = space(&format!("{table}{key}"));
    assert_eq!(scene(&space, &[0.5, 0.5]).surface.material.density_kg_m3, 2700.0);
}

#[test]
fn what_is_off_or_apart_and_leads_nowhere_is_reported_with_its_line() {
    let study = "[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1\nto = 2\n\
                 [[apart]]\ndistance_mm = 30\nplaces = [\"actuator.*\", \"actuator.middle\"]\n\
                 [[uncertain]]\npart = 0.1\nkey = \"surface.kind\"\n\
                 [[uncertain]]\npart = 0.1\nkey = \"support[9].x_mm\"\n";
    let error = space_of(study, STARTING_PLATE).unwrap_err();
    let expected = [
        (10, "apart[1]: actuator.middle: the scene has no actuator.middle"),
        (
            13,
            "uncertain[1] (surface.kind): `key` must be the path of a number in the scene file, but there is no number at this path",
        ),
        (16, "uncertain[2]: support[9].x_mm: the scene has no support[9]"),
    ];
    hold(&error, &expected);
}

/// The scene that a study starts from may be one that no design could be: it is what they are compared with.
#[test]
fn the_scene_as_it_is_need_not_keep_what_designs_have_to() {
    let study = "[[variable]]\nplace = \"actuator.right\"\nwithin_mm = [100, 100, 200, 100]\n\
                 [[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 160\n";
    let space = space(study);
    assert_eq!(space.scene_of_file_with_deviations(&[]).unwrap(), Scene::parse("plate", STARTING_PLATE).unwrap());
    assert!(
        space.build_scene_of_design_with_deviations_checking_distances(&space.design_of_scene_file(), &[]).is_err()
            && space
                .build_scene_of_design_with_deviations_checking_distances(&space.design_at_point(&[0.5, 0.5]), &[])
                .is_err()
    );
}

#[test]
fn chosen_numbers_have_few_digits() {
    assert_eq!(
        [0.1 + 0.2, 1.0 / 3.0, 123_456_789.0, -2e-9 / 3.0].map(super::design::round_to_six_significant_digits),
        [0.3, 0.333_333, 123_457_000.0, -6.66667e-10]
    );
}

/// The scene's own file as a design: numbers that are the same for all, places, numbers of parts, and a choice by what it means.
#[test]
fn the_scene_as_it_is_is_a_design() {
    let study = "[[variable]]\nkey = \"support.*.stiffness_n_per_m\"\nfrom = 500\nto = 8000\n\
                 [[variable]]\nkey = \"support.*.x_mm\"\nfrom = 0\nto = 300\n\
                 [[variable]]\nkey = \"actuator.left.housing_mass_g\"\nfrom = 1\nto = 2\n\
                 [[variable]]\nplace = \"actuator.left\"\nwithin_mm = [10, 20, 110, 120]\n\
                 [[variable]]\nplace = \"actuator.right\"\nmirror_of = \"actuator.left\"\nmirrored = \"y\"\n\
                 [[variable]]\ncount = \"support\"\nfrom = 1\nto = 4\n\
                 [[variable]]\nkey = \"surface.material\"\nnames = [\"glass\", \"metal\"]\nvalues = [\n\
                 { youngs_modulus_pa = 72e9, poisson_ratio = 0.22, density_kg_m3 = 2500 },\n\
                 { density_kg_m3 = 2700, youngs_modulus_pa = 69e9, poisson_ratio = 0.33 },\n]\n";
    let space = space(study);
    let wanted = [
        VariableSetting::Number(2000.0),
        VariableSetting::Kept,
        VariableSetting::Kept,
        VariableSetting::Place([75.0, 100.0]),
        VariableSetting::Place([225.0, 100.0]),
        VariableSetting::Count(4),
        VariableSetting::Choice(1),
    ];
    assert_eq!(space.design_of_scene_file().settings, wanted);
    // It is that scene.
    assert_eq!(
        space.build_scene_of_design_with_deviations_checking_distances(&space.design_of_scene_file(), &[]).unwrap(),
        space.scene_of_file_with_deviations(&[]).unwrap()
    );
}

/// What has no place is no table of one, and one place is apart from nothing.
#[test]
fn what_is_held_apart_has_places() {
    let table = "[[variable]]\nplace = \"actuator.left\"\nwithin_mm = [10, 10, 140, 190]\n";
    let told = |places: &str, expected: &str| {
        let study = format!("{table}[[apart]]\nplaces = {places}\ndistance_mm = 50\n");
        hold(&space_of(&study, STARTING_PLATE).unwrap_err(), &[(8, expected)]);
    };
    told(
        "[\"surface\"]",
        "apart[1]: the path surface must be the path of a table with the key x_mm, such as an [[actuator]], but",
    );
    told("[\"actuator\"]", "apart[1]: the path actuator must be the path of a table");
    told(
        "[\"actuator.left.x_mm\", \"actuator.right.x_mm\"]",
        "apart[1]: the path actuator.left.x_mm must be the path of a table",
    );
    told(
        "[\"actuator.left\", \"actuator[1]\"]",
        "apart[1]: the paths must lead to at least 2 different tables (such as two actuators), but the number of different tables is 1",
    );
    assert!(
        space_of(&format!("{table}[[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 50\n"), STARTING_PLATE).is_ok()
    );
}

/// A bar has no y, whatever stands in its file: 10 mm along it are 10 mm.
#[test]
fn a_bars_y_holds_nothing_apart() {
    let bar = EXAMPLE_BAR.replacen("x_mm", "y_mm = 19\nx_mm", 1);
    let study = "[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1.5\nto = 2\n[[apart]]\nplaces = [\"support.*\", \"actuator.*\"]\ndistance_mm = 5000\n";
    let of = |text: &str| match space_of(study, text) {
        Ok(space) => space
            .build_scene_of_design_with_deviations_checking_distances(&space.design_at_point(&[0.5]), &[])
            .err()
            .map(|error| error.to_string()),
        Err(error) => Some(error.to_string()),
    };
    assert!(of(&bar).is_some_and(|told| told.contains("apart")) && of(&bar) == of(EXAMPLE_BAR), "{:?}", of(&bar));
}

/// Off by both would be off by twice as much.
#[test]
fn a_value_is_off_in_one_way() {
    let table = "[[variable]]\nkey = \"surface.thickness_mm\"\nfrom = 1.5\nto = 2\n";
    let off = |key: &str| format!("[[uncertain]]\nkey = \"{key}\"\npart = 0.1\n");
    let study = format!("{table}{}{}", off("support.*.stiffness_n_per_m"), off("support[1].stiffness_n_per_m"));
    let expected = "this entry and uncertain[1] (support.*.stiffness_n_per_m) in line 9 both make \
                    support[1].stiffness_n_per_m uncertain";
    hold(&space_of(&study, STARTING_PLATE).unwrap_err(), &[(12, expected)]);
}

//! Scene files: the examples are read, and each mistake is told with key, value, range and line.

use era_model::scene::{EXAMPLE_BAR, Mount, STARTING_PLATE, Scene, SurfaceDamping, SurfaceKind};

#[test]
fn examples_are_read() {
    let plate = Scene::parse("plate.toml", STARTING_PLATE).unwrap();
    assert_eq!((plate.surface.kind, plate.supports.len(), plate.actuators.len()), (SurfaceKind::Plate, 4, 2));
    assert_eq!(plate.surface.damping, SurfaceDamping::LossFactor(0.01));
    assert_eq!(plate.screen.convert_px_to_surface_m(960.0, 640.0).unwrap(), (0.15, 0.1));
    let bar = Scene::parse("bar.toml", EXAMPLE_BAR).unwrap();
    assert_eq!((bar.surface.kind, bar.actuators[0].mount), (SurfaceKind::Bar, Mount::Grounded));
    assert_eq!(bar.actuators[0].y_m, 0.01, "on the axis");
}

#[test]
fn pixels_and_millimetres_are_each_others_inverse() {
    let text = STARTING_PLATE
        .replace("height_px = 1280", "height_px = 1280\nx_mm = 20.0\ny_mm = 10.0\nwidth_mm = 240.0\nheight_mm = 160.0");
    let screen = Scene::parse("inset", &text).unwrap().screen;
    let (x, y) = screen.convert_px_to_surface_m(480.0, 320.0).unwrap();
    assert!((x - 0.08).abs() < 1e-12 && (y - 0.05).abs() < 1e-12);
    let (u, v) = screen.convert_surface_m_to_px(x, y).unwrap();
    assert!((u - 480.0).abs() < 1e-9 && (v - 320.0).abs() < 1e-9);
    assert_eq!(screen.convert_px_to_surface_m(-1.0, 0.0).unwrap_err().field, "x_px");
    assert_eq!(screen.convert_px_to_surface_m(0.0, 1281.0).unwrap_err().max, 1280.0);
    assert_eq!(screen.convert_surface_m_to_px(0.01, 0.05).unwrap_err().field, "x_mm");
}

/// Replaces one piece of the example plate and returns what is said about it.
fn mistake(from: &str, to: &str) -> String {
    assert!(STARTING_PLATE.contains(from), "{from:?} is in the example");
    let text = STARTING_PLATE.replacen(from, to, 1);
    Scene::parse("panel.toml", &text).unwrap_err().to_string()
}

/// The line of the first place where the example has `text`.
fn line_of(text: &str) -> usize {
    STARTING_PLATE[..STARTING_PLATE.find(text).unwrap()].matches('\n').count() + 1
}

#[test]
fn each_mistake_names_key_value_range_and_line() {
    // What is changed, to what, and what a person must be told.
    let cases: &[(&str, &str, &[&str])] = &[
        ("length_mm = 300.0", "length_mm = -300.0", &["surface.length_mm", "-300", "1 to 10000"]),
        ("length_mm = 300.0", "lenght_mm = 300.0", &["unknown key `surface.lenght_mm`", "did you mean length_mm?"]),
        ("thickness_mm = 2.0", "thickness_mm = \"two\"", &["surface.thickness_mm", "\"two\"", "a number"]),
        (
            "poisson_ratio = 0.33",
            "poisson_ratio = 0.5",
            &["surface.material.poisson_ratio", "0.5", "between -1 and 0.5"],
        ),
        ("density_kg_m3 = 2700.0", "density_kg_m3 = 0", &["surface.material.density_kg_m3", "0", "0.001 to 1e7"]),
        ("loss_factor = 0.01", "loss_factor = nan", &["surface.damping.loss_factor", "NaN", "0 to 2"]),
        (
            "loss_factor = 0.01",
            "loss_factor = 0.01\nmodal_ratio = 0.02",
            &["loss_factor and modal_ratio", "at most one kind"],
        ),
        ("kind = \"plate\"", "kind = \"shell\"", &["surface.kind", "\"shell\"", "\"plate\", \"bar\""]),
        ("width_px = 1920", "width_px = 1920.5", &["screen.width_px", "1920.5", "whole number from 1 to 100000"]),
        ("x_mm = 75.0", "x_mm = 301.0", &["actuator[1].x_mm", "301", "0 to 300"]),
        ("id = \"right\"", "id = \"left\"", &["actuator[2].id", "\"left\"", "already"]),
        (
            "mount = \"grounded\"",
            "mount = \"glued\"",
            &["actuator[1].mount", "\"glued\"", "\"inertial\", \"grounded\""],
        ),
        ("moving_mass_g = 10.0", "moving_mass_g = -1", &["actuator[1].moving_mass_g", "-1", "to 1e12"]),
        ("max_voltage_v = 2000.0", "max_voltage_v = 1e9", &["actuator[1].max_voltage_v", "1e9", "1 to 10000"]),
        (
            "stiffness_n_per_m = 2000.0",
            "stiffness_n_per_m = inf",
            &["support[1].stiffness_n_per_m", "inf", "0 to 1e20"],
        ),
        (
            "damping_n_s_per_m = 1.3 ",
            "damping_n_s_per_m = 1.3\nloss_factor = 2.5 ",
            &["support[1].loss_factor", "2.5", "0 to 2"],
        ),
        ("version = 1", "version = 1\nfinger = { mass_g = -1 }", &["finger.mass_g", "-1", "0 to 1000"]),
        (
            "version = 1",
            "version = 1\nfinger = { stiffness_n_per_m = 2e6 }",
            &["finger.stiffness_n_per_m", "2000000", "0 to 1000000"],
        ),
        ("version = 1", "version = 1\nfinger = { mas_g = 1 }", &["unknown key `finger.mas_g`", "did you mean mass_g?"]),
        ("version = 1", "version = 1\nair = { sealed_depth_mm = 0 }", &["air.sealed_depth_mm", "0", "0.01 to 10000"]),
        (
            "version = 1",
            "version = 1\nair = { added_mass_kg_per_m2 = -0.1 }",
            &["air.added_mass_kg_per_m2", "-0.1", "0 to 1000"],
        ),
        ("version = 1", "version = 2", &["version is 2, but must be 1"]),
        ("[[support]]", "[[suport]]", &["unknown key `suport`", "did you mean support?"]),
    ];
    for (from, to, wanted) in cases {
        let said = mistake(from, to);
        for piece in *wanted {
            assert!(said.contains(piece), "{to:?} gave {said:?}, which lacks {piece:?}");
        }
        // A second key on a line of its own is one further down.
        let line = line_of(from) + to.matches('\n').count();
        assert!(said.contains(&format!("panel.toml:{line}:")), "{to:?} gave {said:?}, not line {line}");
    }
}

#[test]
fn another_version_is_said_once() {
    assert_eq!(mistake("version = 1", "version = 2").matches("version").count(), 1);
}

#[test]
fn what_is_missing_is_named() {
    assert!(
        mistake("youngs_modulus_pa = 69e9", "")
            .contains("surface.material.youngs_modulus_pa is missing, but must be a number from 1 to 1e18")
    );
    assert!(mistake("id = \"left\"", "").contains("actuator[1].id is missing"));
    assert!(mistake("version = 1", "").contains("version is missing"));
    let said = Scene::parse("empty.toml", "").unwrap_err().to_string();
    assert!(said.contains("surface is missing, but must be a table, written [surface]"), "{said}");
}

#[test]
fn edges_must_fit_the_surface() {
    let with = |text: &str, edges: &str| Scene::parse("edges.toml", &format!("{text}\n{edges}"));
    let left = "[[edge]]\nside = \"left\"\nkind = \"pinned\"\n";
    let twice = with(STARTING_PLATE, &format!("{left}{left}")).unwrap_err().to_string();
    assert!(twice.contains("edge[2].side") && twice.contains("earlier"), "{twice}");
    let top = with(EXAMPLE_BAR, "[[edge]]\nside = \"top\"\nkind = \"pinned\"\n").unwrap_err().to_string();
    assert!(top.contains("edge[1].side is \"top\"") && top.contains("\"left\", \"right\""), "{top}");
    let springs = "[[edge]]\nside = \"left\"\nkind = \"elastic\"\nstiffness_n_per_m2 = 1e5\n";
    assert!(with(STARTING_PLATE, springs).is_ok());
    let wrong_unit = with(EXAMPLE_BAR, springs).unwrap_err().to_string();
    assert!(
        wrong_unit.contains("stiffness_n_per_m2") && wrong_unit.contains("did you mean stiffness_n_per_m?"),
        "{wrong_unit}"
    );
}

#[test]
fn broken_toml_and_all_mistakes_at_once() {
    let said = mistake("width_mm = 200.0", "width_mm = = 200.0");
    assert!(said.contains(&format!("panel.toml:{}: not valid TOML", line_of("width_mm = 200.0"))), "{said}");
    let twice =
        Scene::parse("panel.toml", &STARTING_PLATE.replace("[[support]]", "[support]")).unwrap_err().to_string();
    assert!(twice.contains("[support] is given twice") && twice.contains("is written [[support]]"), "{twice}");
    let twice = Scene::parse("panel.toml", &format!("{STARTING_PLATE}\n[surface]\n")).unwrap_err().to_string();
    assert!(twice.ends_with("[surface] is given twice, but may be given only once"), "{twice}");
    let text = STARTING_PLATE
        .replace("thickness_mm = 2.0", "thickness_mm = 0")
        .replace("air_gap_um = 500.0", "air_gap_um = -5");
    let error = Scene::parse("panel.toml", &text).unwrap_err();
    assert_eq!(error.mistakes.len(), 3, "{error}");
    let missing = Scene::load(std::path::Path::new("no/such/file.toml")).unwrap_err().to_string();
    assert!(missing.contains("no/such/file.toml") && missing.contains("cannot read"), "{missing}");
}

#[test]
fn active_area_lies_on_the_surface() {
    let with = |area: &str| mistake("height_px = 1280", &format!("height_px = 1280\n{area}"));
    let line = line_of("height_px = 1280");
    let cases: &[(&str, usize, &[&str])] = &[
        ("x_mm = 10.0\nwidth_mm = 295.0", line + 2, &["screen.width_mm", "305 mm", "the surface ends at 300 mm"]),
        ("height_mm = 200.1", line + 1, &["screen.height_mm", "200.1 mm", "the surface ends at 200 mm"]),
        ("x_mm = 300.0", line + 1, &["screen.x_mm is 300", "below 300"]),
        ("y_mm = -1.0", line + 1, &["screen.y_mm is -1", "0 to 200"]),
        ("width_mm = 0.0", line + 1, &["screen.width_mm is 0", "above 0"]),
    ];
    for (area, line, wanted) in cases {
        let said = with(area);
        assert_eq!(said.lines().count(), 1, "{area:?} gave {said:?}");
        for piece in wanted.iter().chain([&format!("panel.toml:{line}:").as_str()]) {
            assert!(said.contains(piece), "{area:?} gave {said:?}, which lacks {piece:?}");
        }
    }
}

/// Whatever the way to metres does to the last digit: what is on the border in the file is on the border.
#[test]
fn border_belongs_to_surface_and_screen() {
    for tenths in 10..3000 {
        let side = f64::from(tenths) / 10.0;
        let text = format!(
            "version = 1\nname = \"border\"\n[surface]\nkind = \"plate\"\nlength_mm = {side}\nwidth_mm = {side}\n\
             thickness_mm = 1\n[surface.material]\nyoungs_modulus_pa = 69e9\npoisson_ratio = 0.3\n\
             density_kg_m3 = 2700\n[screen]\nwidth_px = 1920\nheight_px = 7\nx_mm = 0.03\nwidth_mm = {}\n\
             [[mass]]\nx_mm = {side}\ny_mm = {side}\nmass_g = 1",
            side - 0.03
        );
        let scene = Scene::parse("border.toml", &text).unwrap();
        assert_eq!((scene.masses[0].x_m, scene.masses[0].y_m), (scene.surface.length_m, scene.surface.width_m));
        let (x_m, y_m) = scene.screen.convert_px_to_surface_m(1920.0, 7.0).unwrap();
        assert!(x_m <= scene.surface.length_m && y_m <= scene.surface.width_m, "{side}: {x_m} {y_m}");
        let (x_px, y_px) = scene.screen.convert_surface_m_to_px(x_m, y_m).unwrap();
        assert!((x_px - 1920.0).abs() < 1e-9 && (y_px - 7.0).abs() < 1e-9, "{side}: {x_px} {y_px}");
    }
}

#[test]
fn the_model_takes_any_number_of_actuators_and_the_planner_four() {
    let (rest, actuator) = STARTING_PLATE.split_at(STARTING_PLATE.rfind("[[actuator]]").unwrap());
    let with = |ids: &[&str]| {
        let more: String = ids.iter().map(|id| actuator.replace("\"right\"", &format!("{id:?}"))).collect();
        Scene::parse("many.toml", &format!("{rest}{more}"))
    };
    let six = with(&["b", "c", "d", "e", "f"]).unwrap();
    assert_eq!(six.actuators.len(), 6);
    let curves = era_model::response::compute_acceleration_curves_per_newton_with_error_bounds(
        &six,
        era_model::model::Accuracy::FAST,
        (0.1, 0.1),
        &[60.0, 90.0],
    )
    .unwrap();
    assert_eq!(curves.answer.len(), 6);
    let options = era_planner::TableOptions { from_hz: 60.0, to_hz: 80.0, step_hz: 10.0 };
    let model = era_model::model::PanelModel::build(&six, era_model::model::Accuracy::FAST, 80.0)
        .unwrap()
        .reduce_with_residual_shapes_of_actuators_damping_and_points(80.0, &[])
        .unwrap();
    let table = era_planner::PlanTable::build(&six, model, options).unwrap();
    let target = era_planner::Target { x_m: 0.1, y_m: 0.1, intensity_g: None };
    let said = table.plan(&[target]).unwrap_err().to_string();
    assert!(said.contains("6 actuators") && said.contains("at most 4"), "{said}");
}

/// The example plate with more at its end, and what is said about it.
fn added(text: &str) -> Result<Scene, String> {
    Scene::parse("panel.toml", &format!("{STARTING_PLATE}{text}")).map_err(|error| error.to_string())
}

#[test]
fn patches_have_the_surfaces_values_where_they_give_none() {
    let scene = added(
        "[[patch]]\nx_mm = 0\ny_mm = 0\nlength_mm = 300\nwidth_mm = 20\nthickness_mm = 3\n[[patch]]\nx_mm = 10\n\
         y_mm = 5\nlength_mm = 50\nwidth_mm = 40\n[patch.material]\ndensity_kg_m3 = 1000\n",
    )
    .unwrap();
    let [strip, patch] = scene.patches.as_slice() else { panic!("{:?}", scene.patches) };
    assert_eq!((strip.thickness_m, strip.material), (0.003, scene.surface.material));
    assert_eq!((patch.thickness_m, patch.material.density_kg_m3), (0.002, 1000.0));
    assert_eq!(patch.material.youngs_modulus_pa, scene.surface.material.youngs_modulus_pa);
    // The later one on top.
    assert_eq!(scene.layout().layer_at_unless_cut_out(0.02, 0.01).unwrap().thickness_m, 0.002);
    assert_eq!(scene.layout().layer_at_unless_cut_out(0.2, 0.01).unwrap().thickness_m, 0.003);
    let bar = "[[patch]]\nx_mm = 100\nlength_mm = 50\nwidth_mm = 30\n";
    let bar = Scene::parse("bar.toml", &format!("{EXAMPLE_BAR}{bar}")).unwrap();
    assert_eq!((bar.patches[0].width_m, bar.patches[0].thickness_m), (0.03, 0.002));
    assert!(
        (bar.surface_mass_with_air_kg() / bar.surface.material.density_kg_m3 / 0.002 - (0.2 * 0.02 + 0.05 * 0.03))
            .abs()
            < 1e-15
    );
}

#[test]
fn cutouts_leave_one_piece_under_everything() {
    let cutout = |[x, y, length, width]: [f64; 4]| {
        format!("[[cutout]]\nx_mm = {x}\ny_mm = {y}\nlength_mm = {length}\nwidth_mm = {width}\n")
    };
    let hole = added(&cutout([100.0, 20.0, 30.0, 20.0])).unwrap();
    assert_eq!(hole.cutout_number_counted_from_1_at(0.11, 0.03), Some(1));
    // Its border is surface.
    assert_eq!(
        (hole.cutout_number_counted_from_1_at(0.1, 0.03), hole.cutout_number_counted_from_1_at(0.05, 0.03)),
        (None, None)
    );
    let cases: [(Vec<[f64; 4]>, &[&str]); 5] = [
        (vec![[100.0, 0.0, 20.0, 200.0]], &["cutout[1]", "2 pieces"]),
        (vec![[60.0, 80.0, 30.0, 40.0]], &["actuator[1].x_mm and y_mm", "(75, 100)", "[[cutout]]"]),
        (vec![[290.0, 0.0, 20.0, 20.0]], &["cutout[1].length_mm", "310", "300"]),
        (vec![[100.0, 20.0, 20.0, 20.0], [120.0, 40.0, 20.0, 20.0]], &["cutout[2]", "(120, 40)", "the point"]),
        (vec![[100.0, 20.0, 0.0, 20.0]], &["cutout[1].length_mm", "0.1 to 300"]),
    ];
    for (cutouts, pieces) in cases {
        let text: String = cutouts.iter().map(|at| cutout(*at)).collect();
        let told = added(&text).unwrap_err();
        for piece in pieces {
            assert!(told.contains(piece), "{piece:?} is not in {told}");
        }
    }
    // As long as the surface to the last digit, of which messages show nine.
    let side = "25.10151419019784";
    let text = STARTING_PLATE.split("[[").next().unwrap().replace("width_mm = 200.0", &format!("width_mm = {side}"));
    assert!(text.contains(side), "{text}");
    let part = |kind: &str| format!("{text}[[{kind}]]\nx_mm = 100\ny_mm = 0\nlength_mm = 200\nwidth_mm = {side}\n");
    Scene::parse("cut", &part("cutout")).unwrap();
    Scene::parse("patched", &(part("patch") + "thickness_mm = 1\n")).unwrap();
    let edge = "[[edge]]\nside = \"right\"\nkind = \"pinned\"\n".to_owned() + &cutout([250.0, 0.0, 50.0, 200.0]);
    let text = STARTING_PLATE.replace("x_mm = 300.0", "x_mm = 200.0") + &edge;
    let told = Scene::parse("panel.toml", &text).unwrap_err().to_string();
    assert!(told.contains("edge[1].side") && told.contains("remove this whole side"), "{told}");
    let told = Scene::parse("bar.toml", &format!("{EXAMPLE_BAR}{}", cutout([1.0, 1.0, 1.0, 1.0]))).unwrap_err();
    assert!(told.to_string().contains("a bar cannot have cut-outs"), "{told}");
}

#[test]
fn a_bias_stays_below_pull_in() {
    let with = |bias: &str, stiffness: &str| {
        let text = STARTING_PLATE.replacen(
            "max_voltage_v = 2000.0",
            &format!("max_voltage_v = 2000.0\nbias_voltage_v = {bias}"),
            1,
        );
        Scene::parse("panel.toml", &text.replacen("stiffness_n_per_m = 5000.0", stiffness, 1))
            .map_err(|e| e.to_string())
    };
    let scene = with("1500", "stiffness_n_per_m = 5000.0").unwrap();
    assert_eq!(scene.actuators[0].bias_voltage_v, 1500.0);
    assert_eq!(scene.actuators[1].effective_stiffness_n_per_m(), 5000.0);
    let told = with("2001", "stiffness_n_per_m = 5000.0").unwrap_err();
    assert!(told.contains("actuator[1].bias_voltage_v") && told.contains("0 to 2000"), "{told}");
    // sqrt(300 * 0.5e-3^3 / (8.854e-12 * 1963.5e-6)) = 1468.7 V.
    let told = with("1500", "stiffness_n_per_m = 300.0").unwrap_err();
    assert!(told.contains("1468.7 V") && told.contains("pull the mass onto an electrode"), "{told}");
}

#[test]
fn cables_have_a_capacitance() {
    let with = |cable: &str| {
        let text = STARTING_PLATE.replacen(
            "max_voltage_v = 2000.0",
            &format!("max_voltage_v = 2000.0\ncable_capacitance_pf = {cable}"),
            1,
        );
        Scene::parse("panel.toml", &text).map_err(|error| error.to_string())
    };
    let scene = with("200").unwrap();
    assert!((scene.actuators[0].cable_capacitance_f - 200e-12).abs() < 1e-24);
    assert!((scene.actuators[1].cable_capacitance_f - 81e-12).abs() < 1e-24, "what the board is designed for");
    let told = with("10001").unwrap_err();
    assert!(told.contains("actuator[1].cable_capacitance_pf") && told.contains("0 to 10000"), "{told}");
}

#[test]
fn electrodes_behind_resistors() {
    let with = |table: &str, cable: &str| {
        let text = STARTING_PLATE.replacen("max_voltage_v = 2000.0", &format!("max_voltage_v = 2000.0\n{cable}"), 1);
        Scene::parse("panel.toml", &format!("{text}\n[electronics]\n{table}")).map_err(|error| error.to_string())
    };
    let scene =
        with("charging_resistance_ohm = 1e6\ndischarging_resistance_ohm = 1e5\ndischarging_delay_us = 15", "").unwrap();
    let times = scene.actuators[1].charging;
    // eps0 times 1963.5 mm^2 over 500 um are 34.8 pF.
    assert!(
        (times.rise_s / 115.8e-6 - 1.0).abs() < 1e-3 && (times.fall_s / times.rise_s - 0.1).abs() < 1e-12,
        "{times:?}"
    );
    assert!((times.hold_s - 15e-6).abs() < 1e-18);
    let scene = with("charging_resistance_ohm = 1e6", "cable_capacitance_pf = 181").unwrap();
    let [left, right] = [&scene.actuators[0], &scene.actuators[1]].map(|actuator| actuator.charging);
    assert!((left.rise_s - right.rise_s - 100e-6).abs() < 1e-9 && left.fall_s == left.rise_s && left.hold_s == 0.0);
    assert!(with("charging_resistance_ohm = 0", "").unwrap().actuators[0].charging.is_instant());
    for (table, cable, told) in [
        ("", "", "electronics.charging_resistance_ohm is missing"),
        ("charging_resistance_ohm = -1", "", "electronics.charging_resistance_ohm is -1"),
        (
            "charging_resistance_ohm = 1e5\ndischarging_resistance_ohm = 2e5",
            "",
            "discharging_resistance_ohm is 200000, but must be 0 to 100000",
        ),
        (
            "charging_resistance_ohm = 1e6\ndischarging_delay_us = 101",
            "",
            "electronics.discharging_delay_us is 101, but must be 0 to 100",
        ),
        (
            "charging_resistance_ohm = 1e5\ndischarging_delay_us = 40",
            "",
            "discharging_delay_us is 40 us, but must be at most",
        ),
        (
            "charging_resistance_ohm = 0\ndischarging_delay_us = 1",
            "",
            "discharging_delay_us is 1 us, but must be at most",
        ),
        ("charging_resistance_ohm = 1e7", "", "electronics.charging_resistance_ohm is 1e7 ohm, but must be at most"),
        ("charging_resistance_ohm = 2e6", "cable_capacitance_pf = 300", "must be at most 1.49e6"),
        ("charging_resistance_ohm = 1e6\nresistance = 1", "", "electronics.resistance"),
    ] {
        let found = with(table, cable).expect_err(table);
        assert!(found.contains(told), "{table} {cable}: {found}");
        // Where it is to be mended: the table at the end, or the cable.
        let line = found
            .split("panel.toml:")
            .nth(1)
            .and_then(|rest| rest.split(':').next())
            .and_then(|line| line.parse::<usize>().ok());
        if let (Some(line), "cable_capacitance_pf = 300") = (line, cable) {
            let text = STARTING_PLATE.lines().position(|line| line.contains("max_voltage_v")).unwrap();
            assert_eq!(line, text + 2, "{found}");
        }
    }
}

/// Keys that are asked for twice, whether they are there and for their value, are listed once.
#[test]
fn known_keys_are_listed_once() {
    for (place, key) in
        [("[screen]", "zzzzzzzzzz = 1"), ("[[support]]", "zzzzzzzzzz = 1"), ("[surface]", "zzzzzzzzzz = 1")]
    {
        let said = mistake(place, &format!("{place}\n{key}"));
        let line = said.lines().find(|line| line.contains("allowed keys: ")).unwrap();
        let keys: Vec<&str> = line.split_once("allowed keys: ").unwrap().1.split(", ").collect();
        let each: std::collections::BTreeSet<&str> = keys.iter().copied().collect();
        assert!(keys.len() > 3 && keys.len() == each.len(), "{said}");
    }
}

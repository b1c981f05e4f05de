use super::{Cache, Key, Origin, UnusableFile, directory, file, prepare_table};
use crate::model::{Accuracy, Bound};
use crate::physics::limits::Limit;
use crate::plan::bound::bound_field_error_relative_to_largest_peak;
use crate::scene::{EXAMPLE_BAR, MAX_ACTUATORS, STARTING_PLATE, Scene};
use crate::{PlanTable, TableOptions, Target};
use proptest::prelude::*;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

/// A few frequencies, so that there is little to compute.
const FEW: TableOptions = TableOptions { from_hz: 60.0, to_hz: 300.0, step_hz: 12.0 };

fn bar() -> Scene {
    Scene::parse("bar", EXAMPLE_BAR).unwrap()
}

/// A table's key and file.
fn sample() -> &'static (Key, Vec<u8>) {
    static SAMPLE: OnceLock<(Key, Vec<u8>)> = OnceLock::new();
    SAMPLE.get_or_init(|| {
        let directory = tempfile::tempdir().unwrap();
        let cache = Cache::in_directory(directory.path().to_path_buf());
        let made = prepare_table(Some(&cache), &bar(), Accuracy::FAST, FEW).unwrap();
        (Key::new(&bar(), Accuracy::FAST, FEW).unwrap(), std::fs::read(made.kept.unwrap().0).unwrap())
    })
}

/// The limits of that table, as they were computed.
fn limits_of_sample() -> &'static Vec<String> {
    static LIMITS: OnceLock<Vec<String>> = OnceLock::new();
    LIMITS.get_or_init(|| all_limits(&prepare_table(None, &bar(), Accuracy::FAST, FEW).unwrap().table))
}

/// Numbers all over the file, each four times as large, a quarter or 0, with a right hash.
#[test]
fn no_number_of_a_kept_table_changes_a_limit() {
    let (key, bytes) = sample();
    let mut used = 0;
    for at in (84..bytes.len() - 8).step_by(bytes.len() / 150) {
        for change in [4.0, 0.25, 0.0] {
            let mut changed = bytes.clone();
            // Wherever a number begins, one of eight places in a row is one.
            for place in at..(at + 8).min(bytes.len() - 8) {
                let number = f64::from_le_bytes(bytes[place..place + 8].try_into().unwrap());
                if (1e-12..1e12).contains(&number.abs()) {
                    changed[place..place + 8].copy_from_slice(&(change * number).to_le_bytes());
                    break;
                }
            }
            file::fill_in_file_header(key, &mut changed);
            if let Ok((table, _)) = file::decode_table(key, &changed).and_then(|stored| {
                Ok(stored.recompute_table_and_fill_in_stored_parts_if_plausible(&bar(), Accuracy::FAST, FEW)?)
            }) {
                assert_eq!(&all_limits(&table), limits_of_sample(), "at {at}, times {change}");
                used += usize::from(changed != *bytes);
            }
        }
    }
    assert!(used > 50, "{used} changed files were used");
}

/// All there is about plans at a few places, as text and to the last bit.
fn plans(table: &PlanTable) -> Vec<String> {
    let (length, width) = (table.scene.surface.length_m, table.scene.surface.width_m);
    let at = [(0.2, 0.3), (0.5, 0.5), (0.71, 0.9)];
    let plan = |(x, y): (f64, f64)| {
        let mut plan = table.plan(&[Target { x_m: x * length, y_m: y * width, intensity_g: Some(0.3) }]).unwrap();
        plan.elapsed_us = 0.0;
        let bound = match bound_field_error_relative_to_largest_peak(table, &plan) {
            Bound::AtMost(bound) => bound.to_bits(),
            Bound::Unknown(_) => 0,
        };
        format!("{} {bound:x}", serde_json::to_string(&plan).unwrap())
    };
    at.into_iter().map(plan).collect()
}

#[test]
fn a_kept_table_plans_as_the_computed_one_to_the_last_bit() {
    for text in [STARTING_PLATE, EXAMPLE_BAR] {
        let scene = Scene::parse("example", text).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let cache = Cache::in_directory(directory.path().join("made/when needed"));
        let computed = prepare_table(Some(&cache), &scene, Accuracy::FAST, FEW).unwrap();
        assert!(matches!(computed.origin, Origin::Computed { .. }) && computed.kept.is_some());
        let kept = prepare_table(Some(&cache), &scene, Accuracy::FAST, FEW).unwrap();
        assert!(matches!(kept.origin, Origin::Kept { .. }), "{:?}", kept.origin);
        assert_eq!(plans(&computed.table), plans(&kept.table));
        assert_eq!(format!("{:?}", computed.table), format!("{:?}", kept.table));
        assert_eq!(format!("{:?}", computed.steps), format!("{:?}", kept.steps));
        assert_eq!(computed.table.memory_bytes(), kept.table.memory_bytes());
        // Without a cache nothing is kept, and comes out the same.
        let without = prepare_table(None, &scene, Accuracy::FAST, FEW).unwrap();
        assert!(without.kept.is_none());
        assert_eq!(plans(&computed.table), plans(&without.table));
    }
}

/// Scenes of any size and kind are read again, as the table of a panel of 360 mm never was: symmetric ones, whose figures over
/// the surface come from a quarter of it, and random ones.
#[test]
fn tables_of_any_scene_are_read_again() {
    let corners = "version = 1\nname = \"four\"\n[surface]\nkind = \"plate\"\nlength_mm = 360\nwidth_mm = 240\n\
                   thickness_mm = 2.5\n[surface.material]\nyoungs_modulus_pa = 69e9\npoisson_ratio = 0.33\n\
                   density_kg_m3 = 2700\n";
    let mut four = String::from(corners);
    for (x, y) in [(0, 0), (360, 0), (0, 240), (360, 240)] {
        four += &format!("[[support]]\nx_mm = {x}\ny_mm = {y}\nstiffness_n_per_m = 2e3\ndamping_n_s_per_m = 1.3\n");
    }
    for (i, (x, y)) in [(60, 60), (300, 60), (60, 180), (300, 180)].into_iter().enumerate() {
        four += &format!(
            "[[actuator]]\nid = \"era{i}\"\nx_mm = {x}\ny_mm = {y}\nmount = \"grounded\"\nmoving_mass_g = 10\n\
             stiffness_n_per_m = 5e3\ndamping_n_s_per_m = 1.1\nelectrode_area_mm2 = 1963.5\nair_gap_um = 500\n\
             max_voltage_v = 2000\n"
        );
    }
    let random = (0..24).map(|scene| crate::scene::random::random_scene_text(3, scene));
    for text in std::iter::once(four).chain(random) {
        let scene = Scene::parse("any", &text).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let cache = Cache::in_directory(directory.path().to_path_buf());
        let options = TableOptions { from_hz: 40.0, to_hz: 400.0, step_hz: 8.0 };
        let computed = prepare_table(Some(&cache), &scene, Accuracy::FAST, options).unwrap();
        let path = computed.kept.as_ref().unwrap().0.clone();
        let key = Key::new(&scene, Accuracy::FAST, options).unwrap();
        let read = super::load_and_check_table_file(&path, &key, &scene, Accuracy::FAST, options);
        let read = read.unwrap_or_else(|reason| panic!("{reason}\n{text}"));
        assert_eq!(format!("{:?}", computed.table), format!("{:?}", read.table));
    }
}

/// A figure over the surface that is not the scene's, at a frequency that is looked at. Limits are not kept at all.
#[test]
fn figures_are_among_the_samples() {
    let scene = bar();
    let made = prepare_table(None, &scene, Accuracy::FAST, FEW).unwrap();
    let restored = |change: &dyn Fn(&mut PlanTable)| {
        let mut table = made.table.clone();
        change(&mut table);
        let stored = crate::table::stored::StoredTable::new(&table, &made.steps).unwrap();
        stored.recompute_table_and_fill_in_stored_parts_if_plausible(&scene, Accuracy::FAST, FEW)
    };
    assert!(restored(&|_| {}).is_ok());
    // The middle of 21 frequencies is always a sample.
    fn entry(table: &mut PlanTable) -> &mut crate::table::Entry {
        table.entries[1][10].as_mut().unwrap()
    }
    let changes: [&dyn Fn(&mut PlanTable); 3] =
        [&|table| entry(table).mean *= 1.01, &|table| entry(table).most_square *= 1.01, &|table| {
            entry(table).steepest *= 1.01
        }];
    for (number, change) in changes.into_iter().enumerate() {
        assert!(restored(change).is_err(), "{number}");
    }
    let limits: [&dyn Fn(&mut PlanTable); 8] = [
        &|table| entry(table).max_force_n *= 4.0,
        &|table| entry(table).widths.iter_mut().for_each(|width| width.max_force_n *= 4.0),
        &|table| entry(table).widths.iter_mut().for_each(|width| width.travel_m_per_n = [0.0; MAX_ACTUATORS]),
        &|table| entry(table).limit = Limit::Voltage,
        &|table| entry(table).overshoot = [0.0; MAX_ACTUATORS],
        &|table| entry(table).travel = Default::default(),
        &|table| table.electrodes.iter_mut().for_each(|own| own.max_voltage_v *= 2.0),
        &|table| table.pressed.iter_mut().for_each(|own| own.sag_m = 0.0),
    ];
    for (number, change) in limits.into_iter().enumerate() {
        assert_eq!(all_limits(&restored(change).unwrap().0), all_limits(&made.table), "{number}");
    }
}

/// All that limits a drive, to the last digit.
fn all_limits(table: &PlanTable) -> Vec<String> {
    let entries = table.entries.iter().flatten().map(|entry| {
        let own = entry.as_ref();
        let moved = own.map(|own| (&own.acceleration, own.travel, own.harmonic_travel, own.overshoot));
        format!("{moved:?} {:?}", own.map(|own| (own.onset_v, own.widths, own.max_force_n, own.limit)))
    });
    let whole = format!(
        "{:?} {:?} {:?} {:?} {:?} {:?}",
        table.electrodes,
        table.pressed,
        table.transducers,
        table.static_receptance,
        table.max_rail_voltage_with_masses_at_rest_of_each_actuator_v(),
        table.model
    );
    entries.chain([whole]).collect()
}

#[test]
fn a_damaged_file_is_replaced() {
    let (key, bytes) = sample();
    let directory = tempfile::tempdir().unwrap();
    let cache = Cache::in_directory(directory.path().to_path_buf());
    let path = cache.table_file_path(key);
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let made = prepare_table(Some(&cache), &bar(), Accuracy::FAST, FEW).unwrap();
    assert!(matches!(made.origin, Origin::Computed { .. }));
    let again = prepare_table(Some(&cache), &bar(), Accuracy::FAST, FEW).unwrap();
    assert!(matches!(again.origin, Origin::Kept { .. }));
    // A directory in its place can be neither read nor replaced, which is no error.
    std::fs::remove_file(&path).unwrap();
    std::fs::create_dir(&path).unwrap();
    let made = prepare_table(Some(&cache), &bar(), Accuracy::FAST, FEW).unwrap();
    assert!(matches!(made.origin, Origin::Computed { .. }) && made.kept.is_none());
}

#[test]
fn every_cut_and_every_changed_byte_is_noticed() {
    let (key, bytes) = sample();
    assert!(file::decode_table(key, bytes).is_ok());
    for length in (0..200).chain((200..bytes.len()).step_by(bytes.len() / 40)) {
        assert!(file::decode_table(key, &bytes[..length]).is_err(), "{length}");
    }
    for at in (0..200).chain((200..bytes.len()).step_by(bytes.len() / 40)) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x10;
        assert!(file::decode_table(key, &changed).is_err(), "{at}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(matches!(file::decode_table(key, &longer), Err(UnusableFile::Length { .. })));
    let other = Key::new(&bar(), Accuracy::BALANCED, FEW).unwrap();
    assert!(matches!(file::decode_table(&other, bytes), Err(UnusableFile::Key)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Contents that are wrong although their hash is right, as of a program with a mistake: no panic, and no table whose
    /// numbers are not finite.
    #[test]
    fn wrong_contents_with_a_right_hash_do_no_harm(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let (key, bytes) = sample();
        let mut changed = bytes.clone();
        let header = 84;
        if let Some(cut) = cut {
            changed.truncate(header + cut.index(changed.len() - header));
        }
        for (index, value) in changes {
            if changed.len() > header {
                let at = header + index.index(changed.len() - header);
                changed[at] = value;
            }
        }
        file::fill_in_file_header(key, &mut changed);
        if let Ok(stored) = file::decode_table(key, &changed)
            && let Ok((table, _)) = stored.recompute_table_and_fill_in_stored_parts_if_plausible(&bar(), Accuracy::FAST, FEW)
        {
            prop_assert_eq!(&all_limits(&table), limits_of_sample());
            let finite = |z: &num_complex::Complex64| z.re.is_finite() && z.im.is_finite();
            prop_assert!(table.entries.iter().flatten().flatten().all(|entry| entry.acceleration.iter().all(finite)));
            let _ = table.plan(&[Target { x_m: 0.1, y_m: 0.01, intensity_g: None }]);
        }
    }
}

/// Numbers that are finite, of the right count, and of something else.
#[test]
fn numbers_of_something_else_are_found_by_samples() {
    let (key, bytes) = sample();
    let restored = |scene: &Scene, options| {
        file::decode_table(key, bytes).unwrap().recompute_table_and_fill_in_stored_parts_if_plausible(
            scene,
            Accuracy::FAST,
            options,
        )
    };
    assert!(restored(&bar(), FEW).is_ok());
    let shifted = TableOptions { from_hz: FEW.from_hz + 1.0, to_hz: FEW.to_hz + 1.0, ..FEW };
    assert!(restored(&bar(), shifted).is_err());
    // A gap is in nothing that is kept, and its limits are those of the scene.
    let mut wider = bar();
    wider.actuators[0].air_gap_m *= 1.5;
    let computed = prepare_table(None, &wider, Accuracy::FAST, FEW).unwrap();
    assert_eq!(all_limits(&restored(&wider, FEW).unwrap().0), all_limits(&computed.table));
    assert_ne!(&all_limits(&computed.table), limits_of_sample());
    let mut longer = bar();
    longer.surface.length_m *= 1.5;
    assert!(restored(&longer, FEW).is_err());
    let mut fewer = bar();
    fewer.actuators.pop();
    assert!(restored(&fewer, FEW).is_err());
}

#[test]
fn keys_tell_apart_what_matters() {
    let key = Key::new(&bar(), Accuracy::FAST, FEW).unwrap();
    let commented = format!("# nothing that matters\n{EXAMPLE_BAR}");
    assert_eq!(key, Key::new(&Scene::parse("elsewhere", &commented).unwrap(), Accuracy::FAST, FEW).unwrap());
    assert_ne!(key, Key::new(&bar(), Accuracy::BALANCED, FEW).unwrap());
    assert_ne!(key, Key::new(&bar(), Accuracy::FAST, TableOptions { step_hz: 6.0, ..FEW }).unwrap());
    let mut moved = bar();
    moved.actuators[0].x_m += 1e-15;
    assert_ne!(key, Key::new(&moved, Accuracy::FAST, FEW).unwrap());
    assert_eq!(key.to_string().len(), 64);
}

#[test]
fn the_oldest_files_go_first_and_others_stay() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str, size: usize, age_s: u64| {
        let path = directory.path().join(name);
        std::fs::write(&path, vec![0; size]).unwrap();
        let file = std::fs::File::options().append(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
    };
    for age in 0..6_u64 {
        file(&format!("{age}.era-plan"), 100, age);
    }
    // What a killed writer has left.
    file(".era-0123456789abcdef.part", 100, 7200);
    file("notes.txt", 100_000, 5000);
    let left = || {
        let mut names: Vec<_> =
            std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    directory::remove_unfinished_files_and_least_recently_used_tables(directory.path(), 4, 1 << 20);
    assert_eq!(left(), ["0.era-plan", "1.era-plan", "2.era-plan", "3.era-plan", "notes.txt"]);
    directory::remove_unfinished_files_and_least_recently_used_tables(directory.path(), 4, 250);
    assert_eq!(left(), ["0.era-plan", "1.era-plan", "notes.txt"]);
}

#[test]
fn the_directory_is_the_first_that_is_named() {
    let of = |pairs: &'static [(&str, &str)]| {
        let variable = |name: &str| pairs.iter().find(|(known, _)| *known == name).map(|(_, path)| PathBuf::from(path));
        Cache::from_environment_variables_if_any(variable).map(|cache| cache.directory().to_path_buf())
    };
    let all = of(&[("HOME", "/home/me"), ("XDG_CACHE_HOME", "/cache"), ("ERA_CACHE_DIR", "here")]);
    assert_eq!(all, Some("here".into()));
    assert_eq!(of(&[("HOME", "/home/me"), ("XDG_CACHE_HOME", "/cache")]), Some("/cache/era".into()));
    assert_eq!(of(&[("HOME", "/home/me"), ("XDG_CACHE_HOME", "relative")]), Some("/home/me/.cache/era".into()));
    assert_eq!(of(&[]), None);
}

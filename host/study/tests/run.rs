//! Studies computed with a figure that is known: stopped and resumed, in shares, with any number of workers.

use era_model::model::{Accuracy, compute_modes_with_error_bounds};
use era_model::scene::{STARTING_PLATE, Scene, SceneError};
use era_model::stop::StopRequest;
use era_study::evaluate::{EvaluateError, Evaluator, Figures, QuickEvaluator};
use era_study::result::{
    DesignStatus, DesignTable, GatherError, choose_distinct_finalist_indices_meeting_limits_best_first, write_parquet,
};
use era_study::run::{
    DesignOutcome, RunEnd, Shard, Study, StudyFolder, StudyObserver, StudyTask, compute_missing_rows_of_shard,
};
use era_study::spec::WantedFigure;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const HEAD: &str = "version = 1\nname = \"s\"\nscene = \"plate.toml\"\n\
                    [[variable]]\nplace = \"actuator.left\"\nwithin_mm = [0, 0, 300, 200]\n\
                    [[variable]]\nkey = \"support.*.stiffness_n_per_m\"\nfrom = 1000\nto = 5000\n\
                    [[wish]]\nfigure = \"weakest_g\"\n";

/// A figure of the scene alone, largest with the left actuator at (200, 50) mm on springs of 4000 N/m.
struct Known {
    calls: AtomicUsize,
}

fn known(scene: &Scene) -> f64 {
    let (x, y) = (scene.actuators[0].x_m, scene.actuators[0].y_m);
    let spring = scene.supports[0].stiffness_n_per_m;
    2.0 - ((x - 0.2) / 0.3).powi(2) - ((y - 0.05) / 0.2).powi(2) - ((spring - 4000.0) / 4000.0).powi(2)
}

impl Evaluator for Known {
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError> {
        self.calls.fetch_add(1, Ordering::Relaxed);
        let spring = scene.supports[0].stiffness_n_per_m;
        assert!(spring < 4900.0, "poisoned");
        if scene.actuators[0].x_m < 0.03 {
            return Err(era_planner::PlanError::NoFrequencies.into());
        }
        let values = wanted.iter().enumerate().map(|(k, _)| if k == 0 { known(scene) } else { spring });
        Ok(Figures { values: values.collect(), weakest_mm: None })
    }
}

fn evaluator() -> Known {
    Known { calls: AtomicUsize::new(0) }
}

fn study(rest: &str) -> Study {
    Study::parse_texts("s.toml", &format!("{HEAD}{rest}"), "plate.toml", STARTING_PLATE).unwrap()
}

fn folder(place: &Path, study: &Study) -> StudyFolder {
    StudyFolder::open_or_create_refusing_folder_of_other_study(place, study.fingerprint()).unwrap()
}

/// Stops after so many designs.
struct After {
    designs: usize,
    done: AtomicUsize,
}

impl StudyObserver for After {
    fn is_stop_wanted(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.designs
    }

    fn report_newly_computed_designs(&self, designs: usize) {
        self.done.fetch_add(designs, Ordering::Relaxed);
    }
}

fn with_workers<T: Send>(workers: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(workers).build().unwrap().install(work)
}

/// All rows' files, and the table as Parquet.
fn bytes(place: &Path, study: &Study) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(place.join("rows")).unwrap().map(|entry| entry.unwrap());
    let mut all: BTreeMap<String, Vec<u8>> =
        files.map(|file| (file.file_name().into_string().unwrap(), fs::read(file.path()).unwrap())).collect();
    let table = DesignTable::gather_from_folder(study, &folder(place, study)).unwrap();
    all.insert("designs.parquet".into(), write_parquet(&table).unwrap());
    all
}

const WAYS: [&str; 4] = [
    "[method]\nway = \"sobol\"\ndesigns = 60\nchunk = 7\nseed = 4\n",
    "[method]\nway = \"latin_hypercube\"\ndesigns = 60\nchunk = 7\n",
    "[method]\nway = \"grid\"\nlevels = 4\nchunk = 7\n",
    "[method]\nway = \"evolution\"\ndesigns = 80\npopulation = 8\nruns = 2\n",
];

/// Stopped and gone on with, in shares done in any order, with 1, 2 and 4 workers: the same bytes.
#[test]
fn whoever_computes_a_study_in_whatever_pieces_the_bytes_are_the_same() {
    for way in WAYS {
        let study = study(way);
        let whole = tempfile::tempdir().unwrap();
        let ended = with_workers(1, || {
            compute_missing_rows_of_shard(&study, &folder(whole.path(), &study), &evaluator(), Shard::ALL, &())
        });
        assert_eq!(ended.unwrap(), RunEnd::Done);
        let wanted = bytes(whole.path(), &study);
        for workers in [2, 4] {
            let other = tempfile::tempdir().unwrap();
            with_workers(workers, || {
                compute_missing_rows_of_shard(&study, &folder(other.path(), &study), &evaluator(), Shard::ALL, &())
            })
            .unwrap();
            assert_eq!(bytes(other.path(), &study), wanted, "{workers} workers, {way}");
        }
        let stopped = tempfile::tempdir().unwrap();
        let observer = After { designs: 20, done: AtomicUsize::new(0) };
        let first = evaluator();
        let ended = with_workers(2, || {
            compute_missing_rows_of_shard(&study, &folder(stopped.path(), &study), &first, Shard::ALL, &observer)
        });
        assert_eq!(ended.unwrap(), RunEnd::Early);
        let missing = DesignTable::gather_from_folder(&study, &folder(stopped.path(), &study)).unwrap_err();
        assert!(
            matches!(missing, GatherError::Missing { missing, all } if missing > 0 && all == study.count_designs()),
            "{missing}"
        );
        // What a killed writer leaves is neither taken for rows nor in the way; a file that was cut is computed again.
        fs::write(stopped.path().join("rows/.part-1-1"), "half").unwrap();
        let file = study
            .list_tasks()
            .find(|task| stopped.path().join("rows").join(task.rows_file_name()).exists() && *task != StudyTask::Base);
        let file = stopped.path().join("rows").join(file.unwrap().rows_file_name());
        let cut = fs::read(&file).unwrap();
        fs::write(&file, &cut[..cut.len() / 2]).unwrap();
        let second = evaluator();
        with_workers(2, || {
            compute_missing_rows_of_shard(&study, &folder(stopped.path(), &study), &second, Shard::ALL, &())
        })
        .unwrap();
        fs::remove_file(stopped.path().join("rows/.part-1-1")).unwrap();
        assert_eq!(bytes(stopped.path(), &study), wanted, "stopped, {way}");
        let calls = [&first, &second].map(|own| own.calls.load(Ordering::Relaxed));
        assert!(calls[1] < study.count_designs(), "{calls:?}: what was there was not computed again");
        let shared = tempfile::tempdir().unwrap();
        for shard in ["3/3", "1/3", "2/3"] {
            let shard: Shard = shard.parse().unwrap();
            compute_missing_rows_of_shard(&study, &folder(shared.path(), &study), &evaluator(), shard, &()).unwrap();
        }
        assert_eq!(bytes(shared.path(), &study), wanted, "shares, {way}");
    }
}

/// What fails is a row that says why: refused by the scene, by the planner, or by a panic.
/// Asks for the end of the work at its so-manieth design, as Ctrl-C or a client that leaves does, and computes modes, which end then.
struct Interrupted {
    designs: AtomicUsize,
    stop: StopRequest,
}

impl Evaluator for Interrupted {
    fn compute_scene_figures(&self, scene: &Scene, wanted: &[WantedFigure]) -> Result<Figures, EvaluateError> {
        if self.designs.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.stop.request_stop();
            // A thread that waits takes up other work of the pool.
            for _ in 0..200 {
                rayon::yield_now();
                std::thread::sleep(std::time::Duration::from_micros(100));
            }
        }
        compute_modes_with_error_bounds(scene, Accuracy::FAST, 100.0)?;
        evaluator().compute_scene_figures(scene, wanted)
    }
}

/// A design that was stopped has not failed: its row would stay in the folder, and the study would go on without it.
#[test]
fn a_design_that_is_stopped_has_no_row() {
    for way in WAYS {
        let study = study(way);
        let whole = tempfile::tempdir().unwrap();
        compute_missing_rows_of_shard(&study, &folder(whole.path(), &study), &evaluator(), Shard::ALL, &()).unwrap();
        for designs in [1, 2, 30] {
            let place = tempfile::tempdir().unwrap();
            let stop = StopRequest::default();
            let interrupted = Interrupted { designs: AtomicUsize::new(designs), stop: stop.clone() };
            let compute =
                || compute_missing_rows_of_shard(&study, &folder(place.path(), &study), &interrupted, Shard::ALL, &());
            let ended = with_workers(3, || stop.run_with_self_as_current_stop_request_of_thread(compute));
            assert_eq!(ended.unwrap(), RunEnd::Early, "design {designs}, {way}");
            compute_missing_rows_of_shard(&study, &folder(place.path(), &study), &evaluator(), Shard::ALL, &())
                .unwrap();
            assert_eq!(bytes(place.path(), &study), bytes(whole.path(), &study), "design {designs}, {way}");
        }
    }
}

/// A thread of a study that was stopped takes up work of others, which nobody has stopped.
#[test]
fn a_study_beside_one_that_is_stopped_is_not_stopped() {
    let study = study(WAYS[0]);
    let whole = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&study, &folder(whole.path(), &study), &evaluator(), Shard::ALL, &()).unwrap();
    for _ in 0..5 {
        let (stopped, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (stop, never) = (StopRequest::default(), StopRequest::default());
        let first = Interrupted { designs: AtomicUsize::new(2), stop: stop.clone() };
        let second = Interrupted { designs: AtomicUsize::new(0), stop: StopRequest::default() };
        let run = |stop: &StopRequest, place: &Path, own: &Interrupted| {
            let compute =
                || compute_missing_rows_of_shard(&study, &folder(place, &study), own, Shard::ALL, &()).unwrap();
            stop.run_with_self_as_current_stop_request_of_thread(compute)
        };
        let ends = with_workers(2, || {
            rayon::join(|| run(&stop, stopped.path(), &first), || run(&never, other.path(), &second))
        });
        assert_eq!(ends, (RunEnd::Early, RunEnd::Done));
        assert_eq!(bytes(other.path(), &study), bytes(whole.path(), &study));
    }
}

#[test]
fn designs_that_fail_are_rows_with_their_reasons() {
    let study = study("[[apart]]\nplaces = [\"actuator.*\"]\ndistance_mm = 50\n[method]\nway = \"grid\"\nlevels = 5\n");
    let place = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&study, &folder(place.path(), &study), &evaluator(), Shard::ALL, &()).unwrap();
    let table = DesignTable::gather_from_folder(&study, &folder(place.path(), &study)).unwrap();
    assert_eq!(table.entries.len(), 125);
    for entry in &table.entries {
        let scene = study.space.design_at_point(&entry.row.point);
        let numbers: Vec<f64> = study
            .space
            .table_columns()
            .iter()
            .map(|column| column.number_or_choice_index_in_design_unless_scene_value_kept(&scene).unwrap())
            .collect();
        let [x, y, spring] = numbers[..] else { panic!("{numbers:?}") };
        let reason = if (x - 225.0).hypot(y - 100.0) < 50.0 {
            "left and right are"
        } else if spring >= 4900.0 {
            "the program failed at this design because of a bug"
        } else if x < 30.0 {
            "no "
        } else {
            assert_eq!((entry.status, &entry.reason), (DesignStatus::Kept, &None));
            assert!(matches!(entry.row.outcome, DesignOutcome::Found { .. }));
            continue;
        };
        assert_eq!(entry.status, DesignStatus::Failed);
        assert!(entry.reason.as_ref().unwrap().contains(reason), "{:?} at {numbers:?}", entry.reason);
    }
}

/// The best design is the grid's best, and an evolution comes to the optimum.
#[test]
fn the_best_are_found() {
    let study_of_grid = study("[method]\nway = \"grid\"\nlevels = 7\n");
    let place = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&study_of_grid, &folder(place.path(), &study_of_grid), &evaluator(), Shard::ALL, &())
        .unwrap();
    let table = DesignTable::gather_from_folder(&study_of_grid, &folder(place.path(), &study_of_grid)).unwrap();
    let best = choose_distinct_finalist_indices_meeting_limits_best_first(&study_of_grid, &table, 3);
    let all = table.entries.iter().filter(|entry| entry.status == DesignStatus::Kept).map(|entry| entry.wishes[0]);
    assert_eq!(table.entries[best[0]].wishes[0], all.fold(f64::NEG_INFINITY, f64::max));
    assert!(best.len() == 3 && table.entries[best[0]].wishes[0] >= table.entries[best[1]].wishes[0]);
    let evolving = study("[method]\nway = \"evolution\"\ndesigns = 400\npopulation = 10\nruns = 2\n");
    let place = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&evolving, &folder(place.path(), &evolving), &evaluator(), Shard::ALL, &()).unwrap();
    let table = DesignTable::gather_from_folder(&evolving, &folder(place.path(), &evolving)).unwrap();
    let best = &table.entries[choose_distinct_finalist_indices_meeting_limits_best_first(&evolving, &table, 1)[0]];
    assert!(best.wishes[0] > 1.999, "{best:?}");
}

/// Limits are kept by what wins, and the worst of what may be off counts: off by a quarter, springs of 4000 N/m are worse at their
/// worst than ones whose range is around 4000.
#[test]
fn limits_hold_and_the_worst_of_what_may_be_off_counts() {
    let limited = study(
        "[[limit]]\nfigure = \"rigid_mode_hz\"\nmost = 3000\n[method]\nway = \"evolution\"\ndesigns = 400\npopulation = 10\nruns = 1\n",
    );
    let place = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&limited, &folder(place.path(), &limited), &evaluator(), Shard::ALL, &()).unwrap();
    let table = DesignTable::gather_from_folder(&limited, &folder(place.path(), &limited)).unwrap();
    let best = &table.entries[choose_distinct_finalist_indices_meeting_limits_best_first(&limited, &table, 1)[0]];
    let spring = best.row.figures_unless_failed().unwrap().values[1];
    assert!(spring <= 3000.0 && spring > 2950.0, "{best:?}");
    let broken = table.entries.iter().find(|entry| entry.status == DesignStatus::Broken).unwrap();
    assert!(broken.reason.as_ref().unwrap().starts_with("rigid_mode_hz is "), "{broken:?}");
    let robust = study(
        "[[uncertain]]\nkey = \"actuator.left.x_mm\"\nby = 60\n[method]\nway = \"grid\"\nlevels = 6\nrobust = \"corners\"\n",
    );
    assert_eq!(robust.count_uncertainty_samples(), 2);
    let place = tempfile::tempdir().unwrap();
    compute_missing_rows_of_shard(&robust, &folder(place.path(), &robust), &evaluator(), Shard::ALL, &()).unwrap();
    let table = DesignTable::gather_from_folder(&robust, &folder(place.path(), &robust)).unwrap();
    let mut seen = 0;
    for entry in table.entries.iter().filter(|entry| entry.status == DesignStatus::Kept) {
        let numbers: Vec<f64> = table
            .columns
            .iter()
            .map(|column| column.number_or_choice_index_in_design_unless_scene_value_kept(&entry.row.design).unwrap())
            .collect();
        let worst = [-60.0, 0.0, 60.0].map(|off| {
            let mut scene = Scene::parse("plate", STARTING_PLATE).unwrap();
            scene.actuators[0].x_m = (numbers[0] + off).clamp(0.0, 300.0) / 1e3;
            scene.actuators[0].y_m = numbers[1] / 1e3;
            scene.supports[0].stiffness_n_per_m = numbers[2];
            known(&scene)
        });
        let worst = worst.into_iter().fold(f64::INFINITY, f64::min);
        assert!((entry.wishes[0] - worst).abs() < 1e-5, "{entry:?} {worst}");
        seen += 1;
    }
    assert!(seen > 50, "{seen}");
}

/// A grid may have as many designs as may be asked for by number, in as many chunks.
#[test]
fn a_grid_has_a_limit_and_few_chunks() {
    let grid = |levels: &str| {
        let text = format!(
            "version = 1\nname = \"s\"\nscene = \"plate.toml\"\n\
             [[variable]]\nplace = \"actuator.left\"\nwithin_mm = [0, 0, 300, 200]\n\
             [[variable]]\nplace = \"actuator.right\"\nwithin_mm = [0, 0, 300, 200]\n\
             [[wish]]\nfigure = \"weakest_g\"\n[method]\nway = \"grid\"\n{levels}"
        );
        Study::parse_texts("s.toml", &text, "plate.toml", STARTING_PLATE)
    };
    let refused = grid("levels = 1000\n").unwrap_err();
    let told: Vec<(usize, &str)> =
        refused.mistakes.iter().map(|mistake| (mistake.line, mistake.text.as_str())).collect();
    let expected = "method.levels = 1000, together with the levels and steps of the variables, gives \
                    1000000000000 designs, but at most 100000000 are allowed";
    assert_eq!(told, [(14, expected)]);
    let large = grid("levels = 100\n").unwrap();
    assert_eq!(large.count_designs(), 100_000_000);
    assert!(large.list_tasks().count() <= 100_001, "{}", large.list_tasks().count());
    let small = grid("").unwrap();
    assert_eq!((small.count_designs(), small.list_tasks().count()), (625, 11));
}

/// What the scene's sides and the band leave no room for is told with its line before anything is computed.
#[test]
fn places_off_the_surface_and_narrow_bands_are_reported() {
    let of = |variable: &str, rest: &str| {
        let text = format!("version = 1\nname = \"s\"\nscene = \"plate.toml\"\n[[variable]]\n{variable}\n{rest}");
        Study::parse_texts("s.toml", &text, "plate.toml", STARTING_PLATE)
    };
    let hold = |study: Result<Study, SceneError>, expected: &[(usize, &str)]| {
        let error = study.unwrap_err();
        let told: Vec<(usize, &str)> =
            error.mistakes.iter().map(|mistake| (mistake.line, mistake.text.as_str())).collect();
        assert_eq!(told, expected);
    };
    let thickness = "key = \"surface.thickness_mm\"\nfrom = 1\nto = 2";
    let places = "[[wish]]\nfigure = \"contrast_db\"\nat_mm = [500, 20]\n\
                  [[limit]]\nfigure = \"rise_ms\"\nat_mm = [20, -1]\nmost = 9\n";
    let beyond = (10, "wish[1].at_mm is [500, 20], but must be on the surface: x 0 to 300, y 0 to 200");
    let before = "limit[1].at_mm is [20, -1], but must be on the surface: x 0 to 300, y 0 to 200";
    hold(of(thickness, places), &[beyond, (13, before)]);
    let length = "key = \"surface.length_mm\"\nfrom = 400\nto = 600";
    let before = "limit[1].at_mm is [20, -1], but must be on the surface: x at least 0, y 0 to 200";
    hold(of(length, places), &[(13, before)]);
    let weakest = "[[wish]]\nfigure = \"weakest_g\"\n";
    let narrow = "[method]\nfrom_hz = 100\nto_hz = 110\n";
    let apart = "so that 2 actuators can have frequencies 20 Hz apart";
    let end = format!("method.to_hz is 110, but must be at least 120, {apart}");
    hold(of(thickness, &format!("{weakest}{narrow}")), &[(12, end.as_str())]);
    let start = format!("method.from_hz is 390, but must be at most 380, {apart}");
    hold(of(thickness, &format!("{weakest}[method]\nfrom_hz = 390\n")), &[(11, start.as_str())]);
    assert!(of(thickness, &format!("{weakest}[method]\nfrom_hz = 380\n")).is_ok());
    // With one actuator, or one frequency for all, or for figures that need none.
    assert!(of("count = \"actuator\"\nfrom = 1\nto = 2", &format!("{weakest}{narrow}")).is_ok());
    assert!(of(thickness, &format!("{weakest}drives = \"in_phase\"\n{narrow}")).is_ok());
    assert!(of(thickness, &format!("[[wish]]\nfigure = \"mass_g\"\n{narrow}")).is_ok());
}

/// The scene as it is costs what a design that is the same costs. Of a material that the list does not have nobody knows that.
#[test]
fn the_scene_as_it_is_costs_what_the_same_design_costs() {
    let cost = |first: &str, costs: &str| {
        let text = format!(
            "version = 1\nname = \"s\"\nscene = \"plate.toml\"\n[[variable]]\nkey = \"surface.material\"\nvalues = [\n\
             {{ density_kg_m3 = {first}, youngs_modulus_pa = 69e9, poisson_ratio = 0.33 }},\n\
             {{ density_kg_m3 = 2500.0, youngs_modulus_pa = 72e9, poisson_ratio = 0.22 }},\n]\n{costs}\n\
             [[wish]]\nfigure = \"cost\"\n[cost]\nactuator = 10\n[method]\nway = \"grid\"\n"
        );
        let study = Study::parse_texts("s.toml", &text, "plate.toml", STARTING_PLATE).unwrap();
        let place = tempfile::tempdir().unwrap();
        compute_missing_rows_of_shard(&study, &folder(place.path(), &study), &evaluator(), Shard::ALL, &()).unwrap();
        let table = DesignTable::gather_from_folder(&study, &folder(place.path(), &study)).unwrap();
        let each = std::iter::once(&table.base).chain(&table.entries);
        each.map(|entry| (entry.row.figures_unless_failed().unwrap().values[0], entry.status)).collect::<Vec<_>>()
    };
    let kept = |cost: f64| (cost, DesignStatus::Kept);
    assert_eq!(cost("2700", "costs = [40, 60]"), [kept(60.0), kept(60.0), kept(80.0)]);
    let unknown = cost("2600", "costs = [40, 60]");
    assert!(unknown[0].0.is_nan() && unknown[0].1 == DesignStatus::Failed, "{unknown:?}");
    assert_eq!(unknown[1..], [kept(60.0), kept(80.0)]);
    // What costs nothing whatever is chosen costs nothing as it is.
    assert_eq!(cost("2600", ""), [kept(20.0); 3]);
}

/// A study may change the air behind a panel, which is a part of what the quick look solves once. Seen to fail with panels told apart by
/// their surface, patches, cut-outs and edges alone.
#[test]
fn panels_on_other_air_are_other_panels() {
    let on_air = |depth_mm: f64| {
        Scene::parse("plate.toml", &format!("{STARTING_PLATE}\n[air]\nsealed_depth_mm = {depth_mm:?}\n")).unwrap()
    };
    let study = study("");
    let quick = QuickEvaluator::new(study.plan_table_options());
    let weakest = |depth_mm: f64| quick.compute_scene_figures(&on_air(depth_mm), &study.figures).unwrap().values[0];
    let (shallow, deep) = (weakest(5.0), weakest(50.0));
    assert!(shallow > 0.0 && (shallow / deep - 1.0).abs() > 1e-3, "{shallow} {deep}");
}

//! `study`: what may change of a scene, and its work in tasks, for whoever computes them: threads here, or an engine's workers elsewhere.
//!
//! One Python class, whose methods Python needs in one block. Their order: what a study is made from; its names and counts; its tasks and
//! their rows, for engines; one design for optimisers; a folder's missing designs and results, for threads here.

use crate::arguments::UnitCubePoint;
use crate::design::Design;
use crate::errors::{Raised, build_scene_exception};
use crate::results::{convert_to_python_by_json, read_only_array};
use crate::run::{
    error_of_stopped_computation, run_in_own_thread_interruptibly, run_in_own_thread_interruptibly_with_progress,
    run_in_pool_interruptibly,
};
use crate::scene::PyScene;
use crate::study_progress::ProgressObserver;
use crate::tables::run_with_cached_plan_table_emitting_model_warnings;
use era_model::model::Accuracy;
use era_model::text_file::read_text_file;
use era_study::evaluate::{Evaluator, QuickEvaluator, ThoroughEvaluator};
use era_study::result::{
    DesignTable, TableEntry, constraint_names_and_signed_excesses_of_design, objective_names_and_losses_of_design,
};
use era_study::run::{
    DesignOutcome, DesignRow, RunEnd, Shard, Study, StudyFolder, StudyTask, decode_task_rows_if_of_study_and_task,
    encode_task_rows,
};
use era_study::written::verify_and_write_results_unless_stopped;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyType};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;

/// What messages call a study and a scene that are not files.
const STUDY: &str = "study";
const SCENE: &str = "scene";

/// A scene, what may change in it, and what is wanted; never changes. Its work is a number of tasks, each of which gives the same bytes
/// whoever computes it, and as often as it is computed.
///
/// Parameters
/// ----------
/// text : str
///     A study file's text (`docs/src/studies.md`); the scene that it names is of no account.
/// scene : Scene
///     The scene.
///
/// Raises
/// ------
/// SceneError
///     With every mistake of the study and its line.
///
/// Examples
/// --------
/// >>> import era
/// >>> text = '''
/// ... version = 1
/// ... name = "how soft the corners are"
/// ... scene = "plate.toml"
/// ... [[variable]]
/// ... key = "support.*.stiffness_n_per_m"
/// ... from = 500
/// ... to = 8000
/// ... [[wish]]
/// ... figure = "mass_g"
/// ... [method]
/// ... designs = 4
/// ... '''
/// >>> study = era.Study(text, era.Scene.example("plate"))
/// >>> study.designs, study.figures, study.tasks()
/// (4, ('mass_g',), ('base', 'designs-0000000'))
#[pyclass(frozen, module = "era", name = "Study")]
pub struct PyStudy {
    study: Arc<Study>,
    evaluator: Arc<dyn Evaluator + Send + Sync>,
    text: String,
    scene_text: String,
}

/// What one is made from.
type ConstructorArguments<'py> = (String, Bound<'py, PyAny>);

impl PyStudy {
    fn from_study_and_texts_choosing_evaluator(study: Study, text: String, scene_text: String) -> Self {
        let options = study.plan_table_options();
        let evaluator: Arc<dyn Evaluator + Send + Sync> = if study.spec.method.thorough {
            Arc::new(ThoroughEvaluator::new(options))
        } else {
            Arc::new(QuickEvaluator::new(options))
        };
        Self { study: Arc::new(study), evaluator, text, scene_text }
    }

    fn decode_rows_argument_or_raise(
        &self,
        field: &str,
        task: StudyTask,
        bytes: &[u8],
    ) -> Result<Vec<DesignRow>, Raised> {
        decode_task_rows_if_of_study_and_task(&self.study.fingerprint(), task, bytes)
            .ok_or_else(|| error_of_bytes_not_from_this_study_and_task(field, task))
    }

    /// The names of objectives or constraints.
    fn names_of_constraints_or_objectives(
        &self,
        list_values: fn(&Study, &DesignRow) -> Vec<(String, f64)>,
    ) -> Vec<String> {
        let design = self.study.space.design_of_scene_file();
        let nothing = DesignRow { point: Vec::new(), design, outcome: DesignOutcome::Failed(String::new()) };
        list_values(&self.study, &nothing).into_iter().map(|(name, _)| name).collect()
    }

    fn parse_task_argument(&self, name: &str) -> Result<StudyTask, Raised> {
        let task = name.parse::<StudyTask>().ok().filter(|task| self.study.count_designs_of_task(*task) > 0);
        task.ok_or_else(|| Raised::wrong_argument("task", name, "one of tasks()"))
    }

    fn open_or_create_study_folder(&self, folder: PathBuf) -> Result<StudyFolder, Raised> {
        Ok(StudyFolder::open_or_create_refusing_folder_of_other_study(&folder, self.study.fingerprint())?)
    }
}

/// The error of bytes that are not rows of this study and task.
fn error_of_bytes_not_from_this_study_and_task(field: &str, task: StudyTask) -> Raised {
    let allowed = format!("the bytes that compute(\"{task}\") returned for the same study in the same version of era");
    let text = format!("{field} must contain {allowed}, but contains other bytes");
    Raised::wrong_argument_with_text(field, "other bytes", allowed, text)
}

fn read_text_or_raise(path: &Path) -> PyResult<String> {
    Ok(read_text_file(path).map_err(|error| Raised::unusable_file("read", path, &error))?)
}

#[pymethods]
impl PyStudy {
    #[new]
    fn new(py: Python<'_>, text: String, scene: &PyScene) -> PyResult<Self> {
        let scene_text = scene.source_text().to_owned();
        let study = Study::parse_texts(STUDY, &text, SCENE, &scene_text)
            .map_err(|error| build_scene_exception(py, error, true))?;
        Ok(Self::from_study_and_texts_choosing_evaluator(study, text, scene_text))
    }

    /// A study from its file, with the scene that it names.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///
    /// Returns
    /// -------
    /// Study
    ///
    /// Raises
    /// ------
    /// OSError
    ///     A file cannot be read.
    /// SceneError
    ///     With every mistake of the study or the scene, and its line.
    #[classmethod]
    fn from_file(_class: &Bound<'_, PyType>, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let text = read_text_or_raise(&path)?;
        let source = path.display().to_string();
        let spec = era_study::spec::StudySpec::parse(&source, &text)
            .map_err(|error| build_scene_exception(py, error, true))?;
        let scene = path.parent().unwrap_or_else(|| "".as_ref()).join(&spec.scene);
        let scene_text = read_text_or_raise(&scene)?;
        let study = Study::parse_texts(&source, &text, &scene.display().to_string(), &scene_text)
            .map_err(|error| build_scene_exception(py, error, true))?;
        Ok(Self::from_study_and_texts_choosing_evaluator(study, text, scene_text))
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.study.spec.name
    }

    /// The text of its file.
    #[getter(text)]
    fn study_file_text(&self) -> &str {
        &self.text
    }

    /// The scene as it is.
    #[getter(scene)]
    fn build_python_scene_from_stored_text<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.get_type::<PyScene>().getattr("from_toml")?.call1((&self.scene_text,))
    }

    /// How many designs are looked at, the scene as it is not counted.
    #[getter(designs)]
    fn count_designs(&self) -> usize {
        self.study.count_designs()
    }

    /// The figures that are computed of every design, as columns are called.
    #[getter(figures)]
    fn figure_names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        pyo3::types::PyTuple::new(py, self.study.figures.iter().map(|wanted| wanted.column_name()))
    }

    /// The dimensions of the unit cube that designs are points of: one for each number, choice and count that varies, two for a place.
    #[getter(dimensions)]
    fn dimension_names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        pyo3::types::PyTuple::new(py, self.study.space.dimensions().iter().map(|dimension| &dimension.name))
    }

    /// How many values each dimension has, equal parts of 0 to 1 standing for each; None where any number between two will do.
    #[getter(dimension_counts)]
    fn value_counts_of_dimensions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        pyo3::types::PyTuple::new(py, self.study.space.dimensions().iter().map(|dimension| dimension.count))
    }

    /// What is wished for, as "most weakest_g": in the order of `Design.objectives`.
    #[getter(objectives)]
    fn objective_names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        pyo3::types::PyTuple::new(py, self.names_of_constraints_or_objectives(objective_names_and_losses_of_design))
    }

    /// The bounds of all limits, as "sag_um at most 800": in the order of `Design.constraints`.
    #[getter(constraints)]
    fn constraint_names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        pyo3::types::PyTuple::new(
            py,
            self.names_of_constraints_or_objectives(constraint_names_and_signed_excesses_of_design),
        )
    }

    /// What the study follows from (its file, the scene's, this program), as one number in hexadecimal digits.
    #[getter(key)]
    fn fingerprint_as_hex(&self) -> String {
        use std::fmt::Write;
        self.study.fingerprint().iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }

    /// The names of all tasks. `base` is the scene as it is, which searches begin from; `run-I-generation-K` needs the losses of all
    /// earlier generations of its run; all others can be computed in any order.
    ///
    /// Returns
    /// -------
    /// tuple of str
    #[pyo3(name = "tasks")]
    fn list_task_names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyTuple>> {
        let names: Vec<String> = self.study.list_tasks().map(|task| task.to_string()).collect();
        pyo3::types::PyTuple::new(py, names)
    }

    /// How many designs a task has.
    ///
    /// Parameters
    /// ----------
    /// task : str
    ///
    /// Returns
    /// -------
    /// int
    #[pyo3(name = "size")]
    fn count_designs_of_task(&self, task: &str) -> Result<usize, Raised> {
        Ok(self.study.count_designs_of_task(self.parse_task_argument(task)?))
    }

    /// Computes a task.
    ///
    /// Parameters
    /// ----------
    /// task : str
    ///     One of `tasks()`.
    /// losses : sequence of sequences of float, optional
    ///     Of all earlier generations of its run, in their order.
    /// threads : int, optional
    ///     As many as there are processors unless given.
    ///
    /// Returns
    /// -------
    /// bytes
    ///     The rows as the study's folder keeps them. A design that fails is a row with its reason.
    #[pyo3(name = "compute", signature = (task, losses=None, *, threads=None))]
    fn compute_task_rows<'py>(
        &self,
        py: Python<'py>,
        task: &str,
        losses: Option<Vec<Vec<f64>>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let (task, losses) = (self.parse_task_argument(task)?, losses.unwrap_or_default());
        if let StudyTask::Generation { generation, .. } = task
            && losses.len() != generation
        {
            let allowed = format!("{generation}, one list for each earlier generation");
            return Err(Raised::wrong_argument("len(losses)", losses.len(), allowed).into());
        }
        if threads == Some(0) {
            return Err(Raised::wrong_argument("threads", 0, "at least 1").into());
        }
        let (study, evaluator) = (self.study.clone(), self.evaluator.clone());
        let work = move || {
            study.compute_task_rows_unless_stopped(task, &losses, &*evaluator).ok_or_else(error_of_stopped_computation)
        };
        let rows = match threads {
            None => run_in_pool_interruptibly(py, work)?,
            Some(threads) => run_in_own_thread_interruptibly(py, move |waited_for| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
                    Raised::unavailable_resource(format!("cannot start threads for the computation: {error}"))
                })?;
                pool.install(|| {
                    waited_for.clone_stop_request_handle().run_with_self_as_current_stop_request_of_thread(work)
                })
            })?,
        };
        let bytes = encode_task_rows(&self.study.fingerprint(), task, &rows).map_err(Raised::unavailable_resource)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// One design: what it is, its figures, objectives and constraints as numbers. For optimisers of other packages, which ask for the points that
    /// they want to know and are told what these are worth; the method of the study's file is of no account. Nothing is kept on disk.
    ///
    /// Parameters
    /// ----------
    /// point : array_like [dimension]
    ///     In the unit cube, 0 to 1 each, in the order of `dimensions`. The file's `from`, `to`, `scale` and `step` make values of it.
    ///
    /// Returns
    /// -------
    /// Design
    ///     One that cannot be computed says why in `failed`.
    ///
    /// Raises
    /// ------
    /// RequestError
    ///     The point has too few or too many numbers, or one beyond 0 to 1.
    ///
    /// Examples
    /// --------
    /// >>> import era
    /// >>> text = '''
    /// ... version = 1
    /// ... name = "how thick"
    /// ... scene = "plate.toml"
    /// ... [[variable]]
    /// ... key = "surface.thickness_mm"
    /// ... from = 1
    /// ... to = 3
    /// ... [[wish]]
    /// ... figure = "rigid_mode_hz"
    /// ... goal = "most"
    /// ... [[limit]]
    /// ... figure = "mass_g"
    /// ... most = 400
    /// ... [method]
    /// ... designs = 1
    /// ... '''
    /// >>> study = era.Study(text, era.Scene.example("plate"))
    /// >>> study.dimensions, study.objectives, study.constraints
    /// (('surface.thickness_mm',), ('most rigid_mode_hz',), ('mass_g at most 400',))
    /// >>> found = study.evaluate([0.5])
    /// >>> found.values, bool(found.constraints[0] <= 0.0)
    /// ({'surface.thickness_mm': 2.0}, True)
    #[pyo3(name = "evaluate")]
    fn evaluate_design_at_point(&self, py: Python<'_>, point: UnitCubePoint) -> PyResult<Design> {
        let point = point.check_in_unit_cube(self.study.space.dimensions().len())?;
        let (study, evaluator) = (self.study.clone(), self.evaluator.clone());
        let row = run_in_pool_interruptibly(py, move || {
            study.compute_row_at_point_unless_stopped(point, &*evaluator).ok_or_else(error_of_stopped_computation)
        })?;
        Design::from_row(py, &self.study, row)
    }

    /// What the designs of a generation are worth to their search; less is better.
    ///
    /// Parameters
    /// ----------
    /// task : str
    ///     The generation's name.
    /// base, rows : bytes
    ///     What `compute` has given for the task `base`, and for this one.
    ///
    /// Returns
    /// -------
    /// list of float
    #[pyo3(name = "losses")]
    fn compute_generation_losses(&self, task: &str, base: &[u8], rows: &[u8]) -> Result<Vec<f64>, Raised> {
        let own = self.parse_task_argument(task)?;
        let StudyTask::Generation { run, .. } = own else {
            return Err(Raised::wrong_argument(
                "task",
                task,
                "the name of a generation, such as run-0001-generation-00002",
            ));
        };
        let (base, rows) = (
            self.decode_rows_argument_or_raise("base", StudyTask::Base, base)?,
            self.decode_rows_argument_or_raise("rows", own, rows)?,
        );
        let base = base.first().ok_or_else(|| {
            let allowed = "the bytes that compute(\"base\") returned";
            Raised::wrong_argument_with_text(
                "base",
                "no rows",
                allowed,
                format!("base must be {allowed}, but the given bytes contain no row"),
            )
        })?;
        Ok(self.study.compute_losses_for_search_run(run, base, &rows))
    }

    /// The rows of a task in a folder; `None` if they are not there, or not whole.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///     The study's folder, made if it is not there.
    /// task : str
    ///
    /// Returns
    /// -------
    /// bytes or None
    #[pyo3(name = "kept")]
    fn read_encoded_task_rows_if_complete_creating_absent_folder<'py>(
        &self,
        py: Python<'py>,
        folder: PathBuf,
        task: &str,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let task = self.parse_task_argument(task)?;
        let rows = self.open_or_create_study_folder(folder)?.load_task_rows_if_complete(task).map_err(Raised::from)?;
        let bytes = rows
            .map(|rows| encode_task_rows(&self.study.fingerprint(), task, &rows))
            .transpose()
            .map_err(Raised::unavailable_resource)?;
        Ok(bytes.map(|bytes| PyBytes::new(py, &bytes)))
    }

    /// Writes rows into the study's folder: beside their place, which they then take, so that they are there whole or not at all.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///     Made if it is not there.
    /// task : str
    /// rows : bytes
    ///     What `compute` has given.
    ///
    /// Raises
    /// ------
    /// OSError
    ///     They cannot be written.
    /// RequestError
    ///     The folder is another study's, or the bytes are none of this one.
    #[pyo3(name = "keep")]
    fn write_task_rows(&self, folder: PathBuf, task: &str, rows: &[u8]) -> Result<(), Raised> {
        let (task, folder) = (self.parse_task_argument(task)?, self.open_or_create_study_folder(folder)?);
        if folder.write_encoded_rows_if_of_this_study_and_task(task, rows)? {
            return Ok(());
        }
        Err(error_of_bytes_not_from_this_study_and_task("rows", task))
    }

    /// Computes what is not in a folder yet, here.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///     Made if it is not there.
    /// progress : callable, optional
    ///     Called in this thread with the number of designs that are there, and of all, as they come. What it raises ends the work.
    ///
    /// Returns
    /// -------
    /// int
    ///     How many designs were computed.
    #[pyo3(name = "compute_all", signature = (folder, progress=None))]
    fn compute_missing_designs(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let folder = self.open_or_create_study_folder(folder)?;
        let (study, evaluator) = (self.study.clone(), self.evaluator.clone());
        let (more, coming) = channel();
        let (mut there, all) = (0, self.study.count_designs());
        let tell = |_: Python<'_>| {
            for designs in coming.try_iter() {
                there += designs;
                if let Some(progress) = progress {
                    progress.call1((there, all))?;
                }
            }
            Ok(())
        };
        run_in_own_thread_interruptibly_with_progress(py, tell, move |pool| {
            let watched = ProgressObserver { stop: pool.clone_stop_request_handle(), done: AtomicUsize::new(0), more };
            let ended = pool.run_in_pool_with_stop_request(|| {
                era_study::run::compute_missing_rows_of_shard(&study, &folder, &*evaluator, Shard::ALL, &watched)
            })?;
            match ended {
                RunEnd::Done => Ok(watched.done.load(Ordering::Relaxed)),
                // Nobody waits for it.
                RunEnd::Early => Err(error_of_stopped_computation()),
            }
        })
    }

    /// Computes the best designs anew and writes the results into a folder that has all tasks: `designs.parquet`, `best-1.toml`, ...,
    /// `report.html`.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///
    /// Returns
    /// -------
    /// dict
    ///     What `era study --json` prints.
    ///
    /// Raises
    /// ------
    /// OSError
    ///     A file cannot be written.
    /// RequestError
    ///     Designs are missing.
    ///
    /// Warns
    /// -----
    /// ModelWarning
    ///     Gaps of the scene as it is do not bear its press.
    #[pyo3(name = "write")]
    fn verify_and_write_results_warning_of_press_and_return_summary<'py>(
        &self,
        py: Python<'py>,
        folder: PathBuf,
    ) -> PyResult<Bound<'py, PyAny>> {
        let own = self.open_or_create_study_folder(folder.clone())?;
        let study = self.study.clone();
        // Of the scene itself, not of each design, as there are many, which lack the same stops. Where it cannot be modelled its own row says why.
        if let Some(scene) = study.space.base_scene_if_any_ground_mounted_actuator_lacks_end_stop() {
            let told = run_with_cached_plan_table_emitting_model_warnings(
                py,
                &Arc::new(scene),
                Accuracy::BALANCED,
                |_| Ok(()),
            );
            let ours = py.import("era._errors")?.getattr("EraError")?;
            if let Err(error) = told
                && !error.is_instance(py, &ours)
            {
                return Err(error);
            }
        }
        let summary = run_in_own_thread_interruptibly(py, move |pool| {
            let stop = pool.clone_stop_request_handle();
            let written = pool.run_in_pool_with_stop_request(|| {
                verify_and_write_results_unless_stopped(&study, &own, &|| stop.is_stop_requested_or_deadline_over())
            })?;
            Ok(written.map(|written| written.summarise_as_json(&study, &folder)))
        })?;
        convert_to_python_by_json(py, &summary)
    }

    /// The table of a folder that has all tasks: a row for each design, the first one being the scene as it is.
    ///
    /// Parameters
    /// ----------
    /// folder : str or os.PathLike
    ///
    /// Returns
    /// -------
    /// dict
    ///     `status` (list of str: "kept", "breaks a limit", "failed"), `reason` (list of str or None), `on_front` (list of bool), and for
    ///     each variable and figure its values: float64 [design], NaN where there is none, or for a choice a list of its names. Where something may be off
    ///     each figure's name with `_low` and `_high` has its least and most over all samples of that. `weakest_x_mm` and `weakest_y_mm` are the weakest place of
    ///     the first figure that has one, if any does, NaN for a design that failed.
    #[pyo3(name = "table")]
    fn gather_design_table_creating_absent_folder<'py>(
        &self,
        py: Python<'py>,
        folder: PathBuf,
    ) -> PyResult<Bound<'py, PyDict>> {
        let table = DesignTable::gather_from_folder(&self.study, &self.open_or_create_study_folder(folder)?)
            .map_err(Raised::from)?;
        let rows = || std::iter::once(&table.base).chain(&table.entries);
        let found = PyDict::new(py);
        found.set_item("status", rows().map(|own| own.status.name()).collect::<Vec<_>>())?;
        found.set_item("reason", rows().map(|own| own.reason.as_deref()).collect::<Vec<_>>())?;
        found.set_item("on_front", rows().map(|own| own.is_on_front).collect::<Vec<_>>())?;
        for column in &table.columns {
            if column.words.is_some() {
                found.set_item(
                    &column.name,
                    rows()
                        .map(|own| column.text_in_design_unless_scene_value_kept(&own.row.design))
                        .collect::<Vec<_>>(),
                )?;
            } else {
                let values = rows()
                    .map(|own| {
                        column
                            .number_or_choice_index_in_design_unless_scene_value_kept(&own.row.design)
                            .unwrap_or(f64::NAN)
                    })
                    .collect();
                found.set_item(&column.name, read_only_array(py, values))?;
            }
        }
        for (k, wanted) in table.figures.iter().enumerate() {
            let value = |own: &TableEntry| {
                own.row.figures_unless_failed().and_then(|figures| figures.values.get(k).copied()).unwrap_or(f64::NAN)
            };
            found.set_item(wanted.column_name(), read_only_array(py, rows().map(value).collect()))?;
            if table.has_ends {
                let ends = |own: &TableEntry| {
                    own.row.least_and_most_of_figure_over_samples_unless_failed(k).unwrap_or((f64::NAN, f64::NAN))
                };
                let (low, high): (Vec<f64>, Vec<f64>) = rows().map(ends).unzip();
                found.set_item(format!("{}_low", wanted.column_name()), read_only_array(py, low))?;
                found.set_item(format!("{}_high", wanted.column_name()), read_only_array(py, high))?;
            }
        }
        if table.has_weakest_places() {
            let at_mm = |own: &TableEntry| {
                own.row.figures_unless_failed().and_then(|figures| figures.weakest_mm).unwrap_or([f64::NAN; 2])
            };
            found.set_item("weakest_x_mm", read_only_array(py, rows().map(|own| at_mm(own)[0]).collect()))?;
            found.set_item("weakest_y_mm", read_only_array(py, rows().map(|own| at_mm(own)[1]).collect()))?;
        }
        Ok(found)
    }

    fn __repr__(&self) -> String {
        let spec = &self.study.spec;
        format!("<Study {:?}: {} designs, method {}>", spec.name, self.study.count_designs(), spec.method.way.name())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyType>, ConstructorArguments<'py>)> {
        Ok((py.get_type::<Self>(), (self.text.clone(), self.build_python_scene_from_stored_text(py)?)))
    }
}

//! The command `study`: a study computed, or a share of it, and its results written.

use super::args::{CacheOptions, PanelOptions};
use super::args_study::Study as Options;
use super::panel::load_or_compute_plan_table;
use super::progress_of::{StudyProgressDisplay, make_signal_stop_flag_second_signal_exits};
use super::{CommandResult, Failure, print_json, print_text_after_queued_log};
use crate::study::evaluate::{Evaluator, QuickEvaluator, ThoroughEvaluator};
use crate::study::result::GatherError;
use crate::study::run::{self, FolderError, RunEnd, RunError, Shard, Study, StudyError, StudyFolder};
use crate::study::written::{WriteError, verify_and_write_results_unless_stopped};
use std::path::{Path, PathBuf};

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        Failure::usage_error(error)
    }
}

impl From<FolderError> for Failure {
    fn from(error: FolderError) -> Self {
        match error {
            FolderError::Other { .. } => Failure::usage_error(error),
            FolderError::Io { .. } => Failure::runtime_error(format!(
                "{error}; the results so far are kept: run the same command again to continue"
            )),
        }
    }
}

impl From<GatherError> for Failure {
    fn from(error: GatherError) -> Self {
        match error {
            GatherError::Folder(error) => error.into(),
            GatherError::Missing { .. } => Failure::runtime_error(error),
        }
    }
}

impl From<WriteError> for Failure {
    fn from(error: WriteError) -> Self {
        match error {
            WriteError::Gather(error) => error.into(),
            WriteError::Folder(error) => error.into(),
            WriteError::Table(_) | WriteError::Refused(_) => Failure::runtime_error(error),
        }
    }
}

/// Runs it.
pub fn run_study(options: &Options) -> CommandResult {
    let study = Study::load(&options.study)?;
    let path = options.out.clone().unwrap_or_else(|| default_results_folder_in_current_directory(&options.study));
    let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(&path, study.fingerprint())?;
    warn_of_base_scene_actuators_that_fail_press(&study);
    let stops = make_signal_stop_flag_second_signal_exits();
    let shard = options.shard.unwrap_or(Shard::ALL);
    if !options.gather {
        let shown = StudyProgressDisplay::new(stops.clone());
        let evaluator: Box<dyn Evaluator> = if study.spec.method.thorough {
            Box::new(ThoroughEvaluator::new(study.plan_table_options()))
        } else {
            Box::new(QuickEvaluator::new(study.plan_table_options()))
        };
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(workers) = options.workers {
            pool = pool.num_threads(usize::from(workers));
        }
        let pool = pool.build().map_err(Failure::runtime_error)?;
        let ended = pool.install(|| run::compute_missing_rows_of_shard(&study, &folder, &*evaluator, shard, &shown));
        let (there, all) = shown.finish_and_count_done_and_all_designs();
        match ended {
            Err(RunError::Folder(error)) => return Err(error.into()),
            Ok(RunEnd::Early) => {
                return Err(Failure::runtime_error(format!(
                    "stopped: the results of {there} of {all} designs are in {}; run the same command again to \
                     compute the others",
                    path.display()
                )));
            }
            Ok(RunEnd::Done) if !shard.is_whole_study() && all == 0 => {
                return print_text_after_queued_log(&format!(
                    "{}: share {shard} has no designs to compute, because there are too many shares. Use fewer shares, \
                     set a smaller `chunk` in [method], or, for an evolution, set a larger `runs` in [method]",
                    study.spec.name
                ));
            }
            Ok(RunEnd::Done) if !shard.is_whole_study() => {
                return print_text_after_queued_log(&format!(
                    "{}: share {shard} is complete, and the results of its {all} designs are in {}. When all shares \
                     are complete, use `--gather` to combine the results",
                    study.spec.name,
                    path.display()
                ));
            }
            Ok(RunEnd::Done) => {}
        }
    }
    let halt = || stops.load(std::sync::atomic::Ordering::Relaxed);
    let written = super::progress::run_with_progress("computing the finalists again", || {
        verify_and_write_results_unless_stopped(&study, &folder, &halt)
    })?;
    let Some(written) = written else {
        return Err(Failure::runtime_error(
            "stopped while the finalists were computed again; run the same command again to continue",
        ));
    };
    if options.json {
        return print_json(&written.summarise_as_json(&study, &path));
    }
    print_text_after_queued_log(&written.summarise_as_text(&study, &path))
}

/// Says of the study's scene what other commands say when they load it: which actuators do not bear its press. Not of each design, as there
/// are many, which lack the same stops.
fn warn_of_base_scene_actuators_that_fail_press(study: &Study) {
    // A table takes a second or two, and with all stops there is nothing to say.
    if let Some(scene) = study.space.base_scene_if_any_ground_mounted_actuator_lacks_end_stop() {
        // Where there is none, the scene's own row of the results says why.
        let _ = load_or_compute_plan_table(&PanelOptions::default(), CacheOptions { no_cache: true }, &scene);
    }
}

/// The study's name with `-results`, in the current directory.
fn default_results_folder_in_current_directory(study_file: &Path) -> PathBuf {
    let stem = study_file.file_stem().map_or_else(|| "study".into(), |stem| stem.to_string_lossy());
    PathBuf::from(format!("{stem}-results"))
}

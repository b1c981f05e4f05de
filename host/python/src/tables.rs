//! The planner's tables, of which the latest are kept: a panel that is asked again answers at once.

use crate::errors::{Raised, emit_model_warnings};
use crate::run::{WorkPool, run_in_own_thread_interruptibly};
use era_model::model::levels::ReducedLevels;
use era_model::model::{Accuracy, validity};
use era_model::scene::{MAX_ACTUATORS, Scene};
use era_planner::{PlanError, PlanTable, TableOptions, cache};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Tables that are kept: some 3 MB for each actuator. Whoever goes through designs asks each a few times and never again.
const KEPT: usize = 4;

/// A table, for one question at a time: what it works out when it is first asked is waited for by others, and a thread of the pool
/// that waits takes up other work, which may be the same question.
pub type SharedTable = Arc<Mutex<PlanTable>>;

struct KeptTable {
    scene: Arc<Scene>,
    tolerance: f64,
    table: SharedTable,
}

/// The one used last at the end; and the process that they are of: in one that was forked a table may be locked for ever.
static TABLES: Mutex<(u32, Vec<KeptTable>)> = Mutex::new((0, Vec::new()));

/// Works with the table of a scene with its finger on `finger_places_m` (m), that of the scene itself where it has none.
pub fn run_with_table_touched_by_scene_finger<T: Send + 'static>(
    py: Python<'_>,
    scene: &Arc<Scene>,
    accuracy: Accuracy,
    finger_places_m: Vec<(f64, f64)>,
    work: impl FnOnce(&PlanTable) -> Result<T, Raised> + Send + 'static,
) -> PyResult<T> {
    run_with_cached_plan_table_emitting_model_warnings(py, scene, accuracy, move |table| {
        if table.scene.finger.is_none() {
            return work(table);
        }
        let (touched, options) =
            (table.scene.replace_finger_by_masses_and_supports_at_places(&finger_places_m), TableOptions::default());
        let levels = ReducedLevels::build(&touched, accuracy, options.to_hz)?;
        work(&table.build_for_scene_with_fingers_keeping_press_effects(&touched, levels, options)?)
    })
}

/// Works with the table of a scene, which is computed if it is not kept. Warns of what is wrong with the panel.
pub fn run_with_cached_plan_table_emitting_model_warnings<T: Send + 'static>(
    py: Python<'_>,
    scene: &Arc<Scene>,
    accuracy: Accuracy,
    work: impl FnOnce(&PlanTable) -> Result<T, Raised> + Send + 'static,
) -> PyResult<T> {
    if scene.actuators.is_empty() {
        return Err(Raised::from(PlanError::NoActuators).into());
    }
    if scene.actuators.len() > MAX_ACTUATORS {
        // Before minutes are spent on a table that no plan comes from.
        return Err(Raised::from(PlanError::Actuators { count: scene.actuators.len() }).into());
    }
    emit_model_warnings(py, validity::list_thin_plate_warnings(scene, TableOptions::default().to_hz))?;
    let own = scene.clone();
    let (found, doubts) = run_in_own_thread_interruptibly(py, move |pool| {
        let shared = get_or_compute_plan_table(pool, &own, accuracy)?;
        let table = shared.lock().unwrap_or_else(PoisonError::into_inner);
        Ok((
            pool.run_in_pool_with_stop_request(|| work(&table))?,
            era_planner::press_bounds::list_warnings_of_actuators_not_withstanding_press(&table),
        ))
    })?;
    emit_model_warnings(py, doubts)?;
    Ok(found)
}

fn get_or_compute_plan_table(pool: &WorkPool, scene: &Arc<Scene>, accuracy: Accuracy) -> Result<SharedTable, Raised> {
    let tolerance = accuracy.relative_tolerance_or_tightest();
    let is_it = |kept: &KeptTable| kept.tolerance.to_bits() == tolerance.to_bits() && kept.scene == *scene;
    let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
    if tables.0 != std::process::id() {
        *tables = (std::process::id(), Vec::new());
    }
    let kept = &mut tables.1;
    if let Some(at) = kept.iter().position(is_it) {
        let found = kept.remove(at);
        let table = found.table.clone();
        kept.push(found);
        return Ok(table);
    }
    // Others look for theirs meanwhile.
    drop(tables);
    let prepared =
        pool.run_in_pool_with_stop_request(|| cache::prepare_table(None, scene, accuracy, TableOptions::default()))?;
    let table: SharedTable = Arc::new(Mutex::new(prepared.table));
    let kept = &mut TABLES.lock().unwrap_or_else(PoisonError::into_inner).1;
    kept.push(KeptTable { scene: scene.clone(), tolerance, table: table.clone() });
    let more = kept.len().saturating_sub(KEPT);
    kept.drain(..more);
    Ok(table)
}

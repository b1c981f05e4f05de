//! A small study: where the left actuator of the example plate makes the weakest place strongest.
//!
//! `cargo run --release -p era-study --example where_to_put_an_actuator`

use era_model::scene::STARTING_PLATE;
use era_study::evaluate::QuickEvaluator;
use era_study::result::{DesignTable, choose_distinct_finalist_indices_meeting_limits_best_first};
use era_study::run::{Shard, Study, StudyFolder, compute_missing_rows_of_shard};
use std::error::Error;

const STUDY: &str = r#"
version = 1
name = "left actuator"
scene = "plate.toml"

[[variable]]
place = "actuator.left"
within_mm = [20, 20, 140, 180]

[[wish]]
figure = "weakest_g"

[method]
way = "latin_hypercube"
designs = 8
seed = 7
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let study = Study::parse_texts("study.toml", STUDY, "plate.toml", STARTING_PLATE)?;
    // What is done is kept there: a second run goes on where the first one ended.
    let results = tempfile::tempdir()?;
    let folder = StudyFolder::open_or_create_refusing_folder_of_other_study(results.path(), study.fingerprint())?;
    compute_missing_rows_of_shard(&study, &folder, &QuickEvaluator::new(study.plan_table_options()), Shard::ALL, &())?;
    let table = DesignTable::gather_from_folder(&study, &folder)?;
    for place in choose_distinct_finalist_indices_meeting_limits_best_first(&study, &table, 3) {
        let entry = &table.entries[place];
        let settings = &entry.row.design.settings;
        println!("design {}: {:.3} g at the weakest place with {settings:?}", place + 1, entry.wishes[0]);
    }
    Ok(())
}

#[test]
fn it_runs() {
    main().unwrap();
}

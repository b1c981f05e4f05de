//! A small study: where the left actuator of the example plate makes the weakest place strongest.
//!
//! `cargo run --release -p era-study --example where_to_put_an_actuator`

use era_model::scene::EXAMPLE_PLATE;
use era_study::evaluate::Quick;
use era_study::result::{Table, finalists};
use era_study::run::{Folder, Shard, Study, run};
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
    let study = Study::parse("study.toml", STUDY, "plate.toml", EXAMPLE_PLATE)?;
    // What is done is kept there: a second run goes on where the first one ended.
    let results = tempfile::tempdir()?;
    let folder = Folder::open(results.path(), study.key())?;
    run(&study, &folder, &Quick::new(study.options()), Shard::ALL, &())?;
    let table = Table::gather(&study, &folder)?;
    for place in finalists(&study, &table, 3) {
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

//! The pin table of the firmware: each pin once, each analogue input once, and an input for an accelerometer.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Pin, function and what is outside, of each row of the table in `text`.
fn read_pin_table(text: &str) -> Vec<[&str; 3]> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | P"));
    rows.filter_map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let [pin, function, _, outside, ..] = cells[..] else { return None };
        Some([pin, function, outside])
    })
    .collect()
}

#[test]
fn every_pin_has_one_row_and_the_accelerometer_has_an_input_of_its_own() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository");
    let text = fs::read_to_string(root.join("firmware/src/pins.rs")).expect("the pin table");
    let rows = read_pin_table(&text);
    assert!(rows.len() > 20, "{rows:?}");
    let pins: BTreeSet<&str> = rows.iter().map(|[pin, ..]| *pin).collect();
    assert_eq!(pins.len(), rows.len(), "a pin has two rows");
    let accelerometers: Vec<_> = rows.iter().filter(|[_, function, _]| function.contains("accelerometer")).collect();
    let [[pin, _, outside]] = accelerometers[..] else { panic!("{accelerometers:?}") };
    assert_eq!(*pin, "B11");
    // PB11 is input 14 of ADC1 and ADC2 (DS12288, pin table), which nothing else has.
    assert!(outside.starts_with("ADC1 and ADC2 input 14"), "{outside}");
    let same_input = rows.iter().filter(|[.., outside]| outside.contains("input 14"));
    assert_eq!(same_input.count(), 1);
}

//! `era field --reach`, `--schemes` and `--effect click` as they are called: the bar's table, what is refused, and the pictures.

use crate::support::program::{make_scratch_path, run_era, run_era_json};
use serde_json::Value;

/// The example bar's path, written where tests may write.
fn bar() -> String {
    let file = make_scratch_path("reach-bar.toml");
    std::fs::write(&file, era::scene::EXAMPLE_BAR).unwrap();
    file.display().to_string()
}

#[test]
fn bands_zones_and_names_that_make_no_sense_are_refused() {
    let bar = bar();
    for (arguments, words) in [
        (
            &["--from", "100", "--to", "110"][..],
            &["--from 100 --to 110", "between 40 and 400 Hz", "20 Hz apart", "at least 20 Hz wide"][..],
        ),
        (&["--from", "300", "--to", "200"], &["--from 300 --to 200", "between 40 and 400 Hz"]),
        (&["--from", "500"], &["--from 500 --to 400", "between 40 and 400 Hz"]),
        (&["--from", "nan"], &["--from", "finite"]),
        (&["--zone", "0,0,300,10"], &["--zone", "x_mm is 300", "0 to 250"]),
        (&["--zone", "100.1,0,100.2,10"], &["--zone", "mm apart"]),
        (&["--zone", "1,2,3"], &["--zone", "X0,Y0,X1,Y1"]),
        (&["--png", "map.jpg"], &["--png", ".png"]),
    ] {
        let output = run_era(&[&["field", "--schemes", "--accuracy", "fast", "--scene", &bar], arguments].concat());
        assert_eq!(output.code, Some(2), "{arguments:?}: {}", output.error);
        for word in words {
            assert!(output.error.contains(word), "{arguments:?}: {}", output.error);
        }
        assert!(output.out.is_empty());
    }
}

/// Tables and pictures of a part of the bar and of its band, and what is said of the files.
#[test]
fn reach_is_reported_and_drawn() {
    let bar = bar();
    let part = ["--zone", "100,0,150,20", "--from", "120", "--to", "180", "--accuracy", "fast", "--scene", &bar];
    for (what, columns, lines) in [
        ("--reach", "x_mm,y_mm,strongest_g,contrast_db,strongest_left_hz", &["reach: ", "contrast"][..]),
        ("--schemes", "x_mm,y_mm,one_setting_1_g,per_touch_1_g", &["| distinct frequencies | ", "First mode"]),
    ] {
        let (png, csv) = (make_scratch_path(&format!("{what}.png")), make_scratch_path(&format!("{what}.csv")));
        let files = ["--png", &png.display().to_string(), "--csv", &csv.display().to_string()];
        let output = run_era(&[&["field", what], &part[..], &files].concat());
        assert!(output.is_success(), "{}", output.error);
        let text = &output.out;
        assert!(lines.iter().all(|line| text.contains(line)) && text.contains("100 to 150 mm"), "{text}");
        assert!(output.error.contains("wrote") && output.error.contains("pixels"), "{}", output.error);
        assert!(std::fs::read_to_string(&csv).unwrap().starts_with(columns));
        let picture = std::fs::read(&png).unwrap();
        assert!(picture.starts_with(b"\x89PNG") && picture.len() < 100_000, "{} bytes", picture.len());
    }
}

#[test]
fn clicks_that_make_no_sense_are_refused() {
    let bar = bar();
    for (arguments, words) in [
        (&["--effect", "buzz"][..], &["--effect is buzz", "must be click"][..]),
        (&["--effect", "knock"], &["--effect", "knock"]),
        (&["--effect", "click", "--crisp-ms", "10"], &["crisp_ms is 10", "20 to 100"]),
        (&["--effect", "click", "--intensity-g", "-1"], &["intensity_g is -1"]),
        (&["--effect", "click", "--at", "60,10"], &["--effect", "--at"]),
        (&["--effect", "click", "--reach"], &["--effect", "--reach"]),
        (&["--at", "480,80", "--crisp-ms", "40"], &["--crisp-ms is 40", "--effect click"]),
        (&["--reach", "--prefer", "crispness"], &["--prefer is crispness", "--effect click"]),
    ] {
        let output = run_era(&[&["field", "--accuracy", "fast", "--scene", &bar], arguments].concat());
        assert_eq!(output.code, Some(2), "{arguments:?}: {}", output.error);
        assert!(words.iter().all(|word| output.error.contains(word)), "{arguments:?}: {}", output.error);
        assert!(output.out.is_empty());
    }
}

/// The map of a click has at every place what `era effect click` predicts there, in all its forms.
#[test]
fn clicks_are_mapped() {
    let file = make_scratch_path("clicks-bar.toml");
    let finger = "\n[finger]\nmass_g = 5.0\ndamping_n_s_per_m = 5.0\nstiffness_n_per_m = 3000.0\n";
    std::fs::write(&file, format!("{}{finger}", era::scene::EXAMPLE_BAR)).unwrap();
    let (with_finger, bar) = (file.display().to_string(), bar());
    let (png, csv) =
        (make_scratch_path("clicks.png").display().to_string(), make_scratch_path("clicks.csv").display().to_string());
    let wish = ["--accuracy", "fast", "--intensity-g", "0.4", "--crisp-ms", "40"];
    let map = ["field", "--effect", "click", "--prefer", "strength", "--json", "--png", &png, "--csv", &csv, "--scene"];
    let output = run_era(&[&map[..], &[with_finger.as_str()], &wish].concat());
    assert!(output.is_success() && output.error.contains("[finger] is not used"), "{}", output.error);
    let found: Value = output.parse_json();
    let places = found["places"].as_array().unwrap();
    assert_eq!(
        (places.len(), &found["intensity_g"], &found["scene"]),
        (12, &Value::from(0.4), &Value::from("example bar"))
    );
    let number = |value: &Value| value.as_f64().unwrap();
    let is_crisp = |place: &&Value| {
        let is_quiet = place["quiet_ms"].as_f64().is_some_and(|quiet_ms| quiet_ms <= 40.0);
        assert_eq!(place["crisp"], number(&place["peak_at_ms"]) <= 15.0 && is_quiet, "{place}");
        place["crisp"] == true
    };
    let share = places.iter().filter(is_crisp).count() as f64 / 12.0;
    assert!((number(&found["crisp_share"]) - share).abs() < 1e-12, "{found}");
    let least_g = places.iter().map(|place| number(&place["peak_g"])).fold(f64::INFINITY, f64::min);
    assert_eq!(number(&found["least_peak_g"]), least_g);
    // The third of twelve cells of 250 mm.
    let at = format!("{},10", 250.0 * 2.5 / 12.0);
    let one = [&["effect", "click", "--json", "--unit", "mm", "--at", &at, "--scene", &bar], &wish[..]].concat();
    let one = run_era_json(&one);
    for key in ["peak_g", "peak_at_ms", "quiet_ms", "contrast_db", "sound_db"] {
        let difference = number(&one["predicted"][key]) - number(&places[2][key]);
        assert!(difference.abs() < 1e-6, "{key}: {} {}", one["predicted"], places[2]);
    }
    let text = std::fs::read_to_string(&csv).unwrap();
    assert!(
        text.starts_with("x_mm,y_mm,peak_g,peak_at_ms,quiet_ms,crisp,contrast_db,sound_db\n")
            && text.lines().count() == 13,
        "{text}"
    );
    assert!(std::fs::read(&png).unwrap().starts_with(b"\x89PNG"));
    let output = run_era(&["field", "--effect", "click", "--accuracy", "fast", "--scene", &bar]);
    let text = &output.out;
    let words = [
        "clicks of 0.5 g",
        "crisp (from the start of the click: peak within 15 ms, motion below a tenth of the peak after 45 ms)",
        "lowest peak",
        "quiet time (median)",
    ];
    assert!(words.iter().all(|word| text.contains(word)) && text.lines().count() <= 15, "{text}");
}

//! What is written of a study, read back: the table by Parquet's reader and by its bytes, the report as a page.

use era_model::scene::STARTING_PLATE;
use era_study::evaluate::{Figures, VerifiedFigures};
use era_study::report::write_report_html;
use era_study::result::{DesignTable, Finalist, VerifiedFinalists, write_parquet};
use era_study::run::{DesignOutcome, DesignRow, Study};
use era_study::written::StudyResults;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

const STUDY: &str = "version = 1\nname = \"a <b> & c\"\nscene = \"plate.toml\"\n\
                     [[variable]]\nplace = \"actuator.left\"\nwithin_mm = [0, 0, 300, 200]\n\
                     [[variable]]\nname = \"metal\"\nkey = \"surface.material.density_kg_m3\"\nvalues = [2700.0, 7800.0]\nnames = [\"light\", \"</script>\"]\n\
                     [[wish]]\nfigure = \"weakest_g\"\n[[wish]]\nfigure = \"mass_g\"\n\
                     [[uncertain]]\nkey = \"surface.thickness_mm\"\npart = 0.1\n[method]\nway = \"sobol\"\ndesigns = 5\n";

fn study() -> Study {
    Study::parse_texts("s.toml", STUDY, "plate.toml", STARTING_PLATE).unwrap()
}

fn row(study: &Study, point: [f64; 3], outcome: DesignOutcome) -> DesignRow {
    DesignRow { point: point.to_vec(), design: study.space.design_at_point(&point), outcome }
}

fn found(weakest: f64, mass: f64, off: f64) -> DesignOutcome {
    let figures = Figures { values: vec![weakest, mass], weakest_mm: Some([1.5, 2.5]) };
    DesignOutcome::Found { figures, low: vec![weakest - off, mass], high: vec![weakest + off, mass] }
}

fn table(study: &Study) -> DesignTable {
    let base = DesignRow {
        point: Vec::new(),
        design: era_study::space::Design { settings: vec![era_study::space::VariableSetting::Kept; 2] },
        outcome: found(0.3, 350.0, 0.1),
    };
    let rows = vec![
        row(study, [0.1, 0.2, 0.3], found(0.5, 400.0, 0.2)),
        row(study, [0.5, 0.5, 0.9], found(0.6, 300.0, 0.1)),
        row(study, [0.7, 0.1, 0.3], found(0.4, 500.0, 0.0)),
        row(study, [0.9, 0.9, 0.9], DesignOutcome::Failed("no such thing".into())),
    ];
    DesignTable::from_rows(study, base, rows)
}

#[test]
fn the_table_is_read_back() {
    let study = study();
    let table = table(&study);
    let bytes = write_parquet(&table).unwrap();
    // The format's own frame: magic at both ends, and before the last one the length of what lies before that.
    assert_eq!((&bytes[..4], &bytes[bytes.len() - 4..]), (b"PAR1".as_slice(), b"PAR1".as_slice()));
    let footer = u32::from_le_bytes(bytes[bytes.len() - 8..bytes.len() - 4].try_into().unwrap()) as usize;
    assert!(footer > 100 && footer < bytes.len() - 12, "{footer} of {}", bytes.len());
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
    let rows: Vec<Vec<(String, Field)>> =
        reader.get_row_iter(None).unwrap().map(|row| row.unwrap().into_columns()).collect();
    let names: Vec<&str> = rows[0].iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(
        names,
        [
            "design",
            "status",
            "reason",
            "on_front",
            "actuator.left.x_mm",
            "actuator.left.y_mm",
            "metal",
            "weakest_g",
            "weakest_g_low",
            "weakest_g_high",
            "mass_g",
            "mass_g_low",
            "mass_g_high",
            "weakest_x_mm",
            "weakest_y_mm"
        ]
    );
    let text = |text: &str| Field::Str(text.into());
    let cell = |row: usize, name: &str| rows[row].iter().find(|(own, _)| own == name).unwrap().1.clone();
    let column = |name: &str| (0..rows.len()).map(|row| cell(row, name)).collect::<Vec<_>>();
    assert_eq!(column("design"), [0, 1, 2, 3, 4].map(Field::Long));
    assert_eq!(column("status"), ["kept", "kept", "kept", "kept", "failed"].map(text));
    // By its worst, 0.3 with 400 g is surpassed by 0.5 with 300 g; and so is 0.4 with 500 g.
    assert_eq!(column("on_front"), [false, false, true, false, false].map(Field::Bool));
    assert_eq!(cell(4, "reason"), text("no such thing"));
    assert_eq!((cell(0, "reason"), cell(0, "metal"), cell(4, "weakest_g")), (Field::Null, Field::Null, Field::Null));
    assert_eq!((cell(1, "metal"), cell(2, "metal")), (text("light"), text("</script>")));
    assert_eq!(
        (cell(1, "actuator.left.x_mm"), cell(1, "actuator.left.y_mm")),
        (Field::Double(30.0), Field::Double(40.0))
    );
    assert_eq!((cell(2, "weakest_g"), cell(2, "weakest_g_low")), (Field::Double(0.6), Field::Double(0.5)));
    assert_eq!(cell(3, "weakest_x_mm"), Field::Double(1.5));
}

/// A page that shows all of it, asks nobody for anything, and cannot be ended by what a study's file says.
#[test]
fn the_report_stands_alone() {
    let study = study();
    let table = table(&study);
    let base = Finalist { design: 0, text: STARTING_PLATE.into(), verified: Err("not looked at".into()) };
    let best = Finalist { design: 2, ..base.clone() };
    let html = write_report_html(&study, &table, &VerifiedFinalists { base, best: vec![best], tolerance: 1e-3 });
    assert_eq!(html.matches("</script>").count(), 2, "the data's, and the script's");
    for outside in ["src=", "href=", "@import", "url(", "fetch(", "http-equiv"] {
        assert!(!html.contains(outside), "{outside}");
    }
    let addresses: Vec<&str> = html.match_indices("http").map(|(at, _)| &html[at..(at + 26).min(html.len())]).collect();
    assert!(addresses.iter().all(|address| address.starts_with("http://www.w3.org/2000/svg")), "{addresses:?}");
    assert!(html.contains("a &lt;b&gt; &amp; c") && !html.contains("<b>"));
    let from = html.find("id=\"data\">").unwrap() + 10;
    let data: serde_json::Value =
        serde_json::from_str(&html[from..from + html[from..].find("</script>").unwrap()]).unwrap();
    assert_eq!(data["rows"].as_array().unwrap().len(), 3);
    // By its worst, as it is judged.
    assert_eq!(data["rows"][1], serde_json::json!([2, [2, 150.0, 100.0, 1.0, 0.5, 300.0]]));
    assert_eq!(data["wishes"][1], serde_json::json!({"name": "mass_g", "column": 5, "most": false}));
    assert!(html.contains("no such thing"));
    // The scene as it is has its own values of what may change: of the first actuator, and of the choice that its density is.
    assert_eq!(data["base"], serde_json::json!([1, [0, 75.0, 100.0, 0.0, 0.2, 350.0]]));
    for row in ["actuator.left.x_mm</th><td>75</td><td>150</td>", "metal</th><td>light</td><td>&lt;/script&gt;</td>"] {
        assert!(html.contains(row), "{row}");
    }
}

#[test]
fn a_study_without_figures_of_settings_has_no_map() {
    let text = STUDY.replace("weakest_g", "sag_um");
    let study = Study::parse_texts("s.toml", &text, "plate.toml", STARTING_PLATE).unwrap();
    let base = Finalist { design: 0, text: STARTING_PLATE.into(), verified: Err("not looked at".into()) };
    let best = Finalist { design: 2, ..base.clone() };
    let html =
        write_report_html(&study, &table(&study), &VerifiedFinalists { base, best: vec![best], tolerance: 1e-3 });
    assert!(html.contains("There is no map: no wish and no limit depends on"), "it says so");
}

/// What does not keep a limit is marked, be it the scene as it is or one of the best once it is computed anew.
#[test]
fn what_does_not_meet_a_limit_is_marked_in_the_report() {
    let limited =
        STUDY.replace("[[uncertain]]", "[[limit]]\nfigure = \"mass_g\"\nleast = 301\nmost = 349\n[[uncertain]]");
    let limited = Study::parse_texts("s.toml", &limited, "plate.toml", STARTING_PLATE).unwrap();
    let verified = |mass: f64| VerifiedFigures {
        figures: Figures { values: vec![0.5, mass], weakest_mm: None },
        bound: None,
        bounds: vec![None; 2],
        strongest_g: Vec::new(),
        x_mm: Vec::new(),
        y_mm: Vec::new(),
    };
    let own = |design: usize, mass: f64| Finalist { design, text: STARTING_PLATE.into(), verified: Ok(verified(mass)) };
    let finals = VerifiedFinalists { base: own(0, 350.0), best: vec![own(2, 300.0), own(1, 310.0)], tolerance: 1e-3 };
    let table = table(&limited);
    let html = write_report_html(&limited, &table, &finals);
    for row in [
        "<th>mass_g</th><td class=\"unmet\" title=\"at most 349\">350.0 (not met)</td>\
         <td class=\"unmet\" title=\"at least 301\">300.0 (not met)</td><td>310.0</td></tr>",
        "<th>limits</th><td class=\"unmet\" title=\"mass_g is 350.0000, but must be at most 349\">not met</td>",
    ] {
        assert!(html.contains(row), "{row} in {html}");
    }
    // Without limits nothing is said of them.
    assert!(!write_report_html(&study(), &table, &finals).contains("<th>limits</th>"));
}

/// Where no design keeps the limits it is told which comes nearest, in parts of each limit, and what it breaks.
#[test]
fn where_no_design_keeps_the_limits_the_nearest_is_reported() {
    let strict = STUDY.replace(
        "[[uncertain]]",
        "[[limit]]\nfigure = \"weakest_g\"\nleast = 0.7\n[[limit]]\nfigure = \"mass_g\"\nmost = 250\n[[uncertain]]",
    );
    let strict = Study::parse_texts("s.toml", &strict, "plate.toml", STARTING_PLATE).unwrap();
    let mut strictly = table(&strict);
    // Of 0.7 g there are 0.3, 0.5 and 0.4 g, and 250 g are exceeded by 150, 50 and 250 g.
    assert_eq!(
        strictly.find_one_based_design_nearest_to_limits_if_none_meets_them().map(|(design, _)| design),
        Some(2)
    );
    let reason = strictly.entries[1].reason.clone().unwrap();
    assert!(reason.contains("0.5000") && reason.contains("300.0000"), "{reason}");
    let base = Finalist { design: 0, text: STARTING_PLATE.into(), verified: Err("not looked at".into()) };
    let finals = VerifiedFinalists { base, best: Vec::new(), tolerance: 1e-3 };
    let page = write_report_html(&strict, &strictly, &finals);
    assert!(page.contains(&format!("Design 2 comes nearest to the limits: {reason}")), "it is in the report");
    let written = StudyResults { table: strictly.clone(), finals };
    let place = std::path::Path::new("here");
    let text = written.summarise_as_text(&strict, place);
    assert!(
        text.contains(&format!("Design 2 comes nearest to the limits: {reason}\ndesign 2: actuator.left")),
        "{text}"
    );
    assert_eq!(
        written.summarise_as_json(&strict, place)["nearest"],
        serde_json::json!({"design": 2, "reason": reason})
    );
    // One that failed is near to nothing, and where a design keeps the limits none is needed.
    strictly.entries.retain(|entry| entry.row.figures_unless_failed().is_none());
    assert!(strictly.find_one_based_design_nearest_to_limits_if_none_meets_them().is_none());
    // Then no limit is broken, and none is told to be.
    let page = write_report_html(&strict, &strictly, &written.finals);
    assert!(
        page.contains("All designs failed. The first failed because: no such thing.")
            && !page.contains("No design keeps")
    );
    let failed = StudyResults { table: strictly, finals: written.finals };
    let text = failed.summarise_as_text(&strict, place);
    assert!(
        text.contains("\nAll designs failed. The first failed because: no such thing")
            && !text.contains("No design keeps"),
        "{text}"
    );
    let study = study();
    assert!(table(&study).find_one_based_design_nearest_to_limits_if_none_meets_them().is_none());
}

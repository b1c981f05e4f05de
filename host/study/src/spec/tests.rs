//! Mistakes in a study's file, all at once, each with its line.

use super::*;

fn told(text: &str) -> Vec<(usize, String)> {
    let error = StudySpec::parse("s.toml", text).unwrap_err();
    error.mistakes.into_iter().map(|mistake| (mistake.line, mistake.text)).collect()
}

#[test]
fn every_mistake_is_reported_with_key_value_allowed_and_line() {
    let text = "version = 2\nname = \"s\"\nscene = \"x.toml\"\nspeed = 1\n\
                [[variable]]\nkey = \"support[0].x_mm\"\nfrom = 3\nto = 1\n\
                [[variable]]\nplace = \"actuator.left\"\nwithin_mm = [0, 0, 1]\n\
                [[variable]]\nkey = \"a.b\"\nfrom = 0\nto = 1\nscale = \"log\"\n\
                [[variable]]\nkey = \"a.b\"\nvalues = [1, 2]\nnames = [\"one\"]\n\
                [[variable]]\nname = \"nothing\"\n\
                [[wish]]\nfigure = \"weakest\"\n\
                [[wish]]\nfigure = \"contrast_db\"\n\
                [[limit]]\nfigure = \"mass_g\"\n\
                [[uncertain]]\nkey = \"a.b\"\npart = 2\nby = 1\n\
                [method]\nway = \"evolution\"\ndesigns = 10\npopulation = 8\nruns = 4\n";
    let expected = [
        (1, "version is 2, but must be 1"),
        (4, "unknown key `speed`"),
        (6, "\"support[0].x_mm\" is not a path to a key or table of a scene"),
        (7, "variable[1].from is 3, but must be no larger than `to`, which is 1"),
        (11, "variable[2].within_mm is [0, 0, 1], but must be a list of 4 numbers"),
        (14, "variable[3].from is 0, but must be above 0, because the scale is \"log\""),
        (20, "variable[4].names is a list of length 1, but must be a list with one name for each value (length 2)"),
        (22, "variable[5]: exactly one of the keys `key`, `place` and `count` is needed"),
        (24, "wish[1].figure is \"weakest\", but must be one of \"weakest_g\""),
        (25, "wish[2].at_mm is missing, but must be [x, y] in mm, the touched point"),
        (28, "limit[1]: at least one of the keys `least` and `most` is needed"),
        (30, "uncertain[1]: exactly one of the keys `part` and `by` is needed"),
        (31, "uncertain[1].part is 2, but must be 0 to 0.99"),
        (35, "method.designs is 10, but must be at least 32 (population x runs), which is one generation for each run"),
    ];
    let told = told(text);
    assert_eq!(told.len(), expected.len(), "{told:#?}");
    for ((line, text), (wanted_line, wanted)) in told.iter().zip(expected) {
        assert!(*line == wanted_line && text.contains(wanted), "{line}: {text}\nwanted {wanted_line}: {wanted}");
    }
}

/// Keys that are known, where nothing asks for them.
#[test]
fn keys_that_do_not_apply_are_reported_with_the_reason() {
    let of = |rest: &str| told(&format!("version = 1\nname = \"s\"\nscene = \"x.toml\"\n{rest}"));
    let wish = "[[wish]]\nfigure = \"mass_g\"\n";
    let [key, place] = ["key", "place"].map(|kind| format!("{wish}[[variable]]\n{kind} = \"a.b\"\n"));
    for (rest, line, expected) in [
        (format!("{wish}[method]\nway = \"grid\"\ndesigns = 512\n"), 8, "method.designs is 512, but must be left out"),
        (format!("{wish}[method]\nlevels = 3\n"), 7, "method.levels is 3, but must be left out"),
        (format!("{wish}[method]\nruns = 3\n"), 7, "method.runs is 3, but must be left out"),
        (
            format!("{wish}[method]\nsamples = 9\n"),
            7,
            "method.samples is 9, but must be left out, because there is no [[uncertain]]",
        ),
        (
            format!("{wish}[[uncertain]]\nkey = \"a.b\"\nby = 1\n[method]\nrobust = \"corners\"\nsamples = 9\n"),
            11,
            "method.samples is 9, but must be left out, because `robust` is \"corners\": the samples are then all \
             combinations of the lowest and the highest values",
        ),
        (
            format!("{wish}[method]\nway = \"evolution\"\nchunk = 3\n"),
            8,
            "method.chunk is 3, but must be left out, because an evolution computes one generation",
        ),
        (
            format!("{wish}at_mm = [1, 2]\n"),
            6,
            "wish[1].at_mm is [1, 2], but must be left out, because the figure mass_g does not use `at_mm`",
        ),
        (format!("{wish}setting = \"one\"\n"), 6, "wish[1].setting is \"one\", but must be left out"),
        (format!("{wish}drives = \"in_phase\"\n"), 6, "wish[1].drives is \"in_phase\", but must be left out"),
        (format!("{wish}force_n = 3\n"), 6, "wish[1].force_n is 3, but must be left out"),
        (
            format!("{key}values = [1]\nfrom = 1\n"),
            9,
            "variable[1].from is 1, but must be left out, because `values` are given",
        ),
        (
            format!("{key}from = 1\nto = 2\ncosts = [1]\n"),
            10,
            "variable[1].costs is [1], but must be left out, because there are no `values`",
        ),
        (
            format!("{place}within_mm = [0, 0, 1, 1]\nmirrored = \"x\"\n"),
            9,
            "variable[1].mirrored is \"x\", but must be left out, because there is no `mirror_of`",
        ),
        (
            format!("{place}within_mm = [0, 0, 1, 1]\nline_mm = [0, 0, 1, 1]\n"),
            7,
            "variable[1]: the keys `within_mm` and `line_mm` are given, but only one of `within_mm`, \
             `line_mm` and `mirror_of` is allowed",
        ),
        (
            format!("{place}key = \"a.c\"\n"),
            6,
            "variable[1]: the keys `key` and `place` are given, but only one of `key`, `place` and `count` is allowed",
        ),
    ] {
        let told = of(&rest);
        assert!(told.len() == 1 && told[0].0 == line && told[0].1.contains(expected), "{told:?} for {expected}");
    }
}

#[test]
fn a_study_wants_something() {
    let told = told("version = 1\nname = \"s\"\nscene = \"x.toml\"\n");
    assert!(told.len() == 1 && told[0].1.contains("at least one [[wish]]"), "{told:?}");
}

#[test]
fn each_figure_is_computed_once_and_has_a_column_of_its_own() {
    let text = "version = 1\nname = \"s\"\nscene = \"x.toml\"\n\
                [[wish]]\nfigure = \"weakest_g\"\n[[wish]]\nfigure = \"weakest_g\"\nsetting = \"one\"\n\
                [[wish]]\nfigure = \"contrast_db\"\nat_mm = [10, 20.5]\n\
                [[limit]]\nfigure = \"weakest_g\"\nleast = 0.1\n[[limit]]\nfigure = \"sag_um\"\nforce_n = 10\nmost = 100\n";
    let spec = StudySpec::parse("s.toml", text).unwrap();
    let columns: Vec<String> =
        spec.distinct_figures_of_wishes_and_limits().iter().map(WantedFigure::column_name).collect();
    assert_eq!(columns, ["weakest_g", "weakest_g_one_setting", "contrast_db_at_10_20.5", "sag_um_10_n"]);
    assert_eq!(spec.wishes[0].goal, WishGoal::Most);
}

#[test]
fn a_weakest_place_is_driven_as_said() {
    let of = |wish: &str| {
        format!(
            "version = 1\nname = \"s\"\nscene = \"x.toml\"\n[[wish]]\nfigure = \"weakest_g\"\n{wish}[method]\nfinalists = 2\n"
        )
    };
    let spec = StudySpec::parse("s.toml", &of("drives = \"in_phase\"\n")).unwrap();
    assert_eq!(spec.distinct_figures_of_wishes_and_limits()[0].column_name(), "weakest_g_in_phase");
    assert_eq!((spec.method.way, spec.method.finalists), (PointMethod::Sobol, 2));
    assert!(
        !spec.distinct_figures_of_wishes_and_limits()[0].needs_no_plan_table()
            && StudySpec::parse("s.toml", &of("")).unwrap().distinct_figures_of_wishes_and_limits()[0]
                .needs_no_plan_table()
    );
    let told = |wish: &str| told(&of(wish))[0].1.clone();
    assert!(told("drives = \"two\"\n").contains("wish[1].drives is \"two\", but must be one of \"distinct\""));
    let both = told("setting = \"one\"\ndrives = \"one_frequency\"\n");
    assert!(
        both.contains("wish[1].drives is \"one_frequency\", but must be \"distinct\", because setting is \"one\""),
        "{both}"
    );
    assert!(StudySpec::parse("s.toml", &of("").replace("weakest_g\"", "mass_g\"\ndrives = \"distinct\"")).is_err());
}

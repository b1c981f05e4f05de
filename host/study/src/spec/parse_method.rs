//! The keys of the table `[method]`, and what they may be.

use super::method::{PointMethod, StudyMethod, UncertaintySampling};
use super::variables::UncertainValue;
use era_model::scene::read::{AllowedNumbers, TomlSection};
use era_planner::TableOptions;

/// Most designs of a study.
pub(crate) const MOST_DESIGNS: u32 = 100_000_000;
/// Most designs that depend on each other, and are all listed first.
const MOST_LISTED: u32 = 10_000_000;
/// Most values of each variable on a grid.
pub(super) const MOST_LEVELS: u32 = 1000;

/// Reads the table, which need not be there, and reports what is wrong with it.
pub(super) fn read_method(file: &TomlSection<'_, '_>, uncertain: &[UncertainValue]) -> StudyMethod {
    let usual = TableOptions::default();
    let mut method = StudyMethod {
        way: PointMethod::Sobol,
        designs: 256,
        seed: 0,
        levels: 5,
        population: 16,
        runs: 4,
        finalists: 3,
        chunk: None,
        robust: UncertaintySampling::LatinHypercube { samples: 16 },
        from_hz: usual.from_hz,
        to_hz: usual.to_hz,
        thorough: false,
    };
    let Some(section) = file.read_table_if_given_and_a_table("method") else { return method };
    let ways = [PointMethod::Grid, PointMethod::LatinHypercube, PointMethod::Sobol, PointMethod::Evolution]
        .map(|way| (way.name(), way));
    if section.has_key_marking_known("way") {
        method.way = section.read_required_word("way", &ways).unwrap_or(method.way);
    }
    let count = |key: &'static str, usual: usize, most: u32| -> usize {
        if section.has_key_marking_known(key) {
            section.read_required_positive_count_or_1(key, most) as usize
        } else {
            usual
        }
    };
    if method.way == PointMethod::Grid {
        method.levels = count("levels", method.levels, MOST_LEVELS);
        report_given_keys_that_must_be_left_out(
            &section,
            ["designs", "seed"],
            "because `levels` alone determines the designs of a grid",
        );
    } else {
        report_given_keys_that_must_be_left_out(&section, ["levels"], "because `way` is not \"grid\"");
        let most = if method.way == PointMethod::LatinHypercube { MOST_LISTED } else { MOST_DESIGNS };
        method.designs = count("designs", method.designs, most);
        method.seed = u64::from(u32::try_from(count("seed", 0, u32::MAX)).unwrap_or(0));
    }
    if method.way == PointMethod::Evolution {
        method.population = count("population", method.population, 10_000);
        method.runs = count("runs", method.runs, 10_000);
        let least = method.population * method.runs;
        if method.population < 4 {
            section.report_wrong_value("population", method.population.to_string(), "4 to 10000");
        } else if method.designs < least {
            let wanted = format!("at least {least} (population x runs), which is one generation for each run");
            section.report_wrong_value("designs", method.designs.to_string(), &wanted);
        }
        report_given_keys_that_must_be_left_out(
            &section,
            ["chunk"],
            "because an evolution computes one generation at a time",
        );
    } else {
        method.chunk = section
            .has_key_marking_known("chunk")
            .then(|| section.read_required_positive_count_or_1("chunk", 1_000_000) as usize);
        report_given_keys_that_must_be_left_out(&section, ["population", "runs"], "because `way` is not \"evolution\"");
    }
    method.finalists = count("finalists", method.finalists, 100);
    let band = AllowedNumbers::Within(1.0, 1000.0);
    method.from_hz = section.read_optional_number_or_nan("from_hz", method.from_hz, band);
    method.to_hz = section.read_optional_number_or_nan("to_hz", method.to_hz, band);
    if method.from_hz > method.to_hz {
        section.report_wrong_value(
            "from_hz",
            method.from_hz.to_string(),
            &format!("no larger than `to_hz`, which is {}", method.to_hz),
        );
    }
    let words = [("quick", false), ("thorough", true)];
    method.thorough = section
        .has_key_marking_known("look")
        .then(|| section.read_required_word("look", &words))
        .flatten()
        .unwrap_or(false);
    if !uncertain.is_empty() {
        let words = [("corners", true), ("latin_hypercube", false)];
        let corners = section
            .has_key_marking_known("robust")
            .then(|| section.read_required_word("robust", &words))
            .flatten()
            .unwrap_or(false);
        if corners {
            report_given_keys_that_must_be_left_out(
                &section,
                ["samples"],
                "because `robust` is \"corners\": the samples are then all combinations of the lowest and the highest values",
            );
            method.robust = UncertaintySampling::Corners;
        } else {
            method.robust = UncertaintySampling::LatinHypercube { samples: count("samples", 16, 10_000) };
        }
    } else {
        report_given_keys_that_must_be_left_out(&section, ["robust", "samples"], "because there is no [[uncertain]]");
    }
    section.report_unknown_keys();
    method
}

/// Tells of keys that are there though nothing asks for them; `why` goes on after "must be left out, ".
pub(super) fn report_given_keys_that_must_be_left_out<const N: usize>(
    section: &TomlSection<'_, '_>,
    keys: [&'static str; N],
    why: &str,
) {
    for key in keys.into_iter().filter(|key| section.has_key_marking_known(key)) {
        section.report_wrong_list(key, &format!("left out, {why}"));
    }
}

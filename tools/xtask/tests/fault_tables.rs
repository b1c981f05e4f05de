//! Faults and figures of the manual: the table of the fault codes in troubleshooting.md, and the faults and limits in safety.md, are those of
//! the code.

use era_shared::limits as code;
use era_shared::protocol::FaultCode;
use std::fs;
use std::path::Path;

fn read_page(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository").to_path_buf();
    fs::read_to_string(root.join("docs/src").join(name)).expect("a page of the manual")
}

/// The cells of each row of the first table whose head begins with `head`.
fn read_table<'t>(text: &'t str, head: &str) -> Vec<Vec<&'t str>> {
    let lines = text.lines().skip_while(|line| !line.starts_with(head)).skip(2);
    lines
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim().trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// Number and name of a fault.
type NamedFault = (u8, String);

fn name_faults(faults: impl IntoIterator<Item = FaultCode>) -> Vec<NamedFault> {
    faults.into_iter().map(|fault| (fault.number(), fault.name().to_owned())).collect()
}

/// The faults of troubleshooting.md, in its order.
fn read_fault_table(text: &str) -> Vec<NamedFault> {
    let rows = read_table(text, "| code | name |");
    rows.iter().filter_map(|row| Some((row.first()?.parse().ok()?, (*row.get(1)?).to_owned()))).collect()
}

/// The faults after which safety.md says that the measurement of the rails is distrusted: `name (number)`, between commas.
fn read_distrust_list(text: &str) -> Vec<NamedFault> {
    let begin = "a fault shows that the measurement may be wrong:";
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let list = words.split_once(begin).and_then(|(_, rest)| rest.split_once(';')).map_or("", |(list, _)| list);
    let one = |entry: &str| {
        let (name, number) = entry.trim().strip_suffix(')')?.split_once(" (")?;
        Some((number.parse().ok()?, name.to_owned()))
    };
    list.split(',').filter_map(one).collect()
}

/// A row of safety.md's table of limits, and what it has to say by the constants of the code.
fn list_limits() -> Vec<(&'static str, Vec<String>)> {
    let volts = |millivolts: u32| format!("{} V", millivolts / 1_000);
    let micro = |nanoseconds: u32| format!("{:.1} us", f64::from(nanoseconds) / 1e3);
    vec![
        ("rail voltage", vec![volts(code::MAX_RAIL_MILLIVOLTS)]),
        ("over-voltage trip", vec![volts(code::OVER_VOLTAGE_MILLIVOLTS)]),
        (
            "rail called safe",
            vec![
                format!("< {}", volts(code::DISCHARGED_MILLIVOLTS)),
                format!("{:.2} s", f64::from(code::BLEEDER_MS) / 1e3),
            ],
        ),
        (
            "discharged by its switch",
            vec![
                format!("within {} ms", code::SWITCHED_DISCHARGE_MS),
                format!("fault {}", FaultCode::DischargeSlow.number()),
            ],
        ),
        (
            "discharged in any case",
            vec![
                format!("within {} s", code::DISCHARGE_LIMIT_MS / 1_000),
                format!("fault {}", FaultCode::DischargeFailed.number()),
            ],
        ),
        ("soft start", vec![format!("{} V/ms", code::RAIL_SLOPE_MILLIVOLTS_PER_MS / 1_000)]),
        (
            "average current",
            vec![
                format!("{} mA", f64::from(code::OVER_CURRENT_MICROAMPS) / 1e3),
                format!("over {} ms", code::OVER_CURRENT_MEAN_MICROSECONDS / 1_000),
                format!("at most {} mA", f64::from(code::MAX_AVERAGE_MICROAMPS) / 1e3),
            ],
        ),
        ("over-current trip", vec![format!("{} mA", code::TRIP_MICROAMPS / 1_000)]),
        (
            "set and measured voltage",
            vec![
                format!("{} %", code::RAIL_TOLERANCE_PERCENT),
                volts(code::RAIL_TOLERANCE_MILLIVOLTS),
                format!("{} ms", code::IMPLAUSIBLE_AFTER_MS),
            ],
        ),
        ("rail that rises", vec![volts(code::RISING_TOLERANCE_MILLIVOLTS)]),
        ("rail above its set-point", vec![format!("for {} ms", code::SWITCHED_DISCHARGE_MS)]),
        ("loss of rail voltage", vec![format!("{} %", code::COLLAPSE_PERCENT), volts(code::COLLAPSE_FROM_MILLIVOLTS)]),
        ("3.3 V supply of the board", vec![format!("within {} %", code::REFERENCE_TOLERANCE_PERCENT)]),
        (
            "guard time",
            vec![
                format!("{} us", code::GUARD_NANOSECONDS / 1_000),
                format!("never below {}", micro(code::LEAST_GUARD_NANOSECONDS)),
            ],
        ),
        (
            "silence of the host",
            vec![
                format!("{} ms", code::DEADMAN_DEFAULT_MS),
                format!("{} ms to {} s", code::DEADMAN_MIN_MS, code::DEADMAN_MAX_MS / 1_000),
            ],
        ),
        (
            "burst of a channel",
            vec![
                format!("{} s", code::BURST_DEFAULT_MS / 1_000),
                format!("up to {} s", code::BURST_MAX_MS / 1_000),
                format!("rest for {} ms", code::REST_MS),
            ],
        ),
        ("duty of a channel", vec![format!("{} %", code::DUTY_PERCENT), format!("{} s", code::DUTY_CREDIT_MS / 1_000)]),
    ]
}

/// What the table of limits in `text` says otherwise than the code.
fn find_wrong_limits(text: &str) -> Vec<String> {
    let rows = read_table(text, "| limit | value |");
    let mut wrong = Vec::new();
    for (limit, figures) in list_limits() {
        match rows.iter().find(|row| row.first() == Some(&limit)).and_then(|row| row.get(1)) {
            None => wrong.push(format!("there is no row `{limit}`")),
            Some(value) => {
                let missing = figures.into_iter().filter(|figure| !value.contains(figure));
                wrong.extend(missing.map(|figure| format!("{limit}: `{value}` does not say {figure}")));
            }
        }
    }
    wrong
}

#[test]
fn the_table_of_faults_is_that_of_the_code() {
    assert_eq!(read_fault_table(&read_page("troubleshooting.md")), name_faults(FaultCode::ALL));
}

#[test]
fn the_faults_that_cast_doubt_on_a_measurement_are_those_of_the_code() {
    let doubtful = FaultCode::ALL.into_iter().filter(|fault| fault.casts_doubt_on_rail_measurement());
    assert_eq!(read_distrust_list(&read_page("safety.md")), name_faults(doubtful));
}

#[test]
fn the_limits_are_those_of_the_code() {
    let wrong = find_wrong_limits(&read_page("safety.md"));
    assert!(wrong.is_empty(), "docs/src/safety.md:\n  {}", wrong.join("\n  "));
    // Other places that say how long a discharge takes.
    for (page, sentence) in [
        ("protocol.md", "a rail that falls needs {} ms"),
        ("protocol.md", "if a rail still has 60 V or more {} ms after switching off"),
        ("troubleshooting.md", "{} ms after the switch closed, the rail still had 60 V or more"),
    ] {
        let words = read_page(page).split_whitespace().collect::<Vec<_>>().join(" ");
        let sentence = sentence.replace("{}", &code::SWITCHED_DISCHARGE_MS.to_string());
        assert!(words.contains(&sentence), "{page} does not say `{sentence}`");
    }
}

#[test]
fn what_is_wrong_is_found() {
    let page = read_page("troubleshooting.md");
    for (from, to) in
        [("| 19 | discharge-slow |", "| 19 | slow-discharge |"), ("| 6 | over-current |", "| 60 | over-current |")]
    {
        assert!(page.contains(from));
        assert_ne!(read_fault_table(&page.replace(from, to)), name_faults(FaultCode::ALL));
    }
    let page = read_page("safety.md");
    let list = read_distrust_list(&page);
    assert_ne!(read_distrust_list(&page.replace("short-circuit (15), ", "")), list);
    for (from, to, limit) in [
        ("never below 88.8 us", "never below 50 us", "guard time"),
        ("within 13 ms, otherwise fault 19", "within 20 ms, otherwise fault 19", "discharged by its switch"),
        ("| 20 V/ms |", "| 40 V/ms |", "soft start"),
        ("| rail voltage |", "| voltage of a rail |", "rail voltage"),
    ] {
        assert!(page.contains(from), "{from}");
        let wrong = find_wrong_limits(&page.replace(from, to));
        assert!(wrong.len() == 1 && wrong[0].contains(limit), "{wrong:?}");
    }
}

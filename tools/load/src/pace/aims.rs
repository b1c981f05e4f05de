//! What is asked of the daemon, beside what was measured.

use super::measured::TouchStatistics;
use super::{BESIDE, Transport};
use crate::times::{Times, format_ms_number_or_never};
use std::time::Duration;

/// Touches a second at which a daemon counts as idle, and the p99 in ms from a touch's being due to its frame's last byte.
const IDLE: (f64, f64) = (1.0, 2.0);
/// The same at the highest rate.
const BUSY: (f64, f64) = (1000.0, 5.0);
/// An echo that has its load in between, and whose p99 in ms is above this, tells that the machine did something else meanwhile: with a quarter
/// of what a touch may take gone for nothing, the machine is what was measured.
const DISTURBED_MS: f64 = IDLE.1 / 4.0;
/// Longest from a stop to the board at any load, in ms.
const STOP_MS: f64 = 10.0;
/// Longest time for which a board that is on may hear nothing, in ms: a sign of life comes after 30 ms, and 50 ms after that the link is
/// in doubt and touches are refused. The board itself goes off after 250 ms.
const SILENCE_MS: f64 = 80.0;

/// A transport, a rate, and what was measured there.
pub struct LoadRow {
    /// The transport.
    pub transport: Transport,
    /// Touches a second.
    pub rate: f64,
    /// What touches came to.
    pub measured: TouchStatistics,
    /// From when a stop was due to its last byte at the board.
    pub stops: Times,
    /// What the same load took with an echo in the daemon's place.
    pub echo: Times,
    /// How often the load was put on until this row.
    pub tries: usize,
}

impl LoadRow {
    /// Whether every touch was driven or overtaken: one that was refused or not seen is never measured away.
    #[must_use]
    pub fn was_every_touch_driven_or_overtaken(&self) -> bool {
        self.measured.describe_counts_of_refused_touches_and_those_without_frame().is_empty()
    }

    /// That the machine was disturbed, where the echo was beside the touches; for people. The touches themselves have no part in that.
    #[must_use]
    pub fn describe_machine_disturbance_if_simultaneous_echo_was_slow(&self) -> Option<String> {
        let p99 = self
            .echo
            .percentile_counting_missing_as_infinite_ms(99)
            .filter(|p99| self.rate <= BESIDE && *p99 > DISTURBED_MS)?;
        Some(format!(
            "disturbed: the echo's p99 in these seconds is {} ms, above {DISTURBED_MS} ms",
            format_ms_number_or_never(p99)
        ))
    }
}

/// One thing that is asked.
#[derive(Debug, PartialEq)]
struct Aim {
    what: String,
    below_ms: f64,
    /// `None` if it was not measured.
    measured_ms: Option<f64>,
    /// How many the figure is from.
    of: usize,
    /// In which try, where there was more than one.
    tries: usize,
    echo_ms: Option<f64>,
}

impl Aim {
    fn is_met_if_measured(&self) -> Option<bool> {
        self.measured_ms.map(|ms| ms < self.below_ms)
    }

    fn format_line(&self) -> String {
        let verdict = match self.is_met_if_measured() {
            Some(true) => "met",
            Some(false) => "not met",
            None => "not measured",
        };
        let measured = self.measured_ms.map_or_else(
            || "-".into(),
            |ms| {
                let tries = if self.tries > 1 { format!(", try {}", self.tries) } else { String::new() };
                format!("{} ms of {}{tries}", format_ms_number_or_never(ms), self.of)
            },
        );
        let echo = self.echo_ms.map_or_else(|| "-".into(), |ms| format!("{} ms", format_ms_number_or_never(ms)));
        let ratio =
            self.measured_ms.zip(self.echo_ms).map_or_else(|| "-".into(), |(ms, echo)| format!("{:.1}", ms / echo));
        let below = format!("below {} ms", self.below_ms);
        format!("{:<64} {below:>13} {measured:>26} {echo:>12} {ratio:>8}  {verdict}\n", self.what)
    }
}

/// Everything that is asked. What a transport came to at a rate that was not tried is not measured.
fn list_aims(rows: &[LoadRow], longest_silence: Duration) -> Vec<Aim> {
    let mut all = Vec::new();
    for (rate, below_ms) in [IDLE, BUSY] {
        for transport in Transport::ALL {
            let row = rows.iter().find(|row| row.transport == transport && row.rate == rate);
            all.push(Aim {
                what: format!("touch to the frame's last byte, p99, {}, {rate}/s", transport.name()),
                below_ms,
                measured_ms: row.and_then(|row| row.measured.frame.percentile_counting_missing_as_infinite_ms(99)),
                of: row.map_or(0, |row| row.measured.frame.len()),
                tries: row.map_or(1, |row| row.tries),
                echo_ms: row.and_then(|row| row.echo.percentile_counting_missing_as_infinite_ms(99)),
            });
        }
    }
    let mut stops = Times::default();
    for row in rows {
        stops.merge(row.stops.clone());
    }
    let mut add = |what: &str, below_ms, measured_ms, of| {
        all.push(Aim { what: what.into(), below_ms, measured_ms, of, tries: 1, echo_ms: None });
    };
    add(
        "stop to the board, longest, at any of these loads",
        STOP_MS,
        stops.longest_counting_missing_as_infinite_ms(),
        stops.len(),
    );
    // A board that was never on has heard nothing that counts.
    let silence_ms = Some(longest_silence.as_secs_f64() * 1e3).filter(|ms| *ms > 0.0);
    add("no sign of life at a board that is on, longest", SILENCE_MS, silence_ms, 1);
    all
}

/// The table, and those that are not met.
pub fn format_aims_and_list_missed(rows: &[LoadRow], longest_silence: Duration) -> (String, Vec<String>) {
    let aims = list_aims(rows, longest_silence);
    let heads = ["aim", "asked", "measured", "echo, p99", "ratio"];
    let [aim, asked, measured, echo, ratio] = heads;
    let mut text = format!("{aim:<64} {asked:>13} {measured:>26} {echo:>12} {ratio:>8}\n");
    text.extend(aims.iter().map(Aim::format_line));
    let missed =
        aims.iter().filter(|aim| aim.is_met_if_measured() == Some(false)).map(|aim| aim.what.clone()).collect();
    (text, missed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(ms: f64, count: usize) -> Times {
        let mut times = Times::default();
        for _ in 0..count {
            times.add_time(Duration::from_secs_f64(ms / 1e3));
        }
        times
    }

    fn rows(idle_ms: f64, busy_ms: f64, stop_ms: f64) -> Vec<LoadRow> {
        let row = |transport, rate, ms| {
            let measured = TouchStatistics { frame: times(ms, 100), ..TouchStatistics::default() };
            LoadRow { transport, rate, measured, stops: times(stop_ms, 10), echo: times(0.5, 100), tries: 1 }
        };
        Transport::ALL
            .into_iter()
            .flat_map(|transport| [row(transport, 1.0, idle_ms), row(transport, 1000.0, busy_ms)])
            .collect()
    }

    const SILENCE: Duration = Duration::from_millis(50);

    #[test]
    fn each_aim_is_missed_by_itself() {
        assert_eq!(format_aims_and_list_missed(&rows(1.9, 4.9, 9.9), SILENCE).1, Vec::<String>::new());
        assert_eq!(format_aims_and_list_missed(&rows(2.1, 4.9, 9.9), SILENCE).1.len(), 3);
        assert_eq!(format_aims_and_list_missed(&rows(1.9, 5.1, 9.9), SILENCE).1.len(), 3);
        assert_eq!(
            format_aims_and_list_missed(&rows(1.9, 4.9, 10.1), SILENCE).1,
            ["stop to the board, longest, at any of these loads"]
        );
        let late = format_aims_and_list_missed(&rows(1.9, 4.9, 9.9), Duration::from_millis(81)).1;
        assert_eq!(late, ["no sign of life at a board that is on, longest"]);
    }

    fn beside_an_echo(rate: f64, touch_ms: f64, echo_ms: f64) -> LoadRow {
        let measured = TouchStatistics { frame: times(touch_ms, 200), ..TouchStatistics::default() };
        LoadRow {
            transport: Transport::Tcp,
            rate,
            measured,
            stops: times(1.0, 10),
            echo: times(echo_ms, 200),
            tries: 1,
        }
    }

    /// By the echo alone, whatever the touches came to, and only where it was beside them.
    #[test]
    fn a_disturbed_machine_is_reported_by_the_echo() {
        for touch_ms in [0.1, 9.0] {
            let row = |rate, echo_ms| beside_an_echo(rate, touch_ms, echo_ms);
            assert_eq!(row(1.0, 0.49).describe_machine_disturbance_if_simultaneous_echo_was_slow(), None);
            assert!(
                row(1.0, 0.51)
                    .describe_machine_disturbance_if_simultaneous_echo_was_slow()
                    .is_some_and(|text| text.contains("0.51 ms"))
            );
            assert!(row(10.0, 0.51).describe_machine_disturbance_if_simultaneous_echo_was_slow().is_some());
            assert_eq!(row(11.0, 3.0).describe_machine_disturbance_if_simultaneous_echo_was_slow(), None);
        }
    }

    /// The last of three tries counts, however it is; stops of all of them do, and a touch that was refused is not measured away.
    #[test]
    fn a_disturbed_load_is_put_on_again() {
        let tried = |echoes: &[f64], refused: bool| {
            let mut left = echoes.iter();
            let row = super::super::repeat_disturbed_measurement_keeping_last_try_and_all_stops(|| {
                let mut row = beside_an_echo(1.0, 9.0, *left.next().unwrap());
                row.measured.refused.extend(refused.then(|| ("queue-full".into(), 1)));
                Ok(row)
            });
            let row = row.unwrap();
            (row.tries, row.stops.len(), row.echo.percentile_counting_missing_as_infinite_ms(99).unwrap(), left.len())
        };
        assert_eq!(tried(&[0.4, 0.3], false), (1, 10, 0.4, 1));
        assert_eq!(tried(&[0.6, 0.3], false), (2, 20, 0.3, 0));
        assert_eq!(tried(&[0.6, 0.8, 0.7, 0.3], false), (3, 30, 0.7, 1));
        assert_eq!(tried(&[0.6, 0.3], true), (1, 10, 0.6, 1));
    }

    /// Two of a hundred touches that were refused are not left out of the p99.
    #[test]
    fn touches_that_never_came_miss_the_aim() {
        let mut rows = rows(1.9, 4.9, 9.9);
        rows[0].measured.frame.add_missing();
        rows[0].measured.frame.add_missing();
        let (text, missed) = format_aims_and_list_missed(&rows, SILENCE);
        assert_eq!(missed.len(), 1);
        assert!(text.contains("never ms of 102"), "{text}");
    }

    #[test]
    fn what_was_not_tried_is_neither_met_nor_missed() {
        let (text, missed) = format_aims_and_list_missed(&[], Duration::ZERO);
        assert_eq!((missed.len(), text.matches("not measured").count()), (0, 8), "{text}");
    }
}

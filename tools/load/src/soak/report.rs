//! The table at the end.

use super::growth::describe_growth_beyond_allowance;
use super::ledger::FaultLedger;
use super::tally::Tally;
use crate::daemon::MemoryThreadsAndHandles;
use era::device::sim::SimObservations;
use std::fmt::Write;
use std::time::Duration;

/// Travel from which on one electrode alone can pull a mass in, as a part of its gap.
const PULL_IN: f64 = 1.0 / 3.0;
/// One answer in so many may be a refusal that nothing in the run asks for.
const UNEXPECTED: u64 = 100;
/// Longest from the loss of the board until it is told, in ms.
const LOSS_REPORTED_WITHIN_MS: f64 = 100.0;

/// All that was counted and seen.
#[derive(Debug)]
pub struct Report {
    /// Of the random choices.
    pub seed: u64,
    /// Whether faults were injected.
    pub injects: bool,
    /// From the first client to the last.
    pub lasted: Duration,
    /// What clients counted.
    pub tally: Tally,
    /// What faults came to.
    pub ledger: FaultLedger,
    /// Outages of the link to the board.
    pub outages: u64,
    /// Faults that the board has latched, as the daemons have counted them.
    pub latched: u64,
    /// What the first daemon took when it was warm.
    pub at_start: MemoryThreadsAndHandles,
    /// What the last one that was killed took before that, after a round of faults.
    pub before_kill: Option<MemoryThreadsAndHandles>,
    /// What the last one took after its last client.
    pub at_end: MemoryThreadsAndHandles,
    /// What the board has seen.
    pub watch: SimObservations,
    /// The log of a daemon that has ended by itself.
    pub ended: Option<String>,
}

impl Report {
    /// Unsafe states that the board was in, in words.
    fn describe_unsafe_states(&self) -> Vec<String> {
        let SimObservations { travel_part, overlaps, late, .. } = self.watch;
        let mut found = Vec::new();
        if travel_part > PULL_IN {
            found.push(format!("a mass travelled {travel_part:.3} of its gap"));
        }
        if overlaps > 0 {
            found.push(format!("both electrodes of an ERA were on in {overlaps} steps"));
        }
        if late > 0 {
            found.push(format!("high voltage was on in {late} observations after the dead-man time"));
        }
        found
    }

    /// Losses of the board that were told too late, in words.
    fn describe_board_losses_reported_late(&self) -> Option<String> {
        let losses = &self.ledger.losses;
        let late = losses.count_missing_or_longer_than(LOSS_REPORTED_WITHIN_MS);
        let longest = losses.longest_counting_missing_as_infinite_ms().filter(|_| late > 0)?;
        let of = losses.len();
        Some(format!(
            "{late} of {of} losses of the board were reported after more than {LOSS_REPORTED_WITHIN_MS} ms, the last after \
             {longest:.0} ms"
        ))
    }

    /// Touches that were not driven though they should have been, in words.
    fn describe_lack_of_driven_touches_or_arming_and_excess_refusals(&self) -> Vec<String> {
        let (tally, mut found) = (&self.tally, Vec::new());
        if tally.sent > 0 && tally.count_driven() == 0 {
            found.push("no touch was driven".into());
        }
        if !tally.arming.is_empty() && !tally.arming.contains_key("200") {
            found.push("nothing armed the board by hand".into());
        }
        let (count, kinds) = tally.count_and_describe_unexpected_refusals(self.injects);
        if count * UNEXPECTED > tally.count_answered_touches() + tally.arming.values().sum::<u64>() {
            found.push(format!("{count} requests were refused without a cause in this run: {}", kinds.join(", ")));
        }
        found
    }

    /// Faults that nobody has injected, in words.
    fn describe_latched_faults_exceeding_injected(&self) -> Option<String> {
        let injected = self.ledger.count_injected_faults_that_may_latch();
        let Self { latched, .. } = self;
        (*latched > injected)
            .then(|| format!("the board has latched {latched} faults, but only {injected} were injected"))
    }

    /// What the daemon takes more and more of, in words. One that has ended by itself takes nothing.
    fn describe_growth_beyond_allowance_before_kill_and_at_end(&self) -> Vec<String> {
        let mut grown = Vec::new();
        if let Some(takes) = self.before_kill {
            grown.extend(describe_growth_beyond_allowance(self.at_start, takes, "before a kill"));
        }
        if self.ended.is_none() {
            grown.extend(describe_growth_beyond_allowance(self.at_start, self.at_end, "at the end"));
        }
        grown
    }

    /// What the daemon did not stand, if anything.
    #[must_use]
    pub fn find_failures(&self) -> Option<String> {
        let mut wrong = self.describe_unsafe_states();
        if self.tally.lost > 0 {
            wrong.push(format!("{} touches were lost", self.tally.lost));
        }
        if self.tally.sent == 0 {
            wrong.push("no touch was sent".into());
        }
        wrong.extend(self.describe_lack_of_driven_touches_or_arming_and_excess_refusals());
        wrong.extend(self.describe_latched_faults_exceeding_injected());
        wrong.extend(self.ledger.misses.iter().cloned());
        wrong.extend(self.describe_board_losses_reported_late());
        wrong.extend(self.describe_growth_beyond_allowance_before_kill_and_at_end());
        wrong.extend(self.ended.as_ref().map(|log| format!("the daemon has ended by itself; its log:\n{log}")));
        (!wrong.is_empty()).then(|| wrong.join("; "))
    }

    /// The table, as text.
    #[must_use]
    pub fn format_table(&self) -> String {
        let mut out = String::new();
        let mut row = |name: &str, value: String| {
            // Writing to a String cannot fail.
            let _ = writeln!(out, "{name:<34} {value}");
        };
        let (tally, total) = (&self.tally, self.ledger.sum_counts_with_longest_times_over_kinds());
        let unsafe_states = self.describe_unsafe_states();
        row("seed, time", format!("{}, {:.1} s", self.seed, self.lasted.as_secs_f64()));
        row("touches sent", tally.sent.to_string());
        row("  answered", tally.count_answered_touches().to_string());
        for (with, count) in &tally.answered {
            let detail = tally.details.get(with).map(|detail| format!(", at first: {detail}")).unwrap_or_default();
            row(&format!("    {with}"), format!("{count}{detail}"));
        }
        row("  outcome told afterwards", tally.told.to_string());
        row("  with a daemon that was killed", tally.killed.to_string());
        row("  lost", tally.lost.to_string());
        row("HTTP, answer p50 / p99 / max", tally.times.describe_median_p99_and_longest());
        row("live, shown p50 / p99 / max", tally.live_times.describe_median_p99_and_longest());
        for (with, count) in &tally.arming {
            row(&format!("arming by hand: {with}"), count.to_string());
        }
        row("stops and looks at the state", tally.others.to_string());
        row("reconnects of clients", tally.reconnects.to_string());
        row("outages of the link to the board", self.outages.to_string());
        row("faults latched by the board", self.latched.to_string());
        let (start, end) = (self.at_start, self.at_end);
        let mut takes = |name: &str, unit: &str, of: fn(MemoryThreadsAndHandles) -> u64| {
            let killed =
                self.before_kill.map(|takes| format!("{}{unit} before a kill, ", of(takes))).unwrap_or_default();
            row(name, format!("{}{unit} at the start, {killed}{}{unit} at the end", of(start), of(end)));
        };
        takes("memory", " kB", |takes| takes.memory_kb);
        takes("threads", "", |takes| takes.threads);
        takes("handles", "", |takes| takes.handles);
        row("faults injected", total.injected.to_string());
        row("  detected", total.detected.to_string());
        row("  recovered", total.recovered.to_string());
        for (kind, count) in &self.ledger.counts {
            let ms = |time: Duration| time.as_secs_f64() * 1e3;
            let value = format!(
                "{} / {} / {}, after {:.0} and {:.0} ms at most",
                count.injected,
                count.detected,
                count.recovered,
                ms(count.detection),
                ms(count.recovery)
            );
            row(&format!("    {kind}"), value);
        }
        row("loss told, p50 / p99 / max", self.ledger.losses.describe_median_p99_and_longest());
        let travel = self.watch.travel_part;
        row("greatest travel, part of the gap", format!("{travel:.4}, {:.0} % of a third", 100.0 * travel / PULL_IN));
        row("unsafe states seen", unsafe_states.len().to_string());
        for what in unsafe_states.iter().chain(&tally.losses).chain(&self.ledger.misses) {
            row(&format!("  {what}"), String::new());
        }
        out
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Of what clients counted, with nothing else to tell.
    pub fn make_report_with_tally(tally: Tally) -> Report {
        Report { tally, ..make_report_without_failures() }
    }

    const TAKES: MemoryThreadsAndHandles = MemoryThreadsAndHandles { memory_kb: 40_000, threads: 16, handles: 24 };

    fn make_report_without_failures() -> Report {
        Report {
            seed: 1,
            injects: false,
            lasted: Duration::from_secs(1),
            tally: Tally::with_one_driven_touch(),
            ledger: FaultLedger::default(),
            outages: 0,
            latched: 0,
            at_start: TAKES,
            before_kill: None,
            at_end: TAKES,
            watch: SimObservations::default(),
            ended: None,
        }
    }

    #[test]
    fn a_loss_that_is_reported_in_time_is_none() {
        let mut told = make_report_without_failures();
        told.ledger.losses.add_time(Duration::from_millis(100));
        assert_eq!(told.find_failures(), None);
    }

    #[test]
    fn anything_lost_missed_or_unsafe_is_a_failure() {
        assert_eq!(make_report_without_failures().find_failures(), None);
        let mut lost = make_report_without_failures();
        lost.tally.record_and_print_lost_touch("one".into());
        let mut missed = make_report_without_failures();
        missed.ledger.misses.push("one".into());
        let far = Report {
            watch: SimObservations { travel_part: 0.34, ..SimObservations::default() },
            ..make_report_without_failures()
        };
        let both = Report {
            watch: SimObservations { overlaps: 1, ..SimObservations::default() },
            ..make_report_without_failures()
        };
        let late = Report {
            watch: SimObservations { late: 1, ..SimObservations::default() },
            ..make_report_without_failures()
        };
        let leaking =
            Report { at_end: MemoryThreadsAndHandles { handles: 90, ..TAKES }, ..make_report_without_failures() };
        let leaked = Report {
            before_kill: Some(MemoryThreadsAndHandles { memory_kb: 90_000, ..TAKES }),
            ..make_report_without_failures()
        };
        let mut untold = make_report_without_failures();
        untold.ledger.losses.add_time(Duration::from_millis(101));
        let faulted = Report { latched: 1, ..make_report_without_failures() };
        let undriven = make_report_with_tally(Tally { sent: 1, ..Tally::default() });
        let mut refused = make_report_without_failures();
        refused.tally.answered.insert("503 device-late".into(), 1);
        let mut unarmed = make_report_without_failures();
        unarmed.tally.arming.insert("429 busy".into(), 1);
        let with_faults = Report { injects: true, tally: refused.tally, ..make_report_without_failures() };
        assert_eq!(with_faults.find_failures(), None);
        let refused = Report { injects: false, ..with_faults };
        for report in [lost, missed, far, both, late, leaking, leaked, untold, faulted, undriven, refused, unarmed] {
            assert!(report.find_failures().is_some() && !report.format_table().is_empty());
        }
    }
}

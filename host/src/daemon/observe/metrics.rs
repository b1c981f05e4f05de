//! Counters in the Prometheus text format.

use crate::daemon::touch::admission::Admission;
use crate::device::DeviceSnapshot;
use era_shared::safety::SafetyState;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// What the daemon counts.
#[derive(Debug, Default)]
pub struct Metrics {
    touches: AtomicU64,
    failures: AtomicU64,
    plans: AtomicU64,
    plan_ns: AtomicU64,
    previews: AtomicU64,
    preview_failures: AtomicU64,
}

impl Metrics {
    /// Counts a touch.
    pub fn count_touch(&self, succeeded: bool) {
        let counter = if succeeded { &self.touches } else { &self.failures };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a preview.
    pub fn count_preview(&self, succeeded: bool) {
        let counter = if succeeded { &self.previews } else { &self.preview_failures };
        counter.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a plan and its time.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
    pub fn count_plan_and_time(&self, elapsed_us: f64) {
        self.plans.fetch_add(1, Ordering::Relaxed);
        self.plan_ns.fetch_add((elapsed_us * 1e3) as u64, Ordering::Relaxed);
    }

    /// All of it as text.
    #[must_use]
    pub fn format_prometheus(
        &self,
        device: &DeviceSnapshot,
        heard_ago: Option<Duration>,
        admission: &Admission,
        peak_g: Option<f64>,
    ) -> String {
        let mut out = String::new();
        let mut metric = |name: &str, kind: &str, help: &str, value: &dyn std::fmt::Display| {
            // Writing to a String cannot fail.
            let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}\n{name} {value}");
        };
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        metric("era_touches_total", "counter", "Touches driven.", &load(&self.touches));
        metric("era_touch_failures_total", "counter", "Touches answered with an error.", &load(&self.failures));
        metric("era_plans_total", "counter", "Plans computed.", &load(&self.plans));
        #[expect(clippy::cast_precision_loss, reason = "a sum of times")]
        let plan_s = load(&self.plan_ns) as f64 / 1e9;
        metric("era_plan_seconds_total", "counter", "Time spent planning.", &plan_s);
        metric("era_previews_total", "counter", "Computed previews of changed scenes.", &load(&self.previews));
        let failures = load(&self.preview_failures);
        metric("era_preview_failures_total", "counter", "Previews answered with an error.", &failures);
        metric("era_device_connected", "gauge", "1 if the device answers, 0 if not.", &u8::from(device.connected));
        let help = "Restarts of the device that the daemon detected.";
        metric("era_device_restarts_total", "counter", help, &device.restarts);
        let help = "Requests that wait for the planner.";
        metric("era_requests_waiting", "gauge", help, &admission.count_waiting_for_planner());
        let help = "Requests refused because too many requests were waiting.";
        metric("era_requests_refused_total", "counter", help, &admission.count_requests_refused_by_full_queue());
        metric("era_device_outages_total", "counter", "Losses of the link to the device.", &device.outages);
        let help = "Requests after which the device sent nothing for 50 ms: the answer was late or lost.";
        metric("era_device_doubts_total", "counter", help, &device.doubts);
        metric("era_device_faults_total", "counter", "Faults latched by the device.", &device.faults);
        let help = "Faults of the type host-silent that the daemon cleared because of --clear-silence.";
        metric("era_device_silences_cleared_total", "counter", help, &device.cleared);
        let help = "Longest time between two answers of the device while the device was armed.";
        metric("era_link_longest_gap_seconds", "gauge", help, &device.longest_gap.as_secs_f64());
        metric("era_link_frames_sent_total", "counter", "Frames sent to the device.", &device.link.frames_sent);
        metric(
            "era_link_repeats_total",
            "counter",
            "Frames sent again because no answer came in time.",
            &device.link.repeats,
        );
        metric(
            "era_link_bad_frames_total",
            "counter",
            "Sequences of bytes from the device that were not a valid frame.",
            &device.link.bad_frames,
        );
        if let Some(peak_g) = peak_g {
            let help = "Largest acceleration at the board's sensor since the newest touch began, in g.";
            metric("era_acceleration_peak_g", "gauge", help, &peak_g);
        }
        let trips = device.round_trips;
        for (name, help, time) in [
            (
                "era_link_round_trip_seconds",
                "Median duration of the last 64 round trips (request and answer).",
                trips.median,
            ),
            (
                "era_link_round_trip_worst_seconds",
                "Longest duration of the last 64 round trips (request and answer).",
                trips.worst,
            ),
            (
                "era_link_round_trip_jitter_seconds",
                "Jitter of the last 64 round trips (request and answer): mean absolute difference between the durations of \
                 successive round trips.",
                trips.jitter,
            ),
            ("era_link_keep_alive_age_seconds", "Time since the device last answered.", heard_ago),
        ] {
            if let Some(time) = time {
                metric(name, "gauge", help, &time.as_secs_f64());
            }
        }
        if let Some(clock) = device.clock {
            let help = "Root mean square of the last 32 errors of the prediction of the board's time.";
            metric("era_clock_residual_rms_seconds", "gauge", help, &clock.residual_rms_s);
            let help = "Largest of the last 32 errors of the prediction of the board's time.";
            metric("era_clock_residual_worst_seconds", "gauge", help, &clock.residual_worst_s);
            let help = "How much faster the board's clock runs than the host's, in parts per million.";
            metric("era_clock_rate_ppm", "gauge", help, &clock.rate_ppm);
            let help = "Samples of the board's clock that were not used because they came late.";
            metric("era_clock_outliers_total", "counter", help, &clock.outliers);
        }
        let help = "1 for the present state of the device, 0 for all other states.";
        let _ = writeln!(out, "# HELP era_device_state {help}\n# TYPE era_device_state gauge");
        for state in SafetyState::ALL {
            let here = u8::from(device.connected && device.state() == Some(state));
            let _ = writeln!(out, "era_device_state{{state=\"{}\"}} {here}", state.name());
        }
        out
    }
}

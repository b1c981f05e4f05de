//! What a touch asks for besides its own place and strength, as `era plan` and `era touch` take it.

use super::headings::PLANNER;
use super::values::{Point, parse_unitless_point};
use crate::planner::schedule::{MIN_WINDOW_MS, Window};
use crate::planner::{Grouping, Objective, Weigh};
use clap::Args;

/// Other targets, quiet zones, times, what is optimised.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = PLANNER)]
pub struct PlanWishes {
    /// Time window of the target, in ms from the start of the touch [default: the whole touch]
    #[arg(long, value_name = "FROM-TO", value_parser = parse_time_window_ms)]
    pub window: Option<Window>,
    /// Another target: its point in the same unit as the touched point, its requested peak in g and its time window in
    /// ms; can be repeated
    #[arg(long, value_name = "X,Y[:G[:FROM-TO]]", value_parser = parse_target_point_with_optional_peak_and_window, allow_hyphen_values = true)]
    pub also: Vec<AdditionalTarget>,
    /// A quiet zone: its centre in the same unit as the touched point, its radius in mm and the highest allowed peak
    /// acceleration in g; can be repeated
    #[arg(long, value_name = "X,Y:MM:G", value_parser = parse_circular_quiet_zone_and_its_limit, allow_hyphen_values = true)]
    pub quiet: Vec<QuietZoneOption>,
    /// What the planner optimises
    #[arg(long, value_enum, default_value_t)]
    pub objective: Objective,
    /// Which actuators share a frequency
    #[arg(long, value_enum, default_value_t)]
    pub grouping: Grouping,
    /// How the planner weights accelerations by frequency; `felt` multiplies each acceleration by the sensitivity of the
    /// skin at the frequency of this acceleration, relative to the sensitivity at 150 Hz
    #[arg(long, value_enum, default_value_t)]
    pub weigh: Weigh,
}

/// Another target, as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdditionalTarget {
    pub at: Point,
    pub intensity_g: Option<f64>,
    pub window: Option<Window>,
}

/// A quiet zone, as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuietZoneOption {
    pub at: Point,
    pub radius_mm: f64,
    pub at_most_g: f64,
}

fn parse_number(text: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or(format!("{text:?} is not a number"))
}

fn parse_time_window_ms(text: &str) -> Result<Window, String> {
    let (from, to) = text.split_once('-').ok_or(format!("{text:?} is not of the form FROM-TO"))?;
    let window = Window { from_ms: parse_number(from)?, to_ms: parse_number(to)? };
    if window.to_ms < window.from_ms + MIN_WINDOW_MS {
        return Err(format!(
            "TO is {}, but must be at least FROM + {MIN_WINDOW_MS}, which is {}",
            window.to_ms,
            window.from_ms + MIN_WINDOW_MS
        ));
    }
    window.check_range().map_err(|error| error.to_string().replace("from_ms", "FROM").replace("to_ms", "TO"))?;
    Ok(window)
}

fn parse_target_point_with_optional_peak_and_window(text: &str) -> Result<AdditionalTarget, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let (at, intensity, window) = match parts.as_slice() {
        [at] => (at, None, None),
        [at, intensity] => (at, Some(intensity), None),
        [at, intensity, window] => (at, Some(intensity), Some(window)),
        _ => return Err(format!("{text:?} is not of the form X,Y[:G[:FROM-TO]]")),
    };
    let read = || -> Result<AdditionalTarget, String> {
        Ok(AdditionalTarget {
            at: parse_unitless_point(at)?,
            // Left empty for a window alone.
            intensity_g: intensity.filter(|text| !text.is_empty()).map(|text| parse_number(text)).transpose()?,
            window: window.map(|text| parse_time_window_ms(text)).transpose()?,
        })
    };
    read().map_err(|error| format!("{error} (the form is X,Y[:G[:FROM-TO]])"))
}

fn parse_circular_quiet_zone_and_its_limit(text: &str) -> Result<QuietZoneOption, String> {
    match text.split(':').collect::<Vec<_>>().as_slice() {
        [at, radius, most] => Ok(QuietZoneOption {
            at: parse_unitless_point(at)?,
            radius_mm: parse_number(radius)?,
            at_most_g: parse_number(most)?,
        }),
        _ => Err(format!("{text:?} is not of the form X,Y:MM:G")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_as_written() {
        let window = Window { from_ms: 200.0, to_ms: 500.0 };
        let at = Point { x: 10.0, y: -2.5 };
        assert_eq!(
            parse_target_point_with_optional_peak_and_window("10,-2.5"),
            Ok(AdditionalTarget { at, intensity_g: None, window: None })
        );
        assert_eq!(
            parse_target_point_with_optional_peak_and_window("10,-2.5:0.3"),
            Ok(AdditionalTarget { at, intensity_g: Some(0.3), window: None })
        );
        assert_eq!(
            parse_target_point_with_optional_peak_and_window("10,-2.5::200-500"),
            Ok(AdditionalTarget { at, intensity_g: None, window: Some(window) })
        );
        assert_eq!(
            parse_circular_quiet_zone_and_its_limit("10,-2.5:15:0.02"),
            Ok(QuietZoneOption { at, radius_mm: 15.0, at_most_g: 0.02 })
        );
        for (text, wanted) in
            [("1,2:x", "\"x\""), ("1,2:1:2:3", "X,Y[:G[:FROM-TO]]"), ("1", "X,Y"), ("1,2:1:5", "FROM-TO")]
        {
            assert!(parse_target_point_with_optional_peak_and_window(text).unwrap_err().contains(wanted), "{text}");
        }
        assert!(parse_time_window_ms("500-200").unwrap_err().contains("TO is 200"));
        assert!(parse_circular_quiet_zone_and_its_limit("1,2:3").is_err());
    }
}

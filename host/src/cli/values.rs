//! Numbers, places and names of files as the command line takes them.

use crate::connection::HostPort;
use crate::scene::MOST_PRESS_N;
use crate::study::tolerances::{MAX_FRACTION, MOST_MM, Tolerances};
use std::path::PathBuf;
use std::time::Duration;

/// Times that make sense for an answer.
const TIMES: std::ops::RangeInclusive<f64> = 1e-3..=3600.0;

/// A time such as `50ms` or `2s`.
pub fn parse_duration_with_unit_ms_or_s(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text:?} is not a time from 1ms to 3600s, such as 50ms or 2s");
    let (number, unit_s) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e-3),
        None => (text.strip_suffix('s').ok_or_else(wrong)?, 1.0),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| wrong())? * unit_s;
    if TIMES.contains(&seconds) { Ok(Duration::from_secs_f64(seconds)) } else { Err(wrong()) }
}

/// A finger's press in N.
pub fn parse_press_n(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(force_n) if (0.0..=MOST_PRESS_N).contains(&force_n) => Ok(force_n),
        _ => Err(format!("{text:?} is not a force from 0 to {MOST_PRESS_N} N")),
    }
}

/// A pair of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub x: f64,
    pub y: f64,
}

pub fn parse_unitless_point(text: &str) -> Result<Point, String> {
    let number = |part: &str| {
        part.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{part:?} is not a number"))
    };
    let two = text.split_once(',').filter(|(_, y)| !y.contains(','));
    let (x, y) = two.ok_or(format!("{text:?} is not of the form X,Y, with two numbers"))?;
    Ok(Point { x: number(x)?, y: number(y)? })
}

/// A number that JSON can carry: anything else would arrive as "not given".
pub fn parse_finite_number(text: &str) -> Result<f64, String> {
    text.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or(format!("{text:?} is not a finite number"))
}

/// Names of files are refused before anything is computed.
pub fn parse_npy_path(text: &str) -> Result<PathBuf, String> {
    parse_path_with_extension(text, "npy", "the name of a NumPy file must end in .npy")
}

/// The extension says of what type a picture is.
pub fn parse_png_path(text: &str) -> Result<PathBuf, String> {
    parse_path_with_extension(text, "png", "the name of a picture must end in .png")
}

/// The extension says what is written.
pub fn parse_path_ending_in_csv_wav_or_png(text: &str) -> Result<PathBuf, String> {
    ["csv", "wav"]
        .into_iter()
        .find_map(|extension| parse_path_with_extension(text, extension, "").ok())
        .map_or_else(|| parse_path_with_extension(text, "png", "the name must end in .csv, .wav or .png"), Ok)
}

fn parse_path_with_extension(text: &str, extension: &str, refusal: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let fits = path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension));
    if fits { Ok(path) } else { Err(refusal.to_owned()) }
}

pub fn parse_comma_separated_grid_counts(text: &str) -> Result<(usize, usize), String> {
    let count = |part: &str| match part.trim().parse::<usize>() {
        Ok(count @ 1..=10_000) => Ok(count),
        _ => Err(format!("{part:?} is not a whole number from 1 to 10000")),
    };
    let (x, y) = text.split_once(',').ok_or(format!("{text:?} is not of the form NX,NY"))?;
    Ok((count(x)?, count(y)?))
}

/// The address of a daemon: `http://` may be left out, and nothing else is spoken.
pub fn parse_daemon_url_adding_http_if_no_scheme(text: &str) -> Result<String, String> {
    let (scheme, rest) = text.trim().split_once("://").unwrap_or(("http", text.trim()));
    let scheme = scheme.to_ascii_lowercase();
    if !matches!(scheme.as_str(), "http" | "https") {
        let text = hide_secret_parts(text);
        return Err(format!(
            "{text:?} begins with {scheme}://, but the address of a daemon must begin with http:// or https://"
        ));
    }
    // Not repeated: there may be a password or a token in them.
    if let Some(part) = [('@', "a user name"), ('#', "text after #"), ('?', "text after ?")]
        .iter()
        .find_map(|(sign, part)| rest.contains(*sign).then_some(*part))
    {
        return Err(format!(
            "the address of the daemon must have the form http://HOST:PORT (with a path if the daemon is behind another \
             server), but contains {part}: remove this part, and use --token-file or ERA_TOKEN for a token"
        ));
    }
    let rest = rest.trim_end_matches('/');
    if rest.is_empty() || rest.contains(char::is_whitespace) {
        return Err(format!("{text:?} is not of the form http://HOST:PORT"));
    }
    Ok(format!("{scheme}://{rest}"))
}

/// An address without its user, and without what is behind `?` or `#`.
pub fn hide_secret_parts(address: &str) -> String {
    let (shown, rest) = address.split_at(address.find(['?', '#']).unwrap_or(address.len()));
    let shown = shown.rfind('@').map_or_else(|| shown.to_owned(), |at| format!("...{}", &shown[at..]));
    if rest.is_empty() { shown } else { format!("{shown}...") }
}

/// A proxy's address: `http://` may be left out, and nothing else is spoken with a proxy.
///
/// # Errors
/// What is allowed.
pub fn parse_outgoing_http_proxy(text: &str) -> Result<HostPort, String> {
    const SCHEME: &str = "http://";
    let has_scheme = text.get(..SCHEME.len()).is_some_and(|first| first.eq_ignore_ascii_case(SCHEME));
    let rest = if has_scheme { text.get(SCHEME.len()..).unwrap_or_default() } else { text };
    rest.trim_end_matches('/').parse().map_err(|error| {
        format!("the address of a proxy must have the form http://HOST:PORT, and this address cannot be used: {error}")
    })
}

/// An address to listen at. A Unix socket has an option of its own.
///
/// # Errors
/// What is allowed.
pub fn parse_listen_address(text: &str) -> Result<HostPort, String> {
    text.parse::<HostPort>().map_err(|error| {
        let is_path = HostPort::is_unix_socket_path(text);
        error + if is_path { "; for a Unix socket, use --socket, or `socket` in a configuration file" } else { "" }
    })
}

/// What may be off: springs, Young's modulus and thickness by parts of themselves, places by mm.
///
/// # Errors
/// What is allowed.
pub fn parse_tolerances_of_springs_modulus_thickness_and_places(text: &str) -> Result<Tolerances, String> {
    let allowed = || {
        format!(
            "must be four numbers, separated by commas. The first three are the largest deviations of the spring \
             stiffness, of Young's modulus and of the thickness, each as a fraction from 0 to {MAX_FRACTION}. The \
             fourth is the largest deviation of the positions of the actuators and supports, from 0 to {MOST_MM} mm"
        )
    };
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    let [springs, youngs_modulus, thickness, places_mm] = numbers[..] else { return Err(allowed()) };
    let tolerances = Tolerances { springs, youngs_modulus, thickness, places_mm };
    if text.split(',').count() != 4 || tolerances.check_ranges().is_err() { Err(allowed()) } else { Ok(tolerances) }
}

//! Which known name a mistyped one is meant for.

/// The known name that `name` is mistyped from, or `None` if none is near. Up to two letters may be wrong, or every third one; two letters that have
/// changed places count as one (optimal string alignment). `-` counts as `_`, and capital letters as small ones.
#[must_use]
pub fn find_nearest_name<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase().replace('-', "_");
    let most_wrong = |known: &str| 2.min(known.len().saturating_sub(1)).max(known.len() / 3);
    let distances = known.into_iter().map(|known| (strsim::osa_distance(known, &name), known));
    distances.filter(|(distance, known)| *distance <= most_wrong(known)).min().map(|(_, known)| known)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistyped_name_is_found() {
        let known = ["x_px", "intensity_g", "duration_ms", "effect", "g"];
        for (name, nearest) in [
            ("intensity", Some("intensity_g")),
            ("intenstiy_g", Some("intensity_g")),
            ("Duration-ms", Some("duration_ms")),
            ("efect", Some("effect")),
            ("xpx", Some("x_px")),
            ("voltage", None),
            ("z", None),
            ("", None),
        ] {
            assert_eq!(find_nearest_name(name, known), nearest, "{name}");
        }
    }
}

//! Pages that were refused: each is told once in the log, as the browser keeps the reason from the page itself.
//!
//! The refusal is not made readable for the page (no `Access-Control-Allow-Origin`): a request that a browser asks about
//! beforehand, as every one with JSON, would have to be let through that question to be refused behind it, and any page in the
//! world could tell which machines have a daemon.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Origins that are told; pages make up as many as they like.
const LOGGED_ORIGINS: usize = 32;
/// Characters of an origin that are told: the longest name of a host has 253.
const LONGEST: usize = 300;

/// Origins that have been told.
#[derive(Debug, Default)]
pub struct RefusedPages(Mutex<BTreeSet<String>>);

impl RefusedPages {
    /// Whether this origin is told now: the first time, and as long as there are not too many.
    fn add_origin_if_new_and_within_limit(&self, origin: &str) -> bool {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.len() < LOGGED_ORIGINS && origin.len() <= LONGEST && known.insert(origin.to_owned())
    }

    /// Tells of a page that was refused; `allow_origin_value_or_fault` is its origin as `--allow-origin` takes it, or what that wants.
    pub fn warn_once_of_refused_origin(&self, origin: &str, allow_origin_value_or_fault: &Result<String, String>) {
        if self.add_origin_if_new_and_within_limit(origin) {
            tracing::warn!(
                origin,
                "refused a request from a page of another origin: {}",
                advise_how_to_allow_origin(origin, allow_origin_value_or_fault)
            );
        }
    }
}

/// What lets its page in.
fn advise_how_to_allow_origin(origin: &str, allow_origin_value_or_fault: &Result<String, String>) -> String {
    match allow_origin_value_or_fault {
        Ok(origin) => format!("start the daemon with --allow-origin {origin} to allow this origin"),
        // What browsers say of pages from a disk, and of frames that are shut off.
        Err(_) if origin == "null" => {
            "the page is a file or in a sandboxed frame, and such pages cannot be allowed: serve the folder \
             of the page (python3 -m http.server 8000), and allow http://localhost:8000"
                .into()
        }
        Err(wanted) => format!("the daemon cannot allow this origin. An origin that the daemon can allow {wanted}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is advised is taken.
    #[test]
    fn only_origins_that_the_option_takes_are_advised() {
        let taken = Ok("http://kiosk:8000".to_owned());
        assert_eq!(
            advise_how_to_allow_origin("http://kiosk:8000", &taken),
            "start the daemon with --allow-origin http://kiosk:8000 to allow this origin"
        );
        for cannot in ["null", "", "HTTP://KIOSK", "http://kiosk/page"] {
            let said = advise_how_to_allow_origin(cannot, &Err("must be an origin".into()));
            assert!(!said.contains("--allow-origin"), "{said}");
            assert_eq!(said.contains("http.server"), cannot == "null", "{said}");
        }
    }

    #[test]
    fn each_origin_is_reported_once_and_there_is_an_end_to_it() {
        let refused_pages = RefusedPages::default();
        assert!(
            refused_pages.add_origin_if_new_and_within_limit("http://localhost:3000")
                && !refused_pages.add_origin_if_new_and_within_limit("http://localhost:3000")
        );
        assert!(
            refused_pages.add_origin_if_new_and_within_limit("http://127.0.0.1:3000")
                && !refused_pages.add_origin_if_new_and_within_limit(&"x".repeat(LONGEST + 1))
        );
        let more = (0..100)
            .filter(|port| refused_pages.add_origin_if_new_and_within_limit(&format!("http://page:{port}")))
            .count();
        assert_eq!(more, LOGGED_ORIGINS - 2);
    }
}

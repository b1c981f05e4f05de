//! Pages that were refused: each is told once in the log, as the browser keeps the reason from the page itself.
//!
//! The refusal is not made readable for the page (no `Access-Control-Allow-Origin`): a request that a browser asks about
//! beforehand, as every one with JSON, would have to be let through that question to be refused behind it, and any page in the
//! world could tell which machines have a daemon.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Origins that are told; pages make up as many as they like.
const TOLD: usize = 32;
/// Characters of an origin that are told: the longest name of a host has 253.
const LONGEST: usize = 300;

/// Origins that have been told.
#[derive(Debug, Default)]
pub struct Strangers(Mutex<BTreeSet<String>>);

impl Strangers {
    /// Whether this origin is told now: the first time, and as long as there are not too many.
    fn is_new(&self, origin: &str) -> bool {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.len() < TOLD && origin.len() <= LONGEST && known.insert(origin.to_owned())
    }

    /// Tells of a page that was refused; `allowed` is its origin as `--allow-origin` takes it, or what that wants.
    pub fn tell(&self, origin: &str, allowed: &Result<String, String>) {
        if self.is_new(origin) {
            tracing::warn!(origin, "a page of another origin was refused; {}", advice(origin, allowed));
        }
    }
}

/// What lets its page in.
fn advice(origin: &str, allowed: &Result<String, String>) -> String {
    match allowed {
        Ok(origin) => format!("--allow-origin {origin} lets it in"),
        // What browsers say of pages from a disk, and of frames that are shut off.
        Err(_) if origin == "null" => {
            "it comes from a file or a frame that is shut off, which cannot be let in: serve its folder \
             (python3 -m http.server 8000) and allow http://localhost:8000"
                .into()
        }
        Err(wanted) => format!("that cannot be let in: an origin {wanted}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is advised is taken.
    #[test]
    fn only_origins_that_the_option_takes_are_advised() {
        let taken = Ok("http://kiosk:8000".to_owned());
        assert_eq!(advice("http://kiosk:8000", &taken), "--allow-origin http://kiosk:8000 lets it in");
        for cannot in ["null", "", "HTTP://KIOSK", "http://kiosk/page"] {
            let said = advice(cannot, &Err("must be an origin".into()));
            assert!(!said.contains("--allow-origin"), "{said}");
            assert_eq!(said.contains("http.server"), cannot == "null", "{said}");
        }
    }

    #[test]
    fn each_origin_is_told_once_and_there_is_an_end_to_it() {
        let strangers = Strangers::default();
        assert!(strangers.is_new("http://localhost:3000") && !strangers.is_new("http://localhost:3000"));
        assert!(strangers.is_new("http://127.0.0.1:3000") && !strangers.is_new(&"x".repeat(LONGEST + 1)));
        let more = (0..100).filter(|port| strangers.is_new(&format!("http://page:{port}"))).count();
        assert_eq!(more, TOLD - 2);
    }
}

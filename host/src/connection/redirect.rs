//! What is said of a server that sends elsewhere (RFC 9110, 15.4). Nothing is sent there: a request is not repeated as another one, and a
//! token is not given to somebody else.

/// What was answered and what to do, where `path` below `url` was asked for and answered with this status and `Location`.
#[must_use]
pub fn describe_redirect(url: &str, path: &str, status: u16, location: Option<&str>) -> (String, String) {
    let Some(location) = location else {
        let found = format!(
            "{url}{path} answers {status} (a redirect) without a new address, so the command was not carried out"
        );
        return (found, "an era daemon does not redirect: check the address in --url".into());
    };
    let new = resolve_location(&format!("{url}{path}"), location);
    let found = format!(
        "{url}{path} answers {status} and names another address, {new}. era sends no request to another \
         address, so the command was not carried out"
    );
    let (without_query, _) = new.split_once(['?', '#']).unwrap_or((&new, ""));
    let advice = match without_query.strip_suffix(path) {
        Some(base) if base == url.trim_end_matches('/') => {
            "the new address is that of the request itself, but an era daemon does not redirect: check the address in --url"
                .into()
        }
        // An address of a live socket is given as that of the daemon.
        Some(base) => format!(
            "if the daemon has this new address, use --url {}",
            base.replacen("ws", "http", usize::from(base.starts_with("ws")))
        ),
        None => "the new address is not that of an era daemon: check the address in --url".into(),
    };
    (found, advice)
}

/// A `Location` as a whole address (RFC 3986, 5.2, without dots in paths, which are for people to read).
fn resolve_location(asked: &str, location: &str) -> String {
    let (scheme, rest) = asked.split_once("://").unwrap_or(("http", asked));
    let authority = rest.split('/').next().unwrap_or_default();
    let is_scheme =
        |text: &str| !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    if location.split_once("://").is_some_and(|(before, _)| is_scheme(before)) {
        location.to_owned()
    } else if location.starts_with("//") {
        format!("{scheme}:{location}")
    } else if location.starts_with('/') {
        format!("{scheme}://{authority}{location}")
    } else {
        let (folder, _) = asked.rsplit_once('/').unwrap_or((asked, ""));
        format!("{folder}/{location}")
    }
}

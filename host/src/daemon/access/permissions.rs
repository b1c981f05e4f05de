//! Who may do what: pages and names from elsewhere, tokens and their roles.

use super::client::TokenNumber;
use super::head::read_single_header;
use super::origins::{Authority, normalize_host_name, normalize_origin};
use super::refused_pages::RefusedPages;
use crate::daemon::api::problem::{Problem, ProblemKind};
use crate::text_file::BYTE_ORDER_MARK;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use percent_encoding::percent_decode_str;
use sha2::{Digest as _, Sha256};
use std::sync::Arc;
use subtle::ConstantTimeEq;

/// What is asked for where no token is sent (RFC 6750, 3).
const CHALLENGE: &str = "Bearer realm=\"era\"";
const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const FETCH_MODE: HeaderName = HeaderName::from_static("sec-fetch-mode");

/// What somebody may do; each role includes those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Read state, scene, fields, metrics, and the page.
    View,
    /// Drive touches, and stop.
    Touch,
    /// Arm, and clear faults.
    Arm,
}

impl Role {
    /// Its name in files and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Touch => "touch",
            Self::Arm => "arm",
        }
    }

    /// That it does not open what needs `needed_role`.
    #[must_use]
    pub fn insufficient_role_problem(self, needed_role: Self) -> Problem {
        let detail = format!(
            "the role of this token is {}, but this request needs the role {}",
            self.name(),
            needed_role.name()
        );
        let challenge = format!("{CHALLENGE}, error=\"insufficient_scope\", scope=\"{}\"", needed_role.name());
        Problem::new(ProblemKind::Role, detail).with_header(header::WWW_AUTHENTICATE, &challenge)
    }
}

/// Marks requests of whoever may open the daemon's socket in the file system: they need no token.
#[derive(Clone, Copy, Debug)]
pub struct Owner;

/// What the listener speaks over which a request has come, as origins name it.
#[derive(Clone, Copy, Debug)]
pub struct Scheme(pub &'static str);

/// A secret and what it opens.
#[derive(Clone)]
pub struct Token {
    /// SHA-256 of the secret, which itself is not kept. Secrets are long enough that nobody finds one by trying.
    digest: Digest,
    role: Role,
}

impl Token {
    fn new(secret: &str, role: Role) -> Self {
        Self { digest: Sha256::digest(secret).into(), role }
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Token").field("role", &self.role).finish_non_exhaustive()
    }
}

/// Of a secret.
type Digest = [u8; 32];

/// Least length of a secret: 128 bits in base64. That, and the pace at which a client is answered, is what stands against trying: 2000 guesses a second find one
/// in 10^27 years on average. To shut out an address after some wrong ones would shut out all who share it, behind a proxy or a router.
const MIN_SECRET: usize = 22;

/// Who is let in. By default: whoever can connect, from the daemon's own page or from none.
#[derive(Clone, Debug, Default)]
pub struct Access {
    /// Origins of other pages that may talk to the daemon: `https://kiosk.example:8443`.
    pub origins: Vec<String>,
    /// Names beside `localhost` and addresses in numbers by which the daemon may be called.
    pub hosts: Vec<String>,
    /// None: no token is asked for.
    pub tokens: Vec<Token>,
    /// Pages that were refused.
    pub refused_pages: Arc<RefusedPages>,
}

impl Access {
    /// Tokens from a file's lines: `ROLE SECRET`, with `#` before what is a comment.
    ///
    /// # Errors
    /// The line and what is wrong with it.
    pub fn parse_tokens(text: &str) -> Result<Vec<Token>, String> {
        let mut tokens = Vec::new();
        // Old systems end lines with a CR alone.
        for (number, line) in (1..).zip(text.replace("\r\n", "\n").split(['\n', '\r'])) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let mut words = line.split_whitespace();
            let role = match words.next() {
                Some("view") => Role::View,
                Some("touch") => Role::Touch,
                Some("arm") => Role::Arm,
                _ => return Err(format!("line {number}: the first word must be a role: view, touch or arm")),
            };
            match (words.next(), words.next()) {
                (Some(secret), None)
                    if secret.len() >= MIN_SECRET && secret.chars().all(is_unreserved_uri_character) =>
                {
                    tokens.push(Token::new(secret, role));
                }
                (Some(_), None) => {
                    return Err(format!(
                        "line {number}: the secret must have at least {MIN_SECRET} characters, each a letter without \
                        an accent, a digit or one of '-', '_', '.' and '~'"
                    ));
                }
                _ => {
                    return Err(format!(
                        "line {number}: the line must have a role and one secret, with a space between them"
                    ));
                }
            }
        }
        if tokens.is_empty() {
            return Err(
                "the file has no token: write one line for each token, with a role (view, touch or arm) and a secret"
                    .into(),
            );
        }
        Ok(tokens)
    }

    /// An origin as browsers send it, from one as people write it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse_origin(text: &str) -> Result<String, String> {
        normalize_origin(text)
    }

    /// A name or an address as the daemon compares it, from one as people write it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse_host(text: &str) -> Result<String, String> {
        normalize_host_name(text)
    }

    /// Whether the request comes from where it may, and of another page's request that is allowed the origin that the answer names.
    ///
    /// # Errors
    /// [`Problem`]: a name or an origin that is neither this daemon's own nor allowed.
    pub fn check_host_and_origin_and_return_allowed_foreign_origin(
        &self,
        method: &Method,
        headers: &HeaderMap,
        host: Option<&Authority>,
        scheme: Option<Scheme>,
    ) -> Result<Option<HeaderValue>, Problem> {
        // A name that someone else's DNS may point here is not ours, whatever page it comes from ("DNS rebinding").
        if let Some(host) = host
            && !host.is_localhost_or_ip_address()
            && !self.hosts.iter().any(|own| host.has_host_name(own))
        {
            let detail = format!(
                "requests for the host {host} are refused; use localhost or the daemon's IP address, or start the daemon with \
                 --allow-host"
            );
            return Err(Problem::new(ProblemKind::ForeignHost, detail));
        }
        let foreign = |who: &str| {
            let detail = format!(
                "requests from {who} are refused; open the daemon's own page, or start the daemon with --allow-origin"
            );
            Problem::new(ProblemKind::ForeignOrigin, detail)
        };
        if let Some(origin) = read_single_header(headers, &header::ORIGIN)? {
            if self.origins.iter().any(|known| known.eq_ignore_ascii_case(origin)) {
                return Ok(headers.get(header::ORIGIN).cloned());
            }
            if !host.is_some_and(|host| host.matches_origin(origin, scheme.map(|Scheme(own)| own))) {
                self.refused_pages.warn_once_of_refused_origin(origin, &Access::parse_origin(origin));
                return Err(foreign(&format!("pages of {origin}")));
            }
            return Ok(None);
        }
        // A browser that sends no Origin (for an image, say) tells here where the request comes from. A link on another page
        // may lead to this daemon's.
        let is_link = *method == Method::GET && read_single_header(headers, &FETCH_MODE)? == Some("navigate");
        match read_single_header(headers, &FETCH_SITE)? {
            Some("cross-site" | "same-site") if !is_link => Err(foreign("other pages")),
            _ => Ok(None),
        }
    }

    /// Whether the request's token opens what it wants, and which that is and what else it opens, if one is asked for.
    ///
    /// # Errors
    /// [`Problem`]: there is no token, it is not known, or its role does not include `needed_role`.
    pub fn check_token_if_required_and_find_number_and_role(
        &self,
        request: &Request,
        needed_role: Option<Role>,
    ) -> Result<Option<(TokenNumber, Role)>, Problem> {
        let Some(needed_role) = needed_role else { return Ok(None) };
        if self.tokens.is_empty() || request.extensions().get::<Owner>().is_some() {
            return Ok(None);
        }
        let bearer = read_single_header(request.headers(), &header::AUTHORIZATION)?.and_then(read_bearer_token);
        // A page cannot set its socket's headers. Nothing else takes it so: addresses end up in logs.
        let query = request.uri().query().filter(|_| request.uri().path() == "/v1/live").unwrap_or_default();
        let in_query = read_token_from_query(query);
        let given = bearer.or(in_query.as_deref()).map(str::trim);
        let digest: Option<Digest> = given.map(|given| Sha256::digest(given).into());
        let role = digest.and_then(|digest| self.find_highest_role_and_token_index(&digest));
        match role {
            Some((role, number)) if role >= needed_role => Ok(Some((TokenNumber(number), role))),
            Some((role, _)) => Err(role.insufficient_role_problem(needed_role)),
            None => {
                let (detail, challenge) = match given {
                    None => (
                        "the request has no token: send the header Authorization: Bearer TOKEN, or ?token=TOKEN for /v1/live",
                        CHALLENGE.into(),
                    ),
                    Some(_) => (
                        "this token is not in the daemon's token file",
                        format!("{CHALLENGE}, error=\"invalid_token\""),
                    ),
                };
                Err(Problem::new(ProblemKind::Token, detail).with_header(header::WWW_AUTHENTICATE, &challenge))
            }
        }
    }

    /// The most that a secret with this digest opens, and its place among the tokens. Digests are compared whole, all of them, in
    /// a time that tells nothing of where they differ.
    fn find_highest_role_and_token_index(&self, secret_digest: &Digest) -> Option<(Role, usize)> {
        let is_same = |token: &Token| bool::from(token.digest.ct_eq(secret_digest));
        let same = self.tokens.iter().enumerate().filter(|(_, token)| is_same(token));
        same.map(|(number, token)| (token.role, number)).max()
    }
}

/// Characters that stand for themselves wherever a secret is written, addresses included (RFC 3986, 2.3).
const fn is_unreserved_uri_character(c: char) -> bool {
    c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '~')
}

/// The token behind an address, without what was around it in the file that a page has it from: a byte order mark, ends of lines.
fn read_token_from_query(query: &str) -> Option<String> {
    let raw = query.split('&').find_map(|pair| pair.strip_prefix("token="))?;
    // Spaces are written as `+` there, too.
    let plain = percent_decode_str(&raw.replace('+', " ")).decode_utf8_lossy().into_owned();
    Some(plain.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&plain).trim().to_owned())
}

/// The token in an `Authorization` header; the scheme's case is of no account (RFC 9110, 11.1).
fn read_bearer_token(authorization: &str) -> Option<&str> {
    let (scheme, token) = authorization.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then_some(token)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKENS: &str =
        "# panel\nview AAAAAAAAAAAAAAAAAAAAAA\ntouch BBBBBBBBBBBBBBBBBBBBBBBB\n\narm CCCCCCCCCCCCCCCCCCCCCCCC\n";

    /// What is compared is digests, and those in constant time (`ct_eq`): a part of a secret opens as little as none of it.
    #[test]
    fn nothing_but_the_whole_secret_opens() {
        let access = Access { tokens: Access::parse_tokens(TOKENS).unwrap(), ..Access::default() };
        let role =
            |given: &str| access.find_highest_role_and_token_index(&Sha256::digest(given).into()).map(|(role, _)| role);
        for (secret, opens) in
            [("A".repeat(22), Role::View), ("B".repeat(24), Role::Touch), ("C".repeat(24), Role::Arm)]
        {
            assert_eq!(role(&secret), Some(opens));
            for length in 0..secret.len() {
                assert_eq!(role(&secret[..length]), None, "{length} of {}", secret.len());
                let mut other = secret.clone().into_bytes();
                other[length] ^= 1;
                assert_eq!(role(std::str::from_utf8(&other).unwrap()), None, "wrong at {length}");
            }
            for more in [secret.repeat(2), format!("{secret}="), format!("{secret}\0"), secret.to_lowercase()] {
                assert_eq!(role(&more), None, "{more:?}");
            }
        }
    }

    #[test]
    fn secrets_are_neither_short_nor_shown() {
        for (text, wanted) in [
            ("", "no token"),
            ("view short", "line 1"),
            ("\nboss AAAAAAAAAAAAAAAAAAAAAA", "line 2"),
            ("arm", "secret"),
            ("arm AAAAAAAAAAAAAAAAAAAAA+/=", "without an accent"),
        ] {
            let error = Access::parse_tokens(text).unwrap_err();
            assert!(error.contains(wanted), "{text:?}: {error}");
        }
        let shown = format!("{:?}", Access::parse_tokens(TOKENS).unwrap());
        assert!(!shown.contains("AAAA") && shown.contains("View"), "{shown}");
    }

    #[test]
    fn only_what_comes_from_here_or_is_allowed_is_taken() {
        let access = Access {
            origins: vec!["https://kiosk.example".into()],
            hosts: vec!["panel.local".into()],
            ..Access::default()
        };
        let taken = |method: &Method, headers: &[(&'static str, &[u8])]| {
            let mut map = HeaderMap::new();
            for (name, value) in headers {
                map.append(*name, HeaderValue::from_bytes(value).unwrap());
            }
            let host = read_single_header(&map, &header::HOST)?.and_then(Authority::parse);
            access.check_host_and_origin_and_return_allowed_foreign_origin(
                method,
                &map,
                host.as_ref(),
                Some(Scheme("http")),
            )
        };
        let good: &[&[(&'static str, &[u8])]] = &[
            &[("host", b"127.0.0.1:7878")],
            &[("host", b"localhost:7878"), ("origin", b"http://localhost:7878")],
            &[("host", b"[::1]:7878"), ("sec-fetch-site", b"same-origin")],
            &[("host", b"panel.local:7878"), ("sec-fetch-site", b"none")],
            &[("host", b"127.0.0.1"), ("origin", b"https://kiosk.example"), ("sec-fetch-site", b"cross-site")],
            &[],
        ];
        for headers in good {
            assert!(taken(&Method::POST, headers).is_ok(), "{headers:?}");
        }
        let bad: &[&[(&'static str, &[u8])]] = &[
            &[("host", b"elsewhere.example")],
            &[("host", b"localhost.elsewhere.example:7878")],
            &[("host", b"127.0.0.1:7878"), ("origin", b"http://127.0.0.1:9999")],
            &[("host", b"127.0.0.1:7878"), ("origin", b"https://127.0.0.1:7878")],
            &[("host", b"127.0.0.1:7878"), ("origin", b"null")],
            &[("host", b"127.0.0.1:7878"), ("origin", b"https://kiosk.example.evil")],
            &[("host", b"127.0.0.1:7878"), ("sec-fetch-site", b"cross-site")],
            &[("host", b"127.0.0.1:7878"), ("sec-fetch-site", b"same-site")],
            // What is not ASCII was taken for absent once.
            &[("host", b"elsewhere\xc3\xa4.example")],
            &[("host", b"127.0.0.1:7878"), ("origin", b"http://k\xc3\xb6nig.example")],
        ];
        for headers in bad {
            assert!(taken(&Method::POST, headers).is_err(), "{headers:?}");
        }
        // A link on another page may lead here; a form there may not.
        let link: &[(&'static str, &[u8])] = &[("sec-fetch-site", b"cross-site"), ("sec-fetch-mode", b"navigate")];
        assert!(taken(&Method::GET, link).is_ok() && taken(&Method::POST, link).is_err());
    }
}

//! Certificates and private keys in files (PEM): reading them, what is wrong with those that cannot be used, and their dates.

use crate::private_file;
use crate::text_file::BYTE_ORDER_MARK;
use std::fmt;
use std::io::Read;
use std::path::Path;
use time::OffsetDateTime;
use tokio_rustls::rustls::client::{verify_server_cert_signed_by_trust_anchor, verify_server_name};
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::rustls::server::ParsedCertificate;
use tokio_rustls::rustls::{CertificateError, Error, RootCertStore};

/// First bytes of a certificate or key in DER: a sequence of more than 127 bytes.
const DER: [&[u8]; 2] = [&[0x30, 0x81], &[0x30, 0x82]];

/// Reads the certificates of a file, one at least, in their order.
///
/// # Errors
/// What is wrong with the file, and what to do.
pub fn read_certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, String> {
    let mut bytes = Vec::new();
    let read = private_file::open_without_waiting(path).and_then(|mut file| file.read_to_end(&mut bytes));
    read.map_err(|error| format!("cannot read the file: {error}"))?;
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(&bytes);
    let found: Result<Vec<CertificateDer<'static>>, pem::Error> = CertificateDer::pem_slice_iter(bytes).collect();
    let found = found.map_err(|error| describe_damage(&error))?;
    if found.is_empty() {
        return Err(describe_absence(path, bytes, "certificate", "x509"));
    }
    for certificate in &found {
        ParsedCertificate::try_from(certificate).map_err(|error| describe_damage(&error))?;
    }
    Ok(found)
}

/// Reads a private key, of a file that only its owner may read.
///
/// # Errors
/// What is wrong with the file, and what to do.
pub fn read_private_key(path: &Path) -> Result<PrivateKeyDer<'static>, String> {
    let bytes = private_file::read_bytes(path)?;
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(&bytes);
    let has = |words: &str| bytes.windows(words.len()).any(|window| window == words.as_bytes());
    // Of PKCS #8, and of the older files of `openssl`.
    if has("BEGIN ENCRYPTED PRIVATE KEY") || has("Proc-Type: 4,ENCRYPTED") {
        return Err(format!(
            "the key is encrypted with a passphrase, and the daemon cannot ask for a passphrase when it starts: \
             `openssl pkey -in {} -out NEW` writes the key without a passphrase",
            path.display()
        ));
    }
    match PrivateKeyDer::from_pem_slice(bytes) {
        Ok(key) => Ok(key),
        Err(pem::Error::NoItemsFound) => Err(describe_absence(path, bytes, "private key", "pkey")),
        Err(error) => Err(describe_damage(&error)),
    }
}

fn describe_damage(error: &dyn fmt::Display) -> String {
    format!("the file is damaged ({error}): restore the file, or make a new certificate and key")
}

/// Why nothing of the kind is in a file; `tool` is the command of `openssl` that turns it into PEM.
fn describe_absence(path: &Path, bytes: &[u8], wanted: &str, tool: &str) -> String {
    if bytes.trim_ascii().is_empty() {
        return format!("the file is empty, but must contain a {wanted} in PEM format");
    }
    if DER.iter().any(|begin| bytes.starts_with(begin)) {
        let path = path.display();
        return format!(
            "the file is in DER format, but must be in PEM format: `openssl {tool} -in {path} -inform der -out NEW` \
             converts the file"
        );
    }
    let kinds = ["CERTIFICATE-----", "PUBLIC KEY-----", "OPENSSH PRIVATE KEY-----", "PRIVATE KEY-----"];
    let has = |words: &str| bytes.windows(words.len()).any(|window| window == words.as_bytes());
    let there = match kinds.into_iter().find(|kind| has(kind)) {
        Some("CERTIFICATE-----") => "a certificate",
        Some("PUBLIC KEY-----") => "a public key",
        Some("OPENSSH PRIVATE KEY-----") => "a key in OpenSSH's own format",
        Some(_) => "a private key",
        None => return format!("the file contains no {wanted} in PEM format (a PEM file begins with -----BEGIN)"),
    };
    format!("the file contains {there}, but must contain a {wanted} in PEM format")
}

/// What is wrong with a certificate's dates at a time, if something is.
#[must_use]
pub fn find_date_fault(certificate: &CertificateDer<'_>, now: UnixTime) -> Option<CertificateError> {
    let parsed = ParsedCertificate::try_from(certificate).ok()?;
    let algorithms = ring::default_provider().signature_verification_algorithms.all;
    // Nobody is trusted, so there is an error in any case; dates are looked at first.
    match verify_server_cert_signed_by_trust_anchor(&parsed, &RootCertStore::empty(), &[], now, algorithms) {
        Err(Error::InvalidCertificate(fault)) if describe_date_fault(&fault).is_some() => Some(fault),
        _ => None,
    }
}

/// Dates that are wrong, in words; nothing where it is something else.
#[must_use]
pub fn describe_date_fault(fault: &CertificateError) -> Option<String> {
    let clock = |time: &UnixTime| format!("the clock of this computer shows {}", show_time(*time));
    Some(match fault {
        CertificateError::ExpiredContext { time, not_after } => {
            format!("expired on {} ({})", show_time(*not_after), clock(time))
        }
        CertificateError::NotValidYetContext { time, not_before } => {
            format!("is not valid before {} ({})", show_time(*not_before), clock(time))
        }
        CertificateError::Expired => "has expired".into(),
        CertificateError::NotValidYet => "is not valid yet".into(),
        _ => return None,
    })
}

/// Whether a certificate says of no host that it is for it.
#[must_use]
pub fn is_nameless(certificate: &CertificateDer<'_>) -> bool {
    let Ok(any) = ServerName::try_from("localhost") else { return false };
    ParsedCertificate::try_from(certificate).is_ok_and(|parsed| {
        matches!(
            verify_server_name(&parsed, &any),
            Err(Error::InvalidCertificate(CertificateError::NotValidForNameContext { presented, .. })) if presented.is_empty()
        )
    })
}

/// A time as people write it, in UTC and to the minute.
fn show_time(time: UnixTime) -> String {
    let seconds = i64::try_from(time.as_secs()).unwrap_or(i64::MAX);
    match OffsetDateTime::from_unix_timestamp(seconds) {
        Ok(at) => {
            let (year, month, day) = (at.year(), u8::from(at.month()), at.day());
            format!("{year:04}-{month:02}-{day:02} {:02}:{:02} UTC", at.hour(), at.minute())
        }
        Err(_) => "a date after the year 9999".into(),
    }
}

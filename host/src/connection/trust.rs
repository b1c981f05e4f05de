//! Whose certificates are trusted.

use crate::certificate;
use std::sync::Arc;
use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::client::verify_server_name;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::server::ParsedCertificate;
use tokio_rustls::rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, RootCertStore, SignatureScheme,
};

/// What a connection trusts: these certificates and what they sign, or where there are none the authorities of the web.
///
/// # Errors
/// What is wrong with the certificates.
pub fn client_config(given: Vec<CertificateDer<'static>>) -> Result<Arc<ClientConfig>, String> {
    let builder = ClientConfig::builder();
    if given.is_empty() {
        let roots = RootCertStore { roots: webpki_roots::TLS_SERVER_ROOTS.to_vec() };
        return Ok(Arc::new(builder.with_root_certificates(roots).with_no_client_auth()));
    }
    let mut roots = RootCertStore::empty();
    for certificate in &given {
        roots.add(certificate.clone()).map_err(|error| error.to_string())?;
    }
    let signed = WebPkiServerVerifier::builder(Arc::new(roots)).build().map_err(|error| error.to_string())?;
    let verifier = Arc::new(GivenOrSigned { given, signed });
    Ok(Arc::new(builder.dangerous().with_custom_certificate_verifier(verifier).with_no_client_auth()))
}

/// Trusts a certificate that was given itself, as well as those that were signed with its key.
///
/// The usual rules (RFC 5280) want a server's certificate to be signed by one that may sign, and not to be such a one itself. But
/// what `openssl req -x509` makes is both at once. Where it has been given, byte for byte, nobody else has to vouch for it: dates, names
/// and that the server has its key are looked at as always.
#[derive(Debug)]
struct GivenOrSigned {
    given: Vec<CertificateDer<'static>>,
    signed: Arc<WebPkiServerVerifier>,
}

impl ServerCertVerifier for GivenOrSigned {
    fn verify_server_cert(
        &self,
        shown: &CertificateDer<'_>,
        between: &[CertificateDer<'_>],
        name: &ServerName<'_>,
        ocsp: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        if !self.given.contains(shown) {
            return self.signed.verify_server_cert(shown, between, name, ocsp, now);
        }
        if let Some(fault) = certificate::find_date_fault(shown, now) {
            return Err(Error::InvalidCertificate(fault));
        }
        match verify_server_name(&ParsedCertificate::try_from(shown)?, name) {
            // It names no host at all: there is nothing to compare, and its key is what counts.
            Err(Error::InvalidCertificate(CertificateError::NotValidForNameContext { presented, .. }))
                if presented.is_empty() => {}
            result => result?,
        }
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        shown: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signed.verify_tls12_signature(message, shown, signature)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        shown: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signed.verify_tls13_signature(message, shown, signature)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.signed.supported_verify_schemes()
    }
}

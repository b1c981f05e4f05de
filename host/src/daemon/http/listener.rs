//! Where the daemon listens: loopback, a socket in the file system, or with TLS anywhere.

use super::damaged_certificate;
use crate::certificate::{describe_date_fault, find_date_fault, is_nameless, read_certificates, read_private_key};
use crate::connection::HostPort;
use era_files::{Readers, make_private_folder, replace_file};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring::sign::any_supported_type;
use tokio_rustls::rustls::pki_types::{ServerName, UnixTime};
use tokio_rustls::rustls::server::ParsedCertificate;
use tokio_rustls::rustls::{self, ServerConfig};

/// A place where connections come in.
pub enum Listener {
    /// Plain TCP; loopback only, which [`Listener::bind_tcp`] sees to.
    Tcp(TcpListener),
    /// TCP with TLS.
    Tls(TcpListener, TlsAcceptor),
    /// A socket in the file system, for its owner alone.
    #[cfg(unix)]
    Unix(UnixPlace),
}

/// A socket in the file system, removed at the end.
#[cfg(unix)]
#[derive(Debug)]
pub struct UnixPlace {
    listener: tokio::net::UnixListener,
    path: PathBuf,
}

#[cfg(unix)]
impl Drop for UnixPlace {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

impl fmt::Debug for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Listener").field(&self.url()).finish()
    }
}

/// Why there is no listener.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// Two kilovolts for everybody.
    #[error(
        "--listen {address} is not a loopback address: everybody who reaches this address could drive the panel. Such an \
         address needs --token-file for access and, for TLS, either --tls-cert with --tls-key, or --tls-dir (which makes a certificate)"
    )]
    Open {
        /// As asked for.
        address: SocketAddr,
    },
    /// The system gives no port.
    #[error("cannot listen on {address}: {source}. {}", advise_on_port_error(.source))]
    Port {
        /// As asked for.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The name has no address.
    #[error(
        "cannot listen on {place}: {source}. --listen needs an IP address or a host name \
         of this machine"
    )]
    Name {
        /// As asked for.
        place: String,
        /// Why.
        source: io::Error,
    },
    /// The system gives no socket.
    #[error("cannot listen on the socket {path}: {source}")]
    Socket {
        /// Where.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// A running daemon has it.
    #[error("another daemon listens on the socket {path}: give another path with --socket, or --socket none")]
    Taken {
        /// Where.
        path: String,
    },
    /// Certificate or key.
    #[error("{file}: {reason}")]
    Tls {
        /// Which file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A certificate that was made, or its key, cannot be written.
    #[error("cannot write {file}: {source}")]
    Unwritten {
        /// Which file.
        file: String,
        /// Why.
        source: io::Error,
    },
}

impl ListenError {
    /// Whether this file of certificate and key is what is wrong.
    #[must_use]
    pub fn is_about_tls_file(&self, path: &Path) -> bool {
        matches!(self, Self::Tls { file, .. } if *file == path.display().to_string())
    }
}

/// What to do where the system gives no port.
fn advise_on_port_error(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrNotAvailable => {
            "This machine does not have this address: use 127.0.0.1 for connections from this machine, or 0.0.0.0 for all \
             addresses of this machine"
        }
        io::ErrorKind::PermissionDenied => "Ports below 1024 need root or the capability CAP_NET_BIND_SERVICE",
        _ => {
            "Is another daemon running? Choose another port with `era serve --listen 127.0.0.1:PORT` (0: any free port), and \
             give the new address to clients with --url"
        }
    }
}

/// Files of a certificate and its key.
#[derive(Clone, Debug)]
pub struct TlsFiles {
    /// Certificates in PEM, the daemon's own first.
    pub certificate: PathBuf,
    /// Its private key in PEM.
    pub key: PathBuf,
}

impl TlsFiles {
    /// Those that are made in a folder.
    fn default_paths_in_folder(folder: &Path) -> Self {
        Self { certificate: folder.join("era-cert.pem"), key: folder.join("era-key.pem") }
    }

    /// Whether they can be used.
    ///
    /// # Errors
    /// [`ListenError::Tls`].
    pub fn check_usable(&self) -> Result<(), ListenError> {
        build_tls_acceptor(self).map(drop)
    }

    /// What is wrong with the dates of the certificates at this time, in words.
    #[must_use]
    pub fn list_date_faults(&self) -> Vec<String> {
        let name = self.certificate.display();
        let all = read_certificates(&self.certificate).unwrap_or_default();
        let told = |(number, certificate)| {
            let fault = describe_date_fault(&find_date_fault(certificate, UnixTime::now())?)?;
            let which =
                if number == 1 { "the certificate".into() } else { format!("certificate {number} of the chain") };
            Some(format!("{name}: {which} {fault}; clients refuse this certificate, so replace the certificate"))
        };
        (1..).zip(&all).filter_map(told).collect()
    }

    /// Whether the certificate is for no name of a host, so that most clients refuse it.
    #[must_use]
    pub fn has_no_dns_name_or_ip_address(&self) -> bool {
        read_certificates(&self.certificate).is_ok_and(|all| all.first().is_some_and(is_nameless))
    }

    /// Those in a folder; `None` if neither is there, or what is there was left half-written, which [`find_or_make_certificate`] replaces.
    ///
    /// # Errors
    /// [`ListenError::Tls`]: a certificate alone, which clients may have been given.
    pub fn find_whole_pair_in_folder_or_error_if_only_key_missing(folder: &Path) -> Result<Option<Self>, ListenError> {
        let files = Self::default_paths_in_folder(folder);
        if damaged_certificate::find_damaged_file_and_describe_damage(&files.certificate, &files.key).is_some() {
            return Ok(None);
        }
        // The certificate is looked for first: another daemon may be writing the pair, and writes the key first. A key that is alone here
        // belongs to a pair that is not yet whole.
        match (files.certificate.exists(), files.key.exists()) {
            (true, true) => Ok(Some(files)),
            (false, _) => Ok(None),
            (true, false) => Err(ListenError::Tls {
                file: files.key.display().to_string(),
                reason: format!(
                    "the key is missing, but the certificate {} exists: move the certificate to another folder and \
                     start the daemon again. The daemon then makes a new certificate and a new key",
                    files.certificate.display()
                ),
            }),
        }
    }
}

impl Listener {
    /// Listens on an address; anything but loopback only with TLS and where tokens are asked for.
    ///
    /// # Errors
    /// [`ListenError`].
    pub async fn bind_tcp(address: SocketAddr, tls: Option<&TlsFiles>, has_tokens: bool) -> Result<Self, ListenError> {
        Self::from_bound_port(Self::bind_port(address, tls.is_some(), has_tokens).await?, tls)
    }

    /// Whether an address may be listened on so.
    ///
    /// # Errors
    /// [`ListenError::Open`].
    pub fn check_address_allowed(address: SocketAddr, has_tls: bool, has_tokens: bool) -> Result<(), ListenError> {
        if address.ip().is_loopback() || (has_tls && has_tokens) { Ok(()) } else { Err(ListenError::Open { address }) }
    }

    /// Ports at all addresses of a place, one at least, before any file has to be there; on which nobody is let in yet. Where any port
    /// that is free was asked for, all have the first one's.
    ///
    /// # Errors
    /// [`ListenError`]. Of a name, an address that this machine does not have is no error as long as it has another.
    pub async fn bind_ports_of_all_addresses(
        place: &HostPort,
        has_tls: bool,
        has_tokens: bool,
    ) -> Result<Vec<TcpListener>, ListenError> {
        let named = |source| ListenError::Name { place: place.to_string(), source };
        let addresses = place.find_addresses().map_err(named)?;
        for address in &addresses {
            Self::check_address_allowed(*address, has_tls, has_tokens)?;
        }
        let (mut ports, mut missing) = (Vec::<TcpListener>::new(), None);
        for mut address in addresses {
            if let Some(first) = ports.first().filter(|_| address.port() == 0) {
                address.set_port(first.local_addr().map_err(|source| ListenError::Port { address, source })?.port());
            }
            match Self::bind_port(address, has_tls, has_tokens).await {
                Ok(port) => ports.push(port),
                Err(ListenError::Port { address, source })
                    if place.address().is_none()
                        && !matches!(source.kind(), io::ErrorKind::AddrInUse | io::ErrorKind::PermissionDenied) =>
                {
                    missing = Some(ListenError::Port { address, source });
                }
                Err(error) => return Err(error),
            }
        }
        match missing {
            Some(error) if ports.is_empty() => Err(error),
            _ => Ok(ports),
        }
    }

    /// The port of [`Self::bind_tcp`].
    ///
    /// # Errors
    /// [`ListenError`].
    pub async fn bind_port(address: SocketAddr, has_tls: bool, has_tokens: bool) -> Result<TcpListener, ListenError> {
        Self::check_address_allowed(address, has_tls, has_tokens)?;
        TcpListener::bind(address).await.map_err(|source| ListenError::Port { address, source })
    }

    /// Over a port.
    ///
    /// # Errors
    /// [`ListenError::Tls`].
    pub fn from_bound_port(port: TcpListener, tls: Option<&TlsFiles>) -> Result<Self, ListenError> {
        Ok(match tls.map(build_tls_acceptor).transpose()? {
            Some(acceptor) => Self::Tls(port, acceptor),
            None => Self::Tcp(port),
        })
    }

    /// Listens on a socket in the file system that only its owner may open. One that a daemon left behind is removed.
    ///
    /// # Errors
    /// [`ListenError`].
    #[cfg(unix)]
    pub fn bind_unix(path: &Path) -> Result<Self, ListenError> {
        use std::os::unix::fs::PermissionsExt;
        let named = || path.display().to_string();
        let failed = |source| ListenError::Socket { path: named(), source };
        // A socket may be moved to a longer path than any that a client can name.
        std::os::unix::net::SocketAddr::from_pathname(path).map_err(failed)?;
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            make_private_folder(folder).map_err(failed)?;
        }
        match std::os::unix::net::UnixStream::connect(path) {
            Ok(_) => return Err(ListenError::Taken { path: named() }),
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused && is_socket(path) => {
                std::fs::remove_file(path).map_err(failed)?;
            }
            // There is none, or something that is no socket: binding says so.
            Err(_) => {}
        }
        // Bound in a folder that nobody else may enter, whatever the umask is, and moved once nobody else may open it.
        let hidden = temporary_socket_path(path);
        let folder = hidden.parent().unwrap_or(path);
        // What a killed daemon that had this number has left.
        let _ = std::fs::remove_file(&hidden);
        let _ = std::fs::remove_dir(folder);
        std::os::unix::fs::DirBuilderExt::mode(&mut std::fs::DirBuilder::new(), 0o700)
            .create(folder)
            .map_err(failed)?;
        let bound = tokio::net::UnixListener::bind(&hidden).and_then(|listener| {
            std::fs::set_permissions(&hidden, std::fs::Permissions::from_mode(0o600))?;
            if path.exists() {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            std::fs::rename(&hidden, path).map(|()| listener)
        });
        let _ = std::fs::remove_file(&hidden);
        let _ = std::fs::remove_dir(folder);
        Ok(Self::Unix(UnixPlace { listener: bound.map_err(failed)?, path: path.to_owned() }))
    }

    /// Whether a socket can be made there, as far as that can be told without making it.
    ///
    /// # Errors
    /// [`ListenError::Socket`]: the path is too long, or something else is there.
    #[cfg(unix)]
    pub fn check_unix_path(path: &Path) -> Result<(), ListenError> {
        let failed = |source| ListenError::Socket { path: path.display().to_string(), source };
        for longest in [path, temporary_socket_path(path).as_path()] {
            std::os::unix::net::SocketAddr::from_pathname(longest).map_err(failed)?;
        }
        if path.exists() && !is_socket(path) { Err(failed(io::ErrorKind::AlreadyExists.into())) } else { Ok(()) }
    }

    /// Where it is, for people and `--url`.
    #[must_use]
    pub fn url(&self) -> String {
        let at = |listener: &TcpListener| {
            listener.local_addr().map_or_else(|error| error.to_string(), |address| address.to_string())
        };
        match self {
            Self::Tcp(listener) => format!("http://{}", at(listener)),
            Self::Tls(listener, _) => format!("https://{}", at(listener)),
            #[cfg(unix)]
            Self::Unix(place) => format!("unix:{}", place.path.display()),
        }
    }

    /// The next connection.
    ///
    /// # Errors
    /// As the system has it; the next try may go well.
    pub async fn accept(&self) -> io::Result<Incoming> {
        let quick = |stream: TcpStream| {
            // An answer is one write, and a touch waits for nothing that could fill a segment.
            let _ = stream.set_nodelay(true);
            stream
        };
        Ok(match self {
            Self::Tcp(listener) => Incoming::Tcp(quick(listener.accept().await?.0)),
            Self::Tls(listener, acceptor) => Incoming::Tls(quick(listener.accept().await?.0), acceptor.clone()),
            #[cfg(unix)]
            Self::Unix(place) => Incoming::Unix(place.listener.accept().await?.0),
        })
    }
}

/// A connection that has come in.
pub enum Incoming {
    /// Plain.
    Tcp(TcpStream),
    /// Before its handshake.
    Tls(TcpStream, TlsAcceptor),
    /// From this machine's file system.
    #[cfg(unix)]
    Unix(tokio::net::UnixStream),
}

/// What a socket is called until nobody else may open it.
#[cfg(unix)]
fn temporary_socket_path(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{}", std::process::id())).join("s")
}

#[cfg(unix)]
fn is_socket(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    std::fs::symlink_metadata(path).is_ok_and(|known| known.file_type().is_socket())
}

fn build_tls_acceptor(files: &TlsFiles) -> Result<TlsAcceptor, ListenError> {
    let wrong = |file: &Path, reason: String| ListenError::Tls { file: file.display().to_string(), reason };
    let certificates = read_certificates(&files.certificate).map_err(|reason| wrong(&files.certificate, reason))?;
    let key = read_private_key(&files.key).map_err(|reason| wrong(&files.key, reason))?;
    any_supported_type(&key).map_err(|error| {
        let reason = "the key is damaged, or its type is not supported: the supported types are RSA with 2048 to 8192 bits, ECDSA \
                      on P-256 or P-384, and Ed25519";
        wrong(&files.key, format!("{reason} ({error})"))
    })?;
    let config = ServerConfig::builder().with_no_client_auth().with_single_cert(certificates, key);
    let mut config = config.map_err(|error| match error {
        rustls::Error::InconsistentKeys(_) => {
            let certificate = files.certificate.display();
            wrong(
                &files.key,
                format!(
                    "the key does not belong to the certificate in {certificate} (if this file has several \
                     certificates, the key must belong to the first one)"
                ),
            )
        }
        error => wrong(&files.certificate, error.to_string()),
    })?;
    // Tickets to resume a session come when a client has begun to send. Python's `websockets` then reads and writes in two threads, whose TLS
    // session may stop for ever: 2 of 400 connections here, 3 of 1200 to a server of its own, and none of 800 with TLS 1.2.
    config.send_tls13_tickets = 0;
    Ok(TlsAcceptor::from(Arc::new(config)))
}

/// Those of `names` by which a certificate does not let the daemon be called: clients look for theirs in it. None where it cannot
/// be read, which listening says.
#[must_use]
pub fn list_names_missing_in_certificate<'n>(files: &TlsFiles, names: &'n [String]) -> Vec<&'n str> {
    let Ok(certificates) = read_certificates(&files.certificate) else { return Vec::new() };
    let Some(Ok(parsed)) = certificates.first().map(ParsedCertificate::try_from) else { return Vec::new() };
    let is_lacking = |name: &&str| {
        ServerName::try_from(*name).is_ok_and(|name| rustls::client::verify_server_name(&parsed, &name).is_err())
    };
    names.iter().map(String::as_str).filter(is_lacking).collect()
}

/// A certificate and its key in a folder: those that are there, or new ones for these names and this machine's loopback. Clients
/// trust the certificate itself; nobody else vouches for it. So one that is there stays, though it may lack a name (see
/// [`list_names_missing_in_certificate`]): another one would shut out every client that has been given it. What was left half-written is replaced.
///
/// # Errors
/// [`ListenError`].
pub fn find_or_make_certificate(folder: &Path, names_for_new_certificate: &[String]) -> Result<TlsFiles, ListenError> {
    if let Some(files) = TlsFiles::find_whole_pair_in_folder_or_error_if_only_key_missing(folder)? {
        return Ok(files);
    }
    let files = TlsFiles::default_paths_in_folder(folder);
    let wrong =
        |reason: &dyn fmt::Display| ListenError::Tls { file: folder.display().to_string(), reason: reason.to_string() };
    let unwritten = |file: &Path| {
        let file = file.display().to_string();
        move |source| ListenError::Unwritten { file, source }
    };
    make_private_folder(folder).map_err(unwritten(folder))?;
    // Daemons that are started at the same time would each write a key beside the certificate of another.
    let _alone = damaged_certificate::lock_folder_exclusively_waiting_up_to_limit(folder).map_err(unwritten(folder))?;
    if let Some(files) = TlsFiles::find_whole_pair_in_folder_or_error_if_only_key_missing(folder)? {
        return Ok(files);
    }
    let mut all: Vec<String> = ["localhost", "127.0.0.1", "::1"].map(String::from).to_vec();
    all.extend(names_for_new_certificate.iter().cloned());
    let made = rcgen::generate_simple_self_signed(all).map_err(|error| wrong(&error))?;
    if let Some((damaged, reason)) =
        damaged_certificate::find_damaged_file_and_describe_damage(&files.certificate, &files.key)
    {
        damaged_certificate::rename_damaged_files([&files.certificate, &files.key]).map_err(unwritten(folder))?;
        tracing::warn!(
            "{} {reason}, probably because a write was interrupted. The daemon added .damaged to the name of the old \
             certificate file and to the name of the old key file (if they existed), and now makes a new certificate \
             and a new key. Clients need the new certificate",
            damaged.display()
        );
    }
    // The certificate last: one that is there whole has its key.
    replace_file(&files.key, Readers::Owner, made.signing_key.serialize_pem().as_bytes())
        .map_err(unwritten(&files.key))?;
    if let Err(source) = replace_file(&files.certificate, Readers::Everybody, made.cert.pem().as_bytes()) {
        let _ = std::fs::remove_file(&files.key);
        return Err(unwritten(&files.certificate)(source));
    }
    tracing::info!(
        "the daemon has made the certificate {}: make the clients on other machines trust this certificate",
        files.certificate.display()
    );
    Ok(files)
}

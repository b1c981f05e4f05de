//! What is left of a certificate and its key whose writing was cut off: by a full disk, a kill, a power loss.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest wait for another daemon that writes its certificate in the same folder: that takes some milliseconds.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Has a folder for this process alone until what is returned is dropped. Other programs are not kept out.
pub(super) fn lock_folder_exclusively_waiting_up_to_limit(folder: &Path) -> io::Result<File> {
    let (opened, begun) = (File::open(folder)?, Instant::now());
    loop {
        match opened.try_lock() {
            Ok(()) => return Ok(opened),
            Err(TryLockError::WouldBlock) if begun.elapsed() < LONGEST_WAIT => {
                std::thread::sleep(Duration::from_millis(10));
            }
            Err(TryLockError::WouldBlock) => {
                let reason = format!("another process has locked the folder for more than {LONGEST_WAIT:?}");
                return Err(io::Error::new(io::ErrorKind::WouldBlock, reason));
            }
            // A file system without locks: there the second of two daemons may be late.
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => return Ok(opened),
            Err(TryLockError::Error(error)) => return Err(error),
        }
    }
}

/// Which of the two files in a folder for certificates that the daemon makes is damaged, and how; `None` where both or none are there and whole, and where only a whole certificate is there: clients may
/// have been given that. The key is written before the certificate, so that one without a certificate has never been used.
pub(super) fn find_damaged_file_and_describe_damage(certificate: &Path, key: &Path) -> Option<(PathBuf, &'static str)> {
    let (text, secret) = (std::fs::read(certificate).ok(), std::fs::read(key).ok());
    if text.as_ref().is_some_and(|text| is_pem_cut_off(text)) {
        return Some((certificate.to_owned(), "does not contain a complete certificate"));
    }
    if secret.as_ref().is_some_and(|secret| is_pem_cut_off(secret)) {
        return Some((key.to_owned(), "does not contain a complete key"));
    }
    (secret.is_some() && !certificate.exists()).then(|| (key.to_owned(), "has no certificate in the same folder"))
}

/// Gives damaged files other names, with `.damaged` at their end, so that their places are free and nothing is lost.
pub(super) fn rename_damaged_files(files: [&Path; 2]) -> io::Result<()> {
    for path in files {
        let mut name = path.as_os_str().to_owned();
        name.push(".damaged");
        match std::fs::rename(path, name) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// Whether a file in PEM has no end, or holes where its bytes never came onto the disk. Whatever else may be wrong with it is a mistake that somebody made, and is told when it is read.
fn is_pem_cut_off(bytes: &[u8]) -> bool {
    const BEGIN: &[u8] = b"-----BEGIN ";
    const END: &[u8] = b"-----END ";
    let last = |words: &[u8]| bytes.windows(words.len()).rposition(|window| window == words);
    match (last(BEGIN), last(END)) {
        _ if bytes.trim_ascii().is_empty() || bytes.iter().all(|byte| *byte == 0) => true,
        (None, _) => BEGIN.starts_with(bytes),
        (Some(begin), Some(end)) if begin < end => {
            !bytes[end + END.len()..].windows(5).any(|window| window == b"-----") || bytes[begin..].contains(&0)
        }
        (Some(_), _) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "-----BEGIN PRIVATE KEY-----\nMC4C\n-----END PRIVATE KEY-----\n";

    #[test]
    fn every_beginning_of_a_key_is_cut_off() {
        let ends = WHOLE.trim_end().len();
        for length in 0..=WHOLE.len() {
            assert_eq!(is_pem_cut_off(&WHOLE.as_bytes()[..length]), length < ends, "{length}");
        }
        let chain = [WHOLE, WHOLE].concat();
        assert!(!is_pem_cut_off(chain.as_bytes()) && is_pem_cut_off(&chain.as_bytes()[..WHOLE.len() + 30]));
        assert!(is_pem_cut_off(&[0; 200]) && is_pem_cut_off(WHOLE.replace("MC4C", "\0\0\0\0").as_bytes()));
    }

    /// What somebody has put there, though it may be of no use, is not taken for the daemon's own.
    #[test]
    fn what_is_another_mistake_is_not_cut_off() {
        let marked = format!("\u{feff}{WHOLE}");
        let encrypted = WHOLE.replace("PRIVATE", "ENCRYPTED PRIVATE");
        for bytes in [marked.as_bytes(), encrypted.as_bytes(), b"0\x82\x01\x00\x00", b"some notes"] {
            assert!(!is_pem_cut_off(bytes), "{}", String::from_utf8_lossy(bytes));
        }
    }
}

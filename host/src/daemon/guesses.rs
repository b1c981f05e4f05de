//! Wrong tokens, counted by the address that they came from: nobody may try one after the other.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// What is kept of a token: nobody can read it back from that.
pub type Digest = [u8; 32];

/// Different wrong tokens that an address may send within [`WINDOW`]. Mistyped ones are two or three.
pub const MOST: usize = 10;
/// From an address's first wrong token on.
pub const WINDOW: Duration = Duration::from_secs(60);
/// Addresses that are counted at a time, some 400 bytes each. Where there are more, those that began first are forgotten: they
/// have the least to wait for.
const ADDRESSES: usize = 1024;

/// Wrong tokens of late.
#[derive(Debug, Default)]
pub struct Guesses {
    of: Mutex<HashMap<IpAddr, Tries>>,
}

/// Of one address.
#[derive(Clone, Debug)]
struct Tries {
    since: Instant,
    /// Different ones: a page that was left open tries the same one again and again, and guesses nothing.
    wrong: Vec<Digest>,
}

impl Guesses {
    /// For how long an address has to wait before its tokens are looked at again; `wrong` is one that it has just sent.
    pub fn wait(&self, address: IpAddr, wrong: Option<Digest>, now: Instant) -> Option<Duration> {
        let mut of = self.of.lock().unwrap_or_else(PoisonError::into_inner);
        let address = network_of(address);
        if of.get(&address).is_some_and(|tries| now.saturating_duration_since(tries.since) >= WINDOW) {
            of.remove(&address);
        }
        if let Some(tries) = of.get(&address).filter(|tries| tries.wrong.len() >= MOST) {
            return Some(WINDOW.saturating_sub(now.saturating_duration_since(tries.since)));
        }
        let wrong = wrong?;
        if of.len() >= ADDRESSES && !of.contains_key(&address) {
            of.retain(|_, tries| now.saturating_duration_since(tries.since) < WINDOW);
            let first = of.iter().min_by_key(|(_, tries)| tries.since).map(|(address, _)| *address);
            if let Some(first) = first.filter(|_| of.len() >= ADDRESSES) {
                of.remove(&first);
            }
        }
        let tries = of.entry(address).or_insert_with(|| Tries { since: now, wrong: Vec::new() });
        if !tries.wrong.contains(&wrong) {
            tries.wrong.push(wrong);
            if tries.wrong.len() == MOST {
                tracing::warn!(%address, "{MOST} different wrong tokens within a minute: no more are looked at for now");
            }
        }
        None
    }
}

/// What counts as one machine: of IPv6 the network of 64 bits, as every machine has all of its addresses.
pub fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) if !v6.is_loopback() => Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64).into(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(number: usize) -> Digest {
        let mut digest = [0; 32];
        digest[..8].copy_from_slice(&number.to_le_bytes());
        digest
    }

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn many_different_wrong_tokens_shut_one_address_out_for_a_while() {
        let (guesses, start) = (Guesses::default(), Instant::now());
        let (here, there) = (address("192.0.2.1"), address("192.0.2.2"));
        for number in 0..MOST {
            // The same one again is no other guess; after the last one there is no other.
            for _ in 0..if number + 1 < MOST { 20 } else { 1 } {
                assert_eq!(guesses.wait(here, Some(digest(number)), start), None, "{number}");
            }
        }
        let later = start + Duration::from_secs(20);
        for wrong in [None, Some(digest(0)), Some(digest(999))] {
            assert_eq!(guesses.wait(here, wrong, later), Some(Duration::from_secs(40)));
        }
        assert_eq!(guesses.wait(there, None, later), None);
        assert_eq!(guesses.wait(here, None, start + WINDOW), None);
        // From then on it is counted anew.
        assert_eq!(guesses.wait(here, Some(digest(999)), start + WINDOW), None);
    }

    #[test]
    fn all_addresses_of_a_machine_count_together() {
        let (guesses, now) = (Guesses::default(), Instant::now());
        for number in 0..MOST {
            let from = address(&format!("2001:db8:1:2::{number:x}"));
            assert_eq!(guesses.wait(from, Some(digest(number)), now), None);
        }
        assert!(guesses.wait(address("2001:db8:1:2:ffff::1"), None, now).is_some());
        assert!(guesses.wait(address("2001:db8:1:3::1"), None, now).is_none());
        // An IPv4 address is the same one in either way to write it.
        for number in 0..MOST {
            guesses.wait(address("::ffff:192.0.2.7"), Some(digest(number)), now);
        }
        assert!(guesses.wait(address("192.0.2.7"), None, now).is_some());
        assert!(guesses.wait(address("::1"), None, now).is_none());
    }

    #[test]
    fn many_addresses_take_no_more_memory_than_there_is_for_them() {
        let (guesses, start) = (Guesses::default(), Instant::now());
        for number in 0..3 * ADDRESSES {
            let from = IpAddr::from(std::net::Ipv4Addr::from_bits(u32::try_from(number).unwrap()));
            let now = start + Duration::from_micros(u64::try_from(number).unwrap());
            guesses.wait(from, Some(digest(number)), now);
            assert!(guesses.of.lock().unwrap().len() <= ADDRESSES);
        }
        let kept = guesses.of.lock().unwrap();
        assert!(kept.contains_key(&address("0.0.11.255")) && !kept.contains_key(&address("0.0.0.1")));
    }
}

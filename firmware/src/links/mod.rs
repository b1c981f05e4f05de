//! The links to the host. Both carry the same frames as plain bytes, so all that differs is how bytes come in and go
//! out ([`ByteSource`], [`ByteSink`]); what they mean is known to the device task alone.

pub mod uart;
pub mod usb;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::pipe::Pipe;
use embassy_time::{Duration, with_timeout};
use era_shared::link::{LinkArrival, MAX_ENCODED, MAX_PACKET};

/// Index of the UART in [`LINKS`].
pub const UART: usize = 0;
/// Index of USB in [`LINKS`].
pub const USB: usize = 1;

/// How long a host may keep an answer from going out before it is thrown away. A host that reads takes it within a few
/// ms; one that does not has given up on it.
const WRITE_TIMEOUT: Duration = Duration::from_millis(100);

/// From all links to the device.
pub static INBOX: Channel<CriticalSectionRawMutex, (usize, LinkArrival), 4> = Channel::new();

/// From the device to each link.
pub static LINKS: [Outbox; 2] = [Outbox::new(), Outbox::new()];

/// Answers on their way to one link.
pub struct Outbox {
    // Room for two answers of full length.
    pipe: Pipe<CriticalSectionRawMutex, { 2 * MAX_ENCODED }>,
}

impl Outbox {
    const fn new() -> Self {
        Self { pipe: Pipe::new() }
    }

    /// Queues an answer for this link, or drops all of it if there is no room: the host then asks again.
    pub fn queue_answer_or_drop_if_full(&self, answer: &[u8]) {
        // Only the device task writes, so the room cannot shrink after this test.
        if self.pipe.free_capacity() < answer.len() {
            defmt::warn!("an answer of {} bytes was dropped, because the host does not read the link", answer.len());
            return;
        }
        let mut rest = answer;
        // The pipe is a ring and takes a piece only up to its end, so an answer may need two.
        while let Ok(count) = self.pipe.try_write(rest) {
            rest = rest.get(count..).unwrap_or(&[]);
            if rest.is_empty() {
                return;
            }
        }
    }
}

/// Where bytes come from.
pub trait ByteSource {
    /// Waits for bytes and returns how many have come; `Err` when the host has closed the link.
    async fn read_bytes(&mut self, buffer: &mut [u8; MAX_PACKET]) -> Result<usize, Closed>;
    /// Waits until the host has opened the link.
    async fn await_link_opened_by_host(&mut self);
}

/// Where bytes go.
pub trait ByteSink {
    /// Sends all of `bytes`, so that the host sees them without waiting for more.
    async fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), Closed>;
}

/// The other end has gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Closed;

/// Forwards the bytes that a link receives to the device, for ever.
pub async fn forward_link_openings_and_bytes_to_device(link: usize, mut source: impl ByteSource) -> ! {
    let mut buffer = [0_u8; MAX_PACKET];
    loop {
        source.await_link_opened_by_host().await;
        INBOX.send((link, LinkArrival::Reopened)).await;
        while let Ok(count) = source.read_bytes(&mut buffer).await {
            let bytes = buffer.iter().take(count).copied().collect();
            INBOX.send((link, LinkArrival::Bytes(bytes))).await;
        }
    }
}

/// Sends the answers that are queued for a link, for ever.
pub async fn send_queued_answers_or_drop_if_host_does_not_read(link: usize, mut sink: impl ByteSink) -> ! {
    let mut buffer = [0_u8; MAX_ENCODED];
    let outbox = &LINKS[link];
    loop {
        let count = outbox.pipe.read(&mut buffer).await;
        let Some(bytes) = buffer.get(..count) else { continue };
        match with_timeout(WRITE_TIMEOUT, sink.send_bytes(bytes)).await {
            Ok(Ok(())) => {}
            Ok(Err(Closed)) | Err(_) => {
                // What is left of a broken-off answer would only confuse whoever opens the link next.
                outbox.pipe.clear();
                defmt::warn!(
                    "link {} (0: UART, 1: USB): an answer was dropped, because the host did not read it within 100 ms \
                     or closed the link",
                    link
                );
            }
        }
    }
}

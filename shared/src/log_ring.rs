//! A ring of log frames. The firmware writes them; the link, or a debug probe, reads them.
//!
//! The layout is that of an up-channel of SEGGER's RTT, whose reader moves `read` and whose writer moves `write`; `read ==
//! write` means empty. A frame is stored whole or not at all. Where there is no room, the oldest frames are given up: the
//! last thing that a board says is worth more than the first.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};

/// What ends a frame; no frame holds it anywhere else (defmt's rzCOBS, as COBS).
const END: u8 = 0;

/// A view of the ring. Only one may write or take at a time; a probe may move `read` at any time.
#[derive(Clone, Copy, Debug)]
pub struct LogRing<'a> {
    /// The memory.
    pub bytes: &'a [AtomicU8],
    /// Index of the first byte not yet read.
    pub read: &'a AtomicU32,
    /// Index behind the last byte written.
    pub write: &'a AtomicU32,
}

impl LogRing<'_> {
    /// Stores a frame, which includes its end byte. Returns how many frames were lost: older ones that made room, or this one
    /// if it is longer than the whole ring.
    pub fn push_frame_dropping_oldest_and_count_lost_by_it(&self, frame: &[u8]) -> u32 {
        // One byte stays free, as a full ring would look empty.
        if frame.is_empty() || frame.len() >= self.bytes.len() {
            return 1;
        }
        let mut lost = 0;
        while self.count_free_bytes() < frame.len() {
            self.drop_oldest_frame();
            lost += 1;
        }
        let mut write = self.load_index_or_zero_if_outside_ring(self.write);
        for byte in frame {
            if let Some(place) = self.bytes.get(write) {
                place.store(*byte, Relaxed);
            }
            write = self.next_index(write);
        }
        self.write.store(write as u32, Relaxed);
        lost
    }

    /// Moves the oldest bytes to `buffer`, as many as there are and fit; returns how many.
    pub fn take_bytes(&self, buffer: &mut [u8]) -> usize {
        let write = self.load_index_or_zero_if_outside_ring(self.write);
        let mut read = self.load_index_or_zero_if_outside_ring(self.read);
        let mut count = 0;
        for place in buffer {
            if read == write {
                break;
            }
            *place = self.bytes.get(read).map_or(END, |byte| byte.load(Relaxed));
            read = self.next_index(read);
            count += 1;
        }
        self.read.store(read as u32, Relaxed);
        count
    }

    fn drop_oldest_frame(&self) {
        let write = self.load_index_or_zero_if_outside_ring(self.write);
        let mut read = self.load_index_or_zero_if_outside_ring(self.read);
        while read != write {
            let byte = self.bytes.get(read).map_or(END, |byte| byte.load(Relaxed));
            read = self.next_index(read);
            if byte == END {
                break;
            }
        }
        self.read.store(read as u32, Relaxed);
    }

    fn count_free_bytes(&self) -> usize {
        let (read, write, size) = (
            self.load_index_or_zero_if_outside_ring(self.read),
            self.load_index_or_zero_if_outside_ring(self.write),
            self.bytes.len(),
        );
        (read + size - write - 1) % size
    }

    const fn next_index(&self, index: usize) -> usize {
        if index + 1 < self.bytes.len() { index + 1 } else { 0 }
    }

    /// Reads an index. A probe may write anything: an index outside the ring counts as its start.
    fn load_index_or_zero_if_outside_ring(&self, position: &AtomicU32) -> usize {
        let index = position.load(Relaxed) as usize;
        if index < self.bytes.len() { index } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;
    use std::vec::Vec;

    struct Memory {
        bytes: Vec<AtomicU8>,
        read: AtomicU32,
        write: AtomicU32,
    }

    impl Memory {
        fn new(size: usize) -> Self {
            let bytes = (0..size).map(|_| AtomicU8::new(0xEE)).collect();
            Self { bytes, read: AtomicU32::new(0), write: AtomicU32::new(0) }
        }

        fn ring(&self) -> LogRing<'_> {
            LogRing { bytes: &self.bytes, read: &self.read, write: &self.write }
        }
    }

    fn frame(length: usize, fill: u8) -> Vec<u8> {
        let mut frame = std::vec![fill.max(1); length];
        frame.push(END);
        frame
    }

    proptest! {
        /// Against a queue of whole frames: nothing is lost but the oldest, nothing is torn.
        #[test]
        fn it_keeps_the_newest_frames_whole(steps in prop::collection::vec((1_usize..20, any::<u8>(), any::<bool>()), 0..80)) {
            let memory = Memory::new(64);
            let ring = memory.ring();
            let mut expected: VecDeque<Vec<u8>> = VecDeque::new();
            for (length, fill, drain) in steps {
                let frame = frame(length, fill);
                let mut lost = 0;
                while expected.iter().map(Vec::len).sum::<usize>() + frame.len() > 63 {
                    expected.pop_front();
                    lost += 1;
                }
                prop_assert_eq!(ring.push_frame_dropping_oldest_and_count_lost_by_it(&frame), lost);
                expected.push_back(frame);
                if drain {
                    let mut buffer = [0; 64];
                    let count = ring.take_bytes(&mut buffer);
                    let all: Vec<u8> = expected.drain(..).flatten().collect();
                    prop_assert_eq!(&buffer[..count], &all[..]);
                }
            }
        }

        /// Whatever a probe writes into the indices, nothing goes wrong but the text.
        #[test]
        fn indices_from_outside_do_no_harm(read in any::<u32>(), write in any::<u32>(), length in 0_usize..80) {
            let memory = Memory::new(64);
            memory.read.store(read, Relaxed);
            memory.write.store(write, Relaxed);
            memory.ring().push_frame_dropping_oldest_and_count_lost_by_it(&frame(length, 7));
            let mut buffer = [0; 16];
            prop_assert!(memory.ring().take_bytes(&mut buffer) <= 16);
        }
    }

    #[test]
    fn it_is_taken_in_pieces() {
        let memory = Memory::new(16);
        let mut buffer = [0; 4];
        assert_eq!(memory.ring().take_bytes(&mut buffer), 0);
        assert_eq!(memory.ring().push_frame_dropping_oldest_and_count_lost_by_it(&frame(6, 3)), 0);
        assert_eq!(memory.ring().take_bytes(&mut buffer), 4);
        assert_eq!(memory.ring().take_bytes(&mut buffer), 3);
        assert_eq!(buffer[..3], [3, 3, END]);
        assert_eq!(memory.ring().take_bytes(&mut buffer), 0);
        assert_eq!(
            memory.ring().push_frame_dropping_oldest_and_count_lost_by_it(&frame(15, 3)),
            1,
            "longer than the ring can hold"
        );
    }
}

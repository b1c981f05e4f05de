//! The script that a device is put through, and its bytes, which are what the engine changes.

/// Links that a script can use.
pub const LINKS: usize = 2;

/// One step of a script.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A well-formed frame of the current version with this postcard body, a request as far as the script means it.
    Request {
        /// Below [`LINKS`].
        link: usize,
        /// At most 255 bytes.
        body: Vec<u8>,
    },
    /// A well-formed frame of any version and kind.
    Frame {
        /// Below [`LINKS`].
        link: usize,
        /// Protocol version.
        version: u8,
        /// Kind of the frame.
        kind: u8,
        /// At most 255 bytes.
        body: Vec<u8>,
    },
    /// Bytes on the line, whatever they are.
    Bytes {
        /// Below [`LINKS`].
        link: usize,
        /// At most 255.
        bytes: Vec<u8>,
    },
    /// Time passes, with the device polled whenever it wants to be.
    Wait {
        /// At most 1.2 s: the longest dead-man time is 1 s, and steps can follow each other.
        ms: u16,
    },
    /// Time passes, and the device's task is late.
    Late {
        /// As in [`Step::Wait`].
        ms: u16,
    },
    /// The board finds a fault by itself.
    Fault {
        /// Position among the faults that a board can find ([`era_shared::protocol::FaultCode`]), counted round and round.
        code: u8,
        /// Goes with it.
        detail: u8,
    },
    /// From here on the hardware refuses what the bits say.
    Hardware {
        /// Bits of [`crate::board::refuses`].
        refuses: u8,
    },
    /// From here on something outside is as the bits say.
    Outside {
        /// Bits of [`crate::board::outside`].
        wrong: u8,
    },
    /// The hardware switches off by itself: a comparator, the voltage detector.
    Trip {
        /// As in [`Step::Fault`].
        code: u8,
    },
    /// A link is closed and opened again.
    Reopen {
        /// Below [`LINKS`].
        link: usize,
    },
}

/// Longest time in one step, in ms.
const LONGEST_MS: u16 = 1_200;
/// Kinds of steps.
const KINDS: u8 = 10;

impl Step {
    /// The steps in `bytes`, up to where one is incomplete. Every input is a script, so that the engine wastes none.
    #[must_use]
    pub fn decode_script(mut bytes: &[u8]) -> Vec<Step> {
        std::iter::from_fn(|| Step::take_step(&mut bytes)).collect()
    }

    fn take_step(rest: &mut &[u8]) -> Option<Step> {
        let kind = take_byte(rest)? % KINDS;
        Some(match kind {
            0 => Step::Request { link: take_link_index(rest)?, body: take_block(rest)? },
            1 => Step::Frame {
                link: take_link_index(rest)?,
                version: take_byte(rest)?,
                kind: take_byte(rest)?,
                body: take_block(rest)?,
            },
            2 => Step::Bytes { link: take_link_index(rest)?, bytes: take_block(rest)? },
            3 => Step::Wait { ms: take_time_ms(rest)? },
            4 => Step::Late { ms: take_time_ms(rest)? },
            5 => Step::Fault { code: take_byte(rest)?, detail: take_byte(rest)? },
            6 => Step::Hardware { refuses: take_byte(rest)? },
            7 => Step::Reopen { link: take_link_index(rest)? },
            8 => Step::Outside { wrong: take_byte(rest)? },
            _ => Step::Trip { code: take_byte(rest)? },
        })
    }

    /// Appends the bytes that are read back as this step.
    pub fn append_encoded_step(&self, out: &mut Vec<u8>) {
        match self {
            Step::Request { link, body } => {
                out.extend([0, *link as u8]);
                append_block_cut_to_255_bytes(body, out);
            }
            Step::Frame { link, version, kind, body } => {
                out.extend([1, *link as u8, *version, *kind]);
                append_block_cut_to_255_bytes(body, out);
            }
            Step::Bytes { link, bytes } => {
                out.extend([2, *link as u8]);
                append_block_cut_to_255_bytes(bytes, out);
            }
            Step::Wait { ms } => out.extend([&[3], &ms.to_le_bytes()[..]].concat()),
            Step::Late { ms } => out.extend([&[4], &ms.to_le_bytes()[..]].concat()),
            Step::Fault { code, detail } => out.extend([5, *code, *detail]),
            Step::Hardware { refuses } => out.extend([6, *refuses]),
            Step::Reopen { link } => out.extend([7, *link as u8]),
            Step::Outside { wrong } => out.extend([8, *wrong]),
            Step::Trip { code } => out.extend([9, *code]),
        }
    }
}

fn take_byte(rest: &mut &[u8]) -> Option<u8> {
    rest.split_off_first().copied()
}

fn take_link_index(rest: &mut &[u8]) -> Option<usize> {
    Some(usize::from(take_byte(rest)?) % LINKS)
}

fn take_time_ms(rest: &mut &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes([take_byte(rest)?, take_byte(rest)?]) % (LONGEST_MS + 1))
}

fn take_block(rest: &mut &[u8]) -> Option<Vec<u8>> {
    let length = usize::from(take_byte(rest)?);
    rest.split_off(..length).map(<[u8]>::to_vec)
}

/// A block longer than its length byte can say is cut: seeds are short, and a test reads them back.
fn append_block_cut_to_255_bytes(bytes: &[u8], out: &mut Vec<u8>) {
    let length = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
    out.push(length);
    out.extend(bytes.iter().take(usize::from(length)));
}

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
    pub fn script(mut bytes: &[u8]) -> Vec<Step> {
        std::iter::from_fn(|| Step::read(&mut bytes)).collect()
    }

    fn read(rest: &mut &[u8]) -> Option<Step> {
        let kind = byte(rest)? % KINDS;
        Some(match kind {
            0 => Step::Request { link: link(rest)?, body: block(rest)? },
            1 => Step::Frame { link: link(rest)?, version: byte(rest)?, kind: byte(rest)?, body: block(rest)? },
            2 => Step::Bytes { link: link(rest)?, bytes: block(rest)? },
            3 => Step::Wait { ms: time(rest)? },
            4 => Step::Late { ms: time(rest)? },
            5 => Step::Fault { code: byte(rest)?, detail: byte(rest)? },
            6 => Step::Hardware { refuses: byte(rest)? },
            7 => Step::Reopen { link: link(rest)? },
            8 => Step::Outside { wrong: byte(rest)? },
            _ => Step::Trip { code: byte(rest)? },
        })
    }

    /// Appends the bytes that are read back as this step.
    pub fn write(&self, out: &mut Vec<u8>) {
        match self {
            Step::Request { link, body } => {
                out.extend([0, *link as u8]);
                write_block(body, out);
            }
            Step::Frame { link, version, kind, body } => {
                out.extend([1, *link as u8, *version, *kind]);
                write_block(body, out);
            }
            Step::Bytes { link, bytes } => {
                out.extend([2, *link as u8]);
                write_block(bytes, out);
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

fn byte(rest: &mut &[u8]) -> Option<u8> {
    rest.split_off_first().copied()
}

fn link(rest: &mut &[u8]) -> Option<usize> {
    Some(usize::from(byte(rest)?) % LINKS)
}

fn time(rest: &mut &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes([byte(rest)?, byte(rest)?]) % (LONGEST_MS + 1))
}

fn block(rest: &mut &[u8]) -> Option<Vec<u8>> {
    let length = usize::from(byte(rest)?);
    rest.split_off(..length).map(<[u8]>::to_vec)
}

/// A block longer than its length byte can say is cut: seeds are short, and a test reads them back.
fn write_block(bytes: &[u8], out: &mut Vec<u8>) {
    let length = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
    out.push(length);
    out.extend(bytes.iter().take(usize::from(length)));
}

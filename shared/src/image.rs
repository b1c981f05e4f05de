//! The header of a firmware image: what a program that writes it to a board must know about it.
//!
//! It lies at a fixed place behind the vector table ([`HEADER_OFFSET`]), so that it is found in an ELF file as well as in
//! what is read back from a board's flash. All numbers are little-endian.
//!
//! | offset | bytes | field |
//! | --- | --- | --- |
//! | 0 | 8 | magic, `ERAIMAGE` |
//! | 8 | 2 | format, 1 |
//! | 10 | 2 | length of the header, 64 |
//! | 12 | 2 | chip: DEV_ID of the STM32 (RM0440, section 47.6.1) |
//! | 14 | 1 | board kind, as on the wire |
//! | 15 | 3 | version: major, minor, patch |
//! | 18 | 2 | protocol: oldest, newest |
//! | 20 | 8 | commit, ASCII |
//! | 28 | 32 | name, ASCII, padded with zeros |
//! | 60 | 4 | address behind the image's last byte; from the linker |

use crate::protocol::{BoardKind, FirmwareVersion};

/// Address of the first byte of the flash.
pub const FLASH_START: u32 = 0x0800_0000;
/// Size of the flash in bytes.
pub const FLASH_SIZE: u32 = 512 * 1024;
/// Size of the first stage in bytes, at the start of the flash. A whole number of pages with either page size (4 KiB
/// single-bank, 2 KiB dual-bank; RM0440, section 3.3.1).
pub const FIRST_STAGE_SIZE: u32 = 4096;
/// Address of the firmware's vector table.
pub const IMAGE_START: u32 = FLASH_START + FIRST_STAGE_SIZE;
/// The header's offset from the vector table, behind its 118 entries.
pub const HEADER_OFFSET: u32 = 0x200;
/// The header's length in bytes.
pub const HEADER_LENGTH: usize = 64;
/// DEV_ID of the STM32G471, G473, G474, G483 and G484.
pub const CHIP_STM32G474: u16 = 0x469;

/// The header's first bytes.
pub const MAGIC: [u8; 8] = *b"ERAIMAGE";
/// The only format there is.
pub const FORMAT: u16 = 1;

/// Bytes of the header that the firmware contains; the linker adds the last field.
const BYTES_BEFORE_END: usize = 60;
const NAME_LENGTH: usize = 32;

/// What the header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// DEV_ID of the chip that the image runs on.
    pub chip: u16,
    /// Board that the image is for; `None` for a board that this program does not know.
    pub board: Option<BoardKind>,
    /// Version and commit.
    pub firmware: FirmwareVersion,
    /// Oldest protocol version that the firmware speaks.
    pub protocol_min: u8,
    /// Newest protocol version that the firmware speaks.
    pub protocol_current: u8,
    /// Name of the image, padded with zeros.
    pub name: [u8; NAME_LENGTH],
    /// Address behind the last byte that is loaded.
    pub end: u32,
}

/// Why there is no header where it should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaderError {
    /// Not 64 bytes, or without the magic.
    Missing,
    /// A format that this program does not know.
    Format(u16),
}

impl ImageHeader {
    /// Encodes all fields of the header but the last, [`ImageHeader::end`], which the linker adds.
    #[must_use]
    pub const fn encode_header_without_end_address(
        chip: u16,
        board: BoardKind,
        firmware: FirmwareVersion,
        protocol_range: (u8, u8),
        name: &str,
    ) -> [u8; BYTES_BEFORE_END] {
        let mut bytes = [0; BYTES_BEFORE_END];
        let version = [firmware.major, firmware.minor, firmware.patch];
        copy_to_offset(&mut bytes, 0, &MAGIC);
        copy_to_offset(&mut bytes, 8, &FORMAT.to_le_bytes());
        copy_to_offset(&mut bytes, 10, &(HEADER_LENGTH as u16).to_le_bytes());
        copy_to_offset(&mut bytes, 12, &chip.to_le_bytes());
        copy_to_offset(&mut bytes, 14, &[board as u8]);
        copy_to_offset(&mut bytes, 15, &version);
        copy_to_offset(&mut bytes, 18, &[protocol_range.0, protocol_range.1]);
        copy_to_offset(&mut bytes, 20, &firmware.commit);
        assert!(name.len() <= NAME_LENGTH);
        copy_to_offset(&mut bytes, 28, name.as_bytes());
        bytes
    }

    /// Decodes a header.
    ///
    /// # Errors
    /// [`HeaderError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, HeaderError> {
        let bytes: &[u8; HEADER_LENGTH] = bytes.try_into().map_err(|_| HeaderError::Missing)?;
        if !bytes.starts_with(&MAGIC) {
            return Err(HeaderError::Missing);
        }
        let half = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        if half(8) != FORMAT || usize::from(half(10)) != HEADER_LENGTH {
            return Err(HeaderError::Format(half(8)));
        }
        let mut commit = [0; 8];
        commit.copy_from_slice(&bytes[20..28]);
        let mut name = [0; NAME_LENGTH];
        name.copy_from_slice(&bytes[28..60]);
        let board = [BoardKind::Simulated, BoardKind::Stm32G474].into_iter().find(|kind| *kind as u8 == bytes[14]);
        Ok(Self {
            chip: half(12),
            board,
            firmware: FirmwareVersion { major: bytes[15], minor: bytes[16], patch: bytes[17], commit },
            protocol_min: bytes[18],
            protocol_current: bytes[19],
            name,
            end: u32::from_le_bytes([bytes[60], bytes[61], bytes[62], bytes[63]]),
        })
    }

    /// The name without its padding; empty if it is no text.
    #[must_use]
    pub fn name(&self) -> &str {
        let length = self.name.iter().position(|byte| *byte == 0).unwrap_or(NAME_LENGTH);
        self.name.get(..length).and_then(|name| core::str::from_utf8(name).ok()).unwrap_or("")
    }
}

const fn copy_to_offset(header: &mut [u8; BYTES_BEFORE_END], offset: usize, source: &[u8]) {
    let mut index = 0;
    while index < source.len() {
        header[offset + index] = source[index];
        index += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_in_comes_out() {
        let firmware = FirmwareVersion { major: 1, minor: 2, patch: 3, commit: *b"0123abcd" };
        let given = ImageHeader::encode_header_without_end_address(
            CHIP_STM32G474,
            BoardKind::Stm32G474,
            firmware,
            (1, 2),
            "some-image",
        );
        let mut bytes = [0; HEADER_LENGTH];
        bytes[..BYTES_BEFORE_END].copy_from_slice(&given);
        bytes[BYTES_BEFORE_END..].copy_from_slice(&0x0801_2344_u32.to_le_bytes());
        let header = ImageHeader::parse(&bytes).unwrap();
        assert_eq!(header.chip, 0x469);
        assert_eq!(header.board, Some(BoardKind::Stm32G474));
        assert_eq!(header.firmware, firmware);
        assert_eq!((header.protocol_min, header.protocol_current), (1, 2));
        assert_eq!(header.name(), "some-image");
        assert_eq!(header.end, 0x0801_2344);

        assert_eq!(ImageHeader::parse(&bytes[..63]), Err(HeaderError::Missing));
        assert_eq!(ImageHeader::parse(&[0xFF; HEADER_LENGTH]), Err(HeaderError::Missing));
        bytes[8] = 9;
        assert_eq!(ImageHeader::parse(&bytes), Err(HeaderError::Format(9)));
    }
}

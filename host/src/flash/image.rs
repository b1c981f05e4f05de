//! A firmware image as it goes into flash, taken from an ELF file and checked.

use era_shared::image::{
    CHIP_STM32G474, FIRST_STAGE_SIZE, FLASH_SIZE, FLASH_START, HEADER_LENGTH, HEADER_OFFSET, HeaderError, IMAGE_START,
    ImageHeader,
};
use object::LittleEndian;
use object::elf::{EM_ARM, FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The RAM (`memory.x`). A stack grows down from its end, so that the initial stack pointer may be there.
const RAM: Range<u32> = 0x2000_0000..0x2002_0000;
/// The flash is programmed in double words (RM0440, section 3.3.7).
const DOUBLE_WORD: usize = 8;
/// What an erased byte reads as.
pub const ERASED: u8 = 0xFF;

/// Where `cargo xtask firmware` puts the image, in the checkout that this program was built from; the variables
/// `ERA_FIRMWARE` (a file) and `ERA_SOURCE` (a checkout) name another.
#[must_use]
pub fn default_path() -> PathBuf {
    if let Some(file) = std::env::var_os("ERA_FIRMWARE") {
        return file.into();
    }
    let source = std::env::var_os("ERA_SOURCE")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/..")), PathBuf::from);
    source.join("firmware/target/thumbv7em-none-eabihf/release/era-firmware")
}

/// Why a file is no image for this board.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ImageError {
    /// It cannot be read.
    #[error("cannot read {path}: {reason}. Build the firmware with `cargo xtask firmware`, or name another file")]
    File {
        /// As named.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Not an ELF file of 32 bits, little-endian.
    #[error("this is not a 32-bit ELF file: {0}. Name the ELF file whose path `cargo xtask firmware` prints")]
    NotElf(String),
    /// For another processor.
    #[error(
        "this ELF file is for another processor (machine {machine}, entry {entry:#010x}), not for an ARM in Thumb mode (machine 40, odd entry)"
    )]
    Machine {
        /// The file's `e_machine`.
        machine: u16,
        /// The file's `e_entry`.
        entry: u32,
    },
    /// Something of it is to be loaded outside the flash.
    #[error("the image loads {length} bytes to {address:#010x}, outside the flash (512 KiB from {FLASH_START:#010x})")]
    OutsideFlash {
        /// Where to.
        address: u32,
        /// How many bytes.
        length: u32,
    },
    /// A vector table does not make sense.
    #[error("the vector table at {address:#010x} is not that of a firmware for this chip: initial stack pointer \
             {stack_pointer:#010x} (must be in RAM, {:#010x} to {:#010x}), reset vector {reset:#010x} (must be \
             odd, in flash)", RAM.start, RAM.end)]
    VectorTable {
        /// Where it is.
        address: u32,
        /// Its first word.
        stack_pointer: u32,
        /// Its second word.
        reset: u32,
    },
    /// The header is missing, or not known here.
    #[error("{}", match .0 {
        HeaderError::Missing => "there is no image header: this is not the firmware of an ERA board, or the firmware is too old".to_owned(),
        HeaderError::Format(format) => format!("the image header has the format {format}, but this program knows only format 1: update this program"),
    })]
    Header(HeaderError),
    /// For another chip.
    #[error(
        "the image is for the chip with the device ID {chip:#05x}, but this board has an STM32G474 ({CHIP_STM32G474:#05x})"
    )]
    Chip {
        /// As in the header.
        chip: u16,
    },
    /// Its end is not where its header says.
    #[error("the image ends at {end:#010x}, but the end in its header is {header_end:#010x}: the file is damaged")]
    Truncated {
        /// Behind the last byte found.
        end: u32,
        /// As in the header.
        header_end: u32,
    },
}

/// An image that has passed all checks which need no board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// What it says of itself.
    pub header: ImageHeader,
    /// Contents of the flash from its start, a whole number of double words; gaps are as erased.
    bytes: Vec<u8>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn read(path: &Path) -> Result<(Self, Vec<u8>), ImageError> {
        let elf = std::fs::read(path)
            .map_err(|error| ImageError::File { path: path.to_path_buf(), reason: error.to_string() })?;
        Ok((Self::from_elf(&elf)?, elf))
    }

    /// Takes the image out of an ELF file's contents.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn from_elf(elf: &[u8]) -> Result<Self, ImageError> {
        let not_elf = |error: object::read::Error| ImageError::NotElf(error.to_string());
        let header = FileHeader32::<LittleEndian>::parse(elf).map_err(not_elf)?;
        let endian = header.endian().map_err(not_elf)?;
        let (machine, entry) = (header.e_machine(endian), header.e_entry(endian));
        if machine != EM_ARM || entry % 2 == 0 {
            return Err(ImageError::Machine { machine, entry });
        }
        let mut bytes = Vec::new();
        for segment in header.program_headers(endian, elf).map_err(not_elf)? {
            let (address, length) = (segment.p_paddr(endian), segment.p_filesz(endian));
            if segment.p_type(endian) != PT_LOAD || length == 0 {
                continue;
            }
            let offset = address
                .checked_sub(FLASH_START)
                .filter(|offset| offset.checked_add(length).is_some_and(|end| end <= FLASH_SIZE));
            let offset = offset.ok_or(ImageError::OutsideFlash { address, length })? as usize;
            let data = segment
                .data(endian, elf)
                .map_err(|()| ImageError::NotElf("a segment reaches beyond the file's end".into()))?;
            let end = offset + data.len();
            if bytes.len() < end {
                bytes.resize(end, ERASED);
            }
            if let Some(place) = bytes.get_mut(offset..end) {
                place.copy_from_slice(data);
            }
        }
        Self::from_flash(bytes)
    }

    /// An image from the contents of the flash, from its first byte to the image's last.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn from_flash(mut bytes: Vec<u8>) -> Result<Self, ImageError> {
        let end = FLASH_START.saturating_add(u32::try_from(bytes.len()).unwrap_or(u32::MAX));
        for address in [FLASH_START, IMAGE_START] {
            check_vector_table(&bytes, address)?;
        }
        let header_at = (FIRST_STAGE_SIZE + HEADER_OFFSET) as usize;
        let header = bytes.get(header_at..header_at + HEADER_LENGTH).unwrap_or_default();
        let header = ImageHeader::parse(header).map_err(ImageError::Header)?;
        if header.chip != CHIP_STM32G474 {
            return Err(ImageError::Chip { chip: header.chip });
        }
        if header.end != end {
            return Err(ImageError::Truncated { end, header_end: header.end });
        }
        bytes.resize(bytes.len().next_multiple_of(DOUBLE_WORD), ERASED);
        Ok(Self { header, bytes })
    }

    /// Contents of the flash from [`FLASH_START`]: a whole number of double words.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// The two words that the processor starts from.
fn check_vector_table(bytes: &[u8], address: u32) -> Result<(), ImageError> {
    let word = |address: u32| {
        let at = (address - FLASH_START) as usize;
        bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).map_or(u32::MAX, u32::from_le_bytes)
    };
    let (stack_pointer, reset) = (word(address), word(address + 4));
    let stack_in_ram = stack_pointer > RAM.start && stack_pointer <= RAM.end && stack_pointer % 8 == 0;
    let reset_in_flash = reset % 2 == 1 && (FLASH_START..FLASH_START + FLASH_SIZE).contains(&reset);
    if stack_in_ram && reset_in_flash {
        return Ok(());
    }
    Err(ImageError::VectorTable { address, stack_pointer, reset })
}

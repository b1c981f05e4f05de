//! How much of the chip an image takes.

use crate::error::Error;
use object::LittleEndian;
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};
use std::fs;
use std::ops::Range;
use std::path::Path;

/// Addresses of the flash memory and of the RAM, as in `memory.x`.
const FLASH: Range<u32> = 0x0800_0000..0x0808_0000;
const RAM: Range<u32> = 0x2000_0000..0x2002_0000;

/// Bytes taken, and bytes there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryUsage {
    /// Code, constants and the initial values of variables.
    pub flash: u32,
    /// Size of the flash memory.
    pub flash_total: u32,
    /// Variables; the stack has the rest.
    pub ram: u32,
    /// Size of the RAM.
    pub ram_total: u32,
}

/// Reads an image's program headers.
///
/// # Errors
/// [`Error::File`], or [`Error::Image`] if it is no 32-bit ELF file with something to load into flash.
pub fn read_memory_usage(path: &Path) -> Result<MemoryUsage, Error> {
    let data =
        fs::read(path).map_err(|source| Error::File { what: "cannot read", path: path.to_path_buf(), source })?;
    let not_an_image = |reason: String| Error::Image { path: path.to_path_buf(), reason };
    let malformed = |error: object::read::Error| not_an_image(error.to_string());
    let header = FileHeader32::<LittleEndian>::parse(&*data).map_err(malformed)?;
    let endian = header.endian().map_err(malformed)?;
    let (mut flash, mut ram) = (0, 0);
    for segment in header.program_headers(endian, &*data).map_err(malformed)? {
        if segment.p_type(endian) != PT_LOAD {
            continue;
        }
        // What is stored is where it is loaded from, what is occupied is where it runs: initial values count for both.
        if FLASH.contains(&segment.p_paddr(endian)) {
            flash += segment.p_filesz(endian);
        }
        if RAM.contains(&segment.p_vaddr(endian)) {
            ram += segment.p_memsz(endian);
        }
    }
    if flash == 0 {
        return Err(not_an_image("the file has nothing for the flash".to_owned()));
    }
    Ok(MemoryUsage { flash, flash_total: FLASH.end - FLASH.start, ram, ram_total: RAM.end - RAM.start })
}

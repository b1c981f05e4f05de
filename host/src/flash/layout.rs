//! The flash as the ROM bootloader describes it: the name of a USB alternate setting, in the form that AN3156 gives.
//!
//! Example: `@Internal Flash   /0x08000000/256*02Kg`: 256 pages of 2 KiB that can be read, erased and written.

use era_shared::image::{FIRST_STAGE_SIZE, FLASH_SIZE, FLASH_START};
use std::ops::Range;

/// Why the memory that the bootloader describes is not this chip's flash.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum LayoutError {
    /// Not of the form that it should have.
    #[error("the bootloader describes its memory as {0:?}, which this program cannot interpret")]
    Malformed(String),
    /// Another chip.
    #[error(
        "the bootloader describes {found}, but an STM32G474RE has 512 KiB at {FLASH_START:#010x} in pages of 2 or 4 \
         KiB: this is another chip, and nothing was changed"
    )]
    OtherChip {
        /// What it describes.
        found: String,
    },
    /// Pages that are protected.
    #[error(
        "the flash page at {address:#010x} is write-protected by the option bytes; remove the protection with a debug \
         probe"
    )]
    Protected {
        /// Where.
        address: u32,
    },
}

/// Pages of the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    page_size: u32,
}

impl Layout {
    /// Understands the description.
    ///
    /// # Errors
    /// [`LayoutError`].
    pub fn parse(description: &str) -> Result<Self, LayoutError> {
        let malformed = || LayoutError::Malformed(description.to_owned());
        let mut parts = description.strip_prefix('@').ok_or_else(malformed)?.split('/').map(str::trim);
        let (_name, start, pages, rest) = (parts.next(), parts.next(), parts.next(), parts.next());
        let start = start.and_then(|text| text.strip_prefix("0x")).ok_or_else(malformed)?;
        let start = u32::from_str_radix(start, 16).map_err(|_| malformed())?;
        let mut address = u64::from(start);
        let mut sizes = Vec::new();
        let mut protected = None;
        for group in pages.ok_or_else(malformed)?.split(',') {
            let group = PageGroup::parse(group.trim()).ok_or_else(malformed)?;
            if !group.writable {
                protected = protected.or(Some(address));
            }
            address += u64::from(group.count) * u64::from(group.size);
            sizes.push(group.size);
        }
        let length = address - u64::from(start);
        let page_size = sizes.first().copied().unwrap_or_default();
        let known = matches!(page_size, 2048 | 4096) && sizes.iter().all(|size| *size == page_size);
        if rest.is_some() || start != FLASH_START || length != u64::from(FLASH_SIZE) || !known {
            let found = format!("{length} bytes at {start:#010x} in pages of {sizes:?} bytes");
            return Err(LayoutError::OtherChip { found });
        }
        match protected.map(u32::try_from) {
            None => Ok(Self { page_size }),
            Some(address) => Err(LayoutError::Protected { address: address.unwrap_or(start) }),
        }
    }

    /// Addresses of the pages to erase so that `range` is erased.
    ///
    /// Always whole blocks of 4 KiB: a chip whose real pages are larger than it says then still loses nothing that was to
    /// stay.
    pub fn pages(&self, range: &Range<u32>) -> impl Iterator<Item = u32> + use<> {
        let start = range.start - (range.start - FLASH_START) % FIRST_STAGE_SIZE;
        let end = range.end.next_multiple_of(FIRST_STAGE_SIZE);
        (start..end).step_by(self.page_size as usize)
    }
}

/// A number of equal pages.
struct PageGroup {
    count: u32,
    size: u32,
    writable: bool,
}

impl PageGroup {
    /// `256*02Kg`: count, size, unit, and a letter whose low bits say readable (1), erasable (2), writable (4).
    fn parse(text: &str) -> Option<Self> {
        let (count, rest) = text.split_once('*')?;
        let digits = rest.find(|c: char| !c.is_ascii_digit())?;
        let (size, mut letters) = (rest.get(..digits)?, rest.get(digits..)?.chars());
        let unit = match letters.next()? {
            'B' | ' ' => 1,
            'K' => 1024,
            'M' => 1024 * 1024,
            _ => return None,
        };
        let access = letters.next().filter(|letter| ('a'..='g').contains(letter))? as u32 - 'a' as u32 + 1;
        if letters.next().is_some() {
            return None;
        }
        let (count, size) = (count.trim().parse().ok()?, size.parse::<u32>().ok()?.checked_mul(unit)?);
        Some(Self { count, size, writable: access == 7 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_page_sizes_are_understood() {
        let dual = Layout::parse("@Internal Flash   /0x08000000/256*02Kg").unwrap();
        assert_eq!(dual.pages(&(0x0800_1000..0x0800_1801)).collect::<Vec<_>>(), [0x0800_1000, 0x0800_1800]);
        let single = Layout::parse("@Internal Flash  /0x08000000/128*04Kg").unwrap();
        assert_eq!(single.pages(&(0x0800_1000..0x0800_2001)).collect::<Vec<_>>(), [0x0800_1000, 0x0800_2000]);
        // Half a block is never erased alone.
        assert_eq!(dual.pages(&(0x0800_1800..0x0800_1808)).count(), 2);
    }

    #[test]
    fn other_chips_are_refused() {
        for other in [
            "@Internal Flash   /0x08000000/64*02Kg",
            "@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg",
            "@Internal Flash   /0x08000000/4*128Kg",
            "@Internal Flash   /0x08100000/256*02Kg",
            "@Internal Flash   /0x08000000/128*02Kg/0x08040000/128*02Kg",
        ] {
            assert!(matches!(Layout::parse(other), Err(LayoutError::OtherChip { .. })), "{other}");
        }
        for junk in [
            "",
            "Internal Flash",
            "@x",
            "@x/08000000/1*2Kg",
            "@x/0x08000000/",
            "@x/0x08000000/1*Kg",
            "@x/0x08000000/1*2Kz",
        ] {
            assert!(matches!(Layout::parse(junk), Err(LayoutError::Malformed(_))), "{junk}");
        }
        let protected = Layout::parse("@Internal Flash   /0x08000000/2*02Ka,254*02Kg");
        assert_eq!(protected, Err(LayoutError::Protected { address: 0x0800_0000 }));
    }
}

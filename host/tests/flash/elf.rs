//! Images: small ones made here, and what is wrong with a file is said.

use era::flash::image::{Image, ImageError, default_path};
use era_shared::image::{CHIP_STM32G474, FLASH_START, HeaderError, IMAGE_START, ImageHeader};
use era_shared::protocol::{BoardKind, FirmwareVersion};

/// Offset of the header in the flash.
pub const HEADER_AT: usize = 0x1200;

pub fn version(major: u8, commit: &[u8; 8]) -> FirmwareVersion {
    FirmwareVersion { major, minor: 1, patch: 2, commit: *commit }
}

/// Contents of the flash with a first stage and a firmware of `length` bytes whose code is made of `seed`.
pub fn flash_contents(firmware: FirmwareVersion, protocol: (u8, u8), length: usize, seed: u8) -> Vec<u8> {
    let mut bytes = vec![0xFF; 0x1000];
    for (at, word) in [(0, 0x2002_0000_u32), (4, 0x0800_0011), (8, 0x0800_0061), (12, 0x0800_0061)] {
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    bytes.extend((0..length).map(|at| (at as u32).wrapping_mul(97).to_le_bytes()[1] ^ seed));
    for (at, word) in [(0x1000, 0x2002_0000_u32), (0x1004, IMAGE_START + 0x241)] {
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    let given = ImageHeader::encode_header_without_end_address(
        CHIP_STM32G474,
        BoardKind::Stm32G474,
        firmware,
        protocol,
        "test-image",
    );
    bytes[HEADER_AT..HEADER_AT + 60].copy_from_slice(&given);
    let end = FLASH_START + bytes.len() as u32;
    bytes[HEADER_AT + 60..HEADER_AT + 64].copy_from_slice(&end.to_le_bytes());
    bytes
}

/// An ELF file with `contents` as segments at the given addresses.
pub fn elf_file(segments: &[(u32, &[u8])]) -> Vec<u8> {
    let header_length = 52 + 32 * segments.len();
    let mut file = vec![0x7F, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let put16 = |file: &mut Vec<u8>, value: u16| file.extend(value.to_le_bytes());
    let put32 = |file: &mut Vec<u8>, value: u32| file.extend(value.to_le_bytes());
    put16(&mut file, 2); // executable
    put16(&mut file, 40); // ARM
    put32(&mut file, 1);
    put32(&mut file, IMAGE_START + 0x241); // entry
    put32(&mut file, 52); // program headers
    put32(&mut file, 0);
    put32(&mut file, 0x0500_0400);
    for value in [52, 32, segments.len() as u16, 40, 0, 0] {
        put16(&mut file, value);
    }
    let mut offset = header_length as u32;
    for (address, data) in segments {
        for value in [1, offset, *address, *address, data.len() as u32, data.len() as u32, 5, 4] {
            put32(&mut file, value);
        }
        offset += data.len() as u32;
    }
    for (_, data) in segments {
        file.extend(*data);
    }
    file
}

fn good() -> Vec<u8> {
    flash_contents(version(1, b"0123abcd"), (1, 2), 9001, 7)
}

#[test]
fn an_image_is_put_together_from_its_segments() {
    let contents = good();
    let (first, rest) = contents.split_at(0x1000);
    let image = Image::from_elf(&elf_file(&[(IMAGE_START, rest), (FLASH_START, &first[..0xBC])])).unwrap();
    assert_eq!(image.header.firmware, version(1, b"0123abcd"));
    assert_eq!(image.header.name(), "test-image");
    assert_eq!(&image.bytes()[..contents.len()], &contents[..]);
    assert_eq!(image.bytes().len(), contents.len().next_multiple_of(8), "whole double words");
}

#[test]
fn what_is_no_image_is_refused_with_the_reason() {
    let contents = good();
    let whole = elf_file(&[(FLASH_START, &contents)]);
    let changed = |at: usize, bytes: &[u8]| {
        let mut contents = contents.clone();
        contents[at..at + bytes.len()].copy_from_slice(bytes);
        Image::from_elf(&elf_file(&[(FLASH_START, &contents)])).unwrap_err()
    };
    assert!(Image::from_elf(&whole).is_ok());

    assert!(matches!(Image::from_elf(b"not an ELF"), Err(ImageError::NotElf(_))));
    assert!(matches!(Image::from_elf(&whole[..whole.len() - 1]), Err(ImageError::NotElf(_))), "cut off");
    let mut intel = whole.clone();
    intel[18] = 3;
    assert!(matches!(Image::from_elf(&intel), Err(ImageError::Machine { machine: 3, .. })));
    let outside = elf_file(&[(FLASH_START, &contents), (0x0808_0000, &[1])]);
    assert_eq!(Image::from_elf(&outside), Err(ImageError::OutsideFlash { address: 0x0808_0000, length: 1 }));
    let wrapping = elf_file(&[(0xFFFF_FFFF, &[1, 2])]);
    assert!(matches!(Image::from_elf(&wrapping), Err(ImageError::OutsideFlash { .. })));

    for (at, word) in [(0, 0xFFFF_FFFF_u32), (4, 0x0800_0010), (0x1000, 0x2002_0004), (0x1004, 0x2000_0001)] {
        let address = FLASH_START + (at as u32 & 0x1000);
        assert!(
            matches!(changed(at, &word.to_le_bytes()), ImageError::VectorTable { address: found, .. } if found == address)
        );
    }
    assert_eq!(changed(HEADER_AT, b"X"), ImageError::Header(HeaderError::Missing));
    assert_eq!(changed(HEADER_AT + 8, &[9]), ImageError::Header(HeaderError::Format(9)));
    assert_eq!(changed(HEADER_AT + 12, &[0x68]), ImageError::Chip { chip: 0x468 });
    assert!(matches!(changed(HEADER_AT + 60, &[0; 4]), ImageError::Truncated { header_end: 0, .. }));
}

/// The image that is really built, where there is one: `cargo xtask test` builds it first.
#[test]
fn the_built_firmware_is_an_image() {
    let path = default_path();
    if !path.exists() {
        eprintln!("skipped: {} is not there; cargo xtask firmware builds it", path.display());
        return;
    }
    let (image, _) = Image::read(&path).unwrap();
    assert_eq!(image.header.board, Some(BoardKind::Stm32G474));
    assert_eq!(image.header.name(), "era-firmware");
    let first_stage = &image.bytes()[..0x1000];
    assert!(first_stage[0x400..].iter().all(|byte| *byte == 0xFF), "the first stage has grown beyond 1 KiB");
}

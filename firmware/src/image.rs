//! The image header, by which a program that flashes this image knows what it is (`era_shared::image`).

use era_shared::image::{CHIP_STM32G474, ImageHeader};
use era_shared::protocol::{BoardKind, CURRENT_VERSION, FirmwareVersion, MIN_VERSION};

/// Commit of the source, from the build script; empty outside a checkout.
const COMMIT: &[u8] = env!("ERA_COMMIT").as_bytes();

/// Version of this image.
pub const FIRMWARE: FirmwareVersion = FirmwareVersion {
    major: parse_version_number(env!("CARGO_PKG_VERSION_MAJOR")),
    minor: parse_version_number(env!("CARGO_PKG_VERSION_MINOR")),
    patch: parse_version_number(env!("CARGO_PKG_VERSION_PATCH")),
    commit: short_commit_digits(),
};

/// All of the header but its last field, which the linker adds (`memory.x`).
#[used]
#[unsafe(link_section = ".image_header")]
static HEADER: [u8; 60] = ImageHeader::encode_header_without_end_address(
    CHIP_STM32G474,
    BoardKind::Stm32G474,
    FIRMWARE,
    (MIN_VERSION, CURRENT_VERSION),
    env!("CARGO_PKG_NAME"),
);

/// Eight digits, zeros where the commit is not known.
const fn short_commit_digits() -> [u8; 8] {
    let mut digits = [b'0'; 8];
    let mut index = 0;
    while index < COMMIT.len() && index < digits.len() {
        digits[index] = COMMIT[index];
        index += 1;
    }
    digits
}

const fn parse_version_number(text: &str) -> u8 {
    let digits = text.as_bytes();
    let mut value = 0;
    let mut index = 0;
    while index < digits.len() {
        value = value * 10 + (digits[index] - b'0');
        index += 1;
    }
    value
}

//! The order in which an image is written, so that a board whose update was cut off can be updated again.
//!
//! The first stage (`firmware/src/first_stage.rs`), in the first 4 KiB, starts the firmware only if the firmware's first
//! page makes sense, and otherwise the ROM bootloader. So the first stage is left alone if it is as wanted; of the firmware
//! the first page goes first, and its first double word, the initial stack pointer with it, comes last, after all else
//! has been read back.

use super::dfuse::{ControlPipe, DfuError, Dfuse, TRANSFER_SIZE};
use super::image::Image;
use super::layout::Layout;
use era_shared::image::{FIRST_STAGE_SIZE, FLASH_START, HEADER_LENGTH, HEADER_OFFSET, IMAGE_START, ImageHeader};
use std::ops::Range;

/// Bytes of a double word, the least that can be programmed.
const DOUBLE_WORD: u32 = 8;

/// Why an image is not on the board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProgramError {
    /// The bootloader failed.
    #[error(transparent)]
    Dfu(#[from] DfuError),
    /// What was read back is not what was written.
    #[error(
        "the flash at {address:#010x} contains {found:#04x} instead of {wanted:#04x} after writing. Run the same command again; if \
         the error occurs again, the flash of the chip is worn or damaged"
    )]
    Verify {
        /// Where.
        address: u32,
        /// What was written.
        wanted: u8,
        /// What is there.
        found: u8,
    },
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Erasing.
    Erase,
    /// Writing.
    Write,
    /// Reading back.
    Verify,
}

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramResult {
    /// Whether the first stage had to be replaced, too.
    pub first_stage_replaced: bool,
}

/// Reads the header of the image on the board, if there is one.
///
/// # Errors
/// [`DfuError`].
pub fn read_header_on_board<P: ControlPipe>(dfu: &mut Dfuse<P>) -> Result<Option<ImageHeader>, DfuError> {
    let bytes = dfu.read(IMAGE_START + HEADER_OFFSET, HEADER_LENGTH)?;
    Ok(ImageHeader::parse(&bytes).ok())
}

/// Erases, writes and reads back. `progress` gets the stage with the bytes done and to do in it.
///
/// # Errors
/// [`ProgramError`]; running it again brings the board to order.
pub fn program_image<P: ControlPipe>(
    dfu: &mut Dfuse<P>,
    layout: &Layout,
    image: &Image,
    mut progress: impl FnMut(Stage, u32, u32),
) -> Result<ProgramResult, ProgramError> {
    let end = FLASH_START + image.bytes().len() as u32;
    let entry = IMAGE_START..IMAGE_START + FIRST_STAGE_SIZE;
    let rest = entry.end..end.max(entry.end);
    let first_stage = FLASH_START..IMAGE_START;
    let mut job = ProgramJob { dfu, layout, image, total: end - FLASH_START, done: 0, progress: &mut progress };

    let first_stage_replaced = job.find_first_difference(&first_stage)?.is_some();
    job.erase_pages(&entry)?;
    if first_stage_replaced {
        // From the first of these lines to the second a power cut leaves a board that does not start by itself.
        job.erase_pages(&first_stage)?;
        job.write_range(&first_stage)?;
        job.verify_range(&first_stage)?;
    }
    job.erase_pages(&rest)?;

    job.done = 0;
    let first_word = entry.start..entry.start + DOUBLE_WORD;
    let behind_it = first_word.end..entry.end.min(end);
    job.write_range(&rest)?;
    job.write_range(&behind_it)?;
    job.done = 0;
    job.verify_range(&rest)?;
    job.verify_range(&behind_it)?;
    job.write_range(&first_word)?;
    job.verify_range(&first_word)?;
    Ok(ProgramResult { first_stage_replaced })
}

struct ProgramJob<'a, P> {
    dfu: &'a mut Dfuse<P>,
    layout: &'a Layout,
    image: &'a Image,
    total: u32,
    done: u32,
    progress: &'a mut dyn FnMut(Stage, u32, u32),
}

impl<P: ControlPipe> ProgramJob<'_, P> {
    fn erase_pages(&mut self, range: &Range<u32>) -> Result<(), ProgramError> {
        if range.is_empty() {
            return Ok(());
        }
        for page in self.layout.pages(range) {
            self.dfu.erase_page_at(page)?;
            self.report_bytes_done(Stage::Erase, TRANSFER_SIZE as u32);
        }
        Ok(())
    }

    fn write_range(&mut self, range: &Range<u32>) -> Result<(), ProgramError> {
        for piece in split_into_transfers(range) {
            let wanted = expected_bytes(self.image, &piece);
            self.dfu.write(piece.start, &wanted)?;
            self.report_bytes_done(Stage::Write, piece.end - piece.start);
        }
        Ok(())
    }

    fn verify_range(&mut self, range: &Range<u32>) -> Result<(), ProgramError> {
        match self.find_first_difference(range)? {
            None => Ok(()),
            Some(difference) => Err(difference),
        }
    }

    /// Reads back; the first difference, if there is one.
    fn find_first_difference(&mut self, range: &Range<u32>) -> Result<Option<ProgramError>, ProgramError> {
        for piece in split_into_transfers(range) {
            let wanted = expected_bytes(self.image, &piece);
            let found = self.dfu.read(piece.start, wanted.len())?;
            self.report_bytes_done(Stage::Verify, piece.end - piece.start);
            // A shorter answer differs in its first missing byte.
            let found = found.iter().copied().map(Some).chain(std::iter::repeat(None));
            for ((address, wanted), found) in (piece.start..).zip(wanted).zip(found) {
                if found != Some(wanted) {
                    let found = found.unwrap_or(!wanted);
                    return Ok(Some(ProgramError::Verify { address, wanted, found }));
                }
            }
        }
        Ok(None)
    }

    fn report_bytes_done(&mut self, stage: Stage, bytes: u32) {
        self.done = (self.done + bytes).min(self.total);
        (self.progress)(stage, self.done, self.total);
    }
}

/// Pieces of a transfer's length.
fn split_into_transfers(range: &Range<u32>) -> impl Iterator<Item = Range<u32>> + use<> {
    let end = range.end;
    range.clone().step_by(TRANSFER_SIZE).map(move |start| start..end.min(start + TRANSFER_SIZE as u32))
}

/// What should be in a piece of the flash: the image, and around it what is erased.
fn expected_bytes(image: &Image, piece: &Range<u32>) -> Vec<u8> {
    let place = |address: u32| (address - FLASH_START) as usize;
    let bytes = image.bytes();
    (piece.start..piece.end).map(|address| bytes.get(place(address)).copied().unwrap_or(super::image::ERASED)).collect()
}

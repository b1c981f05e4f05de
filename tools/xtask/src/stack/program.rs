//! What an image's functions take of the stack, and what they call, read from the code that would be flashed.

use super::StackError;
use super::thumb::{Effect, decode_effect, instruction_length_bytes};
use object::read::elf::ElfFile32;
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};
use std::collections::{BTreeMap, BTreeSet};

/// The instruction WFI (ARMv7-M, A7.7.261) and ISB SY (A7.7.37).
const WFI: u16 = 0xBF30;
const ISB: [u16; 2] = [0xF3BF, 0x8F6F];

/// One function of the image.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name, and others for the same code.
    pub names: Vec<String>,
    /// Bytes by which it lowers the stack pointer, all its pushes and reservations added up.
    pub frame: u32,
    /// Positions of the functions that it calls or jumps to.
    pub calls: BTreeSet<usize>,
    /// Whether it calls addresses that it got from elsewhere.
    pub calls_indirectly: bool,
}

/// All functions, and where the processor enters them.
#[derive(Clone, Debug)]
pub struct Program {
    /// By address.
    pub functions: Vec<Function>,
    /// Positions of those whose address is stored or computed somewhere: what an indirect call can reach.
    pub address_taken: BTreeSet<usize>,
    /// Functions that sleep (WFI), and whether an ISB follows directly.
    pub sleeps: Vec<(String, bool)>,
    /// Vector numbers (1: reset, 3: HardFault, 16 and up: interrupts) and positions of their handlers.
    pub vectors: BTreeMap<usize, usize>,
}

struct ImageSections<'data> {
    sections: Vec<(u32, &'data [u8])>,
    /// Where code begins and ends, by the mapping symbols of the ABI (ARM ELF, section 5.5.5).
    marks: BTreeMap<u32, bool>,
}

impl ImageSections<'_> {
    fn read_half_word(&self, address: u32) -> Option<u16> {
        self.sections.iter().find_map(|(start, bytes)| {
            let offset = usize::try_from(address.checked_sub(*start)?).ok()?;
            Some(u16::from_le_bytes(bytes.get(offset..offset + 2)?.try_into().ok()?))
        })
    }

    fn is_code_by_mapping_symbols(&self, address: u32) -> bool {
        self.marks.range(..=address).next_back().is_none_or(|(_, code)| *code)
    }
}

impl Program {
    /// Reads a 32-bit little-endian ARM executable with its symbols.
    ///
    /// # Errors
    /// [`StackError`] if it is none, or has code whose stack cannot be followed.
    pub fn read(data: &[u8]) -> Result<Self, StackError> {
        let file = ElfFile32::<object::LittleEndian>::parse(data)?;
        let mut image = ImageSections { sections: Vec::new(), marks: BTreeMap::new() };
        for section in file.sections().filter(|section| section.address() != 0) {
            image.sections.push((section.address() as u32, section.data()?));
        }
        // Address and size, and all names of that address.
        let mut found: BTreeMap<u32, (u32, Vec<String>)> = BTreeMap::new();
        for symbol in file.symbols() {
            let (name, address) = (symbol.name()?, symbol.address() as u32);
            match name.get(..2) {
                Some("$t") => drop(image.marks.insert(address, true)),
                Some("$d") => drop(image.marks.insert(address, false)),
                _ if symbol.kind() == SymbolKind::Text && !symbol.is_undefined() => {
                    let entry = found.entry(address & !1).or_default();
                    entry.0 = entry.0.max(symbol.size() as u32);
                    entry.1.push(format!("{:#}", rustc_demangle::demangle(name)));
                }
                _ => {}
            }
        }
        let starts: Vec<u32> = found.keys().copied().collect();
        let mut program = Self {
            functions: Vec::new(),
            address_taken: BTreeSet::new(),
            vectors: BTreeMap::new(),
            sleeps: Vec::new(),
        };
        for (index, (address, (size, names))) in found.into_iter().enumerate() {
            // Hand-written code may have no size: it then lasts until the next function.
            let next = starts.get(index + 1).copied().unwrap_or(address + 2);
            let end = if size == 0 { next } else { address + size };
            program.add_function(&image, &starts, address..end, names)?;
        }
        program.note_stored_function_addresses_and_vectors(&file, &starts)?;
        // Only the processor enters handlers, wherever else their addresses are stored.
        for handler in program.vectors.values() {
            program.address_taken.remove(handler);
        }
        Ok(program)
    }

    fn add_function(
        &mut self,
        image: &ImageSections<'_>,
        function_starts: &[u32],
        range: std::ops::Range<u32>,
        names: Vec<String>,
    ) -> Result<(), StackError> {
        let unclear = |address| StackError::Unclear { function: names.join(", "), address };
        let mut function = Function { names: Vec::new(), frame: 0, calls: BTreeSet::new(), calls_indirectly: false };
        let (mut cleared, mut low, mut leaves) = (None, BTreeMap::new(), false);
        let mut address = range.start;
        while address < range.end {
            if !image.is_code_by_mapping_symbols(address) {
                // Constants between the instructions: an address among them may be called.
                if address.is_multiple_of(4)
                    && let (Some(first), Some(second)) =
                        (image.read_half_word(address), image.read_half_word(address + 2))
                {
                    self.note_address_taken_if_value_points_to_function(
                        function_starts,
                        u32::from(second) << 16 | u32::from(first),
                    );
                }
                address += 2;
                continue;
            }
            let first = image.read_half_word(address).ok_or_else(|| unclear(address))?;
            let second = image.read_half_word(address + 2).unwrap_or(0);
            if first == WFI {
                let follows = [second, image.read_half_word(address + 4).unwrap_or(0)];
                self.sleeps.push((names.join(", "), follows == ISB));
            }
            match decode_effect(address, first, second) {
                Effect::None => {}
                Effect::Grow(bytes) => function.frame += bytes,
                Effect::ClearLowBits(bits) => cleared = Some(bits),
                // Aligning it costs less than the alignment; afterwards it is only set back.
                Effect::SetStack => match cleared {
                    Some(bits @ 0..=8) => function.frame += 1 << bits,
                    _ => return Err(unclear(address)),
                },
                Effect::Go(to) if range.contains(&to) => {}
                Effect::Go(to) => {
                    let position = function_starts.partition_point(|start| *start <= to).checked_sub(1);
                    function.calls.insert(position.ok_or_else(|| unclear(address))?);
                }
                Effect::NewStack => leaves = true,
                // Where another program begins, nothing of this one is on the stack any more.
                Effect::GoIndirect if leaves => {}
                Effect::GoIndirect => function.calls_indirectly = true,
                Effect::Low { register, value } => drop(low.insert(register, value)),
                Effect::High { register, value } => {
                    self.note_address_taken_if_value_points_to_function(
                        function_starts,
                        value << 16 | low.get(&register).copied().unwrap_or(0),
                    );
                }
                Effect::Unclear => return Err(unclear(address)),
            }
            address += instruction_length_bytes(first);
        }
        function.names = names;
        self.functions.push(function);
        Ok(())
    }

    /// Notes that the address of a function was seen, which has its lowest bit set for Thumb code.
    fn note_address_taken_if_value_points_to_function(&mut self, function_starts: &[u32], value: u32) {
        if value & 1 == 1
            && let Ok(position) = function_starts.binary_search(&(value & !1))
        {
            self.address_taken.insert(position);
        }
    }

    /// Tables of functions in constants and in variables' initial values; and the vector table, apart from them.
    fn note_stored_function_addresses_and_vectors(
        &mut self,
        file: &ElfFile32<'_, object::LittleEndian>,
        function_starts: &[u32],
    ) -> Result<(), StackError> {
        for section in file.sections().filter(|section| section.address() != 0) {
            let name = section.name()?;
            if name == ".text" {
                continue;
            }
            for (number, word) in section.data()?.chunks_exact(4).enumerate() {
                let word = word.iter().rev().fold(0_u32, |sum, byte| sum << 8 | u32::from(*byte));
                if name != ".vector_table" {
                    self.note_address_taken_if_value_points_to_function(function_starts, word);
                } else if number > 0
                    && let Ok(position) = function_starts.binary_search(&(word & !1))
                {
                    self.vectors.insert(number, position);
                }
            }
        }
        Ok(())
    }
}

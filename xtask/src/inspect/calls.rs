//! The call graph of an image: its functions, where each can go, and how much stack each takes.
//!
//! From the machine code itself, so inlining and what the linker removed are as on the board. A
//! branch into another function counts as a call. A call through a register can reach every
//! function whose address stands somewhere in the image: in constants, in data, or in a pair of
//! MOVW and MOVT.

use std::collections::{BTreeMap, BTreeSet};

use object::elf::{FileHeader32, SHF_EXECINSTR, SHT_NOBITS, SHT_SYMTAB, STT_FUNC, STT_NOTYPE};
use object::read::elf::{FileHeader, SectionHeader, Sym};
use object::Endianness;

use super::thumb::{decode, length, Effect};
use crate::report::{Failure, Result};

/// A function of the image.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Function {
    /// Its symbol.
    pub name: String,
    /// First address behind it.
    end: u32,
    /// Functions that it calls or branches to, by address.
    pub goes: BTreeSet<u32>,
    /// Whether it calls through a register.
    pub goes_anywhere: bool,
    /// Bytes of stack that it takes itself. All its instructions count, so this is never too
    /// little.
    pub takes: u32,
    /// Whether it takes an amount of stack that its instructions do not say.
    pub takes_any_amount: bool,
}

/// See the module's page.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Calls {
    /// By address.
    pub functions: BTreeMap<u32, Function>,
    /// Functions whose address stands in the image.
    pub pointed_at: BTreeSet<u32>,
    /// Values of all symbols that are no functions.
    symbols: BTreeMap<String, u32>,
}

/// Bytes of a section at their address.
struct Section<'a> {
    name: &'a [u8],
    address: u32,
    data: &'a [u8],
    code: bool,
}

impl Section<'_> {
    fn halfword(&self, address: u32) -> Option<u16> {
        let at = address.checked_sub(self.address)? as usize;
        Some(u16::from_le_bytes(
            self.data.get(at..at + 2)?.try_into().ok()?,
        ))
    }

    fn words(&self) -> impl Iterator<Item = u32> + '_ {
        let skip = (self.address.next_multiple_of(4) - self.address) as usize;
        self.data
            .get(skip..)
            .unwrap_or(&[])
            .chunks_exact(4)
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
    }
}

impl Calls {
    /// Reads an image with its symbols.
    ///
    /// # Errors
    /// It is no 32-bit ELF file, or has no symbols.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let calls = Self::parse(bytes)
            .map_err(|error| Failure::new(format!("the image can't be read: {error}")))?;
        if calls.functions.is_empty() {
            return Err(Failure::new("the image has no symbols of functions")
                .remedy("read the ELF file that the build left, not a stripped copy"));
        }
        Ok(calls)
    }

    fn parse(bytes: &[u8]) -> std::result::Result<Self, object::read::Error> {
        let header = FileHeader32::<Endianness>::parse(bytes)?;
        let endian = header.endian()?;
        let table = header.sections(endian, bytes)?;
        let mut sections = Vec::new();
        for section in table.iter() {
            if section.sh_addr(endian) != 0 && section.sh_type(endian) != SHT_NOBITS {
                sections.push(Section {
                    name: table.section_name(endian, section)?,
                    address: section.sh_addr(endian),
                    data: section.data(endian, bytes)?,
                    code: section.sh_flags(endian).contains(SHF_EXECINSTR),
                });
            }
        }
        let mut calls = Self::default();
        // Where code turns into constants and back: the symbols $t and $d of the ARM ELF
        // specification, section 5.5.5.
        let mut marks = BTreeMap::new();
        let symbols = table.symbols(endian, bytes, SHT_SYMTAB)?;
        for symbol in symbols.iter() {
            let name = String::from_utf8_lossy(symbols.symbol_name(endian, symbol)?).into_owned();
            let value = symbol.st_value(endian);
            match symbol.st_type() {
                STT_FUNC => {
                    let address = value & !1;
                    let end = address + symbol.st_size(endian);
                    let function = calls.functions.entry(address).or_default();
                    function.end = function.end.max(end);
                    if !function.name.is_empty() {
                        function.name.push(' ');
                    }
                    function.name.push_str(&name);
                }
                STT_NOTYPE if name.starts_with("$t") => drop(marks.insert(value, true)),
                STT_NOTYPE if name.starts_with("$d") => drop(marks.insert(value, false)),
                _ => drop(calls.symbols.insert(name, value)),
            }
        }
        for section in &sections {
            // The vector table points at the handlers, which the processor calls and nobody else.
            if section.name != b".vector_table" {
                calls.find_pointers(section);
            }
        }
        let addresses: Vec<u32> = calls.functions.keys().copied().collect();
        for address in addresses {
            let code = sections
                .iter()
                .find(|section| section.code && section.halfword(address).is_some());
            if let Some(code) = code {
                calls.walk(address, code, &marks);
            }
        }
        Ok(calls)
    }

    fn find_pointers(&mut self, section: &Section) {
        for word in section.words() {
            self.point_at(word);
        }
    }

    fn point_at(&mut self, value: u32) {
        // A pointer to Thumb code has bit 0 set.
        if value & 1 == 1 && self.functions.contains_key(&(value & !1)) {
            self.pointed_at.insert(value & !1);
        }
    }

    /// The function that contains an address.
    fn owner(&self, address: u32) -> Option<u32> {
        let (start, function) = self.functions.range(..=address).next_back()?;
        (address < function.end || address == *start).then_some(*start)
    }

    fn walk(&mut self, start: u32, code: &Section, marks: &BTreeMap<u32, bool>) {
        let mut function = self.functions[&start].clone();
        let mut lows = [None; 16];
        let mut at = start;
        while at < function.end {
            let is_code = marks.range(..=at).next_back().is_none_or(|(_, code)| *code);
            let Some(first) = code.halfword(at) else {
                break;
            };
            if !is_code {
                at += 2;
                continue;
            }
            let second = code.halfword(at + 2).unwrap_or(0);
            match decode(at, first, second) {
                Effect::None => {}
                // Within itself; recursion goes to the first instruction and counts.
                Effect::Goes(to) if to > start && to < function.end => {}
                Effect::Goes(to) => drop(function.goes.insert(self.owner(to).unwrap_or(to))),
                Effect::GoesAnywhere => function.goes_anywhere = true,
                Effect::Takes(bytes) => function.takes += bytes,
                Effect::TakesAnyAmount => function.takes_any_amount = true,
                Effect::Low { register, value } => lows[usize::from(register)] = Some(value),
                Effect::High { register, value } => {
                    if let Some(low) = lows[usize::from(register)] {
                        self.point_at(u32::from(value) << 16 | u32::from(low));
                    }
                }
            }
            at += length(first);
        }
        self.functions.insert(start, function);
    }

    /// Address of the function with exactly this symbol, or with a mangled symbol that contains
    /// `name`.
    pub fn find(&self, name: &str) -> Option<u32> {
        let whole = |function: &Function| function.name.split(' ').any(|word| word == name);
        let mut functions = self.functions.iter();
        functions
            .clone()
            .find(|(_, function)| whole(function))
            .or_else(|| functions.find(|(_, function)| function.name.contains(name)))
            .map(|(address, _)| *address)
    }

    /// Value of a symbol that is no function.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }

    /// A name for a person.
    pub fn name(&self, address: u32) -> String {
        self.functions
            .get(&address)
            .map_or_else(|| format!("{address:#010x}"), |f| f.name.clone())
    }

    /// What the function at `address` can go to.
    pub fn next(&self, address: u32) -> impl Iterator<Item = u32> + '_ {
        let function = self.functions.get(&address);
        let anywhere = function.is_some_and(|function| function.goes_anywhere);
        function
            .into_iter()
            .flat_map(|function| function.goes.iter())
            .chain(self.pointed_at.iter().filter(move |_| anywhere))
            .copied()
    }

    /// A way from one of `roots` to `goal`, both ends included, or `None`; and how many functions
    /// can be reached.
    pub fn way(&self, roots: &[u32], goal: u32) -> (Option<Vec<u32>>, usize) {
        let mut from: BTreeMap<u32, Option<u32>> = roots.iter().map(|root| (*root, None)).collect();
        let mut open: Vec<u32> = roots.to_vec();
        while let Some(at) = open.pop() {
            for to in self.next(at) {
                from.entry(to).or_insert_with(|| {
                    open.push(to);
                    Some(at)
                });
            }
        }
        if !from.contains_key(&goal) {
            return (None, from.len());
        }
        let mut way = vec![goal];
        while let Some(Some(before)) = way.last().and_then(|at| from.get(at)) {
            way.push(*before);
        }
        way.reverse();
        (Some(way), from.len())
    }
}

#[cfg(test)]
impl Calls {
    /// A graph from name, stack and the names that it goes to, for tests.
    pub fn of(functions: &[(&str, u32, &[&str])]) -> Self {
        let address = |name: &str| {
            let at = functions.iter().position(|(n, ..)| *n == name).unwrap();
            0x100 * (at as u32 + 1)
        };
        let mut calls = Self::default();
        for (name, takes, goes) in functions {
            let function = Function {
                name: (*name).to_owned(),
                takes: *takes,
                goes: goes.iter().map(|name| address(name)).collect(),
                ..Function::default()
            };
            calls.functions.insert(address(name), function);
        }
        calls
    }
}

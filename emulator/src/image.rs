//! The firmware image: checked before it is run, so that a wrong file gives a clear message.

use object::elf;
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Architecture, Object, ObjectSymbol, SymbolKind};
use std::fmt;
use std::path::{Path, PathBuf};

/// Start of the flash, where the core finds its vector table.
pub const FLASH_BASE: u32 = 0x0800_0000;
/// Size of the flash of the STM32H753ZI.
pub const FLASH_SIZE: u32 = 2 << 20;

/// Why a file is no firmware for this board.
#[derive(Debug)]
pub enum ImageError {
    /// It cannot be read.
    Unreadable(PathBuf, std::io::Error),
    /// It is no ELF file, or a broken one.
    NotElf(PathBuf, String),
    /// It is for another machine.
    WrongMachine(PathBuf, String),
    /// There is no vector table where the core looks for one.
    NoVectors(PathBuf, String),
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(path, error) => write!(
                f,
                "cannot read the firmware image {}: {error}; build it first (cargo xtask build) or give its path",
                path.display()
            ),
            Self::NotElf(path, why) => write!(
                f,
                "{} is no ELF image ({why}); give the file the linker wrote, not a .bin or .hex",
                path.display()
            ),
            Self::WrongMachine(path, what) => write!(
                f,
                "{} is built for {what}; the board needs 32-bit little-endian ARM (target thumbv7em-none-eabihf)",
                path.display()
            ),
            Self::NoVectors(path, why) => write!(
                f,
                "{} cannot boot: {why}; is memory.x the board's (FLASH at {FLASH_BASE:#010x})?",
                path.display()
            ),
        }
    }
}

impl std::error::Error for ImageError {}

/// A firmware image that this board can boot.
#[derive(Debug, Clone)]
pub struct Image {
    /// Where it was read from.
    pub path: PathBuf,
    /// The whole ELF file.
    pub bytes: Vec<u8>,
    /// Address of the RTT control block, where the image has one.
    pub rtt: Option<u32>,
    /// Memory of the crash record, where the image has one.
    pub crash_record: Option<std::ops::Range<u32>>,
    /// Memory of the stack, where the image names it (`_stack_end` to `_stack_start`, which it
    /// grows down from).
    pub stack: Option<std::ops::Range<u32>>,
    /// Memory of the variables, where the image names it (`__sdata` to `__ebss`).
    pub variables: Option<std::ops::Range<u32>>,
    /// Entry of `Board::samples`, which each pass of the superloop calls with interrupts enabled
    /// and which keeps its own symbol (board/src/firmware.rs).
    pub samples: Option<u32>,
}

impl Image {
    /// Reads and checks the file at `path`.
    ///
    /// # Errors
    /// See [`ImageError`].
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let bytes =
            std::fs::read(path).map_err(|error| ImageError::Unreadable(path.into(), error))?;
        Self::new(path, bytes)
    }

    /// Checks an image that is in memory already.
    ///
    /// # Errors
    /// See [`ImageError`].
    pub fn new(path: &Path, bytes: Vec<u8>) -> Result<Self, ImageError> {
        let not_elf = |why: String| ImageError::NotElf(path.into(), why);
        let file = object::File::parse(&*bytes).map_err(|error| not_elf(error.to_string()))?;
        if file.format() != object::BinaryFormat::Elf {
            return Err(not_elf(format!("it is {:?}", file.format())));
        }
        if file.architecture() != Architecture::Arm || !file.is_little_endian() || file.is_64() {
            let bits = if file.is_64() { "64-bit" } else { "32-bit" };
            return Err(ImageError::WrongMachine(
                path.into(),
                format!("{bits} {:?}", file.architecture()),
            ));
        }
        check_vectors(path, &bytes)?;
        let address = |name: &str| {
            file.symbols()
                .find(|symbol| symbol.name() == Ok(name))
                .and_then(|symbol| u32::try_from(symbol.address()).ok())
        };
        let between = |from: &str, to: &str| {
            let range = address(from)?..address(to)?;
            (!range.is_empty()).then_some(range)
        };
        let rtt = address("_SEGGER_RTT");
        let stack = between("_stack_end", "_stack_start");
        let variables = between("__sdata", "__ebss");
        let crash_record = file
            .symbols()
            .find(|symbol| {
                let is_record =
                    |name: &str| name.contains("crash_record") && name.contains("RECORD");
                symbol.kind() == SymbolKind::Data && symbol.name().is_ok_and(is_record)
            })
            .and_then(|symbol| {
                let start = u32::try_from(symbol.address()).ok()?;
                Some(start..start + u32::try_from(symbol.size()).ok()?)
            });
        let samples = file
            .symbols()
            .find(|symbol| {
                let is_samples = |name: &str| name.contains("5Board7samples");
                symbol.kind() == SymbolKind::Text
                    && symbol.is_definition()
                    && symbol.name().is_ok_and(is_samples)
            })
            .and_then(|symbol| u32::try_from(symbol.address() & !1).ok());
        drop(file);
        Ok(Self {
            path: path.into(),
            rtt,
            crash_record,
            stack,
            variables,
            samples,
            bytes,
        })
    }
}

/// The first word must be a stack pointer, the second a Thumb address inside the flash.
fn check_vectors(path: &Path, bytes: &[u8]) -> Result<(), ImageError> {
    let not_elf = |error: object::Error| ImageError::NotElf(path.into(), error.to_string());
    let no_vectors = |why: String| ImageError::NoVectors(path.into(), why);
    let header = elf::FileHeader32::<object::LittleEndian>::parse(bytes).map_err(not_elf)?;
    let endian = header.endian().map_err(not_elf)?;
    let segments = header.program_headers(endian, bytes).map_err(not_elf)?;
    let first = segments
        .iter()
        .filter(|segment| segment.p_type(endian) == elf::PT_LOAD)
        .find(|segment| {
            let start = segment.p_paddr(endian);
            start <= FLASH_BASE && FLASH_BASE - start < segment.p_filesz(endian)
        })
        .ok_or_else(|| no_vectors(format!("nothing is placed at {FLASH_BASE:#010x}")))?;
    let data = first
        .data(endian, bytes)
        .map_err(|()| no_vectors("the file is cut off".to_owned()))?;
    let at = (FLASH_BASE - first.p_paddr(endian)) as usize;
    let word = |n: usize| {
        data.get(at + 4 * n..at + 4 * n + 4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    };
    let reset = word(1).ok_or_else(|| no_vectors("the vector table is cut off".to_owned()))?;
    if reset & 1 == 0 || !(FLASH_BASE..FLASH_BASE + FLASH_SIZE).contains(&reset) {
        return Err(no_vectors(format!(
            "its reset vector is {reset:#010x}, which is no Thumb address in flash"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(bytes: &[u8]) -> String {
        Image::new(Path::new("some.elf"), bytes.to_vec())
            .expect_err("not a firmware")
            .to_string()
    }

    #[test]
    fn files_that_are_no_firmware_say_what_to_do() {
        assert!(refused(b"MZ what").contains("no ELF image"));
        assert!(refused(&[]).contains("some.elf is no ELF image"));
        let this_program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
        assert!(refused(&this_program).contains("thumbv7em-none-eabihf"));
        let missing = Image::read(Path::new("/nowhere/firmware"))
            .unwrap_err()
            .to_string();
        assert!(missing.contains("/nowhere/firmware") && missing.contains("build it first"));
    }

    /// A 32-bit ARM ELF with one loadable segment of `words` at `address`.
    fn arm_elf(address: u32, words: &[u32]) -> Vec<u8> {
        let data: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let mut file = vec![0x7F, b'E', b'L', b'F', 1, 1, 1];
        file.resize(16, 0);
        for half in [2u16, 40] {
            file.extend(half.to_le_bytes());
        }
        for word in [1, address, 52, 0, 0x0500_0400] {
            file.extend(u32::to_le_bytes(word));
        }
        for half in [52u16, 32, 1, 40, 0, 0] {
            file.extend(half.to_le_bytes());
        }
        let size = data.len() as u32;
        for word in [1, 84, address, address, size, size, 5, 4] {
            file.extend(u32::to_le_bytes(word));
        }
        file.extend(data);
        file
    }

    #[test]
    fn the_vector_table_is_looked_at() {
        let good = arm_elf(FLASH_BASE, &[0x2002_0000, FLASH_BASE + 9, 0]);
        assert!(Image::new(Path::new("good"), good).is_ok());
        let elsewhere = arm_elf(0x2400_0000, &[0x2002_0000, 0x2400_0009]);
        assert!(refused(&elsewhere).contains("nothing is placed at 0x08000000"));
        let even = arm_elf(FLASH_BASE, &[0x2002_0000, FLASH_BASE + 8]);
        assert!(refused(&even).contains("no Thumb address"));
    }
}

//! Reads a firmware image: which memory it fills, and its raw flash contents.

use object::elf::{PT_LOAD, SHF_ALLOC};
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};
use object::Endianness;

use crate::report::{grouped, Failure, Result};

/// A memory of the STM32H753ZI (RM0433 Rev 8, section 2.3.2, table 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Its name in the reference manual.
    pub name: &'static str,
    /// First address.
    pub start: u64,
    /// Size in bytes.
    pub size: u64,
}

impl Memory {
    const fn contains(&self, address: u64) -> bool {
        address >= self.start && address - self.start < self.size
    }
}

/// The flash, the only memory that keeps an image.
pub const FLASH: Memory = Memory {
    name: "flash",
    start: 0x0800_0000,
    size: 2048 * 1024,
};

/// All memories that an image may use.
pub const MEMORIES: [Memory; 7] = [
    FLASH,
    Memory {
        name: "ITCM",
        start: 0,
        size: 64 * 1024,
    },
    Memory {
        name: "DTCM",
        start: 0x2000_0000,
        size: 128 * 1024,
    },
    Memory {
        name: "AXI SRAM",
        start: 0x2400_0000,
        size: 512 * 1024,
    },
    Memory {
        name: "SRAM1-3",
        start: 0x3000_0000,
        size: 288 * 1024,
    },
    Memory {
        name: "SRAM4",
        start: 0x3800_0000,
        size: 64 * 1024,
    },
    Memory {
        name: "backup SRAM",
        start: 0x3880_0000,
        size: 4 * 1024,
    },
];

/// A section that takes room on the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Its name, such as `.text`.
    pub name: String,
    /// Where the program sees it.
    pub address: u64,
    /// Bytes.
    pub size: u64,
}

/// A piece that a programmer writes into memory.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Segment {
    /// Where it is stored (the load address, not where the program sees it).
    stored_at: u64,
    data: Vec<u8>,
}

/// What an ELF file puts on the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// In the file's order.
    pub sections: Vec<Section>,
    segments: Vec<Segment>,
}

impl Image {
    /// Reads a 32-bit ELF file.
    ///
    /// # Errors
    /// When the bytes are not such a file, or a damaged one.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let reason = match Self::read(bytes) {
            Ok(Some(image)) => return Ok(image),
            Ok(None) => "a segment runs beyond the end of the file".to_string(),
            Err(error) => error.to_string(),
        };
        Err(
            Failure::new(format!("no 32-bit ELF file for the board: {reason}"))
                .remedy("delete it and run `cargo xtask build`"),
        )
    }

    fn read(bytes: &[u8]) -> std::result::Result<Option<Self>, object::read::Error> {
        let header = object::elf::FileHeader32::<Endianness>::parse(bytes)?;
        let endian = header.endian()?;
        let table = header.sections(endian, bytes)?;
        let mut sections = Vec::new();
        for section in table.iter() {
            let size = u64::from(section.sh_size(endian));
            if size > 0 && section.sh_flags(endian).contains(SHF_ALLOC) {
                let name = table.section_name(endian, section)?;
                sections.push(Section {
                    name: String::from_utf8_lossy(name).into_owned(),
                    address: u64::from(section.sh_addr(endian)),
                    size,
                });
            }
        }
        let mut segments = Vec::new();
        for segment in header.program_headers(endian, bytes)? {
            if segment.p_type(endian) != PT_LOAD || segment.p_filesz(endian) == 0 {
                continue;
            }
            let data = segment.data(endian, bytes).ok();
            segments.push(data.map(|data| Segment {
                stored_at: u64::from(segment.p_paddr(endian)),
                data: data.to_vec(),
            }));
        }
        // A segment that runs beyond the end of the file leaves a `None`.
        Ok(segments
            .into_iter()
            .collect::<Option<_>>()
            .map(|segments| Self { sections, segments }))
    }

    /// Bytes used in each of [`MEMORIES`], in its order. Initialised data counts twice, as it
    /// should: where it lives and in the flash that it is copied from.
    pub fn usage(&self) -> [u64; MEMORIES.len()] {
        MEMORIES.map(|memory| {
            if memory == FLASH {
                self.segments
                    .iter()
                    .filter(|segment| memory.contains(segment.stored_at))
                    .map(|segment| segment.data.len() as u64)
                    .sum()
            } else {
                self.sections
                    .iter()
                    .filter(|section| memory.contains(section.address))
                    .map(|section| section.size)
                    .sum()
            }
        })
    }

    /// The flash's contents from its first byte on; gaps read 0xFF as in erased flash.
    ///
    /// # Errors
    /// When a piece lies outside the flash, where a raw image can't put it.
    pub fn flash_contents(&self) -> Result<Vec<u8>> {
        let mut contents = Vec::new();
        for segment in &self.segments {
            let length = segment.data.len() as u64;
            let offset = segment
                .stored_at
                .checked_sub(FLASH.start)
                .filter(|offset| offset + length <= FLASH.size)
                .ok_or_else(|| {
                    Failure::new(format!(
                        "the image stores {} bytes at {:#010x}, outside the flash ({:#010x}, {} bytes)",
                        grouped(length),
                        segment.stored_at,
                        FLASH.start,
                        grouped(FLASH.size)
                    ))
                    .remedy("look at board/memory.x: every section needs a load address in FLASH")
                })?;
            // Offsets are below 2 MiB here.
            let (start, end) = (offset as usize, (offset + length) as usize);
            if contents.len() < end {
                contents.resize(end, 0xFF);
            }
            contents[start..end].copy_from_slice(&segment.data);
        }
        Ok(contents)
    }

    /// The size report: sections, then memories.
    pub fn report(&self) -> String {
        let mut text = format!("{:<24}{:>12}{:>12}\n", "section", "address", "bytes");
        for section in &self.sections {
            text.push_str(&format!(
                "{:<24}{:>12}{:>12}\n",
                section.name,
                format!("{:#010x}", section.address),
                grouped(section.size)
            ));
        }
        text.push_str(&format!(
            "\n{:<24}{:>12}{:>12}{:>8}\n",
            "memory", "used", "of", "%"
        ));
        for (memory, used) in MEMORIES.iter().zip(self.usage()) {
            if used > 0 {
                let percent = 100.0 * used as f64 / memory.size as f64;
                text.push_str(&format!(
                    "{:<24}{:>12}{:>12}{percent:>8.1}\n",
                    memory.name,
                    grouped(used),
                    grouped(memory.size)
                ));
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A little ELF32 file: `.text` in flash, `.data` in DTCM loaded from flash, `.bss` in DTCM.
    fn sample() -> Vec<u8> {
        let half = |out: &mut Vec<u8>, value: u16| out.extend(value.to_le_bytes());
        let word = |out: &mut Vec<u8>, value: u32| out.extend(value.to_le_bytes());
        let names = b"\0.text\0.data\0.bss\0.shstrtab\0";
        let (text, data) = ([0x11_u8; 8], [0x22_u8; 4]);
        let headers_end = 52 + 2 * 32;
        let data_at = headers_end + text.len() as u32;
        let names_at = data_at + data.len() as u32;
        let sections_at = names_at + names.len() as u32;

        let mut out = vec![0x7F, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        half(&mut out, 2); // executable
        half(&mut out, 40); // ARM
        for value in [1, 0x0800_0001, 52, sections_at, 0] {
            word(&mut out, value);
        }
        for value in [52, 32, 2, 40, 5, 4] {
            half(&mut out, value);
        }
        // Program headers: type, offset, vaddr, paddr, filesz, memsz, flags, align.
        for value in [1, headers_end, 0x0800_0000, 0x0800_0000, 8, 8, 5, 4] {
            word(&mut out, value);
        }
        for value in [1, data_at, 0x2000_0000, 0x0800_0010, 4, 4, 6, 4] {
            word(&mut out, value);
        }
        out.extend(text);
        out.extend(data);
        out.extend(names);
        // Sections: name, type, flags, addr, offset, size, link, info, align, entsize.
        for section in [
            [0; 10],
            [1, 1, 6, 0x0800_0000, headers_end, 8, 0, 0, 4, 0],
            [7, 1, 3, 0x2000_0000, data_at, 4, 0, 0, 4, 0],
            [13, 8, 3, 0x2000_0004, 0, 100, 0, 0, 4, 0],
            [18, 3, 0, 0, names_at, names.len() as u32, 0, 0, 1, 0],
        ] {
            for value in section {
                word(&mut out, value);
            }
        }
        out
    }

    #[test]
    fn allocated_sections_are_listed() {
        let image = Image::parse(&sample()).unwrap();
        let names: Vec<_> = image.sections.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, [".text", ".data", ".bss"]);
        assert_eq!(image.sections[2].size, 100);
    }

    #[test]
    fn initialised_data_counts_in_flash_and_ram() {
        let usage = Image::parse(&sample()).unwrap().usage();
        assert_eq!(usage[0], 8 + 4, "flash");
        assert_eq!(usage[2], 4 + 100, "DTCM");
        assert_eq!(usage.iter().sum::<u64>(), 116, "nothing elsewhere");
    }

    #[test]
    fn flash_contents_keep_load_addresses_and_gaps() {
        let contents = Image::parse(&sample()).unwrap().flash_contents().unwrap();
        assert_eq!(contents.len(), 0x14);
        assert_eq!(contents[..8], [0x11; 8]);
        assert_eq!(contents[8..16], [0xFF; 8]);
        assert_eq!(contents[16..], [0x22; 4]);
    }

    #[test]
    fn a_segment_outside_the_flash_is_refused() {
        let mut bytes = sample();
        // paddr of the second program header.
        bytes[52 + 32 + 12..52 + 32 + 16].copy_from_slice(&0x2400_0000_u32.to_le_bytes());
        let error = Image::parse(&bytes)
            .unwrap()
            .flash_contents()
            .unwrap_err()
            .to_string();
        assert!(error.contains("0x24000000"), "{error}");
    }

    #[test]
    fn damaged_files_are_errors() {
        let bytes = sample();
        assert!(Image::parse(b"").is_err());
        assert!(Image::parse(b"not an ELF file at all").is_err());
        for length in 0..bytes.len() {
            assert!(Image::parse(&bytes[..length]).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn the_report_names_sections_and_memories() {
        let report = Image::parse(&sample()).unwrap().report();
        for part in [".text", "0x08000000", "flash", "2,097,152", "DTCM"] {
            assert!(report.contains(part), "{part} is missing in\n{report}");
        }
        assert!(!report.contains("AXI SRAM"), "unused memories stay out");
    }
}

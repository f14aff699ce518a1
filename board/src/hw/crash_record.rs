//! The crash record: fault, detail and program counter of the run that ended, in memory that
//! survives a reset.
//!
//! Written by the panic handler, the processor's fault handlers and the handler of unused
//! interrupts. [`fail`] first pulls the DACs' RST low with direct register writes (0 V on all
//! motors, independent of the state of the rest of the firmware), then writes the record, then
//! resets the processor. The next boot validates it by its magic number and CRC, latches it as a
//! fault and sends it in the response to Hello.

use super::{gpio, watchdog};
use control::Fault;
use core::fmt::Write;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};
use heapless::String;
use wire::frame::crc32;
use wire::message::CrashRecord;

/// "CRSH" in ASCII. Marks a record that was written completely up to its CRC.
const MAGIC: u32 = 0x4352_5348;

/// Whole words of 64 bits: the ECC of AXI SRAM works on such words, and keeps a write back until
/// another word is accessed (section 2.4). So the record is aligned to them, its CRC does not share
/// one with the words after it, and it is written word by word.
#[repr(C, align(8))]
#[derive(Clone, Copy)]
struct Record {
    magic: u32,
    code: u32,
    detail: u32,
    pc: u32,
    length: u32,
    text: [u8; 96],
    crc: u32,
    /// Written last, so that the word before it is in memory when the reset comes.
    flush: u64,
}

const _: () = assert!(core::mem::size_of::<Record>().is_multiple_of(8));
// Text and CRC end a word; the flush has one of its own.
const _: () = assert!(core::mem::offset_of!(Record, flush) % 8 == 0);
const _: () =
    assert!(core::mem::offset_of!(Record, crc) + 4 == core::mem::offset_of!(Record, flush));

/// Neither start-up nor a reset writes to `.uninit`.
#[link_section = ".uninit.crash_record"]
static mut RECORD: MaybeUninit<Record> = MaybeUninit::uninit();

/// Stage of the superloop, for a reset by the watchdog.
#[link_section = ".uninit.stage"]
static mut STAGE: MaybeUninit<[AtomicU32; 2]> = MaybeUninit::uninit();

/// Stage of the superloop. A watchdog reset is attributed to it.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Stage {
    /// Start-up.
    Start = 1,
    /// Samples.
    Samples = 2,
    /// DAC words that were sent.
    Outputs = 3,
    /// Supervisor.
    Supervisor = 4,
    /// Links.
    Links = 5,
    /// Sleep, and the decision to sleep.
    Sleep = 6,
}

fn stage_cells() -> &'static [AtomicU32; 2] {
    // SAFETY: any bits are valid atomics; the array is only reached through shared references.
    unsafe { (*core::ptr::addr_of!(STAGE)).assume_init_ref() }
}

/// Records the stage of the superloop. Two stores.
#[inline(always)]
pub fn set_stage(stage: Stage) {
    let [cell, check] = stage_cells();
    cell.store(stage as u32, Ordering::Relaxed);
    check.store(!(stage as u32), Ordering::Relaxed);
}

fn bytes(record: &Record) -> &[u8] {
    let length = core::mem::offset_of!(Record, crc);
    // SAFETY: `repr(C)` of integers without padding up to `crc`.
    unsafe { core::slice::from_raw_parts(core::ptr::from_ref(record).cast(), length) }
}

/// Takes the crash record of the previous run. Without one, a watchdog or brown-out reset creates
/// one.
pub fn take_crash_record(reset_flags: u32) -> Option<CrashRecord> {
    // RCC_RSR, section 8.7.40.
    const IWDG: u32 = 1 << 26;
    const BROWN_OUT: u32 = 1 << 21;
    const POWER_ON: u32 = 1 << 23;
    // SAFETY: a record of integers: any bits are valid. Nothing else uses it during start-up.
    let record = unsafe { (*core::ptr::addr_of!(RECORD)).assume_init() };
    let valid = record.magic == MAGIC && record.crc == crc32(bytes(&record));
    // Invalidated, because the run that begins now may write its own.
    store(&Record { magic: 0, ..record });
    if valid && reset_flags & POWER_ON == 0 {
        let text = record.text.get(..record.length as usize).unwrap_or(&[]);
        return Some(CrashRecord {
            code: record.code as u16,
            detail: record.detail,
            pc: record.pc,
            text: core::str::from_utf8(text)
                .ok()
                .and_then(|text| text.try_into().ok())
                .unwrap_or_default(),
        });
    }
    let mut text = String::new();
    let [stage, check] = stage_cells()
        .each_ref()
        .map(|cell| cell.load(Ordering::Relaxed));
    if reset_flags & IWDG != 0 {
        let known = stage == !check;
        let stage = if known { stage } else { 0 };
        let _ = write!(
            text,
            "watchdog reset; the superloop hung in its stage {stage}"
        );
        return Some(CrashRecord {
            code: Fault::WatchdogReset.code(),
            detail: 0,
            pc: 0,
            text,
        });
    }
    if reset_flags & BROWN_OUT != 0 && reset_flags & POWER_ON == 0 {
        let _ = text.push_str("supply fell below the brown-out level");
        return Some(CrashRecord {
            code: Fault::Supply.code(),
            detail: reset_flags,
            pc: 0,
            text,
        });
    }
    None
}

/// Writes the crash record.
pub fn write_crash_record(fault: Fault, detail: u32, pc: u32, text: &str) {
    let mut record = Record {
        magic: MAGIC,
        code: u32::from(fault.code()),
        detail,
        pc,
        length: 0,
        text: [0; 96],
        crc: 0,
        flush: 0,
    };
    // Cut at a character.
    let mut length = text.len().min(record.text.len());
    while !text.is_char_boundary(length) {
        length -= 1;
    }
    record.text[..length].copy_from_slice(&text.as_bytes()[..length]);
    record.length = length as u32;
    record.crc = crc32(bytes(&record));
    store(&record);
}

/// Writes the record into memory, each word of 64 bits as a whole.
fn store(record: &Record) {
    let from = core::ptr::from_ref(record).cast::<u64>();
    let to = core::ptr::addr_of_mut!(RECORD).cast::<u64>();
    for word in 0..core::mem::size_of::<Record>() / 8 {
        // SAFETY: within both records, aligned; the caller is start-up, the superloop, or has
        // disabled interrupts.
        unsafe { to.add(word).write_volatile(from.add(word).read()) };
    }
    cortex_m::asm::dsb();
    // SAFETY: as above. An access to another word than the last one written.
    let _ = unsafe { to.read_volatile() };
    cortex_m::asm::dsb();
}

/// Ends the run: 0 V on all motors, crash record, reset.
pub fn fail(fault: Fault, detail: u32, pc: u32, text: &str) -> ! {
    cortex_m::interrupt::disable();
    gpio::hold_dacs_at_zero();
    write_crash_record(fault, detail, pc, text);
    watchdog::reset()
}

//! Panic handler and fault handlers: panic, HardFault, interrupts without a handler. All of them
//! call [`crash_record::fail`]: 0 V, crash record, reset.
//!
//! HardFault may be entered with an invalid stack pointer (the stack lies in DTCM above a guard of
//! the MPU, and faults when it overflows). So its handler starts in assembly, saves the old pointer
//! and starts a new stack at the top.

use board::hw::pac::SCB;
use board::hw::{crash_record, gpio, startup};
use control::Fault;
use core::fmt::Write;
use core::panic::PanicInfo;
use heapless::String;

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    gpio::hold_dacs_at_zero();
    let mut text = Tail(String::new());
    let line = info.location().map_or(0, |location| {
        let _ = write!(text, "{}:{}: ", location.file(), location.line());
        location.line()
    });
    let _ = write!(text, "{}", info.message());
    crash_record::fail(Fault::Panic, line, 0, &text.0)
}

/// Keeps the text that fits.
struct Tail(String<96>);

impl Write for Tail {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        for character in text.chars() {
            if self.0.push(character).is_err() {
                break;
            }
        }
        Ok(())
    }
}

core::arch::global_asm!(
    ".section .HardFault.entry,\"ax\",%progbits",
    ".global HardFault",
    ".type HardFault,%function",
    ".thumb_func",
    "HardFault:",
    "mrs r0, msp",
    "ldr r1, =_stack_start",
    "mov sp, r1",
    "b {handler}",
    ".size HardFault, . - HardFault",
    handler = sym hard_fault,
);

/// `old_stack`: where the processor stacked r0 to r3, r12, lr, pc, xPSR, if it could.
extern "C" fn hard_fault(old_stack: *const u32) -> ! {
    cortex_m::interrupt::disable();
    gpio::hold_dacs_at_zero();
    extern "C" {
        static _stack_end: u8;
        static _stack_start: u8;
    }
    // Addresses only.
    let stack = core::ptr::addr_of!(_stack_end) as usize + startup::STACK_GUARD as usize
        ..core::ptr::addr_of!(_stack_start) as usize - 31;
    let pc = if stack.contains(&(old_stack as usize)) && old_stack.is_aligned() {
        // SAFETY: within the stack, eight words below its top.
        unsafe { old_stack.add(6).read_volatile() }
    } else {
        0
    };
    // SAFETY: read-only access to status registers (PM 4.3.10).
    let scb = unsafe { &*SCB::PTR };
    let mut text = String::<96>::new();
    let _ = write!(
        text,
        "hard fault, HFSR {:08x} BFAR {:08x}",
        scb.hfsr.read(),
        scb.bfar.read()
    );
    if pc == 0 {
        let _ = text.push_str(", stack overflow");
    }
    crash_record::fail(Fault::HardFault, scb.cfsr.read(), pc, &text)
}

/// The clock security system found the HSE stopped (RM0433 section 8.5.3). The core runs on from
/// the HSI at another frequency, so nothing that has a time is right any more: restart, without the
/// HSE.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() -> ! {
    cortex_m::interrupt::disable();
    gpio::hold_dacs_at_zero();
    // SAFETY: read-only access to a status register.
    let flags = unsafe { (*board::hw::pac::RCC::PTR).cifr().read().bits() };
    crash_record::fail(Fault::ClockFailure, flags, 0, "the HSE clock stopped")
}

#[cortex_m_rt::exception]
unsafe fn DefaultHandler(number: i16) {
    let mut text = String::<96>::new();
    let _ = write!(text, "interrupt {number} has no handler");
    crash_record::fail(Fault::HardFault, number as u32, 0, &text)
}

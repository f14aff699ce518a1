//! The hardware half: registers, interrupts and every `unsafe` of the firmware.
//!
//! | module | owns | interrupts |
//! | --- | --- | --- |
//! | [`startup`] | RCC, PWR, FLASH, SYSCFG, NVIC priorities | |
//! | [`gpio`] | every pin's mode and level | |
//! | [`time`] | TIM2 (board time), SysTick | |
//! | `tick` | the millisecond of the sample path | SysTick |
//! | [`sensors`] | I2C1, EXTI, the bus scheduler | EXTI0 to 4, EXTI9_5, I2C1_EV, I2C1_ER, TIM2 |
//! | [`dac`] | SPI1, DAC select, LDAC and RST pins | SPI1 |
//! | [`counters`] | the counters' parallel bus | |
//! | [`usart`] | USART3, DMA1 streams 0 and 1 | DMA_STR0 |
//! | [`usb`] | USB OTG FS, CRS | OTG_FS |
//! | [`registers`] | nothing: compares the registers that all others have set up | |
//! | [`watchdog`] | IWDG, the alive line | |
//! | [`crash_record`] | the crash record in memory that survives a reset | |
//!
//! The handlers of panics, HardFault and unused interrupts are in `fault_handlers.rs` of the
//! binary.
//!
//! Section numbers are those of RM0433 rev 8, "PM" those of the Cortex-M7 programming manual
//! PM0253.

pub mod counters;
pub mod crash_record;
pub mod dac;
pub mod gpio;
pub mod registers;
pub mod sensors;
pub mod startup;
mod tick;
pub mod time;
pub mod usart;
pub mod usb;
pub mod usb_class;
pub mod watchdog;

pub use stm32h7::stm32h753 as pac;

use core::cell::UnsafeCell;

/// State that the interrupts of level [`SAMPLE_PATH`](crate::clocks::priority::SAMPLE_PATH) share.
///
/// They cannot preempt each other, so no lock is needed among them. The superloop has a lower
/// priority and accesses the state with interrupts masked.
pub struct SamplePath<T>(UnsafeCell<Option<T>>);

// SAFETY: one core; `in_interrupt` and `masked` exclude each other as their contracts say.
unsafe impl<T: Send> Sync for SamplePath<T> {}

impl<T> SamplePath<T> {
    /// Empty until [`Self::install`].
    pub const fn empty() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Installs the state.
    pub fn install(&self, value: T) {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and this is thread mode: no other reference exists.
            unsafe { *self.0.get() = Some(value) };
        });
    }

    /// Runs `f` on the state from thread mode with interrupts masked. Keep `f` to about ten
    /// instructions. `None` before [`Self::install`].
    pub fn masked<R>(&self, f: impl FnOnce(&mut T) -> R) -> Option<R> {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and this is thread mode: no other reference exists.
            unsafe { (*self.0.get()).as_mut() }.map(f)
        })
    }

    /// Runs `f` on the state from an interrupt.
    ///
    /// # Safety
    /// Only from handlers of level `SAMPLE_PATH`, and never from within another `in_interrupt` or
    /// `masked` of the same state.
    pub unsafe fn in_interrupt<R>(&self, f: impl FnOnce(&mut T) -> R) -> Option<R> {
        // SAFETY: by the caller's contract; thread mode is preempted outside its masked sections.
        unsafe { (*self.0.get()).as_mut() }.map(f)
    }
}

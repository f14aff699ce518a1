//! The hardware half: registers, interrupts and every `unsafe` of the firmware.
//!
//! | module | owns | interrupts |
//! | --- | --- | --- |
//! | [`startup`] | RCC, PWR, FLASH, SYSCFG, NVIC priorities | |
//! | [`gpio`] | every pin's mode and level | |
//! | [`time`] | TIM2 (board time), SysTick | SysTick |
//! | [`sensors`] | I2C1, EXTI, the bus scheduler | EXTI0 to 4, EXTI9_5, I2C1_EV, I2C1_ER, TIM2 |
//! | [`dac`] | SPI1, DAC select, LDAC and RST pins | SPI1 |
//! | [`counters`] | the counters' parallel bus | |
//! | [`usart`] | USART3, DMA1 streams 0 and 1 | DMA_STR0 |
//! | [`usb`] | USB OTG FS, CRS | OTG_FS |
//! | [`watchdog`] | IWDG, the alive line | |
//! | [`crash_record`] | the crash record in memory that survives a reset | |
//!
//! Section numbers are those of RM0433 rev 8, "PM" those of the Cortex-M7 programming manual PM0253.

pub mod counters;
pub mod crash_record;
pub mod dac;
pub mod gpio;
pub mod sensors;
pub mod startup;
pub mod time;
pub mod usart;
pub mod usb;
pub mod watchdog;

pub use stm32h7::stm32h753 as pac;

use core::cell::UnsafeCell;

/// State that the interrupts of level [`SAMPLE_PATH`](crate::clocks::priority::SAMPLE_PATH) share.
///
/// They cannot preempt each other, so among them no lock is needed. The superloop runs below them and gets
/// in only with interrupts masked.
pub struct SamplePath<T>(UnsafeCell<Option<T>>);

// SAFETY: one core; `in_interrupt` and `masked` exclude each other as their contracts say.
unsafe impl<T: Send> Sync for SamplePath<T> {}

impl<T> SamplePath<T> {
    /// Empty until [`Self::install`].
    pub const fn empty() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Puts the state in place.
    pub fn install(&self, value: T) {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and thread mode is here: nobody else holds a reference.
            unsafe { *self.0.get() = Some(value) };
        });
    }

    /// Runs `f` on the state from thread mode, with interrupts masked meanwhile: keep it to some ten
    /// instructions. `None` before [`Self::install`].
    pub fn masked<R>(&self, f: impl FnOnce(&mut T) -> R) -> Option<R> {
        cortex_m::interrupt::free(|_| {
            // SAFETY: interrupts are masked and thread mode is here: nobody else holds a reference.
            unsafe { (*self.0.get()).as_mut() }.map(f)
        })
    }

    /// Runs `f` on the state from an interrupt.
    ///
    /// # Safety
    /// Only from handlers of level `SAMPLE_PATH`, and never from within another `in_interrupt` or `masked`
    /// of the same state.
    pub unsafe fn in_interrupt<R>(&self, f: impl FnOnce(&mut T) -> R) -> Option<R> {
        // SAFETY: as promised by the caller; thread mode is stopped below us outside its masked sections.
        unsafe { (*self.0.get()).as_mut() }.map(f)
    }
}

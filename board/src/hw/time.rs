//! Board time (TIM2, 1 MHz, 32 bits) and the supervisor's tick (SysTick, 1 kHz).
//!
//! Owner: this module. TIM2 runs without interruption and any module may read it. Its compare
//! channel 1 is the alarm of the bus recovery ([`super::sensors`]). The SysTick handler
//! ([`super::tick`]) sets a flag for the superloop. A late superloop finds one flag for several
//! ticks: the pass time shows it (fault "loop overrun"), and the alive line misses edges.

use super::pac::TIM2;
use crate::clocks;
use crate::shared::Tick;
use control::Micros;
use core::sync::atomic::AtomicBool;
use cortex_m::peripheral::{syst::SystClkSource, SYST};

static TICK: Tick = Tick::of(AtomicBool::new(false));

fn tim2() -> &'static crate::hw::pac::tim2::RegisterBlock {
    // SAFETY: registers at a fixed address. CNT is read-only here; the rest is written by `start`
    // before any interrupt runs, and by the alarm functions, which run at one priority.
    unsafe { &*TIM2::PTR }
}

/// Starts both timers.
pub fn start(syst: &mut SYST) {
    let tim = tim2();
    tim.psc().write(|w| w.psc().set(clocks::TIM2_PSC));
    // SAFETY: any 32-bit value; this one never reloads early.
    tim.arr().write(|w| unsafe { w.bits(u32::MAX) });
    // PSC is preloaded: an update takes it over (section 38.3.1), and sets UIF.
    tim.egr().write(|w| w.ug().set_bit());
    // SAFETY: all flags cleared, which are rc_w0 (section 38.4.5).
    tim.sr().write(|w| unsafe { w.bits(0) });
    tim.cr1().modify(|_, w| w.cen().set_bit());

    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(clocks::SYSTICK_RELOAD);
    syst.clear_current();
    syst.enable_counter();
    syst.enable_interrupt();
}

/// Board time.
#[inline(always)]
pub fn now() -> Micros {
    Micros(tim2().cnt().read().bits())
}

/// Requests a TIM2 interrupt in `us` microseconds.
pub fn set_alarm(us: u32) {
    let tim = tim2();
    // SAFETY: any 32-bit value.
    tim.ccr1().write(|w| unsafe { w.bits(now().plus(us).0) });
    // SAFETY: rc_w0 flags: writing 1 leaves the others alone; CC1IF is cleared.
    tim.sr().write(|w| unsafe { w.bits(!2) });
    tim.dier().modify(|_, w| w.cc1ie().set_bit());
}

/// Acknowledges the alarm.
pub fn clear_alarm() {
    let tim = tim2();
    tim.dier().modify(|_, w| w.cc1ie().clear_bit());
    // SAFETY: as above.
    tim.sr().write(|w| unsafe { w.bits(!2) });
}

/// Whether a millisecond has begun since the last [`take_tick`].
pub fn tick_waits() -> bool {
    TICK.waits()
}

/// Whether a millisecond has begun since the last call.
pub fn take_tick() -> bool {
    TICK.take()
}

/// Sets the flag of [`take_tick`]. Called by the SysTick handler.
pub(super) fn set_tick() {
    TICK.set();
}

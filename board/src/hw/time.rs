//! Board time (TIM2, 1 MHz, 32 bits), the supervisor's tick (SysTick, 1 kHz), and time asleep.
//!
//! Owner: this module. TIM2 never stops; anyone may read it. Its compare channel 1 is the alarm of the bus
//! recovery ([`super::sensors`]). SysTick runs the bus scheduler's deadlines and leaves a flag for the
//! superloop; a superloop that comes round late sees one flag for several ticks, which the pass time shows
//! (fault "loop overrun") and which the alive line does not hide.

use super::pac::TIM2;
use super::{dac, sensors};
use crate::clocks;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::peripheral::{syst::SystClkSource, SYST};
use cortex_m_rt::exception;

static TICK: AtomicBool = AtomicBool::new(false);

fn tim2() -> &'static crate::hw::pac::tim2::RegisterBlock {
    // SAFETY: registers that are there for ever. CNT is read by everyone; the rest is written by `start`
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

/// Board time in microseconds; wraps after 71.6 minutes.
#[inline(always)]
pub fn now() -> u32 {
    tim2().cnt().read().bits()
}

/// Wants a TIM2 interrupt in `us` microseconds.
pub fn set_alarm(us: u32) {
    let tim = tim2();
    // SAFETY: any 32-bit value.
    tim.ccr1()
        .write(|w| unsafe { w.bits(now().wrapping_add(us)) });
    // SAFETY: rc_w0 flags: writing 1 leaves the others alone; CC1IF is cleared.
    tim.sr().write(|w| unsafe { w.bits(!2) });
    tim.dier().modify(|_, w| w.cc1ie().set_bit());
}

/// Takes an alarm that has gone off.
pub fn clear_alarm() {
    let tim = tim2();
    tim.dier().modify(|_, w| w.cc1ie().clear_bit());
    // SAFETY: as above.
    tim.sr().write(|w| unsafe { w.bits(!2) });
}

/// Whether a millisecond has begun that nobody has taken yet.
pub fn tick_waits() -> bool {
    TICK.load(Ordering::Relaxed)
}

/// Whether a millisecond has begun since the last call.
pub fn take_tick() -> bool {
    TICK.load(Ordering::Relaxed) && TICK.swap(false, Ordering::Relaxed)
}

#[exception]
fn SysTick() {
    sensors::tick();
    dac::tick();
    TICK.store(true, Ordering::Relaxed);
}

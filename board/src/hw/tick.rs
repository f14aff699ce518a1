//! The SysTick handler: the millisecond of the sample path.
//!
//! It lies above [`super::sensors`], [`super::dac`] and [`super::time`], which do not depend on it:
//! deadlines of the bus scheduler and of the DAC words first, then the flag for the superloop.

use super::{dac, sensors, time};
use cortex_m_rt::exception;

#[exception]
fn SysTick() {
    sensors::tick();
    dac::tick();
    time::set_tick();
}

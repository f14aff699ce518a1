//! Recovery of a held or confused I2C bus, in pieces that need neither a bus nor a clock.
//!
//! A device that was interrupted in the middle of a read holds SDA low until it has clocked out its byte.
//! The way out is a ladder, each rung harsher than the one before it:
//!
//! 1. [`BusClear`]: up to nine SCL clocks until SDA is free, then a STOP (I2C-bus specification UM10204,
//!    section 3.1.16). Reaches devices behind the mux only through the channels that are on.
//! 2. the mux's RESET line: cuts every channel off and frees the mux's own state machine.
//! 3. the mux's mask again: it is unknown after any failure ([`super::Selector::invalidate`]).
//! 4. the device behind it: its bring-up from the start, since its registers are unknown too.
//!
//! [`Ladder`] keeps the order and the bound; the owner of the pins performs the rungs.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

/// SCL clocks that free any device: eight data bits and the acknowledge.
pub const MAX_CLOCKS: u8 = 9;

/// What to do next to clear the bus. Each step ends with half a bit time (1.25 us at 400 kHz, 5 us at
/// 100 kHz, which suits a bus in trouble).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BusClearStep {
    /// Put these levels on the open-drain lines: `true` releases, `false` pulls low.
    Lines {
        /// SCL.
        scl: bool,
        /// SDA.
        sda: bool,
    },
    /// Finished; whether SDA is free.
    Done {
        /// SDA was high at the end: the bus can be used again.
        released: bool,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Release,
    Look,
    ClockHigh,
    StopLow,
    StopClock,
    StopRelease,
    Check,
}

/// Clears the bus: clocks until SDA is free, then a STOP.
#[derive(Clone, Copy, Debug)]
pub struct BusClear {
    phase: Phase,
    clocks: u8,
}

impl BusClear {
    /// Starts with both lines released.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Release,
            clocks: 0,
        }
    }

    /// SCL clocks given so far, up to [`MAX_CLOCKS`].
    pub const fn clocks(&self) -> u8 {
        self.clocks
    }

    /// The next step. `sda_high` is the level of SDA at the end of the step before; ignored by the first.
    pub fn next(&mut self, sda_high: bool) -> BusClearStep {
        let (lines, phase) = match self.phase {
            Phase::Release => ((true, true), Phase::Look),
            // Even a free bus gets its STOP: a device may wait in the middle of a transaction.
            Phase::Look if sda_high || self.clocks == MAX_CLOCKS => ((false, true), Phase::StopLow),
            Phase::Look => {
                self.clocks += 1;
                ((false, true), Phase::ClockHigh)
            }
            Phase::ClockHigh => ((true, true), Phase::Look),
            Phase::StopLow => ((false, false), Phase::StopClock),
            Phase::StopClock => ((true, false), Phase::StopRelease),
            Phase::StopRelease => ((true, true), Phase::Check),
            Phase::Check => return BusClearStep::Done { released: sda_high },
        };
        self.phase = phase;
        let (scl, sda) = lines;
        BusClearStep::Lines { scl, sda }
    }
}

impl Default for BusClear {
    fn default() -> Self {
        Self::new()
    }
}

/// Runs [`BusClear`] on two open-drain pins, half a bit time of `half_period_ns` a step. Returns whether
/// SDA is free.
///
/// # Errors
/// The pin's error.
pub fn clear_bus<SCL, SDA, E>(
    scl: &mut SCL,
    sda: &mut SDA,
    delay: &mut impl DelayNs,
    half_period_ns: u32,
) -> Result<bool, E>
where
    SCL: OutputPin<Error = E>,
    SDA: OutputPin<Error = E> + InputPin<Error = E>,
{
    let mut clear = BusClear::new();
    let mut sda_high = true;
    loop {
        match clear.next(sda_high) {
            BusClearStep::Lines {
                scl: scl_level,
                sda: sda_level,
            } => {
                sda.set_state(sda_level.into())?;
                scl.set_state(scl_level.into())?;
                delay.delay_ns(half_period_ns);
                sda_high = sda.is_high()?;
            }
            BusClearStep::Done { released } => return Ok(released),
        }
    }
}

/// A rung of the recovery. The number goes into fault records: never renumber.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Rung {
    /// Clear the bus with [`BusClear`].
    ClearBus = 1,
    /// Pulse the mux's RESET line and clear the bus on the upstream side again.
    ResetMux = 2,
    /// Write the mux's mask and read it back.
    SelectVerified = 3,
    /// Bring the device behind the mux up again.
    BringUpDevice = 4,
    /// Everything worked: back to normal traffic.
    Recovered = 5,
    /// The last rung failed as well: latch a fault, a human has to look.
    GivenUp = 6,
}

/// Order of the recovery: the mildest step first, the mux's reset only once, never in circles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ladder {
    rung: Rung,
    reset_done: bool,
}

impl Ladder {
    /// Starts at [`Rung::ClearBus`].
    pub const fn new() -> Self {
        Self {
            rung: Rung::ClearBus,
            reset_done: false,
        }
    }

    /// What to do now.
    pub const fn rung(&self) -> Rung {
        self.rung
    }

    /// Takes the outcome of the current rung and returns the next one.
    ///
    /// A failure anywhere leads to the mux's reset; a failure after the reset gives up.
    pub fn next(&mut self, worked: bool) -> Rung {
        self.rung = match (self.rung, worked) {
            (Rung::Recovered, _) => Rung::Recovered,
            (Rung::GivenUp, _) => Rung::GivenUp,
            (Rung::ClearBus | Rung::ResetMux, true) => Rung::SelectVerified,
            (Rung::SelectVerified, true) => Rung::BringUpDevice,
            (Rung::BringUpDevice, true) => Rung::Recovered,
            (_, false) if !self.reset_done => {
                self.reset_done = true;
                Rung::ResetMux
            }
            (_, false) => Rung::GivenUp,
        };
        self.rung
    }
}

impl Default for Ladder {
    fn default() -> Self {
        Self::new()
    }
}

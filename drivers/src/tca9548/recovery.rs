//! Recovery of a blocked I2C bus, as state machines without a bus and without a clock.
//!
//! A device that was interrupted in the middle of a read holds SDA low until it has clocked out its
//! byte. [`Recovery`] is the sequence that the board runs, in the order of increasing effect:
//!
//! 1. take SCL and SDA from the controller, [`BusClear`]: up to nine SCL clocks until SDA is free,
//!    then a STOP (I2C-bus specification UM10204, section 3.1.16). It reaches devices behind the
//!    mux only through the channels that are on.
//! 2. if SDA is still low, or the caller requests it: the mux's RESET line, which switches all
//!    channels off and resets the mux's state machine; then [`BusClear`] again, now without the
//!    devices behind the mux.
//! 3. return the lines to the controller.
//!
//! Afterwards the mask of the mux is unknown ([`super::Selector::invalidate`]). Repetition, pauses
//! and reports are the caller's policy.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

/// Number of SCL clocks that frees any device: eight data bits and the acknowledge.
pub const MAX_CLOCKS: u8 = 9;

/// What to do next to clear the bus. Each step ends with half a bit time (1.25 us at 400 kHz; 5 us
/// at 100 kHz, which every device follows).
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

    /// The next step. `sda_high` is the level of SDA at the end of the step before; ignored by the
    /// first.
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

/// Runs [`BusClear`] on two open-drain pins, half a bit time of `half_period_ns` a step. Returns
/// whether SDA is free.
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

/// Next action of a [`Recovery`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RecoveryStep {
    /// Disable the controller and take SCL and SDA as open-drain outputs, both released. Takes no
    /// time.
    TakeLines,
    /// Put these levels on the lines and wait half a bit time, as in [`BusClearStep::Lines`].
    Lines {
        /// SCL.
        scl: bool,
        /// SDA.
        sda: bool,
    },
    /// Drive the mux's RESET line and wait half a bit time.
    MuxReset {
        /// `true`: the line is low and the mux is in reset.
        low: bool,
    },
    /// Return the lines to the controller and enable it. The recovery is over; this step repeats.
    GiveLines {
        /// SDA was high at the end: the bus can be used again.
        released: bool,
    },
}

#[derive(Clone, Copy, Debug)]
enum RecoveryPhase {
    Take,
    Clear(BusClear),
    ResetLow,
    ResetHigh,
    ClearAfterReset(BusClear),
    Give { released: bool },
}

/// One round of the recovery, see the [module](self).
#[derive(Clone, Copy, Debug)]
pub struct Recovery {
    phase: RecoveryPhase,
    reset_mux: bool,
}

impl Recovery {
    /// Starts a round. `reset_mux`: reset the mux even if the clocks alone free SDA, for a round
    /// after a round that did not help.
    pub const fn new(reset_mux: bool) -> Self {
        Self {
            phase: RecoveryPhase::Take,
            reset_mux,
        }
    }

    /// The next step. `sda_high` is the level of SDA at the end of the step before; ignored by the
    /// first.
    pub fn next(&mut self, sda_high: bool) -> RecoveryStep {
        loop {
            match &mut self.phase {
                RecoveryPhase::Take => {
                    self.phase = RecoveryPhase::Clear(BusClear::new());
                    return RecoveryStep::TakeLines;
                }
                RecoveryPhase::Clear(clear) => match clear.next(sda_high) {
                    BusClearStep::Lines { scl, sda } => return RecoveryStep::Lines { scl, sda },
                    BusClearStep::Done { released } => {
                        self.phase = if !released || self.reset_mux {
                            RecoveryPhase::ResetLow
                        } else {
                            RecoveryPhase::Give { released }
                        };
                    }
                },
                RecoveryPhase::ResetLow => {
                    self.phase = RecoveryPhase::ResetHigh;
                    return RecoveryStep::MuxReset { low: true };
                }
                RecoveryPhase::ResetHigh => {
                    self.phase = RecoveryPhase::ClearAfterReset(BusClear::new());
                    return RecoveryStep::MuxReset { low: false };
                }
                RecoveryPhase::ClearAfterReset(clear) => match clear.next(sda_high) {
                    BusClearStep::Lines { scl, sda } => return RecoveryStep::Lines { scl, sda },
                    BusClearStep::Done { released } => {
                        self.phase = RecoveryPhase::Give { released };
                    }
                },
                RecoveryPhase::Give { released } => {
                    return RecoveryStep::GiveLines {
                        released: *released,
                    }
                }
            }
        }
    }
}

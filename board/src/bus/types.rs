//! Types between the scheduler and its callers: transactions and line levels for the hardware,
//! events for the superloop.

use control::{Micros, UnitIndex};
use drivers::nau7802::{AdcCode, SequenceError};

/// One transaction: a write, a read, or a read after a write, with STOP at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transfer {
    /// 7-bit address.
    pub address: u8,
    /// Bytes to write.
    pub write: [u8; 2],
    /// How many of them, 0 to 2.
    pub write_len: u8,
    /// Bytes to read, 0 to 3; after a repeated START where something is written first.
    pub read_len: u8,
}

impl Transfer {
    pub(super) const fn write(address: u8, bytes: [u8; 2], len: u8) -> Self {
        Self {
            address,
            write: bytes,
            write_len: len,
            read_len: 0,
        }
    }

    pub(super) const fn read(address: u8, len: u8) -> Self {
        Self {
            address,
            write: [0; 2],
            write_len: 0,
            read_len: len,
        }
    }

    pub(super) const fn write_read(address: u8, register: u8, len: u8) -> Self {
        Self {
            address,
            write: [register, 0],
            write_len: 1,
            read_len: len,
        }
    }
}

/// Why a transaction failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferError {
    /// Not acknowledged; the controller has sent a STOP.
    Nack,
    /// Misplaced START or STOP, lost arbitration, overrun: the bus is in an unknown state.
    Bus,
    /// Past its deadline: a line is held low, or a clock is stretched without end.
    Timeout,
}

/// Next action of the hardware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Start this transaction and report [`super::Bus::finished`].
    Transfer(Transfer),
    /// Disable the controller and take SCL and SDA as open-drain GPIO, both released. Call
    /// [`super::Bus::next`] again at once.
    TakeLines,
    /// Set the lines to these levels; after [`crate::clocks::RECOVERY_STEP_US`] report
    /// [`super::Bus::stepped`].
    Lines {
        /// SCL released (high) or pulled low.
        scl: bool,
        /// SDA released or pulled low.
        sda: bool,
    },
    /// Set RESET of the multiplexer to this level; after the same time report
    /// [`super::Bus::stepped`].
    MuxReset {
        /// `true`: low, the part is in reset.
        low: bool,
    },
    /// Return the lines to the controller and enable it. Call [`super::Bus::next`] again at once.
    GiveLines,
}

/// Event for the superloop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A conversion has ended and its result will follow. The encoder position of this sample is
    /// read now.
    Edge {
        /// Unit.
        unit: UnitIndex,
    },
    /// A sample.
    Sample {
        /// Unit.
        unit: UnitIndex,
        /// Conversion result.
        code: AdcCode,
        /// DRDY edge.
        at: Micros,
        /// Conversions that were lost between the sample before and this one.
        missed: u8,
    },
    /// The bring-up of a converter is complete; samples follow.
    Up {
        /// Unit.
        unit: UnitIndex,
    },
    /// The bring-up of a converter has failed.
    BringUpFailed {
        /// Unit.
        unit: UnitIndex,
        /// Stage, register and cause.
        error: SequenceError,
    },
    /// A sample was ready and could not be read.
    ReadFailed {
        /// Unit.
        unit: UnitIndex,
        /// Failures in a row.
        in_a_row: u8,
    },
    /// A recovery of the bus was started.
    Recovery,
    /// The bus is still blocked after [`super::STUCK_AFTER`] rounds.
    Stuck {
        /// Rounds so far.
        rounds: u16,
        /// SDA is low.
        sda_low: bool,
    },
    /// The multiplexer did not acknowledge [`super::MAX_MUX_NACKS`] selects in a row, or read back
    /// another mask as often.
    MuxSilent {
        /// Mask of the last one.
        mask: u8,
        /// Mask that was read back; 0xFF: no answer.
        found: u8,
    },
}

/// Destination of events: a queue in the hardware half, a vector in tests.
pub trait Sink {
    /// Takes an event. Does not block.
    fn event(&mut self, event: Event);
}

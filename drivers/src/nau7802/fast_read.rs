//! The NAU7802's fast read (FRD), and why the sample path doesn't use it.
//!
//! # What it is
//! * Confirmed (register description of 0x11 bit 6): "enable fast read", a *special non-standard
//!   I2C* feature that also needs bit 7 of register 0x15 set.
//!   [`Config::fast_read`](super::Config::fast_read) sets both bits.
//! * Inferred, **unconfirmed on silicon**: a fast read is 33 clocks where the plain one is 54. 33
//!   is one address byte with its acknowledge (9 clocks) and 24 data bits with no acknowledge slots
//!   between them, most significant bit first; the register address is implied. No other split
//!   gives 33.
//!
//! # Why the firmware leaves it off
//! A hardware I2C controller always clocks nine bits a byte. Without the acknowledge slots it would
//! lose two data bits and shift the rest, so a fast read has to be bit-banged. The interrupt-driven
//! sample path would pay more in CPU time than the 21 clocks (52 us at 400 kHz) that it saves on
//! the bus.
//!
//! What is here: the frame as a pure iterator ([`steps`]), its decoder ([`FrameDecoder`]), and a
//! bit-banged reader on embedded-hal pins ([`FastReader`]) to try it on a bench.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

use super::code::AdcCode;
use super::regs::ADDRESS;

/// SCL clocks of a fast read: address byte, acknowledge and 24 data bits.
pub const CLOCKS: u32 = 9 + DATA_BITS;
const DATA_BITS: u32 = 24;

/// One step of the frame. [`Step::Drive`], [`Step::SampleAck`] and [`Step::SampleBit`] are one SCL
/// clock each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// START: SDA falls while SCL is high.
    Start,
    /// Put this bit on SDA for one clock.
    Drive(bool),
    /// Release SDA and sample the acknowledge: low is yes.
    SampleAck,
    /// Sample a data bit for [`FrameDecoder::push`].
    SampleBit,
    /// STOP: SDA rises while SCL is high.
    Stop,
}

/// The steps of a fast read in order.
pub fn steps() -> impl Iterator<Item = Step> {
    const READ: u8 = (ADDRESS << 1) | 1;
    core::iter::once(Step::Start)
        .chain((0..8).rev().map(|bit| Step::Drive(READ & (1 << bit) != 0)))
        .chain(core::iter::once(Step::SampleAck))
        .chain((0..DATA_BITS).map(|_| Step::SampleBit))
        .chain(core::iter::once(Step::Stop))
}

/// Collects the 24 data bits.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameDecoder {
    bits: u32,
    count: u32,
}

impl FrameDecoder {
    /// Takes the next bit; bits past the 24th are ignored.
    pub fn push(&mut self, high: bool) {
        if self.count < DATA_BITS {
            self.bits = (self.bits << 1) | u32::from(high);
            self.count += 1;
        }
    }

    /// The sample, once all 24 bits are in.
    pub fn finish(self) -> Option<AdcCode> {
        let [_, high, middle, low] = self.bits.to_be_bytes();
        (self.count == DATA_BITS).then(|| AdcCode::from_be_bytes([high, middle, low]))
    }
}

/// What can go wrong in [`FastReader::read`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FastReadError<E> {
    /// The part didn't acknowledge its address.
    NoAcknowledge,
    /// Fewer than 24 bits came in: cannot happen with [`steps`].
    Incomplete,
    /// A pin failed.
    Pin(E),
}

impl<E: core::fmt::Debug> core::fmt::Display for FastReadError<E> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoAcknowledge => f.write_str("NAU7802 fast read: no acknowledge; is FRD set?"),
            Self::Incomplete => f.write_str("NAU7802 fast read: frame incomplete"),
            Self::Pin(source) => write!(f, "NAU7802 fast read: pin failed: {source:?}"),
        }
    }
}

impl<E: core::fmt::Debug> core::error::Error for FastReadError<E> {}

/// Bit-banged fast reads over two open-drain pins with pull-ups.
#[derive(Debug)]
pub struct FastReader<SCL, SDA, D> {
    scl: SCL,
    sda: SDA,
    delay: D,
    half_period_ns: u32,
}

impl<SCL, SDA, D, E> FastReader<SCL, SDA, D>
where
    SCL: OutputPin<Error = E>,
    SDA: OutputPin<Error = E> + InputPin<Error = E>,
    D: DelayNs,
{
    /// Takes idle pins (both high). `half_period_ns` is at least 1250 for 400 kHz.
    pub fn new(scl: SCL, sda: SDA, delay: D, half_period_ns: u32) -> Self {
        Self {
            scl,
            sda,
            delay,
            half_period_ns,
        }
    }

    /// Reads one sample. Call it after DRDY; before it, the previous result comes again.
    ///
    /// # Errors
    /// [`FastReadError`]; the bus is idle again afterwards unless a pin failed.
    pub fn read(&mut self) -> Result<AdcCode, FastReadError<E>> {
        let mut decoder = FrameDecoder::default();
        let mut acknowledged = true;
        for step in steps() {
            match step {
                Step::Start => {
                    self.sda.set_low().map_err(FastReadError::Pin)?;
                    self.half_period();
                    self.scl.set_low().map_err(FastReadError::Pin)?;
                }
                Step::Drive(bit) => {
                    self.sda.set_state(bit.into()).map_err(FastReadError::Pin)?;
                    self.clock()?;
                }
                Step::SampleAck => {
                    self.sda.set_high().map_err(FastReadError::Pin)?;
                    acknowledged = !self.clock()?;
                }
                Step::SampleBit if acknowledged => decoder.push(self.clock()?),
                Step::SampleBit => {}
                Step::Stop => {
                    self.sda.set_low().map_err(FastReadError::Pin)?;
                    self.half_period();
                    self.scl.set_high().map_err(FastReadError::Pin)?;
                    self.half_period();
                    self.sda.set_high().map_err(FastReadError::Pin)?;
                }
            }
        }
        if !acknowledged {
            return Err(FastReadError::NoAcknowledge);
        }
        decoder.finish().ok_or(FastReadError::Incomplete)
    }

    /// Gives the pins back.
    pub fn release(self) -> (SCL, SDA, D) {
        (self.scl, self.sda, self.delay)
    }

    fn half_period(&mut self) {
        self.delay.delay_ns(self.half_period_ns);
    }

    /// One SCL clock; returns SDA as it stood while SCL was high.
    fn clock(&mut self) -> Result<bool, FastReadError<E>> {
        self.half_period();
        self.scl.set_high().map_err(FastReadError::Pin)?;
        self.half_period();
        let high = self.sda.is_high().map_err(FastReadError::Pin)?;
        self.scl.set_low().map_err(FastReadError::Pin)?;
        Ok(high)
    }
}

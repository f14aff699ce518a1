//! Blocking TCA9548A driver on embedded-hal 1.0.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{ErrorType, OutputPin, PinState};
use embedded_hal::i2c::I2c;

use super::selector::{Address, ChannelMask, MuxState, ReadBackError, Selector};

/// Length of the reset pulse, nanoseconds. The part needs 6 ns, and takes up to 500 ns to release
/// SDA (SCPS207F section 6.7); this is generous to slow edges.
pub const RESET_PULSE_NS: u32 = 1_000;
/// From the end of the reset pulse to the next START, nanoseconds. The part needs 0 ns (section
/// 6.7).
pub const RESET_RECOVERY_NS: u32 = 1_000;

/// What failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Operation {
    /// Writing the mask.
    WriteMask = 1,
    /// Reading the mask.
    ReadMask = 2,
}

/// Error of the blocking driver: `E` of the bus, `P` of the reset pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E, P> {
    /// A transaction with the mux failed; its mask is unknown now.
    Bus {
        /// Direction of the transaction.
        operation: Operation,
        /// Mask that was written or expected; zero for a plain read.
        mask: ChannelMask,
        /// Error of the bus.
        source: E,
    },
    /// The mux holds another mask than was written.
    ReadBack(ReadBackError),
    /// The reset pin could not be driven.
    ResetPin(P),
}

impl<E, P> Error<E, P> {
    /// For a fault record: number of the failure (1 write, 2 read, 3 read-back, 4 reset pin),
    /// expected mask and mask found, from the third byte down.
    pub fn detail(&self) -> u32 {
        let (number, expected, found) = match self {
            Self::Bus {
                operation, mask, ..
            } => (*operation as u8, mask.bits(), 0),
            Self::ReadBack(error) => (3, error.expected.bits(), error.found.bits()),
            Self::ResetPin(_) => (4, 0, 0),
        };
        u32::from_be_bytes([0, number, expected, found])
    }
}

impl<E: core::fmt::Debug, P: core::fmt::Debug> core::fmt::Display for Error<E, P> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus {
                operation: Operation::WriteMask,
                mask,
                source,
            } => write!(
                f,
                "TCA9548A write of mask 0x{:02X}: bus error {source:?}; clear the bus, then reset the mux",
                mask.bits()
            ),
            Self::Bus {
                operation: Operation::ReadMask,
                source,
                ..
            } => write!(f, "TCA9548A read of the mask: bus error {source:?}; clear the bus, then reset the mux"),
            Self::ReadBack(error) => write!(f, "{error}"),
            Self::ResetPin(source) => write!(f, "TCA9548A RESET: pin failed: {source:?}"),
        }
    }
}

impl<E: core::fmt::Debug, P: core::fmt::Debug> core::error::Error for Error<E, P> {}

/// Stands in for the reset line where RESET is tied high.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoResetLine;

impl ErrorType for NoResetLine {
    type Error = core::convert::Infallible;
}

impl OutputPin for NoResetLine {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    fn set_state(&mut self, _state: PinState) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// A TCA9548A with its reset line.
#[derive(Debug)]
pub struct Tca9548<I2C, RST> {
    i2c: I2C,
    reset: RST,
    address: Address,
    selector: Selector,
}

impl<I2C: I2c, RST: OutputPin> Tca9548<I2C, RST> {
    /// Takes the bus and the reset line (active low, idle high). Nothing is sent.
    pub const fn new(i2c: I2C, reset: RST, address: Address) -> Self {
        Self {
            i2c,
            reset,
            address,
            selector: Selector::new(),
        }
    }

    /// What is known of the mask.
    pub const fn state(&self) -> MuxState {
        self.selector.state()
    }

    /// Switches to a set of channels; sends nothing if it is in force already.
    ///
    /// # Errors
    /// [`Error::Bus`]; the mask is unknown then.
    pub fn select(&mut self, mask: ChannelMask) -> Result<(), Error<I2C::Error, RST::Error>> {
        let Some(byte) = self.selector.request(mask) else {
            return Ok(());
        };
        match self.i2c.write(self.address.get(), &byte) {
            Ok(()) => {
                self.selector.written(mask);
                Ok(())
            }
            Err(source) => Err(Error::Bus {
                operation: Operation::WriteMask,
                mask,
                source,
            }),
        }
    }

    /// Switches to a set of channels and reads the mask back, even if it was in force already.
    ///
    /// # Errors
    /// [`Error::Bus`] or [`Error::ReadBack`]; the mask is unknown then.
    pub fn select_verified(
        &mut self,
        mask: ChannelMask,
    ) -> Result<(), Error<I2C::Error, RST::Error>> {
        self.select(mask)?;
        let found = self.read_mask_for(mask)?;
        self.selector
            .check_read_back(mask, found.bits())
            .map_err(Error::ReadBack)
    }

    /// Reads the mask that the part holds. Does not change [`Self::state`], except on a failure.
    ///
    /// # Errors
    /// [`Error::Bus`]; the mask is unknown then.
    pub fn read_mask(&mut self) -> Result<ChannelMask, Error<I2C::Error, RST::Error>> {
        self.read_mask_for(ChannelMask::NONE)
    }

    fn read_mask_for(
        &mut self,
        mask: ChannelMask,
    ) -> Result<ChannelMask, Error<I2C::Error, RST::Error>> {
        let mut byte = [0];
        match self.i2c.read(self.address.get(), &mut byte) {
            Ok(()) => Ok(ChannelMask::from_bits(byte[0])),
            Err(source) => {
                self.selector.invalidate();
                Err(Error::Bus {
                    operation: Operation::ReadMask,
                    mask,
                    source,
                })
            }
        }
    }

    /// Forgets what is known of the mask. Call it after any failed transaction behind the mux.
    pub fn invalidate(&mut self) {
        self.selector.invalidate();
    }

    /// Pulses the reset line: clears the mask and frees a hung bus state machine. The mask counts
    /// as unknown afterwards, so that the next selection is written whatever the reset did.
    ///
    /// # Errors
    /// [`Error::ResetPin`].
    pub fn reset(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<I2C::Error, RST::Error>> {
        self.selector.invalidate();
        self.reset.set_low().map_err(Error::ResetPin)?;
        delay.delay_ns(RESET_PULSE_NS);
        self.reset.set_high().map_err(Error::ResetPin)?;
        delay.delay_ns(RESET_RECOVERY_NS);
        Ok(())
    }

    /// The bus, for transactions behind the mux.
    pub fn bus(&mut self) -> &mut I2C {
        &mut self.i2c
    }

    /// Gives the bus and the reset line back.
    pub fn release(self) -> (I2C, RST) {
        (self.i2c, self.reset)
    }
}

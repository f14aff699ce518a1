//! Blocking DAC7731 driver on embedded-hal 1.0.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{ErrorType, OutputPin, PinState};
use embedded_hal::spi::SpiBus;

use super::code::DacCode;

/// Length of the reset pulse, nanoseconds. Generous: our sources don't state the minimum.
pub const RESET_PULSE_NS: u32 = 1_000;
/// How long LDAC stays low before its rising edge, nanoseconds. Generous: our sources don't state
/// the minimum.
pub const LDAC_PULSE_NS: u32 = 100;

/// What failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Operation {
    /// CS falls.
    Select = 1,
    /// The 16 bits go out.
    Shift = 2,
    /// CS rises.
    Deselect = 3,
    /// LDAC falls and rises.
    Update = 4,
    /// RST falls and rises.
    Reset = 5,
}

/// Error of the blocking driver: `S` of the SPI bus, `P` of the pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<S, P> {
    /// The word could not be shifted out; the output keeps its value.
    Spi(S),
    /// A line could not be driven.
    Pin {
        /// Which one.
        operation: Operation,
        /// Error of the pin.
        source: P,
    },
}

impl<S, P> Error<S, P> {
    /// For a fault record: the number of the [`Operation`].
    pub fn detail(&self) -> u32 {
        match self {
            Self::Spi(_) => Operation::Shift as u32,
            Self::Pin { operation, .. } => *operation as u32,
        }
    }
}

impl<S: core::fmt::Debug, P: core::fmt::Debug> core::fmt::Display for Error<S, P> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Spi(source) => write!(
                f,
                "DAC7731 input register: SPI error {source:?}; reset the part to 0 V"
            ),
            Self::Pin { operation, source } => {
                let line = match operation {
                    Operation::Select | Operation::Deselect => "CS",
                    Operation::Shift => "SPI",
                    Operation::Update => "LDAC",
                    Operation::Reset => "RST",
                };
                write!(
                    f,
                    "DAC7731 {line}: pin failed: {source:?}; remove motor power"
                )
            }
        }
    }
}

impl<S: core::fmt::Debug, P: core::fmt::Debug> core::error::Error for Error<S, P> {}

/// Stands in for a line that another owner drives, such as an LDAC or RST shared by all six parts.
#[derive(Debug)]
pub struct NoLine<P>(core::marker::PhantomData<P>);

impl<P> NoLine<P> {
    /// A missing line, with the error type of the others.
    pub const fn new() -> Self {
        Self(core::marker::PhantomData)
    }
}

impl<P> Default for NoLine<P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<P: ErrorType> ErrorType for NoLine<P> {
    type Error = P::Error;
}

impl<P: ErrorType> OutputPin for NoLine<P> {
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

/// A DAC7731 with its own CS, LDAC and RST.
///
/// The bus must run in [`super::SPI_MODE`]; CS belongs to the driver, not to the SPI peripheral,
/// because its rising edge has to come while SCLK idles high.
#[derive(Debug)]
pub struct Dac7731<SPI, CS, LDAC, RST> {
    spi: SPI,
    cs: CS,
    ldac: LDAC,
    rst: RST,
    loaded: Option<DacCode>,
    output: Option<DacCode>,
}

impl<SPI, CS, LDAC, RST, P> Dac7731<SPI, CS, LDAC, RST>
where
    SPI: SpiBus,
    CS: OutputPin<Error = P>,
    LDAC: OutputPin<Error = P>,
    RST: OutputPin<Error = P>,
{
    /// Takes the bus and the lines: CS idle high, LDAC idle high, RST idle high. Sends nothing and
    /// so doesn't know the output; call [`Self::reset`] first.
    pub const fn new(spi: SPI, cs: CS, ldac: LDAC, rst: RST) -> Self {
        Self {
            spi,
            cs,
            ldac,
            rst,
            loaded: None,
            output: None,
        }
    }

    /// What the output was last set to; `None` before the first reset or write and after a failure.
    pub const fn output(&self) -> Option<DacCode> {
        self.output
    }

    /// Forces the output to mid-scale, 0 V in the bipolar ranges. RSTSEL must be strapped high:
    /// with RSTSEL low the same pulse gives **negative full scale**.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn reset(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<SPI::Error, P>> {
        self.loaded = None;
        self.output = None;
        self.rst.set_low().map_err(pin(Operation::Reset))?;
        delay.delay_ns(RESET_PULSE_NS);
        self.rst.set_high().map_err(pin(Operation::Reset))?;
        // The reset overrides input and output registers alike (datasheet, features).
        self.loaded = Some(DacCode::MIDSCALE);
        self.output = Some(DacCode::MIDSCALE);
        Ok(())
    }

    /// Shifts a code into the input register without changing the output.
    ///
    /// # Errors
    /// [`Error::Spi`] or [`Error::Pin`]; the input register is unknown then and CS was raised if
    /// possible.
    pub fn load(&mut self, code: DacCode) -> Result<(), Error<SPI::Error, P>> {
        self.loaded = None;
        self.cs.set_low().map_err(pin(Operation::Select))?;
        // Flushed before CS rises: the last bit must be out and SCLK back at its high idle level.
        let shifted = self
            .spi
            .write(&code.to_frame())
            .and_then(|()| self.spi.flush());
        let deselected = self.cs.set_high().map_err(pin(Operation::Deselect));
        shifted.map_err(Error::Spi)?;
        deselected?;
        self.loaded = Some(code);
        Ok(())
    }

    /// Moves the input register to the output with a rising edge of LDAC.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn update(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<SPI::Error, P>> {
        self.output = None;
        self.ldac.set_low().map_err(pin(Operation::Update))?;
        delay.delay_ns(LDAC_PULSE_NS);
        self.ldac.set_high().map_err(pin(Operation::Update))?;
        self.output = self.loaded;
        Ok(())
    }

    /// [`Self::load`] and [`Self::update`]. If the load fails, LDAC stays still and the output with
    /// it.
    ///
    /// # Errors
    /// As the two.
    pub fn write(
        &mut self,
        code: DacCode,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<SPI::Error, P>> {
        self.load(code)?;
        self.update(delay)
    }

    /// Gives the bus and the lines back.
    pub fn release(self) -> (SPI, CS, LDAC, RST) {
        (self.spi, self.cs, self.ldac, self.rst)
    }
}

fn pin<S, P>(operation: Operation) -> impl FnOnce(P) -> Error<S, P> {
    move |source| Error::Pin { operation, source }
}

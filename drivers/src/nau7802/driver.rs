//! Blocking NAU7802 driver on embedded-hal 1.0.

use embedded_hal::delay::DelayNs;
use embedded_hal::i2c::I2c;

use super::bringup::{Action, Bringup, Cause, Event, SequenceError};
use super::code::{AdcCode, Coefficients};
use super::config::Config;
use super::proto;
use super::regs::{CalibrationMode, Channel, Gain, PuCtrl, Rate, Register, Revision, ADDRESS};
use super::settling::Settling;

/// What a transaction was about, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Operation {
    /// A register or a burst was read.
    Read = 1,
    /// A register or a burst was written.
    Write = 2,
}

/// Error of the blocking driver. `E` is the bus's own error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// A single transaction failed.
    Bus {
        /// First register of the transaction.
        register: Register,
        /// Direction of the transaction.
        operation: Operation,
        /// Error of the bus.
        source: E,
    },
    /// A bring-up, reconfiguration or calibration gave up.
    Sequence {
        /// Where and why.
        error: SequenceError,
        /// The last bus error, if that is why.
        source: Option<E>,
    },
}

impl<E> Error<E> {
    /// For a fault record. A sequence error gives [`SequenceError::detail`]; a single transaction
    /// gives stage 0, the operation's number, the register's address and 0.
    pub fn detail(&self) -> u32 {
        match self {
            Self::Bus {
                register,
                operation,
                ..
            } => u32::from_be_bytes([0, *operation as u8, register.address(), 0]),
            Self::Sequence { error, .. } => error.detail(),
        }
    }
}

impl<E: core::fmt::Debug> core::fmt::Display for Error<E> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus {
                register,
                operation,
                source,
            } => {
                let verb = match operation {
                    Operation::Read => "read",
                    Operation::Write => "write",
                };
                write!(f, "NAU7802 {verb} of {register}: bus error {source:?}; recover the bus and set the mux again")
            }
            Self::Sequence {
                error,
                source: None,
            } => write!(f, "{error}"),
            Self::Sequence {
                error,
                source: Some(source),
            } => write!(f, "{error} (bus error {source:?})"),
        }
    }
}

impl<E: core::fmt::Debug> core::error::Error for Error<E> {}

/// A NAU7802 on a bus, or on the selected channel of a mux.
#[derive(Debug)]
pub struct Nau7802<I2C> {
    i2c: I2C,
    config: Config,
    settling: Settling,
}

impl<I2C: I2c> Nau7802<I2C> {
    /// Takes the bus. Nothing is sent; call [`Self::bring_up`].
    pub const fn new(i2c: I2C, config: Config) -> Self {
        Self {
            i2c,
            config,
            settling: Settling::over(),
        }
    }

    /// The settings in force after the last successful sequence.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Resets, configures, verifies, calibrates and starts the part; about 0.6 s.
    ///
    /// # Errors
    /// [`Error::Sequence`] with the stage that gave up.
    pub fn bring_up(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<I2C::Error>> {
        self.run(Bringup::new(self.config), delay)
    }

    /// Changes all settings at once, calibrates on them and starts the part.
    ///
    /// # Errors
    /// [`Error::Sequence`]; the part's settings are unknown then, bring it up again.
    pub fn reconfigure(
        &mut self,
        config: Config,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<I2C::Error>> {
        self.run(Bringup::reconfigure(config), delay)?;
        self.config = config;
        Ok(())
    }

    /// Changes the gain; calibrates, as every change of gain requires.
    ///
    /// # Errors
    /// As [`Self::reconfigure`].
    pub fn set_gain(
        &mut self,
        gain: Gain,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<I2C::Error>> {
        self.reconfigure(
            Config {
                gain,
                ..self.config
            },
            delay,
        )
    }

    /// Changes the rate; calibrates, as every change of rate requires.
    ///
    /// # Errors
    /// As [`Self::reconfigure`].
    pub fn set_rate(
        &mut self,
        rate: Rate,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<I2C::Error>> {
        self.reconfigure(
            Config {
                rate,
                ..self.config
            },
            delay,
        )
    }

    /// Calibrates in the given mode and starts a fresh conversion cycle.
    ///
    /// # Errors
    /// [`Error::Sequence`]; after a calibration error the coefficients are invalid (section 8.6.3).
    pub fn calibrate(
        &mut self,
        mode: CalibrationMode,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<I2C::Error>> {
        self.run(Bringup::calibrate(self.config, mode), delay)
    }

    /// Reads the conversion result. Wait for DRDY first: an early read repeats the previous result,
    /// and counts as one. `None`: one of the [`Settling::RESULTS`] that follow a start, a
    /// calibration or a change, which are discarded. Before the first call after one of these, read
    /// and drop a result that is ready already.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn read(&mut self) -> Result<Option<AdcCode>, Error<I2C::Error>> {
        let mut bytes = [0; proto::READ_ADC_LEN];
        self.read_burst(Register::Adco, &mut bytes)?;
        Ok(self.settling.result().then_some(proto::decode_adc(bytes)))
    }

    /// Reads PU_CTRL. Its conversion-ready bit is no substitute for the DRDY pin.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn status(&mut self) -> Result<PuCtrl, Error<I2C::Error>> {
        self.read_register(Register::PuCtrl)
            .map(proto::decode_status)
    }

    /// Reads the revision.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn revision(&mut self) -> Result<Revision, Error<I2C::Error>> {
        self.read_register(Register::Revision)
            .map(proto::decode_revision)
    }

    /// Reads the calibration coefficients of a channel, to keep them over a power cycle.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn coefficients(&mut self, channel: Channel) -> Result<Coefficients, Error<I2C::Error>> {
        let mut bytes = [0; Coefficients::LEN];
        self.read_burst(Coefficients::register(channel), &mut bytes)?;
        Ok(Coefficients::from_be_bytes(bytes))
    }

    /// Writes the calibration coefficients of a channel.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn set_coefficients(
        &mut self,
        channel: Channel,
        value: Coefficients,
    ) -> Result<(), Error<I2C::Error>> {
        self.i2c
            .write(ADDRESS, &proto::write_coefficients(channel, value))
            .map_err(|source| Error::Bus {
                register: Coefficients::register(channel),
                operation: Operation::Write,
                source,
            })?;
        self.settling = Settling::begun();
        Ok(())
    }

    /// Starts the conversions (CS=1).
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn start(&mut self) -> Result<(), Error<I2C::Error>> {
        let value = self.config.pu_ctrl().with_cycle_start(true).bits();
        self.write_register(Register::PuCtrl, value)?;
        self.settling = Settling::begun();
        Ok(())
    }

    /// Stops the conversions (CS=0); everything else stays powered and set. Published drivers never
    /// set CS, so parts may convert without it: DRDY may go on.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn stop(&mut self) -> Result<(), Error<I2C::Error>> {
        self.write_register(Register::PuCtrl, self.config.pu_ctrl().bits())
    }

    /// Powers the analog and digital parts down. Bring up again afterwards.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn power_down(&mut self) -> Result<(), Error<I2C::Error>> {
        self.write_register(Register::PuCtrl, 0)
    }

    /// Reads one register.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn read_register(&mut self, register: Register) -> Result<u8, Error<I2C::Error>> {
        let mut byte = [0];
        self.read_burst(register, &mut byte)?;
        Ok(byte[0])
    }

    /// Writes one register. Prefer [`Self::reconfigure`]: the driver doesn't see what this changes.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn write_register(
        &mut self,
        register: Register,
        value: u8,
    ) -> Result<(), Error<I2C::Error>> {
        self.i2c
            .write(ADDRESS, &proto::write_register(register, value))
            .map_err(|source| Error::Bus {
                register,
                operation: Operation::Write,
                source,
            })
    }

    /// Gives the bus back.
    pub fn release(self) -> I2C {
        self.i2c
    }

    fn read_burst(
        &mut self,
        register: Register,
        bytes: &mut [u8],
    ) -> Result<(), Error<I2C::Error>> {
        self.i2c
            .write_read(ADDRESS, &[register.address()], bytes)
            .map_err(|source| Error::Bus {
                register,
                operation: Operation::Read,
                source,
            })
    }

    /// Carries out a sequence to its end.
    fn run(
        &mut self,
        mut sequence: Bringup,
        delay: &mut impl DelayNs,
    ) -> Result<(), Error<I2C::Error>> {
        // A sequence that fails leaves results that nobody may use.
        self.settling = Settling::begun();
        let mut bus_error = None;
        let mut event = Event::Start;
        loop {
            event = match sequence.next(event) {
                Action::Write(bytes) => match self.i2c.write(ADDRESS, &bytes) {
                    Ok(()) => Event::Written,
                    Err(source) => {
                        bus_error = Some(source);
                        Event::BusFault
                    }
                },
                Action::WriteRead(register) => {
                    let mut byte = [0];
                    match self.i2c.write_read(ADDRESS, &register, &mut byte) {
                        Ok(()) => Event::Read(byte[0]),
                        Err(source) => {
                            bus_error = Some(source);
                            Event::BusFault
                        }
                    }
                }
                Action::WaitUs(us) => {
                    delay.delay_us(us);
                    Event::Waited
                }
                Action::Done => {
                    self.settling = Settling::begun();
                    return Ok(());
                }
                Action::Failed(error) => {
                    // A bus error before a successful restart is not the cause of a later failed
                    // check.
                    let source = if error.cause == Cause::Bus {
                        bus_error
                    } else {
                        None
                    };
                    return Err(Error::Sequence { error, source });
                }
            };
        }
    }
}

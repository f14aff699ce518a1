//! Blocking LS7266R1 driver over a [`ParallelBus`].

use super::bus::{ParallelBus, Port, Target};
use super::count::CounterValue;
use super::proto::{self, BusOp};
use super::regs::{Axis, Flags, QuadratureMode};

/// Settings of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// How the encoder is counted.
    pub mode: QuadratureMode,
    /// The filter clock is FCK / (prescaler + 1); it must be at least eight times the line
    /// frequency.
    pub prescaler: u8,
}

impl Config {
    /// A motor encoder of the Raven: x4, filter at the full clock.
    pub const MOTOR_ENCODER: Self = Self {
        mode: QuadratureMode::X4,
        prescaler: 0,
    };
}

numbered! {
    /// Procedure that failed. The number goes into fault records: never renumber.
    Stage,
    /// Register or path that the stage is about, for messages.
    register {
        /// Registers of the set-up (IOR, PSC, CMR, IDR).
        Configure = 1, "IOR/PSC/CMR/IDR";
        /// Patterns through PR, CNTR and OL.
        SelfTest = 2, "PR -> CNTR -> OL";
        /// Clearing (RLD) and enabling the inputs (IOR).
        Start = 3, "RLD/IOR";
        /// Latch and read (RLD, OL).
        ReadCounter = 4, "OL";
        /// PR to CNTR.
        LoadCounter = 5, "PR";
        /// FLAG.
        ReadFlags = 6, "FLAG";
        /// Reset of E.
        ClearNoise = 7, "RLD";
    }
}

/// Error of the driver. `E` is the bus's own error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// A bus cycle failed.
    Bus {
        /// Which counter.
        target: Target,
        /// In which procedure.
        stage: Stage,
        /// Error of the bus.
        source: E,
    },
    /// A counter returned another value than was loaded into it.
    SelfTest {
        /// Which counter.
        target: Target,
        /// Value loaded.
        wrote: CounterValue,
        /// Value read.
        found: CounterValue,
    },
}

impl<E> Error<E> {
    /// For a fault record: stage, chip and axis from the top byte down; the low byte holds the data
    /// lines that differed in the self-test.
    pub fn detail(&self) -> u32 {
        let (stage, target, lines) = match self {
            Self::Bus { target, stage, .. } => (*stage, target, 0),
            Self::SelfTest {
                target,
                wrote,
                found,
            } => {
                let [low, middle, high, _] = (wrote.get() ^ found.get()).to_le_bytes();
                (Stage::SelfTest, target, low | middle | high)
            }
        };
        u32::from_be_bytes([stage as u8, target.chip, target.axis as u8, lines])
    }
}

impl<E: core::fmt::Debug> core::fmt::Display for Error<E> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Bus { target, stage, source } => write!(
                f,
                "LS7266R1 chip {} axis {:?}, {}: bus error {source:?}",
                target.chip,
                target.axis,
                stage.register()
            ),
            Self::SelfTest { target, wrote, found } => write!(
                f,
                "LS7266R1 chip {} axis {:?}, {}: wrote 0x{:06X}, read 0x{:06X}; check power, CS# and the data lines",
                target.chip,
                target.axis,
                Stage::SelfTest.register(),
                wrote.get(),
                found.get()
            ),
        }
    }
}

impl<E: core::fmt::Debug> core::error::Error for Error<E> {}

/// The counters on one parallel bus.
#[derive(Debug)]
pub struct Ls7266r1<B> {
    bus: B,
}

impl<B: ParallelBus> Ls7266r1<B> {
    /// Takes the bus. Nothing is sent.
    pub const fn new(bus: B) -> Self {
        Self { bus }
    }

    /// Sets an axis up, tests it and starts counting from 0.
    ///
    /// The part's settings can't be read back; the self-test through PR, CNTR and OL with the
    /// inputs off shows at least that every data line, the strobes and the byte pointer work.
    ///
    /// # Errors
    /// [`Error::Bus`], or [`Error::SelfTest`]: the axis is left with its inputs off.
    pub fn init(&mut self, target: Target, config: Config) -> Result<(), Error<B::Error>> {
        let ops = proto::configure(target.axis, config.mode, config.prescaler);
        self.run(target.chip, Stage::Configure, &ops, &mut [])?;
        for wrote in proto::SELF_TEST_PATTERNS {
            self.run(
                target.chip,
                Stage::SelfTest,
                &proto::load_counter(target.axis, wrote),
                &mut [],
            )?;
            let mut bytes = [0; 3];
            self.run(
                target.chip,
                Stage::SelfTest,
                &proto::read_counter(target.axis),
                &mut bytes,
            )?;
            let found = proto::decode_counter(bytes);
            if found != wrote {
                return Err(Error::SelfTest {
                    target,
                    wrote,
                    found,
                });
            }
        }
        self.run(
            target.chip,
            Stage::Start,
            &proto::start(target.axis),
            &mut [],
        )
    }

    /// Reads one counter.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn read(&mut self, target: Target) -> Result<CounterValue, Error<B::Error>> {
        let mut bytes = [0; 3];
        self.run(
            target.chip,
            Stage::ReadCounter,
            &proto::read_counter(target.axis),
            &mut bytes,
        )?;
        Ok(proto::decode_counter(bytes))
    }

    /// Reads X and Y of one chip as they stood at the same instant.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn read_both(&mut self, chip: u8) -> Result<(CounterValue, CounterValue), Error<B::Error>> {
        let mut bytes = [0; 6];
        self.run(
            chip,
            Stage::ReadCounter,
            &proto::READ_BOTH_COUNTERS,
            &mut bytes,
        )?;
        let [x0, x1, x2, y0, y1, y2] = bytes;
        Ok((
            proto::decode_counter([x0, x1, x2]),
            proto::decode_counter([y0, y1, y2]),
        ))
    }

    /// Sets one counter.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn load(&mut self, target: Target, value: CounterValue) -> Result<(), Error<B::Error>> {
        self.run(
            target.chip,
            Stage::LoadCounter,
            &proto::load_counter(target.axis, value),
            &mut [],
        )
    }

    /// Reads the flags of one axis.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn flags(&mut self, target: Target) -> Result<Flags, Error<B::Error>> {
        let mut byte = [0];
        self.run(
            target.chip,
            Stage::ReadFlags,
            &proto::read_flags(target.axis),
            &mut byte,
        )?;
        Ok(proto::decode_flags(byte[0]))
    }

    /// Clears the sticky noise flag of one axis.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn clear_noise_flag(&mut self, target: Target) -> Result<(), Error<B::Error>> {
        self.run(
            target.chip,
            Stage::ClearNoise,
            &proto::clear_noise_flag(target.axis),
            &mut [],
        )
    }

    /// Gives the bus back.
    pub fn release(self) -> B {
        self.bus
    }

    /// Performs bus operations on one chip; reads fill `bytes` in order.
    fn run(
        &mut self,
        chip: u8,
        stage: Stage,
        ops: &[BusOp],
        bytes: &mut [u8],
    ) -> Result<(), Error<B::Error>> {
        let mut slots = bytes.iter_mut();
        for &op in ops {
            let on = |axis: Axis| Target { chip, axis };
            let (target, result) = match op {
                BusOp::WriteControl(axis, byte) => {
                    (on(axis), self.bus.write(on(axis), Port::Control, byte))
                }
                BusOp::WriteData(axis, byte) => {
                    (on(axis), self.bus.write(on(axis), Port::Data, byte))
                }
                BusOp::ReadFlags(axis) => (
                    on(axis),
                    store(self.bus.read(on(axis), Port::Control), &mut slots),
                ),
                BusOp::ReadData(axis) => (
                    on(axis),
                    store(self.bus.read(on(axis), Port::Data), &mut slots),
                ),
            };
            result.map_err(|source| Error::Bus {
                target,
                stage,
                source,
            })?;
        }
        Ok(())
    }
}

/// Puts a byte that was read into the next slot.
fn store<'a, E>(
    read: Result<u8, E>,
    slots: &mut impl Iterator<Item = &'a mut u8>,
) -> Result<(), E> {
    let byte = read?;
    if let Some(slot) = slots.next() {
        *slot = byte;
    }
    Ok(())
}

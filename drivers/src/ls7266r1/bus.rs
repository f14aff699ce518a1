//! The parallel bus to the counters: the trait, and an implementation on embedded-hal pins.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

use super::regs::Axis;

/// Which counter: chip select line and axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Target {
    /// Index of the chip select line.
    pub chip: u8,
    /// Axis of that chip.
    pub axis: Axis,
}

/// Level of C/D#.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Port {
    /// C/D# high: control registers and FLAG.
    Control,
    /// C/D# low: PR and OL.
    Data,
}

/// One 8-bit bus with a chip select line per counter chip.
///
/// An implementation keeps the part's timing: WR# low for at least 45 ns, RD# low for at least 80
/// ns before the data is taken, 90 ns between reads; CS#, C/D# and X/Y# stand before the strobe
/// falls.
pub trait ParallelBus {
    /// What can fail; `Infallible` for plain register writes.
    type Error;

    /// One write cycle.
    ///
    /// # Errors
    /// Whatever the hardware reports.
    fn write(&mut self, target: Target, port: Port, byte: u8) -> Result<(), Self::Error>;

    /// One read cycle.
    ///
    /// # Errors
    /// Whatever the hardware reports.
    fn read(&mut self, target: Target, port: Port) -> Result<u8, Self::Error>;
}

impl<B: ParallelBus + ?Sized> ParallelBus for &mut B {
    type Error = B::Error;

    fn write(&mut self, target: Target, port: Port, byte: u8) -> Result<(), Self::Error> {
        (**self).write(target, port, byte)
    }

    fn read(&mut self, target: Target, port: Port) -> Result<u8, Self::Error> {
        (**self).read(target, port)
    }
}

/// Eight data lines that can change direction; embedded-hal has no trait for that.
pub trait DataPort {
    /// Error of the lines.
    type Error;

    /// Drives the lines with a byte.
    ///
    /// # Errors
    /// Whatever the lines report.
    fn drive(&mut self, byte: u8) -> Result<(), Self::Error>;

    /// Releases the lines, so that the counter may drive them.
    ///
    /// # Errors
    /// Whatever the lines report.
    fn release(&mut self) -> Result<(), Self::Error>;

    /// Samples the lines.
    ///
    /// # Errors
    /// Whatever the lines report.
    fn sample(&mut self) -> Result<u8, Self::Error>;
}

/// A [`DataPort`] of eight open-drain pins with pull-ups, D0 first.
#[derive(Debug)]
pub struct OpenDrainPort<P>(pub [P; 8]);

impl<P: OutputPin + InputPin> DataPort for OpenDrainPort<P> {
    type Error = P::Error;

    fn drive(&mut self, byte: u8) -> Result<(), Self::Error> {
        for (bit, pin) in self.0.iter_mut().enumerate() {
            pin.set_state((byte & (1 << bit) != 0).into())?;
        }
        Ok(())
    }

    fn release(&mut self) -> Result<(), Self::Error> {
        self.drive(0xFF)
    }

    fn sample(&mut self) -> Result<u8, Self::Error> {
        let mut byte = 0;
        for (bit, pin) in self.0.iter_mut().enumerate() {
            if pin.is_high()? {
                byte |= 1 << bit;
            }
        }
        Ok(byte)
    }
}

/// Error of [`GpioBus`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum GpioBusError<E> {
    /// There is no chip select line of that index.
    NoSuchChip(u8),
    /// A pin failed.
    Pin(E),
}

impl<E: core::fmt::Debug> core::fmt::Display for GpioBusError<E> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoSuchChip(chip) => write!(f, "LS7266R1 bus: no chip select line {chip}"),
            Self::Pin(source) => write!(f, "LS7266R1 bus: pin failed: {source:?}"),
        }
    }
}

impl<E: core::fmt::Debug> core::error::Error for GpioBusError<E> {}

/// The bus on embedded-hal pins, for `N` chips. All strobes and selects idle high.
#[derive(Debug)]
pub struct GpioBus<D, PIN, const N: usize, DELAY> {
    /// Data lines.
    pub data: D,
    /// C/D#: high for control.
    pub control: PIN,
    /// X/Y#: low for X.
    pub axis: PIN,
    /// RD#, active low.
    pub read: PIN,
    /// WR#, active low.
    pub write: PIN,
    /// CS# of each chip, active low.
    pub chips: [PIN; N],
    /// For the widths of the strobes.
    pub delay: DELAY,
}

/// Width of the WR# pulse, nanoseconds (the part needs 45).
const WRITE_NS: u32 = 60;
/// Width of the RD# pulse, nanoseconds (the part needs 80).
const READ_NS: u32 = 100;
/// Pause after a strobe, nanoseconds (the part needs 90 between reads).
const RECOVERY_NS: u32 = 100;

impl<D, PIN, const N: usize, DELAY> GpioBus<D, PIN, N, DELAY>
where
    PIN: OutputPin,
    D: DataPort<Error = PIN::Error>,
    DELAY: DelayNs,
{
    fn address(&mut self, target: Target, port: Port) -> Result<(), GpioBusError<PIN::Error>> {
        let chip = self
            .chips
            .get_mut(usize::from(target.chip))
            .ok_or(GpioBusError::NoSuchChip(target.chip))?;
        self.control
            .set_state((port == Port::Control).into())
            .map_err(GpioBusError::Pin)?;
        self.axis
            .set_state((target.axis == Axis::Y).into())
            .map_err(GpioBusError::Pin)?;
        chip.set_low().map_err(GpioBusError::Pin)
    }

    /// Brings every line back to idle, whatever happened before.
    fn idle(&mut self, target: Target) -> Result<(), PIN::Error> {
        let read = self.read.set_high();
        let write = self.write.set_high();
        let chip = match self.chips.get_mut(usize::from(target.chip)) {
            Some(chip) => chip.set_high(),
            None => Ok(()),
        };
        let data = self.data.release();
        self.delay.delay_ns(RECOVERY_NS);
        read.and(write).and(chip).and(data)
    }

    fn strobe_write(&mut self, byte: u8) -> Result<(), PIN::Error> {
        self.data.drive(byte)?;
        self.write.set_low()?;
        self.delay.delay_ns(WRITE_NS);
        // Data is taken on this edge, so it comes before the lines are released.
        self.write.set_high()
    }

    fn strobe_read(&mut self) -> Result<u8, PIN::Error> {
        self.data.release()?;
        self.read.set_low()?;
        self.delay.delay_ns(READ_NS);
        self.data.sample()
    }
}

impl<D, PIN, const N: usize, DELAY> ParallelBus for GpioBus<D, PIN, N, DELAY>
where
    PIN: OutputPin,
    D: DataPort<Error = PIN::Error>,
    DELAY: DelayNs,
{
    type Error = GpioBusError<PIN::Error>;

    fn write(&mut self, target: Target, port: Port, byte: u8) -> Result<(), Self::Error> {
        self.address(target, port)?;
        let strobe = self.strobe_write(byte);
        let idle = self.idle(target);
        strobe.and(idle).map_err(GpioBusError::Pin)
    }

    fn read(&mut self, target: Target, port: Port) -> Result<u8, Self::Error> {
        self.address(target, port)?;
        let byte = self.strobe_read();
        let idle = self.idle(target);
        let byte = byte.map_err(GpioBusError::Pin)?;
        idle.map_err(GpioBusError::Pin)?;
        Ok(byte)
    }
}

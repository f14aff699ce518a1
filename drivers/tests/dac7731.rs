//! The DAC7731 driver against expected transactions and a shift-register model; its codes against
//! oracles.

use drivers::dac7731::{
    Dac7731, DacCode, Error, NoLine, Operation, Range, LDAC_PULSE_NS, RESET_PULSE_NS, SPI_MODE,
};
use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_hal::spi::{ErrorType, SpiBus, MODE_3};
use embedded_hal_mock::eh1::delay::{CheckedDelay, NoopDelay, Transaction as Delay};
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinTransaction};
use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};
use embedded_hal_mock::eh1::MockError;
use proptest::prelude::*;
use std::cell::RefCell;
use std::rc::Rc;

fn low_high() -> Pin {
    Pin::new(&[
        PinTransaction::set(State::Low),
        PinTransaction::set(State::High),
    ])
}

fn untouched() -> Pin {
    Pin::new(&[])
}

#[test]
fn writes_a_word_and_updates() {
    let spi = Spi::new(&[
        Transaction::write_vec(vec![0x8D, 0x3B]),
        Transaction::flush(),
    ]);
    let mut delay = CheckedDelay::new(&[Delay::delay_ns(LDAC_PULSE_NS)]);
    let mut dac = Dac7731::new(spi, low_high(), low_high(), untouched());
    assert_eq!(dac.output(), None);
    dac.write(DacCode::from_signed(3387), &mut delay).unwrap();
    assert_eq!(dac.output(), Some(DacCode::from_offset_binary(0x8D3B)));
    let (mut spi, mut cs, mut ldac, mut rst) = dac.release();
    spi.done();
    cs.done();
    ldac.done();
    rst.done();
    delay.done();
}

#[test]
fn reset_is_zero_volts() {
    let mut delay = CheckedDelay::new(&[Delay::delay_ns(RESET_PULSE_NS)]);
    let mut dac = Dac7731::new(Spi::<u8>::new(&[]), untouched(), untouched(), low_high());
    dac.reset(&mut delay).unwrap();
    assert_eq!(dac.output().unwrap().microvolts(Range::PlusMinus10V), 0);
    let (mut spi, mut cs, mut ldac, mut rst) = dac.release();
    spi.done();
    cs.done();
    ldac.done();
    rst.done();
    delay.done();
}

#[test]
fn load_waits_for_the_common_update() {
    let spi = Spi::new(&[
        Transaction::write_vec(vec![0x80, 0x00]),
        Transaction::flush(),
    ]);
    let mut dac = Dac7731::new(spi, low_high(), NoLine::<Pin>::new(), NoLine::<Pin>::new());
    dac.load(DacCode::MIDSCALE).unwrap();
    assert_eq!(dac.output(), None, "not on the output yet");
    dac.update(&mut NoopDelay::new()).unwrap();
    assert_eq!(dac.output(), Some(DacCode::MIDSCALE));
    let (mut spi, mut cs, ..) = dac.release();
    spi.done();
    cs.done();
}

/// An SPI bus that fails.
struct Broken;

#[derive(Debug, PartialEq, Eq)]
struct Overrun;

impl embedded_hal::spi::Error for Overrun {
    fn kind(&self) -> embedded_hal::spi::ErrorKind {
        embedded_hal::spi::ErrorKind::Overrun
    }
}

impl ErrorType for Broken {
    type Error = Overrun;
}

impl SpiBus for Broken {
    fn read(&mut self, _: &mut [u8]) -> Result<(), Overrun> {
        Err(Overrun)
    }
    fn write(&mut self, _: &[u8]) -> Result<(), Overrun> {
        Err(Overrun)
    }
    fn transfer(&mut self, _: &mut [u8], _: &[u8]) -> Result<(), Overrun> {
        Err(Overrun)
    }
    fn transfer_in_place(&mut self, _: &mut [u8]) -> Result<(), Overrun> {
        Err(Overrun)
    }
    fn flush(&mut self) -> Result<(), Overrun> {
        Err(Overrun)
    }
}

#[test]
fn a_failed_transfer_deselects_and_never_updates() {
    let mut dac = Dac7731::new(Broken, low_high(), untouched(), untouched());
    let error = dac.write(DacCode::TOP, &mut NoopDelay::new()).unwrap_err();
    assert_eq!(error, Error::Spi(Overrun));
    assert_eq!(error.detail(), Operation::Shift as u32);
    assert!(error.to_string().contains("input register"), "{error}");
    let (_, mut cs, mut ldac, mut rst) = dac.release();
    cs.done();
    ldac.done();
    rst.done();
}

#[test]
fn failing_lines_are_named() {
    let broken = || MockError::Io(std::io::ErrorKind::Other);
    let mut dac = Dac7731::new(
        Spi::<u8>::new(&[]),
        Pin::new(&[PinTransaction::set(State::Low).with_error(broken())]),
        untouched(),
        Pin::new(&[PinTransaction::set(State::Low).with_error(broken())]),
    );
    let error = dac.load(DacCode::MIDSCALE).unwrap_err();
    assert_eq!(error.detail(), Operation::Select as u32);
    assert!(error.to_string().starts_with("DAC7731 CS"), "{error}");
    let error = dac.reset(&mut NoopDelay::new()).unwrap_err();
    assert_eq!(error.detail(), Operation::Reset as u32);
    assert!(error.to_string().starts_with("DAC7731 RST"), "{error}");
    assert_eq!(dac.output(), None);
    let (mut spi, mut cs, mut ldac, mut rst) = dac.release();
    spi.done();
    cs.done();
    ldac.done();
    rst.done();
}

/// The part's input side as the datasheet describes it: bits shift in on rising edges of SCLK while
/// CS is low, and a rising CS with SCLK low is one more of them.
struct Part {
    idle_high: bool,
    sclk: bool,
    cs: bool,
    ldac: bool,
    sdi: bool,
    shift: u16,
    output: u16,
}

impl Part {
    fn sclk(&mut self, level: bool) {
        if level && !self.sclk && !self.cs {
            self.shift = (self.shift << 1) | u16::from(self.sdi);
        }
        self.sclk = level;
    }

    fn cs(&mut self, level: bool) {
        if level && !self.cs && !self.sclk {
            self.shift = (self.shift << 1) | u16::from(self.sdi);
        }
        self.cs = level;
    }
}

type Shared = Rc<RefCell<Part>>;

/// A bus that captures on rising edges: mode 3 if SCLK idles high, mode 0 if it idles low.
struct Wire(Shared);

impl ErrorType for Wire {
    type Error = core::convert::Infallible;
}

impl SpiBus for Wire {
    fn read(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
        unreachable!("write-only part")
    }
    fn write(&mut self, words: &[u8]) -> Result<(), Self::Error> {
        let mut part = self.0.borrow_mut();
        for word in words {
            for bit in (0..8).rev() {
                part.sclk(false);
                part.sdi = word & (1 << bit) != 0;
                part.sclk(true);
            }
        }
        let idle = part.idle_high;
        part.sclk(idle);
        Ok(())
    }
    fn transfer(&mut self, _: &mut [u8], _: &[u8]) -> Result<(), Self::Error> {
        unreachable!("write-only part")
    }
    fn transfer_in_place(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
        unreachable!("write-only part")
    }
    fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

struct Line(Shared, fn(&mut Part, bool));

impl PinErrorType for Line {
    type Error = core::convert::Infallible;
}

impl OutputPin for Line {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        (self.1)(&mut self.0.borrow_mut(), false);
        Ok(())
    }
    fn set_high(&mut self) -> Result<(), Self::Error> {
        (self.1)(&mut self.0.borrow_mut(), true);
        Ok(())
    }
}

fn output_of(code: DacCode, mode: embedded_hal::spi::Mode) -> u16 {
    let idle_high = mode.polarity == embedded_hal::spi::Polarity::IdleHigh;
    let part = Rc::new(RefCell::new(Part {
        idle_high,
        sclk: idle_high,
        cs: true,
        ldac: true,
        sdi: false,
        shift: 0x1234,
        output: 0x8000,
    }));
    let mut dac = Dac7731::new(
        Wire(part.clone()),
        Line(part.clone(), Part::cs),
        Line(part.clone(), |part, level| {
            if level && !part.ldac {
                part.output = part.shift;
            }
            part.ldac = level;
        }),
        Line(part.clone(), |_, _| {}),
    );
    dac.write(code, &mut NoopDelay::new()).unwrap();
    let output = part.borrow().output;
    output
}

#[test]
fn scale_of_the_datasheet() {
    assert_eq!(SPI_MODE, MODE_3);
    let volts10 = |code: u16| DacCode::from_offset_binary(code).microvolts(Range::PlusMinus10V);
    assert_eq!(volts10(0x0000), -10_000_000);
    assert_eq!(volts10(0x8000), 0);
    assert_eq!(volts10(0xC000), 5_000_000);
    assert_eq!(volts10(0xFFFF), 9_999_694);
    assert_eq!(DacCode::TOP.microvolts(Range::PlusMinus5V), 4_999_847);
    assert_eq!(DacCode::BOTTOM.microvolts(Range::ZeroTo10V), 0);
    for range in [Range::PlusMinus10V, Range::PlusMinus5V, Range::ZeroTo10V] {
        assert_eq!(range.zero_volts().microvolts(range), 0, "{range:?}");
        assert_eq!(DacCode::from_microvolts(range, 0), range.zero_volts());
        assert_eq!(DacCode::from_microvolts(range, i32::MIN), DacCode::BOTTOM);
        assert_eq!(DacCode::from_microvolts(range, i32::MAX), DacCode::TOP);
    }
    assert_eq!(DacCode::default(), DacCode::MIDSCALE);
    assert_eq!(DacCode::from_signed(0).to_frame(), [0x80, 0x00]);
    assert_eq!(DacCode::from_signed_saturating(40_000), DacCode::TOP);
    assert_eq!(DacCode::from_signed_saturating(-40_000), DacCode::BOTTOM);
}

proptest! {
    /// The word arrives whole in mode 3, and would not in mode 0: the extra shift is real.
    #[test]
    fn frames_arrive_in_mode_3_only(code in any::<u16>()) {
        let sent = DacCode::from_offset_binary(code);
        prop_assert_eq!(output_of(sent, SPI_MODE), code);
        let spoilt = (code << 1) | (code & 1);
        prop_assert_eq!(output_of(sent, embedded_hal::spi::MODE_0), spoilt);
    }

    /// Signed and offset-binary codes against plain arithmetic.
    #[test]
    fn signed_codes(counts in any::<i16>(), wide in any::<i32>()) {
        let code = DacCode::from_signed(counts);
        prop_assert_eq!(i32::from(code.offset_binary()), i32::from(counts) + 32_768);
        prop_assert_eq!(code.signed(), counts);
        prop_assert_eq!(DacCode::from_frame(code.to_frame()), code);
        let clamped = wide.clamp(-32_768, 32_767);
        prop_assert_eq!(i32::from(DacCode::from_signed_saturating(wide).signed()), clamped);
    }

    /// Volts to code is the nearest code, against floating point.
    #[test]
    fn nearest_code(microvolts in -9_999_000i32..9_999_000) {
        let range = Range::PlusMinus10V;
        let code = DacCode::from_microvolts(range, microvolts);
        let exact = (f64::from(microvolts) / 1e6 + 10.0) / 20.0 * 65_536.0;
        prop_assert!((f64::from(code.offset_binary()) - exact).abs() <= 0.5 + 1e-6);
        prop_assert!((code.microvolts(range) - microvolts).abs() <= 154);
    }
}

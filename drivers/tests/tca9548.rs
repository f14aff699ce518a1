//! The TCA9548A driver against expected transactions, its bookkeeping, and the recovery of a held
//! bus.

use drivers::tca9548::recovery::{clear_bus, BusClear, BusClearStep, Recovery, RecoveryStep};
use drivers::tca9548::{
    Address, ChannelMask, Error, MuxState, NoResetLine, Operation, ReadBackError, Selector,
    Tca9548, RESET_PULSE_NS, RESET_RECOVERY_NS,
};
use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
use embedded_hal_mock::eh1::delay::{CheckedDelay, NoopDelay, Transaction as Delay};
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinTransaction};
use embedded_hal_mock::eh1::i2c::{Mock as I2c, Transaction};
use embedded_hal_mock::eh1::MockError;
use proptest::prelude::*;
use std::cell::RefCell;
use std::rc::Rc;

const NACK: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

fn channel(number: u8) -> ChannelMask {
    ChannelMask::single(number).unwrap()
}

fn mux(transactions: &[Transaction]) -> (Tca9548<I2c, NoResetLine>, I2c) {
    let bus = I2c::new(transactions);
    (
        Tca9548::new(bus.clone(), NoResetLine, Address::DEFAULT),
        bus,
    )
}

#[test]
fn writes_only_what_changes() {
    let (mut mux, mut bus) = mux(&[
        Transaction::write(0x70, vec![0x08]),
        Transaction::write(0x70, vec![0x01]),
    ]);
    assert_eq!(mux.state(), MuxState::Unknown);
    mux.select(channel(3)).unwrap();
    mux.select(channel(3)).unwrap();
    assert_eq!(mux.state(), MuxState::Known(channel(3)));
    mux.select(channel(0)).unwrap();
    bus.done();
}

#[test]
fn even_the_power_on_mask_is_written_first() {
    let (mut mux, mut bus) = mux(&[Transaction::write(0x70, vec![0x00])]);
    mux.select(ChannelMask::NONE).unwrap();
    mux.select(ChannelMask::NONE).unwrap();
    bus.done();
}

#[test]
fn nothing_is_trusted_after_a_nack() {
    let (mut mux, mut bus) = mux(&[
        Transaction::write(0x70, vec![0x02]),
        Transaction::write(0x70, vec![0x04]).with_error(NACK),
        Transaction::write(0x70, vec![0x02]),
    ]);
    mux.select(channel(1)).unwrap();
    let error = mux.select(channel(2)).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Bus { operation: Operation::WriteMask, mask, source: NACK } if mask == channel(2)
        ),
        "{error}"
    );
    assert_eq!(error.detail(), 0x0001_0400);
    assert_eq!(mux.state(), MuxState::Unknown);
    // The old mask has to be written again, though it was in force before.
    mux.select(channel(1)).unwrap();
    bus.done();
}

#[test]
fn a_failure_behind_the_mux_counts_as_well() {
    let (mut mux, mut bus) = mux(&[
        Transaction::write(0x70, vec![0x02]),
        Transaction::write(0x2A, vec![0x12]).with_error(NACK),
        Transaction::write(0x70, vec![0x02]),
    ]);
    mux.select(channel(1)).unwrap();
    embedded_hal::i2c::I2c::write(mux.bus(), 0x2A, &[0x12]).unwrap_err();
    mux.invalidate();
    mux.select(channel(1)).unwrap();
    bus.done();
}

#[test]
fn reads_back() {
    let (mut mux, mut bus) = mux(&[
        Transaction::write(0x70, vec![0x20]),
        Transaction::read(0x70, vec![0x20]),
        // In force already: only read.
        Transaction::read(0x70, vec![0x28]),
        Transaction::write(0x70, vec![0x20]),
        Transaction::read(0x70, vec![0x20]).with_error(NACK),
        Transaction::write(0x70, vec![0x20]),
        Transaction::read(0x70, vec![0x20]),
    ]);
    mux.select_verified(channel(5)).unwrap();
    let error = mux.select_verified(channel(5)).unwrap_err();
    assert_eq!(
        error,
        Error::ReadBack(ReadBackError {
            expected: channel(5),
            found: ChannelMask::from_bits(0x28)
        })
    );
    assert_eq!(error.detail(), 0x0003_2028);
    assert!(
        error.to_string().contains("wrote 0x20, read back 0x28"),
        "{error}"
    );
    assert_eq!(mux.state(), MuxState::Unknown);
    let error = mux.select_verified(channel(5)).unwrap_err();
    assert_eq!(error.detail(), 0x0002_2000);
    assert_eq!(mux.state(), MuxState::Unknown);
    mux.select(channel(5)).unwrap();
    assert_eq!(mux.read_mask().unwrap(), channel(5));
    bus.done();
}

#[test]
fn reset_pulses_the_line_and_forgets() {
    let mut bus = I2c::new(&[
        Transaction::write(0x77, vec![0x01]),
        Transaction::write(0x77, vec![0x01]),
    ]);
    let line = Pin::new(&[
        PinTransaction::set(State::Low),
        PinTransaction::set(State::High),
    ]);
    let mut delay = CheckedDelay::new(&[
        Delay::delay_ns(RESET_PULSE_NS),
        Delay::delay_ns(RESET_RECOVERY_NS),
    ]);
    let mut mux = Tca9548::new(bus.clone(), line, Address::from_straps(7).unwrap());
    mux.select(channel(0)).unwrap();
    mux.reset(&mut delay).unwrap();
    assert_eq!(mux.state(), MuxState::Unknown);
    mux.select(channel(0)).unwrap();
    let (_, mut line) = mux.release();
    line.done();
    delay.done();
    bus.done();
}

#[test]
fn a_dead_reset_line_is_named() {
    let broken = MockError::Io(std::io::ErrorKind::Other);
    let line = Pin::new(&[PinTransaction::set(State::Low).with_error(broken)]);
    let mut bus = I2c::new(&[]);
    let mut mux = Tca9548::new(bus.clone(), line, Address::DEFAULT);
    let error = mux.reset(&mut NoopDelay::new()).unwrap_err();
    assert_eq!(error.detail(), 0x0004_0000);
    assert!(error.to_string().starts_with("TCA9548A RESET"), "{error}");
    mux.release().1.done();
    bus.done();
}

#[test]
fn addresses_and_channels() {
    assert_eq!(Address::from_straps(5).map(Address::get), Some(0x75));
    assert_eq!(Address::from_straps(8), None);
    assert_eq!(channel(7).bits(), 0x80);
    assert_eq!(ChannelMask::single(8), None);
}

/// Two open-drain lines with pull-ups and a device that holds SDA low for some more clocks.
#[derive(Default)]
struct Lines {
    scl: bool,
    sda: bool,
    held_for: u32,
    clocks: u32,
    stops: u32,
}

impl Lines {
    fn level(&self) -> bool {
        self.sda && self.held_for == 0
    }
}

#[derive(Clone)]
struct Scl(Rc<RefCell<Lines>>);
#[derive(Clone)]
struct Sda(Rc<RefCell<Lines>>);

impl ErrorType for Scl {
    type Error = core::convert::Infallible;
}
impl ErrorType for Sda {
    type Error = core::convert::Infallible;
}
impl OutputPin for Scl {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        let mut lines = self.0.borrow_mut();
        // The device moves on at the falling edge.
        if lines.scl {
            lines.clocks += 1;
            lines.held_for = lines.held_for.saturating_sub(1);
        }
        lines.scl = false;
        Ok(())
    }
    fn set_high(&mut self) -> Result<(), Self::Error> {
        self.0.borrow_mut().scl = true;
        Ok(())
    }
}
impl OutputPin for Sda {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        self.0.borrow_mut().sda = false;
        Ok(())
    }
    fn set_high(&mut self) -> Result<(), Self::Error> {
        let mut lines = self.0.borrow_mut();
        if lines.scl && !lines.sda && lines.held_for == 0 {
            lines.stops += 1;
        }
        lines.sda = true;
        Ok(())
    }
}
impl InputPin for Sda {
    fn is_high(&mut self) -> Result<bool, Self::Error> {
        Ok(self.0.borrow().level())
    }
    fn is_low(&mut self) -> Result<bool, Self::Error> {
        Ok(!self.0.borrow().level())
    }
}

fn clear(held_for: u32) -> (bool, Lines) {
    let lines = Rc::new(RefCell::new(Lines {
        scl: true,
        sda: true,
        held_for,
        ..Lines::default()
    }));
    let released = clear_bus(
        &mut Scl(lines.clone()),
        &mut Sda(lines.clone()),
        &mut NoopDelay::new(),
        5_000,
    )
    .unwrap();
    (released, lines.take())
}

#[test]
fn a_held_bus_is_clocked_free() {
    for held_for in 0..=9 {
        let (released, lines) = clear(held_for);
        assert!(released, "held for {held_for} clocks");
        assert_eq!(lines.stops, 1, "held for {held_for} clocks: one STOP");
        // One more falling edge belongs to the STOP.
        assert_eq!(lines.clocks, held_for + 1);
        assert!(lines.scl && lines.sda, "both lines released at the end");
    }
}

#[test]
fn a_short_to_ground_is_not_clocked_for_ever() {
    let (released, lines) = clear(u32::MAX);
    assert!(!released);
    assert_eq!(lines.clocks, 10);
    assert_eq!(lines.stops, 0);
}

#[test]
fn bus_clear_steps_are_bounded() {
    let mut machine = BusClear::new();
    let steps = (0..100)
        .take_while(|_| !matches!(machine.next(false), BusClearStep::Done { .. }))
        .count();
    assert_eq!(steps, 1 + 2 * 9 + 4);
    assert_eq!(machine.clocks(), 9);
    assert_eq!(machine.next(true), BusClearStep::Done { released: true });
}

/// Runs a recovery. `free`: level of SDA after this number of resets of the mux. Returns the steps;
/// consecutive steps of the lines count as one.
fn recovery_steps(reset_mux: bool, free: impl Fn(u32) -> bool) -> Vec<RecoveryStep> {
    const CLOCKS: RecoveryStep = RecoveryStep::Lines {
        scl: false,
        sda: false,
    };
    let mut recovery = Recovery::new(reset_mux);
    let mut steps = Vec::new();
    let mut resets = 0;
    for _ in 0..100 {
        let step = match recovery.next(free(resets)) {
            RecoveryStep::Lines { .. } => CLOCKS,
            step => step,
        };
        resets += u32::from(step == RecoveryStep::MuxReset { low: true });
        if steps.last() != Some(&step) {
            steps.push(step);
        } else if matches!(step, RecoveryStep::GiveLines { .. }) {
            return steps;
        }
    }
    panic!("does not end: {steps:?}");
}

#[test]
fn the_mux_is_reset_only_where_the_clocks_do_not_help_or_the_caller_requests_it() {
    use RecoveryStep::{GiveLines, MuxReset, TakeLines};
    let clocks = RecoveryStep::Lines {
        scl: false,
        sda: false,
    };
    let mild = vec![TakeLines, clocks, GiveLines { released: true }];
    let with_reset = |released| {
        vec![
            TakeLines,
            clocks,
            MuxReset { low: true },
            MuxReset { low: false },
            clocks,
            GiveLines { released },
        ]
    };
    assert_eq!(recovery_steps(false, |_| true), mild);
    assert_eq!(recovery_steps(true, |_| true), with_reset(true));
    assert_eq!(
        recovery_steps(false, |resets| resets > 0),
        with_reset(true),
        "a device behind the mux holds SDA"
    );
    assert_eq!(recovery_steps(false, |_| false), with_reset(false));
}

/// Events at a mux.
#[derive(Clone, Copy, Debug)]
enum Happening {
    Select(u8),
    SelectLost(u8, bool),
    FailureBehind,
    Reset,
}

proptest! {
    /// Whatever fails, a selection that reports success is what the part holds.
    #[test]
    fn a_known_mask_is_the_parts_mask(happenings in prop::collection::vec(prop_oneof![
        4 => any::<u8>().prop_map(Happening::Select),
        1 => (any::<u8>(), any::<bool>()).prop_map(|(mask, arrived)| Happening::SelectLost(mask, arrived)),
        1 => Just(Happening::FailureBehind),
        1 => Just(Happening::Reset),
    ], 0..60), at_start in any::<u8>()) {
        let mut selector = Selector::new();
        let mut part = at_start;
        for happening in happenings {
            match happening {
                Happening::Select(mask) => {
                    let mask = ChannelMask::from_bits(mask);
                    if let Some([byte]) = selector.request(mask) {
                        part = byte;
                        selector.written(mask);
                    }
                    prop_assert_eq!(part, mask.bits());
                }
                Happening::SelectLost(mask, arrived) => {
                    // The write fails on the bus, whether or not the byte got through; no report
                    // follows.
                    if let Some([byte]) = selector.request(ChannelMask::from_bits(mask)) {
                        part = if arrived { byte } else { part };
                    }
                }
                Happening::FailureBehind => selector.invalidate(),
                Happening::Reset => {
                    part = 0;
                    selector.invalidate();
                }
            }
            if let MuxState::Known(mask) = selector.state() {
                prop_assert_eq!(part, mask.bits());
            }
        }
    }
}

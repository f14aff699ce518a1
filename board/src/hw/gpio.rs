//! Pins, out of the table in [`crate::pins`].
//!
//! Shared by all modules. Modes are set once at start-up (SCL and SDA again during a bus recovery,
//! the counters' data bus at each access); levels change through BSRR, which is atomic by itself.
//! No interrupt of its own. Setting and resetting the same pin in one BSRR write sets it (section
//! 11.4.7), so a write here holds one or the other.

use super::pac::{self, gpioa::RegisterBlock, RCC};
use super::startup;
use crate::pins::{self, Mode, Pin, Port};
use wire::message::Pull;

const fn block(port: Port) -> *const RegisterBlock {
    match port {
        Port::A => pac::GPIOA::PTR.cast(),
        Port::B => pac::GPIOB::PTR.cast(),
        Port::C => pac::GPIOC::PTR.cast(),
        Port::D => pac::GPIOD::PTR.cast(),
        Port::E => pac::GPIOE::PTR.cast(),
        Port::F => pac::GPIOF::PTR.cast(),
        Port::G => pac::GPIOG::PTR.cast(),
        Port::H => pac::GPIOH::PTR.cast::<RegisterBlock>(),
    }
}

/// The registers of a port.
pub fn registers(port: Port) -> &'static RegisterBlock {
    // SAFETY: a register block at a fixed address; all ports have the same layout
    // (section 11.4) and every register is accessed as a volatile cell.
    unsafe { &*block(port) }
}

/// Drives an output pin high or low, or releases or pulls an open-drain one.
#[inline(always)]
pub fn write(pin: Pin, high: bool) {
    let bits = if high { pin.mask() } else { pin.mask() << 16 };
    // SAFETY: any value of BSRR is allowed; it touches this pin alone (section 11.4.7).
    registers(pin.port)
        .bsrr()
        .write(|w| unsafe { w.bits(bits) });
}

/// Level of a pin.
#[inline(always)]
pub fn read(pin: Pin) -> bool {
    registers(pin.port).idr().read().bits() & pin.mask() != 0
}

/// Level that is set on an output pin.
pub fn is_set(pin: Pin) -> bool {
    registers(pin.port).odr().read().bits() & pin.mask() != 0
}

/// MODER values (section 11.4.1).
const INPUT: u32 = 0;
const OUTPUT: u32 = 1;
const ALTERNATE: u32 = 2;

/// PUPDR values (section 11.4.4).
const NO_PULL: u32 = 0;
const PULL_UP: u32 = 1;
const PULL_DOWN: u32 = 2;

fn set_mode(pin: Pin, mode: u32) {
    registers(pin.port).moder().modify(|r, w| {
        let shift = pin.number * 2;
        // SAFETY: two bits of one pin; all four values are modes (section 11.4.1).
        unsafe { w.bits(r.bits() & !(3 << shift) | mode << shift) }
    });
}

/// Makes a pin an output (with the level of ODR) or returns it to its peripheral.
pub fn set_output(pin: Pin, output: bool) {
    set_mode(pin, if output { OUTPUT } else { ALTERNATE });
}

/// Turns clocks of all used ports on and drives the DACs' RST low: the first thing that the
/// firmware does, and what the panic handler does, on registers alone, from any state.
pub fn hold_dacs_at_zero() {
    // SAFETY: RCC is shared, but this runs before anything else does or after everything has ended.
    let rcc = unsafe { &*RCC::PTR };
    rcc.ahb4enr().modify(|_, w| {
        w.gpioaen()
            .enabled()
            .gpioben()
            .enabled()
            .gpiocen()
            .enabled()
            .gpioden()
            .enabled();
        w.gpioeen()
            .enabled()
            .gpiofen()
            .enabled()
            .gpiogen()
            .enabled()
            .gpiohen()
            .enabled()
    });
    // A clock needs two cycles of the bus before its peripheral answers (section 8.5.11): read it
    // back.
    let _ = rcc.ahb4enr().read();
    write(pins::DAC_RST, false);
    set_mode(pins::DAC_RST, OUTPUT);
}

/// Sets every pin of the table up; levels come before directions, so no output glitches.
pub fn configure() {
    for pin in pins::all() {
        configure_pin(pin);
    }
}

/// What holds an output pin from outside that stands low. It is an input for some 100 us, with the
/// controller's own pull-up and pull-down, and stands low again afterwards.
pub fn pull_of(pin: Pin) -> Pull {
    /// Reads of the pin until it has followed: 100 us at 64 MHz, twenty times 50 kOhm by 100 pF.
    const READS: u32 = 1_000;
    set_pull(pin, PULL_UP);
    set_mode(pin, INPUT);
    let high_pulled_up = startup::wait_for(READS, || read(pin));
    set_pull(pin, PULL_DOWN);
    let high_pulled_down = !startup::wait_for(READS, || !read(pin));
    set_mode(pin, OUTPUT);
    set_pull(pin, NO_PULL);
    Pull::of_levels(high_pulled_up, high_pulled_down)
}

fn set_pull(pin: Pin, pull: u32) {
    let shift = pin.number * 2;
    // SAFETY: the two bits of this pin alone, with a pull of section 11.4.4.
    registers(pin.port)
        .pupdr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << shift) | pull << shift) });
}

fn configure_pin(pin: Pin) {
    let port = registers(pin.port);
    let shift = pin.number * 2;
    // Closures would borrow `pin`; each register is one line of section 11.4.
    let (mode, open_drain, speed, pull, function) = match pin.mode {
        Mode::AsReset => return,
        Mode::Output { high } => {
            write(pin, high);
            (OUTPUT, false, 1, NO_PULL, 0)
        }
        Mode::InputPullDown => (INPUT, false, 0, PULL_DOWN, 0),
        Mode::Bus => (INPUT, false, 1, NO_PULL, 0),
        Mode::Alternate(function) => (ALTERNATE, false, 2, NO_PULL, function),
        // Slow edges on purpose: 20 ns are plenty at 400 kHz. Pull-ups are on the board.
        Mode::OpenDrain(function) => {
            write(pin, true);
            (ALTERNATE, true, 1, NO_PULL, function)
        }
    };
    // SAFETY: the bit of this pin alone (section 11.4.2).
    port.otyper().modify(|r, w| unsafe {
        w.bits(r.bits() & !pin.mask() | if open_drain { pin.mask() } else { 0 })
    });
    // SAFETY: the two bits of this pin alone, with a speed of section 11.4.3.
    port.ospeedr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << shift) | speed << shift) });
    set_pull(pin, pull);
    let nibble = pin.number % 8 * 4;
    let function = u32::from(function) << nibble;
    if pin.number < 8 {
        // SAFETY: the four bits of this pin alone, AF0 to AF15 (section 11.4.9).
        port.afrl()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(15 << nibble) | function) });
    } else {
        // SAFETY: the four bits of this pin alone, AF0 to AF15 (section 11.4.10).
        port.afrh()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(15 << nibble) | function) });
    }
    set_mode(pin, mode);
}

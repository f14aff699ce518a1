//! The controller: the engine's STM32H743 with the board on its pins and a watchdog, a holdable I2C
//! bus and a USB core with a host in the slots that need another model than the engine's.
//!
//! The STM32H753 of the Nucleo differs from the H743 by its crypto processors only, which nothing
//! here uses.

use super::i2c::HeldI2c;
use super::iwdg::Iwdg;
use super::listener::{self, Listener};
use super::peers::{DacBus, HostLine, Shared};
use super::port::QuietPort;
use super::usb::{Block, Replacement, SharedUsb};
use crate::board::Drive;
use crate::devices::dac7731::Mode;
use crate::wiring::{self, Pin, PORTS};
use rigless::device::{ErasedDevice, Level, RegisterFile, ResetCause};
use rigless::emulator::{Access, AccessKind};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32h743::generated::{flash, gpioa, pwr, rcc, spi1};
use rigless::soc::stm32h743::peripherals::gpio::{Gpio, Pin as PortPin, PORTS as PORT_NAMES};
use rigless::soc::stm32h743::peripherals::rcc::Rcc;
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::{Bus, Error, Fault, Width};
use rigless::time::VirtualNanos;

/// Crystal input: 8 MHz from the ST-Link.
const HSE_HZ: u64 = 8_000_000;
/// BOR_LEV in FLASH_OPTSR_CUR: place of its two bits.
const BROWN_OUT_LEVEL: u32 = 2;
/// Supply in millivolts.
const SUPPLY_MV: u32 = 3_300;

const GPIO_BASE: u64 = 0x5802_0000;
const GPIO_SIZE: u64 = 0x400;
const GPIO_END: u64 = GPIO_BASE + PORTS as u64 * GPIO_SIZE;
const SPI1_BASE: u64 = 0x4001_3000;
const SPI1_CR1: u64 = SPI1_BASE;
const SPI1_CFG2: u64 = SPI1_BASE + 0x0C;
const SPI1_TXDR: u64 = SPI1_BASE + 0x20;
const RCC_CR: u64 = 0x5802_4400;
/// DCTL of the USB core: a write with SDIS cleared connects it.
const USB_DCTL: u64 = 0x4008_0804;

const MODER: u64 = 0x00;
const OTYPER: u64 = 0x04;
const IDR: u64 = 0x10;
const ODR: u64 = 0x14;
const BSRR: u64 = 0x18;
const BSRR_HIGH: u64 = 0x1A;

/// Ports that [`QuietPort`] answers for.
const QUIET: [usize; 2] = [wiring::CNT_RD.port, wiring::CNT_D0.port];

/// Position of USART3 in the engine's list of instances.
const USART3: usize = 2;

/// See the module's page.
#[derive(Debug)]
pub struct RigMcu {
    part: Stm32h743,
    board: Shared,
    i2c: HeldI2c,
    iwdg: Iwdg,
    usb: SharedUsb,
    usb_blocks: [Block; 3],
    usb_slots: Replacement,
    /// Strobes and data bus of the counters.
    quiet: [QuietPort; 2],
    /// The readers of requests.
    listeners: Vec<Listener>,
    slots: Slots,
    /// Whose model answers for each slot.
    answering: Vec<Answering>,
    /// The earliest pending event that was requested for the board.
    scheduled: Option<VirtualNanos>,
    /// Whether the clock controller knows that the HSE stands still.
    clock_stopped: bool,
    /// The reset that comes is a dip of the supply.
    brown_out: bool,
    /// Whether the pins in alternate functions were found right since they were last configured.
    functions_checked: bool,
    /// The firmware has set the USB core up, so that its pins matter.
    usb_set: bool,
}

/// Whose model answers for a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Answering {
    Part,
    I2c,
    Iwdg,
    Usb(usize),
    Quiet(usize),
    Listener(usize),
}

#[derive(Debug, Clone, Copy)]
struct Slots {
    usart3: usize,
    spi1: usize,
    rcc: usize,
    pwr: usize,
    flash: usize,
    ports: [usize; PORTS],
}

impl Store for RigMcu {}

impl RigMcu {
    /// The part out of power-on with `board` around it and `usb`'s host at the socket.
    ///
    /// # Errors
    /// The engine's description of the part is not the one this module was written for.
    pub fn new(board: Shared, usb: SharedUsb) -> Result<Self, Error> {
        let mut part = Stm32h743::new()?;
        part.rcc.attach_crystals(HSE_HZ, 0);
        part.set_supply(SUPPLY_MV);
        part.set_analog_supply(SUPPLY_MV);
        part.usart[USART3].attach(HostLine(board.clone()));
        let bus = part.bus();
        let mut ports = [0; PORTS];
        for (slot, name) in ports.iter_mut().zip(PORT_NAMES) {
            *slot = bus.slot(name)?;
        }
        let listeners = fresh_listeners(&board);
        let mut answering = vec![Answering::Part; bus.slots().len()];
        answering[bus.slot("I2C1")?] = Answering::I2c;
        answering[bus.slot("IWDG")?] = Answering::Iwdg;
        let usb_slots = Replacement::new(bus)?;
        for (nth, slot) in usb_slots.slots().into_iter().enumerate() {
            answering[slot] = Answering::Usb(nth);
        }
        for (nth, port) in QUIET.into_iter().enumerate() {
            answering[ports[port]] = Answering::Quiet(nth);
        }
        for (nth, listener) in listeners.iter().enumerate() {
            answering[bus.slot(listener.instance)?] = Answering::Listener(nth);
        }
        let slots = Slots {
            usart3: bus.slot("USART3")?,
            spi1: bus.slot("SPI1")?,
            rcc: bus.slot("RCC")?,
            pwr: bus.slot("PWR")?,
            flash: bus.slot("Flash")?,
            ports,
        };
        let mut mcu = Self {
            i2c: HeldI2c::new(&board),
            iwdg: Iwdg::default(),
            usb_blocks: Block::all(&usb),
            usb,
            usb_slots,
            quiet: Default::default(),
            listeners,
            part,
            board,
            slots,
            answering,
            scheduled: None,
            clock_stopped: false,
            brown_out: false,
            functions_checked: false,
            usb_set: false,
        };
        mcu.usb_slots.exchange(mcu.part.bus_mut());
        mcu.check()?;
        mcu.load_option_bytes();
        mcu.sync(VirtualNanos(0));
        Ok(mcu)
    }

    /// Applies the levels that the board drives to the pins, and requests a wake-up at the board's
    /// next event.
    fn sync(&mut self, now: VirtualNanos) {
        let (drives, next) = {
            let mut board = self.board.lock();
            let drives = board.has_drives().then(|| board.take_drives());
            (drives, board.next_event())
        };
        self.carry(now, drives, next);
    }

    fn carry(&mut self, now: VirtualNanos, drives: Option<Vec<Drive>>, next: Option<u64>) {
        for (pin, level) in drives.into_iter().flatten() {
            if let Some(nth) = QUIET.iter().position(|port| *port == pin.port) {
                self.quiet[nth].drive(pin.pin, level);
                continue;
            }
            let port_pin = PortPin::new(pin.pin).expect("a port has sixteen pins");
            self.part
                .drive_port(now, pin.port, |gpio, registers, context| {
                    gpio.drive(port_pin, level.map(Level::from), registers, context);
                });
        }
        self.wake_at(now, next.map(VirtualNanos));
    }

    fn wake_at(&mut self, now: VirtualNanos, next: Option<VirtualNanos>) {
        self.scheduled = self.scheduled.filter(|at| *at > now);
        if let Some(next) = next.filter(|next| self.scheduled.is_none_or(|at| *next < at)) {
            let (_, mut context) = self.part.bus_mut().drive(now, self.slots.ports[0]);
            context.schedule(next);
            self.scheduled = Some(next);
        }
    }

    /// The core has made `access`, and every model has settled after it.
    pub fn accessed(&mut self, access: &Access) {
        let address = access.address;
        if let Some((port, offset)) = port_register(address) {
            match (access.kind, offset) {
                (AccessKind::Write, _) => {
                    self.port_register_written(access.virtual_time, port, offset);
                }
                (AccessKind::Read, IDR) if port == wiring::CNT_D0.port => {
                    self.board.lock().data_sampled(access.virtual_time.0);
                }
                _ => {}
            }
        } else if access.kind == AccessKind::Write {
            match address & !3 {
                SPI1_TXDR => {
                    self.board
                        .lock()
                        .spi_written(access.virtual_time.0, access.instruction_count);
                    self.check_functions();
                }
                SPI1_CR1 | SPI1_CFG2 => self.spi_set(),
                RCC_CR => self.hse_switched(access.virtual_time),
                USB_DCTL => self.check_usb(),
                _ => {}
            }
        }
    }

    /// The core switched the HSE on while its clock stands still: it does not become ready (RM0433
    /// section 8.5.2). The engine's model has an HSE that always does, so it is told that the HSE
    /// stays off.
    fn hse_switched(&mut self, now: VirtualNanos) {
        let control = self.part.bus().slots()[self.slots.rcc]
            .registers()
            .get(rcc::Register::Cr);
        if rcc::cr::HSEON.is_set(control) && self.board.lock().is_clock_lost() {
            // An access that the model takes as every other.
            drop(self.write(now, RCC_CR, Width::W32, rcc::cr::HSEON.set(control, 0)));
        }
    }

    /// Tells the clock controller once that its clock stands still (section 8.5.3).
    fn follow_clock(&mut self, now: VirtualNanos) {
        let lost = self.board.lock().is_clock_lost();
        if lost && !self.clock_stopped {
            let mut clocks = std::mem::replace(&mut self.part.rcc, Rcc::new());
            let (registers, mut context) = self.part.bus_mut().drive(now, self.slots.rcc);
            clocks.fail_hse(registers, &mut context);
            self.part.rcc = clocks;
        }
        self.clock_stopped = lost;
    }

    /// Flips one bit of the register at `address`, as if the core had written it.
    ///
    /// # Errors
    /// There is no register, or the part refuses the access.
    pub fn flip_register(&mut self, now: VirtualNanos, address: u64, bit: u8) -> Result<(), Fault> {
        let value = self.peek(now, address, Width::W32)?;
        self.write(now, address, Width::W32, value ^ 1 << bit)?;
        if let Some((port, offset)) = port_register(address) {
            self.port_register_written(now, port, offset);
        }
        Ok(())
    }

    /// The option bytes, which the part loads at each reset: brown-out level 3, as docs/bring-up.md
    /// has it set, unless one was injected.
    fn load_option_bytes(&mut self) {
        let level = u64::from(self.board.lock().brown_out_level());
        let registers = (self.part.bus_mut())
            .slot_mut(self.slots.flash)
            .registers_mut();
        for register in [flash::Register::OptsrCur, flash::Register::OptsrCur_] {
            let bytes = registers.get(register);
            let others = bytes & !(3 << BROWN_OUT_LEVEL);
            registers.set(register, others | level << BROWN_OUT_LEVEL);
        }
    }

    /// The reset that comes next is one of the supply.
    pub fn dip(&mut self) {
        self.brown_out = true;
    }

    /// The engine stopped between two instructions with `instructions` retired.
    pub fn stopped(&mut self, instructions: u64) {
        self.board.lock().probe.counted(instructions);
    }

    fn port_register_written(&mut self, now: VirtualNanos, port: usize, offset: u64) {
        match offset {
            MODER | OTYPER | ODR | BSRR | BSRR_HIGH => self.port_written(now, port, offset),
            _ => self.functions_checked = false,
        }
    }

    fn port_written(&mut self, now: VirtualNanos, port: usize, offset: u64) {
        if offset == MODER {
            self.functions_checked = false;
        }
        let registers = self.part.bus().slots()[self.slots.ports[port]].registers();
        let modes = registers.get(gpioa::Register::Moder);
        let open_drain = registers.get(gpioa::Register::Otyper) as u16;
        let level = registers.get(gpioa::Register::Odr) as u16;
        let driven = outputs(modes) & !(open_drain & level);
        let wake = {
            let mut board = self.board.lock();
            board.port_changed(now.0, port, driven, level);
            board.has_drives() || board.next_event().map(VirtualNanos) < self.scheduled
        };
        if wake || self.scheduled.is_none() {
            self.sync(now);
        }
    }

    fn spi_set(&mut self) {
        let registers = self.part.bus().slots()[self.slots.spi1].registers();
        let cfg2 = registers.get(spi1::Register::Cfg2);
        let enabled = spi1::cr1::SPE.is_set(registers.get(spi1::Register::Cr1));
        let mode = Mode {
            cpol: spi1::cfg2::CPOL.is_set(cfg2),
            cpha: spi1::cfg2::CPHA.is_set(cfg2),
        };
        let driven = enabled || spi1::cfg2::AFCNTR.is_set(cfg2);
        self.board.lock().spi_set(mode, driven.then_some(mode.cpol));
    }

    /// A USB core without its clock or supply is dead on the part; the engine does not look.
    fn check_usb(&mut self) {
        let bus = self.part.bus();
        let [clocks, power] =
            [self.slots.rcc, self.slots.pwr].map(|nth| bus.slots()[nth].registers());
        if let Some(what) = usb_needs(clocks, power) {
            self.board.lock().complain("OTG2_HS", what.to_owned());
        }
        if !self.usb_set {
            self.usb_set = true;
            self.functions_checked = false;
        }
        self.check_functions();
    }

    /// Pins in a wrong alternate function would carry nothing on the part; the engine does not
    /// look.
    fn check_functions(&mut self) {
        if self.functions_checked {
            return;
        }
        self.functions_checked = true;
        for (pin, expected, signal) in wiring::FUNCTIONS {
            if !self.usb_set && [wiring::USB_DM, wiring::USB_DP].contains(&pin) {
                continue;
            }
            let registers = self.part.bus().slots()[self.slots.ports[pin.port]].registers();
            let port_pin = PortPin::new(pin.pin).expect("a port has sixteen pins");
            let found = Gpio::function(port_pin, registers);
            if found != Some(expected) {
                self.board.lock().complain(
                    &name(pin),
                    format!("{signal} needs alternate function {expected}, the pin has {found:?}"),
                );
            }
        }
    }
}

/// What is missing for a USB core that is about to connect.
fn usb_needs(clocks: &RegisterFile, power: &RegisterFile) -> Option<&'static str> {
    let sleep = clocks.get(rcc::Register::Ahb1lpenr);
    let kernel = rcc::d2ccip2r::USBSEL.get(clocks.get(rcc::Register::D2ccip2r));
    if !pwr::cr3::USB33DEN.is_set(power.get(pwr::Register::Cr3)) {
        Some("PWR_CR3.USB33DEN is clear: the transceiver has no supply (RM0433 section 6.4.5)")
    } else if kernel != 3 || !rcc::cr::RC48ON.is_set(clocks.get(rcc::Register::Cr)) {
        Some("RCC_D2CCIP2R.USBSEL is not HSI48, or HSI48 is off: 48 MHz come from there on this board (section 8.5.8)")
    } else if rcc::ahb1lpenr::USB2OTGHSULPILPEN.is_set(sleep)
        || !rcc::ahb1lpenr::USB2OTGHSLPEN.is_set(sleep)
    {
        Some("RCC_AHB1LPENR: USB2OTGHSLPEN set and USB2OTGHSULPILPEN clear, or the core stands still in every WFI (section 8.7.48)")
    } else {
        None
    }
}

/// The readers of requests out of reset, the DACs on SPI1.
fn fresh_listeners(board: &Shared) -> Vec<Listener> {
    listener::fresh(("SPI1", DacBus(board.clone())), board)
}

/// Port and offset of a GPIO register.
fn port_register(address: u64) -> Option<(usize, u64)> {
    (GPIO_BASE..GPIO_END).contains(&address).then(|| {
        let port = (address - GPIO_BASE) / GPIO_SIZE;
        (port as usize, address % GPIO_SIZE)
    })
}

/// Bits of a port's MODER that are general-purpose outputs (01), one per pin.
fn outputs(modes: u64) -> u16 {
    let ones = modes & !(modes >> 1) & 0x5555_5555;
    (0..16).fold(0, |bits, pin| {
        bits | ((ones >> (2 * pin) & 1) as u16) << pin
    })
}

fn name(pin: Pin) -> String {
    format!("P{}{}", (b'A' + pin.port as u8) as char, pin.pin)
}

impl Mcu for RigMcu {
    fn bus(&self) -> &Bus {
        self.part.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.part.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.usb_slots.exchange(self.part.bus_mut());
        self.part.reset(at, cause);
        self.usb_slots.exchange(self.part.bus_mut());
        self.usb.reset();
        rigless::device::Device::reset(&mut self.i2c);
        rigless::device::Device::reset(&mut self.iwdg);
        self.listeners = fresh_listeners(&self.board);
        self.board.lock().controller_reset(at.0);
        if std::mem::take(&mut self.brown_out) {
            // Table 56 of RM0433: a dip below the brown-out level, not below the power-on level.
            let registers = self.part.bus_mut().slot_mut(self.slots.rcc).registers_mut();
            for register in [rcc::Register::Rsr, rcc::Register::C1Rsr] {
                let flags = registers.get(register);
                registers.set(register, rcc::rsr::BORRSTF.set(flags, 1));
            }
        }
        self.load_option_bytes();
        // The events went with the old bus.
        self.scheduled = None;
        self.functions_checked = false;
        self.usb_set = false;
        self.sync(at);
    }

    /// The engine's own part polls every model at every stop; only the serial line has data.
    fn poll(&mut self, now: VirtualNanos) {
        self.follow_clock(now);
        let (drives, next, waiting) = {
            let mut board = self.board.lock();
            board.advance(now.0);
            let drives = board.has_drives().then(|| board.take_drives());
            let waiting = board.to_board_waiting() > 0;
            (drives, board.next_event(), waiting)
        };
        self.carry(now, drives, next);
        if self.usb.take_touched() {
            let slot = self.usb_slots.slots()[0];
            let (_, mut context) = self.part.bus_mut().drive(now, slot);
            self.usb_blocks[0].advance(&mut context);
        }
        if waiting {
            let slot = self.slots.usart3;
            if let (bus, Some(model)) = self.part.split(slot) {
                let (registers, mut context) = bus.drive(now, slot);
                model.poll(registers, &mut context);
            }
        }
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let own: &mut dyn ErasedDevice = match self.answering[slot] {
            Answering::Part => return self.part.split(slot),
            Answering::I2c => &mut self.i2c,
            Answering::Iwdg => &mut self.iwdg,
            Answering::Usb(nth) => &mut self.usb_blocks[nth],
            Answering::Quiet(nth) => &mut self.quiet[nth],
            Answering::Listener(nth) => &mut self.listeners[nth],
        };
        (self.part.bus_mut(), Some(own))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_the_pins_in_mode_01() {
        assert_eq!(outputs(0b11_10_01_00), 0b0010);
        assert_eq!(outputs(0x5555_5555), 0xFFFF);
        assert_eq!(outputs(0xFFFF_FFFF), 0);
        assert_eq!(outputs(0xAAAA_AAAA), 0);
    }
}

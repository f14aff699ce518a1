//! The watch on the controller's own configuration: registers that start-up wrote and that nothing
//! may change afterwards.
//!
//! Owner: the supervisor, each millisecond. No interrupt. A single bit of SPI1's mode makes another
//! word of every word that a DAC gets, and nothing else would notice: the words go out in time, and
//! no word can be read back.
//!
//! [`Registers::start`] notes the registers at the end of start-up. SPI1's mode and what decides
//! where the receiving DMA stream writes are compared each millisecond, all others in turn within
//! [`TURN_CALLS`](crate::register_table::TURN_CALLS) milliseconds. What the firmware itself changes
//! while it runs is left out bit by bit: SPE and CSTART of SPI1, PE of I2C1, the pins of a bus
//! recovery and of the counters' data bus, the alarm of TIM2, the mask of the USB interrupt, the
//! clock of the CRS. So is what only a debugger uses.
//!
//! At a difference the DACs' RST goes low at once, from any state of the ports; then clocks, pins
//! and SPI1, which 0 V needs, and the receiving stream are set up again. The supervisor latches
//! "register changed". RST is released after that is cleared.

use super::pac::{self, Interrupt};
use super::usart::Usart;
use super::{dac, gpio, startup};
use crate::clocks;
use crate::pins::{self, Mode, Port};
use crate::register_table::{Entry, Table};

/// Room for entries of each kind. Start-up panics where it does not suffice.
const CAPACITY: usize = 160;

const ALL: u32 = u32::MAX;

const PORTS: [Port; 8] = [
    Port::A,
    Port::B,
    Port::C,
    Port::D,
    Port::E,
    Port::F,
    Port::G,
    Port::H,
];

/// Registers of the core, which the PAC's crate names in parts only (PM0253 sections 4.1 to 4.8).
mod core {
    pub const SYST_CSR: u32 = 0xE000_E010;
    pub const SYST_RVR: u32 = 0xE000_E014;
    pub const NVIC_ISER: u32 = 0xE000_E100;
    pub const NVIC_IPR: u32 = 0xE000_E400;
    pub const VTOR: u32 = 0xE000_ED08;
    pub const AIRCR: u32 = 0xE000_ED0C;
    pub const SCR: u32 = 0xE000_ED10;
    pub const CCR: u32 = 0xE000_ED14;
    pub const SHPR: [u32; 3] = [0xE000_ED18, 0xE000_ED1C, 0xE000_ED20];
    pub const CPACR: u32 = 0xE000_ED88;
    pub const MPU_CTRL: u32 = 0xE000_ED94;
}

/// See the [module](self).
pub struct Registers {
    /// Not on the stack: it would be moved there several times.
    table: &'static mut Table<CAPACITY>,
}

fn read(address: u32) -> u32 {
    // SAFETY: addresses of the table, which are registers whose reading changes nothing that is
    // used.
    unsafe { (address as *const u32).read_volatile() }
}

/// The address of a register of the PAC.
macro_rules! at {
    ($register:expr) => {
        $register.as_ptr() as u32
    };
}

impl Registers {
    /// Notes every register as it is now. Call it at the end of start-up.
    pub fn start(silicon: u16) -> Self {
        let table = cortex_m::singleton!(: Table<CAPACITY> = Table::new());
        let Some(table) = table else {
            panic!("registers watched twice")
        };
        let mut watch = Self { table };
        watch.output_path();
        watch.pins();
        watch.clocks();
        watch.sensors();
        watch.link();
        watch.interrupts();
        if clocks::has_axi_read_defect(silicon) {
            watch.add(startup::AXI_TARG7_FN_MOD, ALL);
        }
        watch
    }

    /// Compares the registers that are due; call it once a millisecond. Returns the address of a
    /// register that does not have its value, until two whole turns have found none.
    pub fn check(&mut self, usart: &mut Usart) -> Option<u32> {
        if self.table.check(read).is_some() {
            self.make_safe(usart);
        }
        self.table.differs()
    }

    /// RST low, then everything set up again that 0 V on the motors needs, and the stream that
    /// writes to memory.
    fn make_safe(&self, usart: &mut Usart) {
        gpio::hold_dacs_at_zero();
        cortex_m::interrupt::free(|_| {
            for entry in self.table.entries() {
                let found = read(entry.address);
                if is_restored(entry.address) && !entry.holds(found) {
                    // SAFETY: a clock's enable or a pin's setting as start-up wrote it; both may be
                    // written at any time.
                    unsafe { (entry.address as *mut u32).write_volatile(entry.restored(found)) };
                }
            }
        });
        let receiver = self.receiver();
        if self
            .table
            .entries()
            .any(|entry| receiver.contains(&entry.address) && !entry.holds(read(entry.address)))
        {
            usart.restart_receiver();
        }
        dac::restart();
    }

    /// Bits of `mask` that the register has now are to stay.
    fn entry(address: u32, mask: u32) -> Entry {
        Entry {
            address,
            mask,
            value: read(address) & mask,
        }
    }

    fn add(&mut self, address: u32, mask: u32) {
        if self.table.add(Self::entry(address, mask)).is_err() {
            panic!("more registers to watch than room for them");
        }
    }

    fn add_always(&mut self, address: u32, mask: u32) {
        if self.table.add_always(Self::entry(address, mask)).is_err() {
            panic!("more registers to watch than room for them");
        }
    }

    /// SPI1 (section 50.11), and the stream that writes received bytes to memory.
    fn output_path(&mut self) {
        // SAFETY: addresses only.
        let spi = unsafe { &*pac::SPI1::PTR };
        const SPE_CSTART_CSUSP: u32 = 1 | 1 << 9 | 1 << 10;
        const EOTIE: u32 = 1 << 3;
        self.add_always(at!(spi.cfg2()), ALL);
        self.add_always(at!(spi.cfg1()), ALL);
        self.add_always(at!(spi.cr1()), !SPE_CSTART_CSUSP);
        self.add_always(at!(spi.ier()), !EOTIE);
        self.add_always(at!(spi.i2scfgr()), ALL);
        const EN: u32 = 1;
        let [cr, par, m0ar, fcr] = self.receiver();
        self.add_always(cr, !EN);
        self.add_always(par, ALL);
        self.add_always(m0ar, ALL);
        // FS, the FIFO's level, changes (section 15.5.10).
        self.add_always(fcr, !(0b111 << 3));
    }

    /// CR, PAR, M0AR and FCR of the stream that serves USART3's receiver.
    fn receiver(&self) -> [u32; 4] {
        // SAFETY: addresses only.
        let stream = unsafe { &*pac::DMA1::PTR }.st(1);
        [
            at!(stream.cr()),
            at!(stream.par()),
            at!(stream.m0ar()),
            at!(stream.fcr()),
        ]
    }

    /// Mode, type, speed, pull and function of every pin that is used (section 11.4).
    fn pins(&mut self) {
        for port in PORTS {
            let (mut bits, mut modes, mut pairs, mut low, mut high) = (0, 0, 0, 0, 0);
            for pin in pins::all().filter(|pin| pin.port == port) {
                bits |= pin.mask();
                pairs |= 3 << (2 * pin.number);
                // SCL, SDA and the data bus change their mode while the firmware runs.
                if !matches!(pin.mode, Mode::OpenDrain(_) | Mode::Bus) {
                    modes |= 3 << (2 * pin.number);
                }
                let nibble = 15 << (pin.number % 8 * 4);
                if pin.number < 8 {
                    low |= nibble;
                } else {
                    high |= nibble;
                }
            }
            let registers = gpio::registers(port);
            for (address, mask) in [
                (at!(registers.moder()), modes),
                (at!(registers.otyper()), bits),
                (at!(registers.ospeedr()), pairs),
                (at!(registers.pupdr()), pairs),
                (at!(registers.afrl()), low),
                (at!(registers.afrh()), high),
            ] {
                if mask != 0 {
                    self.add(address, mask);
                }
            }
        }
    }

    /// Clock tree, supply, flash and timers.
    fn clocks(&mut self) {
        // SAFETY: addresses only.
        let (rcc, pwr, flash, tim, iwdg) = unsafe {
            (
                &*pac::RCC::PTR,
                &*pac::PWR::PTR,
                &*pac::FLASH::PTR,
                &*pac::TIM2::PTR,
                &*pac::IWDG::PTR,
            )
        };
        // The enable bits: HSI, its divider, CSI, HSI48, HSE with bypass and security system, PLLs
        // (section 8.7.2).
        self.add(at!(rcc.cr()), 0x151D_129B);
        // CRSEN is set once a USB host gives an address.
        const CRSEN: u32 = 1 << 1;
        for (address, mask) in [
            (at!(rcc.cfgr()), ALL),
            (at!(rcc.d1cfgr()), ALL),
            (at!(rcc.d2cfgr()), ALL),
            (at!(rcc.d3cfgr()), ALL),
            (at!(rcc.pllckselr()), ALL),
            (at!(rcc.pllcfgr()), ALL),
            (at!(rcc.pll1divr()), ALL),
            (at!(rcc.d1ccipr()), ALL),
            (at!(rcc.d2ccip1r()), ALL),
            (at!(rcc.d2ccip2r()), ALL),
            (at!(rcc.d3ccipr()), ALL),
            // A bit of these holds a peripheral in reset.
            (at!(rcc.ahb1rstr()), ALL),
            (at!(rcc.ahb4rstr()), ALL),
            (at!(rcc.apb1lrstr()), ALL),
            (at!(rcc.apb2rstr()), ALL),
            (at!(rcc.apb4rstr()), ALL),
            (at!(rcc.ahb1enr()), ALL),
            (at!(rcc.ahb2enr()), ALL),
            (at!(rcc.ahb3enr()), ALL),
            (at!(rcc.ahb4enr()), ALL),
            (at!(rcc.apb1lenr()), ALL),
            (at!(rcc.apb1henr()), !CRSEN),
            (at!(rcc.apb2enr()), ALL),
            (at!(rcc.apb4enr()), ALL),
            // Which clocks go on while the core sleeps.
            (at!(rcc.ahb1lpenr()), ALL),
            (at!(rcc.ahb3lpenr()), ALL),
            (at!(rcc.ahb4lpenr()), ALL),
            (at!(rcc.apb1llpenr()), ALL),
            (at!(rcc.apb2lpenr()), ALL),
            (at!(rcc.apb4lpenr()), ALL),
            // LPDS, PVDE, DBP, FLPS, SVOS, AVDEN (section 6.8.1); BYPASS, LDOEN, SCUEN, USB33DEN,
            // USBREGEN (6.8.4); PDDS, RUN_D3 (6.8.5); VOS (6.8.6).
            (at!(pwr.cr1()), 0x0001_C311),
            (at!(pwr.cr3()), 0x0300_0007),
            (at!(pwr.cpucr()), 0x0000_0807),
            (at!(pwr.d3cr()), 0x0000_C000),
            (at!(flash.acr()), ALL),
            (at!(tim.cr1()), ALL),
            // CC1IE is the alarm of the bus recovery.
            (at!(tim.dier()), !2),
            (at!(tim.psc()), ALL),
            (at!(tim.arr()), ALL),
            (at!(iwdg.pr()), ALL),
            (at!(iwdg.rlr()), ALL),
            // COUNTFLAG of SYST_CSR changes.
            (core::SYST_CSR, 0b111),
            (core::SYST_RVR, ALL),
        ] {
            self.add(address, mask);
        }
    }

    /// I2C1 (section 47.7), EXTI (20.6), SYSCFG's routes (12.3).
    fn sensors(&mut self) {
        // SAFETY: addresses only.
        let (i2c, exti, syscfg) =
            unsafe { (&*pac::I2C1::PTR, &*pac::EXTI::PTR, &*pac::SYSCFG::PTR) };
        // PE is off during a recovery.
        const PE: u32 = 1;
        // The configurable lines, 0 to 21.
        const LINES: u32 = 0x003F_FFFF;
        for (address, mask) in [
            (at!(i2c.cr1()), !PE),
            (at!(i2c.timingr()), ALL),
            (at!(i2c.oar1()), ALL),
            (at!(i2c.oar2()), ALL),
            (at!(exti.rtsr1()), LINES),
            (at!(exti.ftsr1()), LINES),
            (at!(exti.cpuimr1()), LINES),
            (at!(syscfg.exticr1()), ALL),
            (at!(syscfg.exticr2()), ALL),
            (at!(syscfg.exticr3()), ALL),
        ] {
            self.add(address, mask);
        }
    }

    /// USART3 (section 48.7), the fixed part of its sending stream, both routes (17.6).
    fn link(&mut self) {
        // SAFETY: addresses only.
        let (usart, dma, dmamux) =
            unsafe { (&*pac::USART3::PTR, &*pac::DMA1::PTR, &*pac::DMAMUX1::PTR) };
        for address in [
            at!(usart.cr1()),
            at!(usart.cr2()),
            at!(usart.cr3()),
            at!(usart.brr()),
            at!(usart.presc()),
            at!(dma.st(0).par()),
            at!(dmamux.ccr(0)),
            at!(dmamux.ccr(1)),
        ] {
            self.add(address, ALL);
        }
    }

    /// Enables and priorities of the interrupts, and the core's own settings.
    fn interrupts(&mut self) {
        // The handler of OTG_FS masks it, and the superloop unmasks it.
        let usb = Interrupt::OTG_FS as u32;
        for word in 0..5 {
            let mask = if usb / 32 == word {
                !(1 << (usb % 32))
            } else {
                ALL
            };
            self.add(core::NVIC_ISER + 4 * word, mask);
        }
        for interrupt in startup::SAMPLE_PATH.into_iter().chain(startup::LINKS) {
            let number = interrupt as u32;
            self.add(core::NVIC_IPR + (number & !3), 0xFF << (number % 4 * 8));
        }
        for (address, mask) in [
            (core::VTOR, ALL),
            // PRIGROUP.
            (core::AIRCR, 0x700),
            (core::SCR, ALL),
            (core::CCR, ALL),
            (core::SHPR[0], ALL),
            (core::SHPR[1], ALL),
            (core::SHPR[2], ALL),
            (core::CPACR, ALL),
            (core::MPU_CTRL, ALL),
        ] {
            self.add(address, mask);
        }
    }
}

/// Whether a register is written again when it differs: the pins, and the resets and enables of
/// clocks.
fn is_restored(address: u32) -> bool {
    // SAFETY: addresses only.
    let rcc = unsafe { &*pac::RCC::PTR };
    let first = gpio::registers(Port::A).moder().as_ptr() as u32;
    let last = gpio::registers(Port::H).afrh().as_ptr() as u32;
    (first..=last).contains(&address)
        || [
            at!(rcc.ahb4rstr()),
            at!(rcc.apb2rstr()),
            at!(rcc.ahb4enr()),
            at!(rcc.apb2enr()),
        ]
        .contains(&address)
}

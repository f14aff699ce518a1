//! From reset to 400 MHz: supply, voltage scale, flash, clocks, caches, debug, priorities.
//!
//! Owner: `main`, once. The only waits of the firmware are here, and each is bounded: a clock that
//! does not come up ends in a panic, which leaves the motors at 0 V, writes a crash record and
//! resets the board. The HSE is the exception: without it the board runs from the HSI.
//!
//! The order is that of sections 6.6.1 (supply), 6.6.2 (voltage scaling), 4.3.8 (flash before
//! clock) and 8.5 (clock). ACTVOSRDY belongs to the supply configuration and VOSRDY to the scale:
//! waiting for the wrong one hangs, or goes on too early.

use super::pac::{self, CRS, FLASH, PWR, RCC};
use crate::clocks::{self, priority};
use cortex_m::peripheral::{MPU, NVIC, SCB};

/// Reads of a flag before it counts as missing: some milliseconds at 64 MHz; the slowest, HSE,
/// takes 2 ms.
const PATIENCE: u32 = 1_000_000;

/// Waits for a flag for a limited time.
fn wait(what: &'static str, mut ready: impl FnMut() -> bool) {
    if !wait_for(PATIENCE, &mut ready) {
        panic!("{} did not come up", what);
    }
}

/// Waits for a flag for at most `reads` reads of it; whether it came.
pub fn wait_for(reads: u32, mut ready: impl FnMut() -> bool) -> bool {
    (0..reads).any(|_| ready())
}

/// What the start of the clocks found.
pub struct Clocks {
    /// RCC_RSR as it was at boot.
    pub reset_flags: u32,
    /// The core runs from the HSE. `false`: it did not come up, and the core runs from the HSI.
    pub hse: bool,
}

/// REV_ID of DBGMCU_IDC (section 60.5.8): 0x1003 is revision Y, 0x2001 X, 0x2003 V.
pub fn revision(dbgmcu: &pac::DBGMCU) -> u16 {
    (dbgmcu.idc().read().bits() >> 16) as u16
}

/// The controller's own number (section 61.1).
pub fn unique_id() -> [u32; 3] {
    const UNIQUE_ID: *const [u32; 3] = 0x1FF1_E800 as *const [u32; 3];
    // SAFETY: system memory that every part of the family has and nothing writes.
    unsafe { UNIQUE_ID.read_volatile() }
}

/// Revision Y can return wrong data from AXI SRAM under some access patterns (ES0392 2.2.9,
/// "Reading from AXI SRAM may lead to data read corruption"): READ_ISS_OVERRIDE of the SRAM's AXI
/// target, at 0x5100_8108, prevents it.
pub fn axi_read_fix(silicon: u16) {
    if clocks::has_axi_read_defect(silicon) {
        // SAFETY: a register of the AXI interconnect (section 2.5.11) that nothing else writes.
        unsafe { (AXI_TARG7_FN_MOD as *mut u32).write_volatile(1) };
    }
}

/// Address of the register of [`axi_read_fix`].
pub const AXI_TARG7_FN_MOD: u32 = 0x5100_8108;

/// Supply and clocks. Clears RCC_RSR for the next boot.
pub fn clocks(rcc: &RCC, pwr: &PWR, flash: &FLASH) -> Clocks {
    let reset_flags = rcc.rsr().read().bits();
    rcc.rsr().modify(|_, w| w.rmvf().set_bit());

    // Supply from the regulator (section 6.8.4). The low byte of CR3 can be written once after a
    // power-on; after any other reset this write changes nothing.
    pwr.cr3()
        .modify(|_, w| w.scuen().set_bit().ldoen().set_bit().bypass().clear_bit());
    wait("PWR ACTVOSRDY", || {
        pwr.csr1().read().actvosrdy().bit_is_set()
    });
    // Voltage scale 1, for 400 MHz (section 6.8.6).
    // SAFETY: 0b11 is VOS1.
    pwr.d3cr().modify(|_, w| unsafe { w.vos().bits(0b11) });
    wait("PWR VOSRDY", || pwr.d3cr().read().vosrdy().bit_is_set());

    // Wait states before the clock that needs them (section 4.3.8).
    let (latency, delay) = clocks::FLASH_LATENCY;
    // SAFETY: values out of the manual's table, see `clocks::flash_latency`.
    flash
        .acr()
        .modify(|_, w| unsafe { w.latency().bits(latency).wrhighfreq().bits(delay) });
    wait("flash latency", || {
        flash.acr().read().latency().bits() == latency
    });

    // HSE in bypass: the ST-Link drives OSC_IN (section 8.5.2). Without its clock the board starts
    // from the HSI, which runs out of reset: sensors, outputs and the serial link work with its 1
    // %.
    rcc.cr().modify(|_, w| w.hsebyp().bypassed());
    rcc.cr().modify(|_, w| w.hseon().on().hsi48on().on());
    let hse = wait_for(PATIENCE, || rcc.cr().read().hserdy().bit_is_set());
    wait("HSI48", || rcc.cr().read().hsi48rdy().bit_is_set());

    // PLL1 (section 8.5.5): source and dividers while it is off, then on.
    let pll = if hse {
        clocks::PLL1
    } else {
        rcc.cr().modify(|_, w| w.hseon().off());
        clocks::PLL1_HSI
    };
    // SAFETY: dividers and ranges were checked by `clocks::Pll::new`.
    rcc.pllckselr().modify(|_, w| unsafe {
        if hse {
            w.pllsrc().hse();
        } else {
            w.pllsrc().hsi();
        }
        w.divm1().bits(pll.m)
    });
    rcc.pllcfgr().modify(|_, w| {
        // SAFETY: two bits, all four values exist.
        unsafe { w.pll1rge().bits(pll.input_range) };
        w.pll1vcosel().bit(pll.medium_vco).pll1fracen().reset();
        w.divp1en()
            .enabled()
            .divq1en()
            .enabled()
            .divr1en()
            .disabled()
    });
    // SAFETY: see above; the register holds each divider less one.
    rcc.pll1divr().modify(|_, w| unsafe {
        w.divn1()
            .bits(pll.n - 1)
            .divp1()
            .bits(pll.p - 1)
            .divq1()
            .bits(pll.q - 1)
    });
    rcc.cr().modify(|_, w| w.pll1on().on());
    wait("PLL1", || rcc.cr().read().pll1rdy().bit_is_set());

    // Bus dividers before the switch, so that no bus is ever too fast (section 8.5.6).
    rcc.d1cfgr()
        .modify(|_, w| w.d1cpre().div1().hpre().div2().d1ppre().div2());
    rcc.d2cfgr()
        .modify(|_, w| w.d2ppre1().div2().d2ppre2().div2());
    rcc.d3cfgr().modify(|_, w| w.d3ppre().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll1());
    wait("clock switch", || rcc.cfgr().read().sws().is_pll1());
    if hse {
        // An HSE that stops later raises the NMI, with the core on the HSI (section 8.5.3).
        rcc.cr().modify(|_, w| w.hsecsson().on());
    }

    // Kernel clocks (section 8.5.8): SPI1 from PLL1 Q, I2C1 and USART3 from APB1, USB from HSI48.
    rcc.d2ccip1r().modify(|_, w| w.spi123sel().pll1_q());
    rcc.d2ccip2r().modify(|_, w| {
        w.i2c123sel()
            .rcc_pclk1()
            .usart234578sel()
            .rcc_pclk1()
            .usbsel()
            .hsi48()
    });

    // Peripheral clocks (sections 8.7.38 to 8.7.48). SYSCFG routes EXTI lines; without its clock
    // the routing is silently dropped.
    rcc.apb4enr().modify(|_, w| w.syscfgen().enabled());
    rcc.apb1lenr()
        .modify(|_, w| w.tim2en().enabled().i2c1en().enabled().usart3en().enabled());
    rcc.apb2enr().modify(|_, w| w.spi1en().enabled());
    rcc.ahb1enr().modify(|_, w| w.dma1en().enabled());
    let _ = rcc.ahb1enr().read();
    Clocks { reset_flags, hse }
}

/// USB supply and clock. `false` if the supply detector finds none.
pub fn usb_supply(rcc: &RCC, pwr: &PWR) -> bool {
    // VDD33USB is wired to 3.3 V, so only its detector is needed (section 6.4.5).
    pwr.cr3().modify(|_, w| w.usb33den().set_bit());
    if !wait_for(10_000, || pwr.cr3().read().usb33rdy().bit_is_set()) {
        return false;
    }
    rcc.ahb1enr().modify(|_, w| w.usb2otgen().enabled());
    rcc.ahb1lpenr()
        .modify(|_, w| w.usb2otglpen().enabled().usb2otgulpilpen().disabled());
    let _ = rcc.ahb1lpenr().read();
    true
}

/// Lets HSI48 follow the host's start-of-frame, 1 kHz (section 9.4): the reset values of CFGR are
/// made for exactly that, with the source at the second OTG core (SYNCSRC = 3). Without a host
/// there is nothing to follow, and the factory's trimming is good enough to be enumerated.
pub fn trim_usb_clock() {
    // SAFETY: nothing else uses CRS; the enable bit of RCC is set after start-up by this function
    // alone.
    let (rcc, crs) = unsafe { (&*RCC::PTR, &*CRS::PTR) };
    rcc.apb1henr().modify(|_, w| w.crsen().enabled());
    let _ = rcc.apb1henr().read();
    // SAFETY: two bits of SYNCSRC.
    crs.cfgr().modify(|_, w| unsafe { w.syncsrc().bits(3) });
    crs.cr()
        .modify(|_, w| w.autotrimen().enabled().cen().enabled());
}

/// Bytes at the bottom of the stack that nothing may access.
pub const STACK_GUARD: u32 = 1 << STACK_GUARD_BITS;
const STACK_GUARD_BITS: u32 = 10;

/// Regions of the MPU (PM0253 section 4.6): flash is read only, nothing is executed from RAM, and
/// two regions let nothing in: a null pointer would read and write ITCM RAM, which exists and which
/// the firmware does not use; a stack that grows to its end would need memory below DTCM. Elsewhere
/// the default map holds. Any other access is a HardFault, in whose handler the MPU is off. The
/// emulation takes the fast way only to memory in a region.
pub fn guards(mpu: &mut MPU) {
    extern "C" {
        static _stack_end: u8;
    }
    let stack_end = core::ptr::addr_of!(_stack_end) as u32;
    // XN; AP: read only, full, or no access; TEX, C and B as in the default map: write-through, or
    // write-back with allocation.
    const READ_ONLY: u32 = 0b110 << 24 | 1 << 17;
    const DATA: u32 = 1 << 28 | 0b011 << 24 | 1 << 19 | 1 << 17 | 1 << 16;
    const NOTHING: u32 = 1 << 28;
    // The highest region that holds an address decides. Sizes as in `memory.x`.
    let regions = [
        (0x0800_0000, 21, READ_ONLY),
        (0x2400_0000, 19, DATA),
        (0x2000_0000, 17, DATA),
        (0, 12, NOTHING),
        (stack_end, STACK_GUARD_BITS, NOTHING),
    ];
    for (number, (base, bits, attributes)) in (0..).zip(regions) {
        // SAFETY: the linker places code in the first region, data in the second and the stack in
        // the third; no code touches the last two. Each base is a multiple of its size.
        unsafe {
            mpu.rnr.write(number);
            mpu.rbar.write(base);
            // SIZE, ENABLE.
            mpu.rasr.write(attributes | (bits - 1) << 1 | 1);
        }
    }
    // PRIVDEFENA, ENABLE.
    // SAFETY: what the default map permits stays permitted, but for these regions.
    unsafe { mpu.ctrl.write(1 << 2 | 1) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Instruction cache on; data cache off, so that DMA and core see the same memory contents.
/// The signal path runs out of flash at 2 wait states: the instruction cache is what makes it fast.
pub fn caches(scb: &mut SCB) {
    scb.enable_icache();
}

/// Keeps the debug port alive in WFI, which would otherwise cut a probe off (section 60.5.8), and
/// stops the watchdog while the core is halted.
pub fn debug(dbgmcu: &pac::DBGMCU) {
    dbgmcu.cr().modify(|_, w| {
        w.dbgsleep_d1()
            .set_bit()
            .d1dbgcken()
            .set_bit()
            .d3dbgcken()
            .set_bit()
    });
    dbgmcu.apb4fz1().modify(|_, w| w.dbg_wdglsd1().set_bit());
}

/// Interrupts of level [`priority::SAMPLE_PATH`], besides SysTick.
pub const SAMPLE_PATH: [pac::Interrupt; 10] = [
    pac::Interrupt::EXTI0,
    pac::Interrupt::EXTI1,
    pac::Interrupt::EXTI2,
    pac::Interrupt::EXTI3,
    pac::Interrupt::EXTI4,
    pac::Interrupt::EXTI9_5,
    pac::Interrupt::I2C1_EV,
    pac::Interrupt::I2C1_ER,
    pac::Interrupt::TIM2,
    pac::Interrupt::SPI1,
];

/// Interrupts of level [`priority::LINKS`].
pub const LINKS: [pac::Interrupt; 2] = [pac::Interrupt::DMA_STR0, pac::Interrupt::OTG_FS];

/// Priorities of [`crate::clocks::priority`]. Interrupts are unmasked by the modules that own them.
pub fn priorities(nvic: &mut NVIC, scb: &mut SCB) {
    for interrupt in SAMPLE_PATH {
        // SAFETY: priorities only; no critical section rests on them yet.
        unsafe { nvic.set_priority(interrupt, priority::SAMPLE_PATH) };
    }
    for interrupt in LINKS {
        // SAFETY: as above.
        unsafe { nvic.set_priority(interrupt, priority::LINKS) };
    }
    // SAFETY: as above. SysTick runs the bus scheduler's tick, so it has its level.
    unsafe {
        scb.set_priority(
            cortex_m::peripheral::scb::SystemHandler::SysTick,
            priority::SAMPLE_PATH,
        )
    };
}

/// Lets an interrupt through.
pub fn unmask(interrupt: pac::Interrupt) {
    // SAFETY: called by the owner of the interrupt, whose state is installed.
    unsafe { NVIC::unmask(interrupt) };
}

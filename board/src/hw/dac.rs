//! The DACs: SPI1, chip selects, LDAC, RST.
//!
//! Owner: the SPI1 interrupt (level `SAMPLE_PATH`); the superloop writes words to one slot per
//! unit; a newer word replaces one that was not sent yet.
//!
//! A word (section 50.4.9): CS low, one 16-bit frame in mode 3 at 12.5 MHz, interrupt at EOT, CS
//! high while SCLK idles high (a CS that rises while SCLK is low would shift one more bit), then an
//! LDAC pulse: the output moves 2 us after the word was handed over. AFCNTR keeps SCLK and MOSI
//! driven between frames.
//!
//! Nothing on the way to a DAC checks a word, and none can be read back. So every word is sent
//! again each millisecond, behind new ones: a word that noise has changed acts for a millisecond at
//! most instead of a sample's period.
//!
//! A missed deadline: a word that is not out after a millisecond means that SPI or its interrupt
//! has stopped. The DACs' RST goes low, which sets 0 V on all motors without SPI, and the
//! supervisor latches "DAC bus fault"; [`release`] comes after that is cleared.

use super::pac::{self, interrupt, SPI1};
use super::{gpio, startup, time, SamplePath};
use crate::clocks;
use crate::pins;
use control::{DacCode, Micros, UnitIndex, UnitSet, UNITS};

/// LDAC and RST pulses in core cycles: 50 ns and more.
const PULSE_CYCLES: u32 = 40;

static STATE: SamplePath<Dacs> = SamplePath::empty();

struct Dacs {
    /// Words to send.
    slots: [Option<u16>; UNITS],
    /// Unit whose word is being sent, and the start time.
    sending: Option<(UnitIndex, Micros)>,
    /// The word that is being sent was sent before.
    repeats: bool,
    /// Last word of each unit, and the units whose word is to be sent again.
    last: [u16; UNITS],
    again: UnitSet,
    /// Units whose word was sent since the last [`take_done`], and the times.
    done: UnitSet,
    done_at: [Micros; UNITS],
    /// SPI1_SR of a word that did not complete.
    error: Option<u32>,
}

fn spi1() -> &'static pac::spi1::RegisterBlock {
    // SAFETY: registers at a fixed address; used by `start` before the interrupt runs, then by code
    // that holds STATE.
    unsafe { &*SPI1::PTR }
}

/// Writes SPI1's mode; SPE must be 0.
fn configure(spi: &pac::spi1::RegisterBlock) {
    // SSI before MASTER: with software chip select and SSI = 0 a master sees itself deselected,
    // which is a mode fault that switches it off again (section 50.4.10). CFG1 and CFG2 while
    // SPE is 0.
    spi.cr1().write(|w| w.ssi().slave_not_selected());
    spi.cfg1().write(|w| {
        // SAFETY: DSIZE = 15 is a frame of 16 bits; MBR is three bits, computed in `clocks`.
        unsafe { w.dsize().bits(15).mbr().bits(clocks::SPI1_MBR) };
        w.fthlv().one_frame()
    });
    spi.cfg2().write(|w| {
        w.ssm()
            .enabled()
            .master()
            .master()
            .comm()
            .transmitter()
            .cpol()
            .idle_high()
            .cpha()
            .second_edge();
        w.lsbfrst().msbfirst().sp().motorola().afcntr().controlled()
    });
}

/// Sets SPI1 up, loads 0 V into all six DACs while their RST is still low, releases it, and loads 0
/// V again.
pub fn start() {
    configure(spi1());
    STATE.install(Dacs {
        slots: [None; UNITS],
        sending: None,
        repeats: false,
        last: [DacCode::ZERO_VOLT.0; UNITS],
        again: UnitSet::default(),
        done: UnitSet::default(),
        done_at: [Micros::default(); UNITS],
        error: None,
    });
    startup::unmask(pac::Interrupt::SPI1);
    load_zero();
    gpio::write(pins::DAC_RST, true);
    load_zero();
}

/// Loads 0 V into all six and waits until the words are sent: 15 us, at start-up and after a fault
/// only.
fn load_zero() {
    take_done();
    for unit in UnitIndex::ALL {
        write(unit, DacCode::ZERO_VOLT);
    }
    let mut out = UnitSet::default();
    startup::wait_for(10_000, || {
        out.extend(take_done().0.iter());
        out == UnitSet::ALL
    });
}

/// Queues a word. It is sent 2 us later, or up to 12 us where all six come at once.
pub fn write(unit: UnitIndex, code: DacCode) {
    STATE.masked(|dacs| {
        dacs.slots[unit as usize] = Some(code.0);
        dacs.last[unit as usize] = code.0;
        if dacs.sending.is_none() {
            dacs.send_next();
        }
    });
}

/// Units whose word was sent since the last call, and the time of each.
pub fn take_done() -> (UnitSet, [Micros; UNITS]) {
    STATE
        .masked(|dacs| (core::mem::take(&mut dacs.done), dacs.done_at))
        .unwrap_or_default()
}

/// SPI1_SR of a word that did not complete; cleared by the call.
pub fn take_error() -> Option<u32> {
    STATE.masked(|dacs| dacs.error.take()).flatten()
}

/// Whether RST is held low.
pub fn is_held() -> bool {
    !gpio::is_set(pins::DAC_RST)
}

/// Releases RST after the fault that pulled it was cleared. All DACs are at 0 V.
pub fn release() {
    gpio::write(pins::DAC_RST, true);
    load_zero();
}

/// Sets SPI1 up again after one of its registers or pins had changed. The word that was on its way
/// is dropped, and all words are 0 V until new ones come. The caller holds RST low.
pub fn restart() {
    STATE.masked(|dacs| {
        dacs.abort();
        // A mode fault holds MASTER and SPE at 0 until it is cleared (section 50.4.10).
        // SAFETY: the flags' bits of section 50.11.7; writing 1 clears them.
        spi1().ifcr().write(|w| unsafe { w.bits(0xFF8) });
        configure(spi1());
    });
}

/// Called by SysTick every millisecond: aborts a late word.
pub fn tick() {
    // SAFETY: SysTick has level SAMPLE_PATH and is not within another handler of it.
    unsafe {
        STATE.in_interrupt(|dacs| {
            if let Some((_, since)) = dacs.sending {
                if time::now().since(since) > clocks::DAC_DEADLINE_US {
                    gpio::write(pins::DAC_RST, false);
                    dacs.error = Some(spi1().sr().read().bits());
                    dacs.abort();
                }
            } else {
                dacs.again = UnitSet::ALL;
                dacs.send_next();
            }
        });
    }
}

/// Sets the level of a unit's select wire.
fn select(unit: UnitIndex, high: bool) {
    gpio::write(pins::DAC_CS[unit as usize], high);
}

impl Dacs {
    /// Switches SPI1 off and forgets every word.
    fn abort(&mut self) {
        spi1().ier().write(|w| w.eotie().disabled());
        spi1().cr1().modify(|_, w| w.spe().disabled());
        if let Some((unit, _)) = self.sending.take() {
            select(unit, true);
        }
        self.slots = [None; UNITS];
        self.last = [DacCode::ZERO_VOLT.0; UNITS];
    }

    /// A unit whose word is to be sent again, and the word.
    fn next_again(&mut self) -> Option<(UnitIndex, u16)> {
        let unit = self.again.iter().next()?;
        self.again.remove(unit);
        Some((unit, self.last[unit as usize]))
    }

    fn send_next(&mut self) {
        let new = UnitIndex::zip(&mut self.slots)
            .find_map(|(unit, slot)| slot.take().map(|word| (unit, word)));
        self.repeats = new.is_none();
        let Some((unit, word)) = new.or_else(|| self.next_again()) else {
            return;
        };
        self.sending = Some((unit, time::now()));
        select(unit, false);
        let spi = spi1();
        // SAFETY: one frame.
        spi.cr2().write(|w| unsafe { w.tsize().bits(1) });
        spi.cr1().modify(|_, w| w.spe().enabled());
        // EOTIE arms TXC too, which stands while SPE = 0 (errata ES0392 2.22.4): only while a word
        // is out.
        spi.ier().write(|w| w.eotie().enabled());
        // A 16-bit access: a wider one would put a second frame into the FIFO (section 50.4.8).
        // SAFETY: any word.
        spi.txdr16().write(|w| unsafe { w.txdr().bits(word) });
        spi.cr1().modify(|_, w| w.cstart().started());
    }
}

#[interrupt]
fn SPI1() {
    // SAFETY: a handler of level SAMPLE_PATH.
    unsafe {
        STATE.in_interrupt(|dacs| {
            let spi = spi1();
            if !spi.sr().read().eot().bit_is_set() {
                return;
            }
            spi.ier().write(|w| w.eotie().disabled());
            spi.ifcr().write(|w| w.eotc().clear().txtfc().clear());
            if let Some((unit, _)) = dacs.sending.take() {
                select(unit, true);
                gpio::write(pins::DAC_LDAC, false);
                cortex_m::asm::delay(PULSE_CYCLES);
                gpio::write(pins::DAC_LDAC, true);
                if !dacs.repeats {
                    dacs.done.insert(unit);
                    dacs.done_at[unit as usize] = time::now();
                }
            }
            // Only now: switched off too soon after EOT, the last SCLK pulse would be cut (errata
            // 2.22.6).
            spi.cr1().modify(|_, w| w.spe().disabled());
            dacs.send_next();
        });
    }
}

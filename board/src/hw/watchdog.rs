//! The independent watchdog and the alive line to the PLC.
//!
//! Owner: the supervisor, in the superloop. There is no interrupt, because both must stop when the
//! superloop stops. The superloop toggles the alive line once a millisecond; the PLC cuts the
//! amplifiers' power 10 ms after the last edge. The line stands still too while the outputs cannot
//! be trusted to be at 0 V ([`crate::machine::Machine::withholds_alive`]): then the PLC's relay is
//! what stops the motors. The watchdog is fed every 10 ms and only if every [`Part`] has checked in
//! since; it resets the processor 50 ms after the last feed. The DACs keep their code through a
//! reset, but the first instructions after it pull their RST.

use super::gpio;
use super::pac::IWDG;
use crate::clocks;
use crate::pins;
use control::supervisor::CheckIn;

/// Parts that must check in. The numbers are bits of the fault's detail.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Part {
    /// The superloop took all samples off the queue.
    Samples = 0,
    /// The bus scheduler's tick ran (a millisecond was seen).
    Tick = 1,
    /// No DAC word is late.
    Dac = 2,
    /// Both links were served.
    Links = 3,
    /// The supervisor ran.
    Supervisor = 4,
}

const ALL: u32 = 0b1_1111;

/// Keys of IWDG_KR (section 45.4.1).
const FEED: u16 = 0xAAAA;
const UNLOCK: u16 = 0x5555;
const START: u16 = 0xCCCC;

fn key(registers: &IWDG, key: u16) {
    // SAFETY: one of the three keys above; any other value does nothing.
    registers.kr().write(|w| unsafe { w.bits(key) });
}

/// See the [module](self).
pub struct Watchdog {
    registers: IWDG,
    check_in: CheckIn,
    since_feed_ms: u32,
    alive: bool,
}

impl Watchdog {
    /// Starts the watchdog (section 45.3.1). Nothing stops it any more.
    pub fn start(registers: IWDG) -> Self {
        // Start, unlock, set, wait until the values have crossed into the LSI's domain, feed.
        key(&registers, START);
        key(&registers, UNLOCK);
        // SAFETY: three bits, computed in `clocks`.
        registers
            .pr()
            .write(|w| unsafe { w.bits(clocks::IWDG_PR.into()) });
        // SAFETY: twelve bits, computed in `clocks`.
        registers
            .rlr()
            .write(|w| unsafe { w.bits(clocks::IWDG_RLR) });
        super::startup::wait_for(1_000_000, || registers.sr().read().bits() == 0);
        key(&registers, FEED);
        Self {
            registers,
            check_in: CheckIn::new(ALL),
            since_feed_ms: 0,
            alive: false,
        }
    }

    /// Records that this part has run.
    pub fn check_in(&mut self, part: Part) {
        self.check_in.check_in(part as u32);
    }

    /// Call it once a millisecond: toggles the alive line unless it is withheld (`allow_alive`
    /// false), and feeds the watchdog every [`clocks::WATCHDOG_FEED_MS`] if every part has checked
    /// in. If not, returns the bits of the missing parts.
    pub fn tick(&mut self, allow_alive: bool) -> Option<u32> {
        if allow_alive {
            self.alive = !self.alive;
            gpio::write(pins::ALIVE, self.alive);
        }
        self.since_feed_ms += 1;
        if self.since_feed_ms < clocks::WATCHDOG_FEED_MS {
            return None;
        }
        self.since_feed_ms = 0;
        if self.check_in.complete() {
            key(&self.registers, FEED);
            None
        } else {
            Some(self.check_in.missing())
        }
    }
}

/// Resets the processor at once.
pub fn reset() -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

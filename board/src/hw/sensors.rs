//! The load-cell converters: DRDY edges, the I2C controller, and the bus scheduler that joins them.
//!
//! Owner: the interrupts of level `SAMPLE_PATH`, which share the state below without locks. Thread
//! mode takes events from a queue and sets bits in an atomic word, so it never masks an interrupt
//! here.
//!
//! * EXTI0 to 4, EXTI9_5: rising edge of a DRDY line. Ignored where the line is low again: a
//!   conversion holds it high until its result is read, so a short pulse is noise. Otherwise
//!   records the time, passes the unit to the scheduler and wakes the superloop, which reads the
//!   encoder during the I2C read. Line 8 is the E-stop loop: its falling edge (the loop opened)
//!   only records the time for the fault's detail. The supervisor polls the level.
//! * I2C1_EV: next byte; at the STOP the sample goes onto the queue and the next transaction
//!   starts.
//! * I2C1_ER: lost arbitration, overrun: the scheduler starts its recovery. A bus error is cleared
//!   and ignored.
//! * TIM2: next step of a recovery, 5 us after the last.
//! * SysTick ([`super::tick`]): deadlines, units to start and stop, lost edges.
//!
//! A missed deadline: a transaction that is not complete after 300 us is aborted at the next DRDY
//! edge or millisecond, whichever comes first, the bus is recovered within 150 us, and the sample
//! is read again. The other units lose nothing: their results wait in their converters for 2.9 ms.
//!
//! The controller (section 47.4): a write of one or two bytes; if bytes are to be read, the write
//! ends without STOP (AUTOEND = 0, flag TC) and a read with a repeated START follows. After a NACK
//! the controller sends the STOP by itself, so every transaction ends with STOPF.

use super::pac::{EXTI, I2C1, SYSCFG};
use super::{gpio, pac, startup, time, SamplePath};
use crate::bus::{Bus, Event, Sink, Transfer, TransferError, Work};
use crate::clocks;
use crate::pins;
use crate::shared::{Requests, Setting, Word};
use control::{Micros, UnitIndex, UnitSet};
use core::sync::atomic::{AtomicBool, AtomicU32};
use heapless::spsc;
use pac::interrupt;

/// Capacity of the event queue plus one: edges and samples of six units, and the events of several
/// failures.
pub const QUEUE: usize = 32;

/// The superloop's end of the queue.
///
/// Both ends check that the queue has room at all, which it always has. The queue's own code
/// divides by its size, which the compiler cannot see behind the reference; without the check each
/// division has a panic behind it, and the sample path has none.
pub struct Events(spsc::Consumer<'static, Event>);

impl Events {
    /// Takes the oldest event.
    pub fn dequeue(&mut self) -> Option<Event> {
        (self.0.capacity() != NO_ROOM).then(|| self.0.dequeue())?
    }

    /// Number of events that wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        if self.0.capacity() == NO_ROOM {
            0
        } else {
            self.0.len()
        }
    }

    /// Whether an event waits.
    #[must_use]
    pub fn ready(&self) -> bool {
        self.0.ready()
    }
}

/// Capacity of a queue of size 0, one less than its size.
const NO_ROOM: usize = usize::MAX;

static STATE: SamplePath<Sensors> = SamplePath::empty();
/// Units to start and units to stop with the next tick.
static REQUESTS: Requests = Requests::of(AtomicU32::new(0));
/// Whether register pointers are written ahead of the samples.
static POINTER_AHEAD: Setting = Setting::of(AtomicBool::new(true));
/// Events dropped because the queue was full.
static LOST: Word = Word::of(AtomicU32::new(0));
/// Board time when the E-stop loop opened last.
static ESTOP_OPENED: Word = Word::of(AtomicU32::new(0));

struct Queue(spsc::Producer<'static, Event>);

impl Sink for Queue {
    fn event(&mut self, event: Event) {
        if self.0.capacity() == NO_ROOM || self.0.enqueue(event).is_err() {
            LOST.count();
        }
    }
}

struct Sensors {
    bus: Bus,
    queue: Queue,
    transfer: Transfer,
    written: u8,
    read: [u8; 3],
    got: u8,
    nack: bool,
}

/// Sets up the controller and the EXTI lines and unmasks the interrupts.
pub fn start(syscfg: &SYSCFG, exti: &EXTI) -> Events {
    let queue = cortex_m::singleton!(: spsc::Queue<Event, QUEUE> = spsc::Queue::new());
    let Some(queue) = queue else {
        panic!("sensors started twice")
    };
    let (producer, consumer) = queue.split();
    STATE.install(Sensors {
        bus: Bus::new(),
        queue: Queue(producer),
        transfer: Transfer {
            address: 0,
            write: [0; 2],
            write_len: 0,
            read_len: 0,
        },
        written: 0,
        read: [0; 3],
        got: 0,
        nack: false,
    });

    // TIMINGR and the filters with PE = 0 (section 47.4.5); analog filter on, digital off: reset
    // values.
    let i2c = i2c1();
    // SAFETY: fields computed and tested in `clocks::i2c_timingr`.
    i2c.timingr()
        .write(|w| unsafe { w.bits(clocks::I2C_TIMINGR) });
    i2c.cr1().modify(|_, w| {
        w.txie()
            .enabled()
            .rxie()
            .enabled()
            .nackie()
            .enabled()
            .stopie()
            .enabled()
            .tcie()
            .enabled()
            .errie()
            .enabled()
    });
    i2c.cr1().modify(|_, w| w.pe().enabled());

    // Lines 0 to 5 and 8 come from ports F and G (section 12.3.2: 5 = F, 6 = G).
    // SAFETY: four bits a line; ports F and G exist.
    syscfg.exticr1().modify(|_, w| unsafe {
        w.exti0()
            .bits(5)
            .exti1()
            .bits(5)
            .exti2()
            .bits(5)
            .exti3()
            .bits(5)
    });
    // SAFETY: port F is 5 (section 12.3.3).
    syscfg
        .exticr2()
        .modify(|_, w| unsafe { w.exti4().bits(5).exti5().bits(5) });
    // SAFETY: port G is 6 (section 12.3.4).
    syscfg.exticr3().modify(|_, w| unsafe { w.exti8().bits(6) });
    // Rising edges of DRDY, falling ones of the E-stop loop; then unmask (section 20.6).
    // SAFETY: bits of lines 0 to 8 only, all of which are configurable lines.
    exti.rtsr1()
        .modify(|r, w| unsafe { w.bits(r.bits() | DRDY_LINES) });
    // SAFETY: the bit of the E-stop's line, a configurable line.
    exti.ftsr1()
        .modify(|r, w| unsafe { w.bits(r.bits() | ESTOP_LINE) });
    // SAFETY: pending bits of these lines; writing 1 clears them.
    exti.cpupr1()
        .write(|w| unsafe { w.bits(DRDY_LINES | ESTOP_LINE) });
    // SAFETY: mask bits of these lines alone.
    exti.cpuimr1()
        .modify(|r, w| unsafe { w.bits(r.bits() | DRDY_LINES | ESTOP_LINE) });

    use pac::Interrupt as I;
    for interrupt in [
        I::EXTI0,
        I::EXTI1,
        I::EXTI2,
        I::EXTI3,
        I::EXTI4,
        I::EXTI9_5,
        I::I2C1_EV,
        I::I2C1_ER,
        I::TIM2,
    ] {
        startup::unmask(interrupt);
    }
    Events(consumer)
}

/// Requests the bring-up of a unit's converter. It begins within a millisecond.
pub fn start_sensor(unit: UnitIndex) {
    REQUESTS.start(unit);
}

/// Requests that a unit's converter is no longer serviced. Takes effect within a millisecond.
pub fn stop_sensor(unit: UnitIndex) {
    REQUESTS.stop(unit);
}

/// Whether register pointers are written ahead of the samples. Takes effect within a millisecond.
pub fn set_pointer_ahead(ahead: bool) {
    POINTER_AHEAD.set(ahead);
}

/// Events lost since boot because the superloop did not take them.
pub fn events_lost() -> u32 {
    LOST.get()
}

/// Board time when the E-stop loop opened last.
pub fn estop_opened_at() -> Micros {
    Micros(ESTOP_OPENED.get())
}

const DRDY_LINES: u32 = 0x3F;
const ESTOP_LINE: u32 = 1 << pins::E_STOP.number;

fn i2c1() -> &'static pac::i2c1::RegisterBlock {
    // SAFETY: registers at a fixed address; used by `start` before its interrupts run and by
    // handlers of one priority afterwards.
    unsafe { &*I2C1::PTR }
}

fn exti() -> &'static pac::exti::RegisterBlock {
    // SAFETY: the handlers write the pending register only, whose bits are cleared one by one.
    unsafe { &*EXTI::PTR }
}

/// Runs `f` on the state, then gives the bus its next work.
///
/// # Safety
/// As [`SamplePath::in_interrupt`].
unsafe fn with(f: impl FnOnce(&mut Sensors, Micros)) {
    // SAFETY: passed on.
    unsafe {
        STATE.in_interrupt(|sensors| {
            f(sensors, time::now());
            sensors.work();
        });
    }
}

/// Called by SysTick every millisecond.
pub fn tick() {
    // SAFETY: SysTick has level SAMPLE_PATH and is not within another handler of it.
    unsafe {
        with(|sensors, now| {
            let (start, stop) = REQUESTS.take();
            stop.iter().for_each(|unit| sensors.bus.stop(unit));
            start.iter().for_each(|unit| sensors.bus.start(unit, now));
            sensors.bus.set_pointer_ahead(POINTER_AHEAD.get());
            let levels = gpio::registers(pins::DRDY[0].port).idr().read().bits() & DRDY_LINES;
            let high = UnitSet::from_mask(levels as u8);
            sensors.bus.tick(now, high, &mut sensors.queue);
        });
    }
}

impl Sensors {
    fn work(&mut self) {
        // Each pass starts an action that ends with an interrupt, or switches the lines, which
        // happens once at the start of a recovery and once at its end.
        while let Some(work) = self.bus.next(time::now(), &mut self.queue) {
            match work {
                Work::Transfer(transfer) => return self.begin(transfer),
                Work::TakeLines => {
                    // PE = 0 resets the controller's state machine and flags (section 47.4.6).
                    i2c1().cr1().modify(|_, w| w.pe().disabled());
                    for pin in [pins::I2C_SCL, pins::I2C_SDA] {
                        gpio::write(pin, true);
                        gpio::set_output(pin, true);
                    }
                }
                Work::Lines { scl, sda } => {
                    gpio::write(pins::I2C_SDA, sda);
                    gpio::write(pins::I2C_SCL, scl);
                    return time::set_alarm(clocks::RECOVERY_STEP_US);
                }
                Work::MuxReset { low } => {
                    gpio::write(pins::MUX_RST, !low);
                    return time::set_alarm(clocks::RECOVERY_STEP_US);
                }
                Work::GiveLines => {
                    for pin in [pins::I2C_SCL, pins::I2C_SDA] {
                        gpio::set_output(pin, false);
                    }
                    i2c1().cr1().modify(|_, w| w.pe().enabled());
                }
            }
        }
    }

    /// Starts a transaction (section 47.4.8).
    fn begin(&mut self, transfer: Transfer) {
        self.transfer = transfer;
        self.written = 0;
        self.got = 0;
        self.nack = false;
        let reads_at_once = transfer.write_len == 0;
        let length = if reads_at_once {
            transfer.read_len
        } else {
            transfer.write_len
        };
        i2c1().cr2().write(|w| {
            // SAFETY: a 7-bit address in bits 7:1, and a length of 1 to 3.
            unsafe {
                w.sadd()
                    .bits(u16::from(transfer.address) << 1)
                    .nbytes()
                    .bits(length)
            };
            w.rd_wrn().bit(reads_at_once);
            w.autoend()
                .bit(reads_at_once || transfer.read_len == 0)
                .start()
                .start()
        });
    }

    /// One event; the outcome where it was the last (section 47.4.8, flow charts).
    fn event(&mut self) -> Option<Result<[u8; 3], TransferError>> {
        let i2c = i2c1();
        let flags = i2c.isr().read();
        if flags.nackf().bit_is_set() {
            i2c.icr().write(|w| w.nackcf().clear());
            self.nack = true;
        }
        if flags.rxne().bit_is_set() {
            let byte = i2c.rxdr().read().rxdata().bits();
            if let Some(slot) = self.read.get_mut(usize::from(self.got)) {
                *slot = byte;
                self.got += 1;
            }
        }
        if flags.txis().bit_is_set() {
            let byte = self
                .transfer
                .write
                .get(usize::from(self.written))
                .copied()
                .unwrap_or(0);
            self.written += 1;
            // SAFETY: any byte.
            i2c.txdr().write(|w| unsafe { w.txdata().bits(byte) });
        }
        if flags.tc().bit_is_set() {
            i2c.cr2().write(|w| {
                // SAFETY: as in `begin`; a length of 1 to 3.
                unsafe {
                    w.sadd()
                        .bits(u16::from(self.transfer.address) << 1)
                        .nbytes()
                        .bits(self.transfer.read_len)
                };
                w.rd_wrn().read().autoend().automatic().start().start()
            });
        }
        if flags.stopf().bit_is_set() {
            i2c.icr().write(|w| w.stopcf().clear());
            if self.nack {
                // A byte may wait in TXDR that would start the next transaction: flush it (TXE =
                // 1).
                i2c.isr().write(|w| w.txe().set_bit());
                return Some(Err(TransferError::Nack));
            }
            let whole =
                self.got >= self.transfer.read_len && self.written >= self.transfer.write_len;
            return Some(if whole {
                Ok(self.read)
            } else {
                Err(TransferError::Bus)
            });
        }
        None
    }
}

#[interrupt]
fn I2C1_EV() {
    // SAFETY: a handler of level SAMPLE_PATH.
    unsafe {
        STATE.in_interrupt(|sensors| {
            if let Some(outcome) = sensors.event() {
                sensors
                    .bus
                    .finished(outcome, time::now(), &mut sensors.queue);
                sensors.work();
            }
        });
    }
}

#[interrupt]
fn I2C1_ER() {
    // SAFETY: a handler of level SAMPLE_PATH.
    unsafe {
        with(|sensors, now| {
            let flags = i2c1().isr().read();
            i2c1()
                .icr()
                .write(|w| w.berrcf().clear().arlocf().clear().ovrcf().clear());
            // A bus error in controller mode is spurious and the transfer continues (ES0392
            // 2.19.4): only its flag is cleared. One that is real ends the transfer, which then
            // misses its deadline.
            if flags.arlo().bit_is_clear() && flags.ovr().bit_is_clear() {
                return;
            }
            sensors
                .bus
                .finished(Err(TransferError::Bus), now, &mut sensors.queue);
        });
    }
}

#[interrupt]
fn TIM2() {
    time::clear_alarm();
    // SAFETY: a handler of level SAMPLE_PATH.
    unsafe { with(|sensors, _| sensors.bus.stepped(gpio::read(pins::I2C_SDA))) };
}

/// A DRDY line rose.
///
/// # Safety
/// Only from handlers of level SAMPLE_PATH.
unsafe fn edge(unit: UnitIndex) {
    // SAFETY: writing one bit clears one flag (section 20.6.16).
    exti()
        .cpupr1()
        .write(|w| unsafe { w.bits(1 << unit as u32) });
    if !gpio::read(pins::DRDY[unit as usize]) {
        return;
    }
    // SAFETY: passed on.
    unsafe { with(|sensors, now| sensors.bus.drdy(unit, now, &mut sensors.queue)) };
}

macro_rules! drdy_lines {
    ($($interrupt:ident => $unit:ident),*) => {$(
        #[interrupt]
        fn $interrupt() {
            // SAFETY: a handler of level SAMPLE_PATH.
            unsafe { edge(UnitIndex::$unit) };
        }
    )*};
}
drdy_lines!(EXTI0 => Unit1, EXTI1 => Unit2, EXTI2 => Unit3, EXTI3 => Unit4, EXTI4 => Unit5);

#[interrupt]
fn EXTI9_5() {
    let pending = exti().cpupr1().read().bits();
    if pending & ESTOP_LINE != 0 {
        // SAFETY: as in `edge`.
        exti().cpupr1().write(|w| unsafe { w.bits(ESTOP_LINE) });
        ESTOP_OPENED.set(time::now().0);
    }
    if pending & (1 << 5) != 0 {
        // SAFETY: a handler of level SAMPLE_PATH.
        unsafe { edge(UnitIndex::Unit6) };
    }
}

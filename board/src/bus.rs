//! The scheduler of the I2C bus: who may use it next, and what to do when it fails. Pure; the hardware
//! half carries out what [`Bus::next`] says and reports back.
//!
//! # Order of service
//! 1. A unit with a sample ready: first the one whose multiplexer channel is selected already, else the
//!    one that has waited longest. No unit can starve another: each has at most one sample waiting, and
//!    six services (190 us each) fit twice into the shortest sample period (2,900 us).
//! 2. A step of a converter's bring-up, when no sample is due within [`SEQUENCE_ROOM_US`]; one that has
//!    waited for [`SEQUENCE_PATIENCE_US`] goes anyway. All six bring-ups advance at the same time, their
//!    calibrations overlap, and units that stream go on streaming.
//! 3. What can be done ahead of the next sample is: the register pointer of the converter that was
//!    read last goes back to its result (a read leaves it behind it), then the multiplexer goes to the
//!    channel whose converter is due next. A sample then needs neither: 92 us on the bus where all of it
//!    takes 190, for bus time that nobody wanted.
//!
//! That a converter keeps its pointer over a STOP is not in our extract of its datasheet; drivers in the field
//! write the pointer and read in two transactions, STOP between them. After any failure on the bus no
//! pointer is trusted.
//!
//! # When it fails
//! A NACK behind the multiplexer costs one retry with a fresh select (the cached channel is unknown after
//! any failure). Everything else (bus error, lost arbitration, a transaction past its deadline) goes up
//! a ladder, each step of it a few microseconds of an interrupt, never a wait:
//!
//! 1. the lines as GPIO, up to nine clocks until SDA is free, STOP (UM10204 section 3.1.16);
//! 2. if that did not free SDA, or another failure came before anything worked again: RESET of the
//!    multiplexer, and the clocks once more, now without the modules behind it;
//! 3. channel unknown: the next transaction selects again;
//! 4. a unit that keeps failing is reported, switched off by the supervisor and brought up again from the
//!    start when its fault is cleared.
//!
//! A bus that stays held after [`STUCK_AFTER`] rounds is reported as stuck and tried again every
//! [`STUCK_PAUSE_US`].
//!
//! # A missed deadline
//! A sample that is not read before the next conversion ends is gone: the converter overwrites it. The gap
//! between DRDY edges shows it; it is counted in [`Event::Sample::missed`] of the next sample.

use crate::clocks::I2C_DEADLINE_US;
use drivers::nau7802::{self, Action, AdcCode, Bringup, SequenceError};
use drivers::tca9548::recovery::{BusClear, BusClearStep};
use drivers::tca9548::{Address, ChannelMask, MuxState, Selector};
use wire::UNITS;

/// A step of a bring-up starts only if no sample is due within this time, in microseconds: select and the
/// longest step, 50 + 100 us, and 50 us to select back.
pub const SEQUENCE_ROOM_US: i32 = 200;
/// A step of a bring-up waits at most this long for a gap, in microseconds.
pub const SEQUENCE_PATIENCE_US: u32 = 5_000;
/// Rounds of recovery without a transaction that worked, after which the bus counts as stuck.
pub const STUCK_AFTER: u16 = 4;
/// Pause between further rounds on a stuck bus, in microseconds.
pub const STUCK_PAUSE_US: u32 = 20_000;
/// Refusals of the multiplexer in a row after which it is reset, and reported.
pub const MUX_REFUSALS: u8 = 3;

const PERIOD_US: u32 = control::NOMINAL_PERIOD_US;

/// One transaction: a write, a read, or a read after a write, with STOP at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transfer {
    /// 7-bit address.
    pub address: u8,
    /// Bytes to write.
    pub write: [u8; 2],
    /// How many of them, 0 to 2.
    pub write_len: u8,
    /// Bytes to read, 0 to 3; after a repeated START where something is written first.
    pub read_len: u8,
}

impl Transfer {
    const fn write(address: u8, bytes: [u8; 2], len: u8) -> Self {
        Self {
            address,
            write: bytes,
            write_len: len,
            read_len: 0,
        }
    }

    const fn write_read(address: u8, register: u8, len: u8) -> Self {
        Self {
            address,
            write: [register, 0],
            write_len: 1,
            read_len: len,
        }
    }
}

/// Why a transaction did not end well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferError {
    /// Not acknowledged; the controller has sent a STOP.
    Nack,
    /// Misplaced START or STOP, lost arbitration, overrun: the bus is in an unknown state.
    Bus,
    /// Past its deadline: a line is held, or a clock is stretched for ever.
    Timeout,
}

/// What the hardware does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Start this transaction and report [`Bus::finished`].
    Transfer(Transfer),
    /// Switch the controller off and take SCL and SDA as open-drain GPIO, both released. Ask again at once.
    TakeLines,
    /// Put the lines like this; after [`crate::clocks::RECOVERY_STEP_US`] report [`Bus::stepped`].
    Lines {
        /// SCL released (high) or pulled low.
        scl: bool,
        /// SDA released or pulled low.
        sda: bool,
    },
    /// Put RESET of the multiplexer like this; after the same time report [`Bus::stepped`].
    MuxReset {
        /// `true`: pulled low, the part is held in reset.
        low: bool,
    },
    /// Give the lines back to the controller and switch it on. Ask again at once.
    GiveLines,
}

/// What the superloop hears of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A conversion has ended and its result will follow: the time to read what belongs to it (the encoder).
    Edge {
        /// Unit, from 0.
        unit: u8,
    },
    /// A sample.
    Sample {
        /// Unit, from 0.
        unit: u8,
        /// Conversion result.
        code: AdcCode,
        /// DRDY edge, board time in microseconds.
        at: u32,
        /// Conversions that were lost between the sample before and this one.
        missed: u8,
    },
    /// A converter's bring-up has ended well; samples follow.
    Up {
        /// Unit, from 0.
        unit: u8,
    },
    /// A converter's bring-up was given up.
    BringUpFailed {
        /// Unit, from 0.
        unit: u8,
        /// Where and why.
        error: SequenceError,
    },
    /// A sample was ready and could not be read.
    ReadFailed {
        /// Unit, from 0.
        unit: u8,
        /// Failures in a row.
        in_a_row: u8,
    },
    /// The bus was recovered (or an attempt was made).
    Recovery,
    /// The bus is held after [`STUCK_AFTER`] rounds.
    Stuck {
        /// Rounds so far.
        rounds: u16,
        /// SDA is low.
        sda_low: bool,
    },
    /// The multiplexer refused [`MUX_REFUSALS`] selects in a row.
    MuxSilent {
        /// Mask that was to be written.
        mask: u8,
    },
}

/// Where events go. The hardware half has a queue behind it, tests a vector.
pub trait Sink {
    /// Takes an event; never waits.
    fn event(&mut self, event: Event);
}

/// What the bus is busy with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    Select(ChannelMask),
    Read { unit: u8, at: u32 },
    Point { unit: u8 },
    Sequence { unit: u8 },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    Do(Action),
    Wait { until: u32 },
}

#[derive(Debug, Clone)]
enum Phase {
    /// Not looked after: edges are ignored.
    Off,
    /// Being set up; `since`: when the next step could have started.
    BringUp {
        machine: Bringup,
        next: Next,
        since: u32,
    },
    Streaming,
}

#[derive(Debug, Clone)]
struct Unit {
    phase: Phase,
    /// DRDY edge whose sample is still in the converter.
    ready: Option<u32>,
    last_edge: Option<u32>,
    /// Averaged period in microseconds times 16.
    period_q4: u32,
    missed: u8,
    failures: u8,
    /// The register pointer stands at the result.
    pointed: bool,
}

impl Unit {
    const fn new() -> Self {
        Self {
            phase: Phase::Off,
            ready: None,
            last_edge: None,
            period_q4: PERIOD_US << 4,
            missed: 0,
            failures: 0,
            pointed: false,
        }
    }

    const fn period(&self) -> u32 {
        self.period_q4 >> 4
    }

    /// Microseconds until the next edge is expected (negative: overdue); `None` if there is nothing to go by.
    fn due_in(&self, now: u32) -> Option<i32> {
        let last = match (&self.phase, self.last_edge) {
            (Phase::Streaming, Some(last)) => last,
            _ => return None,
        };
        let due = last
            .wrapping_add(self.period())
            .wrapping_sub(now)
            .cast_signed();
        // Long overdue: lost its plug, rather than late.
        (due > -(PERIOD_US.cast_signed() / 4)).then_some(due)
    }
}

/// How far a recovery has come.
#[derive(Debug, Clone, Copy)]
enum Recovery {
    Take,
    Clear {
        clear: BusClear,
        sda_high: bool,
        after_reset: bool,
    },
    ResetLow,
    ResetHigh,
    Give,
    Pause {
        until: u32,
    },
}

/// The scheduler. All its functions run at one interrupt priority, so it needs no locks.
#[derive(Debug, Clone)]
pub struct Bus {
    units: [Unit; UNITS],
    mux: Selector,
    mux_refusals: u8,
    /// Current job and when it started.
    current: Option<(Job, u32)>,
    recovery: Option<Recovery>,
    /// A step of the recovery is on its way.
    stepping: bool,
    /// Rounds of recovery since a transaction worked.
    rounds: u16,
}

impl Default for Bus {
    fn default() -> Self {
        Self::new()
    }
}

const fn mask_of(unit: u8) -> ChannelMask {
    ChannelMask::from_bits(1 << unit)
}

impl Bus {
    /// A bus with all units off.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            units: [const { Unit::new() }; UNITS],
            mux: Selector::new(),
            mux_refusals: 0,
            current: None,
            recovery: None,
            stepping: false,
            rounds: 0,
        }
    }

    /// Starts the bring-up of a unit's converter, whatever it was doing.
    pub fn start(&mut self, unit: u8, now: u32) {
        if let Some(slot) = self.units.get_mut(usize::from(unit)) {
            let mut machine = Bringup::new(nau7802::Config::FORCE_UNIT);
            let next = Next::Do(machine.next(nau7802::Event::Start));
            *slot = Unit {
                phase: Phase::BringUp {
                    machine,
                    next,
                    since: now,
                },
                ..Unit::new()
            };
            self.settle(unit, now, &mut Discard);
        }
    }

    /// Stops looking after a unit.
    pub fn stop(&mut self, unit: u8) {
        if let Some(slot) = self.units.get_mut(usize::from(unit)) {
            *slot = Unit::new();
        }
    }

    /// A DRDY line rose.
    pub fn drdy(&mut self, unit: u8, now: u32, sink: &mut impl Sink) {
        let Some(slot) = self.units.get_mut(usize::from(unit)) else {
            return;
        };
        if !matches!(slot.phase, Phase::Streaming) {
            return;
        }
        if let Some(last) = slot.last_edge {
            let interval = now.wrapping_sub(last);
            let period = slot.period();
            if slot.ready.is_some() && interval < period / 2 {
                return; // the same edge, seen by the tick already
            }
            // Edges in this interval, this one included; a shift-free rounding of interval / period.
            let mut edges = 0;
            let mut rest = interval + period / 2;
            while rest >= period && edges < 255 {
                rest -= period;
                edges += 1;
            }
            if edges == 1 {
                let average = slot.period_q4 - (slot.period_q4 >> 4) + interval;
                // A converter is within 3 % of its nominal rate; what is beyond 6 % is no period of one.
                slot.period_q4 = average.clamp(PERIOD_US * 15, PERIOD_US * 17);
            }
            slot.missed = slot.missed.saturating_add(u8::saturating_sub(edges, 1));
        }
        slot.last_edge = Some(now);
        slot.ready = Some(now);
        sink.event(Event::Edge { unit });
    }

    /// The supervisor's millisecond: deadlines, and edges that were never seen. `drdy_levels` has a bit for
    /// each line that is high.
    pub fn tick(&mut self, now: u32, drdy_levels: u8, sink: &mut impl Sink) {
        self.check_deadline(now, sink);
        for (n, unit) in self.units.iter_mut().enumerate() {
            let overdue = unit
                .last_edge
                .is_none_or(|last| now.wrapping_sub(last) > PERIOD_US + PERIOD_US / 4);
            // The line stays high until the result is read: high without an edge is an edge that was lost.
            if matches!(unit.phase, Phase::Streaming)
                && drdy_levels & (1 << n) != 0
                && unit.ready.is_none()
                && overdue
                && !matches!(self.current, Some((Job::Read { unit, .. }, _)) if usize::from(unit) == n)
            {
                if unit.last_edge.is_some() {
                    unit.missed = unit.missed.saturating_add(1);
                }
                unit.last_edge = Some(now);
                unit.ready = Some(now);
                sink.event(Event::Edge { unit: n as u8 });
            }
        }
    }

    /// The transaction has ended; `read` holds the bytes that were read.
    pub fn finished(
        &mut self,
        result: Result<[u8; 3], TransferError>,
        now: u32,
        sink: &mut impl Sink,
    ) {
        let Some((job, _)) = self.current.take() else {
            return;
        };
        match result {
            Ok(bytes) => {
                self.rounds = 0;
                self.succeeded(job, bytes, now, sink);
            }
            Err(error) => self.failed(job, error, now, sink),
        }
    }

    /// A step of the recovery is over; `sda_high` is the level of SDA now.
    pub fn stepped(&mut self, sda_level: bool) {
        self.stepping = false;
        if let Some(Recovery::Clear { sda_high, .. }) = &mut self.recovery {
            *sda_high = sda_level;
        }
    }

    /// Whether a transaction is on the bus.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.current.is_some()
    }

    /// What to do now. Ask after every other call; `None`: nothing, or still waiting for the last answer.
    pub fn next(&mut self, now: u32, sink: &mut impl Sink) -> Option<Work> {
        if self.stepping {
            return None;
        }
        if self.recovery.is_some() {
            if let Some(work) = self.recover(now, sink) {
                return Some(work);
            }
            if self.recovery.is_some() {
                return None;
            }
        }
        if self.current.is_some() {
            return None;
        }
        if let Some(unit) = self.choose_ready(now) {
            return Some(self.read_or_select(unit, now));
        }
        if let Some(unit) = self.to_point() {
            let transfer = Transfer::write(nau7802::ADDRESS, [nau7802::proto::READ_ADC[0], 0], 1);
            return Some(self.begin(Job::Point { unit }, transfer, now));
        }
        if let Some(unit) = self.choose_sequence(now) {
            return self.sequence_or_select(unit, now, sink);
        }
        let unit = self.due_next(now)?;
        let mask = mask_of(unit);
        self.mux
            .request(mask)
            .map(|byte| self.select(byte[0], mask, now))
    }

    // --- choosing --------------------------------------------------------------------------------

    fn choose_ready(&self, now: u32) -> Option<u8> {
        let mut oldest: Option<(u8, u32)> = None;
        for (n, unit) in (0..).zip(&self.units) {
            let Some(at) = unit.ready else { continue };
            if self.mux.state() == MuxState::Known(mask_of(n)) {
                return Some(n);
            }
            let age = now.wrapping_sub(at);
            if oldest.is_none_or(|(_, oldest_age)| age > oldest_age) {
                oldest = Some((n, age));
            }
        }
        oldest.map(|(n, _)| n)
    }

    fn choose_sequence(&mut self, now: u32) -> Option<u8> {
        if !self
            .units
            .iter()
            .any(|unit| matches!(unit.phase, Phase::BringUp { .. }))
        {
            return None;
        }
        let room = self
            .units
            .iter()
            .filter_map(|unit| unit.due_in(now))
            .all(|due| due > SEQUENCE_ROOM_US);
        let mut longest: Option<(u8, u32)> = None;
        for (n, unit) in (0..).zip(&mut self.units) {
            let Phase::BringUp {
                machine,
                next,
                since,
            } = &mut unit.phase
            else {
                continue;
            };
            if let Next::Wait { until } = *next {
                if now.wrapping_sub(until).cast_signed() < 0 {
                    continue;
                }
                *next = Next::Do(machine.next(nau7802::Event::Waited));
                *since = now;
            }
            let waited = now.wrapping_sub(*since);
            if (room || waited > SEQUENCE_PATIENCE_US)
                && longest.is_none_or(|(_, most)| waited > most)
            {
                longest = Some((n, waited));
            }
        }
        longest.map(|(n, _)| n)
    }

    /// The selected unit, if its pointer has to go back.
    fn to_point(&self) -> Option<u8> {
        let MuxState::Known(mask) = self.mux.state() else {
            return None;
        };
        let selected = mask.bits().trailing_zeros() as u8;
        let unit = self.units.get(usize::from(selected))?;
        (matches!(unit.phase, Phase::Streaming) && !unit.pointed).then_some(selected)
    }

    fn due_next(&self, now: u32) -> Option<u8> {
        let mut soonest: Option<(u8, i32)> = None;
        for (n, unit) in (0..).zip(&self.units) {
            if let Some(due) = unit.due_in(now) {
                if soonest.is_none_or(|(_, least)| due < least) {
                    soonest = Some((n, due));
                }
            }
        }
        soonest.map(|(n, _)| n)
    }

    // --- doing -----------------------------------------------------------------------------------

    fn begin(&mut self, job: Job, transfer: Transfer, now: u32) -> Work {
        self.current = Some((job, now));
        Work::Transfer(transfer)
    }

    fn select(&mut self, byte: u8, mask: ChannelMask, now: u32) -> Work {
        self.begin(
            Job::Select(mask),
            Transfer::write(Address::DEFAULT.get(), [byte, 0], 1),
            now,
        )
    }

    fn read_or_select(&mut self, unit: u8, now: u32) -> Work {
        let mask = mask_of(unit);
        if let Some(byte) = self.mux.request(mask) {
            return self.select(byte[0], mask, now);
        }
        let slot = &mut self.units[usize::from(unit)];
        let at = slot.ready.take().unwrap_or(now);
        let mut transfer = Transfer::write_read(
            nau7802::ADDRESS,
            nau7802::proto::READ_ADC[0],
            nau7802::proto::READ_ADC_LEN as u8,
        );
        if core::mem::take(&mut slot.pointed) {
            transfer.write_len = 0;
        }
        self.begin(Job::Read { unit, at }, transfer, now)
    }

    fn sequence_or_select(&mut self, unit: u8, now: u32, sink: &mut impl Sink) -> Option<Work> {
        let Phase::BringUp {
            next: Next::Do(action),
            ..
        } = self.units[usize::from(unit)].phase
        else {
            return None;
        };
        let transfer = match action {
            Action::Write(bytes) => Transfer::write(nau7802::ADDRESS, bytes, 2),
            Action::WriteRead(register) => Transfer::write_read(nau7802::ADDRESS, register[0], 1),
            Action::WaitUs(_) | Action::Done | Action::Failed(_) => {
                // A wait that follows a wait, or the end: no bus needed.
                self.settle(unit, now, sink);
                return None;
            }
        };
        let mask = mask_of(unit);
        if let Some(byte) = self.mux.request(mask) {
            return Some(self.select(byte[0], mask, now));
        }
        Some(self.begin(Job::Sequence { unit }, transfer, now))
    }

    /// Takes a bring-up's actions that need no bus.
    fn settle(&mut self, unit: u8, now: u32, sink: &mut impl Sink) {
        let slot = &mut self.units[usize::from(unit)];
        let Phase::BringUp { next, since, .. } = &mut slot.phase else {
            return;
        };
        match *next {
            Next::Do(Action::WaitUs(time)) => {
                *next = Next::Wait {
                    until: now.wrapping_add(time),
                }
            }
            Next::Do(Action::Done) => {
                *slot = Unit {
                    phase: Phase::Streaming,
                    ..Unit::new()
                };
                sink.event(Event::Up { unit });
            }
            Next::Do(Action::Failed(error)) => {
                *slot = Unit::new();
                sink.event(Event::BringUpFailed { unit, error });
            }
            Next::Do(Action::Write(_) | Action::WriteRead(_)) | Next::Wait { .. } => *since = now,
        }
    }

    fn advance(&mut self, unit: u8, event: nau7802::Event, now: u32, sink: &mut impl Sink) {
        if let Phase::BringUp { machine, next, .. } = &mut self.units[usize::from(unit)].phase {
            *next = Next::Do(machine.next(event));
            self.settle(unit, now, sink);
        }
    }

    fn succeeded(&mut self, job: Job, bytes: [u8; 3], now: u32, sink: &mut impl Sink) {
        match job {
            Job::Select(mask) => {
                self.mux_refusals = 0;
                self.mux.written(mask);
            }
            Job::Read { unit, at } => {
                let slot = &mut self.units[usize::from(unit)];
                slot.failures = 0;
                if matches!(slot.phase, Phase::Streaming) {
                    let missed = core::mem::take(&mut slot.missed);
                    sink.event(Event::Sample {
                        unit,
                        code: nau7802::proto::decode_adc(bytes),
                        at,
                        missed,
                    });
                }
            }
            Job::Point { unit } => self.units[usize::from(unit)].pointed = true,
            Job::Sequence { unit } => {
                let event = match self.units[usize::from(unit)].phase {
                    Phase::BringUp {
                        next: Next::Do(Action::WriteRead(_)),
                        ..
                    } => nau7802::Event::Read(bytes[0]),
                    _ => nau7802::Event::Written,
                };
                self.advance(unit, event, now, sink);
            }
        }
    }

    fn failed(&mut self, job: Job, error: TransferError, now: u32, sink: &mut impl Sink) {
        self.mux.invalidate();
        for unit in &mut self.units {
            unit.pointed = false;
        }
        match job {
            // A held line is no refusal: it has its own way to a fault, by rounds of recovery.
            Job::Select(mask) if error == TransferError::Nack => {
                self.mux_refusals = self.mux_refusals.saturating_add(1);
                if self.mux_refusals.is_multiple_of(MUX_REFUSALS) {
                    sink.event(Event::MuxSilent { mask: mask.bits() });
                    // As if a round had been in vain: the next one includes its RESET.
                    self.rounds = self.rounds.max(1);
                    self.recovery = Some(Recovery::Take);
                }
            }
            Job::Read { unit, at } => {
                let slot = &mut self.units[usize::from(unit)];
                if matches!(slot.phase, Phase::Streaming) {
                    slot.failures = slot.failures.saturating_add(1);
                    sink.event(Event::ReadFailed {
                        unit,
                        in_a_row: slot.failures,
                    });
                    // Once more for the same sample; a second failure waits for the next edge.
                    if !slot.failures.is_multiple_of(2) && slot.ready.is_none() {
                        slot.ready = Some(at);
                    }
                }
            }
            Job::Select(_) => {}
            // The sample's own read will show whether anyone is there.
            Job::Point { .. } => {}
            Job::Sequence { unit } => self.advance(unit, nau7802::Event::BusFault, now, sink),
        }
        if error != TransferError::Nack {
            self.recovery = Some(Recovery::Take);
        }
    }

    fn check_deadline(&mut self, now: u32, sink: &mut impl Sink) {
        if self
            .current
            .is_some_and(|(_, started)| now.wrapping_sub(started) > I2C_DEADLINE_US)
        {
            self.finished(Err(TransferError::Timeout), now, sink);
        }
    }

    // --- recovery --------------------------------------------------------------------------------

    fn recover(&mut self, now: u32, sink: &mut impl Sink) -> Option<Work> {
        loop {
            match self.recovery.as_mut()? {
                Recovery::Take => {
                    self.rounds = self.rounds.saturating_add(1);
                    sink.event(Event::Recovery);
                    self.mux.invalidate();
                    self.recovery = Some(Recovery::Clear {
                        clear: BusClear::new(),
                        sda_high: true,
                        after_reset: false,
                    });
                    return Some(Work::TakeLines);
                }
                Recovery::Clear {
                    clear,
                    sda_high,
                    after_reset,
                } => match clear.next(*sda_high) {
                    BusClearStep::Lines { scl, sda } => {
                        self.stepping = true;
                        return Some(Work::Lines { scl, sda });
                    }
                    BusClearStep::Done { released } => {
                        let after_reset = *after_reset;
                        self.recovery = Some(if !after_reset && (!released || self.rounds > 1) {
                            Recovery::ResetLow
                        } else {
                            Recovery::Give
                        });
                        if after_reset && self.rounds >= STUCK_AFTER {
                            sink.event(Event::Stuck {
                                rounds: self.rounds,
                                sda_low: !released,
                            });
                        }
                    }
                },
                Recovery::ResetLow => {
                    self.recovery = Some(Recovery::ResetHigh);
                    self.stepping = true;
                    return Some(Work::MuxReset { low: true });
                }
                Recovery::ResetHigh => {
                    self.recovery = Some(Recovery::Clear {
                        clear: BusClear::new(),
                        sda_high: true,
                        after_reset: true,
                    });
                    self.stepping = true;
                    return Some(Work::MuxReset { low: false });
                }
                Recovery::Give => {
                    self.recovery = (self.rounds >= STUCK_AFTER).then(|| Recovery::Pause {
                        until: now.wrapping_add(STUCK_PAUSE_US),
                    });
                    return Some(Work::GiveLines);
                }
                Recovery::Pause { until } => {
                    if now.wrapping_sub(*until).cast_signed() < 0 {
                        return None;
                    }
                    self.recovery = None;
                }
            }
        }
    }
}

/// For calls that cannot have anything to say.
struct Discard;

impl Sink for Discard {
    fn event(&mut self, _: Event) {}
}

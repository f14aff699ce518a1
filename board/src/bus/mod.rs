//! The scheduler of the I2C bus: which unit uses it next, and the recovery after a failure. Pure:
//! the hardware half executes the actions of [`Bus::next`] and reports their results.
//!
//! | file | concern |
//! | --- | --- |
//! | `mod.rs` | the scheduler's state, its inputs (edges, ticks, results), outcome of a job |
//! | `types.rs` | transactions and line levels for the hardware, events for the superloop |
//! | `unit.rs` | one unit: phase of its converter, expected edge, pending sample |
//! | `schedule.rs` | order of service, transactions of each job |
//! | `recovery.rs` | rounds of recovery, stuck bus |
//!
//! # Order of service
//! 1. A unit with a sample ready: first the unit whose multiplexer channel is already selected,
//!    else the unit that has waited longest. No unit can starve another: each has at most one
//!    sample waiting, and six services (190 us each) fit twice into the shortest sample period
//!    (2,900 us).
//! 2. A step of a converter's bring-up, if no sample is due within [`SEQUENCE_ROOM_US`]; after
//!    [`SEQUENCE_PATIENCE_US`] of waiting it runs anyway. All six bring-ups advance concurrently,
//!    their calibrations overlap, and streaming units continue to stream.
//! 3. Preparation of the next sample: the register pointer of the converter that was read last is
//!    set back to its result (a read leaves it behind the result), then the multiplexer selects the
//!    channel of the converter due next. A sample then needs neither: 92 us on the bus instead of
//!    190, with bus time that was idle.
//!
//! A mask is read back before anything else uses the bus, if no sample is due within
//! [`READ_BACK_ROOM_US`]: a bit that changed on its way would connect another converter, or two.
//!
//! The NAU7802 extract at hand does not state that a converter keeps its register pointer over a
//! STOP; published drivers write the pointer and read in two transactions with a STOP between them.
//! Nor does it state that the result is latched at the read: if it is latched when the pointer is
//! written, each sample is one period old. [`Bus::set_pointer_ahead`] switches this part off, and
//! docs/bring-up.md has the measurement that tells. After any failure on the bus no pointer is
//! assumed to be set.
//!
//! # Failures
//! A NACK behind the multiplexer causes one retry with a fresh select (the cached channel is
//! unknown after any failure). Every other failure (bus error, lost arbitration, a transaction past
//! its deadline) starts a recovery. Each of its steps takes a few microseconds of an interrupt;
//! none waits:
//!
//! 1. the lines as GPIO, up to nine clocks until SDA is free, STOP (UM10204 section 3.1.16);
//! 2. if that did not free SDA, or another failure came before any transaction worked: RESET of the
//!    multiplexer, and the clocks again, now without the modules behind it;
//! 3. channel unknown: the next transaction selects again;
//! 4. a unit that continues to fail is reported, switched off by the supervisor and brought up from
//!    the start when its fault is cleared.
//!
//! A bus that is still blocked after [`STUCK_AFTER`] rounds is reported as stuck and retried every
//! [`STUCK_PAUSE_US`].
//!
//! # Missed deadline
//! A sample that is not read before the next conversion ends is lost: the converter overwrites it.
//! The interval between DRDY edges shows it; it is counted in [`Event::Sample::missed`] of the next
//! sample.

mod recovery;
mod schedule;
mod types;
mod unit;

pub use types::{Event, Sink, Transfer, TransferError, Work};

use crate::clocks::I2C_DEADLINE_US;
use control::{Micros, UnitIndex, UnitSet, UNITS};
use drivers::nau7802::{self, Action, Bringup};
use drivers::tca9548::{Address, ChannelMask, Selector};
use recovery::Recovery;
use unit::{Next, Phase, Unit};

/// A step of a bring-up starts only if no sample is due within this time, in microseconds: select
/// and the longest step, 50 + 100 us, and 50 us to select back.
pub const SEQUENCE_ROOM_US: i32 = 200;
/// Longest time that a step of a bring-up waits for a gap, in microseconds.
pub const SEQUENCE_PATIENCE_US: u32 = 5_000;
/// Rounds of recovery without a transaction that worked, after which the bus counts as stuck.
pub const STUCK_AFTER: u16 = 4;
/// Pause between further rounds on a stuck bus, in microseconds.
pub const STUCK_PAUSE_US: u32 = 20_000;
/// A mask is read back only if no sample is due within this time, in microseconds: it takes 50.
pub const READ_BACK_ROOM_US: i32 = 100;
/// Selects in a row that the multiplexer does not acknowledge, or reads back otherwise, before it
/// is reset and reported.
pub const MAX_MUX_NACKS: u8 = 3;

const PERIOD_US: u32 = control::NOMINAL_PERIOD_US;

/// Job on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    Select(ChannelMask),
    ReadBack(ChannelMask),
    /// `left_over`: a result from before the first edge, to be dropped.
    Read {
        unit: UnitIndex,
        at: Micros,
        left_over: bool,
    },
    SetPointer {
        unit: UnitIndex,
    },
    Sequence {
        unit: UnitIndex,
    },
}

/// The scheduler. All its functions run at one interrupt priority, so it needs no locks.
#[derive(Debug, Clone)]
pub struct Bus {
    units: [Unit; UNITS],
    mux: Selector,
    mux_nacks: u8,
    /// The mask that was written last, until it is read back.
    unread: Option<ChannelMask>,
    /// Masks in a row that were read back otherwise.
    mux_changes: u8,
    /// Current job and its start.
    current: Option<(Job, Micros)>,
    recovery: Option<Recovery>,
    /// A step of the recovery is in progress.
    stepping: bool,
    /// Rounds of recovery since the last transaction that worked.
    rounds: u16,
    /// Register pointers are written ahead of the samples.
    pointer_ahead: bool,
}

impl Default for Bus {
    fn default() -> Self {
        Self::new()
    }
}

const fn mask_of(unit: UnitIndex) -> ChannelMask {
    ChannelMask::from_bits(1 << unit as u8)
}

impl Bus {
    /// A bus with all units off.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            units: [const { Unit::new() }; UNITS],
            mux: Selector::new(),
            mux_nacks: 0,
            unread: None,
            mux_changes: 0,
            current: None,
            recovery: None,
            stepping: false,
            rounds: 0,
            pointer_ahead: true,
        }
    }

    /// Whether register pointers are written ahead of the samples. Without it each sample writes
    /// the pointer itself, some 50 us later. A converter that latches its result when the pointer
    /// is written would give samples that are one period old; the module's page and
    /// docs/bring-up.md have the details.
    pub fn set_pointer_ahead(&mut self, ahead: bool) {
        self.pointer_ahead = ahead;
        if !ahead {
            self.forget_pointers();
        }
    }

    /// Starts the bring-up of a unit's converter, from any state.
    pub fn start(&mut self, unit: UnitIndex, now: Micros) {
        let mut machine = Bringup::new(nau7802::Config::FORCE_UNIT);
        let next = Next::Do(machine.next(nau7802::Event::Start));
        self.units[unit as usize] = Unit {
            phase: Phase::BringUp {
                machine,
                next,
                since: now,
            },
            ..Unit::new()
        };
        self.settle(unit, now, &mut Discard);
    }

    /// Takes a unit out of service.
    pub fn stop(&mut self, unit: UnitIndex) {
        self.units[unit as usize] = Unit::new();
    }

    /// A DRDY line rose.
    pub fn drdy(&mut self, unit: UnitIndex, now: Micros, sink: &mut impl Sink) {
        let slot = &mut self.units[unit as usize];
        if !matches!(slot.phase, Phase::Streaming) {
            return;
        }
        if let Some(last) = slot.last_edge {
            let interval = now.since(last);
            let period = slot.period();
            if slot.ready.is_some() && interval < period / 2 {
                return; // the tick has already reported this edge
            }
            // The line stays high until its result is read: a dip in it looks like an edge. The
            // next true edge after one that the tick reported late is no earlier than 0.4 periods.
            if interval < period / 4 {
                return;
            }
            // Edges in this interval, this one included; a shift-free rounding of interval /
            // period.
            let mut edges = 0;
            let mut rest = interval + period / 2;
            while rest >= period && edges < 255 {
                rest -= period;
                edges += 1;
            }
            if edges == 1 {
                let average = slot.period_q4 - (slot.period_q4 >> 4) + interval;
                // A converter is within 3 % of its nominal rate. An interval beyond 6 % is not its
                // period.
                slot.period_q4 = average.clamp(PERIOD_US * 15, PERIOD_US * 17);
            }
            slot.missed = slot.missed.saturating_add(u8::saturating_sub(edges, 1));
        }
        slot.last_edge = Some(now);
        slot.ready = Some(now);
        slot.left_over = false;
        sink.event(Event::Edge { unit });
    }

    /// Call it once a millisecond: checks deadlines, and finds edges that caused no interrupt.
    /// `drdy`: the units whose line is high.
    pub fn tick(&mut self, now: Micros, drdy: UnitSet, sink: &mut impl Sink) {
        self.check_deadline(now, sink);
        let reading = match self.current {
            Some((Job::Read { unit, .. }, _)) => Some(unit),
            _ => None,
        };
        let mut astray = false;
        for (n, unit) in UnitIndex::zip(&mut self.units) {
            let high = matches!(unit.phase, Phase::Streaming) && drdy.contains(n);
            if !high || unit.ready.is_some() || reading == Some(n) {
                continue;
            }
            // High without a sample that waits: its edge was lost, or its read went to another
            // converter, behind a mask that changed on its way and that another one followed before
            // it was read back. Then that converter's pointer has moved, so none is trusted.
            astray = true;
            match unit.last_edge {
                // A line that is high before the first edge shows a result from before the start,
                // or none at all: whether a start lowers DRDY is not documented. It is read, which
                // lowers the line, and its code is dropped.
                None => {
                    unit.ready = Some(now);
                    unit.left_over = true;
                }
                // The line stays high until the result is read: a high line without an edge is a
                // lost edge.
                Some(last) if now.since(last) > PERIOD_US + PERIOD_US / 4 => {
                    unit.missed = unit.missed.saturating_add(1);
                    unit.last_edge = Some(now);
                    unit.ready = Some(now);
                    sink.event(Event::Edge { unit: n });
                }
                Some(_) => {}
            }
        }
        if astray {
            self.forget_pointers();
        }
    }

    /// No register pointer is where it was left.
    fn forget_pointers(&mut self) {
        for unit in &mut self.units {
            unit.pointer_set = false;
        }
    }

    /// The transaction has ended; `read` holds the bytes that were read.
    pub fn finished(
        &mut self,
        result: Result<[u8; 3], TransferError>,
        now: Micros,
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
        if let Some(Recovery::Running { sda_high, .. }) = &mut self.recovery {
            *sda_high = sda_level;
        }
    }

    /// Whether a transaction is on the bus.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.current.is_some()
    }

    /// The next action of the hardware. Call it after every other call. `None`: no work, or an
    /// action is in progress.
    pub fn next(&mut self, now: Micros, sink: &mut impl Sink) -> Option<Work> {
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
        if let Some(mask) = self
            .unread
            .filter(|_| self.has_room(now, READ_BACK_ROOM_US))
        {
            let transfer = Transfer::read(Address::DEFAULT.get(), 1);
            return Some(self.begin(Job::ReadBack(mask), transfer, now));
        }
        if let Some(unit) = self.unit_without_pointer().filter(|_| self.pointer_ahead) {
            let transfer = Transfer::write(nau7802::ADDRESS, [nau7802::proto::READ_ADC[0], 0], 1);
            return Some(self.begin(Job::SetPointer { unit }, transfer, now));
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

    /// Executes the actions of a bring-up that need no bus.
    fn settle(&mut self, unit: UnitIndex, now: Micros, sink: &mut impl Sink) {
        let slot = &mut self.units[unit as usize];
        let Phase::BringUp { next, since, .. } = &mut slot.phase else {
            return;
        };
        match *next {
            Next::Do(Action::WaitUs(time)) => {
                *next = Next::Wait {
                    until: now.plus(time),
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

    fn advance(
        &mut self,
        unit: UnitIndex,
        event: nau7802::Event,
        now: Micros,
        sink: &mut impl Sink,
    ) {
        if let Phase::BringUp { machine, next, .. } = &mut self.units[unit as usize].phase {
            *next = Next::Do(machine.next(event));
            self.settle(unit, now, sink);
        }
    }

    fn succeeded(&mut self, job: Job, bytes: [u8; 3], now: Micros, sink: &mut impl Sink) {
        match job {
            Job::Select(mask) => {
                self.mux_nacks = 0;
                self.mux.written(mask);
                self.unread = Some(mask);
            }
            Job::ReadBack(mask) => {
                self.unread = None;
                let [found, ..] = bytes;
                if self.mux.check_read_back(mask, found).is_ok() {
                    self.mux_changes = 0;
                    return;
                }
                // A pointer may have been written to another converter.
                self.forget_pointers();
                self.mux_changes = self.mux_changes.saturating_add(1);
                if self.mux_changes.is_multiple_of(MAX_MUX_NACKS) {
                    let mask = mask.bits();
                    sink.event(Event::MuxSilent { mask, found });
                }
            }
            Job::Read {
                unit,
                at,
                left_over,
            } => {
                let slot = &mut self.units[unit as usize];
                slot.failures = 0;
                if !matches!(slot.phase, Phase::Streaming) || left_over {
                    return;
                }
                let missed = core::mem::take(&mut slot.missed);
                if slot.settling.result() {
                    sink.event(Event::Sample {
                        unit,
                        code: nau7802::proto::decode_adc(bytes),
                        at,
                        missed,
                    });
                }
            }
            Job::SetPointer { unit } => {
                self.units[unit as usize].pointer_set = true;
            }
            Job::Sequence { unit } => {
                let event = match self.units[unit as usize].phase {
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

    fn failed(&mut self, job: Job, error: TransferError, now: Micros, sink: &mut impl Sink) {
        self.mux.invalidate();
        self.unread = None;
        self.forget_pointers();
        match job {
            // Only a NACK counts here. A blocked line leads to a fault by rounds of recovery.
            Job::Select(mask) | Job::ReadBack(mask) if error == TransferError::Nack => {
                self.mux_nacks = self.mux_nacks.saturating_add(1);
                if self.mux_nacks.is_multiple_of(MAX_MUX_NACKS) {
                    let (mask, found) = (mask.bits(), 0xFF);
                    sink.event(Event::MuxSilent { mask, found });
                    // Counts as a round without success, so that the next one includes the RESET.
                    self.rounds = self.rounds.max(1);
                    self.recovery = Some(Recovery::Due);
                }
            }
            Job::Read {
                unit,
                at,
                left_over,
            } => {
                let slot = &mut self.units[unit as usize];
                if matches!(slot.phase, Phase::Streaming) {
                    slot.failures = slot.failures.saturating_add(1);
                    sink.event(Event::ReadFailed {
                        unit,
                        in_a_row: slot.failures,
                    });
                    // One retry for the same sample; after a second failure the next edge is
                    // awaited.
                    if !slot.failures.is_multiple_of(2) && slot.ready.is_none() {
                        slot.ready = Some(at);
                        slot.left_over = left_over;
                    }
                }
            }
            Job::Select(_) | Job::ReadBack(_) => {}
            // The read of the sample will show whether the converter responds.
            Job::SetPointer { .. } => {}
            Job::Sequence { unit } => self.advance(unit, nau7802::Event::BusFault, now, sink),
        }
        if error != TransferError::Nack {
            self.recovery = Some(Recovery::Due);
        }
    }

    fn check_deadline(&mut self, now: Micros, sink: &mut impl Sink) {
        if self
            .current
            .is_some_and(|(_, started)| now.since(started) > I2C_DEADLINE_US)
        {
            self.finished(Err(TransferError::Timeout), now, sink);
        }
    }
}

/// For calls that cannot produce an event.
struct Discard;

impl Sink for Discard {
    fn event(&mut self, _: Event) {}
}

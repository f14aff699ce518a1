//! Order of service: which unit uses the bus next, and the transactions of each job.

use super::types::{Sink, Transfer, Work};
use super::unit::{Next, Phase};
use super::{mask_of, Bus, Job, SEQUENCE_PATIENCE_US, SEQUENCE_ROOM_US};
use control::{Micros, UnitIndex};
use drivers::nau7802::{self, Action};
use drivers::tca9548::{Address, ChannelMask, MuxState};

impl Bus {
    pub(super) fn choose_ready(&self, now: Micros) -> Option<UnitIndex> {
        let mut oldest: Option<(UnitIndex, u32)> = None;
        for (n, unit) in UnitIndex::zip(&self.units) {
            let Some(at) = unit.ready else { continue };
            if self.mux.state() == MuxState::Known(mask_of(n)) {
                return Some(n);
            }
            let age = now.since(at);
            if oldest.is_none_or(|(_, oldest_age)| age > oldest_age) {
                oldest = Some((n, age));
            }
        }
        oldest.map(|(n, _)| n)
    }

    /// Whether no sample is due within this time.
    pub(super) fn has_room(&self, now: Micros, room_us: i32) -> bool {
        let mut due = self.units.iter().filter_map(|unit| unit.due_in(now));
        due.all(|due| due > room_us)
    }

    pub(super) fn choose_sequence(&mut self, now: Micros) -> Option<UnitIndex> {
        if !self
            .units
            .iter()
            .any(|unit| matches!(unit.phase, Phase::BringUp { .. }))
        {
            return None;
        }
        let room = self.has_room(now, SEQUENCE_ROOM_US);
        let mut longest: Option<(UnitIndex, u32)> = None;
        for (n, unit) in UnitIndex::zip(&mut self.units) {
            let Phase::BringUp {
                machine,
                next,
                since,
            } = &mut unit.phase
            else {
                continue;
            };
            if let Next::Wait { until } = *next {
                if now.until(until) > 0 {
                    continue;
                }
                *next = Next::Do(machine.next(nau7802::Event::Waited));
                *since = now;
            }
            let waited = now.since(*since);
            if (room || waited > SEQUENCE_PATIENCE_US)
                && longest.is_none_or(|(_, most)| waited > most)
            {
                longest = Some((n, waited));
            }
        }
        longest.map(|(n, _)| n)
    }

    /// The selected unit, if the register pointer of its converter does not address the result. Not
    /// while it settles: a converter that latches its result when the pointer is written would then
    /// give the last unsettled result as the first sample.
    pub(super) fn unit_without_pointer(&self) -> Option<UnitIndex> {
        let MuxState::Known(mask) = self.mux.state() else {
            return None;
        };
        let selected = UnitIndex::new(mask.bits().trailing_zeros() as u8)?;
        let unit = &self.units[selected as usize];
        (matches!(unit.phase, Phase::Streaming) && unit.settling.is_over() && !unit.pointer_set)
            .then_some(selected)
    }

    pub(super) fn due_next(&self, now: Micros) -> Option<UnitIndex> {
        let mut soonest: Option<(UnitIndex, i32)> = None;
        for (n, unit) in UnitIndex::zip(&self.units) {
            if let Some(due) = unit.due_in(now) {
                if soonest.is_none_or(|(_, least)| due < least) {
                    soonest = Some((n, due));
                }
            }
        }
        soonest.map(|(n, _)| n)
    }

    pub(super) fn begin(&mut self, job: Job, transfer: Transfer, now: Micros) -> Work {
        self.current = Some((job, now));
        Work::Transfer(transfer)
    }

    pub(super) fn select(&mut self, byte: u8, mask: ChannelMask, now: Micros) -> Work {
        self.begin(
            Job::Select(mask),
            Transfer::write(Address::DEFAULT.get(), [byte, 0], 1),
            now,
        )
    }

    pub(super) fn read_or_select(&mut self, unit: UnitIndex, now: Micros) -> Work {
        let mask = mask_of(unit);
        if let Some(byte) = self.mux.request(mask) {
            return self.select(byte[0], mask, now);
        }
        let slot = &mut self.units[unit as usize];
        let at = slot.ready.take().unwrap_or(now);
        let left_over = core::mem::take(&mut slot.left_over);
        let mut transfer = Transfer::write_read(
            nau7802::ADDRESS,
            nau7802::proto::READ_ADC[0],
            nau7802::proto::READ_ADC_LEN as u8,
        );
        if core::mem::take(&mut slot.pointer_set) {
            transfer.write_len = 0;
        }
        let job = Job::Read {
            unit,
            at,
            left_over,
        };
        self.begin(job, transfer, now)
    }

    pub(super) fn sequence_or_select(
        &mut self,
        unit: UnitIndex,
        now: Micros,
        sink: &mut impl Sink,
    ) -> Option<Work> {
        let Phase::BringUp {
            next: Next::Do(action),
            ..
        } = self.units[unit as usize].phase
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
}

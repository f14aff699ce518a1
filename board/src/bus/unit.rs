//! One unit as the scheduler sees it: phase of its converter, expected edge, pending sample.

use super::PERIOD_US;
use control::Micros;
use drivers::nau7802::{Action, Bringup, Settling};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    Do(Action),
    Wait { until: Micros },
}

#[derive(Debug, Clone)]
pub(super) enum Phase {
    /// Not in service: edges are ignored.
    Off,
    /// In bring-up. `since`: earliest start of the next step.
    BringUp {
        machine: Bringup,
        next: Next,
        since: Micros,
    },
    Streaming,
}

#[derive(Debug, Clone)]
pub(super) struct Unit {
    pub(super) phase: Phase,
    /// DRDY edge whose sample is still in the converter.
    pub(super) ready: Option<Micros>,
    pub(super) last_edge: Option<Micros>,
    /// Averaged period in microseconds times 16.
    pub(super) period_q4: u32,
    pub(super) missed: u8,
    pub(super) failures: u8,
    /// The register pointer of the converter addresses the result.
    pub(super) pointer_set: bool,
    /// What is ready is a result from before the first edge: read it and drop it.
    pub(super) left_over: bool,
    /// Results to drop until the converter has settled.
    pub(super) settling: Settling,
}

impl Unit {
    pub(super) const fn new() -> Self {
        Self {
            phase: Phase::Off,
            ready: None,
            last_edge: None,
            period_q4: PERIOD_US << 4,
            missed: 0,
            failures: 0,
            pointer_set: false,
            left_over: false,
            settling: Settling::begun(),
        }
    }

    pub(super) const fn period(&self) -> u32 {
        self.period_q4 >> 4
    }

    /// Microseconds until the next expected edge (negative: overdue). `None`: no edge yet, or
    /// overdue by more than a quarter of a period.
    pub(super) fn due_in(&self, now: Micros) -> Option<i32> {
        let last = match (&self.phase, self.last_edge) {
            (Phase::Streaming, Some(last)) => last,
            _ => return None,
        };
        let due = now.until(last.plus(self.period()));
        // Long overdue: unplugged rather than late.
        (due > -(PERIOD_US.cast_signed() / 4)).then_some(due)
    }
}

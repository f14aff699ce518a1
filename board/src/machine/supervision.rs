//! Supervision: the supervisor's millisecond, events of the bus, and the faults that follow from
//! them.
//!
//! A fault of the board sets all outputs to 0 V, a fault of a unit sets its output to 0 V
//! (docs/architecture.md, "Faults: unit or board").

use super::{
    board_crc, Effects, Health, Machine, Unit, AT_REST_MS, FIRST_SAMPLE_MS, MAX_FAILED_READS,
    MAX_PASS_US, UNREST_MS,
};
use crate::bus;
use control::let_go::LetGo;
use control::supervisor::{RateLimits, Verdict};
use control::system::Request;
use control::{EncoderCounts, Fault, Micros, SystemState, UnitIndex, UnitSet, UNITS};
use drivers::nau7802::{Cause, SequenceError, Stage};
use wire::message::FaultReport;

/// Noise events at an encoder within [`ENCODER_NOISE_WINDOW_US`] that are a fault.
const ENCODER_NOISE_EVENTS: u8 = 5;
/// Window in which the noise events of an encoder are counted, in microseconds.
const ENCODER_NOISE_WINDOW_US: u32 = 1_000_000;
/// Milliseconds between checks of the configuration in memory.
const CONFIG_CHECK_MS: u32 = 1_000;
/// Milliseconds in a row that the E-stop loop must read open: longer than contact bounce of 1 ms,
/// far shorter than an actuation by hand.
const ESTOP_OPEN_MS: u8 = 2;

impl Machine {
    /// Processes an event of the bus other than an edge or a sample.
    pub fn bus_event(&mut self, event: bus::Event, now: Micros, fx: &mut impl Effects) {
        match event {
            bus::Event::Edge { .. } | bus::Event::Sample { .. } => {}
            bus::Event::Up { unit } => {
                let slot = &mut self.units[unit as usize];
                slot.sensor_up = false;
                slot.came_up = Some(now);
            }
            bus::Event::BringUpFailed { unit, error } => {
                self.fault_unit(unit, Fault::BringUpFailed, bring_up_detail(&error), now, fx);
            }
            bus::Event::ReadFailed { unit, in_a_row } => {
                let slot = &mut self.units[unit as usize];
                slot.failed_reads = slot.failed_reads.wrapping_add(1);
                if in_a_row >= MAX_FAILED_READS {
                    self.fault_unit(unit, Fault::SensorReads, u32::from(in_a_row), now, fx);
                }
            }
            bus::Event::Recovery => self.recoveries = self.recoveries.saturating_add(1),
            bus::Event::Stuck { rounds, sda_low } => {
                let detail = u32::from(rounds) | u32::from(sda_low) << 31;
                self.fault_board(Fault::BusStuck, detail, now, fx);
            }
            bus::Event::MuxSilent { mask, found } => {
                let detail = u32::from(mask) << 8 | u32::from(found);
                self.fault_board(Fault::MuxSilent, detail, now, fx);
            }
        }
    }

    /// Runs the supervisor. Call it once a millisecond.
    pub fn tick(&mut self, now: Micros, health: Health, fx: &mut impl Effects) {
        self.exchange_configs();
        self.watch_board(now, health, fx);
        for unit in UnitIndex::ALL {
            self.watch_unit(unit, now, fx);
            self.watch_let_go(unit, now, fx);
        }
        self.watch_power(now, fx);
        self.advance(Request::None, fx);
    }

    /// Gives the amplifiers their power back once every enabled unit measures and is at rest, and
    /// nothing of the board is faulted.
    fn watch_power(&mut self, now: Micros, fx: &mut impl Effects) {
        let mut enabled = self.units.iter().filter(|unit| unit.config.enabled());
        let idle = self.released || self.latch.is_set() || self.system.drives();
        if idle || enabled.clone().next().is_none() || !enabled.clone().all(Unit::usable) {
            self.at_rest_ms = 0;
            self.unrest_ms = 0;
            return;
        }
        if enabled.all(|unit| unit.at_rest().is_ok()) {
            self.at_rest_ms += 1;
            if self.at_rest_ms >= AT_REST_MS {
                self.released = true;
                self.try_outputs();
            }
            return;
        }
        self.at_rest_ms = 0;
        self.unrest_ms += 1;
        if self.unrest_ms < UNREST_MS {
            return;
        }
        for unit in UnitIndex::ALL {
            let slot = &self.units[unit as usize];
            if let (true, Err((fault, detail))) = (slot.config.enabled(), slot.at_rest()) {
                self.fault_unit(unit, fault, detail, now, fx);
            }
        }
    }

    /// The amplifiers get their power: no reel may wind in.
    fn try_outputs(&mut self) {
        for unit in &mut self.units {
            unit.let_go.powered();
        }
    }

    /// Latches a fault of the board and sets all outputs to 0 V. Also for causes found outside the
    /// machine (a counter that does not respond).
    pub fn fault_board(&mut self, fault: Fault, detail: u32, now: Micros, fx: &mut impl Effects) {
        let first = !self.latch.is_set();
        if self.latch.latch(fault, detail) && (first || fault.takes_power()) {
            fx.report(FaultReport {
                t_us: now.0,
                unit: u8::MAX,
                code: fault.code(),
                detail,
            });
        }
        self.released &= !fault.takes_power();
        // At once, not with the next sample; repeated for each fault.
        for (unit, slot) in UnitIndex::zip(&mut self.units) {
            fx.zero_output(unit);
            slot.let_go.switched_off(now, slot.config.let_go());
        }
        self.advance(Request::None, fx);
    }

    /// Counts a noise event at a unit's encoder; `flags` is the counter's FLAG register. One event
    /// does not prove a wrong count. `ENCODER_NOISE_EVENTS` within a second mean a loose plug and
    /// are a fault.
    pub fn encoder_noise(
        &mut self,
        unit: UnitIndex,
        flags: u8,
        now: Micros,
        fx: &mut impl Effects,
    ) {
        let slot = &mut self.units[unit as usize];
        if !slot.config.enabled() {
            return;
        }
        let (since, events) = slot.encoder_noise;
        slot.encoder_noise = if now.since(since) > ENCODER_NOISE_WINDOW_US {
            (now, 1)
        } else {
            (since, events.saturating_add(1))
        };
        if slot.encoder_noise.1 >= ENCODER_NOISE_EVENTS {
            slot.encoder_noise.1 = 0;
            self.fault_unit(unit, Fault::EncoderError, flags.into(), now, fx);
        }
    }

    pub(super) fn fault_unit(
        &mut self,
        unit: UnitIndex,
        fault: Fault,
        detail: u32,
        now: Micros,
        fx: &mut impl Effects,
    ) {
        let slot = &mut self.units[unit as usize];
        let first = !slot.latch.is_set();
        if slot.latch.latch(fault, detail) && first {
            fx.report(FaultReport {
                t_us: now.0,
                unit: unit as u8,
                code: fault.code(),
                detail,
            });
        }
        slot.zero = None;
        fx.zero_output(unit);
        slot.let_go.switched_off(now, slot.config.let_go());
        // After these faults the load cell cannot tell whether the cable lets go. A swing that the
        // encoder does not show may be the load cell's.
        if matches!(
            fault,
            Fault::AdcSaturated
                | Fault::EncoderStill
                | Fault::TensionNegative
                | Fault::Implausible
                | Fault::CommandAtLimit
        ) {
            slot.let_go.doubt();
        }
        // After these faults the state of the converter is unknown. After all others it continues
        // to measure for telemetry.
        if matches!(
            fault,
            Fault::SensorSilent | Fault::BringUpFailed | Fault::SensorReads | Fault::SensorFrozen
        ) {
            slot.sensor_up = false;
            slot.came_up = None;
            slot.let_go.blind();
            self.tip.forget(unit);
            fx.stop_sensor(unit);
        }
        self.advance(Request::None, fx);
    }

    fn watch_board(&mut self, now: Micros, health: Health, fx: &mut impl Effects) {
        self.estop_open_ms = if health.estop_closed {
            0
        } else {
            self.estop_open_ms.saturating_add(1)
        };
        let was_closed = self.estop_closed;
        self.estop_closed = self.estop_open_ms < ESTOP_OPEN_MS;
        if self.estop_closed && !was_closed && self.released {
            self.try_outputs();
        }
        if !self.estop_closed {
            self.fault_board_once(Fault::EStop, health.estop_opened_at.0, now, fx);
        }
        // Not while a disarmed board ramps down: the ramp needs no host and ends by itself.
        if self.system == SystemState::Running && self.expiry.is_expired(now) {
            let age = u32::from(self.expiry.age_ms(now));
            self.fault_board_once(Fault::SetpointsExpired, age, now, fx);
        }
        // The first passes include the start-up.
        if health.longest_pass_us > MAX_PASS_US && self.system != SystemState::Boot {
            self.fault_board_once(Fault::LoopOverrun, health.longest_pass_us, now, fx);
        }
        if health.events_lost != self.events_lost {
            self.events_lost = health.events_lost;
            self.fault_board_once(Fault::QueueOverflow, health.events_lost, now, fx);
        }
        if let Some(status) = health.dac_error {
            self.fault_board_once(Fault::DacLink, status, now, fx);
        }
        self.register_changed = health.register_changed.is_some();
        if let Some(address) = health.register_changed {
            self.fault_board_once(Fault::RegisterChanged, address, now, fx);
        }
        self.check_config(now, fx);
    }

    /// Each second: checksums of the configurations, and the values that the sample path computed
    /// from each, one unit at a time.
    fn check_config(&mut self, now: Micros, fx: &mut impl Effects) {
        self.config_check_ms += 1;
        const TURN_MS: u32 = CONFIG_CHECK_MS / UNITS as u32;
        if self.config_check_ms.is_multiple_of(TURN_MS) {
            let number = self.config_check_ms / TURN_MS;
            let unit = self.units.get((number as usize).wrapping_sub(1));
            if unit.is_some_and(|unit| !unit.config.is_sound()) {
                self.fault_board_once(Fault::ConfigCrc, number, now, fx);
            }
        }
        if self.config_check_ms >= CONFIG_CHECK_MS {
            self.config_check_ms = 0;
            let crc = self.crc();
            if crc != self.config_crc || board_crc(&self.board) != self.board_crc {
                self.fault_board_once(Fault::ConfigCrc, crc, now, fx);
            }
        }
    }

    /// Units whose encoder [`Self::encoder`] needs now: their load cells do not measure, and
    /// whether their cables let go shows there.
    #[must_use]
    pub fn wants_encoders(&self) -> UnitSet {
        UnitIndex::zip(&self.units)
            .filter(|(_, unit)| unit.let_go.needs_encoder(self.system.drives()))
            .map(|(n, _)| n)
            .collect()
    }

    /// Position of an encoder of [`Self::wants_encoders`], each millisecond.
    pub fn encoder(&mut self, unit: UnitIndex, counts: EncoderCounts) {
        let slot = &mut self.units[unit as usize];
        // The sign of a unit that was never configured is not known.
        let nm = if slot.configured {
            slot.config.nm_per_count()
        } else {
            0
        };
        slot.let_go.turned(counts, nm);
    }

    /// Where an encoder stands, for the status: of one unit in turn each millisecond, whether its
    /// load cell measures or not.
    pub fn position(&mut self, unit: UnitIndex, counts: EncoderCounts) {
        self.units[unit as usize].counts = counts;
    }

    pub(super) fn watch_let_go(&mut self, unit: UnitIndex, now: Micros, fx: &mut impl Effects) {
        let left = self.units[unit as usize].let_go.overdue(now);
        if let Some(left) = left.filter(|_| !self.latch.has(Fault::OutputStuck)) {
            self.fault_board(Fault::OutputStuck, LetGo::detail(unit, left), now, fx);
        }
    }

    /// As [`Self::fault_board`], for causes that persist: acts once until it is cleared.
    pub(super) fn fault_board_once(
        &mut self,
        fault: Fault,
        detail: u32,
        now: Micros,
        fx: &mut impl Effects,
    ) {
        if !self.latch.has(fault) {
            self.fault_board(fault, detail, now, fx);
        }
    }

    fn watch_unit(&mut self, unit: UnitIndex, now: Micros, fx: &mut impl Effects) {
        let slot = &self.units[unit as usize];
        if slot.latch.is_set() || !slot.config.enabled() {
            return;
        }
        if let Some(since) = slot.came_up {
            if now.since(since) > FIRST_SAMPLE_MS * 1_000 {
                self.fault_unit(unit, Fault::BringUpFailed, FIRST_SAMPLE_STAGE << 8, now, fx);
            }
            return;
        }
        if !slot.sensor_up {
            return;
        }
        match slot.rate.check(now, &RateLimits::SENSOR) {
            Verdict::Ok => {}
            Verdict::Silent => {
                let silent_us = slot.rate.last().map_or(0, |last| now.since(last));
                self.fault_unit(unit, Fault::SensorSilent, silent_us, now, fx);
            }
            Verdict::TooSlow(period) => self.fault_unit(unit, Fault::SensorSlow, period, now, fx),
            Verdict::TooFast(period) => self.fault_unit(unit, Fault::SensorFast, period, now, fx),
        }
    }
}

/// [`Fault::BringUpFailed`]: stage number of "first sample".
const FIRST_SAMPLE_STAGE: u32 = 7;

/// Detail of [`Fault::BringUpFailed`] from the driver's finer stages.
fn bring_up_detail(error: &SequenceError) -> u32 {
    let stage = match error.stage {
        _ if error.cause == Cause::Bus => 1,
        Stage::ResetAssert | Stage::ResetRelease => 2,
        Stage::PowerUpDigital
        | Stage::PowerUpReady
        | Stage::PowerUpAnalog
        | Stage::SupplySettle => 3,
        Stage::RevisionCheck => 4,
        Stage::CycleStart
        | Stage::CalibrationStart
        | Stage::CalibrationWait
        | Stage::CycleStop
        | Stage::CycleRestart => 6,
        Stage::Finished => FIRST_SAMPLE_STAGE,
        _ => 5,
    };
    stage << 8 | u32::from(error.register.address())
}

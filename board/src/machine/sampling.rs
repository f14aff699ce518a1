//! The sample path: one sample of one unit through its controller, and the telemetry of it.

use super::{Effects, Machine};
use control::let_go::{LetGo, Released};
use control::supervisor::EncoderWatch;
use control::unit::{Controller, Drive};
use control::zero::Progress;
use control::{
    AdcCode, DacCode, EncoderCounts, Fault, Input, Micros, MotorState, Output, UnitIndex,
};
use wire::message::{flags, Sample};

/// A sample whose DAC word is being sent. Becomes telemetry afterwards, off the latency path.
#[derive(Debug, Clone, Copy)]
pub struct PendingSample {
    unit: UnitIndex,
    adc_code: AdcCode,
    encoder_counts: EncoderCounts,
    at: Micros,
    /// Conversions lost before it.
    missed: u8,
    drive: Drive,
    tip_force_mn: u16,
    output: Output,
    /// The output was computed from a configuration that is whole.
    measured: bool,
}

impl PendingSample {
    /// The telemetry sample. Its times are 0.
    #[must_use]
    pub fn describe(&self) -> Sample {
        let mut sample = Sample {
            unit: self.unit as u8,
            adc_code: self.adc_code.get(),
            encoder_counts: self.encoder_counts.0 as i32,
            ..Sample::default()
        };
        self.output.describe(&mut sample);
        sample.tip_force_mn = self.tip_force_mn;
        if self.missed > 0 {
            sample.flags |= flags::MISSED;
        }
        sample
    }
}

impl Machine {
    /// Processes one sample of one unit: the DAC code to write, and the sample for telemetry.
    ///
    /// `at` is the time of its DRDY edge, `missed` the number of conversions lost before it.
    pub fn sample(
        &mut self,
        unit: UnitIndex,
        adc_code: AdcCode,
        encoder_counts: EncoderCounts,
        at: Micros,
        missed: u8,
        fx: &mut impl Effects,
    ) -> (DacCode, PendingSample) {
        let pending = |drive, output, measured| PendingSample {
            unit,
            adc_code,
            encoder_counts,
            at,
            missed,
            drive,
            tip_force_mn: 0,
            output,
            measured,
        };
        let slot = &mut self.units[unit as usize];
        if !slot.sensor_up {
            if slot.came_up.take().is_none() {
                // It was under way when its converter was stopped or started anew: of nothing that
                // is in force.
                let pending = pending(Drive::Off, Output::default(), false);
                return (DacCode::ZERO_VOLT, pending);
            }
            slot.sensor_up = true;
        }
        if !slot.config.is_sealed() {
            // The output follows from numbers that are wrong: none.
            self.fault_board_once(Fault::ConfigCrc, unit as u32 + 1, at, fx);
            // Nor can the tension tell whether the cable lets go: the encoder has to.
            self.units[unit as usize].let_go.blind();
            let pending = pending(Drive::Off, Output::default(), false);
            return (DacCode::ZERO_VOLT, pending);
        }
        let drive = match slot.motor {
            _ if self.latch.is_set() || slot.latch.is_set() => Drive::Off,
            MotorState::Running => Drive::Follow,
            MotorState::Stopping => Drive::Ramp,
            _ => Drive::Off,
        };
        let input = Input {
            adc_code,
            encoder_counts,
            at,
            setpoint: slot.setpoint,
            drive,
        };
        let output = Controller::step(&slot.config, &mut slot.control, input);
        slot.at_zero = output.at_zero;
        if let Some((fault, detail)) = output.fault {
            if fault == Fault::OverTension && !slot.latch.has(fault) {
                slot.tripped_driven = drive != Drive::Off;
            }
            self.fault_unit(unit, fault, detail, at, fx);
        }
        (output.dac, pending(drive, output, true))
    }

    /// What must be checked of a sample, and does not have to stand between it and its DAC word:
    /// the converter's rate, whether load cell, motor and encoder can be believed, the force at the
    /// tip, the average of a zero. Call it once the word is on its way; a fault writes 0 V behind
    /// it.
    pub fn check(&mut self, pending: &mut PendingSample, fx: &mut impl Effects) {
        let (unit, at, output) = (pending.unit, pending.at, pending.output);
        let others_drive = self.system.drives();
        let slot = &mut self.units[unit as usize];
        // Not one that was left out.
        if slot.sensor_up {
            slot.samples = slot.samples.wrapping_add(1);
            slot.missed = slot.missed.wrapping_add(u32::from(pending.missed));
            slot.rate.observe(at, pending.missed);
            slot.adc_code = pending.adc_code;
            slot.counts = pending.encoder_counts;
        }
        if !pending.measured {
            return;
        }
        if output.flags & flags::SPIKE != 0 {
            slot.spikes = slot.spikes.wrapping_add(1);
        }
        let drives = pending.drive != Drive::Off;
        let doubt = slot
            .plausible
            .sample(&slot.config, pending.drive, pending.adc_code, &output);
        let swing = if drives {
            let spike = output.flags & flags::SPIKE != 0;
            let counts = pending.encoder_counts;
            (slot.encoder).observe(&slot.config, counts, output.tension, output.command, spike)
        } else {
            slot.encoder = EncoderWatch::default();
            None
        };
        // A sample that found a fault has switched its motor off already.
        if drives && output.fault.is_none() {
            let least = slot.config.least_tension(output.command);
            slot.let_go
                .driven(pending.encoder_counts, output.tension, least);
        } else {
            let let_go = slot.config.let_go();
            slot.let_go.switched_off(at, let_go);
            let released = Released {
                counts: pending.encoder_counts,
                travel_nm: output.travel_nm,
                missed: output.flags & flags::MISSED != 0,
                tension: output.tension,
                let_go,
                others_drive,
                // The first 0.1 mm that its reel turns refuses the zero.
                zeroing: slot.zero.is_some() || slot.latch.has(Fault::ZeroRefused),
                over_tension: matches!(output.fault, Some((Fault::OverTension, _))),
            };
            slot.let_go.released(at, released);
        }
        pending.tip_force_mn = self.tip.sample(unit, output.tension);
        if slot.zero.is_some() {
            self.average_zero(pending, fx);
        }
        match doubt {
            // It pulls by itself, so 0 V from its word is not certain: all DACs by RST, and no
            // power.
            Some((Fault::OutputStuck, _)) => {
                let detail = LetGo::detail(unit, Some(output.tension));
                self.fault_board_once(Fault::OutputStuck, detail, at, fx);
            }
            Some((fault, detail)) => self.fault_unit(unit, fault, detail, at, fx),
            None => {}
        }
        if !drives {
            self.watch_let_go(unit, at, fx);
        }
        if let Some(force_mn) = self.tip.exceeded().filter(|_| self.system.drives()) {
            self.fault_board(Fault::TipForce, force_mn, at, fx);
        }
        if let Some(swing) = swing {
            let detail = (swing.to_un() / 1_000).unsigned_abs();
            self.fault_unit(unit, Fault::EncoderStill, detail, at, fx);
        }
    }

    fn average_zero(&mut self, pending: &PendingSample, fx: &mut impl Effects) {
        let (unit, at) = (pending.unit, pending.at);
        let slot = &mut self.units[unit as usize];
        let Some(averager) = &mut slot.zero else {
            return;
        };
        let nm = slot.config.nm_per_count();
        let progress = match averager.turned(pending.encoder_counts, nm) {
            Some(why) => Progress::Refused(why),
            None => averager.push(pending.adc_code),
        };
        match progress {
            Progress::Collecting(_) => {}
            Progress::Done(zero) => {
                slot.zero = None;
                slot.zeroed = true;
                let zero = slot.control.relaxed_zero(&slot.config, zero);
                slot.config = slot.config.with_zero(zero);
                // A configuration that waits for its commit must not restore the old zero.
                slot.staged = slot.staged.map(|staged| staged.with_zero(zero));
                slot.control.config_changed();
                self.config_crc = self.crc();
            }
            Progress::Refused(why) => {
                slot.zero = None;
                self.fault_unit(unit, Fault::ZeroRefused, why.detail(), at, fx);
            }
        }
    }
}

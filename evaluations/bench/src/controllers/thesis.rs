//! The thesis's tension controller (3.6): five-tap mean, PID without damping, friction by the sign
//! of the reel's speed.
//!
//! The thesis gives the parts and no numbers for the gains: they are searched for on the plant
//! ([`super::tune`]), so that what is compared is the structure and not somebody's tuning.

use super::rig::{Rig, Sample, STEP_US};
use std::collections::VecDeque;
use wire::message::UnitConfig;

/// Taps of the mean over the samples (thesis 3.6.2).
const TAPS: usize = 5;
/// Volts a newton: the DAC's scale of the rig file, 282.22 steps of 20 V / 65,536.
const VOLTS_PER_N: f64 = 282.22 * 20.0 / 65_536.0;
/// Least command step of the Raven's software: 1 N mm at a reel of 10 mm (thesis 3.6.1).
const RAVEN_STEP_N: f64 = 0.1;
/// Period in which the sensor board sends all six readings together: 320 Hz (thesis 3.3).
const RAVEN_PERIOD_STEPS: u64 = 3_125 / STEP_US;
/// From the sensor board's reading to the DAC: a transfer to the PC and one cycle of the Raven's 1
/// kHz loop, each 1 ms.
const RAVEN_LATENCY_STEPS: u64 = 2_000 / STEP_US;
/// From a conversion to the DAC on a board of its own: as on ours, 0.2 ms.
const BOARD_LATENCY_STEPS: u64 = 200 / STEP_US;
/// Largest command, N: the force limit of the rig file.
const LIMIT_N: f64 = 16.0;

/// Where the loop is closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// Through the Raven's software: all six cells read together, commands in whole N mm (thesis
    /// 3.6.1).
    Raven,
    /// On a board of its own: each unit when its converter is ready, commands in DAC steps (thesis
    /// 3.6.2).
    Board,
}

/// What is tuned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Newton of command per newton of error.
    pub kp: f64,
    /// Newton of command per newton and second.
    pub ki: f64,
    /// Newton of command per newton a second.
    pub kd: f64,
    /// Part of the declared friction that is added with the sign of the speed, 0 to 1. All of it
    /// makes a limit cycle: the sign changes with every count of the encoder at rest.
    pub friction: f64,
}

/// The controller of one unit.
#[derive(Debug, Clone, Default)]
struct Unit {
    taps: VecDeque<f64>,
    integral: f64,
    last_mean: Option<f64>,
    last_counts: Option<i64>,
    newest: Option<(Sample, u64)>,
    last_step: Option<u64>,
}

/// Six controllers.
#[derive(Debug, Clone)]
pub struct Thesis {
    path: Path,
    gains: Gains,
    units: Vec<Unit>,
}

impl Thesis {
    pub fn new(path: Path, gains: Gains, units: usize) -> Self {
        Self {
            path,
            gains,
            units: vec![Unit::default(); units],
        }
    }

    /// One step of the plant, with the amplifiers driven.
    pub fn advance(&mut self, rig: &mut Rig) {
        let samples = rig.sample();
        match self.path {
            Path::Board => {
                for sample in samples {
                    self.control(rig, sample, rig.step);
                }
            }
            Path::Raven => {
                for sample in samples {
                    self.units[sample.unit].newest = Some((sample, rig.step));
                }
                if rig.step.is_multiple_of(RAVEN_PERIOD_STEPS) {
                    for i in 0..self.units.len() {
                        if let Some((sample, _)) = self.units[i].newest {
                            self.control(rig, sample, rig.step);
                        }
                    }
                }
            }
        }
    }

    fn control(&mut self, rig: &mut Rig, sample: Sample, now: u64) {
        let wire = *rig.units[sample.unit].config.wire();
        let setpoint = rig.units[sample.unit].setpoint_n;
        let unit = &mut self.units[sample.unit];
        unit.taps.push_back(tension_n(&wire, &sample));
        if unit.taps.len() > TAPS {
            unit.taps.pop_front();
        }
        let mean = unit.taps.iter().sum::<f64>() / unit.taps.len() as f64;
        let dt = unit
            .last_step
            .map_or(3.125e-3, |last| ((now - last) * STEP_US) as f64 * 1e-6);
        let error = setpoint - mean;
        let rate = (mean - unit.last_mean.unwrap_or(mean)) / dt;
        unit.integral = (unit.integral + self.gains.ki * error * dt).clamp(-LIMIT_N, LIMIT_N);
        // Positive: winding in.
        let travel = sample.counts.0 - unit.last_counts.unwrap_or(sample.counts.0);
        let direction = (travel * i64::from(wire.travel_nm_per_count.signum())).signum() as f64;
        unit.last_mean = Some(mean);
        unit.last_counts = Some(sample.counts.0);
        unit.last_step = Some(now);
        let friction = f64::from(wire.coulomb_un) * 1e-6
            + f64::from(wire.coulomb_load_q16) / 65_536.0 * setpoint;
        let command = setpoint - f64::from(wire.friction_offset_un) * 1e-6
            + direction * self.gains.friction * friction
            + self.gains.kp * error
            + unit.integral
            - self.gains.kd * rate;
        let command = command.clamp(0.0, LIMIT_N);
        let (command, latency) = match self.path {
            Path::Raven => (
                (command / RAVEN_STEP_N).round() * RAVEN_STEP_N,
                RAVEN_LATENCY_STEPS,
            ),
            Path::Board => (command, BOARD_LATENCY_STEPS),
        };
        rig.apply(sample.unit, command * VOLTS_PER_N, latency);
    }
}

/// Tension of a conversion, N.
fn tension_n(wire: &UnitConfig, sample: &Sample) -> f64 {
    f64::from(sample.code.get() - wire.zero_code)
        * f64::from(wire.scale_pn_per_count)
        * 1e-12
        * f64::from(sample.inv_cos.q16())
        / 65_536.0
}

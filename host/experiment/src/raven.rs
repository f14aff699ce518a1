//! The thesis's first control path (3.6.1): the board is a sensor board with its motors off, the
//! loop runs on the host.
//!
//! When every used unit has a new sample, the host computes the torques with the board's own
//! control law, rounds them to whole N·mm, as the Raven's software takes them, and sends them. They
//! reach the amplifiers after the transport's delay, with the next cycle of the Raven's 1 kHz loop.

use control::unit::{Controller, Drive, Input, Setpoint, State};
use control::{AdcCode, Config, EncoderCounts, Micros};
use rig::Rig;
use run::{ArgumentError, RunError};
use session::link::LinkError;
use session::{Session, TimedSample};
use std::collections::VecDeque;
use std::time::Duration;
use wire::message::{UnitConfig, UnitSetpoint};
use wire::UNITS;

/// Radius of the cable reel, m (thesis 3.6.1): a torque of 1 N·mm is 0.1 N.
pub const REEL_RADIUS_M: f64 = 0.01;
/// Cycle of the Raven's control loop.
pub const RAVEN_CYCLE: Duration = Duration::from_millis(1);

/// See the module's page.
#[derive(Debug)]
pub struct RavenLoop {
    /// Units that are used: a set waits for these.
    used: [bool; UNITS],
    configs: [Config; UNITS],
    states: [State; UNITS],
    setpoints: [UnitSetpoint; UNITS],
    /// The newest sample of each unit that no set has used.
    fresh: [Option<TimedSample>; UNITS],
    /// Torques on their way: when they arrive (ns), V at the amplifiers, times of their samples.
    underway: VecDeque<(u64, [f64; UNITS], [u64; UNITS])>,
    volts_per_n: [f64; UNITS],
}

impl RavenLoop {
    /// For the enabled units of a rig with these configurations, at rest.
    ///
    /// # Errors
    /// The control law refuses a configuration.
    pub fn new(rig: &Rig, in_force: &[UnitConfig; UNITS]) -> Result<Self, RunError> {
        let [a, b, c, d, e, f] = (in_force.each_ref())
            .map(|wire| Config::from_wire(wire).map_err(ArgumentError::Config));
        let configs = [a?, b?, c?, d?, e?, f?];
        Ok(Self {
            used: rig.units.map(|unit| unit.enabled),
            configs,
            states: Default::default(),
            setpoints: [UnitSetpoint {
                tension_un: 0,
                inv_cos_q16: 65_536,
                direction_q14: [0; 3],
                reel_um_per_s: None,
            }; UNITS],
            fresh: [None; UNITS],
            underway: VecDeque::new(),
            // The DAC's range is +-10 V for 65,536 codes.
            volts_per_n: rig.units.map(|unit| unit.dac_codes_per_n * 20.0 / 65_536.0),
        })
    }

    /// Tensions to hold from now on.
    pub fn set(&mut self, setpoints: [UnitSetpoint; UNITS]) {
        self.setpoints = setpoints;
    }

    /// A cycle of the Raven's loop: what has arrived goes to the amplifiers; returns the latencies,
    /// us.
    ///
    /// # Errors
    /// The link has no such way to the amplifiers.
    pub fn cycle(
        &mut self,
        session: &mut Session<'_>,
        samples: &[TimedSample],
        transport_ms: u32,
    ) -> Result<Vec<f64>, LinkError> {
        let now_ns = session.now_ns();
        for timed in samples {
            let unit = usize::from(timed.sample.unit);
            if let Some(slot) = self.fresh.get_mut(unit) {
                *slot = Some(*timed);
            }
            if (self.fresh.iter().zip(self.used)).all(|(fresh, used)| fresh.is_some() || !used) {
                let due = now_ns + u64::from(transport_ms) * 1_000_000;
                let (volts, times) = self.torques();
                self.underway.push_back((due, volts, times));
            }
        }
        let mut latencies = Vec::new();
        while let Some((_, volts, times)) = self.underway.pop_front_if(|(due, ..)| *due <= now_ns) {
            if let Some(controls) = session.link().controls() {
                controls.drive_outside(Some(volts))?;
            }
            latencies = (times.iter().zip(self.used))
                .filter(|(_, used)| *used)
                .map(|(t_us, _)| now_ns as f64 * 1e-3 - *t_us as f64)
                .collect();
        }
        Ok(latencies)
    }

    /// Six torques in whole N·mm from the six samples, as V at the amplifiers.
    fn torques(&mut self) -> ([f64; UNITS], [u64; UNITS]) {
        let fresh = std::mem::take(&mut self.fresh);
        let mut volts = [0.0; UNITS];
        let mut times = [0; UNITS];
        for (unit, timed) in fresh.iter().enumerate() {
            let Some(timed) = timed.filter(|_| self.used[unit]) else {
                continue;
            };
            let config = &self.configs[unit];
            let setpoint = Setpoint::from_wire(config, &self.setpoints[unit]).unwrap_or_default();
            let input = Input {
                adc_code: AdcCode::new(timed.sample.adc_code),
                encoder_counts: EncoderCounts(timed.sample.encoder_counts.into()),
                at: Micros(timed.t_us as u32),
                setpoint,
                drive: Drive::Follow,
            };
            let output = Controller::step(config, &mut self.states[unit], input);
            let command_n = f64::from(output.command.to_bits()) / f64::from(1 << 22);
            volts[unit] = whole_n_mm(command_n) * 1e-3 / REEL_RADIUS_M * self.volts_per_n[unit];
            times[unit] = timed.t_us;
        }
        (volts, times)
    }
}

/// The torque for a cable force as the Raven's software takes it: whole N·mm.
fn whole_n_mm(command_n: f64) -> f64 {
    (command_n * REEL_RADIUS_M * 1e3).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torques_are_whole_newton_millimetres() {
        assert_eq!(
            [0.04, 0.05, 2.349, -1.01].map(whole_n_mm),
            [0.0, 1.0, 23.0, -10.0]
        );
    }
}

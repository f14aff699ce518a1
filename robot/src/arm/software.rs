//! The Raven's software on the virtual arm: encoders, PD at 1 kHz, integer DAC codes, and the
//! `ravenstate` that it publishes.
//!
//! Source: uw-biorobotics/raven2 @d2307c5 (pid_control.cpp, r2params.yaml, grav_comp.cpp,
//! local_io.cpp). The set point of the velocity is always 0, the velocity the first difference of
//! the encoder, the gravity model that of the nominal masses.

use super::dynamics::{Body, MASS_KG};
use crate::kinematics::{forward, joints_from_motors, motors_from_joints, TRANSMISSION};
use crate::ravenstate::{code_for, gearhead_torques, Ravenstate, DEGREES};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Encoder counts a turn of the motor, four edges a line.
pub const COUNTS_PER_TURN: f64 = 4_000.0;
/// Period of the loop, ns.
pub const PERIOD_NS: u64 = 1_000_000;

/// Gains and limits of the first three joints.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gains {
    /// Torque at the gearhead per motor angle, N·m/rad.
    pub kp: [f64; 3],
    /// Torque at the gearhead per motor speed, N·m·s/rad.
    pub kd: [f64; 3],
    /// Largest DAC code, either sign.
    pub clip: [i32; 3],
    /// Whether the gravity model is added.
    pub gravity: bool,
}

impl Default for Gains {
    /// r2params.yaml and the default clipping of defines.h.
    fn default() -> Self {
        Self {
            kp: [0.3, 0.3, 0.15],
            kd: [0.008, 0.008, 0.012],
            clip: [2_500, 2_500, 2_000],
            gravity: true,
        }
    }
}

/// The controller's state.
#[derive(Debug, Clone)]
pub(super) struct Software {
    gains: Gains,
    model: Body,
    counts: Option<[i32; 3]>,
    message: Ravenstate,
}

impl Software {
    pub fn new(gains: Gains) -> Self {
        Self {
            gains,
            model: Body::new(MASS_KG),
            counts: None,
            message: Ravenstate {
                dac_val: Some([0; 16]),
                runlevel: 3,
                ..Ravenstate::default()
            },
        }
    }

    /// A cycle: encoder counts and set points (rad, rad, m) in, DAC codes out.
    pub fn cycle(&mut self, t_ns: u64, counts: [i32; 3], setpoint: [f64; 3]) -> [i32; 3] {
        let angle = |counts: i32| f64::from(counts) * TAU / COUNTS_PER_TURN;
        let before = self.counts.replace(counts).unwrap_or(counts);
        let period_s = PERIOD_NS as f64 * 1e-9;
        let motors = counts.map(angle);
        let speeds: [f64; 3] =
            core::array::from_fn(|i| angle(counts[i].wrapping_sub(before[i])) / period_s);
        let joints = joints_from_motors(motors);
        let wanted = motors_from_joints(setpoint);
        let held = if self.gains.gravity {
            let geometry = self.model.geometry(joints);
            gearhead_torques(self.model.gravity(&geometry).into())
        } else {
            [0.0; 3]
        };
        let torque: [f64; 3] = core::array::from_fn(|i| {
            self.gains.kp[i] * (wanted[i] - motors[i]) - self.gains.kd[i] * speeds[i] + held[i]
        });
        let codes: [i32; 3] = core::array::from_fn(|i| {
            code_for(torque[i]).clamp(-self.gains.clip[i], self.gains.clip[i])
        });
        self.publish(
            t_ns, counts, motors, speeds, joints, setpoint, torque, codes,
        );
        codes
    }

    #[allow(clippy::too_many_arguments)] // one message field each
    fn publish(
        &mut self,
        t_ns: u64,
        counts: [i32; 3],
        motors: [f64; 3],
        speeds: [f64; 3],
        joints: [f64; 3],
        setpoint: [f64; 3],
        torque: [f64; 3],
        codes: [i32; 3],
    ) {
        let m = &mut self.message;
        m.stamp = ((t_ns / 1_000_000_000) as u32, (t_ns % 1_000_000_000) as u32);
        m.seq = m.seq.wrapping_add(1);
        m.dt_ns = PERIOD_NS as i64;
        let pose = forward(&[joints[0], joints[1], joints[2], 0.0, 0.0, 0.0]);
        for i in 0..3 {
            m.enc_vals[i] = -counts[i];
            if let Some(dac) = &mut m.dac_val {
                dac[i] = codes[i];
            }
            m.tau[i] = torque[i] as f32;
            m.mpos[i] = (motors[i] * DEGREES) as f32;
            m.mvel[i] = (speeds[i] * DEGREES) as f32;
            // The insertion too: m x 57.2958. The velocity forgets the coupling.
            m.jpos[i] = (joints[i] * DEGREES) as f32;
            m.jvel[i] = (speeds[i] / TRANSMISSION[i] * DEGREES) as f32;
            m.jpos_d[i] = (setpoint[i] * DEGREES) as f32;
            m.pos[i] = (pose.position_m[i] * 1e6) as i32;
            for k in 0..3 {
                m.ori[3 * i + k] = pose.rotation[(i, k)] as f32;
            }
        }
        let wanted = motors_from_joints(setpoint);
        for (field, value) in m.mpos_d.iter_mut().zip(wanted) {
            *field = (value * DEGREES) as f32;
        }
    }

    /// What is published in this cycle.
    pub const fn message(&self) -> &Ravenstate {
        &self.message
    }
}

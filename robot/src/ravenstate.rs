//! The Raven's own message `ravenstate` (`raven_2/raven_state`, ROS 1, 1 kHz), and what is true of
//! it.
//!
//! Source: uw-biorobotics/raven2 @d2307c5 (`msg/raven_state.msg`, `local_io.cpp`, `init.cpp`,
//! `r2_kinematics.cpp`). Its traps, all handled by [`Adapter`], each held by a test:
//!
//! | trap | what the adapter does |
//! | --- | --- |
//! | all of jpos, jvel and their set points went through the conversion to degrees, the insertion too: it is m x 57.2958 | divides it again |
//! | jvel of elbow and insertion omits the coupling, that of the tool is never written | computes the first three from mvel; the tool's joints, whose velocity and effort nobody knows, are left out |
//! | tau is the command *before* the DAC's clipping | efforts from dac_val; from tau only in the old layout, as [`Meaning::Requested`] |
//! | no current is sensed | efforts are [`Meaning::Commanded`], never measured |
//! | gold's torque-to-current sign is negative except for jaw 1 | turns it back |
//! | jac_f copies jac_vel, truncated to integers, arms swapped | never read |
//! | arm slots follow the USB boards' order, not the colour | [`Adapter::slot`] |
//! | pos is in um, in frame 0 | m, [`Frame::Raven0`] |
//! | the stamp is the ROS clock at publication, after the USB write | [`Clock::RobotUtc`]; the encoders were read earlier in the same cycle of 1 ms |

use crate::kinematics::{joints_from_motors, COUPLING, JOINT_NAMES, TRANSMISSION};
use crate::state::{
    Clock, Effort, Frame, JointState, Meaning, Operating, OperatingState, RobotState, Stamp,
    TipState,
};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Degrees in a radian, the factor of the message's degree fields.
pub const DEGREES: f64 = 57.295_779_513_082_32;

/// DAC codes per ampere of the high-current amplifiers (joints 1 to 3): 32,768 codes are 12 A. With
/// it the published torques per code come out (3.01 mN·m, 2.68 mN·m, 47.7 mN).
pub const CODES_PER_A: f64 = 32_768.0 / 12.0;
/// Torque constant of the RE40 of joints 1 to 3, N·m/A.
pub const TORQUE_CONSTANT: f64 = 0.0603;
/// Ratio of their gearheads, 49:4.
pub const GEAR: f64 = 49.0 / 4.0;

/// Slots of an arm; the first three are shoulder, elbow and insertion.
const SLOTS: usize = 8;

/// The message, field by field as in `raven_state.msg`. Degrees and degrees/s where the table above
/// says so.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
#[allow(missing_docs)] // the names and units are the message's own; see the table above
pub struct Ravenstate {
    /// Seconds and nanoseconds of `hdr.stamp`.
    pub stamp: (u32, u32),
    /// `hdr.seq`.
    pub seq: u32,
    /// 0 E-stop, 1 init, 2 pedal up, 3 pedal down.
    pub runlevel: i32,
    pub sublevel: i32,
    pub last_seq: i32,
    /// Type of the arm in each of the two slots.
    pub r#type: [i32; 2],
    /// um, frame 0.
    pub pos: [i32; 6],
    /// Rotation matrices, row by row.
    #[serde(with = "arrays")]
    pub ori: [f32; 18],
    #[serde(with = "arrays")]
    pub ori_d: [f32; 18],
    pub pos_d: [i32; 6],
    /// ns since the last message.
    pub dt_ns: i64,
    #[serde(rename = "encVals")]
    pub enc_vals: [i32; 16],
    /// Codes after clipping; all `None` in the layout before 2017.
    pub dac_val: Option<[i32; 16]>,
    /// N·m at the gearhead, before clipping.
    pub tau: [f32; 16],
    pub mpos: [f32; 16],
    pub jpos: [f32; 16],
    pub mvel: [f32; 16],
    pub jvel: [f32; 16],
    pub mpos_d: [f32; 16],
    pub jpos_d: [f32; 16],
    pub grasp_d: [f32; 2],
    pub encoffsets: [f32; 16],
    pub jac_vel: [f32; 12],
    /// Copies `jac_vel`.
    pub jac_f: [f32; 12],
}

/// Serde of arrays longer than it knows by itself is done through a list.
mod arrays {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(array: &[f32; 18], s: S) -> Result<S::Ok, S::Error> {
        array.as_slice().serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<[f32; 18], D::Error> {
        let list = Vec::<f32>::deserialize(d)?;
        let got = list.len();
        list.try_into()
            .map_err(|_| D::Error::custom(format!("18 numbers expected, {got} found")))
    }
}

/// Layouts and behaviours of the message that are in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Version {
    /// Without `dac_val`, `jac_vel`, `jac_f`.
    Old,
    /// raven2 master and its crtk branch, 2023 (@d2307c5, @0d10caf).
    V2023,
}

/// Converts one arm of a `ravenstate` to [`RobotState`].
#[derive(Debug, Clone, PartialEq)]
pub struct Adapter {
    /// Layout.
    pub version: Version,
    /// Slot of the arm, 0 or 1: the order of the USB boards, the highest name first.
    pub slot: usize,
    /// Name of the publisher in the states.
    pub publisher: Arc<str>,
    names: Arc<[String]>,
    /// The message tells none.
    frame_id: Arc<str>,
}

/// Current of gold's drives per torque: negative except for jaw 1.
const GOLD_SIGN: f64 = -1.0;

impl Adapter {
    /// For the left (gold) arm in `slot` (0 or 1).
    #[must_use]
    pub fn gold(version: Version, slot: usize, publisher: &str) -> Self {
        Self {
            version,
            slot: slot.min(1),
            publisher: publisher.into(),
            names: JOINT_NAMES[..3]
                .iter()
                .map(|name| (*name).to_owned())
                .collect(),
            frame_id: "".into(),
        }
    }

    /// The arm's state.
    #[must_use]
    pub fn state(&self, message: &Ravenstate) -> RobotState {
        let (s, ns) = message.stamp;
        RobotState {
            publisher: Arc::clone(&self.publisher),
            sequence: Some(message.seq.into()),
            stamp: Stamp {
                clock: Clock::RobotUtc,
                t_ns: i64::from(s) * 1_000_000_000 + i64::from(ns),
            },
            received: None,
            joints: Some(self.joints(message)),
            tip: Some(self.tip(message)),
            force: None,
            operating: Some(operating(message.runlevel)),
        }
    }

    fn joints(&self, message: &Ravenstate) -> JointState {
        JointState {
            names: Arc::clone(&self.names),
            position: self.three(&message.jpos).to_vec(),
            velocity: Some(joints_from_motors(self.three(&message.mvel)).to_vec()),
            effort: Some(self.effort(message)),
            setpoint: Some(self.three(&message.jpos_d).to_vec()),
        }
    }

    /// The first three joints of a field in degrees (the insertion: m x 57.2958), in rad and m.
    fn three(&self, field: &[f32; 16]) -> [f64; 3] {
        core::array::from_fn(|joint| f64::from(field[SLOTS * self.slot + joint]) / DEGREES)
    }

    fn effort(&self, message: &Ravenstate) -> Effort {
        let codes = match self.version {
            Version::Old => None,
            Version::V2023 => message.dac_val,
        };
        let gearhead = core::array::from_fn(|joint| {
            let slot = SLOTS * self.slot + joint;
            match codes {
                Some(codes) => gearhead_torque(codes[slot]),
                None => f64::from(message.tau[slot]),
            }
        });
        Effort {
            meaning: if codes.is_some() {
                Meaning::Commanded
            } else {
                Meaning::Requested
            },
            value: joint_efforts(gearhead).to_vec(),
        }
    }

    fn tip(&self, message: &Ravenstate) -> TipState {
        let position = &message.pos[3 * self.slot..3 * self.slot + 3];
        let r: Vec<f64> = message.ori[9 * self.slot..9 * self.slot + 9]
            .iter()
            .map(|v| f64::from(*v))
            .collect();
        let rotation = Matrix3::from_row_slice(&r);
        let valid = (rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-3;
        TipState {
            frame: Frame::Raven0,
            frame_id: Arc::clone(&self.frame_id),
            stamp_ns: None,
            position_m: core::array::from_fn(|i| f64::from(position[i]) * 1e-6),
            orientation_xyzw: valid.then(|| {
                let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                    rotation,
                ));
                [q.i, q.j, q.k, q.w]
            }),
            velocity_m_per_s: None,
            angular_velocity_rad_per_s: None,
        }
    }
}

/// Torque at the gearhead's output for a code of gold's joints 1 to 3, N·m, without losses.
#[must_use]
pub fn gearhead_torque(code: i32) -> f64 {
    GOLD_SIGN * f64::from(code) / CODES_PER_A * TORQUE_CONSTANT * GEAR
}

/// Code for a torque at the gearhead's output: truncated as the Raven's software does, not clipped.
#[must_use]
pub fn code_for(gearhead_n_m: f64) -> i32 {
    (GOLD_SIGN * gearhead_n_m / (TORQUE_CONSTANT * GEAR) * CODES_PER_A) as i32
}

/// Torques or forces at the first three joints for torques at the gearheads: the transpose of the
/// motors' coupling.
#[must_use]
pub fn joint_efforts(gearhead_n_m: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|k| {
        (0..3)
            .map(|i| COUPLING[i][k] * TRANSMISSION[i] / GEAR * gearhead_n_m[i])
            .sum()
    })
}

/// Torques at the gearheads for torques or forces at the first three joints: the inverse of
/// [`joint_efforts`].
#[must_use]
pub fn gearhead_torques(joint: [f64; 3]) -> [f64; 3] {
    let mut at_motor = [0.0; 3];
    for i in (0..3).rev() {
        let others: f64 = (i + 1..3).map(|k| COUPLING[k][i] * at_motor[k]).sum();
        at_motor[i] = joint[i] - others;
    }
    core::array::from_fn(|i| at_motor[i] * GEAR / TRANSMISSION[i])
}

/// CRTK state for a run level.
fn operating(runlevel: i32) -> OperatingState {
    OperatingState {
        state: match runlevel {
            0 => Operating::Fault,
            2 => Operating::Paused,
            3 => Operating::Enabled,
            _ => Operating::Disabled,
        },
        is_homed: runlevel >= 2,
        is_busy: runlevel == 1 || runlevel == 3,
    }
}

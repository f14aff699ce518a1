//! The virtual Raven-II left arm: the first three joints with motors, cables, friction, gravity and
//! the arm's own software.
//!
//! ```text
//! trajectory ─▶ software (1 kHz PD, integer codes) ─▶ motor ─ friction ─ cable ─▶ link ─ friction, gravity ─▶ tip ◀─ force
//!                    ▲ encoders on the motors
//!                    └─▶ ravenstate ─▶ RobotState
//! ```
//!
//! What the arm publishes ([`VirtualArm::message`], [`VirtualArm::state`]) carries the contact
//! force as a real arm's does: in torque commands and small position errors, under the quantisation
//! of codes and encoders, with a dead zone wherever a joint stands or turns round. What it truly
//! does is in [`Truth`], a separate type that needs the feature `arm`; an estimator is built
//! without that feature.
//!
//! The arm is a [`plant::TipModel`]: in the plant the cables' forces move its tip, and its tip
//! moves the cables. Its parameters are drawn from the seed ([`parameters`]): every seed is another
//! Raven.

mod change;
mod drive;
pub mod dynamics;
pub mod parameters;
mod software;

pub use change::ChangeConfig;
pub use software::{Gains, COUNTS_PER_TURN, PERIOD_NS};

use crate::kinematics::{forward, from_crtk, inverse, to_crtk, InverseError, TRANSMISSION};
use crate::ravenstate::{
    joint_efforts, Adapter, Ravenstate, Version, CODES_PER_A, GEAR, TORQUE_CONSTANT,
};
use crate::state::{Clock, Frame, Mount, RobotState, Stamp, StateError};
use crate::trajectory::{JointTarget, Trajectory};
use change::Change;
use drive::{Contact, Drives};
use dynamics::{Body, Geometry, MASS_KG};
use nalgebra::{Matrix3, Vector3};
use parameters::Parameters;
use serde::{Deserialize, Serialize};
use software::Software;
use std::f64::consts::TAU;

/// Steps after which inertia, gravity and Jacobian are computed again: 0.2 ms on the plant's grid,
/// in which a joint moves by 1e-5 rad.
const REFRESH_STEPS: u32 = 4;

/// What a virtual arm is made of, apart from its seed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArmConfig {
    /// Where the arm's CRTK frame stands in the rig's robot base frame.
    pub mount: Mount,
    /// Joints at the start, rad, rad, m.
    pub start: [f64; 3],
    /// Width of the parameters' scatter: 1 the documented ranges, 0 the nominal arm.
    pub scatter: f64,
    /// Point mass at the tip that the arm's own gravity model does not know, kg: another tool, or
    /// something held.
    #[serde(skip_serializing_if = "is_zero")]
    // A file without it has the hash that it always had.
    pub payload_kg: f64,
    /// Gains of the arm's software.
    pub gains: Gains,
    /// Time in which the pace of a trajectory ramps in and out, s.
    pub ramp_s: f64,
    /// What changes from trial to trial and within one.
    #[serde(skip_serializing_if = "ChangeConfig::is_none")]
    pub change: ChangeConfig,
    /// Number of the trial, from which its changes are drawn.
    #[serde(skip)]
    pub session: u64,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde gives a reference
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

const DEG: f64 = std::f64::consts::PI / 180.0;

impl Default for ArmConfig {
    fn default() -> Self {
        let start = [40.0 * DEG, 82.5 * DEG, 0.375];
        Self {
            // The middle of the trajectories' ranges at the workspace centre of the example rig.
            mount: Mount {
                translation_m: placed(start, [-0.080, 0.025, -0.140]),
                ..Mount::default()
            },
            start,
            scatter: 1.0,
            payload_kg: 0.0,
            gains: Gains::default(),
            ramp_s: 1.0,
            change: ChangeConfig::default(),
            session: 0,
        }
    }
}

/// Origin of the CRTK frame, not turned, for which the tip is at `at_m` with joints `q`.
#[must_use]
pub fn placed(q: [f64; 3], at_m: [f64; 3]) -> [f64; 3] {
    let tip = to_crtk(forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m);
    (Vector3::from(at_m) - tip).into()
}

/// Why there can be no such arm.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// The mount.
    #[error("mount of the virtual arm: {0}")]
    Mount(StateError),
    /// The start.
    #[error("start of the virtual arm: {0}")]
    Start(InverseError),
    /// A figure out of its range.
    #[error("{name} = {value} of the virtual arm: allowed are {min} to {max}")]
    Range {
        /// Key.
        name: &'static str,
        /// Given.
        value: f64,
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
}

/// What the arm truly does. No estimator may see it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// Time since the arm's start, s.
    pub time_s: f64,
    /// Link positions: rad, rad, m.
    pub joints: [f64; 3],
    /// Their velocities.
    pub joint_rates: [f64; 3],
    /// Motor travel in the joints' units, with coupling and stretch.
    pub motors: [f64; 3],
    /// Cable forces at the motors, in the joints' units.
    pub cable: [f64; 3],
    /// Friction at the motors, in the joints' units: N·m, N·m, N.
    pub motor_friction: [f64; 3],
    /// Friction at the links.
    pub link_friction: [f64; 3],
    /// Tip in the rig's frame, m.
    pub tip_m: [f64; 3],
    /// Force on the tip in the rig's frame, N.
    pub force_on_tip_n: [f64; 3],
    /// That force at the joints: what a perfect estimator would find, N·m, N·m, N.
    pub contact_effort: [f64; 3],
}

/// See the module's page.
#[derive(Debug, Clone)]
pub struct VirtualArm {
    config: ArmConfig,
    parameters: Parameters,
    change: Change,
    /// Coulomb friction of all contacts per that of the parameters, now.
    friction: f64,
    body: Body,
    software: Software,
    adapter: Adapter,
    drives: Drives,
    links: [Contact; 3],
    q: [f64; 3],
    v: [f64; 3],
    /// Torque of the motors at the joints' units, held between two cycles of the software.
    torque: [f64; 3],
    refresh: u32,
    geometry: Geometry,
    jacobian: Matrix3<f64>,
    inverse_inertia: Matrix3<f64>,
    gravity: Vector3<f64>,
    /// Rotation from the rig's frame to frame 0.
    rig_to_0: Matrix3<f64>,
    force_0: Vector3<f64>,
    tip_m: [f64; 3],
    tip_m_per_s: [f64; 3],
    trajectory: Trajectory,
    path_time_s: f64,
    ramp: f64,
    steps_s: f64,
    next_cycle_ns: u64,
    /// Messages that nobody has taken yet, while [`VirtualArm::keep_messages`] is on.
    messages: Vec<Ravenstate>,
    /// The truth at the time of each message.
    truths: Vec<Truth>,
    keep: bool,
}

impl VirtualArm {
    /// An arm at rest at its start, holding itself against gravity.
    ///
    /// # Errors
    /// [`ArmError`] names the key that can't be.
    pub fn new(config: &ArmConfig, seed: u64) -> Result<Self, ArmError> {
        check(config)?;
        let mut parameters = Parameters::draw(seed, config.scatter);
        let change = Change::draw(&config.change, seed, config.session);
        for i in 0..3 {
            parameters.torque_gain[i] *= change.gain[i];
            parameters.current_offset_a[i] += change.offset_a[i];
            parameters.homing[i] += change.homing[i];
        }
        let body = Body::new(core::array::from_fn(|i| {
            MASS_KG[i] * parameters.mass_factor[i]
        }))
        .with_payload(config.payload_kg);
        let q = config.start;
        let geometry = body.geometry(q);
        let gravity = body.gravity(&geometry);
        let inertia = body.inertia(&geometry);
        let link_inertia = core::array::from_fn(|i| inertia[(i, i)]);
        let held = cables_for(gravity.into());
        let links = core::array::from_fn(|i| {
            Contact::new(
                parameters.link_coulomb[i],
                parameters.link_breakaway[i],
                parameters.stribeck[i],
                parameters.presliding[i],
                parameters.link_viscous[i],
                link_inertia[i],
            )
        });
        let crtk_to_0 = Matrix3::from_columns(&[
            from_crtk(Vector3::x()),
            from_crtk(Vector3::y()),
            from_crtk(Vector3::z()),
        ]);
        let rig_to_0 = crtk_to_0
            * config
                .mount
                .rotation()
                .inverse()
                .to_rotation_matrix()
                .matrix();
        let mut arm = Self {
            config: *config,
            parameters,
            friction: change.friction(0.0),
            change,
            software: Software::new(config.gains),
            adapter: Adapter::gold(Version::V2023, 0, "virtual"),
            drives: Drives::new(&parameters, link_inertia, q, held),
            links,
            q,
            v: [0.0; 3],
            torque: held,
            refresh: 0,
            jacobian: Body::tip_jacobian(&geometry),
            inverse_inertia: Matrix3::identity(),
            geometry,
            gravity,
            body,
            rig_to_0,
            force_0: Vector3::zeros(),
            tip_m: [0.0; 3],
            tip_m_per_s: [0.0; 3],
            trajectory: Trajectory::standing(q),
            path_time_s: 0.0,
            ramp: 0.0,
            steps_s: 0.0,
            next_cycle_ns: 0,
            messages: Vec::new(),
            truths: Vec::new(),
            keep: false,
        };
        arm.follow(Trajectory::standing(arm.measured_joints()));
        arm.recompute();
        arm.place_tip();
        Ok(arm)
    }

    /// Follows `trajectory` from its start. The arm should be near its first position; set points
    /// jump otherwise.
    pub fn follow(&mut self, trajectory: Trajectory) {
        self.trajectory = trajectory;
        self.path_time_s = 0.0;
    }

    /// The set points in force.
    #[must_use]
    pub fn target(&self) -> JointTarget {
        self.trajectory.at(self.path_time_s)
    }

    /// Moves on by `h_s` with `force_n` on the tip (rig's frame, N).
    pub fn step(&mut self, h_s: f64, moving: bool, force_n: [f64; 3]) {
        self.advance_path(h_s, moving);
        if self.steps_s * 1e9 + 0.5 >= self.next_cycle_ns as f64 {
            self.cycle();
        }
        if self.refresh == 0 {
            self.recompute();
            self.friction = self.change.friction(self.steps_s);
            self.refresh = REFRESH_STEPS;
        }
        self.refresh -= 1;
        self.force_0 = self.rig_to_0 * Vector3::from(force_n);
        let change = (&self.change, self.friction);
        let cable = (self.drives).step(h_s, self.torque, (self.q, self.v), change);
        let v = Vector3::from(self.v);
        let friction = Vector3::from_fn(|i, _| self.links[i].force(self.v[i]));
        let push = cable - friction - self.gravity - self.body.velocity_terms(&self.geometry, v)
            + self.jacobian.tr_mul(&self.force_0)
            + Vector3::new(0.0, self.change.drag_n_m(self.steps_s), 0.0);
        let v = v + self.inverse_inertia * push * h_s;
        // The tool's guide: friction grows with the lateral force at the tip.
        let axis = self.jacobian.column(2).into_owned();
        let lateral = (self.force_0 - axis * axis.dot(&self.force_0)).norm();
        for i in 0..3 {
            self.v[i] = v[i];
            let travel = h_s * v[i];
            self.q[i] += travel;
            let more = if i == 2 {
                self.parameters.guide_friction * lateral
            } else {
                0.0
            };
            let scale = self.friction * self.change.one_way(v[i]);
            self.links[i].slide(travel, v[i], more, scale);
        }
        self.steps_s += h_s;
        self.place_tip();
    }

    fn advance_path(&mut self, h_s: f64, moving: bool) {
        let change = h_s / self.config.ramp_s.max(1e-9);
        self.ramp = if moving {
            (self.ramp + change).min(1.0)
        } else {
            (self.ramp - change).max(0.0)
        };
        // No jump in velocity, none in acceleration.
        let r = self.ramp;
        self.path_time_s += h_s * r * r * r * (r * (6.0 * r - 15.0) + 10.0);
    }

    /// A cycle of the arm's software.
    fn cycle(&mut self) {
        let t_ns = self.next_cycle_ns;
        self.next_cycle_ns += PERIOD_NS;
        let counts = self.encoder_counts();
        let setpoint = self.trajectory.at(self.path_time_s).position;
        let codes = self.software.cycle(t_ns, counts, setpoint);
        self.torque = core::array::from_fn(|i| {
            // Gold's current is negative for a positive torque.
            let current_a =
                -f64::from(codes[i]) / CODES_PER_A + self.parameters.current_offset_a[i];
            self.parameters.torque_gain[i] * TORQUE_CONSTANT * current_a * TRANSMISSION[i]
        });
        if self.keep {
            self.messages.push(self.software.message().clone());
            self.truths.push(self.truth());
        }
    }

    fn encoder_counts(&self) -> [i32; 3] {
        let p = &self.parameters;
        core::array::from_fn(|i| {
            let travel = self.drives.phi[i] + p.homing[i];
            let counts = travel * TRANSMISSION[i] * COUNTS_PER_TURN / TAU + p.encoder_phase[i];
            counts.floor() as i32
        })
    }

    /// What the encoders make of the joints now, rad, rad, m.
    fn measured_joints(&self) -> [f64; 3] {
        let motors = self
            .encoder_counts()
            .map(|counts| f64::from(counts) * TAU / COUNTS_PER_TURN);
        crate::kinematics::joints_from_motors(motors)
    }

    fn recompute(&mut self) {
        self.geometry = self.body.geometry(self.q);
        self.jacobian = Body::tip_jacobian(&self.geometry);
        self.gravity = self.body.gravity(&self.geometry);
        let inertia = self.body.inertia(&self.geometry);
        // Positive definite: a sum of squares and a positive diagonal.
        self.inverse_inertia = inertia.try_inverse().unwrap_or(self.inverse_inertia);
    }

    fn place_tip(&mut self) {
        let to_rig = self.rig_to_0.transpose();
        let tip = to_rig * self.body.tip(self.q) + Vector3::from(self.config.mount.translation_m);
        self.tip_m = tip.into();
        self.tip_m_per_s = (to_rig * (self.jacobian * Vector3::from(self.v))).into();
    }

    /// The last `ravenstate` that the arm has published.
    #[must_use]
    pub const fn message(&self) -> &Ravenstate {
        self.software.message()
    }

    /// Keeps every message until [`VirtualArm::take_messages`], or only the last one.
    pub fn keep_messages(&mut self, keep: bool) {
        self.keep = keep;
        self.messages.clear();
        self.truths.clear();
    }

    /// The messages since the last call, in order; empty unless they are kept.
    pub fn take_messages(&mut self) -> Vec<Ravenstate> {
        std::mem::take(&mut self.messages)
    }

    /// The truth at the time of each message since the last call; empty unless they are kept.
    pub fn take_truths(&mut self) -> Vec<Truth> {
        std::mem::take(&mut self.truths)
    }

    /// A message as a state, on the virtual clock.
    #[must_use]
    pub fn state_of(&self, message: &Ravenstate) -> RobotState {
        let mut state = self.adapter.state(message);
        state.stamp = Stamp {
            clock: Clock::Virtual,
            ..state.stamp
        };
        state
    }

    /// The last message as a state, on the virtual clock.
    #[must_use]
    pub fn state(&self) -> RobotState {
        self.state_of(self.software.message())
    }

    /// Position of the tip as the arm reports it, in the rig's frame, m: from encoders, not the
    /// truth.
    #[must_use]
    pub fn reported_tip_m(&self) -> [f64; 3] {
        let message = self.software.message();
        let tip = Vector3::from_fn(|i, _| f64::from(message.pos[i]) * 1e-6);
        let in_crtk = crate::state::TipState {
            frame: Frame::RavenCrtk,
            frame_id: "".into(),
            stamp_ns: None,
            position_m: to_crtk(tip).into(),
            orientation_xyzw: None,
            velocity_m_per_s: None,
            angular_velocity_rad_per_s: None,
        };
        self.config.mount.tip_in_rig(&in_crtk).position_m
    }

    /// The arm's figures, of which nothing but what it publishes may tell.
    #[must_use]
    pub const fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// What the arm truly does.
    #[must_use]
    pub fn truth(&self) -> Truth {
        Truth {
            time_s: self.steps_s,
            joints: self.q,
            joint_rates: self.v,
            motors: self.drives.phi,
            cable: self.drives.cable,
            motor_friction: self.drives.friction(),
            link_friction: core::array::from_fn(|i| self.links[i].friction()),
            tip_m: self.tip_m,
            force_on_tip_n: (self.rig_to_0.transpose() * self.force_0).into(),
            contact_effort: self.jacobian.tr_mul(&self.force_0).into(),
        }
    }

    /// Velocity of the tip per velocity of joint `joint` (from 0), rig's frame: the direction in
    /// which a force acts on that joint, and its lever.
    ///
    /// # Panics
    /// No such joint.
    #[must_use]
    pub fn direction_of_joint(&self, joint: usize) -> [f64; 3] {
        (self.rig_to_0.transpose() * self.jacobian.column(joint)).into()
    }

    /// Mechanical energy, J: motion, gravity, cables, sticking contacts.
    #[must_use]
    pub fn energy_j(&self) -> f64 {
        let g = self.body.geometry(self.q);
        let v = Vector3::from(self.v);
        0.5 * (v.transpose() * self.body.inertia(&g) * v)[0]
            + self.body.potential_j(&g)
            + self.drives.energy_j(self.q)
            + self.links.iter().map(Contact::energy_j).sum::<f64>()
    }

    /// Takes the drives' power: no torque, until the next cycle of the software.
    #[cfg(test)]
    fn cut_power(&mut self) {
        self.torque = [0.0; 3];
        self.next_cycle_ns = u64::MAX;
    }
}

/// Torques at the motors, in the joints' units, that hold these at the joints.
fn cables_for(joint: [f64; 3]) -> [f64; 3] {
    let gearhead = crate::ravenstate::gearhead_torques(joint);
    core::array::from_fn(|i| gearhead[i] * TRANSMISSION[i] / GEAR)
}

fn check(config: &ArmConfig) -> Result<(), ArmError> {
    config.mount.check().map_err(ArmError::Mount)?;
    let q = config.start;
    inverse(
        forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m,
        [0.0; 3],
    )
    .map_err(ArmError::Start)?;
    for (name, value, min, max) in [
        ("scatter", config.scatter, 0.0, 1.0),
        ("payload_kg", config.payload_kg, 0.0, 1.0),
        ("ramp_s", config.ramp_s, 0.0, 60.0),
    ]
    .into_iter()
    .chain(config.change.ranges())
    {
        if !(min..=max).contains(&value) {
            return Err(ArmError::Range {
                name,
                value,
                min,
                max,
            });
        }
    }
    Ok(())
}

/// Joint efforts that the arm's own message stands for, for tests of estimators.
#[must_use]
pub fn commanded_efforts(message: &Ravenstate) -> [f64; 3] {
    let codes = message.dac_val.unwrap_or_default();
    joint_efforts(core::array::from_fn(|i| {
        crate::ravenstate::gearhead_torque(codes[i])
    }))
}

impl plant::TipModel for VirtualArm {
    fn step(&mut self, h_s: f64, moving: bool, force_n: plant::Vec3) {
        Self::step(self, h_s, moving, force_n);
    }

    fn position_m(&self) -> plant::Vec3 {
        self.tip_m
    }

    fn velocity_m_per_s(&self) -> plant::Vec3 {
        self.tip_m_per_s
    }

    fn boxed_clone(&self) -> Box<dyn plant::TipModel> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;

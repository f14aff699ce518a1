//! What changes on a real arm between trials and within one, and not on an arm of fixed parameters.
//!
//! An estimator that was trained yesterday meets another robot today: gears are cold, amplifiers
//! have other zeros, a tool's cable pulls. Everything is zero by default: the arm of the parameters
//! alone. docs/robot.md has sizes and where they come from.

use super::parameters::HOMING_SD;
use crate::random::Random;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Changes of an arm. Each trial draws its own from its number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChangeConfig {
    /// Coulomb friction at power-on above that of the warm arm, share of it.
    pub warm_up: f64,
    /// Time constant of the warming, s.
    pub warm_up_s: f64,
    /// Coulomb friction of all contacts above that of the parameters, share of it; negative where
    /// it has fallen.
    pub friction: f64,
    /// The same from trial to trial, standard deviation, share: other tensions of the cables,
    /// another temperature of the room.
    pub friction_sd: f64,
    /// Torque per current: standard deviation over trials, share.
    pub gain_sd: f64,
    /// Zeros of the amplifiers: standard deviation over trials, A.
    pub offset_sd_a: f64,
    /// The motors' Coulomb friction over a turn of the motor: amplitude, share of it.
    pub ripple: f64,
    /// Coulomb friction in positive direction above the mean of both, share of it.
    pub asymmetry: f64,
    /// Torque of a tool's cable at the elbow, N·m: it goes back and forth within five minutes.
    pub drag_n_m: f64,
    /// Zeros of the joints, which each trial finds anew by homing: standard deviation over trials,
    /// per that of the parameters.
    pub homing_sd: f64,
}

impl Default for ChangeConfig {
    fn default() -> Self {
        Self {
            warm_up: 0.0,
            warm_up_s: 600.0,
            friction: 0.0,
            friction_sd: 0.0,
            gain_sd: 0.0,
            offset_sd_a: 0.0,
            ripple: 0.0,
            asymmetry: 0.0,
            drag_n_m: 0.0,
            homing_sd: 0.0,
        }
    }
}

/// Period of the drag of a tool's cable, s. Estimate: the tool's orientation changes a few times in
/// an operation's step.
const DRAG_S: f64 = 300.0;

impl ChangeConfig {
    /// The changes of the standard experiment, within the ranges of docs/robot.md, which has the
    /// sources.
    pub const STANDARD: Self = Self {
        warm_up: 0.05,
        warm_up_s: 600.0,
        friction: 0.0,
        friction_sd: 0.02,
        gain_sd: 0.03,
        offset_sd_a: 0.012,
        ripple: 0.1,
        asymmetry: 0.05,
        drag_n_m: 0.05,
        homing_sd: 1.0,
    };

    /// Whether nothing changes. A file without changes has the hash that it always had.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Keys with values and limits.
    pub(super) const fn ranges(&self) -> [(&'static str, f64, f64, f64); 10] {
        [
            ("change.warm_up", self.warm_up, -0.5, 1.0),
            ("change.warm_up_s", self.warm_up_s, 1.0, 1e5),
            ("change.friction", self.friction, -0.9, 3.0),
            ("change.friction_sd", self.friction_sd, 0.0, 0.3),
            ("change.gain_sd", self.gain_sd, 0.0, 0.3),
            ("change.offset_sd_a", self.offset_sd_a, 0.0, 1.0),
            ("change.ripple", self.ripple, 0.0, 0.9),
            ("change.asymmetry", self.asymmetry, -0.9, 0.9),
            ("change.drag_n_m", self.drag_n_m, -5.0, 5.0),
            ("change.homing_sd", self.homing_sd, 0.0, 10.0),
        ]
    }
}

/// The changes of one trial.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    config: ChangeConfig,
    /// Torque per current, to that of the parameters.
    pub gain: [f64; 3],
    /// Current, A.
    pub offset_a: [f64; 3],
    /// Zero of each joint above that of the parameters, rad, rad, m.
    pub homing: [f64; 3],
    /// Coulomb friction of the warm arm per that of the parameters.
    level: f64,
    ripple_phase: [f64; 3],
    drag_phase: f64,
}

impl Change {
    /// Draws the changes of trial `session` of the arm `seed`.
    pub fn draw(config: &ChangeConfig, seed: u64, session: u64) -> Self {
        let mut random = Random::stream(seed, "arm session", session);
        let normal = |random: &mut Random| random.normal().clamp(-2.5, 2.5);
        let gain = [(); 3].map(|()| 1.0 + config.gain_sd * normal(&mut random));
        let offset_a = [(); 3].map(|()| config.offset_sd_a * normal(&mut random));
        let drag_phase = TAU * random.unit();
        let level = 1.0 + config.friction + config.friction_sd * normal(&mut random);
        let homing = HOMING_SD.map(|sd| config.homing_sd * sd * normal(&mut random));
        // The gears are the arm's, not the trial's.
        let mut gears = Random::stream(seed, "arm ripple", 0);
        Self {
            config: *config,
            gain,
            offset_a,
            homing,
            level,
            ripple_phase: [(); 3].map(|()| TAU * gears.unit()),
            drag_phase,
        }
    }

    /// Coulomb friction of every contact per that of the parameters, at a time since power-on.
    pub fn friction(&self, time_s: f64) -> f64 {
        let c = &self.config;
        self.level * (1.0 + c.warm_up * libm::exp(-time_s / c.warm_up_s))
    }

    /// The same of a contact that moves this way.
    pub fn one_way(&self, velocity: f64) -> f64 {
        if self.config.asymmetry == 0.0 {
            return 1.0;
        }
        1.0 + self.config.asymmetry * velocity.signum()
    }

    /// The same of the gear of motor `i`, at an angle of the motor, rad.
    pub fn over_turn(&self, i: usize, angle: f64) -> f64 {
        if self.config.ripple == 0.0 {
            return 1.0;
        }
        1.0 + self.config.ripple * libm::sin(angle + self.ripple_phase[i])
    }

    /// Torque at the elbow, N·m.
    pub fn drag_n_m(&self, time_s: f64) -> f64 {
        self.config.drag_n_m * libm::sin(TAU * time_s / DRAG_S + self.drag_phase)
    }
}

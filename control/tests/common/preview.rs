//! What a host knows of the robot's motion: poses as real robots report them, and the reel speeds
//! that it makes of them.
#![allow(dead_code)] // each user takes a part

use crate::rig::{Noise, Rig, STEP_US};
use nalgebra::Vector3;
use plant::geometry::nominal_geometry;
use robot::motion::Motion;
use std::collections::VecDeque;

/// How a robot reports its tip.
#[derive(Debug, Clone, Copy)]
pub struct Poses {
    /// Time between two, us.
    pub period_us: u64,
    /// From the moment that a pose describes until the host has it, us.
    pub latency_us: u64,
    /// White noise of each coordinate, standard deviation, m.
    pub noise_m: f64,
    /// Step of each coordinate, m; 0: none.
    pub step_m: f64,
}

impl Poses {
    /// As a dVRK sends them: 100 Hz.
    pub const fn dvrk(noise_m: f64) -> Self {
        Self {
            period_us: 10_000,
            latency_us: 5_000,
            noise_m,
            step_m: 0.0,
        }
    }

    /// As a Raven does: 1 kHz, in steps of its encoders, of which one of the shoulder or elbow
    /// moves the tip by some 2 um.
    pub const RAVEN: Self = Self {
        period_us: 1_000,
        latency_us: 2_000,
        noise_m: 0.0,
        step_m: 2e-6,
    };
}

/// Time between two setpoints of the host, us.
const CYCLE_US: u64 = 10_000;

/// Largest standard deviation of the speed that the host sends, m/s, and how far ahead it predicts,
/// s: as in `host/force/src/preview.rs`.
const SD_M_PER_S: f64 = 1.2e-4;
const AHEAD_S: f64 = 6.5e-3;

/// Robot and host.
pub struct Host {
    poses: Poses,
    noise: Noise,
    next_pose: u64,
    next_cycle: u64,
    /// Poses on their way: when they arrive, when they were, us; the tip.
    underway: VecDeque<(u64, u64, Vector3<f64>)>,
    tip: Option<Vector3<f64>>,
    motion: Motion,
    exits: Vec<Vector3<f64>>,
}

impl Host {
    pub fn new(poses: Poses, rig: &Rig, seed: u64) -> Self {
        Self {
            poses,
            noise: Noise(seed ^ 0x0070_7365),
            next_pose: 0,
            next_cycle: 0,
            underway: VecDeque::new(),
            tip: None,
            motion: Motion::default(),
            exits: nominal_geometry(rig.plant.config())
                .iter()
                .map(|unit| unit.position_m.into())
                .collect(),
        }
    }

    /// Before each step of the rig: sends the reels' speeds with the setpoints.
    pub fn step(&mut self, rig: &mut Rig) {
        let now = rig.step * STEP_US;
        if now >= self.next_pose {
            self.next_pose = now + self.poses.period_us;
            let step_m = self.poses.step_m;
            let tip = rig.plant.tip_position_m().map(|x| {
                let x = x + self.poses.noise_m * self.noise.normal();
                if step_m > 0.0 {
                    (x / step_m).round() * step_m
                } else {
                    x
                }
            });
            self.underway
                .push_back((now + self.poses.latency_us, now, tip.into()));
        }
        while let Some((_, at, tip)) = self.underway.pop_front_if(|pose| pose.0 <= now) {
            self.motion.see(at as f64 * 1e-6, tip);
            self.tip = Some(tip);
        }
        if now < self.next_cycle {
            return;
        }
        self.next_cycle = now + CYCLE_US;
        let velocity = self
            .motion
            .velocity_at(now as f64 * 1e-6 + AHEAD_S)
            .filter(|velocity| velocity.sd_m_per_s <= SD_M_PER_S);
        for (unit, exit) in rig.units.iter_mut().zip(&self.exits) {
            unit.reel_um_per_s = velocity.zip(self.tip).map(|(velocity, tip)| {
                let direction = (exit - tip).normalize();
                (direction.dot(&velocity.m_per_s) * 1e6).round() as i32
            });
        }
    }
}

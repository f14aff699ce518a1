//! What a host knows of the robot's motion: poses as real robots report them, and the reel speeds
//! that it makes of them.
#![allow(dead_code)] // each user takes a part

use crate::rig::{Noise, Rig, STEP_US};
use nalgebra::Vector3;
use plant::geometry::nominal_geometry;
use robot::motion::Foretold;
use robot::watch::Delays;
use std::collections::VecDeque;

/// How a robot reports its tip.
#[derive(Debug, Clone, Copy)]
pub struct Poses {
    /// Time between two, us.
    pub period_us: u64,
    /// From the moment that a pose describes until the host has it, us.
    pub latency_us: u64,
    /// How far that scatters, standard deviation, us. Normal; a pose that would come before the one
    /// ahead of it comes with it.
    pub jitter_us: f64,
    /// How far the robot's stamps are from those moments, standard deviation, us. A constant error
    /// is part of the difference of the clocks.
    pub stamp_us: f64,
    /// White noise of each coordinate, standard deviation, m.
    pub noise_m: f64,
    /// Step of each coordinate, m; 0: none.
    pub step_m: f64,
}

impl Poses {
    /// As a dVRK sends them: 100 Hz.
    pub const fn dvrk(noise_m: f64, jitter_us: f64) -> Self {
        Self {
            period_us: 10_000,
            latency_us: 5_000,
            jitter_us,
            stamp_us: STAMP_US,
            noise_m,
            step_m: 0.0,
        }
    }

    /// As a Raven does: 1 kHz, in steps of its encoders, of which one of the shoulder or elbow
    /// moves the tip by some 2 um.
    pub const RAVEN: Self = Self {
        period_us: 1_000,
        latency_us: 2_000,
        jitter_us: 100.0,
        stamp_us: STAMP_US,
        noise_m: 0.0,
        step_m: 2e-6,
    };
}

/// Scatter of the robot's stamps, us: how late the loop of a robot's computer is woken, at 1 kHz
/// without a real-time kernel some tens of us.
const STAMP_US: f64 = 50.0;

/// The robot's clock less ours, us.
const OTHER_CLOCK_US: i64 = 1_700_000_000_000_000;

/// Time between two setpoints of the host, us.
const CYCLE_US: u64 = 10_000;

/// Robot and host.
pub struct Host {
    poses: Poses,
    noise: Noise,
    next_pose: u64,
    next_cycle: u64,
    /// Poses on their way: when they arrive, us; their stamp, us of the robot's clock; the tip.
    underway: VecDeque<(u64, i64, Vector3<f64>)>,
    /// The newest that has arrived.
    newest: Option<(u64, i64, Vector3<f64>)>,
    delays: Delays,
    foretold: Foretold,
    /// How often the speeds were sent after they were not, or the other way round.
    pub changes: u32,
    exits: Vec<Vector3<f64>>,
}

impl Host {
    pub fn new(poses: Poses, rig: &Rig, seed: u64) -> Self {
        Self {
            poses,
            noise: Noise(seed ^ 0x0070_7365),
            // The two cycles have nothing to do with each other.
            next_pose: (seed * 1_700) % poses.period_us,
            next_cycle: 0,
            underway: VecDeque::new(),
            newest: None,
            delays: Delays::default(),
            foretold: Foretold::default(),
            changes: 0,
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
            let jitter_us = self.poses.jitter_us * self.noise.normal();
            let arrives = now
                + self
                    .poses
                    .latency_us
                    .saturating_add_signed(jitter_us as i64);
            let last = self.underway.back().map_or(0, |pose| pose.0);
            let stamp_us = self.poses.stamp_us * self.noise.normal();
            let stamp = now as i64 + stamp_us as i64 + OTHER_CLOCK_US;
            let arrives = arrives.max(last);
            self.underway.push_back((arrives, stamp, tip.into()));
        }
        while let Some(pose) = self.underway.pop_front_if(|pose| pose.0 <= now) {
            self.delays
                .note(pose.0 as i64 * 1_000, (pose.0 as i64 - pose.1) * 1_000);
            self.newest = Some(pose);
        }
        if now < self.next_cycle {
            return;
        }
        self.next_cycle = now + CYCLE_US;
        // No more than the newest one in a cycle; its time as `Poll::tip_at_ns` has it.
        let least = self.delays.least_ns() / 1_000;
        let known = self.newest.and_then(|(came, stamp, tip)| {
            let at = (stamp + least).min(came as i64) as f64 * 1e-6;
            Some((tip, self.foretold.see(at, tip, now as f64 * 1e-6)?))
        });
        self.changes += u32::from(known.is_some() != rig.units[0].reel_um_per_s.is_some());
        for (unit, exit) in rig.units.iter_mut().zip(&self.exits) {
            unit.reel_um_per_s = known.map(|(tip, velocity)| {
                let direction = (exit - tip).normalize();
                (direction.dot(&velocity) * 1e6).round() as i32
            });
        }
    }
}

//! What a run reports while it goes on: its phase, and the trait of whoever watches it.

use crate::force::metrics::Step;
use crate::session::TimedSample;
use serde::Serialize;
use wire::message::UnitConfig;
use wire::UNITS;

/// What a run is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Connecting to the board.
    Connect,
    /// Waiting for the sensors.
    BringUp,
    /// Sending the configuration.
    Configure,
    /// Averaging zeros with slack cables.
    Zero,
    /// Calibrating the load cells with a known weight (emulated rig).
    Calibrate,
    /// Arming and tensioning the cables.
    Tension,
    /// The robot starts to move.
    StartRobot,
    /// Holding the force.
    Hold,
    /// Holding tensions.
    HoldTensions,
    /// Driving the cables without feedback, for an identification.
    Excite,
    /// Ramping down.
    Disarm,
}

impl Phase {
    /// One line for the user.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Connect => "booting and connecting",
            Self::BringUp => "bringing up and calibrating the sensors",
            Self::Configure => "sending the configuration",
            Self::Zero => "zeroing with slack cables",
            Self::Calibrate => "calibrating the load cells with a known weight",
            Self::Tension => "arming, tensioning the cables",
            Self::StartRobot => "robot starts to move",
            Self::Hold => "holding the force",
            Self::HoldTensions => "holding the tensions",
            Self::Excite => "exciting the cables with the loops open",
            Self::Disarm => "ramping down",
        }
    }
}

/// Watches a run. Every method does nothing unless overridden.
pub trait Observer {
    /// A phase began, or reached this fraction of its length (0 to 1).
    fn progress(&mut self, phase: Phase, fraction: f64) {
        let _ = (phase, fraction);
    }
    /// A message for the user.
    fn notice(&mut self, text: &str) {
        let _ = text;
    }
    /// The configuration is in force, zeros included.
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        let _ = configs;
    }
    /// Samples arrived.
    fn samples(&mut self, samples: &[TimedSample]) {
        let _ = samples;
    }
    /// A control cycle is over.
    fn step(&mut self, step: &Step) {
        let _ = step;
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoopObserver;

impl Observer for NoopObserver {}

//! What is asked of a run, and its times.

use emulator_link::Injection;
use known::zeros::ZeroStore;
use nalgebra::Vector3;
use std::sync::atomic::AtomicBool;
use std::sync::Arc;

/// How long the cables are tensioned before the robot moves, s.
pub(super) const PRETENSION_S: f64 = 1.0;
/// How long the robot moves before the force is commanded, s: longer than its soft start.
pub(super) const ROBOT_START_S: f64 = 1.5;
/// Longest run, s: a day.
pub(super) const MAX_HOLD_S: f64 = 86_400.0;

/// Shortest time for which a force is held, s: `--duration` of forcectl takes nothing shorter.
pub(super) const MIN_HOLD_S: f64 = 0.1;

/// What to do in a run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Commanded force at the tip, robot base frame, N.
    pub commanded_n: Vector3<f64>,
    /// For how long it is held, s.
    pub hold_s: f64,
    /// Whether the robot of an emulated rig moves meanwhile.
    pub robot_moves: bool,
    /// What is injected and when, in seconds after the force is commanded (negative: before; what
    /// lies before the start happens at power-on). Emulated rig only.
    pub injections: Vec<(f64, Injection)>,
    /// Where the zeros come from.
    pub zeroing: Zeroing,
    /// Whether a load hangs on the cables at the end as well. They don't let go under it at 0 V, so
    /// that the faults that this makes (15) are not the run's.
    pub loaded: bool,
    /// Set from outside to end the run early; the rig is then disarmed as at the end.
    pub stop: Arc<AtomicBool>,
}

impl Options {
    /// Holds a force, N, for some seconds while the robot moves.
    #[must_use]
    pub fn new(commanded_n: impl Into<Vector3<f64>>, hold_s: f64) -> Self {
        Self {
            commanded_n: commanded_n.into(),
            hold_s,
            robot_moves: true,
            injections: Vec::new(),
            zeroing: Zeroing::default(),
            loaded: false,
            stop: Arc::default(),
        }
    }
}

/// Where the zeros of a run come from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Zeroing {
    /// Measured now and used whatever they are: an emulated rig at power-on, where the cables are
    /// slack.
    #[default]
    Measure,
    /// Those that the board holds. Where it holds none (it was powered up since), they are measured
    /// and have to agree with the stored ones.
    Keep(ZeroStore),
    /// Measured now, because the user says that the cables are slack; refused where they disagree
    /// with the last ones.
    Ask(ZeroStore),
    /// Measured now, and the reference for later.
    Replace(ZeroStore),
}

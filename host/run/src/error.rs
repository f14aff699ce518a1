//! Why a run could not be done, as data: each cause says its text.

use crate::fault::RunFault;
use crate::options::{MAX_HOLD_S, MIN_HOLD_S};
use force::controller::ControlError;
use force::feasibility::ZeroOutOfReach;
use force::pose::PoseError;
use known::zeros::ZERO_TOLERANCE_N;
use known::StoreError;
use session::link::{LinkError, RigLink};
use session::{LatchedFault, SessionError};

/// Why a run could not be done. The rig was made safe as far as the link allowed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The commanded force or another argument is not usable; nothing was driven.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
    /// Session or link.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// No setpoints could be computed.
    #[error("stopped: {0}")]
    Control(#[from] ControlError),
    /// The robot's pose is not known.
    #[error("stopped: {0}")]
    Pose(#[from] PoseError),
    /// A fault of the board, or a state of the rig that nothing may be driven in.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// The rig file's cables cannot hold zero force; nothing was driven.
    #[error("{0}; nothing was driven")]
    Infeasible(#[from] Infeasible),
    /// Units dropped out and the others cannot hold zero force; the rig was ramped down.
    #[error(transparent)]
    UnitLost(#[from] UnitLost),
    /// What is known of the rig can't be read or kept.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Interrupted before the force was commanded.
    #[error("interrupted; the rig is disarmed")]
    Interrupted,
}

impl From<LinkError> for RunError {
    fn from(error: LinkError) -> Self {
        Self::Session(error.into())
    }
}

impl From<LatchedFault> for RunError {
    fn from(fault: LatchedFault) -> Self {
        Self::Fault(fault.into())
    }
}

impl RunError {
    /// The same, with who stopped the rig where that was it and the link knows.
    pub(super) fn with_who(self, link: &dyn RigLink) -> Self {
        match (self, link.stopped_by()) {
            (Self::Fault(Fault::Latched(fault)), Some(by))
                if fault.code == control::Fault::HostStop.code() =>
            {
                let by = by.to_owned();
                Fault::Stopped { by, fault }.into()
            }
            (other, _) => other,
        }
    }
}

/// An argument that is not usable.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArgumentError {
    /// The commanded force, by [`rig::Rig::check_force`].
    #[error("{0}")]
    Force(String),
    /// The time for which a force is to be held, s.
    #[error("a force can't be held for {0} s; give {MIN_HOLD_S} to {MAX_HOLD_S}")]
    Duration(f64),
    /// Injections into a real rig.
    #[error("nothing can be injected into a real rig; use --link embedded")]
    NotInjectable,
    /// A tension outside its unit's limits.
    #[error("unit {unit}: a tension of {tension_n} N is not within {min_n} to {max_n} N (`tension_min_n` and `tension_max_n` of the rig file); nothing was driven")]
    Tension {
        /// Unit from 1.
        unit: u8,
        /// Tension, N.
        tension_n: f64,
        /// Least of the rig file, N.
        min_n: f64,
        /// Largest of the rig file, N.
        max_n: f64,
    },
    /// Stored zeros are to be kept, and there are none.
    #[error("no zero is known for rig `{rig}`, unit {}: let all cables hang slack and run `forcectl zero`; a unit that does not come up gets none (`forcectl status`). Nothing was driven", list(.units))]
    NoZero {
        /// The rig's name.
        rig: String,
        /// Units from 1 that have none.
        units: Vec<u8>,
    },
    /// The length of an excitation, s.
    #[error(
        "a session of {seconds} s; give {min_s} to {max_s} (blocks of it are held out in turn)"
    )]
    Excitation {
        /// Asked for, s.
        seconds: f64,
        /// Shortest, s.
        min_s: f64,
        /// Longest, s.
        max_s: f64,
    },
    /// A unit's tensions leave no range for an excitation.
    #[error("unit {unit}: between tension_min_n = {min_n} and tension_max_n = {max_n} there is not enough range for an excitation; it needs {least_n} N at least")]
    Range {
        /// Unit from 1.
        unit: u8,
        /// Least of the rig file, N.
        min_n: f64,
        /// Largest of the rig file, N.
        max_n: f64,
        /// Range that is needed, N.
        least_n: f64,
    },
    /// A configuration that the control law refuses.
    #[error("the configuration in force is refused: {0:?}")]
    Config(control::config::OutOfRange),
}

/// A fault of the board, or a state of the rig in which nothing may be driven on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A fault was latched meanwhile.
    #[error("{0}")]
    Latched(#[from] LatchedFault),
    /// Somebody stopped the rig, and the link knows who.
    #[error("stopped by {by}: {fault}")]
    Stopped {
        /// Who.
        by: String,
        /// The fault that a stop latches.
        fault: LatchedFault,
    },
    /// A fault is latched from before.
    #[error("a fault is latched: {0}; then `forcectl clear`")]
    LatchedBefore(LatchedFault),
    /// The board is armed from before.
    #[error(
        "the board is armed already; `forcectl disarm` first (and end the program that armed it)"
    )]
    Armed,
    /// No unit came up.
    #[error("no force unit is ready; see `forcectl status`")]
    NoUnit,
    /// Zero force is out of reach at the tip's pose with the units that came up.
    #[error("zero force is out of reach with the units that are ready: the tip would be pulled with {residual_n:.2} N; nothing was armed")]
    ZeroOutOfReach {
        /// The least force at the tip, N.
        residual_n: f64,
    },
    /// Cables that did not come to their tensions: each in words.
    #[error("{within_s:.0} s after arming {} not at the tension asked for; the rig was set to 0 V. Look at the cable, its reel and the load cell (`forcectl status`)", cables.join(", "))]
    NotReached {
        /// How long was waited, s.
        within_s: f64,
        /// The cables.
        cables: Vec<String>,
    },
    /// The configuration read back is not the one that was sent: what differs.
    #[error("the board reads back another configuration than was sent ({}); nothing was armed; check the link and try again", .0.join(", "))]
    ConfigDiffers(Vec<String>),
    /// The board's configuration and what it reads back have different CRC-32.
    #[error("the board's configuration has CRC {board:08x}, what it reads back {read_back:08x}; nothing was armed; power-cycle the board and try again")]
    ConfigCrc {
        /// By the board's status.
        board: u32,
        /// Of what it reads back.
        read_back: u32,
    },
    /// The zeros that the board holds are far from the stored ones.
    #[error("the zeros that the board holds are not the stored ones: {}; let all cables hang slack and run `forcectl zero`; nothing was driven", list(.0))]
    ZerosNotStored(Vec<MovedZero>),
    /// Measured zeros are far from the last ones.
    #[error("the zeros are refused: {}; a slack cable moves by {ZERO_TOLERANCE_N} N at most, so these cables pull (or the sensor changed). Take the load off them and repeat; if they are slack, `forcectl zero --replace`. The board has its former zeros", list(.0))]
    ZerosRefused(Vec<MovedZero>),
    /// The tip left the workspace during an excitation.
    #[error("the tip is {off_m:.3} m from the workspace's centre, {radius_m} m are allowed (`radius_m` in [workspace])")]
    OutsideWorkspace {
        /// From the centre, m.
        off_m: f64,
        /// Allowed, m.
        radius_m: f64,
    },
    /// A cable stands too far off its load cell's axis during an excitation.
    #[error(
        "unit {unit}: the cable is too far off its load cell's axis; check pose, exit_m and axis"
    )]
    Angle {
        /// Unit from 1.
        unit: u8,
    },
    /// The force at the tip came above its limit during an excitation.
    #[error("the force at the tip reached {force_n:.1} N, {limit_n} N are allowed (`force_limit_n` in [controller])")]
    AboveLimit {
        /// Size of the force, N.
        force_n: f64,
        /// Allowed, N.
        limit_n: f64,
    },
}

/// A unit whose zero is far from a reference.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("unit {unit} moved by {moved_n:+.2} N")]
pub struct MovedZero {
    /// Unit from 1.
    pub unit: u8,
    /// By how much, N.
    pub moved_n: f64,
}

/// Why a rig may not be armed, by its rig file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Infeasible {
    /// Zero force is out of reach at some poses.
    #[error(transparent)]
    OutOfReach(ZeroOutOfReach),
    /// It can't be told.
    #[error(transparent)]
    Unknown(ControlError),
}

/// Units that dropped out, where the others cannot hold zero force.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "unit {} dropped out, and the cables that are left {}; the rig was ramped down and disarmed. {}",
    list(.units), left(.residual_n), faults.iter().map(|fault| fault.text.as_str()).collect::<Vec<_>>().join("; ")
)]
pub struct UnitLost {
    /// Units from 1.
    pub units: Vec<u8>,
    /// The least force with which the others would pull the tip, N, or why it can't be told.
    pub residual_n: Result<f64, ControlError>,
    /// Faults since arming.
    pub faults: Vec<RunFault>,
}

fn left(residual_n: &Result<f64, ControlError>) -> String {
    match residual_n {
        Ok(force_n) => format!("would pull the tip with {force_n:.2} N at least"),
        Err(error) => format!("are no help ({error})"),
    }
}

fn list(items: &[impl ToString]) -> String {
    let words: Vec<String> = items.iter().map(ToString::to_string).collect();
    words.join(", ")
}

//! One trial: prepare the board, tension the cables, let the robot move, follow the force profile,
//! ramp down.
//!
//! Whatever ends a trial, the motors end at zero and every row that was joined is in a file. Rows
//! go to the recording, which brings them to the disk twice a second, so that a program that is
//! killed loses no more; at the end they become one file.
//!

//! | question | file |
//! | --- | --- |
//! | its course | `drive` |
//! | what comes in a period | `receive` |
//! | which states become rows, and when they were | `rows`, `clocks` |

mod clocks;
mod drive;
mod receive;
mod rows;

use super::dataset::{Joiner, ROWS, TRUTH};
use super::error::ExperimentError;
use super::feed::Tamper;
use super::figures::Counts;
use super::file::Experiment;
use super::folder::AttemptFolder;
use super::plan::Trial;
use clocks::Clocks;
use emulator_link::Truth as PlantTruth;
use nalgebra::Vector3;
use recording::{Metadata, Recorder};
use rig::Rig;
use robot::arm::Truth as ArmTruth;
use robot::source::{Poll, SourceConfig, SourceError};
use robot::state::RobotState;
use rows::RowRate;
use run::{Fault, Observer, Phase, RunError, Zeroing};
use session::link::RigLink;
use session::Received;
use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::Arc;
use wire::message::UnitConfig;
use wire::UNITS;

/// Watches an experiment.
pub trait Watcher {
    /// A trial's phase, and the time in its force profile, s.
    fn progress(&mut self, trial: usize, phase: Phase, t_s: f64) {
        let _ = (trial, phase, t_s);
    }
    /// A message for the user.
    fn notice(&mut self, text: &str) {
        let _ = text;
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoopWatcher;

impl Watcher for NoopWatcher {}

/// How a trial ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// The whole profile was applied.
    Complete,
    /// Something ended it early.
    Stopped(String),
    /// Somebody stopped the rig from elsewhere: by whom.
    ByOther(String),
    /// The user ended it.
    Interrupted,
}

/// What a trial needs.
pub struct Setup<'a> {
    /// The experiment.
    pub experiment: &'a Experiment,
    /// The rig, with the units enabled that the experiment uses.
    pub rig: &'a Rig,
    /// The trial.
    pub trial: &'a Trial,
    /// Where its files go.
    pub folder: &'a AttemptFolder,
    /// Where the zeros come from.
    pub zeroing: &'a Zeroing,
    /// Set from outside to end it early.
    pub stop: Arc<AtomicBool>,
}

/// What a trial has shown.
#[derive(Debug)]
pub struct Shown {
    /// How it ended.
    pub ending: Ending,
    /// What was counted.
    pub counts: Counts,
    /// Figures that the board reported: firmware, CRC of the configuration.
    pub firmware: String,
    /// CRC-32 of the configurations in force.
    pub config_crc: u32,
    /// Whether the board was ramped down and said that its motors are at 0 V.
    pub disarmed: bool,
    /// What was not in order with the robot, with times.
    pub events: Vec<String>,
    /// Meaning of the joint efforts as the robot declares it.
    pub effort_meaning: Option<String>,
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// The robot's clock.
    pub robot_clock: Option<String>,
}

/// Runs a trial over a link.
///
/// # Errors
/// A file could not be written. All else is in [`Shown::ending`].
pub fn run_trial(
    link: &mut dyn RigLink,
    setup: &Setup<'_>,
    tamper: Option<Tamper>,
    watcher: &mut dyn Watcher,
) -> Result<Shown, ExperimentError> {
    // A robot outside moves in real time, and so does the rig then.
    let shared = matches!(setup.experiment.robot, SourceConfig::Virtual(_));
    let emulated = shared && link.controls().is_some();
    let mut metadata = Metadata::new(setup.rig, emulated)
        .with("link", link.name())
        .with("command", "experiment")
        .with("trial", setup.trial.number)
        .with_columns(&[ROWS, TRUTH]);
    if !(emulated && link.booted_here()) {
        metadata = metadata.never_waits();
    }
    if !setup.experiment.record_samples {
        metadata = metadata.without_samples();
    }
    let recorder = Some(Recorder::create(&setup.folder.recording(), &metadata)?);
    let mut run = Run {
        setup,
        log: Log {
            trial: setup.trial.number,
            recorder,
            clocks: Clocks::new(shared),
            watcher,
        },
        shown: Shown {
            ending: Ending::Complete,
            counts: Counts::new(setup.experiment, setup.rig.units.map(|unit| unit.enabled)),
            firmware: String::new(),
            config_crc: 0,
            disarmed: false,
            events: Vec::new(),
            effort_meaning: None,
            joint_names: Vec::new(),
            robot_clock: None,
        },
        joiner: None,
        file_error: None,
        recorded: 0,
        newest: None,
        rate: RowRate::new(setup.experiment.rate_hz),
        plant: VecDeque::new(),
        arm: VecDeque::new(),
        now_board_s: 0.0,
        saturated: false,
        asked: false,
        commanded_since_ns: None,
    };
    match run.drive(link, tamper) {
        Ok(()) => {}
        Err(End::Interrupted) => run.shown.ending = Ending::Interrupted,
        Err(End::ByOther(who)) => run.shown.ending = Ending::ByOther(who),
        Err(End::Stopped(why)) => run.shown.ending = Ending::Stopped(why),
    }
    run.finish()
}

/// Why the loop ended early.
enum End {
    Interrupted,
    ByOther(String),
    Stopped(String),
}

impl<E: Into<RunError>> From<E> for End {
    fn from(error: E) -> Self {
        match error.into() {
            RunError::Interrupted => Self::Interrupted,
            RunError::Fault(fault) if ends_all(&fault) => Self::ByOther(fault.to_string()),
            error => Self::Stopped(error.to_string()),
        }
    }
}

/// Whether a fault ends more than its attempt: a person's stop, by a command or the E-stop, and a
/// fault from before, which the next attempts would meet as well, for none of them clears it.
fn ends_all(fault: &Fault) -> bool {
    let stops = [control::Fault::HostStop, control::Fault::EStop].map(control::Fault::code);
    match fault {
        Fault::Stopped { .. } | Fault::LatchedBefore(_) => true,
        Fault::Latched(fault) => stops.contains(&fault.code),
        _ => false,
    }
}

fn robot_gone(error: &SourceError) -> End {
    End::Stopped(error.to_string())
}

/// Passes on what preparation reports, and records samples.
struct Log<'a> {
    trial: usize,
    recorder: Option<Recorder>,
    clocks: Clocks,
    watcher: &'a mut dyn Watcher,
}

impl Observer for Log<'_> {
    fn progress(&mut self, phase: Phase, _: f64) {
        if let Some(recorder) = &mut self.recorder {
            recorder.phase(phase);
        }
        self.watcher.progress(self.trial, phase, 0.0);
    }
    fn notice(&mut self, text: &str) {
        if let Some(recorder) = &mut self.recorder {
            recorder.notice(text);
        }
        self.watcher.notice(text);
    }
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        if let Some(recorder) = &mut self.recorder {
            recorder.configured(configs);
        }
    }
    fn received(&mut self, received: &Received) {
        self.clocks.board(&received.readings);
        if let Some(recorder) = &mut self.recorder {
            recorder.received(received);
            if let Some(text) = recorder.trouble() {
                self.watcher.notice(&text);
            }
        }
    }
}

struct Run<'a> {
    setup: &'a Setup<'a>,
    log: Log<'a>,
    shown: Shown,
    joiner: Option<Joiner>,
    file_error: Option<ExperimentError>,
    /// Rows that the recorder has.
    recorded: usize,
    /// The newest usable tip, rig frame, m, and when its state came, ns.
    newest: Option<(Vector3<f64>, Option<i64>)>,
    /// Which states become rows.
    rate: RowRate,
    plant: VecDeque<PlantTruth>,
    arm: VecDeque<ArmTruth>,
    now_board_s: f64,
    saturated: bool,
    /// Whether the robot's side has asked for a force.
    asked: bool,
    /// Link time of the profile's start.
    commanded_since_ns: Option<u64>,
}

/// The tip, and when it was there, ns, where that is known.
fn tip_of(poll: &Poll, state: &RobotState) -> Option<(Vector3<f64>, Option<i64>)> {
    (state.tip.as_ref()).map(|tip| (tip.position_m.into(), poll.tip_at_ns(state)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use session::LatchedFault;

    /// A person's stop ends more than the trial, whenever it is noticed, and so does a fault that
    /// no attempt clears.
    #[test]
    fn a_stop_is_told_from_other_faults() {
        let of = |code: control::Fault| LatchedFault::new(code.code(), 0);
        let by_other = |error: RunError| matches!(End::from(error), End::ByOther(_));
        let stop = of(control::Fault::HostStop);
        assert!(by_other(stop.into()));
        assert!(by_other(Fault::LatchedBefore(stop).into()));
        assert!(by_other(of(control::Fault::EStop).into()));
        let by = "a terminal".to_owned();
        assert!(by_other(Fault::Stopped { by, fault: stop }.into()));
        let expired = of(control::Fault::SetpointsExpired);
        assert!(by_other(Fault::LatchedBefore(expired).into()));
        assert!(!by_other(expired.into()));
        assert!(!by_other(Fault::Armed.into()));
    }
}

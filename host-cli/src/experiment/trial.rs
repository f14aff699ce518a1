//! One trial: prepare the board, tension the cables, let the robot move, follow the force profile, ramp down.
//!
//! Whatever ends a trial, the motors end at zero and every row that was joined is in a file. Rows go out in parts every ten
//! seconds, so that a program that is killed loses no more; at the end they become one file.

mod rows;

use super::dataset::Joiner;
use super::feed::{Feed, Tamper};
use super::figures::Counts;
use super::file::Experiment;
use super::folder::AttemptFolder;
use super::plan::Trial;
use super::pull::Puller;
use super::sync::LeastDelay;
use super::ExperimentError;
use crate::force::controller::{ControlError, Input};
use crate::force::metrics::Step;
use crate::link::RigLink;
use crate::recording::{Metadata, Recorder};
use crate::rigfile::RigFile;
use crate::run::{ramp_down_and_disarm, ready_board, Observer, Phase, Prepared, RunError, Zeroing};
use crate::session::{Received, Session, PERIOD};
use emulator_link::Truth as PlantTruth;
use nalgebra::Vector3;
use robot::arm::Truth as ArmTruth;
use robot::source::{SourceConfig, SourceError};
use robot::state::RobotState;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use wire::message::UnitConfig;
use wire::{Command, UNITS};

/// How long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.5;
/// How long the robot moves before the force profile begins, s.
const ROBOT_START_S: f64 = 1.5;
/// How long the first state of the robot may take, s.
const FIRST_STATE_S: f64 = 5.0;

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
    /// The user ended it.
    Interrupted,
}

/// What a trial needs.
pub struct Setup<'a> {
    /// The experiment.
    pub experiment: &'a Experiment,
    /// The rig, with the units enabled that the experiment uses.
    pub rig: &'a RigFile,
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
    let mut run = Run {
        setup,
        log: Log {
            trial: setup.trial.number,
            recorder: None,
            watcher,
        },
        shown: Shown {
            ending: Ending::Complete,
            counts: Counts::new(setup),
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
        written: 0,
        parts: 0,
        newest: None,
        last_bucket: None,
        robot_clock: LeastDelay::default(),
        board_clock: LeastDelay::default(),
        plant: VecDeque::new(),
        arm: VecDeque::new(),
        now_board_s: 0.0,
        saturated: false,
        commanded_since_ns: None,
    };
    if setup.experiment.record_samples {
        let metadata = Metadata::new(setup.rig, link.controls().is_some())
            .with("link", link.name())
            .with("command", "experiment")
            .with("trial", setup.trial.number);
        let own = link.booted_here();
        let metadata = if own {
            metadata
        } else {
            metadata.never_waits()
        };
        let recorder = Recorder::create(&setup.folder.recording(), &metadata)?;
        run.log.recorder = Some(recorder);
    }
    match run.drive(link, tamper) {
        Ok(()) => {}
        Err(End::Interrupted) => run.shown.ending = Ending::Interrupted,
        Err(End::Stopped(why)) => run.shown.ending = Ending::Stopped(why),
    }
    run.finish()
}

/// Why the loop ended early.
enum End {
    Interrupted,
    Stopped(String),
}

impl<E: Into<RunError>> From<E> for End {
    fn from(error: E) -> Self {
        match error.into() {
            RunError::Interrupted => Self::Interrupted,
            error => Self::Stopped(error.to_string()),
        }
    }
}

fn robot_gone(error: &SourceError) -> End {
    End::Stopped(error.to_string())
}

/// Passes on what preparation reports, and records samples.
struct Log<'a> {
    trial: usize,
    recorder: Option<Recorder>,
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
    /// Rows that are in parts already.
    written: usize,
    parts: usize,
    /// The newest usable tip, rig frame, m.
    newest: Option<Vector3<f64>>,
    /// Number of the row period of the last state that became a row.
    last_bucket: Option<i64>,
    robot_clock: LeastDelay,
    board_clock: LeastDelay,
    plant: VecDeque<PlantTruth>,
    arm: VecDeque<ArmTruth>,
    now_board_s: f64,
    saturated: bool,
    /// Link time of the profile's start.
    commanded_since_ns: Option<u64>,
}

impl Run<'_> {
    fn drive(&mut self, link: &mut dyn RigLink, tamper: Option<Tamper>) -> Result<(), End> {
        let robot = &self.setup.experiment.robot;
        let trajectory = self.setup.trial.trajectory.as_ref();
        // Before anything is driven: a source that can't be opened must not leave cables under tension.
        let mut feed =
            Feed::open(robot, link, trajectory, tamper).map_err(|error| robot_gone(&error))?;
        self.log.progress(Phase::Connect, 0.0);
        let mut session = Session::connect(link)?;
        self.shown.firmware = session
            .info()
            .map_or_else(String::new, |info| info.version.as_str().to_owned());
        let setup = self.setup;
        let prepared = ready_board(
            &mut session,
            setup.rig,
            setup.zeroing,
            &setup.stop,
            &mut self.log,
        )?;
        self.shown.config_crc = prepared.config_crc;
        for (unit, settings) in setup.rig.units.iter().enumerate() {
            if settings.enabled && !prepared.available[unit] {
                return Err(End::Stopped(format!(
                    "unit {} is not ready; see the notices and `forcectl status`",
                    settings.number
                )));
            }
        }
        self.wait_for_robot(&mut session, &mut feed)?;
        let ended = self.hold(&mut session, &mut feed, &prepared);
        self.log.progress(Phase::Disarm, 0.0);
        self.shown.disarmed = ramp_down_and_disarm(&mut session).is_ok();
        if !self.shown.disarmed {
            session.make_safe();
        }
        // Samples that were on their way belong to the last rows.
        let received = session.drain();
        self.take(&received);
        if let Some(joiner) = &mut self.joiner {
            joiner.join(self.now_board_s, true);
        }
        self.shown.counts.link(session.counters());
        ended
    }

    /// Waits for a usable state before anything is armed. What came during the preparation is old.
    fn wait_for_robot(&mut self, session: &mut Session<'_>, feed: &mut Feed) -> Result<(), End> {
        let began_ns = session.now_ns();
        let _ = feed.poll(session.link(), began_ns);
        loop {
            session.advance(PERIOD)?;
            let now_ns = session.now_ns();
            let fresh = feed
                .poll(session.link(), now_ns)
                .map_err(|error| robot_gone(&error))?;
            let received = session.drain();
            self.log.received(&received);
            self.newest = fresh.poll.states.iter().rev().find_map(tip_of);
            if self.newest.is_some() {
                return Ok(());
            }
            let waited_s = (now_ns - began_ns) as f64 * 1e-9;
            if waited_s > FIRST_STATE_S {
                let why =
                    (fresh.poll.events.first()).map_or_else(String::new, |e| format!(": {e}"));
                return Err(End::Stopped(format!(
                    "no usable state of the robot within {FIRST_STATE_S} s from {}{why}; nothing was armed",
                    feed.name()
                )));
            }
            if self.setup.stop.load(Ordering::Relaxed) {
                return Err(End::Interrupted);
            }
        }
    }

    /// Arms and follows the profile.
    fn hold(
        &mut self,
        session: &mut Session<'_>,
        feed: &mut Feed,
        prepared: &Prepared,
    ) -> Result<(), End> {
        let setup = self.setup;
        let mut puller = Puller::new(setup.rig, &setup.experiment.force)?;
        session.command(&Command::Arm)?;
        let lead_s = PRETENSION_S + ROBOT_START_S;
        let start_ns = session.now_ns() + (lead_s * 1e9) as u64;
        self.commanded_since_ns = Some(start_ns);
        let mut moving = false;
        loop {
            let t_s = (session.now_ns() as f64 - start_ns as f64) * 1e-9;
            if t_s >= setup.experiment.trial_s() {
                return Ok(());
            }
            if setup.stop.load(Ordering::Relaxed) {
                return Err(End::Interrupted);
            }
            if !moving && t_s >= -ROBOT_START_S {
                moving = true;
                self.move_robot(session)?;
            }
            if self.joiner.is_none() && t_s >= 0.0 {
                self.begin_rows(prepared, start_ns);
            }
            self.cycle(session, &mut puller, prepared, t_s)?;
            self.receive(session, feed, t_s)?;
            if let Some(error) = &self.file_error {
                return Err(End::Stopped(error.to_string()));
            }
            let phase = if t_s < -ROBOT_START_S {
                Phase::Tension
            } else if t_s < 0.0 {
                Phase::StartRobot
            } else {
                Phase::Hold
            };
            if let Some(recorder) = &mut self.log.recorder {
                recorder.phase(phase);
            }
            self.log
                .watcher
                .progress(self.log.trial, phase, t_s.max(0.0));
        }
    }

    fn move_robot(&self, session: &mut Session<'_>) -> Result<(), End> {
        if matches!(self.setup.experiment.robot, SourceConfig::Virtual(_)) {
            if let Some(controls) = session.link().controls() {
                controls.robot(true)?;
            }
        }
        Ok(())
    }

    fn begin_rows(&mut self, prepared: &Prepared, start_ns: u64) {
        let start_s = self.board_time_s(start_ns as f64 * 1e-9);
        let setup = self.setup;
        self.joiner = Some(Joiner::new(
            setup.rig,
            &prepared.configs,
            start_s,
            setup.trial.number,
            setup.folder.attempt,
        ));
    }

    /// Link time as board time, s. In one virtual clock both are the same.
    fn board_time_s(&self, link_s: f64) -> f64 {
        if session_is_virtual(self.setup.experiment) {
            return link_s;
        }
        self.board_clock
            .offset_s()
            .map_or(link_s, |(offset_s, _)| link_s - offset_s)
    }

    /// Computes and sends setpoints, and lets a period pass.
    fn cycle(
        &mut self,
        session: &mut Session<'_>,
        puller: &mut Puller,
        prepared: &Prepared,
        t_s: f64,
    ) -> Result<(), End> {
        let tip_m = self
            .newest
            .ok_or_else(|| End::Stopped("the robot's tip is not known".to_owned()))?;
        let input = Input {
            dt_s: PERIOD.as_secs_f64(),
            tip_m,
            tension_n: session.recent_tension_n(),
            available: prepared.available,
            commanded_n: if t_s >= 0.0 {
                self.setup.trial.profile.at(t_s)
            } else {
                Vector3::zeros()
            },
        };
        let pulled = puller.step(&input).map_err(|error: ControlError| {
            End::Stopped(format!("no setpoints at {t_s:.2} s: {error}"))
        })?;
        session.set_setpoints(Some(pulled.setpoints));
        session.advance(PERIOD)?;
        let measured = input.tension_n.map(|tension| tension.unwrap_or(f64::NAN));
        if t_s >= 0.0 {
            self.shown.counts.cycle(&measured, &pulled.tension_n, t_s);
        }
        let step = Step {
            t_s,
            tip_m,
            commanded_n: input.commanded_n,
            estimated_n: pulled.applied_n,
            applied_n: None,
            tension_setpoint_n: pulled.tension_n,
            measured_tension_n: measured.map(|t| if t.is_nan() { 0.0 } else { t }),
            true_tension_n: None,
            available: prepared.available,
        };
        if let Some(recorder) = &mut self.log.recorder {
            recorder.cycle_at(&step, session.now_ns());
        }
        Ok(())
    }

    /// Takes what came in a period.
    fn receive(&mut self, session: &mut Session<'_>, feed: &mut Feed, t_s: f64) -> Result<(), End> {
        let now_ns = session.now_ns();
        let fresh = feed
            .poll(session.link(), now_ns)
            .map_err(|error| robot_gone(&error))?;
        let received = session.drain();
        if let Some(newest) = received.samples.last() {
            self.board_clock
                .note(newest.t_us as f64 * 1e-6, now_ns as f64 * 1e-9);
        }
        self.take(&received);
        self.arm.extend(fresh.truth);
        for event in &fresh.poll.events {
            self.shown.events.push(format!("{t_s:.3} s: {event}"));
            self.shown.counts.robot_events += 1;
        }
        // What came together with such an event is in doubt.
        let stop = fresh.poll.stop();
        for state in fresh.poll.states.iter().filter(|_| stop.is_none()) {
            self.newest = tip_of(state).or(self.newest);
            self.row(state, feed, now_ns);
        }
        self.log.received(&received);
        if let Some(joiner) = &mut self.joiner {
            joiner.join(self.now_board_s, false);
        }
        self.write_part();
        if let Some(event) = stop {
            return Err(End::Stopped(format!(
                "at {t_s:.2} s: {event}; the cables were ramped down and the rig disarmed"
            )));
        }
        match session.fault_in(&received) {
            Some(fault) => Err(End::Stopped(fault)),
            None => Ok(()),
        }
    }

    /// Samples into the joiner, the plant's truth into its queue.
    fn take(&mut self, received: &Received) {
        if let Some(joiner) = &mut self.joiner {
            joiner.samples(&received.samples);
            self.shown.counts.samples(&received.samples);
        }
        self.saturated = received
            .samples
            .iter()
            .any(|timed| timed.sample.flags & wire::message::flags::LIMITED != 0);
        if let Some(newest) = received.samples.iter().map(|timed| timed.t_us).max() {
            self.now_board_s = self.now_board_s.max(newest as f64 * 1e-6);
        }
        self.plant.extend(received.truth.iter().cloned());
        while self.plant.len() > 2000 {
            self.plant.pop_front();
        }
        while self.arm.len() > 2000 {
            self.arm.pop_front();
        }
    }
}

/// Whether robot and board run on one virtual clock.
const fn session_is_virtual(experiment: &Experiment) -> bool {
    matches!(experiment.robot, SourceConfig::Virtual(_))
}

fn tip_of(state: &RobotState) -> Option<Vector3<f64>> {
    state.tip.as_ref().map(|tip| tip.position_m.into())
}

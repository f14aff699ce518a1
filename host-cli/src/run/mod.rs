//! A whole run: bring the rig up, hold a force while the robot moves, put it down again.
//!
//! [`set_force`] is what the command `forcectl set-force` calls, and the bench and the scenarios as well: no
//! terminal, no files, one link. Whatever goes wrong, it leaves the rig disarmed as far as the link allows; the
//! board's own expiry of setpoints does the rest.

use crate::force::controller::{ControlError, Controller, Input, Output, Reach};
use crate::force::metrics::{self, Metrics, Step};
use crate::force::pose::{PoseError, PoseSource};
use crate::force::vec3::Vec3;
use crate::link::{LinkError, RigLink};
use crate::rigfile::{board_crc, RigFile};
use crate::session::{
    explain_fault, explain_kept, LinkCounters, Received, Session, SessionError, TimedSample, PERIOD,
};
use control::{MotorState, SystemState};
use emulator_link::{Injection, Report, Truth};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;
use wire::message::{FaultReport, Status, UnitConfig};
use wire::{Command, UNITS};

/// How long sensors may take to come up: three calibrations of 344 ms each, six units on one bus, and retries.
const BRING_UP_WITHIN: Duration = Duration::from_secs(15);
/// How long zeroing may take: 256 samples at 310 SPS are 0.83 s.
const ZERO_WITHIN: Duration = Duration::from_secs(5);
/// How long arming and disarming may take.
const SWITCH_WITHIN: Duration = Duration::from_secs(3);
/// How long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.0;
/// How long the robot moves before the force is wanted, s: longer than its soft start.
const WANDER_S: f64 = 1.5;
/// Measurements older than this are none, in microseconds: a few sample periods.
const FRESH_US: u64 = 30_000;

/// What to do in a run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Force wanted at the tip, robot base frame, N.
    pub force_n: Vec3,
    /// For how long it is held, s.
    pub hold_s: f64,
    /// Whether the robot of an emulated rig wanders meanwhile.
    pub robot_moves: bool,
    /// What is broken and when, in seconds after the force is wanted (negative: before; what lies before the start
    /// happens at power-on). Emulated rig only.
    pub injections: Vec<(f64, Injection)>,
    /// Set from outside to end the run early, in order.
    pub stop: Arc<AtomicBool>,
}

impl Options {
    /// Holds a force for some seconds while the robot moves.
    #[must_use]
    pub fn new(force_n: Vec3, hold_s: f64) -> Self {
        Self {
            force_n,
            hold_s,
            robot_moves: true,
            injections: Vec::new(),
            stop: Arc::default(),
        }
    }
}

/// What a run is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Looking for the board.
    Connect,
    /// Waiting for the sensors.
    BringUp,
    /// Sending the configuration.
    Configure,
    /// Averaging zeros with slack cables.
    Zero,
    /// Weighing known weights (emulated rig).
    Calibrate,
    /// Arming and tensioning the cables.
    Tension,
    /// The robot begins to move.
    Wander,
    /// Holding the force.
    Hold,
    /// Driving the cables without feedback, for an identification.
    Excite,
    /// Ramping down.
    Disarm,
}

impl Phase {
    /// What a person reads.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Connect => "booting and connecting",
            Self::BringUp => "bringing up and calibrating the sensors",
            Self::Configure => "sending the configuration",
            Self::Zero => "zeroing with slack cables",
            Self::Calibrate => "calibrating the load cells with a known weight",
            Self::Tension => "arming, tensioning the cables",
            Self::Wander => "robot starts to move",
            Self::Hold => "holding the force",
            Self::Excite => "driving the cables to and fro, loops open",
            Self::Disarm => "ramping down",
        }
    }
}

/// Watches a run. Every method does nothing unless overridden.
pub trait Observer {
    /// A phase began, or went on to this fraction of it (0 to 1).
    fn progress(&mut self, phase: Phase, fraction: f64) {
        let _ = (phase, fraction);
    }
    /// Something a person should know now.
    fn notice(&mut self, text: &str) {
        let _ = text;
    }
    /// The configuration is in force, zeros included.
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        let _ = configs;
    }
    /// Samples came in.
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

/// A fault that was latched during a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunFault {
    /// Time since the force was wanted, s.
    pub t_s: f64,
    /// Unit from 1; `None`: the whole board.
    pub unit: Option<u8>,
    /// Number.
    pub code: u16,
    /// What it means and how to leave it.
    pub text: String,
}

/// Latency from the DRDY edge to the DAC, of samples while holding, ms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LatencyMs {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Measured from outside of the firmware (embedded rig), or by the firmware itself.
    pub measured_outside: bool,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// As asked.
    Done,
    /// As asked, but a unit dropped out or the force was out of reach.
    Degraded,
    /// Ended early from outside.
    Interrupted,
}

/// What came of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// How it ended.
    pub ended: Ended,
    /// The link's name.
    pub link: String,
    /// Firmware version.
    pub firmware: String,
    /// Hash of the rig file.
    pub rig_hash: String,
    /// CRC-32 of the configuration that was in force on the board, zeros included.
    pub config_crc: u32,
    /// Figures; `None` where the run was too short.
    pub metrics: Option<Metrics>,
    /// How the wanted force stood to what the cables could do, at the worst.
    pub reach: Option<Reach>,
    /// Faults, in order.
    pub faults: Vec<RunFault>,
    /// DRDY edge to DAC.
    pub latency_ms: Option<LatencyMs>,
    /// Conversions that nobody read in time during the run.
    pub samples_lost: u64,
    /// Samples that came in by telemetry since arming.
    pub samples: u64,
    /// Counters of the link.
    pub link_counters: LinkCounters,
    /// For how long the amplifiers were without power while the rig was armed, s (embedded rig).
    pub amplifiers_off_s: f64,
    /// Every cycle.
    #[serde(skip)]
    pub steps: Vec<Step>,
    /// Figures from outside of the firmware (embedded rig).
    #[serde(skip)]
    pub report: Option<Report>,
    /// The configuration that was in force, zeros included.
    #[serde(skip)]
    pub configs: [UnitConfig; UNITS],
}

/// Why a run could not be done. The rig was made safe as far as the link allowed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The wanted force or another argument is not usable; nothing was driven.
    #[error("{0}")]
    Argument(String),
    /// Conversation or link.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// No setpoints could be computed.
    #[error("stopped: {0}")]
    Control(#[from] ControlError),
    /// The robot's pose is not known.
    #[error("stopped: {0}")]
    Pose(#[from] PoseError),
    /// A fault of the board.
    #[error("{0}")]
    Fault(String),
    /// Interrupted before the force was wanted.
    #[error("interrupted; the rig is disarmed")]
    Interrupted,
}

impl From<LinkError> for RunError {
    fn from(error: LinkError) -> Self {
        Self::Session(error.into())
    }
}

/// Holds a force at the tip and tells what came of it.
///
/// # Errors
/// [`RunError`]; the rig was made safe as far as the link allowed.
pub fn set_force(
    link: &mut dyn RigLink,
    rig: &RigFile,
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Outcome, RunError> {
    rig.check_force(options.force_n)
        .map_err(RunError::Argument)?;
    if !(options.hold_s.is_finite() && options.hold_s > 0.0 && options.hold_s <= 86_400.0) {
        return Err(RunError::Argument(format!(
            "a force can't be held for {} s; give 0.1 to 86400",
            options.hold_s
        )));
    }
    if !options.injections.is_empty() && link.controls().is_none() {
        return Err(RunError::Argument(
            "nothing can be injected into a real rig; use --link embedded".to_owned(),
        ));
    }
    let mut pose = PoseSource::open(&rig.pose)?;
    let mut injections = options.injections.clone();
    injections.sort_by(|a, b| a.0.total_cmp(&b.0));
    let early = injections.partition_point(|(t_s, _)| *t_s < -(PRETENSION_S + WANDER_S));
    if let Some(controls) = link.controls() {
        for (_, injection) in injections.drain(..early) {
            controls.inject(injection)?;
        }
    }
    observer.progress(Phase::Connect, 0.0);
    let mut session = Session::connect(link)?;
    if let Some(kept) = session.info().and_then(|info| info.kept.as_ref()) {
        observer.notice(&format!(
            "the board's run before this one ended with {}",
            explain_kept(kept)
        ));
    }
    let prepared = prepare_board(&mut session, rig, &options.stop, observer)?;
    let mut run = Run {
        rig,
        options,
        observer,
        pose: &mut pose,
        controller: Controller::new(rig).map_err(ControlError::from)?,
        injections,
        available: prepared.available,
        steps: Vec::new(),
        faults: prepared.faults.clone(),
        reach: None,
        samples: 0,
        amplifiers_off: 0,
        latencies_us: Vec::new(),
        t0_ns: None,
        last: None,
    };
    let held = run.hold(&mut session);
    // Whatever happened: down in order, or as far as it goes.
    let interrupted = match held {
        Ok(interrupted) => interrupted,
        Err(error) => {
            session.make_safe();
            return Err(error);
        }
    };
    run.observer.progress(Phase::Disarm, 0.0);
    if let Err(error) = ramp_down_and_disarm(&mut session) {
        session.make_safe();
        return Err(error.into());
    }
    let status = session.get_status()?;
    let received = session.drain();
    run.observer.samples(&received.samples);
    run.samples += received.samples.len() as u64;
    Ok(run.outcome(&mut session, &prepared, &status, interrupted)?)
}

/// Weight that an emulated rig's load cells are calibrated with, N: about 500 g, the middle of the thesis's weights.
const WEIGHT_N: f64 = 5.0;
/// Until the converter's filter has forgotten what was before.
const WEIGHT_SETTLES: Duration = Duration::from_millis(200);
/// For how long a weight is weighed: 160 samples take 3 mN of noise to 0.3 mN, 0.06 per mille of the weight.
const WEIGHED_FOR: Duration = Duration::from_millis(500);
/// A scale further from the rig file's than this is a mistake and no calibration.
const SCALE_WITHIN: f64 = 0.25;

/// Calibrates the load cells of an emulated rig with a known weight on each, as the thesis does by hand (3.5.1)
/// before the units are mounted: every seed is another rig, whose cells differ by some percent, and no rig file
/// can know them. On a real rig the rig file holds the calibration, and nothing is done here.
fn calibrate(
    session: &mut Session<'_>,
    configs: &mut [UnitConfig; UNITS],
    observer: &mut dyn Observer,
) -> Result<(), RunError> {
    if session.link().controls().is_none() {
        return Ok(());
    }
    observer.progress(Phase::Calibrate, 0.0);
    hang_weights(session, WEIGHT_N)?;
    session.advance(WEIGHT_SETTLES)?;
    observer.samples(&session.drain().samples);
    session.advance(WEIGHED_FOR)?;
    let received = session.drain();
    observer.samples(&received.samples);
    hang_weights(session, 0.0)?;
    session.advance(WEIGHT_SETTLES)?;
    observer.samples(&session.drain().samples);
    for (i, config) in configs
        .iter_mut()
        .enumerate()
        .filter(|(_, config)| config.enabled)
    {
        let codes: Vec<f64> = (received.samples.iter())
            .filter(|timed| usize::from(timed.sample.unit) == i)
            .map(|timed| f64::from(timed.sample.code))
            .collect();
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        let scale = WEIGHT_N / (mean - f64::from(config.zero_code)) * 1e12;
        let before = f64::from(config.scale_pn_per_count);
        // NaN and infinity (no samples, no change) are not within.
        if (scale / before - 1.0).abs() <= SCALE_WITHIN {
            config.scale_pn_per_count = scale.round() as i32;
        } else {
            observer.notice(&format!(
                "unit {}: the known weight gives {:.3e} N a count, the rig file says {:.3e}; the rig file's is kept",
                i + 1,
                scale * 1e-12,
                before * 1e-12
            ));
        }
    }
    session.configure(configs)?;
    observer.progress(Phase::Calibrate, 1.0);
    Ok(())
}

/// Hangs a weight on every load cell, N; 0 takes it off.
fn hang_weights(session: &mut Session<'_>, weight_n: f64) -> Result<(), LinkError> {
    if let Some(controls) = session.link().controls() {
        for unit in 1..=UNITS as u8 {
            controls.inject(Injection::PullCable(unit, weight_n))?;
        }
    }
    Ok(())
}

/// Ramps down and waits until the motors are at 0 V.
pub(crate) fn ramp_down_and_disarm(session: &mut Session<'_>) -> Result<(), SessionError> {
    session.command(&Command::Disarm)?;
    session.set_setpoints(None);
    session.wait_for(SWITCH_WITHIN, "disarming", |status| {
        SystemState::from_u8(status.state).is_some_and(|state| !state.drives())
    })?;
    if let Some(controls) = session.link().controls() {
        controls.robot(false)?;
    }
    Ok(())
}

/// A board that is configured, zeroed and disarmed.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The configurations in force, zeros included.
    pub configs: [UnitConfig; UNITS],
    /// CRC-32 of them, as the board reports it.
    pub config_crc: u32,
    /// Units that take part.
    pub available: [bool; UNITS],
    /// Faults of the units that don't.
    pub faults: Vec<RunFault>,
    missed_before: [u32; UNITS],
    lost_before: u64,
}

fn check_stop(stop: &AtomicBool) -> Result<(), RunError> {
    if stop.load(Ordering::Relaxed) {
        Err(RunError::Interrupted)
    } else {
        Ok(())
    }
}

fn unit_fault(t_s: f64, unit: usize, code: u16, detail: u32) -> RunFault {
    RunFault {
        t_s,
        unit: Some(unit as u8 + 1),
        code,
        text: explain_fault(code, detail),
    }
}

/// Takes a connected board to one that is configured, zeroed and disarmed. Units that fail on the way are
/// switched off and reported.
///
/// # Errors
/// [`RunError`]; nothing was armed.
pub fn prepare_board(
    session: &mut Session<'_>,
    rig: &RigFile,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let status = session.get_status()?;
    if SystemState::from_u8(status.state).is_some_and(SystemState::drives) {
        return Err(RunError::Fault(
            "the board is armed already; `forcectl disarm` first (and end the program that armed it)".to_owned(),
        ));
    }
    if status.fault != 0 {
        return Err(RunError::Fault(format!(
            "a fault is latched: {}; then `forcectl clear`",
            explain_fault(status.fault, status.fault_detail)
        )));
    }
    session.command(&Command::Stream { every: 1 })?;
    observer.progress(Phase::Configure, 0.0);
    let mut configs = rig.units.map(|unit| unit.to_wire());
    session.configure(&configs)?;
    check_stop(stop)?;

    observer.progress(Phase::BringUp, 0.0);
    let status = wait_ready(session, BRING_UP_WITHIN, Phase::BringUp, stop, observer)?;
    let mut faults = leave_out_faulted(session, &mut configs, &status, observer)?;

    observer.progress(Phase::Zero, 0.0);
    let mask = (0..UNITS)
        .filter(|i| configs[*i].enabled)
        .fold(0, |mask, i| mask | 1 << i);
    session.command(&Command::Zero { units: mask })?;
    let status = wait_ready(session, ZERO_WITHIN, Phase::Zero, stop, observer)?;
    let in_force = session.get_configs()?;
    let mut with_zeros = configs;
    for i in 0..UNITS {
        with_zeros[i].zero_code = in_force[i].zero_code;
    }
    faults.extend(leave_out_faulted(
        session,
        &mut with_zeros,
        &status,
        observer,
    )?);
    calibrate(session, &mut with_zeros, observer)?;
    let in_force = session.get_configs()?;
    if in_force != with_zeros {
        return Err(RunError::Fault(format!(
            "the board reads back another configuration than was sent ({}); nothing was armed; check the link and try again",
            differences(&with_zeros, &in_force).join(", ")
        )));
    }
    let status = session.get_status()?;
    let config_crc = board_crc(&in_force);
    if status.config_crc != config_crc {
        return Err(RunError::Fault(format!(
            "the board's configuration has CRC {:08x}, what it reads back {config_crc:08x}; nothing was armed; power-cycle the board and try again",
            status.config_crc
        )));
    }
    observer.configured(&in_force);
    let available = in_force.map(|config| config.enabled);
    if !available.contains(&true) {
        return Err(RunError::Fault(
            "no force unit is ready; see `forcectl status`".to_owned(),
        ));
    }
    Ok(Prepared {
        configs: in_force,
        config_crc,
        available,
        faults,
        missed_before: status.units.map(|unit| unit.missed),
        lost_before: conversions_lost(session.link())?.unwrap_or(0),
    })
}

/// What differs between the configurations sent and those read back, for people.
fn differences(sent: &[UnitConfig; UNITS], back: &[UnitConfig; UNITS]) -> Vec<String> {
    let fields = |config: &UnitConfig| match serde_json::to_value(config) {
        Ok(serde_json::Value::Object(fields)) => fields,
        _ => serde_json::Map::new(),
    };
    let mut found = Vec::new();
    for (i, (sent, back)) in sent.iter().zip(back).enumerate() {
        let back = fields(back);
        for (name, value) in fields(sent) {
            if let Some(other) = back.get(&name).filter(|other| **other != value) {
                found.push(format!("unit {}: {name} {value} became {other}", i + 1));
            }
        }
    }
    found
}

/// Conversions that the embedded rig saw unread so far.
fn conversions_lost(link: &mut dyn RigLink) -> Result<Option<u64>, LinkError> {
    let Some(controls) = link.controls() else {
        return Ok(None);
    };
    let report = controls.report()?;
    let lost = report
        .conversions
        .iter()
        .zip(report.conversions_read)
        .map(|(all, read)| all.saturating_sub(read));
    Ok(Some(lost.sum()))
}

/// Units that faulted are switched off in the configuration, so that the others can be armed.
fn leave_out_faulted(
    session: &mut Session<'_>,
    configs: &mut [UnitConfig; UNITS],
    status: &Status,
    observer: &mut dyn Observer,
) -> Result<Vec<RunFault>, RunError> {
    let mut faults = Vec::new();
    for (i, unit) in status.units.iter().enumerate() {
        let faulted =
            unit.fault != 0 || MotorState::from_u8(unit.state) == Some(MotorState::Faulted);
        if configs[i].enabled && faulted {
            let fault = unit_fault(-(PRETENSION_S + WANDER_S), i, unit.fault, unit.fault_detail);
            observer.notice(&format!("unit {} is left out: {}", i + 1, fault.text));
            faults.push(fault);
            configs[i].enabled = false;
        }
    }
    if !faults.is_empty() {
        session.configure(configs)?;
    }
    Ok(faults)
}

/// Waits until the board is ready: every unit has come up, or failed.
fn wait_ready(
    session: &mut Session<'_>,
    within: Duration,
    phase: Phase,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Status, RunError> {
    let start = session.now_ns();
    // A status that was on its way before the command took effect must not count.
    session.advance(PERIOD)?;
    loop {
        check_stop(stop)?;
        session.advance(PERIOD)?;
        let status = session.get_status()?;
        if status.fault != 0 {
            return Err(RunError::Fault(explain_fault(
                status.fault,
                status.fault_detail,
            )));
        }
        if status.state == SystemState::Ready as u8 {
            observer.progress(phase, 1.0);
            return Ok(status);
        }
        let waited = Duration::from_nanos(session.now_ns() - start);
        if waited > within {
            return Err(SessionError::TooLong(format!(
                "{} is not over after {} s (state `{}`); see `forcectl status`",
                phase.describe(),
                within.as_secs(),
                crate::session::system_state_name(status.state)
            ))
            .into());
        }
        observer.progress(phase, (waited.as_secs_f64() / 2.0).min(0.99));
    }
}

struct Run<'a> {
    rig: &'a RigFile,
    options: &'a Options,
    observer: &'a mut dyn Observer,
    pose: &'a mut PoseSource,
    controller: Controller,
    injections: Vec<(f64, Injection)>,
    available: [bool; UNITS],
    steps: Vec<Step>,
    faults: Vec<RunFault>,
    reach: Option<Reach>,
    samples: u64,
    /// Milliseconds in which the amplifiers had no power.
    amplifiers_off: u64,
    latencies_us: Vec<u16>,
    /// Link time at which the force is wanted.
    t0_ns: Option<u64>,
    last: Option<Output>,
}

impl Run<'_> {
    /// Arms, tensions, holds. `true`: ended early from outside.
    fn hold(&mut self, session: &mut Session<'_>) -> Result<bool, RunError> {
        check_stop(&self.options.stop)?;
        let before_s = PRETENSION_S + WANDER_S;
        self.observer.progress(Phase::Tension, 0.0);
        self.observer.samples(&session.drain().samples);
        session.command(&Command::Arm)?;
        let start_ns = session.now_ns();
        let t0_ns = start_ns + (before_s * 1e9) as u64;
        self.t0_ns = Some(t0_ns);
        let mut moving = false;
        loop {
            let t_s = (session.now_ns() as f64 - t0_ns as f64) * 1e-9;
            if t_s >= self.options.hold_s {
                return Ok(false);
            }
            if self.options.stop.load(Ordering::Relaxed) {
                return Ok(true);
            }
            if !moving && self.options.robot_moves && t_s >= -WANDER_S {
                moving = true;
                if let Some(controls) = session.link().controls() {
                    controls.robot(true)?;
                }
            }
            while self
                .injections
                .first()
                .is_some_and(|(at_s, _)| *at_s <= t_s)
            {
                let (_, injection) = self.injections.remove(0);
                if let Some(controls) = session.link().controls() {
                    controls.inject(injection)?;
                }
            }
            self.cycle(session, t_s)?;
            let (phase, fraction) = if t_s < -WANDER_S {
                (Phase::Tension, (t_s + before_s) / PRETENSION_S)
            } else if t_s < 0.0 {
                (Phase::Wander, (t_s + WANDER_S) / WANDER_S)
            } else {
                (Phase::Hold, t_s / self.options.hold_s)
            };
            self.observer.progress(phase, fraction);
        }
    }

    /// One cycle of 10 ms: compute, send, let time pass, look at what came.
    fn cycle(&mut self, session: &mut Session<'_>, t_s: f64) -> Result<(), RunError> {
        let tip_m = self
            .pose
            .tip_m(session.pose().map(|pose| pose.position_m))?;
        let newest = session.tension_n();
        let now_us = newest
            .iter()
            .flatten()
            .map(|(_, at)| *at)
            .max()
            .unwrap_or(0);
        let input = Input {
            dt_s: PERIOD.as_secs_f64(),
            tip_m,
            tension_n: newest.map(|tension| {
                tension
                    .filter(|(_, at)| at + FRESH_US >= now_us)
                    .map(|(tension, _)| tension)
            }),
            available: self.available,
            wanted_n: if t_s >= 0.0 {
                self.options.force_n
            } else {
                [0.0; 3]
            },
        };
        let output = self.controller.step(&input)?;
        session.set_setpoints(Some(output.setpoints));
        if t_s >= 0.0 {
            self.note_reach(output.reach);
        }
        session.advance(PERIOD)?;
        let received = session.drain();
        let end_s = t_s + PERIOD.as_secs_f64();
        let step = self.step_of(&output, &input, session, received.truth.last(), end_s);
        self.observer.step(&step);
        self.steps.push(step);
        let off = received
            .truth
            .iter()
            .filter(|truth| !truth.amplifier_on)
            .count() as u64;
        if off > 0 && self.amplifiers_off == 0 {
            self.observer.notice(&format!(
                "at {end_s:.2} s the PLC cut the amplifiers' power (E-stop, or the board's alive line stopped)"
            ));
        }
        self.amplifiers_off += off;
        self.last = Some(output);
        self.take(received, session.status(), t_s)
    }

    fn step_of(
        &self,
        output: &Output,
        input: &Input,
        session: &Session<'_>,
        truth: Option<&Truth>,
        end_s: f64,
    ) -> Step {
        let measured_tension_n = session
            .tension_n()
            .map(|tension| tension.map_or(0.0, |(t, _)| t));
        Step {
            t_s: end_s,
            tip_m: truth.map_or(input.tip_m, |truth| truth.tip_m),
            wanted_n: output.slewed_n,
            estimated_n: output.applied_n,
            applied_n: truth.map(|truth| truth.tip_force_n),
            asked_tension_n: output.allocation.tension_n,
            measured_tension_n,
            true_tension_n: truth.map(|truth| truth.tension_n),
            available: self.available,
        }
    }

    /// Keeps the worst of how the wanted force stood to what the cables could do; says so when it begins.
    fn note_reach(&mut self, reach: Reach) {
        let was_out = self.reach.is_some_and(|reach| !reach.feasible);
        if !reach.feasible && !was_out {
            self.observer.notice(&describe_reach(&reach));
        }
        if self
            .reach
            .is_none_or(|worst| reach.residual_n > worst.residual_n)
        {
            self.reach = Some(reach);
        }
    }

    fn take(
        &mut self,
        received: Received,
        status: Option<&Status>,
        t_s: f64,
    ) -> Result<(), RunError> {
        self.observer.samples(&received.samples);
        self.samples += received.samples.len() as u64;
        if t_s >= 0.0 {
            self.latencies_us
                .extend(received.samples.iter().map(|timed| timed.sample.latency_us));
        }
        for fault in &received.faults {
            self.take_fault(fault, t_s)?;
        }
        if let Some(status) = status {
            // Reports may be lost with their frame; the status tells as well.
            if status.fault != 0 {
                return Err(RunError::Fault(explain_fault(
                    status.fault,
                    status.fault_detail,
                )));
            }
            for (i, unit) in status.units.iter().enumerate() {
                if self.available[i] && unit.fault != 0 {
                    self.drop_unit(i, unit.fault, unit.fault_detail, t_s);
                }
            }
        }
        Ok(())
    }

    fn take_fault(&mut self, fault: &FaultReport, t_s: f64) -> Result<(), RunError> {
        let i = usize::from(fault.unit);
        if i >= UNITS {
            return Err(RunError::Fault(explain_fault(fault.code, fault.detail)));
        }
        if self.available[i] {
            self.drop_unit(i, fault.code, fault.detail, t_s);
        }
        Ok(())
    }

    /// The others carry on.
    fn drop_unit(&mut self, i: usize, code: u16, detail: u32, t_s: f64) {
        self.available[i] = false;
        let fault = unit_fault(t_s, i, code, detail);
        self.observer.notice(&format!(
            "unit {} dropped out, the others carry on: {}",
            i + 1,
            fault.text
        ));
        self.faults.push(fault);
    }

    fn outcome(
        mut self,
        session: &mut Session<'_>,
        prepared: &Prepared,
        status: &Status,
        interrupted: bool,
    ) -> Result<Outcome, SessionError> {
        let report = match session.link().controls() {
            Some(controls) => Some(controls.report()?),
            None => None,
        };
        let missed: u64 = status
            .units
            .iter()
            .zip(prepared.missed_before)
            .map(|(unit, before)| u64::from(unit.missed.wrapping_sub(before)))
            .sum();
        let samples_lost = match &report {
            Some(report) => {
                let all: u64 = report.conversions.iter().sum();
                let read: u64 = report.conversions_read.iter().sum();
                // A conversion that became ready just now is not lost.
                let lost = all
                    .saturating_sub(read)
                    .saturating_sub(prepared.lost_before);
                lost.saturating_sub(UNITS as u64).max(missed)
            }
            None => missed,
        };
        let degraded = !self.faults.is_empty()
            || self.amplifiers_off > 0
            || self.reach.is_some_and(|reach| !reach.feasible);
        let info = session.info();
        Ok(Outcome {
            ended: if interrupted {
                Ended::Interrupted
            } else if degraded {
                Ended::Degraded
            } else {
                Ended::Done
            },
            firmware: info.map_or_else(String::new, |info| info.version.as_str().to_owned()),
            rig_hash: self.rig.hash(),
            config_crc: prepared.config_crc,
            metrics: metrics::of_run(self.options.force_n, &self.steps),
            reach: self.reach,
            faults: std::mem::take(&mut self.faults),
            latency_ms: self.latency_ms(report.as_ref()),
            samples_lost,
            samples: self.samples,
            link_counters: session.counters(),
            amplifiers_off_s: self.amplifiers_off as f64 * 1e-3,
            steps: std::mem::take(&mut self.steps),
            report,
            configs: prepared.configs,
            link: session.link().name(),
        })
    }

    /// From the rig's own record while the force was held, or the firmware's where there is no rig.
    fn latency_ms(&mut self, report: Option<&Report>) -> Option<LatencyMs> {
        let t0_ns = self.t0_ns?;
        let outside: Vec<f64> = report
            .into_iter()
            .flat_map(|report| &report.latencies)
            .filter(|latency| latency.drdy_ns >= t0_ns)
            .map(|latency| latency.dac_update_ns.saturating_sub(latency.drdy_ns) as f64 * 1e-6)
            .collect();
        let measured_outside = !outside.is_empty();
        let mut all = if measured_outside {
            outside
        } else {
            self.latencies_us
                .iter()
                .map(|us| f64::from(*us) * 1e-3)
                .collect()
        };
        all.sort_by(f64::total_cmp);
        let last = all.len().checked_sub(1)?;
        Some(LatencyMs {
            p50: all[last / 2],
            p99: all[last * 99 / 100],
            measured_outside,
        })
    }
}

/// What is said about a force out of reach.
#[must_use]
pub fn describe_reach(reach: &Reach) -> String {
    match reach.fraction {
        _ if reach.feasible => "the force is within reach".to_owned(),
        Some(fraction) => format!(
            "the force is out of reach of the cables that are left or their limits: the nearest one is held, {:.3} N beside it; in exactly this direction {:.1} % of it would be within reach",
            reach.residual_n,
            100.0 * fraction
        ),
        None => format!(
            "the force is out of reach: the nearest one is held, {:.3} N beside it; with the cables that are left not even zero force is within reach",
            reach.residual_n
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::fake::{FakeBoard, Mood};

    #[derive(Default)]
    struct Notes(Vec<String>, u64);

    impl Observer for Notes {
        fn notice(&mut self, text: &str) {
            self.0.push(text.to_owned());
        }
        fn samples(&mut self, samples: &[TimedSample]) {
            self.1 += samples.len() as u64;
        }
    }

    fn rig() -> RigFile {
        RigFile::built_in().unwrap()
    }

    fn options() -> Options {
        Options::new([0.0, 2.5, 0.0], 4.0)
    }

    #[test]
    fn a_force_is_held_while_the_robot_moves() {
        let mut board = FakeBoard::new(Mood::Good);
        let mut notes = Notes::default();
        let outcome = set_force(&mut board, &rig(), &options(), &mut notes).unwrap();
        assert_eq!(outcome.ended, Ended::Done, "{:?}", notes.0);
        // The samples of zeroing and calibrating are there as well.
        assert!(notes.1 > outcome.samples, "{} {}", notes.1, outcome.samples);
        assert_eq!(outcome.link_counters.frames_lost, 0);
        let metrics = outcome.metrics.unwrap();
        assert!(metrics.tip_force_error_n < 0.1, "{metrics:?}");
        assert!(
            metrics.tension_rms_n.iter().all(|rms| *rms < 0.3),
            "{metrics:?}"
        );
        assert!(metrics.settling_s.is_some_and(|s| s < 1.0), "{metrics:?}");
        let moved = outcome.steps.iter().map(|step| step.tip_m[0]);
        let (low, high) = moved.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
        assert!(high - low > 0.005, "the robot stood still");
        // Disarmed at the end, motors at 0 V.
        assert_eq!(board.system, SystemState::Ready);
        assert!(board
            .plant
            .truth()
            .units
            .iter()
            .all(|unit| unit.amplifier_volts == 0.0));
    }

    #[test]
    fn load_cells_of_an_emulated_rig_are_calibrated_with_a_weight() {
        let mut board = FakeBoard::new(Mood::Good);
        let options = Options::new([0.0, 1.0, 0.0], 0.2);
        let outcome = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
        for (i, config) in outcome.configs.iter().enumerate() {
            // A code is 1 / (128 * 2^24) V/V.
            let per_n = board.plant.parameters(i).bridge_per_n * 128.0 * f64::from(1 << 24);
            let error = f64::from(config.scale_pn_per_count) * 1e-12 * per_n - 1.0;
            assert!(error.abs() < 1e-3, "unit {}: {error}", i + 1);
        }
    }

    #[test]
    fn nothing_is_driven_with_a_bad_force() {
        for bad in [
            [f64::NAN, 0.0, 0.0],
            [0.0, f64::INFINITY, 0.0],
            [0.0, 1e9, 0.0],
        ] {
            let mut board = FakeBoard::new(Mood::Good);
            let result = set_force(
                &mut board,
                &rig(),
                &Options::new(bad, 1.0),
                &mut NoopObserver,
            );
            assert!(matches!(result, Err(RunError::Argument(_))), "{bad:?}");
            assert!(board.commands.is_empty());
        }
    }

    #[test]
    fn a_unit_that_faults_is_reported_and_the_others_carry_on() {
        let mut board = FakeBoard::new(Mood::Good);
        let mut options = options();
        options.injections = vec![(1.5, Injection::UnplugSensor(4))];
        let mut notes = Notes::default();
        let outcome = set_force(&mut board, &rig(), &options, &mut notes).unwrap();
        assert_eq!(outcome.ended, Ended::Degraded);
        assert_eq!(outcome.faults.len(), 1);
        assert_eq!(outcome.faults[0].unit, Some(4));
        assert!(
            notes.0.iter().any(|n| n.contains("unit 4 dropped out")),
            "{:?}",
            notes.0
        );
        // +y needs unit 3, which is there: the force goes on.
        let end = outcome.steps.last().unwrap();
        assert!((end.best_force_n()[1] - 2.5).abs() < 0.3, "{end:?}");
        assert_eq!(end.asked_tension_n[3], 0.0);
    }

    #[test]
    fn a_unit_that_never_came_up_is_left_out() {
        let mut board = FakeBoard::new(Mood::Good);
        let mut options = options();
        options.injections = vec![(f64::NEG_INFINITY, Injection::UnplugSensor(2))];
        let mut notes = Notes::default();
        let outcome = set_force(&mut board, &rig(), &options, &mut notes).unwrap();
        assert!(
            notes.0.iter().any(|n| n.contains("unit 2 is left out")),
            "{:?}",
            notes.0
        );
        assert!(!outcome.configs[1].enabled);
        assert_eq!(outcome.ended, Ended::Degraded);
    }

    #[test]
    fn the_e_stop_ends_the_run_with_its_page() {
        let mut board = FakeBoard::new(Mood::Good);
        let mut options = options();
        options.injections = vec![(1.0, Injection::EStop(true))];
        let error = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap_err();
        assert!(
            error.to_string().contains("fault 1, E-stop open"),
            "{error}"
        );
        assert!(!board.system.drives());
    }

    #[test]
    fn ctrl_c_disarms() {
        struct Press(Arc<AtomicBool>);
        impl Observer for Press {
            fn step(&mut self, step: &Step) {
                if step.t_s > 1.5 {
                    self.0.store(true, Ordering::Relaxed);
                }
            }
        }
        let mut board = FakeBoard::new(Mood::Good);
        let options = options();
        let mut press = Press(Arc::clone(&options.stop));
        let outcome = set_force(&mut board, &rig(), &options, &mut press).unwrap();
        assert_eq!(outcome.ended, Ended::Interrupted);
        assert_eq!(board.system, SystemState::Ready);
        assert!(outcome.steps.last().unwrap().t_s < 1.6);
        // Before anything was armed: nothing ever is.
        let mut board = FakeBoard::new(Mood::Good);
        let options = Options {
            stop: Arc::new(AtomicBool::new(true)),
            ..options
        };
        let result = set_force(&mut board, &rig(), &options, &mut NoopObserver);
        assert!(matches!(result, Err(RunError::Interrupted)));
        assert!(!board.commands.contains(&Command::Arm));
    }

    #[test]
    fn a_link_that_breaks_is_an_error_and_the_board_stops_by_itself() {
        let mut board = FakeBoard::new(Mood::BreaksAt(5_500_000_000));
        let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains("went away"), "{error}");
        board.mood = Mood::Good;
        board.exchange(&[], Duration::from_millis(200)).unwrap();
        assert_eq!(board.fault.map(|f| f.0.code()), Some(2));
    }

    #[test]
    fn a_board_that_falls_silent_or_restarts_ends_the_run() {
        let mut board = FakeBoard::new(Mood::MuteAt(5_500_000_000));
        let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains("doesn't answer"), "{error}");
        let mut board = FakeBoard::new(Mood::ResetsAt(5_500_000_000));
        let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains("was reset"), "{error}");
        assert!(error.to_string().contains("watchdog"), "{error}");
    }

    #[test]
    fn a_bad_line_is_survived_and_counted() {
        let mut board = FakeBoard::new(Mood::Noisy(4000));
        let outcome = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
        assert!(
            outcome.link_counters.frames_bad > 10,
            "{:?}",
            outcome.link_counters
        );
        assert!(outcome.link_counters.frames_lost > 10);
        assert!(outcome.metrics.unwrap().tip_force_error_n < 0.1);
    }

    #[test]
    fn dropped_frames_are_counted_by_their_gaps() {
        let mut board = FakeBoard::new(Mood::Drops(50));
        let outcome = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
        let counters = outcome.link_counters;
        let share = counters.frames_lost as f64 / (counters.frames + counters.frames_lost) as f64;
        assert!((share - 0.02).abs() < 0.001, "{counters:?}");
    }

    #[test]
    fn strangers_are_refused_and_told_apart() {
        for (mood, words) in [
            (Mood::OtherAbi(wire::ABI_VERSION + 1), "update forcectl"),
            (Mood::OtherAbi(0), "cargo xtask flash"),
            (Mood::Garbage, "none of them a frame"),
            (Mood::Silent, "sends nothing"),
            (Mood::Refusing, "refused"),
        ] {
            let mut board = FakeBoard::new(mood);
            let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
            assert!(error.to_string().contains(words), "{mood:?}: {error}");
            assert!(!board.commands.contains(&Command::Arm));
        }
    }
}

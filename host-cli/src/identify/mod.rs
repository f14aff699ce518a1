//! Finds what a rig's rig file lacks: excite, analyse, correct, and see whether it was better.
//!
//! # Why the loop is opened
//!
//! In the closed loop the command answers to the very disturbance that is looked for: friction that pulls the tension
//! down pulls the command up, and a fit of tension over command sees the feedback as much as the drive. So
//! [`excite`] runs the board with all gains at zero and without feedforward: the command is the setpoint, and nothing
//! but the setpoint. That also keeps a rig quiet that would swing in closed loop, such as one whose drive answers late.
//! What makes it safe is what the board does at all times: force limit, slew limits, over-tension, slack brake,
//! expiring setpoints, E-stop. The commands stay 1 N inside the tensions that the rig file allows, so no
//! friction that the board could make up for lets a cable go slack. Friction that nobody makes up for pulls at the tip:
//! where that force comes near the rig file's limit the commands swing less from then on, and past the limit the host
//! ends the session.
//!
//! # What makes effects tell apart
//!
//! The robot has to move: reels that rest hold any force. Its path makes them turn both ways at many speeds and
//! through many angles. Each cable's command is a sum of five sines from 0.1 to 4 Hz, at frequencies of its own, so
//! that load, speed, angle, time and the neighbours' loads have nothing to do with each other.
//!
//! # Times
//!
//! A converter's value is 6.25 ms old when it is ready (sinc4, four conversions long). [`Recording::rows`] takes
//! command, travel and speed from that much earlier, and the command half a sample later again, since the DAC holds it
//! for one.

pub mod findings;

use crate::force::pose::PoseSource;
use crate::identify::findings::{Frame, Rewritten};
use crate::link::RigLink;
use crate::rigfile::{RigFile, UnitSettings};
use crate::run::{self, Observer, Outcome, Phase, Prepared, RunError};
use crate::session::{explain_fault, Session, TimedSample, PERIOD};
use control::convert::REEL_RADIUS_M;
use nalgebra::Vector3;
use residual::spec::Spec;
use residual::Report;
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use wire::message::{UnitConfig, UnitSetpoint};
use wire::{Command, UNITS};

/// The model of the recorded session.
pub const MODEL: &str = include_str!("../../models/identify.toml");

/// For how long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.0;
/// From then on until samples are used, s: longer than the robot's soft start.
const SETTLE_S: f64 = 1.5;
/// Distance of the commands from the tensions that the rig file allows, N.
const INSIDE_N: f64 = 1.0;
/// Largest amplitude of the commands, N. Six cables out of step, and their friction, make 8 N at the tip with it.
const MOST_AMPLITUDE_N: f64 = 1.5;
/// Smaller ones show nothing, N.
const LEAST_AMPLITUDE_N: f64 = 0.5;
/// Part of the rig file's force limit above which the commands swing less from then on; the rest is for what the force
/// still grows by until that helps.
const NEAR_LIMIT: f64 = 0.85;
/// What is left of the swing after a setpoint period (10 ms) above that: half of it after 0.23 s.
const EASE: f64 = 0.97;
/// Frequencies of the first unit's sines, Hz; each unit's are 6 % above those of the one before.
const SINES_HZ: [f64; 5] = [0.11, 0.27, 0.63, 1.37, 2.90];
/// Age of a conversion when it is ready: half of four conversions, in conversions.
const CONVERSION_AGE: f64 = 2.0;
/// Half the span over which speed is taken, s: 25 ms in all, in which one count is 0.17 mm/s.
const HALF_SPEED_SPAN_S: f64 = 0.0125;
/// Nominal time between two conversions, s.
const SAMPLE_S: f64 = 1.0 / control::NOMINAL_SPS as f64;
/// What nameless structure may still take off the held-out RMSE, as a part of what the findings took off it, if a board
/// is to use them: beyond, the parameters are those of a stand-in.
pub const MOST_LEFT: f64 = 0.1;

/// A recorded session.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Samples, in order, with 1/cos as it was in force.
    samples: Vec<(TimedSample, f64)>,
    /// The configurations in force, zeros and scales included.
    configs: [UnitConfig; UNITS],
    /// Units that took part.
    pub available: [bool; UNITS],
    /// Part of the amplitude that was left at the end; below 1 where the force at the tip came near the limit.
    pub swing: f64,
}

/// A row of a session as it is analysed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Row {
    /// Time of the conversion's middle, s.
    pub time_s: f64,
    /// Cable tension, unfiltered, N.
    pub tension_n: f64,
    /// Command in force then, N: DAC output by `dac_codes_per_n`.
    pub command_n: f64,
    /// Cable speed then, m/s, positive winding in.
    pub speed_m_s: f64,
    /// Reel angle then, rad, from the board's encoder position by a reel of 10 mm.
    pub angle_rad: f64,
    /// The others' tensions at that time, N.
    pub neighbours_n: [f64; UNITS],
}

/// Runs the excitation and records it.
///
/// # Errors
/// [`RunError`]; the rig was made safe as far as the link allowed. Any fault ends the session: half a session is none.
pub fn excite(
    link: &mut dyn RigLink,
    rig: &RigFile,
    seconds: f64,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Recording, RunError> {
    let open = opened(rig, seconds)?;
    let mut pose = PoseSource::open(&rig.pose)?;
    observer.progress(Phase::Connect, 0.0);
    let mut session = Session::connect(link)?;
    let prepared = run::prepare_board(&mut session, &open, stop, observer)?;
    let result = drive(
        &mut session,
        rig,
        &prepared,
        &mut pose,
        seconds,
        stop,
        observer,
    );
    match result {
        Ok((samples, swing)) => {
            observer.progress(Phase::Disarm, 0.0);
            if let Err(error) = run::ramp_down_and_disarm(&mut session) {
                session.make_safe();
                return Err(error.into());
            }
            Ok(Recording {
                samples,
                configs: prepared.configs,
                available: prepared.available,
                swing,
            })
        }
        Err(error) => {
            session.make_safe();
            Err(error)
        }
    }
}

/// Checks what a session is asked for, before anything is driven.
///
/// # Errors
/// The session is too short or too long, or a unit's tensions leave no room.
pub fn check(rig: &RigFile, seconds: f64) -> Result<(), RunError> {
    opened(rig, seconds).map(|_| ())
}

/// The rig with the tension loops open: the command is the setpoint.
fn opened(rig: &RigFile, seconds: f64) -> Result<RigFile, RunError> {
    if !(seconds.is_finite() && (8.0..=600.0).contains(&seconds)) {
        return Err(RunError::Argument(format!(
            "a session of {seconds} s; give 8 to 600 (blocks of 4 s are held out in turn)"
        )));
    }
    let mut open = rig.clone();
    for unit in &mut open.units {
        unit.kp = 0.0;
        unit.ki_per_s = 0.0;
        unit.kd_s = 0.0;
        unit.damping_n_s_per_m = 0.0;
        unit.friction_feedforward = false;
        if unit.enabled && sines(unit, 1.0).1 < LEAST_AMPLITUDE_N {
            return Err(RunError::Argument(format!(
                "unit {}: between tension_min_n = {} and tension_max_n = {} there is no room for an excitation; {} N are the least",
                unit.number,
                unit.tension_min_n,
                unit.tension_max_n,
                2.0 * (INSIDE_N + LEAST_AMPLITUDE_N)
            )));
        }
    }
    Ok(open)
}

/// Middle and amplitude of a unit's commands, N, with a part of the swing that there is room for.
fn sines(unit: &UnitSettings, swing: f64) -> (f64, f64) {
    let low = unit.tension_min_n + INSIDE_N;
    let room = (0.5 * (unit.tension_max_n - INSIDE_N - low)).min(MOST_AMPLITUDE_N);
    let amplitude = (swing * room).max(room.min(LEAST_AMPLITUDE_N));
    (low + amplitude, amplitude)
}

/// A unit's command at a time, N.
fn command_n(unit: &UnitSettings, i: usize, t_s: f64, swing: f64) -> f64 {
    let (middle, amplitude) = sines(unit, swing);
    let sum: f64 = SINES_HZ
        .iter()
        .enumerate()
        .map(|(k, hz)| {
            let hz = hz * 1.06f64.powi(i as i32);
            // Phases of no pattern (golden section), so that the sines don't start together.
            (TAU * (hz * t_s + 0.618 * (5 * i + k) as f64)).sin()
        })
        .sum();
    middle + amplitude * sum / SINES_HZ.len() as f64
}

fn drive(
    session: &mut Session<'_>,
    rig: &RigFile,
    prepared: &Prepared,
    pose: &mut PoseSource,
    seconds: f64,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<(Vec<(TimedSample, f64)>, f64), RunError> {
    observer.progress(Phase::Tension, 0.0);
    observer.samples(&session.drain().samples);
    session.command(&Command::Arm)?;
    let start_ns = session.now_ns();
    let mut kept = Vec::new();
    let mut moving = false;
    let mut swing = 1.0;
    loop {
        let t_s = (session.now_ns() - start_ns) as f64 * 1e-9 - PRETENSION_S;
        if t_s >= SETTLE_S + seconds {
            return Ok((kept, swing));
        }
        if stop.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted);
        }
        if !moving && t_s >= 0.0 {
            moving = true;
            if let Some(controls) = session.link().controls() {
                controls.robot(true)?;
            }
        }
        let tip_m = pose.tip_m(session.pose().map(|pose| pose.position_m.into()))?;
        let off = (tip_m - rig.workspace.center_m).norm();
        if off.is_nan() || off > rig.workspace.radius_m {
            return Err(RunError::Fault(format!(
                "the tip is {off:.3} m from the workspace's centre, {} m are allowed (`radius_m` in [workspace])",
                rig.workspace.radius_m
            )));
        }
        let mut force_n = Vector3::zeros();
        let mut inv_cos = [1.0; UNITS];
        let mut setpoints = [UnitSetpoint {
            tension_un: 0,
            inv_cos_q16: 1 << 16,
        }; UNITS];
        for (i, unit) in rig.units.iter().enumerate() {
            if !prepared.available[i] {
                continue;
            }
            let cable = unit.cable_at(tip_m);
            let q16 = cable.and_then(|(_, cos)| control::geometry::inv_cos_q16(cos));
            let (Some((direction, _)), Some(q16)) = (cable, q16) else {
                return Err(RunError::Fault(format!(
                    "unit {}: the cable is too far off its load cell's axis; check pose, exit_m and axis",
                    unit.number
                )));
            };
            if let Some((tension, _)) = session.tension_n()[i] {
                force_n += direction * tension;
            }
            inv_cos[i] = f64::from(q16) / 65_536.0;
            setpoints[i] = UnitSetpoint {
                tension_un: (command_n(unit, i, t_s, swing) * 1e6).round() as i32,
                inv_cos_q16: q16,
            };
        }
        let force = force_n.norm();
        if force > rig.controller.force_limit_n {
            return Err(RunError::Fault(format!(
                "the force at the tip reached {force:.1} N, {} N are allowed (`force_limit_n` in [controller])",
                rig.controller.force_limit_n
            )));
        }
        // Never up again: a command that follows the force is feedback, which the analysis would take for drive.
        if force > NEAR_LIMIT * rig.controller.force_limit_n {
            swing = (swing * EASE).max(LEAST_AMPLITUDE_N / MOST_AMPLITUDE_N);
        }
        session.set_setpoints(Some(setpoints));
        session.advance(PERIOD)?;
        let received = session.drain();
        observer.samples(&received.samples);
        if let Some(fault) = received.faults.first() {
            return Err(RunError::Fault(explain_fault(fault.code, fault.detail)));
        }
        if let Some(status) = session.status() {
            let unit = status.units.iter().zip(prepared.available);
            let unit = unit.filter(|(unit, available)| *available && unit.fault != 0);
            let fault = std::iter::once((status.fault, status.fault_detail))
                .chain(unit.map(|(unit, _)| (unit.fault, unit.fault_detail)))
                .find(|(code, _)| *code != 0);
            if let Some((code, detail)) = fault {
                return Err(RunError::Fault(explain_fault(code, detail)));
            }
        }
        if t_s >= SETTLE_S {
            kept.extend(received.samples.iter().map(|timed| {
                let unit = usize::from(timed.sample.unit).min(UNITS - 1);
                (*timed, inv_cos[unit])
            }));
        }
        let (phase, part) = if t_s < SETTLE_S {
            (
                Phase::Tension,
                (t_s + PRETENSION_S) / (PRETENSION_S + SETTLE_S),
            )
        } else {
            (Phase::Excite, (t_s - SETTLE_S) / seconds)
        };
        observer.progress(phase, part.clamp(0.0, 1.0));
    }
}

/// A quantity of one unit over time, straight between its points.
#[derive(Debug, Clone, Default)]
struct Track {
    at_s: Vec<f64>,
    value: Vec<f64>,
}

impl Track {
    fn push(&mut self, at_s: f64, value: f64) {
        // Times that stand still would divide by zero.
        if self.at_s.last().is_none_or(|last| at_s > *last) {
            self.at_s.push(at_s);
            self.value.push(value);
        }
    }

    /// `None` outside of what was recorded.
    fn at(&self, t_s: f64) -> Option<f64> {
        let after = self.at_s.partition_point(|at| *at <= t_s);
        let before = after.checked_sub(1)?;
        let (t0, t1) = (*self.at_s.get(before)?, *self.at_s.get(after)?);
        let (y0, y1) = (self.value[before], self.value[after]);
        Some(y0 + (y1 - y0) * (t_s - t0) / (t1 - t0))
    }
}

impl Recording {
    /// The rows of a unit (from 0); see the module's page, "Times".
    #[must_use]
    pub fn rows(&self, unit: usize) -> Vec<Row> {
        let mut tension: [Track; UNITS] = Default::default();
        let (mut command, mut travel) = (Track::default(), Track::default());
        let age_s = CONVERSION_AGE * SAMPLE_S;
        for (timed, inv_cos) in &self.samples {
            let s = &timed.sample;
            let i = usize::from(s.unit);
            let Some(config) = self.configs.get(i) else {
                continue;
            };
            let t_s = timed.t_us as f64 * 1e-6;
            let scale = f64::from(config.scale_pn_per_count) * 1e-12;
            let force = (f64::from(s.adc_code) - f64::from(config.zero_code)) * scale;
            tension[i].push(t_s - age_s, force * inv_cos);
            if i == unit {
                let codes_per_n = f64::from(config.dac_counts_per_n_q16) / 65_536.0;
                let latency_s = f64::from(s.latency_us) * 1e-6;
                command.push(
                    t_s + latency_s + 0.5 * SAMPLE_S,
                    (f64::from(s.dac_code) - 32_768.0) / codes_per_n,
                );
                travel.push(
                    t_s,
                    f64::from(s.encoder_counts) * f64::from(config.travel_nm_per_count) * 1e-9,
                );
            }
        }
        let Some(own) = tension.get(unit) else {
            return Vec::new();
        };
        let row = |(t_s, tension_n): (&f64, &f64)| {
            let after = travel.at(t_s + HALF_SPEED_SPAN_S)?;
            let before = travel.at(t_s - HALF_SPEED_SPAN_S)?;
            Some(Row {
                time_s: *t_s,
                tension_n: *tension_n,
                command_n: command.at(*t_s)?,
                speed_m_s: (after - before) / (2.0 * HALF_SPEED_SPAN_S),
                angle_rad: travel.at(*t_s)? / REEL_RADIUS_M,
                neighbours_n: core::array::from_fn(|i| tension[i].at(*t_s).unwrap_or(0.0)),
            })
        };
        own.at_s.iter().zip(&own.value).filter_map(row).collect()
    }

    /// The rows of a unit (from 0) as CSV, with a header.
    #[must_use]
    pub fn csv(&self, unit: usize) -> String {
        let mut text = "time_s,tension_n,command_n,speed_m_s,angle_rad".to_owned();
        (1..=UNITS).for_each(|n| {
            let _ = write!(text, ",tension_{n}_n");
        });
        text.push('\n');
        for r in self.rows(unit) {
            let _ = write!(
                text,
                "{:.6},{:.6},{:.6},{:.7},{:.6}",
                r.time_s, r.tension_n, r.command_n, r.speed_m_s, r.angle_rad
            );
            r.neighbours_n.iter().for_each(|n| {
                let _ = write!(text, ",{n:.5}");
            });
            text.push('\n');
        }
        text
    }
}

/// The model of a unit: what its settings declare.
///
/// # Errors
/// Only if the model file that is built in were wrong; a test keeps it right.
pub fn model(unit: &UnitSettings) -> Result<Spec, residual::Error> {
    let mut spec = Spec::parse(MODEL)?;
    spec.title = format!("Unit {}: {}", unit.number, spec.title);
    for term in &mut spec.terms {
        term.fixed = Some(match term.name.as_str() {
            "friction_gain" => unit.friction_gain,
            "friction_offset_n" => unit.friction_offset_n,
            "coulomb_n" => -unit.coulomb_n,
            _ => -unit.coulomb_per_n,
        });
    }
    let term = |name: &str, expr: String, fixed: f64| residual::spec::Term {
        name: name.to_owned(),
        expr,
        unit: String::new(),
        fixed: Some(fixed),
        per: String::new(),
        effect: String::new(),
        fitted: None,
    };
    if unit.viscous_n_s_per_m != 0.0 {
        let fixed = -unit.viscous_n_s_per_m;
        spec.terms
            .push(term("viscous_n_s_per_m", "velocity".to_owned(), fixed));
    }
    for ripple in unit.ripples.iter().filter(|r| !r.is_none()) {
        let order = TAU * REEL_RADIUS_M / ripple.period_m;
        let sine = format!("sin({order} * angle + {})", ripple.phase_rad);
        if ripple.amplitude_n != 0.0 {
            spec.terms
                .push(term("ripple", sine.clone(), ripple.amplitude_n));
        }
        if ripple.amplitude_per_n != 0.0 {
            let text = format!("command * {sine}");
            spec.terms
                .push(term("ripple by load", text, ripple.amplitude_per_n));
        }
    }
    Ok(spec)
}

/// What was found on one unit, and what came of it.
#[derive(Debug, Clone, Serialize)]
pub struct UnitFinding {
    /// Unit from 1.
    pub unit: u8,
    /// The analysis.
    pub report: Report,
    /// What of it is not in the new settings, and why.
    pub not_used: Vec<String>,
}

/// What was found on a rig.
#[derive(Debug, Clone)]
pub struct Findings {
    /// Unit by unit.
    pub units: Vec<UnitFinding>,
    /// The rig with what the board can use.
    pub rig: RigFile,
    /// The text of the rig file with it, and the changes.
    pub rewritten: Rewritten,
}

/// Why an analysis could not be done.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// A file could not be written.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: String,
        /// The operating system's words.
        cause: std::io::Error,
    },
    /// The data can't answer.
    #[error("unit {unit}: {error}")]
    Analysis {
        /// Unit from 1.
        unit: u8,
        /// What is wrong.
        error: residual::Error,
    },
    /// The rig file's text can't be changed.
    #[error("{0}")]
    RigFile(String),
}

/// Analyses a recording unit by unit, with reports in folders below `out`, and puts what the board can use into the
/// text of the rig file.
///
/// # Errors
/// [`FindError`].
pub fn find(
    recording: &Recording,
    rig: &RigFile,
    rig_name: &str,
    rig_text: &str,
    out: &Path,
    progress: &mut dyn residual::Progress,
) -> Result<Findings, FindError> {
    let mut units = Vec::new();
    let mut new = rig.units;
    for (i, unit) in rig.units.iter().enumerate() {
        if !recording.available[i] {
            continue;
        }
        let folder = out.join(format!("unit{}", unit.number));
        let log = folder.join("session.csv");
        let file = |cause| FindError::File {
            path: log.display().to_string(),
            cause,
        };
        std::fs::create_dir_all(&folder).map_err(file)?;
        std::fs::write(&log, recording.csv(i)).map_err(file)?;
        progress.stage(&format!("unit {}", unit.number));
        let report = model(unit)
            .and_then(|model| {
                let options = residual::Options {
                    data: vec![log.clone()],
                    model,
                    out: Some(folder.clone()),
                };
                residual::run(&options, &mut ())
            })
            .map_err(|error| FindError::Analysis {
                unit: unit.number,
                error,
            })?;
        let not_used = match usable(&report) {
            Ok(mut board) => {
                let angles: Vec<f64> = recording.rows(i).iter().map(|r| r.angle_rad).collect();
                findings::merge_ripples(&mut board.ripples, &angles);
                let frame = Frame {
                    increment: true,
                    gain_of_drive: true,
                    velocity_m_per_s: Some(1.0),
                    travel_m_per_rad: Some(REEL_RADIUS_M),
                };
                let corrected = findings::correct(unit, &board, &frame);
                new[i] = corrected.unit;
                corrected.not_used
            }
            Err(why) => vec![why],
        };
        units.push(UnitFinding {
            unit: unit.number,
            report,
            not_used,
        });
    }
    let rewritten = findings::rewrite(rig_name, rig_text, rig, &new).map_err(FindError::RigFile)?;
    let mut rig = rig.clone();
    rig.units = new;
    Ok(Findings {
        units,
        rig,
        rewritten,
    })
}

/// What a board may use of a report, or why nothing.
///
/// # Errors
/// The verdict doesn't support a change, or nameless structure is left beside what was named.
pub fn usable(report: &Report) -> Result<residual::Compensation, String> {
    let (before, after) = (report.baseline.heldout_rmse, report.last.heldout_rmse);
    let left = |s: &&residual::Structure| s.gain * after > MOST_LEFT * (before - after);
    if let Some(left) = report.structure.iter().find(left) {
        return Err(format!(
            "all of it: a nameless dependence on {} would take another {:.3} {} off the error, beside the {:.3} {} of what was named, which may stand in for it",
            left.depends_on,
            left.gain * after,
            report.unit,
            before - after,
            report.unit
        ));
    }
    report
        .compensation()
        .ok_or_else(|| format!("the verdict: {}", report.summary()))
}

/// The figures that a correction is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// RMS of tension less asked tension, each cable, N.
    pub tension_rms_n: [f64; UNITS],
    /// The worst cable's.
    pub worst_tension_rms_n: f64,
    /// RMS of the length of the force error at the tip, N.
    pub tip_rms_n: f64,
    /// Whether they are the plant's truth (embedded rig) or the load cells'.
    pub from_truth: bool,
}

impl Figures {
    /// Of a run; `None` where it was too short.
    #[must_use]
    pub fn of(outcome: &Outcome) -> Option<Self> {
        let metrics = outcome.metrics.as_ref()?;
        Some(Self {
            tension_rms_n: metrics.tension_rms_n,
            worst_tension_rms_n: metrics.tension_rms_n.into_iter().fold(0.0, f64::max),
            tip_rms_n: metrics.tip_force_rms_n,
            from_truth: metrics.from_truth,
        })
    }

    /// Whether these are better than those of before: the worst cable by 2 % at least, the tip no worse than 5 %.
    #[must_use]
    pub fn better_than(&self, before: &Self) -> bool {
        self.worst_tension_rms_n <= 0.98 * before.worst_tension_rms_n
            && self.tip_rms_n <= 1.05 * before.tip_rms_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::fake::{FakeBoard, Mood};
    use crate::rigfile::DEFAULT_TEXT;
    use crate::run::NoopObserver;
    use control::SystemState;
    use emulator_link::Injection;
    use plant::effects::{AmplifierGain, Coulomb, Effect, Periodic, Shaft};
    use plant::PlantConfig;

    fn rig() -> RigFile {
        RigFile::built_in().unwrap()
    }

    /// Records, analyses, corrects; and the part of the swing that was left.
    fn identified(effects: Vec<Effect>) -> (Findings, f64) {
        let plant = PlantConfig {
            effects,
            ..PlantConfig::default()
        };
        let mut board = FakeBoard::with(Mood::Good, 3, plant);
        let stop = AtomicBool::new(false);
        let recording = excite(&mut board, &rig(), 24.0, &stop, &mut NoopObserver).unwrap();
        assert_eq!(board.system, SystemState::Ready, "disarmed at the end");
        let id = std::thread::current().id();
        let out = std::env::temp_dir().join(format!("identify-{}-{id:?}", std::process::id()));
        let findings = find(&recording, &rig(), "rig", DEFAULT_TEXT, &out, &mut ()).unwrap();
        std::fs::remove_dir_all(out).unwrap();
        (findings, recording.swing)
    }

    #[test]
    fn what_each_unit_has_beyond_the_rig_file_is_found_and_declared() {
        let (findings, swing) = identified(vec![
            Effect::Coulomb(Coulomb {
                units: vec![0],
                constant_n: 0.6,
                per_load: 0.0,
            }),
            Effect::Periodic(Periodic {
                units: vec![1],
                shaft: Shaft::Motor,
                order: 1.0,
                amplitude_n: 0.6,
                phase_rad: 0.0,
            }),
            Effect::AmplifierGain(AmplifierGain {
                units: vec![2],
                relative_error: -0.25,
            }),
        ]);
        assert_eq!(swing, 1.0, "no more force than was to be expected");
        let (old, new) = (rig().units, findings.rig.units);
        let friction = |u: &UnitSettings| u.coulomb_n + 4.5 * u.coulomb_per_n;
        // Units differ by some 0.1 N by themselves.
        let more = friction(&new[0]) + crate::identify::findings::UNDER_N - friction(&old[0]);
        assert!((more - 0.6).abs() < 0.25, "{:?}", findings.units[0]);
        let name = findings.units[0].report.effects[0].name.as_str();
        assert!(name.ends_with("coulomb"), "{name}");

        let ripple = new[1].ripples[0];
        let motor_turn_m = TAU * REEL_RADIUS_M * 7.0 / 26.0;
        assert!(
            (ripple.period_m / motor_turn_m - 1.0).abs() < 0.01,
            "{ripple:?} {:?}",
            findings.units[1]
        );
        assert!((ripple.amplitude_n - 0.6).abs() < 0.06, "{ripple:?}");
        assert!(ripple.phase_rad.abs() < 0.15, "{ripple:?}");

        let scale = new[2].dac_codes_per_n / old[2].dac_codes_per_n * 0.75;
        assert!((scale - 1.0).abs() < 0.04, "{scale}");

        for i in 3..UNITS {
            assert!((friction(&new[i]) - friction(&old[i])).abs() < 0.3);
            assert!(new[i].ripples[0].is_none());
        }
        let parsed = RigFile::parse("rig", &findings.rewritten.text).unwrap();
        assert_eq!(parsed, findings.rig);
        refuses_what_is_not_clear(&findings.units[0].report);
    }

    #[test]
    fn a_rig_with_much_friction_is_driven_less_and_still_found_out() {
        let (findings, swing) = identified(vec![Effect::Coulomb(Coulomb {
            units: vec![],
            constant_n: 0.0,
            per_load: 0.2,
        })]);
        assert!(swing < 1.0, "{swing}");
        for (old, new) in rig().units.iter().zip(&findings.rig.units) {
            let friction = |u: &UnitSettings| u.coulomb_n + 4.0 * u.coulomb_per_n;
            let more = friction(new) + crate::identify::findings::UNDER_N - friction(old);
            // Units differ by some 0.1 N by themselves.
            assert!((more - 0.8).abs() < 0.3, "{more} {:?}", findings.units);
        }
    }

    /// From a report that a board may use: the same with other verdicts.
    fn refuses_what_is_not_clear(clear: &Report) {
        use residual::{Ambiguity, EffectKind, Structure, Verdict};
        assert!(usable(clear).is_ok(), "{}", clear.summary());
        let with = |change: &dyn Fn(&mut Report)| {
            let mut report = clear.clone();
            change(&mut report);
            usable(&report)
        };
        for verdict in [Verdict::None, Verdict::Unknown] {
            let why = with(&|r| r.verdict = verdict).unwrap_err();
            assert!(why.contains("verdict"), "{why}");
        }
        let rivals = |names: [EffectKind; 2]| {
            with(&move |r| {
                r.verdict = Verdict::NotIdentifiable;
                r.not_identifiable = vec![Ambiguity::new(names.to_vec(), "")];
            })
        };
        assert!(rivals([EffectKind::Coulomb, EffectKind::Backlash]).is_err());
        assert!(rivals([EffectKind::Coulomb, EffectKind::Delay]).is_err());
        // The same friction by either name.
        assert!(rivals([EffectKind::LoadDependentCoulomb, EffectKind::Coulomb]).is_ok());
        let nameless = |part: f64| {
            with(&move |r| {
                let explained = r.baseline.heldout_rmse - r.last.heldout_rmse;
                r.structure = vec![Structure::new(
                    "time",
                    part * explained / r.last.heldout_rmse,
                    0.0,
                )];
            })
        };
        assert!(nameless(0.05).is_ok());
        assert!(nameless(0.2).unwrap_err().contains("time"));
    }

    #[test]
    fn a_session_that_faults_ends_disarmed_and_says_why() {
        let stop = AtomicBool::new(false);
        let mut board = FakeBoard::new(Mood::Good);
        board
            .controls()
            .unwrap()
            .inject(Injection::EStop(true))
            .unwrap();
        let error = excite(&mut board, &rig(), 10.0, &stop, &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains("E-stop"), "{error}");
        assert!(!board.system.drives());
    }

    #[test]
    fn nothing_is_driven_without_time_or_room() {
        let stop = AtomicBool::new(false);
        let mut board = FakeBoard::new(Mood::Good);
        for seconds in [f64::NAN, 1.0, 1e6] {
            let result = excite(&mut board, &rig(), seconds, &stop, &mut NoopObserver);
            assert!(matches!(result, Err(RunError::Argument(_))), "{seconds}");
        }
        let mut narrow = rig();
        narrow.units[3].tension_max_n = 4.5;
        let error = excite(&mut board, &narrow, 10.0, &stop, &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains("unit 4"), "{error}");
        assert!(board.commands.is_empty());
    }

    #[test]
    fn commands_stay_inside_the_tensions_of_the_rig_file() {
        for (i, unit) in rig().units.iter().enumerate() {
            for n in 0..20_000 {
                let swing = 1.0 - f64::from(n) / 20_000.0;
                let command = command_n(unit, i, f64::from(n) * 0.003, swing);
                assert!(command >= unit.tension_min_n + INSIDE_N - 1e-9);
                assert!(command <= unit.tension_max_n - INSIDE_N + 1e-9);
            }
        }
    }

    #[test]
    fn a_model_declares_what_the_rig_file_says() {
        let mut unit = rig().units[0];
        assert_eq!(model(&unit).unwrap().terms.len(), 4);
        unit.coulomb_n = 1.5;
        unit.viscous_n_s_per_m = 7.0;
        unit.ripples[1].period_m = TAU * REEL_RADIUS_M;
        unit.ripples[1].amplitude_per_n = 0.02;
        let spec = model(&unit).unwrap();
        let fixed = |name: &str| {
            let term = spec.terms.iter().find(|t| t.name == name);
            term.and_then(|t| t.fixed)
        };
        assert_eq!(fixed("coulomb_n"), Some(-1.5));
        assert_eq!(fixed("viscous_n_s_per_m"), Some(-7.0));
        assert_eq!(fixed("ripple by load"), Some(0.02));
    }
}

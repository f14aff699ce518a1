//! The 100 Hz loop of a run: arm, tension the cables, let the robot move, hold the force.
//!
//! A unit that faults during the run is taken out. The others continue while they can hold zero
//! force; where they cannot, the rig is ramped down, because the cables that are left would pull
//! the tip aside. A fault of the whole board ends the run.

use crate::checks::{check_stop, fresh_pose, require_zero_at, tell_of};
use crate::cycles::Cycles;
use crate::error::{RunError, UnitLost};
use crate::fault::RunFault;
use crate::options::{Options, PRETENSION_S, ROBOT_START_S};
use crate::outcome::{Ended, Histogram, LatencyMs, Outcome};
use crate::phase::{begin, Observer, Phase};
use crate::quality::{Evidence, Saturation};
use crate::ready::Prepared;
use emulator_link::{Injection, Truth};
use force::controller::{ControlError, Controller, Input, Output, Reach};
use force::feasibility;
use force::metrics::Step;
use force::pose::PoseSource;
use nalgebra::Vector3;
use rig::Rig;
use session::{LatchedFault, Received, Session, SessionError, PERIOD};
use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use wire::message::{FaultReport, Status};
use wire::{Command, UNITS};

/// Period of the board's status, us (docs/protocol.md).
const STATUS_PERIOD_US: u32 = 50_000;

/// A run that is being held, and what it has collected so far.
pub(super) struct Hold<'a> {
    rig: &'a Rig,
    options: &'a Options,
    pub(super) observer: &'a mut dyn Observer,
    pose: PoseSource,
    controller: Controller,
    /// What is still to be injected, by time in s.
    injections: VecDeque<(f64, Injection)>,
    /// Units that were armed.
    armed: [bool; UNITS],
    /// Those that are left of them.
    available: [bool; UNITS],
    cycles: Cycles,
    faults: Vec<RunFault>,
    reach: Option<Reach>,
    samples: u64,
    /// Milliseconds in which the amplifiers had no power.
    amplifiers_off_ms: u64,
    latencies_us: Histogram,
    saturation: Saturation,
    /// Link time at which the force is commanded.
    t0_ns: Option<u64>,
    robot_moves: bool,
    /// When the board latched the fault that ended the run, s.
    fault_s: Option<f64>,
}

impl<'a> Hold<'a> {
    pub(super) fn new(
        rig: &'a Rig,
        options: &'a Options,
        observer: &'a mut dyn Observer,
        pose: PoseSource,
        injections: VecDeque<(f64, Injection)>,
        prepared: &Prepared,
    ) -> Result<Self, RunError> {
        Ok(Self {
            rig,
            options,
            observer,
            pose,
            controller: Controller::new(rig).map_err(ControlError::from)?,
            injections,
            armed: prepared.available,
            available: prepared.available,
            cycles: Cycles::new(options.commanded_n),
            faults: prepared.faults.clone(),
            reach: None,
            samples: 0,
            amplifiers_off_ms: 0,
            latencies_us: Histogram::default(),
            saturation: Saturation::default(),
            t0_ns: None,
            robot_moves: false,
            fault_s: None,
        })
    }

    /// Whether the board was armed.
    pub(super) const fn was_armed(&self) -> bool {
        self.t0_ns.is_some()
    }

    /// Units that still take part.
    pub(super) const fn available(&self) -> &[bool; UNITS] {
        &self.available
    }

    /// Arms, tensions, holds. `true`: ended early from outside.
    pub(super) fn run(&mut self, session: &mut Session<'_>) -> Result<bool, RunError> {
        check_stop(&self.options.stop)?;
        self.require_pose(session)?;
        begin(session, self.observer, Phase::Tension);
        session.command(&Command::Arm)?;
        let t0_ns = session.now_ns() + ((PRETENSION_S + ROBOT_START_S) * 1e9) as u64;
        self.t0_ns = Some(t0_ns);
        loop {
            let t_s = (session.now_ns() as f64 - t0_ns as f64) * 1e-9;
            if t_s >= self.options.hold_s {
                return Ok(false);
            }
            if self.options.stop.load(Ordering::Relaxed) {
                return Ok(true);
            }
            let (phase, fraction) = phase_at(t_s, self.options.hold_s);
            self.observer.progress(phase, fraction);
            self.control_rig(session, t_s)?;
            self.cycle(session, t_s)?;
        }
    }

    /// Waits for a pose that is received from now on, and checks that zero force is within reach
    /// there.
    fn require_pose(&mut self, session: &mut Session<'_>) -> Result<(), RunError> {
        let tip_m = fresh_pose(session, &mut self.pose, &self.options.stop, self.observer)?;
        require_zero_at(self.rig, tip_m, &self.available)
    }

    /// Starts the robot of an emulated rig and injects what is due.
    fn control_rig(&mut self, session: &mut Session<'_>, t_s: f64) -> Result<(), RunError> {
        let Some(controls) = session.link().controls() else {
            return Ok(());
        };
        if !self.robot_moves && self.options.robot_moves && t_s >= -ROBOT_START_S {
            self.robot_moves = true;
            controls.robot(true)?;
        }
        while let Some((_, injection)) = self.injections.pop_front_if(|(at_s, _)| *at_s <= t_s) {
            controls.inject(injection)?;
        }
        Ok(())
    }

    /// One cycle of 10 ms: compute, send while time passes, evaluate what arrived.
    fn cycle(&mut self, session: &mut Session<'_>, t_s: f64) -> Result<(), RunError> {
        let input = self.input(session, t_s)?;
        let output = self.controller.step(&input)?;
        if t_s >= 0.0 {
            self.note_reach(output.reach);
        }
        session.send_setpoints(output.setpoints, PERIOD)?;
        let received = session.drain();
        let end_s = t_s + PERIOD.as_secs_f64();
        let step = self.step_of(&output, &input, session, received.truth.last(), end_s);
        self.note_samples(&received, t_s);
        self.observer.step(&step);
        self.cycles.push(step);
        self.saturation.note_cycle(t_s, &output, self.rig);
        self.note_power(&received.truth, end_s);
        self.note_end(&received.faults, session, end_s);
        self.note_faults(&received.faults, session.status(), t_s)?;
        self.require_balance(&input)
    }

    /// An error where units have dropped out and the others cannot hold zero force at this tip.
    fn require_balance(&self, input: &Input) -> Result<(), RunError> {
        if self.available == input.available && self.available == self.armed {
            return Ok(());
        }
        let residual_n = match feasibility::residual_at(self.rig, input.tip_m, &self.available) {
            Ok(None) => return Ok(()),
            Ok(Some(residual_n)) => Ok(residual_n),
            Err(error) => Err(error),
        };
        let since_arming = |fault: &&RunFault| fault.t_s > -(PRETENSION_S + ROBOT_START_S);
        Err(UnitLost {
            units: (1..=UNITS as u8)
                .filter(|n| {
                    let i = usize::from(*n) - 1;
                    self.armed[i] && !self.available[i]
                })
                .collect(),
            residual_n,
            faults: (self.faults.iter().filter(since_arming).cloned()).collect(),
        }
        .into())
    }

    /// The controller's input: pose, tensions that are recent enough, commanded force.
    fn input(&mut self, session: &Session<'_>, t_s: f64) -> Result<Input, RunError> {
        let tip = self.pose.tip(session.tip_m(), session.now_ns());
        tell_of(&mut self.pose, self.observer);
        let (tip_m, moment) = tip?;
        Ok(Input {
            dt_s: PERIOD.as_secs_f64(),
            tip_m,
            // While a cable's slack is taken up its reel turns as no robot makes it.
            moment: moment.filter(|_| t_s >= -ROBOT_START_S),
            tension_n: session.recent_tension_n(),
            available: self.available,
            commanded_n: if t_s >= 0.0 {
                self.options.commanded_n
            } else {
                Vector3::zeros()
            },
        })
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
            tip_m: truth.map_or(input.tip_m, |truth| truth.tip_m.into()),
            commanded_n: output.slewed_n,
            estimated_n: output.applied_n,
            applied_n: truth.map(|truth| truth.tip_force_n.into()),
            tension_setpoint_n: output.allocation.tension_n,
            measured_tension_n,
            true_tension_n: truth.map(|truth| truth.tension_n),
            available: self.available,
        }
    }

    /// Keeps the worst reach, and reports a force that gets out of reach.
    fn note_reach(&mut self, reach: Reach) {
        let was_out = self.reach.is_some_and(|reach| !reach.feasible);
        if !reach.feasible && !was_out {
            self.observer.notice(&reach.describe());
        }
        if self
            .reach
            .is_none_or(|worst| reach.residual_n > worst.residual_n)
        {
            self.reach = Some(reach);
        }
    }

    /// Counts the time without amplifier power, and reports its beginning.
    fn note_power(&mut self, truth: &[Truth], end_s: f64) {
        let off_ms = truth.iter().filter(|truth| !truth.amplifier_on).count() as u64;
        if off_ms > 0 && self.amplifiers_off_ms == 0 {
            self.observer.notice(&format!(
                "at {end_s:.2} s the PLC cut the amplifiers' power (E-stop, or the board's alive line stopped)"
            ));
        }
        self.amplifiers_off_ms += off_ms;
    }

    fn note_samples(&mut self, received: &Received, t_s: f64) {
        self.observer.received(received);
        self.samples += received.samples.len() as u64;
        self.saturation.note_samples(t_s, &received.samples);
        if t_s >= 0.0 {
            let latencies_us = received.samples.iter().map(|timed| timed.sample.latency_us);
            latencies_us.for_each(|us| self.latencies_us.add(us));
        }
    }

    /// Keeps when the board latched a fault of its own, at the end of a cycle: from then on its
    /// motors are at 0 V, and the error is not that of a force that was held. A report has the time
    /// of the fault. A status has its own, and what it tells happened after the one before it.
    fn note_end(&mut self, faults: &[FaultReport], session: &Session<'_>, end_s: f64) {
        let of_board = |fault: &&FaultReport| usize::from(fault.unit) >= UNITS;
        let reported = faults.iter().find(of_board).map(|fault| fault.t_us);
        let told = || {
            let status = session.status().filter(|status| status.fault != 0)?;
            Some(status.t_us.wrapping_sub(STATUS_PERIOD_US))
        };
        if let Some(age_s) = reported.or_else(told).and_then(|t_us| session.age_s(t_us)) {
            self.fault_s = Some(end_s - age_s);
        }
    }

    /// Drops units that faulted; an error for a fault of the whole board.
    fn note_faults(
        &mut self,
        faults: &[FaultReport],
        status: Option<&Status>,
        t_s: f64,
    ) -> Result<(), RunError> {
        for fault in faults {
            let i = usize::from(fault.unit);
            if i >= UNITS {
                return Err(LatchedFault::from(fault).into());
            }
            if self.available[i] {
                self.drop_unit(i, fault.code, fault.detail, t_s);
            }
        }
        let Some(status) = status else {
            return Ok(());
        };
        // A report may be lost with its frame; the status holds the fault as well.
        if status.fault != 0 {
            return Err(LatchedFault::of_board(status).into());
        }
        for (i, unit) in status.units.iter().enumerate() {
            if self.available[i] && unit.fault != 0 {
                self.drop_unit(i, unit.fault, unit.fault_detail, t_s);
            }
        }
        Ok(())
    }

    /// Takes a unit (from 0) out of the allocation. The others continue.
    fn drop_unit(&mut self, i: usize, code: u16, detail: u32, t_s: f64) {
        self.available[i] = false;
        let fault = RunFault::of_unit(t_s, i, code, detail);
        self.observer
            .notice(&format!("unit {} dropped out: {}", i + 1, fault.text));
        self.faults.push(fault);
    }

    /// What the plant did while the rig was ramped down, a row for each control period.
    fn truth_rows<'t>(&self, truth: &'t [Truth]) -> impl Iterator<Item = Step> + use<'t> {
        let (t0_ns, available) = (self.t0_ns.unwrap_or(0), self.available);
        (truth.iter().step_by(PERIOD.as_millis() as usize)).map(move |truth| Step {
            t_s: (truth.t_ns as f64 - t0_ns as f64) * 1e-9,
            tip_m: truth.tip_m.into(),
            commanded_n: Vector3::zeros(),
            estimated_n: truth.tip_force_n.into(),
            applied_n: Some(truth.tip_force_n.into()),
            tension_setpoint_n: [0.0; UNITS],
            measured_tension_n: truth.tension_n,
            true_tension_n: Some(truth.tension_n),
            available,
        })
    }

    /// The run's outcome, after the board was disarmed. `stopped`: why it ended early; the link may
    /// be gone then, and what only the link knows is left out.
    pub(super) fn outcome(
        mut self,
        session: &mut Session<'_>,
        prepared: &Prepared,
        interrupted: bool,
        stopped: Option<&str>,
    ) -> Result<Outcome, SessionError> {
        let last = session.drain();
        self.note_samples(&last, f64::NEG_INFINITY);
        let status = match stopped {
            None => Some(session.get_status()?),
            Some(_) => session.status().cloned(),
        };
        let report = match session.link().controls().map(|controls| controls.report()) {
            Some(Err(error)) if stopped.is_none() => return Err(error.into()),
            report => report.and_then(Result::ok),
        };
        let latency_ms = self
            .t0_ns
            .and_then(|t0_ns| LatencyMs::of(report.as_ref(), t0_ns, &self.latencies_us));
        let ramped = self.truth_rows(if stopped.is_some() { &last.truth } else { &[] });
        let (metrics, steady, mut rows) = self.cycles.end(self.fault_s);
        rows.steps.extend(ramped);
        let uncertainty = (self.rig.calibration.as_deref())
            .and_then(|record| steady.uncertainty(record, self.rig.pose_sd_m));
        let amplifiers_off_s = self.amplifiers_off_ms as f64 * 1e-3;
        let not_injected: Vec<_> = self.injections.into();
        let shortfalls = Evidence {
            rig: self.rig,
            interrupted,
            steps: &rows.steps,
            whole_from: rows.whole_from,
            metrics: metrics.as_ref(),
            faults: &self.faults,
            reach: self.reach.as_ref(),
            amplifiers_off_s,
            saturation: &self.saturation,
            not_injected: &not_injected,
            stopped,
        }
        .judge();
        Ok(Outcome {
            ended: Ended::of(stopped.is_some(), interrupted, !shortfalls.is_empty()),
            shortfalls,
            firmware: session
                .info()
                .map_or_else(String::new, |info| info.version.as_str().to_owned()),
            rig_hash: self.rig.hash(),
            config_crc: prepared.config_crc,
            commanded_n: self.options.commanded_n,
            metrics,
            uncertainty,
            reach: self.reach,
            faults: self.faults,
            latency_ms,
            samples_lost: status
                .map_or(0, |status| prepared.samples_lost(report.as_ref(), &status)),
            samples: self.samples,
            link_counters: session.counters(),
            amplifiers_off_s,
            steps: rows.steps,
            report,
            configs: prepared.configs,
            link: session.link().name(),
        })
    }
}

/// The phase at a time (0: the force is commanded), and the fraction of it that is over.
fn phase_at(t_s: f64, hold_s: f64) -> (Phase, f64) {
    if t_s < -ROBOT_START_S {
        (
            Phase::Tension,
            (t_s + PRETENSION_S + ROBOT_START_S) / PRETENSION_S,
        )
    } else if t_s < 0.0 {
        (Phase::StartRobot, (t_s + ROBOT_START_S) / ROBOT_START_S)
    } else {
        (Phase::Hold, t_s / hold_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_follow_each_other_and_fill_up() {
        for (t_s, phase, fraction) in [
            (-2.5, Phase::Tension, 0.0),
            (-2.0, Phase::Tension, 0.5),
            (-1.5, Phase::StartRobot, 0.0),
            (-0.75, Phase::StartRobot, 0.5),
            (0.0, Phase::Hold, 0.0),
            (3.0, Phase::Hold, 0.75),
        ] {
            assert_eq!(phase_at(t_s, 4.0), (phase, fraction), "{t_s}");
        }
    }
}

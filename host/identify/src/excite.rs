//! The excitation: cables driven with open loops while the robot moves, and what makes that safe.

use super::recording::{Recording, Sampled};
use control::cell::CellForce;
use force::pose::PoseSource;
use nalgebra::Vector3;
use rig::{Rig, UnitSettings};
use run::{ArgumentError, Fault, Observer, Phase, Prepared, RunError};
use session::link::RigLink;
use session::{LatchedFault, Received, Session, PERIOD};
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use wire::message::{Status, UnitSetpoint};
use wire::{Command, UNITS};

/// For how long the cables are tensioned before the robot moves, s.
const PRETENSION_S: f64 = 1.0;
/// Time from then until samples are used, s: longer than the robot's soft start.
const SETTLE_S: f64 = 1.5;
/// Distance of the commands from the tensions that the rig file allows, N.
const MARGIN_N: f64 = 1.0;
/// Largest amplitude of the commands, N. Six cables out of step, and their friction, make 8 N at
/// the tip with it.
const MAX_AMPLITUDE_N: f64 = 1.5;
/// Smallest amplitude of the commands, N: a smaller one shows nothing.
const MIN_AMPLITUDE_N: f64 = 0.5;
/// Part of the largest swing with which a session begins again that a fault 45 ended: the smallest
/// commands, up to 2 N above the least tension. An amplifier whose gain is off by 30 % is then off
/// by 1.2 N at most, which the board permits.
pub const SMALL_SWING: f64 = MIN_AMPLITUDE_N / MAX_AMPLITUDE_N;
/// Part of the rig file's force limit above which the swing is reduced. The rest is for the force's
/// growth until the reduction takes effect.
const EASE_ABOVE: f64 = 0.85;
/// Factor on the swing for each setpoint period (10 ms) above that: one half after 0.23 s.
const EASE_PER_CYCLE: f64 = 0.97;
/// Frequencies of the first unit's sines, Hz; each unit's are 6 % above those of the one before.
const SINES_HZ: [f64; 5] = [0.11, 0.27, 0.63, 1.37, 2.90];
/// Shortest and longest session, s.
pub(super) const MIN_SESSION_S: f64 = 8.0;
const MAX_SESSION_S: f64 = 600.0;

/// Drives the cables with the loops open and records the samples. The commands begin with this part
/// of the largest swing, [`SMALL_SWING`] to 1.
///
/// # Errors
/// [`RunError`]; the rig was made safe as far as the link allowed. Any fault ends the session: a
/// part of it can't be analysed.
pub fn excite(
    link: &mut dyn RigLink,
    rig: &Rig,
    seconds: f64,
    swing: f64,
    zeroing: &run::Zeroing,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Recording, RunError> {
    let open = opened(rig, seconds)?;
    let pose = PoseSource::open(&rig.pose)?;
    let mut session = run::connect(link, observer)?;
    let prepared = run::ready_board(&mut session, &open, zeroing, stop, observer)?;
    let mut excitation = Excitation {
        rig,
        prepared: &prepared,
        pose,
        swing,
        cells: prepared.configs.each_ref().map(CellForce::new),
        samples: Vec::new(),
    };
    let result = excitation.run(&mut session, seconds, stop, observer);
    match result {
        Ok(()) => {
            observer.progress(Phase::Disarm, 0.0);
            if let Err(error) = run::ramp_down_and_disarm(&mut session, &prepared.available) {
                run::make_safe(&mut session, rig, observer);
                return Err(error.into());
            }
            Ok(Recording {
                samples: excitation.samples,
                configs: prepared.configs,
                available: prepared.available,
                swing: excitation.swing,
            })
        }
        Err(error) => {
            run::make_safe(&mut session, rig, observer);
            Err(error)
        }
    }
}

/// Checks the length of a session and the rig's tensions before anything is driven.
///
/// # Errors
/// The session is too short or too long, or a unit's tensions leave no range for it.
pub fn check(rig: &Rig, seconds: f64) -> Result<(), RunError> {
    opened(rig, seconds).map(|_| ())
}

/// The rig with the tension loops open: the command is the setpoint.
fn opened(rig: &Rig, seconds: f64) -> Result<Rig, RunError> {
    if !(MIN_SESSION_S..=MAX_SESSION_S).contains(&seconds) {
        return Err(ArgumentError::Excitation {
            seconds,
            min_s: MIN_SESSION_S,
            max_s: MAX_SESSION_S,
        }
        .into());
    }
    let open = rig.with_open_loops();
    for unit in &open.units {
        if unit.enabled && sines(unit, 1.0).1 < MIN_AMPLITUDE_N {
            return Err(ArgumentError::Range {
                unit: unit.number,
                min_n: unit.tension_min_n,
                max_n: unit.tension_max_n,
                least_n: 2.0 * (MARGIN_N + MIN_AMPLITUDE_N),
            }
            .into());
        }
    }
    Ok(open)
}

/// The swing at this force at the tip: less near the force limit; an error above it. It never
/// grows: a command that follows the force is feedback, which the analysis would take for drive.
fn eased(swing: f64, force_n: f64, limit_n: f64) -> Result<f64, RunError> {
    if force_n > limit_n {
        return Err(Fault::AboveLimit { force_n, limit_n }.into());
    }
    Ok(if force_n > EASE_ABOVE * limit_n {
        (swing * EASE_PER_CYCLE).max(SMALL_SWING)
    } else {
        swing
    })
}

/// Middle and amplitude of a unit's commands, N, with this part of the largest swing.
fn sines(unit: &UnitSettings, swing: f64) -> (f64, f64) {
    let low = unit.tension_min_n + MARGIN_N;
    let max = (0.5 * (unit.tension_max_n - MARGIN_N - low)).min(MAX_AMPLITUDE_N);
    let amplitude = (swing * max).max(max.min(MIN_AMPLITUDE_N));
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

/// A session that is being driven.
struct Excitation<'a> {
    rig: &'a Rig,
    prepared: &'a Prepared,
    pose: PoseSource,
    /// Part of the amplitude that is left.
    swing: f64,
    /// Forces on the cells, from the arming on.
    cells: [CellForce; UNITS],
    samples: Vec<Sampled>,
}

/// Setpoints of a cycle, 1/cos of each unit, and the force at the tip by the measured tensions.
struct Cycle {
    setpoints: [UnitSetpoint; UNITS],
    inv_cos: [f64; UNITS],
    force_n: Vector3<f64>,
}

impl Excitation<'_> {
    fn run(
        &mut self,
        session: &mut Session<'_>,
        seconds: f64,
        stop: &AtomicBool,
        observer: &mut dyn Observer,
    ) -> Result<(), RunError> {
        // A pose of the time before the preparation is old.
        run::fresh_pose(session, &mut self.pose, stop, observer)?;
        run::begin(session, observer, Phase::Tension);
        session.command(&Command::Arm)?;
        let start_ns = session.now_ns();
        let mut moving = false;
        loop {
            let t_s = (session.now_ns() - start_ns) as f64 * 1e-9 - PRETENSION_S;
            if t_s >= SETTLE_S + seconds {
                return Ok(());
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
            let cycle = self.setpoints(session, t_s);
            run::tell_of(&mut self.pose, observer);
            let cycle = cycle?;
            let limit_n = self.rig.controller.force_limit_n;
            self.swing = eased(self.swing, cycle.force_n.norm(), limit_n)?;
            session.send_setpoints(cycle.setpoints, PERIOD)?;
            let received = session.drain();
            observer.received(&received);
            self.check_faults(&received, session.status())?;
            for timed in &received.samples {
                let unit = usize::from(timed.sample.unit).min(UNITS - 1);
                // Also of the time before: the cells creep from the first load on.
                let cell_n = self.cells[unit].at(timed.sample.adc_code, timed.t_us);
                if t_s >= SETTLE_S {
                    self.samples.push(Sampled {
                        timed: *timed,
                        cell_n,
                        inv_cos: cycle.inv_cos[unit],
                    });
                }
            }
            let (phase, part) = phase_at(t_s, seconds);
            observer.progress(phase, part.clamp(0.0, 1.0));
        }
    }

    /// The setpoints at a time (0: the robot starts), for the cables' directions at the tip's pose.
    fn setpoints(&mut self, session: &Session<'_>, t_s: f64) -> Result<Cycle, RunError> {
        let tip_m = self
            .pose
            .tip_m(session.pose().map(|pose| pose.position_m.into()))?;
        let workspace = &self.rig.workspace;
        let off_m = (tip_m - workspace.center_m).norm();
        if off_m.is_nan() || off_m > workspace.radius_m {
            return Err(Fault::OutsideWorkspace {
                off_m,
                radius_m: workspace.radius_m,
            }
            .into());
        }
        let mut cycle = Cycle {
            setpoints: [UnitSetpoint {
                tension_un: 0,
                inv_cos_q16: 1 << 16,
                direction_q14: [0; 3],
                reel_um_per_s: None,
            }; UNITS],
            inv_cos: [1.0; UNITS],
            force_n: Vector3::zeros(),
        };
        for (i, unit) in self.rig.units.iter().enumerate() {
            if !self.prepared.available[i] {
                continue;
            }
            let cable = unit.cable_at(tip_m);
            let q16 = cable.and_then(|(_, cos)| control::geometry::inv_cos_q16(cos));
            let (Some((direction, _)), Some(q16)) = (cable, q16) else {
                return Err(Fault::Angle { unit: unit.number }.into());
            };
            if let Some((tension, _)) = session.tension_n()[i] {
                cycle.force_n += direction * tension;
            }
            cycle.inv_cos[i] = f64::from(q16) / 65_536.0;
            cycle.setpoints[i] = UnitSetpoint {
                tension_un: unit.setpoint_un(command_n(unit, i, t_s, self.swing)),
                inv_cos_q16: q16,
                direction_q14: control::geometry::direction_q14(&direction),
                reel_um_per_s: None,
            };
        }
        Ok(cycle)
    }

    /// An error for any fault of the board or of a unit that takes part.
    fn check_faults(&self, received: &Received, status: Option<&Status>) -> Result<(), RunError> {
        let reported = received.faults.first().map(LatchedFault::from);
        let in_status =
            || status.and_then(|status| LatchedFault::first_of(status, &self.prepared.available));
        match reported.or_else(in_status) {
            Some(fault) => Err(fault.into()),
            None => Ok(()),
        }
    }
}

/// The phase at a time (0: the robot starts), and the fraction of it that is over.
fn phase_at(t_s: f64, seconds: f64) -> (Phase, f64) {
    if t_s < SETTLE_S {
        (
            Phase::Tension,
            (t_s + PRETENSION_S) / (PRETENSION_S + SETTLE_S),
        )
    } else {
        (Phase::Excite, (t_s - SETTLE_S) / seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use emulator_link::Injection;
    use run::NoopObserver;
    use session::link::fake::{Behavior, FakeBoard};

    fn rig() -> Rig {
        Rig::built_in().unwrap()
    }

    #[test]
    fn a_session_that_faults_ends_disarmed_and_says_why() {
        let stop = AtomicBool::new(false);
        let mut board = FakeBoard::new(Behavior::Good);
        board
            .controls()
            .unwrap()
            .inject(Injection::EStop(true))
            .unwrap();
        let error = excite(
            &mut board,
            &rig(),
            10.0,
            1.0,
            &run::Zeroing::Measure,
            &stop,
            &mut NoopObserver,
        )
        .unwrap_err();
        assert!(error.to_string().contains("E-stop"), "{error}");
        assert!(!board.system.drives());
    }

    #[test]
    fn nothing_is_driven_without_time_or_range() {
        let stop = AtomicBool::new(false);
        let mut board = FakeBoard::new(Behavior::Good);
        for seconds in [f64::NAN, 1.0, 1e6] {
            let result = excite(
                &mut board,
                &rig(),
                seconds,
                1.0,
                &run::Zeroing::Measure,
                &stop,
                &mut NoopObserver,
            );
            assert!(matches!(result, Err(RunError::Argument(_))), "{seconds}");
        }
        let mut narrow = rig();
        narrow.units[3].tension_max_n = 4.5;
        let error = excite(
            &mut board,
            &narrow,
            10.0,
            1.0,
            &run::Zeroing::Measure,
            &stop,
            &mut NoopObserver,
        )
        .unwrap_err();
        assert!(error.to_string().contains("unit 4"), "{error}");
        assert!(board.commands.is_empty());
    }

    #[test]
    fn the_swing_falls_near_the_force_limit_and_ends_above_it() {
        assert_eq!(eased(1.0, 10.1, 12.0).unwrap(), 1.0);
        assert_eq!(eased(1.0, 10.3, 12.0).unwrap(), 0.97);
        assert_eq!(eased(SMALL_SWING, 11.9, 12.0).unwrap(), SMALL_SWING);
        assert!(eased(1.0, 12.1, 12.0).is_err());
    }

    #[test]
    fn commands_stay_inside_the_tensions_of_the_rig_file() {
        for (i, unit) in rig().units.iter().enumerate() {
            for n in 0..20_000 {
                let swing = 1.0 - f64::from(n) / 20_000.0;
                let command = command_n(unit, i, f64::from(n) * 0.003, swing);
                assert!(command >= unit.tension_min_n + MARGIN_N - 1e-9);
                assert!(command <= unit.tension_max_n - MARGIN_N + 1e-9);
            }
        }
    }
}

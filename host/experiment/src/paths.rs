//! Both control paths of the thesis on one plant: the dedicated board (3.6.2), and the Raven's
//! software (3.6.1).
//!
//! `raven`: the loop on the host (`raven`).
//!
//! `board`: the same control law on the board, one unit at a time, with the DAC's resolution.
//!
//! Plant, noise, robot path, force controller and gains are the same; tensions are the plant's.

use super::raven::{RavenLoop, RAVEN_CYCLE, REEL_RADIUS_M};
use force::controller::{ControlError, Controller as ForceController, Input as ForceInput};
use force::preview::Moment;
use nalgebra::Vector3;
use rig::Rig;
use run::{ready_board, NoopObserver, Prepared, RunError, Zeroing};
use serde::Serialize;
use session::link::fast::FastRig;
use session::{LatchedFault, Received, Session, TimedSample};
use std::sync::atomic::AtomicBool;
use wire::{Command, UNITS};

/// Cycles of the force controller, in cycles of the Raven's loop.
const FORCE_EVERY: u64 = 10;
/// Time for tensioning and for the robot's start before the force is commanded, s.
const LEAD_S: f64 = 2.5;
/// When the robot starts to move, s before the force is commanded.
const ROBOT_START_S: f64 = 1.5;
/// From here on errors count, s after the command.
const STEADY_AFTER_S: f64 = 1.0;

/// A control path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "path", rename_all = "snake_case")]
pub enum Path {
    /// The loop on the board.
    Board,
    /// The loop on the host, torques through the Raven's software.
    Raven {
        /// Delay of samples and torques on their way together, ms: ROS and USB, without the serial
        /// line (emulated) and the wait for the next cycle of 1 ms.
        transport_ms: u32,
    },
}

/// How a path did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathFigures {
    /// Which.
    #[serde(flatten)]
    pub path: Path,
    /// From a sample's DRDY edge to the amplifier's input, ms: median.
    pub latency_p50_ms: f64,
    /// 99th percentile.
    pub latency_p99_ms: f64,
    /// Step of the cable force that the path can command, N.
    pub resolution_n: f64,
    /// RMS of true tension less setpoint per cable, N.
    pub tension_rms_n: [f64; UNITS],
    /// RMS of the force error at the tip, N.
    pub force_rms_n: f64,
    /// Why it ended early.
    pub stopped: Option<String>,
}

impl PathFigures {
    /// Tension error of the worst cable, N.
    #[must_use]
    pub fn worst_tension_rms_n(&self) -> f64 {
        self.tension_rms_n.iter().copied().fold(0.0, f64::max)
    }
}

/// Holds a force at the moving tip for `seconds` over one path.
///
/// # Errors
/// [`RunError`] where the rig can't be made ready.
pub fn hold(
    path: Path,
    rig: &Rig,
    commanded_n: Vector3<f64>,
    seconds: f64,
    seed: u64,
) -> Result<PathFigures, RunError> {
    let mut link = FastRig::with(core_sim::Options {
        seed,
        ..core_sim::Options::default()
    })?;
    let mut session = Session::connect(&mut link)?;
    let stop = AtomicBool::new(false);
    let prepared = ready_board(
        &mut session,
        rig,
        &Zeroing::Measure,
        &stop,
        &mut NoopObserver,
    )?;
    let mut hold = Hold::new(path, rig, commanded_n, &prepared)?;
    let stopped = hold.run(&mut session, seconds).err();
    if path == Path::Board {
        session.make_safe();
    } else if let Some(controls) = session.link().controls() {
        controls.drive_outside(Some([0.0; UNITS]))?;
    }
    Ok(hold.figures(rig, stopped.map(|error| error.to_string())))
}

struct Hold<'a> {
    path: Path,
    commanded_n: Vector3<f64>,
    prepared: &'a Prepared,
    force: ForceController,
    raven: RavenLoop,
    tension_n: [f64; UNITS],
    latencies_us: Vec<f64>,
    tension_square: [f64; UNITS],
    force_square: f64,
    rows: u64,
}

impl<'a> Hold<'a> {
    fn new(
        path: Path,
        rig: &Rig,
        commanded_n: Vector3<f64>,
        prepared: &'a Prepared,
    ) -> Result<Self, RunError> {
        Ok(Self {
            path,
            commanded_n,
            prepared,
            force: ForceController::new(rig).map_err(ControlError::from)?,
            raven: RavenLoop::new(rig, &prepared.configs)?,
            tension_n: [0.0; UNITS],
            latencies_us: Vec::new(),
            tension_square: [0.0; UNITS],
            force_square: 0.0,
            rows: 0,
        })
    }

    fn run(&mut self, session: &mut Session<'_>, seconds: f64) -> Result<(), RunError> {
        if self.path == Path::Board {
            session.command(&Command::Arm)?;
        }
        let cycles = ((LEAD_S + seconds) / RAVEN_CYCLE.as_secs_f64()).round() as u64;
        let mut moving = false;
        for cycle in 0..cycles {
            let t_s = cycle as f64 * RAVEN_CYCLE.as_secs_f64() - LEAD_S;
            if !moving && t_s >= -ROBOT_START_S {
                moving = true;
                if let Some(controls) = session.link().controls() {
                    controls.robot(true)?;
                }
            }
            if cycle % FORCE_EVERY == 0 {
                self.allocate(session, t_s)?;
            }
            session.exchange(RAVEN_CYCLE)?;
            let received = session.drain();
            if let Some(fault) = received.faults.first() {
                return Err(LatchedFault::new(fault.code, fault.detail).into());
            }
            match self.path {
                Path::Board => {
                    let latency = |timed: &TimedSample| f64::from(timed.sample.latency_us);
                    self.latencies_us
                        .extend(received.samples.iter().map(latency));
                }
                Path::Raven { transport_ms } => {
                    self.latencies_us.extend(self.raven.cycle(
                        session,
                        &received.samples,
                        transport_ms,
                    )?);
                }
            }
            self.judge(&received, t_s);
        }
        Ok(())
    }

    /// Tensions for the commanded force, at 100 Hz.
    fn allocate(&mut self, session: &mut Session<'_>, t_s: f64) -> Result<(), RunError> {
        let tip_m = session
            .pose()
            .map_or_else(Vector3::zeros, |pose| pose.position_m.into());
        let output = self.force.step(&ForceInput {
            dt_s: RAVEN_CYCLE.as_secs_f64() * FORCE_EVERY as f64,
            tip_m,
            moment: (session.tip_m().filter(|_| t_s >= -ROBOT_START_S)).map(|(_, at_ns)| Moment {
                tip_s: at_ns as f64 * 1e-9,
                now_s: session.now_ns() as f64 * 1e-9,
            }),
            tension_n: session.tension_n().map(|t| t.map(|(tension, _)| tension)),
            available: self.prepared.available,
            commanded_n: if t_s >= 0.0 {
                self.commanded_n
            } else {
                Vector3::zeros()
            },
        })?;
        self.tension_n = output.allocation.tension_n;
        if self.path == Path::Board {
            session.set_setpoints(Some(output.setpoints));
        } else {
            self.raven.set(output.setpoints);
        }
        Ok(())
    }

    fn judge(&mut self, received: &Received, t_s: f64) {
        let Some(truth) = received.truth.last().filter(|_| t_s >= STEADY_AFTER_S) else {
            return;
        };
        self.rows += 1;
        for (sum, (real, wanted)) in
            (self.tension_square.iter_mut()).zip(truth.tension_n.iter().zip(self.tension_n))
        {
            *sum += (real - wanted).powi(2);
        }
        let force = Vector3::from(truth.tip_force_n);
        self.force_square += (force - self.commanded_n).norm_squared();
    }

    fn figures(mut self, rig: &Rig, stopped: Option<String>) -> PathFigures {
        self.latencies_us.sort_by(f64::total_cmp);
        let quantile = |q: f64| {
            let last = self.latencies_us.len().saturating_sub(1) as f64;
            self.latencies_us
                .get((q * last).round() as usize)
                .map_or(f64::NAN, |us| us * 1e-3)
        };
        let root = |sum: f64| (sum / self.rows.max(1) as f64).sqrt();
        PathFigures {
            path: self.path,
            latency_p50_ms: quantile(0.5),
            latency_p99_ms: quantile(0.99),
            resolution_n: match self.path {
                Path::Board => rig.units[0].dac_codes_per_n.recip(),
                Path::Raven { .. } => 1e-3 / REEL_RADIUS_M,
            },
            tension_rms_n: self.tension_square.map(root),
            force_rms_n: root(self.force_square),
            stopped,
        }
    }
}

/// The table of several paths, Markdown.
#[must_use]
pub fn table(figures: &[PathFigures]) -> String {
    let mut text = String::from(
        "| path | latency, median | latency, 99 % | step of the cable force | tension error, worst cable (RMS) | force error at the tip (RMS) |\n\
         | --- | --- | --- | --- | --- | --- |\n",
    );
    for f in figures {
        let name = match f.path {
            Path::Board => "board".to_owned(),
            Path::Raven { transport_ms } => format!("raven, transport {transport_ms} ms"),
        };
        text.push_str(&format!(
            "| {name} | {:.2} ms | {:.2} ms | {:.4} N | {:.3} N | {:.3} N |\n",
            f.latency_p50_ms,
            f.latency_p99_ms,
            f.resolution_n,
            f.worst_tension_rms_n(),
            f.force_rms_n
        ));
        if let Some(why) = &f.stopped {
            text.push_str(&format!("\nstopped early ({name}): {why}\n"));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_board_is_faster_finer_and_nearer_to_its_setpoints_than_the_raven_s_software() {
        let rig = Rig::built_in().unwrap();
        let of = |path| hold(path, &rig, Vector3::new(0.0, 2.5, 0.0), 4.0, 1).unwrap();
        let board = of(Path::Board);
        let raven = of(Path::Raven { transport_ms: 1 });
        assert_eq!((&board.stopped, &raven.stopped), (&None, &None));
        assert!(
            board.latency_p50_ms < 0.5 && raven.latency_p50_ms > 2.0,
            "{board:?} {raven:?}"
        );
        assert!((raven.resolution_n - 0.1).abs() < 1e-12);
        assert!(board.worst_tension_rms_n() < 0.1, "{board:?}");
        assert!(raven.worst_tension_rms_n() > board.worst_tension_rms_n());
        // It does pull: a path that commanded nothing would be off by all of 2 N.
        assert!(raven.worst_tension_rms_n() < 1.0, "{raven:?}");
    }
}

//! `monitor --estimate`: the force that a model tells of the robot's state, beside that of the load
//! cells. It is shown and not published; `estimate run` publishes.

use super::model::Estimated;
use super::source::{Event, Update};
use super::SILENT;
use crate::cli::estimate::live::MISFITS;
use crate::cli::estimate::robot::{Heard, Robot};
use crate::cli::exit::Result;
use estimator::estimator::Estimator;
use estimator::stream::Stream;
use std::path::Path;
use std::time::Instant;

/// A model that follows the robot beside the rig.
pub struct Estimating<'a> {
    stream: Stream<'a>,
    /// `None` once it was lost.
    robot: Option<Robot<'a>>,
    /// When the last row came; `None` after a silence.
    came: Option<Instant>,
    misfits: bool,
}

impl<'a> Estimating<'a> {
    /// Opens the source of the robot's states.
    ///
    /// # Errors
    /// Those of [`Robot::open`].
    pub fn open(estimator: &'a Estimator, file: &Path, any_robot: bool) -> Result<Self> {
        Ok(Self {
            stream: Stream::new(estimator),
            robot: Some(Robot::open(estimator, file, any_robot)?),
            came: None,
            misfits: false,
        })
    }

    /// What is new, at the rig's time `t_s`. A robot that is lost ends the estimates and not the
    /// view, from which the rig can be stopped.
    pub fn next(&mut self, t_s: f64) -> Vec<Update> {
        let Some(robot) = &mut self.robot else {
            return Vec::new();
        };
        let event = |kind: &str, text: String| {
            Update::Event(Event {
                t_s,
                kind: kind.to_owned(),
                text,
                ..Event::default()
            })
        };
        let heard = match robot.poll() {
            Ok(heard) => heard,
            Err(failure) => {
                self.robot = None;
                let text = format!("no more estimates: {}", failure.message);
                return vec![event("robot", text), Update::Estimate(Estimated::Silent)];
            }
        };
        let mut out = Vec::new();
        let mut last = None;
        for heard in heard {
            match heard {
                Heard::Note(text) => out.push(event("robot", text)),
                Heard::Anew => self.stream.reset(),
                Heard::Gap(elapsed_s) => self.stream.gap(elapsed_s),
                Heard::Row(_, input) => {
                    let sure = self.stream.step(&input);
                    if sure.misfits != self.misfits {
                        self.misfits = sure.misfits;
                        let (kind, text) = if sure.misfits {
                            ("misfit", MISFITS)
                        } else {
                            ("robot", "the model fits the robot again")
                        };
                        out.push(event(kind, text.to_owned()));
                    }
                    last = Some(sure);
                }
            }
        }
        if let Some(sure) = last {
            self.came = Some(Instant::now());
            let mut force_n = [None; 3];
            for (axis, force) in (self.stream.estimator().axes.iter()).zip(self.stream.force()) {
                force_n[*axis] = Some(f64::from(*force));
            }
            out.push(Update::Estimate(Estimated::Force {
                force_n,
                half_n: sure.half_n,
                valid: sure.usable(),
                misfits: sure.misfits,
            }));
        } else if self.came.is_some_and(|came| came.elapsed() > SILENT) {
            self.came = None;
            out.push(Update::Estimate(Estimated::Silent));
        }
        out
    }
}

//! `forcectl estimate run`: a force for each row, as the rows come.

use super::{check_robot, mapping, model};
use crate::cli::exit::{self, Failure, Reply, Result};
use crate::cli::Context;
use clap::Args;
use estimate::load;
use estimate::pace::{Anew, Pace, Take};
use estimator::estimator::Estimator;
use estimator::interval::Live as Width;
use estimator::model::Stepper;
use estimator::motion::INPUTS;
use nalgebra::Vector3;
use robot::source::{self, SourceConfig};
use robot::state::{Acts, Frame, Meaning, RobotState, TipForce};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Between two looks at the source.
const LOOK: Duration = Duration::from_millis(1);

/// Arguments of `estimate run`.
#[derive(Debug, Args)]
pub struct Live {
    /// Model file
    model: PathBuf,
    /// Log to read in place of a robot: each row in turn, as fast as it goes
    #[arg(
        long,
        value_name = "FILE",
        required_unless_present = "robot",
        conflicts_with = "robot"
    )]
    replay: Option<PathBuf>,
    /// File with the `[robot]` table that names the source of states
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Print every N-th row
    #[arg(long, value_name = "N", default_value = "5", value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// End after this time of rows, s
    #[arg(long, value_name = "SECONDS")]
    duration: Option<f64>,
    /// Use the model although it was trained on another robot
    #[arg(long)]
    any_robot: bool,
    /// Mapping file (TOML) of the log
    #[arg(long, value_name = "FILE", requires = "replay")]
    mapping: Option<PathBuf>,
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// The model on a stream, with what is printed of it.
struct Stream<'a> {
    estimator: &'a Estimator,
    stepper: Box<dyn Stepper + 'a>,
    width: Option<Width<'a>>,
    force: Vec<f32>,
    times_us: Vec<f64>,
    /// Times that the past was forgotten.
    anew: usize,
}

impl<'a> Stream<'a> {
    fn new(estimator: &'a Estimator) -> Self {
        Self {
            estimator,
            stepper: estimator.model().stepper(),
            width: Self::width(estimator),
            force: vec![0.0; estimator.axes.len()],
            times_us: Vec::new(),
            anew: 0,
        }
    }

    fn width(estimator: &'a Estimator) -> Option<Width<'a>> {
        let interval = estimator.interval.as_ref();
        interval.map(|i| i.live(estimator.step_s))
    }

    /// Forgets the past: what the friction's state was before a break is not what it is after it.
    fn reset(&mut self) {
        self.stepper.reset();
        self.width = Self::width(self.estimator);
        self.anew += 1;
    }

    /// Takes a row; force, N, and the half width of its interval, N.
    fn step(&mut self, input: &[f32]) -> Option<f64> {
        let began = Instant::now();
        self.stepper.step(input, &mut self.force);
        let width = self.width.as_mut().map(|w| w.step(input));
        self.times_us.push(began.elapsed().as_secs_f64() * 1e6);
        width
    }

    fn line(&self, time_s: f64, width: Option<f64>) -> String {
        let mut line = format!("{time_s:10.3}");
        for (axis, force) in self.estimator.axes.iter().zip(&self.force) {
            line += &format!("  {} {force:7.3} N", AXES[*axis]);
        }
        if let Some(width) = width {
            line += &format!("  +- {width:.3}");
        }
        line
    }

    fn done(mut self) -> Reply {
        self.times_us.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = self.times_us.len().saturating_sub(1);
            self.times_us
                .get(((self.times_us.len() as f64 * share) as usize).min(last))
                .copied()
                .unwrap_or(0.0)
        };
        let (rows, median, p99) = (self.times_us.len(), at(0.5), at(0.99));
        let anew = self.anew;
        Reply::new(
            format!("{rows} rows, begun anew {anew} times; a step takes {median:.1} us (median), {p99:.1} us (p99)\n"),
            json!({"rows": rows, "begun_anew": anew, "median_us": median, "p99_us": p99}),
        )
    }
}

impl Live {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let estimator = model(&self.model)?;
        match (&self.replay, &self.robot) {
            (Some(log), _) => self.replay(context, &estimator, log),
            (None, Some(file)) => self.live(context, &estimator, file),
            (None, None) => Err(Failure::usage("give --replay FILE or --robot FILE")),
        }
    }

    fn replay(&self, context: &Context, estimator: &Estimator, log: &Path) -> Result<Reply> {
        let mut data = load::load(
            log,
            &mapping(self.mapping.as_ref())?,
            1.0 / estimator.step_s,
            false,
        )?;
        // A log alone names no robot; a data card beside it, or a mapping, does.
        if data.robot == load::UNNAMED && estimator.robot != data.robot {
            context.output.note(&format!(
                "{}: neither a data card nor a mapping file names the robot of this log; the model is of `{}`, and on another robot its forces are wrong",
                data.name, estimator.robot
            ));
        } else {
            check_robot(estimator, &data.robot, self.any_robot)?;
        }
        data.fit_inputs(estimator).map_err(Failure::usage)?;
        let mut stream = Stream::new(estimator);
        for (number, sequence) in data.sequences.iter().enumerate() {
            if number > 0 {
                stream.reset();
            }
            for k in 0..sequence.rows() {
                let time_s = sequence.start_s + k as f64 * sequence.step_s;
                if context.interrupt.requested()
                    || self
                        .duration
                        .is_some_and(|d| k as f64 * sequence.step_s >= d)
                {
                    break;
                }
                let width = stream.step(sequence.input_row(k));
                if k % self.every as usize == 0 && !context.output.json() {
                    context.output.line(&stream.line(time_s, width));
                }
            }
        }
        Ok(stream.done())
    }

    fn live(&self, context: &Context, estimator: &Estimator, file: &Path) -> Result<Reply> {
        let config = robot_table(file)?;
        let name = match &config {
            SourceConfig::Virtual(_) => {
                return Err(Failure::usage("the virtual arm lives inside a run of `forcectl experiment run`; estimate from its dataset with --replay"));
            }
            SourceConfig::CrtkRos1(c) => format!("crtk-ros1 {}", c.namespace),
            SourceConfig::Udp(c) => format!("udp {}", c.listen),
            SourceConfig::CrtkRos2(_) | SourceConfig::Static(_) => String::new(),
        };
        check_robot(estimator, &name, self.any_robot)?;
        let mut source = source::open(&config).map_err(|error| Failure::new(exit::LINK, error))?;
        let mut stream = Stream::new(estimator);
        let began = Instant::now();
        let mut pace = Pace::new(estimator.step_s);
        let mut gap_noted = false;
        let mut told = String::new();
        let _controlled_stop = context.interrupt.controlled_stop();
        while !context.interrupt.requested()
            && self
                .duration
                .is_none_or(|d| began.elapsed().as_secs_f64() < d)
        {
            let now_ns = i64::try_from(began.elapsed().as_nanos()).unwrap_or(i64::MAX);
            let poll = source
                .poll(now_ns)
                .map_err(|error| Failure::new(exit::LINK, error))?;
            for text in poll.events.iter().map(ToString::to_string) {
                // A robot in fault says so with every state.
                if text != told {
                    context.output.note(&text);
                    told = text;
                }
            }
            if poll.stop().is_some() && pace.goes_on() {
                context
                    .output
                    .note("the stream of states broke off: the estimate begins anew");
                stream.reset();
                pace.broke_off();
            }
            for state in &poll.states {
                let t_ns = state.stamp.t_ns;
                match pace.take(t_ns).map_err(Failure::usage)? {
                    Take::Between => continue,
                    Take::Next => {}
                    Take::Anew(why) => {
                        // A gap may come at every row: once is enough.
                        let gap = matches!(why, Anew::Gap { .. });
                        if !(gap && gap_noted) {
                            context.output.note(&why.to_string());
                        }
                        gap_noted |= gap;
                        stream.reset();
                    }
                }
                let input = match inputs(state, &estimator.absent) {
                    Ok(input) => input,
                    // Told with its flaw above; it may be there again in the next state.
                    Err(_) if !poll.left_out.is_empty() => {
                        stream.reset();
                        pace.broke_off();
                        continue;
                    }
                    Err(why) => {
                        let why = format!("{}: {why}", source.name());
                        return Err(Failure::new(exit::LINK, why));
                    }
                };
                let width = stream.step(&input);
                let published = source.publish_estimate(&tip_force(estimator, &stream.force));
                published.map_err(|error| Failure::new(exit::LINK, error))?;
                let rows = stream.times_us.len();
                if rows.is_multiple_of(self.every as usize) && !context.output.json() {
                    context.output.line(&stream.line(t_ns as f64 * 1e-9, width));
                }
            }
            std::thread::sleep(LOOK);
        }
        Ok(stream.done())
    }
}

/// `[robot]` of a TOML file.
fn robot_table(file: &Path) -> Result<SourceConfig> {
    let text = std::fs::read_to_string(file)
        .map_err(|error| Failure::usage(format!("{}: {error}", file.display())))?;
    let mut table: toml::Table = toml::from_str(&text)
        .map_err(|error| Failure::usage(format!("{}: {error}", file.display())))?;
    let robot = table
        .remove("robot")
        .ok_or_else(|| Failure::usage(format!("{}: there is no [robot] table", file.display())))?;
    robot
        .try_into()
        .map_err(|error| Failure::usage(format!("{}: [robot] {error}", file.display())))
}

/// A state as the row of a model. Inputs without which the model was trained are 0; a robot need not publish them.
fn inputs(
    state: &RobotState,
    absent: &[usize],
) -> std::result::Result<[f32; INPUTS], &'static str> {
    let joints = state
        .joints
        .as_ref()
        .ok_or("the robot publishes no joints")?;
    let groups = [
        (Some(&joints.position), "the robot publishes no joints"),
        (
            joints.velocity.as_ref(),
            "the robot publishes no joint velocities",
        ),
        (
            joints.effort.as_ref().map(|effort| &effort.value),
            "the robot publishes no joint efforts (on a Raven they are in /ravenstate alone)",
        ),
    ];
    let mut row = [0.0; INPUTS];
    for (n, (values, none)) in groups.into_iter().enumerate() {
        for i in 0..3 {
            if absent.contains(&(3 * n + i)) {
                continue;
            }
            row[3 * n + i] = *values
                .ok_or(none)?
                .get(i)
                .ok_or("the robot has fewer than three joints")?
                as f32;
        }
    }
    Ok(row)
}

/// The force as CRTK knows forces.
fn tip_force(estimator: &Estimator, force: &[f32]) -> TipForce {
    let mut vector = Vector3::zeros();
    for (axis, value) in estimator.axes.iter().zip(force) {
        vector[*axis] = f64::from(*value);
    }
    TipForce {
        frame: Frame::Rig,
        acts: Acts::OnTool,
        meaning: Meaning::Estimated,
        force_n: vector.into(),
        torque_n_m: None,
    }
}

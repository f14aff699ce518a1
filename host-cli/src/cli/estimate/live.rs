//! `forcectl estimate run`: a force for each row, as the rows come.

use super::{model, read};
use crate::cli::exit::{self, Failure, Reply, Result};
use crate::cli::Context;
use clap::Args;
use estimate::load;
use estimate::pace::{Anew, Pace, Take};
use estimator::data::Label;
use estimator::estimator::Estimator;
use estimator::motion::INPUTS;
use estimator::stream::{self, Before, Stream, Sure};
use experiment::table::Table;
use nalgebra::Vector3;
use robot::source::{self, Estimate, SourceConfig};
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
    /// Write every row as Parquet: time, estimate, half width, valid; of a replay the measured
    /// force too
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Draw a replay as SVG: estimate, interval and measured force
    #[arg(long, value_name = "FILE", requires = "replay")]
    plot: Option<PathBuf>,
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

pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

/// The model on a stream, with what is printed and written of it.
struct Run<'a> {
    stream: Stream<'a>,
    context: &'a Context,
    every: usize,
    rows: Option<Table>,
    times_us: Vec<f64>,
    /// Times that the past was forgotten, wholly or over a gap.
    anew: usize,
    valid: usize,
    /// Whether the model was found not to fit the robot.
    misfits: bool,
}

/// Told once.
const MISFITS: &str = "this model no longer fits this robot: the motors' torques are not what it expects, whatever the force. Its estimates are wrong and invalid until it fits. Move all three joints back and forth for a minute with nothing at the tool, and give the log to `forcectl estimate recalibrate`; a force along an axis that had none in the training looks the same";

impl<'a> Run<'a> {
    fn new(estimator: &'a Estimator, context: &'a Context, of: &Live) -> Self {
        let axes = || estimator.axes.iter().map(|axis| AXES[*axis]);
        let mut names = vec!["t_s".to_owned()];
        names.extend(axes().map(|axis| format!("estimate_{axis}_n")));
        names.extend(["half_width_n", "valid", "misfits"].map(str::to_owned));
        names.extend(axes().map(|axis| format!("force_{axis}_n")));
        Self {
            stream: Stream::new(estimator),
            context,
            every: of.every as usize,
            rows: (of.out.is_some() || of.plot.is_some()).then(|| Table::new(names)),
            times_us: Vec::new(),
            anew: 0,
            valid: 0,
            misfits: false,
        }
    }

    fn reset(&mut self) {
        self.stream.reset();
        self.anew += 1;
    }

    fn gap(&mut self, elapsed_s: f64) {
        self.stream.gap(elapsed_s);
        self.anew += 1;
    }

    /// Takes a row; `label`: the measured force, where there is one.
    fn step(&mut self, time_s: f64, input: &[f32], label: Option<&[f32]>) -> Sure {
        let began = Instant::now();
        let sure = self.stream.step(input);
        self.times_us.push(began.elapsed().as_secs_f64() * 1e6);
        self.valid += usize::from(sure.usable());
        if sure.misfits && !std::mem::replace(&mut self.misfits, true) {
            self.context
                .output
                .note(&format!("{time_s:.1} s: {MISFITS}"));
        }
        if let Some(rows) = &mut self.rows {
            let axes = &self.stream.estimator().axes;
            let mut row = vec![time_s];
            row.extend(self.stream.force().iter().copied().map(f64::from));
            row.extend([
                sure.half_n.unwrap_or(f64::NAN),
                f64::from(u8::from(sure.usable())),
                f64::from(u8::from(sure.misfits)),
            ]);
            row.extend((axes.iter()).map(|a| label.map_or(f64::NAN, |l| f64::from(l[*a]))));
            rows.push(&row);
        }
        if (self.times_us.len() - 1).is_multiple_of(self.every) {
            self.context.output.line(&self.line(time_s, sure));
        }
        sure
    }

    fn line(&self, time_s: f64, sure: Sure) -> String {
        let axes = self.stream.estimator().axes.iter();
        let forces = axes.zip(self.stream.force());
        if self.context.output.json() {
            let mut object = serde_json::Map::new();
            object.insert("t_s".to_owned(), json!(time_s));
            for (axis, force) in forces {
                object.insert(format!("estimate_{}_n", AXES[*axis]), json!(force));
            }
            object.insert("half_width_n".to_owned(), json!(sure.half_n));
            object.insert("valid".to_owned(), json!(sure.usable()));
            object.insert("misfits".to_owned(), json!(sure.misfits));
            return serde_json::Value::Object(object).to_string();
        }
        let mut line = format!("{time_s:10.3}");
        for (axis, force) in forces {
            line += &format!("  {} {force:7.3} N", AXES[*axis]);
        }
        if let Some(half_n) = sure.half_n {
            line += &format!("  +- {half_n:.3}");
        }
        if sure.misfits {
            line += "  invalid: the model misfits";
        } else if !sure.valid {
            line += "  invalid";
        }
        line
    }

    fn done(mut self, of: &Live) -> Result<Reply> {
        self.times_us.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = self.times_us.len().saturating_sub(1);
            self.times_us
                .get(((self.times_us.len() as f64 * share) as usize).min(last))
                .copied()
                .unwrap_or(0.0)
        };
        let (rows, median, p99) = (self.times_us.len(), at(0.5), at(0.99));
        let (anew, valid) = (self.anew, self.valid);
        if let Some(table) = &self.rows {
            let estimator = self.stream.estimator();
            if let Some(path) = &of.out {
                let metadata = [("robot", estimator.robot.clone())];
                let written = table.write(path, &metadata);
                written.map_err(|error| Failure::new(exit::FILE, error))?;
            }
            if let Some(path) = &of.plot {
                let svg = estimate::pictures::replay(table, AXES[estimator.axes[0]]).to_svg();
                std::fs::write(path, svg).map_err(|error| Failure::file(path, &error))?;
            }
        }
        Ok(Reply::new(
            format!("{rows} rows, begun anew {anew} times, {valid} valid; a step takes {median:.1} us (median), {p99:.1} us (p99)\n"),
            json!({"rows": rows, "begun_anew": anew, "valid": valid, "misfits": self.misfits, "median_us": median, "p99_us": p99}),
        ))
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
        // With the measured force where the log has it; a replay does not need it.
        let mut data = read(
            context,
            log,
            self.mapping.as_ref(),
            1.0 / estimator.step_s,
            Label::WhereThere,
        )?;
        // A log alone names no robot; a data card beside it, or a mapping, does.
        if data.robot == load::UNNAMED || estimator.robot == load::UNNAMED {
            context.output.note(&format!(
                "{}: nothing tells whether its robot is that of the model: neither a data card nor a mapping file names the robot of {}; on another robot than the model's the forces are wrong",
                data.name,
                if data.robot == load::UNNAMED {
                    format!("this log, the model is of `{}`", estimator.robot)
                } else {
                    "the training".to_owned()
                }
            ));
        } else {
            load::check_robot(estimator, &data.robot, self.any_robot)?;
        }
        data.fit_inputs(estimator).map_err(Failure::usage)?;
        let mut run = Run::new(estimator, context, self);
        let mut last = None;
        for sequence in &data.sequences {
            match stream::between(last.replace(sequence), sequence) {
                Before::Gap(elapsed_s) => run.gap(elapsed_s),
                _ if run.times_us.is_empty() => {}
                _ => run.reset(),
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
                let label = sequence.target_row(k);
                run.step(time_s, sequence.input_row(k), Some(label));
            }
        }
        run.done(self)
    }

    fn live(&self, context: &Context, estimator: &Estimator, file: &Path) -> Result<Reply> {
        let config = robot_table(file)?;
        if matches!(config, SourceConfig::Virtual(_)) {
            return Err(Failure::usage("the virtual arm lives inside a run of `forcectl experiment run`; estimate from its dataset with --replay"));
        }
        self.check_name(estimator, config.robot(), file)?;
        let mut source = source::open(&config).map_err(|error| Failure::new(exit::LINK, error))?;
        let mut run = Run::new(estimator, context, self);
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
                run.reset();
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
                        match why {
                            Anew::Gap { distance_ns } => run.gap(distance_ns as f64 * 1e-9),
                            Anew::Back => run.reset(),
                        }
                    }
                }
                let input = match inputs(state, &estimator.absent) {
                    Ok(input) => input,
                    // Told with its flaw above; it may be there again in the next state.
                    Err(_) if !poll.left_out.is_empty() => {
                        run.reset();
                        pace.broke_off();
                        continue;
                    }
                    Err(why) => {
                        let why = format!("{}: {why}", source.name());
                        return Err(Failure::new(exit::LINK, why));
                    }
                };
                let sure = run.step(t_ns as f64 * 1e-9, &input, None);
                // CRTK has no word for a force that is not known: it is not published.
                if sure.usable() {
                    let estimate = Estimate {
                        force: tip_force(estimator, run.stream.force()),
                        half_n: sure.half_n.map(|half_n| half_widths(estimator, half_n)),
                        stamp: state.stamp.clone(),
                    };
                    let published = source.publish_estimate(&estimate);
                    published.map_err(|error| Failure::new(exit::LINK, error))?;
                }
            }
            std::thread::sleep(LOOK);
        }
        run.done(self)
    }

    /// Refuses a robot whose name is not that of the model's training.
    fn check_name(&self, estimator: &Estimator, name: Option<&str>, file: &Path) -> Result<()> {
        if self.any_robot {
            return Ok(());
        }
        if estimator.robot == load::UNNAMED {
            return Err(Failure::usage(
                "nothing named the robot of this model's training, so nothing tells whether it is this one. Give `name` in [robot] of the experiment and train again, or take the model with --any-robot",
            ));
        }
        match name {
            Some(name) => Ok(load::check_robot(estimator, name, false)?),
            None => Err(Failure::usage(format!(
                "{}: [robot] has no `name`, and an address does not tell which robot publishes there. The model is of the robot `{}`: if this is it, write name = {:?}, else train a model of it. --any-robot takes the model as it is",
                file.display(), estimator.robot, estimator.robot
            ))),
        }
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

/// A state as the row of a model. Inputs without which the model was trained are 0; a robot need
/// not publish them.
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

/// Half widths of the components of a force, N. Of several components the interval is a ball.
fn half_widths(estimator: &Estimator, half_n: f64) -> [f64; 3] {
    core::array::from_fn(|axis| {
        if estimator.axes.contains(&axis) {
            half_n
        } else {
            0.0
        }
    })
}

//! `forcectl estimate run`: a force for each row, as the rows come.

use super::robot::{Heard, Robot};
use super::{inputs, model, read};
use crate::cli::exit::{self, Failure, Reply, Result};
use crate::cli::values::AXES;
use crate::cli::Context;
use clap::Args;
use estimate::load;
use estimator::data::Label;
use estimator::estimator::Estimator;
use estimator::stream::{self, Before, Stream, Sure};
use experiment::table::Table;
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

/// Told when it begins.
pub const MISFITS: &str = "this model no longer fits this robot: the motors' torques are not what it expects, whatever the force. Its estimates are wrong and invalid until it fits. Move all three joints back and forth for a minute with nothing at the tool, and give the log to `forcectl estimate recalibrate`; a force along an axis that had none in the training looks the same";

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
                files::replace(path, svg).map_err(|error| Failure::file(path, &error))?;
            }
        }
        let us =
            |time_us: Option<f64>| time_us.map_or_else(|| "-".to_owned(), |t| format!("{t:.1} us"));
        let code = if valid > 0 {
            exit::DONE
        } else {
            self.context.output.note("no row has a valid estimate");
            exit::DEGRADED
        };
        let text = format!(
            "{rows} rows, begun anew {anew} times, {valid} valid; a step takes {} (median), {} (p99)\n",
            us(median),
            us(p99)
        );
        let json = json!({"rows": rows, "begun_anew": anew, "valid": valid, "misfits": self.misfits, "median_us": median, "p99_us": p99});
        Ok(Reply::new(text, json).with_code(code))
    }
}

impl Live {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.check_outputs()?;
        let estimator = model(&self.model)?;
        match (&self.replay, &self.robot) {
            (Some(log), _) => self.replay(context, &estimator, log),
            (None, Some(file)) => self.live(context, &estimator, file),
            (None, None) => Err(Failure::usage("give --replay FILE or --robot FILE")),
        }
    }

    /// Refuses files that would replace what is read, or each other.
    fn check_outputs(&self) -> Result<()> {
        let read = [Some(&self.model), self.replay.as_ref(), self.robot.as_ref()];
        let read: Vec<&Path> = read.into_iter().flatten().map(PathBuf::as_path).collect();
        let inputs = inputs(&read, self.mapping.as_deref());
        for file in [&self.out, &self.plot].into_iter().flatten() {
            files::check_output(file, &inputs)?;
        }
        match (&self.out, &self.plot) {
            (Some(out), Some(plot)) => files::check_output(plot, &[out]).map_err(|_| {
                Failure::usage(format!(
                    "--plot {}: --out is the same file; name another one",
                    plot.display()
                ))
            }),
            _ => Ok(()),
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
        let mut replayed = 0;
        let most = self
            .duration
            .map(|d| (d / estimator.step_s).ceil() as usize);
        let ends = |replayed: usize| {
            context.interrupt.requested() || most.is_some_and(|most| replayed >= most)
        };
        for sequence in &data.sequences {
            if ends(replayed) {
                break;
            }
            match stream::between(last.replace(sequence), sequence) {
                Before::Gap(elapsed_s) => run.gap(elapsed_s),
                _ if run.times_us.is_empty() => {}
                _ => run.reset(),
            }
            for k in 0..sequence.rows() {
                let time_s = sequence.start_s + k as f64 * sequence.step_s;
                if ends(replayed) {
                    break;
                }
                replayed += 1;
                let label = sequence.target_row(k);
                run.step(time_s, sequence.input_row(k), Some(label));
            }
        }
        run.done(self)
    }

    fn live(&self, context: &Context, estimator: &Estimator, file: &Path) -> Result<Reply> {
        let mut robot = Robot::open(estimator, file, self.any_robot)?;
        let mut run = Run::new(estimator, context, self);
        let began = Instant::now();
        let _controlled_stop = context.interrupt.controlled_stop();
        while !context.interrupt.requested()
            && self
                .duration
                .is_none_or(|d| began.elapsed().as_secs_f64() < d)
        {
            for heard in robot.poll()? {
                match heard {
                    Heard::Note(text) => context.output.note(&text),
                    Heard::Anew => run.reset(),
                    Heard::Gap(elapsed_s) => run.gap(elapsed_s),
                    Heard::Row(stamp, input) => {
                        let sure = run.step(stamp.t_ns as f64 * 1e-9, &input, None);
                        robot.publish(run.stream.force(), sure, stamp)?;
                    }
                }
            }
            std::thread::sleep(LOOK);
        }
        run.done(self)
    }
}

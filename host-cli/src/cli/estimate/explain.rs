//! `forcectl estimate explain`: what has changed of a robot since a model was trained, in words.

use super::{model, read};
use crate::cli::exit::{Failure, Reply, Result};
use crate::cli::Context;
use clap::Args;
use estimate::explain;
use estimate::load;
use estimator::data::Label;
use estimator::sequence::Sequence;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Arguments of `estimate explain`.
#[derive(Debug, Args)]
pub struct Explain {
    /// Model file: physics or hybrid
    model: PathBuf,
    /// Folder of an experiment or of logs, or a log; without a measured force the motion has to be
    /// free
    data: PathBuf,
    /// Trials [default: all]
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    trials: Vec<usize>,
    /// Use the data although they are of another robot
    #[arg(long)]
    any_robot: bool,
    /// Mapping file (TOML)
    #[arg(long, value_name = "FILE")]
    mapping: Option<PathBuf>,
}

impl Explain {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let estimator = model(&self.model)?;
        let mut data = read(
            context,
            &self.data,
            self.mapping.as_ref(),
            1.0 / estimator.step_s,
            Label::WhereThere,
        )?;
        load::check_robot(&estimator, &data.robot, self.any_robot)?;
        data.fit_inputs(&estimator).map_err(Failure::usage)?;
        let sequences: Vec<&Sequence> = if self.trials.is_empty() {
            data.sequences.iter().collect()
        } else {
            data.of(&self.trials)
        };
        let explained = explain::explain(&estimator, &sequences).map_err(Failure::usage)?;
        let mut text = String::new();
        for motor in &explained.motors {
            let says = if motor.says.is_empty() {
                "nothing that the model does not know".to_owned()
            } else {
                motor.says.join("; ")
            };
            row!(text, "{:<10} {says}", motor.joint);
            if motor.paths_not_judged > 0 {
                row!(
                    text,
                    "           {} more courses of the search predict as well; their names were not judged",
                    motor.paths_not_judged
                );
            }
            row!(
                text,
                "           torque less expected torque: {:.3} {} RMS, {:.3} {} with that",
                motor.before,
                motor.unit,
                motor.after,
                motor.unit
            );
        }
        let (without, rows) = (explained.rows_without_force, explained.rows);
        if without > 0 {
            row!(
                text,
                "{without} of {rows} rows lack a measured force or a part of it, which counts as none: there the motion has to be free"
            );
        }
        Ok(Reply::new(text, json!(explained)))
    }
}

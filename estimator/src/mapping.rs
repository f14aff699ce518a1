//! Where in a log the inputs of a model are. Read from a small TOML file.

use crate::motion::INPUT_NAMES;
use serde::{Deserialize, Serialize};

/// Where in a log the model's inputs are: column names, factors to SI units. The default is the
/// dataset of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mapping {
    /// Column of the time, and factor to s.
    pub time: Source,
    /// Positions of the first three joints: to rad, rad, m.
    pub position: [Source; 3],
    /// Velocities: to rad/s, rad/s, m/s.
    pub velocity: [Source; 3],
    /// Efforts of the drives at the joints: to N·m, N·m, N.
    pub effort: [Source; 3],
    /// Force on the tool: to N. With the factor -1 for a log of the force by the tool.
    pub force: [Source; 3],
    /// Tip as the robot reports it: to m. All three absent: the frame of the force is the robot's
    /// CRTK frame.
    pub tip: [Source; 3],
    /// Column that is 1 where a row can be used; empty: every row can be.
    pub usable: String,
    /// Column with the number of the trial; empty: each file is a trial.
    pub trial: String,
    /// Name of the robot. A model is refused for data of another robot.
    pub robot: String,
}

/// A column and its factor to SI units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Name of the column.
    #[serde(default)]
    pub column: String,
    /// Factor to the SI unit.
    #[serde(default = "one")]
    pub factor: f64,
    /// The log has no such quantity: velocities, and efforts of one or two joints. The model is
    /// trained without this input.
    #[serde(default)]
    pub absent: bool,
}

const fn one() -> f64 {
    1.0
}

fn source(name: &str) -> Source {
    Source {
        column: name.to_owned(),
        factor: 1.0,
        absent: false,
    }
}

impl Default for Mapping {
    fn default() -> Self {
        let input = |from: usize| core::array::from_fn(|i| source(INPUT_NAMES[from + i]));
        Self {
            time: source("t_s"),
            position: input(0),
            velocity: input(3),
            effort: input(6),
            force: ["force_x_n", "force_y_n", "force_z_n"].map(source),
            tip: ["tip_x_m", "tip_y_m", "tip_z_m"].map(source),
            usable: "quality".to_owned(),
            trial: "trial".to_owned(),
            robot: String::new(),
        }
    }
}

impl Mapping {
    /// Sources of the reported tip, where the log has it.
    #[must_use]
    pub fn tip(&self) -> Option<&[Source; 3]> {
        (!self.tip.iter().all(|source| source.absent)).then_some(&self.tip)
    }

    /// Column that says which rows can be used.
    #[must_use]
    pub fn usable(&self) -> Option<&str> {
        Some(self.usable.as_str()).filter(|column| !column.is_empty())
    }

    /// Column with the number of the trial.
    #[must_use]
    pub fn trial(&self) -> Option<&str> {
        Some(self.trial.as_str()).filter(|column| !column.is_empty())
    }
}

//! Where in a log the inputs of a model are. Read from a small TOML file, whose words are those of
//! a model file of the analysis: `column`, `unit`, `scale`, `offset`, `[input]`.

use crate::motion::INPUT_NAMES;
use residual_columns::layout::{Action, Input};
use residual_columns::units;
use serde::{Deserialize, Serialize};

/// Where in a log the model's inputs are: column names and their units. The default is the dataset
/// of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mapping {
    /// Time. Two columns with a plus between are a sum: seconds and nanoseconds, date and time of
    /// day.
    pub time: Source,
    /// Positions of the first three joints: two angles, a length.
    pub position: [Source; 3],
    /// Velocities.
    pub velocity: [Source; 3],
    /// Efforts of the drives at the joints: two torques, a force.
    pub effort: [Source; 3],
    /// Force on the tool. With `scale = -1` for a log of the force by the tool. Absent: the
    /// component was not measured, and is neither trained nor scored.
    pub force: [Source; 3],
    /// Tip as the robot reports it. All three absent: the frame of the force is the robot's CRTK
    /// frame.
    pub tip: [Source; 3],
    /// Column that is 1 where a row can be used; empty: every row can be.
    pub usable: String,
    /// Column with the number of the trial; empty: each file is a trial.
    pub trial: String,
    /// Name of the robot. A model is refused for data of another robot.
    pub robot: String,
    /// How files are read. A log is one run, so nothing of it is cut by `sequence`.
    pub input: Input,
    /// Lines of text files that are no rows: `report` refuses the file, `drop` leaves them out.
    pub text: Action,
}

/// A column: value = cell * scale + offset, in `unit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Source {
    /// Name of the column.
    pub column: String,
    /// Unit after `scale` and `offset`; empty: the SI unit.
    pub unit: String,
    /// Factor from cell to `unit`.
    #[serde(alias = "factor")]
    pub scale: f64,
    /// Offset after the factor, in `unit`.
    pub offset: f64,
    /// The log has no such quantity: velocities, efforts of one or two joints, components of the
    /// force. The model is trained without this input.
    pub absent: bool,
}

impl Source {
    /// What stands for a quantity that a log lacks.
    #[must_use]
    pub fn none() -> Self {
        Self {
            absent: true,
            ..Self::default()
        }
    }

    /// Factor and offset from a cell to an SI unit.
    ///
    /// # Errors
    /// The unit can't be converted to it, in words that follow its name.
    pub fn to_si(&self, si: &str) -> Result<(f64, f64), &'static str> {
        let factor = match self.unit.is_empty() {
            true => 1.0,
            false => units::factor(&self.unit, si)?,
        };
        Ok((self.scale * factor, self.offset * factor))
    }

    /// Whether the log has values of it. A factor of 0 makes none.
    #[must_use]
    pub fn is_measured(&self) -> bool {
        !self.absent && self.scale != 0.0
    }
}

impl Default for Source {
    fn default() -> Self {
        Self {
            column: String::new(),
            unit: String::new(),
            scale: 1.0,
            offset: 0.0,
            absent: false,
        }
    }
}

fn source(name: &str) -> Source {
    Source {
        column: name.to_owned(),
        ..Source::default()
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
            input: Input::default(),
            text: Action::Report,
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

    /// Names of all columns that are read.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        let groups = [&self.position, &self.velocity, &self.effort, &self.force];
        let sources = groups
            .into_iter()
            .flatten()
            .chain(self.tip().into_iter().flatten());
        let named = sources.chain([&self.time]).filter(|s| !s.absent);
        (named.map(|s| s.column.as_str()))
            .chain(self.usable())
            .chain(self.trial())
    }
}

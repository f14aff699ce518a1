//! Logs as sequences: columns by name, units, checks, splits by trial.
//!
//! What is refused, with file and column: a column that is missing, a value that is no number inside a usable stretch, another
//! rate, fewer rows than a second.

use crate::geometry::Base;
use crate::motion::{INPUTS, INPUT_NAMES};
use crate::sequence::Sequence;
use serde::{Deserialize, Serialize};

/// Columns of a log by name.
pub trait Columns {
    /// A column; `None` if the log has none of this name.
    fn column(&self, name: &str) -> Option<&[f64]>;
    /// Names of all columns, for messages.
    fn names(&self) -> Vec<String>;
}

/// Where in a log the model's inputs are: column names, factors to SI units. The default is the dataset of an experiment.
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
    /// Tip as the robot reports it: to m. `None`: the frame of the force is the robot's CRTK frame.
    pub tip: Option<[Source; 3]>,
    /// Column that is 1 where a row can be used; `None`: every row can be.
    pub usable: Option<String>,
    /// Column with the number of the trial; `None`: each file is a trial.
    pub trial: Option<String>,
    /// Name of the robot. A model is refused for data of another robot.
    pub robot: String,
}

/// A column and its factor to SI units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Name of the column.
    pub column: String,
    /// Factor to the SI unit.
    #[serde(default = "one")]
    pub factor: f64,
}

const fn one() -> f64 {
    1.0
}

fn source(name: &str) -> Source {
    Source {
        column: name.to_owned(),
        factor: 1.0,
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
            tip: Some(["tip_x_m", "tip_y_m", "tip_z_m"].map(source)),
            usable: Some("quality".to_owned()),
            trial: Some("trial".to_owned()),
            robot: String::new(),
        }
    }
}

/// Why a log can't be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DataError {
    /// A column is missing.
    #[error("{file}: there is no column `{column}` (for {role}); the file has {has}. Name the right column in a mapping file (--mapping)")]
    Missing {
        /// File.
        file: String,
        /// Column.
        column: String,
        /// What it is for.
        role: String,
        /// Columns that are there.
        has: String,
    },
    /// A value is no number.
    #[error("{file}: column `{column}` is {value} in row {row} (t = {time_s} s), which is marked as usable; mark such rows unusable or leave them out")]
    NotANumber {
        /// File.
        file: String,
        /// Column.
        column: String,
        /// What is there.
        value: f64,
        /// Row from 1.
        row: usize,
        /// Time, s.
        time_s: f64,
    },
    /// Another rate.
    #[error("{file}: its rows are {found_hz:.2} Hz (column `{column}`), which is no multiple of the model's {wanted_hz:.2} Hz; record at such a rate, or train a model at this one (--rate)")]
    Rate {
        /// File.
        file: String,
        /// Column of the time.
        column: String,
        /// Rate of the file, Hz.
        found_hz: f64,
        /// Wanted, Hz.
        wanted_hz: f64,
    },
    /// Nothing usable.
    #[error("{file}: no stretch of usable rows is longer than a second")]
    Empty {
        /// File.
        file: String,
    },
    /// Time does not go on.
    #[error("{file}: the time in column `{column}` does not increase")]
    Time {
        /// File.
        file: String,
        /// Column.
        column: String,
    },
}

/// Rows of one file that can be used.
#[derive(Debug, Clone)]
pub struct Part {
    /// Unbroken stretches, with the force's three components as targets where the log has them.
    pub sequences: Vec<Sequence>,
    /// Joints (rad, rad, m) and reported tips (m), about a thousand rows.
    pub tips: Vec<([f64; 3], [f64; 3])>,
    /// Rate of the file, Hz.
    pub rate_hz: f64,
    /// Rows that were left out because they are not usable.
    pub unusable: usize,
}

/// Reads a log: rows at `rate_hz`, which divides the log's rate. `with_force`: the label is needed.
///
/// # Errors
/// [`DataError`] with file and column.
pub fn read<'a>(
    file: &str,
    log: &'a dyn Columns,
    mapping: &'a Mapping,
    rate_hz: f64,
    with_force: bool,
) -> Result<Part, DataError> {
    let find = |role: &str, column: &str| {
        log.column(column).ok_or_else(|| DataError::Missing {
            file: file.to_owned(),
            column: column.to_owned(),
            role: role.to_owned(),
            has: log.names().join(", "),
        })
    };
    let three = |role: &str, sources: &'a [Source; 3]| -> Result<Vec<Column<'a>>, DataError> {
        let mut columns = Vec::with_capacity(3);
        for s in sources {
            columns.push(Column::new(&s.column, find(role, &s.column)?, s.factor));
        }
        Ok(columns)
    };
    let time = Column::new(
        &mapping.time.column,
        find("the time", &mapping.time.column)?,
        mapping.time.factor,
    );
    let mut inputs = three("a joint's position", &mapping.position)?;
    inputs.extend(three("a joint's velocity", &mapping.velocity)?);
    inputs.extend(three("a joint's effort", &mapping.effort)?);
    let force = if with_force {
        three("the force on the tool", &mapping.force)?
    } else {
        Vec::new()
    };
    let tip = match &mapping.tip {
        Some(tip) => three("the reported tip", tip)?,
        None => Vec::new(),
    };
    let usable = mapping
        .usable
        .as_ref()
        .map(|c| find("whether a row is usable", c))
        .transpose()?;
    let trial = mapping
        .trial
        .as_ref()
        .map(|c| find("the trial", c))
        .transpose()?;
    let found_s = step_s(file, &time)?;
    let every = (1.0 / (rate_hz * found_s)).round();
    if every < 1.0 || (every * found_s * rate_hz - 1.0).abs() > 0.02 {
        return Err(DataError::Rate {
            file: file.to_owned(),
            column: mapping.time.column.clone(),
            found_hz: 1.0 / found_s,
            wanted_hz: rate_hz,
        });
    }
    let rows = time.values.len();
    let mut part = Part {
        sequences: Vec::new(),
        tips: Vec::new(),
        rate_hz: 1.0 / found_s,
        unusable: 0,
    };
    let every = every as usize;
    let mut taken = 0_usize;
    let mut open: Option<Sequence> = None;
    // Row of the stretch's start, so that every n-th row is counted from there.
    let mut began = 0;
    let mut before: Option<(f64, usize)> = None;
    for row in 0..rows {
        let (t, number) = (
            time.at(row),
            trial.map_or(0, |c| {
                if c[row].is_finite() {
                    c[row] as usize
                } else {
                    0
                }
            }),
        );
        let bad = usable.is_some_and(|c| c[row] != 1.0);
        let broken = before
            .is_some_and(|(last, n)| n != number || (t - last - found_s).abs() > 0.5 * found_s);
        if bad || broken {
            close(&mut part, open.take());
        }
        before = Some((t, number));
        if bad {
            part.unusable += 1;
            continue;
        }
        check(file, row, &time, inputs.iter().chain(&force))?;
        let sequence = open.get_or_insert_with(|| {
            began = row;
            Sequence {
                trial: number,
                start_s: t,
                step_s: 1.0 / rate_hz,
                input: Vec::new(),
                inputs: INPUTS,
                target: Vec::new(),
                targets: 3,
            }
        });
        if (row - began) % every != 0 {
            continue;
        }
        sequence
            .input
            .extend(inputs.iter().map(|c| c.at(row) as f32));
        if force.is_empty() {
            sequence.target.extend([0.0; 3]);
        } else {
            sequence
                .target
                .extend(force.iter().map(|c| c.at(row) as f32));
        }
        // About a thousand, counted in rows that are taken: a stretch may begin at any row.
        taken += 1;
        if !tip.is_empty() && (taken - 1).is_multiple_of((rows / every / 1_000).max(1)) {
            check(file, row, &time, tip.iter())?;
            part.tips.push((
                core::array::from_fn(|i| inputs[i].at(row)),
                core::array::from_fn(|i| tip[i].at(row)),
            ));
        }
    }
    close(&mut part, open.take());
    if part.sequences.is_empty() {
        return Err(DataError::Empty {
            file: file.to_owned(),
        });
    }
    Ok(part)
}

struct Column<'a> {
    name: &'a str,
    values: &'a [f64],
    factor: f64,
}

impl<'a> Column<'a> {
    const fn new(name: &'a str, values: &'a [f64], factor: f64) -> Self {
        Self {
            name,
            values,
            factor,
        }
    }

    fn at(&self, row: usize) -> f64 {
        self.values[row] * self.factor
    }
}

fn check<'a>(
    file: &str,
    row: usize,
    time: &Column<'_>,
    columns: impl Iterator<Item = &'a Column<'a>>,
) -> Result<(), DataError> {
    for column in columns {
        let value = column.at(row);
        // Also what 32 bits can't hold.
        if !(value as f32).is_finite() {
            return Err(DataError::NotANumber {
                file: file.to_owned(),
                column: column.name.to_owned(),
                value: column.values[row],
                row: row + 1,
                time_s: time.at(row),
            });
        }
    }
    Ok(())
}

/// Keeps a stretch of at least a second.
fn close(part: &mut Part, sequence: Option<Sequence>) {
    if let Some(sequence) = sequence {
        if sequence.rows() as f64 * sequence.step_s >= 1.0 {
            part.sequences.push(sequence);
        }
    }
}

/// Median step of the time, s.
fn step_s(file: &str, time: &Column<'_>) -> Result<f64, DataError> {
    let mut steps: Vec<f64> = (1..time.values.len())
        .map(|k| time.at(k) - time.at(k - 1))
        .filter(|s| s.is_finite())
        .collect();
    if steps.is_empty() {
        return Err(DataError::Empty {
            file: file.to_owned(),
        });
    }
    steps.sort_by(f64::total_cmp);
    // A float of the clock and the truth: 1e-5 of the step is noise of the stamps.
    let median = steps[steps.len() / 2];
    if median <= 0.0 {
        return Err(DataError::Time {
            file: file.to_owned(),
            column: time.name.to_owned(),
        });
    }
    Ok(median)
}

/// The robot's base from parts, or the CRTK frame where logs have no tips.
///
/// # Errors
/// The tips do not fit the kinematics.
pub fn base(parts: &[Part]) -> Result<Base, crate::geometry::BaseError> {
    let pairs: Vec<_> = parts.iter().flat_map(|p| p.tips.iter().copied()).collect();
    if pairs.is_empty() {
        return Ok(Base::default());
    }
    Base::fit(&pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Log(Vec<(String, Vec<f64>)>);

    impl Columns for Log {
        fn column(&self, name: &str) -> Option<&[f64]> {
            self.0
                .iter()
                .find(|(n, _)| n == name)
                .map(|(_, v)| v.as_slice())
        }

        fn names(&self) -> Vec<String> {
            self.0.iter().map(|(n, _)| n.clone()).collect()
        }
    }

    fn log(rows: usize) -> Log {
        let mapping = Mapping::default();
        let mut columns = vec![(
            "t_s".to_owned(),
            (0..rows).map(|k| k as f64 * 0.01).collect(),
        )];
        let all = mapping
            .position
            .iter()
            .chain(&mapping.velocity)
            .chain(&mapping.effort)
            .chain(&mapping.force);
        for (n, source) in all.chain(mapping.tip.iter().flatten()).enumerate() {
            columns.push((
                source.column.clone(),
                (0..rows).map(|k| (n * 10_000 + k) as f64).collect(),
            ));
        }
        columns.push(("quality".to_owned(), vec![1.0; rows]));
        columns.push(("trial".to_owned(), vec![4.0; rows]));
        Log(columns)
    }

    fn set(log: &mut Log, name: &str, row: usize, value: f64) {
        let column = log.0.iter_mut().find(|(n, _)| n == name).unwrap();
        column.1[row] = value;
    }

    fn read_at(log: &Log, rate_hz: f64) -> Result<Part, DataError> {
        read("a.parquet", log, &Mapping::default(), rate_hz, true)
    }

    #[test]
    fn every_second_row_is_taken_and_gaps_split() {
        let mut log = log(1_000);
        set(&mut log, "quality", 500, 0.0);
        set(&mut log, "joint_effort_2", 500, f64::NAN);
        let part = read_at(&log, 50.0).unwrap();
        assert_eq!(part.sequences.len(), 2);
        assert_eq!(part.unusable, 1);
        // The first stretch begins at an even row, the second at an odd one; tips come from both.
        assert_eq!(
            part.tips.len(),
            part.sequences.iter().map(Sequence::rows).sum::<usize>()
        );
        assert_eq!(
            (part.sequences[0].rows(), part.sequences[0].trial),
            (250, 4)
        );
        assert_eq!(part.sequences[0].input_row(3)[1], 10_006.0);
        assert_eq!(part.sequences[1].input_row(0)[0], 501.0);
        assert_eq!(
            part.sequences[0].target_row(1),
            [90_002.0, 100_002.0, 110_002.0]
        );
    }

    #[test]
    fn refusals_name_file_and_column() {
        let mut missing = log(1_000);
        missing.0.retain(|(n, _)| n != "joint_effort_2");
        let mut nan = log(1_000);
        set(&mut nan, "joint_velocity_3", 7, f64::NAN);
        let mut large = log(1_000);
        set(&mut large, "force_y_n", 3, 1e300);
        for (log, words) in [
            (&missing, vec!["a.parquet", "`joint_effort_2`", "--mapping"]),
            (&nan, vec!["a.parquet", "`joint_velocity_3`", "row 8"]),
            (&large, vec!["`force_y_n`", "row 4"]),
        ] {
            let error = read_at(log, 50.0).unwrap_err().to_string();
            for word in words {
                assert!(error.contains(word), "{error}");
            }
        }
        let error = read_at(&log(1_000), 40.0).unwrap_err().to_string();
        assert!(
            error.contains("100.00 Hz") && error.contains("40.00 Hz"),
            "{error}"
        );
        assert!(matches!(
            read_at(&log(50), 50.0),
            Err(DataError::Empty { .. })
        ));
    }

    #[test]
    fn a_mapping_brings_other_names_and_units() {
        let mut other = log(400);
        for (name, values) in &mut other.0 {
            if name == "joint_position_1" {
                *name = "shoulder_deg".to_owned();
                values.iter_mut().for_each(|v| *v = 180.0);
            }
        }
        let mut mapping = Mapping::default();
        mapping.position[0] = Source {
            column: "shoulder_deg".to_owned(),
            factor: std::f64::consts::PI / 180.0,
        };
        let part = read("b.csv", &other, &mapping, 100.0, true).unwrap();
        assert!((part.sequences[0].input_row(0)[0] - std::f32::consts::PI).abs() < 1e-6);
    }
}

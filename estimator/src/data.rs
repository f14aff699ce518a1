//! Logs as sequences: columns by name, units, checks, splits by trial.
//!
//! What is refused, with file and column: a column that is missing, a value or a time that is not a
//! number in a usable row, a trial that is not a whole number, another rate, fewer rows than a
//! second.

use crate::geometry::Base;
pub use crate::mapping::{Mapping, Source};
use crate::motion::INPUTS;
pub use crate::refusal::DataError;
use crate::sequence::Sequence;

/// Columns of a log by name.
pub trait Columns {
    /// A column; `None` if the log has none of this name.
    fn column(&self, name: &str) -> Option<&[f64]>;
    /// Names of all columns, for messages.
    fn names(&self) -> Vec<String>;
    /// First cell of a column that is no numbers, and its line; `None` of any other.
    fn text(&self, _name: &str) -> Option<(&str, u64)> {
        None
    }
    /// Line of a row (from 0) in a text file, for messages; `None` where that is not known.
    fn line(&self, _row: usize) -> Option<u64> {
        None
    }
}

/// Joints (rad, rad, m) and the tip that the robot reports with them (m).
pub type Pose = ([f64; 3], [f64; 3]);

/// Rows of one file that can be used.
#[derive(Debug, Clone)]
pub struct Part {
    /// Unbroken stretches, with the force's three components as targets where the log has them.
    pub sequences: Vec<Sequence>,
    /// Trial, with joints (rad, rad, m) and reported tip (m), of about a thousand rows.
    pub tips: Vec<(usize, Pose)>,
    /// Rate of the file, Hz.
    pub rate_hz: f64,
    /// Rows that were left out because they are not usable.
    pub unusable: usize,
    /// Usable rows that were left out because gaps cut the log into stretches below a second.
    pub short: usize,
    /// Inputs that the log lacks, by their place in [`crate::motion::INPUT_NAMES`]. They are 0 in
    /// every row.
    pub absent: Vec<usize>,
}

/// What a log without a column can do instead.
const SPARE: &str =
    ", or write `{ absent = true }` for it there: a model is then trained without this input";
const UNMEASURED: &str =
    ", or write `{ absent = true }` for it there: this component is then neither trained nor scored";
const ALL_USABLE: &str = ", or write `usable = \"\"` there: every row is taken";
const FILE_IS_TRIAL: &str = ", or write `trial = \"\"` there: each file is a trial";

/// Inputs that a mapping calls absent.
///
/// # Errors
/// All efforts are.
fn absent(file: &str, mapping: &Mapping) -> Result<Vec<usize>, DataError> {
    let groups = mapping.velocity.iter().chain(&mapping.effort);
    let absent: Vec<usize> = groups
        .enumerate()
        .filter(|(_, source)| source.absent)
        .map(|(n, _)| 3 + n)
        .collect();
    if (6..INPUTS).all(|input| absent.contains(&input)) {
        return Err(DataError::Needed {
            file: file.to_owned(),
            role: "the effort of every joint".to_owned(),
            why: "without any effort nothing tells the force: log the motor torques, or currents with `scale`".to_owned(),
        });
    }
    Ok(absent)
}

/// What a log must have of the force on the tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Label {
    /// A finite value in every row that is usable.
    Needed,
    /// What there is: NaN where a column or a value is missing.
    WhereThere,
}

/// Reads a log: rows at `rate_hz`, which divides the log's rate.
///
/// # Errors
/// [`DataError`] with file and column.
pub fn read<'a>(
    file: &str,
    log: &'a dyn Columns,
    mapping: &'a Mapping,
    rate_hz: f64,
    label: Label,
) -> Result<Part, DataError> {
    let find = |role: &str, column: &str, instead: &'static str| {
        let file = || file.to_owned();
        let (column, role) = (column.to_owned(), role.to_owned());
        match (log.column(&column), log.text(&column)) {
            (Some(values), _) => Ok(values),
            (None, Some((cell, line))) => Err(DataError::Text {
                cell: cell.to_owned(),
                line,
                file: file(),
                column,
                role,
                instead,
            }),
            (None, None) => Err(DataError::Missing {
                has: log.names().join(", "),
                file: file(),
                column,
                role,
                instead,
            }),
        }
    };
    let one = |role: &'static str,
               s: &'a Source,
               si: &'static str,
               instead: &'static str|
     -> Result<Column<'a>, DataError> {
        let file = file.to_owned();
        match (s.absent, instead) {
            (true, SPARE | UNMEASURED) => Ok(Column::none()),
            (true, _) => Err(DataError::Needed {
                file,
                role: role.to_owned(),
                why: "every model needs it; only velocities, efforts and components of the force can be absent".to_owned(),
            }),
            (false, _) if s.column.is_empty() => Err(DataError::Unnamed { file, role: role.to_owned() }),
            (false, _) => {
                let values = find(role, &s.column, instead)?;
                let (scale, offset) = s.to_si(si).map_err(|why| DataError::Unit {
                    file,
                    role,
                    column: s.column.clone(),
                    unit: s.unit.clone(),
                    why,
                    si,
                })?;
                Ok(Column {
                    name: &s.column,
                    values: Some(values),
                    scale,
                    offset,
                })
            }
        }
    };
    let three = |role: &'static str,
                 sources: &'a [Source; 3],
                 si: [&'static str; 3],
                 instead: &'static str| {
        let columns = sources
            .iter()
            .zip(si)
            .map(|(s, si)| one(role, s, si, instead));
        columns.collect::<Result<Vec<Column<'a>>, DataError>>()
    };
    let absent = absent(file, mapping)?;
    let time = one("the time", &mapping.time, "s", "")?;
    let mut inputs = three(
        "a joint's position",
        &mapping.position,
        ["rad", "rad", "m"],
        "",
    )?;
    let velocity = ["rad/s", "rad/s", "m/s"];
    inputs.extend(three(
        "a joint's velocity",
        &mapping.velocity,
        velocity,
        SPARE,
    )?);
    let effort = ["N·m", "N·m", "N"];
    inputs.extend(three("a joint's effort", &mapping.effort, effort, SPARE)?);
    let force = three(
        "the force on the tool",
        &mapping.force,
        ["N"; 3],
        UNMEASURED,
    );
    let force = match (label, force) {
        (Label::WhereThere, Err(DataError::Missing { .. })) => Vec::new(),
        (_, force) => force?,
    };
    let needed: &[Column<'_>] = match label {
        Label::Needed => &force,
        Label::WhereThere => &[],
    };
    let tip = match mapping.tip() {
        Some(tip) => three("the reported tip", tip, ["m"; 3], "")?,
        None => Vec::new(),
    };
    let usable = mapping
        .usable()
        .map(|c| find("whether a row is usable", c, ALL_USABLE))
        .transpose()?;
    let trial = mapping
        .trial()
        .map(|c| find("the trial", c, FILE_IS_TRIAL))
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
    let rows = time.rows();
    let mut part = Part {
        sequences: Vec::new(),
        tips: Vec::new(),
        rate_hz: 1.0 / found_s,
        unusable: 0,
        short: 0,
        absent,
    };
    let every = every as usize;
    let mut taken = 0_usize;
    let mut open: Option<Sequence> = None;
    // Row of the stretch's start, so that every n-th row is counted from there.
    let mut began = 0;
    let mut before: Option<(f64, usize)> = None;
    for row in 0..rows {
        let t = time.at(row);
        let bad = usable.is_some_and(|c| c[row] != 1.0);
        // A row that is not usable may have any trial: it ends a stretch whatever it is.
        let number = match trial.map(|c| (c[row], number_of(c[row]))) {
            None => 0,
            Some((_, Some(number))) => number,
            Some((_, None)) if bad => 0,
            Some((value, None)) => {
                return Err(DataError::Trial {
                    file: file.to_owned(),
                    column: mapping.trial.clone(),
                    value,
                    row: row + 1,
                    line: log.line(row),
                });
            }
        };
        // So written, a time that is not a number is a gap: comparisons with it are false.
        let follows = |last: f64| (t - last - found_s).abs() <= 0.5 * found_s;
        let broken = before.is_some_and(|(last, n)| n != number || !follows(last));
        if bad || broken {
            close(&mut part, open.take(), label);
        }
        before = Some((t, number));
        if bad {
            part.unusable += 1;
            continue;
        }
        let checked = std::iter::once(&time).chain(&inputs).chain(needed);
        check(file, log, row, &time, checked)?;
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
            sequence.target.extend([f32::NAN; 3]);
        } else {
            let unmeasured =
                |i: usize| label == Label::WhereThere && !mapping.force[i].is_measured();
            let values = force.iter().enumerate();
            sequence
                .target
                .extend(values.map(|(i, c)| match unmeasured(i) {
                    true => f32::NAN,
                    false => c.at(row) as f32,
                }));
        }
        // About a thousand, counted in rows that are taken: a stretch may begin at any row.
        taken += 1;
        if !tip.is_empty() && (taken - 1).is_multiple_of((rows / every / 1_000).max(1)) {
            check(file, log, row, &time, tip.iter())?;
            let joints = core::array::from_fn(|i| inputs[i].at(row));
            let tip = core::array::from_fn(|i| tip[i].at(row));
            part.tips.push((number, (joints, tip)));
        }
    }
    close(&mut part, open.take(), label);
    if part.sequences.is_empty() {
        return Err(DataError::Empty {
            file: file.to_owned(),
        });
    }
    Ok(part)
}

/// A trial's number: whole, and exact as a float.
fn number_of(value: f64) -> Option<usize> {
    let whole = value.fract() == 0.0 && (0.0..=9e15).contains(&value);
    whole.then_some(value as usize)
}

struct Column<'a> {
    name: &'a str,
    /// `None`: the log has no such column; its value is 0.
    values: Option<&'a [f64]>,
    /// Factor and offset to the SI unit.
    scale: f64,
    offset: f64,
}

impl Column<'_> {
    const fn none() -> Self {
        Self {
            name: "",
            values: None,
            scale: 0.0,
            offset: 0.0,
        }
    }

    fn at(&self, row: usize) -> f64 {
        self.raw(row) * self.scale + self.offset
    }

    fn raw(&self, row: usize) -> f64 {
        self.values.map_or(0.0, |values| values[row])
    }

    fn rows(&self) -> usize {
        self.values.map_or(0, <[f64]>::len)
    }
}

fn check<'a>(
    file: &str,
    log: &dyn Columns,
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
                value: column.raw(row),
                row: row + 1,
                line: log.line(row),
                time_s: time.at(row),
            });
        }
    }
    Ok(())
}

/// Keeps a stretch: for a training one of at least a second, for a replay each, as it would come
/// live.
fn close(part: &mut Part, sequence: Option<Sequence>, label: Label) {
    if let Some(sequence) = sequence {
        if label == Label::WhereThere || sequence.rows() as f64 * sequence.step_s >= 1.0 {
            part.sequences.push(sequence);
        } else {
            part.short += sequence.rows();
        }
    }
}

/// Median step of the time, s.
fn step_s(file: &str, time: &Column<'_>) -> Result<f64, DataError> {
    let mut steps: Vec<f64> = (1..time.rows())
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

/// The robot's base from joints (rad, rad, m) and reported tips (m), or the CRTK frame where logs
/// have no tips.
///
/// # Errors
/// The tips do not fit the kinematics.
pub fn base(pairs: &[Pose]) -> Result<Base, crate::geometry::BaseError> {
    if pairs.is_empty() {
        return Ok(Base::default());
    }
    Base::fit(pairs)
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

        fn text(&self, name: &str) -> Option<(&str, u64)> {
            (name == "quality").then_some(("good", 2))
        }

        /// A line of names, then one a row.
        fn line(&self, row: usize) -> Option<u64> {
            Some(row as u64 + 2)
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
        for (n, source) in all.chain(&mapping.tip).enumerate() {
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
        read(
            "a.parquet",
            log,
            &Mapping::default(),
            rate_hz,
            Label::Needed,
        )
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

    /// As a link makes that loses a row in twenty.
    #[test]
    fn stretches_below_a_second_are_counted_and_replayed() {
        let mut log = log(1_000);
        for row in (300..1_000).step_by(60) {
            set(&mut log, "quality", row, 0.0);
        }
        let of = |label| read("a.parquet", &log, &Mapping::default(), 100.0, label).unwrap();
        let (train, replay) = (of(Label::Needed), of(Label::WhereThere));
        let rows = |part: &Part| part.sequences.iter().map(Sequence::rows).sum::<usize>();
        assert_eq!((train.unusable, train.short, rows(&train)), (12, 688, 300));
        assert_eq!((replay.short, rows(&replay)), (0, 988));
    }

    #[test]
    fn a_time_that_is_no_number_is_refused_or_ends_a_stretch() {
        let mut usable = log(1_000);
        set(&mut usable, "t_s", 499, f64::NAN);
        let error = read_at(&usable, 100.0).unwrap_err().to_string();
        for word in ["a.parquet", "`t_s`", "row 500"] {
            assert!(error.contains(word), "{error}");
        }
        // A gap whose rows are marked and have no time: what follows is no neighbour of what was
        // before.
        set(&mut usable, "quality", 499, 0.0);
        let part = read_at(&usable, 100.0).unwrap();
        let rows: Vec<usize> = part.sequences.iter().map(Sequence::rows).collect();
        assert_eq!(rows, [499, 500]);
        assert_eq!(part.sequences[1].start_s, 5.0);
    }

    #[test]
    fn a_trial_that_is_no_whole_number_is_refused_where_it_is_used() {
        for value in [f64::NAN, -1.0, 2.5, f64::INFINITY, 1e300] {
            let mut named = log(1_000);
            set(&mut named, "trial", 6, value);
            let error = read_at(&named, 50.0).unwrap_err().to_string();
            for word in [
                "a.parquet",
                "`trial`",
                "row 7",
                "line 8",
                "`trial = \"\"`",
                "--mapping",
            ] {
                assert!(error.contains(word), "{error}");
            }
            set(&mut named, "quality", 6, 0.0);
            let part = read_at(&named, 50.0).unwrap();
            assert!(part.sequences.iter().all(|s| s.trial == 4));
        }
    }

    #[test]
    fn refusals_name_file_and_column() {
        let mut missing = log(1_000);
        missing.0.retain(|(n, _)| n != "joint_effort_2");
        let mut text = log(1_000);
        text.0.retain(|(n, _)| n != "quality");
        let mut nan = log(1_000);
        set(&mut nan, "joint_velocity_3", 7, f64::NAN);
        let mut large = log(1_000);
        set(&mut large, "force_y_n", 3, 1e300);
        for (log, words) in [
            (
                &missing,
                vec![
                    "a.parquet",
                    "`joint_effort_2`",
                    "--mapping",
                    "absent = true",
                ],
            ),
            (&text, vec!["a.parquet", "`quality`", "`good`", "line 2"]),
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
    fn an_absent_input_is_zero_and_named_and_what_every_model_needs_is_refused() {
        let mut other = log(400);
        other.0.retain(|(n, _)| n != "joint_effort_1");
        let absent = Source::none();
        let mut mapping = Mapping::default();
        mapping.effort[0] = absent.clone();
        let part = read("c.csv", &other, &mapping, 100.0, Label::Needed).unwrap();
        assert_eq!(part.absent, [6]);
        assert_eq!(
            part.sequences[0].input_row(5)[5..8],
            [50_005.0, 0.0, 70_005.0]
        );

        let refused = |mapping: &Mapping| {
            let error = read("c.csv", &other, mapping, 100.0, Label::Needed).unwrap_err();
            error.to_string()
        };
        let mut none = mapping.clone();
        none.effort = [absent.clone(), absent.clone(), absent.clone()];
        assert!(refused(&none).contains("the effort of every joint is absent"));
        let mut blind = mapping.clone();
        blind.position[1] = absent.clone();
        let error = refused(&blind);
        assert!(
            error.contains("c.csv") && error.contains("a joint's position is absent"),
            "{error}"
        );
        // A log of one trial without marks and tips.
        let mut bare = mapping.clone();
        (bare.usable, bare.trial) = (String::new(), String::new());
        bare.tip = [absent.clone(), absent.clone(), absent.clone()];
        let mut plain = log(400);
        plain
            .0
            .retain(|(n, _)| n != "quality" && n != "trial" && !n.starts_with("tip_"));
        for word in ["`usable = \"\"`", "`trial = \"\"`"] {
            let mut named = mapping.clone();
            named.tip = bare.tip.clone();
            if word.contains("trial") {
                named.usable = String::new();
            }
            let error = read("d.csv", &plain, &named, 100.0, Label::Needed)
                .unwrap_err()
                .to_string();
            assert!(error.contains(word), "{error}");
        }
        let part = read("d.csv", &plain, &bare, 100.0, Label::Needed).unwrap();
        assert_eq!((part.sequences[0].rows(), part.tips.len()), (400, 0));
        let mut unnamed = mapping.clone();
        unnamed.velocity[2].column.clear();
        assert!(refused(&unnamed).contains("names no column for a joint's velocity"));
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
        let shoulder = Source {
            column: "shoulder_deg".to_owned(),
            unit: "deg".to_owned(),
            ..Source::default()
        };
        for (shoulder, value) in [
            (shoulder.clone(), 1.0),
            (
                Source {
                    scale: 0.5,
                    offset: 45.0,
                    ..shoulder.clone()
                },
                0.75,
            ),
        ] {
            mapping.position[0] = shoulder;
            let part = read("b.csv", &other, &mapping, 100.0, Label::Needed).unwrap();
            let read = part.sequences[0].input_row(0)[0] / std::f32::consts::PI;
            assert!((read - value).abs() < 1e-6, "{read}");
        }
        for (unit, word) in [("mm", "another quantity"), ("A", "not a unit")] {
            mapping.position[0].unit = unit.to_owned();
            let error = read("b.csv", &other, &mapping, 100.0, Label::Needed).unwrap_err();
            let error = error.to_string();
            for word in ["b.csv", "`shoulder_deg`", word, "rad", "scale"] {
                assert!(error.contains(word), "{error}");
            }
        }
    }
}

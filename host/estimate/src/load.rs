//! Data of an estimator from files: the dataset folder of an experiment, or any logs with a mapping
//! file.

use super::plausible;
use estimator::data::{self, Columns, Label, Mapping, Part, Pose};
use estimator::estimator::Estimator;
use estimator::geometry::Base;
use estimator::model::ModelError;
use estimator::sequence::Sequence;
use residual::load::Table;
use residual::spec::Action;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Why data can't be used. The text says what, where, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct LoadError(pub String);

/// Name of a robot that neither a data card nor a mapping names.
pub const UNNAMED: &str = "unnamed";

pub(crate) fn failed(path: &Path, cause: impl std::fmt::Display) -> LoadError {
    LoadError(format!("{}: {cause}", path.display()))
}

/// One file: a trial, or several with a column for their number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// File name.
    pub file: String,
    /// SHA-256 of its bytes.
    pub sha256: String,
    /// Trials in it.
    pub trials: Vec<usize>,
    /// Rows that were marked as not usable.
    pub rows_not_usable: usize,
    /// Lines that are no rows and were left out.
    #[serde(default)]
    pub lines_left_out: usize,
    /// Usable rows that were left out because gaps cut the log into stretches below a second.
    #[serde(default)]
    pub rows_in_short_stretches: usize,
    /// Rows that were taken.
    #[serde(default)]
    pub rows: usize,
}

/// Share of a file's usable rows from which on their loss is told.
const TOLD: f64 = 0.01;

impl Source {
    /// What was left out of the file, in sentences; `None` where nothing was.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        let mut out = Vec::new();
        let (lines, are) = match self.lines_left_out {
            1 => ("line", "is no row and was"),
            _ => ("lines", "are no rows and were"),
        };
        if self.lines_left_out > 0 {
            let count = self.lines_left_out;
            out.push(format!("{count} {lines} of {} {are} left out.", self.file));
        }
        let short = self.rows_in_short_stretches;
        if short as f64 > TOLD * (self.rows + short) as f64 {
            out.push(format!(
                "{short} rows of {} stand in stretches below a second, between gaps of the time or rows that are not usable, and were left out.",
                self.file
            ));
        }
        (!out.is_empty()).then(|| out.join(" "))
    }
}

/// What a data card tells of the label's time, from the experiment's own figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sampling {
    /// Largest median distance in time from a row to the nearest load-cell sample over trials, s.
    pub force_age_s: f64,
    /// Largest uncertainty of the time between robot and board over trials, s.
    pub sync_error_s: f64,
}

/// Trials.
#[derive(Debug, Clone)]
pub struct Data {
    /// Folder or file that was given.
    pub name: String,
    /// Robot that published the states. A model is used for this one only.
    pub robot: String,
    /// Files.
    pub sources: Vec<Source>,
    /// Unbroken stretches in order of their trials, with the force's three components as targets.
    pub sequences: Vec<Sequence>,
    /// Joints (rad, rad, m) and reported tips (m) by trial: see [`Data::base`].
    tips: Vec<(usize, Pose)>,
    /// Rows per second of the files.
    pub file_rate_hz: f64,
    /// Time of the label; `None` where the log has no data card.
    pub sampling: Option<Sampling>,
    /// Component along which the experiment pulls, where its card names one; else those that the
    /// mapping calls measured.
    pub axes: Vec<usize>,
    /// Inputs that the files lack, by their place in [`estimator::motion::INPUT_NAMES`]; they are 0
    /// in the sequences.
    pub absent: Vec<usize>,
}

/// A table as the estimator reads it.
struct Read(Table);

impl Columns for Read {
    fn column(&self, name: &str) -> Option<&[f64]> {
        self.0.column(name)
    }

    fn names(&self) -> Vec<String> {
        self.0.all_names()
    }

    fn text(&self, name: &str) -> Option<(&str, u64)> {
        self.0.text(name)
    }

    fn line(&self, row: usize) -> Option<u64> {
        self.0.line(row)
    }
}

/// Reads a table: Parquet by its name, else text with a header. A cell that is empty is NaN.
fn table(path: &Path, mapping: &Mapping) -> Result<Read, LoadError> {
    let input = &mapping.input;
    // Rows of a model are unbroken stretches of trials.
    for (key, used) in [
        ("sequence", !input.sequence.is_empty()),
        ("messages", !input.messages.is_empty()),
    ] {
        if used {
            return Err(LoadError(format!(
                "input.{key} of the mapping file is for `forcectl residual` alone: give each trial a file or a number in the column that `trial` names"
            )));
        }
    }
    // Text in rows that are marked unusable does no harm; in the marks themselves it does.
    let used: Vec<&str> = match mapping.text {
        Action::Drop => mapping.columns().collect(),
        _ => mapping
            .usable()
            .into_iter()
            .chain(mapping.trial())
            .collect(),
    };
    let words = |error: residual::Error| {
        let mut text = error.to_string();
        for (of_analysis, here) in [
            ("hygiene.text", "text"),
            ("roles.time", "time"),
            ("--data", "the folder"),
            ("model file", "mapping file"),
        ] {
            text = text.replace(of_analysis, here);
        }
        LoadError(text)
    };
    let table = residual::load::read(path, input, mapping.text, &mapping.time.column, &used)
        .map_err(words)?;
    // Text in the cells of some rows is refused where these are used.
    let text = (mapping.columns()).find_map(|column| Some((column, table.text(column)?)));
    let Some((column, (cell, line))) = text else {
        return Ok(Read(table));
    };
    let advice = match column {
        _ if mapping.trial() == Some(column) => {
            "number the trials, or write `trial = \"\"` in a mapping file (--mapping): each file is then a trial"
        }
        _ if mapping.usable() == Some(column) => {
            "write 1 where a row can be used, or `usable = \"\"` in a mapping file (--mapping): every row is taken"
        }
        _ => "name a column of numbers in a mapping file (--mapping); `input.skip` there leaves out lines above the header",
    };
    Err(failed(
        path,
        format!("line {line}: column `{column}` is text (`{cell}`); {advice}"),
    ))
}

/// Reads a mapping file.
///
/// # Errors
/// The file can't be read, or a key is wrong.
pub fn mapping(path: &Path) -> Result<Mapping, LoadError> {
    let text = ::files::read_text(path).map_err(|e| failed(path, e))?;
    let mapping: Mapping = toml::from_str(&text).map_err(|e| failed(path, e))?;
    mapping.input.check().map_err(|e| failed(path, e))?;
    if mapping.text == Action::Fix {
        return Err(failed(path, "text is \"report\" or \"drop\""));
    }
    if mapping.text == Action::Drop && mapping.input.rate > 0.0 {
        return Err(failed(
            path,
            "nobody knows how long a line took that is left out: text = \"drop\" needs a column with the time in place of input.rate",
        ));
    }
    Ok(mapping)
}

/// The dataset's files below a folder, or the file itself.
fn files(path: &Path) -> Result<(Vec<PathBuf>, Option<PathBuf>), LoadError> {
    if path.is_file() {
        // A file of a dataset is of the robot that the card beside it names.
        let card = path.with_file_name("card.json");
        return Ok((vec![path.to_owned()], card.is_file().then_some(card)));
    }
    let inner = path.join("dataset");
    let folder = if inner.is_dir() {
        inner
    } else {
        path.to_owned()
    };
    let entries = std::fs::read_dir(&folder).map_err(|e| failed(&folder, e))?;
    let is_log = |path: &PathBuf| {
        let name = path.to_string_lossy();
        [".parquet", ".csv", ".csv.gz"]
            .iter()
            .any(|end| name.ends_with(end))
    };
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(is_log)
        .collect();
    found.sort();
    if found.is_empty() {
        return Err(failed(&folder, "there is no .parquet, .csv or .csv.gz file; give the folder of `forcectl experiment run`, or a log"));
    }
    let card = folder.join("card.json");
    Ok((found, card.is_file().then_some(card)))
}

/// Reads a folder or a file at `rate_hz`.
///
/// # Errors
/// [`LoadError`]: what is refused is listed in [`estimator::data`].
pub fn load(path: &Path, mapping: &Mapping, rate_hz: f64, label: Label) -> Result<Data, LoadError> {
    let (files, card) = files(path)?;
    let card: Option<serde_json::Value> = match card {
        Some(card) => {
            let text = ::files::read_text(&card).map_err(|e| failed(&card, e))?;
            Some(serde_json::from_str(&text).map_err(|e| failed(&card, e))?)
        }
        None => None,
    };
    let axes = axes_of(path, card.as_ref(), mapping, label)?;
    let mut parts: Vec<Part> = Vec::new();
    let mut sources: Vec<Source> = Vec::new();
    for (number, file) in files.iter().enumerate() {
        let table = table(file, mapping)?;
        let mut part = data::read(&file.display().to_string(), &table, mapping, rate_hz, label)
            .map_err(|e| LoadError(e.to_string()))?;
        plausible::check_velocities(file, &part.sequences, mapping)?;
        if mapping.trial().is_none() {
            part.sequences.iter_mut().for_each(|s| s.trial = number + 1);
            part.tips
                .iter_mut()
                .for_each(|(trial, _)| *trial = number + 1);
        }
        let mut trials: Vec<usize> = part.sequences.iter().map(|s| s.trial).collect();
        trials.sort_unstable();
        trials.dedup();
        // Their rows would be taken for one trial, and a split between trials would be none.
        let in_earlier = |s: &&Source| s.trials.iter().any(|t| trials.contains(t));
        if let Some(earlier) = sources.iter().find(in_earlier) {
            return Err(failed(
                file,
                format!(
                    "it has a trial of {} too ({:?} and {trials:?} by column `{}`); give each trial its own number, or write `trial = \"\"` in a mapping file (--mapping): each file is then a trial",
                    earlier.file, earlier.trials, mapping.trial
                ),
            ));
        }
        sources.push(Source {
            file: file
                .file_name()
                .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            sha256: files::sha256(file).map_err(|e| failed(file, e))?,
            trials,
            rows_not_usable: part.unusable,
            rows_in_short_stretches: part.short,
            rows: part.sequences.iter().map(Sequence::rows).sum(),
            lines_left_out: table.0.lines_left_out(),
        });
        parts.push(part);
    }
    let tips: Vec<(usize, Pose)> = (parts.iter())
        .flat_map(|p| p.tips.iter().copied())
        .collect();
    // A check alone: what a model takes from it is fitted to its training.
    base_of(path, &tips, |_| true)?;
    let absent = parts.first().map_or_else(Vec::new, |p| p.absent.clone());
    let file_rate_hz = parts.first().map_or(rate_hz, |p| p.rate_hz);
    let mut sequences: Vec<Sequence> = parts.into_iter().flat_map(|p| p.sequences).collect();
    plausible::check_units(path, &sequences)?;
    sequences.sort_by(|a, b| {
        (a.trial, a.start_s)
            .partial_cmp(&(b.trial, b.start_s))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(Data {
        name: path.display().to_string(),
        robot: if mapping.robot.is_empty() {
            card.as_ref().map_or_else(|| UNNAMED.to_owned(), robot_of)
        } else {
            mapping.robot.clone()
        },
        sampling: card.as_ref().and_then(sampling_of),
        axes,
        sources,
        sequences,
        tips,
        file_rate_hz,
        absent,
    })
}

fn base_of(
    path: &Path,
    tips: &[(usize, Pose)],
    of: impl Fn(usize) -> bool,
) -> Result<Base, LoadError> {
    let pairs: Vec<Pose> = (tips.iter())
        .filter(|(trial, _)| of(*trial))
        .map(|(_, pair)| *pair)
        .collect();
    data::base(&pairs).map_err(|error| failed(path, error))
}

/// Components of the force that the data have.
fn axes_of(
    path: &Path,
    card: Option<&serde_json::Value>,
    mapping: &Mapping,
    label: Label,
) -> Result<Vec<usize>, LoadError> {
    if let Some(axis) = card.and_then(axis_of) {
        return Ok(vec![axis]);
    }
    // A model would learn that a component is always 0.
    let axes: Vec<usize> = (0..3).filter(|a| mapping.force[*a].is_measured()).collect();
    if axes.is_empty() && label == Label::Needed {
        return Err(failed(
            path,
            "the mapping file has no measured component of `force`: all three are absent or have the scale 0; name the column of the measured one",
        ));
    }
    Ok(axes)
}

/// Name of the robot by the data card: `name` of its `[robot]`. A virtual arm is named after what
/// it is drawn from. An address is no name: any robot can publish there.
fn robot_of(card: &serde_json::Value) -> String {
    let experiment = &card["experiment"];
    let robot = &experiment["robot"];
    if let Some(name) = robot["name"].as_str() {
        return name.to_owned();
    }
    let kind = robot["kind"].as_str().unwrap_or("robot");
    let which = if kind == "virtual" {
        let seed = robot["seed"]
            .as_u64()
            .or_else(|| experiment["seed"].as_u64());
        let arm = &robot["arm"];
        let payload = arm["payload_kg"]
            .as_f64()
            .filter(|kg| *kg > 0.0)
            .map_or_else(String::new, |kg| format!(", payload {kg} kg"));
        format!("seed {}{payload}", seed.unwrap_or_default())
    } else {
        return UNNAMED.to_owned();
    };
    format!("{kind} {which}").trim().to_owned()
}

/// Main component of a force along one axis.
fn axis_of(card: &serde_json::Value) -> Option<usize> {
    let force = &card["experiment"]["force"];
    if force["kind"] != "one_axis" {
        return None;
    }
    let axis: Vec<f64> = force["axis"]
        .as_array()?
        .iter()
        .filter_map(serde_json::Value::as_f64)
        .collect();
    (0..axis.len().min(3)).max_by(|a, b| axis[*a].abs().total_cmp(&axis[*b].abs()))
}

fn sampling_of(card: &serde_json::Value) -> Option<Sampling> {
    let largest = |key: &str| {
        let values = card["trials"]
            .as_array()?
            .iter()
            .filter_map(|t| t["figures"][key].as_f64());
        values.fold(None, |most: Option<f64>, v| {
            Some(most.map_or(v, |m| m.max(v)))
        })
    };
    Some(Sampling {
        force_age_s: largest("force_age_s")?,
        sync_error_s: largest("sync_error_s")?,
    })
}

/// Refuses a model of another robot, unless `any` may be.
///
/// # Errors
/// The model was trained on a robot of another name.
pub fn check_robot(estimator: &Estimator, robot: &str, any: bool) -> Result<(), LoadError> {
    if any || estimator.robot == robot {
        return Ok(());
    }
    Err(LoadError(format!(
        "the model was trained on the robot `{}`, these data are of `{robot}`: friction differs from robot to robot. Train on this robot, or see the error with --any-robot",
        estimator.robot
    )))
}

impl Data {
    /// What was left out of the files, a sentence for each that lost lines.
    #[must_use]
    pub fn losses(&self) -> Vec<String> {
        self.sources.iter().filter_map(Source::loss).collect()
    }

    /// Numbers of the trials, in order.
    #[must_use]
    pub fn trials(&self) -> Vec<usize> {
        let mut trials: Vec<usize> = self.sequences.iter().map(|s| s.trial).collect();
        trials.dedup();
        trials
    }

    /// Where the robot's base stands in the frame of the force, from the reported tips of these
    /// trials alone.
    ///
    /// # Errors
    /// The tips do not fit the kinematics, or hardly move.
    pub fn base(&self, trials: &[usize]) -> Result<Base, LoadError> {
        base_of(Path::new(&self.name), &self.tips, |trial| {
            trials.contains(&trial)
        })
    }

    /// Trials for training and for testing: those of `test`, or the last two of nine, as in the
    /// thesis.
    ///
    /// # Errors
    /// There is no such trial, or none is left for training or for testing.
    pub fn split(&self, test: &[usize]) -> Result<(Vec<usize>, Vec<usize>), LoadError> {
        let all = self.trials();
        if let Some(wrong) = test.iter().find(|t| !all.contains(t)) {
            return Err(LoadError(format!(
                "--test {wrong}: {} has the trials {all:?}",
                self.name
            )));
        }
        let test: Vec<usize> = if test.is_empty() {
            let count = (all.len() * 2).div_ceil(9).min(all.len().saturating_sub(1));
            all[all.len() - count..].to_vec()
        } else {
            test.to_vec()
        };
        if test.is_empty() {
            return Err(LoadError(format!(
                "{}: there is one trial ({all:?}), and none is left for testing; the split is between trials, never within one. Give more trials, or write `trial = \"\"` in a mapping file (--mapping) where each file is a trial",
                self.name
            )));
        }
        let training: Vec<usize> = all.into_iter().filter(|t| !test.contains(t)).collect();
        if training.is_empty() {
            return Err(LoadError(
                "no trial is left for training; the split is between trials, never within one"
                    .to_owned(),
            ));
        }
        Ok((training, test))
    }

    /// Brings the inputs to those of a model.
    ///
    /// # Errors
    /// The files lack an input that the model was trained with.
    pub fn fit_inputs(&mut self, estimator: &Estimator) -> Result<(), ModelError> {
        let hold = estimator.fit_inputs(&self.absent)?;
        self.sequences
            .iter_mut()
            .for_each(|s| hold.apply(&mut s.input));
        Ok(())
    }

    /// Stretches of these trials.
    #[must_use]
    pub fn of(&self, trials: &[usize]) -> Vec<&Sequence> {
        self.sequences
            .iter()
            .filter(|s| trials.contains(&s.trial))
            .collect()
    }

    /// Minutes of rows.
    #[must_use]
    pub fn minutes(sequences: &[&Sequence]) -> f64 {
        sequences
            .iter()
            .map(|s| s.rows() as f64 * s.step_s)
            .sum::<f64>()
            / 60.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::table::Table;
    use robot::kinematics::{forward, to_crtk};

    /// Three seconds of a moving arm at 100 Hz.
    fn rows(names: &[&str]) -> Table {
        let mut table = Table::new(names.iter().map(|n| (*n).to_owned()).collect());
        for k in 0..300 {
            let t = f64::from(k) * 0.01;
            let q = [
                0.7 + 0.3 * t.sin(),
                1.4 + 0.3 * (0.7 * t).cos(),
                0.38 + 0.03 * (1.3 * t).sin(),
            ];
            let tip = to_crtk(forward(&[q[0], q[1], q[2], 0.0, 0.0, 0.0]).position_m);
            let row: Vec<f64> = names
                .iter()
                .map(|name| match *name {
                    "t_s" => t,
                    "joint_position_1" => q[0],
                    "joint_position_2" => q[1],
                    "joint_position_3" => q[2],
                    "tip_x_m" => tip.x,
                    "tip_y_m" => tip.y,
                    "tip_z_m" => tip.z,
                    "quality" => 1.0,
                    "trial" => 2.0,
                    _ => 0.5,
                })
                .collect();
            table.push(&row);
        }
        table
    }

    const NAMES: [&str; 18] = [
        "t_s",
        "joint_position_1",
        "joint_position_2",
        "joint_position_3",
        "joint_velocity_1",
        "joint_velocity_2",
        "joint_velocity_3",
        "joint_effort_1",
        "joint_effort_2",
        "joint_effort_3",
        "force_x_n",
        "force_y_n",
        "force_z_n",
        "tip_x_m",
        "tip_y_m",
        "tip_z_m",
        "quality",
        "trial",
    ];

    #[test]
    fn a_dataset_folder_tells_robot_axis_and_age_of_the_label() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("dataset");
        std::fs::create_dir(&inner).unwrap();
        rows(&NAMES)
            .write(&inner.join("trial-02.parquet"), &[])
            .unwrap();
        let card = serde_json::json!({
            "experiment": {"seed": 3, "robot": {"kind": "virtual", "seed": null}, "force": {"kind": "one_axis", "axis": [0.0, 1.0, 0.0]}},
            "trials": [{"figures": {"force_age_s": 0.001, "sync_error_s": 1e-6}}, {"figures": {"force_age_s": 0.002, "sync_error_s": 1e-6}}],
        });
        std::fs::write(inner.join("card.json"), card.to_string()).unwrap();
        let data = load(folder.path(), &Mapping::default(), 50.0, Label::Needed).unwrap();
        assert_eq!(
            (data.robot.as_str(), data.axes.as_slice()),
            ("virtual seed 3", [1].as_slice())
        );
        assert_eq!((data.trials(), data.sequences[0].rows()), (vec![2], 150));
        assert!((data.sampling.unwrap().force_age_s - 0.002).abs() < 1e-12);
        assert_eq!(data.sources[0].sha256.len(), 64);
        // A file of it is of the same robot.
        let file = inner.join("trial-02.parquet");
        let one = load(&file, &Mapping::default(), 50.0, Label::Needed).unwrap();
        assert_eq!((one.robot, one.axes), (data.robot, data.axes));
        let error = load(folder.path(), &Mapping::default(), 30.0, Label::Needed)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("trial-02.parquet") && error.contains("30.00 Hz"),
            "{error}"
        );
    }

    #[test]
    fn any_log_is_read_by_a_mapping_and_mistakes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("day.csv");
        let table = rows(&NAMES);
        let mut text = NAMES.join(",").replace("joint_effort_2", "elbow_nmm") + "\n";
        for k in 0..table.rows() {
            let cells: Vec<String> = NAMES
                .iter()
                .map(|n| table.column(n).unwrap()[k].to_string())
                .collect();
            text += &(cells.join(",") + "\n");
        }
        std::fs::write(&log, &text).unwrap();
        let error = load(&log, &Mapping::default(), 50.0, Label::Needed)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("day.csv") && error.contains("`joint_effort_2`"),
            "{error}"
        );
        let map = folder.path().join("map.toml");
        let named = |column: &str| format!("{{ column = \"{column}\" }}");
        let effort = format!(
            "{}, {{ column = \"elbow_nmm\", unit = \"N·mm\" }}, {}",
            named("joint_effort_1"),
            named("joint_effort_3")
        );
        std::fs::write(&map, format!("robot = \"mine\"\neffort = [{effort}]\n")).unwrap();
        let data = load(&log, &mapping(&map).unwrap(), 100.0, Label::Needed).unwrap();
        assert_eq!((data.robot.as_str(), data.axes.len()), ("mine", 3));
        // One component was measured, as in docs/estimation.md.
        let force = "robot = \"mine\"\ntrial = \"\"\nforce = [{ absent = true }, { column = \"force_y_n\" }, { column = \"force_y_n\", scale = 0.0 }]\n";
        let one_axis = folder.path().join("one-axis.toml");
        std::fs::write(&one_axis, format!("{force}effort = [{effort}]\n")).unwrap();
        let one = load(&log, &mapping(&one_axis).unwrap(), 100.0, Label::Needed).unwrap();
        assert_eq!(one.axes, [1]);
        let mut none = mapping(&one_axis).unwrap();
        none.force[1].scale = 0.0;
        let error = load(&log, &none, 100.0, Label::Needed)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("day.csv") && error.contains("scale 0"),
            "{error}"
        );
        // Two files that hold the same trial.
        let days = folder.path().join("days");
        std::fs::create_dir(&days).unwrap();
        for name in ["a.csv", "b.csv"] {
            std::fs::copy(&log, days.join(name)).unwrap();
        }
        let error = load(&days, &mapping(&map).unwrap(), 50.0, Label::Needed)
            .unwrap_err()
            .to_string();
        for word in ["b.csv", "a.csv", "`trial`", "`trial = \"\"`"] {
            assert!(error.contains(word), "{error}");
        }
        let both = load(&days, &mapping(&one_axis).unwrap(), 50.0, Label::Needed).unwrap();
        assert_eq!(both.trials(), [1, 2]);
        let data = load(&log, &mapping(&map).unwrap(), 100.0, Label::Needed).unwrap();
        assert!((data.sequences[0].input_row(0)[7] - 0.0005).abs() < 1e-9);
        // A time that is not a number, in the fifth row: without the word the same file is read.
        let broken = text.replacen("\n0.04,", "\nbroken,", 1);
        assert_ne!(broken, text);
        std::fs::write(&log, broken).unwrap();
        let error = load(&log, &mapping(&map).unwrap(), 50.0, Label::Needed)
            .unwrap_err()
            .to_string();
        for word in ["day.csv", "`t_s`", "row 5", "line 6"] {
            assert!(error.contains(word), "{error}");
        }
        std::fs::write(&map, "efort = []\n").unwrap();
        assert!(mapping(&map).unwrap_err().to_string().contains("efort"));
    }

    #[test]
    fn a_spreadsheet_of_another_country_is_described_as_for_the_analysis() {
        let folder = tempfile::tempdir().unwrap();
        let table = rows(&NAMES);
        // Semicolons, decimal commas, a line above the header, angles in degrees, time in two
        // columns, the trial in the file's name.
        let kept: Vec<&str> = (NAMES.iter().copied())
            .filter(|n| !["t_s", "trial", "quality"].contains(n))
            .collect();
        let mut text = format!("day 4\nsecs;nsecs;{}\n", kept.join(";"));
        for k in 0..table.rows() {
            let value = |name: &str| {
                let value = table.column(name).unwrap()[k];
                let value = match name {
                    "joint_position_1" => value.to_degrees(),
                    _ => value,
                };
                value.to_string().replace('.', ",")
            };
            let cells: Vec<String> = kept.iter().map(|name| value(name)).collect();
            let ns = (table.column("t_s").unwrap()[k] * 1e9).round() as u64;
            let (secs, ns) = (7 + ns / 1_000_000_000, ns % 1_000_000_000);
            text += &format!("{secs};{ns};{}\n", cells.join(";"));
        }
        let log = folder.path().join("run-12.csv");
        std::fs::write(&log, &text).unwrap();
        let map = folder.path().join("map.toml");
        let others = "{ column = \"joint_position_2\" }, { column = \"joint_position_3\" }";
        let words = format!(
            "time = {{ column = \"secs + nsecs\" }}\nusable = \"\"\nrobot = \"mine\"\n\
             position = [{{ column = \"joint_position_1\", unit = \"deg\" }}, {others}]\n\
             [input]\nskip = 1\nseparator = \";\"\ndecimal = \",\"\nfile_name = \"run-{{trial}}.csv\"\n"
        );
        std::fs::write(&map, &words).unwrap();
        let read = |words: &str| {
            std::fs::write(&map, words).unwrap();
            load(&log, &mapping(&map).unwrap(), 100.0, Label::Needed)
        };
        let data = read(&words).unwrap();
        let plain = folder.path().join("plain.parquet");
        table.write(&plain, &[]).unwrap();
        let plain = load(&plain, &Mapping::default(), 100.0, Label::Needed).unwrap();
        assert_eq!(data.trials(), [12]);
        assert_eq!(data.sequences[0].rows(), plain.sequences[0].rows());
        for (a, b) in (data.sequences[0].input.iter()).zip(&plain.sequences[0].input) {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} {b}");
        }
        // What is of the analysis alone, and a line that is no row.
        let split = words.clone() + "sequence = [\"unit\"]\n";
        let error = read(&split).unwrap_err().to_string();
        assert!(
            error.contains("input.sequence") && error.contains("trial"),
            "{error}"
        );
        let cut = text.trim_end().rsplit_once(';').unwrap().0;
        std::fs::write(&log, cut).unwrap();
        let error = read(&words).unwrap_err().to_string();
        assert!(
            error.contains("run-12.csv")
                && error.contains("text = \"drop\"")
                && error.contains("mapping file"),
            "{error}"
        );
        let fewer = read(&("text = \"drop\"\n".to_owned() + &words)).unwrap();
        assert_eq!(fewer.sequences[0].rows(), data.sequences[0].rows() - 1);
    }

    #[test]
    fn words_of_a_mapping_that_have_no_meaning_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let map = folder.path().join("map.toml");
        for (words, word) in [
            ("[input]\ndecimal = \";\"\n", "input.decimal"),
            ("[input]\nrate = -100.0\n", "input.rate"),
            ("text = \"fix\"\n", "\"drop\""),
            ("text = \"drop\"\n[input]\nrate = 100.0\n", "input.rate"),
        ] {
            std::fs::write(&map, words).unwrap();
            let error = mapping(&map).unwrap_err().to_string();
            assert!(
                error.contains("map.toml") && error.contains(word),
                "{error}"
            );
        }
    }

    /// What a force is measured in, and of which parts, is not told by its absence.
    #[test]
    fn a_force_that_is_not_needed_is_still_read_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log.parquet");
        rows(&NAMES).write(&log, &[]).unwrap();
        let read = |unit: &str| {
            let map = folder.path().join("map.toml");
            let y = format!("{{ column = \"force_y_n\", unit = \"{unit}\" }}");
            let force = format!("force = [{{ absent = true }}, {y}, {{ absent = true }}]\n");
            std::fs::write(&map, force).unwrap();
            load(&log, &mapping(&map).unwrap(), 100.0, Label::WhereThere)
        };
        let error = read("kgf").unwrap_err().to_string();
        assert!(
            error.contains("`kgf`") && error.contains("force_y_n"),
            "{error}"
        );
        let data = read("mN").unwrap();
        let plain = load(&log, &Mapping::default(), 100.0, Label::WhereThere).unwrap();
        for k in [0, 7] {
            let force = data.sequences[0].target_row(k);
            let n = plain.sequences[0].target_row(k)[1];
            assert!(force[0].is_nan() && force[2].is_nan(), "{force:?}");
            assert!(
                (force[1] - 1e-3 * n).abs() <= 1e-6 * n.abs(),
                "{force:?} {n}"
            );
        }
        // Without the columns the force is not known.
        let other: Vec<&str> = (NAMES.iter().copied())
            .filter(|n| !n.starts_with("force_"))
            .collect();
        rows(&other).write(&log, &[]).unwrap();
        let none = load(&log, &Mapping::default(), 100.0, Label::WhereThere).unwrap();
        assert!(none.sequences[0].target.iter().all(|n| n.is_nan()));
    }

    #[test]
    fn text_among_numbers_is_left_out_or_named_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let table = rows(&NAMES);
        let write = |name: &str, row: usize, column: &str| {
            let mut text = "head\n".to_owned() + &NAMES.join(",") + "\n";
            for k in 0..table.rows() {
                let cell = |n: &&str| match (k == row, *n == column) {
                    (true, true) => "ERR".to_owned(),
                    _ => table.column(n).unwrap()[k].to_string(),
                };
                text += &(NAMES.iter().map(cell).collect::<Vec<_>>().join(",") + "\n");
            }
            let log = folder.path().join(name);
            std::fs::write(&log, text).unwrap();
            log
        };
        let read = |log: &Path, words: &str| {
            let map = folder.path().join("map.toml");
            std::fs::write(&map, words.to_owned() + "[input]\nskip = 1\n").unwrap();
            load(log, &mapping(&map).unwrap(), 100.0, Label::Needed)
        };
        let effort = write("effort.csv", 40, "joint_effort_2");
        // Row 41 of the log, below two lines.
        let error = read(&effort, "").unwrap_err().to_string();
        assert!(error.contains("row 41, line 43"), "{error}");
        let data = read(&effort, "text = \"drop\"\n").unwrap();
        assert_eq!(data.sources[0].lines_left_out, 1);
        // The rows before the gap are too few for a stretch.
        let loss = "1 line of effort.csv is no row and was left out. 40 rows of effort.csv stand in stretches below a second, between gaps of the \
                    time or rows that are not usable, and were left out.";
        assert_eq!(data.losses(), [loss]);
        assert_eq!(data.sequences[0].rows(), table.rows() - 41);
        let marks = write("marks.csv", 40, "quality");
        let error = read(&marks, "").unwrap_err().to_string();
        assert!(
            error.contains("marks.csv:43") && error.contains("`ERR`"),
            "{error}"
        );
        assert!(!error.contains("hygiene"), "{error}");
    }
}

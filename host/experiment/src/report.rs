//! The report of an experiment: figures over all trials, and pictures of what the data cover.

use super::card::{line, Card};
use super::error::ExperimentError;
use super::file::{Experiment, Force};
use super::folder::Folder;
use super::pictures::{maps, tall, visited, Axis, Panel};
use super::pull::OneAxis;
use super::table::{failed, Table};
use nalgebra::Vector3;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use wire::UNITS;

/// Most rows that the pictures are made of; more are thinned evenly.
const MOST_ROWS: usize = 2_000_000;
/// Half the time over which velocities are taken for the pictures, in rows: published ones have the
/// step of a count.
const HALF_WINDOW: usize = 5;
/// Length of the curves, s.
const CURVES_S: f64 = 90.0;
/// Files that a report consists of.
const FILES: [&str; 6] = [
    "README.md",
    "coverage.svg",
    "force-coverage.svg",
    "force.svg",
    "tracking.svg",
    "tensions.svg",
];

/// Writes data card, report and pictures into the folder; returns the report's folder.
///
/// # Errors
/// No trial is good yet, or a file can't be read or written.
pub fn write(folder: &Folder, experiment: &Experiment) -> Result<PathBuf, ExperimentError> {
    let card = Card::of(folder, experiment)?;
    if card.good().is_empty() {
        return Err(ExperimentError::Folder(format!(
            "{}: no trial is good yet; `forcectl experiment run` with --resume goes on",
            folder.root().display()
        )));
    }
    let data = Data::read(folder, experiment, &card)?;
    let dataset = folder.root().join("dataset");
    put(&dataset.join("README.md"), &card.markdown())?;
    put(&dataset.join("card.json"), &format!("{:#}\n", card.json()))?;
    let report = folder.root().join("report");
    std::fs::create_dir_all(&report).map_err(|error| failed(&report, error))?;
    for (name, svg) in data.pictures(experiment) {
        put(&report.join(name), &svg)?;
    }
    put(&report.join("README.md"), &data.text(experiment, &card))?;
    Ok(report)
}

/// Copies card, report and pictures, and no data, to another folder.
///
/// # Errors
/// A file can't be read or written.
pub fn copy(folder: &Folder, into: &Path) -> Result<(), ExperimentError> {
    std::fs::create_dir_all(into).map_err(|error| failed(into, error))?;
    let copy = |from: PathBuf, name: &str| {
        let to = into.join(name);
        let text = std::fs::read(&from).map_err(|error| failed(&from, error))?;
        std::fs::write(&to, text).map_err(|error| failed(&to, error))
    };
    for name in FILES {
        copy(folder.root().join("report").join(name), name)?;
    }
    for (name, as_name) in [("README.md", "data-card.md"), ("card.json", "card.json")] {
        copy(folder.root().join("dataset").join(name), as_name)?;
    }
    Ok(())
}

fn put(path: &Path, text: &str) -> Result<(), ExperimentError> {
    std::fs::write(path, text).map_err(|error| failed(path, error).into())
}

/// What the pictures need of all trials.
#[derive(Debug, Default)]
struct Data {
    joints: [Vec<f64>; 3],
    rates: [Vec<f64>; 3],
    tip_m: [Vec<f64>; 3],
    force_n: [Vec<f64>; 3],
    commanded_n: [Vec<f64>; 3],
    tension_n: [Vec<f64>; UNITS],
    /// The first trial's beginning.
    curves: Table,
    /// Sums of squares of force less truth, and rows, over all trials.
    label_square: [f64; 3],
    label_rows: u64,
    rows: u64,
    standing: u64,
}

/// Tip speed below which the tip counts as standing, m/s: below the slowest of the thesis's groups
/// (4.3: 0 to 2.4 mm/s in six).
const STANDING_M_PER_S: f64 = 0.4e-3;

/// Reads a table of the data set.
fn read(path: &Path) -> Result<Table, ExperimentError> {
    Table::read(path).map_err(|error| ExperimentError::Folder(error.to_string()))
}

impl Data {
    fn read(
        folder: &Folder,
        experiment: &Experiment,
        card: &Card<'_>,
    ) -> Result<Self, ExperimentError> {
        let all: u64 = card.good().iter().map(|a| a.figures.rows).sum();
        let stride = (all as usize).div_ceil(MOST_ROWS).max(1);
        let mut data = Self::default();
        for attempt in card.good() {
            folder.check_files(attempt)?;
            let table = read(&folder.dataset(attempt.trial))?;
            data.add(&table, stride, experiment.rate_hz);
            let truth = folder.truth(attempt.trial);
            if truth.is_file() {
                data.judge(&table, &read(&truth)?);
            }
            if data.curves.rows() == 0 {
                data.curves = table;
            }
        }
        Ok(data)
    }

    fn add(&mut self, table: &Table, stride: usize, rate_hz: f64) {
        let column = |name: &str| table.column(name).unwrap_or_default();
        let axes = ["x", "y", "z"];
        let thin = |values: &[f64], to: &mut Vec<f64>| to.extend(values.iter().step_by(stride));
        for i in 0..3 {
            let position = column(["joint_position_1", "joint_position_2", "joint_position_3"][i]);
            thin(position, &mut self.joints[i]);
            thin(&rates(position, rate_hz), &mut self.rates[i]);
            thin(column(&format!("tip_{}_m", axes[i])), &mut self.tip_m[i]);
            thin(
                column(&format!("force_{}_n", axes[i])),
                &mut self.force_n[i],
            );
            thin(
                column(&format!("force_commanded_{}_n", axes[i])),
                &mut self.commanded_n[i],
            );
        }
        for unit in 0..UNITS {
            thin(
                column(&format!("tension_{}_n", unit + 1)),
                &mut self.tension_n[unit],
            );
        }
        let speeds = axes.map(|axis| rates(column(&format!("tip_{axis}_m")), rate_hz));
        self.rows += table.rows() as u64;
        let [x, y, z] = &speeds;
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let speed = Vector3::new(*x, *y, *z).norm();
            self.standing += u64::from(speed < STANDING_M_PER_S);
        }
    }

    fn judge(&mut self, table: &Table, truth: &Table) {
        let pairs = ["x", "y", "z"].map(|axis| {
            (
                table.column(&format!("force_{axis}_n")).unwrap_or_default(),
                truth
                    .column(&format!("true_force_{axis}_n"))
                    .unwrap_or_default(),
            )
        });
        for row in 0..table.rows().min(truth.rows()) {
            let error = pairs.map(|(label, real)| label[row] - real[row]);
            if error.iter().all(|e| e.is_finite()) {
                self.label_rows += 1;
                for (sum, e) in self.label_square.iter_mut().zip(error) {
                    *sum += e * e;
                }
            }
        }
    }

    /// Force along the axis of a one-axis experiment, or its length.
    fn main_force(&self, experiment: &Experiment, of: &[Vec<f64>; 3]) -> (String, Vec<f64>) {
        let axis = OneAxis::of(&experiment.force).map(|one| one.axis);
        let values = (0..of[0].len())
            .map(|row| {
                let force = Vector3::from_fn(|i, _| of[i][row]);
                axis.map_or(force.norm(), |axis| force.dot(&axis))
            })
            .collect();
        (main_words(experiment), values)
    }

    fn pictures(&self, experiment: &Experiment) -> Vec<(&'static str, String)> {
        let degrees = |values: &[f64]| values.iter().map(|v| v.to_degrees()).collect::<Vec<_>>();
        let mm = |values: &[f64]| values.iter().map(|v| v * 1e3).collect::<Vec<_>>();
        let tip = [0, 1, 2].map(|i| {
            Axis::new(
                &format!("tip {}, mm", ["x", "y", "z"][i]),
                mm(&self.tip_m[i]),
            )
        });
        let joint = [
            Axis::new("shoulder, degrees", degrees(&self.joints[0])),
            Axis::new("elbow, degrees", degrees(&self.joints[1])),
            Axis::new("insertion, mm", mm(&self.joints[2])),
        ];
        let rate = [
            Axis::new("shoulder, degrees/s", degrees(&self.rates[0])),
            Axis::new("elbow, degrees/s", degrees(&self.rates[1])),
            Axis::new("insertion, mm/s", mm(&self.rates[2])),
        ];
        let (words, measured) = self.main_force(experiment, &self.force_n);
        let (_, commanded) = self.main_force(experiment, &self.commanded_n);
        let force = Axis::new(&words, measured.clone());
        let name = &experiment.name;
        vec![
            (
                "coverage.svg",
                maps(
                    &format!(
                        "{name}: tip, joints and joint velocities (the darker, the more often; logarithmic)"
                    ),
                    &[
                        (&tip[0], &tip[1]),
                        (&tip[0], &tip[2]),
                        (&tip[1], &tip[2]),
                        (&joint[0], &joint[1]),
                        (&joint[0], &joint[2]),
                        (&joint[1], &joint[2]),
                        (&rate[0], &rate[1]),
                        (&rate[0], &rate[2]),
                        (&rate[1], &rate[2]),
                    ],
                )
                .to_svg(),
            ),
            (
                "force-coverage.svg",
                maps(
                    &format!(
                        "{name}: force by joint and by joint velocity (the darker, the more often; logarithmic)"
                    ),
                    &[
                        (&joint[0], &force),
                        (&joint[1], &force),
                        (&joint[2], &force),
                        (&rate[0], &force),
                        (&rate[1], &force),
                        (&rate[2], &force),
                    ],
                )
                .to_svg(),
            ),
            ("force.svg", self.force_picture(experiment)),
            (
                "tracking.svg",
                self.tracking_picture(experiment, &measured, &commanded),
            ),
            ("tensions.svg", self.tensions_picture(experiment)),
        ]
    }

    fn force_picture(&self, experiment: &Experiment) -> String {
        let set = |of: &[Vec<f64>; 3], i: usize| of[i].clone();
        let panels: Vec<Panel> = (0..3)
            .map(|i| Panel::Histogram {
                title: format!("Force {}, per cent of the rows", ["x", "y", "z"][i]),
                x_words: "N".to_owned(),
                sets: vec![
                    ("measured".to_owned(), set(&self.force_n, i)),
                    ("commanded".to_owned(), set(&self.commanded_n, i)),
                ],
            })
            // A command of zero all the time would only be a spike.
            .map(|panel| match panel {
                Panel::Histogram {
                    title,
                    x_words,
                    sets,
                } => Panel::Histogram {
                    title,
                    x_words,
                    sets: sets
                        .into_iter()
                        .filter(|(_, v)| v.iter().any(|f| *f != 0.0))
                        .collect(),
                },
                other => other,
            })
            .collect();
        tall(&format!("{}: force on the tool", experiment.name), &panels).to_svg()
    }

    fn tracking_picture(
        &self,
        experiment: &Experiment,
        measured: &[f64],
        commanded: &[f64],
    ) -> String {
        let (t_s, rows) = self.beginning();
        let part = |name: &str| {
            let column = self.curves.column(name).unwrap_or_default();
            column[..rows.min(column.len())].to_vec()
        };
        let along = |prefix: &str| -> Vec<f64> {
            let columns = ["x", "y", "z"].map(|axis| part(&format!("{prefix}_{axis}_n")));
            let axis = OneAxis::of(&experiment.force).map(|one| one.axis);
            (0..rows)
                .map(|row| {
                    let force = Vector3::from_fn(|i, _| columns[i][row]);
                    axis.map_or(force.norm(), |axis| force.dot(&axis))
                })
                .collect()
        };
        let words = main_words(experiment);
        let error = measured.iter().zip(commanded).map(|(a, b)| a - b).collect();
        let panels = [
            Panel::Curves {
                title: format!("{words}: beginning of the first trial"),
                t_s,
                sets: vec![
                    ("measured".to_owned(), along("force")),
                    ("commanded".to_owned(), along("force_commanded")),
                ],
            },
            Panel::Histogram {
                title: "Measured less commanded, per cent of all rows".to_owned(),
                x_words: "N".to_owned(),
                sets: vec![("error".to_owned(), error)],
            },
        ];
        tall(&format!("{}: tracking", experiment.name), &panels).to_svg()
    }

    fn tensions_picture(&self, experiment: &Experiment) -> String {
        let (t_s, rows) = self.beginning();
        let used: Vec<usize> = (0..UNITS)
            .filter(|unit| self.tension_n[*unit].iter().any(|t| t.is_finite()))
            .collect();
        let name = |unit: usize| format!("cable {}", unit + 1);
        let curve = |unit: usize| {
            let column = self.curves.column(&format!("tension_{}_n", unit + 1));
            let column = column.unwrap_or_default();
            (name(unit), column[..rows.min(column.len())].to_vec())
        };
        let panels = [
            Panel::Curves {
                title: "Tension, N: beginning of the first trial".to_owned(),
                t_s,
                sets: used.iter().map(|unit| curve(*unit)).collect(),
            },
            Panel::Histogram {
                title: "Tension, per cent of all rows".to_owned(),
                x_words: "N".to_owned(),
                sets: (used
                    .iter()
                    .map(|unit| (name(*unit), self.tension_n[*unit].clone())))
                .collect(),
            },
        ];
        tall(&format!("{}: cable tensions", experiment.name), &panels).to_svg()
    }

    /// Times of the first trial's beginning, and how many rows that is.
    fn beginning(&self) -> (Vec<f64>, usize) {
        let t_s = self.curves.column("t_s").unwrap_or_default();
        let rows = t_s.partition_point(|t| *t <= CURVES_S);
        (t_s[..rows].to_vec(), rows)
    }

    fn text(&self, experiment: &Experiment, card: &Card<'_>) -> String {
        let mut text = String::new();
        line!(text, "# Report: {}\n", experiment.name);
        line!(
            text,
            "`forcectl experiment report` has written this page: {} of {} trials of {} min, seed {}, {} rows at {} Hz, {} attempts kept and \
             not used.\n",
            card.good().len(),
            experiment.trials,
            experiment.minutes,
            experiment.seed,
            self.rows,
            experiment.rate_hz,
            card.failed().len()
        );
        if !card.left().is_empty() {
            line!(
                text,
                "**Not complete**: trials {:?} are left to do.\n",
                card.left()
            );
        }
        self.figures(&mut text, experiment, card);
        line!(text, "\n## Coverage\n");
        for (what, x, y) in [
            ("tip x and y", &self.tip_m[0], &self.tip_m[1]),
            ("tip x and z", &self.tip_m[0], &self.tip_m[2]),
            ("shoulder and elbow", &self.joints[0], &self.joints[1]),
            ("shoulder and insertion", &self.joints[0], &self.joints[2]),
            (
                "velocities of shoulder and elbow",
                &self.rates[0],
                &self.rates[1],
            ),
        ] {
            line!(
                text,
                "- {what}: {:.0} % of the map's cells visited",
                100.0 * visited(x, y)
            );
        }
        let standing = 100.0 * self.standing as f64 / self.rows.max(1) as f64;
        line!(
            text,
            "- tip slower than {} mm/s: {standing:.1} % of the rows",
            STANDING_M_PER_S * 1e3
        );
        for (file, what) in [
            (
                "coverage.svg",
                "Coverage of workspace, joints and joint velocities",
            ),
            ("force-coverage.svg", "Force by joint and by joint velocity"),
            ("force.svg", "Histogram of the force"),
            ("tracking.svg", "Tracking of the commanded force"),
            ("tensions.svg", "Cable tensions"),
        ] {
            line!(text, "\n![{what}]({file})");
        }
        text
    }

    fn figures(&self, text: &mut String, experiment: &Experiment, card: &Card<'_>) {
        line!(text, "## Trials\n");
        line!(text, "| trial | rows | tracking RMS, N | largest, N | worst tension RMS, N | samples lost | saturated | clock, s | emulated s/s |");
        line!(
            text,
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
        );
        for a in card.good() {
            let f = &a.figures;
            let worst = f.tension_rms_n.iter().copied().fold(0.0, f64::max);
            line!(
                text,
                "| {} | {} of {} | {:.3} | {:.2} | {:.3} | {} of {} | {:.4} | {:.0} | {:.1} |",
                a.trial,
                f.rows,
                f.rows_expected,
                f.tracking_rms_n,
                f.tracking_largest_n,
                worst,
                f.samples_lost,
                f.samples + f.samples_lost,
                f.saturated,
                a.wall_s,
                experiment.trial_s() / a.wall_s.max(1e-9)
            );
        }
        let what = match experiment.force {
            Force::OneAxis { .. } => "along the axis",
            Force::ThreeAxes { .. } => "length of the difference",
        };
        line!(
            text,
            "\nTracking is measured less commanded force ({what})."
        );
        if self.label_rows > 0 {
            let [x, y, z] = self
                .label_square
                .map(|s| (s / self.label_rows as f64).sqrt());
            line!(
                text,
                "The label `force_..._n` differs from the force in the plant by {x:.3}, {y:.3}, {z:.3} N (RMS of x, y, z over {} rows).",
                self.label_rows
            );
        }
    }
}

fn main_words(experiment: &Experiment) -> String {
    match OneAxis::of(&experiment.force) {
        Some(_) => "force along the axis, N".to_owned(),
        None => "length of the force, N".to_owned(),
    }
}

/// Velocities from positions over a short time, at each row.
fn rates(position: &[f64], rate_hz: f64) -> Vec<f64> {
    let last = position.len().saturating_sub(1);
    (0..position.len())
        .map(|row| {
            let (from, to) = (
                row.saturating_sub(HALF_WINDOW),
                (row + HALF_WINDOW).min(last),
            );
            (position[to] - position[from]) * rate_hz / (to - from).max(1) as f64
        })
        .collect()
}

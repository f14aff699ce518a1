//! The data card: what a dataset is, as JSON for programs and Markdown for people.

use super::dataset::{Column, CELL_DELAY_S, COLUMNS, TRUTH_COLUMNS};
use super::error::ExperimentError;
use super::file::Experiment;
use super::folder::{Attempt, Folder, Status};
use serde_json::{json, Value};
use std::fmt::Write as _;

/// Adds a line to a text.
macro_rules! line {
    ($text:expr) => { line!($text, "") };
    ($text:expr, $($arg:tt)*) => {{
        let _ = writeln!($text, $($arg)*);
    }};
}
pub(super) use line;

/// Everything that a card tells.
#[derive(Debug)]
pub struct Card<'a> {
    experiment: &'a Experiment,
    good: Vec<Attempt>,
    failed: Vec<Attempt>,
    left: Vec<usize>,
    rig: Value,
}

impl<'a> Card<'a> {
    /// Of what a folder holds.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn of(folder: &Folder, experiment: &'a Experiment) -> Result<Self, ExperimentError> {
        let mut card = Self {
            experiment,
            good: Vec::new(),
            failed: Vec::new(),
            left: Vec::new(),
            rig: Value::Null,
        };
        for trial in 1..=experiment.trials {
            let attempts = folder.attempts(trial)?;
            if attempts.iter().all(|a| a.status != Status::Good) {
                card.left.push(trial);
            }
            for attempt in attempts {
                if attempt.status == Status::Good {
                    card.good.push(attempt);
                } else {
                    card.failed.push(attempt);
                }
            }
        }
        let path = folder.root().join("rig.json");
        card.rig = std::fs::read_to_string(&path)
            .ok()
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        Ok(card)
    }

    /// The good attempts.
    #[must_use]
    pub fn good(&self) -> &[Attempt] {
        &self.good
    }

    /// The attempts that are kept and not used.
    #[must_use]
    pub fn failed(&self) -> &[Attempt] {
        &self.failed
    }

    /// Trials that are still to be done.
    #[must_use]
    pub fn left(&self) -> &[usize] {
        &self.left
    }

    fn first(&self) -> Option<&Attempt> {
        self.good.first()
    }

    /// As JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        // The path of a rig file belongs to one computer.
        let mut experiment = self.experiment.clone();
        experiment.rig = (experiment.rig.as_ref())
            .and_then(|path| path.file_name())
            .map(Into::into);
        json!({
            "name": self.experiment.name,
            "page": "docs/dataset.md",
            "experiment": experiment,
            "experiment_hash_sha256": self.experiment.hash(),
            "rig_hash_sha256": self.rig["hash"],
            "rig_name": self.rig["rig"]["name"],
            "calibration": self.rig["calibration"],
            "robot": {
                "joint_names": self.first().map(|a| &a.joint_names),
                "effort": self.first().map(|a| &a.effort_meaning),
                "clock": self.first().map(|a| &a.robot_clock),
            },
            "force": {
                "columns": ["force_x_n", "force_y_n", "force_z_n"],
                "unit": "N",
                "frame": "rig (robot base frame of the rig file)",
                "acts": "on_tool",
                "by": "cables",
                "source": "load cells",
                "cell_delay_taken_off_s": CELL_DELAY_S,
            },
            "columns": columns(&COLUMNS),
            "truth": {
                "folder": "truth/",
                "use": "judging an estimator afterwards; no estimator may read it",
                "columns": columns(&TRUTH_COLUMNS),
            },
            "trials": self.good,
            "attempts_not_used": self.failed,
            "trials_left": self.left,
        })
    }

    /// The calibration that the labels rest on, in words: its age when the experiment began, and
    /// the last check.
    fn calibration(&self) -> String {
        let of = &self.rig["calibration"];
        let Some(date) = of["date"].as_str() else {
            return "none was stored: the labels rest on the numbers of the rig file".to_owned();
        };
        let age = (of["age_days"].as_i64()).map_or_else(
            || "no gain measured".to_owned(),
            |days| format!("gains {days} days old"),
        );
        let valid = (of["validity"]["until"].as_str())
            .map_or_else(String::new, |until| format!(", valid until {until}"));
        let checks = of["checks"].as_array().map_or(&[][..], Vec::as_slice);
        let last = checks.iter().filter_map(|c| c["date"].as_str()).max();
        let held = checks.iter().all(|c| c["holds"] == true);
        let check = match last {
            None => "never checked with a known weight".to_owned(),
            Some(day) if held => format!("checked with a known weight on {day}: holds"),
            Some(day) => format!("checked with a known weight on {day}: DID NOT HOLD"),
        };
        format!("of {date}, {age}{valid}; {check}")
    }

    /// As Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let e = self.experiment;
        let mut text = String::new();
        line!(text, "# Data card: {}\n", e.name);
        let rows: u64 = self.good.iter().map(|a| a.figures.rows).sum();
        line!(text, "{} of {} trials of {} min, {rows} rows at {} Hz. Columns: docs/dataset.md of the project, and below.\n",
            self.good.len(), e.trials, e.minutes, e.rate_hz);
        line!(text, "- **Label**: `force_x_n`, `force_y_n`, `force_z_n`: force **on the tool**, by the cables, in the rig's frame (robot base frame), N, from load cells.");
        line!(
            text,
            "- **Inputs**: what the robot publishes (`joint_...`, `tip_...`). Efforts are {}.",
            self.first()
                .and_then(|a| a.effort_meaning.as_deref())
                .unwrap_or("not declared")
        );
        line!(text, "- **Truth**: the folder `truth/`, where there is one, holds what the plant truly did. No estimator may read it.");
        if !e.path.is_board() {
            line!(
                text,
                "- **Control path**: the host's loops through the Raven's software, transport {} ms, not the board's",
                e.transport_ms()
            );
        }
        line!(text, "- **Split**: between trials, never within one.");
        line!(
            text,
            "- **Experiment**: seed {}, SHA-256 {}",
            e.seed,
            e.hash()
        );
        line!(
            text,
            "- **Rig file**: `{}`, SHA-256 {}",
            word(&self.rig["rig"]["name"]),
            word(&self.rig["hash"])
        );
        line!(text, "- **Calibration**: {}", self.calibration());
        if let Some(first) = self.first() {
            let versions: Vec<String> = first
                .versions
                .iter()
                .map(|(k, v)| format!("{k} {v}"))
                .collect();
            line!(text, "- **Versions**: {}", versions.join(", "));
            line!(
                text,
                "- **Joints**: {}; clock of the robot: {}",
                first.joint_names.join(", "),
                first.robot_clock.as_deref().unwrap_or("not declared")
            );
        }
        line!(text, "\n## Trials\n");
        line!(text, "| trial | attempt | begin (UTC) | rows | tracking RMS, N | samples lost | saturated | force age, ms | sync error, ms | seed of the chips | SHA-256 of the rows |");
        line!(
            text,
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
        );
        for a in &self.good {
            let f = &a.figures;
            let hash = a
                .files
                .iter()
                .find(|(name, _)| name.starts_with("dataset"))
                .map_or("", |(_, hash)| hash);
            line!(
                text,
                "| {} | {} | {} | {} | {:.3} | {} of {} | {:.4} | {:.2} | {:.3} | {} | `{}` |",
                a.trial,
                a.attempt,
                a.started_utc,
                f.rows,
                f.tracking_rms_n,
                f.samples_lost,
                f.samples + f.samples_lost,
                f.saturated,
                f.force_age_s * 1e3,
                f.sync_error_s * 1e3,
                a.seeds.get("chips").copied().unwrap_or_default(),
                hash.get(..16).unwrap_or(hash)
            );
        }
        if !self.failed.is_empty() {
            line!(text, "\n## Attempts that are kept and not used\n");
            line!(text, "| trial | attempt | reason |\n| --- | --- | --- |");
            for a in &self.failed {
                line!(
                    text,
                    "| {} | {} | {} |",
                    a.trial,
                    a.attempt,
                    a.reason.as_deref().unwrap_or("").replace('|', "/")
                );
            }
        }
        line!(text, "\n## Columns\n");
        line!(text, "| column | unit | what |\n| --- | --- | --- |");
        for (name, unit, what) in COLUMNS {
            line!(text, "| `{name}` | {unit} | {what} |");
        }
        text
    }
}

fn word(value: &Value) -> &str {
    value.as_str().unwrap_or("unknown")
}

fn columns(columns: &[Column]) -> Value {
    columns
        .iter()
        .map(|(name, unit, what)| json!({ "name": name, "unit": unit, "what": what }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_the_dataset_names_every_column_with_its_unit() {
        let page = include_str!("../../../docs/dataset.md");
        for (name, unit, what) in COLUMNS.iter().chain(&TRUTH_COLUMNS) {
            let row = format!("| `{name}` | {unit} | {what} |");
            assert!(page.contains(&row), "docs/dataset.md lacks: {row}");
        }
        let rows = page
            .lines()
            .filter(|line| line.starts_with("| `") && line.matches('|').count() == 4);
        assert_eq!(rows.count(), COLUMNS.len() + TRUTH_COLUMNS.len());
    }
}

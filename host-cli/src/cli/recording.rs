//! `forcectl recording`: checks recordings, writes their Parquet files, joins them with a robot's
//! log. Drives nothing.

use super::exit::{self, Failure, Reply, Result};
use super::output::path_json;
use super::{values, Context};
use clap::{Args, Subcommand};
use recording::check::{self, Checked};
use recording::merge::{self, Merge};
use recording::read::{mcap_of, End};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Below the help of the command.
pub const HELP: &str = "\
RECORDING is a folder that `set-force --record` or `record` has written, or its run.mcap, complete or cut off.

`merge` and `export` replace neither the log nor a recording: --out may not be the log, nor lie in the recording's folder
(`merge`) or in that of another recording (`export`). `merge` refuses a log in which a name of a column is there twice, or
is one of those that it adds (a log that was joined before).

Exit codes: 0 nothing is missing; 2 the arguments are refused; 6 it was read, and something is missing or damaged (the
list says what); 7 a file cannot be read or written.";

/// Arguments of `recording`.
#[derive(Debug, Args)]
pub struct Recording {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Gaps, drops, clocks, phases and hashes of a recording
    Check {
        /// Recording
        recording: PathBuf,
    },
    /// Write the Parquet files of a recording, for example of one that was killed
    Export {
        /// Recording
        recording: PathBuf,
        /// Folder for the Parquet files [default: that of the recording]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Also write repaired.mcap, with index and end, for programs that refuse the run.mcap of a
        /// killed run
        #[arg(long)]
        mcap: bool,
    },
    /// Join a robot's log with a recording by time, with the error of the join
    Merge {
        /// Recording
        recording: PathBuf,
        /// The robot's log: CSV or Parquet
        #[arg(long, value_name = "FILE")]
        log: PathBuf,
        /// Column with the time, UTC or ROS time: s, ms, us or ns since 1970 by its size, or RFC
        /// 3339 with its zone; `SECS+NSECS` for a ROS stamp, `DATE+TIME` for a date and a time of
        /// day in two columns
        #[arg(long, value_name = "COLUMN")]
        time: String,
        /// Time to add to that of the log, s, where its clock is known to differ
        #[arg(
            long,
            value_name = "SECONDS",
            default_value = "0",
            allow_hyphen_values = true,
            value_parser = values::clock_shift
        )]
        shift: f64,
        /// Largest error of the log's own time, s, to be counted into the error of the join
        #[arg(
            long,
            value_name = "SECONDS",
            default_value = "0",
            allow_hyphen_values = true,
            value_parser = values::time_error
        )]
        log_error: f64,
        /// Parquet file to write, outside of the recording's folder
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

impl Recording {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        match &self.what {
            What::Check { recording } => {
                let checked = check::check(recording)?;
                let code = if checked.problems.is_empty() {
                    exit::DONE
                } else {
                    exit::DEGRADED
                };
                let json = serde_json::to_value(&checked)
                    .map_err(|error| Failure::new(exit::FILE, error))?;
                Ok(Reply::new(text_of(&checked), json).with_code(code))
            }
            What::Export {
                recording,
                out,
                mcap: repaired,
            } => {
                let mcap = mcap_of(recording);
                let beside = files::folder_of(&mcap);
                let folder = out.as_deref().unwrap_or(beside);
                check_export(&mcap, folder, *repaired)?;
                // Before a folder is made for what can't be read.
                files::open(&mcap).map_err(|error| {
                    Failure::usage(format!(
                        "{}: {error}; give a run.mcap of `forcectl`, or the folder that holds it",
                        mcap.display()
                    ))
                })?;
                std::fs::create_dir_all(folder).map_err(|error| Failure::file(folder, error))?;
                export(&mcap, folder, *repaired)
            }
            What::Merge {
                recording,
                log,
                time,
                shift,
                log_error,
                out,
            } => {
                let mcap = mcap_of(recording);
                let folder = files::folder_of(&mcap);
                let whole = recording.is_dir() || folder.join(recording::JSON_FILE).is_file();
                files::check_output(out, &[log, if whole { folder } else { &mcap }])?;
                let merged = merge::merge(&Merge {
                    recording,
                    log,
                    time,
                    shift_s: *shift,
                    log_error_s: *log_error,
                    out,
                })?;
                for warning in &merged.warnings {
                    context.output.note(warning);
                }
                let code = match (merged.joined, merged.complete) {
                    (0, _) | (_, false) => exit::DEGRADED,
                    _ => exit::DONE,
                };
                let json = serde_json::to_value(&merged)
                    .map_err(|error| Failure::new(exit::FILE, error))?;
                Ok(Reply::new(merged.to_string(), json).with_code(code))
            }
        }
    }
}

/// Refuses a folder in which the export would replace files of another recording, or what it reads.
fn check_export(mcap: &Path, folder: &Path, repaired: bool) -> Result<()> {
    let written = recording::TABLES.iter().map(|table| table.file);
    for name in written.chain(repaired.then_some(recording::REPAIRED_FILE)) {
        let path = folder.join(name);
        if path.exists() {
            files::check_output(&path, &[mcap])?;
        }
    }
    let other = folder.join(recording::MCAP_FILE);
    let real = |path: &Path| path.canonicalize().ok();
    if other.exists() && real(folder) != real(files::folder_of(mcap)) {
        return Err(Failure::usage(format!(
            "--out {}: another recording is there ({}), and its Parquet files would be replaced. Nothing was written; name another folder",
            folder.display(),
            other.display()
        )));
    }
    Ok(())
}

fn export(mcap: &Path, folder: &Path, repaired: bool) -> Result<Reply> {
    let mut exported = recording::export(mcap, folder);
    if repaired {
        let to = folder.join(recording::REPAIRED_FILE);
        match recording::repair(mcap, &to) {
            Ok(copied) => exported.files.push((to, copied.messages)),
            Err(error) => exported.failures.push(error),
        }
    }
    let mut text = String::new();
    for (path, rows) in &exported.files {
        let what = if path.ends_with(recording::REPAIRED_FILE) {
            "messages"
        } else {
            "rows"
        };
        row!(text, "{}: {rows} {what}", path.display());
    }
    let files: Vec<_> = exported
        .files
        .iter()
        .map(|(path, rows)| json!({"file": path_json(path), "rows": rows}))
        .collect();
    let whole = exported.end == End::Complete;
    if !whole {
        row!(
            text,
            "the recording is cut off or damaged; these are the rows before that place"
        );
    }
    let reply = Reply::new(text, json!({"files": files, "complete": whole}));
    if exported.failures.is_empty() {
        return Ok(reply.with_code(if whole { exit::DONE } else { exit::DEGRADED }));
    }
    let why: Vec<_> = exported.failures.iter().map(ToString::to_string).collect();
    let code = match exported.failures.iter().all(|failure| failure.of_input) {
        true => exit::USAGE,
        false => exit::FILE,
    };
    Err(Failure::new(code, why.join("\n")).with_reply(reply))
}

/// The check for people.
fn text_of(checked: &Checked) -> String {
    let mut out = String::new();
    row!(
        out,
        "file            {}, SHA-256 {}",
        checked.end,
        checked.sha256
    );
    for key in [
        "utc_start",
        "time_source",
        "rig_name",
        "rig_hash_sha256",
        "firmware_version",
        "forcectl_version",
        "link",
    ] {
        if let Some(value) = checked.metadata.get(key) {
            row!(out, "{key:<15} {value}");
        }
    }
    row!(out, "configurations  {}", checked.configurations.join(" "));
    row!(out, "");
    row!(
        out,
        "unit   samples   period ms   gaps   missing   longest ms"
    );
    for unit in &checked.units {
        row!(
            out,
            "{:>4} {:>9} {:>11.4} {:>6} {:>9} {:>12.3}",
            unit.unit,
            unit.samples,
            unit.period_s * 1e3,
            unit.gaps,
            unit.missing,
            unit.longest_s * 1e3
        );
    }
    row!(out, "");
    let clock = &checked.clock;
    let ms =
        |s: Option<f64>| s.map_or_else(|| "unknown".to_owned(), |s| format!("{:.3} ms", s * 1e3));
    row!(
        out,
        "board's clock   drift {}; largest error of its place in host time: {} median, {} at the worst place",
        match (clock.drift_ppm, clock.drift_uncertainty_ppm) {
            (Some(ppm), Some(error_ppm)) => format!("{ppm:+.3} +- {error_ppm:.3} ppm"),
            _ => "unknown".to_owned(),
        },
        ms(clock.uncertainty_median_s),
        ms(clock.uncertainty_max_s)
    );
    for phase in &checked.phases {
        row!(
            out,
            "phase           {:<12} {:>9.3} s",
            phase.phase,
            phase.duration_s
        );
    }
    row!(
        out,
        "lost            frames {}, damaged {}; conversions {}; dropped by the recorder: samples {}, cycles {}",
        checked.frames_lost,
        checked.frames_bad,
        checked.conversions_missed,
        checked.dropped_samples,
        checked.dropped_cycles
    );
    for event in &checked.events {
        row!(out, "event           {event}");
    }
    if checked.problems.is_empty() {
        row!(out, "\nNothing is missing.");
    }
    for problem in &checked.problems {
        row!(out, "problem         {problem}");
    }
    out
}

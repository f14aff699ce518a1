//! The analysis of a recorded session, unit by unit, and the corrected rig file.

use super::drift::FrictionChange;
use super::findings::{self, Frame, Rewritten};
use super::recording::csv;
use super::{model, Recording};
use control::convert::REEL_RADIUS_M;
use residual::{Report, Verdict};
use rig::{Rig, UnitSettings};
use serde::Serialize;
use std::path::Path;
use wire::UNITS;

/// Largest reduction of the held-out RMSE by structure without a name, as a part of the reduction
/// by the findings, with which a board may use the findings. Above it their parameters may stand
/// for another effect.
pub const MAX_UNEXPLAINED: f64 = 0.1;

/// Blocks that a recording is held out in, and their longest duration, s: that of the usual
/// recording of 40 s.
const BLOCKS: f64 = 10.0;
const LONGEST_BLOCK_S: f64 = 4.0;

/// What was found on one unit, and what of it is used.
#[derive(Debug, Clone, Serialize)]
pub struct UnitFinding {
    /// Unit from 1.
    pub unit: u8,
    /// The analysis.
    pub report: Report,
    /// What of it is not in the new settings, and why.
    pub not_used: Vec<String>,
    /// How friction changed while it was recorded; `None` where the recording doesn't tell.
    pub friction_change: Option<FrictionChange>,
}

/// A unit whose load cell is to be weighed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DoubtedCell {
    /// Unit from 1.
    pub unit: u8,
    /// Names of the effects that it shows, and that weights measure and the board takes out.
    pub effects: Vec<String>,
}

/// The units whose load cells show creep or a curve; all units where two or more do. Cells of one
/// kind are alike, a session does not show it in each, and one that is left as it is beside others
/// that are put right makes the force at the tip worse: the errors of all cells are alike before,
/// and cancel in part.
#[must_use]
pub fn doubted_cells(units: &[UnitFinding]) -> Vec<DoubtedCell> {
    let of_cell = |unit: &UnitFinding| {
        let names = unit.report.effects.iter().map(|e| e.name.to_string());
        DoubtedCell {
            unit: unit.unit,
            effects: names.filter(|name| findings::is_of_cell(name)).collect(),
        }
    };
    let mut cells: Vec<DoubtedCell> = units.iter().map(of_cell).collect();
    let shows = |cell: &DoubtedCell| !cell.effects.is_empty();
    if cells.iter().filter(|cell| shows(cell)).count() < 2 {
        cells.retain(shows);
    }
    cells
}

/// What was found on a rig.
#[derive(Debug, Clone)]
pub struct Findings {
    /// Unit by unit.
    pub units: Vec<UnitFinding>,
    /// The rig with what the board can use.
    pub rig: Rig,
    /// The text of the rig file with it, and the changes.
    pub rewritten: Rewritten,
}

/// Why an analysis could not be done.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// A file could not be written.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: String,
        /// The operating system's message.
        cause: std::io::Error,
    },
    /// The analysis failed.
    #[error("unit {unit}: {error}")]
    Analysis {
        /// Unit from 1.
        unit: u8,
        /// What is wrong.
        error: residual::Error,
    },
    /// The rig file's text can't be changed.
    #[error("{0}")]
    Rewrite(String),
}

/// Analyses a recording unit by unit, with reports in folders below `out`, and puts what the board
/// can use into the text of the rig file.
///
/// # Errors
/// [`FindError`].
pub fn find(
    recording: &Recording,
    rig: &Rig,
    rig_name: &str,
    rig_text: &str,
    out: &Path,
    progress: &mut dyn residual::Progress,
) -> Result<Findings, FindError> {
    let mut units = Vec::new();
    let mut new = rig.units;
    let mut delays: [Option<f64>; UNITS] = [None; UNITS];
    for (i, unit) in rig.units.iter().enumerate() {
        if !recording.available[i] {
            continue;
        }
        progress.stage(&format!("unit {}", unit.number));
        let block_s = (recording.duration_s() / BLOCKS).min(LONGEST_BLOCK_S);
        let rows = recording.rows(i);
        let report = analyse(unit, block_s, &csv(&rows), out)?;
        delays[i] = Some(delay_s(&report));
        let not_used = match usable(&report) {
            Ok(mut compensation) => {
                let angles: Vec<f64> = rows.iter().map(|r| r.angle_rad).collect();
                findings::merge_ripples(&mut compensation.ripples, &angles);
                let frame = Frame {
                    increment: true,
                    gain_of_drive: true,
                    velocity_m_per_s: Some(1.0),
                    travel_m_per_rad: Some(REEL_RADIUS_M),
                };
                let corrected = findings::correct(unit, &compensation, &frame);
                new[i] = corrected.unit;
                corrected.not_used
            }
            Err(why) => std::iter::once(why).chain(advice(&report)).collect(),
        };
        units.push(UnitFinding {
            unit: unit.number,
            report,
            not_used,
            friction_change: FrictionChange::of(&rows),
        });
    }
    let needed = delays_of_all(delays);
    for (unit, delay_s) in new.iter_mut().zip(needed) {
        *unit = findings::slowed(unit, delay_s);
    }
    let rewritten = findings::rewrite(rig_name, rig_text, rig, &new).map_err(FindError::Rewrite)?;
    let mut rig = rig.clone();
    rig.units = new;
    Ok(Findings {
        units,
        rig,
        rewritten,
    })
}

/// The delay of the drive that a report found, s, whatever its verdict; 0: none.
fn delay_s(report: &Report) -> f64 {
    as_several(report)
        .compensation()
        .map_or(0.0, |compensation| compensation.delay_s)
}

/// A report as it would be if its effects were certain.
fn as_several(report: &Report) -> Report {
    Report {
        verdict: Verdict::Several,
        paths_not_judged: 0,
        ..report.clone()
    }
}

/// The delay that each unit's gains have to allow for, s, from those that were found; `None`: the
/// unit took no part. A loop whose gains are too high for its delay swings until a fault ends it,
/// and one whose gains are lower than needed only settles later. So a delay counts also where the
/// rest of a unit's verdict doesn't, and where more than half of the units have one the others are
/// taken to have their median: six drives of one kind.
fn delays_of_all(found: [Option<f64>; UNITS]) -> [f64; UNITS] {
    let mut late: Vec<f64> = found.into_iter().flatten().filter(|s| *s > 0.0).collect();
    late.sort_unstable_by(f64::total_cmp);
    let most = 2 * late.len() > found.iter().flatten().count();
    let usual = if most { late[late.len() / 2] } else { 0.0 };
    found.map(|delay_s| match delay_s {
        Some(delay_s) if delay_s > 0.0 => delay_s,
        Some(_) => usual,
        None => 0.0,
    })
}

/// What helps against the found effects for which the board has no setting, whatever the verdict.
#[must_use]
pub fn advice(report: &Report) -> Vec<String> {
    let left_out = as_several(report).compensation().map_or_else(
        || report.effects.iter().map(|e| e.name.to_string()).collect(),
        |compensation| compensation.left_out,
    );
    let mut out: Vec<String> = Vec::new();
    for name in left_out {
        if let Some(advice) = findings::without_setting(&name) {
            let line = format!("{name}: the board has no setting for it; what helps: {advice}");
            if !out.contains(&line) {
                out.push(line);
            }
        }
    }
    out
}

/// Analyses the log of one unit in blocks of `block_s` seconds, with its files in a folder below
/// `out`.
fn analyse(unit: &UnitSettings, block_s: f64, csv: &str, out: &Path) -> Result<Report, FindError> {
    let folder = out.join(format!("unit{}", unit.number));
    let log = folder.join("session.csv");
    let file = |cause| FindError::File {
        path: log.display().to_string(),
        cause,
    };
    std::fs::create_dir_all(&folder).map_err(file)?;
    std::fs::write(&log, csv).map_err(file)?;
    model(unit)
        .and_then(|mut model| {
            model.holdout.block_s = Some(block_s);
            let options = residual::Options {
                data: vec![log.clone()],
                model,
                out: Some(folder.clone()),
            };
            residual::run(&options, &mut ())
        })
        .map_err(|error| FindError::Analysis {
            unit: unit.number,
            error: advised(error),
        })
}

/// The error with what the user of `identify` can do, who has neither files nor a model file of the
/// analysis.
fn advised(error: residual::Error) -> residual::Error {
    match error {
        residual::Error::Data { what, .. } => residual::Error::Data {
            what,
            hint: "Drive the cables for longer (--drive-duration), and see that the robot moves all of them".to_owned(),
        },
        other => other,
    }
}

/// What a board may use of a report, or why nothing.
///
/// # Errors
/// The verdict doesn't support a change, or nameless structure is left beside the named effects.
pub fn usable(report: &Report) -> Result<residual::Compensation, String> {
    let (before, after) = (report.baseline.heldout_rmse, report.last.heldout_rmse);
    let left = |s: &&residual::Structure| s.gain * after > MAX_UNEXPLAINED * (before - after);
    if let Some(left) = report.structure.iter().find(left) {
        return Err(format!(
            "all of it: a dependence on {} without a name would reduce the error by another {:.3} {}, beside the {:.3} {} of the named effects; these may stand for something else",
            left.depends_on,
            left.gain * after,
            report.unit,
            before - after,
            report.unit
        ));
    }
    report
        .compensation()
        .ok_or_else(|| format!("the verdict: {}", report.summary()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::Rig;

    /// A delay of most drives is one of all.
    #[test]
    fn a_delay_of_most_units_lowers_the_gains_of_all() {
        let (none, off) = (Some(0.0), None);
        let most = [Some(0.25), none, Some(0.75), off, Some(0.5), none];
        assert_eq!(delays_of_all(most), [0.25, 0.5, 0.75, 0.0, 0.5, 0.5]);
        let half = [Some(0.25), none, Some(0.75), none, off, off];
        assert_eq!(delays_of_all(half), [0.25, 0.0, 0.75, 0.0, 0.0, 0.0]);
        assert_eq!(delays_of_all([none; UNITS]), [0.0; UNITS]);
        assert_eq!(delays_of_all([off; UNITS]), [0.0; UNITS]);
    }

    /// Nobody who drives a rig can set a key of the model that is built in.
    #[test]
    fn what_a_recording_lacks_is_said_in_options_of_the_command() {
        let unit = Rig::built_in().unwrap().units[0];
        let out = tempfile::tempdir().unwrap();
        let mut csv = "time_s,tension_n,command_n,speed_m_s,angle_rad\n".to_owned();
        for i in 0..900 {
            let t = 0.0025 * f64::from(i);
            csv += &format!(
                "{t},{},{},0.01,{t}\n",
                4.0 + (9.0 * t).sin(),
                4.0 + (5.0 * t).sin()
            );
        }
        let error = analyse(&unit, 4.0, &csv, out.path())
            .unwrap_err()
            .to_string();
        assert!(error.contains("--drive-duration"), "{error}");
        assert!(!error.contains("block_s"), "{error}");
    }
}

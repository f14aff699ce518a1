//! The runs of a seed: `forcectl` as a process of its own, and what its reports say.

use crate::effect::{plant_text, Kind, Truth, MIDDLE_N};
use crate::options::Options;
use serde_json::{json, Value};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// What `forcectl identify` reported.
#[derive(Default)]
pub struct Findings {
    /// Effects by name, with the number of units that they were named in.
    pub named: BTreeMap<String, usize>,
    /// Units that took part.
    pub units: usize,
    /// For each effect the compared number in each unit that has and names it.
    pub found: Vec<Vec<f64>>,
    /// Growth of friction while session 2 was recorded, N, in each unit in which it is sure.
    pub changes: Vec<f64>,
    /// For each effect the units that name it and don't have it.
    pub elsewhere: Vec<usize>,
    /// Tension error of the worst cable, N RMS, before and after; `None` where a fault ended the
    /// session, or there was none.
    pub worst: (Option<f64>, Option<f64>),
    /// Force error at the tip, N RMS, before and after.
    pub tip: (Option<f64>, Option<f64>),
    /// Worst cable and tip of the same rig without the effect, with the rig file as it is.
    pub without: Option<(f64, f64)>,
    /// The same with the effect, after the geometry was measured again, where that is the remedy.
    pub surveyed: Option<(f64, f64)>,
    /// What ended the session before, in a word or two; `None`: nothing did.
    pub stopped: Option<&'static str>,
    /// What broke the comparison off, in words.
    pub broken_off: Option<String>,
    /// The settings that a run behind fault 15 named, with which the rig was then identified, and
    /// the worst cable with them, N RMS.
    pub told: Option<(String, Option<f64>)>,
    /// Changed settings.
    pub changed: usize,
    /// Whether the force was held better after.
    pub better: bool,
}

/// Why there are no findings.
#[derive(Debug)]
pub enum NoFindings {
    /// The board gave up units: with the effect their tension is implausible, also with open loops.
    Stopped,
    /// Something went wrong, in words.
    Failed(String),
}

impl From<String> for NoFindings {
    fn from(why: String) -> Self {
        Self::Failed(why)
    }
}

/// What a message of `forcectl` says where the tension of a unit is implausible.
const IMPLAUSIBLE: &str = "fault 45, ";

/// What a report says where something else than the pairs ended the comparison.
const BROKEN_OFF: &str = "the comparison was broken off: ";

/// A number of a report.
fn number(value: &Value, path: &str) -> Result<f64, String> {
    value
        .pointer(path)
        .and_then(Value::as_f64)
        .ok_or_else(|| format!("identify.json has no number at {path}"))
}

/// The compared number of a kind, from the effects of a unit that count as the name.
fn compared(kind: Kind, effects: &[&Value]) -> f64 {
    let sum = |name: &str| -> f64 {
        effects
            .iter()
            .filter_map(|e| e["params"][name].as_f64())
            .sum()
    };
    match kind {
        Kind::Coulomb | Kind::LoadFriction | Kind::Scatter | Kind::Changing => {
            -(sum("friction") + sum("friction_at_zero_load") + MIDDLE_N * sum("friction_per_load"))
        }
        Kind::Ripple => sum("amplitude"),
        Kind::Gain => 100.0 * sum("gain_error"),
        Kind::Delay => 1e3 * (sum("delay") + sum("time_constant")),
        Kind::Viscous => -sum("damping"),
        Kind::Backlash => 1e3 * 0.010 * (sum("gap") + sum("play")),
        Kind::Creep => 100.0 * sum("creep_share"),
        Kind::CellCurve => sum("curvature"),
        Kind::Stiffness => sum("stiffness"),
        Kind::CellTilt => sum("sine_share"),
        Kind::Nothing => 0.0,
    }
}

/// Effects of load cells that were named and then measured with weights: the unit, and the effect
/// in the form of the others, with what the weights say.
fn weighed(report: &Value) -> Vec<(u64, Value)> {
    let list = |path: &str| report.pointer(path).and_then(Value::as_array);
    let gains: Vec<&Value> = list("/weighed/gains/gains").into_iter().flatten().collect();
    let mut effects = Vec::new();
    for cell in list("/weighed/cells").into_iter().flatten() {
        let unit = cell["unit"].as_u64().unwrap_or(0);
        let Some(gain) = gains.iter().find(|gain| gain["unit"] == cell["unit"]) else {
            continue;
        };
        for name in cell["effects"].as_array().into_iter().flatten() {
            // As the truth states them, and the analysis.
            let params = json!({"creep_share": gain["creep"], "curvature": gain["curve_per_n"]});
            effects.push((unit, json!({"name": name, "params": params})));
        }
    }
    effects
}

/// By how much a unit's friction grew while it was recorded, N, where the interval excludes zero.
fn sure_change_n(unit: &Value) -> Option<f64> {
    let change = &unit["friction_change"];
    let [low, high] = [0, 1].map(|i| change["interval_n"][i].as_f64());
    let change_n = change["change_n"].as_f64()?;
    (low? > 0.0 || high? < 0.0).then_some(change_n)
}

/// The findings in an `identify.json`.
pub fn read(truth: &Truth, report: &Value) -> Result<Findings, String> {
    let units = report["units"]
        .as_array()
        .ok_or("identify.json has no units")?;
    let mut named: BTreeMap<String, usize> = BTreeMap::new();
    let mut found = vec![Vec::new(); truth.effects.len()];
    let mut elsewhere = vec![0; truth.effects.len()];
    let weighed = weighed(report);
    for unit in units {
        let number = unit["unit"].as_u64().unwrap_or(0);
        let has = truth.is_in(number);
        let of_cell = weighed.iter().filter(|(of, _)| *of == number);
        let effects: Vec<&Value> = (unit["effects"].as_array().into_iter().flatten())
            .chain(of_cell.map(|(_, effect)| effect))
            .collect();
        let mut names: Vec<&str> = effects.iter().filter_map(|e| e["name"].as_str()).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            *named.entry(name.to_owned()).or_default() += 1;
        }
        for (k, effect) in truth.effects.iter().enumerate() {
            let is_it = |e: &&Value| {
                e["name"]
                    .as_str()
                    .is_some_and(|n| effect.names.contains(&n))
            };
            let own: Vec<&Value> = effects.iter().copied().filter(is_it).collect();
            match (own.is_empty(), has) {
                (true, _) => {}
                (false, true) => found[k].push(compared(effect.kind, &own)),
                (false, false) => elsewhere[k] += 1,
            }
        }
    }
    let mut changes: Vec<f64> = units.iter().filter_map(sure_change_n).collect();
    for of_effect in found.iter_mut().chain([&mut changes]) {
        of_effect.sort_by(f64::total_cmp);
    }
    let figure = |path: &str| report.pointer(path).and_then(Value::as_f64);
    let before = |path: &str| match report["before_fault"].as_str() {
        Some(_) => Ok(None),
        None => number(report, path).map(Some),
    };
    Ok(Findings {
        named,
        units: units.len(),
        found,
        changes,
        elsewhere,
        worst: (
            before("/before/worst_tension_rms_n")?,
            figure("/after/worst_tension_rms_n"),
        ),
        tip: (before("/before/tip_rms_n")?, figure("/after/tip_rms_n")),
        without: None,
        surveyed: None,
        stopped: (report["before_fault"].as_str()).map(|why| {
            if why.contains("fault 44") {
                "fault 44"
            } else {
                "fault 45"
            }
        }),
        broken_off: (report["left"].as_str())
            .and_then(|why| why.strip_prefix(BROKEN_OFF))
            .map(|why| why.split(',').next().unwrap_or(why).to_owned()),
        told: None,
        changed: report["changed"].as_array().map_or(0, Vec::len) + weighed.len(),
        better: report["better"].as_bool().unwrap_or(false),
    })
}

/// Runs `forcectl identify` and the control run on a seed's rig, or reads what an earlier run left.
pub fn run(options: &Options, seed: u64, truth: &Truth) -> Result<Findings, NoFindings> {
    let folder = options.out.join(format!("seed{seed}"));
    let report = folder.join("found");
    let json = report.join("identify.json");
    let control = folder.join("control");
    let stopped = folder.join("stopped");
    if options.reuse {
        if stopped.exists() {
            return Err(NoFindings::Stopped);
        }
        return Ok(findings(truth, &json, &control)?);
    }
    // What an earlier run left would be read in place of a report that was never written.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let plant = folder.join("plant.toml");
    std::fs::write(&plant, &truth.plant).map_err(|e| format!("{}: {e}", plant.display()))?;
    identify(options, seed, &folder, None)?;
    let mut behind = read_told(&folder);
    for _ in 0..MOST_TOLD {
        let Some(told) = behind.filter(|_| !json.exists()) else {
            break;
        };
        identify(options, seed, &folder, Some(&told))?;
        behind = read_told(&folder).filter(|newer| *newer != told);
    }
    if !json.exists() {
        let last = std::fs::read_to_string(folder.join(SAID)).unwrap_or_default();
        let last = last.lines().last().unwrap_or("no message");
        if last.contains(IMPLAUSIBLE) {
            std::fs::write(&stopped, last).map_err(|e| format!("{}: {e}", stopped.display()))?;
            return Err(NoFindings::Stopped);
        }
        return Err(format!("forcectl ended without a report: {last}").into());
    }
    // The same rig without the effect: the smallest error that a correction can reach.
    std::fs::create_dir_all(&control).map_err(|e| format!("{}: {e}", control.display()))?;
    let plain = control.join("plant.toml");
    std::fs::write(&plain, plant_text("", &[])).map_err(|e| format!("{}: {e}", plain.display()))?;
    let force = ["set-force", "0", "2.5", "0", "--duration", &options.hold];
    // Without what was weighed on the rig that has the effect.
    call(options, seed, &force, &plain, &control, &control)?;
    // What helps against a cell that is askew.
    if truth.kinds().contains(&Kind::CellTilt) {
        let geometry = folder.join("geometry");
        call(
            options,
            seed,
            &["calibrate", "geometry", "--yes"],
            &plant,
            &geometry,
            &folder,
        )?;
        call(
            options,
            seed,
            &force,
            &plant,
            &folder.join(SURVEYED),
            &folder,
        )?;
    }
    Ok(findings(truth, &json, &control)?)
}

/// What the last run of `forcectl identify` said on standard error.
const SAID: &str = "said.txt";
/// The rig file with the settings that a run named.
const TOLD: &str = "told.toml";
/// How often a run may name other settings: larger ones, as another unit or reversal shows them.
const MOST_TOLD: usize = 3;
/// Settings that a run names behind fault 15, in the order of its sentence.
const SETTINGS: [&str; 2] = ["coulomb_n", "tension_min_n"];

/// Runs `forcectl identify`, with the rig file as it is or with settings that a run before named,
/// for all units: their reels are alike.
fn identify(
    options: &Options,
    seed: u64,
    folder: &Path,
    told: Option<&[String; 2]>,
) -> Result<(), String> {
    let forcectl = |e: std::io::Error| format!("{}: {e}", options.forcectl.display());
    let file = |path: &Path| {
        let path = path.display().to_string();
        move |e: std::io::Error| format!("{path}: {e}")
    };
    let mut command = Command::new(&options.forcectl);
    command
        .arg("identify")
        .args(["--link", &options.link, "--seed", &seed.to_string()])
        .arg("--plant")
        .arg(folder.join("plant.toml"))
        .args(["--drive-duration", &options.drive])
        .args(["--duration", &options.hold])
        .args(["--clear-implausible", "--weigh", "--yes"])
        .arg("--out")
        .arg(folder.join("found"))
        .env("FORCECTL_STATE_DIR", folder.join("state"));
    if let Some(told) = told {
        let print = Command::new(&options.forcectl)
            .args(["check", "--print"])
            .output()
            .map_err(forcectl)?;
        let rig: String = String::from_utf8_lossy(&print.stdout)
            .lines()
            .map(|line| {
                let of = |(name, _): &(&&str, &String)| line.starts_with(&format!("{name} = "));
                match SETTINGS.iter().zip(told).find(of) {
                    Some((name, value)) => format!("{name} = {value}\n"),
                    None => format!("{line}\n"),
                }
            })
            .collect();
        let path = folder.join(TOLD);
        std::fs::write(&path, rig).map_err(file(&path))?;
        command.arg("--rig").arg(&path);
    }
    let output = command.output().map_err(forcectl)?;
    let said = folder.join(SAID);
    std::fs::write(&said, &output.stderr).map_err(file(&said))
}

/// The settings that the last run named behind fault 15.
fn read_told(folder: &Path) -> Option<[String; 2]> {
    let said = std::fs::read_to_string(folder.join(SAID)).ok()?;
    let value = |name: &str| {
        let (_, behind) = said.rsplit_once(&format!("`{name} = "))?;
        Some(behind.split_once('`')?.0.to_owned())
    };
    Some([value(SETTINGS[0])?, value(SETTINGS[1])?])
}

/// Folder of the session after the geometry was measured again.
const SURVEYED: &str = "surveyed";

/// Another command on the rig of a seed; `of` is the folder with its state.
fn call(
    options: &Options,
    seed: u64,
    words: &[&str],
    plant: &Path,
    out: &Path,
    of: &Path,
) -> Result<(), String> {
    Command::new(&options.forcectl)
        .args(words)
        .args(["--link", &options.link, "--seed", &seed.to_string()])
        .arg("--plant")
        .arg(plant)
        .arg("--out")
        .arg(out)
        .env("FORCECTL_STATE_DIR", of.join("state"))
        .output()
        .map(|_| ())
        .map_err(|e| format!("{}: {e}", options.forcectl.display()))
}

pub fn report_of(path: &Path) -> Result<Value, String> {
    let fault = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = std::fs::read_to_string(path).map_err(|e| fault(&e))?;
    serde_json::from_str(&text).map_err(|e| fault(&e))
}

/// What a report says, with the control run of the same rig without the effect.
fn findings(truth: &Truth, report: &Path, control: &Path) -> Result<Findings, String> {
    let mut findings = read(truth, &report_of(report)?)?;
    findings.without = Some(held(control)?);
    let rig = std::fs::read_to_string(control.with_file_name(TOLD)).unwrap_or_default();
    let line = |name: &&str| rig.lines().find(|line| line.starts_with(*name));
    if let [Some(coulomb), Some(least)] = SETTINGS.each_ref().map(line) {
        let before = findings.worst.0.take();
        findings.told = Some((format!("`{coulomb}` and `{least}`"), before));
        findings.stopped = Some("fault 15");
        let tip = findings.tip.0.take();
        if !findings.better {
            (findings.worst.1, findings.tip.1) = (before, tip);
        }
    }
    let surveyed = control.with_file_name(SURVEYED);
    if surveyed.exists() {
        findings.surveyed = Some(held(&surveyed)?);
    }
    Ok(findings)
}

/// Worst cable and tip of a session that held the force, N RMS.
fn held(folder: &Path) -> Result<(f64, f64), String> {
    let run = report_of(&folder.join("set-force.json"))?;
    let cables = run["metrics"]["tension_rms_n"].as_array();
    let worst = cables
        .into_iter()
        .flatten()
        .filter_map(Value::as_f64)
        .fold(0.0, f64::max);
    Ok((worst, number(&run, "/metrics/tip_force_rms_n")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sentence of `run::friction`, as forcectl prints it.
    #[test]
    fn the_newest_settings_of_a_run_are_read_and_none_where_none_were_named() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read_told(folder.path()), None);
        let said = |text: &str| std::fs::write(folder.path().join(SAID), text).unwrap();
        said("forcectl: fault 46, command at its limit\n");
        assert_eq!(read_told(folder.path()), None);
        said("with `coulomb_n = 1.35` and `tension_min_n = 2.6` the board\nforcectl: fault 15\n");
        let told = ["1.35", "2.6"].map(str::to_owned);
        assert_eq!(read_told(folder.path()), Some(told));
    }
}

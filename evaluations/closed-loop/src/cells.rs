//! Weights on rigs whose load cells are curved or creep: what the board's correction of the cell is
//! worth.
//!
//! For each seed with such an effect the force is held with the rig file as it is,
//! `forcectl calibrate gain` hangs weights, and the force is held again with the calibration. The
//! same follows on the same rig without the effect: weights correct the scatter of the cells' scale
//! as well, and only the difference between the two rigs is due to curve or creep. The rig is the
//! one without the emulated controller; its control core is the firmware's.

use crate::effect::{kind_of, plant_text, truth, Effects, Kind, Truth};
use crate::options::Options;
use crate::run::report_of;
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// The force held without and with a calibration: worst cable and tip, N RMS.
struct Held {
    before: (f64, f64),
    after: (f64, f64),
    /// Units whose curve or creep the board corrects.
    corrected: usize,
    /// Median over them of what was found: curve in 1/N, creep as a share.
    found: f64,
}

/// Effects that lie in the load cells.
fn in_the_cells(seed: u64) -> bool {
    matches!(kind_of(seed), Kind::Creep | Kind::CellCurve)
}

/// The page, as Markdown.
///
/// # Errors
/// A command failed.
pub fn page(options: &Options) -> Result<String, String> {
    let (first, last) = (*options.seeds.start(), *options.seeds.end());
    let mut rows = String::new();
    let mut costs: Vec<(f64, f64)> = Vec::new();
    for seed in (first..=last).filter(|seed| in_the_cells(*seed)) {
        let truth = truth(seed, options.size, Effects::All);
        let folder = options.out.join(format!("cells{seed}"));
        let with = rig(
            options,
            seed,
            &folder.join("with"),
            &truth.plant,
            kind_of(seed),
        )?;
        let without = rig(
            options,
            seed,
            &folder.join("without"),
            &plant_text("", &[]),
            kind_of(seed),
        )?;
        costs.push((
            with.before.1 - without.before.1,
            with.after.1 - without.after.1,
        ));
        let text = row(seed, &truth, &with, &without);
        eprint!("{text}");
        rows.push_str(&text);
    }
    if rows.is_empty() {
        return Err(format!(
            "no seed of {first}..{last} has cells that are curved or creep; give ten seeds in a row"
        ));
    }
    let mean =
        |part: fn(&(f64, f64)) -> f64| costs.iter().map(part).sum::<f64>() / costs.len() as f64;
    let sources = evaluation::sources();
    Ok(format!(
        "# Load cells that are curved or creep

Printed by `cargo xtask closed-loop --cells --seeds {first}..{last} --markdown docs/calibration/cells.md` ({sources}); don't edit. What
to do on a rig is in the [guide](../calibration.md).

Each seed is another rig whose six cells are curved or creep; the rig file knows nothing of it. The force of 2.5 N along y is held at the
moving tip for {hold} s with the rig file as it is. Then `forcectl calibrate gain` hangs weights of 10 g to 1 kg up and down and leaves
the largest on for 30 s and off for 30 s; curve and creep that pay go to the board. The force is held once more. Errors are RMS against
the plant's true tensions and the true force at the tip. *without it*: the same rig with straight cells that do not creep, before and
after the same weights, which correct the scale of each cell on both rigs.

| seed | cells | found, median | corrected on the board | worst cable, N | tip, N | without it: worst cable, N | without it: tip, N |
|---|---|---|---|---|---|---|---|
{rows}
Mean cost of curve or creep at the tip, against *without it*: {:.3} N before, {:.3} N after.
",
        mean(|c| c.0),
        mean(|c| c.1),
        hold = options.hold,
    ))
}

fn row(seed: u64, truth: &Truth, with: &Held, without: &Held) -> String {
    let pair = |a: f64, b: f64| format!("{a:.3} -> {b:.3}");
    let found = match kind_of(seed) {
        Kind::Creep => format!("{:.2} %", 100.0 * with.found),
        _ => format!("{:.4} /N", with.found),
    };
    let mut out = String::new();
    let _ = writeln!(
        out,
        "| {seed} | {} | {found} | {} of 6 | {} | {} | {} | {} |",
        truth.words(),
        with.corrected,
        pair(with.before.0, with.after.0),
        pair(with.before.1, with.after.1),
        pair(without.before.0, without.after.0),
        pair(without.before.1, without.after.1),
    );
    out
}

/// Holds, weighs and holds again.
fn rig(
    options: &Options,
    seed: u64,
    folder: &Path,
    plant: &str,
    kind: Kind,
) -> Result<Held, String> {
    let fault = |e: std::io::Error| format!("{}: {e}", folder.display());
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(fault)?;
    }
    std::fs::create_dir_all(folder).map_err(fault)?;
    let plant_file = folder.join("plant.toml");
    std::fs::write(&plant_file, plant).map_err(fault)?;
    let call = |words: &[&str], out: &Path| -> Result<(), String> {
        let output = Command::new(&options.forcectl)
            .args(words)
            .args(["--link", "fast", "--seed", &seed.to_string()])
            .arg("--plant")
            .arg(&plant_file)
            .arg("--out")
            .arg(out)
            .arg("--json")
            .env("FORCECTL_STATE_DIR", folder.join("state"))
            .output()
            .map_err(|e| format!("{}: {e}", options.forcectl.display()))?;
        // 6: the force was held, and not as well as asked. That is what this page shows.
        if matches!(output.status.code(), Some(0 | 6)) {
            return std::fs::write(out.join("reply.json"), &output.stdout).map_err(fault);
        }
        let words = String::from_utf8_lossy(&output.stderr);
        let last = words.lines().last().unwrap_or("no message").to_owned();
        Err(format!(
            "seed {seed}: forcectl ended with {}: {last}",
            output.status
        ))
    };
    let hold = |name: &str| -> Result<(f64, f64), String> {
        let out = folder.join(name);
        call(
            &["set-force", "0", "2.5", "0", "--duration", &options.hold],
            &out,
        )?;
        figures(&report_of(&out.join("set-force.json"))?)
    };
    let before = hold("before")?;
    let weights = folder.join("weights");
    call(&["calibrate", "gain", "--yes"], &weights)?;
    let after = hold("after")?;
    let (corrected, found) = found(&report_of(&weights.join("reply.json"))?, kind);
    Ok(Held {
        before,
        after,
        corrected,
        found,
    })
}

/// Units that the board corrects, and the median of what was found on them.
fn found(gains: &Value, kind: Kind) -> (usize, f64) {
    let units = gains["gains"].as_array();
    let flag = match kind {
        Kind::Creep => "creep_on_board",
        _ => "curve_on_board",
    };
    let mut values: Vec<f64> = units
        .into_iter()
        .flatten()
        .filter(|unit| unit[flag].as_bool() == Some(true))
        .filter_map(|unit| match kind {
            Kind::Creep => unit["creep"].as_f64(),
            // The curve of the reading over the load, as the truth states it.
            _ => unit["curve_per_n"].as_f64(),
        })
        .collect();
    values.sort_by(f64::total_cmp);
    let median = values.get(values.len() / 2).copied().unwrap_or(0.0);
    (values.len(), median)
}

/// Worst cable and tip of a run, N RMS, by the plant's truth.
fn figures(run: &Value) -> Result<(f64, f64), String> {
    let metrics = &run["metrics"];
    let cables = metrics["tension_rms_n"].as_array().into_iter().flatten();
    let worst = cables.filter_map(Value::as_f64).fold(0.0, f64::max);
    let tip = metrics["tip_force_rms_n"].as_f64();
    tip.map(|tip| (worst, tip))
        .ok_or_else(|| "set-force.json has no /metrics/tip_force_rms_n".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_row_has_what_was_found_and_both_rigs() {
        let gains = json!({"gains": [
            {"curve_per_n": 0.01, "curve_on_board": true, "creep_on_board": false},
            {"curve_per_n": 0.02, "curve_on_board": true, "creep_on_board": false},
            {"curve_per_n": 9.0, "curve_on_board": false, "creep_on_board": false},
        ]});
        assert_eq!(found(&gains, Kind::CellCurve), (2, 0.02));
        assert_eq!(found(&gains, Kind::Creep), (0, 0.0));
        let run = json!({"metrics": {"tension_rms_n": [0.1, 0.3], "tip_force_rms_n": 0.2}});
        assert_eq!(figures(&run), Ok((0.3, 0.2)));
        assert!(figures(&json!({})).is_err());
        let held = |before, after| Held {
            before: (before, before),
            after: (after, after),
            corrected: 6,
            found: 0.02,
        };
        let seed = (1..20).find(|s| kind_of(*s) == Kind::CellCurve).unwrap();
        let text = row(
            seed,
            &truth(seed, 1.0, Effects::All),
            &held(0.2, 0.1),
            &held(0.15, 0.09),
        );
        assert!(
            text.contains("0.0200 /N | 6 of 6 | 0.200 -> 0.100"),
            "{text}"
        );
    }
}

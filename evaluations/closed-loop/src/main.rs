//! Closing the loop on rigs that do what their rig file does not say: one effect a seed, found or not, and what
//! making up for it bought.
//!
//! For each seed an effect and its size are drawn and written to a plant file. `forcectl identify` runs as a process of
//! its own and hands that file to the rig; its analysis sees the recorded session and nothing else. Only then is
//! what it reports compared with the truth.
//!
//! `cargo xtask closed-loop [--seeds 1..10] [--drive-duration 40] [--duration 16] [--size 1] [--markdown FILE]`

use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// What `--help` prints; `cargo xtask closed-loop --help` as well.
const HELP: &str = include_str!("help.txt");

/// Cables start this slack, m, so that zeros are taken without a pull, as docs/bring-up.md has it.
const SLACK_M: f64 = 0.003;
/// Mean command of the excitation, N: where friction that grows with load is compared.
const MIDDLE_N: f64 = 4.5;

/// Draws numbers from a seed: SplitMix64.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A kind of effect that a rig may have beyond its rig file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Coulomb,
    LoadFriction,
    Ripple,
    Gain,
    Delay,
    Viscous,
    Backlash,
    Creep,
    CellCurve,
    Nothing,
}

const KINDS: [Kind; 10] = [
    Kind::Coulomb,
    Kind::LoadFriction,
    Kind::Ripple,
    Kind::Gain,
    Kind::Delay,
    Kind::Viscous,
    Kind::Backlash,
    Kind::Creep,
    Kind::CellCurve,
    Kind::Nothing,
];

/// What a rig has beyond its rig file.
struct Truth {
    kind: Kind,
    /// In words, with its size.
    words: String,
    /// The plant file's text.
    plant: String,
    /// Names by which it counts as named.
    names: &'static [&'static str],
    /// The number that is compared, and its unit.
    value: f64,
    unit: &'static str,
}

/// The kinds of ten seeds in a row are a permutation of all.
fn kind_of(seed: u64) -> Kind {
    let turn = seed.saturating_sub(1) / KINDS.len() as u64;
    let mut kinds = KINDS;
    let mut draw = Draw(turn ^ 0xC105_ED10);
    for i in (1..kinds.len()).rev() {
        kinds.swap(i, (draw.next() % (i as u64 + 1)) as usize);
    }
    kinds[(seed.saturating_sub(1) % KINDS.len() as u64) as usize]
}

/// What the rig of a seed has, its size times a factor.
fn truth(seed: u64, size: f64) -> Truth {
    let kind = kind_of(seed);
    let mut draw = Draw(seed.wrapping_mul(0x5851_F42D_4C95_7F2D));
    let sign = if draw.next() & 1 == 0 { 1.0 } else { -1.0 };
    let x = draw.between(0.0, 1.0);
    let within = |low: f64, high: f64| size * (low + (high - low) * x);
    let (words, effect, names, value, unit): (_, _, &'static [&'static str], _, _) = match kind {
        Kind::Coulomb => {
            let n = within(0.4, 0.8);
            (
                format!("Coulomb friction +{n:.3} N"),
                format!("kind = \"coulomb\"\nconstant_n = {n}"),
                &["coulomb", "load_dependent_coulomb"],
                n,
                "N",
            )
        }
        Kind::LoadFriction => {
            // A cable over one more guide, by a quarter turn, loses 1 - exp(-mu pi / 2) of its pull: mu of 0.10 to 0.14.
            let share = within(0.15, 0.20);
            (
                format!("friction +{share:.3} of the pull"),
                format!("kind = \"coulomb\"\nconstant_n = 0.0\nper_load = {share}"),
                &["coulomb", "load_dependent_coulomb"],
                share * MIDDLE_N,
                "N at 4.5 N",
            )
        }
        Kind::Ripple => {
            let n = within(0.4, 0.8);
            (
                format!("ripple {n:.3} N, once a motor turn"),
                format!("kind = \"periodic\"\nshaft = \"motor\"\norder = 1.0\namplitude_n = {n}"),
                &["periodic_angle"],
                n,
                "N",
            )
        }
        Kind::Gain => {
            let error = sign * within(0.2, 0.3);
            (
                format!("amplifier gain {:+.1} %", 100.0 * error),
                format!("kind = \"amplifier_gain\"\nrelative_error = {error}"),
                &["gain"],
                100.0 * error,
                "%",
            )
        }
        Kind::Delay => {
            let ms = within(4.0, 10.0);
            (
                format!("command delayed by {ms:.2} ms"),
                format!("kind = \"command_delay\"\ndelay_s = {}", ms * 1e-3),
                &["delay", "cable_stretch"],
                ms,
                "ms",
            )
        }
        Kind::Viscous => {
            let c = within(20.0, 50.0);
            (
                format!("viscous friction +{c:.1} N s/m"),
                format!("kind = \"viscous\"\ncoefficient_n_s_per_m = {c}"),
                &["viscous"],
                c,
                "N s/m",
            )
        }
        Kind::Backlash => {
            let mm = within(0.4, 1.0);
            (
                format!("backlash of {mm:.2} mm"),
                format!(
                    "kind = \"backlash\"\ngap_m = {}\nreel_friction_n = 0.2",
                    mm * 1e-3
                ),
                &["backlash"],
                mm,
                "mm",
            )
        }
        Kind::Creep => {
            let part = within(0.06, 0.12);
            (
                format!("creep of the cells, {:.1} % in 6 s", 100.0 * part),
                format!("kind = \"creep\"\nfraction = {part}\ntime_constant_s = 6.0"),
                &["creep"],
                100.0 * part,
                "%",
            )
        }
        Kind::CellCurve => {
            let k = within(0.006, 0.012);
            (
                format!("cells curved by {k:.4} /N"),
                format!("kind = \"cell_quadratic\"\nper_n = {k}"),
                &["quadratic"],
                k,
                "1/N",
            )
        }
        Kind::Nothing => (
            "nothing but the units' own scatter".to_owned(),
            String::new(),
            &[],
            0.0,
            "",
        ),
    };
    Truth {
        kind,
        words,
        plant: plant_text(&effect),
        names,
        value,
        unit,
    }
}

/// A plant file with this effect, or none.
fn plant_text(effect: &str) -> String {
    let mut plant = format!("[cable]\ninitial_slack_m = {SLACK_M}\n");
    if !effect.is_empty() {
        let _ = write!(plant, "\n[[effects]]\n{effect}\n");
    }
    plant
}

/// What `forcectl identify` said.
struct Said {
    /// Effects by name, with the number of units that they were named in.
    named: BTreeMap<String, usize>,
    units: usize,
    /// The compared number in each unit that names the effect.
    found: Vec<f64>,
    worst: (f64, Option<f64>),
    tip: (f64, Option<f64>),
    /// Worst cable and tip of the same rig without the effect, with the rig file as it is.
    without: Option<(f64, f64)>,
    changed: usize,
    better: bool,
}

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
        Kind::Coulomb | Kind::LoadFriction => {
            -(sum("friction") + sum("friction_at_zero_load") + MIDDLE_N * sum("friction_per_load"))
        }
        Kind::Ripple => sum("amplitude"),
        Kind::Gain => 100.0 * sum("gain_error"),
        Kind::Delay => 1e3 * (sum("delay") + sum("time_constant")),
        Kind::Viscous => -sum("damping"),
        Kind::Backlash => 1e3 * 0.010 * (sum("gap") + sum("play")),
        Kind::Creep => 100.0 * sum("creep_share"),
        Kind::CellCurve => sum("curvature"),
        Kind::Nothing => 0.0,
    }
}

fn read(truth: &Truth, report: &Value) -> Result<Said, String> {
    let units = report["units"]
        .as_array()
        .ok_or("identify.json has no units")?;
    let mut named: BTreeMap<String, usize> = BTreeMap::new();
    let mut found = Vec::new();
    for unit in units {
        let effects: Vec<&Value> = unit["effects"].as_array().into_iter().flatten().collect();
        let mut names: Vec<&str> = effects.iter().filter_map(|e| e["name"].as_str()).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            *named.entry(name.to_owned()).or_default() += 1;
        }
        let own: Vec<&Value> = effects
            .into_iter()
            .filter(|e| e["name"].as_str().is_some_and(|n| truth.names.contains(&n)))
            .collect();
        if !own.is_empty() {
            found.push(compared(truth.kind, &own));
        }
    }
    found.sort_by(f64::total_cmp);
    let after = |path: &str| report.pointer(path).and_then(Value::as_f64);
    Ok(Said {
        named,
        units: units.len(),
        found,
        worst: (
            number(report, "/before/worst_tension_rms_n")?,
            after("/after/worst_tension_rms_n"),
        ),
        tip: (
            number(report, "/before/tip_rms_n")?,
            after("/after/tip_rms_n"),
        ),
        without: None,
        changed: report["changed"].as_array().map_or(0, Vec::len),
        better: report["better"].as_bool().unwrap_or(false),
    })
}

struct Options {
    forcectl: PathBuf,
    seeds: (u64, u64),
    drive: String,
    hold: String,
    size: f64,
    out: PathBuf,
    markdown: Option<PathBuf>,
    reuse: bool,
}

/// `None`: `--help` was asked for.
fn options() -> Result<Option<Options>, String> {
    let mut options = Options {
        forcectl: PathBuf::new(),
        seeds: (1, 10),
        drive: "40".to_owned(),
        hold: "16".to_owned(),
        size: 1.0,
        out: PathBuf::from("target/closed-loop"),
        markdown: None,
        reuse: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || {
            words
                .next()
                .ok_or(format!("{word} needs a value\n\n{HELP}"))
        };
        match word.as_str() {
            "--forcectl" => options.forcectl = value()?.into(),
            "--seeds" => {
                let text = value()?;
                let (first, last) = text.split_once("..").unwrap_or((&text, &text));
                let seed = |t: &str| t.trim_start_matches('=').parse::<u64>().ok();
                options.seeds = seed(first)
                    .zip(seed(last))
                    .filter(|(first, last)| (1..=*last).contains(first))
                    .ok_or(format!(
                        "--seeds {text}: give FIRST..LAST, whole numbers from 1"
                    ))?;
            }
            "--drive-duration" => options.drive = value()?,
            "--duration" => options.hold = value()?,
            "--size" => {
                let text = value()?;
                let size = text.parse().ok().filter(|x| (0.1..=1.0).contains(x));
                options.size = size.ok_or(format!("--size {text}: give 0.1 to 1"))?;
            }
            "--out" => options.out = value()?.into(),
            "--reuse" => options.reuse = true,
            "--markdown" => options.markdown = Some(value()?.into()),
            "-h" | "--help" => return Ok(None),
            other => return Err(format!("{other}: no such option\n\n{HELP}")),
        }
    }
    if options.forcectl.as_os_str().is_empty() {
        return Err(format!("--forcectl is missing\n\n{HELP}"));
    }
    Ok(Some(options))
}

fn run(options: &Options, seed: u64, truth: &Truth) -> Result<Said, String> {
    let folder = options.out.join(format!("seed{seed}"));
    let report = folder.join("found");
    let json = report.join("identify.json");
    let control = folder.join("control");
    if options.reuse {
        return said(truth, &json, &control);
    }
    // What an earlier run left would be read in place of a report that was never written.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let plant = folder.join("plant.toml");
    std::fs::write(&plant, &truth.plant).map_err(|e| format!("{}: {e}", plant.display()))?;
    let output = Command::new(&options.forcectl)
        .arg("identify")
        .args(["--link", "embedded", "--seed", &seed.to_string()])
        .arg("--plant")
        .arg(&plant)
        .args(["--drive-duration", &options.drive])
        .args(["--duration", &options.hold])
        .arg("--out")
        .arg(&report)
        .output()
        .map_err(|e| format!("{}: {e}", options.forcectl.display()))?;
    // 6: done, and nothing changed. That is a result.
    if !matches!(output.status.code(), Some(0 | 6)) {
        let words = String::from_utf8_lossy(&output.stderr);
        let last = words.lines().last().unwrap_or("no words").to_owned();
        return Err(format!("forcectl ended with {}: {last}", output.status));
    }
    // The same rig without the effect: what there was to win.
    std::fs::create_dir_all(&control).map_err(|e| format!("{}: {e}", control.display()))?;
    let plain = control.join("plant.toml");
    std::fs::write(&plain, plant_text("")).map_err(|e| format!("{}: {e}", plain.display()))?;
    Command::new(&options.forcectl)
        .args(["set-force", "0", "2.5", "0", "--duration", &options.hold])
        .args(["--link", "embedded", "--seed", &seed.to_string()])
        .arg("--plant")
        .arg(&plain)
        .arg("--out")
        .arg(&control)
        .output()
        .map_err(|e| format!("{}: {e}", options.forcectl.display()))?;
    said(truth, &json, &control)
}

fn json(path: &Path) -> Result<Value, String> {
    let fault = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let text = std::fs::read_to_string(path).map_err(|e| fault(&e))?;
    serde_json::from_str(&text).map_err(|e| fault(&e))
}

/// What a report says, and the control run beside it.
fn said(truth: &Truth, report: &Path, control: &Path) -> Result<Said, String> {
    let mut said = read(truth, &json(report)?)?;
    let control = json(&control.join("set-force.json"))?;
    let cables = control["metrics"]["tension_rms_n"].as_array();
    let worst = cables
        .into_iter()
        .flatten()
        .filter_map(Value::as_f64)
        .fold(0.0, f64::max);
    said.without = Some((worst, number(&control, "/metrics/tip_force_rms_n")?));
    Ok(said)
}

const HEAD: &str = "\
| seed | undeclared | named | true | found | worst cable, N | tip, N | without it, N | board |
|---|---|---|---|---|---|---|---|---|
";

/// What an effect did to the worst cable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cost {
    /// Less than a tenth over the same rig without it.
    None,
    /// At least half of what it cost is gone.
    WonBack,
    /// Less than half of what it cost is gone.
    Left,
}

fn cost(said: &Said) -> Option<Cost> {
    let (without, _) = said.without?;
    let cost = said.worst.0 - without;
    let won = said.worst.1.map_or(0.0, |after| said.worst.0 - after);
    Some(if cost < 0.1 * without {
        Cost::None
    } else if said.better && won >= 0.5 * cost {
        Cost::WonBack
    } else {
        Cost::Left
    })
}

/// A row of the table, and whether the board made the force better by what was rightly named.
fn row(seed: u64, truth: &Truth, said: &Result<Said, String>) -> (String, bool) {
    let said = match said {
        Ok(said) => said,
        Err(why) => {
            return (
                format!("| {seed} | {} | failed: {why} | | | | | | |\n", truth.words),
                false,
            )
        }
    };
    let units = said.units;
    let hits = said.found.len();
    let others: Vec<String> = said
        .named
        .iter()
        .filter(|(name, count)| !truth.names.contains(&name.as_str()) && **count * 3 >= units)
        .map(|(name, count)| format!("{name} {count}/{units}"))
        .collect();
    let mut named = match truth.names {
        [] => "-".to_owned(),
        _ if hits == 0 => "missed".to_owned(),
        names => {
            let seen: Vec<&str> = names
                .iter()
                .copied()
                .filter(|n| said.named.contains_key(*n))
                .collect();
            format!("{} {hits}/{units}", seen.join(" or "))
        }
    };
    if !others.is_empty() {
        let _ = write!(named, "; beside it {}", others.join(", "));
    }
    let (true_value, found) = if truth.names.is_empty() {
        ("-".to_owned(), "-".to_owned())
    } else {
        let found = said.found.get(hits / 2).map_or("-".to_owned(), |median| {
            format!(
                "{median:.3} ({:.3} to {:.3})",
                said.found[0],
                said.found[hits - 1]
            )
        });
        (format!("{:.3} {}", truth.value, truth.unit), found)
    };
    let pair = |(before, after): (f64, Option<f64>)| {
        after.map_or(format!("{before:.3}"), |after| {
            format!("{before:.3} -> {after:.3}")
        })
    };
    let board = match (said.changed, said.better) {
        (0, _) => "nothing to use",
        (_, true) => "better",
        (_, false) => "no better, left as it was",
    };
    let text = format!(
        "| {seed} | {} | {named} | {true_value} | {found} | {} | {} | {} | {board} |\n",
        truth.words,
        pair(said.worst),
        pair(said.tip),
        said.without.map_or("-".to_owned(), |(worst, tip)| format!(
            "{worst:.3}, {tip:.3}"
        ))
    );
    (text, said.better && 2 * hits > units)
}

/// Kinds by what came of them.
#[derive(Default)]
struct Kinds {
    /// Named in most units, and the force was held better after.
    better: Vec<Kind>,
    /// Of those: cost something, half of it won back.
    back: Vec<Kind>,
    /// Cost something, and most of it is still there.
    left: Vec<Kind>,
    /// Cost nothing.
    harmless: Vec<Kind>,
}

impl Kinds {
    fn add(&mut self, kind: Kind, gained: bool, cost: Option<Cost>) {
        let lists = [
            (&mut self.better, gained),
            (&mut self.back, gained && cost == Some(Cost::WonBack)),
            (&mut self.left, cost == Some(Cost::Left)),
            (&mut self.harmless, cost == Some(Cost::None)),
        ];
        for (list, belongs) in lists {
            if belongs && !list.contains(&kind) {
                list.push(kind);
            }
        }
    }
}

/// Why a kind comes out as it does, told only where it did.
const NOTES: [(Kind, Cost, &str); 5] = [
    (
        Kind::Backlash,
        Cost::None,
        "*Backlash* is not felt: a cable under tension keeps its gear on one flank, so the play is never crossed.",
    ),
    (
        Kind::Creep,
        Cost::Left,
        "*Creep* is an error of the measurement. The loop holds what the cells say; the remedy is a calibration, not a setting.",
    ),
    (
        Kind::CellCurve,
        Cost::Left,
        "A *curve of the cells* is an error of the measurement as well: calibrate with several weights.",
    ),
    (
        Kind::Viscous,
        Cost::None,
        "*Viscous friction* damps reel and cable: where it costs the loop nothing there is nothing to win.",
    ),
    (
        Kind::LoadFriction,
        Cost::WonBack,
        "*Friction in proportion to the pull* is drawn as that of one more guide, a quarter turn at a friction coefficient of 0.10 \
         to 0.14. `--size 0.5` halves all sizes ([what that cost](identify.md#on-rigs-with-undeclared-effects)).",
    ),
];

fn page(options: &Options, rows: &str, kinds: &Kinds) -> String {
    let (first, last) = options.seeds;
    let Kinds {
        better,
        back,
        left,
        harmless,
    } = kinds;
    let notes: String = NOTES
        .iter()
        .filter(|(kind, of, _)| match of {
            Cost::None => harmless.contains(kind),
            Cost::WonBack => back.contains(kind),
            Cost::Left => left.contains(kind),
        })
        .map(|(_, _, note)| format!("* {note}\n"))
        .collect();
    let size = if options.size < 1.0 {
        format!(" --size {}", options.size)
    } else {
        String::new()
    };
    format!(
        "# Closed loop: an effect that the rig file doesn't declare

Printed by `cargo xtask closed-loop --seeds {first}..{last}{size} --markdown docs/residual/closed-loop.md`.

Each seed is another rig (scatter of units, survey, noise, the robot's path) with one effect in all its units that the rig
file does not have. `forcectl identify` runs as a process of its own on the real firmware: it holds 2.5 N along y at the
moving tip for {hold} s, drives the cables for {seconds} s with the tension loops open, analyses what was recorded, puts what the
board can use into a rig file, and holds the force again. The effect is in a file that only the rig reads.

*named*: units in which the effect was named; what else was named in a third of them or more. Units also differ
from the rig file by themselves (Coulomb friction by 5 %, its share of load by 8 %, offset by 27 mN), which is found as
friction, gain or offset of its own. *found*: median over the units that name it (smallest to largest). *worst
cable*, *tip*: RMS of the worst cable's tension error and of the force error at the tip, by the plant's truth,
before and after. *without it*: both on the same rig without the effect, rig file as it is; after a correction
they can be smaller than that, since the units' own scatter is corrected as well. *board*: `better` where the worst cable gained 2 % at least and the tip lost no more than 5 %;
elsewhere `forcectl identify` leaves the rig file as it was.

{HEAD}{rows}
Kinds of effect that were named in most units, and the force was held better after: {} ({better:?}). Not all of that is
due to the effect: units' own scatter is corrected with it, and friction is declared 0.1 N below what is found, which
helps by itself, as the row with nothing undeclared shows.

Kinds that had cost the worst cable a tenth or more against *without it*, of whose cost at least half was won back: {}
({back:?}). Kinds whose cost is still there: {left:?}. Kinds that cost less than a tenth, or nothing: {harmless:?}.

{notes}",
        better.len(),
        back.len(),
        hold = options.hold,
        seconds = options.drive,
    )
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(Some(options)) => options,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(why) => {
            eprintln!("closed-loop: {why}");
            return ExitCode::from(2);
        }
    };
    let mut rows = String::new();
    let mut kinds = Kinds::default();
    let mut failed = false;
    print!("{HEAD}");
    for seed in options.seeds.0..=options.seeds.1 {
        let truth = truth(seed, options.size);
        let said = run(&options, seed, &truth);
        failed |= said.is_err();
        let (text, gained) = row(seed, &truth, &said);
        print!("{text}");
        rows.push_str(&text);
        kinds.add(truth.kind, gained, said.ok().as_ref().and_then(cost));
    }
    println!(
        "\nkinds of effect that were named in most units and held better after: {} {:?}; that had cost something, half of it won back: {} {:?}",
        kinds.better.len(),
        kinds.better,
        kinds.back.len(),
        kinds.back
    );
    if let Some(path) = &options.markdown {
        if let Err(why) = write(path, &page(&options, &rows, &kinds)) {
            eprintln!("closed-loop: {why}");
            return ExitCode::FAILURE;
        }
    }
    if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    }
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn ten_seeds_in_a_row_have_every_kind_and_good_plants() {
        for first in [1, 11, 101] {
            let mut kinds: Vec<Kind> = (first..first + 10).map(kind_of).collect();
            kinds.sort_by_key(|kind| format!("{kind:?}"));
            kinds.dedup();
            assert_eq!(kinds.len(), KINDS.len());
        }
        for seed in 1..60 {
            let truth = truth(seed, 1.0);
            assert_eq!(
                truth.plant.contains("[[effects]]"),
                truth.kind != Kind::Nothing
            );
            assert!(truth.plant.contains("initial_slack_m = 0.003"));
        }
        // The sizes differ from seed to seed, and one seed is one rig.
        assert_ne!(truth(1, 1.0).plant, truth(11, 1.0).plant);
        assert_ne!(truth(1, 1.0).plant, truth(1, 0.5).plant);
        assert_eq!(truth(7, 1.0).plant, truth(7, 1.0).plant);
    }

    #[test]
    fn a_report_is_held_against_the_truth() {
        let seed = (1..20).find(|s| kind_of(*s) == Kind::Gain).unwrap();
        let truth = truth(seed, 1.0);
        let unit = |name: &str, error: f64| json!({"effects": [{"name": name, "params": {"gain_error": error}}]});
        let report = json!({
            "units": [unit("gain", -0.2), unit("gain", -0.3), unit("tone", 0.0)],
            "changed": ["x"],
            "better": true,
            "before": {"worst_tension_rms_n": 0.2, "tip_rms_n": 0.1},
            "after": {"worst_tension_rms_n": 0.1, "tip_rms_n": 0.05},
        });
        let mut said = read(&truth, &report).unwrap();
        assert_eq!(cost(&said), None);
        said.without = Some((0.11, 0.05));
        assert_eq!(cost(&said), Some(Cost::WonBack));
        // It cost nothing, or little of it came back, or the board was left as it was.
        said.without = Some((0.19, 0.05));
        assert_eq!(cost(&said), Some(Cost::None));
        said.without = Some((0.05, 0.05));
        said.worst.1 = Some(0.15);
        assert_eq!(cost(&said), Some(Cost::Left));
        said.worst.1 = Some(0.1);
        assert_eq!(cost(&said), Some(Cost::WonBack));
        said.better = false;
        assert_eq!(cost(&said), Some(Cost::Left));
        said.better = true;
        let (text, gained) = row(seed, &truth, &Ok(said));
        assert!(gained);
        assert!(text.contains("gain 2/3; beside it tone 1/3"), "{text}");
        assert!(text.contains("-20.000 (-30.000 to -20.000)"), "{text}");
        assert!(text.contains("0.200 -> 0.100"), "{text}");
        let (text, gained) = row(seed, &truth, &Err("no rig".to_owned()));
        assert!(!gained && text.contains("no rig"));
        assert!(read(&truth, &json!({"units": []})).is_err());
    }
}

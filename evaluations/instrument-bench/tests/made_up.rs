//! The evaluation on made-up runs in the format of the public set, whose truth is known.

use estimator::model::Model as _;
use estimator::sequence::Sequence;
use instrument_bench::data::{read_run, read_set, Run};
use instrument_bench::protocol::{inputs, Inputs};
use instrument_bench::reference::Reference;
use instrument_bench::results::Set;
use instrument_bench::score::score;
use instrument_bench::split::Apart;
use instrument_bench::sums::Sums;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Speeds and loads of the made-up set.
const SPEEDS: u8 = 3;
const LEVELS: u8 = 5;

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

/// Noise without a library: a number in -1 to 1 from two numbers.
fn noise(seed: u64, n: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ n.wrapping_mul(0xD1B5_4A32_D192_ED03);
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Text of a run: the drive follows a sine; its current holds the load by the lever of the jaw,
/// friction, and the inertia of the motor, whose speed has a ripple. `gain` is the tool's.
fn run_text(speed: u8, level: u8, gain: f64) -> String {
    let mut text = String::from("%a header\n%with two lines\n");
    let omega = TAU * 0.1 * (f64::from(speed) + 2.0);
    let load = 12.0 * (f64::from(level) + 1.0);
    let seed = u64::from(speed) * 100 + u64::from(level);
    for n in 0..12_000u64 {
        let t = n as f64 * 1e-3;
        let angle = |t: f64| 0.525 + 0.525 * (omega * t).cos() + 0.004 * (37.0 * t).sin();
        let (p, v) = (angle(t), (angle(t + 1e-3) - angle(t - 1e-3)) / 2e-3);
        let a = (angle(t + 1e-3) - 2.0 * angle(t) + angle(t - 1e-3)) / 1e-6;
        // The jaw closes with falling angle, against the load.
        let torque = -load * (1.0 + 0.1 * (p - 0.5)) - 3.0 * v.tanh();
        let current = -gain * torque * (1.0 - 0.2 * p) / 600.0
            - 0.02 * (20.0 * v).tanh()
            - 0.004 * v
            - 0.000_4 * a;
        let current = current + 0.004 * noise(seed, n);
        let spindle = (p * 8192.0 / TAU).round();
        let motor = (-(p + 0.02) * 4096.0 * 35.0 / TAU).round();
        let counts = ((torque + 0.3 * noise(seed + 50, n)) / 0.039_811).round();
        let _ = writeln!(
            text,
            "{t:.3},{spindle},0,{current:.4},0,{counts},0.1,0.0,{motor},0.0"
        );
    }
    text
}

fn write_set(name: &str, gain: f64) -> (PathBuf, Vec<Run>) {
    let clone = folder(name);
    let set = clone.join("data").join("Made_up");
    std::fs::create_dir_all(&set).expect("a folder for the set");
    for speed in 0..SPEEDS {
        for level in 0..LEVELS {
            let file = set.join(format!("{speed}{level}.TXT"));
            std::fs::write(file, run_text(speed, level, gain)).expect("the run is written");
        }
    }
    let runs = read_set(&clone, "Made_up").expect("the set is read");
    (clone, runs)
}

#[test]
fn the_model_beats_a_plane_on_loads_that_it_has_not_seen() {
    let (_, runs) = write_set("splits", 1.0);
    assert_eq!(runs.len(), usize::from(SPEEDS * LEVELS));
    let set = Set::of("Made_up", runs);
    let labels = set.labels();
    let plane: Vec<Sums> = set
        .runs
        .iter()
        .zip(&set.scored)
        .map(|(run, scored)| Reference::Plane.sums(run, scored))
        .collect();
    // Without one of three speeds the friction at that speed is an extrapolation.
    for (apart, most) in [(Apart::Level, 0.7), (Apart::LevelAndSpeed, 1.2)] {
        let (ours, plane) = (
            score(apart, &labels, &set.causal).rmse_mnm,
            score(apart, &labels, &plane).rmse_mnm,
        );
        // The noise of the current alone is 1.5 mN·m a row.
        assert!(ours < most, "{apart:?}: {ours}");
        assert!(plane > 1.5 * ours, "{apart:?}: {plane} {ours}");
    }
}

#[test]
fn two_files_correct_a_tool_with_another_gain() {
    let first = Set::of("a", write_set("tool-a", 1.0).1);
    let second = Set::of("b", write_set("tool-b", 1.04).1);
    let transfers =
        instrument_bench::results::transfer(&first, &second).expect("both sets can be fitted");
    assert_eq!(transfers.files, ["Made_up/00", "Made_up/24"]);
    assert!(transfers.raw_mnm > 1.2, "{}", transfers.raw_mnm);
    assert!(transfers.corrected_mnm < 0.7, "{}", transfers.corrected_mnm);
}

#[test]
fn a_row_depends_on_the_past_alone_and_live_is_the_same() {
    let (_, runs) = write_set("causal", 1.0);
    let set = Set::of("Made_up", runs);
    let model = set.model().expect("the set can be fitted");
    let rows = inputs(&set.runs[7], Inputs::Causal);
    let sequence = |rows: &[instrument_bench::data::Row]| Sequence {
        trial: 0,
        start_s: 0.0,
        step_s: 1e-3,
        input: rows
            .iter()
            .flat_map(|r| [r.current_a as f32, r.spindle_rad as f32, r.motor_rad as f32])
            .collect(),
        inputs: 3,
        target: vec![0.0; rows.len()],
        targets: 1,
    };
    let whole = model.predict(&sequence(&rows));
    let part = model.predict(&sequence(&rows[..5000]));
    assert_eq!(whole[..5000], part[..]);
    let scored = &set.scored[7];
    let squared: f64 = scored
        .rows
        .iter()
        .zip(&scored.truth_mnm)
        .map(|(row, truth)| (f64::from(whole[*row]) - truth).powi(2))
        .sum();
    let rmse = (squared / scored.rows.len() as f64).sqrt();
    assert!(rmse < 0.7, "single precision costs little: {rmse}");
}

#[test]
fn what_is_not_there_or_broken_is_refused_with_its_place() {
    let empty = folder("empty");
    let error = read_set(&empty, "Tool_4_Maryland_L_4")
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("https://github.com/MRDLab/mis-tool-characterization")
            && error.contains("--data"),
        "{error}"
    );
    let good = run_text(0, 0, 1.0);
    let broken = folder("broken");
    for (name, from, to, words) in [
        ("00", "0.100,", "0.700,", ":103: the time is not 1 ms after"),
        (
            "01",
            "\n0.100,",
            "\nx,",
            ":103: `x` in column 1 is not a number",
        ),
        (
            "02",
            "\n0.100,",
            "\nNaN,",
            ":103: `NaN` in column 1 is not a number",
        ),
        (
            "03",
            "\n0.100,",
            "\n0.100,1,",
            ":103: 11 cells where 10 columns",
        ),
    ] {
        let file = broken.join(format!("{name}.TXT"));
        std::fs::write(&file, good.replacen(from, to, 1)).expect("the file is written");
        let error = read_run(&file, "broken").unwrap_err().to_string();
        assert!(error.contains(&format!("{name}.TXT{words}")), "{error}");
    }
    let short: String = good
        .lines()
        .take(100)
        .map(|line| format!("{line}\n"))
        .collect();
    let file = broken.join("04.TXT");
    std::fs::write(&file, short).expect("the file is written");
    assert!(read_run(&file, "broken")
        .unwrap_err()
        .to_string()
        .contains("98 rows"));
    let file = broken.join("notes.TXT");
    std::fs::write(&file, good).expect("the file is written");
    assert!(read_run(&file, "broken")
        .unwrap_err()
        .to_string()
        .contains("two or three digits"));
}

#[test]
fn a_runaway_is_left_out_with_all_that_remembers_it() {
    let (_, mut runs) = write_set("runaway", 1.0);
    let before = instrument_bench::protocol::scored(&runs[0]);
    let at = before.rows[before.rows.len() / 2];
    for row in &mut runs[0].rows[at..at + 50] {
        row.spindle_rad -= 3.0;
    }
    let after = instrument_bench::protocol::scored(&runs[0]);
    assert!(after.runaway > 0);
    assert!(after
        .rows
        .iter()
        .all(|row| *row + 90 < at || *row > at + 290));
}

//! How estimates fare over several robots:
//! `cargo run --release -p estimator --example robots -- MODEL SEED...` prints the table of
//! docs/estimation.md.
//!
//! Each robot (seed) is there twice: as an arm that is the same in every trial, and as one with the
//! changes of the standard experiment. For each motion a model is trained on six trials of five
//! minutes and tested on two others, of a minute of free motion and five minutes under load.
//! `frozen`: the model as it was trained; `after a minute`: recalibrated on the free motion, of
//! which one set has four minutes. The label is the true force of the simulation, without the rig's
//! cells. Rows are those that are valid. Intervals are over robots.

#[path = "../tests/common/rows.rs"]
mod rows;
#[path = "../tests/common/trials.rs"]
#[expect(dead_code, reason = "trials along y of the tests")]
mod trials;

use estimator::estimator::{Estimator, Kind};
use estimator::metrics::half_width;
use estimator::sequence::Sequence;
use estimator::stream::Stream;
use rayon::prelude::*;
use robot::arm::ChangeConfig;
use robot::trajectory::TrajectoryConfig;
use trials::{along_y, train_axes, trial_on, wave};

/// Trials of the training and of the test.
const TRAINING: u64 = 6;
const TEST: u64 = 2;
const MINUTE_S: f64 = 60.0;
const LOADED_S: f64 = 300.0;
/// The speeds of the thesis (4.3: 0 to 2.4 mm/s at the tip) per the default ones.
const SLOW: f64 = 0.25;

/// What is done with a robot.
struct Set {
    name: &'static str,
    speed: f64,
    axes: &'static [usize],
    force_n: fn(f64, f64) -> [f64; 3],
    /// Free motion before the force of a test, s.
    free_s: f64,
}

const SETS: [Set; 4] = [
    Set {
        name: "default speeds",
        speed: 1.0,
        axes: &[1],
        force_n: along_y,
        free_s: MINUTE_S,
    },
    Set {
        name: "speeds of the thesis",
        speed: SLOW,
        axes: &[1],
        force_n: along_y,
        free_s: MINUTE_S,
    },
    Set {
        name: "speeds of the thesis, four minutes",
        speed: SLOW,
        axes: &[1],
        force_n: along_y,
        free_s: MINUTE_S / SLOW,
    },
    Set {
        name: "three components: x; y; z",
        speed: 1.0,
        axes: &[0, 1, 2],
        force_n: all_ways,
        free_s: MINUTE_S,
    },
];

/// Three components of up to 3 N, at rates of the thesis.
fn all_ways(t: f64, phase: f64) -> [f64; 3] {
    [0.0, 1.7, 3.1].map(|of| 0.7 * wave(t, phase + of))
}

impl Set {
    fn trial(&self, seed: u64, session: u64, change: ChangeConfig, free_s: f64) -> [Sequence; 2] {
        let path = TrajectoryConfig::default();
        let path = TrajectoryConfig {
            slowest: path.slowest.map(|v| v * self.speed),
            fastest: path.fastest.map(|v| v * self.speed),
            ..path
        };
        let times_s = [free_s, LOADED_S];
        trial_on(&path, seed, session, change, times_s, self.force_n)
    }
}

/// Errors over the valid rows of trials: mean of each component, N, and the share that intervals
/// cover.
#[derive(Clone, Copy, Default)]
struct Score {
    error_n: [f64; 3],
    rows: f64,
    covered: f64,
}

impl Score {
    fn add(mut self, estimator: &Estimator, loaded: &Sequence) -> Self {
        let mut stream = Stream::new(estimator);
        for k in 0..loaded.rows() {
            let sure = stream.step(loaded.input_row(k));
            if !sure.valid {
                continue;
            }
            let mut square = 0.0;
            for (place, axis) in estimator.axes.iter().enumerate() {
                let error = f64::from(stream.force()[place] - loaded.target_row(k)[*axis]);
                self.error_n[place] += error.abs();
                square += error * error;
            }
            self.rows += 1.0;
            let within = sure.half_n.is_some_and(|half| square.sqrt() <= half);
            self.covered += f64::from(u8::from(within));
        }
        self
    }
}

/// Frozen and recalibrated scores of one robot.
fn robot(kind: Kind, seed: u64, set: &Set, change: ChangeConfig) -> [Score; 2] {
    let training: Vec<Sequence> = (1..=TRAINING)
        .into_par_iter()
        .map(|session| set.trial(seed, session, change, 0.0))
        .map(|[_, loaded]| loaded)
        .collect();
    let rows: Vec<&Sequence> = training.iter().collect();
    let model = train_axes(kind, seed, set.axes.to_vec(), &rows);
    let text = model.to_json().expect("stored");
    let tests: Vec<[Sequence; 2]> = (11..11 + TEST)
        .into_par_iter()
        .map(|session| set.trial(seed, session, change, set.free_s))
        .collect();
    let mut scores = [Score::default(); 2];
    for [free, loaded] in &tests {
        let mut estimator = Estimator::from_json(&text).expect("a model");
        scores[0] = scores[0].add(&estimator, loaded);
        estimator.recalibrate(&[free]).expect("recalibrated");
        scores[1] = scores[1].add(&estimator, loaded);
    }
    scores
}

/// Mean over robots with its interval, and the largest; and the coverage.
fn cells(scores: &[Score], axes: usize) -> String {
    let mut text = String::new();
    for place in 0..axes {
        let all: Vec<f64> = scores.iter().map(|s| s.error_n[place] / s.rows).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let half = half_width(&all).map_or(String::new(), |half| format!(" ± {half:.3}"));
        let most = all.iter().copied().fold(0.0, f64::max);
        text += &format!(
            "{}{mean:.3}{half}, at most {most:.3}",
            if place > 0 { "; " } else { "" }
        );
    }
    let share = |s: &Score| s.covered / s.rows;
    let covered = scores.iter().map(share).sum::<f64>() / scores.len() as f64;
    let least = scores.iter().map(share).fold(1.0, f64::min);
    format!("{text} | {:.1} ({:.1})", 100.0 * covered, 100.0 * least)
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let kind = arguments.next().and_then(|name| Kind::of(&name));
    let kind = kind.expect("`physics` or `hybrid`, then seeds");
    let seeds: Vec<u64> = arguments.map(|a| a.parse().expect("a seed")).collect();
    println!("| motion | arm | frozen: MAE, N | covers, % (least) | after a minute: MAE, N | covers, % (least) |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for set in &SETS {
        for (arm, change) in [
            ("same in every trial", ChangeConfig::default()),
            ("changes between trials", ChangeConfig::STANDARD),
        ] {
            let all: Vec<[Score; 2]> = seeds
                .iter()
                .map(|seed| {
                    let scores = robot(kind, *seed, set, change);
                    let mae = scores.map(|s| s.error_n.map(|e| e / s.rows));
                    eprintln!("{}, {arm}, robot {seed}: {mae:.3?}", set.name);
                    scores
                })
                .collect();
            let of = |n: usize| all.iter().map(|s| s[n]).collect::<Vec<_>>();
            let n = set.axes.len();
            let (frozen, minute) = (cells(&of(0), n), cells(&of(1), n));
            println!("| {} | {arm} | {frozen} | {minute} |", set.name);
        }
    }
}

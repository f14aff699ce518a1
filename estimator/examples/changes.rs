//! How estimates fare on a robot that has changed since the training, without and with a
//! recalibration on a minute of free motion:
//! `cargo run --release -p estimator --example changes -- MODEL SEED...` prints the table of
//! docs/estimation.md.
//!
//! For each robot (seed) the model is trained on 30 minutes of the arm without changes. Each row is
//! another change, in two trials of a minute of free motion and three minutes under load, begun at
//! power-on. `frozen`: the model as it was trained. The label is the true force of the simulation,
//! without the rig's cells. Rows are those that are valid.
//!
//! Below the table: alarms, the least error with a drag, and how often a constant force that nobody
//! measured in the minute is told, on the unchanged arm along each axis.

#[path = "../tests/common/rows.rs"]
mod rows;
#[path = "../tests/common/trials.rs"]
mod trials;

use estimator::estimator::{Estimator, Kind};
use estimator::physics::Physics;
use estimator::sequence::Sequence;
use estimator::stream::Stream;
use estimator::wander::{self, Share, Wander};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use robot::arm::ChangeConfig;
use robot::trajectory::TrajectoryConfig;
use trials::{train, trial, trial_on};

const FREE_S: f64 = 60.0;
/// Trials of each change.
const TRIALS: usize = 2;
/// Trials of the unchanged arm of each robot in which an alarm is counted.
const UNCHANGED: u64 = 24;

/// A trial: error over its valid rows, N, the share that the interval covers, and when the alarm
/// came, s.
#[derive(Clone, Copy)]
struct Score {
    mae_n: f64,
    covered: f64,
    alarm_s: Option<f64>,
}

fn score(estimator: &Estimator, sequence: &Sequence) -> Score {
    let mut stream = Stream::new(estimator);
    let (mut error_n, mut rows, mut covered) = (0.0, 0.0, 0.0);
    let mut alarm_s = None;
    for k in 0..sequence.rows() {
        let sure = stream.step(sequence.input_row(k));
        if sure.misfits {
            alarm_s.get_or_insert(k as f64 * sequence.step_s);
        }
        if sure.valid {
            let error = f64::from(stream.force()[0] - sequence.target_row(k)[1]).abs();
            error_n += error;
            rows += 1.0;
            covered += f64::from(u8::from(sure.half_n.is_some_and(|half| error <= half)));
        }
    }
    Score {
        mae_n: error_n / rows,
        covered: covered / rows,
        alarm_s,
    }
}

/// Mean error that no estimator with the same balances falls below, N, where a torque of a tool's
/// cable of this size is at the elbow, from the covariance of force and torque: if the noise of
/// each balance is white beyond 2 s, and with the slow errors that balances have.
fn least_n(model: &str, loaded: &Sequence, size: f64) -> [f64; 2] {
    let value: serde_json::Value = serde_json::from_str(model).expect("a model");
    let physics = value["model"]["physics"].clone();
    let physics: Physics = serde_json::from_value(physics).expect("a physical model");
    let moments = loaded
        .target
        .chunks_exact(3)
        .fold(Matrix3::identity() * 1e-3, |sum, f| {
            let force = Vector3::new(f64::from(f[0]), f64::from(f[1]), f64::from(f[2]));
            sum + force * force.transpose()
        });
    let moments = moments / loaded.rows() as f64;
    // The rate of the forces of `trial`, 1/s, and the sinusoid's standard deviation.
    let sizes = [0.0, size / 2.0_f64.sqrt(), 0.0];
    let noise: Vec<Vector3<f64>> = {
        let mut observer = physics.observer();
        let rows = (0..loaded.rows()).map(|k| observer.take(loaded.input_row(k)).1.deviation);
        rows.map(Vector3::from).collect()
    };
    let middle = core::array::from_fn(|i| {
        let mut of: Vec<f64> = noise.iter().map(|noise| noise[i]).collect();
        of.sort_by(f64::total_cmp);
        of[of.len() / 2]
    });
    [([0.0; 3], 2.0), (middle, wander::ALIKE_S)].map(|(stays, alike_s)| {
        let unsure = [Share::default(); 3];
        let mut filter = Wander::new(&moments, 0.074, sizes, stays, unsure, loaded.step_s);
        let mut observer = physics.observer();
        let (mut sum, mut rows) = (0.0, 0.0);
        for (k, noise) in noise.iter().enumerate() {
            let (moment, seen) = observer.take(loaded.input_row(k));
            let variance = noise.component_mul(noise) * (alike_s / wander::ALIKE_S);
            let none = Vector3::zeros();
            filter.step(&none, &variance, &seen.levers, &none, loaded.step_s);
            if moment.settled() {
                sum += filter.force().1[(1, 1)].sqrt();
                rows += 1.0;
            }
        }
        // Mean of the absolute value of a normal distribution.
        (2.0 / std::f64::consts::PI).sqrt() * sum / rows
    })
}

/// Means over trials.
fn cells(scores: &[Score]) -> String {
    let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    let (mae_n, covered) = (mean(|s| s.mae_n), mean(|s| s.covered));
    format!("{mae_n:.3} | {:.1}", 100.0 * covered)
}

fn early(scores: &[Score]) -> usize {
    let within = |s: &&Score| s.alarm_s.is_some_and(|t| t <= 60.0);
    scores.iter().filter(within).count()
}

type Set = fn(&mut ChangeConfig);

const CHANGES: [(&str, Set); 13] = [
    ("none", |_| {}),
    ("friction warms up, 3.5 % at power-on", |c| {
        c.warm_up = 0.035
    }),
    ("friction warms up, 7 % at power-on", |c| c.warm_up = 0.07),
    ("friction fell by 6 %", |c| c.friction = -0.06),
    ("friction fell by 12 %", |c| c.friction = -0.12),
    ("friction fell by 24 %", |c| c.friction = -0.24),
    ("amplifiers: gain 3 %, offset 12 mA", |c| {
        c.gain_sd = 0.03;
        c.offset_sd_a = 0.012;
    }),
    ("amplifiers: gain 6 %, offset 24 mA", |c| {
        c.gain_sd = 0.06;
        c.offset_sd_a = 0.024;
    }),
    ("ripple, 20 % of Coulomb", |c| c.ripple = 0.2),
    ("asymmetry, 15 %", |c| c.asymmetry = 0.15),
    ("drag of a tool's cable, 0.1 N·m", |c| c.drag_n_m = 0.1),
    ("drag of a tool's cable, 0.2 N·m", |c| c.drag_n_m = 0.2),
    ("warm-up, amplifiers, ripple and drag at once", |c| {
        *c = ChangeConfig {
            warm_up: 0.07,
            gain_sd: 0.03,
            offset_sd_a: 0.012,
            ripple: 0.2,
            drag_n_m: 0.2,
            ..*c
        };
    }),
];

/// Sizes of a constant force, N.
const HELD_N: [f64; 2] = [1.0, 2.0];

/// In how many minutes a recalibration tells a constant force of this size, along each axis in
/// turn.
fn told(text: &str, seed: u64, size_n: f64) -> usize {
    let path = TrajectoryConfig::default();
    (0..3 * TRIALS)
        .into_par_iter()
        .filter(|n| {
            let session = 11 + (n % TRIALS) as u64;
            let force: [f64; 3] = Vector3::ith(n / TRIALS, size_n).into();
            let none = ChangeConfig::default();
            let [_, held] = trial_on(&path, seed, session, none, [0.0, FREE_S], |_, _| force);
            let mut estimator = Estimator::from_json(text).expect("a model");
            let found = estimator.recalibrate(&[&held]).expect("recalibrated");
            found.force_n.is_some()
        })
        .count()
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let kind = arguments.next().and_then(|name| Kind::of(&name));
    let kind = kind.expect("`physics` or `hybrid`, then seeds");
    let seeds: Vec<u64> = arguments.map(|a| a.parse().expect("a seed")).collect();
    // By change: frozen, and recalibrated.
    let mut scores = vec![[Vec::new(), Vec::new()]; CHANGES.len()];
    let mut unchanged = Vec::new();
    let (mut told_of_none, mut told_of) = (0, [0; HELD_N.len()]);
    let mut least = [[0.0; 2]; 2];
    let mut robots = 0.0;
    for seed in &seeds {
        let none = ChangeConfig::default();
        let training: Vec<Sequence> = (1..7_u64)
            .into_par_iter()
            .map(|session| trial(*seed, session, none, 0.0, 300.0))
            .map(|[_, loaded]| loaded)
            .collect();
        let rows: Vec<&Sequence> = training.iter().collect();
        let text = train(kind, *seed, &rows).to_json().expect("stored");
        eprintln!("robot {seed}: trained");
        let found: Vec<([Score; 2], bool)> = (0..CHANGES.len() * TRIALS)
            .into_par_iter()
            .map(|n| {
                let mut change = ChangeConfig::default();
                CHANGES[n / TRIALS].1(&mut change);
                let session = 11 + (n % TRIALS) as u64;
                let [free, loaded] = trial(*seed, session, change, FREE_S, 180.0);
                let mut estimator = Estimator::from_json(&text).expect("a model");
                let frozen = score(&estimator, &loaded);
                let found = estimator.recalibrate(&[&free]).expect("recalibrated");
                let told = found.force_n.is_some();
                ([frozen, score(&estimator, &loaded)], told)
            })
            .collect();
        let more: Vec<Score> = (21..21 + UNCHANGED)
            .into_par_iter()
            .map(|session| {
                let [_, loaded] = trial(*seed, session, none, 0.0, 180.0);
                score(&Estimator::from_json(&text).expect("a model"), &loaded)
            })
            .collect();
        unchanged.extend(more);
        if kind == Kind::Physics {
            let [_, loaded] = trial(*seed, 11, none, 0.0, 180.0);
            robots += 1.0;
            for (sums, size) in least.iter_mut().zip([0.1, 0.2]) {
                for (sum, least_n) in sums.iter_mut().zip(least_n(&text, &loaded, size)) {
                    *sum += least_n;
                }
            }
        }
        for (count, size_n) in told_of.iter_mut().zip(HELD_N) {
            *count += told(&text, *seed, size_n);
        }
        for (n, (of, told)) in found.into_iter().enumerate() {
            told_of_none += usize::from(told);
            for (all, one) in scores[n / TRIALS].iter_mut().zip(of) {
                all.push(one);
            }
        }
    }
    println!("| change | frozen: MAE, N | covers, % | alarm within 60 s | after a minute: MAE, N | covers, % | alarm |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for ((name, _), [frozen, minute]) in CHANGES.iter().zip(&scores) {
        println!(
            "| {name} | {} | {} of {} | {} | {} of {} |",
            cells(frozen),
            early(frozen),
            frozen.len(),
            cells(minute),
            minute.iter().filter(|s| s.alarm_s.is_some()).count(),
            minute.len()
        );
    }
    let all = || scores.iter().flat_map(|[frozen, _]| frozen);
    let bad: Vec<Score> = all().filter(|s| s.covered < 0.8).copied().collect();
    println!(
        "\nFrozen, covered below 80 %: alarm within 60 s in {} of {} trials; unchanged: an alarm in {} of {} trials of 180 s.",
        early(&bad),
        bad.len(),
        unchanged.iter().filter(|s| s.alarm_s.is_some()).count(),
        unchanged.len()
    );
    let trials = seeds.len() * TRIALS;
    println!(
        "A constant force in the minute is told in {told_of_none} of {} without one.",
        CHANGES.len() * trials
    );
    for (count, size_n) in told_of.iter().zip(HELD_N) {
        println!("One of {size_n} N is told in {count} of {}.", 3 * trials);
    }
    if kind == Kind::Physics {
        for (size, sums) in [0.1, 0.2].iter().zip(least) {
            let [white, slow] = sums.map(|sum| sum / robots);
            println!("Drag of {size} N·m: no estimator with these balances falls below {white:.2} N, with their slow errors {slow:.2} N.");
        }
    }
}

//! What the error depends on: input groups, minutes of data, which minutes.

use super::load::Data;
use estimator::estimator::{Estimator, Kind, Training};
use estimator::metrics::{compare, figures, Figures};
use estimator::model::ModelError;
use estimator::sequence::Sequence;
use serde::{Deserialize, Serialize};

/// Groups of inputs: name and columns of a row.
pub const GROUPS: [(&str, &[usize]); 7] = [
    ("velocities", &[3, 4, 5]),
    ("effort of the shoulder", &[6]),
    ("effort of the elbow", &[7]),
    ("effort of the insertion", &[8]),
    ("all efforts", &[6, 7, 8]),
    ("position of the shoulder", &[0]),
    ("position of the insertion", &[2]),
];
/// Length of a stretch that can be chosen, s.
const STRETCH_S: f64 = 60.0;

/// A figure with what it belongs to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What was changed.
    pub name: String,
    /// Minutes of training.
    pub minutes: f64,
    /// Errors on the test trials.
    pub figures: Figures,
}

/// Trains and tests on these stretches.
///
/// # Errors
/// Too few rows.
pub fn point(
    name: &str,
    settings: &Training,
    training: &[&Sequence],
    test: &[&Sequence],
) -> Result<(Point, Estimator), ModelError> {
    let estimator = Estimator::train(settings, training, &mut |_| {})?;
    let trials = compare(estimator.model(), &estimator.base, &estimator.axes, test);
    let point = Point {
        name: name.to_owned(),
        minutes: Data::minutes(training),
        figures: figures(&trials),
    };
    Ok((point, estimator))
}

/// The same stretches with inputs held at the mean of the training.
fn without(sequences: &[&Sequence], columns: &[usize], mean: &[f32]) -> Vec<Sequence> {
    let hold = |s: &&Sequence| {
        let mut out = (*s).clone();
        for row in out.input.chunks_exact_mut(s.inputs) {
            for c in columns {
                row[*c] = mean[*c];
            }
        }
        out
    };
    sequences.iter().map(hold).collect()
}

/// Error of `settings.kind` without each group of inputs, trained anew.
///
/// # Errors
/// Too few rows.
pub fn ablation(
    settings: &Training,
    training: &[&Sequence],
    test: &[&Sequence],
) -> Result<Vec<Point>, ModelError> {
    let inputs = training.first().map_or(0, |s| s.inputs);
    let rows: usize = training.iter().map(|s| s.rows()).sum();
    let mut mean = vec![0.0_f64; inputs];
    for row in training.iter().flat_map(|s| s.input.chunks_exact(inputs)) {
        for (m, v) in mean.iter_mut().zip(row) {
            *m += f64::from(*v) / rows as f64;
        }
    }
    let mean: Vec<f32> = mean.into_iter().map(|m| m as f32).collect();
    let mut points = Vec::new();
    for (name, columns) in GROUPS {
        let (training, test) = (
            without(training, columns, &mean),
            without(test, columns, &mean),
        );
        let training: Vec<&Sequence> = training.iter().collect();
        let test: Vec<&Sequence> = test.iter().collect();
        points.push(point(name, settings, &training, &test)?.0);
    }
    Ok(points)
}

/// Stretches of a minute.
fn stretches(sequences: &[&Sequence]) -> Vec<Sequence> {
    let mut out = Vec::new();
    for s in sequences {
        let rows = (STRETCH_S / s.step_s).round() as usize;
        for (n, input) in s.input.chunks_exact(rows * s.inputs).enumerate() {
            out.push(Sequence {
                start_s: s.start_s + (n * rows) as f64 * s.step_s,
                input: input.to_vec(),
                target: s.target[n * rows * s.targets..(n + 1) * rows * s.targets].to_vec(),
                ..(*s).clone()
            });
        }
    }
    out
}

/// Order of `count` things by a seed.
fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let mut random = robot::random::Random::stream(seed, "minutes", 0);
    let mut order: Vec<usize> = (0..count).collect();
    for i in (1..count).rev() {
        let other = (random.unit() * (i + 1) as f64) as usize;
        order.swap(i, other.min(i));
    }
    order
}

/// Error against minutes of training, drawn at random.
///
/// # Errors
/// Too few rows.
pub fn learning_curve(
    settings: &Training,
    training: &[&Sequence],
    test: &[&Sequence],
    minutes: &[usize],
    seed: u64,
) -> Result<Vec<Point>, ModelError> {
    let pool = stretches(training);
    let order = shuffled(pool.len(), seed);
    let mut points = Vec::new();
    for count in minutes.iter().filter(|m| **m <= pool.len()) {
        let chosen: Vec<&Sequence> = order[..*count].iter().map(|i| &pool[*i]).collect();
        points.push(point("random", settings, &chosen, test)?.0);
    }
    Ok(points)
}

/// Chooses minutes by predicted error: begins with `first` random ones, then takes, `step` at a time, those whose predicted
/// interval is the widest. The prediction needs no label: it could be made of a trajectory that is only planned and run without
/// cables.
///
/// # Errors
/// Too few rows.
pub fn chosen(
    settings: &Training,
    training: &[&Sequence],
    test: &[&Sequence],
    counts: [usize; 3],
    seed: u64,
) -> Result<Point, ModelError> {
    let [first, step, last] = counts;
    let pool = stretches(training);
    let mut order = shuffled(pool.len(), seed);
    let mut taken: Vec<usize> = order.drain(..first.min(order.len())).collect();
    // The physical model is enough to say where the error is large, and quick.
    let scout = Training {
        kind: Kind::Physics,
        intervals: true,
        ..settings.clone()
    };
    while taken.len() < last && !order.is_empty() {
        let rows: Vec<&Sequence> = taken.iter().map(|i| &pool[*i]).collect();
        let estimator = Estimator::train(&scout, &rows, &mut |_| {})?;
        let Some(interval) = &estimator.interval else {
            break;
        };
        let width = |i: &usize| {
            let widths = interval.widths(&pool[*i]);
            widths.iter().sum::<f64>() / widths.len().max(1) as f64
        };
        let mut widths: Vec<(f64, usize)> = order.iter().map(|i| (width(i), *i)).collect();
        widths.sort_by(|a, b| b.0.total_cmp(&a.0));
        let more: Vec<usize> = widths
            .iter()
            .take(step.min(last - taken.len()))
            .map(|(_, i)| *i)
            .collect();
        order.retain(|i| !more.contains(i));
        taken.extend(more);
    }
    let rows: Vec<&Sequence> = taken.iter().map(|i| &pool[*i]).collect();
    Ok(point("chosen by predicted error", settings, &rows, test)?.0)
}

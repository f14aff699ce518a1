//! What the error depends on: input groups, minutes of data, which minutes.

use super::load::Data;
use estimator::estimator::{Estimator, Kind, Training};
use estimator::metrics::{by_trial, compare, figures, paired, Difference, Figures};
use estimator::model::ModelError;
use estimator::sequence::Sequence;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Groups of inputs: name and columns of a row.
pub const GROUPS: [(&str, &[usize]); 9] = [
    ("velocities", &[3, 4, 5]),
    ("effort of the shoulder", &[6]),
    ("effort of the elbow", &[7]),
    ("effort of the insertion", &[8]),
    ("all efforts", &[6, 7, 8]),
    ("position of the shoulder", &[0]),
    ("position of the elbow", &[1]),
    ("position of the insertion", &[2]),
    ("all positions", &[0, 1, 2]),
];
/// Name of the row with all inputs.
pub const WHOLE: &str = "nothing";
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
    /// Mean absolute error of each test trial, N.
    pub by_trial: Vec<f64>,
    /// Error less that of what it is compared with.
    pub difference: Option<Difference>,
}

impl Point {
    /// Compares with a reference, trial by trial.
    fn against(mut self, reference: &[f64]) -> Self {
        self.difference = paired(&self.by_trial, reference);
        self
    }
}

/// What a study needs.
pub struct Study<'a> {
    /// Model.
    pub settings: &'a Training,
    /// Stretches for training.
    pub training: &'a [&'a Sequence],
    /// Stretches for testing.
    pub test: &'a [&'a Sequence],
    /// Told of each figure.
    pub say: &'a mut dyn FnMut(&str),
}

impl Study<'_> {
    /// Trains and tests.
    ///
    /// # Errors
    /// Too few rows.
    fn point(
        &mut self,
        name: &str,
        training: &[&Sequence],
        test: &[&Sequence],
    ) -> Result<Point, ModelError> {
        let estimator = Estimator::train(self.settings, training, &mut |_| {})
            .map_err(|error| ModelError::Data(format!("{name}: {error}")))?;
        let trials = compare(estimator.model(), &estimator.base, &estimator.axes, test);
        let point = Point {
            name: name.to_owned(),
            minutes: Data::minutes(training),
            figures: figures(&trials),
            by_trial: by_trial(&trials),
            difference: None,
        };
        (self.say)(&format!(
            "  `{}`, {name}, {:.0} min: MAE {:.3} N",
            self.settings.kind.name(),
            point.minutes,
            point.figures.mae_n
        ));
        Ok(point)
    }

    /// Error without each group of inputs, trained anew, and less the error with all. `minutes`: of
    /// training at most, from the beginnings of the trials.
    ///
    /// # Errors
    /// Too few rows.
    pub fn ablation(&mut self, minutes: Option<f64>) -> Result<Vec<Point>, ModelError> {
        let beginnings = beginnings(self.training, minutes);
        let training: Vec<&Sequence> = beginnings.iter().collect();
        let whole = self.point(WHOLE, &training, self.test)?;
        let reference = whole.by_trial.clone();
        let mean = means(&training);
        let mut points = vec![whole];
        for (name, columns) in GROUPS {
            let held = without(&training, columns, &mean);
            let test = without(self.test, columns, &mean);
            let point = self.point(
                name,
                &held.iter().collect::<Vec<_>>(),
                &test.iter().collect::<Vec<_>>(),
            )?;
            points.push(point.against(&reference));
        }
        Ok(points)
    }

    /// Error against minutes of training, drawn at random.
    ///
    /// # Errors
    /// Too few rows.
    pub fn learning_curve(
        &mut self,
        minutes: &[usize],
        seed: u64,
    ) -> Result<Vec<Point>, ModelError> {
        let pool = stretches(self.training);
        let order = shuffled(pool.len(), seed);
        let mut points = Vec::new();
        for count in minutes.iter().filter(|m| **m <= pool.len()) {
            let drawn: Vec<&Sequence> = order[..*count].iter().map(|i| &pool[*i]).collect();
            points.push(self.point("random", &drawn, self.test)?);
        }
        Ok(points)
    }

    /// Chosen minutes against random ones: as many, and `more`. Differences are to the mean of the
    /// draws of `more`.
    ///
    /// # Errors
    /// Too few rows.
    pub fn choice(&mut self, choice: &Choice, seed: u64) -> Result<Vec<Point>, ModelError> {
        let pool = stretches(self.training);
        if pool.len() <= choice.last {
            (self.say)(&format!(
                "  {} min are too few to choose {} from",
                pool.len(),
                choice.last
            ));
            return Ok(Vec::new());
        }
        let more = choice.more.min(pool.len());
        let mut drawn = Vec::new();
        for (count, draws) in [(choice.last, choice.draws), (more, choice.draws)] {
            for draw in 0..draws {
                let order = shuffled(pool.len(), seed + draw);
                let rows: Vec<&Sequence> = order.iter().take(count).map(|i| &pool[*i]).collect();
                let name = format!("random, draw {}", draw + 1);
                drawn.push((count, self.point(&name, &rows, self.test)?));
            }
        }
        let taken = chosen(self.settings, &pool, choice, seed)?;
        let rows: Vec<&Sequence> = taken.iter().map(|i| &pool[*i]).collect();
        let mut points = vec![self.point(CHOSEN, &rows, self.test)?];
        let many: Vec<&Point> = (drawn.iter())
            .filter(|(count, _)| *count == more)
            .map(|(_, point)| point)
            .collect();
        let trials = points[0].by_trial.len();
        let reference: Vec<f64> = (0..trials)
            .map(|t| many.iter().map(|p| p.by_trial[t]).sum::<f64>() / many.len().max(1) as f64)
            .collect();
        points.extend(drawn.into_iter().map(|(_, point)| point));
        Ok(points
            .into_iter()
            .map(|point| point.against(&reference))
            .collect())
    }
}

/// Name of the row of the chosen minutes.
pub const CHOSEN: &str = "chosen by predicted error";
/// The error of chosen minutes may be so much above that of more random ones and still match it, N.
/// It was set before any figure of the comparison was known.
pub const CHOICE_MARGIN_N: f64 = 0.005;

/// How minutes are chosen, and what they are compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// Random minutes at the beginning.
    pub first: usize,
    /// Minutes that are added at a time.
    pub step: usize,
    /// Minutes at the end.
    pub last: usize,
    /// Random minutes to compare with.
    pub more: usize,
    /// Random draws of each size.
    pub draws: u64,
}

/// Chooses minutes by predicted error: begins with random ones, then takes those whose predicted
/// interval is the widest. The prediction needs no label: it could be made of a trajectory that is
/// only planned and run without cables.
fn chosen(
    settings: &Training,
    pool: &[Sequence],
    choice: &Choice,
    seed: u64,
) -> Result<Vec<usize>, ModelError> {
    let mut order = shuffled(pool.len(), seed);
    let mut taken: Vec<usize> = order.drain(..choice.first.min(order.len())).collect();
    // The physical model is enough to say where the error is large, and quick.
    let scout = Training {
        kind: Kind::Physics,
        intervals: true,
        ..settings.clone()
    };
    while taken.len() < choice.last && !order.is_empty() {
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
            .take(choice.step.min(choice.last - taken.len()))
            .map(|(_, i)| *i)
            .collect();
        order.retain(|i| !more.contains(i));
        taken.extend(more);
    }
    Ok(taken)
}

/// Mean of each input.
fn means(sequences: &[&Sequence]) -> Vec<f32> {
    let inputs = sequences.first().map_or(0, |s| s.inputs);
    let rows: usize = sequences.iter().map(|s| s.rows()).sum();
    let mut mean = vec![0.0_f64; inputs];
    for row in sequences
        .iter()
        .flat_map(|s| s.input.chunks_exact(inputs.max(1)))
    {
        for (m, v) in mean.iter_mut().zip(row) {
            *m += f64::from(*v) / rows as f64;
        }
    }
    mean.into_iter().map(|m| m as f32).collect()
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

/// A part of a stretch.
fn part(s: &Sequence, from: usize, rows: usize) -> Sequence {
    Sequence {
        start_s: s.start_s + from as f64 * s.step_s,
        input: s.input[from * s.inputs..(from + rows) * s.inputs].to_vec(),
        target: s.target[from * s.targets..(from + rows) * s.targets].to_vec(),
        ..*s
    }
}

/// The longest stretch of each trial in rows of `minutes` of training in all, s. `None`: no limit.
#[must_use]
pub fn longest_beginnings_s(sequences: &[&Sequence], minutes: Option<f64>) -> BTreeMap<usize, f64> {
    let mut longest: BTreeMap<usize, f64> = BTreeMap::new();
    let share = share(sequences, minutes);
    for s in sequences {
        let seconds = (s.rows() as f64 * share).round() * s.step_s;
        let most = longest.entry(s.trial).or_default();
        *most = most.max(seconds);
    }
    longest
}

fn share(sequences: &[&Sequence], minutes: Option<f64>) -> f64 {
    minutes.map_or(1.0, |m| (m / Data::minutes(sequences).max(1e-9)).min(1.0))
}

/// The beginnings of the stretches, `minutes` in all, each with its share; all of them where there
/// is no limit.
fn beginnings(sequences: &[&Sequence], minutes: Option<f64>) -> Vec<Sequence> {
    let share = share(sequences, minutes);
    sequences
        .iter()
        .map(|s| part(s, 0, (s.rows() as f64 * share).round() as usize))
        .collect()
}

/// Stretches of a minute.
fn stretches(sequences: &[&Sequence]) -> Vec<Sequence> {
    let mut out = Vec::new();
    for s in sequences {
        let rows = (STRETCH_S / s.step_s).round() as usize;
        out.extend((0..s.rows() / rows).map(|n| part(s, n * rows, rows)));
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

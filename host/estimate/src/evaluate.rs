//! Figures of a model on trials that it has not seen.

use estimator::estimator::Estimator;
use estimator::interval::error_n;
use estimator::metrics::{
    self, by_bin, compare, speed_bin, speed_edges, Figures, Rows, StepTime, SPEED_BINS,
};
use estimator::model::ModelError;
use estimator::sequence::Sequence;
use estimator::stream::{self, Before, Breaks, Stream};
use robot::random::Random;
use serde::{Deserialize, Serialize};

/// Rows of one trial on which the time of a step is measured.
const TIMED_ROWS: usize = 20_000;

/// One bin of speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpeedBin {
    /// Speeds of the tip below this, m/s; the last bin is open.
    pub below_m_per_s: f64,
    /// Mean absolute error, N; `None` without rows.
    pub mae_n: Option<f64>,
    /// Rows.
    pub rows: usize,
    /// Share of the rows within the interval, where there is one.
    pub covered: Option<f64>,
    /// Mean half width of the interval, N.
    pub half_width_n: Option<f64>,
}

/// Figures of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Trials.
    pub trials: Vec<usize>,
    /// Errors.
    pub figures: Figures,
    /// By speed of the tip.
    pub by_speed: Vec<SpeedBin>,
    /// Mean absolute error of each component, N. Cards of before have none.
    #[serde(default)]
    pub mae_by_component_n: Vec<f64>,
    /// Mean absolute error while a motor turns round, N; `None` without such rows.
    pub mae_reversing_n: Option<f64>,
    /// Mean absolute error otherwise, N; `None` without such rows.
    pub mae_sliding_n: Option<f64>,
    /// Share of the rows within the interval, where there is one.
    pub covered: Option<f64>,
    /// The same for each trial.
    pub covered_by_trial: Vec<f64>,
    /// Time of a step on the machine that wrote this.
    pub step: StepTime,
    /// What a user receives, row by row. Cards of before have none.
    #[serde(default)]
    pub stream: Option<Streamed>,
}

/// A replay row by row, with what comes after starts and gaps.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Streamed {
    /// Starts, that of each log among them.
    pub starts: usize,
    /// Gaps.
    pub gaps: usize,
    /// Rows, valid or not.
    pub all: Emitted,
    /// Rows that are valid: what is published.
    pub valid: Emitted,
    /// Valid rows of the first second after a start or a gap.
    pub early: Emitted,
    /// Share of the time that has a valid estimate: rows that are missing in a gap count as time
    /// without one.
    pub valid_share: f64,
    /// Time from a start or a gap to the first valid row: median and 95 % point over those that
    /// were followed by one, s.
    pub until_valid_s: Option<[f64; 2]>,
    /// Starts and gaps that the next break came after before any row was valid.
    pub never_valid: usize,
    /// By trial: time of its rows until the model was found not to fit the robot, s; `None` where
    /// it fits to the end.
    #[serde(default)]
    pub misfits_s: Vec<Option<f64>>,
}

/// Rows of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Emitted {
    /// Rows.
    pub rows: usize,
    /// Mean absolute error, N; `None` without rows.
    pub mae_n: Option<f64>,
    /// Share within the interval; `None` without rows or intervals.
    pub covered: Option<f64>,
    /// Mean half width, N.
    pub half_width_n: Option<f64>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    rows: usize,
    error_n: f64,
    covered: usize,
    half_n: f64,
}

impl Sum {
    fn add(&mut self, error_n: f64, half_n: Option<f64>) {
        self.rows += 1;
        self.error_n += error_n;
        if let Some(half_n) = half_n {
            self.half_n += half_n;
            self.covered += usize::from(error_n <= half_n);
        }
    }

    fn emitted(self, intervals: bool) -> Emitted {
        let per_row = |sum: f64| (self.rows > 0).then(|| sum / self.rows as f64);
        Emitted {
            rows: self.rows,
            mae_n: per_row(self.error_n),
            covered: per_row(self.covered as f64).filter(|_| intervals),
            half_width_n: per_row(self.half_n).filter(|_| intervals),
        }
    }
}

/// What a replay has beside its trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Replay {
    /// More starts in each trial.
    pub starts: usize,
    /// Gaps in each trial.
    pub gaps: usize,
    /// Seed of their places.
    pub seed: u64,
}

/// How much of the longest stretch of each training trial is looked at for its error, s: a column
/// that is wrong is wrong from the start, and a network of a window has to go over it for every
/// row. The first 10 s of a stretch do not count.
const LOOKED_AT_S: f64 = 90.0;

/// Says which few training trials have an error far above that of the others: a column of theirs
/// may be reversed, scaled, or that of something else.
#[must_use]
pub fn unlike_trials(estimator: &Estimator, training: &[&Sequence]) -> Option<String> {
    let of_one_trial = training.chunk_by(|a, b| a.trial == b.trial);
    let longest = of_one_trial.filter_map(|own| own.iter().max_by_key(|s| s.rows()));
    let beginnings: Vec<Sequence> = longest.map(|s| s.beginning(LOOKED_AT_S)).collect();
    let trials = compare(
        estimator.model(),
        &estimator.base,
        &estimator.axes,
        &beginnings.iter().collect::<Vec<_>>(),
    );
    let errors = metrics::by_trial(&trials);
    let (unlike, of_others) = residual::few_unlike(&errors)?;
    let each = unlike
        .iter()
        .map(|i| format!("trial {}: {:.3} N", trials[*i].trial, errors[*i]));
    Some(format!(
        "few training trials are unlike the others, whose mean absolute error has the median {of_others:.3} N: {}. Check the columns, signs \
         and units of their logs, and whether something else touched the robot; train again without what is wrong",
        each.collect::<Vec<_>>().join(", ")
    ))
}

/// Replays each trial row by row, and counts every row.
fn streamed(
    estimator: &Estimator,
    sequences: &[&Sequence],
    replay: &Replay,
    go_on: &dyn Fn(),
) -> Streamed {
    let mut stream = Stream::new(estimator);
    let (mut all, mut valid, mut early) = (Sum::default(), Sum::default(), Sum::default());
    let mut out = Streamed::default();
    let (mut times_s, mut missing_s) = (Vec::new(), 0.0);
    // Time since the last start or gap, until a row is valid.
    let mut waiting: Option<f64> = None;
    let mut age_s = 0.0;
    let mut last: Option<&Sequence> = None;
    for sequence in sequences {
        let step_s = sequence.step_s;
        if last.is_none_or(|last| last.trial != sequence.trial) {
            out.misfits_s.push(None);
        }
        // A trial of several stretches shares its breaks.
        let of_trial = |s: &&&Sequence| s.trial == sequence.trial;
        let trial_rows: usize = sequences.iter().filter(of_trial).map(|s| s.rows()).sum();
        let share = |count: usize| {
            (count as f64 * sequence.rows() as f64 / trial_rows.max(1) as f64).round() as usize
        };
        let mut random = Random::stream(replay.seed, "breaks of a replay", sequence.trial as u64);
        let breaks = Breaks::drawn(
            sequence.rows(),
            step_s,
            share(replay.starts),
            share(replay.gaps),
            &mut random,
        );
        let first = stream::between(last.replace(sequence), sequence);
        stream::replay(
            &mut stream,
            sequence,
            &breaks,
            first,
            |k, before, force, sure| {
                go_on();
                if before != Before::Row {
                    out.never_valid += usize::from(waiting.is_some());
                    waiting = Some(0.0);
                    age_s = 0.0;
                }
                match before {
                    Before::Row => {}
                    Before::Start => out.starts += 1,
                    Before::Gap(elapsed_s) => {
                        out.gaps += 1;
                        missing_s += elapsed_s - step_s;
                    }
                }
                if sure.misfits {
                    if let Some(misfit) = out.misfits_s.last_mut() {
                        misfit.get_or_insert(sequence.start_s + k as f64 * step_s);
                    }
                }
                let error_n = error_n(force, sequence.target_row(k), &estimator.axes);
                all.add(error_n, sure.half_n);
                if sure.usable() {
                    valid.add(error_n, sure.half_n);
                    if age_s < EARLY_S {
                        early.add(error_n, sure.half_n);
                    }
                    times_s.extend(waiting.take());
                } else if let Some(waited_s) = &mut waiting {
                    *waited_s += step_s;
                }
                age_s += step_s;
            },
        );
    }
    out.never_valid += usize::from(waiting.is_some());
    let intervals = estimator.interval.is_some();
    out.all = all.emitted(intervals);
    out.valid = valid.emitted(intervals);
    out.early = early.emitted(intervals);
    let step_s = sequences.first().map_or(0.0, |s| s.step_s);
    let time_s = all.rows as f64 * step_s + missing_s;
    out.valid_share = if time_s > 0.0 {
        valid.rows as f64 * step_s / time_s
    } else {
        0.0
    };
    times_s.sort_by(f64::total_cmp);
    let at = |share: f64| {
        times_s
            .get((times_s.len() as f64 * share) as usize)
            .copied()
    };
    out.until_valid_s = at(0.5).zip(at(0.95)).map(|(half, most)| [half, most]);
    out
}

/// Time after a start or a gap of [`Streamed::early`], s.
const EARLY_S: f64 = 1.0;

/// Whether a row is left to test on: to be asked before a training.
///
/// # Errors
/// [`ModelError::Data`]: no sequence is longer than what [`evaluate`] leaves out.
pub fn testable(sequences: &[&Sequence]) -> Result<(), ModelError> {
    let longer = |s: &&Sequence| s.rows() > estimator::physics::settle_rows(s.step_s);
    if sequences.iter().any(longer) {
        return Ok(());
    }
    Err(ModelError::Data(format!(
        "no row is left to test on: the first {} s of each unbroken stretch are left out, because no model with a memory knows its state there; give longer stretches",
        estimator::physics::SETTLE_S
    )))
}

/// Evaluates on sequences. The first 10 s of each are left out, but of [`Evaluation::stream`].
///
/// # Errors
/// [`ModelError::Data`]: no sequence is longer than that.
pub fn evaluate(
    estimator: &Estimator,
    sequences: &[&Sequence],
    replay: &Replay,
) -> Result<(Evaluation, Vec<Rows>), ModelError> {
    evaluate_while(estimator, sequences, replay, &|| {})
}

/// The same for a caller that may want to end it: `go_on` is called before each trial and at each
/// replayed row, and unwinds where the work is to end.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_while(
    estimator: &Estimator,
    sequences: &[&Sequence],
    replay: &Replay,
    go_on: &dyn Fn(),
) -> Result<(Evaluation, Vec<Rows>), ModelError> {
    testable(sequences)?;
    let by_trial = sequences.chunk_by(|a, b| a.trial == b.trial);
    let trials: Vec<Rows> = by_trial
        .flat_map(|trial| {
            go_on();
            compare(estimator.model(), &estimator.base, &estimator.axes, trial)
        })
        .collect();
    let Some(longest) = sequences.iter().max_by_key(|s| s.rows()) else {
        return Err(ModelError::Data("there is no trial to test on".to_owned()));
    };
    let widths = estimator
        .interval
        .as_ref()
        .map(|interval| widths(interval, sequences));
    let edges = speed_edges(&trials);
    let bin = |rows: &Rows, k: usize| speed_bin(&edges, rows.speed[k]);
    let errors = by_bin(&trials, SPEED_BINS, bin);
    let within = |t: usize, k: usize| {
        widths
            .as_ref()
            .is_some_and(|w| trials[t].error[k].abs() <= w[t][k])
    };
    let mut inside = [(0_usize, 0.0_f64); SPEED_BINS];
    let mut covered_by_trial = Vec::new();
    for (t, rows) in trials.iter().enumerate() {
        let mut covered = 0_usize;
        for k in 0..rows.error.len() {
            let (count, width) = &mut inside[bin(rows, k)];
            if within(t, k) {
                *count += 1;
                covered += 1;
            }
            *width += widths.as_ref().map_or(0.0, |w| w[t][k]);
        }
        covered_by_trial.push(covered as f64 / rows.error.len().max(1) as f64);
    }
    let figures = metrics::figures(&trials);
    let by_speed =
        errors
            .iter()
            .zip(edges)
            .zip(inside)
            .map(|(((mae_n, rows), edge), (covered, width))| SpeedBin {
                below_m_per_s: edge,
                mae_n: mean_of((*mae_n, *rows)),
                rows: *rows,
                covered: (widths.is_some() && *rows > 0).then(|| covered as f64 / *rows as f64),
                half_width_n: (widths.is_some() && *rows > 0).then(|| width / *rows as f64),
            });
    let reversal = by_bin(&trials, 2, |rows, k| usize::from(rows.reversing[k]));
    let step = metrics::step_time(estimator.model(), longest, estimator.axes.len(), TIMED_ROWS);
    let evaluation = Evaluation {
        trials: trials.iter().map(|t| t.trial).collect(),
        by_speed: by_speed.collect(),
        mae_by_component_n: metrics::by_component(&trials),
        mae_reversing_n: mean_of(reversal[1]),
        mae_sliding_n: mean_of(reversal[0]),
        covered: widths.as_ref().map(|_| {
            inside.iter().map(|(n, _)| n).sum::<usize>() as f64 / figures.rows.max(1) as f64
        }),
        covered_by_trial: if widths.is_some() {
            covered_by_trial
        } else {
            Vec::new()
        },
        figures,
        step,
        stream: Some(streamed(estimator, sequences, replay, go_on)),
    };
    Ok((evaluation, trials))
}

/// The mean over rows, where there are any.
fn mean_of((mean_n, rows): (f64, usize)) -> Option<f64> {
    (rows > 0).then_some(mean_n)
}

/// Half widths of the rows that [`compare`] keeps, by trial.
fn widths(interval: &estimator::interval::Interval, sequences: &[&Sequence]) -> Vec<Vec<f64>> {
    let mut out: Vec<(usize, Vec<f64>)> = Vec::new();
    for sequence in sequences {
        let settle = estimator::physics::settle_rows(sequence.step_s).min(sequence.rows());
        let kept = interval.widths(sequence).split_off(settle);
        match out.last_mut() {
            Some((trial, all)) if *trial == sequence.trial => all.extend(kept),
            _ => out.push((sequence.trial, kept)),
        }
    }
    out.into_iter()
        .map(|(_, widths)| widths)
        .filter(|widths| !widths.is_empty())
        .collect()
}

//! How good estimates are: errors with intervals over trials, by speed, near reversals, and what a
//! step costs.

use crate::geometry::Base;
use crate::model::{Model, Stepper};
use crate::motion::{Motion, LEVELS};
use crate::physics::settle_rows;
use crate::sequence::Sequence;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Bins of speed.
pub const SPEED_BINS: usize = 6;

/// Estimate against truth of one trial's rows.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// Trial.
    pub trial: usize,
    /// Error of each row: the length of the error vector, or the error along the axis with its
    /// sign, N.
    pub error: Vec<f64>,
    /// Estimate, the first component, N.
    pub estimate: Vec<f64>,
    /// Label, the first component, N.
    pub label: Vec<f64>,
    /// Sum of the absolute errors of each component, N.
    pub component_n: Vec<f64>,
    /// Smallest and largest label over all components, N.
    pub range: Option<[f64; 2]>,
    /// Speed of the tip, m/s.
    pub speed: Vec<f64>,
    /// Whether a motor or a link is bent back: a reversal is not yet run through.
    pub reversing: Vec<bool>,
    /// Joints, rad, rad, m.
    pub joints: Vec<[f64; 3]>,
    /// Joint velocities, per second.
    pub rates: Vec<[f64; 3]>,
    /// Tip in frame 0, m.
    pub tips: Vec<[f64; 3]>,
}

/// Figures over rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Mean absolute error, N.
    pub mae_n: f64,
    /// Half width of the 95 % interval of the mean over trials, N. `None` with one trial.
    pub mae_half_n: Option<f64>,
    /// Root mean square error, N.
    pub rmse_n: f64,
    /// RMSE per range of the label: from the smallest to the largest value of any component. `None`
    /// where the label has no range.
    pub nrmse: Option<f64>,
    /// Rows.
    pub rows: usize,
    /// Trials.
    pub trials: usize,
}

/// Two-sided 95 % points of Student's t for 1 to 10 degrees of freedom.
const T95: [f64; 10] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
];

/// Half width of the 95 % interval of a mean: the trials are the independent draws, not the rows.
#[must_use]
pub fn half_width(values: &[f64]) -> Option<f64> {
    let n = values.len();
    if n < 2 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
    let t = T95.get(n - 2).copied().unwrap_or(1.96);
    Some(t * (variance / n as f64).sqrt())
}

/// A difference of two models' mean absolute errors, paired over trials.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// Mean over trials, N.
    pub mean_n: f64,
    /// Half width of its 95 % interval, N. `None` with one trial.
    pub half_n: Option<f64>,
}

/// Mean absolute error of each trial, N.
#[must_use]
pub fn by_trial(trials: &[Rows]) -> Vec<f64> {
    let mean = |rows: &Rows| {
        rows.error.iter().map(|e| e.abs()).sum::<f64>() / rows.error.len().max(1) as f64
    };
    trials.iter().map(mean).collect()
}

/// `a` less `b`, both by trial and of the same trials. What is hard for both models in a trial
/// cancels. `None` without trials, or with other numbers of trials.
#[must_use]
pub fn paired(a: &[f64], b: &[f64]) -> Option<Difference> {
    if a.is_empty() || a.len() != b.len() {
        return None;
    }
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    Some(Difference {
        mean_n: differences.iter().sum::<f64>() / differences.len() as f64,
        half_n: half_width(&differences),
    })
}

/// Predicts sequences and compares. The first 10 s of a sequence are left out: no model with a
/// memory knows its state there. A trial of which nothing is left is not listed.
#[must_use]
pub fn compare(
    model: &dyn Model,
    base: &Base,
    axes: &[usize],
    sequences: &[&Sequence],
) -> Vec<Rows> {
    let mut trials: Vec<Rows> = Vec::new();
    for sequence in sequences {
        let predicted = model.predict(sequence);
        if trials
            .last()
            .is_none_or(|rows| rows.trial != sequence.trial)
        {
            trials.push(Rows {
                trial: sequence.trial,
                ..Rows::default()
            });
        }
        if let Some(rows) = trials.last_mut() {
            add(rows, sequence, &predicted, base, axes);
        }
    }
    trials.retain(|rows| !rows.error.is_empty());
    trials
}

fn add(rows: &mut Rows, sequence: &Sequence, predicted: &[f32], base: &Base, axes: &[usize]) {
    let mut motion = Motion::new(sequence.step_s);
    let settle = settle_rows(sequence.step_s);
    for k in 0..sequence.rows() {
        let moment = *motion.step(sequence.input_row(k));
        if k < settle {
            continue;
        }
        let label = sequence.target_row(k);
        let error = |a: usize| f64::from(predicted[k * axes.len() + a]) - f64::from(label[axes[a]]);
        rows.component_n.resize(axes.len(), 0.0);
        for (a, sum) in rows.component_n.iter_mut().enumerate() {
            *sum += error(a).abs();
        }
        rows.error.push(if axes.len() == 1 {
            error(0)
        } else {
            (0..axes.len())
                .map(|a| error(a).powi(2))
                .sum::<f64>()
                .sqrt()
        });
        rows.estimate.push(f64::from(predicted[k * axes.len()]));
        rows.label.push(f64::from(label[axes[0]]));
        for axis in axes {
            let value = f64::from(label[*axis]);
            let [low, high] = rows.range.unwrap_or([value; 2]);
            rows.range = Some([low.min(value), high.max(value)]);
        }
        let tip = base.jacobian(moment.joints) * nalgebra::Vector3::from(moment.joint_rate);
        rows.speed.push(tip.norm());
        rows.reversing
            .push((0..3).any(|i| moment.motor_stop(i, LEVELS - 1).abs() < 0.99));
        rows.joints.push(moment.joints);
        rows.rates.push(moment.joint_rate);
        rows.tips
            .push(crate::geometry::tip_in_0(moment.joints).into());
    }
}

/// Figures over all rows of all trials.
#[must_use]
pub fn figures(trials: &[Rows]) -> Figures {
    let all = || trials.iter().flat_map(|t| &t.error);
    let n = all().count().max(1) as f64;
    let rmse_n = (all().map(|e| e * e).sum::<f64>() / n).sqrt();
    let ends = || trials.iter().filter_map(|t| t.range);
    let range = ends().fold(f64::NEG_INFINITY, |a, [_, high]| a.max(high))
        - ends().fold(f64::INFINITY, |a, [low, _]| a.min(low));
    Figures {
        mae_n: all().map(|e| e.abs()).sum::<f64>() / n,
        mae_half_n: half_width(&by_trial(trials)),
        rmse_n,
        nrmse: (range > 0.0).then(|| rmse_n / range),
        rows: all().count(),
        trials: trials.len(),
    }
}

/// Mean absolute error of each component, N.
#[must_use]
pub fn by_component(trials: &[Rows]) -> Vec<f64> {
    let components = trials.first().map_or(0, |t| t.component_n.len());
    let rows: usize = trials.iter().map(|t| t.error.len()).sum();
    let sum = |a: usize| trials.iter().map(|t| t.component_n[a]).sum::<f64>();
    (0..components)
        .map(|a| sum(a) / rows.max(1) as f64)
        .collect()
}

/// Upper ends of six bins of equal width from 0 to the speed that 99.5 % of the rows stay below
/// (the last bin is open), m/s.
#[must_use]
pub fn speed_edges(trials: &[Rows]) -> [f64; SPEED_BINS] {
    let mut speeds: Vec<f64> = trials
        .iter()
        .flat_map(|t| t.speed.iter().copied())
        .collect();
    speeds.sort_by(f64::total_cmp);
    let top = speeds
        .get(
            speeds
                .len()
                .saturating_sub(1)
                .min(speeds.len() * 995 / 1000),
        )
        .copied()
        .unwrap_or(1.0);
    core::array::from_fn(|i| top * (i + 1) as f64 / SPEED_BINS as f64)
}

/// Bin of a speed.
#[must_use]
pub fn speed_bin(edges: &[f64; SPEED_BINS], speed: f64) -> usize {
    edges
        .iter()
        .position(|edge| speed < *edge)
        .unwrap_or(SPEED_BINS - 1)
}

/// Mean absolute error by something that puts rows into bins: error in N and rows.
#[must_use]
pub fn by_bin(
    trials: &[Rows],
    bins: usize,
    bin: impl Fn(&Rows, usize) -> usize,
) -> Vec<(f64, usize)> {
    let mut sums = vec![(0.0, 0); bins];
    for trial in trials {
        for (k, error) in trial.error.iter().enumerate() {
            let (sum, rows) = &mut sums[bin(trial, k)];
            *sum += error.abs();
            *rows += 1;
        }
    }
    sums.into_iter()
        .map(|(sum, rows)| (sum / rows.max(1) as f64, rows))
        .collect()
}

/// Time of a step with one row, us.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepTime {
    /// Median.
    pub median_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
}

/// Measures steps on up to `rows` rows.
#[must_use]
pub fn step_time(model: &dyn Model, sequence: &Sequence, targets: usize, rows: usize) -> StepTime {
    let mut stepper: Box<dyn Stepper + '_> = model.stepper();
    let mut force = vec![0.0; targets];
    let mut times: Vec<f64> = (0..sequence.rows().min(rows))
        .map(|k| {
            let began = Instant::now();
            stepper.step(sequence.input_row(k), &mut force);
            began.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let at = |share: f64| {
        times
            .get(((times.len() as f64 * share) as usize).min(times.len().saturating_sub(1)))
            .copied()
            .unwrap_or(f64::NAN)
    };
    StepTime {
        median_us: at(0.5),
        p99_us: at(0.99),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No force, for rows of any inputs.
    struct Nothing;

    impl Model for Nothing {
        fn predict(&self, sequence: &Sequence) -> Vec<f32> {
            vec![0.0; sequence.rows() * 3]
        }

        fn parameters(&self) -> usize {
            0
        }

        fn stepper(&self) -> Box<dyn Stepper + '_> {
            unreachable!("whole sequences alone")
        }
    }

    #[test]
    fn a_relative_error_is_of_the_range_over_all_components() {
        let rows = 600;
        let sequence = Sequence {
            trial: 1,
            start_s: 0.0,
            step_s: 0.02,
            input: (0..rows)
                .flat_map(|_| [0.5, 1.2, 0.4, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1])
                .collect(),
            inputs: 9,
            // The first component is the smallest by far.
            target: (0..rows)
                .flat_map(|k| {
                    let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                    [0.01 * sign, 3.0 * sign, 0.0]
                })
                .collect(),
            targets: 3,
        };
        let trials = compare(&Nothing, &Base::default(), &[0, 1, 2], &[&sequence]);
        let f = figures(&trials);
        let components = by_component(&trials);
        for (got, expected) in components.iter().zip([0.01, 3.0, 0.0]) {
            assert!((got - expected).abs() < 1e-6, "{components:?}");
        }
        assert!((f.rmse_n - 3.0).abs() < 1e-3, "{f:?}");
        assert!((f.nrmse.unwrap() - 0.5).abs() < 1e-3, "{f:?}");
    }

    #[test]
    fn the_interval_is_over_trials() {
        // Two trials of means 1 and 3: sd 1.414, t 12.706.
        let half = half_width(&[1.0, 3.0]).unwrap();
        assert!((half - 12.706).abs() < 1e-9, "{half}");
        assert_eq!(half_width(&[1.0]), None);
    }

    #[test]
    fn differences_are_paired_over_trials() {
        // Trials differ by 1 N, the models by 0.1 N in each: the interval is of the second.
        let difference = paired(&[1.1, 2.1, 3.13], &[1.0, 2.0, 3.0]).unwrap();
        assert!((difference.mean_n - 0.11).abs() < 1e-12);
        let half = 4.303 * (0.0003_f64 / 3.0).sqrt();
        assert!((difference.half_n.unwrap() - half).abs() < 1e-9);
        assert_eq!(paired(&[1.0], &[1.0, 2.0]), None);
        assert_eq!(paired(&[2.0], &[1.5]).unwrap().half_n, None);
    }

    #[test]
    fn a_label_without_a_range_has_no_relative_error() {
        let still = Rows {
            trial: 1,
            error: vec![0.5; 10],
            range: Some([0.0; 2]),
            ..Rows::default()
        };
        let f = figures(&[still]);
        assert_eq!((f.nrmse, f.mae_n, f.rows), (None, 0.5, 10));
        assert_eq!(figures(&[]).rows, 0);
    }

    #[test]
    fn figures_weigh_rows_and_bins_are_of_equal_width() {
        let trial = |trial, error: Vec<f64>| Rows {
            trial,
            range: Some([0.0, (error.len() - 1) as f64]),
            speed: error
                .iter()
                .enumerate()
                .map(|(k, _)| k as f64 * 0.001)
                .collect(),
            error,
            ..Rows::default()
        };
        let trials = [trial(1, vec![1.0; 300]), trial(2, vec![-2.0; 100])];
        let f = figures(&trials);
        assert!((f.mae_n - 1.25).abs() < 1e-12 && f.rows == 400);
        assert!((f.rmse_n - (700.0_f64 / 400.0).sqrt()).abs() < 1e-12);
        assert!((f.nrmse.unwrap() - f.rmse_n / 299.0).abs() < 1e-12);
        let edges = speed_edges(&trials);
        assert!((edges[0] * 6.0 - edges[5]).abs() < 1e-12);
        assert_eq!(speed_bin(&edges, 1e9), 5);
        assert_eq!(speed_bin(&edges, 0.0), 0);
        let bins = by_bin(&trials, 2, |t, _| t.trial - 1);
        assert_eq!(bins, vec![(1.0, 300), (2.0, 100)]);
    }
}

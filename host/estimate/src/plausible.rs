//! Whether the columns of a log can be what a mapping says they are: velocities of their joints,
//! units that all trials share.

use super::load::{failed, LoadError};
use estimator::data::Mapping;
use estimator::sequence::Sequence;
use std::collections::BTreeMap;
use std::path::Path;

/// Time over which a change of a position is compared with its velocity, s: long against the steps
/// of an encoder and the delay of a filter.
const COMPARED_S: f64 = 0.5;
/// Such times, of 20 s in all, from which they are compared.
const FEWEST_COMPARED: usize = 40;
/// Change of a position over the one that its velocity makes. A gear ratio of two is a mistake, a
/// filter's loss is less.
const SLOPE: std::ops::Range<f64> = 0.5..2.0;
/// Least correlation of the two. The virtual arm has 0.99 and more.
const ALIKE: f64 = 0.7;
/// RMS change of a joint within that time below which it stands: rad, rad, m.
const STANDS: [f64; 3] = [5e-3, 5e-3, 5e-4];

/// Refuses a file in which a velocity is not that of its joint: other columns, or another unit.
pub(crate) fn check_velocities(
    file: &Path,
    sequences: &[Sequence],
    mapping: &Mapping,
) -> Result<(), LoadError> {
    for (joint, least) in STANDS.into_iter().enumerate() {
        let (mut pp, mut pv, mut vv, mut count) = (0.0, 0.0, 0.0, 0_usize);
        for sequence in sequences {
            let rows = (COMPARED_S / sequence.step_s).round().max(1.0) as usize;
            let value = |row: usize, column: usize| f64::from(sequence.input_row(row)[column]);
            for from in (0..sequence.rows().saturating_sub(rows)).step_by(rows) {
                let change = value(from + rows, joint) - value(from, joint);
                // The trapezoidal rule.
                let ends = 0.5 * (value(from, 3 + joint) + value(from + rows, 3 + joint));
                let middle: f64 = (from + 1..from + rows).map(|k| value(k, 3 + joint)).sum();
                let by_velocity = (ends + middle) * sequence.step_s;
                pp += change * change;
                pv += change * by_velocity;
                vv += by_velocity * by_velocity;
                count += 1;
            }
        }
        let stands = (pp / count.max(1) as f64).sqrt() < least;
        if mapping.velocity[joint].absent || count < FEWEST_COMPARED || stands {
            continue;
        }
        let (slope, alike) = (pv / vv, pv / (pp * vv).sqrt());
        // Without a velocity at all both are no number.
        if !(SLOPE.contains(&slope) && alike >= ALIKE) {
            return Err(failed(
                file,
                format!(
                    "`{}` is not the velocity of `{}`: over {COMPARED_S} s the position changes by {slope:.3} of what it makes (correlation {alike:.3}). \
                     Check both columns and their units in the mapping file; leave a velocity that is not measured out with `{{ absent = true }}`",
                    mapping.velocity[joint].column, mapping.position[joint].column
                ),
            ));
        }
    }
    Ok(())
}

/// RMS of a trial's effort or force over the median of all trials from which its unit is another.
/// Forces of one experiment differ by some times, units by 57 or more.
const ANOTHER_UNIT: f64 = 30.0;

/// Refuses a trial whose efforts or forces are far larger than those of the others.
pub(crate) fn check_units(path: &Path, sequences: &[Sequence]) -> Result<(), LoadError> {
    let mut squares: BTreeMap<usize, ([f64; 6], f64)> = BTreeMap::new();
    for sequence in sequences {
        let (sums, rows) = squares.entry(sequence.trial).or_default();
        for k in 0..sequence.rows() {
            let efforts = sequence.input_row(k)[6..9].iter();
            let values = efforts.chain(sequence.target_row(k));
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += f64::from(*value).powi(2);
            }
            *rows += 1.0;
        }
    }
    let names = [
        "the effort of the shoulder",
        "the effort of the elbow",
        "the effort of the insertion",
        "the force along x",
        "the force along y",
        "the force along z",
    ];
    for (i, name) in names.iter().enumerate() {
        let rms = squares.values().map(|(sums, rows)| (sums[i] / rows).sqrt());
        let mut sorted: Vec<f64> = rms.filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let Some(median) = sorted.get(sorted.len() / 2).filter(|_| sorted.len() > 2) else {
            continue;
        };
        let other = squares.iter().find_map(|(trial, (sums, rows))| {
            let ratio = (sums[i] / rows).sqrt() / median;
            (*median > 0.0 && ratio > ANOTHER_UNIT).then_some((trial, ratio))
        });
        if let Some((trial, ratio)) = other {
            return Err(failed(
                path,
                format!("trial {trial}: {name} is {ratio:.0} times as large as in the median of the trials (RMS). Check its unit in that trial's log, or leave the trial out"),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 30 s of three joints; `velocity` is what the log has of a joint's, by joint and true ones.
    fn moving(velocity: impl Fn(usize, [f64; 3]) -> f64) -> Sequence {
        let mut input = Vec::new();
        for k in 0..3_000 {
            let t = 0.01 * f64::from(k);
            let size = [0.3, 0.2, 0.03];
            let phase = |i: usize| (0.5 + 0.2 * i as f64) * t;
            let noise = 2e-4 * (f64::from(k) * 12.9898).sin();
            let q: [f64; 3] = core::array::from_fn(|i| size[i] * phase(i).sin() * (1.0 + noise));
            let v = core::array::from_fn(|i| size[i] * (0.5 + 0.2 * i as f64) * phase(i).cos());
            input.extend(q.map(|x| x as f32));
            input.extend((0..3).map(|i| velocity(i, v) as f32));
            input.extend([0.0; 3]);
        }
        Sequence {
            trial: 1,
            start_s: 0.0,
            step_s: 0.01,
            input,
            inputs: 9,
            target: vec![0.0; 9_000],
            targets: 3,
        }
    }

    #[test]
    fn a_trial_in_another_unit_is_refused() {
        let trials = |factor: f32| -> Vec<Sequence> {
            (1..5)
                .map(|trial| {
                    let mut sequence = moving(|i, v| v[i]);
                    sequence.trial = trial;
                    let scale = if trial == 3 { factor } else { 1.0 };
                    // No force in one trial: free motion.
                    let force = if trial == 2 { 0.0 } else { scale };
                    sequence.target.iter_mut().for_each(|f| *f = force);
                    sequence
                })
                .collect()
        };
        check_units(Path::new("day"), &trials(5.0)).unwrap();
        let error = check_units(Path::new("day"), &trials(1e3)).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains("day") && error.contains("trial 3: the force along x"),
            "{error}"
        );
    }

    #[test]
    fn a_velocity_of_another_joint_or_unit_is_refused() {
        let check = |sequence: Sequence| {
            check_velocities(Path::new("a.csv"), &[sequence], &Mapping::default())
        };
        check(moving(|i, v| v[i])).unwrap();
        // What a filter and a scale that is not quite right make of it.
        check(moving(|i, v| 0.8 * v[i])).unwrap();
        for (wrong, column) in [
            (moving(|i, v| v[[1, 0, 2][i]]), "joint_velocity_1"),
            (
                moving(|i, v| if i == 2 { 1e3 * v[2] } else { v[i] }),
                "joint_velocity_3",
            ),
            (
                moving(|i, v| if i == 1 { v[1].to_degrees() } else { v[i] }),
                "joint_velocity_2",
            ),
            (
                moving(|i, v| if i == 1 { -v[1] } else { v[i] }),
                "joint_velocity_2",
            ),
            (
                moving(|i, v| if i == 0 { 0.0 } else { v[i] }),
                "joint_velocity_1",
            ),
        ] {
            let error = check(wrong).unwrap_err().to_string();
            assert!(error.contains("a.csv") && error.contains(column), "{error}");
        }
    }
}

//! The model of one tool on another of its kind: a correction from two files, held by what is known
//! about tools.
//!
//! The correction adds to the model's torque: an offset, a gain, their dependence on the angle,
//! friction by speed, and the turn after a reversal. Two files can't say all that; a normal prior
//! says how far tools of one kind differ.

use crate::data::Run;
use crate::features::{legendre, Features};
use crate::model::{for_each_row, Bilinear};
use crate::protocol::{Inputs, Scored};
use crate::sums::Sums;

/// Regressors of the correction.
pub const CORRECTIONS: usize = 18;

/// How far tools differ, one standard deviation: offset, mN·m.
const OFFSET_MNM: f64 = 4.0;
/// Gain: 1.5 mN·m at 50 mN·m.
const GAIN: f64 = 1.5 / 50.0;
/// Each order of the offset's dependence on the angle, mN·m.
const PROFILE_MNM: f64 = 3.0;
/// Each order of the gain's dependence on the angle.
const LEVER: f64 = 2.0 / 50.0;
/// Friction by speed, mN·m a rad/s.
const FRICTION: f64 = 3.0;
/// Each exponential of the turn, mN·m.
const TURN_MNM: f64 = 3.0;
/// Speed at which friction is in the offset, rad/s.
const USUAL_RAD_S: f64 = -1.0;
/// Independent errors in a file: errors of neighbouring rows are alike.
const INDEPENDENT: f64 = 12.0;
/// Standard deviation of such an error, mN·m.
const ERROR_MNM: f64 = 2.0;

/// Regressors of the correction, scaled to the prior.
#[must_use]
pub fn row(features: &Features, torque_mnm: f64) -> [f64; CORRECTIONS] {
    let polynomial = legendre::<9>(features.spindle_rad());
    let (speed, turn) = features.motion();
    let mut out = [0.0; CORRECTIONS];
    out[0] = OFFSET_MNM;
    out[1] = GAIN * torque_mnm;
    for (slot, value) in out[2..10].iter_mut().zip(&polynomial[1..=8]) {
        *slot = PROFILE_MNM * value;
    }
    for (slot, value) in out[10..14].iter_mut().zip(&polynomial[1..=4]) {
        *slot = LEVER * torque_mnm * value;
    }
    out[14] = FRICTION * (speed - USUAL_RAD_S);
    for (slot, turn) in out[15..].iter_mut().zip(&turn[1..]) {
        *slot = TURN_MNM * turn;
    }
    out
}

/// Sums of the correction over a run: its truth is what the model leaves.
#[must_use]
pub fn sums(model: &Bilinear, run: &Run, scored: &Scored) -> Sums {
    let mut regressors = Vec::with_capacity(scored.rows.len() * CORRECTIONS);
    let mut left = Vec::with_capacity(scored.rows.len());
    for_each_row(run, scored, Inputs::Causal, |features, truth| {
        let torque = model.value(&features.row());
        regressors.extend(row(features, torque));
        left.push(truth - torque);
    });
    Sums::of(CORRECTIONS, &regressors, &left)
}

/// Root mean squared error on all other runs after a correction from these two, mN·m. `None` where
/// there are no others.
#[must_use]
pub fn error_after(sums: &[Sums], pair: [usize; 2]) -> Option<f64> {
    let mut known = Sums::new(CORRECTIONS);
    for run in pair {
        known += &sums[run];
    }
    let information = 2.0 * INDEPENDENT / known.rows / (ERROR_MNM * ERROR_MNM);
    let weights = known.posterior(information)?;
    let (squared, rows) = sums
        .iter()
        .enumerate()
        .filter(|(run, _)| !pair.contains(run))
        .fold((0.0, 0.0), |(s, r), (_, sums)| {
            (s + sums.squared_error(&weights), r + sums.rows)
        });
    (rows > 0.0).then(|| (squared / rows).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_and_a_gain_are_taken_from_two_files() {
        // Ten loads; the other tool reads 5 % more and 3 mN·m more.
        let sums: Vec<Sums> = (1..=10)
            .map(|level| {
                let (mut x, mut y) = (Vec::new(), Vec::new());
                for n in 0..200 {
                    let torque = -12.0 * f64::from(level);
                    let mut features = Features::new();
                    let spindle_rad = 1.05 - 0.005 * f64::from(n);
                    features.push(crate::data::Row {
                        current_a: 0.1,
                        spindle_rad,
                        motor_rad: spindle_rad,
                    });
                    x.extend(row(&features, torque));
                    y.push(0.05 * torque + 3.0);
                }
                Sums::of(CORRECTIONS, &x, &y)
            })
            .collect();
        let before = {
            let none = nalgebra::DVector::zeros(CORRECTIONS);
            let squared: f64 = sums.iter().map(|s| s.squared_error(&none)).sum();
            (squared / 2000.0).sqrt()
        };
        let ends = error_after(&sums, [0, 9]).unwrap();
        assert!(before > 1.5 && ends < 0.2 * before, "{before} {ends}");
        assert_eq!(error_after(&sums[..2], [0, 1]), None);
    }
}

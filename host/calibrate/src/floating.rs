//! A known weight on a tip that the cables alone carry: what the load cells say of it.
//!
//! The tension loops are open, and a stand holds the tip at a known place while the motors get half
//! of what the weight needs. When the stand is lowered, the friction of the reels and the cables'
//! directions take the rest, and the cables carry the weight to the last newton: the force by the
//! cells, along the directions from where the tip is then, has to be that of the weight. Where it
//! is then, the encoders tell: the lengths of six cables give its three coordinates. The friction
//! itself does not count: it is between motor and cable, and the cell weighs the cable.
//!
//! Closed loops are of no use here. They would hold the commanded force whatever hangs on the tip,
//! and they are made for a tip that a robot holds: a free one swings with them.
//!
//! A tip that a robot or the stand still holds tells nothing. So the cells have to see the weight
//! come on.

use super::{CalibrateError, Result};
use calibration::self_calibration::{Prior, Sample};
use force::metrics::Step;
use nalgebra::{Matrix3, Vector3};
use rig::Rig;
use wire::UNITS;

/// Part of the weight that is commanded. What is left, 2.5 N of 500 g, the friction of two reels
/// holds (0.9 N and 0.15 of the tension each), so that the tip hardly sinks.
pub const COMMANDED: f64 = 0.5;
/// Part of the weight that has to come on when the tip is let go. Friction leaves the force before
/// that at the commanded half or below it.
const COMES_ON: f64 = 0.2;
/// When the tip is let go, s after the force is commanded: the force is reached by then, and the
/// lengths before are those at the tip's known place.
pub const LET_GO_S: f64 = 5.0;
/// Before that, the time over which the lengths are read, s.
const BEFORE_S: f64 = 2.0;
/// At the end, the time over which everything is read, s.
pub const READ_S: f64 = 5.0;
/// Within the reading it may move by this, m: 0.3 mm on 30 N/m are 9 mN.
const AT_REST_M: f64 = 3e-4;

/// A free tip at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Floating {
    /// Where it is, robot base frame, m.
    pub tip_m: Vector3<f64>,
    /// How far it went when it was let go, m.
    pub went_m: Vector3<f64>,
    /// Difference of the cables' lengths by the encoders to that, m, root mean square.
    pub lengths_rms_m: f64,
    /// Force of the cables on it by the load cells, N.
    pub force_n: Vector3<f64>,
    /// The same before it was let go, N.
    pub before_n: Vector3<f64>,
    /// The tensions, N.
    pub tension_n: [f64; UNITS],
    /// Standard uncertainty of a coordinate of where it is against where it was, m: the encoders do
    /// not see how the cables stretch.
    pub stretch_sd_m: f64,
    /// How much the force changed from the first to the second half of the reading, N.
    pub drift_n: f64,
}

/// Means of lengths and tensions over a part of a run.
struct Part {
    travel_m: [f64; UNITS],
    tension_n: [f64; UNITS],
}

impl Part {
    /// `None` where no cycle is within.
    fn of(
        steps: &[&Step],
        samples: &[Vec<Sample>; UNITS],
        within: std::ops::Range<f64>,
    ) -> Option<Self> {
        let cycles: Vec<usize> = (0..steps.len())
            .filter(|at| within.contains(&steps[*at].t_s))
            .collect();
        let count = cycles.len() as f64;
        let mean = |of: &dyn Fn(usize) -> f64| cycles.iter().map(|at| of(*at)).sum::<f64>() / count;
        (count > 0.0).then(|| Self {
            travel_m: std::array::from_fn(|i| mean(&|at| samples[i][at].travel_m)),
            tension_n: std::array::from_fn(|i| mean(&|at| samples[i][at].tension_n)),
        })
    }
}

/// Force of the cables on a tip at rest that is free, from a run in which it was let go at
/// [`LET_GO_S`] where the run's pose says, with a weight on it, N. `samples` are those of a
/// [`Collector`](crate::moving::Collector).
///
/// # Errors
/// The run is too short or a unit took no part; the tip did not move or does not come to rest; the
/// lengths fit no place of the tip.
pub fn at_rest(
    rig: &Rig,
    weight_n: f64,
    steps: &[Step],
    samples: &[Vec<Sample>; UNITS],
) -> Result<Floating> {
    let steps: Vec<&Step> = steps.iter().filter(|step| step.t_s >= 0.0).collect();
    if let Some(out) = (0..UNITS).find(|i| samples[*i].len() != steps.len()) {
        return Err(CalibrateError::refused(format!(
            "unit {} took no part in some of the run; a tip hangs in all {UNITS} cables",
            out + 1
        )));
    }
    let end_s = steps.last().map_or(0.0, |step| step.t_s);
    let read = |from_s: f64, to_s: f64| {
        (from_s >= LET_GO_S)
            .then(|| Part::of(&steps, samples, from_s..to_s))
            .flatten()
            .ok_or_else(|| {
                CalibrateError::refused(format!(
                    "the run ended after {end_s:.1} s: too short to let go of the tip at {LET_GO_S} s and to read over the last {READ_S} s"
                ))
            })
    };
    let before = Part::of(&steps, samples, LET_GO_S - BEFORE_S..LET_GO_S)
        .ok_or_else(|| CalibrateError::refused("the run ended before the tip was let go"))?;
    let from = (steps.iter())
        .find(|step| step.t_s >= LET_GO_S - BEFORE_S)
        .map_or_else(Vector3::zeros, |step| step.tip_m);
    let place = |now: &Part| {
        let paid_out = std::array::from_fn(|i| now.travel_m[i] - before.travel_m[i]);
        moved_tip(rig, &from, &paid_out)
    };
    let all = read(end_s - READ_S, end_s)?;
    let (tip_m, lengths_rms_m) = place(&all);
    let went_m = tip_m - from;
    let before_n = force_n(rig, &from, &from, &before.tension_n);
    let after_n = force_n(rig, &from, &tip_m, &all.tension_n);
    if after_n.z - before_n.z < COMES_ON * weight_n {
        return Err(CalibrateError::refused(format!(
            "the cables pulled up with {:.2} N before the tip was let go, and with {:.2} N after: a weight of {weight_n:.2} N did not come on. Take the tip off the robot, lower the stand, and let the weight hang free",
            before_n.z, after_n.z
        )));
    }
    if lengths_rms_m > rig.pose_sd_m.max(1e-3) {
        return Err(CalibrateError::refused(format!(
            "the lengths of the cables fit no place of the tip, by {:.1} mm: `forcectl calibrate verify` looks for wrong exit points and encoders",
            1e3 * lengths_rms_m
        )));
    }
    let middle_s = end_s - 0.5 * READ_S;
    let (first, second) = (read(end_s - READ_S, middle_s)?, read(middle_s, end_s)?);
    let moves_m = (place(&second).0 - place(&first).0).norm();
    if moves_m > AT_REST_M {
        return Err(CalibrateError::refused(format!(
            "the tip still moves by {:.1} mm in {:.1} s: --duration longer, and nothing may touch weight or cables",
            1e3 * moves_m,
            0.5 * READ_S
        )));
    }
    let more_n = (all.tension_n.iter().zip(&before.tension_n)).map(|(now, was)| (now - was).abs());
    let stretch_sd_m = Prior::default().compliance_sd_m_per_n * more_n.fold(0.0, f64::max);
    let force_of = |part: &Part| force_n(rig, &from, &tip_m, &part.tension_n);
    Ok(Floating {
        tip_m,
        went_m,
        lengths_rms_m,
        force_n: after_n,
        before_n,
        tension_n: all.tension_n,
        stretch_sd_m,
        drift_n: (force_of(&second) - force_of(&first)).norm(),
    })
}

/// Force of the cables at a tip, N, of tensions that the board took from the cells with the tip at
/// `from`: a cell feels the tension times the cosine between cable and axis.
fn force_n(
    rig: &Rig,
    from: &Vector3<f64>,
    tip_m: &Vector3<f64>,
    tension_n: &[f64; UNITS],
) -> Vector3<f64> {
    (rig.units.iter().zip(tension_n))
        .map(|(unit, tension_n)| {
            let along = |tip: &Vector3<f64>| (unit.exit_m - tip).normalize();
            let cosine = |tip: &Vector3<f64>| unit.axis.dot(&along(tip));
            along(tip_m) * (tension_n * cosine(from) / cosine(tip_m))
        })
        .sum()
}

/// Where a tip is that was at `from`, after so much of each cable was paid out (m), and the root
/// mean square of what the lengths differ from that, m. Least squares by Gauss and Newton.
fn moved_tip(rig: &Rig, from: &Vector3<f64>, paid_out_m: &[f64; UNITS]) -> (Vector3<f64>, f64) {
    let mut tip_m = *from;
    let off = |tip_m: &Vector3<f64>, i: usize| {
        let exit_m = &rig.units[i].exit_m;
        (exit_m - from).norm() + paid_out_m[i] - (exit_m - tip_m).norm()
    };
    // Millimetres on half a metre: each pass takes the error to its square.
    for _ in 0..5 {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for i in 0..UNITS {
            let away = (tip_m - rig.units[i].exit_m).normalize();
            normal += away * away.transpose();
            right += away * off(&tip_m, i);
        }
        let Some(inverse) = normal.try_inverse() else {
            break;
        };
        tip_m += inverse * right;
    }
    let squares: f64 = (0..UNITS).map(|i| off(&tip_m, i).powi(2)).sum();
    (tip_m, (squares / UNITS as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.01;
    /// The unit above the tip.
    const ABOVE: u8 = 5;

    const WEIGHT_N: f64 = 2.0;

    /// A run of 20 s whose tip goes by `went_m` from the middle of the workspace at `LET_GO_S`, and
    /// by `drifts_m_per_s` on from there. The cells say tensions of 3 N each, that above the tip
    /// 2 N more from then on.
    fn run(
        rig: &Rig,
        went_m: Vector3<f64>,
        drifts_m_per_s: f64,
    ) -> (Vec<Step>, [Vec<Sample>; UNITS]) {
        let from = rig.workspace.center_m;
        let mut steps = Vec::new();
        let mut samples: [Vec<Sample>; UNITS] = Default::default();
        for k in 0..2000 {
            let t_s = f64::from(k) * CYCLE_S;
            let mut tip_m = from;
            if t_s >= LET_GO_S {
                tip_m += went_m + Vector3::x() * (drifts_m_per_s * t_s);
            }
            for (unit, samples) in rig.units.iter().zip(&mut samples) {
                let carries = unit.number == ABOVE && t_s >= LET_GO_S;
                samples.push(Sample {
                    tip_m: from,
                    travel_m: (unit.exit_m - tip_m).norm() - 0.3,
                    tension_n: if carries { 3.0 + WEIGHT_N } else { 3.0 },
                });
            }
            steps.push(Step {
                t_s,
                tip_m: from,
                commanded_n: Vector3::zeros(),
                estimated_n: Vector3::zeros(),
                applied_n: None,
                tension_setpoint_n: [3.0; UNITS],
                measured_tension_n: [3.0; UNITS],
                true_tension_n: None,
                available: [true; UNITS],
            });
        }
        (steps, samples)
    }

    #[test]
    fn a_tip_that_sank_is_found_by_the_lengths_and_its_force_along_them() {
        let rig = Rig::built_in().unwrap();
        let went_m = Vector3::new(1e-3, -2e-3, -6e-3);
        let (steps, samples) = run(&rig, went_m, 0.0);
        let found = at_rest(&rig, WEIGHT_N, &steps, &samples).unwrap();
        assert!((found.went_m - went_m).norm() < 1e-9, "{found:?}");
        assert!(found.lengths_rms_m < 1e-9 && found.drift_n < 1e-9);
        let tip_m = rig.workspace.center_m + went_m;
        // What the cells feel does not depend on the tip; the tensions that they stand for do.
        let expected: Vector3<f64> = (rig.units.iter())
            .map(|unit| {
                let cosine = |tip: Vector3<f64>| unit.axis.dot(&(unit.exit_m - tip).normalize());
                let cell_n = if unit.number == ABOVE {
                    3.0 + WEIGHT_N
                } else {
                    3.0
                };
                let tension_n = cell_n * cosine(rig.workspace.center_m) / cosine(tip_m);
                (unit.exit_m - tip_m).normalize() * tension_n
            })
            .sum();
        assert!((found.force_n - expected).norm() < 1e-9, "{found:?}");
        // 6 mm are a force that the command does not have: the test tells them apart.
        let (steps, samples) = run(&rig, Vector3::new(0.0, 0.0, -1.2e-3), 0.0);
        let less = at_rest(&rig, WEIGHT_N, &steps, &samples).unwrap();
        assert!(
            less.force_n.z < found.force_n.z - 0.05,
            "{less:?} {found:?}"
        );
    }

    #[test]
    fn a_tip_that_is_held_or_moves_or_fits_no_place_is_refused() {
        let rig = Rig::built_in().unwrap();
        let told = |steps: &[Step], samples: &[Vec<Sample>; UNITS]| {
            let found = at_rest(&rig, WEIGHT_N, steps, samples);
            found.unwrap_err().to_string()
        };
        let (steps, mut samples) = run(&rig, Vector3::zeros(), 0.0);
        for sample in samples.iter_mut().flatten() {
            sample.tension_n = 3.0;
        }
        assert!(told(&steps, &samples).contains("did not come on"));
        let sinks = Vector3::new(0.0, 0.0, -5e-3);
        let (steps, samples) = run(&rig, sinks, 4e-4);
        assert!(told(&steps, &samples).contains("still moves by 1.0 mm"));
        let (steps, mut samples) = run(&rig, sinks, 0.0);
        for sample in &mut samples[2][500..] {
            sample.travel_m += 8e-3;
        }
        assert!(told(&steps, &samples).contains("fit no place"));
        samples[2].truncate(700);
        assert!(told(&steps, &samples).contains("unit 3 took no part"));
        let (steps, samples) = run(&rig, sinks, 0.0);
        let short = samples.clone().map(|unit| unit[..700].to_vec());
        assert!(told(&steps[..700], &short).contains("ended after 7.0 s"));
    }
}

//! How good a run was: force at the tip, tensions, settling.

use nalgebra::Vector3;
use serde::Serialize;
use wire::UNITS;

/// Half the width of the band that counts as settled, N: 5 % of the 2.5 N of the rig's first
/// demonstration.
pub const SETTLED_WITHIN_N: f64 = 0.125;

/// How long an error has to stay within that to count as settled, s.
pub const SETTLED_FOR_S: f64 = 0.5;

/// Time after the command from which on a run counts as steady, s.
pub const STEADY_AFTER_S: f64 = 1.0;

/// One control cycle of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Step {
    /// Time since the force was commanded, s; negative before.
    pub t_s: f64,
    /// Tip, robot base frame, m.
    pub tip_m: Vector3<f64>,
    /// Commanded force after its slew limit, N.
    pub commanded_n: Vector3<f64>,
    /// Force applied by the measured tensions along the surveyed directions, N.
    pub estimated_n: Vector3<f64>,
    /// Force applied in the plant, N (embedded rig).
    pub applied_n: Option<Vector3<f64>>,
    /// Setpoints of the cable tensions, N.
    pub tension_setpoint_n: [f64; UNITS],
    /// Tensions measured, N.
    pub measured_tension_n: [f64; UNITS],
    /// Tensions in the plant, N (embedded rig).
    pub true_tension_n: Option<[f64; UNITS]>,
    /// Units that take part.
    pub available: [bool; UNITS],
}

impl Step {
    /// The force in the plant where it is known, the load cells' otherwise, N.
    #[must_use]
    pub fn best_force_n(&self) -> Vector3<f64> {
        self.applied_n.unwrap_or(self.estimated_n)
    }

    /// The tensions in the plant where they are known, the load cells' otherwise, N.
    #[must_use]
    pub fn best_tension_n(&self) -> [f64; UNITS] {
        self.true_tension_n.unwrap_or(self.measured_tension_n)
    }
}

/// Figures of a run. "Applied" is the plant's truth where there is one, the load cells' estimate
/// otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrics {
    /// Whether force and tensions are the plant's truth.
    pub from_truth: bool,
    /// Commanded force, N.
    pub commanded_n: Vector3<f64>,
    /// Mean force at the tip while steady, N.
    pub applied_n: Vector3<f64>,
    /// Mean error per axis while steady, N.
    pub error_n: Vector3<f64>,
    /// Length of the mean error while steady, N.
    pub tip_force_error_n: f64,
    /// Root mean square of the error's length while steady, N.
    pub tip_force_rms_n: f64,
    /// Time from the command until the error begins to stay within [`SETTLED_WITHIN_N`] for
    /// [`SETTLED_FOR_S`], s; `None`: it never does. Errors are averaged over 100 ms, so that one
    /// noisy cycle is not a failure to settle.
    pub settling_s: Option<f64>,
    /// The same for the component along the commanded direction alone: the step response, without
    /// the errors that friction reversals make across it.
    pub settling_along_s: Option<f64>,
    /// Part of the time after settling in which that averaged error is within the band. Below 1
    /// where friction that changes sides (the robot turns round) pushes the force out for a moment.
    pub within_band: f64,
    /// Mean setpoint of each cable's tension while steady, N.
    pub tension_setpoint_n: [f64; UNITS],
    /// Mean tension of each cable while steady, N.
    pub tension_n: [f64; UNITS],
    /// Root mean square of tension less setpoint while steady, N; of cables that took part.
    pub tension_rms_n: [f64; UNITS],
    /// Cycles that were steady.
    pub steady_cycles: usize,
}

/// Cycles over which an error is averaged before it is held against the band: 100 ms.
const SMOOTH_CYCLES: usize = 10;

/// Figures of the cycles of a run; `commanded_n` is the commanded force, N. `None` where no cycle
/// is steady.
#[must_use]
pub fn of_run(commanded_n: Vector3<f64>, steps: &[Step]) -> Option<Metrics> {
    let commanded: Vec<&Step> = steps.iter().filter(|step| step.t_s >= 0.0).collect();
    let steady: Vec<&&Step> = commanded
        .iter()
        .filter(|step| step.t_s >= STEADY_AFTER_S)
        .collect();
    if steady.is_empty() {
        return None;
    }
    let count = steady.len() as f64;
    let mean3 = |value: &dyn Fn(&Step) -> Vector3<f64>| {
        let sum: Vector3<f64> = steady.iter().map(|step| value(step)).sum();
        sum / count
    };
    let mean6 = |value: &dyn Fn(&Step, usize) -> f64| -> [f64; UNITS] {
        core::array::from_fn(|i| steady.iter().map(|step| value(step, i)).sum::<f64>() / count)
    };
    let error = |step: &Step| step.best_force_n() - commanded_n;
    let error_n = mean3(&error);
    let square = steady
        .iter()
        .map(|step| error(step).norm_squared())
        .sum::<f64>()
        / count;
    let tension_rms_n = mean6(&|step, i| {
        if step.available[i] {
            (step.best_tension_n()[i] - step.tension_setpoint_n[i]).powi(2)
        } else {
            0.0
        }
    })
    .map(f64::sqrt);
    let (settling_s, within_band) = settling(commanded_n, &commanded, |error| error.norm());
    let along = commanded_n.try_normalize(0.0).unwrap_or_default();
    let (settling_along_s, _) = settling(commanded_n, &commanded, |error| error.dot(&along).abs());
    Some(Metrics {
        from_truth: steady.iter().all(|step| step.applied_n.is_some()),
        commanded_n,
        applied_n: mean3(&Step::best_force_n),
        error_n,
        tip_force_error_n: error_n.norm(),
        tip_force_rms_n: square.sqrt(),
        settling_s,
        settling_along_s,
        within_band,
        tension_setpoint_n: mean6(&|step, i| step.tension_setpoint_n[i]),
        tension_n: mean6(&|step, i| step.best_tension_n()[i]),
        tension_rms_n,
        steady_cycles: steady.len(),
    })
}

/// When the averaged error enters the band and stays for [`SETTLED_FOR_S`], and the part of the
/// time after that in which it is within.
fn settling(
    commanded_n: Vector3<f64>,
    commanded: &[&Step],
    size: impl Fn(Vector3<f64>) -> f64,
) -> (Option<f64>, f64) {
    let within: Vec<(f64, bool)> = (commanded.iter().enumerate())
        .map(|(i, step)| {
            let window = &commanded[(i + 1).saturating_sub(SMOOTH_CYCLES)..=i];
            let sum: Vector3<f64> = (window.iter())
                .map(|s| s.best_force_n() - commanded_n)
                .sum();
            let error = size(sum / window.len() as f64);
            // NaN is not within.
            (step.t_s, error <= SETTLED_WITHIN_N)
        })
        .collect();
    let mut entered = None;
    for &(t_s, inside) in &within {
        entered = if inside { entered.or(Some(t_s)) } else { None };
        if let Some(since) = entered.filter(|since| t_s - since >= SETTLED_FOR_S) {
            let after = within.iter().filter(|(t, _)| *t >= since);
            let good = after.clone().filter(|(_, inside)| *inside).count();
            return (Some(since), good as f64 / after.count() as f64);
        }
    }
    (None, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(t_s: f64, force_n: Vector3<f64>) -> Step {
        Step {
            t_s,
            tip_m: Vector3::zeros(),
            commanded_n: Vector3::new(0.0, 2.5, 0.0),
            estimated_n: Vector3::zeros(),
            applied_n: Some(force_n),
            tension_setpoint_n: [2.0; UNITS],
            measured_tension_n: [2.0; UNITS],
            true_tension_n: Some([2.1; UNITS]),
            available: [true, true, true, true, true, false],
        }
    }

    #[test]
    fn a_first_order_rise_settles_where_it_should() {
        // 2.5 (1 - exp(-t/0.1)): within 0.125 N after 0.1 ln 20 = 0.2996 s, the average 50 ms later
        // or so.
        let steps: Vec<Step> = (-50..500)
            .map(|n| {
                let t = f64::from(n) * 0.01;
                let y = if t < 0.0 {
                    0.0
                } else {
                    2.5 * (1.0 - (-t / 0.1).exp())
                };
                step(t, Vector3::new(0.0, y, 0.03))
            })
            .collect();
        let metrics = of_run(Vector3::new(0.0, 2.5, 0.0), &steps).unwrap();
        let settling = metrics.settling_s.unwrap();
        assert!((0.30..0.37).contains(&settling), "{settling}");
        let along = metrics.settling_along_s.unwrap();
        assert!((0.30..=settling).contains(&along), "{along}");
        assert!(
            (metrics.tip_force_error_n - 0.03).abs() < 1e-4,
            "{metrics:?}"
        );
        for i in 0..5 {
            assert!((metrics.tension_rms_n[i] - 0.1).abs() < 1e-12);
        }
        assert_eq!(metrics.tension_rms_n[5], 0.0);
        assert!(metrics.from_truth);
    }

    #[test]
    fn leaving_the_band_again_counts() {
        let mut steps: Vec<Step> = (0..300)
            .map(|n| step(f64::from(n) * 0.01, Vector3::new(0.0, 2.5, 0.0)))
            .collect();
        for s in &mut steps[20..50] {
            s.applied_n = Some(Vector3::new(0.0, 2.0, 0.0));
        }
        let metrics = of_run(Vector3::new(0.0, 2.5, 0.0), &steps).unwrap();
        let settling = metrics.settling_s.unwrap();
        assert!((0.50..0.60).contains(&settling), "{settling}");
        assert_eq!(metrics.within_band, 1.0);
        // Out of the band for a while later on: settled, but not all of the time.
        for s in &mut steps[200..230] {
            s.applied_n = Some(Vector3::repeat(f64::NAN));
        }
        let metrics = of_run(Vector3::new(0.0, 2.5, 0.0), &steps).unwrap();
        assert_eq!(metrics.settling_s, Some(settling));
        assert!((0.8..0.9).contains(&metrics.within_band), "{metrics:?}");
        for s in &mut steps {
            s.applied_n = Some(Vector3::new(0.0, 2.0, 0.0));
        }
        assert_eq!(
            of_run(Vector3::new(0.0, 2.5, 0.0), &steps)
                .unwrap()
                .settling_s,
            None
        );
        assert!(of_run(Vector3::zeros(), &steps[..50]).is_none());
    }
}

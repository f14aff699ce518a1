//! How good a run was: force at the tip, tensions, settling.

use nalgebra::Vector3;
use serde::Serialize;
use std::collections::VecDeque;
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
    let mut sums = Sums::new(commanded_n);
    steps.iter().for_each(|step| sums.add(step));
    sums.metrics()
}

/// What a run held, added up cycle by cycle: a run of a day has 8.6 million.
#[derive(Debug, Clone)]
pub struct Sums {
    commanded_n: Vector3<f64>,
    /// Errors of the newest cycles, N.
    newest_n: VecDeque<Vector3<f64>>,
    settling: Settling,
    settling_along: Settling,
    /// Cycles that were steady; the sums are over them.
    steady: usize,
    from_truth: bool,
    force_n: Vector3<f64>,
    error_n: Vector3<f64>,
    square: f64,
    setpoint_n: [f64; UNITS],
    tension_n: [f64; UNITS],
    tension_square: [f64; UNITS],
}

impl Sums {
    /// Of a run with this commanded force, N.
    #[must_use]
    pub fn new(commanded_n: Vector3<f64>) -> Self {
        Self {
            commanded_n,
            newest_n: VecDeque::with_capacity(SMOOTH_CYCLES),
            settling: Settling::default(),
            settling_along: Settling::default(),
            steady: 0,
            from_truth: true,
            force_n: Vector3::zeros(),
            error_n: Vector3::zeros(),
            square: 0.0,
            setpoint_n: [0.0; UNITS],
            tension_n: [0.0; UNITS],
            tension_square: [0.0; UNITS],
        }
    }

    /// Adds a cycle; those before the command do not count.
    pub fn add(&mut self, step: &Step) {
        if step.t_s < 0.0 {
            return;
        }
        let error_n = step.best_force_n() - self.commanded_n;
        if self.newest_n.len() == SMOOTH_CYCLES {
            self.newest_n.pop_front();
        }
        self.newest_n.push_back(error_n);
        let smooth_n = self.newest_n.iter().sum::<Vector3<f64>>() / self.newest_n.len() as f64;
        let along = self.commanded_n.try_normalize(0.0).unwrap_or_default();
        self.settling.add(step.t_s, smooth_n.norm());
        self.settling_along
            .add(step.t_s, smooth_n.dot(&along).abs());
        if step.t_s < STEADY_AFTER_S {
            return;
        }
        self.steady += 1;
        self.from_truth &= step.applied_n.is_some();
        self.force_n += step.best_force_n();
        self.error_n += error_n;
        self.square += error_n.norm_squared();
        for (i, tension_n) in step.best_tension_n().into_iter().enumerate() {
            self.setpoint_n[i] += step.tension_setpoint_n[i];
            self.tension_n[i] += tension_n;
            if step.available[i] {
                self.tension_square[i] += (tension_n - step.tension_setpoint_n[i]).powi(2);
            }
        }
    }

    /// The figures; `None` where no cycle is steady.
    #[must_use]
    pub fn metrics(&self) -> Option<Metrics> {
        let count = self.steady as f64;
        let error_n = self.error_n / count;
        let mean = |sums: [f64; UNITS]| sums.map(|sum| sum / count);
        (self.steady > 0).then(|| Metrics {
            from_truth: self.from_truth,
            commanded_n: self.commanded_n,
            applied_n: self.force_n / count,
            error_n,
            tip_force_error_n: error_n.norm(),
            tip_force_rms_n: (self.square / count).sqrt(),
            settling_s: self.settling.since_s(),
            settling_along_s: self.settling_along.since_s(),
            within_band: self.settling.within_band(),
            tension_setpoint_n: mean(self.setpoint_n),
            tension_n: mean(self.tension_n),
            tension_rms_n: mean(self.tension_square).map(f64::sqrt),
            steady_cycles: self.steady,
        })
    }
}

/// When an error enters the band and stays for [`SETTLED_FOR_S`], and the part of the time after
/// that in which it is within.
#[derive(Debug, Clone, Default)]
struct Settling {
    /// When it entered the band that it has not left since, s.
    entered_s: Option<f64>,
    settled: bool,
    /// Cycles since it entered the band that it settled in, and those of them that were within.
    cycles: usize,
    within: usize,
}

impl Settling {
    fn add(&mut self, t_s: f64, error_n: f64) {
        // NaN is not within.
        let inside = error_n <= SETTLED_WITHIN_N;
        if !self.settled && !inside {
            *self = Self::default();
            return;
        }
        let since_s = *self.entered_s.get_or_insert(t_s);
        self.cycles += 1;
        self.within += usize::from(inside);
        self.settled |= t_s - since_s >= SETTLED_FOR_S;
    }

    fn since_s(&self) -> Option<f64> {
        self.entered_s.filter(|_| self.settled)
    }

    fn within_band(&self) -> f64 {
        match self.settled {
            true => self.within as f64 / self.cycles as f64,
            false => 0.0,
        }
    }
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

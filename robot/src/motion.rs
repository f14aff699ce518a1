//! How fast the tip moves, from poses that have noise, steps and delays.
//!
//! Each coordinate has a Kalman filter of its own for position, speed and acceleration, driven by
//! white jerk (`JERK_POWER`). The noise of the poses is not configured: third differences of
//! poses at a regular rate are nearly all noise. How well the filter predicts the next pose is part
//! of the uncertainty that it tells, so that a robot that moves in another way than the filter
//! expects is noticed.

use nalgebra::{Matrix3, Vector3};

/// Smallest and largest power of the jerk, m^2/s^5. The smallest is that of the rig's slow motions
/// (12 mm/s); it filters the noise of the poses best. From there the power rises while the poses
/// are further from the predictions than they should be. Found with control's example
/// `tension_loop`.
const JERK_POWER: (f64, f64) = (2e-5, 2e-4);

/// Misfit above which the power of the jerk rises. A filter that fits has 1; at 1.3 the start of a
/// motion made the filter too fast for seconds.
const MOST_MISFIT: f64 = 4.0;

/// Time over which the noise of the poses and the quality of the predictions are averaged, s.
const AVERAGING_S: f64 = 0.5;

/// Longest time between two poses, s: after a longer one all begins anew.
const LONGEST_GAP_S: f64 = 0.1;

/// Poses that it takes until their noise is known, to a quarter of it.
const FIRST_POSES: u32 = 50;

/// Smallest noise of a pose that is believed, m: 0.1 um, below the steps of any robot's encoders at
/// its tip.
const LEAST_NOISE_M: f64 = 1e-7;

/// How far a robot's stamps are from the moments of its poses, s: its loop is woken late by some
/// tens of us without a real-time kernel. A tip that moves is that much elsewhere, which third
/// differences average with its turns.
const STAMP_S: f64 = 5e-5;

/// The tip's speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// In the frame of the poses, m/s.
    pub m_per_s: Vector3<f64>,
    /// Standard deviation of a coordinate, m/s.
    pub sd_m_per_s: f64,
}

/// One coordinate.
#[derive(Debug, Clone, Copy)]
struct Axis {
    /// Position, speed, acceleration, SI.
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// The last poses, newest last, m.
    poses: [f64; 4],
    /// Square of the noise of a pose, m^2.
    noise_m2: f64,
}

impl Axis {
    fn new(position_m: f64) -> Self {
        Self {
            state: Vector3::new(position_m, 0.0, 0.0),
            // Speeds up to 0.1 m/s, accelerations up to 0.3 m/s^2.
            covariance: Matrix3::from_diagonal(&Vector3::new(1e-8, 1e-2, 1e-1)),
            poses: [position_m; 4],
            noise_m2: 0.0,
        }
    }

    /// State and covariance after `dt_s` with this power of the jerk.
    fn after(&self, dt_s: f64, jerk: f64) -> (Vector3<f64>, Matrix3<f64>) {
        let t = dt_s;
        let f = Matrix3::new(1.0, t, t * t / 2.0, 0.0, 1.0, t, 0.0, 0.0, 1.0);
        let q = Matrix3::new(
            t.powi(5) / 20.0,
            t.powi(4) / 8.0,
            t.powi(3) / 6.0,
            t.powi(4) / 8.0,
            t.powi(3) / 3.0,
            t.powi(2) / 2.0,
            t.powi(3) / 6.0,
            t.powi(2) / 2.0,
            t,
        );
        let covariance = f * self.covariance * f.transpose() + q * jerk;
        (f * self.state, covariance)
    }

    /// Takes a pose, the `count`th; the square of its distance from the prediction over the one to
    /// be expected.
    fn see(&mut self, position_m: f64, dt_s: f64, count: u32, jerk: f64) -> f64 {
        self.poses.rotate_left(1);
        self.poses[3] = position_m;
        let [a, b, c, d] = self.poses;
        let (state, covariance) = self.after(dt_s, jerk);
        let mut least_m = LEAST_NOISE_M;
        if count > 4 {
            // 1 + 9 + 9 + 1 times the noise's square.
            let seen_m2 = (d - 3.0 * c + 3.0 * b - a).powi(2) / 20.0;
            let share = (dt_s / AVERAGING_S)
                .max(1.0 / f64::from(count - 4))
                .min(1.0);
            self.noise_m2 += (seen_m2 - self.noise_m2) * share;
            // The first poses tell no speed.
            least_m = least_m.max(state[1].abs() * STAMP_S);
        }
        let variance = covariance[(0, 0)] + self.noise_m2.max(least_m * least_m);
        let gain = covariance.column(0) / variance;
        let off_m = position_m - state[0];
        self.state = state + gain * off_m;
        let corrected = covariance - gain * covariance.row(0);
        self.covariance = (corrected + corrected.transpose()) * 0.5;
        off_m * off_m / variance
    }
}

/// Estimates the tip's speed.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    axes: Option<[Axis; 3]>,
    at_s: f64,
    count: u32,
    /// Mean of what [`Axis::see`] returns: 1 where the filter fits the motion.
    misfit: f64,
    /// Power of the jerk, m^2/s^5.
    jerk: f64,
}

impl Motion {
    /// Takes the pose of the time `at_s` on the caller's clock. One that is not newer than the last
    /// changes nothing.
    pub fn see(&mut self, at_s: f64, position_m: Vector3<f64>) {
        let dt_s = at_s - self.at_s;
        let usable = at_s.is_finite() && position_m.iter().all(|x| x.is_finite());
        match &mut self.axes {
            _ if !usable => {}
            Some(axes) if dt_s <= LONGEST_GAP_S => {
                if dt_s <= 0.0 {
                    return;
                }
                self.count = self.count.saturating_add(1);
                let mut misfit = 0.0;
                for (axis, position_m) in axes.iter_mut().zip(&position_m) {
                    misfit += axis.see(*position_m, dt_s, self.count, self.jerk) / 3.0;
                }
                self.misfit += (misfit - self.misfit) * (dt_s / AVERAGING_S);
                // By a factor of e in AVERAGING_S at most.
                let rate = (self.misfit - MOST_MISFIT).clamp(-1.0, 1.0) * dt_s / AVERAGING_S;
                self.jerk = (self.jerk * libm::exp(rate)).clamp(JERK_POWER.0, JERK_POWER.1);
                self.at_s = at_s;
            }
            _ => {
                *self = Self {
                    axes: Some([0, 1, 2].map(|i| Axis::new(position_m[i]))),
                    at_s,
                    count: 1,
                    misfit: 1.0,
                    jerk: JERK_POWER.0,
                };
            }
        }
    }

    /// The speed at a time not before the newest pose; `None` before the noise of the poses is
    /// known, and where the newest one is too old for a prediction.
    #[must_use]
    pub fn velocity_at(&self, t_s: f64) -> Option<Velocity> {
        let ahead_s = t_s - self.at_s;
        let axes = self
            .axes
            .filter(|_| self.count >= FIRST_POSES && (0.0..LONGEST_GAP_S).contains(&ahead_s))?;
        let ahead = axes.map(|axis| axis.after(ahead_s, self.jerk));
        let variance = ahead.iter().map(|(_, p)| p[(1, 1)]).fold(0.0, f64::max);
        Some(Velocity {
            m_per_s: Vector3::from(ahead.map(|(x, _)| x[1])),
            sd_m_per_s: (variance * self.misfit.max(1.0)).sqrt(),
        })
    }
}

/// Largest standard deviation of the tip's speed that is told, m/s. Poses at 100 Hz reach it at
/// some 8 um of noise. With worse ones the largest tension error was larger with the speed than
/// without (example `tension_loop` of control, presliding distance twice the declared one).
pub const MOST_SD_M_PER_S: f64 = 1.2e-4;

/// Standard deviation from which it is told, m/s; once it was withheld, after it has been below
/// that for [`AGAIN_AFTER_S`]. So poses at the limit, and those whose time is uncertain, which is
/// noise while the robot moves and none while it turns, are not told and withheld in turn (example
/// `tension_loop`, row of 1 ms).
pub const FIRST_SD_M_PER_S: f64 = 0.9e-4;
/// See [`FIRST_SD_M_PER_S`], s: longer than the robot of that example turns.
pub const AGAIN_AFTER_S: f64 = 5.0;

/// How far ahead the speed is predicted, s: to the middle of the 10 ms until the next setpoints (5
/// ms), and to the middle of the time for which the board holds a command (1.5 ms).
pub const AHEAD_S: f64 = 6.5e-3;

/// The tip's speed while the setpoints of a cycle hold, where it is known well enough.
#[derive(Debug, Clone, Default)]
pub struct Foretold {
    motion: Motion,
    told: bool,
    /// Until when it is withheld; `None` before the first time.
    withheld_until_s: Option<f64>,
}

impl Foretold {
    /// Takes the newest pose of a cycle that begins at `now_s`: the tip was there at `tip_s`, as
    /// far as that is known, both on the caller's clock. The speed in the frame of the poses, m/s.
    pub fn see(
        &mut self,
        tip_s: f64,
        position_m: Vector3<f64>,
        now_s: f64,
    ) -> Option<Vector3<f64>> {
        self.motion.see(tip_s, position_m);
        let velocity = self.motion.velocity_at(now_s + AHEAD_S);
        let sd_m_per_s = velocity.map_or(f64::INFINITY, |velocity| velocity.sd_m_per_s);
        let most = if self.told {
            MOST_SD_M_PER_S
        } else {
            FIRST_SD_M_PER_S
        };
        if sd_m_per_s > most && (self.told || self.withheld_until_s.is_some()) {
            self.withheld_until_s = Some(now_s + AGAIN_AFTER_S);
        }
        self.told =
            sd_m_per_s <= most && self.withheld_until_s.is_none_or(|until_s| now_s >= until_s);
        velocity
            .filter(|_| self.told)
            .map(|velocity| velocity.m_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    /// Mean error of the speed of a tip that swings by 15 mm in 5 s, and the mean of what was told
    /// for it, m/s.
    fn errors(noise_m: f64, period_s: f64, ahead_s: f64) -> (f64, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut motion = Motion::default();
        let (mut squares, mut told, mut count) = (0.0, 0.0, 0.0);
        let omega = std::f64::consts::TAU / 5.0;
        for n in 0..(10.0 / period_s) as u32 {
            let t = f64::from(n) * period_s;
            // Uniform, with the same standard deviation.
            let mut pose = |x: f64| x + noise_m * 12f64.sqrt() * (rng.random::<f64>() - 0.5);
            let x = 0.015 * libm::sin(omega * t);
            motion.see(t, Vector3::new(pose(x), pose(0.1), pose(-0.1)));
            if t > 2.0 {
                let at = t + ahead_s;
                let velocity = motion.velocity_at(at).unwrap();
                let true_x = 0.015 * omega * libm::cos(omega * at);
                squares += (velocity.m_per_s[0] - true_x).powi(2);
                told += velocity.sd_m_per_s;
                count += 1.0;
            }
        }
        ((squares / count).sqrt(), told / count)
    }

    #[test]
    fn the_speed_is_found_through_noise_and_its_error_is_told() {
        for (noise_m, period_s, most) in [
            (2e-6, 0.01, 1.2e-4),
            (1e-5, 0.01, 3e-4),
            (5e-5, 0.01, 6e-4),
            (2e-6, 0.001, 8e-5),
        ] {
            let (error, told) = errors(noise_m, period_s, 0.012);
            println!("{noise_m} m, {period_s} s: {error:.2e} m/s, told {told:.2e}");
            assert!(error < most, "{noise_m}: {error}");
            assert!(error < 1.5 * told, "{noise_m}: {error}, told {told}");
        }
    }

    #[test]
    fn a_motion_that_the_filter_does_not_expect_is_told() {
        let mut motion = Motion::default();
        let mut sd = 0.0f64;
        for n in 0..400 {
            // A triangle: 5 mm/s, and a corner each second.
            let t = f64::from(n) * 0.01;
            let x = 0.005 * (t % 2.0 - 1.0).abs();
            motion.see(t, Vector3::new(x, 0.0, 0.0));
            if n > 150 && n < 220 {
                sd = sd.max(motion.velocity_at(t).unwrap().sd_m_per_s);
            }
        }
        assert!(sd > 1e-3, "{sd}");
    }

    /// How often the speed is withheld in a minute of poses with this noise, m, which come with
    /// this jitter, s, and the part of the cycles in which it is told. A tip that swings as above.
    fn withheld(noise_m: f64, jitter_s: f64) -> (u32, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let mut foretold = Foretold::default();
        let (mut count, mut told, mut was) = (0, 0, false);
        for n in 0..6_000 {
            let t = f64::from(n) * 0.01;
            let mut scatter = |sd: f64| sd * 12f64.sqrt() * (rng.random::<f64>() - 0.5);
            let x = 0.015 * libm::sin(std::f64::consts::TAU / 5.0 * t);
            let position_m = Vector3::new(x, 0.1, -0.1).map(|x| x + scatter(noise_m));
            let is = foretold
                .see(t + scatter(jitter_s), position_m, t + 0.005)
                .is_some();
            count += u32::from(was && !is);
            told += u32::from(is);
            was = is;
        }
        (count, f64::from(told) / 6_000.0)
    }

    #[test]
    fn poses_at_the_limit_are_not_told_in_turns() {
        for (um, ms) in (0..=12)
            .map(|um| (um, 0.0))
            .chain([(0, 0.05), (0, 0.1), (1, 0.1), (2, 0.1)])
            .chain([(2, 0.5), (2, 1.0), (0, 1.0)])
        {
            let (count, part) = withheld(f64::from(um) * 1e-6, ms * 1e-3);
            println!(
                "{um} um, {ms} ms: withheld {count} times, {:.0} % told",
                100.0 * part
            );
            // Each time for 5 s at least.
            assert!(count <= 6, "{um} um, {ms} ms: {count}");
            let good = um <= 4 && ms <= 0.1;
            let bad = um >= 10 || ms >= 1.0;
            assert!(!good || part > 0.9, "{um} um, {ms} ms: {part}");
            assert!(!bad || part < 0.1, "{um} um, {ms} ms: {part}");
        }
    }

    #[test]
    fn nothing_is_told_without_poses_or_with_old_ones() {
        let mut motion = Motion::default();
        assert_eq!(motion.velocity_at(0.0), None);
        for n in 0..100 {
            motion.see(f64::from(n) * 0.01, Vector3::new(0.0, 0.1, 0.2));
        }
        assert!(motion.velocity_at(1.0).is_some());
        assert_eq!(motion.velocity_at(1.2), None);
        assert_eq!(motion.velocity_at(0.5), None);
        assert_eq!(motion.velocity_at(f64::NAN), None);
        // Neither of these is a pose.
        motion.see(1.0, Vector3::new(f64::NAN, 0.1, 0.2));
        motion.see(f64::NAN, Vector3::new(0.0, 0.1, 0.2));
        assert!(motion.velocity_at(1.0).unwrap().m_per_s.norm() < 1e-9);
        // After a gap neither speed nor noise is known any more.
        motion.see(1.5, Vector3::new(0.5, 0.1, 0.2));
        assert_eq!(motion.velocity_at(1.5), None);
    }
}

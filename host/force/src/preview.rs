//! How fast each reel will have to wind in because the robot moves: what goes to the board with a
//! setpoint, where it is known well enough ([`wire::message::UnitSetpoint::reel_um_per_s`]).

use control::unit::REEL_SPEED_MAX_UM_PER_S;
use nalgebra::Vector3;
use robot::motion::Foretold;

/// When a pose was, on a clock of its source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// When the tip was there, as far as it is known, s.
    pub tip_s: f64,
    /// Now, s.
    pub now_s: f64,
}

/// What is known of the tip's motion.
#[derive(Debug, Default)]
pub struct Preview {
    foretold: Foretold,
}

impl Preview {
    /// Takes a cycle's pose. The tip's speed while its setpoints hold, m/s, where it is known well
    /// enough to be sent; never without the time of the pose.
    pub fn see(&mut self, tip_m: Vector3<f64>, moment: Option<Moment>) -> Option<Vector3<f64>> {
        let Some(moment) = moment else {
            self.foretold = Foretold::default();
            return None;
        };
        self.foretold.see(moment.tip_s, tip_m, moment.now_s)
    }
}

/// Speed of the reel whose cable pulls in `direction` (unit vector) at a tip of this velocity, m/s;
/// `None` where it is more than a setpoint may tell.
#[must_use]
pub fn reel_um_per_s(direction: &Vector3<f64>, velocity_m_per_s: &Vector3<f64>) -> Option<i32> {
    // A tip that moves towards the reel lets its cable go slack: the reel has to wind in.
    let speed = direction.dot(velocity_m_per_s) * 1e6;
    (speed.abs() <= f64::from(REEL_SPEED_MAX_UM_PER_S)).then(|| speed.round() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOWARDS: Vector3<f64> = Vector3::new(1.0, 0.0, 0.0);

    /// A tip that moves along x at 10 mm/s, its poses as told.
    fn speed(moment: impl Fn(f64) -> Option<Moment>, noise_m: f64) -> Option<i32> {
        let mut preview = Preview::default();
        let mut velocity = None;
        for n in 0..300 {
            let now_s = f64::from(n) * 0.01;
            let noise = if n % 2 == 0 { noise_m } else { -noise_m };
            let tip_m = Vector3::new(0.01 * now_s + noise, 0.1, 0.2);
            velocity = preview.see(tip_m, moment(now_s));
        }
        velocity.and_then(|velocity| reel_um_per_s(&TOWARDS, &velocity))
    }

    #[test]
    fn a_tip_that_comes_nearer_lets_the_reel_wind_in() {
        let now = |now_s| {
            Some(Moment {
                tip_s: now_s,
                now_s,
            })
        };
        let told = speed(now, 2e-6).unwrap();
        assert!((told - 10_000).abs() < 200, "{told}");
        let velocity = Vector3::new(0.01, 0.0, 0.0);
        assert_eq!(reel_um_per_s(&-TOWARDS, &velocity), Some(-10_000));
        assert_eq!(reel_um_per_s(&Vector3::y(), &velocity), Some(0));
    }

    #[test]
    fn a_pose_that_is_noisy_late_or_of_unknown_time_tells_nothing() {
        let now = |now_s| {
            Some(Moment {
                tip_s: now_s,
                now_s,
            })
        };
        assert_eq!(speed(now, 1e-4), None);
        let late = |now_s| {
            Some(Moment {
                tip_s: now_s - 0.1,
                now_s,
            })
        };
        assert_eq!(speed(late, 2e-6), None);
        assert_eq!(speed(|_| None, 2e-6), None);
    }

    #[test]
    fn what_no_setpoint_may_tell_is_not_told() {
        for speed in [f64::NAN, f64::INFINITY, 1.1, -1.1] {
            assert_eq!(reel_um_per_s(&TOWARDS, &(TOWARDS * speed)), None, "{speed}");
        }
        assert_eq!(reel_um_per_s(&TOWARDS, &-TOWARDS), Some(-1_000_000));
    }
}

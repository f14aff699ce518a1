//! Force profiles: the commanded force over time, drawn from a seed.
//!
//! Half waves of a cosine lead from one random turning point to the next, along a straight line, at
//! random peak rates. Force and rate are continuous; the profile begins and ends at zero force. The
//! turning points of a one-axis profile are uniform over both directions, those of a three-axes
//! profile uniform in a ball. Both sets are convex: no force between two turning points is larger
//! than the larger of them.

use super::file::Force;
use nalgebra::Vector3;
use robot::random::Random;
use std::f64::consts::PI;

/// Least way of a move as a part of the largest force: shorter ones are drawn again.
const LEAST_WAY: f64 = 0.1;

/// One half wave.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Move {
    start_s: f64,
    duration_s: f64,
    from_n: Vector3<f64>,
    to_n: Vector3<f64>,
}

/// See the module's page.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    moves: Vec<Move>,
}

impl Profile {
    /// Draws a profile of `duration_s`. The same force, seed and number give the same profile on
    /// every machine.
    #[must_use]
    pub fn new(force: &Force, seed: u64, number: u64, duration_s: f64) -> Self {
        let mut random = Random::stream(seed, "force profile", number);
        let largest_n = force.largest_n();
        let (slowest, fastest) = force.rates_n_per_s();
        let mut moves = Vec::new();
        let mut from_n = Vector3::zeros();
        let mut start_s = 0.0;
        let length_s = |way_n: f64, rate: f64| 0.5 * PI * way_n / rate;
        while start_s < duration_s {
            let rate = random.uniform(slowest, fastest);
            let to_n = loop {
                let point = turning_point(force, &mut random);
                if (point - from_n).norm() >= LEAST_WAY * largest_n {
                    break point;
                }
            };
            let move_s = length_s((to_n - from_n).norm(), rate);
            // The way home has to fit in after this move.
            if start_s + move_s + length_s(to_n.norm(), fastest) > duration_s {
                break;
            }
            moves.push(Move {
                start_s,
                duration_s: move_s,
                from_n,
                to_n,
            });
            start_s += move_s;
            from_n = to_n;
        }
        let left_s = (duration_s - start_s).max(1e-3);
        let home_s = left_s.min(length_s(from_n.norm(), slowest).max(1e-3));
        moves.push(Move {
            start_s,
            duration_s: home_s,
            from_n,
            to_n: Vector3::zeros(),
        });
        Self { moves }
    }

    /// The commanded force at a time, N, robot base frame; zero before and after.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        let index = self.moves.partition_point(|m| m.start_s <= t_s);
        let Some(m) = index.checked_sub(1).map(|i| &self.moves[i]) else {
            return Vector3::zeros();
        };
        let part = ((t_s - m.start_s) / m.duration_s).clamp(0.0, 1.0);
        m.from_n + (m.to_n - m.from_n) * (0.5 * (1.0 - libm::cos(PI * part)))
    }
}

fn turning_point(force: &Force, random: &mut Random) -> Vector3<f64> {
    let largest_n = force.largest_n();
    match force.axis() {
        Some(axis) => axis * random.uniform(-largest_n, largest_n),
        None => {
            let direction = loop {
                let v = Vector3::from_fn(|_, _| random.normal());
                if let Some(unit) = v.try_normalize(1e-6) {
                    break unit;
                }
            };
            direction * largest_n * random.unit().cbrt()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> Force {
        Force::ThreeAxes {
            largest_n: 3.0,
            slowest_n_per_s: 0.2,
            fastest_n_per_s: 1.0,
        }
    }

    fn one() -> Force {
        crate::Experiment::thesis().unwrap().force
    }

    #[test]
    fn profiles_stay_within_force_and_rate_and_end_at_zero() {
        for force in [one(), three()] {
            for seed in 0..5 {
                let profile = Profile::new(&force, seed, 1, 300.0);
                let mut before = profile.at(0.0);
                assert_eq!(before, Vector3::zeros());
                let mut largest = 0.0_f64;
                for n in 1..=30_000 {
                    let now = profile.at(f64::from(n) * 0.01);
                    let rate = (now - before).norm() / 0.01;
                    assert!(rate <= force.rates_n_per_s().1 * 1.0001, "{rate}");
                    assert!(now.norm() <= force.largest_n() * 1.000_001);
                    largest = largest.max(now.norm());
                    before = now;
                }
                assert!(before.norm() < 1e-9, "{before}");
                assert!(largest > 0.6 * force.largest_n(), "{largest}");
            }
        }
    }

    #[test]
    fn the_forces_of_a_long_one_axis_profile_go_both_ways_alike() {
        let profile = Profile::new(&one(), 7, 0, 10_800.0);
        let forces: Vec<f64> = (0..108_000)
            .map(|n| profile.at(f64::from(n) * 0.1).y)
            .collect();
        let mean = forces.iter().sum::<f64>() / forces.len() as f64;
        assert!(mean.abs() < 0.3, "{mean}");
        for low in [-4.5, -3.0, -1.5, 0.0, 1.5, 3.0] {
            let share = forces
                .iter()
                .filter(|f| (low..low + 1.5).contains(*f))
                .count();
            assert!(share > 8_000, "{low}: {share}");
        }
        assert!(forces.iter().all(|f| f.abs() <= 4.5));
    }

    #[test]
    fn a_profile_repeats_and_another_number_is_another_one() {
        let force = three();
        let at = |number| Profile::new(&force, 1, number, 60.0).at(20.0);
        assert_eq!(at(1), at(1));
        assert_ne!(at(1), at(2));
    }
}

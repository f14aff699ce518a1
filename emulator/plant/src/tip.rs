//! The robot's tip: a prescribed path, ramped in and out, and the little that it gives way; or a
//! model of a robot that a caller brings ([`TipModel`]).

use crate::config::{PathConfig, PlantConfig};
use crate::vector::{add, dot, norm, scale, sub, Vec3};
use nalgebra::{Matrix3, Vector3};
use random::SplitMix64;
use std::any::Any;
use std::f64::consts::TAU;
use std::fmt::Debug;

/// A robot that holds the cables' ends in place of the prescribed path of the configuration.
///
/// The plant calls [`TipModel::step`] once per grid step with the force that acted on the tip at
/// the step's start; the cables follow the position after it. So forces move the tip and the tip
/// moves the cables, on one grid, whatever drives the plant.
pub trait TipModel: Any + Debug + Send {
    /// Moves on by `h_s`. `moving`: the robot has a command to follow its path. `force_n`: force on
    /// the tip, robot frame, N, cables and payload.
    fn step(&mut self, h_s: f64, moving: bool, force_n: Vec3);

    /// Position of the tip, robot frame, m.
    fn position_m(&self) -> Vec3;

    /// Velocity of the tip, robot frame, m/s.
    fn velocity_m_per_s(&self) -> Vec3;

    /// A copy, for a copy of the plant.
    fn boxed_clone(&self) -> Box<dyn TipModel>;
}

/// A ring that no robot holds: it hangs in the cables, with a weight on it.
#[derive(Clone, Debug)]
struct Loose {
    mass_kg: f64,
    position_m: Vec3,
    velocity_m_per_s: Vec3,
}

/// Least mass of what hangs in the cables, kg: the ring in which they end (estimate).
const RING_KG: f64 = 0.010;
/// Damping of the ring, N s/m. A weight of 500 g swings out within a second (estimate: friction of
/// the cord and the hand that steadies it).
const RING_DAMPING_N_S_PER_M: f64 = 2.0;

impl TipModel for Loose {
    fn step(&mut self, h_s: f64, _moving: bool, force_n: Vec3) {
        // Implicit in the damping, which a light ring with a long step would overshoot.
        let damped = 1.0 / (1.0 + RING_DAMPING_N_S_PER_M * h_s / self.mass_kg);
        let pushed = add(self.velocity_m_per_s, scale(force_n, h_s / self.mass_kg));
        self.velocity_m_per_s = scale(pushed, damped);
        self.position_m = add(self.position_m, scale(self.velocity_m_per_s, h_s));
    }

    fn position_m(&self) -> Vec3 {
        self.position_m
    }

    fn velocity_m_per_s(&self) -> Vec3 {
        self.velocity_m_per_s
    }

    fn boxed_clone(&self) -> Box<dyn TipModel> {
        Box::new(self.clone())
    }
}

/// `amplitude sin(omega s + phase)`.
#[derive(Clone, Debug)]
struct Sinusoid {
    amplitude_m: f64,
    omega_rad_per_s: f64,
    phase_rad: f64,
}

/// A path as a function of path time `s` in s, about the workspace centre.
#[derive(Clone, Debug)]
enum Path {
    Random {
        axes: [Vec<Sinusoid>; 3],
        spline: Spline,
    },
    Sweep {
        direction: Vec3,
        amplitude_m: f64,
        speed_m_per_s: f64,
    },
    Fixed(Vec3),
}

/// One span of a cubic Hermite spline through the exact path: sines are evaluated once a knot, not
/// once a step. With knots at most 0.05 rad of the fastest sine apart the error is below 2e-8 of
/// its amplitude.
#[derive(Clone, Debug)]
struct Spline {
    knot_s: f64,
    index: Option<u64>,
    start: (Vec3, Vec3),
    end: (Vec3, Vec3),
}

fn sum_of_sinusoids(axes: &[Vec<Sinusoid>; 3], s: f64) -> (Vec3, Vec3) {
    let mut position = [0.0; 3];
    let mut velocity = [0.0; 3];
    for (k, axis) in axes.iter().enumerate() {
        for w in axis {
            let (sin, cos) = libm::sincos(w.omega_rad_per_s * s + w.phase_rad);
            position[k] += w.amplitude_m * sin;
            velocity[k] += w.amplitude_m * w.omega_rad_per_s * cos;
        }
    }
    (position, velocity)
}

impl Path {
    fn new(config: &PathConfig, seed: u64) -> Self {
        match config {
            PathConfig::Random(p) => {
                let mut axes: [Vec<Sinusoid>; 3] = Default::default();
                for (k, axis) in axes.iter_mut().enumerate() {
                    let mut rng = SplitMix64::stream(seed, "path", k);
                    let weights: Vec<f64> =
                        (0..p.harmonics).map(|_| rng.uniform(0.4, 1.0)).collect();
                    let total: f64 = weights.iter().sum();
                    for (i, weight) in weights.iter().enumerate() {
                        // One frequency from each of equal log bands, so that none coincide.
                        let band = (i as f64 + rng.unit()) / p.harmonics as f64;
                        axis.push(Sinusoid {
                            amplitude_m: p.half_extent_m[k] * weight / total,
                            omega_rad_per_s: libm::pow(p.period_ratio, band),
                            phase_rad: rng.uniform(0.0, TAU),
                        });
                    }
                }
                // Amplitudes fix the box; one factor on all frequencies fixes the speed.
                let mean_square: f64 = axes
                    .iter()
                    .flatten()
                    .map(|w| 0.5 * (w.amplitude_m * w.omega_rad_per_s).powi(2))
                    .sum();
                let factor = if mean_square > 0.0 {
                    p.rms_speed_m_per_s / mean_square.sqrt()
                } else {
                    0.0
                };
                let mut fastest = 0.0_f64;
                for w in axes.iter_mut().flatten() {
                    w.omega_rad_per_s *= factor;
                    fastest = fastest.max(w.omega_rad_per_s);
                }
                Self::Random {
                    axes,
                    spline: Spline {
                        knot_s: (0.05 / fastest.max(1e-9)).min(5e-3),
                        index: None,
                        start: ([0.0; 3], [0.0; 3]),
                        end: ([0.0; 3], [0.0; 3]),
                    },
                }
            }
            PathConfig::Sweep(p) => Self::Sweep {
                direction: scale(p.direction, 1.0 / norm(p.direction)),
                amplitude_m: p.amplitude_m,
                speed_m_per_s: p.speed_m_per_s,
            },
            PathConfig::Fixed(p) => Self::Fixed(p.offset_m),
        }
    }

    /// Offset from the centre and its derivative by path time.
    #[inline]
    fn at(&mut self, s: f64) -> (Vec3, Vec3) {
        match self {
            Self::Random { axes, spline } => {
                let index = (s / spline.knot_s) as u64;
                if spline.index != Some(index) {
                    let at = |i: u64| sum_of_sinusoids(axes, i as f64 * spline.knot_s);
                    spline.start = at(index);
                    spline.end = at(index + 1);
                    spline.index = Some(index);
                }
                let h = spline.knot_s;
                let t = s / h - index as f64;
                let (p0, v0) = spline.start;
                let (p1, v1) = spline.end;
                let mut position = [0.0; 3];
                let mut velocity = [0.0; 3];
                for k in 0..3 {
                    let rise = p1[k] - p0[k];
                    let a = h * v0[k] - rise;
                    let b = rise - h * v1[k];
                    position[k] = p0[k] + t * rise + t * (1.0 - t) * ((1.0 - t) * a + t * b);
                    velocity[k] = (rise
                        + (1.0 - 2.0 * t) * ((1.0 - t) * a + t * b)
                        + t * (1.0 - t) * (b - a))
                        / h;
                }
                (position, velocity)
            }
            Self::Sweep {
                direction,
                amplitude_m,
                speed_m_per_s,
            } => {
                // Distance along a triangle wave that starts at the centre going forward.
                let turn = (*speed_m_per_s * s / (4.0 * *amplitude_m) + 0.25).fract();
                let (offset, sign) = if turn < 0.5 {
                    (4.0 * turn - 1.0, 1.0)
                } else {
                    (3.0 - 4.0 * turn, -1.0)
                };
                (
                    scale(*direction, offset * *amplitude_m),
                    scale(*direction, sign * *speed_m_per_s),
                )
            }
            Self::Fixed(offset) => (*offset, [0.0; 3]),
        }
    }
}

/// What holds the cables' ends, and where it is.
#[derive(Debug)]
pub(crate) struct Tip {
    holder: Holder,
    /// Position, robot frame, m.
    pub position_m: Vec3,
    /// Velocity, m/s; of a prescribed path without that of giving way.
    pub velocity_m_per_s: Vec3,
}

#[derive(Debug)]
enum Holder {
    Path(Box<PathTip>),
    Model(Box<dyn TipModel>),
    /// Nothing; beside it where the robot let go, m.
    Nothing(Loose, Vec3),
}

impl Clone for Tip {
    fn clone(&self) -> Self {
        Self {
            holder: match &self.holder {
                Holder::Path(path) => Holder::Path(path.clone()),
                Holder::Model(model) => Holder::Model(model.boxed_clone()),
                Holder::Nothing(ring, robot_m) => Holder::Nothing(ring.clone(), *robot_m),
            },
            ..*self
        }
    }
}

impl Tip {
    /// A tip on the path of the configuration.
    pub fn new(config: &PlantConfig, seed: u64) -> Self {
        let path = PathTip::new(config, seed);
        Self {
            position_m: path.position_m,
            velocity_m_per_s: path.velocity_m_per_s,
            holder: Holder::Path(Box::new(path)),
        }
    }

    /// A tip that a model moves.
    pub fn with_model(model: Box<dyn TipModel>) -> Self {
        Self {
            position_m: model.position_m(),
            velocity_m_per_s: model.velocity_m_per_s(),
            holder: Holder::Model(model),
        }
    }

    /// The model, where one moves the tip.
    pub fn model_mut(&mut self) -> Option<&mut dyn TipModel> {
        match &mut self.holder {
            Holder::Path(_) | Holder::Nothing(..) => None,
            Holder::Model(model) => Some(model.as_mut()),
        }
    }

    /// Lets the tip go, with a weight of so many newtons, or exchanges that weight. `false`: a
    /// model holds the tip, and keeps it.
    pub fn let_go(&mut self, weight_n: f64, gravity_m_per_s2: f64) -> bool {
        let robot_m = match self.holder {
            Holder::Model(_) => return false,
            Holder::Path(_) => self.position_m,
            Holder::Nothing(_, robot_m) => robot_m,
        };
        let ring = Loose {
            mass_kg: (weight_n / gravity_m_per_s2).max(RING_KG),
            position_m: self.position_m,
            velocity_m_per_s: self.velocity_m_per_s,
        };
        self.holder = Holder::Nothing(ring, robot_m);
        true
    }

    /// Where the robot says that its tip is and how fast it is: it stands where it let the tip go.
    pub fn robot_says(&self) -> (Vec3, Vec3) {
        match self.holder {
            Holder::Nothing(_, robot_m) => (robot_m, [0.0; 3]),
            _ => (self.position_m, self.velocity_m_per_s),
        }
    }

    /// Moves on by `h_s`, with `force_n` on the tip.
    #[inline]
    pub fn step(&mut self, h_s: f64, moving: bool, force_n: Vec3) {
        match &mut self.holder {
            Holder::Path(path) => {
                path.step(h_s, moving, force_n);
                self.position_m = path.position_m;
                self.velocity_m_per_s = path.velocity_m_per_s;
            }
            Holder::Model(model) => {
                model.step(h_s, moving, force_n);
                self.position_m = model.position_m();
                self.velocity_m_per_s = model.velocity_m_per_s();
            }
            Holder::Nothing(ring, _) => {
                ring.step(h_s, moving, force_n);
                self.position_m = ring.position_m;
                self.velocity_m_per_s = ring.velocity_m_per_s;
            }
        }
    }
}

/// The state of a tip on its path.
#[derive(Clone, Debug)]
struct PathTip {
    path: Path,
    center_m: Vec3,
    ramp_rate_per_s: f64,
    compliance_m_per_n: f64,
    /// See [`toward`].
    toward: [Vec3; 3],
    /// 0 standing, 1 at full speed.
    ramp: f64,
    path_time_s: f64,
    give_m: Vec3,
    /// Position, robot frame, m.
    position_m: Vec3,
    /// Velocity along the path, m/s, without that of giving way: fed back into the cables' damping
    /// within one step it would make an algebraic loop.
    velocity_m_per_s: Vec3,
}

impl PathTip {
    fn new(plant: &PlantConfig, seed: u64) -> Self {
        let config = &plant.robot;
        let mut path = Path::new(&config.path, seed);
        let start = path.at(0.0).0;
        Self {
            path,
            center_m: config.workspace_center_m,
            // A ramp without duration takes one step: the next step has full speed.
            ramp_rate_per_s: 1.0 / config.ramp_s.max(1e-9),
            compliance_m_per_n: config.tip_compliance_m_per_n,
            toward: toward(plant),
            ramp: 0.0,
            path_time_s: 0.0,
            give_m: [0.0; 3],
            position_m: add(config.workspace_center_m, start),
            velocity_m_per_s: [0.0; 3],
        }
    }

    #[inline]
    fn step(&mut self, h_s: f64, moving: bool, force_n: Vec3) {
        let change = self.ramp_rate_per_s * h_s;
        self.ramp = if moving {
            (self.ramp + change).min(1.0)
        } else {
            (self.ramp - change).max(0.0)
        };
        // Smooth start from standstill: no jump in velocity, none in acceleration.
        let r = self.ramp;
        let pace = r * r * r * (r * (6.0 * r - 15.0) + 10.0);
        self.path_time_s += pace * h_s;
        let (offset, rate) = self.path.at(self.path_time_s);
        self.position_m = add(self.center_m, offset);
        self.velocity_m_per_s = scale(rate, pace);
        if self.compliance_m_per_n > 0.0 {
            let target = scale(force_n, self.compliance_m_per_n);
            let off_m = sub(target, self.give_m);
            let move_m = self.toward.map(|row| dot(row, off_m));
            self.give_m = add(self.give_m, move_m);
            self.position_m = add(self.position_m, self.give_m);
        }
    }
}

/// How much of its way to `compliance x force` a tip that gives goes in a step, as the rows of a
/// matrix: what relaxes in it, exact for a force that does not change, and at most to where the
/// force of taut cables, which falls over the way, is balanced. Some mm/N are a hundred times the
/// give of the cables, and a longer way would swing.
fn toward(plant: &PlantConfig) -> [Vec3; 3] {
    let robot = &plant.robot;
    let relaxes = 1.0 - libm::exp(-(plant.step_ns as f64) * 1e-9 / robot.tip_relaxation_s);
    let mut stiffness = Matrix3::zeros();
    for place in &plant.units {
        let cable = Vector3::from(place.position_m) - Vector3::from(robot.workspace_center_m);
        let pull = cable.normalize();
        stiffness += pull * pull.transpose() * (plant.cable.axial_stiffness_n / cable.norm());
    }
    let eigen = stiffness.symmetric_eigen();
    let part = eigen
        .eigenvalues
        .map(|n_per_m| relaxes.min(1.0 / (1.0 + robot.tip_compliance_m_per_n * n_per_m.max(0.0))));
    let rows = eigen.eigenvectors * Matrix3::from_diagonal(&part) * eigen.eigenvectors.transpose();
    rows.transpose().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{RandomPath, SweepPath};

    #[test]
    fn random_path_keeps_its_box_and_its_speed() {
        let config = RandomPath::default();
        let mut path = Path::new(&PathConfig::Random(config.clone()), 11);
        let (mut square, mut reach) = (0.0, 0.0_f64);
        let count = 400_000;
        for i in 0..count {
            let (position, velocity) = path.at(f64::from(i) * 0.01);
            square += norm(velocity).powi(2);
            reach = position.iter().fold(reach, |m, p| m.max(p.abs()));
        }
        let rms = (square / f64::from(count)).sqrt();
        assert!((rms / config.rms_speed_m_per_s - 1.0).abs() < 0.02, "{rms}");
        assert!(reach <= config.half_extent_m[0] + 1e-9, "{reach}");
        assert!(reach > 0.7 * config.half_extent_m[0], "{reach}");
    }

    #[test]
    fn spline_follows_the_exact_sines() {
        let mut path = Path::new(&PathConfig::default(), 5);
        for i in 0..5_000 {
            let s = f64::from(i) * 0.00137;
            let (position, velocity) = path.at(s);
            let Path::Random { axes, .. } = &path else {
                unreachable!()
            };
            let (exact, exact_velocity) = sum_of_sinusoids(axes, s);
            assert!(norm(sub(position, exact)) < 1e-11);
            assert!(norm(sub(velocity, exact_velocity)) < 1e-8);
        }
    }

    #[test]
    fn velocity_is_the_derivative_of_position_while_ramping() {
        let mut tip = Tip::new(&PlantConfig::default(), 2);
        let h = 50e-6;
        let mut largest_step = 0.0_f64;
        for i in 0..60_100 {
            let before = tip.clone();
            tip.step(h, i < 40_000, [0.0; 3]);
            let mean = scale(add(before.velocity_m_per_s, tip.velocity_m_per_s), 0.5);
            let moved = scale(sub(tip.position_m, before.position_m), 1.0 / h);
            assert!(norm(sub(mean, moved)) < 1e-5);
            let jump = norm(sub(tip.velocity_m_per_s, before.velocity_m_per_s));
            largest_step = largest_step.max(jump);
        }
        assert!(largest_step < 1e-5, "{largest_step}");
        assert_eq!(tip.velocity_m_per_s, [0.0; 3]);
    }

    #[test]
    fn sweep_turns_at_its_amplitude() {
        let mut path = Path::new(
            &PathConfig::Sweep(SweepPath {
                direction: [0.0, 2.0, 0.0],
                amplitude_m: 0.01,
                speed_m_per_s: 0.005,
            }),
            0,
        );
        assert!(norm(path.at(0.0).0) < 1e-15);
        assert!((path.at(1.0).0[1] - 0.005).abs() < 1e-12);
        assert!((path.at(3.0).0[1] - 0.005).abs() < 1e-12);
        assert_eq!(path.at(3.0).1, [0.0, -0.005, 0.0]);
    }
}

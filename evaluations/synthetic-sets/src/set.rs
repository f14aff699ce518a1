//! Puts a set together: several logs of one rig with the same undeclared effects, usually in all of
//! them.

use crate::effect::{scale, AtWork, Effect, Kind};
use crate::excitation::{draw, Drive, SHAFT_RAD_PER_M, STEP_S};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// What to generate.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Effects, none to three.
    pub kinds: Vec<Kind>,
    /// RMS of each effect as a multiple of the noise's.
    pub strength: f64,
    /// Whether a controller on the measured force drives the command.
    pub closed_loop: bool,
    /// What is unusual about the logs.
    pub circumstance: Circumstance,
    /// Seed of everything.
    pub seed: u64,
}

/// What is unusual about the logs of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Circumstance {
    /// Nothing.
    Usual,
    /// A row each 14 ms, stamped in steps of 10 ms.
    CoarseTime,
    /// The reel turns back once or twice in a log.
    FewReversals,
    /// Five rows in a second.
    SlowRows,
    /// The effects act in the second log only.
    OneLog,
    /// The effects begin in the middle of each log.
    FromTheMiddle,
}

impl Circumstance {
    /// All but the usual one.
    pub const UNUSUAL: [Self; 5] = [
        Self::CoarseTime,
        Self::FewReversals,
        Self::SlowRows,
        Self::OneLog,
        Self::FromTheMiddle,
    ];

    /// In words, behind the name of an effect.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Usual => "",
            Self::CoarseTime => "stamps in steps of 10 ms",
            Self::FewReversals => "few reversals",
            Self::SlowRows => "5 rows a second",
            Self::OneLog => "in one log only",
            Self::FromTheMiddle => "from the middle of each log",
        }
    }

    /// Lines of the reel's path, in hertz.
    const fn path_hz(self) -> (f64, f64) {
        match self {
            Self::FewReversals => (0.006, 0.03),
            _ => (0.04, 0.45),
        }
    }

    /// Steps of the generator's clock from row to row; `drawn` where nothing is unusual about them.
    const fn every(self, drawn: u32) -> u32 {
        match self {
            Self::CoarseTime => 7,
            Self::SlowRows => 100,
            _ => drawn,
        }
    }

    /// The stamp of a row, in seconds.
    fn stamp(self, t: f64) -> f64 {
        match self {
            Self::CoarseTime => (t * 100.0 + 1e-6).floor() / 100.0,
            _ => t,
        }
    }

    /// Whether the effects act in a log at a share of its length.
    fn acts(self, log: usize, share: f64) -> bool {
        match self {
            Self::OneLog => log == 1,
            Self::FromTheMiddle => share >= 0.5,
            _ => true,
        }
    }
}

/// One log: columns of equal length.
#[derive(Debug, Clone, Default)]
pub struct Log {
    /// Time in seconds.
    pub time_s: Vec<f64>,
    /// Measured force in newtons: the target.
    pub force_n: Vec<f64>,
    /// Commanded force in newtons.
    pub command_n: Vec<f64>,
    /// Shaft speed in rad/s, exactly zero at rest.
    pub speed_rad_s: Vec<f64>,
    /// Shaft angle in radians.
    pub angle_rad: Vec<f64>,
    /// Temperature in degrees Celsius.
    pub temperature_c: Vec<f64>,
    /// Force of the neighbouring unit in newtons.
    pub neighbour_n: Vec<f64>,
}

impl Log {
    /// Names of the columns, in the order of [`Log::columns`].
    pub const NAMES: [&'static str; 7] = [
        "time_s",
        "force_n",
        "command_n",
        "speed_rad_s",
        "angle_rad",
        "temperature_c",
        "neighbour_n",
    ];

    /// The columns.
    #[must_use]
    pub fn columns(&self) -> [&[f64]; 7] {
        [
            &self.time_s,
            &self.force_n,
            &self.command_n,
            &self.speed_rad_s,
            &self.angle_rad,
            &self.temperature_c,
            &self.neighbour_n,
        ]
    }

    /// The log as CSV text with a header.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = Self::NAMES.join(",");
        for row in 0..self.time_s.len() {
            text.push('\n');
            let cells: Vec<String> = self
                .columns()
                .iter()
                .map(|column| format!("{:.6}", column[row]))
                .collect();
            text.push_str(&cells.join(","));
        }
        text.push('\n');
        text
    }
}

/// What was done to a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// The effects with their parameters.
    pub effects: Vec<Effect>,
    /// RMS of everything undeclared in the logged rows, in newtons.
    pub effect_rms_n: f64,
    /// RMS of the noise, in newtons: what a perfect model leaves.
    pub noise_rms_n: f64,
    /// Rows a second.
    pub rate_hz: f64,
}

/// Logs and what is in them.
#[derive(Debug, Clone)]
pub struct Set {
    /// One log for each group.
    pub logs: Vec<Log>,
    /// What was done.
    pub truth: Truth,
}

/// Generates a set.
#[must_use]
pub fn generate(recipe: &Recipe) -> Set {
    let mut rng = ChaCha12Rng::seed_from_u64(recipe.seed);
    let groups = rng.random_range(5..=7);
    let seconds = rng.random_range(50.0..80.0);
    let unusual = recipe.circumstance;
    let every = unusual.every([5, 10, 25][rng.random_range(0..3)]);
    let noise_n = 0.02 * 4f64.powf(rng.random::<f64>());
    let drives: Vec<Drive> = (0..groups)
        .map(|_| draw(&mut rng, seconds, unusual.path_hz()))
        .collect();
    let mut effects: Vec<Effect> = recipe
        .kinds
        .iter()
        .map(|kind| Effect::draw(*kind, &mut rng))
        .collect();
    for effect in &mut effects {
        scale(effect, &drives, recipe.strength * noise_n);
    }
    let mut sums = Sums::default();
    let logs = drives
        .iter()
        .enumerate()
        .map(|(index, drive)| {
            log(
                (index, drive),
                &effects,
                recipe,
                noise_n,
                every,
                &mut rng,
                &mut sums,
            )
        })
        .collect();
    let truth = Truth {
        effects,
        effect_rms_n: (sums.effect / sums.rows).sqrt(),
        noise_rms_n: (sums.noise / sums.rows).sqrt(),
        rate_hz: 1.0 / (STEP_S * f64::from(every)),
    };
    Set { logs, truth }
}

/// Squares added up over the rows of a set.
#[derive(Debug, Default)]
struct Sums {
    effect: f64,
    noise: f64,
    rows: f64,
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Runs one log: controller, effects, noise, logger.
fn log(
    (index, drive): (usize, &Drive),
    effects: &[Effect],
    recipe: &Recipe,
    noise_n: f64,
    every: u32,
    rng: &mut impl Rng,
    sums: &mut Sums,
) -> Log {
    let mut work = AtWork::new(effects);
    let mut commands: Vec<f64> = Vec::with_capacity(drive.setpoint_n.len());
    let mut out = Log::default();
    // Noise at the logger's rate: two parts white, one part first-order with 0.1 s.
    let dt = STEP_S * f64::from(every);
    let keep = (-dt / 0.1).exp();
    let (white_n, slow_n) = (noise_n * 0.8f64.sqrt(), noise_n * 0.2f64.sqrt());

    let mut slow = slow_n * normal(rng);
    let mut integral = 0.0;
    let mut correction = 0.0;
    for k in 0..drive.setpoint_n.len() {
        commands.push(drive.setpoint_n[k] + correction);
        let share = k as f64 / drive.setpoint_n.len() as f64;
        let effect = match recipe.circumstance.acts(index, share) {
            true => work.force(k, drive, &commands),
            false => 0.0,
        };
        if k % every as usize != 0 {
            continue;
        }
        slow = keep * slow + slow_n * (1.0 - keep * keep).sqrt() * normal(rng);
        let noise = white_n * normal(rng) + slow;
        // The converter's step.
        let force = ((commands[k] + effect + noise) / 0.002).round() * 0.002;
        if recipe.closed_loop {
            let error = drive.setpoint_n[k] - force;
            integral = (integral + 2.0 * error * dt).clamp(-3.0, 3.0);
            correction = 0.3 * error + integral;
        }
        sums.effect += effect * effect;
        sums.noise += (force - commands[k] - effect).powi(2);
        sums.rows += 1.0;
        let speed = drive.speed_m_s[k] * SHAFT_RAD_PER_M;
        let speed_noise = if speed == 0.0 {
            0.0
        } else {
            0.01 * normal(rng)
        };
        out.time_s
            .push(recipe.circumstance.stamp(k as f64 * STEP_S));
        out.force_n.push(force);
        out.command_n.push(commands[k]);
        out.speed_rad_s.push(speed + speed_noise);
        out.angle_rad.push(drive.travel_m[k] * SHAFT_RAD_PER_M);
        out.temperature_c
            .push(drive.temperature_c[k] + 0.02 * normal(rng));
        out.neighbour_n
            .push(drive.neighbour_n[k] + 0.01 * normal(rng));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipe(kinds: &[Kind], seed: u64) -> Recipe {
        Recipe {
            kinds: kinds.to_vec(),
            strength: 1.0,
            closed_loop: false,
            circumstance: Circumstance::Usual,
            seed,
        }
    }

    #[test]
    fn every_effect_has_the_given_size() {
        let all = Kind::KNOWN.into_iter().chain(Kind::UNCATALOGUED);
        for kind in all.chain(Kind::IMPURE) {
            let truth = generate(&recipe(&[kind], 7)).truth;
            let ratio = truth.effect_rms_n / truth.noise_rms_n;
            assert!(
                (ratio - 1.0).abs() < 0.06,
                "{}: effect {ratio:.3} times the noise",
                kind.name()
            );
        }
    }

    #[test]
    fn a_set_without_effect_is_the_command_and_noise() {
        let set = generate(&recipe(&[], 3));
        assert_eq!(set.truth.effect_rms_n, 0.0);
        let (mut sum, mut n) = (0.0, 0.0);
        for log in &set.logs {
            for (force, command) in log.force_n.iter().zip(&log.command_n) {
                sum += (force - command).powi(2);
                n += 1.0;
            }
        }
        let rms = (sum / f64::from(n as u32)).sqrt();
        assert!((rms / set.truth.noise_rms_n - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_seed_is_a_set() {
        let a = generate(&recipe(&[Kind::Coulomb], 11));
        let b = generate(&recipe(&[Kind::Coulomb], 11));
        let c = generate(&recipe(&[Kind::Coulomb], 12));
        assert_eq!(a.logs[0].to_csv(), b.logs[0].to_csv());
        assert_ne!(a.logs[0].to_csv(), c.logs[0].to_csv());
    }

    #[test]
    fn reels_run_both_ways_and_stand_still() {
        let set = generate(&recipe(&[], 5));
        for log in &set.logs {
            let share = |counts: fn(&f64) -> bool| {
                log.speed_rad_s.iter().filter(|v| counts(v)).count() as f64
                    / log.speed_rad_s.len() as f64
            };
            assert!(share(|v| *v > 1.0) > 0.1 && share(|v| *v < -1.0) > 0.1);
            assert!(share(|v| *v == 0.0) > 0.02, "no rest");
        }
    }

    #[test]
    fn an_unusual_log_is_what_it_is_called() {
        let of = |circumstance| {
            generate(&Recipe {
                circumstance,
                strength: 3.0,
                ..recipe(&[Kind::Offset], 4)
            })
        };
        let coarse = of(Circumstance::CoarseTime);
        let steps: Vec<f64> = (coarse.logs[0].time_s.windows(2))
            .map(|w| ((w[1] - w[0]) * 1e3).round())
            .collect();
        assert!(steps.iter().all(|s| [10.0, 20.0].contains(s)));
        assert!(steps.contains(&10.0) && steps.contains(&20.0));
        let reversals = |set: &Set| -> usize {
            let of_log = |log: &Log| {
                let moving: Vec<f64> = (log.speed_rad_s.iter().copied())
                    .filter(|v| v.abs() > 0.1)
                    .collect();
                moving.windows(2).filter(|w| w[0] * w[1] < 0.0).count()
            };
            set.logs.iter().map(of_log).max().unwrap()
        };
        let few = reversals(&of(Circumstance::FewReversals));
        assert!(few <= 4, "{few} reversals");
        assert!(reversals(&of(Circumstance::Usual)) > 8);
        assert_eq!(of(Circumstance::SlowRows).truth.rate_hz, 5.0);
        // The mean error of each half of each log.
        let halves = |set: &Set| -> Vec<[f64; 2]> {
            let of_log = |log: &Log| {
                let error = |r: std::ops::Range<usize>| {
                    let n = r.len() as f64;
                    r.map(|i| log.force_n[i] - log.command_n[i]).sum::<f64>() / n
                };
                let n = log.force_n.len();
                [error(0..n / 2), error(n / 2 + 1..n)]
            };
            set.logs.iter().map(of_log).collect()
        };
        let one = of(Circumstance::OneLog);
        let size = 0.5 * one.truth.effects[0].size;
        for (k, means) in halves(&one).into_iter().enumerate() {
            assert_eq!(means.map(|m| m > size), [k == 1; 2], "{means:?}");
        }
        for means in halves(&of(Circumstance::FromTheMiddle)) {
            assert_eq!(means.map(|m| m > size), [false, true], "{means:?}");
        }
    }

    #[test]
    fn a_controller_hides_the_effect_from_the_force() {
        let open = generate(&Recipe {
            strength: 3.0,
            ..recipe(&[Kind::Offset], 2)
        });
        let closed = generate(&Recipe {
            strength: 3.0,
            closed_loop: true,
            ..recipe(&[Kind::Offset], 2)
        });
        let lift = |set: &Set| {
            let log = &set.logs[0];
            log.command_n.iter().sum::<f64>() / log.command_n.len() as f64
        };
        assert!(lift(&closed) < lift(&open) - open.truth.effect_rms_n * 0.5);
    }
}

//! A set: several runs whose declared model lacks chosen effects of a chosen size.

use crate::effects::{sensor, Effect, Stage, CATALOGUE};
use crate::excitation::{self, Limits, Measured};
use crate::fit::{rms, Basis};
use crate::noise::{scale_to_rms, Colour};
use crate::parameters::{Parameters, Scene};
use crate::random::Random;
use crate::world::World;
use crate::{steps_per_row, FULL_SCALE_N};
use serde_json::{json, Value};

/// Slowest and fastest row rate in Hz.
pub const RATES_HZ: [f64; 2] = [20.0, 320.0];

/// Smallest and largest RMS of the noise in N.
pub const NOISES_N: [f64; 2] = [0.001, 0.060];

/// Velocity in rad/s below which the declared model takes the reel as at rest.
pub const DEADBAND_RAD_S: f64 = 0.02;

/// Velocity in rad/s that rounds the declared Coulomb friction.
const FRICTION_ROUNDING_RAD_S: f64 = 0.2;

/// Largest RMS of the noise of the logged velocity in rad/s.
const SPEED_NOISE_RAD_S: f64 = 0.003;

/// Time in s that the logger's clock shows at the first row.
const CLOCK_START_S: f64 = 1.0;

/// A declared model, as the user of the rig has it. Its terms are smooth functions of the logged columns and are
/// exactly true, so an empty set lacks nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    /// The force as commanded.
    Bare,
    /// A fitted gain of the command, and an offset.
    Gain,
    /// The command, an offset, viscous friction.
    Viscous,
    /// As `Viscous`, and Coulomb friction rounded near rest.
    Friction,
    /// The command, an offset, and a spring over the angle.
    Spring,
}

/// One term of a declared model.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Name in the model file.
    pub name: &'static str,
    /// Expression in the model file.
    pub expr: String,
    /// Unit of the coefficient.
    pub unit: &'static str,
    /// True for a coefficient that the model file fixes.
    pub fixed: bool,
    /// True coefficient, in `unit`.
    pub coefficient: f64,
}

impl Declared {
    /// Models that any set may have.
    const COMMON: [Self; 4] = [Self::Bare, Self::Gain, Self::Viscous, Self::Friction];

    /// The terms with their true coefficients.
    fn terms(self, random: &mut Random) -> Vec<Term> {
        let term = |name, expr: &str, unit, fixed, coefficient| Term {
            name,
            expr: expr.to_string(),
            unit,
            fixed,
            coefficient,
        };
        let gain = random.uniform(0.95, 1.05);
        let offset = random.uniform(-0.05, 0.05);
        let viscous = random.uniform(-0.08, -0.01);
        let friction = random.uniform(-0.3, -0.05);
        let mut terms = vec![term("force as commanded", "command", "-", true, 1.0)];
        if self == Self::Gain {
            terms = vec![term("gain of the command", "command", "-", false, gain)];
        }
        if self != Self::Bare {
            terms.push(term("offset", "1", "N", false, offset));
        }
        if matches!(self, Self::Viscous | Self::Friction) {
            terms.push(term(
                "viscous friction",
                "velocity",
                "N s/rad",
                false,
                viscous,
            ));
        }
        if self == Self::Friction {
            let expr = format!("tanh(velocity / {FRICTION_ROUNDING_RAD_S})");
            terms.push(term("dry friction", &expr, "N", false, friction));
        }
        if self == Self::Spring {
            // The effect `backlash` brings the spring itself, on the other side of its play.
            terms.push(term("return spring", "angle", "N/rad", false, 0.0));
        }
        terms
    }
}

impl Term {
    /// Largest change of the force with the velocity in N s/rad.
    fn slope(&self) -> f64 {
        match self.name {
            "viscous friction" => self.coefficient.abs(),
            "dry friction" => self.coefficient.abs() / FRICTION_ROUNDING_RAD_S,
            _ => 0.0,
        }
    }

    /// The term without its coefficient.
    fn value(&self, command: f64, velocity: f64, angle: f64) -> f64 {
        match self.name {
            "offset" => 1.0,
            "viscous friction" => velocity,
            "dry friction" => (velocity / FRICTION_ROUNDING_RAD_S).tanh(),
            "return spring" => angle,
            _ => command,
        }
    }
}

/// What a set is to contain.
#[derive(Clone, Debug)]
pub struct Request {
    /// Seed of everything.
    pub seed: u64,
    /// Effects that the declared model lacks; empty for an empty set.
    pub effects: Vec<&'static Effect>,
    /// RMS of each effect after the best fit of the declared model, over the RMS of the noise. 0: nothing is missing.
    pub size: f64,
    /// Rows per second.
    pub rate_hz: f64,
    /// RMS of the noise in N; drawn log-uniform from [`NOISES_N`] if `None`.
    pub noise_n: Option<f64>,
    /// Runs; drawn from 4 to 8 if `None`.
    pub runs: Option<usize>,
    /// Duration of each run in s; drawn from 40 to 90 for each run if `None`.
    pub duration_s: Option<f64>,
    /// Measured logs to take motion and command from.
    pub excitation: Option<Measured>,
    /// Whether to look for effects that describe the same force.
    pub compare: bool,
}

impl Request {
    /// A request with everything drawn.
    pub fn new(seed: u64, effects: Vec<&'static Effect>, size: f64, rate_hz: f64) -> Self {
        Self {
            seed,
            effects,
            size,
            rate_hz,
            noise_n: None,
            runs: None,
            duration_s: None,
            excitation: None,
            compare: true,
        }
    }

    fn check(&self) -> Result<(), String> {
        let within = |name: &str, value: f64, [low, high]: [f64; 2], unit: &str| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(format!(
                    "{name} is {value} {unit}; give {low} {unit} to {high} {unit}"
                ))
            }
        };
        within("the row rate", self.rate_hz, RATES_HZ, "Hz")?;
        within("the size", self.size, [0.0, 100.0], "times the noise")?;
        if let Some(noise) = self.noise_n {
            within("the noise", noise, NOISES_N, "N RMS")?;
        }
        if let Some(duration) = self.duration_s {
            within("the duration of a run", duration, [5.0, 600.0], "s")?;
        }
        if let Some(runs) = self.runs {
            within("the number of runs", runs as f64, [2.0, 100.0], "runs")?;
        }
        if self.effects.len() > 3 {
            return Err(format!(
                "{} effects in one set; give at most 3",
                self.effects.len()
            ));
        }
        for (i, effect) in self.effects.iter().enumerate() {
            if self.effects[..i].contains(effect) {
                return Err(format!(
                    "effect {} is given twice; give each once",
                    effect.name
                ));
            }
        }
        Ok(())
    }
}

/// An effect in a set.
#[derive(Clone, Debug)]
pub struct Missing {
    /// The effect.
    pub effect: &'static Effect,
    /// Its parameters, scaled.
    pub parameters: Parameters,
    /// RMS of what the declared model leaves of the effect alone, in N.
    pub rms_n: f64,
    /// RMS of the effect alone without any fit, in N.
    pub raw_rms_n: f64,
    /// RMS of what the declared model leaves of the readings with all effects, less the readings without this one, in N.
    pub marginal_rms_n: f64,
    /// RMS of what the declared model and the best fit of the other missing effects leave of it, in N.
    pub distinct_rms_n: f64,
    /// Other effects of the catalogue, fitted to this one.
    pub alike: Vec<Alike>,
}

/// How well another effect of the catalogue describes a missing one on the data of the set.
#[derive(Clone, Debug)]
pub struct Alike {
    /// The other effect.
    pub effect: &'static Effect,
    /// RMS of what the other effect leaves, over the RMS of the noise.
    pub left_over_noise: f64,
    /// RMS of what the other effect leaves, over the RMS of the missing one.
    pub left_over_effect: f64,
}

/// One log.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Name of the measured log that gave motion and command.
    pub excitation: Option<String>,
    /// Names of the columns, the time first.
    pub columns: Vec<&'static str>,
    /// Rows, with a value for each column; SI units as the names say.
    pub rows: Vec<Vec<f64>>,
    /// Noise in each row of the log in N, before quantisation and clipping.
    pub noise: Vec<f64>,
    /// Reading in each row without noise and quantisation, in N.
    pub clean: Vec<f64>,
    /// Rows that were lost.
    pub rows_lost: usize,
    /// Rows whose reading without noise lies outside 0 N to 15 N, where a real cable or cell would do something else.
    pub rows_out_of_range: usize,
}

/// A set of logs and all that is true about it.
#[derive(Clone, Debug)]
pub struct Set {
    /// The request.
    pub request: Request,
    /// Terms of the declared model.
    pub terms: Vec<Term>,
    /// Effects that it lacks.
    pub missing: Vec<Missing>,
    /// RMS of what the declared model leaves of all effects together, in N.
    pub joint_rms_n: f64,
    /// RMS of the noise in N.
    pub noise_rms_n: f64,
    /// Colour of the noise.
    pub colour: Colour,
    /// Step of the reading in N.
    pub quantum_n: f64,
    /// RMS of the jitter of the row times in s.
    pub jitter_s: f64,
    /// RMS of the noise of the logged velocity while the reel turns, in rad/s.
    pub speed_noise_rad_s: f64,
    /// Whether the logs have a temperature.
    pub has_temperature: bool,
    /// The logs.
    pub runs: Vec<Run>,
}

/// Sampling of a run: the times of its rows on the grid.
struct Sampling {
    world: World,
    times: Vec<f64>,
}

/// The runs, and the basis of the declared model.
struct Rig<'a> {
    runs: &'a [Sampling],
    terms: &'a [Term],
    basis: Basis,
    /// Readings without noise and effects, of all runs one after the other.
    plain: Vec<f64>,
}

impl<'a> Rig<'a> {
    fn new(runs: &'a [Sampling], terms: &'a [Term]) -> Self {
        let mut rig = Self {
            runs,
            terms,
            basis: fitted_terms(runs, terms),
            plain: Vec::new(),
        };
        rig.plain = rig.readings(&[]).concat();
        rig
    }

    /// Readings without noise in the rows of all runs, with given effects.
    fn readings(&self, effects: &[(&Effect, &Parameters)]) -> Vec<Vec<f64>> {
        let mut order: Vec<_> = effects.to_vec();
        order.sort_by_key(|(effect, _)| effect.stage);
        self.runs
            .iter()
            .map(|run| {
                let mut signal = self.base(&run.world);
                for (effect, parameters) in &order {
                    (effect.apply)(parameters, &run.world, &mut signal);
                }
                run.times
                    .iter()
                    .map(|t| run.world.sample(&signal, *t))
                    .collect()
            })
            .collect()
    }

    /// The declared terms with their true coefficients, on the grid.
    fn base(&self, world: &World) -> Vec<f64> {
        (0..world.len())
            .map(|i| {
                self.terms
                    .iter()
                    .map(|term| {
                        term.coefficient
                            * term.value(world.command[i], world.velocity[i], world.angle[i])
                    })
                    .sum()
            })
            .collect()
    }

    /// What effects add to the readings of all runs, one after the other.
    fn contribution(&self, effects: &[(&Effect, &Parameters)]) -> Vec<f64> {
        difference(&self.readings(effects).concat(), &self.plain)
    }

    /// The parameters scaled so that the declared model leaves `target_rms` N RMS of the effect, and what it leaves.
    fn scale_to(
        &self,
        effect: &Effect,
        drawn: &Parameters,
        target_rms: f64,
        tolerance: f64,
    ) -> Result<(Parameters, Vec<f64>), String> {
        // Nearly all effects are nearly proportional to the scale: false position in the logarithm, kept in a bracket.
        let (mut low, mut high): (f64, f64) = (0.0, f64::INFINITY);
        let mut scale = 1.0;
        let mut tries = 0;
        while tries < 60 {
            tries += 1;
            let scaled = drawn.at_scale(scale);
            let mut left = self.contribution(&[(effect, &scaled)]);
            self.basis.remove_from(&mut left);
            let now = rms(&left);
            if (now - target_rms).abs() <= tolerance * target_rms {
                return Ok((scaled, left));
            }
            if now < target_rms {
                low = scale;
            } else {
                high = scale;
            }
            let mut next = if now > 0.0 {
                scale * (target_rms / now).clamp(1e-3, 1e3)
            } else {
                scale * 10.0
            };
            if next <= low || next >= high || tries > 12 {
                next = match (low, high) {
                    (0.0, high) => high * 0.1,
                    (low, high) if high.is_infinite() => low * 2.0,
                    (low, high) => (low * high).sqrt(),
                };
            }
            if !(1e-9..1e9).contains(&next) {
                break;
            }
            scale = next;
        }
        Err(format!(
            "effect {} can't reach {:.2} mN RMS beside the declared model on this motion and command; give another \
             seed, a smaller --size or --noise, or another --excitation",
            effect.name,
            target_rms * 1e3
        ))
    }
}

impl Set {
    /// Generates a set.
    ///
    /// # Errors
    /// If the request is out of range, or an effect can't have the size.
    pub fn generate(request: &Request) -> Result<Self, String> {
        request.check()?;
        let seed = request.seed;
        let mut random = Random::new(seed, "set");
        let drawn_noise = random.log_uniform(NOISES_N[0], NOISES_N[1]);
        let noise_rms_n = request.noise_n.unwrap_or(drawn_noise);
        let colour = Colour::draw(&mut random);
        let quantum_n = noise_rms_n * random.log_uniform(0.02, 0.5);
        let jitter_s = random.uniform(0.0, 0.04) / request.rate_hz;
        let needs_temperature = request
            .effects
            .iter()
            .any(|e| e.name.starts_with("temperature"))
            || request
                .effects
                .iter()
                .any(|e| e.name == "viscous-temperature");
        let has_temperature = random.chance(0.6) || needs_temperature;
        let loss = random.uniform(0.0, 0.003);

        let terms = Self::declare(request, &mut Random::new(seed, "declared"));
        let (runs, names) = Self::sample(request, jitter_s, loss);
        // The declared terms must be true on the logged velocity, to a twentieth of the noise.
        let slope: f64 = terms.iter().map(Term::slope).sum();
        let speed_noise_rad_s = SPEED_NOISE_RAD_S.min(0.05 * noise_rms_n / slope.max(1e-9));
        let rig = Rig::new(&runs, &terms);
        let scene = scene(&rig, request.rate_hz);

        let mut scaled: Vec<(&'static Effect, Parameters)> = Vec::new();
        if request.size > 0.0 {
            for effect in &request.effects {
                let drawn = effect.draw(
                    &mut Random::new(seed, &format!("effect {}", effect.name)),
                    &scene,
                );
                let (parameters, _) =
                    rig.scale_to(effect, &drawn, request.size * noise_rms_n, 2e-3)?;
                scaled.push((effect, parameters));
            }
        }
        let all: Vec<(&Effect, &Parameters)> = scaled.iter().map(|(e, p)| (*e, p)).collect();
        let joint_rms_n = rig.basis.rms_left(&rig.contribution(&all));
        let mut missing = Vec::new();
        for (effect, parameters) in &scaled {
            let others: Vec<_> = all.iter().copied().filter(|(e, _)| e != effect).collect();
            let alone = rig.contribution(&[(effect, parameters)]);
            let mut distinct = rig.basis.clone();
            for other in &others {
                distinct.add(&rig.contribution(&[*other]));
            }
            missing.push(Missing {
                effect,
                parameters: parameters.clone(),
                rms_n: rig.basis.rms_left(&alone),
                raw_rms_n: rms(&alone),
                marginal_rms_n: rig.basis.rms_left(&difference(
                    &rig.contribution(&all),
                    &rig.contribution(&others),
                )),
                distinct_rms_n: distinct.rms_left(&alone),
                alike: if request.compare {
                    compare(&rig, effect, parameters, noise_rms_n, &scene, seed)
                } else {
                    Vec::new()
                },
            });
        }

        let mut noise: Vec<Vec<f64>> = runs
            .iter()
            .enumerate()
            .map(|(i, run)| {
                colour.generate(
                    run.times.len(),
                    request.rate_hz,
                    &mut Random::new(seed, &format!("noise {i}")),
                )
            })
            .collect();
        scale_to_rms(&mut noise, noise_rms_n);
        let ceiling = scaled
            .iter()
            .filter(|(e, _)| e.stage == Stage::Limit)
            .map(|(_, p)| sensor::clipping_level(p))
            .fold(f64::INFINITY, f64::min);
        let readings = rig.readings(&all);
        let logs = runs
            .iter()
            .zip(readings)
            .zip(noise)
            .zip(names)
            .enumerate()
            .map(|(i, (((sampling, clean), noise), (name, rows_lost)))| {
                let random = Random::new(seed, &format!("log {i}"));
                let log = Log {
                    quantum_n,
                    jitter_s,
                    speed_noise_rad_s,
                    has_temperature,
                    ceiling,
                };
                let mut run = log.write(sampling, clean, noise, random);
                run.excitation = name;
                run.rows_lost = rows_lost;
                run
            })
            .collect();
        Ok(Self {
            request: request.clone(),
            terms,
            missing,
            joint_rms_n,
            noise_rms_n,
            colour,
            quantum_n,
            jitter_s,
            speed_noise_rad_s,
            has_temperature,
            runs: logs,
        })
    }

    /// A declared model that contains none of the effects.
    fn declare(request: &Request, random: &mut Random) -> Vec<Term> {
        let free: Vec<Declared> = Declared::COMMON
            .into_iter()
            .filter(|d| request.effects.iter().all(|e| !e.declared_in.contains(d)))
            .collect();
        let declared = free
            .get(random.index(free.len()))
            .copied()
            .unwrap_or(Declared::Spring);
        declared.terms(random)
    }

    /// Motion, command and row times of all runs; and for each its source and the rows lost.
    #[allow(clippy::type_complexity)]
    fn sample(
        request: &Request,
        jitter_s: f64,
        loss: f64,
    ) -> (Vec<Sampling>, Vec<(Option<String>, usize)>) {
        let mut random = Random::new(request.seed, "excitation");
        let dt = 1.0 / (request.rate_hz * steps_per_row(request.rate_hz) as f64);
        let drawn_runs = random.integer(4, 8);
        let runs = request.runs.unwrap_or(drawn_runs);
        let short = request.effects.iter().any(|e| e.name == "backlash");
        let limits = Limits {
            speed_rad_s: if short {
                random.uniform(0.8, 2.0)
            } else {
                random.uniform(2.5, 7.0)
            },
            travel_rad: if short { 1.5 } else { 12.0 },
            acceleration_rad_s2: random.log_uniform(15.0, 80.0),
        };
        let first = random.index(1 << 20);
        let mut samplings = Vec::new();
        let mut names = Vec::new();
        for i in 0..runs {
            let mut random = Random::new(request.seed, &format!("run {i}"));
            let drawn = random.uniform(40.0, 90.0);
            let duration = request.duration_s.unwrap_or(drawn);
            let (mut world, duration, name) = match &request.excitation {
                Some(measured) => {
                    let (world, duration, name) =
                        measured.run(first + i, &mut random, duration, dt);
                    (world, duration, Some(name))
                }
                None => (
                    excitation::synthetic(&mut random, duration, dt, &limits),
                    duration,
                    None,
                ),
            };
            world.seed = request
                .seed
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .wrapping_add(i as u64);
            let rows = (duration * request.rate_hz) as usize;
            let mut times: Vec<f64> = (0..rows)
                .map(|row| {
                    let limit = 0.4 / request.rate_hz;
                    row as f64 / request.rate_hz + (jitter_s * random.normal()).clamp(-limit, limit)
                })
                .collect();
            times.retain(|_| !random.chance(loss));
            for _ in 0..random.index(3) {
                let from = random.index(times.len());
                let to = (from + random.integer(3, 12)).min(times.len());
                times.drain(from..to);
            }
            names.push((name, rows - times.len()));
            samplings.push(Sampling { world, times });
        }
        (samplings, names)
    }

    /// All that is true about the set, for `truth.json`.
    pub fn truth(&self) -> Value {
        let over_noise = |rms_n: f64| rms_n / self.noise_rms_n;
        let missing: Vec<Value> = self
            .missing
            .iter()
            .map(|m| {
                json!({
                    "name": m.effect.name,
                    "title": m.effect.title,
                    "equation": m.effect.equation,
                    "source": m.effect.source,
                    "outside": m.effect.outside,
                    "size": over_noise(m.rms_n),
                    "rms_n": m.rms_n,
                    "rms_before_fit_n": m.raw_rms_n,
                    "size_beside_other_effects": over_noise(m.marginal_rms_n),
                    "size_distinct_from_other_effects": over_noise(m.distinct_rms_n),
                    "parameters": m.parameters.to_json(),
                    "equivalences": m.effect.equivalences.iter().map(|e| json!({
                        "names": e.names, "kind": e.kind, "reason": e.reason,
                    })).collect::<Vec<_>>(),
                    "compared_on_this_data": m.alike.iter().map(|a| json!({
                        "name": a.effect.name,
                        "left_over_noise": a.left_over_noise,
                        "left_over_effect": a.left_over_effect,
                    })).collect::<Vec<_>>(),
                })
            })
            .collect();
        json!({
            "format": 1,
            "seed": self.request.seed,
            "rate_hz": self.request.rate_hz,
            "size_requested": self.request.size,
            "empty": self.missing.is_empty(),
            "missing": missing,
            "size_of_all_together": over_noise(self.joint_rms_n),
            "declared": self.terms.iter().map(|t| json!({
                "name": t.name, "expr": t.expr, "unit": t.unit, "fixed": t.fixed, "coefficient": t.coefficient,
            })).collect::<Vec<_>>(),
            "noise": {
                "rms_n": self.noise_rms_n,
                "shares_of_variance": self.colour.to_json(self.request.rate_hz),
                "quantum_n": self.quantum_n,
                "jitter_rms_s": self.jitter_s,
                "speed_rms_rad_s": self.speed_noise_rad_s,
            },
            "also_present": self.also_present(),
            "runs": self.runs.iter().enumerate().map(|(i, run)| json!({
                "file": file_name(i),
                "rows": run.rows.len(),
                "rows_lost": run.rows_lost,
                "rows_out_of_range": run.rows_out_of_range,
                "motion_and_command_from": run.excitation,
            })).collect::<Vec<_>>(),
        })
    }

    /// Things in the noise that a careful analysis may name without being wrong.
    fn also_present(&self) -> Vec<Value> {
        let mut present = Vec::new();
        if self.colour.tone > 0.0 {
            present.push(json!({
                "name": "mains",
                "size": self.colour.tone.sqrt(),
                "reason": "the noise has a tone",
            }));
        }
        if self.colour.flicker > 0.0 {
            present.push(json!({
                "name": "drift",
                "size": self.colour.flicker.sqrt(),
                "reason": "the noise has a 1/f part, which wanders within a run and differs from run to run",
            }));
        }
        present
    }
}

/// The fitted terms in the rows of all runs.
fn fitted_terms(runs: &[Sampling], terms: &[Term]) -> Basis {
    let columns: Vec<Vec<f64>> = terms
        .iter()
        .filter(|term| !term.fixed)
        .map(|term| {
            runs.iter()
                .flat_map(|run| {
                    run.times.iter().map(|t| {
                        let at = |signal: &[f64]| run.world.sample(signal, *t);
                        term.value(
                            at(&run.world.command),
                            at(&run.world.velocity),
                            at(&run.world.angle),
                        )
                    })
                })
                .collect()
        })
        .collect();
    Basis::new(&columns)
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Name of the file of run `i`, counted from 0.
pub fn file_name(i: usize) -> String {
    format!("run{:02}.csv", i + 1)
}

fn scene(rig: &Rig, rate_hz: f64) -> Scene {
    let mut scene = Scene {
        rate_hz,
        max_command_n: f64::NEG_INFINITY,
        min_command_n: f64::INFINITY,
        max_reading_n: rig.plain.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        travel_rad: 0.0,
        max_speed_rad_s: 0.0,
    };
    for Sampling { world, .. } in rig.runs {
        let extreme =
            |signal: &[f64], pick: fn(f64, f64) -> f64| signal.iter().copied().fold(f64::NAN, pick);
        scene.max_command_n = scene.max_command_n.max(extreme(&world.command, f64::max));
        scene.min_command_n = scene.min_command_n.min(extreme(&world.command, f64::min));
        let (low, high) = (
            extreme(&world.angle, f64::min),
            extreme(&world.angle, f64::max),
        );
        scene.travel_rad = scene.travel_rad.max(0.5 * (high - low));
        let speed = extreme(&world.velocity, f64::max).max(-extreme(&world.velocity, f64::min));
        scene.max_speed_rad_s = scene.max_speed_rad_s.max(speed);
    }
    scene
}

/// Random parameters tried for each other effect.
const RANDOM_TRIES: usize = 12;

/// Changes tried to the best parameters of each other effect.
const LOCAL_TRIES: usize = 16;

/// Runs of a set that effects are compared on.
const COMPARED_RUNS: usize = 2;

/// Fits the effects that `effect.equivalences` names to the contribution of the effect in the first runs, with parameters
/// found by a random search that may leave the documented ranges. The result is an upper bound: another search may leave
/// less.
fn compare(
    rig: &Rig,
    effect: &Effect,
    parameters: &Parameters,
    noise_rms_n: f64,
    scene: &Scene,
    seed: u64,
) -> Vec<Alike> {
    let rig = Rig::new(&rig.runs[..rig.runs.len().min(COMPARED_RUNS)], rig.terms);
    let mut target = rig.contribution(&[(effect, parameters)]);
    rig.basis.remove_from(&mut target);
    let target_rms = rms(&target);
    if target_rms == 0.0 {
        return Vec::new();
    }
    let left_by = |candidate: &Effect, drawn: &Parameters| -> Option<f64> {
        let (_, column) = rig.scale_to(candidate, drawn, target_rms, 0.02).ok()?;
        Some(Basis::new(&[column]).rms_left(&target)).filter(|left| left.is_finite())
    };
    let candidates = CATALOGUE.iter().filter(|candidate| {
        *candidate != effect
            && effect
                .equivalences
                .iter()
                .any(|e| e.names.contains(&candidate.name))
    });
    let mut alike: Vec<Alike> = candidates
        .filter_map(|candidate| {
            let mut random =
                Random::new(seed, &format!("compare {} {}", effect.name, candidate.name));
            let mut best: Option<(f64, Parameters)> = None;
            let attempt = |drawn: Parameters, best: &mut Option<(f64, Parameters)>| {
                let Some(left) = left_by(candidate, &drawn) else {
                    return;
                };
                if best.as_ref().is_none_or(|(least, _)| left < *least) {
                    *best = Some((left, drawn));
                }
            };
            for _ in 0..RANDOM_TRIES {
                attempt(candidate.draw(&mut random, scene), &mut best);
            }
            let count = best.as_ref().map_or(0, |(_, p)| p.list().len());
            // A first parameter that carries the size is left alone: the scale sets it anyway.
            let first = best
                .as_ref()
                .map_or(0, |(_, p)| usize::from(count > 1 && p.list()[0].scaled));
            for (index, factor) in (first..count).flat_map(|index| [(index, 1e-3), (index, 1e3)]) {
                if let Some((_, now)) = best.clone() {
                    attempt(now.with_changed(index, Some(factor), &now), &mut best);
                }
            }
            for _ in 0..LOCAL_TRIES {
                let Some((_, now)) = best.clone() else { break };
                let index = random.integer(first, count - 1);
                let spread = if random.chance(0.5) { 2.0 } else { 0.5 };
                let factor = random
                    .chance(0.75)
                    .then_some((spread * random.normal()).exp());
                let drawn = candidate.draw(&mut random, scene);
                attempt(now.with_changed(index, factor, &drawn), &mut best);
            }
            best.map(|(left, _)| Alike {
                effect: candidate,
                left_over_noise: left / noise_rms_n,
                left_over_effect: left / target_rms,
            })
        })
        .collect();
    alike.sort_by(|a, b| a.left_over_noise.total_cmp(&b.left_over_noise));
    alike
}

/// How a run becomes a log.
struct Log {
    quantum_n: f64,
    jitter_s: f64,
    speed_noise_rad_s: f64,
    has_temperature: bool,
    ceiling: f64,
}

impl Log {
    fn write(
        &self,
        sampling: &Sampling,
        clean: Vec<f64>,
        noise: Vec<f64>,
        mut random: Random,
    ) -> Run {
        let world = &sampling.world;
        let mut columns = vec!["time_s", "force_n", "command_n", "speed_rad_s", "angle_rad"];
        if self.has_temperature {
            columns.push("temperature_c");
        }
        columns.extend([
            "neighbour_1_n",
            "neighbour_2_n",
            "shoulder_rad",
            "elbow_rad",
        ]);
        let mut last = f64::NEG_INFINITY;
        let rows = sampling
            .times
            .iter()
            .zip(clean.iter().zip(&noise))
            .map(|(&t, (clean, noise))| {
                let at = |signal: &[f64]| world.sample(signal, t);
                // The time stamp misses the moment of the sample by a little; it still grows.
                let stamp = round(
                    t + CLOCK_START_S + 0.1 * self.jitter_s * random.normal(),
                    1e-6,
                )
                .max(last + 1e-6);
                last = stamp;
                let velocity = at(&world.velocity);
                let speed = if velocity == 0.0 {
                    0.0
                } else {
                    velocity + self.speed_noise_rad_s * random.normal()
                };
                let mut row = vec![
                    stamp,
                    round((clean + noise).min(self.ceiling), self.quantum_n),
                    round(at(&world.command), 1e-4),
                    round(speed, 1e-4),
                    round(at(&world.angle), 1e-4),
                ];
                if self.has_temperature {
                    row.push(round(at(&world.temperature) + 0.02 * random.normal(), 0.01));
                }
                for neighbour in &world.neighbours {
                    row.push(round(at(neighbour) + 0.003 * random.normal(), 1e-3));
                }
                row.extend(world.pose.iter().map(|joint| round(at(joint), 1e-4)));
                row
            })
            .collect();
        let rows_out_of_range = clean
            .iter()
            .filter(|f| !(0.0..=FULL_SCALE_N).contains(*f))
            .count();
        Run {
            columns,
            rows,
            noise,
            clean,
            rows_out_of_range,
            ..Run::default()
        }
    }
}

fn round(value: f64, step: f64) -> f64 {
    // Adding zero turns -0 into 0.
    (value / step).round() * step + 0.0
}

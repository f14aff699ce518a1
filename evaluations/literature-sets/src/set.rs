//! A set: several runs whose declared model lacks chosen effects of a chosen size.

use crate::compare::{compare, Alike};
use crate::declared::{Declared, Term};
use crate::effects::{sensor, Effect, Stage};
use crate::fit::rms;
use crate::log::{Log, Run};
use crate::noise::{scale_to_rms, Colour};
use crate::parameters::{Parameters, Scene};
use crate::random::Random;
use crate::request::{Request, NOISES_N};
use crate::rig::{difference, scene, Rig};
use crate::sampling::sample;

/// Largest RMS of the noise of the logged velocity in rad/s.
const SPEED_NOISE_RAD_S: f64 = 0.003;

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
    /// RMS of what the declared model leaves of the readings with all effects, less the readings
    /// without this one, in N.
    pub marginal_rms_n: f64,
    /// RMS of what the declared model and the best fit of the other missing effects leave of it, in
    /// N.
    pub distinct_rms_n: f64,
    /// Other effects of the catalogue, fitted to this one.
    pub alike: Vec<Alike>,
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
            .any(|e| e.name.starts_with("temperature") || e.name == "viscous-temperature");
        let has_temperature = random.chance(0.6) || needs_temperature;
        let loss = random.uniform(0.0, 0.003);

        let terms = Self::declare(request, &mut Random::new(seed, "declared"));
        let runs = sample(request, jitter_s, loss);
        // The declared terms must be true on the logged velocity, to a twentieth of the noise.
        let slope: f64 = terms.iter().map(Term::slope).sum();
        let speed_noise_rad_s = SPEED_NOISE_RAD_S.min(0.05 * noise_rms_n / slope.max(1e-9));
        let rig = Rig::new(&runs, &terms);
        let scene = scene(&rig, request.rate_hz);

        let scaled = scale(request, &rig, &scene, noise_rms_n)?;
        let all: Vec<(&Effect, &Parameters)> = scaled.iter().map(|(e, p)| (*e, p)).collect();
        let joint_rms_n = rig.basis.rms_left(&rig.contribution(&all));
        let missing = missing(request, &rig, &scene, &scaled, noise_rms_n);
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
        let log = Log {
            quantum_n,
            jitter_s,
            speed_noise_rad_s,
            has_temperature,
            ceiling,
        };
        let logs = runs
            .iter()
            .zip(rig.readings(&all))
            .zip(noise)
            .enumerate()
            .map(|(i, ((sampling, clean), noise))| {
                log.write(
                    sampling,
                    clean,
                    noise,
                    Random::new(seed, &format!("log {i}")),
                )
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
}

/// The effects of the request with their parameters scaled to its size; none where the size is 0.
fn scale(
    request: &Request,
    rig: &Rig,
    scene: &Scene,
    noise_rms_n: f64,
) -> Result<Vec<(&'static Effect, Parameters)>, String> {
    if request.size == 0.0 {
        return Ok(Vec::new());
    }
    request
        .effects
        .iter()
        .map(|effect| {
            let mut random = Random::new(request.seed, &format!("effect {}", effect.name));
            let drawn = effect.draw(&mut random, scene);
            let target_n = request.size * noise_rms_n;
            let (parameters, _) = rig.scale_to(effect, &drawn, target_n, 2e-3)?;
            Ok((*effect, parameters))
        })
        .collect()
}

/// What is true about each scaled effect in the set.
fn missing(
    request: &Request,
    rig: &Rig,
    scene: &Scene,
    scaled: &[(&'static Effect, Parameters)],
    noise_rms_n: f64,
) -> Vec<Missing> {
    let all: Vec<(&Effect, &Parameters)> = scaled.iter().map(|(e, p)| (*e, p)).collect();
    let with_all = rig.contribution(&all);
    let mut missing = Vec::new();
    for (effect, parameters) in scaled {
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
            marginal_rms_n: rig
                .basis
                .rms_left(&difference(&with_all, &rig.contribution(&others))),
            distinct_rms_n: distinct.rms_left(&alone),
            alike: if request.compare {
                compare(rig, effect, parameters, noise_rms_n, scene, request.seed)
            } else {
                Vec::new()
            },
        });
    }
    missing
}

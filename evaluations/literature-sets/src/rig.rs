//! The rig without noise: readings of all runs with any effects, and effects scaled to a size.

use crate::declared::Term;
use crate::effects::Effect;
use crate::fit::{rms, Basis};
use crate::parameters::{Parameters, Scene};
use crate::world::World;

/// Sampling of a run: the times of its rows on the grid.
pub(crate) struct Sampling {
    pub world: World,
    pub times: Vec<f64>,
    /// Name of the measured log that gave motion and command.
    pub excitation: Option<String>,
    /// Rows that were lost.
    pub rows_lost: usize,
}

/// The runs, and the basis of the declared model.
pub(crate) struct Rig<'a> {
    pub runs: &'a [Sampling],
    pub terms: &'a [Term],
    pub basis: Basis,
    /// Readings without noise and effects, of all runs one after the other.
    pub plain: Vec<f64>,
}

impl<'a> Rig<'a> {
    pub fn new(runs: &'a [Sampling], terms: &'a [Term]) -> Self {
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
    pub fn readings(&self, effects: &[(&Effect, &Parameters)]) -> Vec<Vec<f64>> {
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
    pub fn contribution(&self, effects: &[(&Effect, &Parameters)]) -> Vec<f64> {
        difference(&self.readings(effects).concat(), &self.plain)
    }

    /// The parameters scaled so that the declared model leaves `target_rms` N RMS of the effect,
    /// and what it leaves.
    pub fn scale_to(
        &self,
        effect: &Effect,
        drawn: &Parameters,
        target_rms: f64,
        tolerance: f64,
    ) -> Result<(Parameters, Vec<f64>), String> {
        // Nearly all effects are nearly proportional to the scale: false position in the logarithm,
        // kept in a bracket.
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

/// `a` less `b`.
pub(crate) fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// What the parameters of an effect depend on.
pub(crate) fn scene(rig: &Rig, rate_hz: f64) -> Scene {
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

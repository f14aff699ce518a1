//! How well other effects of the catalogue describe a missing one on the data of a set.

use crate::effects::{Effect, CATALOGUE};
use crate::fit::{rms, Basis};
use crate::parameters::{Parameters, Scene};
use crate::random::Random;
use crate::rig::Rig;

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

/// Random parameters tried for each other effect.
const RANDOM_TRIES: usize = 12;

/// Changes tried to the best parameters of each other effect.
const LOCAL_TRIES: usize = 16;

/// Runs of a set that effects are compared on.
const COMPARED_RUNS: usize = 2;

/// Fits the effects that `effect.equivalences` names to the contribution of the effect in the first
/// runs, with parameters found by a random search that may leave the documented ranges. The result
/// is an upper bound: another search may leave less.
pub(crate) fn compare(
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

//! Other names that predict as well: the paths of the search that came to the same error.

use super::assessment::Assessment;
use crate::check::Checked;
use residual_columns::error::Error;
use residual_columns::nan;
use residual_effects::EffectKind;
use residual_search::model::Chosen;
use residual_search::paths::Path;
use residual_search::Search;
use serde::{Deserialize, Serialize};

/// Effects found in whose place others predict as well.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EqualPath {
    /// Effects found that the other search did without.
    pub effects: Vec<EffectKind>,
    /// Effects that it found in their place.
    pub instead: Vec<EffectKind>,
    /// Held-out RMSE of its model, in the target's unit.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_rmse: f64,
}

/// The kinds of effects.
pub(super) fn kinds(chosen: &[Chosen]) -> Vec<EffectKind> {
    chosen.iter().map(|c| c.effect.kind()).collect()
}

/// The names of other paths in the place of those found. `taken` are the effects of the path that
/// was taken, `found` those of them that the data support.
///
/// A path whose own names the data do not support is no alternative.
pub(super) fn equal_paths(
    search: &mut Search,
    taken: &[EffectKind],
    found: &[Chosen],
    others: Vec<Path>,
    check: Option<&Checked>,
) -> Result<Vec<EqualPath>, Error> {
    let mut out: Vec<EqualPath> = Vec::new();
    for path in others {
        let others = kinds(&path.outcome.chosen);
        let found = kinds(found);
        let Some((effects, instead)) = differing(taken, &found, &others) else {
            continue;
        };
        if out
            .iter()
            .any(|p| p.effects == effects && p.instead == instead)
        {
            continue;
        }
        let heldout_rmse = path.outcome.fitted.rmse();
        if supports(search, path, &instead, check)? {
            out.push(EqualPath {
                effects,
                instead,
                heldout_rmse,
            });
        }
    }
    Ok(out)
}

/// The found names that another path did without, and those that it has in their place; `None`
/// unless there are both.
fn differing(
    taken: &[EffectKind],
    found: &[EffectKind],
    others: &[EffectKind],
) -> Option<(Vec<EffectKind>, Vec<EffectKind>)> {
    let only = |these: &[EffectKind], those: &[&[EffectKind]]| {
        let mut out: Vec<EffectKind> = Vec::new();
        for kind in these {
            if !out.contains(kind) && !those.iter().any(|t| t.contains(kind)) {
                out.push(*kind);
            }
        }
        out
    };
    let mut effects = only(found, &[others]);
    effects.retain(|kind| taken.contains(kind));
    let instead = only(others, &[taken, found]);
    (!effects.is_empty() && !instead.is_empty()).then_some((effects, instead))
}

/// Whether the data support these names of a path.
fn supports(
    search: &mut Search,
    path: Path,
    names: &[EffectKind],
    check: Option<&Checked>,
) -> Result<bool, Error> {
    let judged = Assessment::new(search, path.outcome, check)?;
    let mut refused = judged.outcome.chosen.iter().zip(&judged.why);
    Ok(!refused.any(|(c, why)| why.is_some() && names.contains(&c.effect.kind())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_differ_on_both_sides_are_alternatives() {
        use EffectKind::{Coulomb, Delay, Geometry, GravityAngle, Inertia, Payload};
        let of = |taken: &[_], found: &[_], others: &[_]| differing(taken, found, others);
        let taken = [Coulomb, GravityAngle, Inertia];
        assert_eq!(
            of(&taken, &taken, &[Payload, Coulomb]),
            Some((vec![GravityAngle, Inertia], vec![Payload]))
        );
        // A part of the same names, or more of them, is no other name.
        assert_eq!(of(&taken, &taken, &[Coulomb, GravityAngle]), None);
        assert_eq!(
            of(&taken, &taken, &[Coulomb, GravityAngle, Inertia, Delay]),
            None
        );
        // What is not found has no alternative, and what was refused already is none.
        assert_eq!(of(&taken, &[Coulomb], &[Coulomb, Payload]), None);
        assert_eq!(
            of(
                &[Coulomb, Geometry],
                &[Coulomb, GravityAngle],
                &[Coulomb, Geometry]
            ),
            None
        );
        // What was found later is not of the path that was taken.
        assert_eq!(
            of(
                &[Coulomb, Geometry],
                &[Coulomb, GravityAngle],
                &[Coulomb, Payload]
            ),
            None
        );
    }
}

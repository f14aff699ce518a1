//! Other names that predict as well: the paths of the search that came to the same error.

use super::Refused;
use residual_columns::nan;
use residual_effects::EffectKind;
use residual_search::model::Chosen;
use residual_search::{Outcome, Search};
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

/// The names that another path has in the place of those found, if it predicts as well and its own
/// names are supported. `refused` are those of the path that was taken: what was refused already
/// is no alternative.
pub(super) fn equal_path(
    search: &Search,
    found: &Outcome,
    refused: &[Refused],
    other: &Outcome,
) -> Option<EqualPath> {
    let heldout_rmse = other.fitted.rmse();
    if heldout_rmse > found.fitted.rmse() && !search.is_equal(other, found) {
        return None;
    }
    let refused: Vec<EffectKind> = refused.iter().map(|r| r.effect.effect.kind()).collect();
    let (effects, instead) = differing(&kinds(&found.chosen), &refused, &kinds(&other.chosen))?;
    Some(EqualPath {
        effects,
        instead,
        heldout_rmse,
    })
}

/// The kinds of effects.
fn kinds(chosen: &[Chosen]) -> Vec<EffectKind> {
    chosen.iter().map(|c| c.effect.kind()).collect()
}

/// The found names that another path did without, and those that it has in their place; `None`
/// unless there are both.
fn differing(
    found: &[EffectKind],
    refused: &[EffectKind],
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
    let effects = only(found, &[others]);
    let instead = only(others, &[found, refused]);
    (!effects.is_empty() && !instead.is_empty()).then_some((effects, instead))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_differ_on_both_sides_are_alternatives() {
        use EffectKind::{Coulomb, Delay, Geometry, GravityAngle, Inertia, Payload};
        let found = [Coulomb, GravityAngle, Inertia];
        assert_eq!(
            differing(&found, &[], &[Payload, Coulomb]),
            Some((vec![GravityAngle, Inertia], vec![Payload]))
        );
        // A part of the same names, or more of them, is no other name.
        assert_eq!(differing(&found, &[], &[Coulomb, GravityAngle]), None);
        let more = [Coulomb, GravityAngle, Inertia, Delay];
        assert_eq!(differing(&found, &[], &more), None);
        // What is not found has no alternative, and what was refused already is none.
        assert_eq!(differing(&[Coulomb], &[], &[Coulomb, Payload]), None);
        let found = [Coulomb, GravityAngle];
        assert_eq!(differing(&found, &[Geometry], &[Coulomb, Geometry]), None);
        // A name that is found beside a refused one has its alternatives as any other.
        assert_eq!(
            differing(&found, &[Geometry], &[Coulomb, Payload]),
            Some((vec![GravityAngle], vec![Payload]))
        );
    }
}

//! What a search found.

use crate::model::{Chosen, Fitted};
use crate::ranking::Step;
use residual_columns::nan;
use residual_effects::{EffectKind, EffectRef};
use serde::{Deserialize, Serialize};

/// The best other effect in the place of a named one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rival {
    /// Its name in the catalogue.
    pub name: EffectKind,
    /// Held-out RMSE of the model with the rival instead, everything else that improves the fit in
    /// it, in the target's unit.
    #[serde(deserialize_with = "nan::from_null")]
    pub heldout_rmse: f64,
    /// `heldout_rmse` relative to that of the model with the effect, less 1: 0.05 is 5 % larger.
    /// That model has the effects of `Report::effects` and `Report::improves`, so its error is
    /// `Report::with_all` where there is one.
    #[serde(deserialize_with = "nan::from_null")]
    pub behind: f64,
}

/// An effect's nearest rival, and the candidates that the data cannot distinguish from it.
#[derive(Clone, Default)]
pub struct Standing {
    /// The nearest rival; `None` if there is none.
    pub rival: Option<Rival>,
    /// Whether it has fewer parameters.
    pub rival_is_simpler: bool,
    /// What cannot be distinguished from it.
    pub ties: Vec<EffectRef>,
}

/// What the search found.
pub struct Outcome {
    /// The effects.
    pub chosen: Vec<Chosen>,
    /// Nearest rival of each chosen effect, and what cannot be distinguished from it.
    pub standings: Vec<Standing>,
    /// The last scan of the catalogue, on top of the final model.
    pub last: Step,
    /// The final model.
    pub fitted: Fitted,
    /// The effect that would have come next, where the search ended at `selection.max_effects`.
    pub limited: Option<EffectKind>,
}

/// What one chosen effect is worth.
#[derive(Clone, Copy)]
pub struct Weight {
    /// Index among the chosen effects.
    pub index: usize,
    /// Held-out RMSE of the final model.
    pub rmse: f64,
    /// Held-out RMSE of the final model without this effect.
    pub rmse_without: f64,
}

/// One chosen effect and the others.
pub fn without(chosen: &[Chosen], index: usize) -> (Chosen, Vec<Chosen>) {
    let mut rest = chosen.to_vec();
    let own = rest.remove(index);
    (own, rest)
}

/// Whether two lists have the same forms of effects.
pub(super) fn same_forms(a: &[Chosen], b: &[Chosen]) -> bool {
    let count = |all: &[Chosen], form: &Chosen| all.iter().filter(|c| c.is_form(form)).count();
    a.len() == b.len() && a.iter().all(|form| count(a, form) == count(b, form))
}

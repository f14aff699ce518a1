//! A weight, a payload or a cosine error that may be a ripple: over a part of a turn a ripple of an
//! order near one has their shape.

use super::EqualPath;
use crate::intervals::parameters;
use residual_columns::error::Error;
use residual_effects::EffectKind;
use residual_search::model::Chosen;
use residual_search::{without, Outcome, Search};
use std::sync::Arc;

/// Distance of an order from 1 up to which a weight with an angle of a wrong scale has it.
const NEAR: f64 = 0.1;

/// Fall of the squared error with another order, in squared errors of a row, from which its
/// interval is looked at: the 0.1 % quantile of chi squared with one degree is 10.8.
const GAIN: f64 = 10.8;

/// Half widths of the 95 % interval by which an order must be off 1. More than one, since an
/// interval knows nothing of what the rest of the model lacks.
const HALF_WIDTHS: f64 = 2.0;

/// The ripple that may stand for an effect with the sine and cosine of an angle, if another order
/// than 1 fits better and 1 is none that it may be.
pub(super) fn ripple_in_place(
    search: &Search,
    outcome: &Outcome,
    index: usize,
) -> Result<Option<EqualPath>, Error> {
    let own = &outcome.chosen[index];
    let ctx = search.scan_on(&search.declared).context();
    let Some(free) = own.effect.of_any_order(&own.variant, own.psi, &ctx) else {
        return Ok(None);
    };
    let fitted = search.fit(&without(&outcome.chosen, index).1)?;
    let scan = search.scan_on(&fitted);
    let Some(order) = scan.best_of_grid(&free) else {
        return Ok(None);
    };
    let [at_one, least] = [1.0, order].map(|n| scan.in_sample(&(free.build)(n)));
    let rows = search.problem.y.len() as f64;
    if at_one <= least * (1.0 + GAIN / rows) {
        return Ok(None);
    }
    let mut chosen = outcome.chosen.clone();
    chosen[index] = Chosen {
        effect: own.effect,
        variant: Arc::new(free),
        psi: order,
    };
    search.polish(&mut chosen)?;
    let order = chosen[index].psi;
    let (_, intervals) = parameters(search, &chosen, index)?;
    let is_other = intervals
        .get("order")
        .is_some_and(|interval| is_no_weight(order, *interval));
    if !is_other {
        return Ok(None);
    }
    Ok(Some(EqualPath {
        effects: vec![own.effect.kind()],
        instead: vec![EffectKind::PeriodicAngle],
        heldout_rmse: search.rmse(&chosen)?,
    }))
}

/// Whether an order with its 95 % interval is that of no weight.
fn is_no_weight(order: f64, [low, high]: [f64; 2]) -> bool {
    let half = (high - order).max(order - low);
    (order - 1.0).abs() > NEAR.max(HALF_WIDTHS * half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_near_one_or_vague_may_be_that_of_a_weight() {
        assert!(is_no_weight(1.25, [1.2, 1.3]));
        assert!(is_no_weight(0.7, [0.6, 0.8]));
        assert!(!is_no_weight(1.05, [1.04, 1.06]));
        assert!(!is_no_weight(1.25, [1.1, 1.4]));
        assert!(!is_no_weight(1.25, [1.2, 1.4]));
    }
}

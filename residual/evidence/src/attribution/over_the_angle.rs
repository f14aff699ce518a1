//! Effects that together take the shape of any curve over the angle.

use super::refusal::{Against, Refusal};
use residual_columns::format::num;
use residual_effects::{sector_of, Context, EffectKind};
use residual_search::model::Chosen;
use residual_search::paths::FEW_PERIODS;
use std::f64::consts::TAU;

/// Turns of a motion up to which orders are not resolved from their neighbours.
const FEW_TURNS: f64 = 1.5;

/// How far an order is off a whole number that may be one.
const WHOLE: f64 = 0.15;

/// Ripples of whole low orders that may be found in few turns; beyond them they are a Fourier
/// series.
const MOST_WHOLE: usize = 3;

/// Share of the motion from which a sector is as wide as the motion.
const WIDE: f64 = 0.6;

/// Marks ripples and sectors that take the shape of any curve over the angle: several ripples of
/// low order over little more than a turn, and a sector as wide as the motion.
pub(super) fn shapes_of_the_angle(why: &mut [Option<Refusal>], chosen: &[Chosen], ctx: &Context) {
    let Some(turns) = ctx.turns() else {
        return;
    };
    let low: Vec<usize> = (0..chosen.len())
        .filter(|i| chosen[*i].effect.kind() == EffectKind::PeriodicAngle)
        .filter(|i| chosen[*i].psi * turns < FEW_PERIODS)
        .collect();
    let orders: Vec<f64> = low.iter().map(|i| chosen[*i].psi).collect();
    if turns <= FEW_TURNS && are_a_series(&orders) {
        let said: Vec<String> = orders.iter().map(|o| num(*o)).collect();
        for i in low {
            why[i].get_or_insert(Against::AsASeries.refuses(format!(
                "ripples of order {} over {} turns take the shape of any curve: structure over the angle, and no ripples",
                said.join(", "),
                num(turns)
            )));
        }
    }
    for (why, own) in why.iter_mut().zip(chosen) {
        let width = sector_of(&own.variant.label).filter(|w| is_wide(*w, turns));
        if let Some(width) = width.filter(|_| own.effect.kind() == EffectKind::AngleFriction) {
            why.get_or_insert(Against::Itself.refuses(format!(
                "a sector of {} rad is as wide as the motion of {} turns: structure over the angle, and no place that rubs",
                num(width),
                num(turns)
            )));
        }
    }
}

/// Whether ripples of low orders are the series of a curve: two with an order that is no whole
/// number, or many.
fn are_a_series(orders: &[f64]) -> bool {
    let whole = |o: &f64| (o - o.round()).abs() <= WHOLE && o.round() > 0.0;
    orders.len() > MOST_WHOLE || (orders.len() > 1 && !orders.iter().all(whole))
}

/// Whether a sector is as wide as a motion. Over a turn and more none is.
fn is_wide(width: f64, turns: f64) -> bool {
    turns < 1.0 && width >= WIDE * turns * TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_low_orders_are_a_curve() {
        for orders in [
            &[1.27, 2.4, 5.1, 7.27][..],
            &[1.0, 2.5],
            &[1.0, 2.0, 3.0, 4.0],
            &[0.4, 0.9],
        ] {
            assert!(are_a_series(orders), "{orders:?}");
        }
        for orders in [&[][..], &[1.27], &[2.0, 6.0], &[1.0, 2.0, 6.1]] {
            assert!(!are_a_series(orders), "{orders:?}");
        }
        assert!(is_wide(2.8, 0.6) && !is_wide(0.3, 0.6) && !is_wide(2.8, 3.0));
    }
}

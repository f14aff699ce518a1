//! Effects that contradict each other.

use super::refusal::{Against, Refusal};
use crate::intervals::Parameters;
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_effects::{EffectKind, Nature, Param};
use residual_search::model::Chosen;
use residual_search::{Search, Weight};

/// Marks effects that contradict each other. Friction takes energy out of a motion, inertia is
/// positive and a spring pulls back, so all of one motion has one sign: for the force of a drive
/// that of the motion, for the force behind it the other. A weight pushes away from an unstable
/// point, against that sign. Of two with unlike signs the one that is worth less is none, but a
/// correction of the other. A value whose interval holds 0 has no sign.
pub(super) fn contradictions(
    why: &mut [Option<Refusal>],
    weights: &[Weight],
    parameters: &[&Parameters],
) {
    let size = |index: usize| {
        let (params, intervals) = parameters[index];
        let own = params
            .iter()
            .find(|p| p.nature.has_one_sign() || p.nature == Nature::Unstable)?;
        let certain = |[low, high]: &[f64; 2]| *low > 0.0 || *high < 0.0;
        let is_certain = intervals.get(&own.name).is_none_or(certain);
        is_certain.then_some(own)
    };
    let sign = |p: &Param| match p.nature {
        Nature::Unstable => -p.value.signum(),
        _ => p.value.signum(),
    };
    // The most valuable first.
    let mut first: Option<&Param> = None;
    for w in weights {
        if why[w.index].is_some() {
            continue;
        }
        match (size(w.index), first) {
            (Some(own), None) => first = Some(own),
            (Some(own), Some(other)) if sign(own) * sign(other) < 0.0 => {
                why[w.index] = Some(Against::Itself.refuses(format!(
                    "{} {} beside {} {} of another effect: friction, damping, inertia and stiffness of one motion have one sign",
                    own.name,
                    num(own.value),
                    other.name,
                    num(other.value),
                )));
            }
            _ => {}
        }
    }
}

/// Inertia up to which it may be that of a late velocity, over what the lateness makes of the
/// damping.
const OF_A_LAG: f64 = 1.5;

/// Marks an inertia that is no larger than what a velocity column that is `late` by some seconds
/// makes of the damping: the damping of the real velocity is that of the column and that times the
/// lateness of the acceleration.
pub(super) fn inertia_of_a_lag(why: &mut [Option<Refusal>], parameters: &[&Parameters], late: f64) {
    let all = parameters.iter().flat_map(|(params, _)| params);
    let damping: f64 = all
        .filter(|p| p.nature == Nature::Damping)
        .map(|p| p.value)
        .sum();
    let made = OF_A_LAG * late * damping;
    for (why, (params, _)) in why.iter_mut().zip(parameters) {
        let Some(own) = params.iter().find(|p| p.nature == Nature::Inertia) else {
            continue;
        };
        // That of a mass has its weight beside it.
        let alone = params.iter().all(|p| p.nature != Nature::Weight);
        if why.is_none() && alone && own.value * made > 0.0 && own.value.abs() <= made.abs() {
            *why = Some(Against::Itself.refuses(format!(
                "inertia {} is no more than the damping makes of the velocity column, which is {} s late against the slope of the angle",
                num(own.value),
                num(late)
            )));
        }
    }
}

/// Gain error from which a declared prediction is taken away rather than corrected.
const TAKEN_AWAY: f64 = -0.5;

/// Share of what a gain and an inertia are worth together that one of them alone must be worth. Of
/// declared inertias whose stamps scatter by 0.2 to 0.9 of a row it was 0.03 to 0.11.
const WORTH_ALONE: f64 = 0.25;

/// Marks a gain that takes the declared prediction away and an inertia that puts it back, where
/// neither is worth anything without the other: together they are the prediction with a slope of
/// the velocity over another width, which a lag, or stamps that scatter, do as well.
pub(super) fn slope_of_another_width(
    why: &mut [Option<Refusal>],
    search: &Search,
    chosen: &[Chosen],
    weights: &[Weight],
    parameters: &[&Parameters],
) -> Result<(), Error> {
    let of = |at: usize, name: &str| parameters[at].0.iter().find(|p| p.name == name);
    let taken = |at: &usize| {
        let kind = chosen[*at].effect.kind();
        let size = of(*at, "gain_error").map_or(0.0, |p| p.value);
        kind == EffectKind::Gain && size < TAKEN_AWAY
    };
    let put_back = |at: &usize| chosen[*at].effect.kind() == EffectKind::Inertia;
    let (Some(gain), Some(inertia)) = (
        (0..chosen.len()).find(taken),
        (0..chosen.len()).find(put_back),
    ) else {
        return Ok(());
    };
    let others = (0..chosen.len()).filter(|at| *at != gain && *at != inertia);
    let others: Vec<Chosen> = others.map(|at| chosen[at].clone()).collect();
    let neither = search.rmse(&others)?.powi(2);
    let both = weights.first().map_or(neither, |w| w.rmse.powi(2));
    let alone = |other: usize| {
        let without = weights.iter().find(|w| w.index == other);
        neither - without.map_or(neither, |w| w.rmse_without.powi(2))
    };
    let little = WORTH_ALONE * (neither - both);
    if alone(gain) < little && alone(inertia) < little {
        for at in [gain, inertia] {
            why[at] = Some(Against::AsASeries.refuses(
                "the gain takes the declared prediction away and the inertia puts it back: together they are the declared prediction with a slope of the velocity over another width; look at the time stamps, a lag of the velocity, and the half width of deriv() in the declared terms"
                    .to_owned(),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::reasons::tests::weights;
    use super::*;

    fn parameter(nature: Nature, value: f64) -> Parameters {
        let param = Param::new("", value, "").being(nature);
        (vec![param], Default::default())
    }

    #[test]
    fn of_two_with_unlike_signs_the_weaker_is_none() {
        use Nature::{Damping, Friction, Inertia, Other, Stiffness};
        let of = |natures: [Nature; 3], values: [f64; 3]| {
            let all = natures.into_iter().zip(values);
            let parameters: Vec<Parameters> = all.map(|(n, v)| parameter(n, v)).collect();
            let mut why = vec![None; 3];
            let weights = weights(&[1.1, 3.0, 2.0]);
            contradictions(&mut why, &weights, &parameters.iter().collect::<Vec<_>>());
            why.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        let with = |values| of([Inertia; 3], values);
        assert_eq!(with([0.1, 0.2, 0.3]), [false, false, false]);
        assert_eq!(with([-0.1, 0.2, 0.3]), [true, false, false]);
        // A spring pulls back as inertia does.
        let all = [Stiffness, Inertia, Damping];
        assert_eq!(of(all, [-0.1, 0.2, 0.3]), [true, false, false]);
        // The sign is that of the most valuable one, whatever it is.
        assert_eq!(with([0.1, -0.2, 0.3]), [true, false, true]);
        // The loop of a position is friction, that of a load is not.
        let beside = |a_loop| of([Inertia, a_loop, Damping], [0.1, -0.2, 0.3]);
        assert_eq!(beside(Friction), [true, false, true]);
        assert_eq!(beside(Other), [false, false, false]);
    }

    #[test]
    fn a_value_without_a_sign_contradicts_nothing() {
        let of = |interval: [f64; 2]| {
            let mut parameters = [
                parameter(Nature::Friction, -0.4),
                parameter(Nature::Friction, 0.19),
            ];
            parameters[1].1.insert(String::new(), interval);
            let mut why = vec![None; 2];
            let weights = weights(&[3.0, 2.0]);
            contradictions(&mut why, &weights, &parameters.iter().collect::<Vec<_>>());
            why.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        assert_eq!(of([-0.18, 0.56]), [false, false]);
        assert_eq!(of([0.05, 0.33]), [false, true]);
    }

    #[test]
    fn a_weight_pushes_away_from_an_unstable_point() {
        let of = |nature: Nature| {
            let parameters = [parameter(Nature::Friction, 0.5), parameter(nature, -2.0)];
            let mut why = vec![None; 2];
            let weights = weights(&[3.0, 2.0]);
            contradictions(&mut why, &weights, &parameters.iter().collect::<Vec<_>>());
            assert!(why[0].is_none());
            why[1].is_some()
        };
        assert!(!of(Nature::Unstable) && of(Nature::Stiffness));
    }

    #[test]
    fn an_inertia_that_a_late_velocity_makes_of_damping_is_none() {
        let refused = |inertia: f64, late: f64| {
            let parameters = [
                parameter(Nature::Damping, -2.0),
                parameter(Nature::Inertia, inertia),
            ];
            let mut why = vec![None; 2];
            inertia_of_a_lag(&mut why, &parameters.iter().collect::<Vec<_>>(), late);
            assert!(why[0].is_none());
            why[1].is_some()
        };
        assert!(refused(-0.04, 0.02) && refused(-0.055, 0.02));
        assert!(!refused(-0.07, 0.02) && !refused(0.04, 0.02) && !refused(-0.04, 0.005));
    }
}

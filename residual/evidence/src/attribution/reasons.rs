//! Why names are not supported that their own parameters allow: too weak, not needed, no help on
//! check data.

use super::refusal::{Against, Refusal};
use crate::check::Checked;
use crate::intervals::Parameters;
use crate::leftover::Forms;
use residual_columns::error::Error;
use residual_columns::format::{num, percent};
use residual_effects::{Nature, Param};
use residual_search::model::Chosen;
use residual_search::{without, Outcome, Search, Weight};

/// Why the name of each effect is not supported, where its own parameters do not stand against it.
pub(super) fn reasons(
    search: &Search,
    outcome: &Outcome,
    weights: &[Weight],
    parameters: &[Option<Parameters>],
    forms: &Forms,
    check: Option<&Checked>,
) -> Result<Vec<Option<Refusal>>, Error> {
    let rows = search.problem.y.len() as f64;
    let mut why: Vec<Option<Refusal>> = vec![None; outcome.chosen.len()];
    for w in weights {
        let own = rows * (w.rmse_without.powi(2) - w.rmse.powi(2));
        let weaker = || {
            let (depends_on, squares) = forms.strongest().filter(|(_, squares)| *squares >= own)?;
            let share =
                |squares: f64| percent(1.0 - w.rmse / (w.rmse.powi(2) + squares / rows).sqrt());
            Some(format!(
                "without it the held-out RMSE is {} larger, which is not more than what structure without a name still \
                 explains ({}: {})",
                percent(w.rmse_without / w.rmse - 1.0),
                depends_on,
                share(squares)
            ))
        };
        let own = &outcome.chosen[w.index];
        why[w.index] = parameters[w.index]
            .as_ref()
            .and_then(|parameters| undetermined(own, parameters))
            .or_else(weaker)
            .map(|why| Against::Others.refuses(why));
    }
    if why.iter().all(Option::is_none) && outcome.standings.is_empty() {
        // The search saw to it; without other effects it may be otherwise.
        worthless(&mut why, weights, search.spec.selection.material);
    }
    if let Some(check) = check {
        let with = check.rmse(search, &outcome.chosen)?;
        for (i, why) in why.iter_mut().enumerate().filter(|(_, w)| w.is_none()) {
            let mut rest = without(&outcome.chosen, i).1;
            // Beside this one the others may have taken values that they would not have alone.
            if search.thin.is_none() {
                search.polish(&mut rest)?;
            }
            let without = check.rmse(search, &rest)?;
            if without <= with {
                *why = Some(Against::Check(with / without).refuses(format!(
                    "on the check data it does not help: RMSE {} with it and {} without",
                    num(with),
                    num(without)
                )));
            }
        }
        let declared = check.rmse(search, &[])?;
        if why.iter().all(Option::is_none) && with > declared {
            if let Some(weakest) = weights.last() {
                why[weakest.index] = Some(Against::Check(with / declared).refuses(format!(
                    "on the check data the model with the effects is worse than the declared one: RMSE {} and {}",
                    num(with),
                    num(declared)
                )));
            }
        }
    }
    Ok(why)
}

/// Marks the weakest effect if it is worth less than half of what counts, as in the search.
fn worthless(why: &mut [Option<Refusal>], weights: &[Weight], material: f64) {
    let Some(weakest) = weights.last() else {
        return;
    };
    let loss = 1.0 - weakest.rmse / weakest.rmse_without.max(f64::MIN_POSITIVE);
    if loss < 0.5 * material {
        why[weakest.index] = Some(Against::Others.refuses(format!(
            "beside the other effects found it lowers the held-out RMSE by {} only",
            percent(loss)
        )));
    }
}

/// Why the coefficients of an effect say nothing, if the interval of each that carries its name
/// contains 0. A mass is told from an inertia by its weight.
fn undetermined(own: &Chosen, (params, intervals): &Parameters) -> Option<String> {
    let shape = own.variant.psi.as_ref().map(|p| p.name);
    let has_weight = params.iter().any(|p| p.nature == Nature::Weight);
    let carries = |nature: Nature| match nature {
        Nature::Inertia => !has_weight,
        nature => nature.carries_the_name(),
    };
    let sizes: Vec<_> = params
        .iter()
        .filter(|p| Some(p.name.as_str()) != shape && carries(p.nature))
        .map(|p| (p, intervals.get(&p.name)))
        .collect();
    let zero = |(_, interval): &(&Param, Option<&[f64; 2]>)| {
        interval.is_some_and(|[low, high]| *low <= 0.0 && *high >= 0.0)
    };
    let (first, interval) = sizes.first().filter(|_| sizes.iter().all(zero))?;
    let [low, high] = (*interval)?;
    Some(format!(
        "{} {} lies between {} and {}{}: it may as well be 0",
        first.name,
        num(first.value),
        num(*low),
        num(*high),
        if sizes.len() > 1 {
            ", and so do the others"
        } else {
            ""
        }
    ))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use residual_effects::EffectKind;

    pub fn weights(rmse_without: &[f64]) -> Vec<Weight> {
        let weight = |(index, rmse_without): (usize, &f64)| Weight {
            index,
            rmse: 1.0,
            rmse_without: *rmse_without,
        };
        let mut out: Vec<Weight> = rmse_without.iter().enumerate().map(weight).collect();
        out.sort_by(|a, b| b.rmse_without.total_cmp(&a.rmse_without));
        out
    }

    /// The gain at mid-range is certain, and that it changes with the temperature is not.
    #[test]
    fn a_name_needs_the_parameter_that_carries_it() {
        let own = Chosen {
            effect: residual_effects::effect(EffectKind::DriftTemperature),
            variant: std::sync::Arc::new(residual_effects::Variant::linear("of gain", vec![])),
            psi: 0.0,
        };
        let says = |per_degree: [f64; 2]| {
            let all = [
                ("gain_per_degree", per_degree),
                ("gain_error_at_mid_range", [0.8, 1.0]),
            ];
            let natures = [Nature::Other, Nature::Beside];
            let params = all
                .iter()
                .zip(natures)
                .map(|((name, [low, high]), nature)| {
                    Param::new(*name, 0.5 * (low + high), "").being(nature)
                });
            let params = params.collect();
            let intervals = all
                .map(|(name, interval)| (name.to_string(), interval))
                .into();
            undetermined(&own, &(params, intervals)).is_some()
        };
        assert!(says([-0.1, 0.1]) && !says([0.1, 0.2]));
    }

    #[test]
    fn a_mass_needs_its_weight() {
        let own = Chosen {
            effect: residual_effects::effect(EffectKind::Payload),
            variant: std::sync::Arc::new(residual_effects::Variant::linear(
                "mass on angle",
                vec![],
            )),
            psi: 0.0,
        };
        let says = |sine: [f64; 2], cosine: [f64; 2]| {
            let all = [
                ("weight_sine", sine, Nature::Weight),
                ("weight_cosine", cosine, Nature::Weight),
                ("inertia", [0.1, 0.2], Nature::Inertia),
            ];
            let params = all.map(|(name, [low, high], nature)| {
                Param::new(name, low.midpoint(high), "").being(nature)
            });
            let intervals = all.map(|(name, interval, _)| (name.to_string(), interval));
            undetermined(&own, &(params.to_vec(), intervals.into())).is_some()
        };
        assert!(says([-0.1, 0.2], [-0.2, 0.1]));
        assert!(!says([-0.1, 0.2], [0.1, 0.2]) && !says([-0.2, -0.1], [-0.2, 0.1]));
    }

    #[test]
    fn the_weakest_goes_if_it_is_worth_less_than_half_of_what_counts() {
        let of = |rmse_without: &[f64]| {
            let mut why = vec![None; rmse_without.len()];
            worthless(&mut why, &weights(rmse_without), 0.02);
            why.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        assert_eq!(of(&[1.5, 1.005, 1.008]), [false, true, false]);
        assert_eq!(of(&[1.5, 1.02]), [false, false]);
        assert_eq!(of(&[]), [false; 0]);
    }
}

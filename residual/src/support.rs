//! Which of the effects that improve the fit have a name that the data support.
//!
//! A name counts as *found* only if all of this holds:
//! * its own share, the rise of the held-out squared error when it alone is removed and the rest is fitted again, is
//!   larger than the strongest structure without a name that is left;
//! * its parameters are possible ([`Effect::impossible`](crate::effects::Effect::impossible)), and do not contradict those of
//!   another effect;
//! * it is worth something beside the other found effects alone;
//! * on data that the search has not seen, where there are such data, the model is better with it than without.
//!
//! The others still improve the fit. They are reported in a list of their own.

use crate::check::Checked;
use crate::effects::{Context, Estimate};
use crate::error::Error;
use crate::format::{num, percent};
use crate::intervals::{parameters, Parameters};
use crate::leftover::Leftover;
use crate::search::{Outcome, Search, Weight};

/// Times that the found effects are judged again after others were taken away.
const ROUNDS: usize = 8;

/// Effects that improve the fit under a name that the data do not support.
pub(crate) struct Beside {
    /// The model with all effects.
    pub outcome: Outcome,
    /// What each is worth there, the most valuable first.
    pub weights: Vec<Weight>,
    /// Their parameters there.
    pub parameters: Vec<Parameters>,
    /// Why the name of each is not supported, by index among the chosen effects; `None` for those found.
    pub why: Vec<Option<String>>,
}

/// Final model with the found effects alone.
pub(crate) struct Supported {
    pub outcome: Outcome,
    pub left: Leftover,
    pub weights: Vec<Weight>,
    pub parameters: Vec<Parameters>,
    /// What else improves the fit; `None` if everything is found.
    pub beside: Option<Beside>,
}

/// Parameters of every chosen effect.
fn all_parameters(search: &Search, outcome: &Outcome) -> Result<Vec<Parameters>, Error> {
    (0..outcome.chosen.len())
        .map(|index| parameters(search, &outcome.chosen, index))
        .collect()
}

/// Why an effect with these parameters is impossible, if it is.
fn impossible(
    ctx: &Context,
    outcome: &Outcome,
    index: usize,
    parameters: &Parameters,
) -> Option<String> {
    let own = &outcome.chosen[index];
    own.effect.impossible(
        &Estimate {
            form: own.variant.form,
            label: &own.variant.label,
            params: &parameters.0,
            intervals: &parameters.1,
        },
        ctx,
    )
}

/// Parts the effects of the search into found ones and others, and fits the found ones alone.
pub(crate) fn supported(
    search: &mut Search,
    outcome: Outcome,
    left: Leftover,
    check: Option<&Checked>,
) -> Result<Supported, Error> {
    let weights = search.weights(&outcome)?;
    let parameters = all_parameters(search, &outcome)?;
    let why = reasons(search, &outcome, &weights, &parameters, &left, check)?;
    if why.iter().all(Option::is_none) {
        return Ok(Supported {
            outcome,
            left,
            weights,
            parameters,
            beside: None,
        });
    }
    let mut beside = Beside {
        outcome,
        weights,
        parameters,
        why,
    };
    for _ in 0..ROUNDS {
        let kept: Vec<usize> = (0..beside.why.len())
            .filter(|i| beside.why[*i].is_none())
            .collect();
        let outcome = search.only(&beside.outcome, &kept)?;
        let parameters = all_parameters(search, &outcome)?;
        let ctx = search.scan_on(&search.declared).context();
        let weights = search.weights(&outcome)?;
        // Alone, an effect may come out otherwise.
        let mut now: Vec<Option<String>> = (0..kept.len())
            .map(|k| impossible(&ctx, &outcome, k, &parameters[k]))
            .collect();
        drop(ctx);
        contradictions(&mut now, &weights, &parameters);
        if now.iter().all(Option::is_none) {
            worthless(&mut now, &weights, search.spec.selection.material);
        }
        if now.iter().all(Option::is_none) {
            let frame = search.problem.kept_frame();
            let mut left = Leftover::new(search, &outcome, &frame)?;
            if kept.is_empty() {
                left.only_unsupported(&beside);
            }
            return Ok(Supported {
                outcome,
                left,
                weights,
                parameters,
                beside: Some(beside),
            });
        }
        for (k, reason) in kept.iter().zip(now) {
            beside.why[*k] = reason;
        }
    }
    // Every round takes an effect away; with more effects than rounds, nothing is called found.
    for why in &mut beside.why {
        why.get_or_insert_with(|| "its parameters depend on the other effects".into());
    }
    let outcome = search.only(&beside.outcome, &[])?;
    let frame = search.problem.kept_frame();
    let mut left = Leftover::new(search, &outcome, &frame)?;
    left.only_unsupported(&beside);
    Ok(Supported {
        outcome,
        left,
        weights: vec![],
        parameters: vec![],
        beside: Some(beside),
    })
}

/// Marks effects that contradict each other: one acceleration has one inertia. Of two with unlike signs the one that is
/// worth less is no inertia but a correction of the other.
fn contradictions(why: &mut [Option<String>], weights: &[Weight], parameters: &[Parameters]) {
    let inertia = |index: usize| {
        let own = parameters[index].0.iter().find(|p| p.name == "inertia");
        own.map(|p| p.value)
    };
    // The most valuable first.
    let mut first: Option<f64> = None;
    for w in weights {
        match (inertia(w.index), first) {
            (Some(own), None) => first = Some(own),
            (Some(own), Some(other)) if own * other < 0.0 => {
                why[w.index].get_or_insert_with(|| {
                    format!(
                        "inertia {} beside {} of another effect: one motion has one inertia",
                        num(own),
                        num(other)
                    )
                });
            }
            _ => {}
        }
    }
}

/// Marks the weakest effect if it is worth less than half of what counts, as in the search.
fn worthless(why: &mut [Option<String>], weights: &[Weight], material: f64) {
    let Some(weakest) = weights.last() else {
        return;
    };
    let loss = 1.0 - weakest.rmse / weakest.rmse_without.max(f64::MIN_POSITIVE);
    if loss < 0.5 * material {
        why[weakest.index] = Some(format!(
            "beside the other effects found it lowers the held-out RMSE by {} only",
            percent(loss)
        ));
    }
}

/// Why the name of each effect is not supported.
fn reasons(
    search: &Search,
    outcome: &Outcome,
    weights: &[Weight],
    parameters: &[Parameters],
    left: &Leftover,
    check: Option<&Checked>,
) -> Result<Vec<Option<String>>, Error> {
    let ctx = search.scan_on(&search.declared).context();
    let rows = search.problem.y.len() as f64;
    let mut why: Vec<Option<String>> = vec![None; outcome.chosen.len()];
    for w in weights {
        let own = rows * (w.rmse_without.powi(2) - w.rmse.powi(2));
        let weaker = || {
            let strongest = left.strongest.as_ref().filter(|s| s.squares >= own)?;
            let share =
                |squares: f64| percent(1.0 - w.rmse / (w.rmse.powi(2) + squares / rows).sqrt());
            Some(format!(
                "without it the held-out RMSE is {} larger, which is not more than what structure without a name still \
                 explains ({}: {})",
                percent(w.rmse_without / w.rmse - 1.0),
                strongest.depends_on,
                share(strongest.squares)
            ))
        };
        why[w.index] = impossible(&ctx, outcome, w.index, &parameters[w.index]).or_else(weaker);
    }
    contradictions(&mut why, weights, parameters);
    if let Some(check) = check {
        let with = check.rmse(search, &outcome.chosen)?;
        for (i, why) in why.iter_mut().enumerate().filter(|(_, w)| w.is_none()) {
            let without = check.rmse(search, &crate::search::without(&outcome.chosen, i).1)?;
            if without <= with {
                *why = Some(format!(
                    "on the check data it does not help: RMSE {} with it and {} without",
                    num(with),
                    num(without)
                ));
            }
        }
    }
    Ok(why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Param;

    fn weights(rmse_without: &[f64]) -> Vec<Weight> {
        let weight = |(index, rmse_without): (usize, &f64)| Weight {
            index,
            rmse: 1.0,
            rmse_without: *rmse_without,
        };
        let mut out: Vec<Weight> = rmse_without.iter().enumerate().map(weight).collect();
        out.sort_by(|a, b| b.rmse_without.total_cmp(&a.rmse_without));
        out
    }

    #[test]
    fn of_two_inertias_with_unlike_signs_the_weaker_is_none() {
        let with = |values: [f64; 3]| {
            let parameters = values.map(|value| {
                let own = Param {
                    name: "inertia".into(),
                    value,
                    unit: String::new(),
                };
                (vec![own], Default::default())
            });
            let mut why = vec![None; 3];
            contradictions(&mut why, &weights(&[1.1, 3.0, 2.0]), &parameters);
            why.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        assert_eq!(with([0.1, 0.2, 0.3]), [false, false, false]);
        assert_eq!(with([-0.1, 0.2, 0.3]), [true, false, false]);
        // The sign is that of the most valuable one, whatever it is.
        assert_eq!(with([0.1, -0.2, 0.3]), [true, false, true]);
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

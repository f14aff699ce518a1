//! Attribution: which of the effects that improve the fit have a name that the data support.
//!
//! A name counts as *found* only if all of this holds:
//! * its own share, the rise of the held-out squared error when it alone is removed and the rest is
//!   fitted again, is larger than the strongest structure without a name that is left;
//! * its parameters are possible ([`Effect::impossible`](residual_effects::Effect::impossible)),
//!   and do not contradict those of another effect;
//! * it does not, with others, take the shape of any curve over the angle;
//! * it is the law of what it explains: no free form that contains it predicts better, and no curve
//!   with as few parameters does as well as its sum with others;
//! * it does not act in one sequence alone;
//! * it is worth something beside the other found effects alone;
//! * on data that the search has not seen, where there are such data, the model is better with it
//!   than without.
//!
//! The others still improve the fit. They are reported in a list of their own.

mod assessment;
mod contradiction;
mod equal;
mod free_curve;
mod images;
mod one_sequence;
mod order;
mod over_the_angle;
mod reasons;
mod refusal;

use crate::check::Checked;
use crate::intervals::{parameters, Parameters};
use crate::leftover::Leftover;
use assessment::Assessment;
use equal::equal_path;
pub use equal::EqualPath;
use residual_columns::error::Error;
use residual_effects::EffectKind;
use residual_search::model::Chosen;
use residual_search::ranking::Step;
use residual_search::{Outcome, Search, Standing, Weight};

/// Effects that are taken away one at a time, with a search after each. Then all that are refused
/// go at once, without a search. Raised from 3 and 8 when a round came to take one effect only.
const ROUNDS: usize = 12;

/// Effects that improve the fit under a name that the data do not support.
pub struct Improving {
    /// The model with all effects.
    pub outcome: Outcome,
    /// What each is worth there, the most valuable first.
    pub weights: Vec<Weight>,
    /// Their parameters there.
    pub parameters: Vec<Parameters>,
    /// Why the name of each is not supported, by index among the chosen effects; `None` for those
    /// found.
    pub why: Vec<Option<String>>,
}

/// Final model with the found effects alone.
pub struct Attributed {
    /// The model with the effects found.
    pub outcome: Outcome,
    /// What it leaves.
    pub left: Leftover,
    /// What each effect is worth, the most valuable first.
    pub weights: Vec<Weight>,
    /// Their parameters.
    pub parameters: Vec<Parameters>,
    /// What else improves the fit; `None` if everything is found.
    pub improving: Option<Improving>,
    /// Other names that predict as well.
    pub equal: Vec<EqualPath>,
    /// Paths that predict as well and were not judged.
    pub not_judged: usize,
}

/// The effects of the whole search, without the fit to all rows, which takes much memory.
struct First {
    chosen: Vec<Chosen>,
    standings: Vec<Standing>,
    last: Step,
    limited: Option<EffectKind>,
    weights: Vec<Weight>,
    parameters: Vec<Option<Parameters>>,
}

impl First {
    fn of(now: Assessment) -> First {
        let Outcome {
            chosen,
            standings,
            last,
            limited,
            ..
        } = now.outcome;
        First {
            chosen,
            standings,
            last,
            limited,
            weights: now.weights,
            parameters: now.parameters,
        }
    }

    /// What is reported to improve the fit beside the effects `found`.
    fn improving(
        self,
        search: &Search,
        found: &[Chosen],
        refused: &[Refused],
    ) -> Result<Improving, Error> {
        Ok(Improving {
            why: unsupported(&self.chosen, found, refused),
            parameters: all_parameters(search, &self.chosen, self.parameters)?,
            outcome: Outcome {
                fitted: search.fit(&self.chosen)?,
                chosen: self.chosen,
                standings: self.standings,
                last: self.last,
                limited: self.limited,
            },
            weights: self.weights,
        })
    }
}

/// An effect whose name is not supported, and why.
struct Refused {
    effect: Chosen,
    why: String,
}

/// What is left of a path when the names that the data do not support are gone.
struct Supported {
    now: Assessment,
    /// What it was before; `None` if no name is gone.
    first: Option<First>,
    refused: Vec<Refused>,
}

/// Parts the effects of the search into found ones and others, and fits the found ones alone.
///
/// The weakest effect whose name is not supported is taken away, and the search goes on without its
/// name. Then the others are judged again: effects that share what they explain, as two forms of
/// friction do, look worthless beside each other, and one of them may be right; and a wrong name
/// may have kept the right one out. An effect that was only too weak beside a wrong one is looked
/// for again. Where rows are many each of these searches takes long, and several weak ones go at
/// once.
///
/// The paths that predict as well are judged in the same way, each with its own load. Where names
/// of the path that was taken are refused, the one with the best model of supported names is
/// reported. The supported names of the others, where they predict as well, may stand for those
/// found.
pub fn attribute(
    search: &mut Search,
    outcome: Outcome,
    check: Option<&Checked>,
) -> Result<Attributed, Error> {
    let paths = std::mem::take(&mut search.equal_paths);
    let mut best = supported(search, outcome, check)?;
    let mut others: Vec<Outcome> = Vec::new();
    for path in paths {
        let place = search.leave();
        let outcome = search.take(path);
        let mut other = supported(search, outcome, check)?;
        let rmse = |s: &Supported| s.now.outcome.fitted.rmse();
        let most = rmse(&best) * (1.0 - search.spec.selection.material);
        if best.first.is_some() && rmse(&other) < most {
            std::mem::swap(&mut best, &mut other);
        } else {
            search.go_back(place);
        }
        others.push(other.now.outcome);
    }
    let mut equal: Vec<EqualPath> = Vec::new();
    for other in &others {
        let new = equal_path(search, &best.now.outcome, &best.refused, other);
        let known = |new: &EqualPath| {
            let same = |p: &EqualPath| p.effects == new.effects && p.instead == new.instead;
            equal.iter().any(same)
        };
        equal.extend(new.filter(|new| !known(new)));
    }
    let found = &best.now.outcome;
    for index in 0..found.chosen.len() {
        let known = |new: &EqualPath| equal.iter().any(|p| p.effects == new.effects);
        let ripple = order::ripple_in_place(search, found, index)?;
        equal.extend(ripple.filter(|new| !known(new)));
    }
    Ok(Attributed {
        equal,
        not_judged: search.more_equal_paths,
        ..attributed(search, best)?
    })
}

/// Takes away the effects of a path whose names the data do not support.
fn supported(
    search: &mut Search,
    outcome: Outcome,
    check: Option<&Checked>,
) -> Result<Supported, Error> {
    let mut now = Assessment::new(search, outcome, check)?;
    let mut first: Option<First> = None;
    let mut refused: Vec<Refused> = Vec::new();
    for round in 0.. {
        let mut gone = now.next_refused(search)?;
        if gone.is_empty() {
            break;
        }
        let last_round = round >= ROUNDS;
        if last_round {
            gone = (0..now.why.len())
                .filter(|i| now.why[*i].is_some())
                .collect();
        }
        let mut kept = Vec::new();
        for (i, effect) in now.outcome.chosen.iter().enumerate() {
            let Some(refusal) = now.why[i].clone().filter(|_| gone.contains(&i)) else {
                kept.push(effect.clone());
                continue;
            };
            if !last_round {
                search.bar(effect.effect.kind(), !refusal.against.is_final());
            }
            refused.push(Refused {
                effect: effect.clone(),
                why: refusal.why,
            });
        }
        let last = First::of(now);
        first.get_or_insert(last);
        let outcome = search.resume(kept, !last_round)?;
        now = Assessment::new(search, outcome, check)?;
    }
    Ok(Supported {
        now,
        first,
        refused,
    })
}

/// What is reported of the path on which the search is.
fn attributed(search: &mut Search, path: Supported) -> Result<Attributed, Error> {
    let Supported {
        mut now,
        first,
        refused,
    } = path;
    let mut left = now.left(search)?;
    let parameters = all_parameters(search, &now.outcome.chosen, now.parameters)?;
    let improving = first
        .map(|first| first.improving(search, &now.outcome.chosen, &refused))
        .transpose()?;
    if let Some(all) = &improving {
        if now.outcome.chosen.is_empty() {
            left.only_unsupported(&all.outcome.chosen, &all.weights);
        }
        // Its rivals are those beside the effects found.
        search.judge_again(&mut now.outcome)?;
    }
    Ok(Attributed {
        outcome: now.outcome,
        left,
        equal: vec![],
        not_judged: 0,
        weights: now.weights,
        parameters,
        improving,
    })
}

/// For each effect of the whole search why its name is not supported; `None` for those among the
/// `found`.
fn unsupported(all: &[Chosen], found: &[Chosen], refused: &[Refused]) -> Vec<Option<String>> {
    let mut places: Vec<Option<usize>> = vec![None; all.len()];
    for f in found {
        // Of several ripples each one found stands for the nearest.
        let near = |i: &usize| (all[*i].psi - f.psi).abs();
        let own = (0..all.len()).filter(|i| places[*i].is_none() && all[*i].is_form(f));
        if let Some(i) = own.min_by(|a, b| near(a).total_cmp(&near(b))) {
            places[i] = Some(i);
        }
    }
    all.iter()
        .zip(&places)
        .map(|(own, place)| {
            if place.is_some() {
                return None;
            }
            let near = |r: &&Refused| (r.effect.psi - own.psi).abs();
            let known = refused.iter().filter(|r| r.effect.is_form(own));
            Some(
                known
                    .min_by(|a, b| near(a).total_cmp(&near(b)))
                    .map_or_else(
                        || {
                            "without the effects whose names are not supported it adds nothing"
                                .to_string()
                        },
                        |r| r.why.clone(),
                    ),
            )
        })
        .collect()
}

/// Parameters of every effect; `known` are those that were needed so far.
fn all_parameters(
    search: &Search,
    chosen: &[Chosen],
    known: Vec<Option<Parameters>>,
) -> Result<Vec<Parameters>, Error> {
    let of = |(index, known): (usize, Option<Parameters>)| match known {
        Some(own) => Ok(own),
        None => parameters(search, chosen, index),
    };
    known.into_iter().enumerate().map(of).collect()
}

//! Which of the effects that improve the fit have a name that the data support.
//!
//! A name counts as *found* only if all of this holds:
//! * its own share, the rise of the held-out squared error when it alone is removed and the rest is fitted again, is
//!   larger than the strongest structure without a name that is left;
//! * its parameters are possible ([`Effect::impossible`](residual_effects::Effect::impossible)), and do not contradict those of
//!   another effect;
//! * it is worth something beside the other found effects alone;
//! * on data that the search has not seen, where there are such data, the model is better with it than without.
//!
//! The others still improve the fit. They are reported in a list of their own.

use crate::check::Checked;
use crate::intervals::{parameters, Parameters};
use crate::leftover::{Forms, Leftover};
use residual_columns::error::Error;
use residual_columns::format::{num, percent};
use residual_effects::{Build, Context, EffectKind, Estimate, Param};
use residual_search::model::Chosen;
use residual_search::ranking::Step;
use residual_search::{without, Outcome, Search, Standing, Weight};

/// Effects that are taken away one at a time, with a search after each. Then all that are refused go at once, without a search.
const ROUNDS: usize = 12;

/// Parameters of dry friction, of damping, of inertia and of a spring.
const OF_ONE_SIGN: [&str; 8] = [
    "friction",
    "damping",
    "drag",
    "friction_at_zero_load",
    "held_friction",
    "sliding_friction",
    "inertia",
    "stiffness",
];

/// Effects that improve the fit under a name that the data do not support.
pub struct Beside {
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
pub struct Supported {
    /// The model with the effects found.
    pub outcome: Outcome,
    /// What it leaves.
    pub left: Leftover,
    /// What each effect is worth, the most valuable first.
    pub weights: Vec<Weight>,
    /// Their parameters.
    pub parameters: Vec<Parameters>,
    /// What else improves the fit; `None` if everything is found.
    pub beside: Option<Beside>,
}

/// Why an effect with these parameters is impossible, if it is.
fn impossible(
    ctx: &Context,
    outcome: &Outcome,
    index: usize,
    parameters: &Parameters,
) -> Option<String> {
    let own = &outcome.chosen[index];
    let estimate = Estimate {
        form: own.variant.form,
        label: &own.variant.label,
        params: &parameters.0,
        intervals: &parameters.1,
    };
    own.effect.impossible(&estimate, ctx)
}

/// Why an effect cannot be what its name says beside the others, if it cannot. What the search saw to when it was chosen may
/// be otherwise with effects that were chosen later.
fn contrary(
    search: &Search,
    ctx: &Context,
    chosen: &[Chosen],
    index: usize,
) -> Result<Option<String>, Error> {
    let (own, rest) = without(chosen, index);
    let simpler = own.effect.must_surpass(&own.variant, own.psi, ctx);
    if !own.variant.has_conditions() && simpler.is_none() {
        return Ok(None);
    }
    let fitted = search.fit(&rest)?;
    let scan = search.scan_on(&fitted);
    if !scan.possible(&own.variant, own.psi) {
        return Ok(Some(
            "beside the other effects its coefficients are not possible for such an effect, as of friction that acts with the motion"
                .to_string(),
        ));
    }
    let Some((simpler, psi)) = simpler.as_ref().and_then(|s| Some((s, s.psi.as_ref()?))) else {
        return Ok(None);
    };
    let most = scan.in_sample(&(own.variant.build)(own.psi));
    let surpassed = |x: &&f64| scan.in_sample(&(simpler.build)(**x)) > most;
    let as_good = psi.grid.iter().find(|x| !surpassed(x));
    Ok(as_good.map(|x| {
        format!(
            "{} of {} {} explains as much",
            simpler.label,
            num(*x),
            psi.unit
        )
    }))
}

/// Why the nonlinear parameter of an effect says nothing, if it lies at the end of the range in which it was looked for.
fn at_end(own: &Chosen) -> Option<String> {
    let psi = own.variant.psi.as_ref()?;
    let [low, high] = psi.at_limits(own.psi);
    let [low_counts, high_counts] = own.effect.may_be_at_end(&own.variant);
    let beyond = (low && !low_counts) || (high && !high_counts);
    beyond.then(|| {
        format!(
            "{} {} lies at the end of the range in which such an effect is looked for: beyond it it is another one",
            psi.name,
            num(own.variant.shown(own.psi))
        )
    })
}

/// Why a name is not supported.
#[derive(Clone)]
struct Refusal {
    why: String,
    against: Against,
}

/// What stands against a name.
#[derive(Clone, Copy, PartialEq)]
enum Against {
    /// Its own parameters.
    Itself,
    /// The check data: the error with it over that without it.
    Check(f64),
    /// Other effects, or what is left: without them it may be supported.
    Others,
}

impl Against {
    fn refuses(self, why: String) -> Refusal {
        Refusal { why, against: self }
    }

    /// In which order effects are taken away; of equal ones the weakest is first.
    fn order(self) -> f64 {
        match self {
            Against::Itself => f64::INFINITY,
            Against::Check(harm) => harm,
            Against::Others => f64::NEG_INFINITY,
        }
    }
}

/// Effects with what decides on their names.
struct Judged {
    outcome: Outcome,
    /// Nameless forms on top of the model; `None` where an effect is refused for its own parameters, whatever is left.
    forms: Option<Forms>,
    weights: Vec<Weight>,
    /// `None` where they were not needed.
    parameters: Vec<Option<Parameters>>,
    /// Why each name is not supported; `None` where it is.
    why: Vec<Option<Refusal>>,
}

impl Judged {
    /// Judges effects.
    ///
    /// One that its own parameters refuse is taken away before any other is looked at: intervals and nameless forms take long
    /// where rows are many, and change without it.
    fn new(
        search: &mut Search,
        outcome: Outcome,
        check: Option<&Checked>,
    ) -> Result<Judged, Error> {
        let weights = search.weights(&outcome)?;
        let mut now = Judged {
            parameters: vec![None; outcome.chosen.len()],
            why: vec![None; outcome.chosen.len()],
            outcome,
            forms: None,
            weights,
        };
        if !now.refused_by_itself(search)? {
            let forms = Forms::new(search, &now.outcome.fitted)?;
            reasons(search, &mut now, &forms, check)?;
            now.forms = Some(forms);
        }
        Ok(now)
    }

    /// Looks for what is left.
    fn left(&mut self, search: &mut Search) -> Result<Leftover, Error> {
        let forms = match self.forms.take() {
            Some(forms) => forms,
            None => Forms::new(search, &self.outcome.fitted)?,
        };
        Leftover::new(search, &self.outcome, forms)
    }

    /// Marks the weakest effect that its own parameters refuse. Whether there is one.
    fn refused_by_itself(&mut self, search: &Search) -> Result<bool, Error> {
        let ctx = search.scan_on(&search.declared).context();
        for index in self.weights.iter().rev().map(|w| w.index) {
            let own = parameters(search, &self.outcome.chosen, index)?;
            let why = match impossible(&ctx, &self.outcome, index, &own) {
                Some(why) => Some(why),
                None => contrary(search, &ctx, &self.outcome.chosen, index)?,
            };
            self.parameters[index] = Some(own);
            // Others may have driven a parameter to the end of its range.
            let chosen = &self.outcome.chosen[index];
            let refusal = why
                .map(|why| Against::Itself.refuses(why))
                .or_else(|| Some(Against::Others.refuses(at_end(chosen)?)));
            if refusal.is_some() {
                self.why[index] = refusal;
                return Ok(true);
            }
        }
        let known: Vec<&Parameters> = self.parameters.iter().flatten().collect();
        let loops: Vec<_> = self.outcome.chosen.iter().map(friction_of_a_loop).collect();
        contradictions(&mut self.why, &self.weights, &loops, &known);
        let has = |name: &str| {
            known
                .iter()
                .any(|(all, _)| all.iter().any(|p| p.name == name))
        };
        if has("inertia") && has("damping") {
            if let Some(late) = ctx.velocity_is_late() {
                inertia_of_a_lag(&mut self.why, &known, late);
            }
        }
        Ok(self.why.iter().any(Option::is_some))
    }

    /// Indices of the effects to take away next, see [`next_gone`]; none if all names are supported.
    fn next_refused(&self, search: &Search) -> Result<Vec<usize>, Error> {
        let of = |w: &Weight| Some((w.index, self.why[w.index].as_ref()?.against.order()));
        // The weights begin with the most valuable.
        let refused: Vec<(usize, f64)> = self.weights.iter().filter_map(of).collect();
        let together = search.thin.is_some();
        let strongest = self.forms.as_ref().and_then(Forms::strongest);
        let least = strongest.map_or(0.0, |(_, squares)| squares);
        let rows = search.problem.y.len() as f64;
        let material = 1.0 - 0.5 * search.spec.selection.material;
        let mut before: Option<(Vec<usize>, f64)> = None;
        next_gone(&refused, together, |others, index| {
            let rmse = |left_out: &[usize]| {
                let kept = self.outcome.chosen.iter().enumerate();
                let kept = kept.filter(|(i, _)| !left_out.contains(i));
                search.rmse(&kept.map(|(_, c)| c.clone()).collect::<Vec<_>>())
            };
            let without = match &before {
                Some((same, rmse)) if same == others => *rmse,
                _ => rmse(others)?,
            };
            let with: Vec<usize> = others.iter().copied().filter(|i| *i != index).collect();
            let with = rmse(&with)?;
            before = Some((others.to_vec(), without));
            let own = rows * (without.powi(2) - with.powi(2));
            Ok(own > least && with < without * material)
        })
    }
}

/// Which of the refused effects, the most valuable first, with their orders, are taken away next: one of them, or `together` those that
/// are only too weak beside others. Of these the most valuable stays, as it may be right, and each that is strong without those that
/// go: of two that share what they explain one may be right. `strong(others, index)` tells whether that effect is, where the
/// `others`, which include it, are left out.
fn next_gone(
    refused: &[(usize, f64)],
    together: bool,
    mut strong: impl FnMut(&[usize], usize) -> Result<bool, Error>,
) -> Result<Vec<usize>, Error> {
    // The last of several equal ones is the weakest.
    let Some((worst, order)) = refused.iter().max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return Ok(vec![]);
    };
    if !together || refused.len() < 3 || *order != Against::Others.order() {
        return Ok(vec![*worst]);
    }
    let mut gone: Vec<usize> = refused[1..].iter().map(|(index, _)| *index).collect();
    for (index, _) in &refused[1..] {
        if strong(&gone, *index)? {
            gone.retain(|i| i != index);
        }
    }
    Ok(if gone.is_empty() { vec![*worst] } else { gone })
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

/// The effects of the whole search, without the fit to all rows, which takes much memory.
struct First {
    chosen: Vec<Chosen>,
    judged: Vec<Standing>,
    last: Step,
    limited: Option<EffectKind>,
    weights: Vec<Weight>,
    parameters: Vec<Option<Parameters>>,
}

impl First {
    fn of(now: Judged) -> First {
        let Outcome {
            chosen,
            judged,
            last,
            limited,
            ..
        } = now.outcome;
        First {
            chosen,
            judged,
            last,
            limited,
            weights: now.weights,
            parameters: now.parameters,
        }
    }

    /// What is reported beside the effects `found`.
    fn beside(
        self,
        search: &Search,
        found: &[Chosen],
        refused: &[Refused],
    ) -> Result<Beside, Error> {
        Ok(Beside {
            why: unsupported(&self.chosen, found, refused),
            parameters: all_parameters(search, &self.chosen, self.parameters)?,
            outcome: Outcome {
                fitted: search.fit(&self.chosen)?,
                chosen: self.chosen,
                judged: self.judged,
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

/// Parts the effects of the search into found ones and others, and fits the found ones alone.
///
/// The weakest effect whose name is not supported is taken away, and the search goes on without its name. Then the others are
/// judged again: effects that share what they explain, as two forms of friction do, look worthless beside each other, and one of
/// them may be right; and a wrong name may have kept the right one out. An effect that was only too weak beside a wrong one is
/// looked for again. Where rows are many each of these searches takes long, and several weak ones go at once.
pub fn supported(
    search: &mut Search,
    outcome: Outcome,
    check: Option<&Checked>,
) -> Result<Supported, Error> {
    let mut now = Judged::new(search, outcome, check)?;
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
                search.bar(effect.effect.kind(), refusal.against != Against::Itself);
            }
            refused.push(Refused {
                effect: effect.clone(),
                why: refusal.why,
            });
        }
        let last = First::of(now);
        first.get_or_insert(last);
        let outcome = search.resume(kept, !last_round)?;
        now = Judged::new(search, outcome, check)?;
    }
    let mut left = now.left(search)?;
    let parameters = all_parameters(search, &now.outcome.chosen, now.parameters)?;
    let beside = first
        .map(|first| first.beside(search, &now.outcome.chosen, &refused))
        .transpose()?;
    if let Some(beside) = &beside {
        if now.outcome.chosen.is_empty() {
            left.only_unsupported(&beside.outcome.chosen, &beside.weights);
        }
        // Its rivals are those beside the effects found.
        search.judge_again(&mut now.outcome)?;
    }
    Ok(Supported {
        outcome: now.outcome,
        left,
        weights: now.weights,
        parameters,
        beside,
    })
}

/// For each effect of the whole search why its name is not supported; `None` for those among the `found`.
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

/// Name of the parameter of an effect that is friction as a loop of the position. A loop of the load is none.
fn friction_of_a_loop(own: &Chosen) -> Option<String> {
    let piece = own.variant.along_friction?;
    match (own.variant.build)(own.psi) {
        Build::Add(pieces) => pieces.get(piece).map(|p| p.name.clone()),
        _ => None,
    }
}

/// Marks effects that contradict each other. Friction takes energy out of a motion, inertia is positive and a spring pulls back, so all of
/// one motion has one sign: for the force of a drive that of the motion, for the force behind it the other. Of two with unlike signs the
/// one that is worth less is none, but a correction of the other.
fn contradictions(
    why: &mut [Option<Refusal>],
    weights: &[Weight],
    loops: &[Option<String>],
    parameters: &[&Parameters],
) {
    let size = |index: usize| {
        parameters[index].0.iter().find(|p| {
            OF_ONE_SIGN.contains(&p.name.as_str()) || loops[index].as_ref() == Some(&p.name)
        })
    };
    // The most valuable first.
    let mut first: Option<&Param> = None;
    for w in weights {
        if why[w.index].is_some() {
            continue;
        }
        match (size(w.index), first) {
            (Some(own), None) => first = Some(own),
            (Some(own), Some(other)) if own.value * other.value < 0.0 => {
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

/// Inertia up to which it may be that of a late velocity, over what the lateness makes of the damping.
const OF_A_LAG: f64 = 1.5;

/// Marks an inertia that is no larger than what a velocity column that is `late` by some seconds makes of the damping: the damping of the
/// real velocity is that of the column and that times the lateness of the acceleration.
fn inertia_of_a_lag(why: &mut [Option<Refusal>], parameters: &[&Parameters], late: f64) {
    let all = parameters.iter().flat_map(|(params, _)| params);
    let damping: f64 = all.filter(|p| p.name == "damping").map(|p| p.value).sum();
    let made = OF_A_LAG * late * damping;
    for (why, (params, _)) in why.iter_mut().zip(parameters) {
        let Some(own) = params.iter().find(|p| p.name == "inertia") else {
            continue;
        };
        // That of a mass has its weight beside it.
        let alone = params.iter().all(|p| !p.name.starts_with("weight"));
        if why.is_none() && alone && own.value * made > 0.0 && own.value.abs() <= made.abs() {
            *why = Some(Against::Itself.refuses(format!(
                "inertia {} is no more than the damping makes of the velocity column, which is {} s late against the slope of the angle",
                num(own.value),
                num(late)
            )));
        }
    }
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

/// Why the name of each effect is not supported, where its own parameters do not stand against it.
fn reasons(
    search: &Search,
    now: &mut Judged,
    forms: &Forms,
    check: Option<&Checked>,
) -> Result<(), Error> {
    let (outcome, weights) = (&now.outcome, &now.weights);
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
        why[w.index] = now.parameters[w.index]
            .as_ref()
            .and_then(|parameters| undetermined(own, parameters))
            .or_else(weaker)
            .map(|why| Against::Others.refuses(why));
    }
    if why.iter().all(Option::is_none) && outcome.judged.is_empty() {
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
    now.why = why;
    Ok(())
}

/// Parameters that an effect has beside those that carry its name: they may be certain where the effect is not.
const BESIDE_THE_NAME: [&str; 4] = [
    "phase",
    "before_first_motion",
    "error_at_mid_range",
    "gain_error_at_mid_range",
];

/// Why the coefficients of an effect say nothing, if the interval of each that carries its name contains 0.
fn undetermined(own: &Chosen, (params, intervals): &Parameters) -> Option<String> {
    let shape = own.variant.psi.as_ref().map(|p| p.name);
    let sizes: Vec<_> = params
        .iter()
        .filter(|p| Some(p.name.as_str()) != shape && !BESIDE_THE_NAME.contains(&p.name.as_str()))
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
mod tests {
    use super::*;
    use residual_effects::Param;

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

    /// Beyond the longest distance of a presliding friction it is a hysteresis; below the shortest it holds at rest all the same.
    #[test]
    fn a_parameter_at_the_end_of_its_range_says_nothing() {
        use residual_effects::{effect, Form, Piece, Psi, Variant};
        let chosen = |kind, form, psi| {
            let range = Psi {
                name: "distance",
                unit: "rad".into(),
                grid: vec![0.01, 0.1, 1.0],
                refine: true,
                resolution: None,
            };
            let build = |_| Build::Add(vec![Piece::new("friction", "N", "velocity")]);
            Chosen {
                effect: effect(kind),
                variant: std::sync::Arc::new(Variant::profiled("", range, build).form(form)),
                psi,
            }
        };
        let ends = |kind, form| {
            [0.006, 0.007, 0.0072, 1.2, 1.4, 1.5]
                .map(|psi| at_end(&chosen(kind, form, psi)).is_some())
        };
        let own = ends(EffectKind::Presliding, Form::ElasticTurn);
        assert_eq!(own, [false, false, false, false, true, true]);
        let own = ends(EffectKind::Creep, Form::Other);
        assert_eq!(own, [true, true, false, false, true, true]);
    }

    #[test]
    fn of_two_with_unlike_signs_the_weaker_is_none() {
        let of = |names: [&str; 3], a_loop: Option<&str>, values: [f64; 3]| {
            let parameters: Vec<Parameters> = names
                .iter()
                .zip(values)
                .map(|(name, value)| {
                    let (name, unit) = (name.to_string(), String::new());
                    (vec![Param { name, value, unit }], Default::default())
                })
                .collect();
            let mut why = vec![None; 3];
            let loops = [None, a_loop.map(str::to_string), None];
            contradictions(
                &mut why,
                &weights(&[1.1, 3.0, 2.0]),
                &loops,
                &parameters.iter().collect::<Vec<_>>(),
            );
            why.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        let with = |values| of(["inertia"; 3], None, values);
        assert_eq!(with([0.1, 0.2, 0.3]), [false, false, false]);
        assert_eq!(with([-0.1, 0.2, 0.3]), [true, false, false]);
        // A spring pulls back as inertia does.
        let names = ["stiffness", "inertia", "damping"];
        assert_eq!(of(names, None, [-0.1, 0.2, 0.3]), [true, false, false]);
        // The sign is that of the most valuable one, whatever it is.
        assert_eq!(with([0.1, -0.2, 0.3]), [true, false, true]);
        // The loop of a position is friction, that of a load is not.
        let beside = |a_loop| {
            of(
                ["inertia", "half_height", "damping"],
                a_loop,
                [0.1, -0.2, 0.3],
            )
        };
        assert_eq!(beside(Some("half_height")), [true, false, true]);
        assert_eq!(beside(None), [false, false, false]);
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
            let param = |name: &str, [low, high]: [f64; 2]| Param {
                name: name.into(),
                value: 0.5 * (low + high),
                unit: String::new(),
            };
            let params = all.map(|(name, interval)| param(name, interval)).to_vec();
            let intervals = all
                .map(|(name, interval)| (name.to_string(), interval))
                .into();
            undetermined(&own, &(params, intervals)).is_some()
        };
        assert!(says([-0.1, 0.1]) && !says([0.1, 0.2]));
    }

    #[test]
    fn an_inertia_that_a_late_velocity_makes_of_damping_is_none() {
        let of = |name: &str, value: f64| -> Parameters {
            let (name, unit) = (name.to_string(), String::new());
            (vec![Param { name, value, unit }], Default::default())
        };
        let refused = |inertia: f64, late: f64| {
            let parameters = [of("damping", -2.0), of("inertia", inertia)];
            let mut why = vec![None; 2];
            inertia_of_a_lag(&mut why, &parameters.iter().collect::<Vec<_>>(), late);
            assert!(why[0].is_none());
            why[1].is_some()
        };
        assert!(refused(-0.04, 0.02) && refused(-0.055, 0.02));
        assert!(!refused(-0.07, 0.02) && !refused(0.04, 0.02) && !refused(-0.04, 0.005));
    }

    #[test]
    fn refused_ones_go_one_by_one_or_the_weak_ones_together() {
        let (itself, others) = (Against::Itself.order(), Against::Others.order());
        let check = Against::Check(1.1).order();
        let gone = |refused: &[(usize, f64)], together: bool| {
            next_gone(refused, together, |_, _| Ok(false)).unwrap()
        };
        assert!(gone(&[], true).is_empty());
        for together in [false, true] {
            assert_eq!(gone(&[(3, others)], together), [3]);
            assert_eq!(gone(&[(3, others), (1, others)], together), [1]);
            let refused = [(3, others), (1, check), (2, others)];
            assert_eq!(gone(&refused, together), [1]);
            let refused = [(3, itself), (1, itself), (2, others)];
            assert_eq!(gone(&refused, together), [1]);
        }
        let weak = [(3, others), (1, others), (2, others)];
        assert_eq!(gone(&weak, false), [2]);
        assert_eq!(gone(&weak, true), [1, 2]);
    }

    #[test]
    fn of_two_pairs_that_share_one_of_each_stays() {
        let others = Against::Others.order();
        // 0 and 1 share what they explain, and so do 2 and 3.
        let refused = [(0, others), (1, others), (2, others), (3, others)];
        let strong = |left_out: &[usize], index: usize| Ok(left_out.contains(&(index ^ 1)));
        assert_eq!(next_gone(&refused, true, strong).unwrap(), [1, 3]);
        // If all are strong without the others, the weakest goes.
        let all = next_gone(&refused, true, |_, _| Ok(true)).unwrap();
        assert_eq!(all, [3]);
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

//! Puts the report together from what the search found and what is left.

use crate::pictures;
use rayon::prelude::*;
use residual_columns::error::Error;
use residual_effects::{effect as effect_of, Build, EffectKind, CATALOGUE};
use residual_evidence::attribution::{EqualPath, Improving};
use residual_evidence::by_log::{by_log, unlike_logs};
use residual_evidence::check::Checked;
use residual_evidence::few::few_rows;
use residual_evidence::intervals::Parameters;
use residual_evidence::leftover::Leftover;
use residual_evidence::residual_tests::residual_tests;
use residual_evidence::verdict::{verdict, Conditions};
use residual_fit::problem::EVERYTHING;
use residual_log::data::Data;
use residual_report::{Ambiguity, Effect, NotMaterial, Report, Tested, SCHEMA_VERSION};
use residual_search::declared;
use residual_search::extended::extended;
use residual_search::figures::figures;
use residual_search::model::Fit;
use residual_search::scan::{Candidate, Scan};
use residual_search::{without, Outcome, Search, Standing, Weight};
use std::collections::BTreeMap;

/// Smallest relative fall of the held-out RMSE that is listed among what is not material.
const LISTED: f64 = 5e-4;

/// Results of the search.
pub(crate) struct Found<'a> {
    pub search: &'a Search<'a>,
    pub outcome: &'a Outcome,
    pub left: Leftover,
    /// What each effect is worth, the most valuable first.
    pub weights: &'a [Weight],
    /// Parameters of the effects, by index among the chosen ones.
    pub parameters: &'a [Parameters],
    /// What else improves the fit.
    pub improving: Option<&'a Improving>,
    /// Other names that predict as well.
    pub equal: Vec<EqualPath>,
    /// Paths that predict as well and were not judged.
    pub not_judged: usize,
    /// Data to check the models on.
    pub check: Option<&'a Checked>,
}

/// The report.
pub(crate) fn report(found: Found, data: &Data) -> Result<Report, Error> {
    let Found {
        search,
        outcome,
        weights,
        parameters,
        improving,
        check,
        ..
    } = found;
    let spec = search.spec;
    let base = &search.declared.fit;
    let fit = &outcome.fitted.fit;
    let seed = spec.selection.seed;
    let effects = effects(search, outcome, weights, parameters)?;
    let improves = match improving {
        Some(all) => unsupported(search, all)?,
        None => vec![],
    };
    let all = improving.map_or(outcome, |b| &b.outcome);
    let check = match check {
        Some(check) => Some(check.figures(search, &outcome.chosen, &all.chosen)?),
        None => None,
    };
    let left = found
        .left
        .structure
        .iter()
        .map(|s| s.gain)
        .fold(0.0, f64::max);
    let ambiguous: Vec<Ambiguity> = weights
        .iter()
        .filter_map(|w| ambiguity(outcome, w.index, left))
        .collect();
    let verdict = verdict(Conditions {
        effects: effects.len(),
        unexplained: found.left.unexplained,
        limited: outcome.limited.is_some(),
        ambiguous: ambiguous
            .first()
            .zip(effects.first())
            .is_some_and(|(a, e)| a.effects.first() == Some(&e.name)),
    });
    let by_log = by_log(&base.held, &fit.held, data);
    let unlike_logs = unlike_logs(&by_log, &spec.roles.target.unit);
    Ok(Report {
        schema_version: SCHEMA_VERSION,
        title: spec.title.clone(),
        unit: spec.roles.target.unit.clone(),
        files: data.file_names(),
        rows: search.problem.y.len(),
        sequences: search.problem.frame.sequences().len(),
        groups: data.groups(),
        folds: data.folds().to_vec(),
        baseline: figures(&search.problem, base, seed),
        last: figures(&search.problem, fit, seed),
        nested_rmse: None,
        verdict,
        not_identifiable: ambiguous,
        equal_paths: found.equal,
        paths_not_judged: found.not_judged,
        plot_unknown: match (&found.left.largest, found.left.when) {
            (Some(nameless), _) => {
                let against = nameless.against().unwrap_or(&search.load);
                Some(pictures::over(
                    search,
                    against,
                    &base.residual,
                    &fit.residual,
                ))
            }
            (None, true) => Some(pictures::over_time(search, &base.residual, &fit.residual)),
            (None, false) => None,
        },
        by_log,
        structure: found.left.structure,
        seen_not_material: not_material(search, outcome, &effects),
        tested: outcome.last.ranked.iter().map(tested).collect(),
        effects,
        with_all: improving.map(|b| figures(&search.problem, &b.outcome.fitted.fit, seed)),
        improves,
        limited: outcome.limited,
        check,
        absent: absent(search, &outcome.last.ranked)?,
        hygiene: data
            .findings()
            .iter()
            .cloned()
            .chain(few_rows(&fit.residual, data))
            .chain(unlike_logs)
            .chain(found.left.notes)
            .collect(),
        residual_tests: residual_tests(
            &search.problem,
            &spec.roles,
            &search.problem.kept_frame(),
            &base.residual,
            &fit.residual,
        ),
        extended: extended(spec, &outcome.fitted, &outcome.chosen),
        declared: declared::terms(&search.declared),
    })
}

/// The chosen effects, the most valuable first, with the error before and after each in that order.
fn effects(
    search: &Search,
    outcome: &Outcome,
    weights: &[Weight],
    parameters: &[Parameters],
) -> Result<Vec<Effect>, Error> {
    let mut out = Vec::new();
    let mut so_far = Vec::new();
    let mut before = search.declared.rmse();
    for (k, w) in weights.iter().enumerate() {
        so_far.push(outcome.chosen[w.index].clone());
        let after = if k + 1 == weights.len() {
            w.rmse
        } else {
            search.rmse(&so_far)?
        };
        out.push(effect(
            search,
            outcome,
            w,
            &parameters[w.index],
            (before, after),
        )?);
        before = after;
    }
    Ok(out)
}

/// The effects whose names the data do not support, the most valuable first. The errors before and
/// after are those of the model with all effects, without and with this one.
fn unsupported(search: &Search, improving: &Improving) -> Result<Vec<Effect>, Error> {
    let mut out = Vec::new();
    for w in &improving.weights {
        let Some(why) = &improving.why[w.index] else {
            continue;
        };
        let errors = (w.rmse_without, w.rmse);
        let parameters = &improving.parameters[w.index];
        let mut own = effect(search, &improving.outcome, w, parameters, errors)?;
        own.unsupported = why.clone();
        out.push(own);
    }
    Ok(out)
}

/// One chosen effect for the report.
fn effect(
    search: &Search,
    outcome: &Outcome,
    weight: &Weight,
    (params, ci): &Parameters,
    (before, after): (f64, f64),
) -> Result<Effect, Error> {
    let index = weight.index;
    let (own, rest) = without(&outcome.chosen, index);
    // The other effects are in both models, so that the plot shows this effect alone.
    let rest = search.fit(&rest)?;
    Ok(Effect {
        name: own.effect.kind(),
        form: own.variant.label.clone(),
        form_kind: own.variant.form,
        meaning: own.effect.kind().meaning().into(),
        terms: match (own.variant.build)(own.psi) {
            Build::Add(p) | Build::Local(p) | Build::Known(p) => {
                p.iter().map(|p| p.text.clone()).collect()
            }
            Build::Swap(s) | Build::SwapAll(s) => {
                s.iter().map(|(n, t)| format!("{n} -> {t}")).collect()
            }
            Build::Through(t) => vec![format!("{EVERYTHING} -> {t}")],
        },
        units: params
            .iter()
            .map(|p| (p.name.clone(), p.unit.clone()))
            .collect(),
        params: params.iter().map(|p| (p.name.clone(), p.value)).collect(),
        ci: ci.clone(),
        at_limit: own
            .variant
            .psi
            .iter()
            .filter(|p| p.at_limits(own.psi).contains(&true))
            .map(|p| p.name.to_string())
            .collect(),
        heldout_before: before,
        heldout_after: after,
        heldout_without: weight.rmse_without,
        unsupported: String::new(),
        rival: standing(outcome, index).rival,
        plot: pictures::of_effect(search, &own, &rest, &outcome.fitted),
    })
}

fn standing(outcome: &Outcome, index: usize) -> Standing {
    outcome.standings.get(index).cloned().unwrap_or_default()
}

/// Candidates that the data cannot distinguish from a chosen effect, if any. Structure without a
/// name that is `left` explains a part of the held-out RMSE.
fn ambiguity(outcome: &Outcome, index: usize, left: f64) -> Option<Ambiguity> {
    let Standing {
        rival,
        rival_is_simpler,
        mut ties,
    } = standing(outcome, index);
    let own = outcome.chosen[index].effect;
    // What is missing, and has no name, may be what makes it better than something simpler.
    if let Some(rival) = rival.filter(|r| rival_is_simpler && r.behind < left) {
        let known = ties.iter().any(|e| e.kind() == rival.name);
        ties.extend((!known).then(|| effect_of(rival.name)));
    }
    let twin = own
        .twin(&outcome.chosen[index].variant.label)
        .map(effect_of)
        .filter(|twin| ties.iter().all(|t| t.kind() != twin.kind()));
    if ties.is_empty() && twin.is_none() {
        return None;
    }
    let others = || ties.iter().copied().chain(twin);
    let experiments: Vec<String> = others()
        .chain([own])
        .map(|e| format!("{}: {}", e.name(), e.kind().experiment()))
        .collect();
    Some(Ambiguity {
        effects: std::iter::once(own)
            .chain(others())
            .map(|e| e.kind())
            .collect(),
        experiment: experiments.join("; "),
    })
}

/// Effects that stand out from the decoys but are too small to count.
fn not_material(search: &Search, outcome: &Outcome, effects: &[Effect]) -> Vec<NotMaterial> {
    let acceptance = search.acceptance();
    outcome
        .last
        .ranked
        .iter()
        .filter(|c| {
            c.gain > LISTED
                && !acceptance.material(c.gain)
                && acceptance.significant(c.p)
                && !effects.iter().any(|e| e.name == c.origin.kind())
        })
        .map(|c| NotMaterial {
            name: c.origin.kind(),
            form: c.variant.label.clone(),
            gain: c.gain,
            params: nonlinear(c),
        })
        .collect()
}

fn tested(c: &Candidate) -> Tested {
    Tested {
        name: c.origin.kind(),
        form: c.variant.label.clone(),
        gain: c.gain,
        p_value: c.p,
        t_statistic: c.t,
        params: nonlinear(c),
    }
}

/// The nonlinear parameter by its name.
fn nonlinear(c: &Candidate) -> BTreeMap<String, f64> {
    let psi = c.variant.psi.iter();
    psi.map(|p| (p.name.to_string(), c.variant.shown(c.psi)))
        .collect()
}

/// Effects that were not looked for, as the data lack their columns. The windows of the data show
/// this as well as all rows. On top of an effect that was found another may be possible, and is
/// `tested`.
fn absent(search: &Search, tested: &[Candidate]) -> Result<Vec<EffectKind>, Error> {
    let declared = &search.declared;
    let small = match &search.thin {
        Some(thin) => Some((thin, Fit::new(thin, &declared.model)?)),
        None => None,
    };
    let mut scan = search.scan_on(declared);
    if let Some((problem, fit)) = &small {
        scan = Scan {
            problem,
            fit,
            ..scan
        };
    }
    let ctx = scan.context();
    Ok(CATALOGUE
        .par_iter()
        .filter(|e| search.allowed(**e) && e.variants(&ctx).is_empty())
        .filter(|e| !tested.iter().any(|c| c.origin.kind() == e.kind()))
        .map(|e| e.kind())
        .collect())
}

#[cfg(test)]
mod tests {
    use crate::{analyse, spec::Spec, Data};

    /// A delay of all that is predicted is possible only once something that moves is predicted.
    #[test]
    fn no_effect_is_both_tested_and_not_tested() {
        let model = "[roles]\ntime = { column = \"t\", unit = \"s\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
             velocity = { column = \"v\", unit = \"m/s\" }\n[[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
        let rows = |f: &dyn Fn(f64) -> f64| (0..800).map(|i| f(0.02 * f64::from(i))).collect();
        let velocity = |t: f64| (1.9 * t).cos() + 0.6 * (3.3 * t).sin();
        let target = |t: f64| 0.01 * (1e4 * t).sin() - 0.4 * velocity(t).signum() - velocity(t);
        let data = Data::from_columns(
            rows(&|t| t),
            [("velocity", rows(&velocity)), ("target", rows(&target))],
        )
        .sequences((0..4).map(|run| 200 * run..200 * (run + 1)))
        .build()
        .unwrap();
        let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
        assert!(!report.effects.is_empty() && !report.absent.is_empty());
        assert!(
            report.tested.iter().any(|t| t.name == "delay"),
            "{}",
            report.markdown()
        );
        for name in &report.absent {
            assert!(!report.tested.iter().any(|t| t.name == *name), "{name}");
        }
    }
}

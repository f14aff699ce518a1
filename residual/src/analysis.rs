//! The whole analysis: load, baseline, selection, rivals, what is left, verdict.

use crate::effects::{self, Build, Context, EffectKind, EffectRef, Form, Friction, CATALOGUE};
use crate::error::Error;
use crate::expr::Expr;
use crate::load::{self, Loaded};
use crate::model::{Chosen, Fit, Model};
use crate::problem::{correlation_rows, Column, Problem, Sums};
use crate::progress::Progress;
use crate::report::{
    Ambiguity, Effect, Figures, NotMaterial, Plot, Report, Rival, Structure, Tested, Verdict,
    WITHOUT,
};
use crate::search::{
    self, choose, context, indistinguishable, passes, rank, Candidate, Nameless, Offer, Origin,
    State, Step,
};
use crate::spec::{Spec, Term};
use crate::stats::{self, Rng};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

/// Rows above which the catalogue is screened on windows of the data first.
const SCREEN_ROWS: usize = 120_000;
/// An effect's nearest rival, and the candidates that the data cannot tell from it.
type Judged = (Option<Rival>, Vec<Candidate>);

/// Share of what the named effects explain above which nameless structure makes them stand-ins.
const STAND_IN: f64 = 0.25;

/// Share of what the named effects explain by which one nameless form must do better in their place to make them
/// stand-ins.
const BETTER_ALONE: f64 = 0.01;

/// How far the size of an effect on the part of the command that follows the setpoint may be off the fitted
/// one, as a factor either way.
const FEEDBACK: f64 = 1.4;

/// Bootstrap replicates.
const REPLICATES: usize = 200;

/// What to analyse.
#[derive(Debug, Clone)]
pub struct Options {
    /// Log files and folders.
    pub data: Vec<PathBuf>,
    /// The model.
    pub model: Spec,
    /// Where reports go; nothing is written if `None`.
    pub out: Option<PathBuf>,
}

/// Runs an analysis and writes its reports.
///
/// # Errors
/// Any [`Error`]; then nothing is written, and an earlier report in the folder is gone.
pub fn run(options: &Options, progress: &mut dyn Progress) -> Result<Report, Error> {
    if let Some(out) = &options.out {
        crate::report::clear(out)?;
    }
    progress.stage("reading data");
    let loaded = load::load(&options.data, &options.model)?;
    let report = analyse(&options.model, loaded, progress)?;
    if let Some(out) = &options.out {
        progress.stage("writing reports");
        report.write(out)?;
    }
    Ok(report)
}

/// The declared model's prediction with its coefficients written in, as an expression.
fn load_expression(model: &Model, fit: &Fit) -> String {
    let mut parts = Vec::new();
    let mut k = fit.theta.iter();
    for t in model.terms.iter().filter(|t| !t.local) {
        let a = t.fixed.unwrap_or_else(|| k.next().copied().unwrap_or(0.0));
        // The load is what the drive imposes: terms of velocity or time alone are no load.
        if a != 0.0 {
            parts.push((t, a));
        }
    }
    let driven: Vec<&(&crate::model::WorkTerm, f64)> = {
        let d: Vec<_> = parts
            .iter()
            .filter(|(t, _)| t.expr.names().contains("command"))
            .collect();
        if d.is_empty() {
            parts.iter().collect()
        } else {
            d
        }
    };
    let text: Vec<String> = driven
        .iter()
        .map(|(t, a)| Expr::Num(*a).op("*", t.expr.clone()).to_string())
        .collect();
    if text.is_empty() {
        "0".into()
    } else {
        format!("({})", text.join(" + "))
    }
}

/// Refuses data on which no answer would mean anything.
fn check_excitation(p: &Problem, spec: &Spec) -> Result<(), Error> {
    let varies = |v: &[f64]| {
        v.iter()
            .any(|x| (x - v[0]).abs() > 1e-12 * v[0].abs().max(1e-300))
    };
    if !varies(&p.y) {
        return Err(Error::data(
            "the target is constant on all fitted rows",
            "Check roles.target and rows.keep",
        ));
    }
    let inputs: Vec<String> = spec
        .roles
        .all()
        .into_iter()
        .map(|(n, _)| n)
        .filter(|n| !["time", "target"].contains(&n.as_str()) && !spec.roles.groups.contains_key(n))
        .collect();
    if !inputs.is_empty()
        && !inputs.iter().any(|n| {
            p.frame
                .column(n)
                .is_some_and(|c| varies(&p.gather(c.to_vec())))
        })
    {
        return Err(Error::data(
            format!("constant excitation: {} never change on the fitted rows", inputs.join(", ")),
            "No effect can be told from another without motion or varying load; record an experiment that varies them",
        ));
    }
    Ok(())
}

/// Fitted numbers of a choice.
fn parameters_of(c: &Chosen) -> usize {
    let pieces = match (c.variant.build)(c.psi) {
        Build::Add(p) | Build::Local(p) => p.len(),
        Build::Swap(_) | Build::SwapAll(_) => 0,
    };
    pieces + usize::from(c.variant.psi.as_ref().is_some_and(|p| p.refine))
}

struct Analysis<'a> {
    problem: Problem,
    thin: Option<Problem>,
    spec: &'a Spec,
    load: String,
    floor: f64,
    tests: usize,
    /// Scans of the catalogue that were made already, by the model they were made on.
    scans: HashMap<String, Vec<Candidate>>,
}

impl Analysis<'_> {
    fn fit(&self, chosen: &[Chosen]) -> Result<(Model, Fit), Error> {
        let model = Model::with(self.spec, chosen)?;
        let fit = Fit::new(&self.problem, &model)?;
        Ok((model, fit))
    }

    fn allowed(&self, e: EffectRef) -> bool {
        let s = &self.spec.selection;
        (s.only.is_empty() || s.only.iter().any(|n| n == e.name()))
            && !s.except.iter().any(|n| n == e.name())
    }

    /// Scans the catalogue (or nameless structure) on top of a model.
    fn scan<O: Origin>(
        &mut self,
        model: &Model,
        fit: &Fit,
        offers: &dyn Fn(&Self, &Context) -> Vec<Offer<O>>,
    ) -> Result<Vec<Candidate<O>>, Error> {
        let list =
            |p: &Problem, f: &Fit| offers(self, &context(p, self.spec, &self.load, model, f));
        let found = match &self.thin {
            None => {
                let variants = list(&self.problem, fit);
                State {
                    problem: &self.problem,
                    spec: self.spec,
                    model,
                    fit,
                }
                .scan(&variants, None)
            }
            Some(thin) => {
                let small = Fit::new(thin, model)?;
                let variants = list(thin, &small);
                let mut first = State {
                    problem: thin,
                    spec: self.spec,
                    model,
                    fit: &small,
                }
                .scan(&variants, None);
                first.sort_by(|a, b| b.gain.total_cmp(&a.gain));
                let tests = first.len();
                first.truncate(14);
                first.retain(|c| c.gain > 0.25 * self.spec.selection.material);
                let short: Vec<Offer<O>> = first
                    .iter()
                    .map(|c| Offer {
                        origin: c.origin.clone(),
                        variant: c.variant.clone(),
                    })
                    .collect();
                let at: Vec<f64> = first.iter().map(|c| c.psi).collect();
                self.tests = self.tests.max(tests);
                State {
                    problem: &self.problem,
                    spec: self.spec,
                    model,
                    fit,
                }
                .scan(&short, Some(&at))
            }
        };
        self.tests = self.tests.max(found.len());
        Ok(found)
    }

    fn step(&mut self, model: &Model, fit: &Fit) -> Result<Step, Error> {
        let key = model.key();
        let all = match self.scans.get(&key) {
            Some(known) => known.clone(),
            None => {
                let mut all = self.scan(model, fit, &|s: &Self, ctx| {
                    search::variants(ctx, &|e| s.allowed(e))
                })?;
                self.look_again(&mut all, model, fit);
                self.scans.insert(key, all.clone());
                all
            }
        };
        Ok(rank(
            all,
            self.spec,
            self.tests,
            self.floor,
            self.problem.y.len(),
        ))
    }

    /// A second look at material candidates that the first decoys could not clear.
    fn look_again<O: Origin>(&self, all: &mut [Candidate<O>], model: &Model, fit: &Fit) {
        let state = State {
            problem: &self.problem,
            spec: self.spec,
            model,
            fit,
        };
        let sel = &self.spec.selection;
        for c in all
            .iter_mut()
            .filter(|c| c.gain >= sel.material && c.p * self.tests as f64 > sel.fdr)
        {
            c.p = c.p.min(state.second_look(c));
        }
        if self.spec.roles.setpoint.is_some() {
            for c in all.iter_mut().filter(|c| {
                c.gain >= sel.material && c.p < 1.0 && state.built_on_command(&c.variant, c.psi)
            }) {
                if !c.origin.has_witness() && state.share_on_setpoint(&c.variant, c.psi) < 0.5 {
                    c.p = 1.0;
                }
            }
        }
    }

    /// Adds effects until nothing material is left.
    fn forward(
        &mut self,
        chosen: &mut Vec<Chosen>,
        progress: &mut dyn Progress,
    ) -> Result<(), Error> {
        let sel = &self.spec.selection;
        loop {
            progress.stage(&format!(
                "searching the catalogue on top of {} effect(s)",
                chosen.len()
            ));
            let (model, fit) = self.fit(chosen)?;
            let step = self.step(&model, &fit)?;
            let before = stats::rms(&fit.held);
            let mut taken = false;
            // The winner may be a form of an effect that is there already and turn out to add nothing.
            for c in step.winner.into_iter().chain(
                step.good
                    .iter()
                    .copied()
                    .filter(|i| Some(*i) != step.winner),
            ) {
                let c = &step.ranked[c];
                let mut next = chosen.clone();
                if !c.origin.repeatable() {
                    next.retain(|x| x.effect.kind() != c.origin.kind());
                }
                next.push(self.complete(c, &next));
                self.part_friction(&mut next)?;
                self.prune(&mut next)?;
                let after = stats::rms(&self.fit(&next)?.1.held);
                if after <= before * (1.0 - sel.material) && next.len() <= sel.max_effects {
                    *chosen = next;
                    taken = true;
                    break;
                }
            }
            if !taken {
                return Ok(());
            }
        }
    }

    /// A candidate as a choice. Friction that grows with load on top of plain Coulomb friction is
    /// one friction with two parameters, so the form with both is taken (and plain Coulomb pruned).
    fn complete(&self, c: &Candidate, chosen: &[Chosen]) -> Chosen {
        let mut choice = choose(c);
        let friction = chosen
            .iter()
            .any(|x| x.effect.friction() == Some(Friction::Constant));
        if c.origin.friction() == Some(Friction::WithLoad) && friction {
            if let Ok((model, fit)) = self.fit(&[]) {
                let ctx = context(&self.problem, self.spec, &self.load, &model, &fit);
                if let Some(v) = c.origin.variants(&ctx).into_iter().next() {
                    choice.variant = Arc::new(v);
                }
            }
        }
        choice
    }

    /// Friction that stays at rest is friction in motion and at rest under one coefficient. Once it
    /// grows with the load, each has coefficients of its own, unless that predicts worse: as one it
    /// would keep richer forms of either out, and what moves would be told as a difference to what rests.
    fn part_friction(&self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        let at = |friction: Friction| {
            chosen
                .iter()
                .position(|c| c.effect.friction() == Some(friction))
        };
        let (Some(load), Some(rest)) = (at(Friction::WithLoad), at(Friction::AtRest)) else {
            return Ok(());
        };
        if chosen[rest].variant.form != Form::MotionAndRest {
            return Ok(());
        }
        let (model, fit) = self.fit(&[])?;
        let ctx = context(&self.problem, self.spec, &self.load, &model, &fit);
        let forms = chosen[load].effect.variants(&ctx);
        let Some(moving) = forms.into_iter().next().map(Arc::new) else {
            return Ok(());
        };
        let error = |c: &[Chosen]| Ok::<f64, Error>(stats::rms(&self.fit(c)?.1.held));
        // The plain form can say all that the one coefficient said, to rounding.
        let mut least = error(chosen)? * (1.0 + 1e-9);
        let from = chosen.clone();
        for held in from[rest].effect.variants(&ctx) {
            if ![Form::AtRest, Form::AtRestWithLoad].contains(&held.form) {
                continue;
            }
            let mut parted = from.clone();
            parted[load].variant = moving.clone();
            parted[rest].variant = Arc::new(held);
            let e = error(&parted)?;
            if e <= least {
                (least, *chosen) = (e, parted);
            }
        }
        Ok(())
    }

    /// Each effect must hold its place against the whole catalogue with the others in place.
    fn rivals(
        &mut self,
        chosen: &mut Vec<Chosen>,
        may_swap: bool,
        progress: &mut dyn Progress,
    ) -> Result<(Vec<Judged>, bool), Error> {
        let mut out = Vec::new();
        let rows = self.problem.y.len() as f64;
        let current = stats::rms(&self.fit(chosen)?.1.held);
        for i in 0..chosen.len() {
            let own_kind = chosen[i].effect.kind();
            progress.stage(&format!("rivals of {own_kind}"));
            let mut rest = chosen.clone();
            let own = rest.remove(i);
            let (model, fit) = self.fit(&rest)?;
            let step = self.step(&model, &fit)?;
            let there = |kind: EffectKind| {
                rest.iter()
                    .any(|r| r.effect.kind() == kind && !r.effect.repeatable())
            };
            if let Some(c) = step.winner.map(|w| &step.ranked[w]).filter(|c| {
                // Another form of the same effect may fit better now that others are in place.
                let form = (own_kind, own.variant.label.as_str());
                may_swap
                    && (c.origin.kind(), c.variant.label.as_str()) != form
                    && !there(c.origin.kind())
            }) {
                let mut other = rest.clone();
                let form = self.complete(c, &other);
                // Completed, it may be what is there already.
                let same =
                    (form.effect.kind(), &form.variant.label) == (own_kind, &own.variant.label);
                let simpler = parameters_of(&form) < parameters_of(&own);
                other.push(form);
                let rmse = stats::rms(&self.fit(&other)?.1.held);
                if !same && rmse < current * if simpler { 1.005 } else { 0.99 } {
                    self.prune(&mut other)?;
                    *chosen = other;
                    return Ok((vec![], true));
                }
            }
            let rival = step
                .ranked
                .iter()
                .find(|c| c.origin.kind() != own_kind && !there(c.origin.kind()))
                .map(|c| Rival {
                    name: c.origin.kind(),
                    heldout_rmse: (c.held / rows).sqrt(),
                    behind: (c.held / rows).sqrt() / current - 1.0,
                });
            let state = State {
                problem: &self.problem,
                spec: self.spec,
                model: &model,
                fit: &fit,
            };
            let ties = step
                .ranked
                .iter()
                .position(|c| c.origin.kind() == own_kind)
                .map_or(vec![], |w| indistinguishable(&state, &step, w));
            out.push((rival, ties));
        }
        Ok((out, false))
    }

    /// Two effects that one explains as well are one: tries every pair against the whole catalogue.
    fn merge(
        &mut self,
        chosen: &mut Vec<Chosen>,
        progress: &mut dyn Progress,
    ) -> Result<bool, Error> {
        let squares = |fit: &Fit| fit.held.iter().map(|r| r * r).sum::<f64>();
        // With more effects the pairs are many, and two in place of one would have been thrown out before.
        if !(2..=3).contains(&chosen.len()) {
            return Ok(false);
        }
        let current = squares(&self.fit(chosen)?.1);
        // A hundredth of what two large effects explain may be a third effect that was found beside them.
        let most = current * (1.0 + self.spec.selection.material).powi(2);
        for j in 1..chosen.len() {
            for i in 0..j {
                let name = |k: usize| chosen[k].effect.name();
                progress.stage(&format!("one effect for {} and {}", name(i), name(j)));
                let spent = parameters_of(&chosen[i]) + parameters_of(&chosen[j]);
                let mut rest = chosen.clone();
                rest.remove(j);
                rest.remove(i);
                let (model, fit) = self.fit(&rest)?;
                let pair = squares(&fit) - current;
                let step = self.step(&model, &fit)?;
                let fits = |c: &&Candidate| {
                    c.parameters <= spent
                        && c.held - current < 0.05 * pair
                        && !rest
                            .iter()
                            .any(|r| r.effect.kind() == c.origin.kind() && !r.effect.repeatable())
                };
                for c in step.good.iter().map(|g| &step.ranked[*g]).filter(fits) {
                    let mut one = rest.clone();
                    one.push(choose(c));
                    self.polish(&mut one)?;
                    let left = squares(&self.fit(&one)?.1);
                    if left - current < 0.01 * pair && left < most {
                        *chosen = one;
                        return Ok(true);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Throws out effects that the others make superfluous.
    fn prune(&self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        loop {
            let full = stats::rms(&self.fit(chosen)?.1.held);
            let mut weakest: Option<(usize, f64)> = None;
            for i in 0..chosen.len() {
                let mut rest = chosen.clone();
                rest.remove(i);
                let without = stats::rms(&self.fit(&rest)?.1.held);
                let loss = 1.0 - full / without.max(f64::MIN_POSITIVE);
                if loss < 0.5 * self.spec.selection.material && weakest.is_none_or(|w| loss < w.1) {
                    weakest = Some((i, loss));
                }
            }
            match weakest {
                Some((i, _)) => {
                    chosen.remove(i);
                }
                None => return Ok(()),
            }
        }
    }

    /// Refines every nonlinear parameter with the other effects in place.
    fn polish(&self, chosen: &mut [Chosen]) -> Result<(), Error> {
        for _ in 0..2 {
            for i in 0..chosen.len() {
                let Some(psi) = chosen[i].variant.psi.clone().filter(|p| p.refine) else {
                    continue;
                };
                let mut rest: Vec<Chosen> = chosen.to_vec();
                let own = rest.remove(i);
                let (model, fit) = self.fit(&rest)?;
                let state = State {
                    problem: &self.problem,
                    spec: self.spec,
                    model: &model,
                    fit: &fit,
                };
                let (lo, hi) = match psi.resolution {
                    Some(d) => (own.psi - 0.5 * d, own.psi + 0.5 * d),
                    None => {
                        let (lo, hi) = search::bracket(&psi.grid, own.psi);
                        (
                            own.psi - 0.3 * (own.psi - lo).abs(),
                            own.psi + 0.3 * (hi - own.psi).abs(),
                        )
                    }
                };
                // An optimum at the edge of the interval means that it lies further on.
                let (mut lo, mut hi) = (lo, hi);
                for _ in 0..6 {
                    let best = state.refine(&own.variant, lo, hi, search::FINE);
                    chosen[i].psi = best;
                    let reach = hi - lo;
                    if best - lo > 0.04 * reach && hi - best > 0.04 * reach {
                        break;
                    }
                    let positive = lo > 0.0;
                    (lo, hi) = (best - 0.7 * reach, best + 0.7 * reach);
                    if positive {
                        lo = lo.max(0.3 * best);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Checks that the data can be analysed, fits the declared model, and cuts the blocks to the colour
/// of its residual.
fn fit_declared(problem: &mut Problem, spec: &Spec) -> Result<(Model, Fit), Error> {
    check_excitation(problem, spec)?;
    let declared = Model::declared(spec)?;
    let first = Fit::new(problem, &declared)?;
    if first.dropped.iter().any(|d| *d) {
        let terms = first
            .free
            .iter()
            .zip(&first.dropped)
            .filter(|(_, d)| **d)
            .map(|(i, _)| declared.terms[*i].name.clone())
            .collect();
        return Err(Error::RankDeficient { terms });
    }
    problem.cut_blocks(
        correlation_rows(problem, &first.residual),
        spec.selection.decoys,
    );
    let fit = Fit::new(problem, &declared)?;
    Ok((declared, fit))
}

/// The declared model alone, without a search.
#[derive(Debug, Clone)]
pub struct Baseline {
    /// Its errors.
    pub figures: Figures,
    /// Its terms: name, coefficient, unit, whether it was declared fixed.
    pub terms: Vec<(String, f64, String, bool)>,
    /// Rows of the frame that were fitted.
    pub rows: Vec<usize>,
    /// Residual on those rows when their group is held out.
    pub held: Vec<f64>,
}

/// Fits the declared model and holds out each group; looks for nothing.
///
/// # Errors
/// [`Error::Data`] or [`Error::RankDeficient`].
pub fn baseline(spec: &Spec, loaded: &Loaded) -> Result<Baseline, Error> {
    let sel = &spec.selection;
    let mut problem = Problem::new(
        loaded.frame.clone(),
        &loaded.keep,
        &loaded.fold,
        sel.decoys,
        sel.seed,
    );
    let (declared, fit) = fit_declared(&mut problem, spec)?;
    Ok(Baseline {
        figures: figures(&problem, &fit, sel.seed),
        terms: declared_terms(&declared, &fit),
        rows: (0..loaded.keep.len()).filter(|i| loaded.keep[*i]).collect(),
        held: fit.held,
    })
}

/// Analyses data that are already loaded.
///
/// # Errors
/// [`Error::Data`] or [`Error::RankDeficient`].
pub fn analyse(spec: &Spec, loaded: Loaded, progress: &mut dyn Progress) -> Result<Report, Error> {
    let Loaded {
        frame,
        keep,
        fold,
        fold_names,
        groups,
        files,
        hygiene,
    } = loaded;
    let sel = &spec.selection;
    let mut problem = Problem::new(frame, &keep, &fold, sel.decoys, sel.seed);
    problem.ticker = progress.ticker();
    progress.stage(&format!(
        "baseline on {} rows, {} groups in {} folds",
        problem.y.len(),
        groups,
        problem.folds
    ));
    let (declared, base) = fit_declared(&mut problem, spec)?;
    let load = load_expression(&declared, &base);
    let thin = problem.thin(SCREEN_ROWS);
    let floor = spec
        .roles
        .target
        .noise_floor
        .max(stats::quantum(&problem.y).map_or(0.0, |q| q / 12f64.sqrt() / 4.0));
    let mut a = Analysis {
        problem,
        thin,
        spec,
        load,
        floor,
        tests: 1,
        scans: HashMap::new(),
    };
    let baseline = figures(&a.problem, &base, sel.seed);

    // Forward, then every effect against its rivals; a change starts the forward search again.
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut last_step;
    let mut rivals: Vec<(Option<Rival>, Vec<Candidate>)>;
    let mut round = 0;
    loop {
        a.forward(&mut chosen, progress)?;
        a.polish(&mut chosen)?;
        round += 1;
        if round < 4 && a.merge(&mut chosen, progress)? {
            a.polish(&mut chosen)?;
        }
        let (list, changed) = a.rivals(&mut chosen, round < 4, progress)?;
        rivals = list;
        if changed {
            continue;
        }
        // Polished parameters change the residual: look once more before calling it the end.
        progress.stage("what is left");
        let (model, fit) = a.fit(&chosen)?;
        let step = a.step(&model, &fit)?;
        let more = step.winner.is_some();
        last_step = Some(step);
        if !more || round >= 4 {
            break;
        }
    }

    // What is left.
    let (model, fit) = a.fit(&chosen)?;
    let rows = a.problem.y.len();
    let nameless_offers = |_: &Analysis, ctx: &Context| search::generic(ctx);
    let mut nameless = a.scan(&model, &fit, &nameless_offers)?;
    a.look_again(&mut nameless, &model, &fit);
    nameless.sort_by(|x, y| y.gain.total_cmp(&x.gain));
    let tests = a.tests.max(nameless.len());
    let left: Vec<&Candidate<Nameless>> = nameless
        .iter()
        .filter(|c| passes(c, spec, tests, a.floor, rows))
        .collect();
    let held_now = fit.held.iter().map(|r| r * r).sum::<f64>();
    let explained = (base.scores.held_total(0) - held_now).max(0.0);
    let mut structure: Vec<Structure> = left
        .iter()
        .take(6)
        .map(|c| Structure {
            depends_on: c.origin.depends_on.clone(),
            gain: c.gain,
            p: c.p,
        })
        .collect();
    let mut unexplained = left
        .first()
        .is_some_and(|c| c.base - c.held > STAND_IN * explained);
    // One nameless form in place of all named effects: if it does better, they only stand in for it. Better by
    // something that counts beside what they explain: a free curve that contains an effect takes a last
    // hundredth more on any real log.
    if !unexplained && !left.is_empty() && !chosen.is_empty() {
        let alone = a.scan(&declared, &base, &nameless_offers)?;
        unexplained = alone.iter().any(|c| {
            c.held < held_now * (1.0 - sel.material).powi(2)
                && held_now - c.held > BETTER_ALONE * explained
                && passes(c, spec, tests, a.floor, rows)
        });
    }
    let frame = a.problem.kept_frame();
    // An effect that fits, but in so few places that nothing confirms it, is neither named nor nothing.
    if let Some(c) = last_step.iter().flat_map(|s| &s.ranked).find(|c| {
        !c.steady && c.gain >= sel.material && c.p * tests as f64 <= sel.fdr && c.losses.len() > 8
    }) {
        structure.push(Structure {
            depends_on: format!(
                "few places, too few to be sure; {} would fit",
                c.origin.name()
            ),
            gain: c.gain,
            p: c.p,
        });
        unexplained |= c.base - c.held > STAND_IN * explained;
    }
    let switching = stats::switching(&fit.residual, &frame);
    let gain = 1.0 - (1.0 - switching.share).sqrt();
    if switching.z < -5.0 && switching.kurtosis < -0.5 && gain >= sel.material {
        structure.push(Structure {
            depends_on: "no column: it switches between levels".into(),
            gain,
            p: stats::normal_tail(-switching.z),
        });
        structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
        unexplained |= switching.share * held_now > STAND_IN * explained;
    }

    let mut residual_tests = vec![(
        "before".to_string(),
        stats::whiteness(&base.residual, &frame),
    )];
    residual_tests.push(("after".into(), stats::whiteness(&fit.residual, &frame)));
    let crossed: Vec<_> = spec
        .roles
        .all()
        .into_par_iter()
        .filter(|(name, _)| {
            name != "target" && name != "time" && !spec.roles.groups.contains_key(name)
        })
        .flat_map_iter(|(name, _)| {
            let x = a
                .problem
                .gather(a.problem.frame.column(&name).unwrap_or(&[]).to_vec());
            [("before", &base.residual), ("after", &fit.residual)].map(|(when, r)| {
                let test = stats::cross_correlation(r, &x, &name, &frame);
                (when.to_string(), test)
            })
        })
        .collect();
    residual_tests.extend(crossed);

    // Order by what is lost without each, then tell the story in that order.
    let full = stats::rms(&fit.held);
    let mut order: Vec<(usize, f64)> = (0..chosen.len())
        .map(|i| {
            let mut rest = chosen.clone();
            rest.remove(i);
            Ok((i, stats::rms(&a.fit(&rest)?.1.held)))
        })
        .collect::<Result<_, Error>>()?;
    order.sort_by(|x, y| y.1.total_cmp(&x.1));
    // In a closed loop the command answers the disturbance. What the command does to the target must come out
    // as large where the command follows the setpoint; effects that don't are named, but not believed.
    if spec.roles.setpoint.is_some() {
        let mut doubtful = Vec::new();
        for (i, without) in &order {
            let mut rest = chosen.clone();
            let own = rest.remove(*i);
            let (m, f) = a.fit(&rest)?;
            let state = State {
                problem: &a.problem,
                spec,
                model: &m,
                fit: &f,
            };
            let name = own.effect.name();
            if !state.built_on_command(&own.variant, own.psi) || own.effect.has_witness() {
                continue;
            }
            let share = state.share_on_setpoint(&own.variant, own.psi);
            let size = (without.powi(2) - full.powi(2)) * rows as f64;
            if !(1.0 / FEEDBACK..=FEEDBACK).contains(&share) && size > 0.5 * STAND_IN * explained {
                doubtful.push((format!("{name} {share:.2} times"), 1.0 - full / without));
            }
        }
        if let Some((_, gain)) = doubtful.first() {
            let sizes: Vec<&str> = doubtful.iter().map(|d| d.0.as_str()).collect();
            structure.insert(
                0,
                Structure {
                    depends_on: format!(
                        "the command through feedback: where it follows the setpoint the effects are not of the fitted \
                         size ({}); log the same with the loop open, or with speed and angle",
                        sizes.join(", ")
                    ),
                    gain: *gain,
                    p: 0.0,
                },
            );
            unexplained = true;
        }
    }
    let mut list = Vec::new();
    let mut ambiguous = Vec::new();
    let mut so_far: Vec<Chosen> = Vec::new();
    let mut before = baseline.heldout_rmse;
    for (k, (i, _)) in order.iter().enumerate() {
        let c = &chosen[*i];
        so_far.push(c.clone());
        let after = if k + 1 == order.len() {
            full
        } else {
            stats::rms(&a.fit(&so_far)?.1.held)
        };
        let (params, ci) = parameters(&a, &chosen, *i)?;
        let effect = c.effect;
        let ctx = context(&a.problem, spec, &a.load, &declared, &base);
        let against = effect.against(&ctx);
        // The others are in place on both sides, so that nothing else is in the picture.
        let mut rest = chosen.clone();
        rest.remove(*i);
        let (_, without) = a.fit(&rest)?;
        let (rival, ties) = rivals.get(*i).cloned().unwrap_or((None, vec![]));
        if !ties.is_empty() {
            ambiguous.push(Ambiguity {
                effects: std::iter::once(effect.kind())
                    .chain(ties.iter().map(|t| t.origin.kind()))
                    .collect(),
                experiment: ties
                    .iter()
                    .map(|t| format!("{}: {}", t.origin.name(), t.origin.experiment()))
                    .chain([format!("{}: {}", effect.name(), effect.experiment())])
                    .collect::<Vec<_>>()
                    .join("; "),
            });
        }
        list.push(Effect {
            name: effect.kind(),
            form: c.variant.label.clone(),
            form_kind: c.variant.form,
            meaning: effect.meaning().into(),
            terms: match (c.variant.build)(c.psi) {
                Build::Add(p) | Build::Local(p) => p.iter().map(|p| p.text.clone()).collect(),
                Build::Swap(s) | Build::SwapAll(s) => {
                    s.iter().map(|(n, t)| format!("{n} -> {t}")).collect()
                }
            },
            units: params
                .iter()
                .map(|p| (p.name.clone(), p.unit.clone()))
                .collect(),
            params: params.iter().map(|p| (p.name.clone(), p.value)).collect(),
            ci,
            heldout_before: before,
            heldout_after: after,
            rival,
            plot: plot(&a, &against, &without.residual, &fit.residual)
                .named("residual", WITHOUT, "with it"),
        });
        before = after;
    }

    let verdict = if list.is_empty() {
        if unexplained {
            Verdict::Unknown
        } else {
            Verdict::None
        }
    } else if unexplained {
        Verdict::Unknown
    } else if !ambiguous.is_empty() && ambiguous[0].effects[0] == list[0].name {
        Verdict::NotIdentifiable
    } else if list.len() > 1 {
        Verdict::Several
    } else {
        Verdict::Effect
    };

    let step = last_step.map(|s| s.ranked).unwrap_or_default();
    let seen_not_material: Vec<NotMaterial> = step
        .iter()
        .filter(|c| {
            c.gain > 5e-4
                && c.gain < sel.material
                && c.p * a.tests as f64 <= sel.fdr
                && !list.iter().any(|e| e.name == c.origin.kind())
        })
        .map(|c| NotMaterial {
            name: c.origin.kind(),
            form: c.variant.label.clone(),
            gain: c.gain,
            params: psi_map(c),
        })
        .collect();
    let tested = step
        .iter()
        .map(|c| Tested {
            name: c.origin.kind(),
            form: c.variant.label.clone(),
            gain: c.gain,
            p: c.p,
            steadiness: c.z,
            params: psi_map(c),
        })
        .collect::<Vec<_>>();
    // What the catalogue offers is as well seen on the windows.
    let small = match &a.thin {
        Some(thin) => Some((thin, Fit::new(thin, &declared)?)),
        None => None,
    };
    let (on, with) = small
        .as_ref()
        .map_or((&a.problem, &base), |(thin, fit)| (*thin, fit));
    let absent = CATALOGUE
        .iter()
        .filter(|e| a.allowed(**e))
        .filter(|e| {
            e.variants(&context(on, spec, &a.load, &declared, with))
                .is_empty()
        })
        .map(|e| e.kind())
        .collect();
    let plot_unknown = left.first().map(|c| {
        let text = c.origin.against().unwrap_or(&a.load);
        plot(&a, text, &base.residual, &fit.residual)
    });
    let last = figures(&a.problem, &fit, sel.seed);
    Ok(Report {
        title: spec.title.clone(),
        unit: spec.roles.target.unit.clone(),
        files: files
            .iter()
            .map(|f| {
                f.file_name()
                    .map_or(String::new(), |n| n.to_string_lossy().into_owned())
            })
            .collect(),
        rows: a.problem.y.len(),
        sequences: a.problem.frame.sequences().len(),
        groups,
        folds: fold_names,
        baseline,
        last,
        verdict,
        effects: list,
        not_identifiable: ambiguous,
        structure,
        seen_not_material,
        tested,
        absent,
        hygiene,
        residual_tests,
        extended: extended(spec, &model, &fit, &chosen),
        declared: declared_terms(&declared, &base),
        plot_unknown,
    })
}

fn psi_map<O>(c: &Candidate<O>) -> BTreeMap<String, f64> {
    c.variant
        .psi
        .iter()
        .map(|p| (p.name.to_string(), c.psi))
        .collect()
}

fn declared_terms(model: &Model, fit: &Fit) -> Vec<(String, f64, String, bool)> {
    let mut k = fit.theta.iter();
    model
        .terms
        .iter()
        .filter(|t| !t.local)
        .map(|t| {
            (
                t.name.clone(),
                t.fixed.unwrap_or_else(|| k.next().copied().unwrap_or(0.0)),
                t.unit.clone(),
                t.fixed.is_some(),
            )
        })
        .collect()
}

/// Held-out RMSE and MAE with 95 % block-bootstrap intervals.
fn figures(p: &Problem, fit: &Fit, seed: u64) -> Figures {
    let per: Vec<(f64, f64, f64)> = p
        .blocks
        .iter()
        .map(|b| {
            let r = &fit.held[b.range.clone()];
            (
                r.iter().map(|x| x * x).sum(),
                r.iter().map(|x| x.abs()).sum(),
                r.len() as f64,
            )
        })
        .collect();
    let mut rng = Rng::new(seed ^ 0xb00);
    let (mut rmse, mut mae): (Vec<f64>, Vec<f64>) = (0..1000)
        .map(|_| {
            let (mut s, mut a, mut n) = (0.0, 0.0, 0.0);
            for _ in 0..per.len() {
                let b = per[rng.below(per.len())];
                s += b.0;
                a += b.1;
                n += b.2;
            }
            ((s / n).sqrt(), a / n)
        })
        .unzip();
    rmse.sort_by(f64::total_cmp);
    mae.sort_by(f64::total_cmp);
    let ci = |v: &[f64]| {
        [
            stats::quantile_sorted(v, 0.025),
            stats::quantile_sorted(v, 0.975),
        ]
    };
    Figures {
        heldout_rmse: stats::rms(&fit.held),
        heldout_rmse_ci: ci(&rmse),
        heldout_mae: fit.held.iter().map(|x| x.abs()).sum::<f64>() / fit.held.len().max(1) as f64,
        heldout_mae_ci: ci(&mae),
        insample_rmse: stats::rms(&fit.residual),
    }
}

type Intervals = BTreeMap<String, [f64; 2]>;

/// Parameters of one chosen effect with 95 % block-bootstrap intervals; the nonlinear one is chosen
/// anew in every replicate.
fn parameters(
    a: &Analysis,
    chosen: &[Chosen],
    index: usize,
) -> Result<(Vec<effects::Param>, Intervals), Error> {
    let own = &chosen[index];
    let p = &a.problem;
    let sums_at = |psi: f64| -> Result<(Sums, Vec<usize>), Error> {
        let mut all = chosen.to_vec();
        all[index].psi = psi;
        let model = Model::with(a.spec, &all)?;
        let view = p.view(&model.replaced)?;
        let mut x = Vec::new();
        let mut fixed = vec![0.0; p.y.len()];
        let mut mine = Vec::new();
        let local = matches!((own.variant.build)(psi), Build::Local(_));
        for t in &model.terms {
            // A local effect is summarised by one common phase only if it has one: see below.
            if t.local && !(local && t.chosen == Some(index)) {
                continue;
            }
            let v = p.eval(&view, &t.expr)?;
            match t.fixed {
                Some(k) => fixed
                    .iter_mut()
                    .zip(v.iter())
                    .for_each(|(f, v)| *f += k * v),
                None => {
                    if t.chosen == Some(index) {
                        mine.push(x.len());
                    }
                    x.push(v);
                }
            }
        }
        let y: Vec<f64> = p.y.iter().zip(&fixed).map(|(y, f)| y - f).collect();
        let cols: Vec<&[f64]> = x.iter().map(|c: &Column| c.as_slice()).collect();
        Ok((Sums::new(p, &cols, &y, None, None), mine))
    };
    let value = |psi: f64, s: &Sums, mine: &[usize], w: Option<&[f64]>| {
        let (t, _) = s.fit(w);
        own.variant
            .params(psi, &mine.iter().map(|i| t[*i]).collect::<Vec<_>>())
    };
    let (s0, mine) = sums_at(own.psi)?;
    let mut params = value(own.psi, &s0, &mine, None);
    let local = matches!((own.variant.build)(own.psi), Build::Local(_));
    if local {
        let (_, fit) = a.fit(chosen)?;
        let size = fit.local.iter().map(|(_, r)| r * r).sum::<f64>().sqrt();
        params.retain(|p| p.name != "phase");
        params
            .iter_mut()
            .filter(|p| p.name == "amplitude")
            .for_each(|p| p.value = size);
    }
    let mut grid = vec![(own.psi, s0)];
    if let Some(psi) = own.variant.psi.as_ref().filter(|p| p.refine && !local) {
        let cost = |s: &Sums| -> f64 {
            let (x, _) = s.fit(None);
            (0..s.yy.len()).map(|k| s.block_error(k, &x)).sum()
        };
        let (lo, hi) = match psi.resolution {
            Some(d) => (own.psi - d, own.psi + d),
            None => search::bracket(&psi.grid, own.psi),
        };
        let mut h = 0.05 * (hi - lo).abs();
        if psi.grid[0] > 0.0 {
            // A width or time that came out far below its grid must stay positive.
            h = h.min(0.5 * own.psi);
        }
        let centre = cost(&grid[0].1);
        let n = p.y.len() as f64;
        let curvature = [own.psi - h, own.psi + h]
            .iter()
            .map(|x| sums_at(*x).map(|s| cost(&s.0) - centre))
            .collect::<Result<Vec<f64>, _>>()?;
        let bend = (curvature[0] + curvature[1]).max(1e-12 * centre) / (h * h);
        let colour = correlation_rows(p, &a.fit(chosen)?.1.residual);
        let se = (2.0 * centre / n * colour / bend)
            .sqrt()
            .min((hi - lo).abs());
        let points: Vec<f64> = (-8i32..=8)
            .filter(|k| *k != 0)
            .map(|k| own.psi + 0.5 * f64::from(k) * se)
            .filter(|x| psi.grid[0] < 0.0 || *x > 0.0)
            .collect();
        let more: Vec<(f64, Sums)> = points
            .par_iter()
            .filter_map(|x| sums_at(*x).ok().map(|s| (*x, s.0)))
            .collect();
        grid.extend(more);
    }
    let mut rng = Rng::new(a.spec.selection.seed ^ 0xc1);
    let draws: Vec<Vec<f64>> = (0..REPLICATES)
        .map(|_| {
            let mut w = vec![0.0; p.blocks.len()];
            (0..w.len()).for_each(|_| w[rng.below(p.blocks.len())] += 1.0);
            w
        })
        .collect();
    let replicates: Vec<Vec<effects::Param>> = draws
        .par_iter()
        .map(|w| {
            let best = grid
                .iter()
                .min_by(|a, b| {
                    let err = |s: &Sums| -> f64 {
                        let (x, _) = s.fit(Some(w));
                        (0..w.len())
                            .filter(|k| w[*k] > 0.0)
                            .map(|k| w[k] * s.block_error(k, &x))
                            .sum()
                    };
                    err(&a.1).total_cmp(&err(&b.1))
                })
                .unwrap_or(&grid[0]);
            value(best.0, &best.1, &mine, Some(w))
        })
        .collect();
    let mut ci = BTreeMap::new();
    for q in &params {
        let mut v: Vec<f64> = replicates
            .iter()
            .filter_map(|r| r.iter().find(|x| x.name == q.name).map(|x| x.value))
            .collect();
        if q.name == "phase" {
            // Phases wrap: count them from the estimate.
            v.iter_mut().for_each(|x| {
                *x = q.value
                    + (*x - q.value + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                    - std::f64::consts::PI
            });
        }
        v.sort_by(f64::total_cmp);
        if !local {
            ci.insert(
                q.name.clone(),
                [
                    stats::quantile_sorted(&v, 0.025),
                    stats::quantile_sorted(&v, 0.975),
                ],
            );
        }
    }
    Ok((params, ci))
}

/// The model file with the effects as terms: running it again reproduces the final fit.
fn extended(spec: &Spec, model: &Model, fit: &Fit, chosen: &[Chosen]) -> Spec {
    let mut out = spec.clone();
    out.terms = model
        .terms
        .iter()
        .enumerate()
        .map(|(i, t)| {
            let fitted = fit.free.iter().position(|f| *f == i).map(|k| fit.theta[k]);
            let effect = match t.chosen {
                Some(c) => chosen[c].effect.name().to_string(),
                None => spec.terms[i].effect.clone(),
            };
            Term {
                name: if t.chosen.is_some() {
                    format!("{effect}: {}", t.name)
                } else {
                    t.name.clone()
                },
                expr: model.written_out(&t.expr).to_string(),
                unit: t.unit.clone(),
                fixed: t.fixed,
                per: if t.local {
                    "sequence".into()
                } else {
                    String::new()
                },
                effect,
                fitted: if t.fixed.is_none() { fitted } else { None },
            }
        })
        // A term that repeats others on these data carries nothing.
        .zip((0..).map(|i| {
            fit.free
                .iter()
                .position(|f| *f == i)
                .is_some_and(|k| fit.dropped[k])
        }))
        .filter(|(_, dropped)| !dropped)
        .map(|(t, _)| t)
        .collect();
    out
}

/// Points and binned means of the residual before and after.
fn plot(a: &Analysis, against: &str, before: &[f64], after: &[f64]) -> Plot {
    let x = a
        .problem
        .eval_text(&a.problem.plain, against, true)
        .unwrap_or_default();
    let unit = if against == a.load {
        a.spec.roles.target.unit.clone()
    } else {
        a.spec.roles.unit(against)
    };
    let name = against.replace(&a.load, "load");
    let label = if unit.is_empty() {
        name
    } else {
        format!("{name}, {unit}")
    };
    Plot::new(&label, &x, before, after)
}

#[cfg(test)]
mod tests {
    use crate::effects::testbench::{simulate, Excitation};
    use crate::report::{Effect, Report};
    use std::collections::VecDeque;

    fn names(report: &Report) -> Vec<&str> {
        let mut names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        names.sort_unstable();
        names
    }

    fn param(report: &Report, effect: &str, name: &str) -> f64 {
        let of = |e: &&Effect| e.name == effect;
        let found = report
            .effects
            .iter()
            .find(of)
            .and_then(|e| e.params.get(name));
        *found.unwrap_or_else(|| panic!("no {effect}.{name}\n{}", report.markdown()))
    }

    fn near(value: f64, truth: f64) {
        assert!((value / truth - 1.0).abs() < 0.1, "{value} for {truth}");
    }

    /// Whatever is found after a delay of the target is as late as what was found before.
    #[test]
    fn friction_in_a_late_log_is_one_friction() {
        let mut line = VecDeque::new();
        let report = simulate(&Excitation::default(), 1.0, &mut |s| {
            if s.first {
                line.clear();
            }
            line.push_back(s.command - (0.5 + 0.15 * s.command) * s.velocity.signum());
            if line.len() > 4 {
                line.pop_front();
            }
            line[0] - s.command
        });
        assert_eq!(names(&report), ["delay", "load_dependent_coulomb"]);
        near(param(&report, "delay", "delay"), 0.06);
        let friction = |name| param(&report, "load_dependent_coulomb", name);
        near(friction("friction_at_zero_load"), -0.5);
        near(friction("friction_per_load"), -0.15);
        let terms = &report.extended.terms;
        assert!(
            terms
                .iter()
                .skip(1)
                .all(|t| t.expr.contains("delay(velocity")),
            "{terms:?}"
        );
    }

    /// Friction that grows with load in motion, and another one at rest: neither takes the other's place.
    #[test]
    fn friction_at_rest_and_in_motion_have_coefficients_of_their_own() {
        let excitation = Excitation {
            stops: true,
            ..Excitation::default()
        };
        let mut last = 0.0;
        let report = simulate(&excitation, 1.0, &mut |s| {
            if s.first {
                last = 0.0;
            }
            if s.velocity != 0.0 {
                last = s.velocity.signum();
                -(0.3 + 0.15 * s.command) * last
            } else {
                -1.2 * last
            }
        });
        assert_eq!(names(&report), ["load_dependent_coulomb", "presliding"]);
        let moving = |name| param(&report, "load_dependent_coulomb", name);
        near(moving("friction_at_zero_load"), -0.3);
        near(moving("friction_per_load"), -0.15);
        near(param(&report, "presliding", "held_friction"), -1.2);
    }
}

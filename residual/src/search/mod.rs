//! The search: which effects of the catalogue, together, explain what the declared model lacks.
//!
//! Each step scans the whole catalogue on the current residual. A candidate counts if its held-out
//! gain is material, stands out from the gains that decoys of the residual reach with the same
//! terms, and is steady over blocks. Among those that explain nearly the same, the one with fewer
//! parameters is taken first; a richer one that still adds something is taken in a later step and
//! then replaces what it makes superfluous. So an effect that only imitates another
//! one (a line in position for a hysteresis) can be added, but is removed later.
//!
//! Steps: [`forward`] adds effects, [`polish`] refines their nonlinear parameters, [`merge`] puts one
//! effect in the place of two, [`rivals`] lets the whole catalogue compete for each place,
//! [`prune`] removes what the others make superfluous.

mod forward;
mod friction;
mod merge;
mod polish;
mod prune;
mod rivals;

pub(crate) use rivals::Judged;

use crate::data::Data;
use crate::declared::{self, fit_declared};
use crate::effects::{Context, EffectKind, EffectRef};
use crate::error::Error;
use crate::model::{Chosen, Fit, Fitted, Model};
use crate::problem::Problem;
use crate::progress::Progress;
use crate::ranking::{rank, Acceptance, Step};
use crate::scan::{catalogue_offers, Candidate, Offer, Origin, Scan};
use crate::spec::Spec;
use crate::stats;
use std::collections::HashMap;
use std::sync::Arc;

/// Rows of the windows on which the catalogue is screened, where the data have at least twice as many.
const SCREEN_ROWS: usize = 60_000;

/// Forms that pass the screening on windows.
const SCREENED: usize = 14;

/// Rounds of forward search and rivals; in the last nothing is replaced.
const ROUNDS: usize = 4;

/// The problem, the declared model on it, and what the search has scanned so far.
pub(crate) struct Search<'a> {
    pub problem: Problem,
    /// Windows of the data on which the catalogue is screened, where there are many rows.
    pub thin: Option<Problem>,
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression.
    pub load: String,
    pub declared: Arc<Fitted>,
    /// Smallest RMS of a contribution that can be distinguished from the steps of the target.
    floor: f64,
    /// Most forms tried in one scan.
    tests: usize,
    /// Scans of the catalogue that were made already, by the model they were made on.
    scans: HashMap<String, Vec<Candidate>>,
    /// The effect that `selection.max_effects` kept out of the last forward search.
    limited: Option<EffectKind>,
}

/// What the search found.
pub(crate) struct Outcome {
    pub chosen: Vec<Chosen>,
    /// Nearest rival of each chosen effect, and what cannot be distinguished from it.
    pub judged: Vec<Judged>,
    /// The last scan of the catalogue, on top of the final model.
    pub last: Step,
    /// The final model.
    pub fitted: Fitted,
    /// The effect that would have come next, where the search ended at `selection.max_effects`.
    pub limited: Option<EffectKind>,
}

/// What one chosen effect is worth.
#[derive(Clone, Copy)]
pub(crate) struct Weight {
    /// Index among the chosen effects.
    pub index: usize,
    /// Held-out RMSE of the final model.
    pub rmse: f64,
    /// Held-out RMSE of the final model without this effect.
    pub rmse_without: f64,
}

/// One chosen effect and the others.
pub(crate) fn without(chosen: &[Chosen], index: usize) -> (Chosen, Vec<Chosen>) {
    let mut rest = chosen.to_vec();
    let own = rest.remove(index);
    (own, rest)
}

/// Rows before and after one at a stop in which noise may have been cut off as well.
const CUT_OFF: usize = 10;

/// What the declared model predicts if it is fitted without the rows at which the target stops. With them it would bend
/// towards the limit. `None` if the target stops nowhere, or too little is left.
fn unlimited(stops: &[Option<f64>], spec: &Spec, data: &Data) -> Option<String> {
    let at: Vec<f64> = stops.iter().copied().flatten().collect();
    if at.is_empty() {
        return None;
    }
    let mut free = data.without_values(&at, CUT_OFF).problem(&spec.selection);
    free.derive(&Scan::derived(spec));
    let fitted = fit_declared(&mut free, spec).ok()?;
    Some(declared::prediction_expression(&fitted))
}

impl<'a> Search<'a> {
    /// Fits the declared model and prepares the search.
    pub fn new(
        spec: &'a Spec,
        data: &Data,
        progress: &mut dyn Progress,
    ) -> Result<Search<'a>, Error> {
        let mut problem = data.problem(&spec.selection);
        problem.ticker = progress.ticker();
        progress.stage(&format!(
            "baseline on {} rows, {} groups in {} folds",
            problem.y.len(),
            data.groups(),
            problem.folds
        ));
        problem.derive(&Scan::derived(spec));
        let declared = fit_declared(&mut problem, spec)?;
        problem.unlimited = unlimited(&problem.stops, spec, data);
        let steps = stats::quantum(&problem.y).map_or(0.0, |q| q / 12f64.sqrt() / 4.0);
        Ok(Search {
            load: declared::load_expression(&declared),
            thin: problem.thin(SCREEN_ROWS).map(|mut thin| {
                thin.derive(&Scan::derived(spec));
                thin
            }),
            declared: Arc::new(declared),
            floor: spec.roles.target.noise_floor.max(steps),
            problem,
            spec,
            tests: 1,
            scans: HashMap::new(),
            limited: None,
        })
    }

    /// Forward, then every effect against its rivals; a change starts the forward search again.
    pub fn run(&mut self, progress: &mut dyn Progress) -> Result<Outcome, Error> {
        let mut chosen: Vec<Chosen> = Vec::new();
        let mut round = 0;
        loop {
            self.forward(&mut chosen, progress)?;
            self.polish(&mut chosen)?;
            round += 1;
            let may_replace = round < ROUNDS;
            if may_replace && self.merge(&mut chosen, progress)? {
                self.polish(&mut chosen)?;
            }
            let Some(judged) = self.rivals(&mut chosen, may_replace, progress)? else {
                continue;
            };
            // Polished parameters change the residual, so the catalogue is scanned once more before the end.
            progress.stage("what is left");
            let fitted = self.fit(&chosen)?;
            let last = self.step(&fitted)?;
            let more = if last.winner.is_none() || !may_replace {
                None
            } else {
                self.limited = None;
                self.next(&chosen)?
            };
            // Where nothing that counts can be added, another round would end as this one did.
            match more {
                Some(next) => chosen = next,
                None => {
                    return Ok(Outcome {
                        limited: self.limited,
                        chosen,
                        judged,
                        last,
                        fitted,
                    })
                }
            }
        }
    }

    /// The outcome with some of its effects only (indices), their nonlinear parameters refined again.
    pub fn only(&mut self, outcome: &Outcome, kept: &[usize]) -> Result<Outcome, Error> {
        let mut chosen: Vec<Chosen> = kept.iter().map(|i| outcome.chosen[*i].clone()).collect();
        self.polish(&mut chosen)?;
        let fitted = self.fit(&chosen)?;
        let last = self.step(&fitted)?;
        let judged = kept.iter().filter_map(|i| outcome.judged.get(*i));
        Ok(Outcome {
            judged: judged.cloned().collect(),
            limited: outcome.limited,
            chosen,
            last,
            fitted,
        })
    }

    /// Fits the declared model with chosen effects.
    pub fn fit(&self, chosen: &[Chosen]) -> Result<Fitted, Error> {
        let model = Model::with(self.spec, chosen)?;
        let fit = Fit::new(&self.problem, &model)?;
        Ok(Fitted { model, fit })
    }

    /// Held-out RMSE of the declared model with chosen effects.
    pub fn rmse(&self, chosen: &[Chosen]) -> Result<f64, Error> {
        Ok(self.fit(chosen)?.rmse())
    }

    /// A scan on top of a model, on all rows.
    pub fn scan_on<'s>(&'s self, fitted: &'s Fitted) -> Scan<'s> {
        Scan::new(&self.problem, self.spec, &self.load, fitted)
    }

    /// What a candidate must reach to count.
    pub fn acceptance(&self) -> Acceptance<'a> {
        Acceptance {
            selection: &self.spec.selection,
            tests: self.tests,
            floor: self.floor,
            rows: self.problem.y.len(),
        }
    }

    /// Whether the model file lets the search look for an effect.
    pub fn allowed(&self, e: EffectRef) -> bool {
        let s = &self.spec.selection;
        (s.only.is_empty() || s.only.iter().any(|n| n == e.name()))
            && !s.except.iter().any(|n| n == e.name())
    }

    /// Scans what is on offer on top of a model; screens it on windows first where rows are many.
    pub fn scan<O: Origin>(
        &mut self,
        on: &Fitted,
        offers: &dyn Fn(&Self, &Context) -> Vec<Offer<O>>,
    ) -> Result<Vec<Candidate<O>>, Error> {
        let (tests, found) = match &self.thin {
            None => {
                let scan = self.scan_on(on);
                (0, scan.candidates(&offers(self, &scan.context()), None))
            }
            Some(thin) => {
                let fit = Fit::new(thin, &on.model)?;
                let small = Scan {
                    problem: thin,
                    fit: &fit,
                    screening: true,
                    ..self.scan_on(on)
                };
                let mut first = small.candidates(&offers(self, &small.context()), None);
                // What the target itself shows may lie outside of all windows.
                first.sort_by(|a, b| {
                    let observed = b.variant.observed.cmp(&a.variant.observed);
                    observed.then(b.gain.total_cmp(&a.gain))
                });
                let tests = first.len();
                let own = first.iter().filter(|c| c.variant.observed).count();
                first.truncate(SCREENED + own);
                let least = 0.25 * self.spec.selection.material;
                first.retain(|c| c.variant.observed || c.gain > least);
                let short: Vec<Offer<O>> = first.iter().map(Candidate::offer).collect();
                let at: Vec<f64> = first.iter().map(|c| c.psi).collect();
                (tests, self.scan_on(on).candidates(&short, Some(&at)))
            }
        };
        self.tests = self.tests.max(tests).max(found.len());
        Ok(found)
    }

    /// Scans the catalogue on top of a model and ranks it.
    fn step(&mut self, on: &Fitted) -> Result<Step, Error> {
        let key = on.model.key();
        if !self.scans.contains_key(&key) {
            let mut all = self.scan(on, &|search: &Self, ctx| {
                catalogue_offers(ctx, &|e| search.allowed(e))
            })?;
            self.retest(&mut all, on);
            self.scans.insert(key.clone(), all);
        }
        let all = self.scans.get(&key).map_or(&[][..], Vec::as_slice);
        Ok(rank(all, &self.acceptance()))
    }

    /// Tests material candidates again that the first decoys could not clear. In a closed loop those
    /// that the setpoint does not confirm are refused.
    pub fn retest<O: Origin>(&self, all: &mut [Candidate<O>], on: &Fitted) {
        let scan = self.scan_on(on);
        let acceptance = self.acceptance();
        let doubtful =
            |c: &Candidate<O>| acceptance.material(c.gain) && !acceptance.significant(c.p);
        if all.iter().any(&doubtful) {
            let rows = self.problem.y.len();
            // Windows show it as well as all rows; with fewer rows decoys gain more, so they do not clear too much.
            let small = self
                .thin
                .as_ref()
                .and_then(|thin| Some((thin, Fit::new(thin, &on.model).ok()?)));
            let scan = match &small {
                Some((problem, fit)) => Scan {
                    problem,
                    fit,
                    ..scan
                },
                None => scan,
            };
            for c in all.iter_mut().filter(|c| doubtful(c)) {
                c.p = c.p.min(scan.retest(c, rows));
            }
        }
        let scan = self.scan_on(on);
        let counts = |c: &Candidate<O>| acceptance.accepts(c) && !c.variant.observed;
        for c in all.iter_mut().filter(|c| counts(c)) {
            c.between = scan
                .between_sequences(&c.variant, c.psi)
                .filter(|b| !acceptance.significant(b.within));
        }
        if self.spec.roles.setpoint.is_none() {
            return;
        }
        for c in all.iter_mut().filter(|c| {
            let open = acceptance.material(c.gain) && c.p < 1.0 && !c.variant.observed;
            open && scan.built_on_command(&c.variant, c.psi)
        }) {
            if !c.origin.has_witness() && scan.share_on_setpoint(&c.variant, c.psi) < 0.5 {
                c.p = 1.0;
            }
        }
    }

    /// What each chosen effect is worth, the most valuable first.
    pub fn weights(&self, outcome: &Outcome) -> Result<Vec<Weight>, Error> {
        let rmse = outcome.fitted.rmse();
        let mut weights: Vec<Weight> = (0..outcome.chosen.len())
            .map(|index| {
                Ok(Weight {
                    index,
                    rmse,
                    rmse_without: self.rmse(&without(&outcome.chosen, index).1)?,
                })
            })
            .collect::<Result<_, Error>>()?;
        weights.sort_by(|x, y| y.rmse_without.total_cmp(&x.rmse_without));
        Ok(weights)
    }
}

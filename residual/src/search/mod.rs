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
//! [`exchange`] tries another form of an effect with one more effect, [`prune`] removes what the others
//! make superfluous.

mod exchange;
mod forward;
mod friction;
mod load;
mod merge;
mod polish;
mod prune;
mod rivals;

pub(crate) use rivals::Judged;

use crate::data::Data;
use crate::declared::{self, fit_declared};
use crate::effects::{Context, EffectKind, EffectRef};
use crate::error::Error;
use crate::feedback::Instruments;
use crate::model::{Chosen, Fit, Fitted, Model};
use crate::problem::Problem;
use crate::progress::Progress;
use crate::ranking::{rank, Acceptance, Step};
use crate::scan::{catalogue_offers, Candidate, Offer, Origin, Scan};
use crate::spec::Spec;
use crate::stats;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Rows of the windows on which the catalogue is screened, where the data have at least twice as many.
const SCREEN_ROWS: usize = 60_000;

/// Forms that pass the screening on windows.
const SCREENED: usize = 14;

/// Share of the best gain on windows above which a form is scanned on all rows at once. The others are only if none of
/// these counts: a form that explains so much less can neither come first nor be a close rival.
const AT_ONCE: f64 = 0.5;

/// Fewest forms that are scanned on all rows at once.
const FEWEST_AT_ONCE: usize = 4;

/// Times that the load is expressed anew. The second time corrects it for effects that the first one changed.
const LOADS: usize = 2;

/// The same where rows are many: before the rivals, and at the end if the effects are others by then.
const LOADS_OF_MANY: usize = 1;

/// Forward searches after an effect was taken away, each with refined parameters.
const FORWARDS: usize = 2;

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
    /// Whether it is the load behind a command that an effect replaces.
    load_is_behind: bool,
    pub declared: Arc<Fitted>,
    /// Smallest RMS of a contribution that can be distinguished from the steps of the target.
    floor: f64,
    /// Most forms tried in one scan.
    tests: usize,
    /// Scans of the catalogue that were made already, by the model they were made on.
    scans: HashMap<String, Scanned>,
    /// The effect that `selection.max_effects` kept out of the last forward search.
    limited: Option<EffectKind>,
    /// Effects whose names are not supported, and whether they are left out for now only.
    barred: Vec<(EffectKind, bool)>,
    /// Instruments that were made last, by view.
    pub(crate) last_instruments: Mutex<Option<(String, Arc<Instruments>)>>,
}

/// Forms of the catalogue on top of one model.
#[derive(Clone)]
struct Scanned {
    /// With what each achieves.
    candidates: Vec<Candidate>,
    /// Those that were screened on windows and are still to be scanned on all rows.
    waiting: ShortList,
}

/// Forms that passed the screening on windows, the most promising first.
#[derive(Clone)]
struct ShortList<O = EffectRef> {
    offers: Vec<Offer<O>>,
    /// Nonlinear parameter of each, on windows.
    at: Vec<f64>,
    /// Gain of each on windows; infinite for what the target itself shows.
    gains: Vec<f64>,
}

impl<O> Default for ShortList<O> {
    fn default() -> Self {
        ShortList {
            offers: vec![],
            at: vec![],
            gains: vec![],
        }
    }
}

impl<O> ShortList<O> {
    /// Takes off those that are scanned on all rows at once.
    fn first(&mut self) -> ShortList<O> {
        let finite = self.gains.iter().copied().filter(|g| g.is_finite());
        let least = AT_ONCE * finite.fold(0.0, f64::max);
        let enough = self.gains.iter().take_while(|g| **g >= least).count();
        self.take(enough.max(FEWEST_AT_ONCE))
    }

    /// Takes off the first `count`.
    fn take(&mut self, count: usize) -> ShortList<O> {
        let count = count.min(self.offers.len());
        ShortList {
            offers: self.offers.drain(..count).collect(),
            at: self.at.drain(..count).collect(),
            gains: self.gains.drain(..count).collect(),
        }
    }
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

/// Whether two lists have the same forms of effects.
fn same_forms(a: &[Chosen], b: &[Chosen]) -> bool {
    let count = |all: &[Chosen], form: &Chosen| all.iter().filter(|c| c.is_form(form)).count();
    a.len() == b.len() && a.iter().all(|form| count(a, form) == count(b, form))
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
            load_is_behind: false,
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
            barred: vec![],
            last_instruments: Mutex::default(),
        })
    }

    /// Forward, then every effect against its rivals; a change starts the forward search again.
    pub fn run(&mut self, progress: &mut dyn Progress) -> Result<Outcome, Error> {
        let mut chosen: Vec<Chosen> = Vec::new();
        let (mut round, mut loads) = (0, 0);
        // The effects with which the load was expressed before the rivals.
        let mut early: Option<Vec<Chosen>> = None;
        loop {
            if self.load_is_stale(&chosen) {
                self.load_before(&mut chosen)?;
            }
            self.forward(&mut chosen, progress)?;
            self.polish_last(&mut chosen)?;
            // Rivals take long where rows are many: they are looked for with the load that stays.
            if self.thin.is_some() && early.is_none() {
                let fitted = self.fit(&chosen)?;
                let (renewed, rmse) = (self.renewed(&fitted, &chosen)?, fitted.rmse());
                drop(fitted);
                if !renewed.is_empty() {
                    early = Some(chosen.clone());
                    if self.renew_load(renewed, rmse, &mut chosen)? {
                        continue;
                    }
                }
            }
            round += 1;
            let may_replace = round < ROUNDS;
            if may_replace && self.merge(&mut chosen, progress)? {
                self.polish(&mut chosen)?;
            }
            let Some(judged) = self.rivals(&mut chosen, may_replace, progress)? else {
                continue;
            };
            if may_replace && self.exchange(&mut chosen, progress)? {
                continue;
            }
            // Polished parameters change the residual, so the catalogue is scanned once more before the end.
            progress.stage("what is left");
            let fitted = self.fit(&chosen)?;
            let last = self.step(&fitted)?;
            let most = match (&self.thin, &early) {
                (None, _) => LOADS,
                (_, Some(early)) if same_forms(early, &chosen) => 0,
                _ => LOADS_OF_MANY,
            };
            let renewed = match loads < most {
                true => self.renewed(&fitted, &chosen)?,
                false => vec![],
            };
            let more = if last.winner.is_none() || !may_replace {
                None
            } else {
                self.limited = None;
                self.next(&chosen)?
            };
            // Where nothing that counts can be added, another round would end as this one did.
            match more {
                Some(next) => chosen = next,
                None if self.renew_load(renewed, fitted.rmse(), &mut chosen)? => {
                    // After the first time the effects are those of another load.
                    let first = loads == 0 && self.thin.is_none();
                    round = if first { 0 } else { ROUNDS - 1 };
                    loads += 1;
                }
                // `forward` begins with the load that is left.
                None if self.load_is_stale(&chosen) => {}
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

    /// Leaves an effect out of the catalogue: from now on, or only until another one is left out for good.
    pub fn bar(&mut self, kind: EffectKind, for_now: bool) {
        if !for_now {
            let before = self.barred.len();
            self.barred.retain(|(_, for_now)| !for_now);
            // Scans that were made meanwhile lack what was left out.
            if self.barred.len() < before {
                self.scans.clear();
            }
        }
        self.barred.push((kind, for_now));
    }

    fn is_barred(&self, kind: EffectKind) -> bool {
        self.barred.iter().any(|(k, _)| *k == kind)
    }

    /// The outcome with some effects, their nonlinear parameters refined again. Goes `on` to search for more.
    pub fn resume(&mut self, mut chosen: Vec<Chosen>, on: bool) -> Result<Outcome, Error> {
        // Where rows are many it is enough to refine them once, at the end.
        if self.thin.is_none() || !on {
            self.polish(&mut chosen)?;
        }
        self.load_before(&mut chosen)?;
        // Where rows are many, what was added beside parameters that were not refined may have made up for them, or been hidden by them.
        for _ in 0..if on { FORWARDS } else { 0 } {
            self.forward(&mut chosen, &mut ())?;
            if self.polish_last(&mut chosen)? {
                continue;
            }
            // The load may be that of the effect that is gone.
            let fitted = self.fit(&chosen)?;
            let rmse = fitted.rmse();
            let renewed = match self.thin {
                None => self.renewed(&fitted, &chosen)?,
                Some(_) => vec![],
            };
            drop(fitted);
            if !self.renew_load(renewed, rmse, &mut chosen)? {
                break;
            }
        }
        let fitted = self.fit(&chosen)?;
        let last = self.step(&fitted)?;
        Ok(Outcome {
            judged: vec![],
            limited: self.limited,
            chosen,
            last,
            fitted,
        })
    }

    /// Rivals of the effects of an outcome, each beside the others of it.
    pub fn judge_again(&mut self, outcome: &mut Outcome) -> Result<(), Error> {
        let mut chosen = outcome.chosen.clone();
        outcome.judged = self
            .rivals(&mut chosen, false, &mut ())?
            .unwrap_or_default();
        Ok(())
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

    /// A model fitted on the windows; `None` where rows are few.
    fn fit_on_windows(&self, on: &Fitted) -> Option<(&Problem, Fit)> {
        let thin = self.thin.as_ref()?;
        Some((thin, Fit::new(thin, &on.model).ok()?))
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
        !self.is_barred(e.kind())
            && (s.only.is_empty() || s.only.iter().any(|n| n == e.name()))
            && !s.except.iter().any(|n| n == e.name())
    }

    /// Scans what is on offer on top of a model; screens it on windows first where rows are many.
    pub fn scan<O: Origin>(
        &mut self,
        on: &Fitted,
        offers: &dyn Fn(&Self, &Context) -> Vec<Offer<O>>,
    ) -> Result<Vec<Candidate<O>>, Error> {
        match self.screen(on, offers)? {
            None => Ok(self.scan_all(on, offers)),
            Some(list) => Ok(self.scan_listed(on, &list)),
        }
    }

    /// Screens what is on offer on windows; `None` where there are no windows, as the rows are few.
    fn screen<O: Origin>(
        &mut self,
        on: &Fitted,
        offers: &dyn Fn(&Self, &Context) -> Vec<Offer<O>>,
    ) -> Result<Option<ShortList<O>>, Error> {
        let Some(thin) = &self.thin else {
            return Ok(None);
        };
        let fit = Fit::new(thin, &on.model)?;
        let small = Scan {
            problem: thin,
            fit: &fit,
            screening: true,
            ..self.scan_on(on)
        };
        let mut found = small.candidates(&offers(self, &small.context()), None);
        // What the target itself shows may lie outside of all windows.
        let gain = |c: &Candidate<O>| match c.variant.observed {
            true => f64::INFINITY,
            false => c.gain,
        };
        found.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
        let tests = found.len();
        let own = found.iter().filter(|c| c.variant.observed).count();
        found.truncate(SCREENED + own);
        let least = 0.25 * self.spec.selection.material;
        found.retain(|c| gain(c) > least);
        self.tests = self.tests.max(tests);
        Ok(Some(ShortList {
            offers: found.iter().map(Candidate::offer).collect(),
            at: found.iter().map(|c| c.psi).collect(),
            gains: found.iter().map(gain).collect(),
        }))
    }

    /// Scans all that is on offer on all rows.
    fn scan_all<O: Origin>(
        &mut self,
        on: &Fitted,
        offers: &dyn Fn(&Self, &Context) -> Vec<Offer<O>>,
    ) -> Vec<Candidate<O>> {
        let scan = self.scan_on(on);
        let found = scan.candidates(&offers(self, &scan.context()), None);
        self.tests = self.tests.max(found.len());
        found
    }

    /// Scans forms that were screened on all rows.
    fn scan_listed<O: Origin>(&self, on: &Fitted, list: &ShortList<O>) -> Vec<Candidate<O>> {
        let scan = self.scan_on(on);
        scan.candidates(&list.offers, Some(&list.at))
    }

    /// Scans the catalogue on top of a model and ranks it.
    fn step(&mut self, on: &Fitted) -> Result<Step, Error> {
        let key = self.scanned(on)?;
        Ok(rank(&self.candidates(&key), &self.acceptance()))
    }

    /// The forms of the catalogue of one of the scans that were made, each with what it achieves.
    fn candidates(&self, key: &str) -> Vec<Candidate> {
        let all = self.scans.get(key).map(|scanned| &scanned.candidates);
        let free = |c: &&Candidate| !self.is_barred(c.origin.kind());
        all.into_iter().flatten().filter(free).cloned().collect()
    }

    /// Scans the catalogue on top of a model, unless that was done before. Returns the key of the scan.
    fn scanned(&mut self, on: &Fitted) -> Result<String, Error> {
        let key = on.model.key();
        if !self.scans.contains_key(&key) {
            let offers =
                |search: &Self, ctx: &Context| catalogue_offers(ctx, &|e| search.allowed(e));
            let (mut candidates, waiting) = match self.screen(on, &offers)? {
                None => (self.scan_all(on, &offers), ShortList::default()),
                Some(mut list) => (self.scan_listed(on, &list.first()), list),
            };
            self.retest(&mut candidates, on);
            let scanned = Scanned {
                candidates,
                waiting,
            };
            self.scans.insert(key.clone(), scanned);
            let acceptance = self.acceptance();
            if !self.candidates(&key).iter().any(|c| acceptance.accepts(c)) {
                self.scan_waiting(on);
            }
        }
        Ok(key)
    }

    /// Scans on all rows what is still waiting for it on top of a model. Whether there was anything.
    fn scan_waiting(&mut self, on: &Fitted) -> bool {
        let key = on.model.key();
        let waiting = self
            .scans
            .get_mut(&key)
            .map(|s| std::mem::take(&mut s.waiting));
        let Some(list) = waiting.filter(|list| !list.offers.is_empty()) else {
            return false;
        };
        let mut more = self.scan_listed(on, &list);
        self.retest(&mut more, on);
        if let Some(scanned) = self.scans.get_mut(&key) {
            scanned.candidates.append(&mut more);
        }
        true
    }

    /// Tests material candidates again that the first decoys could not clear. In a closed loop those
    /// that the setpoint does not confirm are refused.
    pub fn retest<O: Origin>(&self, all: &mut [Candidate<O>], on: &Fitted) {
        let acceptance = self.acceptance();
        let rows = self.problem.y.len();
        // Windows show it as well as all rows; with fewer rows decoys gain more, so they do not clear too much.
        let small = self.fit_on_windows(on);
        let scan = self.scan_on(on);
        let on_windows = scan.on(small.as_ref());
        let doubtful =
            |c: &Candidate<O>| acceptance.material(c.gain) && !acceptance.significant(c.p);
        for c in all.iter_mut().filter(|c| doubtful(c)) {
            c.p = c.p.min(on_windows.retest(c, rows));
        }
        let setpoint = self.spec.roles.setpoint.as_ref();
        let instruments = setpoint.map(|_| self.instruments(&scan));
        let open = |c: &Candidate<O>| {
            let counts = acceptance.material(c.gain) && c.p < 1.0 && !c.origin.has_witness();
            counts && scan.built_on_command(&c.variant, c.psi)
        };
        all.par_iter_mut().for_each(|c| {
            let fits = acceptance.fits(c);
            let to_confirm = instruments.as_ref().filter(|_| open(c));
            if c.variant.observed || !(fits || to_confirm.is_some()) {
                return;
            }
            let added = scan.contribution(c);
            if fits {
                let between = scan.between_sequences(&c.variant, c.psi, &added);
                if !between.is_some_and(|b| acceptance.confirmed_between(&b)) {
                    c.slow = scan.against_slow_noise(&c.variant, &added);
                }
                c.between = between.filter(|b| !acceptance.significant(b.within));
            }
            if to_confirm.is_some_and(|all| scan.share_on_setpoint(all, &added) < 0.5) {
                c.p = 1.0;
            }
        });
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

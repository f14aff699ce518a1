//! What a search works on: the problem, the declared model on it, and what was scanned so far.

use super::paths::Path;
use super::scanned::Scanned;
use super::{without, Outcome, Weight};
use crate::declared::{self, fit_declared};
use crate::model::{Chosen, Fit, Fitted, Model};
use crate::ranking::Acceptance;
use crate::scan::{Instruments, Scan};
use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_columns::stats;
use residual_effects::{EffectKind, EffectRef};
use residual_fit::problem::Problem;
use residual_log::data::Data;
use residual_log::spec::Spec;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Rows of the windows on which the catalogue is screened, where the data have at least twice as
/// many. Lowered from 120 000 for speed.
const SCREEN_ROWS: usize = 60_000;

/// The problem, the declared model on it, and what the search has scanned so far.
pub struct Search<'a> {
    /// The rows that are fitted.
    pub problem: Problem,
    /// Windows of the data on which the catalogue is screened, where there are many rows.
    pub thin: Option<Problem>,
    /// The model file.
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression.
    pub load: String,
    /// Whether it is the load behind a command that an effect replaces.
    pub(super) load_is_behind: bool,
    /// The declared model, fitted.
    pub declared: Arc<Fitted>,
    /// Smallest RMS of a contribution that can be distinguished from the steps of the target.
    floor: f64,
    /// Most forms tried in one scan.
    pub(super) tests: usize,
    /// Scans of the catalogue that were made already, by the model they were made on.
    pub(super) scans: HashMap<String, Scanned>,
    /// The effect that `selection.max_effects` kept out of the last forward search.
    pub(super) limited: Option<EffectKind>,
    /// Other paths that predict as well as the one that was taken.
    pub equal_paths: Vec<Path>,
    /// How many more there are than these.
    pub more_equal_paths: usize,
    /// Effects whose names are not supported, and whether they are left out for now only.
    pub(super) barred: Vec<(EffectKind, bool)>,
    /// Instruments that were made last, by view.
    last_instruments: Mutex<Option<(String, Arc<Instruments>)>>,
}

/// Rows before and after one at a stop in which noise may have been cut off as well.
const CUT_OFF: usize = 10;

/// What the declared model predicts if it is fitted without the rows at which the target stops.
/// With them it would bend towards the limit. `None` if the target stops nowhere, or too little is
/// left.
fn unlimited(stops: &[Option<f64>], spec: &Spec, data: &Data) -> Option<String> {
    let at: Vec<f64> = stops.iter().copied().flatten().collect();
    if at.is_empty() {
        return None;
    }
    let mut free = declared::problem(&data.without_values(&at, CUT_OFF), &spec.selection);
    free.derive(&Scan::derived(spec));
    let fitted = fit_declared(&mut free, spec).ok()?;
    Some(declared::prediction_expression(&fitted))
}

/// Share of the target's RMS below which an error is rounding: a log of a simulation without noise
/// leaves 1e-16 of it behind the right model, and that has structure.
const ROUNDING: f64 = 1e-9;

impl<'a> Search<'a> {
    /// Fits the declared model and prepares the search.
    pub fn new(
        spec: &'a Spec,
        data: &Data,
        progress: &mut dyn Progress,
    ) -> Result<Search<'a>, Error> {
        let mut problem = declared::problem(data, &spec.selection);
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
        let load = declared::load_expression(&declared);
        problem.direction = Scan::new(&problem, spec, &load, &declared).better_direction();
        let steps = stats::quantum(&problem.y).map_or(0.0, |q| q / 12f64.sqrt() / 4.0);
        Ok(Search {
            load,
            load_is_behind: false,
            thin: problem.thin(SCREEN_ROWS).map(|mut thin| {
                thin.derive(&Scan::derived(spec));
                thin
            }),
            declared: Arc::new(declared),
            floor: (spec.roles.target.noise_floor)
                .max(steps)
                .max(ROUNDING * stats::rms(&problem.y)),
            problem,
            spec,
            tests: 1,
            scans: HashMap::new(),
            limited: None,
            equal_paths: vec![],
            more_equal_paths: 0,
            barred: vec![],
            last_instruments: Mutex::default(),
        })
    }

    /// Leaves an effect out of the catalogue: from now on, or only until another one is left out
    /// for good.
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

    /// Leaves kinds of effects out of the catalogue until they are offered again.
    pub(super) fn leave_out(&mut self, kinds: &[EffectKind]) {
        self.barred.extend(kinds.iter().map(|k| (*k, true)));
        self.scans.clear();
    }

    /// Offers kinds of effects again that were left out.
    pub(super) fn offer_again(&mut self, kinds: &[EffectKind]) {
        self.barred.retain(|(k, _)| !kinds.contains(k));
        self.scans.clear();
    }

    pub(super) fn is_barred(&self, kind: EffectKind) -> bool {
        self.barred.iter().any(|(k, _)| *k == kind)
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
    pub(super) fn fit_on_windows(&self, on: &Fitted) -> Option<(&Problem, Fit)> {
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

    /// Whether this sum of squared errors is of rounding alone: the model is exact.
    pub fn is_rounding(&self, squares: f64) -> bool {
        let rms = (squares / self.problem.y.len().max(1) as f64).sqrt();
        rms <= ROUNDING * stats::rms(&self.problem.y)
    }

    /// Whether the search may look for an effect: the model file lets it, and its name was not
    /// refused.
    pub fn allowed(&self, e: EffectRef) -> bool {
        !self.is_barred(e.kind()) && self.is_offered(e)
    }

    /// Whether the model file lets the search look for an effect.
    pub(super) fn is_offered(&self, e: EffectRef) -> bool {
        let s = &self.spec.selection;
        (s.only.is_empty() || s.only.iter().any(|n| n == e.name()))
            && !s.except.iter().any(|n| n == e.name())
    }

    /// Instruments of the columns as a model sees them.
    pub fn instruments(&self, scan: &Scan) -> Arc<Instruments> {
        let key = scan.fit.view.key();
        let mut last = self
            .last_instruments
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some((known, instruments)) if known == key => instruments.clone(),
            _ => {
                let new = Arc::new(Instruments::new(scan));
                *last = Some((key.to_string(), new.clone()));
                new
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

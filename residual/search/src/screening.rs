//! Scans of the catalogue. Where rows are many, forms are screened on windows first.

use super::scanned::{Scanned, ShortList};
use super::Search;
use crate::model::{Fit, Fitted};
use crate::ranking::{rank, Step};
use crate::scan::{catalogue_offers, Candidate, Offer, Origin, Scan};
use rayon::prelude::*;
use residual_columns::error::Error;
use residual_effects::Context;

/// Forms that pass the screening on windows.
const SCREENED: usize = 14;

impl Search<'_> {
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
    pub(super) fn step(&mut self, on: &Fitted) -> Result<Step, Error> {
        let key = self.scanned(on)?;
        Ok(rank(&self.candidates(&key), &self.acceptance()))
    }

    /// The forms of the catalogue of one of the scans that were made, each with what it achieves.
    pub(super) fn candidates(&self, key: &str) -> Vec<Candidate> {
        let all = self.scans.get(key).map(|scanned| &scanned.candidates);
        let free = |c: &&Candidate| !self.is_barred(c.origin.kind());
        all.into_iter().flatten().filter(free).cloned().collect()
    }

    /// Scans the catalogue on top of a model, unless that was done before. Returns the key of the
    /// scan.
    pub(super) fn scanned(&mut self, on: &Fitted) -> Result<String, Error> {
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

    /// Scans on all rows what is still waiting for it on top of a model. Whether there was
    /// anything.
    pub(super) fn scan_waiting(&mut self, on: &Fitted) -> bool {
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

    /// Tests material candidates again that the first decoys could not clear. In a closed loop
    /// those that the setpoint does not confirm are refused.
    pub fn retest<O: Origin>(&self, all: &mut [Candidate<O>], on: &Fitted) {
        let acceptance = self.acceptance();
        let rows = self.problem.y.len();
        // Windows show it as well as all rows; with fewer rows decoys gain more, so they do not
        // clear too much.
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
}

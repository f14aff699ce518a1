//! The course of a search: rounds until nothing changes.

use super::load::replaces_command;
use super::outcome::same_forms;
use super::{Outcome, Search, Standing};
use crate::model::Chosen;
use residual_columns::error::Error;
use residual_columns::progress::Progress;

/// Times that the load is expressed anew. The second time corrects it for effects that the first
/// one changed.
const LOADS: usize = 2;

/// The same where rows are many: before the rivals, and at the end if the effects are others by
/// then.
const LOADS_OF_MANY: usize = 1;

/// Forward searches after an effect was taken away, each with refined parameters.
const FORWARDS: usize = 2;

/// Rounds of forward search and rivals; in the last nothing is replaced.
const ROUNDS: usize = 4;

/// How far a search has come.
#[derive(Default)]
struct Course {
    /// The effects chosen so far.
    chosen: Vec<Chosen>,
    /// Rounds that came to the rivals.
    rounds: usize,
    /// Times that the load was expressed anew after the rivals.
    loads: usize,
    /// The effects with which the load was expressed before the rivals.
    early: Option<Vec<Chosen>>,
}

impl Course {
    /// Whether an effect may still lose its place: in the last round none does.
    fn may_replace(&self) -> bool {
        self.rounds < ROUNDS
    }
}

/// How a round ended.
enum Round {
    /// Effects or load changed: another round follows.
    Changed,
    /// Nothing is left to change.
    Settled(Box<Outcome>),
}

impl Search<'_> {
    /// Forward, then every effect against its rivals; a change starts the forward search again.
    pub fn run(&mut self, progress: &mut dyn Progress) -> Result<Outcome, Error> {
        let mut course = Course::default();
        loop {
            if let Round::Settled(outcome) = self.round(&mut course, progress)? {
                return Ok(*outcome);
            }
        }
    }

    fn round(&mut self, course: &mut Course, progress: &mut dyn Progress) -> Result<Round, Error> {
        if self.load_is_stale(&course.chosen) {
            self.load_before(&mut course.chosen)?;
        }
        self.forward(&mut course.chosen, progress)?;
        self.polish_last(&mut course.chosen)?;
        if self.renews_load_early(course)? {
            return Ok(Round::Changed);
        }
        course.rounds += 1;
        match self.contest(course, progress)? {
            None => Ok(Round::Changed),
            Some(standings) => self.conclude(course, standings, progress),
        }
    }

    /// Expresses the load anew before the rivals, once, where rows are many: rivals take long
    /// there, and are looked for with the load that stays. Whether it changed.
    fn renews_load_early(&mut self, course: &mut Course) -> Result<bool, Error> {
        if self.thin.is_none() || course.early.is_some() {
            return Ok(false);
        }
        let fitted = self.fit(&course.chosen)?;
        let (renewed, rmse) = (self.renewed(&fitted, &course.chosen)?, fitted.rmse());
        drop(fitted);
        if renewed.is_empty() {
            return Ok(false);
        }
        course.early = Some(course.chosen.clone());
        self.renew_load(renewed, rmse, &mut course.chosen)
    }

    /// Lets other effects and forms compete for each place. How each effect stands beside its
    /// rivals; `None` if one was replaced.
    fn contest(
        &mut self,
        course: &mut Course,
        progress: &mut dyn Progress,
    ) -> Result<Option<Vec<Standing>>, Error> {
        let may_replace = course.may_replace();
        let chosen = &mut course.chosen;
        if may_replace && self.merge(chosen, progress)? {
            self.polish(chosen)?;
        }
        let standings = self.rivals(chosen, may_replace, progress)?;
        let exchanged = standings.is_some() && may_replace && self.exchange(chosen, progress)?;
        Ok(standings.filter(|_| !exchanged))
    }

    /// Ends the search, unless another effect can be added or the load changes.
    fn conclude(
        &mut self,
        course: &mut Course,
        standings: Vec<Standing>,
        progress: &mut dyn Progress,
    ) -> Result<Round, Error> {
        // Polished parameters change the residual, so the catalogue is scanned once more before the
        // end.
        progress.stage("what is left");
        let fitted = self.fit(&course.chosen)?;
        let last = self.step(&fitted)?;
        let renewed = match course.loads < self.most_loads(course) {
            true => self.renewed(&fitted, &course.chosen)?,
            false => vec![],
        };
        // Where nothing that counts can be added, another round would end as this one did.
        if last.winner.is_some() && course.may_replace() {
            self.limited = None;
            if let Some(next) = self.next(&course.chosen)? {
                course.chosen = next;
                return Ok(Round::Changed);
            }
        }
        if self.renew_load(renewed, fitted.rmse(), &mut course.chosen)? {
            // After the first time the effects are those of another load.
            let first = course.loads == 0 && self.thin.is_none();
            course.rounds = if first { 0 } else { ROUNDS - 1 };
            course.loads += 1;
            return Ok(Round::Changed);
        }
        if self.load_is_stale(&course.chosen) {
            // The next round begins with the load that is left.
            return Ok(Round::Changed);
        }
        Ok(Round::Settled(Box::new(Outcome {
            limited: self.limited,
            chosen: std::mem::take(&mut course.chosen),
            standings,
            last,
            fitted,
        })))
    }

    /// How often the load may be expressed anew after the rivals.
    fn most_loads(&self, course: &Course) -> usize {
        match (&self.thin, &course.early) {
            (None, _) => LOADS,
            (_, Some(early)) if same_forms(early, &course.chosen) => 0,
            _ => LOADS_OF_MANY,
        }
    }

    /// The outcome with some effects, their nonlinear parameters refined again. Goes `on` to search
    /// for more.
    pub fn resume(&mut self, mut chosen: Vec<Chosen>, on: bool) -> Result<Outcome, Error> {
        // Where rows are many it is enough to refine them once, at the end.
        if self.thin.is_none() || !on {
            self.polish(&mut chosen)?;
        }
        self.load_before(&mut chosen)?;
        // Where rows are many, what was added beside parameters that were not refined may have made
        // up for them, or been hidden by them.
        for _ in 0..if on { FORWARDS } else { 0 } {
            self.forward(&mut chosen, &mut ())?;
            if !self.polish_last(&mut chosen)? && !self.renews_load_after(&mut chosen)? {
                break;
            }
        }
        // Beside the effect that is gone two may have made the command as late as one does.
        let several = chosen.iter().filter(|c| replaces_command(c)).count() > 1;
        if on && several && self.merge(&mut chosen, &mut ())? {
            self.forward(&mut chosen, &mut ())?;
            self.polish_last(&mut chosen)?;
        }
        let fitted = self.fit(&chosen)?;
        let last = self.step(&fitted)?;
        Ok(Outcome {
            standings: vec![],
            limited: self.limited,
            chosen,
            last,
            fitted,
        })
    }

    /// Expresses the load anew where rows are few: it may be that of an effect that is gone.
    /// Whether it changed.
    fn renews_load_after(&mut self, chosen: &mut Vec<Chosen>) -> Result<bool, Error> {
        if self.thin.is_some() {
            return Ok(false);
        }
        let fitted = self.fit(chosen)?;
        let (renewed, rmse) = (self.renewed(&fitted, chosen)?, fitted.rmse());
        drop(fitted);
        self.renew_load(renewed, rmse, chosen)
    }

    /// Rivals of the effects of an outcome, each beside the others of it.
    pub fn judge_again(&mut self, outcome: &mut Outcome) -> Result<(), Error> {
        let mut chosen = outcome.chosen.clone();
        outcome.standings = self
            .rivals(&mut chosen, false, &mut ())?
            .unwrap_or_default();
        Ok(())
    }
}

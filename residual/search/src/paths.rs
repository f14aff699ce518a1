//! More than one path: an effect that can take the shape of many others may be chosen first and
//! keep them out.
//!
//! Every step of a search changes one or two effects. Where several ripples of low order have taken
//! the place of friction and weight, no such step leads out of it. So the search is repeated
//! without these effects, which are offered again on top of what was found then. It also goes on
//! from the best subset of the textbook terms, by themselves and beside what is no textbook term
//! and takes no shape. The best of the paths is taken, and those that are as good are kept.

use super::outcome::same_forms;
use super::subset::is_physics;
use super::{declared, without, Outcome, Search};
use crate::model::{Chosen, Fitted};
use crate::scan::{t_statistic, Candidate};
use residual_columns::error::Error;
use residual_columns::progress::Progress;
use residual_effects::EffectKind;

/// Periods in the motion below which a ripple is a curve like any other.
pub const FEW_PERIODS: f64 = 8.0;

/// Standard errors of the difference of two errors, block by block, below which they are equal.
const EQUAL: f64 = 2.0;

/// Standard errors from which on one error is surely smaller than another, and the part of what
/// counts that is enough then: chosen on friction that falls with the speed and damping, which dry
/// friction and a drag imitate within 1.1 % of the error.
const SURELY: f64 = 4.0;
const PART: f64 = 0.25;

/// Effects that take the shape of others from which on they may have kept them out: one alone is
/// put to the test by its rivals.
const FEWEST_SHAPES: usize = 2;

/// Effects that contain textbook terms, or that textbook terms may stand for.
const LIKE_PHYSICS: [EffectKind; 2] = [EffectKind::Payload, EffectKind::Hysteresis];

/// Standard errors, and relative difference, up to which two paths are equal as far as names go.
/// The smaller of two paths is taken over a wider range; its names are only certain beyond this.
const SAME_ERRORS: f64 = 1.0;
const SAME: f64 = 0.003;

/// Most paths that are kept beside the best one: each costs a judgement of its names. How many more
/// there are is told.
const MOST_EQUAL: usize = 3;

/// What a course of the search found, with the load on which its effects are built.
pub struct Path {
    /// What it found.
    pub outcome: Outcome,
    load: String,
    load_is_behind: bool,
}

/// A state of the search to which it can go back.
pub struct Place {
    barred: Vec<(EffectKind, bool)>,
    load: String,
    load_is_behind: bool,
    limited: Option<EffectKind>,
}

/// The best path, and the others.
struct Paths {
    best: Path,
    others: Vec<Path>,
}

impl Paths {
    /// Whether one of them has these forms of effects.
    fn have(&self, chosen: &[Chosen]) -> bool {
        let all = self.others.iter().chain([&self.best]);
        all.map(|p| &p.outcome.chosen)
            .any(|own| same_forms(own, chosen))
    }
}

impl Search<'_> {
    /// Searches again without each kind of effect that can take the shape of others, and without
    /// all of them, where the first search chose some; then from the best subset of the textbook
    /// terms. Gives the best outcome: one of another path must predict better by what counts, or as
    /// well with fewer parameters. Those that predict as well are in [`Search::equal_paths`].
    /// Nothing is repeated where rows are many.
    pub fn other_paths(
        &mut self,
        first: Outcome,
        progress: &mut dyn Progress,
    ) -> Result<Outcome, Error> {
        if self.thin.is_some() {
            return Ok(first);
        }
        let kinds = self.shapes(&first.chosen)?;
        let mut left_out: Vec<Vec<EffectKind>> = kinds.iter().map(|k| vec![*k]).collect();
        if kinds.len() > 1 {
            left_out.push(kinds);
        }
        let start = declared::load_expression(&self.declared);
        let mut paths = Paths {
            best: self.path(first),
            others: vec![],
        };
        for kinds in left_out {
            let names: Vec<&str> = kinds.iter().map(|k| k.as_str()).collect();
            progress.stage(&format!("again without {}", names.join(", ")));
            (self.load, self.load_is_behind) = (start.clone(), false);
            let other = self.without_kinds(&kinds, progress)?;
            self.add_path(&mut paths, other);
        }
        self.try_physics(&mut paths, &start, progress)?;
        let Paths { best, others } = paths;
        let equal = |p: &Path| self.is_equal(&p.outcome, &best.outcome);
        let mut equals: Vec<Path> = vec![];
        for other in others.into_iter().filter(equal) {
            let forms = &other.outcome.chosen;
            let same = |p: &Path| same_forms(&p.outcome.chosen, forms);
            if !same(&best) && !equals.iter().any(same) {
                equals.push(other);
            }
        }
        let rmse = |p: &Path| p.outcome.fitted.rmse();
        equals.sort_by(|a, b| rmse(a).total_cmp(&rmse(b)));
        self.more_equal_paths = equals.len().saturating_sub(MOST_EQUAL);
        equals.truncate(MOST_EQUAL);
        self.equal_paths = equals;
        Ok(self.take(best))
    }

    /// Goes over to a path.
    pub fn take(&mut self, path: Path) -> Outcome {
        self.set_load(&path.load, path.load_is_behind);
        self.limited = path.outcome.limited;
        path.outcome
    }

    /// Offers all effects again that were left out, and tells the way back.
    pub fn leave(&mut self) -> Place {
        self.scans.clear();
        Place {
            barred: std::mem::take(&mut self.barred),
            load: self.load.clone(),
            load_is_behind: self.load_is_behind,
            limited: self.limited,
        }
    }

    /// Goes back to a place that was left.
    pub fn go_back(&mut self, place: Place) {
        self.barred = place.barred;
        self.scans.clear();
        self.set_load(&place.load, place.load_is_behind);
        self.limited = place.limited;
    }

    /// Goes on from the textbook terms that predict best beside the effects of the best path that
    /// are no such terms and take no shape, and from those that do by themselves.
    fn try_physics(
        &mut self,
        paths: &mut Paths,
        start: &str,
        progress: &mut dyn Progress,
    ) -> Result<(), Error> {
        let beside = self.without_physics_and_shapes(&paths.best.outcome.chosen)?;
        if !beside.is_empty() {
            self.set_load(&paths.best.load, paths.best.load_is_behind);
            self.try_physics_beside(&beside, paths, progress)?;
        }
        // By themselves, what is built on the load is built on the declared one.
        self.set_load(start, false);
        self.try_physics_beside(&[], paths, progress)
    }

    /// Builds effects on another load from now on.
    fn set_load(&mut self, load: &str, is_behind: bool) {
        if self.load != load {
            self.load = load.to_string();
            self.scans.clear();
        }
        self.load_is_behind = is_behind;
    }

    /// Goes on from the textbook terms that predict best beside other effects.
    fn try_physics_beside(
        &mut self,
        beside: &[Chosen],
        paths: &mut Paths,
        progress: &mut dyn Progress,
    ) -> Result<(), Error> {
        let mut chosen = beside.to_vec();
        chosen.extend(self.physics_beside(beside)?);
        self.prune(&mut chosen)?;
        let best = &paths.best.outcome;
        // Without what is no textbook term they may only imitate it.
        let imitates = || -> Result<bool, Error> {
            Ok(beside.is_empty() && !self.is_not_worse(&self.fit(&chosen)?, best))
        };
        if paths.have(&chosen) || imitates()? {
            return Ok(());
        }
        self.keep_accepted(&mut chosen)?;
        if paths.have(&chosen) {
            return Ok(());
        }
        progress.stage("from the best subset of the textbook terms");
        let mut other = self.resume(chosen, true)?;
        self.judge_again(&mut other)?;
        self.add_path(paths, other);
        Ok(())
    }

    /// Takes away what would not be accepted on top of the others, the weakest first: the best of
    /// many sets fits chance, too.
    fn keep_accepted(&mut self, chosen: &mut Vec<Chosen>) -> Result<(), Error> {
        loop {
            let mut weakest: Option<(usize, f64)> = None;
            for i in 0..chosen.len() {
                let (own, rest) = without(chosen, i);
                let fitted = self.fit(&rest)?;
                let key = self.scanned(&fitted)?;
                let acceptance = self.acceptance();
                let same = |c: &&Candidate| own.is_form(&c.choose());
                let all = self.candidates(&key);
                let is_accepted = all.iter().find(same).is_some_and(|c| acceptance.accepts(c));
                let rmse = fitted.rmse();
                if !is_accepted && weakest.is_none_or(|(_, least)| rmse < least) {
                    weakest = Some((i, rmse));
                }
            }
            match weakest {
                Some((i, _)) => chosen.remove(i),
                None => return Ok(()),
            };
        }
    }

    /// Puts an outcome beside the others, or before them.
    fn add_path(&self, paths: &mut Paths, outcome: Outcome) {
        let mut new = self.path(outcome);
        if self.is_better(&new.outcome, &paths.best.outcome) {
            std::mem::swap(&mut new, &mut paths.best);
        }
        paths.others.push(new);
    }

    /// An outcome of this search, with the load on which it is built.
    pub fn path(&self, outcome: Outcome) -> Path {
        Path {
            outcome,
            load: self.load.clone(),
            load_is_behind: self.load_is_behind,
        }
    }

    /// A search without some kinds of effects, which are then offered on top of it.
    fn without_kinds(
        &mut self,
        kinds: &[EffectKind],
        progress: &mut dyn Progress,
    ) -> Result<Outcome, Error> {
        self.leave_out(kinds);
        let outcome = self.run(progress);
        self.offer_again(kinds);
        let outcome = outcome?;
        let (before, rmse) = (outcome.chosen.len(), outcome.fitted.rmse());
        let mut whole = self.resume(outcome.chosen.clone(), true)?;
        if whole.chosen.len() <= before || whole.fitted.rmse() >= rmse {
            return Ok(outcome);
        }
        self.judge_again(&mut whole)?;
        Ok(whole)
    }

    /// By how many standard errors a model predicts worse than another, block by block.
    pub(super) fn worse(&self, new: &Fitted, old: &Fitted) -> f64 {
        let losses = |f: &Fitted| -> Vec<f64> {
            let of = |rows: &std::ops::Range<usize>| {
                f.fit.held[rows.clone()].iter().map(|r| r * r).sum()
            };
            self.problem.blocks.iter().map(|b| of(&b.range)).collect()
        };
        t_statistic(&losses(new), &losses(old))
    }

    /// Whether an outcome predicts better than another by what counts, or as well with fewer
    /// parameters.
    fn is_better(&self, other: &Outcome, best: &Outcome) -> bool {
        let worse = self.worse(&other.fitted, &best.fitted);
        let of = |o: &Outcome| {
            let parameters = o.chosen.iter().map(Chosen::parameters).sum();
            (o.fitted.rmse(), parameters)
        };
        let known = |c: &Chosen| {
            let kind = c.effect.kind();
            is_physics(kind) || best.chosen.iter().any(|b| b.effect.kind() == kind)
        };
        let textbook = other.chosen.iter().all(known);
        let material = self.spec.selection.material;
        takes_over(of(other), of(best), worse, material, textbook)
    }

    /// Whether two outcomes predict as well as each other.
    pub fn is_equal(&self, a: &Outcome, b: &Outcome) -> bool {
        let apart = (a.fitted.rmse() / b.fitted.rmse() - 1.0).abs();
        let unsure = || self.worse(&a.fitted, &b.fitted).abs() < SAME_ERRORS;
        apart < SAME || (apart < self.spec.selection.material && unsure())
    }

    /// Whether a model predicts as well as an outcome, or better.
    fn is_not_worse(&self, new: &Fitted, best: &Outcome) -> bool {
        let most = best.fitted.rmse() * (1.0 + self.spec.selection.material);
        new.rmse() < most && self.worse(new, &best.fitted) < EQUAL
    }

    /// The effects that are no textbook terms and do not take the shape of any.
    fn without_physics_and_shapes(&self, chosen: &[Chosen]) -> Result<Vec<Chosen>, Error> {
        let declared = self.scan_on(&self.declared);
        let turns = declared.context().turns();
        let keeps = |c: &&Chosen| {
            let kind = c.effect.kind();
            !is_physics(kind) && !LIKE_PHYSICS.contains(&kind) && !takes_a_shape(c, turns)
        };
        Ok(chosen.iter().filter(keeps).cloned().collect())
    }

    /// The kinds among chosen effects that can take the shape of others: ripples of few periods in
    /// the motion, friction that depends on the angle, curves over the pose.
    fn shapes(&self, chosen: &[Chosen]) -> Result<Vec<EffectKind>, Error> {
        let declared = self.scan_on(&self.declared);
        let turns = declared.context().turns();
        let shapes = chosen.iter().filter(|c| takes_a_shape(c, turns));
        let shapes: Vec<&Chosen> = shapes.collect();
        if shapes.len() < FEWEST_SHAPES {
            return Ok(vec![]);
        }
        let mut kinds: Vec<EffectKind> = Vec::new();
        for c in shapes {
            if !kinds.contains(&c.effect.kind()) {
                kinds.push(c.effect.kind());
            }
        }
        Ok(kinds)
    }
}

/// Whether an effect can take the shape of others: a ripple of few periods in a motion of so many
/// turns, friction that depends on the angle, a curve over the pose.
fn takes_a_shape(c: &Chosen, turns: Option<f64>) -> bool {
    match c.effect.kind() {
        EffectKind::PeriodicAngle => turns.is_some_and(|turns| c.psi * turns < FEW_PERIODS),
        EffectKind::AngleFriction | EffectKind::Geometry => true,
        _ => false,
    }
}

/// Whether a path takes over from another, by their errors and numbers of parameters: it is better
/// by what counts (`material`), or smaller and no `worse`, neither in standard errors nor by what
/// counts. Where few rows carry most of the error, standard errors are as large as any difference.
/// A path of `textbook` terms, which take no shape of others, needs to be better by a part of what
/// counts, if it is so in all blocks.
fn takes_over(
    new: (f64, usize),
    old: (f64, usize),
    worse: f64,
    material: f64,
    textbook: bool,
) -> bool {
    let is_worse = worse >= EQUAL || new.0 > old.0 * (1.0 + material);
    let by_part = textbook && worse <= -SURELY && new.0 < old.0 * (1.0 - PART * material);
    new.0 < old.0 * (1.0 - material) || by_part || (new.1 < old.1 && !is_worse)
}

#[cfg(test)]
mod tests {
    use super::takes_over;

    #[test]
    fn a_path_must_be_better_or_as_good_and_smaller() {
        for (new, old, worse, textbook, expected) in [
            ((0.415, 12), (0.418, 10), -4.5, true, true),
            ((0.415, 12), (0.418, 10), -3.5, true, false),
            ((0.417, 12), (0.418, 10), -9.0, true, false),
            ((0.415, 12), (0.418, 10), -9.0, false, false),
            ((0.356, 9), (0.540, 13), -9.0, false, true),
            ((0.356, 13), (0.540, 9), -9.0, false, true),
            ((0.418_3, 7), (0.418_0, 10), 0.8, false, true),
            ((0.43, 7), (0.418, 10), 3.0, false, false),
            ((0.418_3, 10), (0.418_0, 10), 0.8, false, false),
            ((0.415, 12), (0.418, 10), -1.0, true, false),
            ((0.439, 7), (0.395, 8), 1.5, false, false),
        ] {
            assert_eq!(
                takes_over(new, old, worse, 0.02, textbook),
                expected,
                "{new:?} {old:?}"
            );
        }
    }
}

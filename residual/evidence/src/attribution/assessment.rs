//! Effects with what decides on their names.

use super::contradiction::{contradictions, inertia_of_a_lag, slope_of_another_width};
use super::free_curve::names_of_another_law;
use super::images::{images_by_stamps, images_of_a_tone};
use super::one_sequence::in_one_sequence;
use super::over_the_angle::shapes_of_the_angle;
use super::reasons::reasons;
use super::refusal::{at_end, contrary, impossible, Against, Refusal};
use crate::check::Checked;
use crate::intervals::{parameters, Parameters};
use crate::leftover::{Forms, Leftover};
use residual_columns::error::Error;
use residual_effects::Nature;
use residual_search::{Outcome, Search, Weight};

/// Effects with what decides on their names.
pub(super) struct Assessment {
    pub(super) outcome: Outcome,
    /// Nameless forms on top of the model; `None` where an effect is refused for its own
    /// parameters, whatever is left.
    forms: Option<Forms>,
    pub(super) weights: Vec<Weight>,
    /// `None` where they were not needed.
    pub(super) parameters: Vec<Option<Parameters>>,
    /// Why each name is not supported; `None` where it is.
    pub(super) why: Vec<Option<Refusal>>,
}

impl Assessment {
    /// Judges effects.
    ///
    /// One that its own parameters refuse is taken away before any other is looked at: intervals
    /// and nameless forms take long where rows are many, and change without it.
    pub(super) fn new(
        search: &mut Search,
        outcome: Outcome,
        check: Option<&Checked>,
    ) -> Result<Assessment, Error> {
        let weights = search.weights(&outcome)?;
        let mut now = Assessment {
            parameters: vec![None; outcome.chosen.len()],
            why: vec![None; outcome.chosen.len()],
            outcome,
            forms: None,
            weights,
        };
        if !now.refused_by_itself(search)? {
            let forms = Forms::new(search, &now.outcome.fitted)?;
            let (outcome, weights) = (&now.outcome, &now.weights);
            now.why = reasons(search, outcome, weights, &now.parameters, &forms, check)?;
            if now.why.iter().all(Option::is_none) {
                names_of_another_law(&mut now.why, search, outcome)?;
            }
            now.forms = Some(forms);
        }
        Ok(now)
    }

    /// Looks for what is left.
    pub(super) fn left(&mut self, search: &mut Search) -> Result<Leftover, Error> {
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
                None => match contrary(search, &ctx, &self.outcome.chosen, index)? {
                    Some(why) => Some(why),
                    None => in_one_sequence(search, &self.outcome, index)?,
                },
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
        shapes_of_the_angle(&mut self.why, &self.outcome.chosen, &ctx);
        let known: Vec<&Parameters> = self.parameters.iter().flatten().collect();
        if ctx.problem.values_per_s.is_some() {
            images_of_a_tone(&mut self.why, &self.outcome.chosen, &self.weights);
        } else {
            images_by_stamps(&mut self.why, search, &self.outcome.chosen, &self.weights)?;
        }
        contradictions(&mut self.why, &self.weights, &known);
        let all = || known.iter().flat_map(|(params, _)| params);
        let has = |nature: Nature| all().any(|p| p.nature == nature);
        if has(Nature::Inertia) && has(Nature::Damping) {
            if let Some(late) = ctx.velocity_is_late() {
                inertia_of_a_lag(&mut self.why, &known, late);
            }
        }
        let chosen = &self.outcome.chosen;
        slope_of_another_width(&mut self.why, search, chosen, &self.weights, &known)?;
        Ok(self.why.iter().any(Option::is_some))
    }

    /// Indices of the effects to take away next, see [`next_gone`]; none if all names are
    /// supported.
    pub(super) fn next_refused(&self, search: &Search) -> Result<Vec<usize>, Error> {
        let series: Vec<usize> = (0..self.why.len())
            .filter(|i| matches!(&self.why[*i], Some(w) if w.against == Against::AsASeries))
            .collect();
        if !series.is_empty() {
            return Ok(series);
        }
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

/// Which of the refused effects are taken away next. They come with their orders, the most valuable
/// first.
///
/// Usually it is one: the last of those with the greatest order. Where many may go `together`, all
/// that are only too weak beside others go at once, but for two kinds. The most valuable stays, as
/// it may be right. So does each that is strong without those that go: of two that share what they
/// explain, one may be right. `strong(others, index)` tells whether an effect is strong where the
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

#[cfg(test)]
mod tests {
    use super::*;

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
}

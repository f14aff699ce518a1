//! What shows the direction of the motion, which dry friction follows.
//!
//! A deadband above the noise of a velocity hides slow motion as well: where a motion begins and
//! ends, friction has a direction that the velocity does not show. It would be taken for a friction
//! that acts at rest, or for a lag. The slope of the angle over a few rows may show it.

use super::friction::velocity_of;
use super::{t_statistic, Scan};
use crate::ranking::STEADY;
use residual_effects::{Piece, Variant};
use residual_fit::problem::{Direction, Problem};
use residual_log::spec::Spec;

/// The direction of the motion: of the velocity outside of its deadband, or what shows it better.
pub(super) fn direction_of(problem: &Problem, spec: &Spec) -> Option<Direction> {
    let of_velocity = |of: String| Direction {
        of,
        band: spec.roles.velocity.as_ref().map_or(0.0, |v| v.deadband),
    };
    let better = problem.direction.clone();
    better.or_else(|| velocity_of(spec).map(of_velocity))
}

/// Expressions whose signs are directions of the motion: the velocity, and what shows it better.
pub(super) fn shown_by(problem: &Problem, spec: &Spec) -> Vec<String> {
    let better = problem.direction.iter().map(|d| d.of.clone());
    velocity_of(spec).into_iter().chain(better).collect()
}

impl Scan<'_> {
    /// The slope of the angle that shows the direction of dry friction best, where friction with it
    /// predicts steadily better than with the velocity outside of its deadband.
    pub fn better_direction(&self) -> Option<Direction> {
        let ctx = self.context();
        let (plain, velocity) = (ctx.direction.as_ref()?, ctx.velocity.as_ref()?);
        let at = vec![0.0; self.problem.folds];
        let losses = |direction: &Direction| {
            // Without a damping beside it, friction would be too large where motion is slow.
            let friction = [direction.sign(), velocity.clone()];
            let pieces = friction.map(|text| Piece::new("", "", text));
            self.losses(&Variant::linear("", pieces.to_vec()), &at)
        };
        let total = |losses: &[f64]| losses.iter().sum::<f64>();
        let slopes = ctx.slopes_of_angle().into_iter();
        let tried = slopes.map(|slope| (losses(&slope), slope));
        let (after, best) = tried.min_by(|a, b| total(&a.0).total_cmp(&total(&b.0)))?;
        (t_statistic(&losses(plain), &after) > STEADY).then_some(best)
    }
}

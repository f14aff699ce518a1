//! What the effects know about the data and the current model.

use super::friction::{dry_friction, velocity_of};
use super::Scan;
use crate::effects::Context;
use crate::spec::Spec;

/// Expression of the position: the angle, or the integral of the velocity.
fn position_of(spec: &Spec) -> Option<String> {
    if spec.roles.angle.is_some() {
        return Some("angle".to_string());
    }
    velocity_of(spec).map(|_| "integ(velocity)".to_string())
}

impl<'a> Scan<'a> {
    /// Expressions of velocity and position, which most forms contain.
    pub fn derived(spec: &Spec) -> Vec<String> {
        velocity_of(spec)
            .into_iter()
            .chain(position_of(spec))
            .collect()
    }

    /// The context of the current residual.
    pub fn context(&self) -> Context<'a> {
        let Scan {
            problem,
            spec,
            model,
            fit,
            ..
        } = *self;
        let roles = &spec.roles;
        let frame = &problem.frame;
        let velocity = velocity_of(spec);
        let position = position_of(spec);
        let deadband = roles.velocity.as_ref().map_or(0.0, |v| v.deadband);
        let span = frame
            .sequences()
            .iter()
            .map(|r| frame.time()[r.end - 1] - frame.time()[r.start])
            .fold(0.0, f64::max);
        let varies = |n: &String| {
            frame
                .column(n)
                .is_some_and(|c| c.iter().any(|x| *x != c[0]))
        };
        let mut columns: Vec<String> = model
            .terms
            .iter()
            .flat_map(|t| t.expr.names())
            .filter(|n| n != "time" && n != "elapsed" && varies(n))
            .collect();
        columns.sort();
        columns.dedup();
        let friction = velocity
            .as_ref()
            .is_some_and(|v| model.terms.iter().any(|t| dry_friction(&t.expr, v)));
        Context {
            problem,
            spec,
            load: self.load.to_string(),
            residual: &fit.residual,
            columns,
            friction,
            velocity,
            deadband,
            position,
            dt: frame.step(),
            span,
        }
    }
}

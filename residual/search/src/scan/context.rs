//! What the effects know about the data and the current model.

use super::direction::{direction_of, shown_by};
use super::friction::{dry_friction, velocity_of};
use super::Scan;
use crate::model::WorkTerm;
use residual_columns::stats;
use residual_effects::Context;
use residual_log::spec::Spec;

/// Standard errors from 0 from which on a coefficient is a size that others can be measured by.
const CLEAR: f64 = 3.0;

/// Most declared terms, and most characters, of a prediction that is written out in a form.
const MOST_FORCES: usize = 12;
const MOST_TEXT: usize = 1000;

/// Size of what a prediction has beside the load, over the size of the load in it, from which on it
/// makes a difference.
const BESIDE: f64 = 0.02;

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

    /// Whether the only term of the command is the command itself with a fitted coefficient that
    /// scatters too much over the folds.
    fn load_is_vague(&self) -> bool {
        let terms = &self.model.terms;
        let mut of_command = (0..terms.len()).filter(|i| {
            let t = &terms[*i];
            t.chosen.is_none() && !t.local && t.expr.names().contains("command")
        });
        let (Some(own), None) = (of_command.next(), of_command.next()) else {
            return false;
        };
        let Some(at) = self.fit.free.iter().position(|i| *i == own) else {
            return false;
        };
        if terms[own].expr.to_string() != "command" {
            return false;
        }
        let (problem, folds) = (self.problem, self.problem.folds);
        let without = |fold: usize| {
            let used = problem.blocks.iter();
            let weights: Vec<f64> = used.map(|b| f64::from(u8::from(b.fold != fold))).collect();
            self.fit.theta[at] + self.fit.sums.fit(Some(&weights)).0[at]
        };
        let all: Vec<f64> = (0..folds).map(without).collect();
        // Standard error by the jackknife.
        let error = stats::deviation(&all) * (folds as f64 - 1.0).max(1.0) / (folds as f64).sqrt();
        folds > 1 && self.fit.theta[at].abs() < CLEAR * error
    }

    /// What the declared terms predict beside the effects, with their coefficients as numbers,
    /// where that is more than a multiple of the load.
    fn all_force(&self) -> Option<String> {
        let declared = self.model.terms.iter().enumerate();
        let declared: Vec<_> = declared.filter(|(_, t)| t.chosen.is_none()).collect();
        if !(2..=MOST_FORCES).contains(&declared.len()) || declared.iter().any(|(_, t)| t.local) {
            return None;
        }
        let product = |(i, t): (usize, &WorkTerm)| {
            let fitted = self.fit.free.iter().position(|free| *free == i);
            let k = t.fixed.or_else(|| Some(self.fit.theta[fitted?]))?;
            Some(format!("{k} * ({})", t.expr))
        };
        let texts: Vec<String> = declared.into_iter().filter_map(product).collect();
        let text = format!("({})", texts.join(" + "));
        if text.len() > MOST_TEXT {
            return None;
        }
        let values = |text: &str| self.problem.eval_text(&self.problem.plain, text, true).ok();
        let (force, load) = (values(&text)?, values(self.load)?);
        let (mean_force, mean_load) = (stats::mean(&force), stats::mean(&load));
        let (mut ff, mut fl, mut ll) = (0.0, 0.0, 0.0);
        for (f, l) in force.iter().zip(load.iter()) {
            let (f, l) = (f - mean_force, l - mean_load);
            ff += f * f;
            fl += f * l;
            ll += l * l;
        }
        // Squares of what the load does not explain, over those that it does.
        let rest = ff * ll - fl * fl;
        (ll > 0.0 && rest > BESIDE * BESIDE * fl * fl).then_some(text)
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
        let shown = shown_by(problem, spec);
        let friction = model.terms.iter().any(|t| dry_friction(t, &shown));
        Context {
            problem,
            spec,
            load: self.load.to_string(),
            all_force: self.all_force(),
            load_is_vague: self.load_is_vague(),
            residual: &fit.residual,
            columns,
            friction,
            velocity,
            deadband,
            direction: direction_of(problem, spec),
            position,
            dt: frame.step(),
            span,
        }
    }
}

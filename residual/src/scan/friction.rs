//! Dry friction in a model: which terms are, and whether a form makes it larger as its name says.

use super::{Applied, Scan};
use crate::effects::Build;
use crate::expr::Expr;
use crate::linalg::dot;
use crate::spec::Spec;

/// The velocity as the model file gives it: the role, or the slope of the angle.
pub(super) fn velocity_of(spec: &Spec) -> Option<String> {
    let roles = &spec.roles;
    if roles.velocity.is_some() {
        Some("velocity".to_string())
    } else {
        roles.angle.as_ref().map(|_| "deriv(angle, 2)".to_string())
    }
}

/// Whether a term has the direction of a motion with velocity `v`, and so is dry friction.
pub(super) fn dry_friction(term: &Expr, v: &str) -> bool {
    let text = term.to_string();
    ["sgn", "sign", "held", "tanh"]
        .iter()
        .any(|f| text.contains(&format!("{f}({v}")))
}

impl Scan<'_> {
    /// Whether dry friction is larger with piece `own` than without, where that piece acts.
    pub(super) fn adds_to_friction(&self, build: &Build, own: usize) -> bool {
        let (Build::Add(pieces), Some(v)) = (build, velocity_of(self.spec)) else {
            return true;
        };
        let Ok(Applied { sums, .. }) = self.sums(build, false) else {
            return false;
        };
        let (x, _) = sums.fit(None);
        let (refit, new) = x.split_at(self.fit.x.len());
        let value = |e: &Expr| self.problem.eval(&self.fit.view, e).ok();
        // Declared and found terms with what the fit adds to their coefficients, then the form's own.
        let mut refit = self.fit.theta.iter().zip(refit).map(|(t, x)| t + x);
        let mut friction = vec![0.0; self.problem.y.len()];
        let mut add = |e: &Expr, k: f64| {
            for (f, v) in friction
                .iter_mut()
                .zip(value(e).iter().flat_map(|v| v.iter()))
            {
                *f += k * v;
            }
        };
        for t in self.model.terms.iter().filter(|t| !t.local) {
            let k = t.fixed.or_else(|| refit.next()).unwrap_or(0.0);
            if dry_friction(&t.expr, &v) {
                add(&t.expr, k);
            }
        }
        let parsed: Vec<Expr> = pieces
            .iter()
            .filter_map(|p| Expr::parse(&p.text).ok())
            .collect();
        for (i, (e, k)) in parsed.iter().zip(new).enumerate() {
            if i != own && dry_friction(e, &v) {
                add(e, *k);
            }
        }
        let Some(extra) = parsed.get(own).and_then(value) else {
            return false;
        };
        // Squares with it and without: friction that is all in this piece has no sign to go against.
        let k = new[own];
        2.0 * k * dot(&friction, &extra) + k * k * dot(&extra, &extra) >= 0.0
    }
}

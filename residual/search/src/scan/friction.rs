//! Which fitted values a form cannot have, and dry friction in a model: which terms are, and
//! whether a form makes it larger as its name says.

use super::direction::shown_by;
use super::{Applied, Scan};
use crate::model::WorkTerm;
use residual_columns::expr::Expr;
use residual_columns::linalg::dot;
use residual_effects::{Build, Variant};
use residual_log::spec::Spec;

/// The velocity as the model file gives it: the role, or the slope of the angle.
pub(super) fn velocity_of(spec: &Spec) -> Option<String> {
    let roles = &spec.roles;
    if roles.velocity.is_some() {
        Some("velocity".to_string())
    } else {
        roles.angle.as_ref().map(|_| "deriv(angle, 2)".to_string())
    }
}

/// Whether an expression has the direction of a motion, which one of `shown` shows.
fn has_direction(expr: &Expr, shown: &[String]) -> bool {
    let text = expr.to_string();
    let any = |v: &String| {
        let mut functions = ["sgn", "sign", "held", "tanh"].iter();
        functions.any(|f| text.contains(&format!("{f}({v}")))
    };
    shown.iter().any(any)
}

/// Whether the expression of an effect is dry friction: it has the direction of the motion, and not
/// as a part of all force.
fn is_friction(expr: &Expr, shown: &[String]) -> bool {
    let mut sum = false;
    expr.visit(&mut |e| {
        sum |= matches!(e, Expr::Binary("+" | "-", ..))
            && e.names().contains("command")
            && has_direction(e, shown);
    });
    has_direction(expr, shown) && !sum
}

/// Whether a term of the model is dry friction. A declared one may have the command beside it.
pub(super) fn dry_friction(term: &WorkTerm, shown: &[String]) -> bool {
    match term.chosen {
        None => has_direction(&term.expr, shown),
        Some(_) => is_friction(&term.expr, shown),
    }
}

/// Part of a loop by which other friction may act against it, as one fit to both is uncertain.
const AGAINST: f64 = 0.25;

impl Scan<'_> {
    /// Whether an effect can have the coefficients that a form has at `psi`.
    pub fn possible(&self, variant: &Variant, psi: f64) -> bool {
        if !variant.has_conditions() {
            return true;
        }
        let build = (variant.build)(psi);
        let Ok(Applied { sums, local, .. }) = self.sums(&build, false) else {
            return false;
        };
        if local {
            return true;
        }
        let (x, _) = sums.fit(None);
        let own = x.get(self.fit.x.len()..).unwrap_or(&[]);
        variant.possible.as_ref().is_none_or(|holds| {
            let with_coefficients = matches!(build, Build::Add(_) | Build::Local(_));
            holds(psi, if with_coefficients { own } else { &[] })
        }) && variant.adds_to_friction.is_none_or(|piece| {
            // Squares with it and without: friction that is all in this piece has no sign to go
            // against.
            let Some((k, other, own)) = self.beside_friction(&build, &x, piece) else {
                return true;
            };
            2.0 * k * other + k * k * own >= 0.0
        }) && variant.along_friction.is_none_or(|piece| {
            let Some((k, other, own)) = self.beside_friction(&build, &x, piece) else {
                return true;
            };
            k * other >= -AGAINST * k * k * own
        })
    }

    /// Coefficient of piece `own` in a fit `x`, and the products of the piece with the dry friction
    /// without it, and with itself. `None` where there is nothing to compare.
    fn beside_friction(&self, build: &Build, x: &[f64], own: usize) -> Option<(f64, f64, f64)> {
        let Build::Add(pieces) = build else {
            return None;
        };
        let shown = shown_by(self.problem, self.spec);
        if shown.is_empty() {
            return None;
        }
        let (refit, new) = x.split_at(self.fit.x.len());
        let value = |e: &Expr| self.problem.eval(&self.fit.view, e).ok();
        // Declared and found terms with what the fit adds to their coefficients, then the form's
        // own.
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
            if dry_friction(t, &shown) {
                add(&t.expr, k);
            }
        }
        let parsed: Vec<Expr> = pieces
            .iter()
            .filter_map(|p| Expr::parse(&p.text).ok())
            .collect();
        for (i, (e, k)) in parsed.iter().zip(new).enumerate() {
            if i != own && is_friction(e, &shown) {
                add(e, *k);
            }
        }
        let extra = parsed.get(own).and_then(value)?;
        Some((new[own], dot(&friction, &extra), dot(&extra, &extra)))
    }
}

#[cfg(test)]
mod tests {
    use super::is_friction;
    use residual_columns::expr::Expr;

    #[test]
    fn a_force_with_friction_in_it_is_no_friction() {
        let shown = ["velocity".to_string()];
        let of = |text: &str| is_friction(&Expr::parse(text).unwrap(), &shown);
        assert!(of("sgn(velocity, 0.01)"));
        assert!(of("sgn(velocity, 0.01) * abs(1.02 * command + 0.1)"));
        assert!(!of("velocity"));
        assert!(!of(
            "max(0, (1 * (command) + -0.3 * (tanh(velocity / 0.2))) - 4.8)"
        ));
        assert!(!of(
            "(temperature - 25) * (1 * (command) + -0.3 * (sign(velocity)))"
        ));
    }
}

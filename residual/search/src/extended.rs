//! The extended model: the model file with the chosen effects as terms.

use crate::model::{Chosen, Fitted};
use residual_log::spec::{Spec, Term};

/// The model file with the effects as terms: running it again reproduces the final fit. A term that
/// repeats others on these data carries nothing and is left out.
pub fn extended(spec: &Spec, fitted: &Fitted, chosen: &[Chosen]) -> Spec {
    let Fitted { model, fit } = fitted;
    let mut out = spec.clone();
    out.terms = Vec::new();
    for (i, t) in model.terms.iter().enumerate() {
        let place = fit.free.iter().position(|f| *f == i);
        if place.is_some_and(|k| fit.dropped[k]) {
            continue;
        }
        let effect = match t.chosen {
            Some(c) => chosen[c].effect.name().to_string(),
            None => spec.terms[i].effect.clone(),
        };
        out.terms.push(Term {
            name: match t.chosen {
                Some(_) => format!("{effect}: {}", t.name),
                None => t.name.clone(),
            },
            expr: model.written_out(&t.expr).to_string(),
            unit: t.unit.clone(),
            fixed: t.fixed,
            per: if t.local {
                "sequence".into()
            } else {
                String::new()
            },
            effect,
            fitted: place.map(|k| fit.theta[k]),
        });
    }
    out
}

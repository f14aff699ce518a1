//! A wrong scale of the declared model.

use super::{Context, Effect, EffectKind, Estimate, Found, Piece, Remedy, Variant};

pub(crate) struct Gain;

impl Effect for Gain {
    fn kind(&self) -> EffectKind {
        EffectKind::Gain
    }
    fn meaning(&self) -> &'static str {
        "gain: the declared prediction is too small or too large by a constant factor"
    }
    fn experiment(&self) -> &'static str {
        "hold several known loads at rest: the error grows in proportion to the load"
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Gain((found.get)("gain_error"))]
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "the target would not follow the prediction at all";
        e.outside("gain_error", -1.0, f64::INFINITY, why)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        // A prediction whose coefficients are all fitted has no gain error.
        if ctx.range(&ctx.load).is_none() || !ctx.scale_is_declared() {
            return vec![];
        }
        vec![Variant::linear(
            "of the declared prediction",
            vec![Piece::new("gain_error", "1", ctx.load.clone())],
        )]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::knowing;

    /// What is fitted cannot have a wrong scale.
    #[test]
    fn only_a_declared_scale_has_a_gain() {
        let rows = 200;
        let command: Vec<f64> = (0..rows).map(|i| (0.1 * i as f64).sin()).collect();
        let target = command.iter().map(|c| 2.0 * c + 0.5).collect::<Vec<_>>();
        let forms = |terms: &str| {
            let spec = format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
                 command = {{ column = \"c\", unit = \"N\" }}\n{terms}"
            );
            let columns = [("target", target.clone()), ("command", command.clone())];
            let mut count = 0;
            knowing(&spec, &columns, rows, |ctx| {
                count = Gain.variants(ctx).len()
            });
            count
        };
        let term = |expr: &str, fixed: &str| {
            format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\n{fixed}\n")
        };
        let fixed = term("command", "fixed = 1.9");
        assert_eq!(forms(&fixed), 1);
        assert_eq!(forms(&(fixed + &term("1", ""))), 1);
        let fitted = term("command", "");
        assert_eq!(forms(&fitted), 0);
        assert_eq!(forms(&(fitted + &term("1", "fixed = 0.4"))), 0);
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("gain", |s| 0.1 * s.command);
    }
}

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
    #[test]
    fn is_named() {
        crate::effects::testbench::names("gain", |s| 0.1 * s.command);
    }
}

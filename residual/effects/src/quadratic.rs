//! Curvature of the characteristic.

use super::{Context, Effect, EffectKind, Piece, Variant};

pub struct Quadratic;

impl Effect for Quadratic {
    fn kind(&self) -> EffectKind {
        EffectKind::Quadratic
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some((lo, hi)) = ctx.range(&ctx.load) else {
            return vec![];
        };
        let unit = ctx.per(&format!("{}^2", ctx.unit()));
        let l = &ctx.load;
        let square = |(of, force): (&str, String)| {
            let piece = Piece::new("curvature", unit.clone(), format!("{force}^2"));
            Variant::linear(&format!("square of {of}"), vec![piece])
        };
        let mut out: Vec<Variant> = ctx.sensed().into_iter().map(square).collect();
        if lo < 0.0 && hi > 0.0 {
            out.push(Variant::linear(
                "signed square of load",
                vec![Piece::new("curvature", unit, format!("{l} * abs({l})"))],
            ));
        }
        out
    }
}

//! A sensor that sees only the component along its own axis.

use super::{Context, Effect, EffectKind, Estimate, Piece, Variant};

pub struct CosineMisalignment;

/// Shares of the load that a component along the axis can lose.
const COSINE: (f64, f64) = (-0.05, 1.1);

/// Shares of the load that a component across the axis can have.
const SINE: (f64, f64) = (-1.1, 1.1);

impl Effect for CosineMisalignment {
    fn kind(&self) -> EffectKind {
        EffectKind::CosineMisalignment
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        let why = "a component lies between nothing and all of the load";
        e.outside("cosine_share", COSINE.0, COSINE.1, why)
            .or_else(|| e.outside("sine_share", SINE.0, SINE.1, why))
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let angles = ctx.angles().into_iter();
        let own = angles.filter(|(n, ..)| form.label.starts_with(&format!("{n},")));
        own.map(|(_, q, _)| q).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let l = &ctx.load;
        let mut out = Vec::new();
        for (name, q, range) in ctx.angles() {
            if range > 6.0 {
                continue;
            }
            let straight = Piece::new("cosine_share", "1", format!("{l} * (cos({q}) - 1)"));
            let aligned = format!("{name}, aligned at zero");
            let one = Variant::linear(&aligned, vec![straight.clone()]);
            out.push(one.between(&[COSINE]));
            let tilted = Piece::new("sine_share", "1", format!("{l} * sin({q})"));
            let both = Variant::linear(&format!("{name}, tilted"), vec![straight, tilted]);
            out.push(both.between(&[COSINE, SINE]));
        }
        out
    }
}

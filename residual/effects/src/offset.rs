//! A constant that the model lacks.

use super::{Context, Effect, EffectKind, Found, Piece, Remedy, Variant};

pub struct Offset;

impl Effect for Offset {
    fn kind(&self) -> EffectKind {
        EffectKind::Offset
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Offset((found.get)("offset"))]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        vec![Variant::linear(
            "constant",
            vec![Piece::new("offset", ctx.unit(), "1")],
        )]
    }
}

//! Dry friction of constant size.

use super::{
    Context, Effect, EffectKind, Found, Friction, Nature, Piece, Remedy, Setting, Variant,
};

pub struct Coulomb;

impl Effect for Coulomb {
    fn kind(&self) -> EffectKind {
        EffectKind::Coulomb
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.velocity.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn friction(&self) -> Option<Friction> {
        Some(Friction::Constant)
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::DryFriction)
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Friction((found.get)("friction"))]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let friction = |sign| Piece::new("friction", ctx.unit(), sign).being(Nature::Friction);
        let form = |sign| Variant::linear("sign of velocity", vec![friction(sign)]);
        let sign = ctx.direction.as_ref().map(|d| d.sign());
        sign.map(form).into_iter().collect()
    }
}

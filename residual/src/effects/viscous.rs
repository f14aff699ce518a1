//! Friction in proportion to velocity.

use super::{Context, Effect, EffectKind, Found, Piece, Remedy, Variant};

pub(crate) struct Viscous;

impl Effect for Viscous {
    fn kind(&self) -> EffectKind {
        EffectKind::Viscous
    }
    fn meaning(&self) -> &'static str {
        "viscous friction: a force in proportion to the velocity"
    }
    fn experiment(&self) -> &'static str {
        "move at several constant speeds under constant load: the force follows the speed in a straight line"
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.velocity.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Viscous((found.get)("damping"))]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(v) = &ctx.velocity else {
            return vec![];
        };
        vec![Variant::linear(
            "velocity",
            vec![Piece::new(
                "damping",
                ctx.per(&ctx.velocity_unit()),
                v.clone(),
            )],
        )]
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("viscous", |s| -0.3 * s.velocity);
    }
}

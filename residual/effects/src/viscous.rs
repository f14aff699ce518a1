//! Friction in proportion to velocity.

use super::{ratio, Context, Effect, EffectKind, Found, Nature, Piece, Remedy, Variant};

pub struct Viscous;

impl Effect for Viscous {
    fn kind(&self) -> EffectKind {
        EffectKind::Viscous
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
        let unit = ctx.per(&ctx.velocity_unit());
        let damping = Piece::new("damping", unit.clone(), v.clone()).being(Nature::Damping);
        let mut out = vec![Variant::linear("velocity", vec![damping.clone()])];
        // Fluids and air: the force grows with the square of the velocity.
        let square = ratio(&unit, &ctx.velocity_unit());
        out.push(Variant::linear(
            "square of the velocity",
            vec![Piece::new("drag", square, format!("{v} * abs({v})")).being(Nature::Drag)],
        ));
        if ctx.range(&ctx.load).is_some() {
            let text = format!("{v} * {}", ctx.load);
            let per_load = ratio("1", &ctx.velocity_unit());
            let share = Piece::new("damping_per_load", per_load, text);
            out.push(Variant::linear(
                "velocity, growing with load",
                vec![damping.clone(), share],
            ));
        }
        if let Some((lo, hi)) = ctx.range("temperature") {
            let text = format!("{v} * (temperature - {})", 0.5 * (lo + hi));
            let kelvin = ctx.spec.roles.unit("temperature");
            let share = Piece::new("damping_per_degree", ratio(&unit, &kelvin), text);
            out.push(Variant::linear(
                "velocity, changing with temperature",
                vec![damping, share],
            ));
        }
        out
    }
}

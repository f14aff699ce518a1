//! Friction in proportion to velocity.

use super::{ratio, Context, Effect, EffectKind, Found, Piece, Remedy, Variant};

pub struct Viscous;

impl Effect for Viscous {
    fn kind(&self) -> EffectKind {
        EffectKind::Viscous
    }
    fn meaning(&self) -> &'static str {
        "viscous friction: a force in proportion to the velocity, or as the drag of a fluid to its square"
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
        let unit = ctx.per(&ctx.velocity_unit());
        let damping = Piece::new("damping", unit.clone(), v.clone());
        let mut out = vec![Variant::linear("velocity", vec![damping.clone()])];
        // Fluids and air: the force grows with the square of the velocity.
        let square = ratio(&unit, &ctx.velocity_unit());
        out.push(Variant::linear(
            "square of the velocity",
            vec![Piece::new("drag", square, format!("{v} * abs({v})"))],
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

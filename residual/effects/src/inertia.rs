//! Force that accelerates the moving mass.

use super::{coefficients_alone, Build, Context, Effect, EffectKind, Nature, Piece, Psi, Variant};

pub struct Inertia;

impl Effect for Inertia {
    fn kind(&self) -> EffectKind {
        EffectKind::Inertia
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.velocity
            .as_ref()
            .map_or_else(|| ctx.load.clone(), |v| format!("deriv({v}, 2)"))
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(v) = ctx.velocity.clone() else {
            return vec![];
        };
        let unit = ctx.per(&format!("{}/s", ctx.velocity_unit()));
        // Data decide on the width of the slope.
        let slopes = ctx.slopes(&v);
        let psi = Psi::new("slope_half_width", "rows", slopes.widths()).given();
        vec![Variant::profiled("acceleration", psi, move |n| {
            Build::Add(vec![
                Piece::new("inertia", unit.clone(), slopes.text(n)).being(Nature::Inertia)
            ])
        })
        .with(coefficients_alone)]
    }
}

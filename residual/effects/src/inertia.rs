//! Force that accelerates the moving mass.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub struct Inertia;

impl Effect for Inertia {
    fn kind(&self) -> EffectKind {
        EffectKind::Inertia
    }
    fn meaning(&self) -> &'static str {
        "inertia: a force in proportion to the acceleration"
    }
    fn experiment(&self) -> &'static str {
        "move sinusoidally at constant amplitude and several frequencies: the force grows with the square of the frequency"
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
        let psi = Psi {
            name: "slope_half_width",
            unit: "rows".into(),
            grid: slopes.widths(),
            refine: false,
            resolution: None,
        };
        vec![Variant::profiled("acceleration", psi, move |n| {
            Build::Add(vec![Piece::new("inertia", unit.clone(), slopes.text(n))])
        })
        .with(|_, coef, pieces, _| {
            pieces
                .iter()
                .zip(coef)
                .map(|(p, c)| super::Param {
                    name: p.name.clone(),
                    value: *c,
                    unit: p.unit.clone(),
                })
                .collect()
        })]
    }
}

//! Force that accelerates the moving mass.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Inertia;

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
        // The width of the slope is a compromise between noise and lost detail; data decide.
        let psi = Psi {
            name: "slope_half_width",
            unit: "rows".into(),
            grid: [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0]
                .into_iter()
                .filter(|half| *half == 1.0 || ctx.slope_follows(&v, *half))
                .collect(),
            refine: false,
            resolution: None,
        };
        vec![Variant::profiled("acceleration", psi, move |n| {
            Build::Add(vec![Piece::new(
                "inertia",
                unit.clone(),
                format!("deriv({v}, {n})"),
            )])
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

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("inertia", |s| 0.2 * s.acceleration);
    }
}

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
        // Data decide on the width of the slope.
        let psi = Psi {
            name: "slope_half_width",
            unit: "rows".into(),
            grid: ctx.slopes(&v),
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
    use super::*;
    use crate::effects::testbench::knowing;

    /// A slope over a third of a period is no acceleration any more.
    #[test]
    fn slopes_are_short_beside_the_motion() {
        let (rows, dt) = (1000, 0.02);
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    velocity = { column = \"v\", unit = \"rad/s\" }\n\
                    [[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let widths = |hz: f64| {
            let w = std::f64::consts::TAU * hz;
            let velocity: Vec<f64> = (0..rows).map(|i| (w * dt * i as f64).sin()).collect();
            let columns = [("target", velocity.clone()), ("velocity", velocity)];
            let mut grid = vec![];
            knowing(spec, &columns, rows, |ctx| {
                grid = Inertia.variants(ctx)[0].psi.as_ref().unwrap().grid.clone();
            });
            grid
        };
        assert_eq!(widths(0.68), [1.0, 2.0, 3.0, 5.0, 8.0]);
        assert_eq!(widths(0.1), [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0]);
        assert_eq!(widths(8.0), [1.0]);
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("inertia", |s| 0.2 * s.acceleration);
    }
}

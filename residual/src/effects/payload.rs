//! A mass that the model does not know: its weight and its inertia belong together.

use super::{Build, Context, Effect, EffectKind, Estimate, Param, Piece, Psi, Variant};

pub(crate) struct Payload;

/// Standard gravity, m/s² (CGPM 1901).
const G: f64 = 9.80665;

impl Effect for Payload {
    fn kind(&self) -> EffectKind {
        EffectKind::Payload
    }
    fn meaning(&self) -> &'static str {
        "payload: an unknown mass, seen by its weight and its inertia together"
    }
    fn experiment(&self) -> &'static str {
        "move up and down with and without strong acceleration: weight stays, inertia does not"
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        e.outside("mass", 0.0, f64::INFINITY, "a mass is not negative")
    }
    fn axes(&self, form: &Variant, psi: f64, ctx: &Context) -> Vec<String> {
        let angles = ctx.angles().into_iter();
        let own = angles.filter(|(n, ..)| form.label == format!("mass on {n}"));
        let slope = ctx.velocity.iter().map(|v| format!("deriv({v}, {psi})"));
        own.map(|(_, q, _)| q).chain(slope).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(v) = ctx.velocity.clone() else {
            return vec![];
        };
        let widths = || Psi {
            name: "slope_half_width",
            unit: "rows".into(),
            grid: vec![1.0, 2.0, 3.0, 5.0, 8.0, 12.0],
            refine: false,
            resolution: None,
        };
        let metre = match ctx.velocity_unit().as_str() {
            "m/s" => Some(1.0),
            "mm/s" => Some(1e-3),
            _ => None,
        };
        let mut out = Vec::new();
        if let Some(k) = metre {
            // Without real acceleration this is an offset and nothing else.
            let swing = ctx
                .range(&format!("deriv({v}, 3) * {k}"))
                .map_or(0.0, |(lo, hi)| hi - lo);
            if swing > 0.3 {
                let v = v.clone();
                out.push(
                    Variant::profiled("hanging mass", widths(), move |n| {
                        Build::Add(vec![Piece::new(
                            "mass",
                            "kg",
                            format!("{G} + {k} * deriv({v}, {n})"),
                        )])
                    })
                    .with(coefficients),
                );
            }
        }
        let unit = ctx.unit().to_string();
        for (name, q, range) in ctx.angles() {
            if name != "angle" && ctx.spec.roles.angle.is_some() {
                continue;
            }
            // Over several turns a weight on the shaft is a ripple of order one.
            if name == "angle" && range > 1.5 * std::f64::consts::TAU {
                continue;
            }
            let (v, unit, per) = (
                v.clone(),
                unit.clone(),
                ctx.per(&format!("{}/s", ctx.velocity_unit())),
            );
            out.push(
                Variant::profiled(&format!("mass on {name}"), widths(), move |n| {
                    Build::Add(vec![
                        Piece::new("weight_sine", unit.clone(), format!("sin({q})")),
                        Piece::new("weight_cosine", unit.clone(), format!("cos({q})")),
                        Piece::new("inertia", per.clone(), format!("deriv({v}, {n})")),
                    ])
                })
                .with(coefficients),
            );
        }
        out
    }
}

fn coefficients(_: f64, coef: &[f64], pieces: &[Piece], _: &Psi) -> Vec<Param> {
    pieces
        .iter()
        .zip(coef)
        .map(|(p, c)| Param {
            name: p.name.clone(),
            value: *c,
            unit: p.unit.clone(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::effects::testbench::{names_with, Excitation};

    #[test]
    fn is_named() {
        names_with(
            "payload",
            Excitation {
                metres: true,
                ..Excitation::default()
            },
            |s| 0.06 * (9.80665 + s.acceleration),
        );
    }
}

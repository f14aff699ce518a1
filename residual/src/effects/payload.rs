//! A mass that the model does not know: its weight and its inertia belong together.

use super::gravity_angle::too_short;
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
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        e.outside("mass", 0.0, f64::INFINITY, "a mass is not negative")
            .or_else(|| {
                let own = |(name, ..): &(String, String, f64)| e.label == mass_on(name);
                too_short(&ctx.angles().into_iter().find(own)?)
            })
    }
    fn axes(&self, form: &Variant, psi: f64, ctx: &Context) -> Vec<String> {
        let angles = ctx.angles().into_iter();
        let own = angles.filter(|(n, ..)| form.label == mass_on(n));
        let slope = ctx.velocity.iter().map(|v| format!("deriv({v}, {psi})"));
        own.map(|(_, q, _)| q).chain(slope).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(v) = ctx.velocity.clone() else {
            return vec![];
        };
        let slopes = ctx.slopes(&v);
        let widths = || Psi {
            name: "slope_half_width",
            unit: "rows".into(),
            grid: slopes.widths(),
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
                let slopes = slopes.clone();
                // A mass in kg is a force over an acceleration; of a current or a voltage it is a factor and no mass.
                let force = ctx.unit().trim() == "N";
                let (name, unit) = if force {
                    ("mass", "kg".into())
                } else {
                    ("inertia", ctx.per("m/s/s"))
                };
                let form = Variant::profiled("hanging mass", widths(), move |n| {
                    let text = format!("{G} + {k} * {}", slopes.text(n));
                    Build::Add(vec![Piece::new(name, unit.clone(), text)])
                })
                .with(coefficients);
                out.push(if force {
                    form.between(&[(0.0, f64::INFINITY)])
                } else {
                    form
                });
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
            let (slopes, unit, per) = (
                slopes.clone(),
                unit.clone(),
                ctx.per(&format!("{}/s", ctx.velocity_unit())),
            );
            out.push(
                Variant::profiled(&mass_on(&name), widths(), move |n| {
                    Build::Add(vec![
                        Piece::new("weight_sine", unit.clone(), format!("sin({q})")),
                        Piece::new("weight_cosine", unit.clone(), format!("cos({q})")),
                        Piece::new("inertia", per.clone(), slopes.text(n)),
                    ])
                })
                .with(coefficients),
            );
        }
        out
    }
}

/// The form of a mass that turns with an angle.
fn mass_on(name: &str) -> String {
    format!("mass on {name}")
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
    use super::*;
    use crate::effects::testbench::{knowing, names_with, Excitation};
    use crate::effects::Form;

    /// A motion of `size` about zero, with the target in `unit`.
    fn moved(unit: &str, velocity: &str, size: f64, look: impl FnOnce(&Context)) {
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..1200).map(|i| f(0.02 * i as f64)).collect()
        };
        let columns = [
            ("target", of(&|t| (0.7 * t).sin())),
            ("command", of(&|t| (0.7 * t).cos())),
            ("angle", of(&|t| size * (3.0 * t).sin())),
            ("velocity", of(&|t| size * 3.0 * (3.0 * t).cos())),
        ];
        let spec = format!(
            "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"{unit}\" }}\n\
             command = {{ column = \"c\", unit = \"{unit}\" }}\nvelocity = {{ column = \"v\", unit = \"{velocity}\" }}\n\
             angle = {{ column = \"a\", unit = \"rad\" }}\n[[terms]]\nname = \"a\"\nexpr = \"command\"\n"
        );
        knowing(&spec, &columns, 600, look);
    }

    #[test]
    fn a_mass_in_kg_needs_a_force() {
        let first = |unit: &str| {
            let mut out = None;
            moved(unit, "m/s", 1.0, |ctx| {
                let forms = Payload.variants(ctx);
                let own = forms.iter().find(|f| f.label == "hanging mass").unwrap();
                out = own.params(2.0, &[1.0]).pop();
            });
            let own = out.unwrap();
            (own.name, own.unit)
        };
        assert_eq!(first("N"), ("mass".into(), "kg".into()));
        assert_eq!(first("A"), ("inertia".into(), "A/(m/s/s)".into()));
    }

    #[test]
    fn a_mass_on_a_short_arc_is_like_any_parabola() {
        let impossible = |size: f64| {
            let mut out = None;
            moved("N", "rad/s", size, |ctx| {
                let estimate = Estimate {
                    form: Form::Other,
                    label: "mass on angle",
                    params: &[],
                    intervals: &Default::default(),
                };
                out = Payload.impossible(&estimate, ctx);
            });
            out.is_some()
        };
        assert!(impossible(0.33) && !impossible(1.0));
    }

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

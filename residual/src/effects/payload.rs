//! A mass that the model does not know: its weight and its inertia belong together.

use super::gravity_angle::{joints, sum, too_short, turns_little, Angle};
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
            .or_else(|| turning(ctx, e.label).iter().find_map(too_short))
    }
    fn axes(&self, form: &Variant, psi: f64, ctx: &Context) -> Vec<String> {
        let own = turning(ctx, &form.label).into_iter();
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
        for own in ctx.angles() {
            if own.0 != "angle" && ctx.spec.roles.angle.is_some() {
                continue;
            }
            // Over several turns a weight on the shaft is a ripple of order one.
            if own.0 == "angle" && !turns_little(&own) {
                continue;
            }
            let (name, q, _) = own;
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
        out.extend(ends_of_arms(ctx).into_iter().map(|arm| {
            let (slopes, unit) = (slopes.clone(), unit.clone());
            let own_per = ctx.per(&format!("{}/s", ctx.velocity_unit()));
            let other_per = ctx.per("rad/s/s");
            let label = mass_on_both(&arm.angle.0, &arm.sum.0);
            let (q, sum, other) = (arm.angle.1, arm.sum.1, arm.other.1);
            Variant::profiled(&label, widths(), move |n| {
                let weight = |name: &str, f: &str, q: &str| {
                    Piece::new(name, unit.clone(), format!("{f}({q})"))
                };
                let acceleration = format!("deriv(deriv({other}, {n}), {n})");
                Build::Add(vec![
                    weight("weight_sine", "sin", &q),
                    weight("weight_cosine", "cos", &q),
                    weight("outer_weight_sine", "sin", &sum),
                    weight("outer_weight_cosine", "cos", &sum),
                    Piece::new("inertia", own_per.clone(), slopes.text(n)),
                    Piece::new("coupling_inertia", other_per.clone(), acceleration),
                ])
            })
            .with(coefficients)
        }));
        out
    }
}

/// Most other joints with which arms of two links are tried. The forms have many terms.
const MOST_OTHERS: usize = 3;

/// An arm of two links with a mass at its end.
struct Arm {
    /// Angle of the joint whose torque is the target.
    angle: Angle,
    /// Angle of the other joint.
    other: Angle,
    /// Angle of the outer link: their sum or difference.
    sum: Angle,
}

/// Arms of two links, where the angle is a joint's and the other joints are few.
fn ends_of_arms(ctx: &Context) -> Vec<Arm> {
    let (Some(angle), others) = joints(ctx) else {
        return vec![];
    };
    if others.len() > MOST_OTHERS {
        return vec![];
    }
    let of = |(other, sign): (&Angle, &str)| {
        Some(Arm {
            sum: sum(ctx, &[&angle, other], sign)?,
            angle: angle.clone(),
            other: other.clone(),
        })
    };
    let pairs = others.iter().flat_map(|o| [(o, "+"), (o, "-")]);
    pairs.filter_map(of).collect()
}

/// The angles with which the weight of a form turns.
fn turning(ctx: &Context, label: &str) -> Vec<Angle> {
    let arms = ends_of_arms(ctx).into_iter();
    let both = arms.filter(|arm| label == mass_on_both(&arm.angle.0, &arm.sum.0));
    let single = ctx.angles().into_iter();
    let own = single.filter(|(name, ..)| label == mass_on(name));
    own.chain(both.flat_map(|arm| [arm.angle, arm.sum]))
        .collect()
}

/// The form of a mass at the end of an arm whose links turn with an angle and a sum.
fn mass_on_both(angle: &str, sum: &str) -> String {
    format!("mass on {angle} and {sum}")
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

    /// A mass at the end of an arm of two links, beside a model whose coefficients are those of the arm without it. Each part of it
    /// looks like a larger gain.
    #[test]
    fn is_named_at_the_end_of_an_arm() {
        let report = carried(0.3);
        let first = report.effects.first().expect("an effect");
        let own = (first.name.as_str(), first.form.as_str());
        let expected = ("payload", "mass on angle and angle + q2");
        assert_eq!(own, expected, "{}", report.markdown());
        assert_eq!(report.effects.len(), 1, "{}", report.markdown());
        let near = |name: &str, value: f64| {
            let found = first.params[name];
            assert!((found - value).abs() < 0.1 * value, "{name} {found}");
        };
        near("weight_sine", 0.3 * G * 0.4);
        near("outer_weight_sine", 0.3 * G * 0.3);
    }

    /// An arm with links of 0.4 and 0.3 m that carries this mass in kg.
    fn carried(mass: f64) -> crate::Report {
        use crate::{analyse, spec::Spec, stats::Rng, Data};
        let (runs, rows, dt) = (4, 2000, 0.01);
        let mut rng = Rng::new(9);
        // A sum of sines with its first two derivatives.
        let motion = |parts: [(f64, f64, f64); 2], t: f64| {
            parts.iter().fold([0.0; 3], |[x, v, a], (size, w, phase)| {
                let (s, c) = (w * t + phase).sin_cos();
                [x + size * s, v + size * w * c, a - size * w * w * s]
            })
        };
        let mut columns: Vec<(&str, Vec<f64>)> = ["target", "angle", "velocity", "q2", "a1", "a12"]
            .map(|n| (n, vec![]))
            .into();
        for i in 0..runs * rows {
            let (run, t) = ((i / rows) as f64, (i % rows) as f64 * dt);
            let [q1, v1, a1] = motion([(0.8, 0.5, run), (0.4, 1.3, 2.0 * run)], t);
            let [q2, _, a2] = motion([(0.7, 0.8, 2.0 * run), (0.3, 1.9, run + 1.6)], t);
            let (w1, w12, a12) = (q1.sin(), (q1 + q2).sin(), a1 + a2);
            let arm = 4.0 * w1 + 1.5 * w12 + 0.6 * a1 + 0.2 * a12;
            let load = G * (0.4 * w1 + 0.3 * w12) + 0.16 * a1 + 0.09 * a12;
            let target = arm + mass * load + 0.05 * rng.normal();
            let row = [target, q1, v1, q2, a1, a12];
            columns
                .iter_mut()
                .zip(row)
                .for_each(|((_, c), x)| c.push(x));
        }
        let data = Data::from_columns(
            (0..runs * rows).map(|i| (i % rows) as f64 * dt).collect(),
            columns,
        )
        .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
        .build()
        .unwrap();
        let term = |expr: &str, fixed: f64| {
            format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\nfixed = {fixed}\n")
        };
        let model = format!(
            "roles.time = {{ column = \"t\", unit = \"s\" }}\n\
             roles.target = {{ column = \"y\", unit = \"N·m\" }}\n\
             roles.velocity = {{ column = \"v\", unit = \"rad/s\", deadband = 0.01 }}\n\
             roles.angle = {{ column = \"a\", unit = \"rad\" }}\n\
             roles.pose.q2 = {{ column = \"q2\", unit = \"rad\" }}\n{}{}{}{}",
            term("sin(angle)", 4.0),
            term("sin(angle + q2)", 1.5),
            term("a1", 0.6),
            term("a12", 0.2),
        );
        analyse(&Spec::parse(&model).unwrap(), data, &mut ()).unwrap()
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

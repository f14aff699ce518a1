//! A mass that the model does not know: its weight and its inertia belong together.

use super::gravity_angle::{any_order, joints, sum, too_short, turns_little, Angle};
use super::{
    coefficients_alone, Build, Context, Effect, EffectKind, Estimate, Nature, Piece, Psi, Variant,
};

pub struct Payload;

/// Standard gravity, m/s² (CGPM 1901).
const G: f64 = 9.80665;

impl Effect for Payload {
    fn kind(&self) -> EffectKind {
        EffectKind::Payload
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        e.outside("mass", 0.0, f64::INFINITY, "a mass is not negative")
            .or_else(|| turning(ctx, e.label).iter().find_map(too_short))
    }
    fn of_any_order(&self, form: &Variant, psi: f64, ctx: &Context) -> Option<Variant> {
        let mut single = ctx.angles().into_iter();
        let (_, q, _) = single.find(|(name, ..)| form.label == mass_on(name))?;
        let slope = ctx.slopes(ctx.velocity.as_ref()?).text(psi);
        let (unit, per) = (ctx.unit().to_string(), acceleration_unit(ctx));
        let build = move |order: f64| {
            let weight = |name: &str, f: &str| {
                Piece::new(name, unit.clone(), format!("{f}({order} * ({q}))"))
            };
            Build::Add(vec![
                weight("weight_sine", "sin"),
                weight("weight_cosine", "cos"),
                Piece::new("inertia", per.clone(), slope.clone()),
            ])
        };
        Some(Variant::profiled("of any order", any_order(), build))
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
        let widths = || Psi::new("slope_half_width", "rows", slopes.widths()).given();
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
                // A mass in kg is a force over an acceleration; of a current or a voltage it is a
                // factor and no mass.
                let force = ctx.unit().trim() == "N";
                let (name, unit, nature) = if force {
                    ("mass", "kg".into(), Nature::Other)
                } else {
                    ("inertia", ctx.per("m/s/s"), Nature::Inertia)
                };
                let form = Variant::profiled("hanging mass", widths(), move |n| {
                    let text = format!("{G} + {k} * {}", slopes.text(n));
                    Build::Add(vec![Piece::new(name, unit.clone(), text).being(nature)])
                })
                .with(coefficients_alone);
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
            let (slopes, unit, per) = (slopes.clone(), unit.clone(), acceleration_unit(ctx));
            out.push(
                Variant::profiled(&mass_on(&name), widths(), move |n| {
                    Build::Add(vec![
                        Piece::new("weight_sine", unit.clone(), format!("sin({q})"))
                            .being(Nature::Weight),
                        Piece::new("weight_cosine", unit.clone(), format!("cos({q})"))
                            .being(Nature::Weight),
                        Piece::new("inertia", per.clone(), slopes.text(n)).being(Nature::Inertia),
                    ])
                })
                .with(coefficients_alone),
            );
        }
        out.extend(ends_of_arms(ctx).into_iter().map(|arm| {
            let (slopes, unit) = (slopes.clone(), unit.clone());
            let own_per = acceleration_unit(ctx);
            let other_per = ctx.per("rad/s/s");
            let label = mass_on_both(&arm.angle.0, &arm.sum.0);
            let (q, sum, other) = (arm.angle.1, arm.sum.1, arm.other.1);
            Variant::profiled(&label, widths(), move |n| {
                let weight = |name: &str, f: &str, q: &str| {
                    Piece::new(name, unit.clone(), format!("{f}({q})"))
                };
                let acceleration = format!("deriv(deriv({other}, {n}), {n})");
                Build::Add(vec![
                    weight("weight_sine", "sin", &q).being(Nature::Weight),
                    weight("weight_cosine", "cos", &q).being(Nature::Weight),
                    weight("outer_weight_sine", "sin", &sum),
                    weight("outer_weight_cosine", "cos", &sum),
                    Piece::new("inertia", own_per.clone(), slopes.text(n)).being(Nature::Inertia),
                    Piece::new("coupling_inertia", other_per.clone(), acceleration),
                ])
            })
            .with(coefficients_alone)
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

/// The unit of a coefficient of the acceleration.
fn acceleration_unit(ctx: &Context) -> String {
    ctx.per(&format!("{}/s", ctx.velocity_unit()))
}

/// The form of a mass at the end of an arm whose links turn with an angle and a sum.
fn mass_on_both(angle: &str, sum: &str) -> String {
    format!("mass on {angle} and {sum}")
}

/// The form of a mass that turns with an angle.
fn mass_on(name: &str) -> String {
    format!("mass on {name}")
}

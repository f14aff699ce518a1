//! Weight of a part that turns with an angle.

use super::{
    amplitude_phase, Build, Context, Effect, EffectKind, Estimate, Lookalike, Nature, Piece, Psi,
    Variant,
};

use residual_columns::format::num;
use residual_columns::linalg::similarity;
use residual_columns::stats;

/// Shortest arc in radians over which sine and cosine are no parabola.
const SHORTEST_ARC: f64 = 1.2;

pub struct GravityAngle;

/// Label of the weight of a part near the point on which it stands: over a short arc it rises with
/// the angle as the force of a spring does, away from that point.
const UPRIGHT: &str = "angle, near an unstable point";

impl Effect for GravityAngle {
    fn kind(&self) -> EffectKind {
        EffectKind::GravityAngle
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let mut all = ctx.angles().into_iter().chain(sums(ctx));
        too_short(&all.find(|(n, ..)| n == e.label)?)
    }
    fn of_any_order(&self, form: &Variant, _: f64, ctx: &Context) -> Option<Variant> {
        let mut all = ctx.angles().into_iter().chain(sums(ctx));
        let (_, q, _) = all.find(|(name, ..)| *name == form.label)?;
        let unit = ctx.unit().to_string();
        let build = move |order: f64| {
            let piece = |name: &str, f: &str| {
                Piece::new(name, unit.clone(), format!("{f}({order} * ({q}))"))
            };
            Build::Add(vec![piece("sine", "sin"), piece("cosine", "cos")])
        };
        Some(Variant::profiled("of any order", any_order(), build))
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let all = ctx.angles().into_iter().chain(sums(ctx));
        let own = all.filter(|(n, ..)| *n == form.label);
        own.map(|(_, q, _)| q).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.unit();
        let short = ctx
            .angles()
            .into_iter()
            .find(|a| a.0 == "angle" && too_short(a).is_some());
        let upright = short.map(|(_, q, _)| {
            let per = ctx.per("rad");
            let slope = Piece::new("weight_per_angle", per, angle_along(ctx, &q));
            Variant::linear(UPRIGHT, vec![slope.being(Nature::Unstable)])
        });
        ctx.angles()
            .into_iter()
            .filter(|a| a.0 != "angle" || turns_little(a))
            .chain(sums(ctx))
            .map(|(n, q, _)| {
                let pieces = vec![
                    Piece::new("sine", unit, format!("sin({q})")),
                    Piece::new("cosine", unit, format!("cos({q})")),
                ];
                let mut v = Variant::linear(&n, pieces).with(amplitude_phase);
                v.psi = Some(Psi::new("order", "1/turn", vec![1.0]).given());
                v
            })
            .chain(upright)
            .collect()
    }
}

/// Lowest and highest order of a ripple that may look like a weight over a part of a turn.
const ORDERS: [f64; 2] = [0.3, 3.0];

/// The orders of ripples that may look like what turns with an angle as a weight does.
pub(super) fn any_order() -> Psi {
    Psi::new(
        "order",
        "1/turn",
        Context::log_grid(ORDERS[0], ORDERS[1], 25),
    )
}

/// Standard errors by which a weight must predict worse than a line or a curve over an angle to be
/// excluded: as for the laws of friction with which `load_dependent_coulomb` is compared.
const EXCLUDED_FROM: f64 = 2.0;

/// The weights that a line or a curve over an angle may be. Where the arc is too short to tell them
/// apart, the name of a weight is refused, and that of the line says no more.
pub(super) fn weights(ctx: &Context) -> Vec<Lookalike> {
    let mut all = Lookalike::of(&[EffectKind::GravityAngle], EXCLUDED_FROM, ctx);
    all.iter_mut().for_each(|own| own.though_refused = true);
    all
}

/// An angle along the velocity, as inertia and damping are.
pub(super) fn angle_along(ctx: &Context, angle: &str) -> String {
    let against = ctx.velocity.iter().any(|v| {
        let product = format!("{v} * deriv(angle, 2)");
        stats::mean(&ctx.values(&product)) < 0.0
    });
    if against {
        format!("-1 * {angle}")
    } else {
        angle.into()
    }
}

/// An angle: its name for reports, its expression in radians, its range in radians.
pub(super) type Angle = (String, String, f64);

/// Why an angle cannot show a weight that turns with it.
pub(super) fn too_short((name, _, range): &Angle) -> Option<String> {
    (*range < SHORTEST_ARC).then(|| {
        format!(
            "{name} moves by {} rad only: over so short an arc a weight is no different from any parabola",
            num(*range)
        )
    })
}

/// Turns from which on a weight on the shaft is a ripple of order one, and the angle is that of a
/// motor rather than of a joint.
const MOST_TURNS: f64 = 1.5;

/// Whether an angle moves as that of a joint does.
pub(super) fn turns_little((_, _, range): &Angle) -> bool {
    *range < MOST_TURNS * std::f64::consts::TAU
}

/// Most joints of which sums are tried.
const MOST_JOINTS: usize = 8;

/// Squared correlation with another angle above which a pose is the same column once more, in other
/// digits. Two joints that are driven alike are further apart, and the sum of their angles, which
/// is twice the angle then, is that of the outer link. With 0.998 such a sum was called a ripple.
const SAME_JOINT: f64 = 1.0 - 1e-7;

/// The angle of the joint whose torque is the target, and those of the other joints. The angle is
/// `None` where it is no joint's: where it is a length, or turns many times.
pub(super) fn joints(ctx: &Context) -> (Option<Angle>, Vec<Angle>) {
    let (own, mut others): (Vec<_>, Vec<_>) =
        ctx.angles().into_iter().partition(|(n, ..)| n == "angle");
    let own = own.into_iter().find(turns_little);
    let centred = |n: &str| {
        let mut values = ctx.values(n);
        let mean = stats::mean(&values);
        values.iter_mut().for_each(|x| *x -= mean);
        values
    };
    let mut seen: Vec<Vec<f64>> = own.iter().map(|_| centred("angle")).collect();
    others.retain(|(n, ..)| {
        let values = centred(n);
        let once_more = seen
            .iter()
            .any(|other| similarity(other, &values) > SAME_JOINT);
        if !once_more {
            seen.push(values);
        }
        !once_more && seen.len() <= MOST_JOINTS + 1
    });
    others.truncate(MOST_JOINTS);
    (own, others)
}

/// Sums of joint angles: the angle of a link behind several joints about parallel axes.
///
/// The torque of a weight about a joint is a sine and cosine of its own angle, with factors that
/// depend on the others: each sum contains it. Three angles have plus signs, and the other two
/// follow each other, so that the forms are few.
fn sums(ctx: &Context) -> Vec<Angle> {
    let (own, others) = joints(ctx);
    let mut chains: Vec<(Vec<&Angle>, &str)> = Vec::new();
    match &own {
        Some(own) => {
            let pairs = others.iter().flat_map(|b| [(b, "+"), (b, "-")]);
            chains.extend(pairs.map(|(b, sign)| (vec![own, b], sign)));
            chains.extend(others.windows(2).map(|w| (vec![own, &w[0], &w[1]], "+")));
        }
        None => {
            for (i, a) in others.iter().enumerate() {
                let pairs = others[i + 1..].iter().flat_map(|b| [(b, "+"), (b, "-")]);
                chains.extend(pairs.map(|(b, sign)| (vec![a, b], sign)));
            }
            chains.extend(others.windows(3).map(|w| (w.iter().collect(), "+")));
        }
    }
    let of = |(joints, sign): (Vec<&Angle>, &str)| sum(ctx, &joints, sign);
    chains.into_iter().filter_map(of).collect()
}

/// The sum of angles, or their difference; `None` if it does not move.
pub(super) fn sum(ctx: &Context, joints: &[&Angle], sign: &str) -> Option<Angle> {
    let written = |part: &dyn Fn(&Angle) -> String| {
        let all: Vec<String> = joints.iter().map(|a| part(a)).collect();
        all.join(&format!(" {sign} "))
    };
    let text = format!("({})", written(&|a| a.1.clone()));
    let (lo, hi) = ctx.range(&text)?;
    Some((written(&|a| a.0.clone()), text, hi - lo))
}

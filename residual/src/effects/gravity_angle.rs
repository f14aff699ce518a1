//! Weight of a part that turns with an angle.

use super::{Context, Effect, EffectKind, Estimate, Param, Piece, Psi, Variant};

use crate::format::num;
use crate::linalg::similarity;
use crate::stats;

/// Shortest arc in radians over which sine and cosine are no parabola.
const SHORTEST_ARC: f64 = 1.2;

pub(crate) struct GravityAngle;

impl Effect for GravityAngle {
    fn kind(&self) -> EffectKind {
        EffectKind::GravityAngle
    }
    fn meaning(&self) -> &'static str {
        "gravity: the weight of a part acts with the sine and cosine of its angle, whatever the load"
    }
    fn experiment(&self) -> &'static str {
        "turn through the whole range slowly with no load; repeat with the mount turned by a quarter"
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let mut all = ctx.angles().into_iter().chain(sums(ctx));
        too_short(&all.find(|(n, ..)| n == e.label)?)
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let all = ctx.angles().into_iter().chain(sums(ctx));
        let own = all.filter(|(n, ..)| *n == form.label);
        own.map(|(_, q, _)| q).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.unit();
        ctx.angles()
            .into_iter()
            .filter(|a| a.0 != "angle" || turns_little(a))
            .chain(sums(ctx))
            .map(|(n, q, _)| {
                let pieces = vec![
                    Piece::new("sine", unit, format!("sin({q})")),
                    Piece::new("cosine", unit, format!("cos({q})")),
                ];
                let mut v = Variant::linear(&n, pieces).with(weight);
                v.psi = Some(Psi {
                    name: "order",
                    unit: "1/turn".into(),
                    grid: vec![1.0],
                    refine: false,
                    resolution: None,
                });
                v
            })
            .collect()
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

/// Turns from which on a weight on the shaft is a ripple of order one, and the angle is that of a motor rather than of a joint.
const MOST_TURNS: f64 = 1.5;

/// Whether an angle moves as that of a joint does.
pub(super) fn turns_little((_, _, range): &Angle) -> bool {
    *range < MOST_TURNS * std::f64::consts::TAU
}

/// Most joints of which sums are tried.
const MOST_JOINTS: usize = 8;

/// Squared correlation with the angle above which a pose is the same joint once more.
const SAME_JOINT: f64 = 0.998;

/// The angle of the joint whose torque is the target, and those of the other joints. The angle is `None` where it is no joint's: where
/// it is a length, or turns many times.
pub(super) fn joints(ctx: &Context) -> (Option<Angle>, Vec<Angle>) {
    let (own, mut others): (Vec<_>, Vec<_>) =
        ctx.angles().into_iter().partition(|(n, ..)| n == "angle");
    let own = own.into_iter().find(turns_little);
    if own.is_some() {
        let centred = |n: &str| {
            let mut values = ctx.values(n);
            let mean = stats::mean(&values);
            values.iter_mut().for_each(|x| *x -= mean);
            values
        };
        let angle = centred("angle");
        let same = |n: &str| similarity(&angle, &centred(n)) > SAME_JOINT;
        others.retain(|(n, ..)| !same(n));
    }
    others.truncate(MOST_JOINTS);
    (own, others)
}

/// Sums of joint angles: the angle of a link behind several joints about parallel axes.
///
/// The torque of a weight about a joint is a sine and cosine of its own angle, with factors that depend on the others: each sum
/// contains it. Three angles have plus signs, and the other two follow each other, so that the forms are few.
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

fn weight(_: f64, coef: &[f64], pieces: &[Piece], _: &Psi) -> Vec<Param> {
    let unit = pieces.first().map(|p| p.unit.clone()).unwrap_or_default();
    let (s, c) = (
        coef.first().copied().unwrap_or(0.0),
        coef.get(1).copied().unwrap_or(0.0),
    );
    vec![
        Param {
            name: "amplitude".into(),
            value: s.hypot(c),
            unit,
        },
        Param {
            name: "phase".into(),
            value: c.atan2(s),
            unit: "rad".into(),
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::knowing;

    /// Forms offered for three poses, the first of them the angle once more, and an angle with this amplitude in rad.
    fn forms(amplitude: f64, effect: &dyn Effect) -> Vec<String> {
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..1200).map(|i| f(0.02 * i as f64)).collect()
        };
        let columns = [
            ("target", of(&|t| (0.7 * t).sin())),
            ("angle", of(&|t| amplitude * (0.9 * t).sin())),
            ("velocity", of(&|t| amplitude * 0.9 * (0.9 * t).cos())),
            ("q1", of(&|t| 0.3 - amplitude * (0.9 * t).sin())),
            ("q2", of(&|t| (0.5 * t).sin())),
            ("q3", of(&|t| (0.31 * t).cos())),
        ];
        let pose = |n: &str| format!("pose.{n} = {{ column = \"{n}\", unit = \"rad\" }}\n");
        let spec = format!(
            "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N·m\" }}\n\
             velocity = {{ column = \"v\", unit = \"rad/s\" }}\nangle = {{ column = \"a\", unit = \"rad\" }}\n\
             {}{}{}[[terms]]\nname = \"a\"\nexpr = \"1\"\n",
            pose("q1"),
            pose("q2"),
            pose("q3")
        );
        let mut out = vec![];
        knowing(&spec, &columns, 600, |ctx| {
            out = effect.variants(ctx).into_iter().map(|v| v.label).collect();
        });
        out
    }

    /// The torque about a joint contains its own angle in every term.
    #[test]
    fn sums_contain_the_angle_of_the_joint() {
        let own = [
            "angle + q2",
            "angle - q2",
            "angle + q3",
            "angle - q3",
            "angle + q2 + q3",
        ];
        let single = ["q1", "q2", "q3", "angle"];
        let all: Vec<&str> = single.into_iter().chain(own).collect();
        assert_eq!(forms(1.0, &GravityAngle), all);
        assert_eq!(
            forms(1.0, &crate::effects::payload::Payload),
            [
                "mass on angle",
                "mass on angle and angle + q2",
                "mass on angle and angle - q2",
                "mass on angle and angle + q3",
                "mass on angle and angle - q3",
            ]
        );
    }

    /// A motor that turns many times is no joint.
    #[test]
    fn sums_are_of_the_poses_where_the_angle_is_no_joint() {
        let of = forms(30.0, &GravityAngle);
        assert!(!of.iter().any(|label| label.contains("angle")), "{of:?}");
        for sum in ["q1 + q2", "q2 - q3", "q1 + q2 + q3"] {
            assert!(of.iter().any(|label| label == sum), "{of:?}");
        }
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("gravity_angle", |s| 0.5 * (s.pose + 0.7).sin());
    }
}

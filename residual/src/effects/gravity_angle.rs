//! Weight of a part that turns with an angle.

use super::{Context, Effect, EffectKind, Estimate, Param, Piece, Psi, Variant};

use crate::format::num;

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
        let single = ctx.angles();
        let all = sums(ctx, &single).into_iter().chain(single.clone());
        let own = all.into_iter().find(|(n, ..)| n == e.label)?;
        too_short(&own)
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let single = ctx.angles();
        let all = sums(ctx, &single).into_iter().chain(single.clone());
        let own = all.filter(|(n, ..)| *n == form.label);
        own.map(|(_, q, _)| q).collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.unit();
        let single = ctx.angles();
        let poses = single.iter().filter(|(n, ..)| n != "angle").cloned();
        let sums = sums(ctx, &poses.collect::<Vec<_>>());
        single
            .into_iter()
            .chain(sums)
            .filter(|(n, _, range)| n != "angle" || *range < 1.5 * std::f64::consts::TAU)
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

/// Why an angle (name, expression, range in radians) cannot show a weight that turns with it.
pub(super) fn too_short((name, _, range): &(String, String, f64)) -> Option<String> {
    (*range < SHORTEST_ARC).then(|| {
        format!(
            "{name} moves by {} rad only: over so short an arc a weight is no different from any parabola",
            num(*range)
        )
    })
}

/// Most joints of which sums are tried.
const MOST_JOINTS: usize = 8;

/// Sums and differences of two joint angles: the angle of a link behind two joints about parallel axes. Name, expression in
/// radians, range in radians.
fn sums(ctx: &Context, joints: &[(String, String, f64)]) -> Vec<(String, String, f64)> {
    let mut out = Vec::new();
    for (i, (a, qa, _)) in joints.iter().enumerate().take(MOST_JOINTS) {
        for (b, qb, _) in &joints[i + 1..joints.len().min(MOST_JOINTS)] {
            for (name, sign) in [("+", "+"), ("-", "-")] {
                let text = format!("({qa} {sign} {qb})");
                if let Some((lo, hi)) = ctx.range(&text) {
                    out.push((format!("{a} {name} {b}"), text, hi - lo));
                }
            }
        }
    }
    out
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
    #[test]
    fn is_named() {
        crate::effects::testbench::names("gravity_angle", |s| 0.5 * (s.pose + 0.7).sin());
    }
}

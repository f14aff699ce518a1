//! Weight of a part that turns with an angle.

use super::{Context, Effect, EffectKind, Param, Piece, Psi, Variant};

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
    fn against(&self, ctx: &Context) -> String {
        ctx.angles()
            .first()
            .map_or_else(|| ctx.load.clone(), |a| a.1.clone())
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.unit();
        ctx.angles()
            .into_iter()
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

//! A ripple locked to an angle: reel run-out, gear mesh, cogging.

use super::{
    amplitude_phase, spectrum, Build, Context, Effect, EffectKind, Form, Found, Piece, Psi, Remedy,
    Variant,
};

pub(crate) struct PeriodicAngle;

impl Effect for PeriodicAngle {
    fn kind(&self) -> EffectKind {
        EffectKind::PeriodicAngle
    }
    fn meaning(&self) -> &'static str {
        "a ripple locked to the angle (eccentric reel, gear mesh, cogging), by order per turn and phase"
    }
    fn experiment(&self) -> &'static str {
        "turn slowly through many turns at two different speeds: the ripple keeps its order per turn, while its frequency follows the speed"
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.position.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Ripple {
            order: (found.get)("order"),
            amplitude: (found.get)("amplitude"),
            phase: (found.get)("phase"),
            of_load: found.form == Form::ShareOfLoad,
        }]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let Some(x) = ctx.position.clone() else {
            return vec![];
        };
        let Some(k) = Context::radians(&ctx.position_unit()) else {
            return vec![];
        };
        let angle = ctx.values(&format!("({x}) * {k}"));
        let Some((lo, hi)) = ctx.range(&x) else {
            return vec![];
        };
        let turns = (hi - lo) * k / std::f64::consts::TAU;
        if turns < 0.05 {
            return vec![];
        }
        // Below one and a half periods in the range a ripple is a curve like any other.
        let lowest = (1.5 / turns).max(0.02);
        let highest =
            400.0f64.min(spectrum::highest_frequency(ctx.problem, &angle) * std::f64::consts::TAU);
        let turns_of: Vec<f64> = angle.iter().map(|a| a / std::f64::consts::TAU).collect();
        let mut out = Vec::new();
        for (label, with_load) in [("ripple", false), ("ripple in proportion to load", true)] {
            if with_load && ctx.range(&ctx.load).is_none() {
                continue;
            }
            let weight = if with_load {
                ctx.values(&ctx.load)
            } else {
                vec![]
            };
            let mut grid = spectrum::proposals(
                ctx,
                &turns_of,
                &weight,
                &spectrum::Look {
                    lowest,
                    highest,
                    coherent: true,
                    lines: false,
                },
            );
            if turns < 1.5 {
                // Order one over less than a turn and a half is gravity's.
                grid.retain(|o| (o - 1.0).abs() > 0.05);
            }
            if grid.is_empty() {
                continue;
            }
            let factor = if with_load {
                format!(" * {}", ctx.load)
            } else {
                String::new()
            };
            let unit = if with_load {
                "1".to_string()
            } else {
                ctx.unit().to_string()
            };
            let x = x.clone();
            out.push(
                Variant::profiled(
                    label,
                    Psi {
                        name: "order",
                        unit: "1/turn".into(),
                        grid,
                        refine: true,
                        resolution: Some(0.6 / turns),
                    },
                    move |n| {
                        let w = n * k;
                        Build::Add(vec![
                            Piece::new("sine", unit.clone(), format!("sin({w} * {x}){factor}")),
                            Piece::new("cosine", unit.clone(), format!("cos({w} * {x}){factor}")),
                        ])
                    },
                )
                .with(amplitude_phase)
                .form(if with_load {
                    Form::ShareOfLoad
                } else {
                    Form::Other
                }),
            );
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("periodic_angle", |s| 0.3 * (3.0 * s.angle + 0.4).sin());
    }
}

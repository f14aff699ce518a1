//! A sine of constant frequency: mains, a fan, an alias of something faster.

use super::{amplitude_phase, spectrum, Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Tone;

impl Effect for Tone {
    fn kind(&self) -> EffectKind {
        EffectKind::Tone
    }
    fn meaning(&self) -> &'static str {
        "a tone of constant frequency in time, independent of the motion (mains, fan, or the alias of something above half the row rate)"
    }
    fn experiment(&self) -> &'static str {
        "log at rest with the drive off, at two sampling rates: a true tone keeps its frequency, an alias moves"
    }
    fn against(&self, _: &Context) -> String {
        "elapsed".into()
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let time = ctx.values("time");
        let highest = spectrum::highest_frequency(ctx.problem, &time);
        let lowest = (5.0 / ctx.span).min(0.2 * highest);
        let inputs: Vec<Vec<f64>> = ctx
            .velocity
            .iter()
            .cloned()
            .chain(ctx.has_command().then(|| "command".to_string()))
            .chain(ctx.spec.roles.pose.keys().cloned())
            .map(|e| ctx.values(&e))
            .filter(|v| !v.is_empty())
            .collect();
        let mut out = Vec::new();
        for (label, local) in [("one phase for all", false), ("a phase for each run", true)] {
            let mut grid = spectrum::proposals(
                ctx,
                &time,
                &[],
                &spectrum::Look {
                    lowest,
                    highest,
                    coherent: !local,
                    lines: true,
                },
            );
            // At a frequency at which the rig itself is driven, a tone cannot be told from an answer.
            grid.retain(|f| spectrum::share(ctx.problem, &time, &inputs, *f) < 0.1);
            if grid.is_empty() {
                continue;
            }
            let unit = ctx.unit().to_string();
            out.push(
                Variant::profiled(
                    label,
                    Psi {
                        name: "frequency",
                        unit: "Hz".into(),
                        grid,
                        refine: true,
                        resolution: Some(0.6 / ctx.span),
                    },
                    move |f| {
                        let w = f * std::f64::consts::TAU;
                        let pieces = vec![
                            Piece::new("sine", unit.clone(), format!("sin({w} * time)")),
                            Piece::new("cosine", unit.clone(), format!("cos({w} * time)")),
                        ];
                        if local {
                            Build::Local(pieces)
                        } else {
                            Build::Add(pieces)
                        }
                    },
                )
                .with(amplitude_phase),
            );
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("tone", |s| {
            0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
        });
    }
}

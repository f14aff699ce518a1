//! A limit that the model does not know.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Saturation;

impl Effect for Saturation {
    fn kind(&self) -> EffectKind {
        EffectKind::Saturation
    }
    fn meaning(&self) -> &'static str {
        "saturation: beyond a limit the target no longer follows the command"
    }
    fn experiment(&self) -> &'static str {
        "ramp the command slowly beyond the suspected limit and back"
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        if ctx.declared_columns().iter().any(|d| d == "command") {
            let mut v = ctx.values("command");
            v.sort_by(f64::total_cmp);
            let unit = ctx.spec.roles.unit("command");
            let qs = [
                0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.84, 0.88, 0.91, 0.94, 0.96, 0.98, 0.99,
            ];
            let mut upper: Vec<f64> = qs.iter().map(|q| stats_q(&v, *q)).collect();
            upper.dedup();
            if upper.len() > 2 {
                let psi = Psi {
                    name: "upper_limit",
                    unit: unit.clone(),
                    grid: upper,
                    refine: true,
                    resolution: None,
                };
                out.push(Variant::profiled("of the command, above", psi, |c| {
                    Build::Swap(vec![("command".into(), format!("min(command, {c})"))])
                }));
            }
            let mut lower: Vec<f64> = qs.iter().rev().map(|q| stats_q(&v, 1.0 - *q)).collect();
            lower.dedup();
            if lower.len() > 2 {
                let psi = Psi {
                    name: "lower_limit",
                    unit: unit.clone(),
                    grid: lower,
                    refine: true,
                    resolution: None,
                };
                out.push(Variant::profiled("of the command, below", psi, |c| {
                    Build::Swap(vec![("command".into(), format!("max(command, {c})"))])
                }));
            }
            let (lo, hi) = (stats_q(&v, 0.02), stats_q(&v, 0.98));
            if lo < 0.0 && hi > 0.0 {
                let top = hi.max(-lo);
                let grid = (0..14)
                    .map(|i| top * (0.35 + 0.05 * f64::from(i)))
                    .collect();
                out.push(Variant::profiled(
                    "of the command, both ways",
                    Psi {
                        name: "limit",
                        unit,
                        grid,
                        refine: true,
                        resolution: None,
                    },
                    |c| {
                        Build::Swap(vec![(
                            "command".into(),
                            format!("clip(command, {}, {c})", -c),
                        )])
                    },
                ));
            }
        } else if let Some((lo, hi)) = ctx.range(&ctx.load) {
            let grid = (0..14)
                .map(|i| lo + (hi - lo) * (0.4 + 0.042 * f64::from(i)))
                .collect();
            let load = ctx.load.clone();
            out.push(Variant::profiled(
                "of the prediction",
                Psi {
                    name: "upper_limit",
                    unit: ctx.unit().into(),
                    grid,
                    refine: true,
                    resolution: None,
                },
                move |c| {
                    Build::Add(vec![Piece::new(
                        "share_lost",
                        "1",
                        format!("min(0, {c} - {load})"),
                    )])
                },
            ));
        }
        out
    }
}

fn stats_q(v: &[f64], q: f64) -> f64 {
    crate::stats::quantile_sorted(v, q)
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("saturation", |s| s.command.min(4.2) - s.command);
    }
}

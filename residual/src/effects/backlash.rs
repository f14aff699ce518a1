//! Lost motion: the driven side stands still while the gap is crossed.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Backlash;

impl Effect for Backlash {
    fn kind(&self) -> EffectKind {
        EffectKind::Backlash
    }
    fn meaning(&self) -> &'static str {
        "backlash: after a reversal the drive crosses a gap before the output follows"
    }
    fn experiment(&self) -> &'static str {
        "reverse slowly with small amplitudes around the gap: the output stands still inside it, with sharp corners"
    }
    fn against(&self, ctx: &Context) -> String {
        ctx.position.clone().unwrap_or_else(|| ctx.load.clone())
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        let declared = ctx.declared_columns();
        for name in ["command", "angle"] {
            if !declared.iter().any(|d| d == name) {
                continue;
            }
            let Some((lo, hi)) = ctx.range(name) else {
                continue;
            };
            let grid = Context::log_grid(0.01 * (hi - lo), 0.6 * (hi - lo), 12);
            let unit = ctx.spec.roles.unit(name);
            out.push(Variant::profiled(
                &format!("gap in {name}"),
                Psi {
                    name: "gap",
                    unit,
                    grid,
                    refine: true,
                    resolution: None,
                },
                move |w| Build::Swap(vec![(name.to_string(), format!("play({name}, {w})"))]),
            ));
        }
        // The position is not in the declared model: the gap shows as an elastic-plastic loop.
        if let (Some(_), Some(x)) = (&ctx.spec.roles.angle, ctx.position.clone()) {
            if !declared.iter().any(|d| d == "angle") {
                if let Some((lo, hi)) = ctx.range(&x) {
                    let grid = Context::log_grid(0.01 * (hi - lo), 0.6 * (hi - lo), 12);
                    let per = ctx.per(&ctx.position_unit());
                    out.push(Variant::profiled(
                        "gap in position",
                        Psi {
                            name: "gap",
                            unit: ctx.position_unit(),
                            grid,
                            refine: true,
                            resolution: None,
                        },
                        move |w| {
                            Build::Add(vec![Piece::new(
                                "stiffness",
                                per.clone(),
                                format!("stop({x}, {w})"),
                            )])
                        },
                    ));
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        let mut play = 0.0;
        crate::effects::testbench::names("backlash", move |s| {
            if s.first {
                play = s.command;
            }
            play = f64::clamp(play, s.command - 0.3, s.command + 0.3);
            play - s.command
        });
    }
}

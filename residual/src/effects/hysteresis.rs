//! A loop with memory of the path, over a good part of the range.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Hysteresis;

impl Effect for Hysteresis {
    fn kind(&self) -> EffectKind {
        EffectKind::Hysteresis
    }
    fn meaning(&self) -> &'static str {
        "hysteresis: a loop that depends on the path of load or position, not on speed, and turns gradually"
    }
    fn experiment(&self) -> &'static str {
        "ramp the load (or position) slowly up and down with shrinking amplitude, at two speeds: the loops nest and don't change with speed"
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut drivers = Vec::new();
        if ctx.has_command() {
            drivers.push(("load", ctx.load.clone(), ctx.unit().to_string()));
        }
        if let (Some(_), Some(x)) = (&ctx.spec.roles.angle, &ctx.position) {
            drivers.push(("position", x.clone(), ctx.position_unit()));
        }
        let unit = ctx.unit().to_string();
        drivers
            .into_iter()
            .filter_map(|(name, x, xu)| {
                let (lo, hi) = ctx.range(&x)?;
                // Shorter turning widths belong to `presliding`.
                let grid = Context::log_grid(0.025 * (hi - lo), 0.8 * (hi - lo), 11);
                let unit = unit.clone();
                Some(Variant::profiled(
                    &format!("loop of {name}"),
                    Psi {
                        name: "turning_width",
                        unit: xu,
                        grid,
                        refine: true,
                        resolution: None,
                    },
                    move |d| {
                        Build::Add(vec![Piece::new(
                            "half_height",
                            unit.clone(),
                            format!("dahl({x}, {d})"),
                        )])
                    },
                ))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        let (mut z, mut last) = (0.0, 0.0);
        crate::effects::testbench::names("hysteresis", move |s| {
            if s.first {
                (z, last) = (0.0, s.command);
            }
            let dx: f64 = s.command - last;
            last = s.command;
            let sg = if dx >= 0.0 { 1.0 } else { -1.0 };
            z = sg + (z - sg) * (-dx.abs() / 0.8).exp();
            0.4 * z
        });
    }
}

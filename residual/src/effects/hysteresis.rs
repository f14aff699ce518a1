//! A loop with memory of the path, over a good part of the range.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};

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
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let column = if e.label.contains("position") {
            "angle"
        } else {
            "command"
        };
        e.below_step("turning_width", ctx.step_of(column), column)
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        match &ctx.position {
            Some(x) if form.label.contains("position") => vec![x.clone()],
            _ => vec![ctx.load.clone()],
        }
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
        let grid = |x: &str| {
            let (lo, hi) = ctx.range(x)?;
            // Shorter turning widths belong to `presliding`.
            Some(Context::log_grid(0.025 * (hi - lo), 0.8 * (hi - lo), 11))
        };
        let width = |unit: &str, grid: Vec<f64>| Psi {
            name: "turning_width",
            unit: unit.into(),
            grid,
            refine: true,
            resolution: None,
        };
        let mut out = Vec::new();
        for (name, x, xu) in drivers {
            let Some(grid) = grid(&x) else {
                continue;
            };
            // Gradual turns as of Dahl's model, sharp ones as of a spring that slips.
            let (dahl, own) = (x.clone(), unit.clone());
            out.push(Variant::profiled(
                &format!("loop of {name}"),
                width(&xu, grid.clone()),
                move |d| {
                    let text = format!("dahl({dahl}, {d})");
                    Build::Add(vec![Piece::new("half_height", own.clone(), text)])
                },
            ));
            if name != "position" {
                continue;
            }
            let (stop, own) = (x.clone(), unit.clone());
            out.push(Variant::profiled(
                "loop of position with sharp corners",
                width(&xu, grid.clone()),
                move |d| {
                    let text = format!("stop({stop}, {d}) * {}", 2.0 / d);
                    Build::Add(vec![Piece::new("half_height", own.clone(), text)])
                },
            ));
            if ctx.range(&ctx.load).is_none() {
                continue;
            }
            let load = ctx.load.clone();
            out.push(Variant::profiled(
                "loop of position, in proportion to load",
                width(&xu, grid),
                move |d| {
                    let text = format!("dahl({x}, {d}) * abs({load})");
                    Build::Add(vec![Piece::new("half_height_per_load", "1", text)])
                },
            ));
        }
        out
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

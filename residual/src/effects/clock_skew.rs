//! Clocks of command and target that run at different rates.

use super::{Build, Context, Effect, EffectKind, Psi, Variant};

pub(crate) struct ClockSkew;

impl Effect for ClockSkew {
    fn kind(&self) -> EffectKind {
        EffectKind::ClockSkew
    }
    fn meaning(&self) -> &'static str {
        "clock skew: the clocks of command and target run at different rates, so the lag between them grows along the run"
    }
    fn experiment(&self) -> &'static str {
        "repeat one sharp event at the start and at the end of a long run and compare the lag"
    }
    fn against(&self, ctx: &Context) -> String {
        // The lag grows with the time, and shows in proportion to the slope of the load.
        format!("elapsed * deriv({}, 2)", ctx.load)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let names = ctx.declared_columns();
        if names.is_empty() || ctx.span < 200.0 * ctx.dt {
            return vec![];
        }
        let one = ctx.dt / ctx.span;
        let mut half = Context::log_grid(0.03 * one, 60.0 * one, 20);
        half.retain(|r| *r < 0.05);
        let grid: Vec<f64> = half
            .iter()
            .rev()
            .map(|r| -r)
            .chain(half.iter().copied())
            .collect();
        vec![Variant::profiled(
            "rate of the inputs' clock",
            Psi {
                name: "skew",
                unit: "s/s".into(),
                grid,
                refine: true,
                resolution: None,
            },
            move |r| {
                Build::Swap(
                    names
                        .iter()
                        .map(|n| (n.clone(), format!("warp({n}, {r})")))
                        .collect(),
                )
            },
        )]
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("clock_skew", |s| {
            s.command_at(s.elapsed * 1.004) - s.command
        });
    }
}

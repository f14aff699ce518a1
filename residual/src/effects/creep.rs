//! Creep: a slow part of the response of sensor or cable to a load.

use super::{Build, Context, Effect, EffectKind, Piece, Psi, Variant};

pub(crate) struct Creep;

impl Effect for Creep {
    fn kind(&self) -> EffectKind {
        EffectKind::Creep
    }
    fn meaning(&self) -> &'static str {
        "creep: part of the response to a load is slow, with a time constant of its own"
    }
    fn experiment(&self) -> &'static str {
        "hold a load for many time constants, remove it, and record the return to zero"
    }
    fn against(&self, _: &Context) -> String {
        "elapsed".into()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        if ctx.range(&ctx.load).is_none() {
            return vec![];
        }
        // Under a load that never changes within a run, creep is like any other start-up transient.
        let size = crate::stats::rms(&ctx.values(&ctx.load));
        let change =
            crate::stats::rms(&ctx.values(&format!("{} - seqmean({})", ctx.load, ctx.load)));
        if change < 0.02 * size {
            return vec![];
        }
        let grid = Context::log_grid(15.0 * ctx.dt, 2.0 * ctx.span, 12);
        let psi = || Psi {
            name: "time_constant",
            unit: "s".into(),
            grid: grid.clone(),
            refine: true,
            resolution: None,
        };
        let (a, b) = (ctx.load.clone(), ctx.load.clone());
        vec![
            Variant::profiled("since the load came on", psi(), move |tau| {
                Build::Add(vec![Piece::new(
                    "creep_share",
                    "1",
                    format!("charge({a}, {tau})"),
                )])
            }),
            Variant::profiled("about an old equilibrium", psi(), move |tau| {
                Build::Add(vec![Piece::new(
                    "creep_share",
                    "1",
                    format!("lowpass({b}, {tau}) - {b}"),
                )])
            }),
        ]
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        let mut z = 0.0;
        crate::effects::testbench::names("creep", move |s| {
            if s.first {
                z = 0.0;
            }
            z += (s.command - z) * (1.0 - (-s.dt / 8.0f64).exp());
            0.2 * z
        });
    }
}

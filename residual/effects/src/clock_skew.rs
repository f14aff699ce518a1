//! Clocks of command and target that run at different rates.

use super::delay::inputs;
use super::{Build, Context, Effect, EffectKind, Psi, Variant};

pub struct ClockSkew;

/// Constant lags that are tried up to the one that a skew reaches at the end of a run.
const CONSTANT_LAGS: i32 = 12;

impl Effect for ClockSkew {
    fn kind(&self) -> EffectKind {
        EffectKind::ClockSkew
    }
    fn against(&self, ctx: &Context) -> String {
        // The lag grows with the time, and shows in proportion to the slope of the load.
        format!("elapsed * deriv({}, 2)", ctx.load)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let declared = ctx.declared_columns();
        if declared.is_empty() || ctx.span < 200.0 * ctx.dt {
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
        let psi = || Psi::new("skew", "s/s", grid.clone());
        let mut out = Vec::new();
        if ctx.columns.iter().any(|n| n != "command") {
            // All inputs, those of effects that were found or will be found as well.
            let all = inputs(ctx);
            out.push(Variant::profiled(
                "rate of the inputs' clock",
                psi(),
                move |r| {
                    let warp = |n: &String| (n.clone(), format!("warp({n}, {r})"));
                    Build::SwapAll(all.iter().map(warp).collect())
                },
            ));
        }
        if declared.iter().any(|n| n == "command") {
            // Drive and sensors have a clock each: the motion is logged by that of the target.
            out.push(Variant::profiled(
                "rate of the command's clock",
                psi(),
                |r| Build::Swap(vec![("command".into(), format!("warp(command, {r})"))]),
            ));
        }
        out
    }
    /// A lag that is the same all along the run, up to twice the one that the skew reaches.
    fn must_surpass(&self, form: &Variant, skew: f64, ctx: &Context) -> Vec<Variant> {
        let build = (form.build)(skew);
        let (names, everywhere): (Vec<String>, _) = match build {
            Build::Swap(pairs) => (pairs.into_iter().map(|(n, _)| n).collect(), false),
            Build::SwapAll(pairs) => (pairs.into_iter().map(|(n, _)| n).collect(), true),
            _ => return vec![],
        };
        let end = skew * ctx.span;
        let psi = Psi::new(
            "delay",
            "s",
            (-CONSTANT_LAGS..=2 * CONSTANT_LAGS)
                .map(|k| -end * f64::from(k) / f64::from(CONSTANT_LAGS))
                .collect(),
        )
        .given();
        let constant = Variant::profiled("a constant delay", psi, move |lag| {
            let delay = |n: &String| (n.clone(), format!("delay({n}, {lag})"));
            let pairs = names.iter().map(delay).collect();
            if everywhere {
                Build::SwapAll(pairs)
            } else {
                Build::Swap(pairs)
            }
        });
        vec![constant]
    }
}

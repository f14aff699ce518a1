//! A lag of the reading: all that the target shows has gone through one filter of first order.

use super::cable_stretch::lags;
use super::delay::as_held;
use super::{Build, Context, Effect, EffectKind, Estimate, Found, Psi, Remedy, Setting, Variant};
use residual_fit::problem::EVERYTHING;

pub struct SensorLag;

impl Effect for SensorLag {
    fn kind(&self) -> EffectKind {
        EffectKind::SensorLag
    }
    fn against(&self, ctx: &Context) -> String {
        // A late reading is off by the time constant times this slope.
        format!("deriv({}, 2)", ctx.load)
    }
    fn setting(&self) -> Option<Setting> {
        Some(Setting::Delay)
    }
    /// For a loop slower than the lag, a first-order lag is a delay of its time constant.
    fn remedies(&self, found: &Found) -> Vec<Remedy> {
        vec![Remedy::Delay((found.get)("time_constant"))]
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        e.outside(
            "time_constant",
            0.0,
            ctx.span,
            "longer than the longest run",
        )
        .or_else(|| as_held(e.get("time_constant")?, ctx))
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        // Of the command alone it is the lag of `cable_stretch`.
        if ctx.columns.iter().all(|n| n == "command") {
            return vec![];
        }
        let psi = Psi::new("time_constant", "s", lags(ctx));
        let through = |tau| Build::Through(format!("lowpass({EVERYTHING}, {tau})"));
        vec![Variant::profiled("of everything", psi, through)]
    }
}

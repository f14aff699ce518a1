//! A slew limit: the target follows the command at a limited rate.

use super::{ratio, Build, Context, Effect, EffectKind, Psi, Variant};
use residual_columns::stats;

pub struct SlewLimit;

/// Slowest rate that is looked for, over the mean rate of the command: below it the target would
/// lose most of what the command does.
const SLOWEST: f64 = 0.2;

/// Factor between values of the rate.
const FURTHER: f64 = 1.3;

impl Effect for SlewLimit {
    fn kind(&self) -> EffectKind {
        EffectKind::SlewLimit
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        if !ctx.declared_columns().iter().any(|d| d == "command") {
            return vec![];
        }
        let rates = ctx.values("abs(deriv(command, 1))");
        let (slowest, fastest) = (
            SLOWEST * stats::mean(&rates),
            rates.iter().copied().fold(0.0, f64::max),
        );
        if slowest <= 0.0 {
            return vec![];
        }
        let grid = Context::grid_by_ratio(slowest, fastest, FURTHER);
        let unit = ratio(&ctx.spec.roles.unit("command"), "s");
        let form = |label: &str, command: String| {
            let psi = Psi::new("rate_limit", unit.clone(), grid.clone());
            Variant::profiled(label, psi, move |rate| {
                let limited = format!("slew({command}, {rate})");
                Build::Swap(vec![("command".into(), limited)])
            })
        };
        let mut out = vec![form("of the command", "command".into())];
        if ctx.is_stepped("command") {
            // A step acts from its row on, so the target is under way in the next one.
            let label = "of the command, which is held between rows";
            out.push(form(label, format!("delay(command, {})", ctx.dt)));
        }
        out
    }
}

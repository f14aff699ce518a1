//! Drift along the run.

use super::{Context, Effect, EffectKind, Estimate, Piece, Variant};
use crate::stats;

/// Share of the angle's variance that is no line in time, up to which the angle only says what time it is.
const STRAIGHT: f64 = 1e-3;

pub(crate) struct DriftTime;

impl Effect for DriftTime {
    fn kind(&self) -> EffectKind {
        EffectKind::DriftTime
    }
    fn meaning(&self) -> &'static str {
        "drift: an error that grows steadily with time"
    }
    fn experiment(&self) -> &'static str {
        "hold one load for a long time at constant temperature; repeat the run with the order of loads reversed"
    }
    fn axes(&self, form: &Variant, _: f64, _: &Context) -> Vec<String> {
        let clock = form.label == "by the clock";
        vec![if clock { "time" } else { "elapsed" }.into()]
    }
    fn impossible(&self, _: &Estimate, ctx: &Context) -> Option<String> {
        let angle = ctx.values(ctx.position.as_ref()?);
        let (_, rest) = stats::line(&ctx.values("elapsed"), &angle)?;
        let mean = stats::mean(&angle);
        let all: f64 = angle.iter().map(|a| (a - mean).powi(2)).sum();
        (rest < STRAIGHT * all).then(|| {
            "the position grows with time in one line: what depends on it looks the same".into()
        })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.per("s");
        let mut out = vec![Variant::linear(
            "since the start of the run",
            vec![Piece::new("drift", unit.clone(), "elapsed")],
        )];
        let starts: Vec<f64> = ctx
            .problem
            .frame
            .sequences()
            .iter()
            .map(|r| ctx.problem.frame.time()[r.start])
            .collect();
        if starts.iter().any(|s| (s - starts[0]).abs() > ctx.span) {
            out.push(Variant::linear(
                "by the clock",
                vec![Piece::new("drift", unit, "time")],
            ));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("drift_time", |s| 0.01 * s.elapsed);
    }
}

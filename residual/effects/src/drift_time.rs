//! Drift along the run.

use super::{Context, Effect, EffectKind, Estimate, Piece, Variant};
use residual_columns::stats;

/// Share of the angle's variance that is no line in time, up to which the angle only says what time
/// it is.
const STRAIGHT: f64 = 1e-3;

/// The same for the velocity: friction grows with it on any machine, and steps of the speed are no
/// line.
const NEARLY_STRAIGHT: f64 = 0.05;

pub struct DriftTime;

impl Effect for DriftTime {
    fn kind(&self) -> EffectKind {
        EffectKind::DriftTime
    }
    fn axes(&self, form: &Variant, _: f64, _: &Context) -> Vec<String> {
        let clock = form.label == "by the clock";
        vec![if clock { "time" } else { "elapsed" }.into()]
    }
    fn impossible(&self, _: &Estimate, ctx: &Context) -> Option<String> {
        let straight = |text: &Option<String>, most: f64| {
            let values = ctx.values(text.as_ref()?);
            let (_, rest) = stats::line(&ctx.values("elapsed"), &values)?;
            let mean = stats::mean(&values);
            let all: f64 = values.iter().map(|a| (a - mean).powi(2)).sum();
            Some(rest < most * all)
        };
        let found = [
            ("position", straight(&ctx.position, STRAIGHT)),
            ("velocity", straight(&ctx.velocity, NEARLY_STRAIGHT)),
        ];
        let (name, _) = found.into_iter().find(|(_, is)| *is == Some(true))?;
        Some(format!(
            "the {name} grows or falls with time in one line: what depends on it looks the same"
        ))
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

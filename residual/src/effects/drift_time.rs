//! Drift along the run.

use super::{Context, Effect, EffectKind, Estimate, Piece, Variant};
use crate::stats;

/// Share of the angle's variance that is no line in time, up to which the angle only says what time it is.
const STRAIGHT: f64 = 1e-3;

/// The same for the velocity: friction grows with it on any machine, and steps of the speed are no line.
const NEARLY_STRAIGHT: f64 = 0.05;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testbench::knowing;
    use crate::effects::Form;

    /// A motor whose speed is lowered step by step: damping falls with time as a drift would.
    #[test]
    fn a_speed_that_falls_with_time_is_no_drift() {
        let rows = 1200;
        let refused = |speed: &dyn Fn(usize) -> f64| {
            let velocity: Vec<f64> = (0..rows).map(speed).collect();
            let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                        velocity = { column = \"v\", unit = \"rad/s\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
            let columns = [("target", velocity.clone()), ("velocity", velocity)];
            let mut out = false;
            knowing(spec, &columns, rows, |ctx| {
                let estimate = Estimate {
                    form: Form::Other,
                    label: "since the start of the run",
                    params: &[],
                    intervals: &Default::default(),
                };
                out = DriftTime.impossible(&estimate, ctx).is_some();
            });
            out
        };
        assert!(refused(&|i| 10.0 - (i / 100) as f64));
        assert!(!refused(&|i| (0.05 * i as f64).sin()));
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("drift_time", |s| 0.01 * s.elapsed);
    }
}

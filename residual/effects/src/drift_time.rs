//! Drift along the run.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};
use residual_columns::stats;

/// Share of the angle's variance that is no line in time, up to which the angle only says what time
/// it is.
const STRAIGHT: f64 = 1e-3;

/// The same for the velocity: friction grows with it on any machine, and steps of the speed are no
/// line.
const NEARLY_STRAIGHT: f64 = 0.05;

/// The form that begins anew in each run.
const SINCE_THE_START: &str = "since the start of the run";

/// Times in the longest run at which something may have begun.
const BEGINNINGS: usize = 9;

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
    /// Something that begins at one time of each run: an offset, an error of gain, a friction. What
    /// it has of a mean looks like a drift.
    fn must_surpass(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<Variant> {
        if form.label != SINCE_THE_START {
            return vec![];
        }
        let times: Vec<f64> = (1..=BEGINNINGS)
            .map(|k| ctx.span * k as f64 / (BEGINNINGS + 1) as f64)
            .collect();
        let load = ctx.range(&ctx.load).map(|_| ("a gain", ctx.load.clone()));
        let friction = ctx.velocity.iter().flat_map(|v| {
            let sign = format!("sgn({v}, {})", ctx.deadband);
            [("a friction", sign), ("a damping", v.clone())]
        });
        std::iter::once(("an offset", "1".to_string()))
            .chain(load)
            .chain(friction)
            .map(|(name, text)| {
                let psi = Psi::new("time", "s", times.clone()).given();
                let label = format!("{name} that begins in the run, at a time");
                Variant::profiled(&label, psi, move |t| {
                    let text = format!("({text}) * (elapsed > {t})");
                    Build::Add(vec![Piece::new("step", "", text)])
                })
            })
            .collect()
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let unit = ctx.per("s");
        let mut out = vec![Variant::linear(
            SINCE_THE_START,
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

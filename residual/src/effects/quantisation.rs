//! Steps: a command or a reading in whole units.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};
use crate::stats;

pub(crate) struct Quantisation;

/// Fewest steps in the range of a signal that make it a quantised one.
const FEWEST_STEPS: f64 = 3.0;

impl Effect for Quantisation {
    fn kind(&self) -> EffectKind {
        EffectKind::Quantisation
    }
    fn meaning(&self) -> &'static str {
        "quantisation: the command takes effect, or the target is read, only in whole steps"
    }
    fn experiment(&self) -> &'static str {
        "ramp the command so slowly that many rows fall on each step"
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let signal = if e.label == "of the target" {
            &ctx.load
        } else {
            "command"
        };
        let most = ctx.width(signal) / FEWEST_STEPS;
        let why = "a step of the size of the signal is no quantisation";
        e.outside("step", 0.0, most, why)
    }
    fn axes(&self, form: &Variant, psi: f64, ctx: &Context) -> Vec<String> {
        // The same saw tooth in every step.
        let (x, f) = match form.label.as_str() {
            "of the target" => (ctx.load.as_str(), "round"),
            "of the command, rounded" => ("command", "round"),
            _ => ("command", "floor"),
        };
        vec![format!("{x} - {f}({x} / {psi}) * {psi}")]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut out = Vec::new();
        if ctx.declared_columns().iter().any(|d| d == "command") {
            if let Some((lo, hi)) = ctx.range("command") {
                let grid = Context::log_grid((hi - lo) / 40.0, (hi - lo) / 1.5, 120);
                for (label, f) in [
                    ("of the command, rounded", "round"),
                    ("of the command, cut off", "floor"),
                ] {
                    let psi = Psi {
                        name: "step",
                        unit: ctx.spec.roles.unit("command"),
                        grid: grid.clone(),
                        refine: true,
                        resolution: None,
                    };
                    out.push(Variant::profiled(label, psi, move |q| {
                        Build::Swap(vec![(
                            "command".into(),
                            format!("{f}(command / {q}) * {q}"),
                        )])
                    }));
                }
            }
        }
        if let Some(q) = stats::quantum(&ctx.problem.y) {
            let load = ctx.load.clone();
            let unit = ctx.unit().to_string();
            out.push(Variant::profiled(
                "of the target",
                Psi {
                    name: "step",
                    unit,
                    grid: vec![q],
                    refine: false,
                    resolution: None,
                },
                move |q| {
                    Build::Add(vec![Piece::new(
                        "share",
                        "1",
                        format!("round({load} / {q}) * {q} - {load}"),
                    )])
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
        crate::effects::testbench::names("quantisation", |s| {
            (s.command / 0.6).round() * 0.6 - s.command
        });
    }
}
